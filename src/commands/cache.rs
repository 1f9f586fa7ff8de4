//! Page files of sources that were opened directly: built once into the user's cache folder, found again as long as
//! the source does not change.

use super::build::{BuildOptions, build_source};
use crate::import::LoadOptions;
use crate::model::Progress;
use crate::store::PageFile;
use etcetera::BaseStrategy;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// A folder below deepfield's part of the user's cache (`$XDG_CACHE_HOME/deepfield` and its equivalents), created if
/// needed.
///
/// # Errors
/// When there is no home folder or the folder cannot be created; the message names it.
pub fn folder(name: &str) -> Result<PathBuf, std::io::Error> {
    let base = etcetera::choose_base_strategy().map_err(std::io::Error::other)?.cache_dir();
    let folder = base.join("deepfield").join(name);
    std::fs::create_dir_all(&folder)
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", folder.display())))?;
    Ok(folder)
}

/// Whether the file at `path` is a page file, by its first bytes.
///
/// # Errors
/// When the file cannot be read; the message names it.
pub fn is_page_file(path: &Path) -> Result<bool, std::io::Error> {
    let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let mut head = Vec::with_capacity(16);
    std::fs::File::open(path).map_err(name)?.take(16).read_to_end(&mut head).map_err(name)?;
    Ok(PageFile::recognises(&head))
}

/// The path of a page file for `path`: itself if it is one, else one in the cache, built first unless it is there
/// already.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn page_file_of(path: &Path, progress: &dyn Progress) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
    if is_page_file(path)? {
        return Ok(path.to_owned());
    }
    let cached = folder("pages")?.join(cached_name(path)?);
    if PageFile::open(&cached).is_err() {
        build_source(path, &LoadOptions::default(), &BuildOptions::default(), &cached, progress)?;
    }
    Ok(cached)
}

/// A file name that changes when the source's path, length or time of change does, or the page file's version.
fn cached_name(path: &Path) -> Result<String, std::io::Error> {
    let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let path = std::fs::canonicalize(path).map_err(name)?;
    let about = std::fs::metadata(&path).map_err(name)?;
    let changed = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let mut hasher = DefaultHasher::new();
    (&path, about.len(), changed, crate::store::layout::VERSION).hash(&mut hasher);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(format!("{stem}-{:016x}.df", hasher.finish()))
}
