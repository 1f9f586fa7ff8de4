//! Files behind a URL, by ranges of bytes over HTTP and S3. What is promised is in `docs/remote.md`.
//!
//! Nothing here knows what is in a file but that it begins with a header: a [`RemoteFile`] is a [`Disk`](super::Disk), and pages, the
//! footer and whatever else has a checksum check themselves.

mod address;
mod client;
mod failure;
mod file;
mod kept;
mod pause;
mod runtime;
mod traffic;
mod version;

pub(super) use kept::keep_pages;

use crate::model::url::{shown, whole};
use address::Address;
use file::RemoteFile;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A file that was opened within this time is not asked about again: what kind of file it is, what it holds and its pages are one question
/// to a user, and one opening to a server.
const FRESH: Duration = Duration::from_secs(10);

/// Files that are open, or were just now; those that were opened last come last.
fn opened() -> MutexGuard<'static, Vec<Arc<RemoteFile>>> {
    static OPEN: Mutex<Vec<Arc<RemoteFile>>> = Mutex::new(Vec::new());
    static PROCESS: AtomicU32 = AtomicU32::new(0);
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    let own = std::process::id();
    if PROCESS.swap(own, Ordering::Relaxed) != own {
        // Files of the process that this one was forked from, whose connections are attended to by threads that it alone has. Closing them could wait
        // for these.
        std::mem::forget(std::mem::take(&mut *open));
    }
    open.retain(|file| Arc::strong_count(file) > 1 || is_fresh(file));
    open
}

fn is_fresh(file: &RemoteFile) -> bool {
    file.age() < FRESH && !file.is_changed()
}

/// The file behind a URL as it was opened last, where somebody has it open: nobody is asked.
pub(super) fn known(path: &Path) -> Option<Arc<RemoteFile>> {
    let url = whole(&shown(path));
    opened().iter().rfind(|file| file.url() == url && !file.is_changed()).cloned()
}

/// Opens the file behind a URL.
///
/// # Errors
/// Why it cannot be read, in one sentence that names the server; [`io::ErrorKind`] tells what may pass from what will not, as
/// [`StoreError::may_pass`](super::StoreError::may_pass) reads it.
pub(super) fn open(path: &Path) -> io::Result<Arc<RemoteFile>> {
    if let Some(file) = known(path).filter(|file| is_fresh(file)) {
        return Ok(file);
    }
    let file = Arc::new(RemoteFile::open(Address::of(&whole(&shown(path)))?)?);
    opened().push(Arc::clone(&file));
    Ok(file)
}

/// Whether there is anything to tell, so that asking takes no lock.
static IS_TOLD: AtomicBool = AtomicBool::new(false);
static NOTES: Mutex<Vec<String>> = Mutex::new(Vec::new());

fn note(text: String) {
    NOTES.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    IS_TOLD.store(true, Ordering::Release);
}

/// What is to be told since the last call, a sentence each.
pub(super) fn take_notes() -> Vec<String> {
    match IS_TOLD.swap(false, Ordering::Acquire) {
        true => std::mem::take(&mut *NOTES.lock().unwrap_or_else(PoisonError::into_inner)),
        false => Vec::new(),
    }
}
