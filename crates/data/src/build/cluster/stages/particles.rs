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
                let (part, left) = self.surveyed(task, stream)?;
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
        let planned: Planned = (outlines, LeftOut::sum(left_out));
        self.hand_on(&planned, 0, 0)
    }

    /// What was seen of each family, without samples.
    pub(super) fn outlines(&self) -> Result<(Vec<Option<Outline>>, LeftOut), BuildError> {
        let (outlines, left_out) = self.planned()?;
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
        self.check_columns(&outline, &streams.families[number])?;
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
            let (shares, _) = self.sorted(task, outline)?;
            blocks.push(shares);
        }
        let count = outline.survey.count;
        let found = total(blocks.iter().flatten().filter_map(|share| share.particles(outline.columns).ok()));
        if found != count {
            return Err(self.mixed("partition", "particles", found, count));
        }
        let spill = self.spill();
        let columns = (outline.own, outline.columns);
        let mut partition = Partition::handed_on(self.spill(), columns, &outline.plan, blocks);
        for stage in stages {
            let bytes = Self::found_columns(stage, outline) * size_of::<f32>();
            for (bucket, (_, blob)) in self.found(stage, family, outline)?.into_iter().enumerate() {
                let expected = bytes * partition.len(bucket);
                match &blob {
                    Some(blob) if blob.len() != expected => {
                        let what = format!("columns of a bucket: found {} bytes, expected {expected}", blob.len());
                        return Err(BuildError::temporary(&spill, spill.damaged(blob, &what)));
                    }
                    None if expected > 0 => {
                        return Err(self.unsound(&format!("a bucket without columns of stage {stage}")));
                    }
                    _ => {}
                }
                let found = if *stage == "motion" { [None, blob] } else { [blob, None] };
                partition.found(bucket, found);
            }
        }
        Ok(partition)
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
        self.check_columns(&outline, &streams.families[number])?;
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
        let (outlines, _) = self.planned()?;
        let spill = self.spill();
        for (family, outline) in outlines.into_iter().enumerate() {
            let Some((mut outline, samples)) = outline else {
                scaled.push(None);
                continue;
            };
            let columns = outline.columns;
            let sampled = |samples: &Columns| expect("sampled columns", samples.attributes.len(), columns);
            outline.survey.put_samples(self.checked_value(&spill, &samples, sampled)?);
            let note = outline.note();
            let mut means = Vec::new();
            let sum = |stage: &str, outline: &Outline| {
                let seen = self.found(stage, family, outline)?.into_iter().map(|(seen, _)| seen);
                Ok::<_, BuildError>(found::sum(seen, Self::found_columns(stage, outline)))
            };
            if outline.estimating().is_some() {
                let found = sum("neighbours", &outline)?;
                outline.survey.estimated(found);
            }
            if outline.derived_columns() > 0 {
                let found = sum("motion", &outline)?;
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
