//! What tasks have left for others, checked where it is read: checksums say that bytes are those that were written, not that numbers among
//! them can be what they are used as. Counts add up to those of the plan, lists are as long as what they tell of, and what names a bucket, a
//! node, a codebook or a part names one that is there. So stages need not look at that again, and allocate no more than particles ask for.

use super::pages::NODES;
use super::*;
use std::fmt::Display;

impl Task<'_> {
    /// The error about the file of a task, which is removed: its task is to be run again.
    pub(super) fn damaged(&self, stage: &str, task: u32, what: &str) -> BuildError {
        match self.job.number(stage, task) {
            Ok(number) => BuildError::of_part(self.parts.folder(), self.parts.damaged(number, what)),
            Err(error) => error,
        }
    }

    /// The index of a task, which passes a check.
    pub(super) fn checked<T: Portable>(
        &self,
        stage: &str,
        task: u32,
        check: impl FnOnce(&T) -> Result<(), String>,
    ) -> Result<T, BuildError> {
        let found = self.parts.index(self.job.number(stage, task)?)?;
        match check(&found) {
            Ok(()) => Ok(found),
            Err(what) => Err(self.damaged(stage, task, &what)),
        }
    }

    /// The value that is in a blob, which passes a check.
    pub(super) fn checked_value<T: Portable>(
        &self,
        spill: &Spill,
        blob: &Blob,
        check: impl FnOnce(&T) -> Result<(), String>,
    ) -> Result<T, BuildError> {
        let temporary = |error| BuildError::temporary(spill, error);
        let bytes = spill.get(blob).map_err(temporary)?;
        let unknown = || "value: found others, expected those of this stage".to_owned();
        let found = T::of_bytes(&bytes).ok_or_else(unknown).and_then(|found| check(&found).map(|()| found));
        found.map_err(|what| temporary(spill.damaged(blob, &what)))
    }

    /// What a task has seen of a family in its chunks.
    pub(super) fn surveyed(&self, task: u32, stream: &dyn ParticleStream) -> Result<Surveyed, BuildError> {
        let (_, own, input) = self.settings.input(task);
        let chunks = own.input(input);
        self.checked("survey", task, |(parts, _): &Surveyed| {
            let numbers = || parts.iter().map(|(chunk, _)| *chunk);
            let are_own = numbers().is_sorted_by(|a, b| a < b) && numbers().all(|number| chunks.contains(&number));
            expect_that(are_own, "chunks", "those of the task, in order")?;
            parts.iter().try_for_each(|(_, survey)| survey.check(3 + stream.columns()))?;
            expect_within("particles", total(parts.iter().map(|(_, survey)| survey.count)), 0..=own.particles)
        })
    }

    /// What was seen of each family, with where its sampled columns are.
    pub(super) fn planned(&self) -> Result<Planned, BuildError> {
        self.checked("plan", 0, |(outlines, (_, checksums)): &Planned| {
            let tasks: usize = self.settings.inputs().map(|tasks| tasks.len()).sum();
            expect("checksums of the source", checksums.len(), tasks)?;
            self.check_outlines(outlines.iter().map(|own| own.as_ref().map(|(outline, _)| outline)), false)
        })
    }

    /// What is known of each family once its columns are complete.
    pub(super) fn scaled(&self) -> Result<Vec<Option<Scaled>>, BuildError> {
        self.checked("scale", 0, |scaled: &Vec<Option<Scaled>>| {
            self.check_outlines(scaled.iter().map(|own| own.as_ref().map(|own| &own.outline)), true)?;
            scaled.iter().flatten().try_for_each(|Scaled { outline, scaling, means, .. }| {
                expect("scaled attributes", scaling.attributes.len(), outline.attributes.len())?;
                expect("means", means.len(), outline.derived_columns())
            })
        })
    }

    fn check_outlines<'o>(
        &self,
        outlines: impl ExactSizeIterator<Item = Option<&'o Outline>>,
        is_complete: bool,
    ) -> Result<(), String> {
        let families = &self.settings.families;
        expect("families", outlines.len(), families.len())?;
        let mut known = outlines.zip(families).filter_map(|(outline, own)| Some((outline?, own)));
        known.try_for_each(|(outline, own)| outline.check(own.particles, is_complete))
    }

    /// What was planned of a family is what its source has.
    pub(super) fn check_columns(&self, outline: &Outline, stream: &dyn ParticleStream) -> Result<(), BuildError> {
        match outline.is_of(stream) {
            true => Ok(()),
            // The checksum says that the plan is what was made of the source then.
            false => Err(self.changed("other columns, neighbours or edge of the periodic box")),
        }
    }

    /// What a task that has sorted chunks has of the buckets of a group, of which there are so many.
    pub(super) fn sorted(
        &self,
        spill: &Spill,
        task: u32,
        group: u32,
        (buckets, outline): (usize, &Outline),
    ) -> Result<Shares, BuildError> {
        let blob = self.of_sorted(spill, task, 1 + group)?;
        let check = |shares: &Shares| shares.check(buckets, outline.columns, outline.survey.count, blob.part());
        self.checked_value(spill, &blob, check)
    }

    /// How often which values are in the columns of the chunks that a task has sorted.
    pub(super) fn counted(&self, spill: &Spill, task: u32, outline: &Outline) -> Result<Vec<Vec<u64>>, BuildError> {
        let check = |counts: &Vec<Vec<u64>>| check_columns_counted(counts, 3 + outline.columns, outline.survey.count);
        self.checked_value(spill, &self.of_sorted(spill, task, 0)?, check)
    }

    /// A blob of [`Sorted`]. Of the others nothing is read: there is one for each group, and each group's task reads of all these lists.
    fn of_sorted(&self, spill: &Spill, task: u32, number: u32) -> Result<Blob, BuildError> {
        let part = self.job.number("partition", task)?;
        spill.listed(part, number).map_err(|error| BuildError::temporary(spill, error))
    }

    /// Columns that a stage finds for the particles of a family.
    pub(super) fn found_columns(stage: &str, outline: &Outline) -> usize {
        match stage {
            "motion" => outline.derived_columns(),
            _ if outline.estimating().is_some() => 2,
            _ => 0,
        }
    }

    /// What a task has found for the buckets of a family that it has, in their order.
    pub(super) fn found_of(&self, stage: &str, task: u32, outline: &Outline) -> Result<Found, BuildError> {
        let columns = Self::found_columns(stage, outline);
        let buckets = if columns > 0 { self.buckets(task, outline).len() } else { 0 };
        self.checked(stage, task, |found: &Found| {
            expect("buckets", found.len(), buckets)?;
            found.iter().try_for_each(|(seen, _)| seen.check(columns))
        })
    }

    /// What was found for the buckets of a family, added up in their order.
    pub(super) fn found(&self, stage: &str, family: usize, outline: &Outline) -> Result<Seen, BuildError> {
        let (columns, count) = (Self::found_columns(stage, outline), outline.survey.count);
        let (mut all, mut values) = (Seen::none(columns), vec![0_u64; columns]);
        let check = |wrong: Option<&u64>| match wrong {
            None => Ok(()),
            Some(found) => Err(self.mixed(stage, "values", *found, count)),
        };
        for task in self.settings.groups().nth(family).into_iter().flatten() {
            for (seen, _) in self.found_of(stage, task, outline)? {
                values.iter_mut().zip(&seen.ranges).for_each(|(sum, own)| *sum = total([*sum, own.values()]));
                // Ranges add up as long as their values are no more than there are particles.
                check(values.iter().find(|found| **found > count))?;
                all = all.with(seen);
            }
        }
        check(values.iter().find(|found| **found != count))?;
        Ok(all)
    }

    /// The buckets of a task that has some of a family.
    pub(super) fn buckets(&self, task: u32, outline: &Outline) -> Range<usize> {
        let (_, own, group) = self.settings.group(task);
        shares(outline.plan.len(), own.groups, group)
    }

    /// The error about what the tasks of a stage have found together.
    pub(super) fn mixed(&self, stage: &str, field: &str, found: u64, expected: impl Display) -> BuildError {
        let what = format!("{field}: found {found} in all results of stage {stage}, expected {expected}");
        job_error(self.parts.folder(), &what)
    }

    /// What was built of the buckets of a task, and the sum of all counts among it that are added up.
    pub(super) fn built(&self, task: u32, outline: &Outline) -> Result<(Grown, u64), BuildError> {
        let buckets = self.buckets(task, outline);
        let (kinds, attributes) = (self.options.octree.levels().len(), outline.attributes.len());
        let count = outline.survey.count;
        let mut counts = 0_u64;
        let grown = self.checked("grow", task, |grown: &Grown| {
            expect("buckets", grown.built.len(), buckets.len())?;
            for (bucket, built) in buckets.clone().zip(&grown.built) {
                counts = total([counts, check_built(built, (&outline.plan, bucket), kinds, attributes, count)?]);
            }
            let estimated = Self::found_columns("neighbours", outline);
            check_columns_counted(&grown.estimated, estimated, count)?;
            check_columns_counted(&grown.derived, outline.derived_columns(), count)
        })?;
        Ok((grown, counts))
    }

    /// What has been joined of each family.
    pub(super) fn joined(&self) -> Result<Vec<JoinedFamily>, BuildError> {
        self.checked("join", 0, |families: &Vec<JoinedFamily>| {
            expect("families", families.len(), self.settings.families.len())?;
            let kinds = self.options.octree.levels().len() as u64;
            let known = families.iter().zip(self.settings.groups()).filter(|(family, _)| !family.trees.is_empty());
            for (family, tasks) in known {
                expect("trees", family.trees.len() as u64, kinds)?;
                for Joined { drafts, books, .. } in &family.trees {
                    expect("runs of nodes", drafts.len(), tasks.len())?;
                    books.iter().try_for_each(Book::check)?;
                }
                let mut counted = family.estimated.iter().chain(&family.derived);
                counted.try_for_each(|counts| check_counts(counts, total(counts.iter().copied())))?;
            }
            let books = families.iter().flat_map(|family| &family.trees).flat_map(|tree| &tree.books);
            let particles = books.flat_map(|book| &book.parts).map(|part| part.particles);
            expect_within("particles", total(particles), 0..=self.most_particles())
        })
    }

    /// Particles that all nodes of all trees have together at most.
    fn most_particles(&self) -> u64 {
        most_in_nodes(self.settings.particles()).saturating_mul(self.options.octree.levels().len() as u64)
    }

    /// Nodes of a tree that follow those before them, which have been checked.
    pub(super) fn next_draft(&self, spill: &Spill, blob: &Blob, checked: &mut Checked) -> Result<Draft, BuildError> {
        self.checked_value(spill, blob, |draft: &Draft| checked.add(draft))
    }

    /// The batches of a run of those that share a codebook of a family, which has these parts.
    pub(super) fn run_of(
        &self,
        spill: &Spill,
        scaled: &Scaled,
        book: &Book,
        parts: &[Part],
        run: &Blob,
    ) -> Result<Vec<Entry>, BuildError> {
        let (columns, most) = (3 + scaled.scaling.attributes.len(), self.most_particles());
        self.checked_value(spill, run, |entries: &Vec<Entry>| book.check_run(parts, entries, columns, most))
    }

    /// What shares a codebook of a family, all of it.
    pub(super) fn shared(&self, spill: &Spill, scaled: &Scaled, book: &Book) -> Result<Shared, BuildError> {
        let mut all: Vec<Entry> = Vec::new();
        for (parts, run) in book.runs() {
            all.extend(self.run_of(spill, scaled, book, parts, run)?);
        }
        Ok(book.shared(0, all))
    }

    /// The run of what shares a codebook of a family that a part is of.
    pub(super) fn shared_around(
        &self,
        spill: &Spill,
        scaled: &Scaled,
        book: &Book,
        part: usize,
    ) -> Result<Shared, BuildError> {
        let (parts, run) = book.run_around(part).ok_or_else(|| self.unsound("parts of no batches"))?;
        Ok(book.shared(parts[0].batches.start, self.run_of(spill, scaled, book, parts, run)?))
    }

    /// The batches of a part, coded.
    pub(super) fn coded_part(&self, spill: &Spill, part: &Part, coded: &Blob) -> Result<Vec<Coded<Codes>>, BuildError> {
        self.checked_value(spill, coded, |batches: &Vec<Coded<Codes>>| {
            expect("batches of a part", batches.len(), part.batches.len())
        })
    }

    /// What the tasks of a stage have left for each of so many things, of which `own` are those of each task.
    pub(super) fn of_all<R: Portable>(
        &self,
        stage: &str,
        own: &[Vec<usize>],
        check: impl Fn(usize, &R) -> Result<(), String>,
    ) -> Result<Vec<R>, BuildError> {
        let mut all: Vec<(usize, R)> = Vec::new();
        for (task, own) in (0..).zip(own) {
            all.extend(self.of_task(stage, task, own, &check)?);
        }
        // Each is one task's.
        all.sort_by_key(|(number, _)| *number);
        Ok(all.into_iter().map(|(_, found)| found).collect())
    }

    /// What a task of a stage has left for each of its own things, with their numbers.
    pub(super) fn of_task<R: Portable>(
        &self,
        stage: &str,
        task: u32,
        own: &[usize],
        check: impl Fn(usize, &R) -> Result<(), String>,
    ) -> Result<Vec<(usize, R)>, BuildError> {
        self.checked(stage, task, |found: &Vec<(usize, R)>| {
            expect_that(found.iter().map(|(number, _)| number).eq(own), "numbers", "those of the task's parts")?;
            found.iter().try_for_each(|(number, found)| check(*number, found))
        })
    }

    /// Where the pages of each task are, and where they end.
    pub(super) fn page_plan(&self) -> Result<Pages, BuildError> {
        self.checked("pages", 0, |index: &Pages| {
            let Pages { tasks, end, version, about, .. } = index;
            let pages = index.count();
            expect("tasks", tasks.len(), self.settings.write as usize)?;
            expect_within("pages", pages, 1..=u32::MAX.into())?;
            // No page is longer than 4 GiB.
            let most = pages.saturating_mul(u64::from(u32::MAX) + ALIGNMENT).saturating_add(ALIGNMENT);
            expect_within("end of pages", *end, ALIGNMENT..=most)?;
            expect("rest behind the last page", *end % ALIGNMENT, 0)?;
            expect_that(is_about(*version, about, pages as usize), "metadata", "those of a file of this version")
        })
    }

    /// The pages that a task writes, where they are to be.
    pub(super) fn own_pages(&self, spill: &Spill, index: &Pages, task: u32) -> Result<Vec<Page>, BuildError> {
        let own = index.tasks.get(task as usize);
        let (blob, count) = own.ok_or_else(|| self.unsound("pages of fewer tasks"))?;
        let OwnPages { pages, nodes } = self.checked_value(spill, blob, |own: &OwnPages| {
            let pages = &own.pages;
            expect("pages", pages.len() as u64, *count)?;
            expect_that(pages.is_sorted_by(|a, b| a.offset < b.offset), "pages", "one behind the other")?;
            let is_place = |offset: u64| (ALIGNMENT..index.end).contains(&offset) && offset.is_multiple_of(ALIGNMENT);
            expect_that(pages.iter().all(|page| is_place(page.offset)), "page", "a place before the end of all")
        })?;
        let bytes = total(nodes.iter().map(|blob| blob.len() as u64));
        self.left_beside(bytes.saturating_mul(NODES), "a task that writes pages, which knows all of their nodes,")?;
        let mut all: Vec<PlacedNode> = Vec::new();
        for blob in &nodes {
            all.extend(self.portable::<Vec<PlacedNode>>(spill, blob)?);
        }
        // Those of a page are of several groups of buckets.
        all.sort_by_key(|(place, _)| (place.page, place.node));
        let mut rest = all.into_iter().peekable();
        let mut whole = Vec::with_capacity(pages.len());
        for head in pages {
            let mut nodes = Vec::new();
            while let Some((_, node)) =
                rest.next_if(|(place, _)| place.page == head.id && place.node as usize == nodes.len())
            {
                nodes.push(node);
            }
            expect("nodes of a page", nodes.len() as u64, head.nodes.into())
                .map_err(|what| self.damaged("pages", 0, &what))?;
            whole.push(Page { head, nodes });
        }
        match rest.next() {
            None => Ok(whole),
            Some(_) => Err(self.damaged("pages", 0, "nodes of a page: found more, expected those of the task's pages")),
        }
    }
}

/// Bytes that a batch takes in memory, in a list that has just grown, for each byte that tells of it.
pub(super) const BATCH: u64 = 3;

/// Whether these are counts of so many columns, of no more values than there are particles.
fn check_columns_counted(counts: &[Vec<u64>], columns: usize, particles: u64) -> Result<(), String> {
    expect("counted columns", counts.len(), columns)?;
    let values = counts.first().map_or(0, |counts| total(counts.iter().copied()));
    expect_within("counted values", values, 0..=particles)?;
    counts.iter().try_for_each(|counts| check_counts(counts, values))
}
