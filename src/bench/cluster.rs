//! Builds by several processes on one machine: against one process with as many threads as there are processors for, what goes through files,
//! and the same file where processes are killed.

use super::process_memory::peak_memory;
use super::splat::Failure;
use super::{Arguments, Times};
use crate::synth::{clusters::Clusters, gadget};
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Threads of the one process.
const THREADS: usize = 2;
/// Processes of one thread.
const WORKERS: usize = 4;
/// How often a process is looked at.
const PERIOD: Duration = Duration::from_millis(2);

/// One line of the results.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Number of particles.
    pub particles: u64,
    /// Seconds of one process with two threads, from the snapshot (in the system's file cache) to the page file.
    pub alone: Times,
    /// Seconds of four processes of one thread, from the plan to the page file.
    pub workers: Times,
    /// Processor time of the one process that could have been used, divided by that of the others: 1 where they lose nothing.
    pub efficiency: f64,
    /// Tasks of all stages.
    pub tasks: u32,
    /// Bytes that tasks read, of the source and of the files of other tasks, for each particle.
    pub read: f64,
    /// Bytes of particles on their way to where they are built, for each particle.
    pub shuffled: f64,
    /// Bytes of everything else that tasks write, the page file among them, for each particle.
    pub written: f64,
    /// Most memory that the one process has had, bytes.
    pub alone_peak: u64,
    /// Most memory that a process of a task has had, bytes.
    pub worker_peak: u64,
    /// Processes that were killed in one more build, whose file is the same.
    pub killed: u32,
}

/// What is asked of `deepfield build --status --json`.
#[derive(Deserialize)]
struct State {
    stages: Vec<Stage>,
    bytes: Bytes,
}

#[derive(Deserialize)]
struct Stage {
    name: String,
    tasks: u32,
}

#[derive(Deserialize)]
struct Bytes {
    read: u64,
    shuffled: u64,
    written: u64,
}

/// How a process, or several, went.
#[derive(Clone, Copy, Debug, Default)]
struct Went {
    /// Most memory that one has had, bytes.
    peak: u64,
    killed: u32,
    /// Together.
    time: Duration,
}

impl Went {
    fn and(self, other: Went) -> Went {
        Went { peak: self.peak.max(other.peak), killed: self.killed + other.killed, time: self.time + other.time }
    }
}

/// Measures all sizes and prints a table to standard error.
///
/// # Errors
/// When a file cannot be written, a process fails, or a file is not the one that one process builds.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let bench = Bench { folder: folder.path().to_owned(), memory: arguments.memory };
    let mut outcomes = Vec::new();
    eprintln!(
        "{:>10} {:>8} {:>9} {:>10} {:>6} {:>9} {:>11} {:>10} {:>9} {:>10} {:>7}",
        "particles",
        "alone s",
        "workers s",
        "efficiency",
        "tasks",
        "read B/p",
        "shuffle B/p",
        "write B/p",
        "alone MiB",
        "worker MiB",
        "killed"
    );
    for &particles in &arguments.sizes {
        let mut out = std::io::BufWriter::new(std::fs::File::create(bench.source())?);
        gadget::write(&Clusters::new(arguments.seed, particles), &mut out, &())?;
        out.flush()?;
        let (mut alone, mut workers) = (Vec::new(), Vec::new());
        let (mut alone_went, mut workers_went, mut state) = (Went::default(), Went::default(), None);
        let mut typical = Vec::new();
        for _ in 0..arguments.repeat {
            let start = Instant::now();
            alone_went = alone_went.and(bench.alone()?);
            alone.push(start.elapsed());
            let start = Instant::now();
            let stages = bench.by_workers(&[])?;
            workers.push(start.elapsed());
            workers_went = stages.iter().fold(workers_went, |all, stage| all.and(*stage));
            let found = bench.state()?;
            typical = stages.iter().zip(&found.stages).map(|(went, stage)| went.time / stage.tasks.max(1)).collect();
            state = Some(found);
            bench.compare()?;
        }
        let killed = bench.by_workers(&typical)?.iter().map(|stage| stage.killed).sum();
        bench.compare()?;
        let State { stages, bytes } = state.ok_or("--repeat: found 0, expected 1 or more")?;
        let (alone, workers) = (Times::of(alone), Times::of(workers));
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let of_each = |bytes: u64| bytes as f64 / particles as f64;
        let outcome = Outcome {
            particles,
            alone,
            workers,
            efficiency: alone.median * THREADS.min(processors) as f64
                / (workers.median * WORKERS.min(processors) as f64),
            tasks: stages.iter().map(|stage| stage.tasks).sum(),
            read: of_each(bytes.read),
            shuffled: of_each(bytes.shuffled),
            written: of_each(bytes.written),
            alone_peak: alone_went.peak,
            worker_peak: workers_went.peak,
            killed,
        };
        eprintln!(
            "{particles:>10} {:>8.3} {:>9.3} {:>10.2} {:>6} {:>9.1} {:>11.1} {:>10.2} {:>9} {:>10} {killed:>7}",
            alone.median,
            workers.median,
            outcome.efficiency,
            outcome.tasks,
            outcome.read,
            outcome.shuffled,
            outcome.written,
            outcome.alone_peak >> 20,
            outcome.worker_peak >> 20
        );
        outcomes.push(outcome);
    }
    Ok(outcomes)
}

/// Where it is measured, and with what.
struct Bench {
    folder: PathBuf,
    memory: Option<u64>,
}

impl Bench {
    fn source(&self) -> PathBuf {
        self.folder.join("snapshot")
    }

    fn job(&self) -> PathBuf {
        self.folder.join("job")
    }

    fn program(&self, words: &[&str]) -> Result<Command, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(words);
        Ok(command)
    }

    fn build(&self, out: &str) -> Result<Command, Failure> {
        let mut command = self.program(&["build"])?;
        command.arg(self.source()).arg("-o").arg(self.folder.join(out));
        Ok(command)
    }

    fn with_memory<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        match self.memory {
            Some(bytes) => command.args(["--memory", &bytes.to_string()]),
            None => command,
        }
    }

    /// The build of one process.
    fn alone(&self) -> Result<Went, Failure> {
        let mut command = self.build("alone.df")?;
        watched(self.with_memory(command.args(["--threads", &THREADS.to_string()])), None)
    }

    /// Builds by tasks, and gives how those of each stage went. Where `typical` has how long a task of each stage takes, the first process of
    /// each task is killed at some moment within twice of that, and the task run again.
    fn by_workers(&self, typical: &[Duration]) -> Result<Vec<Went>, Failure> {
        let job = self.job();
        if job.exists() {
            watched(self.program(&["build", "--cancel"])?.arg(&job), None)?;
        }
        watched(self.with_memory(self.build("out.df")?.arg("--plan").arg(&job)), None)?;
        let stages = self.state()?.stages;
        stages.iter().enumerate().map(|(number, stage)| self.stage(stage, typical.get(number).copied())).collect()
    }

    /// Runs the tasks of a stage, whoever is free the next one.
    fn stage(&self, stage: &Stage, typical: Option<Duration>) -> Result<Went, Failure> {
        let (next, went) = (AtomicU32::new(0), Mutex::new(Went::default()));
        let work = || -> Result<(), Failure> {
            loop {
                let task = next.fetch_add(1, Ordering::Relaxed);
                if task >= stage.tasks {
                    return Ok(());
                }
                // Multiples of the golden ratio: moments of all kinds, and the same ones each time.
                let moment = 2.0 * (f64::from(task + 1) * 0.618_033_988_749_895).fract();
                let own = self.task(stage, task, typical.map(|time| time.mul_f64(moment)))?;
                let mut all = went.lock().unwrap_or_else(PoisonError::into_inner);
                *all = all.and(own);
            }
        };
        std::thread::scope(|scope| -> Result<(), Failure> {
            let threads: Vec<_> = (0..WORKERS).map(|_| scope.spawn(work)).collect();
            // All of them end before the first failure is told.
            let ended: Vec<_> = threads.into_iter().map(|thread| thread.join()).collect();
            ended.into_iter().try_for_each(|ended| ended.map_err(|_| "a thread that waits for processes has failed")?)
        })?;
        Ok(went.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs a task in a process, once more where that is killed.
    fn task(&self, stage: &Stage, task: u32, kill_after: Option<Duration>) -> Result<Went, Failure> {
        let run = |kill_after: Option<Duration>| -> Result<Went, Failure> {
            let mut command = self.program(&["stage"])?;
            command.arg(self.job()).args([&stage.name, &task.to_string()]).env("RAYON_NUM_THREADS", "1");
            watched(self.with_memory(&mut command), kill_after)
        };
        let went = run(kill_after)?;
        if went.killed == 0 { Ok(went) } else { Ok(went.and(run(None)?)) }
    }

    /// How far the job is.
    fn state(&self) -> Result<State, Failure> {
        let output = self.program(&["build", "--json", "--status"])?.arg(self.job()).output()?;
        Ok(serde_json::from_slice(&output.stdout).map_err(|error| format!("deepfield build --status: {error}"))?)
    }

    /// Whether both ways have built the same file.
    fn compare(&self) -> Result<(), Failure> {
        let [alone, out] = ["alone.df", "out.df"].map(|name| std::fs::read(self.folder.join(name)));
        if alone? == out? { Ok(()) } else { Err("out.df: found other bytes than those of alone.df".into()) }
    }
}

/// Runs a process to its end, or kills it after a while.
fn watched(command: &mut Command, kill_after: Option<Duration>) -> Result<Went, Failure> {
    let start = Instant::now();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let process = child.id().to_string();
    let (mut peak, mut killed) = (0, false);
    let status = loop {
        peak = peak.max(peak_memory(&process).unwrap_or(0));
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if !killed && kill_after.is_some_and(|after| start.elapsed() >= after) {
            child.kill()?;
            killed = true;
        }
        std::thread::sleep(PERIOD);
    };
    let mut said = String::new();
    if let Some(mut errors) = child.stderr.take() {
        errors.read_to_string(&mut said)?;
    }
    // One that ended as it was killed has done its task.
    match (status.success(), killed) {
        (true, _) => Ok(Went { peak, killed: 0, time: start.elapsed() }),
        (false, true) => Ok(Went { peak, killed: 1, time: Duration::ZERO }),
        (false, false) => Err(format!("{command:?}: {}", said.trim_end()).into()),
    }
}
