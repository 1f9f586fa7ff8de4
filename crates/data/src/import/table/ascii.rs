//! Tables of numbers between blanks or tabs, plain or compressed, behind a line of names, which may be a comment (`# x y z mass`), as
//! numpy, TOPCAT and halo finders write them. Other comments may be before and between the rows, and before the names two lines of VELOCIraptor.

use super::catalogue::Catalogue;
use super::columns::{Column, number, stated_number};
use super::records::{Delimiter, words};
use super::separated::{Heading, Separated, header_line, open};
use super::{sky, text};
use crate::import::{Format, HEAD, ImportError, Source};
use crate::model::ReadMethod;
use std::io::BufRead;
use std::path::Path;

/// The format of such tables.
pub(in crate::import) struct Ascii;

/// The longest text before the first row, bytes.
const LONGEST: usize = 1 << 22;

/// What else may separate values, in CSV.
const SEPARATORS: [char; 2] = [',', ';'];

impl Format for Ascii {
    fn name(&self) -> &'static str {
        "ASCII table with a header"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["txt", "dat", "asc"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        if begins_as_velociraptor(&text) {
            return true;
        }
        // Where the head ends in a row, or in a long line of names; a mark of byte order and a letter that is cut are not among the text.
        let is_cut = text.len() + 8 > HEAD;
        let whole = if is_cut { text.rfind('\n').map_or(&*text, |end| &text[..=end]) } else { text.as_str() };
        Beginning::read(Path::new("head"), &mut whole.as_bytes()).is_ok_and(|beginning| beginning.is_of_table())
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open::<Ascii>(path, method)?)?))
    }
}

impl Separated for Ascii {
    const NAME: &'static str = "ascii";

    fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError> {
        let beginning = Beginning::read(path, reader)?;
        let columns = beginning.columns().ok_or_else(|| {
            let values = words(beginning.row.as_bytes()).count();
            let expected =
                format!("a line such as # x y z mass before the rows, a name for each of their {values} values");
            ImportError::missing(path, "names of columns", expected)
        })?;
        let (lines, begun) = (beginning.lines, beginning.row.into_bytes());
        Ok(Heading { lines, begun, ..Heading::of_names(columns, Delimiter::Blanks) })
    }
}

/// What such a file begins with.
struct Beginning {
    /// The lines before the first row that may be names, without marks of comments.
    candidates: Vec<String>,
    /// How many lines there are before the first row.
    lines: u64,
    /// The first row, which may be cut where it is very long; empty without any.
    row: String,
}

impl Beginning {
    fn read(path: &Path, reader: &mut dyn BufRead) -> Result<Beginning, ImportError> {
        let (mut candidates, mut lines, mut bytes, mut is_named) = (Vec::new(), 0, 0, false);
        loop {
            let row = header_line(path, reader)?;
            if lines == 0 && are_counts(&row) {
                let [counts, names] = [header_line(path, reader)?, header_line(path, reader)?];
                if begins_as_velociraptor(&[&row, &counts, &names].map(String::as_str).concat()) {
                    let row = header_line(path, reader)?;
                    return Ok(Beginning { candidates: vec![names.trim().to_owned()], lines: 3, row });
                }
                return Ok(Beginning { candidates, lines, row });
            }
            let text = row.trim_start_matches('\u{feff}').trim();
            // One line without a mark may be names, too.
            let is_plain = !text.is_empty() && !text.starts_with('#');
            if row.is_empty() || is_plain && (is_named || !are_names(&columns_of(text))) {
                return Ok(Beginning { candidates, lines, row });
            }
            is_named |= is_plain;
            lines += 1;
            bytes += row.len();
            if bytes > LONGEST {
                let found = format!("more than {LONGEST} bytes before the first row");
                return Err(ImportError::malformed(path, "header", found, "a shorter one"));
            }
            candidates.push(text.trim_start_matches('#').trim_start().to_owned());
        }
    }

    /// The columns that a line names: the first of which positions can be made, else the last; it has as many names as the row has values.
    fn columns(&self) -> Option<Vec<Column>> {
        let values = words(self.row.as_bytes()).count();
        let named = self.candidates.iter().map(|line| columns_of(line));
        let named = named.filter(|columns| are_names(columns) && (values == 0 || columns.len() == values));
        let mut named: Vec<Vec<Column>> = named.collect();
        let chosen = named.iter().position(|columns| sky::has_positions(columns)).or(named.len().checked_sub(1))?;
        Some(named.swap_remove(chosen))
    }

    /// Whether it is that of a table which is not CSV.
    fn is_of_table(&self) -> bool {
        // The rows may be behind more comments than were read.
        if self.row.is_empty() {
            let is_csv = |line: &str| line.contains(SEPARATORS) || line.contains('\t');
            return self.candidates.iter().any(|line| !is_csv(line) && sky::has_positions(&columns_of(line)));
        }
        let tabs = |line: &str| line.matches('\t').count();
        let row = self.row.trim_end_matches(['\r', '\n']);
        let is_csv = row.contains(SEPARATORS)
            || tabs(row) > 0 && self.lines == 1 && self.candidates.iter().all(|names| tabs(names) == tabs(row));
        let values = words(row.as_bytes()).count();
        let numbers = words(row.as_bytes()).filter(|word| number(&String::from_utf8_lossy(word)).is_some()).count();
        // Places without names are told, too, so that it is said what they lack.
        !is_csv && numbers >= if self.columns().is_some() { 2 } else { values.max(3) }
    }
}

/// Whether a text begins as a list of haloes of VELOCIraptor does: with two lines of two whole numbers, and one of names.
fn begins_as_velociraptor(text: &str) -> bool {
    let mut lines = text.lines();
    let are_both = [lines.next(), lines.next()].into_iter().all(|line| line.is_some_and(are_counts));
    are_both && lines.next().is_some_and(|names| sky::has_positions(&columns_of(names)))
}

/// Whether a line is two whole numbers and nothing else.
fn are_counts(line: &str) -> bool {
    let words: Vec<&str> = line.split_whitespace().take(3).collect();
    words.len() == 2 && words.iter().all(|word| word.parse::<u64>().is_ok())
}

/// The columns that a line would name; what is in brackets is a part of the name before it.
fn columns_of(line: &str) -> Vec<Column> {
    let mut names: Vec<String> = Vec::new();
    let mut is_open = false;
    for word in line.split(|letter: char| letter.is_whitespace() || letter == ',').filter(|word| !word.is_empty()) {
        match names.last_mut().filter(|_| is_open || word.starts_with(['[', '('])) {
            Some(name) => {
                name.push(' ');
                name.push_str(word);
            }
            None => names.push(word.to_owned()),
        }
        let ends = word.rfind([']', ')']);
        is_open = word.rfind(['[', '(']).map_or(is_open && ends.is_none(), |begins| ends < Some(begins));
    }
    names.iter().map(|name| Column::new(name)).collect()
}

/// Whether none of these is a number.
fn are_names(columns: &[Column]) -> bool {
    !columns.is_empty() && columns.iter().all(|column| stated_number(&column.name).is_none())
}
