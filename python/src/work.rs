//! Long work away from the interpreter, which meanwhile runs other threads, hears Ctrl-C and is told how far the work has come.
//!
//! The work has a thread of its own; the thread that called attends to the interpreter until the work ends, or is left to end by itself.

use crate::error::{Failure, told};
use crate::forks::Call;
use deepfield_draw::picture::asked::{State, on_threads};
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often signals are looked for.
const PERIOD: Duration = Duration::from_millis(10);

/// How often progress is told at most.
const TELLING: Duration = Duration::from_millis(50);

/// How long interrupted work that writes is waited for, so that it leaves nothing behind: with what a busy machine takes to run this thread again,
/// the tenth of a second that interrupted work is to take.
const GRACE: Duration = Duration::from_millis(60);

/// How long Python's end waits at most for what was still writing after that.
const PATIENCE: Duration = Duration::from_secs(2);

/// Threads of interrupted work that writes, which had not ended in time.
static LEFT: Mutex<Vec<JoinHandle<()>>> = Mutex::new(Vec::new());

/// The process that worked first. In one that is forked from it the threads that share its work are not there.
static FIRST: OnceLock<u32> = OnceLock::new();

/// Stack of the work's thread, bytes: as much as a program's first thread usually has.
const STACK: usize = 8 << 20;

/// Lets signals be handled, and tells `progress` the stage, the steps done and their number, unless that was a moment ago, at `last`.
fn attend(state: &State, py: Python<'_>, progress: Option<&Py<PyAny>>, last: &mut Instant) -> PyResult<()> {
    py.check_signals()?;
    let Some(progress) = progress.filter(|_| last.elapsed() >= TELLING) else { return Ok(()) };
    if let Some(reached) = state.reached() {
        progress.call1(py, reached)?;
        *last = Instant::now();
    }
    Ok(())
}

/// Does the work, and gives what came of it with what there was to tell. `progress` is called with the stage, the steps done and their
/// number, some times a second; what it raises ends the work, as Ctrl-C does. Interrupted, it is waited for until it has ended: who called
/// removes what it leaves.
///
/// # Errors
/// [`crate::error::Error`] where the work fails; else what a signal handler or `progress` raises.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    job: impl FnOnce(&Arc<State>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<(T, Vec<String>)> {
    run_beside(py, progress, Awaited::End, job)
}

/// Does work that writes nothing but into the cache, as [`run`] does; interrupted, it is not waited for: it ends by itself where it next asks whether
/// anybody waits, and where it may be writing Python's end waits for that.
///
/// # Errors
/// As [`run`].
pub fn run_alone<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    job: impl FnOnce(&Arc<State>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<(T, Vec<String>)> {
    run_beside(py, progress, Awaited::Nothing, job)
}

/// Does work that writes, as [`run_alone`] does; interrupted where it writes, it is waited for a little, within which it ends as a rule, and else by
/// [`wait_for_writers`]. Where it has ended, nothing that is not whole is left of it.
///
/// # Errors
/// As [`run`].
pub fn run_writing<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    job: impl FnOnce(&Arc<State>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<(T, Vec<String>)> {
    run_beside(py, progress, Awaited::Writing, job)
}

/// What is waited for of interrupted work.
#[derive(Clone, Copy)]
enum Awaited {
    /// That it ends.
    End,
    /// That it ends, where it is writing, and [`GRACE`] at most.
    Writing,
    /// Nothing.
    Nothing,
}

impl Awaited {
    /// For how long, of work in this state.
    fn longest(self, state: &State) -> Duration {
        match self {
            Awaited::End => Duration::MAX,
            Awaited::Writing if state.is_writing() => GRACE,
            Awaited::Writing | Awaited::Nothing => Duration::ZERO,
        }
    }
}

/// Does the work on a thread to which it is left, interrupted, after what is awaited of it.
fn run_beside<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    awaited: Awaited,
    job: impl FnOnce(&Arc<State>) -> Result<T, Failure> + Send + 'static,
) -> PyResult<(T, Vec<String>)> {
    let state = Arc::new(State::default());
    let (ends, ended) = channel::<Ended<T>>();
    let own = Arc::clone(&state);
    let process = std::process::id();
    let is_forked = *FIRST.get_or_init(|| process) != process;
    // As many as there usually are, for this work alone.
    let threads = is_forked.then_some(0);
    let call = Call::begin(py);
    let working = call.work();
    let work = move || {
        // Whoever was interrupted hears nothing of it.
        let _ = ends.send(catch_unwind(AssertUnwindSafe(|| on_threads(threads, || job(&own)))));
        drop(working);
    };
    let named = std::thread::Builder::new().name("deepfield".into()).stack_size(STACK);
    let thread = named.spawn(work).map_err(|error| told(format!("starting a thread: {error}").into()))?;
    let (waiting, progress) = (&*state, progress.as_ref());
    let ended = py.detach(move || {
        let mut last = Instant::now();
        loop {
            match ended.recv_timeout(PERIOD) {
                Ok(ended) => return Ok(ended),
                Err(RecvTimeoutError::Disconnected) => return Ok(Ok(Err("the work ended without an answer".into()))),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if let Err(interruption) = Python::attach(|py| attend(waiting, py, progress, &mut last)) {
                waiting.stop().store(true, Ordering::Relaxed);
                // However it ends.
                let is_left = matches!(ended.recv_timeout(awaited.longest(waiting)), Err(RecvTimeoutError::Timeout));
                // What only reads may be building into the cache, too.
                if is_left && (matches!(awaited, Awaited::Writing) || waiting.is_writing()) {
                    leave(thread);
                }
                return Err(interruption);
            }
            if std::process::id() != process {
                // What is behind it is another process's.
                std::mem::forget(thread);
                return Err(told("this process was forked within the call, whose work the first one does".into()));
            }
        }
    })?;
    match ended {
        Ok(Ok(found)) => Ok((found, state.take_notes())),
        Ok(Err(failure)) => Err(told(failure)),
        Err(panic) => resume_unwind(panic),
    }
}

/// Leaves a thread to [`wait_for_writers`].
fn leave(thread: JoinHandle<()>) {
    let mut left = LEFT.lock().unwrap_or_else(PoisonError::into_inner);
    left.retain(|other| !other.is_finished());
    left.push(thread);
}

/// Waits a little for interrupted work that writes: Python calls it as it ends, which ends all threads in the middle of what they do.
#[pyfunction]
pub fn wait_for_writers(py: Python<'_>) {
    let left = std::mem::take(&mut *LEFT.lock().unwrap_or_else(PoisonError::into_inner));
    py.detach(move || {
        let end = Instant::now() + PATIENCE;
        while left.iter().any(|thread| !thread.is_finished()) && Instant::now() < end {
            std::thread::sleep(PERIOD);
        }
    });
}

/// How work ended: what came of it, or with what it was unwound.
type Ended<T> = Result<Result<T, Failure>, Box<dyn Any + Send>>;
