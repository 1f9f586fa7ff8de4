//! Builds by several processes on one machine: against one process with as many threads as there are processors for, what goes through files,
//! and the same file where processes are killed.

mod workers;

use super::process_memory::peak_memory;
use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::cluster::{Job, Moved};
use crate::synth::random::Random;
use crate::synth::{clusters::Clusters, gadget};
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use workers::{Kill, StageTime, WORKERS, Went};

/// Threads of the one process.
const THREADS: usize = 2;
/// How often it is looked at what memory that has.
const PERIOD: Duration = Duration::from_millis(20);

/// Which processes are killed.
#[derive(clap::Args, Clone, Copy, Debug)]
#[group(id = "cluster")]
#[command(next_help_heading = "Options of `bench cluster`")]
pub struct Options {
    /// Worker processes that are killed in all further builds together, at moments by chance and --seed while they run.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(..=10_000))]
    pub kills: u32,
    /// Further builds in which they are killed; more where some moments met no process.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub builds: u32,
}

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
    /// The stages of the last build in which no process was killed.
    pub stages: Vec<StageTime>,
    /// Bytes that tasks read, of the source and of the files of other tasks, for each particle.
    pub read: f64,
    /// Bytes of particles on their way to where they are built, for each particle.
    pub shuffled: f64,
    /// Bytes of everything else that tasks write, the page file among them, for each particle.
    pub written: f64,
    /// Memory that each process may take, bytes; `None` where none was named.
    pub memory_limit: Option<u64>,
    /// Most memory that the one process has had, bytes; `None` where the system does not tell it.
    pub alone_peak: Option<u64>,
    /// Most memory that a worker has had, one that was killed too.
    pub worker_peak: Option<u64>,
    /// Workers that have had more than they may.
    pub over_limit: Option<u32>,
    /// Workers that were killed.
    pub killed: u32,
    /// Further builds in which they were, whose files are all the same.
    pub builds: u32,
}

/// Measures all sizes and prints a table to standard error.
///
/// # Errors
/// When a file cannot be written, a process fails, or a file is not the one that one process builds.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    let bench = Bench { folder: folder.path().to_owned(), memory: arguments.memory };
    eprintln!(
        "{:>10} {:>8} {:>9} {:>10} {:>6} {:>9} {:>11} {:>10} {:>12} {:>12} {:>12} {:>10} {:>7} {:>7}",
        "particles",
        "alone s",
        "workers s",
        "efficiency",
        "tasks",
        "read B/p",
        "shuffle B/p",
        "write B/p",
        "limit MiB",
        "alone MiB",
        "worker MiB",
        "over limit",
        "killed",
        "builds"
    );
    let outcome = |&particles: &u64| -> Result<Outcome, Failure> {
        let outcome = bench.measure(particles, arguments)?;
        print(&outcome);
        Ok(outcome)
    };
    arguments.sizes.iter().map(outcome).collect()
}

/// A line of the table, and one with the seconds of the stages.
fn print(outcome: &Outcome) {
    let known = |value: Option<u64>, none: &str| value.map_or(none.to_owned(), |value| value.to_string());
    let mebibytes = |bytes: Option<u64>| known(bytes.map(|bytes| bytes >> 20), "not measured");
    let over = match (outcome.over_limit, outcome.memory_limit) {
        (Some(workers), _) => workers.to_string(),
        (None, Some(_)) => "not known".to_owned(),
        (None, None) => "-".to_owned(),
    };
    eprintln!(
        "{:>10} {:>8.3} {:>9.3} {:>10.2} {:>6} {:>9.1} {:>11.1} {:>10.2} {:>12} {:>12} {:>12} {over:>10} {:>7} {:>7}",
        outcome.particles,
        outcome.alone.median,
        outcome.workers.median,
        outcome.efficiency,
        outcome.tasks,
        outcome.read,
        outcome.shuffled,
        outcome.written,
        known(outcome.memory_limit.map(|bytes| bytes >> 20), "none"),
        mebibytes(outcome.alone_peak),
        mebibytes(outcome.worker_peak),
        outcome.killed,
        outcome.builds
    );
    let stages: Vec<String> = outcome
        .stages
        .iter()
        .map(|stage| format!("{} {:.3} s ({:.3})", stage.name, stage.seconds, stage.busy))
        .collect();
    eprintln!("{:>10} stages (and all of their tasks): {}", "", stages.join(", "));
}

/// Where it is measured, and with what.
struct Bench {
    folder: PathBuf,
    memory: Option<u64>,
}

impl Bench {
    /// Measures a snapshot of so many particles.
    fn measure(&self, particles: u64, arguments: &Arguments) -> Result<Outcome, Failure> {
        let mut out = std::io::BufWriter::new(std::fs::File::create(self.source())?);
        gadget::write(&Clusters::new(arguments.seed, particles), &mut out, &())?;
        out.flush()?;
        drop(out);
        let (mut alone, mut workers) = (Vec::new(), Vec::new());
        let (mut alone_peak, mut peaks): (Option<u64>, Vec<Option<u64>>) = (None, Vec::new());
        let mut fastest = Duration::MAX;
        let (mut stages, mut moved) = (Vec::new(), Moved::default());
        for _ in 0..arguments.repeat {
            let start = Instant::now();
            alone_peak = alone_peak.max(self.alone()?);
            alone.push(start.elapsed());
            let start = Instant::now();
            let went = self.by_workers(&[])?;
            workers.push(start.elapsed());
            fastest = fastest.min(went.time);
            peaks.extend(went.peaks);
            stages = went.stages;
            moved = self.end()?;
        }
        let Options { kills, builds: least } = arguments.cluster;
        let (mut killed, mut builds) = (0, 0);
        while killed < kills || (kills > 0 && builds < least) {
            // Those that met no process are made up for.
            let due = kills.saturating_sub(killed).div_ceil(least.saturating_sub(builds).max(1));
            let went = self.by_workers(&chosen(arguments.seed, builds, due, fastest))?;
            peaks.extend(went.peaks);
            self.end()?;
            killed += went.killed;
            builds += 1;
        }
        let (alone, workers) = (Times::of(alone), Times::of(workers));
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let of_each = |bytes: u64| bytes as f64 / particles as f64;
        Ok(Outcome {
            particles,
            alone,
            workers,
            efficiency: alone.median * THREADS.min(processors) as f64
                / (workers.median * WORKERS.min(processors) as f64),
            tasks: stages.iter().map(|stage| stage.tasks).sum(),
            stages,
            read: of_each(moved.read),
            shuffled: of_each(moved.shuffled),
            written: of_each(moved.written),
            memory_limit: self.memory,
            alone_peak,
            worker_peak: peaks.iter().flatten().max().copied(),
            over_limit: over(&peaks, self.memory),
            killed,
            builds,
        })
    }

    fn source(&self) -> PathBuf {
        self.folder.join("snapshot")
    }

    fn job(&self) -> PathBuf {
        self.folder.join("job")
    }

    fn build(&self, out: &str) -> Result<Command, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("build").arg(self.source()).arg("-o").arg(self.folder.join(out));
        if let Some(bytes) = self.memory {
            command.args(["--memory", &bytes.to_string()]);
        }
        Ok(command)
    }

    /// The build of one process; gives the most memory that it has had.
    fn alone(&self) -> Result<Option<u64>, Failure> {
        ended(self.build("alone.df")?.args(["--threads", &THREADS.to_string()]))
    }

    /// Builds by tasks, and kills processes meanwhile.
    fn by_workers(&self, kills: &[Kill]) -> Result<Went, Failure> {
        ended(self.build("out.df")?.arg("--plan").arg(self.job()))?;
        workers::run(&self.job(), self.memory, kills)
    }

    /// Compares the file of workers with that of one process, and removes the job; gives the bytes that it has moved.
    fn end(&self) -> Result<Moved, Failure> {
        let [alone, out] = ["alone.df", "out.df"].map(|name| std::fs::read(self.folder.join(name)));
        if alone? != out? {
            return Err("out.df: found other bytes than those of alone.df, expected the same".into());
        }
        let job = Job::open(&self.job())?;
        let moved = job.status()?.bytes;
        job.remove()?;
        Ok(moved)
    }
}

/// Runs a process to its end; gives the most memory that it has had, where the system tells it.
fn ended(command: &mut Command) -> Result<Option<u64>, Failure> {
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let process = child.id().to_string();
    let (end, over) = channel::<()>();
    let watch = std::thread::spawn(move || {
        let mut peak: Option<u64> = None;
        loop {
            peak = peak.max(peak_memory(&process));
            if over.recv_timeout(PERIOD) != Err(RecvTimeoutError::Timeout) {
                return peak;
            }
        }
    });
    let output = child.wait_with_output()?;
    drop(end);
    let peak = watch.join().map_err(|_| "a thread that watches a process has failed")?;
    match output.status.success() {
        true => Ok(peak),
        false => Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim_end()).into()),
    }
}

/// Moments by chance within the time of a build.
fn chosen(seed: u64, build: u32, count: u32, time: Duration) -> Vec<Kill> {
    let mut random = Random::new(seed, u64::from(build));
    let mut kill =
        || Kill { moment: time.mul_f64(random.uniform()), worker: (random.uniform() * WORKERS as f64) as usize };
    let mut kills: Vec<Kill> = (0..count).map(|_| kill()).collect();
    kills.sort_by_key(|kill| kill.moment);
    kills
}

/// How many of the processes with these peaks have had more than their limit; `None` without one, and where a peak is not known.
fn over(peaks: &[Option<u64>], limit: Option<u64>) -> Option<u32> {
    let limit = limit?;
    peaks.iter().map(|peak| peak.map(|peak| u32::from(peak > limit))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_within_a_build_in_order_and_those_of_the_seed() {
        let time = Duration::from_secs(3);
        let kills = chosen(1, 0, 500, time);
        assert!(kills.len() == 500 && kills.is_sorted_by_key(|kill| kill.moment));
        assert!(kills.iter().all(|kill| kill.moment < time && kill.worker < WORKERS));
        assert!((0..WORKERS).all(|worker| kills.iter().filter(|kill| kill.worker == worker).count() > 80));
        assert!((200..300).contains(&kills.iter().filter(|kill| kill.moment < time / 2).count()));
        assert_eq!(kills, chosen(1, 0, 500, time));
        assert_ne!(kills, chosen(1, 1, 500, time));
        assert_ne!(kills, chosen(2, 0, 500, time));
    }

    #[test]
    fn processes_over_their_limit_are_counted_where_all_are_known() {
        assert_eq!(over(&[Some(3), Some(5), Some(4)], Some(4)), Some(1));
        assert_eq!(over(&[Some(3), None], Some(4)), None);
        assert_eq!(over(&[Some(3)], None), None);
        assert_eq!(over(&[], Some(4)), Some(0));
    }
}
