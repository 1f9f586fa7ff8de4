//! The stages that make trees: leaves and grids of each group of buckets, joined.

use super::*;

impl Task<'_> {
    pub(super) fn grow(self, task: u32) -> Result<(), BuildError> {
        let (number, own, group) = self.settings.group(task);
        let Some(scaled) = self.scaled()?.into_iter().nth(number).flatten() else {
            return self.hand_on(&Grown { built: Vec::new(), estimated: Vec::new(), derived: Vec::new() }, 0, 0);
        };
        let Scaled { outline, scaling, means, .. } = scaled;
        let (has_estimates, derived) = (outline.estimating().is_some(), outline.derived_columns());
        let stages = [has_estimates.then_some("neighbours"), (derived > 0).then_some("motion")];
        let stages: Vec<&str> = stages.into_iter().flatten().collect();
        let mut partition = self.particles(number, group, &outline, &stages)?;
        partition.derived(means);
        let buckets = partition.numbers();
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
        let held = Memory::shares(buckets.len(), own.input);
        let workers = self.memory(&outline, held).workers(largest, self.job.output())?;
        let spill = self.spill();
        let built =
            self.grown(&outline, &scaling, &spill, |grower| grower.grow(&partition, buckets.clone(), workers))?;
        drop((partition, spill));
        let [estimated, derived] = counts;
        self.hand_on(&Grown { built, estimated, derived }, 0, 0)
    }

    /// Lets a family's trees be built.
    pub(super) fn grown<R>(
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

    pub(super) fn join(self) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let bits = self.options.octree.code_bits();
        let mut all: Vec<JoinedFamily> = Vec::new();
        for ((scaled, tasks), own) in
            self.scaled()?.into_iter().zip(self.settings.groups()).zip(&self.settings.families)
        {
            let Some(Scaled { outline, scaling, .. }) = scaled else {
                all.push(JoinedFamily::default());
                continue;
            };
            self.progress.begin(&format!("joining {}", own.name), 0);
            let mut built = Vec::with_capacity(outline.plan.len());
            let mut joined = JoinedFamily::default();
            let mut counts = 0_u64;
            for task in tasks {
                let (group, own) = self.built(task, &outline)?;
                counts = total([counts, own]);
                built.extend(group.built);
                joined.estimated = added(joined.estimated, group.estimated);
                joined.derived = added(joined.derived, group.derived);
            }
            let (kinds, count) = (self.options.octree.levels(), outline.survey.count);
            let most = most_in_nodes(count).saturating_mul(kinds.len() as u64).saturating_add(count);
            if counts > most {
                return Err(self.mixed("grow", "particles of nodes", counts, format!("at most {most}")));
            }
            let trees = self.grown(&outline, &scaling, &spill, |grower| grower.join(built))?;
            let mut first: Option<Draft> = None;
            for (tree, kind) in trees.into_iter().zip(kinds) {
                let (draft, batches) = Draft::of(tree, &spill, self.progress).map_err(temporary)?;
                let mixed = |what| job_error(self.parts.folder(), &format!("{what}, of all results of stage grow"));
                let check_cells = |first: &Draft| draft.check_cells(first.cells());
                draft.check(count).and_then(|()| first.as_ref().map_or(Ok(()), check_cells)).map_err(mixed)?;
                let found = draft.leaf_particles();
                if found != count {
                    return Err(self.mixed("partition or grow", "particles of leaves", found, count));
                }
                let book = |own: &Shared| Ok(Book { parts: own.parts(), shared: spill.put(&[&own.bytes()])? });
                let books = shared(&draft.nodes, batches, bits, scope(*kind));
                let books = books.iter().map(book).collect::<io::Result<Vec<_>>>().map_err(temporary)?;
                joined.trees.push(Joined { draft: spill.put(&[&draft.bytes()]).map_err(temporary)?, books });
                first = first.or(Some(draft));
            }
            all.push(joined);
        }
        drop(spill);
        self.hand_on(&all, 0, 0)
    }
}
