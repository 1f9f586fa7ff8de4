//! Page files of sources that were opened directly: in the folder where the program has its own, under the names that it gives them, so
//! that each finds what the other has built.

use crate::error::Failure;
use deepfield_draw::look::{Member, page_cache, said_of_particles};
use deepfield_draw::picture::asked::State;
use etcetera::BaseStrategy;
use std::path::{Path, PathBuf};

/// The page file of particles at `path`, which is of some of these datasets: itself if it is one or a run of them, else one in the cache, built first
/// unless it is there already: in so many bytes of memory.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn page_file(members: &[Member], path: &Path, memory: Option<u64>, state: &State) -> Result<PathBuf, Failure> {
    let (file, removed) = page_cache::page_file(path, &said_of_particles(members, path), memory, folder, state)?;
    // What comes next does not write, until a stage begins that may.
    state.set_writing(false);
    removed.into_iter().for_each(|removed| state.note(removed.to_string()));
    Ok(file)
}

/// The folder where pages are kept that servers send, and how many bytes of them; none where there is no folder, or its budget is none.
pub fn for_pages_from_afar() -> Option<(PathBuf, u64)> {
    let folder = folder().ok()?;
    let room = page_cache::room_for_pages(&folder).ok()?;
    Some((folder, room))
}

/// The folder of page files, created if needed.
fn folder() -> Result<PathBuf, std::io::Error> {
    let base = etcetera::choose_base_strategy().map_err(std::io::Error::other)?.cache_dir();
    let folder = base.join("deepfield").join("pages");
    let named = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    std::fs::create_dir_all(&folder).map_err(named)?;
    Ok(folder)
}
