//! `job.json`: what a job builds of what, and into how many tasks its stages are cut. It never changes once it is there.

use super::super::memory::OUTPUT_PARTICLE;
use super::super::survey::BLOCK;
use super::super::{BuildError, BuildOptions};
use super::run::RunSettings;
use crate::import::LoadOptions;
use crate::model::FamilyName;
use crate::store::StoreError;
use crate::store::temporary::Temporary;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The file's name in the job's folder.
pub(super) const FILE: &str = "job.json";
/// What it says that it is.
const FORMAT: &str = "deepfield job";
/// What is written and read.
const VERSION: u32 = 2;
/// A job file is not longer.
const LONGEST: u64 = 1 << 26;

/// What a job is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Plan {
    /// A page file of one source.
    Snapshot(Settings),
    /// A run file of several.
    Run(RunSettings),
}

impl Plan {
    /// The file that is built.
    pub fn output(&self) -> &Path {
        match self {
            Plan::Snapshot(own) => &own.output,
            Plan::Run(own) => &own.output,
        }
    }

    /// How it is built.
    pub fn options(&self) -> &BuildOptions {
        match self {
            Plan::Snapshot(own) => &own.options,
            Plan::Run(own) => &own.options,
        }
    }

    /// Particles of all sources.
    pub fn particles(&self) -> u64 {
        match self {
            Plan::Snapshot(own) => own.particles(),
            Plan::Run(own) => own.particles(),
        }
    }

    /// Bytes that the job's folder takes, about.
    pub fn temporary_bytes(&self) -> u64 {
        match self {
            Plan::Snapshot(own) => own.temporary_bytes,
            Plan::Run(own) => own.temporary_bytes(),
        }
    }

    /// Bytes of the output, about.
    pub fn output_bytes(&self) -> u64 {
        match self {
            Plan::Snapshot(own) => OUTPUT_PARTICLE * own.particles(),
            Plan::Run(own) => own.output_bytes(),
        }
    }

    /// Name and number of tasks of each stage, each of which comes after the one before.
    pub fn stages(&self) -> Vec<(&'static str, u32)> {
        match self {
            Plan::Snapshot(own) => own.stages(),
            Plan::Run(own) => own.stages(),
        }
    }

    /// Whether numbers of tasks are such as are planned.
    pub fn check(&self, folder: &Path) -> Result<(), BuildError> {
        match self {
            Plan::Snapshot(own) => own.check(folder),
            Plan::Run(own) => own.check(folder),
        }
    }
}

/// What is built of one source, and how finely that is cut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Settings {
    /// The source as it was named, which the output tells, and where it is.
    pub named: PathBuf,
    pub source: PathBuf,
    /// Its length, by which it is recognised.
    pub source_bytes: u64,
    pub output: PathBuf,
    pub load: LoadOptions,
    pub options: BuildOptions,
    pub families: Vec<FamilyTasks>,
    /// Tasks that train quantisers, all families together, and that code.
    pub train: u32,
    pub code: u32,
    /// Tasks that write pages.
    pub write: u32,
    /// Bytes that the job takes beside its output, about.
    pub temporary_bytes: u64,
}

/// Into how many tasks the work on a family is cut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FamilyTasks {
    pub name: FamilyName,
    pub particles: u64,
    /// Chunks that it is read in.
    pub chunks: usize,
    /// Tasks that read it.
    pub input: u32,
    /// Tasks that have some of its buckets each.
    pub groups: u32,
}

impl FamilyTasks {
    /// The chunks that a task reads: whole blocks of a survey where there are enough.
    pub fn input(&self, task: u32) -> Range<usize> {
        let unit = if self.chunks / BLOCK >= self.input as usize { BLOCK } else { 1 };
        let units = shares(self.chunks.div_ceil(unit), self.input, task);
        (units.start * unit).min(self.chunks)..(units.end * unit).min(self.chunks)
    }
}

/// What the task `task` of `tasks` has of so many things.
pub(super) fn shares(things: usize, tasks: u32, task: u32) -> Range<usize> {
    let start = |task: u32| (things as u128 * u128::from(task) / u128::from(tasks.max(1))) as usize;
    start(task)..start(task + 1)
}

/// The task of `tasks` that has one of so many things.
pub(super) fn sharer(thing: usize, things: usize, tasks: u32) -> u32 {
    (((thing as u128 + 1) * u128::from(tasks)).saturating_sub(1) / (things as u128).max(1)) as u32
}

/// The file as it is written.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u32,
    /// What tells the job from all others.
    id: u64,
    /// CRC-32C of number and plan, as they are written without spaces.
    check: u32,
    plan: Plan,
}

impl File {
    /// The checksum of what the file says.
    fn sum(&self, path: &Path) -> Result<u32, BuildError> {
        Ok(crc32c::crc32c_append(crc32c::crc32c(&self.id.to_le_bytes()), text(&self.plan, path)?.as_bytes()))
    }
}

fn text(plan: &Plan, path: &Path) -> Result<String, BuildError> {
    serde_json::to_string(plan).map_err(|error| unsound(path, &format!("plan: {error}")))
}

fn unsound(path: &Path, what: &str) -> BuildError {
    BuildError::Job { path: path.to_owned(), what: what.to_owned() }
}

fn check_length(path: &Path, bytes: u64) -> Result<(), BuildError> {
    match bytes <= LONGEST {
        true => Ok(()),
        false => Err(unsound(path, &format!("length: found {bytes} bytes, expected at most {LONGEST}"))),
    }
}

/// Reads the file of a job; gives what tells it from others, too.
///
/// # Errors
/// Where there is none, or it is damaged.
pub(super) fn read(folder: &Path) -> Result<(u64, Plan), BuildError> {
    let path = folder.join(FILE);
    let io = |source| BuildError::from(StoreError::Io { path: path.clone(), action: "read", source });
    let bytes = std::fs::metadata(&path).map_err(io)?.len();
    check_length(&path, bytes)?;
    let bytes = std::fs::read(&path).map_err(io)?;
    let file: File = serde_json::from_slice(&bytes).map_err(|error| unsound(&path, &error.to_string()))?;
    if (file.format.as_str(), file.version) != (FORMAT, VERSION) {
        let found = format!("{:?} of version {}", file.format, file.version);
        return Err(unsound(&path, &format!("format: found {found}, expected {FORMAT:?} of version {VERSION}")));
    }
    if file.sum(&path)? != file.check {
        return Err(unsound(&path, "check: found another checksum than that of id and plan, expected the same"));
    }
    Ok((file.id, file.plan))
}

/// Whether a folder has another job by now, whose files may have the same names as those of this one.
pub(super) fn is_of_other(folder: &Path, id: u64) -> bool {
    read(folder).is_ok_and(|(found, _)| found != id)
}

/// Writes the file of a job; gives what tells it from others.
///
/// # Errors
/// When the folder takes no files.
pub(super) fn write(folder: &Path, plan: &Plan) -> Result<u64, BuildError> {
    let path = folder.join(FILE);
    let io = |source| BuildError::from(StoreError::Io { path: path.clone(), action: "write", source });
    // The same job in another folder is another one: what it has beside the output is its own. So is the one that is planned again after this one
    // was removed: tasks of this one may still run.
    let place = folder.canonicalize().map_err(io)?;
    let begun = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
    let own = crc32c::crc32c(text(plan, &path)?.as_bytes());
    let here = crc32c::crc32c_append(crc32c::crc32c(place.as_os_str().as_encoded_bytes()), &begun.to_le_bytes());
    let id = u64::from(own) << 32 | u64::from(crc32c::crc32c_append(here, &std::process::id().to_le_bytes()));
    let mut file = File { format: FORMAT.into(), version: VERSION, id, check: 0, plan: plan.clone() };
    file.check = file.sum(&path)?;
    let mut bytes = serde_json::to_vec_pretty(&file).map_err(|error| unsound(&path, &error.to_string()))?;
    bytes.push(b'\n');
    check_length(&path, bytes.len() as u64)?;
    let temporary = Temporary::create(&path, None).map_err(io)?;
    temporary.file().write_all(&bytes).map_err(io)?;
    temporary.persist(&path).map_err(io)?;
    Ok(id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever a task has is its own.
        #[test]
        fn things_are_those_of_one_task(things in 1..5000_usize, tasks in 1..300_u32) {
            let mut all = 0;
            for task in 0..tasks {
                let own = shares(things, tasks, task);
                prop_assert_eq!(own.start, all);
                prop_assert!(own.clone().all(|thing| sharer(thing, things, tasks) == task));
                all = own.end;
            }
            prop_assert_eq!(all, things);
        }

        /// Every chunk is read by one task, in order; and by whole blocks where there are enough of them.
        #[test]
        fn tasks_read_all_chunks_once(chunks in 1..10_000_usize, input in 1..50_u32) {
            let input = input.min(chunks as u32);
            let family = FamilyTasks { name: FamilyName::Gas, particles: 1, chunks, input, groups: 1 };
            let ranges: Vec<_> = (0..input).map(|task| family.input(task)).collect();
            prop_assert!(ranges.iter().cloned().flatten().eq(0..chunks));
            prop_assert!(chunks / BLOCK < input as usize || ranges.iter().all(|range| range.start % BLOCK == 0));
        }
    }
}
