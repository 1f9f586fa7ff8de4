//! The process that builds a file: alone, and with how many threads.

use super::{BuildError, BuildOptions};
use crate::store::temporary::{clean, folder_of};
use std::path::Path;

/// Has one process alone build the file `out`. What killed ones have left of it goes first: it may be what fills the disk.
pub(super) fn alone<R: Send>(
    options: &BuildOptions,
    out: &Path,
    work: impl FnOnce() -> Result<R, BuildError> + Send,
) -> Result<R, BuildError> {
    remove_left(options, out);
    in_pool(options, work)
}

/// Removes what killed builds have left of the file `out`. Tasks of a job do not ask for that: several may be at work on the same file, and where
/// locks hold on one machine only, those on others do not look alive.
pub(super) fn remove_left(options: &BuildOptions, out: &Path) {
    for folder in std::iter::once(folder_of(out)).chain(options.temporary.as_deref()) {
        clean(out, folder);
    }
}

/// Does work with the threads that the options ask for.
pub(super) fn in_pool<R: Send>(
    options: &BuildOptions,
    work: impl FnOnce() -> Result<R, BuildError> + Send,
) -> Result<R, BuildError> {
    match options.threads {
        None => work(),
        Some(threads) => pool(threads)?.install(work),
    }
}

/// A pool of so many threads.
pub(super) fn pool(threads: usize) -> Result<rayon::ThreadPool, BuildError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| BuildError::Threads { threads, reason: error.to_string() })
}
