//! The threads that requests wait on, two for the whole process, and how others wait for them.

use std::io;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Mutex, PoisonError};
use tokio::runtime::{Builder, Runtime};

/// Enough: they move bytes and decode nothing.
const THREADS: usize = 2;

/// The one of this process: where it was forked from another, the threads of that are not there.
fn runtime() -> io::Result<&'static Runtime> {
    static OWN: Mutex<Option<(u32, &'static Runtime)>> = Mutex::new(None);
    // What is there is whole, so a poisoned lock does not matter.
    let mut own = OWN.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((_, runtime)) = own.filter(|(first, _)| *first == process) {
        return Ok(runtime);
    }
    let started =
        Builder::new_multi_thread().worker_threads(THREADS).thread_name("deepfield remote").enable_all().build();
    let started = started.map_err(|error| io::Error::other(format!("no thread can be started: {error}")))?;
    // There for as long as the process is.
    let started: &'static Runtime = Box::leak(Box::new(started));
    *own = Some((process, started));
    Ok(started)
}

/// Begins work; its outcome can be waited for by a thread of any kind, those of other runtimes too.
pub(super) fn begin<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> io::Result<Receiver<T>> {
    let (give, take) = sync_channel(1);
    runtime()?.spawn(async move {
        // Whoever has given up waiting wants no outcome.
        let _ = give.send(work.await);
    });
    Ok(take)
}

/// Does work and waits for it.
pub(super) fn wait<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> io::Result<T> {
    outcome(&begin(work)?)
}

/// Waits for work that was begun.
pub(super) fn outcome<T>(work: &Receiver<T>) -> io::Result<T> {
    work.recv().map_err(|_| io::Error::other("a request was given up"))
}
