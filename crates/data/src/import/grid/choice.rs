//! Messages about files of several arrays, of which one is meant.

use super::content::{Content, in_one_line};
use crate::import::ImportError;

/// How many arrays a message lists.
const LISTED: usize = 12;

/// A name as messages have it.
pub(super) fn shown(name: &str) -> String {
    in_one_line(&name).chars().take(100).collect()
}

/// An array as messages list it: `fields/density (256 x 256 x 133 of float32)`; axes have the fastest last.
pub(super) fn described(name: &str, axes: &[u64], kind: &str) -> String {
    format!("{} ({} of {kind})", shown(name), sizes(axes))
}

/// Axes in words, the fastest first.
fn sizes(axes: &[u64]) -> String {
    axes.iter().rev().map(u64::to_string).collect::<Vec<_>>().join(" x ")
}

/// What there is, in one line.
fn all(arrays: &[String]) -> String {
    let more = arrays.len().saturating_sub(LISTED);
    let text = arrays.iter().take(LISTED).map(String::as_str).collect::<Vec<_>>().join(", ");
    match (arrays.is_empty(), more) {
        (true, _) => "none of two or three axes".into(),
        (_, 0) => text,
        _ => format!("{text} and {more} more"),
    }
}

/// The message that there is not exactly one array.
pub(super) fn several(content: &Content, what: &str, arrays: &[String]) -> ImportError {
    let file = content.path.file_name().unwrap_or_default().to_string_lossy();
    let first = arrays.first().map_or("NAME", |text| text.rsplit_once(" (").map_or(text, |(name, _)| name));
    let expected = match arrays {
        [] => "one of two or three axes".into(),
        _ => format!("one; name it behind the file, as {}#{first}", in_one_line(&file)),
    };
    ImportError::malformed(&content.path, what, all(arrays), expected)
}

/// The message that there is no array of a name.
pub(super) fn missing(content: &Content, name: &str, arrays: &[String]) -> ImportError {
    let expected = match arrays {
        [] => "the name of an array in the file".to_owned(),
        _ => format!("one of {}", all(arrays)),
    };
    ImportError::missing(&content.path, shown(name), expected)
}

/// The message that an array has other axes than a grid.
pub(super) fn axes(content: &Content, name: &str, axes: &[u64]) -> ImportError {
    let found = match axes {
        [] => "one value".to_owned(),
        _ => format!("{} axes ({})", axes.len(), sizes(axes)),
    };
    ImportError::malformed(&content.path, shown(name), found, "2 axes (an image) or 3 (a volume)")
}
