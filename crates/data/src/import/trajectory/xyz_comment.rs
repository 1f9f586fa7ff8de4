//! The second line of a frame of extended XYZ: `key=value` pairs, with quotes, escapes and arrays in brackets. Lines of plain XYZ,
//! which may say anything, are read in the same way: spaces may stand around the sign, commas behind values.

use super::row::{logical, number, words};

/// The pairs of a comment line. Keys are in small letters; a key without a value is true.
pub(super) struct Pairs(Vec<(String, String)>);

impl Pairs {
    /// Reads a line. Whatever it says, something comes out.
    pub(super) fn of(line: &[u8]) -> Pairs {
        let text = String::from_utf8_lossy(line);
        let mut rest = text.as_ref();
        let mut pairs = Vec::new();
        loop {
            rest = rest.trim_start_matches(|letter: char| letter.is_whitespace() || letter == ',');
            if rest.is_empty() {
                return Pairs(pairs);
            }
            let (key, after) = if rest.starts_with(['"', '\'']) { value(rest) } else { bare(rest, true) };
            let value_follows = after.trim_start().strip_prefix('=');
            let (value, after) = match value_follows {
                Some(after) => value(after.trim_start()),
                None => ("T".into(), after),
            };
            // A sign alone, without a key before it.
            rest =
                if after.len() == rest.len() { &rest[rest.chars().next().map_or(0, char::len_utf8)..] } else { after };
            pairs.push((key.to_lowercase(), value));
        }
    }

    /// The value of the first of these keys that is there.
    pub(super) fn get(&self, keys: &[&str]) -> Option<&str> {
        let found = |key: &&str| self.0.iter().find(|(known, _)| known == key);
        keys.iter().find_map(found).map(|(_, value)| value.as_str())
    }
}

/// A word up to a space or a comma before one, and of a key up to its sign.
fn bare(text: &str, is_key: bool) -> (String, &str) {
    let mut letters = text.char_indices().peekable();
    while let Some((at, letter)) = letters.next() {
        let ends_pair = letter == ',' && letters.peek().is_none_or(|(_, next)| next.is_whitespace());
        if letter.is_whitespace() || ends_pair || (is_key && letter == '=') {
            return (text[..at].into(), &text[at..]);
        }
    }
    (text.into(), "")
}

/// A value: bare, in quotes, or an array in braces or brackets, whose inner brackets and commas become spaces.
fn value(text: &str) -> (String, &str) {
    let close = match text.chars().next() {
        Some(quote @ ('"' | '\'')) => quote,
        Some('{') => '}',
        Some('[') => ']',
        _ => return bare(text, false),
    };
    let is_array = close == ']' || close == '}';
    let (mut value, mut depth, mut is_escaped) = (String::new(), 0, false);
    for (at, letter) in text.char_indices().skip(1) {
        match letter {
            _ if is_escaped => {
                value.push(if letter == 'n' { '\n' } else { letter });
                is_escaped = false;
            }
            '\\' => is_escaped = true,
            _ if letter == close && depth == 0 => return (value, &text[at + close.len_utf8()..]),
            '[' | '{' if is_array => {
                depth += 1;
                value.push(' ');
            }
            ']' | '}' if is_array => {
                depth -= 1;
                value.push(' ');
            }
            ',' if is_array => value.push(' '),
            _ => value.push(letter),
        }
    }
    // A quote that does not end holds the rest of the line.
    (value, "")
}

/// Numbers in a value, separated by spaces or commas.
pub(super) fn numbers(value: &str) -> Option<Vec<f64>> {
    let spaced = value.replace(',', " ");
    words(spaced.as_bytes()).map(|word| number(word).filter(|number| number.is_finite())).collect()
}

/// Which of three axes a value says yes to; one word holds for all.
pub(super) fn three_logical(value: &str) -> Option<[bool; 3]> {
    let spaced = value.replace(',', " ");
    let all: Vec<bool> = words(spaced.as_bytes()).map(logical).collect::<Option<_>>()?;
    match all[..] {
        [one] => Some([one; 3]),
        [x, y, z] => Some([x, y, z]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_read_as_they_are_written() {
        let line = r#"Lattice="5.44 0.0 0.0 0.0 5.44 0.0 0.0 0.0 5.44" Properties=species:S:1:pos:R:3 Time=0.5 flag name='a b' "my key"="say \"hi\"" v=[[1, 2],[3,4]] w={5 6} pbc="T T F""#;
        let pairs = Pairs::of(line.as_bytes());
        assert_eq!(pairs.get(&["properties"]), Some("species:S:1:pos:R:3"));
        assert_eq!(numbers(pairs.get(&["lattice"]).unwrap()).unwrap().len(), 9);
        assert_eq!((pairs.get(&["time"]), pairs.get(&["flag"])), (Some("0.5"), Some("T")));
        assert_eq!((pairs.get(&["name"]), pairs.get(&["my key"])), (Some("a b"), Some("say \"hi\"")));
        assert_eq!(numbers(pairs.get(&["v"]).unwrap()).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(numbers(pairs.get(&["w"]).unwrap()).unwrap(), [5.0, 6.0]);
        assert_eq!(three_logical(pairs.get(&["pbc"]).unwrap()), Some([true, true, false]));
        // As CP2K writes plain XYZ.
        let pairs = Pairs::of(b" i =      500, time =      250.000, E =      -17.1645");
        assert_eq!((pairs.get(&["i"]), pairs.get(&["time"])), (Some("500"), Some("250.000")));
        for odd in ["=", "= =", "a=", "\"", "a=\"", "a=[", ",,=,", "é='ü", "[]]]", "a={]}=b", "\\"] {
            Pairs::of(odd.as_bytes());
        }
    }
}
