//! Why a source cannot be imported: every message is one line with the file, the field and what was expected.

use std::path::{Path, PathBuf};

/// A source that cannot be read. The text names the file, the field and what was expected there.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system refused to open or read the file.
    #[error("{}: {field}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being read.
        field: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// No registered format recognises the content.
    #[error("{}: content: not a known format, expected one of {expected}", path.display())]
    Unrecognised {
        /// The file.
        path: PathBuf,
        /// The names of the registered formats.
        expected: String,
    },
    /// A part of the file contradicts the format, or the rest of the file.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The header entry, block or data set.
        field: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// A field, family or data set that is needed, or was asked for, is not there.
    #[error("{}: {field}: missing, expected {expected}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What was looked for.
        field: String,
        /// What would have done, or what there is instead.
        expected: String,
    },
    /// A file that is to be like others and is not.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Unlike {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: String,
        /// What the others are.
        expected: String,
    },
    /// Axes of a grid that do not span an image or a volume.
    #[error("{}: {field}: singular, expected directions that span the grid", path.display())]
    Singular {
        /// The file.
        path: PathBuf,
        /// The header entry.
        field: String,
    },
    /// The source is well-formed but holds nothing to draw.
    #[error("{}: {field}: no particles, expected at least one", path.display())]
    NoParticles {
        /// The file.
        path: PathBuf,
        /// Where the count stands.
        field: String,
    },
}

impl ImportError {
    /// An [`ImportError::Io`] for `path` while reading `field`.
    pub fn io(path: &Path, field: impl Into<String>, source: std::io::Error) -> ImportError {
        ImportError::Io { path: path.into(), field: field.into(), source }
    }

    /// An [`ImportError::Malformed`].
    pub fn malformed(
        path: &Path,
        field: impl Into<String>,
        found: impl ToString,
        expected: impl Into<String>,
    ) -> ImportError {
        ImportError::Malformed {
            path: path.into(),
            field: in_one_line(field.into()),
            found: found.to_string(),
            expected: expected.into(),
        }
    }

    /// An [`ImportError::Malformed`] for values of which single precision holds none, such as `value`.
    pub(super) fn beyond_precision(path: &Path, field: impl Into<String>, value: f64) -> ImportError {
        let found = format!("{value:e} and no value that single precision holds");
        ImportError::malformed(path, field, found, "sizes from 1e-38 to 3e38, in other units")
    }

    /// An [`ImportError::Missing`].
    pub fn missing(path: &Path, field: impl Into<String>, expected: impl Into<String>) -> ImportError {
        ImportError::Missing { path: path.into(), field: in_one_line(field.into()), expected: expected.into() }
    }
}

/// A field's name, of which a damaged file may have made anything.
fn in_one_line(field: String) -> String {
    if field.contains(char::is_control) { field.replace(char::is_control, "?") } else { field }
}
