//! The first stages: the source is looked through, its particles go to their buckets, and what they lack is found.

use super::reading::{Kept, each};
use super::*;

/// Tasks whose files are read at a time.
const AT_ONCE: u32 = 64;
/// Bytes that what a task has seen of the source takes while it is joined with others, for each byte that tells of it: as it was read, and in the
/// lists of all.
const SURVEYED: u64 = 2;

impl Task<'_> {
    pub(super) fn survey(self, task: u32) -> Result<(), BuildError> {
        let (number, own, input) = self.settings.input(task);
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let (stream, chunks) = (&streams.families[number], own.input(input));
        let parts = Survey::parts(stream, &self.options.octree, chunks.clone(), self.progress)?;
        let bytes = self.settings.source_bytes(own, &chunks);
        let surveyed: Surveyed = (parts, stream.left_out());
        self.hand_on(&surveyed, bytes, 0)
    }

    pub(super) fn plan(self) -> Result<(), BuildError> {
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let spill = self.spill();
        let apart = |mut outline: Outline| {
            let samples = outline.survey.take_samples();
            let samples = spill.put(&[&samples.bytes()]).map_err(|error| BuildError::temporary(&spill, error))?;
            Ok::<_, BuildError>((outline, samples))
        };
        let (mut left_out, mut checksums) = (Vec::new(), Vec::new());
        let mut outlines: Vec<Option<(Outline, Blob)>> = Vec::new();
        for (stream, tasks) in streams.families.iter().zip(self.settings.inputs()) {
            let held = total(self.told_by("survey", tasks.clone())).saturating_mul(SURVEYED);
            self.left_beside(held, "stage plan, which knows all sampled positions,")?;
            let mut parts = Vec::with_capacity(tasks.len());
            for task in tasks {
                let (part, left) = self.surveyed(task, stream)?;
                checksums.push(part.iter().map(|(_, survey)| survey.checksum).fold(0, u64::wrapping_add));
                parts.push(part);
                left_out.push(left);
            }
            let (found, most) = (total(parts.iter().flatten().map(|(_, survey)| survey.count)), stream.particles());
            if found > most {
                return Err(self.mixed("survey", "particles", found, format!("at most {most}")));
            }
            let survey = Survey::joined(stream, &self.options.octree, parts);
            let outline = Outline::of(survey, stream, &self.options.octree, self.job.output())?;
            let sound = outline.as_ref().map_or(Ok(()), |outline| outline.check(most, false));
            let mixed = |what| job_error(self.parts.folder(), &format!("{what}, of all results of stage survey"));
            sound.map_err(mixed)?;
            outlines.push(outline.map(apart).transpose()?);
        }
        if outlines.iter().all(Option::is_none) {
            let field = "particles that can be drawn".into();
            return Err(ImportError::NoParticles { path: self.settings.named.clone(), field }.into());
        }
        drop(spill);
        let planned: Planned = (outlines, (LeftOut::sum(left_out), checksums));
        self.hand_on(&planned, 0, 0)
    }

    /// What was seen of each family, without samples.
    pub(super) fn outlines(&self) -> Result<(Vec<Option<Outline>>, LeftOut), BuildError> {
        let (outlines, (left_out, _)) = self.planned()?;
        Ok((outlines.into_iter().map(|outline| outline.map(|(outline, _)| outline)).collect(), left_out))
    }

    /// What was seen of one family; `None` if it has no particle.
    pub(super) fn outline(&self, family: usize) -> Result<Option<Outline>, BuildError> {
        Ok(self.outlines()?.0.into_iter().nth(family).flatten())
    }

    pub(super) fn partition(self, task: u32) -> Result<(), BuildError> {
        let (number, own, input) = self.settings.input(task);
        let (outlines, (_, checksums)) = self.planned()?;
        let Some((outline, _)) = outlines.into_iter().nth(number).flatten() else {
            return self.hand_on(&Sorted::default(), 0, 0);
        };
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        self.check_columns(&outline, &streams.families[number])?;
        let chunks = own.input(input);
        let particles = (own.particles as f64 * chunks.len() as f64 / own.chunks.max(1) as f64) as u64;
        let (folder, columns, buckets) = (self.parts.folder(), outline.most_columns(), outline.plan.len());
        let counts = (particles, self.settings.particles());
        let memory = Memory::of_sorting(self.allowed(), folder, columns, buckets, counts, self.job.output())?;
        let spill = Spill::new(&folder.join(format!("{SPILL}.{task}")), folder, memory.particles, self.options.read);
        let (partition, counts, checksum) = Partition::of_chunks(
            &streams.families[number],
            chunks.clone(),
            &outline.survey.ranges,
            &outline.plan,
            outline.root,
            (spill, memory.waiting),
            self.progress,
        )?;
        if checksums.get(task as usize) != Some(&checksum) {
            return Err(self.changed("other values than stage survey has read"));
        }
        let spill = self.spill();
        let groups = (0..own.groups).map(|group| shares(buckets, own.groups, group));
        let shares = partition.hand_on(groups, outline.has_neighbours(), &spill)?;
        let counted = spill.put(&[&counts.bytes()]).map_err(|error| BuildError::temporary(&spill, error))?;
        let sorted: Sorted = std::iter::once(counted).chain(shares).collect();
        drop(spill);
        let bytes = self.settings.source_bytes(own, &chunks);
        self.hand_on(&sorted, bytes, 0)
    }

    /// The particles of a group of a family's buckets, with what was found for them in the stages of these names. Of other groups nothing is
    /// read.
    pub(super) fn particles(
        &self,
        family: usize,
        group: u32,
        outline: &Outline,
        stages: &[&str],
    ) -> Result<Partition, BuildError> {
        let buckets = shares(outline.plan.len(), self.settings.families[family].groups, group);
        let columns = (outline.own, outline.columns);
        let spill = self.spill();
        let mut partition = Partition::of_group(self.spill(), columns, &outline.plan, buckets.clone());
        let (mut found, count) = (0, outline.survey.count);
        let tasks = self.settings.inputs().nth(family).unwrap_or(0..0);
        let read = |task: u32| self.sorted(&spill, task, group, (buckets.len(), outline));
        each(tasks, AT_ONCE, read, |shares: Shares| {
            found = total([found, shares.all]);
            partition.add(shares);
        })?;
        if found != count {
            return Err(self.mixed("partition", "particles", found, count));
        }
        let task = self.settings.groups().nth(family).map_or(group, |tasks| tasks.start + group);
        for stage in stages {
            let bytes = Self::found_columns(stage, outline) * size_of::<f32>();
            for (bucket, (_, blob)) in buckets.clone().zip(self.found_of(stage, task, outline)?) {
                let expected = bytes * partition.len(bucket);
                let len = blob.as_ref().map_or(0, Blob::len);
                if len != expected {
                    let what = format!("columns of a bucket: found {len} bytes, expected {expected}");
                    return Err(self.damaged(stage, task, &what));
                }
                let found = if *stage == "motion" { [None, blob] } else { [blob, None] };
                partition.found(bucket, found);
            }
        }
        Ok(partition)
    }

    /// What a task may take that finds columns for a group of so many buckets, and the groups around it that it keeps: it holds what is known of
    /// these and of its own. Blocks of buckets that follow each other have mostly the same groups around them.
    fn memory_of_finding(&self, outline: &Outline, own: &FamilyTasks, buckets: usize) -> (Memory, Kept<Partition>) {
        // Some groups have one more.
        let each = Memory::shares(buckets + 1, own.input);
        let around = Memory::groups_around(self.allowed(), each, own.groups);
        (self.memory(outline, each.saturating_mul(1 + around as u64)), Kept::new(around))
    }

    pub(super) fn neighbours(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.settings.group(task);
        let outline = self.outline(number)?;
        let estimating = outline.as_ref().and_then(Outline::estimating);
        let Some((outline, estimating)) = outline.as_ref().zip(estimating) else {
            return self.hand_on(&Found::new(), 0, 0);
        };
        let of_group = |group: u32| self.particles(number, group, outline, &[]);
        let mut partition = of_group(group)?;
        let buckets = partition.numbers();
        let (memory, kept) = self.memory_of_finding(outline, own, buckets.len());
        let others = |bucket: usize| {
            let group = sharer(bucket, outline.plan.len(), own.groups);
            kept.get(group, || of_group(group))
        };
        let surroundings = Surroundings { others: Some(&others), ..estimating.surroundings };
        let estimating = Estimating { surroundings, ..estimating };
        let block = memory.neighbour_block();
        let seen = estimating.of_buckets(&mut partition, buckets.clone(), block, self.progress)?;
        let of_bucket = |(bucket, seen)| {
            let [estimates, _] = partition.take_found(bucket);
            (seen, estimates)
        };
        let found: Found = buckets.zip(seen).map(of_bucket).collect();
        drop((partition, kept));
        self.hand_on(&found, 0, 0)
    }

    pub(super) fn motion(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.settings.group(task);
        let source = self.source()?;
        let streams = self.streams(source.as_ref())?;
        let derivation = streams.families[number].derivation();
        let Some((outline, derivation)) = self.outline(number)?.zip(derivation) else {
            return self.hand_on(&Found::new(), 0, 0);
        };
        self.check_columns(&outline, &streams.families[number])?;
        let of_group = |group: u32| self.particles(number, group, &outline, &["neighbours"]);
        let mut partition = of_group(group)?;
        let buckets = partition.numbers();
        let (memory, kept) = self.memory_of_finding(&outline, own, buckets.len());
        let others = |bucket: usize| {
            let group = sharer(bucket, outline.plan.len(), own.groups);
            kept.get(group, || of_group(group))
        };
        let deriving = outline.deriving(derivation, streams.about.kernel);
        let surroundings = Surroundings { others: Some(&others), ..deriving.surroundings };
        let deriving = Deriving { surroundings, ..deriving };
        let block = memory.motion_block();
        let seen = deriving.of_buckets(&mut partition, buckets.clone(), block, self.progress)?;
        let of_bucket = |(bucket, seen)| {
            let [_, derived] = partition.take_found(bucket);
            (seen, derived)
        };
        let found: Found = buckets.zip(seen).map(of_bucket).collect();
        drop((partition, kept));
        self.hand_on(&found, 0, 0)
    }

    pub(super) fn scale(self) -> Result<(), BuildError> {
        let mut scaled: Vec<Option<Scaled>> = Vec::new();
        let (outlines, _) = self.planned()?;
        let spill = self.spill();
        for (family, outline) in outlines.into_iter().enumerate() {
            let Some((mut outline, samples)) = outline else {
                scaled.push(None);
                continue;
            };
            let columns = outline.columns;
            let (estimated, derived) = (Self::found_columns("neighbours", &outline), outline.derived_columns());
            let held = Memory::found(outline.plan.len(), estimated + derived);
            self.left_beside(held, "stage scale, which knows a sample of what was found for each bucket,")?;
            let sampled = |samples: &Columns| expect("sampled columns", samples.attributes.len(), columns);
            outline.survey.put_samples(self.checked_value(&spill, &samples, sampled)?);
            let note = outline.note();
            let mut means = Vec::new();
            if estimated > 0 {
                let found = self.found("neighbours", family, &outline)?;
                outline.survey.estimated(found);
            }
            if derived > 0 {
                let found = self.found("motion", family, &outline)?;
                means = found.means();
                outline.derived(found);
            }
            let scaling = outline.scaling();
            drop(outline.survey.take_samples());
            scaled.push(Some(Scaled { outline, scaling, means, note }));
        }
        drop(spill);
        self.hand_on(&scaled, 0, 0)
    }
}
