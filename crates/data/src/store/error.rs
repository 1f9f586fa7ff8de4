//! What can be wrong with a page file.

use super::disk::Change;
use crate::model::When;
use std::io::ErrorKind;
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
    /// Not such a file at all.
    #[error("{path}: not a deepfield {kind}: {expected}")]
    NotThis {
        /// The file.
        path: PathBuf,
        /// What it was opened as: a page file or a run.
        kind: &'static str,
        /// What was expected.
        expected: &'static str,
    },
    /// A built file of something else, where particles are shown.
    #[error(
        "{path}: content: found {found}, expected particles, or a source, whose voxels or pixels are shown as particles"
    )]
    NotParticles {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// A file of another version.
    #[error("{path}: {kind} of version {found}; this program reads versions {} to {}", supported[0], supported[1])]
    Version {
        /// The file.
        path: PathBuf,
        /// What it is: a page file or a run.
        kind: &'static str,
        /// Version in the file.
        found: u32,
        /// The first and the last version that are supported.
        supported: [u32; 2],
    },
    /// A moment that lies outside of a run.
    #[error("{path}: --time {when}: {reason}")]
    Moment {
        /// The run.
        path: PathBuf,
        /// The moment that was named.
        when: When,
        /// What there is.
        reason: String,
    },
    /// A run of stills alone, where tracks are asked for.
    #[error("{path}: the run holds stills alone; build it without --stills-only to have its particles between steps")]
    NoTracks {
        /// The run.
        path: PathBuf,
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
    /// A run that keeps no stills.
    #[error("{path}: it was built with --no-stills, and keeps tracks only")]
    NoStills {
        /// The run.
        path: PathBuf,
    },
    /// A run without the flow level that was asked for.
    #[error("{path}: flow level {level}: found {levels} of them, from 1 on")]
    NoFlowLevel {
        /// The run.
        path: PathBuf,
        /// The level that was asked for.
        level: usize,
        /// How many it has.
        levels: usize,
    },
    /// The operating system refused to read a page.
    #[error("{path}: page {page}: cannot be read: {source}")]
    Page {
        /// The file.
        path: PathBuf,
        /// The page.
        page: u32,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A page of a file that is no longer what was opened.
    #[error("{path}: page {page}: {change}")]
    Changed {
        /// The file.
        path: PathBuf,
        /// The page that was to be read.
        page: u32,
        /// What has become of the file.
        change: Change,
    },
    /// The file cannot be shown together with others.
    #[error("{path}: cannot be shown with the others: {reason}")]
    Unjoinable {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
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

impl StoreError {
    /// Whether the same read may succeed later: an error of the disk or the network, not one of the file's content.
    pub fn may_pass(&self) -> bool {
        match self {
            StoreError::Io { source, .. } | StoreError::Page { source, .. } => may_pass(source.kind()),
            _ => false,
        }
    }
}

/// Whether what the system or a server answers may pass by itself.
pub(super) fn may_pass(kind: ErrorKind) -> bool {
    use ErrorKind::{InvalidInput, NotFound, PermissionDenied, StaleNetworkFileHandle, UnexpectedEof, Unsupported};
    !matches!(kind, UnexpectedEof | NotFound | PermissionDenied | InvalidInput | Unsupported | StaleNetworkFileHandle)
}

/// A broken promise, before the file it is in is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Where: `footer`, `page 7`.
    pub place: String,
    /// What should be there.
    pub expected: String,
}

impl Damage {
    /// What is expected at a place, and is not there.
    pub fn new(place: impl Into<String>, expected: impl Into<String>) -> Damage {
        Damage { place: place.into(), expected: expected.into() }
    }

    /// The error of the file at `path`.
    pub fn in_file(self, path: &Path) -> StoreError {
        StoreError::Damaged { path: path.to_path_buf(), place: self.place, expected: self.expected }
    }
}
