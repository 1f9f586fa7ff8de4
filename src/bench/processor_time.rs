//! How long the program's threads have been on a processor: what a measurement is worth where the machine has other work to do.

use std::time::Duration;

/// The time of all threads that are there together, where the system tells it.
pub fn processor_time() -> Option<Duration> {
    let threads = std::fs::read_dir("/proc/self/task").ok()?;
    let of = |thread: std::fs::DirEntry| -> Option<u64> {
        // Nanoseconds on a processor, nanoseconds of waiting, number of turns.
        std::fs::read_to_string(thread.path().join("schedstat")).ok()?.split_whitespace().next()?.parse().ok()
    };
    let nanoseconds: Option<u64> = threads.filter_map(Result::ok).map(of).sum();
    nanoseconds.map(Duration::from_nanos)
}
