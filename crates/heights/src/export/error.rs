//! Why heights cannot be written.

use crate::model::HeightError;
use deepfield_data::model::new_file;
use std::path::{Path, PathBuf};

/// Heights that cannot be written, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// They cannot be read.
    #[error(transparent)]
    Heights(#[from] HeightError),
    /// The operating system refused to write the file.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// What is asked for cannot be, or not in this format.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Refused {
        /// The file that was to be written.
        path: PathBuf,
        /// What stands against it.
        field: String,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
}

impl ExportError {
    /// An [`ExportError::Io`].
    pub(crate) fn io(path: &Path, source: std::io::Error) -> ExportError {
        ExportError::Io { path: path.into(), source: new_file::without_name(&source) }
    }

    /// An [`ExportError::Refused`].
    pub(crate) fn refused(path: &Path, field: &str, found: impl ToString, expected: &str) -> ExportError {
        ExportError::Refused {
            path: path.into(),
            field: field.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}
