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
        let mut all: Vec<JoinedFamily> = Vec::new();
        for (scaled, tasks) in self.scaled()?.into_iter().zip(self.settings.groups()) {
            all.push(match scaled {
                Some(Scaled { outline, scaling, .. }) => self.grown(&outline, &scaling, &spill, |grower| {
                    self.progress.begin(&format!("joining {}", outline.name), tasks.len() as u64);
                    self.joined_family(grower, &outline, tasks)
                })?,
                None => JoinedFamily::default(),
            });
        }
        drop(spill);
        self.hand_on(&all, 0, 0)
    }

    /// Joins what tasks have built of a family, one after the other: of most nodes only what decides which share a codebook is held.
    fn joined_family(
        &self,
        grower: &Grower<'_>,
        outline: &Outline,
        tasks: Range<u32>,
    ) -> Result<JoinedFamily, BuildError> {
        let spill = grower.spill;
        let temporary = |error| BuildError::temporary(spill, error);
        let mixed = |what| job_error(self.parts.folder(), &format!("{what}, of all results of stage grow"));
        let (kinds, count) = (self.options.octree.levels(), outline.survey.count);
        let most = most_in_nodes(count).saturating_mul(kinds.len() as u64).saturating_add(count);
        let held = self.held_by_joining(tasks.clone());
        let what = "stage join, which knows all leaves and builds the nodes of one group of buckets at a time,";
        let near = self.near(0, self.left_beside(held, what)?);
        let mut joiner = grower.joiner();
        let mut trees: Vec<Growing> = kinds.iter().map(|_| Growing::default()).collect();
        let (mut joined, mut counts) = (JoinedFamily::default(), 0_u64);
        for task in tasks {
            let (group, own) = self.built(task, outline)?;
            counts = total([counts, own]);
            if counts > most {
                return Err(self.mixed("grow", "particles of nodes", counts, format!("at most {most}")));
            }
            joined.estimated = added(joined.estimated, group.estimated);
            joined.derived = added(joined.derived, group.derived);
            let mut first: Option<Draft> = None;
            for (tree, nodes) in trees.iter_mut().zip(joiner.add(group.built, self.buckets(task, outline).end)?) {
                let (draft, batches) = Draft::of(nodes, spill, self.progress).map_err(temporary)?;
                let check_cells = |first: &Draft| draft.check_cells(first);
                tree.checked.add(&draft).and_then(|()| first.as_ref().map_or(Ok(()), check_cells)).map_err(mixed)?;
                tree.gathering.add(&draft.nodes, batches, &near).map_err(temporary)?;
                tree.drafts.push(spill.put(&[&draft.bytes()]).map_err(temporary)?);
                first = first.or(Some(draft));
            }
            self.progress.advance(1);
        }
        for ((tree, levels), kind) in trees.into_iter().zip(joiner.levels()).zip(kinds) {
            let Growing { drafts, checked, gathering } = tree;
            checked.end(&levels, count).map_err(mixed)?;
            let found = total(levels.iter().map(|level| level.leaf_particles));
            if found != count {
                return Err(self.mixed("partition or grow", "particles of leaves", found, count));
            }
            self.left_beside(held.saturating_add(SORTED * gathering.largest()), what)?;
            let books = gathering.books(&near, spill, self.options.octree.code_bits().entries, scope(*kind));
            joined.trees.push(Joined { drafts, levels, books: books.map_err(temporary)? });
        }
        Ok(joined)
    }

    /// Bytes that are held, about, where what these tasks have built is joined.
    fn held_by_joining(&self, tasks: Range<u32>) -> u64 {
        let bytes = self.told_by("grow", tasks);
        let all = total(bytes.iter().copied()) / PIECE_TOLD * Gathering::HELD;
        all.saturating_add(bytes.into_iter().max().unwrap_or(0).saturating_mul(JOINED))
    }

    /// A place for what the task needs again itself, of which so much is kept in memory.
    pub(super) fn near(&self, task: u32, room: u64) -> Spill {
        let folder = self.parts.folder();
        Spill::new(&folder.join(format!("{SPILL}.{task}")), folder, room, self.options.read)
    }
}

/// A tree whose nodes come.
#[derive(Default)]
struct Growing {
    drafts: Vec<Blob>,
    checked: Checked,
    gathering: Gathering,
}

/// Bytes by which a task that builds tells of a piece: more.
const PIECE_TOLD: u64 = 200;
/// Bytes that what a task has built takes while it is joined, for each byte that tells of it: read, as pieces, as nodes, and as batches.
const JOINED: u64 = 8;
/// The same of batches that are sorted out, for each byte that tells of them.
const SORTED: u64 = 5;
