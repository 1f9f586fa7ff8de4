//! The user's cache folder, and the page files in it of sources that were opened directly.

use crate::look::HeightsSaid;
use crate::look::page_cache::{default_budget, page_file, prune, room_for_pages};
use crate::model::Progress;
use etcetera::BaseStrategy;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

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

/// As [`page_file_with`], where nothing is said of it.
///
/// # Errors
/// As [`page_file_with`].
pub fn page_file_of(path: &Path, progress: &dyn Progress) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
    page_file_with(path, &HeightsSaid::default(), progress)
}

/// The path of a page file for `path`, as [`page_file`] finds or builds it in the user's cache; tells what had to go for it.
///
/// # Errors
/// As [`page_file`].
pub fn page_file_with(
    path: &Path,
    said: &HeightsSaid,
    progress: &dyn Progress,
) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
    let (file, removed) = page_file(path, said, None, || folder("pages"), progress)?;
    removed.into_iter().for_each(|removed| eprintln!("deepfield: {removed}"));
    Ok(file)
}

/// Where pages that servers send are kept in place of the user's cache, and how many bytes of them.
static APART: Mutex<Option<(PathBuf, u64)>> = Mutex::new(None);

/// Of files behind URLs that are opened from now on, pages are kept in this folder and not in the user's cache: so many bytes of them, 0 for none.
pub fn keep_apart(folder: &Path, bytes: u64) {
    *APART.lock().unwrap_or_else(PoisonError::into_inner) = Some((folder.to_owned(), bytes));
}

/// The folder where pages are kept that servers send, and how many bytes of them; none where there is no folder, or its budget is none.
pub fn for_pages_from_afar() -> Option<(PathBuf, u64)> {
    if let Some(apart) = APART.lock().unwrap_or_else(PoisonError::into_inner).clone() {
        return Some(apart);
    }
    let folder = folder("pages").ok()?;
    let room = room_for_pages(&folder).ok()?;
    Some((folder, room))
}

/// Removes what was used longest ago, so that the folder keeps to its budget; never `made`.
pub(super) fn make_room(folder: &Path, stated: Option<u64>, made: &Path) -> Result<(), std::io::Error> {
    let budget = stated.unwrap_or_else(|| default_budget(folder));
    if let Some(removed) = prune(folder, budget, made)? {
        eprintln!("deepfield: {removed}");
    }
    Ok(())
}
