//! What the tasks of each stage do.

mod books;
mod codes;
mod division;
mod drawn;
mod output;
mod pages;
mod particles;
mod reading;
mod tables;
mod trees;
mod verify;

use super::super::coding::{Book, CodedBatches, Entry, Gathering, Group, Part, Shared};
use super::super::derive::Deriving;
use super::super::estimates::Estimating;
use super::super::family::Outline;
use super::super::found::{self, Finding, Seen, added};
use super::super::memory::{Memory, default_memory};
use super::super::partition::{Partition, Shares, histograms};
use super::super::reach::Surroundings;
use super::super::spill::{Blob, Spill};
use super::super::survey::Survey;
use super::super::tree::{Built, Checked, Draft, Grower, NodeSections, check_built, most_in_nodes, scope};
use super::super::{BuildError, BuildOptions, metadata, streams_of};
use super::parts::Parts;
use super::settings::{FamilyTasks, Settings, sharer, shares};
use super::{Job, job_error};
use crate::codec::quantize::{Coded, Draft as DraftBook, Sums, Trained};
use crate::codec::{QuantityError, Scaling};
use crate::hierarchy::attribute_info::check_counts;
use crate::hierarchy::octree::{Columns, Context};
use crate::hierarchy::{Histogram, LevelInfo, Purpose};
use crate::import::{ImportError, LeftOut, Source, Streams, open_with};
use crate::model::portable::{Portable, expect, expect_that, expect_within, portable, total};
use crate::model::positioned::{read_exact_at, write_all_at};
use crate::model::{Dataset, ParticleStream, Progress};
use crate::store::layout::{ALIGNMENT, MAGIC, PageEntry, StoredNode, align_up};
use crate::store::paging::{EncodedPage, TOO_LONG};
use crate::store::writer::{about, ends, is_about};
use crate::store::{FamilyMetadata, NodeRef, PageId, StoreError};
use books::{CodedBook, books_by_task, largest_book};
use division::{balanced, runs, units};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How names of files begin that hold what a task's memory does not.
pub(super) const SPILL: &str = "spill";

/// A task at work.
pub(super) struct Task<'a> {
    job: &'a Job,
    settings: &'a Settings,
    options: &'a BuildOptions,
    parts: Arc<Parts>,
    progress: &'a dyn Progress,
}

/// What is known of a family once its columns are complete.
struct Scaled {
    outline: Outline,
    scaling: Scaling,
    /// What stands for missing values of derived attributes.
    means: Vec<f32>,
    /// What is to be told of replaced densities.
    note: Option<String>,
}

portable!(Scaled { outline, scaling, means, note });

/// What was built of the buckets of a group; and counts of estimated columns and derived ones.
struct Grown {
    built: Vec<Built>,
    estimated: Vec<Vec<u64>>,
    derived: Vec<Vec<u64>>,
}

portable!(Grown { built, estimated, derived });

/// What has been joined of a family: its trees, and counts of all that was found for it.
#[derive(Default)]
struct JoinedFamily {
    trees: Vec<Joined>,
    estimated: Vec<Vec<u64>>,
    derived: Vec<Vec<u64>>,
}

portable!(JoinedFamily { trees, estimated, derived });

/// A tree that is to be coded: where the nodes are that were whole with each group of buckets, what its depths have, and what shares a codebook.
struct Joined {
    drafts: Vec<Blob>,
    levels: Vec<LevelInfo>,
    books: Vec<Book>,
}

portable!(Joined { drafts, levels, books });

/// What is coded by itself: a part of what shares a codebook.
struct Unit<'a> {
    /// Among those of its task.
    place: usize,
    /// The number of its codebook.
    book: usize,
    group: &'a Group<'a>,
    part: Range<usize>,
    scaling: &'a Scaling,
    /// Where it is put away.
    spill: &'a Spill,
}

/// The pages of all families: where those of each task are, and how many; where they end, and what of the footer follows their table.
struct Pages {
    tasks: Vec<(Blob, u64)>,
    /// The entry of each code, by codebook and family.
    numbers: Blob,
    end: u64,
    version: u32,
    about: Vec<u8>,
}

portable!(Pages { tasks, numbers, end, version, about });

impl Pages {
    /// Those of all tasks.
    fn count(&self) -> u64 {
        total(self.tasks.iter().map(|(_, pages)| *pages))
    }
}

/// The pages that a task writes, in order, and where their nodes are.
struct OwnPages {
    pages: Vec<PageHead>,
    nodes: Vec<Blob>,
}

portable!(OwnPages { pages, nodes });

/// A page that is to be written, without its nodes, of which there are so many.
#[derive(Clone, Copy)]
struct PageHead {
    id: PageId,
    family: u32,
    offset: u64,
    nodes: u32,
}

portable!(PageHead { id, family, offset, nodes });

/// A node that is to be written, at its place.
type PlacedNode = (NodeRef, (StoredNode, NodeSections));

/// A page that is to be written.
struct Page {
    head: PageHead,
    nodes: Vec<(StoredNode, NodeSections)>,
}

/// The index of a task that has read chunks of a family.
type Surveyed = (Vec<(usize, Survey)>, LeftOut);

/// The index of the task that plans: what was seen of each family, with where its sampled columns are; what is left out; and the checksum of
/// what each task has read of the source.
type Planned = (Vec<Option<(Outline, Blob)>>, (LeftOut, Vec<u64>));

/// The index of a task that has sorted chunks of a family by bucket: where the counts of the columns are, and then the [`Shares`] of each group
/// of buckets.
type Sorted = Vec<Blob>;

/// The index of a task that has found columns for the buckets of a group.
type Found = Vec<(Seen, Option<Blob>)>;

/// Where codes of a batch are, and their number.
type Codes = (Blob, usize);

/// The indices of tasks that code, by unit: where its codes are, and where what their particles have together is, or how often each refined one
/// is; in the end where its batches are, and sum and maximum of each quantity's errors.
type CodedUnits = Vec<(usize, (Blob, Blob))>;
type SettledUnits = Vec<(usize, SettledUnit)>;
type SettledUnit = (Blob, Vec<QuantityError>);

impl<'a> Task<'a> {
    /// Task `number` of a job.
    ///
    /// # Errors
    /// When the job's folder takes no files.
    pub fn new(
        job: &'a Job,
        settings: &'a Settings,
        number: u32,
        options: &'a BuildOptions,
        progress: &'a dyn Progress,
    ) -> Result<Task<'a>, BuildError> {
        Ok(Task { job, settings, options, parts: Arc::new(Parts::of_task(job.names(), number)?), progress })
    }

    /// Does what a task of a stage is to do.
    ///
    /// # Errors
    /// Where the result of another is missing or damaged, or something cannot be read or written.
    pub fn run(self, stage: &str, task: u32) -> Result<(), BuildError> {
        match stage {
            "survey" => self.survey(task),
            "plan" => self.plan(),
            "partition" => self.partition(task),
            "neighbours" => self.neighbours(task),
            "motion" => self.motion(task),
            "scale" => self.scale(),
            "grow" => self.grow(task),
            "join" => self.join(),
            "quantize" => self.quantize(task),
            "train" => self.train(task),
            "code" => self.code(task),
            "draft" => self.draft(),
            "refine" => self.refine(task),
            "lines" => self.lines(),
            "settle" => self.settle(task),
            "pages" => self.pages(),
            "write" => self.write(task),
            _ => self.finish(),
        }
    }

    /// Opens the source, which must be the one that was planned for.
    fn source(&self) -> Result<Box<dyn Source>, BuildError> {
        let settings = self.settings;
        let source = open_with(&settings.source, self.options.read)?;
        match source.description().bytes == settings.source_bytes {
            true => Ok(source),
            false => Err(self.changed(&format!("{} bytes", source.description().bytes))),
        }
    }

    /// The families of the source, which must be those that were planned for.
    fn streams<'s>(&self, source: &'s dyn Source) -> Result<Streams<'s>, BuildError> {
        let (streams, _) = streams_of(source, &self.settings.load, self.options)?;
        let own = streams.families.iter().map(|stream| (stream.family(), stream.particles(), stream.chunks()));
        let planned = self.settings.families.iter().map(|own| (own.name, own.particles, own.chunks));
        if own.eq(planned) { Ok(streams) } else { Err(self.changed("other families or numbers of particles")) }
    }

    fn changed(&self, found: &str) -> BuildError {
        job_error(
            &self.settings.source,
            &format!("found {found}, expected the source as it was when the job was planned"),
        )
    }

    fn unsound(&self, found: &str) -> BuildError {
        job_error(self.parts.folder(), &format!("found {found}, expected results of one job"))
    }

    /// What a task may take that looks after a family, beside bytes that it holds whatever that is.
    fn memory(&self, outline: &Outline, held: u64) -> Memory {
        Memory::of_task(self.allowed(), self.parts.folder(), outline.most_columns(), held)
    }

    /// Bytes that are left to the task beside those that it cannot do without.
    ///
    /// # Errors
    /// When these are more than the task may take; `what` needs them.
    fn left_beside(&self, held: u64, what: &str) -> Result<u64, BuildError> {
        Memory::left(self.allowed(), held, (what, self.job.output()))
    }

    /// Bytes by which each of these tasks of a stage tells of what it has done, if it is done.
    fn told_by(&self, stage: &str, tasks: Range<u32>) -> Vec<u64> {
        let names = self.job.names();
        let header = |task: u32| names.done(self.job.number(stage, task).ok()?);
        tasks.filter_map(header).map(|header| header.index_bytes()).collect()
    }

    /// Bytes that the task may take.
    fn allowed(&self) -> u64 {
        self.options.memory.unwrap_or_else(default_memory)
    }

    /// Where blobs are, and where the task puts its own.
    fn spill(&self) -> Spill {
        Spill::of_parts(Arc::clone(&self.parts))
    }

    /// The value that is in a blob.
    fn portable<T: Portable>(&self, spill: &Spill, blob: &Blob) -> Result<T, BuildError> {
        self.checked_value(spill, blob, |_| Ok(()))
    }

    /// The index of a task.
    fn index<T: Portable>(&self, stage: &str, task: u32) -> Result<T, BuildError> {
        self.parts.index(self.job.number(stage, task)?)
    }

    /// Ends the task's file.
    fn hand_on(self, index: &impl Portable, source_bytes: u64, written: u64) -> Result<(), BuildError> {
        let folder = self.parts.folder().to_owned();
        let parts = Arc::into_inner(self.parts);
        parts.ok_or_else(|| job_error(&folder, "a task's file is still in use"))?.finish(index, source_bytes, written)
    }
}

fn io_error(path: &Path, action: &'static str, source: io::Error) -> BuildError {
    StoreError::Io { path: PathBuf::from(path), action, source }.into()
}
