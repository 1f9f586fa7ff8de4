//! The first stages: the source is looked through, its particles go to their buckets, and what they lack is found.

use super::*;

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
        let mut left_out = Vec::new();
        let mut outlines: Vec<Option<(Outline, Blob)>> = Vec::new();
        for (stream, tasks) in streams.families.iter().zip(self.settings.inputs()) {
            let mut parts = Vec::with_capacity(tasks.len());
            for task in tasks {
                let (part, left): Surveyed = self.index("survey", task)?;
                parts.push(part);
                left_out.push(left);
            }
            let survey = Survey::joined(stream, &self.options.octree, parts);
            let outline = Outline::of(survey, stream, &self.options.octree, self.job.output())?;
            outlines.push(outline.map(apart).transpose()?);
        }
        if outlines.iter().all(Option::is_none) {
            let field = "particles that can be drawn".into();
            return Err(ImportError::NoParticles { path: self.settings.named.clone(), field }.into());
        }
        drop(spill);
        let planned: Planned = (outlines, LeftOut::sum(left_out));
        self.hand_on(&planned, 0, 0)
    }

    /// What was seen of each family, without samples.
    pub(super) fn outlines(&self) -> Result<(Vec<Option<Outline>>, LeftOut), BuildError> {
        let (outlines, left_out): Planned = self.index("plan", 0)?;
        Ok((outlines.into_iter().map(|outline| outline.map(|(outline, _)| outline)).collect(), left_out))
    }

    /// What was seen of one family; `None` if it has no particle.
    pub(super) fn outline(&self, family: usize) -> Result<Option<Outline>, BuildError> {
        Ok(self.outlines()?.0.into_iter().nth(family).flatten())
    }

    pub(super) fn partition(self, task: u32) -> Result<(), BuildError> {
        let (number, own, input) = self.settings.input(task);
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
        let bytes = self.settings.source_bytes(own, &chunks);
        self.hand_on(&sorted, bytes, 0)
    }

    /// The particles of all buckets of a family, with what was found for them in the stages of these names.
    pub(super) fn particles(&self, family: usize, outline: &Outline, stages: &[&str]) -> Result<Partition, BuildError> {
        let mut blocks = Vec::new();
        for task in self.settings.inputs().nth(family).into_iter().flatten() {
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
    pub(super) fn found(&self, stage: &str, family: usize) -> Result<Found, BuildError> {
        let mut all = Found::new();
        for task in self.settings.groups().nth(family).into_iter().flatten() {
            all.extend(self.index::<Found>(stage, task)?);
        }
        Ok(all)
    }

    pub(super) fn neighbours(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.settings.group(task);
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

    pub(super) fn motion(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.settings.group(task);
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

    pub(super) fn scale(self) -> Result<(), BuildError> {
        let mut scaled: Vec<Option<Scaled>> = Vec::new();
        let (outlines, _): Planned = self.index("plan", 0)?;
        let spill = self.spill();
        for (family, outline) in outlines.into_iter().enumerate() {
            let Some((mut outline, samples)) = outline else {
                scaled.push(None);
                continue;
            };
            outline.survey.put_samples(self.portable(&spill, &samples)?);
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
            drop(outline.survey.take_samples());
            scaled.push(Some(Scaled { outline, scaling, means, note }));
        }
        drop(spill);
        self.hand_on(&scaled, 0, 0)
    }

    /// What is known of each family once its columns are complete.
    pub(super) fn scaled(&self) -> Result<Vec<Option<Scaled>>, BuildError> {
        self.index("scale", 0)
    }
}
