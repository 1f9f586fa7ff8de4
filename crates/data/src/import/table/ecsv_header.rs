//! The header of an ECSV file: as much YAML as its descriptions of columns take, in block or in flow style.

use super::columns::{MOST_COMPONENTS, shown};
use crate::import::ImportError;
use std::path::Path;

/// How such files begin.
pub(super) const MARK: &str = "# %ECSV ";

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// So many numbers in each row, or `True` and `False`; several in brackets.
    Numbers(usize),
    /// Anything else.
    Text,
}

/// A column as the header describes it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Described {
    pub name: String,
    pub unit: String,
    pub kind: Kind,
}

/// What a header says.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Description {
    /// What separates values.
    pub delimiter: char,
    /// The columns in their order.
    pub columns: Vec<Described>,
}

/// Reads the lines of a header, without the marks of comments.
///
/// # Errors
/// Where there are no descriptions of columns, or one has no name or type that is known.
pub(super) fn described(path: &Path, lines: &[String]) -> Result<Description, ImportError> {
    let delimiter = match lines.iter().find_map(|line| line.strip_prefix("delimiter:")) {
        None => ' ',
        Some(stated) => match plain(stated) {
            "," => ',',
            " " | "" => ' ',
            other => return Err(ImportError::malformed(path, "delimiter", shown(other), "a comma or a space")),
        },
    };
    let Some(start) = lines.iter().position(|line| line.trim_end() == "datatype:") else {
        return Err(ImportError::missing(path, "datatype", "a description of each column in the header"));
    };
    let mut items: Vec<Vec<&str>> = Vec::new();
    let dashes = lines.get(start + 1).map_or(0, |line| indent(line));
    for line in &lines[start + 1..] {
        match line.trim_start().strip_prefix('-').filter(|_| !line.trim_start().starts_with("---")) {
            Some(rest) if indent(line) == dashes => items.push(vec![rest]),
            _ if line.starts_with(' ') || line.is_empty() => {
                if let Some(item) = items.last_mut() {
                    item.push(line);
                }
            }
            // What comes behind the descriptions.
            _ => break,
        }
    }
    let columns = items.iter().enumerate().map(|(index, item)| {
        let pairs = pairs(item);
        let value = |key: &str| pairs.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str());
        let field = format!("column {} of the header", index + 1);
        let name = value("name").filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| ImportError::missing(path, &*field, "its name"))?;
        let is_number = |kind: &str| ["bool", "int", "uint", "float"].iter().any(|known| kind.starts_with(known));
        let kind = match (value("datatype"), value("subtype")) {
            (Some("string"), Some(array)) => {
                let (kind, shape) = array.split_once('[').unwrap_or((array, ""));
                components(shape).filter(|_| is_number(kind)).map_or(Kind::Text, Kind::Numbers)
            }
            (_, Some(_)) | (Some("string" | "complex64" | "complex128" | "complex256"), _) => Kind::Text,
            (Some(kind), None) if is_number(kind) => Kind::Numbers(1),
            (found, None) => {
                let expected = "a datatype: bool, intN, uintN, floatN, complexN or string";
                return Err(ImportError::malformed(path, field, shown(found.unwrap_or("none")), expected));
            }
        };
        Ok(Described { name: name.into(), unit: value("unit").unwrap_or_default().into(), kind })
    });
    let columns = columns.collect::<Result<Vec<Described>, ImportError>>()?;
    if columns.is_empty() {
        return Err(ImportError::missing(path, "datatype", "a description of each column in the header"));
    }
    Ok(Description { delimiter, columns })
}

/// The numbers of an array with the shape `3]` or `2,3]`; `None` where each row has its own, or only one, or too many.
fn components(shape: &str) -> Option<usize> {
    let mut axes = shape.strip_suffix(']')?.split(',');
    let count = axes.try_fold(1_usize, |count, axis| count.checked_mul(axis.trim().parse().ok()?))?;
    (2..=MOST_COMPONENTS).contains(&count).then_some(count)
}

fn indent(line: &str) -> usize {
    line.len() - line.trim_start().len()
}

/// A value without space and quotes around it.
fn plain(text: &str) -> &str {
    let text = text.trim();
    let unquoted = |quote: char| text.strip_prefix(quote).and_then(|text| text.strip_suffix(quote));
    unquoted('\'').or_else(|| unquoted('"')).unwrap_or(text)
}

/// The keys of one column with their values.
fn pairs(item: &[&str]) -> Vec<(String, String)> {
    let joined = item.join(" ");
    let trimmed = joined.trim();
    let texts: Vec<&str> = match trimmed.strip_prefix('{') {
        Some(flow) => split(flow.strip_suffix('}').unwrap_or(flow)),
        None => {
            // Keys of the block itself: what is indented further belongs to the value before.
            let own = item.iter().skip(1).filter(|line| !line.trim().is_empty()).map(|line| indent(line)).min();
            item.iter()
                .enumerate()
                .filter(|(at, line)| *at == 0 || Some(indent(line)) == own)
                .map(|(_, line)| *line)
                .collect()
        }
    };
    let pair = |text: &&str| text.split_once(':').map(|(key, value)| (plain(key).to_owned(), plain(value).to_owned()));
    texts.iter().filter_map(pair).collect()
}

/// The parts between the commas of a mapping in flow style, but for those in quotes and brackets.
fn split(text: &str) -> Vec<&str> {
    let (mut parts, mut start, mut depth, mut quote) = (Vec::new(), 0, 0_usize, None);
    let mut before = ' ';
    for (at, letter) in text.char_indices() {
        match (quote, letter) {
            (Some(open), _) if letter == open => quote = None,
            (Some(_), _) => {}
            // An apostrophe inside a word is no quote.
            (None, '\'' | '"') if !before.is_alphanumeric() => quote = Some(letter),
            (None, '{' | '[' | '(') => depth += 1,
            (None, '}' | ']' | ')') => depth = depth.saturating_sub(1),
            (None, ',') if depth == 0 => {
                parts.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
        before = letter;
    }
    parts.push(&text[start..]);
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Description, String> {
        let lines: Vec<String> = text.lines().map(str::to_owned).collect();
        described(Path::new("t.ecsv"), &lines).map_err(|error| error.to_string())
    }

    #[test]
    fn both_styles_say_the_same() {
        let flow = "%ECSV 1.0\n---\ndelimiter: ','\ndatatype:\n- {name: ra, unit: deg, datatype: float64, description: 'a, {b}: c',\n  \
            format: '%.3f'}\n- {name: 'is it', datatype: bool}\n- {name: name, datatype: string}\n\
            - {name: v, datatype: string, subtype: 'float64[2,3]'}\n- {name: w, datatype: string, subtype: 'float64[null]'}\nmeta: !!omap\n- {x: 1}\n";
        let block = "%ECSV 1.0\n---\ndelimiter: ','\ndatatype:\n-\n  name: ra\n  unit: deg\n  datatype: float64\n  \
            description: >\n    name: no\n-\n  name: is it\n  datatype: bool\n- name: name\n  datatype: string\n\
            -\n  name: v\n  datatype: string\n  subtype: float64[2,3]\n-\n  name: w\n  datatype: string\n  subtype: json\nmeta:\n  x: 1\n";
        let column = |name: &str, unit: &str, kind| Described { name: name.into(), unit: unit.into(), kind };
        let columns = vec![
            column("ra", "deg", Kind::Numbers(1)),
            column("is it", "", Kind::Numbers(1)),
            column("name", "", Kind::Text),
            column("v", "", Kind::Numbers(6)),
            column("w", "", Kind::Text),
        ];
        let expected = Description { delimiter: ',', columns };
        assert_eq!(of(flow).as_ref(), Ok(&expected));
        assert_eq!(of(block).as_ref(), Ok(&expected));
    }

    #[test]
    fn what_a_header_lacks_is_said() {
        for (text, expected) in [
            ("---\n", "datatype: missing"),
            ("datatype:\nmeta:\n", "datatype: missing"),
            ("datatype:\n- {datatype: int8}\n", "column 1 of the header: missing, expected its name"),
            ("datatype:\n- {name: a, datatype: wood}\n", "column 1 of the header: found wood"),
            ("delimiter: '|'\ndatatype:\n- {name: a, datatype: int8}\n", "delimiter: found |"),
        ] {
            let found = of(text).unwrap_err();
            assert!(found.contains(expected), "{found}");
        }
    }
}
