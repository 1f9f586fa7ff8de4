//! Trajectories that were looked through a short while ago: a run opens its steps one by one, and each of them needs the whole file's
//! index.

use super::Text;
use super::index::Index;
use crate::import::ImportError;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

/// Memory that is kept for indices, words.
const MOST_WORDS: usize = 1 << 24;
/// Unpacked files that are kept.
const MOST_UNPACKED: usize = 3;

/// A file as it was when it was looked through.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Key {
    path: PathBuf,
    bytes: u64,
    changed: Option<SystemTime>,
    format: &'static str,
}

impl Key {
    /// Of a file that is read as of a format.
    ///
    /// # Errors
    /// When it cannot be looked at.
    pub(super) fn of(path: &Path, format: &'static str) -> Result<Key, ImportError> {
        let about = std::fs::metadata(path).map_err(|error| ImportError::io(path, "file", error))?;
        Ok(Key {
            path: std::path::absolute(path).unwrap_or_else(|_| path.into()),
            bytes: about.len(),
            changed: about.modified().ok(),
            format,
        })
    }
}

/// The latest last.
static KNOWN: Mutex<Vec<(Key, Arc<Index>)>> = Mutex::new(Vec::new());

/// The index of a file: that of before where the file has not changed.
///
/// # Errors
/// As [`Index::of`].
pub(super) fn index_of(path: &Path, text: &dyn Text) -> Result<Arc<Index>, ImportError> {
    let key = Key::of(path, text.name())?;
    {
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = known.iter().position(|(other, _)| *other == key) {
            let found = known.remove(at);
            let index = Arc::clone(&found.1);
            known.push(found);
            return Ok(index);
        }
    }
    let index = Arc::new(Index::of(path, key.bytes, text)?);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.retain(|(other, _)| other.path != key.path || other.format != key.format);
    known.push((key, Arc::clone(&index)));
    let (mut words, mut unpacked) = (0, 0);
    let mut keep: Vec<bool> = known
        .iter()
        .rev()
        .map(|(_, index)| {
            words += index.weight();
            unpacked += usize::from(index.unpacked.is_some());
            words <= MOST_WORDS && (index.unpacked.is_none() || unpacked <= MOST_UNPACKED)
        })
        .collect();
    known.retain(|_| keep.pop().unwrap_or(false));
    Ok(index)
}
