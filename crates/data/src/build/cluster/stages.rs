//! What the tasks of each stage do.

use super::super::coding::{CodedBatches, Coding, Group, Measured, Part, Shared, shared};
use super::super::family::{self, Outline};
use super::super::found::{self, Seen, added};
use super::super::memory::{Memory, default_memory};
use super::super::partition::{Partition, Share, histograms};
use super::super::spill::{Blob, Spill};
use super::super::survey::Survey;
use super::super::tree::{Books, Built, CodedTrees, Draft, Grower, NodeSections, scope};
use super::super::{BuildError, BuildOptions, metadata, streams_of};
use super::parts::Parts;
use super::settings::{FamilyTasks, shares};
use super::{Job, job_error};
use crate::codec::Scaling;
use crate::codec::quantize::{Draft as DraftBook, SettledPart, Sums, Trained};
use crate::hierarchy::octree::{Columns, Context};
use crate::hierarchy::{Histogram, Purpose};
use crate::import::{ImportError, LeftOut, Source, Streams, open_with};
use crate::model::portable::{Portable, portable};
use crate::model::positioned::{read_exact_at, write_all_at};
use crate::model::{Dataset, Kernel, ParticleStream, Progress};
use crate::store::layout::{ALIGNMENT, MAGIC, PageEntry, StoredNode, align_up};
use crate::store::paging::{EncodedPage, TOO_LONG};
use crate::store::writer::{about, ends};
use crate::store::{FamilyMetadata, PageId, StoreError};
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

/// A tree that is to be coded: where its nodes are, and what shares a codebook.
struct Joined {
    draft: Blob,
    books: Vec<Book>,
}

portable!(Joined { draft, books });

/// What shares a codebook: where it is, and the parts that can be coded by themselves.
struct Book {
    shared: Blob,
    parts: Vec<Part>,
}

portable!(Book { shared, parts });

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

/// The pages of all families: where those of each task are, where they end, and what of the footer follows their table.
struct Pages {
    tasks: Vec<Blob>,
    /// The entry of each code, by codebook and family.
    numbers: Blob,
    end: u64,
    version: u32,
    about: Vec<u8>,
    /// Those of the tables that are written behind all.
    pages: u64,
}

portable!(Pages { tasks, numbers, end, version, about, pages });

/// A page that is to be written.
struct Page {
    id: PageId,
    family: u32,
    offset: u64,
    nodes: Vec<(StoredNode, NodeSections)>,
}

portable!(Page { id, family, offset, nodes });

/// The index of a task that has read chunks of a family.
type Surveyed = (Vec<(usize, Survey)>, LeftOut);

/// The index of a task that has sorted chunks of a family by bucket: what each bucket has, and counts of the columns.
type Sorted = (Vec<Share>, Vec<Vec<u64>>);

/// The index of a task that has found columns for the buckets of a group.
type Found = Vec<(Seen, Option<Blob>)>;

/// Where codes of a batch are, and their number.
type Codes = (Blob, usize);

/// The indices of tasks that code, by unit: where its codes are, what their particles have together, or how often each refined one is.
type CodedUnits = Vec<(usize, (Blob, Sums))>;
type RefinedUnits = Vec<(usize, (Blob, Vec<u64>))>;
type SettledUnits = Vec<(usize, SettledPart<Codes>)>;

impl<'a> Task<'a> {
    /// Task `number` of a job.
    ///
    /// # Errors
    /// When the job's folder takes no files.
    pub fn new(
        job: &'a Job,
        number: u32,
        options: &'a BuildOptions,
        progress: &'a dyn Progress,
    ) -> Result<Task<'a>, BuildError> {
        Ok(Task { job, options, parts: Arc::new(Parts::of_task(job.names(), number)?), progress })
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

    fn survey(self, task: u32) -> Result<(), BuildError> {
        let (number, own, input) = self.job.input(task);
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let (stream, chunks) = (&streams.families[number], own.input(input));
        let parts = Survey::parts(stream, &self.options.octree, chunks.clone(), self.progress)?;
        let bytes = self.job.source_bytes(own, &chunks);
        let surveyed: Surveyed = (parts, stream.left_out());
        self.hand_on(&surveyed, bytes, 0)
    }

    fn plan(self) -> Result<(), BuildError> {
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let mut left_out = Vec::new();
        let mut outlines: Vec<Option<Outline>> = Vec::new();
        for (stream, tasks) in streams.families.iter().zip(self.job.inputs()) {
            let mut parts = Vec::with_capacity(tasks.len());
            for task in tasks {
                let (part, left): Surveyed = self.index("survey", task)?;
                parts.push(part);
                left_out.push(left);
            }
            let survey = Survey::joined(stream, &self.options.octree, parts);
            outlines.push(Outline::of(survey, stream, &self.options.octree, self.job.output())?);
        }
        if outlines.iter().all(Option::is_none) {
            let field = "particles that can be drawn".into();
            return Err(ImportError::NoParticles { path: self.job.settings.named.clone(), field }.into());
        }
        self.hand_on(&(outlines, LeftOut::sum(left_out)), 0, 0)
    }

    /// What was seen of each family.
    fn outlines(&self) -> Result<(Vec<Option<Outline>>, LeftOut), BuildError> {
        self.index("plan", 0)
    }

    /// What was seen of one family; `None` if it has no particle.
    fn outline(&self, family: usize) -> Result<Option<Outline>, BuildError> {
        Ok(self.outlines()?.0.into_iter().nth(family).flatten())
    }

    fn partition(self, task: u32) -> Result<(), BuildError> {
        let (number, own, input) = self.job.input(task);
        let Some(outline) = self.outline(number)? else { return self.hand_on(&Sorted::default(), 0, 0) };
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let chunks = own.input(input);
        let particles = (own.particles as f64 * chunks.len() as f64 / own.chunks.max(1) as f64) as u64;
        let memory = self.memory(&outline, particles);
        let folder = self.parts.folder();
        let spill = Spill::new(&folder.join(format!("{SPILL}.{task}")), folder, memory.particles, self.options.read);
        let (partition, counts) = Partition::of_chunks(
            &streams.families[number],
            chunks.clone(),
            &outline.survey.ranges,
            &outline.plan,
            outline.root,
            outline.has_neighbours(),
            spill,
            self.progress,
        )?;
        let sorted: Sorted = (partition.hand_on(&self.spill())?, counts);
        let bytes = self.job.source_bytes(own, &chunks);
        self.hand_on(&sorted, bytes, 0)
    }

    /// The particles of all buckets of a family, with what was found for them in the stages of these names.
    fn particles(&self, family: usize, outline: &Outline, stages: &[&str]) -> Result<Partition, BuildError> {
        let mut blocks = Vec::new();
        for task in self.job.inputs().nth(family).into_iter().flatten() {
            let (shares, _): Sorted = self.index("partition", task)?;
            blocks.push(shares);
        }
        let mut partition = Partition::handed_on(self.spill(), (outline.own, outline.columns), blocks);
        for stage in stages {
            for (bucket, (_, blob)) in self.found(stage, family)?.into_iter().enumerate() {
                let found = if *stage == "motion" { [None, blob] } else { [blob, None] };
                partition.found(bucket, found);
            }
        }
        Ok(partition)
    }

    /// What was found for the buckets of a family, in their order.
    fn found(&self, stage: &str, family: usize) -> Result<Found, BuildError> {
        let mut all = Found::new();
        for task in self.job.groups().nth(family).into_iter().flatten() {
            all.extend(self.index::<Found>(stage, task)?);
        }
        Ok(all)
    }

    fn neighbours(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.job.group(task);
        let outline = self.outline(number)?;
        let estimating = outline.as_ref().and_then(Outline::estimating);
        let Some((outline, estimating)) = outline.zip(estimating) else { return self.hand_on(&Found::new(), 0, 0) };
        let mut partition = self.particles(number, &outline, &[])?;
        let buckets = shares(outline.plan.len(), own.groups, group);
        let block = self.memory(&outline, 0).neighbour_block();
        let seen = estimating.of_buckets(&mut partition, buckets.clone(), block, self.progress)?;
        let of_bucket = |(bucket, seen)| {
            let [estimates, _] = partition.take_found(bucket);
            (seen, estimates)
        };
        let found: Found = buckets.zip(seen).map(of_bucket).collect();
        drop(partition);
        self.hand_on(&found, 0, 0)
    }

    fn motion(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.job.group(task);
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let derivation = streams.families[number].derivation();
        let Some((outline, derivation)) = self.outline(number)?.zip(derivation) else {
            return self.hand_on(&Found::new(), 0, 0);
        };
        let mut partition = self.particles(number, &outline, &["neighbours"])?;
        let buckets = shares(outline.plan.len(), own.groups, group);
        let block = self.memory(&outline, 0).motion_block();
        let deriving = outline.deriving(derivation, streams.about.kernel);
        let seen = deriving.of_buckets(&mut partition, buckets.clone(), block, self.progress)?;
        let of_bucket = |(bucket, seen)| {
            let [_, derived] = partition.take_found(bucket);
            (seen, derived)
        };
        let found: Found = buckets.zip(seen).map(of_bucket).collect();
        drop(partition);
        self.hand_on(&found, 0, 0)
    }

    fn scale(self) -> Result<(), BuildError> {
        let mut scaled: Vec<Option<Scaled>> = Vec::new();
        for (family, outline) in self.outlines()?.0.into_iter().enumerate() {
            let Some(mut outline) = outline else {
                scaled.push(None);
                continue;
            };
            let note = outline.note();
            let mut means = Vec::new();
            let seen = |stage| Ok::<_, BuildError>(self.found(stage, family)?.into_iter().map(|(seen, _)| seen));
            if outline.estimating().is_some() {
                outline.survey.estimated(found::sum(seen("neighbours")?, 2));
            }
            if outline.derived_columns() > 0 {
                let found = found::sum(seen("motion")?, outline.derived_columns());
                means = found.means();
                outline.derived(found);
            }
            let scaling = outline.scaling();
            outline.survey.forget_samples();
            scaled.push(Some(Scaled { outline, scaling, means, note }));
        }
        self.hand_on(&scaled, 0, 0)
    }

    /// What is known of each family once its columns are complete.
    fn scaled(&self) -> Result<Vec<Option<Scaled>>, BuildError> {
        self.index("scale", 0)
    }

    fn grow(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.job.group(task);
        let Some(scaled) = self.scaled()?.into_iter().nth(number).flatten() else {
            return self.hand_on(&Grown { built: Vec::new(), estimated: Vec::new(), derived: Vec::new() }, 0, 0);
        };
        let Scaled { outline, scaling, means, .. } = scaled;
        let (has_estimates, derived) = (outline.estimating().is_some(), outline.derived_columns());
        let stages = [has_estimates.then_some("neighbours"), (derived > 0).then_some("motion")];
        let stages: Vec<&str> = stages.into_iter().flatten().collect();
        let mut partition = self.particles(number, &outline, &stages)?;
        partition.derived(means);
        let buckets = shares(outline.plan.len(), own.groups, group);
        let ranges = &outline.survey.ranges;
        let count = |ranges, columns: fn(Columns) -> Vec<Vec<f32>>| {
            found::counts(&partition, buckets.clone(), ranges, columns, self.progress)
        };
        let mut counts = [Vec::new(), Vec::new()];
        if has_estimates {
            counts[0] = count(&ranges[1..3], |columns| vec![columns.density, columns.smoothing_length])?;
        }
        if derived > 0 {
            counts[1] = count(&ranges[3..3 + derived], |columns| columns.attributes)?;
        }
        let largest = buckets.clone().map(|bucket| partition.len(bucket)).max().unwrap_or(0);
        let workers = self.memory(&outline, 0).workers(largest, self.job.output())?;
        let spill = self.spill();
        let built =
            self.grown(&outline, &scaling, &spill, |grower| grower.grow(&partition, buckets.clone(), workers))?;
        drop((partition, spill));
        let [estimated, derived] = counts;
        self.hand_on(&Grown { built, estimated, derived }, 0, 0)
    }

    /// Lets a family's trees be built.
    fn grown<R>(
        &self,
        outline: &Outline,
        scaling: &Scaling,
        spill: &Spill,
        work: impl FnOnce(&Grower<'_>) -> Result<R, BuildError>,
    ) -> Result<R, BuildError> {
        let (rules, octree) = (outline.rules(), outline.octree(&self.options.octree));
        let context = Context { root: outline.root, options: &octree, rules: &rules };
        let (family, plan) = (outline.name, &outline.plan);
        work(&Grower { context: &context, family, plan, scaling, spill, progress: self.progress })
    }

    fn join(self) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let bits = self.options.octree.code_bits();
        let mut all: Vec<JoinedFamily> = Vec::new();
        for ((scaled, tasks), own) in self.scaled()?.into_iter().zip(self.job.groups()).zip(&self.job.settings.families)
        {
            let Some(Scaled { outline, scaling, .. }) = scaled else {
                all.push(JoinedFamily::default());
                continue;
            };
            self.progress.begin(&format!("joining {}", own.name), 0);
            let mut built = Vec::with_capacity(outline.plan.len());
            let mut joined = JoinedFamily::default();
            for task in tasks {
                let group: Grown = self.index("grow", task)?;
                built.extend(group.built);
                joined.estimated = added(joined.estimated, group.estimated);
                joined.derived = added(joined.derived, group.derived);
            }
            let trees = self.grown(&outline, &scaling, &spill, |grower| grower.join(built))?;
            for (tree, kind) in trees.into_iter().zip(self.options.octree.levels()) {
                let (draft, batches) = Draft::of(tree, &spill, self.progress).map_err(temporary)?;
                let book = |own: &Shared| Ok(Book { parts: own.parts(), shared: spill.put(&[&own.bytes()])? });
                let books = shared(&draft.nodes, batches, bits, scope(*kind));
                let books = books.iter().map(book).collect::<io::Result<Vec<_>>>().map_err(temporary)?;
                joined.trees.push(Joined { draft: spill.put(&[&draft.bytes()]).map_err(temporary)?, books });
            }
            all.push(joined);
        }
        drop(spill);
        self.hand_on(&all, 0, 0)
    }

    /// What has been joined of each family.
    fn joined(&self) -> Result<Vec<JoinedFamily>, BuildError> {
        self.index("join", 0)
    }

    /// What shares a codebook, of all families, with the number of its family; codebooks are numbered in this order.
    fn books(&self) -> Result<Vec<(usize, Book)>, BuildError> {
        let families = self.joined()?.into_iter().enumerate();
        let books = families.flat_map(|(family, joined)| {
            joined.trees.into_iter().flat_map(|tree| tree.books).map(move |book| (family, book))
        });
        Ok(books.collect())
    }

    /// The units of a task, in order: the same ones in all stages that code.
    fn own_units(&self, books: &[(usize, Book)], task: u32) -> Vec<usize> {
        let particles = |(book, part): (usize, usize)| books[book].1.parts[part].particles;
        let particles: Vec<u64> = units(books).into_iter().map(particles).collect();
        balanced(&particles, self.job.settings.code).swap_remove(task as usize)
    }

    /// How the columns of a family are scaled that has codebooks.
    fn scaling<'s>(&self, scaled: &'s [Option<Scaled>], family: usize) -> Result<&'s Scaling, BuildError> {
        let scaled = scaled.get(family).and_then(Option::as_ref);
        scaled.map(|scaled| &scaled.scaling).ok_or_else(|| self.unsound("codebooks of a family without particles"))
    }

    fn train(self, task: u32) -> Result<(), BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let spill = self.spill();
        let bits = self.options.octree.code_bits();
        let particles = |(_, book): &(usize, Book)| book.parts.iter().map(|part| part.particles).sum();
        let particles: Vec<u64> = books.iter().map(particles).collect();
        let own = balanced(&particles, self.job.settings.train).swap_remove(task as usize);
        self.progress.begin("training", own.len() as u64);
        let train = |number: usize| {
            let (family, book) = &books[number];
            let shared: Shared = self.portable(&spill, &book.shared)?;
            let group = shared.group(&spill, bits, self.progress);
            let trained = shared.train(self.scaling(&scaled, *family)?, &group, bits);
            self.progress.advance(1);
            let put = |trained: Trained| spill.put(&[&trained.bytes()]);
            Ok((number, trained.and_then(put).map_err(|error| BuildError::temporary(&spill, error))?))
        };
        let trained = own.into_iter().map(train).collect::<Result<Vec<(usize, Blob)>, BuildError>>()?;
        drop(spill);
        self.hand_on(&trained, 0, 0)
    }

    /// Where trained quantisers are, by codebook.
    fn trained(&self) -> Result<Vec<Blob>, BuildError> {
        let mut all: Vec<(usize, Blob)> = Vec::new();
        for task in 0..self.job.settings.train {
            all.extend(self.index::<Vec<(usize, Blob)>>("train", task)?);
        }
        all.sort_by_key(|(number, _)| *number);
        Ok(all.into_iter().map(|(_, trained)| trained).collect())
    }

    /// Does something to each of a task's units, as many at a time as there are threads.
    fn with_units<R: Send>(
        &self,
        task: u32,
        spill: &Spill,
        work: impl Fn(Unit<'_>) -> Result<R, BuildError> + Sync,
    ) -> Result<Vec<(usize, R)>, BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let units = units(&books);
        let own = self.own_units(&books, task);
        self.progress.begin("coding", own.len() as u64);
        let bits = self.options.octree.code_bits();
        let mut done = Vec::with_capacity(own.len());
        // Batches of one codebook at a time.
        for own in own.chunk_by(|a, b| units[*a].0 == units[*b].0) {
            let number = units[own[0]].0;
            let (family, book) = &books[number];
            let shared: Shared = self.portable(spill, &book.shared)?;
            let (before, scaling) = (done.len(), self.scaling(&scaled, *family)?);
            let one = |(i, &unit): (usize, &usize)| {
                let part = book.parts[units[unit].1].batches.clone();
                let lane = spill.lane(unit);
                let group = shared.group(&lane, bits, self.progress);
                let unit_of = Unit { place: before + i, book: number, group: &group, part, scaling, spill: &lane };
                let worked = work(unit_of)?;
                lane.close().map_err(|error| BuildError::temporary(spill, error))?;
                self.progress.advance(1);
                Ok((unit, worked))
            };
            done.extend(own.par_iter().enumerate().with_max_len(1).map(one).collect::<Result<Vec<_>, BuildError>>()?);
        }
        Ok(done)
    }

    fn code(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let trained: BTreeMap<usize, Trained> = self.of_own_books(task, &spill, &self.trained()?)?;
        let temporary = |error| BuildError::temporary(&spill, error);
        let coded: CodedUnits =
            self.with_units(task, &spill, |Unit { book, group, part, scaling, spill, .. }| {
                let trained = trained.get(&book).ok_or_else(|| self.unsound("fewer quantisers than codebooks"))?;
                let (kept, sums) = trained.code(group, part, scaling).map_err(temporary)?;
                Ok((spill.put(&[&kept.bytes()]).map_err(temporary)?, sums))
            })?;
        drop(spill);
        self.hand_on(&coded, 0, 0)
    }

    /// What the tasks of a stage hand on of each unit, by number of the unit.
    fn of_units<R: Portable>(&self, stage: &str) -> Result<Vec<R>, BuildError> {
        let mut all: Vec<(usize, R)> = Vec::new();
        for task in 0..self.job.settings.code {
            all.extend(self.index::<Vec<(usize, R)>>(stage, task)?);
        }
        all.sort_by_key(|(unit, _)| *unit);
        Ok(all.into_iter().map(|(_, value)| value).collect())
    }

    fn draft(self) -> Result<(), BuildError> {
        let (scaled, books, trained) = (self.scaled()?, self.books()?, self.trained()?);
        let mut sums = self.of_units::<(Blob, Sums)>("code")?.into_iter();
        let mut drafts = Vec::with_capacity(books.len());
        let spill = self.spill();
        for ((family, book), trained) in books.iter().zip(&trained) {
            let (scaling, trained): (_, Trained) = (self.scaling(&scaled, *family)?, self.portable(&spill, trained)?);
            let mut totals = trained.totals(scaling);
            book.parts.iter().zip(sums.by_ref()).for_each(|(part, (_, sums))| totals.add(part.group, sums));
            drafts.push(totals.draft(&trained, scaling));
        }
        drop(spill);
        self.hand_on_drafts(&drafts)
    }

    /// Hands on codebooks, each as a blob.
    fn hand_on_drafts(self, drafts: &[DraftBook]) -> Result<(), BuildError> {
        let spill = self.spill();
        let blobs = drafts.iter().map(|draft| spill.put(&[&draft.bytes()])).collect::<io::Result<Vec<Blob>>>();
        let blobs = blobs.map_err(|error| BuildError::temporary(&spill, error))?;
        drop(spill);
        self.hand_on(&blobs, 0, 0)
    }

    /// What there is of the codebooks that a task has units of, of which `blobs` has all.
    fn of_own_books<T: Portable>(
        &self,
        task: u32,
        spill: &Spill,
        blobs: &[Blob],
    ) -> Result<BTreeMap<usize, T>, BuildError> {
        let books = self.books()?;
        let units = units(&books);
        let mut numbers: Vec<usize> = self.own_units(&books, task).into_iter().map(|unit| units[unit].0).collect();
        numbers.dedup();
        let read = |number: usize| {
            let blob = blobs.get(number).ok_or_else(|| self.unsound("fewer codebooks than were planned"))?;
            Ok((number, self.portable(spill, blob)?))
        };
        numbers.into_iter().map(read).collect()
    }

    /// The codebook of a unit.
    fn draft_of<'d>(
        &self,
        drafts: &'d BTreeMap<usize, DraftBook>,
        unit: &Unit<'_>,
    ) -> Result<&'d DraftBook, BuildError> {
        drafts.get(&unit.book).ok_or_else(|| self.unsound("fewer codebooks than were trained"))
    }

    /// The codes of a unit, of which `kept` has the places of all of the task's.
    fn codes_of(&self, spill: &Spill, kept: &[Blob], unit: &Unit<'_>) -> Result<Vec<Codes>, BuildError> {
        self.portable(spill, kept.get(unit.place).ok_or_else(|| self.unsound("codes of other parts"))?)
    }

    fn refine(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let drafts = self.of_own_books(task, &spill, &self.index::<Vec<Blob>>("draft", 0)?)?;
        let coded: CodedUnits = self.index("code", task)?;
        let kept: Vec<Blob> = coded.into_iter().map(|(_, (kept, _))| kept).collect();
        let refined: RefinedUnits = self.with_units(task, &spill, |unit| {
            let (draft, mut codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            let mut counts = Vec::new();
            if draft.is_of_lines() {
                (codes, counts) = draft.refine(unit.group, unit.part, codes).map_err(temporary)?;
            }
            Ok((unit.spill.put(&[&codes.bytes()]).map_err(temporary)?, counts))
        })?;
        drop(spill);
        self.hand_on(&refined, 0, 0)
    }

    fn lines(self) -> Result<(), BuildError> {
        let (books, mut drafts) = (self.books()?, self.drafts("draft")?);
        let counts = self.of_units::<(Blob, Vec<u64>)>("refine")?;
        let mut counts = counts.iter().map(|(_, counts)| counts);
        for ((_, book), draft) in books.iter().zip(&mut drafts) {
            let own: Vec<&Vec<u64>> = counts.by_ref().take(book.parts.len()).collect();
            if draft.is_of_lines() {
                draft.conserve(own);
            }
        }
        self.hand_on_drafts(&drafts)
    }

    /// The codebooks of a stage, all of them.
    fn drafts(&self, stage: &str) -> Result<Vec<DraftBook>, BuildError> {
        let spill = self.spill();
        let blobs: Vec<Blob> = self.index(stage, 0)?;
        blobs.iter().map(|blob| self.portable(&spill, blob)).collect()
    }

    /// The stage that hands on codebooks as they will be stored, but for their errors.
    fn last_drafts(&self) -> &'static str {
        if self.is_refined() { "lines" } else { "draft" }
    }

    fn is_refined(&self) -> bool {
        self.options.octree.code_bits().is_refined()
    }

    fn settle(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let drafts = self.of_own_books(task, &spill, &self.index::<Vec<Blob>>(self.last_drafts(), 0)?)?;
        let kept: Vec<Blob> = match self.is_refined() {
            true => self.index::<RefinedUnits>("refine", task)?.into_iter().map(|(_, (kept, _))| kept).collect(),
            false => self.index::<CodedUnits>("code", task)?.into_iter().map(|(_, (kept, _))| kept).collect(),
        };
        let settled: SettledUnits = self.with_units(task, &spill, |unit| {
            let (draft, codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            draft.settle(unit.group, unit.part, codes, unit.scaling).map_err(temporary)
        })?;
        drop(spill);
        self.hand_on(&settled, 0, 0)
    }

    /// All that is coded, by codebook.
    fn quantized(&self) -> Result<Vec<CodedBatches>, BuildError> {
        let (books, drafts) = (self.books()?, self.drafts(self.last_drafts())?);
        let mut settled = self.of_units::<SettledPart<Codes>>("settle")?.into_iter();
        let of_book = |((_, book), draft): (&(usize, Book), DraftBook)| {
            let groups = book.parts.iter().map(|part| part.group);
            draft.finished(groups.zip(settled.by_ref()))
        };
        Ok(books.iter().zip(drafts).map(of_book).collect())
    }

    fn pages(self) -> Result<(), BuildError> {
        let source = self.source()?;
        let about_source = self.streams(source.as_ref())?.about;
        let kernel = about_source.kernel;
        let (scaled, joined) = (self.scaled()?, self.joined()?);
        let (outlines, left_out) = self.outlines()?;
        let mut batches = self.quantized()?.into_iter();
        let (mut families, mut notes, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
        // Each with its length, and as bytes.
        let mut pages: Vec<(u64, Vec<u8>)> = Vec::new();
        let mut end = ALIGNMENT;
        let known = scaled.into_iter().zip(outlines).zip(joined).enumerate();
        for (number, ((scaled, outline), joined)) in known {
            let Some((scaled, outline)) = scaled.zip(outline) else { continue };
            let JoinedFamily { trees, estimated, derived } = joined;
            let coded = self.coded(&scaled, trees, &mut batches, kernel)?;
            let others = family::others(&coded);
            let trees = family::trees(&coded, &others, self.options);
            let (trees, written) = trees.paged(pages.len() as u32, self.options.page_bytes);
            for tree in &trees {
                for page in 0..tree.len() {
                    let (id, nodes) = tree.page(page);
                    let mut bytes = Vec::new();
                    (id, (families.len() as u32, end)).put(&mut bytes);
                    let nodes: Vec<_> = nodes.collect();
                    nodes.len().put(&mut bytes);
                    for (node, (depth, index)) in nodes {
                        node.put(&mut bytes);
                        coded.places(tree.purpose, depth, index).put(&mut bytes);
                    }
                    let len = tree.page_bytes(page);
                    pages.push((len, bytes));
                    end = align_up(end + len, ALIGNMENT).unwrap_or(end + len);
                }
            }
            numbers.push(coded.books.numbers.clone());
            notes.extend(scaled.note.clone());
            let histograms = self.histograms(number, &outline, &scaled, estimated, derived)?;
            families.push(scaled.outline.metadata(&histograms, coded, written, self.options)?);
        }
        let about_source = Dataset { skipped: left_out.into_skipped(), ..about_source };
        let (version, about) = self.footer(about_source, families, notes, pages.len())?;
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let tasks = self.job.settings.write;
        let lengths: Vec<u64> = pages.iter().map(|(len, _)| *len).collect();
        let put = |range: Range<usize>| {
            let count = range.len().bytes();
            let mut bytes: Vec<&[u8]> = vec![&count];
            bytes.extend(pages[range].iter().map(|(_, page)| &page[..]));
            spill.put(&bytes)
        };
        let blobs: io::Result<Vec<Blob>> = runs(&lengths, tasks).into_iter().map(put).collect();
        let index = Pages {
            tasks: blobs.map_err(temporary)?,
            numbers: spill.put(&[&numbers.bytes()]).map_err(temporary)?,
            end,
            version,
            about,
            pages: pages.len() as u64,
        };
        drop(spill);
        self.hand_on(&index, 0, 0)
    }

    /// The coded trees of a family, of which `coded` has what shares each codebook, in order.
    fn coded(
        &self,
        scaled: &Scaled,
        joined: Vec<Joined>,
        coded: &mut impl Iterator<Item = CodedBatches>,
        kernel: Kernel,
    ) -> Result<CodedTrees, BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let bits = self.options.octree.code_bits();
        let mut books = Books::default();
        let (mut splats, mut volume) = (None, None);
        for (&kind, Joined { draft, books: shared }) in self.options.octree.levels().iter().zip(joined) {
            let draft: Draft = self.portable(&spill, &draft)?;
            let shared: Vec<Shared> =
                shared.iter().map(|book| self.portable(&spill, &book.shared)).collect::<Result<_, _>>()?;
            let own: Vec<CodedBatches> = coded.by_ref().take(shared.len()).collect();
            if own.len() != shared.len() {
                return Err(self.unsound("fewer codebooks than stage join has told"));
            }
            let mut coding = Coding::of(&draft.nodes);
            let leaves = shared.iter().take_while(|own| own.is_of_leaves()).count();
            if let (Purpose::Splats, Some(picture)) = (kind, scaled.outline.picture(kernel, bits)) {
                let positions = |depth: usize, index: usize| draft.positions(depth, index);
                let measured = Measured { picture: &picture, positions: &positions };
                let error = measured.error(&draft.nodes, &shared[..leaves], &own[..leaves], &spill, bits);
                coding.column_error = error.map_err(temporary)?;
            }
            shared.into_iter().zip(own).for_each(|(shared, own)| coding.take(shared, own, &spill));
            let tree = draft.coded(kind, coding, splats.as_ref(), bits, &mut books);
            match kind {
                Purpose::Splats => splats = Some(tree),
                Purpose::Samples | Purpose::Clusters => volume = Some(tree),
            }
        }
        match splats {
            Some(splats) => Ok(CodedTrees::new(spill, splats, volume, books)),
            None => Err(self.unsound("a family without a tree")),
        }
    }

    /// How often which values are in the columns of a family.
    fn histograms(
        &self,
        family: usize,
        outline: &Outline,
        scaled: &Scaled,
        estimated: Vec<Vec<u64>>,
        derived: Vec<Vec<u64>>,
    ) -> Result<Vec<Histogram>, BuildError> {
        let mut source: Vec<Vec<u64>> = Vec::new();
        for task in self.job.inputs().nth(family).into_iter().flatten() {
            let (_, counts): Sorted = self.index("partition", task)?;
            source = added(source, counts);
        }
        let ranges = &scaled.outline.survey.ranges;
        let mut all = histograms(&outline.survey.ranges, source);
        if outline.estimating().is_some() {
            all.splice(1..3, histograms(&ranges[1..3], estimated));
        }
        if outline.derived_columns() > 0 {
            all.truncate(3 + outline.own);
            all.splice(3..3, histograms(&ranges[3..3 + outline.derived_columns()], derived));
        }
        Ok(all)
    }

    /// The version of the output, and what follows the table of pages in its footer.
    fn footer(
        &self,
        mut source: Dataset,
        families: Vec<FamilyMetadata>,
        notes: Vec<String>,
        pages: usize,
    ) -> Result<(u32, Vec<u8>), BuildError> {
        let settings = &self.job.settings;
        if source.provenance.path == settings.source {
            source.provenance.path.clone_from(&settings.named);
        }
        Ok(about(&metadata(source, families, notes, self.options)?, pages))
    }

    fn write(self, task: u32) -> Result<(), BuildError> {
        let finish = self.job.names();
        if finish.done(finish.tasks() - 1).is_some() {
            // The file is gone to where it belongs; the task's own result has been taken.
            return self.hand_on(&Vec::<PageEntry>::new(), 0, 0);
        }
        let index: Pages = self.index("pages", 0)?;
        let spill = self.spill();
        let numbers: Vec<Vec<Vec<u16>>> = self.portable(&spill, &index.numbers)?;
        let blob = index.tasks.get(task as usize).ok_or_else(|| self.unsound("pages of fewer tasks"))?;
        let pages: Vec<Page> = self.portable(&spill, blob)?;
        self.progress.begin("writing pages", pages.len() as u64);
        let path = self.job.growing();
        let unwritable = |reason: &str| StoreError::Unwritable { path: path.clone(), reason: reason.into() };
        let file = open_growing(&path)?;
        let bits = self.options.octree.code_bits();
        let write = |page: &Page| -> Result<PageEntry, BuildError> {
            let numbers = &numbers[page.family as usize];
            let sections = |(node, places): &(StoredNode, NodeSections)| {
                Ok((node.clone(), places.read(node, numbers, bits, &spill)?))
            };
            let records = page.nodes.iter().map(sections).collect::<io::Result<Vec<_>>>();
            let records = records.map_err(|error| BuildError::temporary(&spill, error))?;
            let page_of = EncodedPage::new(page.id, page.family, &records).ok_or_else(|| unwritable(TOO_LONG))?;
            let EncodedPage { nodes, memory, bytes } = page_of;
            let memory =
                u32::try_from(memory).map_err(|_| unwritable("a page would take more than 4 GiB of memory"))?;
            let (len, crc) = (bytes.len() as u32, crc32c::crc32c(&bytes));
            // With the zeros behind it: something else may be there by now.
            let mut bytes = bytes;
            bytes.resize(bytes.len().next_multiple_of(ALIGNMENT as usize), 0);
            write_all_at(&file, &bytes, page.offset).map_err(|source| io_error(&path, "write", source))?;
            self.progress.advance(1);
            Ok(PageEntry { offset: page.offset, len, nodes, family: page.family, crc, memory })
        };
        let entries = pages.par_iter().with_max_len(1).map(write).collect::<Result<Vec<PageEntry>, _>>()?;
        let written = entries.iter().map(|entry| u64::from(entry.len)).sum();
        drop(spill);
        self.hand_on(&entries, 0, written)
    }

    fn finish(self) -> Result<(), BuildError> {
        let Pages { end, version, about, pages, .. } = self.index("pages", 0)?;
        let tasks = self.job.settings.write;
        let mut table: Vec<(u32, PageEntry)> = Vec::new();
        for task in 0..tasks {
            table.extend(self.index::<Vec<PageEntry>>("write", task)?.into_iter().map(|entry| (task, entry)));
        }
        if table.len() as u64 != pages {
            return Err(self.unsound("another number of pages than stage pages has told"));
        }
        let entries: Vec<PageEntry> = table.iter().map(|(_, entry)| *entry).collect();
        let (header, tail) = ends(MAGIC, version, &entries, end, &about);
        let output = self.job.output();
        let (path, mut head) = (self.job.growing(), vec![0; ALIGNMENT as usize]);
        head.iter_mut().zip(header.encode()).for_each(|(to, byte)| *to = byte);
        let file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            // Another try has come to the end, or is about to.
            Err(_) if begins_with(output, &head, header.file_len) => return self.hand_on(&(), 0, 0),
            Err(_) => return Err(self.write_again(&path, (0..tasks).collect())),
        };
        self.progress.begin("checking pages", pages);
        let len = file.metadata().map_err(|source| io_error(&path, "look at", source))?.len();
        let is_damaged = |(_, entry): &&(u32, PageEntry)| {
            self.progress.advance(1);
            let next = align_up(entry.offset + u64::from(entry.len), ALIGNMENT).unwrap_or(end);
            let mut bytes = vec![0; (next - entry.offset) as usize];
            // Behind the last page there may be nothing yet.
            let have = len.saturating_sub(entry.offset).min(bytes.len() as u64) as usize;
            let read = read_exact_at(&file, &mut bytes[..have], entry.offset);
            let (page, zeros) = bytes.split_at(entry.len as usize);
            read.is_err() || crc32c::crc32c(page) != entry.crc || zeros.iter().any(|&byte| byte != 0)
        };
        let mut damaged: Vec<u32> = table.par_iter().filter(is_damaged).map(|(task, _)| *task).collect();
        damaged.dedup();
        if !damaged.is_empty() {
            return Err(self.write_again(&path, damaged));
        }
        let written = write_all_at(&file, &tail, end)
            .and_then(|()| file.set_len(header.file_len))
            .and_then(|()| write_all_at(&file, &head, 0))
            .and_then(|()| file.sync_all());
        written.map_err(|source| io_error(&path, "write", source))?;
        drop(file);
        match std::fs::rename(&path, output) {
            Err(source) if !begins_with(output, &head, header.file_len) => {
                return Err(io_error(output, "rename the finished file to", source));
            }
            _ => {}
        }
        self.hand_on(&(), 0, tail.len() as u64 + ALIGNMENT)
    }

    /// Forgets tasks that have written pages that are not in the file.
    fn write_again(&self, path: &Path, tasks: Vec<u32>) -> BuildError {
        for &task in &tasks {
            match self.job.number("write", task) {
                Ok(number) => self.job.names().forget(number),
                Err(error) => return error,
            }
        }
        let tasks = tasks.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
        job_error(path, &format!("pages: found others than were written, or none; run stage write, task {tasks}"))
    }

    /// Opens the source, which must be the one that was planned for.
    fn source(&self) -> Result<Box<dyn Source>, BuildError> {
        let settings = &self.job.settings;
        let source = open_with(&settings.source, self.options.read)?;
        match source.description().bytes == settings.source_bytes {
            true => Ok(source),
            false => Err(self.changed(&format!("{} bytes", source.description().bytes))),
        }
    }

    /// The families of the source, which must be those that were planned for.
    fn streams<'s>(&self, source: &'s dyn Source) -> Result<Streams<'s>, BuildError> {
        let (streams, _) = streams_of(source, &self.job.settings.load, self.options)?;
        let own = streams.families.iter().map(|stream| (stream.family(), stream.particles(), stream.chunks()));
        let planned = self.job.settings.families.iter().map(|own| (own.name, own.particles, own.chunks));
        if own.eq(planned) { Ok(streams) } else { Err(self.changed("other families or numbers of particles")) }
    }

    fn changed(&self, found: &str) -> BuildError {
        job_error(
            &self.job.settings.source,
            &format!("found {found}, expected the source as it was when the job was planned"),
        )
    }

    fn unsound(&self, found: &str) -> BuildError {
        job_error(self.parts.folder(), &format!("found {found}, expected results of one job"))
    }

    /// What a task may take that looks after a family, and reads so many of its particles.
    fn memory(&self, outline: &Outline, particles: u64) -> Memory {
        let allowed = self.options.memory.unwrap_or_else(default_memory);
        Memory::of_task(allowed, self.parts.folder(), outline.most_columns(), outline.plan.len(), particles)
    }

    /// Where blobs are, and where the task puts its own.
    fn spill(&self) -> Spill {
        Spill::of_parts(Arc::clone(&self.parts))
    }

    /// The value that is in a blob.
    fn portable<T: Portable>(&self, spill: &Spill, blob: &Blob) -> Result<T, BuildError> {
        let bytes = spill.get(blob).map_err(|error| BuildError::temporary(spill, error))?;
        T::of_bytes(&bytes).ok_or_else(|| self.unsound("a value of another version"))
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

impl Job {
    /// Family, and number among its own, of a task that reads the source.
    fn input(&self, task: u32) -> (usize, &FamilyTasks, u32) {
        self.of_family(task, |family| family.input)
    }

    /// The same of one that has some of the buckets of a family.
    fn group(&self, task: u32) -> (usize, &FamilyTasks, u32) {
        self.of_family(task, |family| family.groups)
    }

    fn of_family(&self, task: u32, tasks: impl Fn(&FamilyTasks) -> u32) -> (usize, &FamilyTasks, u32) {
        let families = &self.settings.families;
        let mut rest = task;
        let mut number = 0;
        while number + 1 < families.len() && rest >= tasks(&families[number]) {
            rest -= tasks(&families[number]);
            number += 1;
        }
        (number, &families[number], rest)
    }

    /// The tasks of each family that read the source.
    fn inputs(&self) -> impl Iterator<Item = Range<u32>> {
        self.of_families(|family| family.input)
    }

    /// The tasks of each family that have some of its buckets.
    fn groups(&self) -> impl Iterator<Item = Range<u32>> {
        self.of_families(|family| family.groups)
    }

    fn of_families(&self, tasks: fn(&FamilyTasks) -> u32) -> impl Iterator<Item = Range<u32>> {
        self.settings.families.iter().scan(0, move |first, family| {
            let start = *first;
            *first += tasks(family);
            Some(start..*first)
        })
    }

    /// Bytes of the source that some chunks of a family take, about.
    fn source_bytes(&self, family: &FamilyTasks, chunks: &Range<usize>) -> u64 {
        let particles = family.particles as f64 * chunks.len() as f64 / family.chunks.max(1) as f64;
        (self.settings.source_bytes as f64 * particles / self.settings.particles().max(1) as f64) as u64
    }
}

/// Codebook and part of whatever is coded by itself; the numbers of these units are those of this order.
fn units(books: &[(usize, Book)]) -> Vec<(usize, usize)> {
    let units = |(number, (_, book)): (usize, &(usize, Book))| (0..book.parts.len()).map(move |part| (number, part));
    books.iter().enumerate().flat_map(units).collect()
}

/// Things of these sizes for a number of tasks, each of which has about as much to do.
fn balanced(sizes: &[u64], tasks: u32) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(sizes[i]), i));
    let mut all = vec![(0, Vec::new()); tasks.max(1) as usize];
    for i in order {
        if let Some((held, own)) = all.iter_mut().min_by_key(|(held, _)| *held) {
            *held += sizes[i];
            own.push(i);
        }
    }
    let in_order = |(_, mut own): (u64, Vec<usize>)| {
        own.sort_unstable();
        own
    };
    all.into_iter().map(in_order).collect()
}

/// Things of these sizes in runs of about the same size, one for each task.
fn runs(sizes: &[u64], tasks: u32) -> Vec<Range<usize>> {
    let total: u128 = sizes.iter().map(|size| u128::from(*size)).sum();
    let mut ends = vec![0; tasks.max(1) as usize];
    let mut before = 0;
    for (i, size) in sizes.iter().enumerate() {
        let middle = before + u128::from(*size) / 2;
        let task = (middle * ends.len() as u128 / total.max(1)).min(ends.len() as u128 - 1) as usize;
        ends[task] = i + 1;
        before += u128::from(*size);
    }
    let mut start = 0;
    let run = |end: usize| {
        let own = start..end.max(start);
        start = own.end;
        own
    };
    ends.into_iter().map(run).collect()
}

/// Opens the file that will be the output, or begins it.
fn open_growing(path: &Path) -> Result<File, BuildError> {
    let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
    file.map_err(|source| io_error(path, "open", source))
}

/// Whether a file of this length begins with these bytes.
fn begins_with(path: &Path, head: &[u8], len: u64) -> bool {
    let mut bytes = vec![0; head.len()];
    let read = File::open(path).and_then(|file| {
        read_exact_at(&file, &mut bytes, 0)?;
        Ok(file.metadata()?.len())
    });
    read.is_ok_and(|found| found == len) && bytes == head
}

fn io_error(path: &Path, action: &'static str, source: io::Error) -> BuildError {
    StoreError::Io { path: PathBuf::from(path), action, source }.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Each thing is one task's, and no task has much more than its share.
        #[test]
        fn work_is_shared_out_evenly(sizes in prop::collection::vec(0..1000_u64, 0..100), tasks in 1..20_u32) {
            let share = sizes.iter().sum::<u64>() / u64::from(tasks) + sizes.iter().max().unwrap_or(&0) + 2;
            let of = |own: &mut dyn Iterator<Item = usize>| own.map(|i| sizes[i]).sum::<u64>();
            let balanced = balanced(&sizes, tasks);
            prop_assert!(balanced.iter().all(|own| of(&mut own.iter().copied()) <= share));
            let mut all = balanced.concat();
            all.sort_unstable();
            prop_assert!(all.into_iter().eq(0..sizes.len()) && balanced.len() == tasks as usize);
            let runs = runs(&sizes, tasks);
            prop_assert!(runs.iter().all(|run| of(&mut run.clone()) <= share));
            prop_assert!(runs.iter().cloned().flatten().eq(0..sizes.len()) && runs.len() == tasks as usize);
        }
    }
}
