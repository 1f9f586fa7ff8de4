//! What can be wrong with a page file.

use std::path::{Path, PathBuf};

/// An error of the page file's reader, writer or verifier; it names the file and what was expected where.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("{path}: {action}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// Not a page file at all.
    #[error("{path}: not a deepfield page file: {expected}")]
    NotAPageFile {
        /// The file.
        path: PathBuf,
        /// What was expected.
        expected: &'static str,
    },
    /// A page file of another version.
    #[error("{path}: page-file version {found}; this program reads version {supported}")]
    Version {
        /// The file.
        path: PathBuf,
        /// Version in the file.
        found: u32,
        /// The version that is supported.
        supported: u32,
    },
    /// A page file whose content breaks a promise of the format.
    #[error("{path}: {place}: {expected}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The part of the file: `header`, `footer`, `page 3, node 2`.
        place: String,
        /// What was expected there.
        expected: String,
    },
    /// The data cannot be written as a page file.
    #[error("{path}: cannot be written: {reason}")]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// A broken promise, before the file it is in is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Damage {
    pub place: String,
    pub expected: String,
}

impl Damage {
    pub fn new(place: impl Into<String>, expected: impl Into<String>) -> Damage {
        Damage { place: place.into(), expected: expected.into() }
    }

    pub fn in_file(self, path: &Path) -> StoreError {
        StoreError::Damaged { path: path.to_path_buf(), place: self.place, expected: self.expected }
    }
}
