//! Worker processes that run the tasks of a job as they are told, and what kills some of them.

use crate::bench::process_memory::peak_memory;
use crate::bench::splat::Failure;
use crate::build::cluster::{Job, Stage};
use serde::Serialize;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Processes of one thread.
pub const WORKERS: usize = 4;
/// How soon it is tried again to kill a process, where none was at work.
const AGAIN: Duration = Duration::from_millis(1);

/// A process to be killed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kill {
    /// When, from the start of the workers.
    pub moment: Duration,
    /// Which one, or the next that is at work.
    pub worker: usize,
}

/// How a build by workers went.
#[derive(Debug, Default)]
pub struct Went {
    /// The most memory that each process has had, bytes, where the system tells it.
    pub peaks: Vec<Option<u64>>,
    /// Processes that were killed.
    pub killed: u32,
    /// The stages, in order.
    pub stages: Vec<StageTime>,
    /// From the start of the workers to their end.
    pub time: Duration,
}

/// How long a stage took.
#[derive(Clone, Debug, Serialize)]
pub struct StageTime {
    /// Its name.
    pub name: String,
    /// Number of its tasks.
    pub tasks: u32,
    /// Seconds from the end of the stage before to its own.
    pub seconds: f64,
    /// Seconds of all its tasks together.
    pub busy: f64,
}

/// Runs all tasks of the job in a folder, each with so much memory.
///
/// # Errors
/// When a process cannot be started, or ends without being killed.
pub fn run(job: &Path, memory: Option<u64>, kills: &[Kill]) -> Result<Went, Failure> {
    let start = Instant::now();
    let build = Build {
        job,
        memory,
        stages: Job::open(job)?.stages().to_vec(),
        turn: Mutex::new(Turn { stage: 0, next: 0, done: 0, began: start, busy: Duration::ZERO, is_failed: false }),
        changed: Condvar::new(),
        slots: Default::default(),
        went: Mutex::default(),
    };
    let work = |slot: &Mutex<Slot>| {
        let worked = build.work(slot);
        if worked.is_err() {
            build.fail();
        }
        worked
    };
    let (end, over) = channel();
    std::thread::scope(|scope| -> Result<(), Failure> {
        let workers: Vec<_> = build.slots.iter().map(|slot| scope.spawn(move || work(slot))).collect();
        let killer = scope.spawn(|| build.kill(kills, start, over));
        // All of them end before the first failure is told.
        let ended: Vec<_> = workers.into_iter().map(|worker| worker.join()).collect();
        drop(end);
        let failed = |_| Failure::from("a thread that waits for processes has failed");
        killer.join().map_err(failed)?;
        ended.into_iter().try_for_each(|ended| ended.map_err(failed)?)
    })?;
    let went = build.went.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Went { time: start.elapsed(), ..went })
}

/// A build that is under way.
struct Build<'a> {
    job: &'a Path,
    memory: Option<u64>,
    stages: Vec<Stage>,
    turn: Mutex<Turn>,
    /// Told when a stage ends, or the build.
    changed: Condvar,
    slots: [Mutex<Slot>; WORKERS],
    went: Mutex<Went>,
}

/// The stage whose turn it is.
struct Turn {
    stage: usize,
    /// The task that is handed out next, and those that are done.
    next: u32,
    done: u32,
    began: Instant,
    busy: Duration,
    is_failed: bool,
}

/// The process of a worker.
#[derive(Default)]
struct Slot {
    child: Option<Child>,
    is_busy: bool,
    is_killed: bool,
    /// The most memory that it had when it was killed.
    peak: Option<u64>,
}

/// What a process is told, and what it says.
struct Pipes {
    tasks: ChildStdin,
    done: BufReader<ChildStdout>,
}

/// What is guarded is whole whenever its lock is given back.
fn locked<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Build<'_> {
    /// What a worker does: one task after the other, each again where its process is killed.
    fn work(&self, slot: &Mutex<Slot>) -> Result<(), Failure> {
        let mut pipes = self.start(slot)?;
        while let Some(task) = self.take() {
            let begun = Instant::now();
            loop {
                locked(slot).is_busy = true;
                let is_done = pipes.is_done(&task);
                locked(slot).is_busy = false;
                if is_done {
                    break;
                }
                if !self.end(slot, pipes)? {
                    return Err(format!("deepfield stage: {task}: found no end of it, expected its line").into());
                }
                pipes = self.start(slot)?;
            }
            self.done(begun.elapsed());
        }
        self.end(slot, pipes)?;
        Ok(())
    }

    /// Starts a process that waits for tasks.
    fn start(&self, slot: &Mutex<Slot>) -> Result<Pipes, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("stage").arg(self.job).env("RAYON_NUM_THREADS", "1").stdin(Stdio::piped()).stdout(Stdio::piped());
        if let Some(memory) = self.memory {
            command.args(["--memory", &memory.to_string()]);
        }
        let mut child = command.spawn()?;
        let pipes = child.stdin.take().zip(child.stdout.take());
        let (tasks, done) = pipes.ok_or("deepfield stage: found no pipes, expected two")?;
        locked(slot).child = Some(child);
        Ok(Pipes { tasks, done: BufReader::new(done) })
    }

    /// Ends a process that has no more to do, or has ended already; says whether it was killed.
    fn end(&self, slot: &Mutex<Slot>, pipes: Pipes) -> Result<bool, Failure> {
        let Slot { child, is_killed, peak, .. } = std::mem::take(&mut *locked(slot));
        let Some(mut child) = child else { return Ok(false) };
        // Told only while it lives.
        let peak = peak.or_else(|| peak_memory(&child.id().to_string()));
        drop(pipes);
        let status = child.wait()?;
        if !is_killed && !status.success() {
            return Err(format!("deepfield stage: {status}").into());
        }
        let mut went = locked(&self.went);
        went.peaks.push(peak);
        went.killed += u32::from(is_killed);
        Ok(is_killed)
    }

    /// The next task, once there is one; `None` at the end.
    fn take(&self) -> Option<String> {
        let mut turn = locked(&self.turn);
        loop {
            let stage = self.stages.get(turn.stage).filter(|_| !turn.is_failed)?;
            if turn.next < stage.tasks {
                turn.next += 1;
                return Some(format!("{} {}", stage.name, turn.next - 1));
            }
            turn = self.changed.wait(turn).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Takes note of a task of the stage at hand that is done.
    fn done(&self, time: Duration) {
        let mut turn = locked(&self.turn);
        turn.done += 1;
        turn.busy += time;
        let Some(Stage { name, tasks, .. }) = self.stages.get(turn.stage) else { return };
        if turn.done < *tasks {
            return;
        }
        let [seconds, busy] = [turn.began.elapsed(), turn.busy].map(|time| time.as_secs_f64());
        locked(&self.went).stages.push(StageTime { name: name.clone(), tasks: *tasks, seconds, busy });
        let (stage, began) = (turn.stage + 1, Instant::now());
        *turn = Turn { stage, next: 0, done: 0, began, busy: Duration::ZERO, is_failed: turn.is_failed };
        self.changed.notify_all();
    }

    /// Gives the build up.
    fn fail(&self) {
        locked(&self.turn).is_failed = true;
        self.changed.notify_all();
    }

    /// Kills processes at their moments, until the build is over.
    fn kill(&self, kills: &[Kill], start: Instant, over: Receiver<()>) {
        for kill in kills {
            let mut wait = kill.moment.saturating_sub(start.elapsed());
            loop {
                if over.recv_timeout(wait) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
                if self.kill_from(kill.worker) {
                    break;
                }
                wait = AGAIN;
            }
        }
    }

    /// Kills the process of the first worker from this one on that is at work; false where none is.
    fn kill_from(&self, first: usize) -> bool {
        (0..WORKERS).any(|k| {
            let mut slot = locked(&self.slots[(first + k) % WORKERS]);
            let Slot { child: Some(child), is_busy: true, is_killed, peak } = &mut *slot else { return false };
            if *is_killed {
                return false;
            }
            *peak = peak_memory(&child.id().to_string());
            *is_killed = child.kill().is_ok();
            *is_killed
        })
    }
}

impl Pipes {
    /// Has a process run a task; false where it ends before that.
    fn is_done(&mut self, task: &str) -> bool {
        let mut said = String::new();
        self.tasks.write_all(format!("{task}\n").as_bytes()).is_ok()
            && self.done.read_line(&mut said).is_ok_and(|_| said.trim_end() == task)
    }
}
