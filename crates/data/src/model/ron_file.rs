//! RON that a user writes: read in one way everywhere, with one kind of error.

use super::ron_words::Marked;
use super::url::{is_url, refused, shown};
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
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

/// Reads a value from RON text; `file` is what errors call it. `Some(...)` may be left out, and words with hyphens are words.
///
/// # Errors
/// [`RonError::Syntax`].
pub fn parse<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, RonError> {
    let options = ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let marked = Marked::new(text);
    options.from_str(&marked.text).map_err(|error| {
        let column = |at: ron::error::Position| marked.column(text, at.line, at.col);
        let kind = match error.code {
            ron::Error::NoSuchStructField { expected, .. } => other_kind(text, expected),
            _ => None,
        };
        RonError::Syntax {
            file: file.to_owned(),
            line: error.span.start.line,
            column: column(error.span.start),
            field: field_at(text, error.span.end.line, column(error.span.end)).unwrap_or("the text").to_owned(),
            message: match (error.code, kind) {
                (_, Some(kind)) => format!("the file is {kind}"),
                // Who comes from --attribute or from a configuration has a text there.
                (ron::Error::ExpectedIdentifier, None) => {
                    "Expected identifier: a word without quotes, such as flat or named(\"NAME\")".into()
                }
                // Who comes from an option has `dome`, whose fields may all be left out.
                (ron::Error::ExpectedStructLike, None) => {
                    "Expected opening `(`, also before no fields, as in dome()".into()
                }
                (code, None) => code.to_string().replace(['\n', '\r'], " ").replace("`r#", "`"),
            },
        }
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

/// What a text is that has a field which is not among those `expected` at its top, where it is a file of another kind.
fn other_kind(text: &str, expected: &[&str]) -> Option<&'static str> {
    #[derive(Default, Deserialize)]
    #[serde(default)]
    struct Fields {
        datasets: Option<IgnoredAny>,
        keyframes: Option<IgnoredAny>,
        outputs: Option<IgnoredAny>,
    }
    // Files of these kinds, and nothing in them, have a version.
    let fields: Fields = expected.contains(&"version").then(|| parse("", text).ok()).flatten()?;
    let kinds = [
        ("datasets", fields.datasets, "a scene: deepfield view FILE, or deepfield render FILE"),
        ("keyframes", fields.keyframes, "a tour: deepfield tour FILE, or deepfield view --tour FILE"),
        ("outputs", fields.outputs, "one of outputs: deepfield view DATA --outputs FILE"),
    ];
    kinds.into_iter().find(|(name, value, _)| value.is_some() && !expected.contains(name)).map(|(_, _, kind)| kind)
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
        .find(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | '-' | '"'))
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
    fn words_with_hyphens_are_words() {
        #[derive(Debug, PartialEq, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        enum Eyes {
            Left,
            SideBySide,
        }
        #[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Pair {
            eyes: Vec<Eyes>,
            #[serde(default)]
            size: u32,
        }
        let pair: Pair = parse("my.ron", "(eyes: [side-by-side, left, r#side-by-side], size: 3)").unwrap();
        assert_eq!((pair.eyes, pair.size), (vec![Eyes::SideBySide, Eyes::Left, Eyes::SideBySide], 3));
        let message = |text: &str| parse::<Pair>("my.ron", text).unwrap_err().to_string();
        for (text, parts) in [
            ("(eyes: [left, over-under])", ["my.ron:1:", "`over-under`", "`side-by-side`"]),
            ("(eyes: [], frame-ms: 3)", ["my.ron:1:", ": frame-ms: ", "`frame-ms`"]),
        ] {
            let found = message(text);
            assert!(parts.iter().all(|part| found.contains(part)), "{text:?} gave {found:?}");
        }
        let [hyphens, none] = ["(eyes: [side-by-side], size: -3)", "(eyes: [left        ], size: -3)"];
        assert_eq!(message(hyphens), message(none), "places are those of the text that was written");
    }

    #[test]
    fn files_of_another_kind_are_told() {
        #[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Tour {
            version: u32,
            keyframes: Vec<u32>,
        }
        let tour: Tour = parse("t.ron", "(version: 1, keyframes: [3])").unwrap();
        assert_eq!((tour.version, tour.keyframes), (1, vec![3]));
        let message = |text: &str| parse::<Tour>("t.ron", text).unwrap_err().to_string();
        let scene = message("(version: 1, size: (1, 2), datasets: [(path: \"a.df\", look: (mode: \"points\"))])");
        assert!(scene.contains(": size: the file is a scene: deepfield view FILE"), "{scene}");
        for own in ["(version: 1, keyframe: [])", "(version: 1, keyframes: [], title: \"outputs: 3\")"] {
            assert!(message(own).contains("Unexpected field named"), "{own}");
        }
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
