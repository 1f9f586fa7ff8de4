//! Where a field stands in RON that has been read, for messages about values that are of the right type and make no sense.

use super::ron_file::RonError;

/// A RON text and what messages call it.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// What messages call it.
    pub file: &'a str,
    /// All of it.
    pub text: &'a str,
}

impl Place<'_> {
    /// The error of a value; `path` leads to its field from the outside, the last name being the field's.
    pub fn refuse(&self, path: &[&str], found: impl ToString, expected: impl std::fmt::Display) -> RonError {
        self.refuse_from(0, path, found, expected)
    }

    /// The same for a field behind the byte `start`, as one of a list's values. A name that is not there leads no further.
    pub fn refuse_from(
        &self,
        start: usize,
        path: &[&str],
        found: impl ToString,
        expected: impl std::fmt::Display,
    ) -> RonError {
        let mut at = if self.text.is_char_boundary(start) { start } else { 0 };
        for name in path {
            at += find_name(&self.text[at..], name).unwrap_or(0);
        }
        let before = &self.text[..at];
        RonError::Syntax {
            file: self.file.to_owned(),
            line: 1 + before.matches('\n').count(),
            column: 1 + before.rsplit('\n').next().map_or(0, |line| line.chars().count()),
            field: path.last().copied().unwrap_or("the text").to_owned(),
            message: format!("found {}, expected {expected}", found.to_string()),
        }
    }
}

/// Where a name stands in RON that a colon follows, or the same name as a string.
pub fn find_name(text: &str, name: &str) -> Option<usize> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    let mut whole = text.match_indices(name).filter(|(at, _)| {
        let (before, after) = (&text[..*at], &text[at + name.len()..]);
        !before.chars().next_back().is_some_and(is_word) && after.trim_start_matches('"').trim_start().starts_with(':')
    });
    whole.next().map(|(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_leads_to_its_field() {
        let text = "(eye: 1, ä: (\n  my_eye: 2, eye : 3, \"a name\": 4))";
        let place = Place { file: "p.ron", text };
        for (start, path, found) in [
            (0, &["eye"][..], "1:2: eye"),
            (0, &["ä"], "1:10: ä"),
            (0, &["ä", "eye"], "2:14: eye"),
            (3, &["eye"], "2:14: eye"),
            (0, &["a name"], "2:24: a name"),
            (0, &["ä", "nothing"], "1:10: nothing"),
            // In the middle of a character, and behind the end.
            (10, &["eye"], "1:2: eye"),
            (999, &["eye"], "1:2: eye"),
            (0, &[], "1:1: the text"),
        ] {
            let message = place.refuse_from(start, path, "x", "y").to_string();
            assert_eq!(message, format!("p.ron:{found}: found x, expected y"), "{start} {path:?}");
        }
    }
}
