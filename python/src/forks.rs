//! Processes that are forked from this one. A lock that another thread holds at that moment is never given back there, and what it was making for all
//! is never made. So a fork waits until other threads are in the middle of no call, and they begin none until it is done.

use pyo3::prelude::*;
use std::cell::Cell;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::time::{Duration, Instant};

/// How often what is waited for is looked at.
const PERIOD: Duration = Duration::from_millis(5);

/// How long a fork waits at most.
const PATIENCE: Duration = Duration::from_secs(2);

/// Calls that have not ended, and their work, each as 1; forks that wait for them or are being done, each as [`FORK`]. It is no lock, which could be
/// held itself.
static STATE: AtomicU64 = AtomicU64::new(0);
const FORK: u64 = 1 << 32;

thread_local! {
    /// The calls among them that this thread is in.
    static OWN: Cell<u64> = const { Cell::new(0) };
}

/// A call that has not ended, of the thread that it stays on.
pub struct Call(PhantomData<*const ()>);

/// The work of a call, on another thread.
pub struct Work(());

impl Call {
    /// Begins one, once no fork is to be done; within another one at once, which forks wait for anyway.
    pub fn begin(py: Python<'_>) -> Call {
        let begins = || {
            let may = |state: u64| (state < FORK).then_some(state + 1);
            STATE.fetch_update(SeqCst, SeqCst, may).is_ok()
        };
        if OWN.get() > 0 {
            STATE.fetch_add(1, SeqCst);
        } else if !begins() {
            py.detach(|| {
                let end = Instant::now() + 2 * PATIENCE;
                while !begins() {
                    std::thread::sleep(PERIOD);
                    if Instant::now() > end {
                        // Who forks may wait for something of this thread's.
                        STATE.fetch_add(1, SeqCst);
                        break;
                    }
                }
            });
        }
        OWN.set(OWN.get() + 1);
        Call(PhantomData)
    }

    /// Begins its work, which may end after it.
    pub fn work(&self) -> Work {
        STATE.fetch_add(1, SeqCst);
        Work(())
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        OWN.set(OWN.get() - 1);
        STATE.fetch_sub(1, SeqCst);
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        STATE.fetch_sub(1, SeqCst);
    }
}

/// Waits a little for what other threads do: Python calls it before it forks. Who forks within a call, as `progress` may, does not wait for that.
#[pyfunction]
pub fn before_fork(py: Python<'_>) {
    STATE.fetch_add(FORK, SeqCst);
    if OWN.get() > 0 {
        return;
    }
    py.detach(|| {
        let end = Instant::now() + PATIENCE;
        while !STATE.load(SeqCst).is_multiple_of(FORK) && Instant::now() < end {
            std::thread::sleep(PERIOD);
        }
    });
}

/// Lets calls begin again: Python calls it when it has forked.
#[pyfunction]
pub fn after_fork_in_parent() {
    STATE.fetch_sub(FORK, SeqCst);
}

/// The same in the new process, which has this thread alone.
#[pyfunction]
pub fn after_fork_in_child() {
    STATE.store(OWN.get(), SeqCst);
}
