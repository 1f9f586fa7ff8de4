//! A process that is kept running.

use super::Line;
use std::io::Write;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// A process that ran for so long did not fail at its start.
const STEADY: Duration = Duration::from_secs(20);
/// The longest time before one that failed is started again.
const LONGEST: Duration = Duration::from_secs(15);

/// A process with a name, or its place while it does not run.
#[derive(Debug)]
pub(super) struct Post {
    pub name: String,
    child: Option<Child>,
    line: Option<ChildStdin>,
    tried: Option<Instant>,
    /// How often it failed at its start, one time after the other.
    failures: u32,
}

/// How a process has ended.
#[derive(Debug)]
pub(super) struct End(Result<ExitStatus, std::io::Error>);

impl End {
    /// Whether it has done what it was asked for.
    pub fn is_success(&self) -> bool {
        self.0.as_ref().is_ok_and(ExitStatus::success)
    }

    /// Its exit code; 1 for one that was killed.
    pub fn code(&self) -> i32 {
        self.0.as_ref().ok().and_then(ExitStatus::code).unwrap_or(1)
    }
}

impl std::fmt::Display for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.0 {
            Ok(status) => status.fmt(f),
            Err(error) => error.fmt(f),
        }
    }
}

/// How long it is waited before one is started that failed so often at its start.
fn pause(failures: u32) -> Duration {
    match failures {
        0 => Duration::ZERO,
        failures => Duration::from_millis(250u64 << (failures - 1).min(8)).min(LONGEST),
    }
}

impl Post {
    pub fn new(name: &str) -> Post {
        Post { name: name.to_owned(), child: None, line: None, tried: None, failures: 0 }
    }

    /// The number of the process while it runs.
    pub fn process(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }

    /// How often it failed at its start, one time after the other.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// How it has ended; once.
    pub fn look(&mut self) -> Option<End> {
        let end = End(self.child.as_mut()?.try_wait().transpose()?);
        (self.child, self.line) = (None, None);
        let was_steady = self.tried.is_some_and(|tried| tried.elapsed() >= STEADY);
        self.failures = if was_steady { 1 } else { self.failures.saturating_add(1) };
        Some(end)
    }

    /// Whether it is time to start it.
    pub fn is_due(&self) -> bool {
        self.child.is_none() && self.tried.is_none_or(|tried| tried.elapsed() >= pause(self.failures))
    }

    /// Starts it.
    ///
    /// # Errors
    /// When that is not possible; it counts as a failure at the start.
    pub fn start(&mut self, mut command: Command) -> std::io::Result<()> {
        self.tried = Some(Instant::now());
        let mut child = command.stdin(Stdio::piped()).spawn().inspect_err(|_| self.failures += 1)?;
        self.line = child.stdin.take();
        self.child = Some(child);
        Ok(())
    }

    /// Tells it something. One that does not hear any more has ended, which is seen soon.
    pub fn say(&mut self, line: &Line) {
        let (Some(pipe), Some(text)) = (&mut self.line, line.encode()) else { return };
        if pipe.write_all(text.as_bytes()).and_then(|()| pipe.flush()).is_err() {
            self.line = None;
        }
    }

    /// Asks it to end.
    pub fn ask_to_end(&mut self) {
        self.line = None;
    }
}

impl Drop for Post {
    /// Nothing is left behind.
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            // One that has ended by itself cannot be ended again.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_to_a_limit() {
        let pauses: Vec<u128> = (0..9).map(|failures| pause(failures).as_millis()).collect();
        assert_eq!(pauses, [0, 250, 500, 1000, 2000, 4000, 8000, 15_000, 15_000]);
        assert_eq!(pause(u32::MAX), LONGEST);
    }

    #[test]
    fn what_cannot_be_started_is_tried_after_a_pause() {
        let mut post = Post::new("left");
        assert!(post.is_due() && post.look().is_none() && post.process().is_none());
        assert!(post.start(Command::new("/no/such/program")).is_err());
        assert!(!post.is_due(), "not at once");
        assert_eq!(post.failures(), 1);
    }
}
