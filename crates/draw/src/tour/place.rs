//! Where a field of a keyframe stands in a tour's text, for messages.

use crate::model::ron_file::RonError;
use crate::model::ron_place::{Place, find_name};

/// A tour's text.
pub(super) trait TourPlace {
    /// The error of a value of the keyframe number `index`, from 0; `path` leads to its field.
    fn refuse_in(
        &self,
        index: usize,
        path: &[&str],
        found: impl ToString,
        expected: impl std::fmt::Display,
    ) -> RonError;
}

impl TourPlace for Place<'_> {
    fn refuse_in(
        &self,
        index: usize,
        path: &[&str],
        found: impl ToString,
        expected: impl std::fmt::Display,
    ) -> RonError {
        let start = keyframe_starts(self.text).get(index).copied().unwrap_or(0);
        self.refuse_from(start, path, found, expected)
    }
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
