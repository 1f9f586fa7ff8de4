//! Where a field of a keyframe stands in a tour's text, for messages.

use crate::model::ron_file::RonError;

/// A tour's text.
pub(super) struct Place<'a> {
    pub file: &'a str,
    pub text: &'a str,
}

impl Place<'_> {
    /// The error of a value of the tour itself.
    pub fn refuse(&self, field: &str, found: impl ToString, expected: impl std::fmt::Display) -> RonError {
        self.refuse_at(0, &[field], found, expected)
    }

    /// The error of a value of the keyframe number `index`, from 0; `path` leads to its field.
    pub fn refuse_in(
        &self,
        index: usize,
        path: &[&str],
        found: impl ToString,
        expected: impl std::fmt::Display,
    ) -> RonError {
        let start = keyframe_starts(self.text).get(index).copied().unwrap_or(0);
        self.refuse_at(start, path, found, expected)
    }

    fn refuse_at(
        &self,
        start: usize,
        path: &[&str],
        found: impl ToString,
        expected: impl std::fmt::Display,
    ) -> RonError {
        let mut at = start;
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
fn find_name(text: &str, name: &str) -> Option<usize> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    let mut whole = text.match_indices(name).filter(|(at, _)| {
        let (before, after) = (&text[..*at], &text[at + name.len()..]);
        !before.chars().next_back().is_some_and(is_word) && after.trim_start_matches('"').trim_start().starts_with(':')
    });
    whole.next().map(|(at, _)| at)
}

/// Where the keyframes begin in a tour's text that has been read: the brackets inside the list of keyframes, strings and
/// comments left aside.
fn keyframe_starts(text: &str) -> Vec<usize> {
    let mut starts = Vec::new();
    let Some(list) = find_name(text, "keyframes") else { return starts };
    let bytes = text.as_bytes();
    let (mut at, mut depth) = (list, 0usize);
    while at < bytes.len() {
        match bytes[at] {
            b'"' => {
                at += 1;
                while at < bytes.len() && bytes[at] != b'"' {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
            }
            b'/' if bytes.get(at + 1) == Some(&b'/') => {
                while at < bytes.len() && bytes[at] != b'\n' {
                    at += 1;
                }
            }
            b'(' | b'[' | b'{' => {
                if depth == 1 {
                    starts.push(at);
                }
                depth += 1;
            }
            b')' | b']' | b'}' => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return starts;
                }
            }
            _ => {}
        }
        at += 1;
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keyframes_are_found_in_any_text() {
        let text =
            "(title: \"keyframes(\", keyframes: [(caption: \"a ) \\\" (\"), // (\n (camera: (eye: (1,2,3))), ()])";
        let starts = keyframe_starts(text);
        assert_eq!(starts.len(), 3, "{starts:?}");
        let place = Place { file: "t.ron", text };
        let message = place.refuse_in(1, &["camera", "eye"], "x", "y").to_string();
        assert!(message.starts_with("t.ron:2:12: eye: found x"), "{message}");
        for broken in ["", "(keyframes: [(\"", "(keyframes: [(", "keyframes:]]]", "(keyframes: [\"\\"] {
            keyframe_starts(broken);
        }
    }
}
