//! RON that a user writes: read in one way everywhere, with one kind of error.

use super::url::{is_url, refused, shown};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

/// A RON file that cannot be used: which file, where in it, which field, and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum RonError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Wrong RON, an unknown field, or a value of the wrong type.
    #[error("{file}:{line}:{column}: {field}: {message}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The field that is being set there; `the text` where there is none.
        field: String,
        /// What is wrong and what was expected.
        message: String,
    },
    /// A value that makes no sense.
    #[error("{file}: {field} is {found}, expected {expected}")]
    Value {
        /// The file.
        file: String,
        /// The field's path.
        field: String,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
}

impl RonError {
    /// A [`RonError::Value`].
    pub fn value(file: &str, field: &str, found: impl ToString, expected: impl Into<String>) -> RonError {
        RonError::Value { file: file.into(), field: field.into(), found: found.to_string(), expected: expected.into() }
    }
}

/// Reads a value from RON text; `file` is what errors call it. `Some(...)` may be left out.
///
/// # Errors
/// [`RonError::Syntax`].
pub fn parse<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, RonError> {
    let options = ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    options.from_str(text).map_err(|error| RonError::Syntax {
        file: file.to_owned(),
        line: error.span.start.line,
        column: error.span.start.col,
        field: field_at(text, error.span.end.line, error.span.end.col).unwrap_or("the text").to_owned(),
        message: match error.code {
            // Who comes from --attribute or from a configuration has a text there.
            ron::Error::ExpectedIdentifier => {
                "Expected identifier: a word without quotes, such as flat or named(\"NAME\")".into()
            }
            code => code.to_string().replace(['\n', '\r'], " "),
        },
    })
}

/// [`parse`] of a file.
///
/// # Errors
/// [`RonError::Io`] and [`RonError::Syntax`].
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, RonError> {
    let (file, text) = read_text(path)?;
    parse(&file, &text)
}

/// A file's name as errors call it, and its text.
///
/// # Errors
/// [`RonError::Io`].
pub fn read_text(path: &Path) -> Result<(String, String), RonError> {
    let file = shown(path).display().to_string();
    let text = if is_url(path) { Err(refused("a file")) } else { text_of(path) };
    match text {
        Ok(text) => Ok((file, text)),
        Err(source) => Err(RonError::Io { file, source }),
    }
}

/// Bytes of a file that are looked at before the others are read.
const HEAD: u64 = 4096;

/// All of a file, which is text. Data that is named in its place may be longer than memory, and is found out by its first bytes.
fn text_of(path: &Path) -> std::io::Result<String> {
    let no_text = || std::io::Error::new(ErrorKind::InvalidData, "content: found no text, expected RON");
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    (&file).take(HEAD).read_to_end(&mut bytes)?;
    if bytes.contains(&0) {
        return Err(no_text());
    }
    (&file).read_to_end(&mut bytes)?;
    String::from_utf8(bytes).map_err(|_| no_text())
}

/// The field `version` of RON text where it is above `known`: what a later version has added would be called unknown, so it is
/// looked at before the rest.
pub fn later_version(text: &str, known: u32) -> Option<u32> {
    #[derive(Deserialize)]
    struct AnyVersion {
        version: u32,
    }
    parse("", text).ok().map(|AnyVersion { version }| version).filter(|version| *version > known)
}

/// The name before the last colon that stands before a place in RON text (line and column from 1): the field whose value is
/// there.
fn field_at(text: &str, line: usize, column: usize) -> Option<&str> {
    let lines = text.split_inclusive('\n');
    let before: usize = lines.clone().take(line.saturating_sub(1)).map(str::len).sum();
    let rest = lines.clone().nth(line.saturating_sub(1)).unwrap_or("");
    let within: usize = rest.chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
    // The name itself may be what is wrong, and its colon behind the place.
    let end = rest[within..]
        .find(|c: char| !c.is_alphanumeric() && c != '_' && c != '"')
        .map_or(rest.len(), |end| within + end);
    let head = &text[..before + end];
    let named = if rest[end..].trim_start().starts_with(':') {
        Some(head)
    } else {
        head.rsplit_once(':').map(|(name, _)| name)
    };
    let name = named?.trim_end().trim_end_matches('"');
    name.rsplit(|c: char| !c.is_alphanumeric() && c != '_' && c != '-').next().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Example {
        size: u32,
        inner: Option<Inner>,
    }

    impl Default for Example {
        fn default() -> Example {
            Example { size: 1, inner: None }
        }
    }

    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Inner {
        width: (f32, f32),
    }

    #[test]
    fn the_place_and_the_field_are_named() {
        let message = |text: &str| parse::<Example>("my.ron", text).unwrap_err().to_string();
        for (text, parts) in [
            ("(\n  size: \"big\",\n)", ["my.ron:2:", ": size: "]),
            ("(\n  sice: 3,\n)", ["my.ron:2:", ": sice: "]),
            ("(size: 3, inner: (width: (1.0, x)))", ["my.ron:1:", ": width: "]),
            ("(\n size: 3,\n inner: (\n\n  hight: 3))", ["my.ron:5:", ": hight: "]),
            ("(", ["my.ron:1:", "the text"]),
            ("", ["my.ron:1:", "the text"]),
            ("ä: \u{1F600}", ["my.ron:1:", ""]),
        ] {
            let found = message(text);
            assert!(parts.iter().all(|part| found.contains(part)), "{text:?} gave {found:?}");
        }
        assert_eq!(field_at("(\u{3d000}size: 3)", 1, 3), Some("size"), "behind a character of several bytes");
        let example: Example = parse("my.ron", "(inner: (width: (1.0, 2.0)))").unwrap();
        assert_eq!((example.size, example.inner.unwrap().width), (1, (1.0, 2.0)));
    }

    #[test]
    fn later_versions_are_told_whatever_else_there_is() {
        for (text, later) in [
            ("(version: 3, news: [1, (x: \"y\")])", Some(3)),
            ("(news: {}, version: 2)", None),
            ("(version: 1)", None),
            ("(version: -3)", None),
            ("(versions: 3)", None),
            ("(version: 3", None),
        ] {
            assert_eq!(later_version(text, 2), later, "{text}");
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let text = read::<Example>(Path::new("/nowhere/at.ron")).unwrap_err().to_string();
        assert!(text.starts_with("/nowhere/at.ron: "), "{text}");
        let afar = read::<Example>(Path::new("https://h/at.ron?sig=s3cr3t")).unwrap_err().to_string();
        assert!(afar.starts_with("https://h/at.ron: found a URL, expected a file of this machine"), "{afar}");
    }

    #[test]
    fn data_in_the_place_of_text_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot.hdf5");
        for data in [&b"\x89HDF\r\n\x1a\n\0\0\0"[..], b"(size: \xff)"] {
            std::fs::write(&path, data).unwrap();
            let text = read::<Example>(&path).unwrap_err().to_string();
            assert_eq!(text, format!("{}: content: found no text, expected RON", path.display()));
        }
        std::fs::write(&path, format!("(size: 3)\n{}", " ".repeat(2 * HEAD as usize))).unwrap();
        assert_eq!(read::<Example>(&path).unwrap().size, 3);
    }
}
