//! Why something could not be looked at closer: every message is one line with the file, the field and what was expected.

use crate::import::ImportError;
use crate::store::StoreError;
use std::path::{Path, PathBuf};

/// A question that cannot be answered, or an answer that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ExploreError {
    /// The page file could not be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The source, or a file of objects or ids, could not be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// RON could not be read.
    #[error(transparent)]
    Ron(#[from] crate::model::ron_file::RonError),
    /// The operating system refused to read or write a file.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A field, family or object that was asked for is not in the data.
    #[error("{}: {what}: not there, expected {expected}", path.display())]
    Missing {
        /// The data.
        path: PathBuf,
        /// What was asked for.
        what: String,
        /// What there is.
        expected: String,
    },
    /// A region, colour or option that makes no sense.
    #[error("{field} is {found}, expected {expected}")]
    Value {
        /// Which setting.
        field: String,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Whoever asked no longer wants the answer.
    #[error("stopped before it was done")]
    Stopped,
}

impl ExploreError {
    /// An [`ExploreError::Io`].
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> ExploreError {
        ExploreError::Io { path: path.into(), action, source }
    }

    /// A file that contradicts its format: an [`ImportError::Malformed`].
    pub fn malformed(
        path: &Path,
        field: impl Into<String>,
        found: impl ToString,
        expected: impl Into<String>,
    ) -> ExploreError {
        ImportError::malformed(path, field, found, expected).into()
    }

    /// An [`ExploreError::Missing`].
    pub fn missing(path: &Path, what: impl Into<String>, expected: impl Into<String>) -> ExploreError {
        ExploreError::Missing { path: path.into(), what: what.into(), expected: expected.into() }
    }

    /// An [`ExploreError::Value`].
    pub fn value(field: impl Into<String>, found: impl ToString, expected: impl Into<String>) -> ExploreError {
        ExploreError::Value { field: field.into(), found: found.to_string(), expected: expected.into() }
    }
}
