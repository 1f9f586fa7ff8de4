//! Why nothing was built.

use super::cluster::PartError;
use super::spill::Spill;
use crate::import::ImportError;
use crate::model::{FamilyName, StreamError};
use crate::store::StoreError;
use std::path::{Path, PathBuf};

/// Why nothing was built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// The page file could not be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The source could not be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The particles could not be read.
    #[error(transparent)]
    Stream(StreamError),
    /// A column breaks its promise.
    #[error("{family}: {field}: expected {expected}")]
    Column {
        /// The family.
        family: FamilyName,
        /// The field that is wrong.
        field: String,
        /// What it should be.
        expected: &'static str,
    },
    /// The source has changed while it was read.
    #[error(
        "{family}: found other values when it was read again, expected a source that does not change while it is read"
    )]
    Changed {
        /// The family.
        family: FamilyName,
    },
    /// The source has no such family or attribute, or no particle.
    #[error("{path}: {what}")]
    Selection {
        /// The source.
        path: PathBuf,
        /// What was asked for, and what there is.
        what: String,
    },
    /// The build needs more memory than it may take.
    #[error(
        "{path}: {what} takes about {needed} MiB of memory, more than the {} MiB that the build may take",
        mebibytes(*allowed)
    )]
    Memory {
        /// The output.
        path: PathBuf,
        /// What needs it.
        what: String,
        /// Mebibytes needed.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// Temporary files would fill the disk.
    #[error(
        "{folder}: building {path} takes about {needed} MiB there for a while, and the disk has {free} MiB left; another folder can be \
         named with --temporary"
    )]
    Space {
        /// The output.
        path: PathBuf,
        /// The folder of temporary files.
        folder: PathBuf,
        /// Mebibytes needed.
        needed: u64,
        /// Mebibytes free.
        free: u64,
    },
    /// A job's folder, or a file in it, is not what it should be.
    #[error("{path}: {what}")]
    Job {
        /// The folder or file.
        path: PathBuf,
        /// What was found, and what was expected.
        what: String,
    },
    /// A temporary file could not be written or read.
    #[error("{folder}: temporary file: {source}")]
    Temporary {
        /// Its folder.
        folder: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The thread pool could not be started.
    #[error("starting {threads} threads: {reason}")]
    Threads {
        /// How many.
        threads: usize,
        /// The system's answer.
        reason: String,
    },
}

impl BuildError {
    pub(super) fn temporary(spill: &Spill, source: std::io::Error) -> BuildError {
        BuildError::of_part(spill.folder(), source)
    }

    /// Of a file in a folder, which says itself what is wrong where it is a task's.
    pub(super) fn of_part(folder: &Path, source: std::io::Error) -> BuildError {
        match source.downcast::<PartError>() {
            Ok(PartError { path, what }) => BuildError::Job { path, what },
            Err(source) => BuildError::Temporary { folder: folder.to_owned(), source },
        }
    }
}

/// Bytes as mebibytes in a message: whole ones, with two digits where they are few and none of the whole.
fn mebibytes(bytes: u64) -> String {
    match bytes {
        few if few < 10 << 20 && !few.is_multiple_of(1 << 20) => format!("{:.2}", few as f64 / f64::from(1 << 20)),
        many => (many >> 20).to_string(),
    }
}

impl From<StreamError> for BuildError {
    fn from(error: StreamError) -> BuildError {
        match error.downcast::<ImportError>() {
            Ok(import) => BuildError::Import(*import),
            Err(other) => BuildError::Stream(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::mebibytes;

    #[test]
    fn little_memory_is_told_with_its_digits() {
        let told = [1_000_000, 1 << 20, 1_600_000, 512 << 20, (64 << 20) + 5].map(mebibytes);
        assert_eq!(told, ["0.95", "1", "1.53", "512", "64"]);
    }
}
