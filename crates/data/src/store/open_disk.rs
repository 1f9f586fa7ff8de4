//! Where a file's bytes come from by its name: a disk of this machine, or a server where the name is a URL.

use super::disk::{Disk, LocalFile};
use super::error::StoreError;
use crate::model::ReadMethod;
use crate::model::url::{is_url, shown};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Opens what is named, a file that is read in the way `method` or one behind a URL; messages call it a file of the kind `kind`.
///
/// # Errors
/// [`StoreError`] where it cannot be read, or is no regular file.
pub fn open_disk(path: &Path, method: ReadMethod, kind: &'static str) -> Result<Arc<dyn Disk>, StoreError> {
    let io = |source| StoreError::Io { path: shown(path), action: "open", source };
    if is_url(path) {
        return open_url(path).map_err(io);
    }
    let not_a_file = || StoreError::NotThis { path: path.to_path_buf(), kind, expected: "a regular file" };
    Ok(Arc::new(LocalFile::open(path, method).map_err(io)?.ok_or_else(not_a_file)?))
}

/// The same where it will do how a file behind a URL was when somebody opened it who still reads it: then nobody is asked.
///
/// # Errors
/// As [`open_disk`].
pub fn known_disk(path: &Path, method: ReadMethod, kind: &'static str) -> Result<Arc<dyn Disk>, StoreError> {
    match known_url(path) {
        Some(disk) => Ok(disk),
        None => open_disk(path, method, kind),
    }
}

/// The first bytes of a file, here or behind a URL: `most` of them, or as many as it has.
///
/// # Errors
/// What the system or the server answers.
pub fn first_bytes(path: &Path, most: usize) -> io::Result<Vec<u8>> {
    if is_url(path) {
        let file = open_url(path)?;
        let mut bytes = vec![0; most.min(usize::try_from(file.size()?).unwrap_or(most))];
        file.read_exact_at(&mut bytes, 0)?;
        return Ok(bytes);
    }
    let mut bytes = Vec::with_capacity(most);
    std::fs::File::open(path)?.take(most as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// From now on pages that servers send are kept in the folder that `find` gives, which may hold so many bytes of them. To be called once,
/// before the first URL is opened.
#[cfg(feature = "remote")]
pub fn keep_pages_from_afar(find: fn() -> Option<(PathBuf, u64)>) {
    super::remote::keep_pages(find);
}

/// Nothing: no page comes from a server without the feature `remote`.
#[cfg(not(feature = "remote"))]
pub fn keep_pages_from_afar(_: fn() -> Option<(PathBuf, u64)>) {}

/// What is to be told about files behind URLs since the last call, a sentence each.
#[cfg(feature = "remote")]
pub fn take_notes() -> Vec<String> {
    super::remote::take_notes()
}

/// Nothing: no file lies behind a URL without the feature `remote`.
#[cfg(not(feature = "remote"))]
pub fn take_notes() -> Vec<String> {
    Vec::new()
}

#[cfg(feature = "remote")]
fn open_url(path: &Path) -> io::Result<Arc<dyn Disk>> {
    Ok(super::remote::open(path)?)
}

#[cfg(feature = "remote")]
fn known_url(path: &Path) -> Option<Arc<dyn Disk>> {
    if is_url(path) { Some(super::remote::known(path)?) } else { None }
}

#[cfg(not(feature = "remote"))]
fn known_url(_: &Path) -> Option<Arc<dyn Disk>> {
    None
}

#[cfg(not(feature = "remote"))]
fn open_url(_: &Path) -> io::Result<Arc<dyn Disk>> {
    let why = "found a URL, expected a file: this program was built without the feature `remote`";
    Err(io::Error::new(io::ErrorKind::Unsupported, why))
}
