//! The tracks of a run, interval by interval: never more than the steps around one are in work.
//!
//! The states of each step are read once and sent to buckets by id ([`super::states`]); buckets are joined in memory
//! ([`super::matching`]), and tracks go on to buckets by where they begin, which are cut into leaves, coded and written in order.

use super::flow::{FlowBuild, FlowStep};
use super::flow_regions::Regions;
use super::left_out::left_out;
use super::matching::{Found, Joining, NOBODY, TrackRecord, Window, track_words};
use super::memory::default_memory;
use super::run::StepProgress;
use super::shuffle::Shuffle;
use super::spill::Spill;
use super::states::{Scales, StateLayout, StepStates};
use super::track_nodes::write_nodes;
use super::{BuildError, BuildOptions, Matching, TrackOptions, kept};
use crate::hierarchy::RootCell;
use crate::hierarchy::octree::Plan;
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::hierarchy::spacetime::{Interval, Lattice};
use crate::import::{FieldKind, ImportError, LoadOptions, Run, Source, SourceStream, streams};
use crate::model::periodic::PeriodicBox;
use crate::model::{Bounds, ClockVariable, FamilyName, ParticleStream, Progress, Unit};
use crate::store::Metadata;
use crate::store::run::{
    FamilyTracks, FlowParts, IntervalTracks, Matches, RunFileWriter, Tangents, TrackFamily, TrackLayout, span,
};
use crate::store::temporary::folder_of;
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;

/// Tracks of a bucket by place.
const BUCKET: usize = 1 << 16;
/// Displacements by velocities outside of this mean that velocities are not what they seem.
const FACTORS: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Share of the mass that no factor of velocities accounts for where steps are too far apart.
const LOST: f64 = 0.25;
/// What `H0` is where it was assumed to be 100, by the one assumed.
const OTHER_HUBBLE: f64 = 1000.0;
/// Share of a family whose ids may be repeated.
const MOST_SHARED: f64 = 0.1;

/// A step as its still was built.
pub(super) struct BuiltStep {
    /// Its number in the [`Run`].
    pub number: usize,
    /// What the still's footer says of attributes: the mean of each, of each family.
    pub means: Vec<(FamilyName, Vec<f32>)>,
    /// The box around its positions, run units.
    pub bounds: Bounds,
    /// Particles.
    pub particles: u64,
}

impl BuiltStep {
    pub fn means_of(metadata: &Metadata) -> Vec<(FamilyName, Vec<f32>)> {
        let means = |family: &crate::store::FamilyMetadata| {
            family.attributes.iter().map(|attribute| attribute.mean as f32).collect()
        };
        metadata.families.iter().map(|family| (family.name, means(family))).collect()
    }
}

/// What tracks are built from and with.
pub(super) struct TrackBuild<'a> {
    pub run: &'a Run,
    pub steps: &'a [BuiltStep],
    /// The options of each step's load.
    pub load: &'a dyn Fn(usize) -> LoadOptions,
    pub tracks: &'a TrackOptions,
    pub options: &'a BuildOptions,
    pub out: &'a Path,
    pub box_size: Option<f64>,
}

/// What was built: for the directory.
pub(super) struct BuiltTracks {
    pub layout: TrackLayout,
    pub intervals: Vec<IntervalTracks>,
    pub notes: Vec<String>,
    pub temporary_bytes: u64,
}

/// What the headers say of the run as a whole.
struct Plans {
    layout: StateLayout,
    clock: Vec<f64>,
    variable: ClockVariable,
    /// Whether each family is matched by rows.
    by_row: Vec<bool>,
    units: Vec<Unit>,
    periodic: Option<f64>,
}

impl TrackBuild<'_> {
    /// Builds the tracks of all intervals and writes them.
    ///
    /// # Errors
    /// When a source cannot be read again, particles cannot be matched, or the run not be written.
    pub fn build(&self, writer: &mut RunFileWriter, progress: &dyn Progress) -> Result<BuiltTracks, BuildError> {
        let plans = self.plan()?;
        let families = plans.layout.families.len();
        let mut notes = Vec::new();
        let mut tangents = vec![(Tangents::Velocity, 1.0); families];
        let mut is_decided = vec![false; families];
        let mut window: Vec<StepStates> = Vec::new();
        let mut intervals: Vec<IntervalTracks> = Vec::new();
        let (count, mut temporary_bytes) = (self.steps.len(), 0);
        // States of the step before and of the one after are held where tangents are differences.
        let mut first = 0;
        let mut totals = vec![Found::default(); families];
        let mut flow: Option<FlowBuild> = None;
        for number in 0..count - 1 {
            let read_to = |window: &mut Vec<StepStates>, first: usize, last: usize| -> Result<(), BuildError> {
                while first + window.len() <= last.min(count - 1) {
                    let step = first + window.len();
                    let here = StepProgress { progress, step: step + 1, total: count };
                    window.push(self.states(&plans, step, &here)?);
                }
                Ok(())
            };
            read_to(&mut window, first, number + 1)?;
            self.decide(&plans, (first, &window), number, &mut tangents, &mut is_decided, &mut notes)?;
            let by_differences = tangents.iter().any(|(tangents, _)| *tangents == Tangents::Differences);
            if by_differences {
                read_to(&mut window, first, number + 2)?;
            }
            let (interval, found, on_disk) = self.interval(
                &plans,
                (first, &window),
                number,
                &tangents,
                by_differences,
                &mut flow,
                writer,
                progress,
            )?;
            for (total, found) in totals.iter_mut().zip(&found) {
                let shared_ids = total.shared_ids.max(found.shared_ids);
                *total = Found { shared_ids, ..total.with(*found) };
            }
            temporary_bytes =
                temporary_bytes.max(on_disk + window.iter().map(|states| states.shuffle.on_disk()).sum::<u64>());
            intervals.push(interval);
            // A step left out needs the one after: it is measured while all three are here.
            let keep_from = keep_from(number, by_differences);
            if number + 2 < count {
                read_to(&mut window, first, number + 2)?;
                let sample = |step: usize| window.get(step - first).map_or(&[][..], |states| &states.sample);
                let joining = self.joining(&plans, number, &tangents);
                let samples = [number, number + 1, number + 2].map(sample);
                let clock = [number, number + 1, number + 2].map(|step| plans.clock[step]);
                for (family, deviation) in left_out(&joining, samples, clock) {
                    intervals[number].families[family].matches.leave_one_out = Some(deviation);
                }
            }
            while first < keep_from {
                window.remove(0);
                first += 1;
            }
        }
        for ((name, _), total) in plans.layout.families.iter().zip(&totals) {
            self.check_shared(*name, total, &mut notes)?;
        }
        let families = plans.layout.families.iter().enumerate().map(|(family, (name, attributes))| TrackFamily {
            name: *name,
            tangents: tangents[family].0,
            has_ids: !plans.by_row[family],
            velocity_scale: tangents[family].1,
            velocity_unit: plans.units[family].clone(),
            attributes: attributes.clone(),
        });
        let about = &self.run.steps[self.steps[0].number].about;
        let families = families.collect();
        let layout = TrackLayout {
            lattice: plans.layout.lattice,
            box_size: plans.periodic,
            is_comoving: about.scale_factor.is_some() && self.run.is_timed_by_headers,
            cosmology: about.cosmology,
            motion: about.motion,
            clock: plans.clock.clone(),
            families,
            flow_errors: flow.map(|flow| flow.errors).unwrap_or_default(),
        };
        Ok(BuiltTracks { layout, intervals, notes, temporary_bytes })
    }

    /// Looks at all headers.
    fn plan(&self) -> Result<Plans, BuildError> {
        let bounds = self.steps.iter().fold(Bounds::EMPTY, |all, step| all.union(step.bounds));
        let periodic = PeriodicBox::of(self.box_size, bounds).map(|periodic| periodic.edge);
        let root = match periodic {
            // A whole number of units, so that images are exact.
            Some(edge) if bounds.min.min_element() >= 0.0 && bounds.max.max_element() <= edge => {
                RootCell { min: DVec3::ZERO, size: edge }
            }
            Some(edge) => RootCell { min: DVec3::splat(-0.5 * edge), size: 2.0 * edge },
            None => RootCell::around(bounds, 1.0),
        };
        let mut families: Vec<(FamilyName, Vec<(String, Unit)>)> = Vec::new();
        let mut units = Vec::new();
        for (index, step) in self.steps.iter().enumerate() {
            let is_new = |name: &FamilyName| families.iter().all(|(known, _)| known != name);
            if !step.means.iter().any(|(name, _)| is_new(name)) {
                continue;
            }
            let source = self.run.steps[step.number].open(self.options.read)?;
            for stream in self.streams(source.as_ref(), index)?.families {
                if step.means.iter().any(|(name, _)| *name == stream.family()) && is_new_in(&families, stream.family())
                {
                    families.push((stream.family(), stream.all_attributes()));
                    units.push(stream.velocity_unit().cloned().unwrap_or_default());
                }
            }
        }
        let by_row = families.iter().map(|(name, _)| self.by_row(*name)).collect::<Result<Vec<_>, _>>()?;
        let most = self.steps.iter().map(|step| step.particles).max().unwrap_or(0);
        let clock = self.steps.iter().map(|step| self.run.steps[step.number].clock).collect();
        let layout = StateLayout::new(Lattice { root }, families, most);
        Ok(Plans { layout, clock, variable: self.run.clock, by_row, units, periodic })
    }

    fn streams<'a>(&self, source: &'a dyn Source, step: usize) -> Result<crate::import::Streams<'a>, BuildError> {
        let load = (self.load)(step);
        Ok(streams(source, &load, &|names| kept(names, self.options, &load))?)
    }

    /// Whether a family is matched by rows; which must agree in number then.
    fn by_row(&self, name: FamilyName) -> Result<bool, BuildError> {
        let holding = self.steps.iter().filter(|step| step.means.iter().any(|(own, _)| *own == name));
        let mut counts: Vec<(&Path, u64)> = Vec::new();
        let mut lacking = None;
        let (mut has_velocities, mut is_without_ids, mut keeps_rows) = (true, true, true);
        for step in holding {
            let about = &self.run.steps[step.number].about;
            let Some(info) = about.families.iter().find(|info| info.name == name) else { continue };
            counts.push((&about.path, info.count));
            is_without_ids &= about.format == "tipsy";
            keeps_rows &= about.keeps_rows;
            has_velocities &= info.find(FieldKind::Velocity).is_some();
            if info.find(FieldKind::Id).is_none() && lacking.is_none() {
                lacking = Some(&*about.path);
            }
        }
        let differ = counts.windows(2).find(|pair| pair[0].1 != pair[1].1);
        match (self.tracks.matching, lacking) {
            (Matching::None, lacking) => Ok(lacking.is_some()),
            (Matching::Order, _) => match differ {
                Some([(_, before), (path, count)]) => {
                    let found = format!("{count} particles, {before} before");
                    let expected = "as many as before for --match order";
                    Err(ImportError::malformed(path, name.as_str(), found, expected).into())
                }
                _ => Ok(true),
            },
            (_, None) => Ok(false),
            // A format that has none keeps its particles in order; velocities will have to bear it out.
            (Matching::Auto, Some(_)) if differ.is_none() && has_velocities && is_without_ids => Ok(true),
            (Matching::Auto, Some(_)) if differ.is_none() && keeps_rows => Ok(true),
            (_, Some(path)) => Err(missing_ids(path, name)),
        }
    }

    /// Reads the states of a step.
    fn states(&self, plans: &Plans, step: usize, progress: &dyn Progress) -> Result<StepStates, BuildError> {
        let own = &self.run.steps[self.steps[step].number];
        let source = own.open(self.options.read)?;
        let streams = self.streams(source.as_ref(), step)?;
        let room = self.memory() / 6;
        let mut states = StepStates::new(&plans.layout, self.options, self.out, room);
        for stream in &streams.families {
            let means = self.steps[step].means.iter().find(|(name, _)| *name == stream.family());
            let scales = Scales {
                length: own.length,
                mass: own.mass,
                velocity: stream.velocity_unit().and_then(|_| plans.variable.velocity_factor(&own.about.epoch())),
                means: means.map(|(_, means)| means.clone()).unwrap_or_default(),
            };
            let family = plans.layout.families.iter().position(|(name, _)| *name == stream.family());
            if let Some(family) = family {
                check_attributes(&own.about.path, stream, &plans.layout.families[family].1)?;
            }
            let by_row = family.is_some_and(|family| plans.by_row[family]);
            states.add(&plans.layout, stream, by_row, &scales, (self.options, self.out), progress)?;
        }
        Ok(states)
    }

    fn memory(&self) -> u64 {
        self.options.memory.unwrap_or_else(default_memory)
    }

    /// Decides of families that are at both ends of an interval for the first time whether their velocities are what they seem.
    fn decide(
        &self,
        plans: &Plans,
        (first, window): (usize, &[StepStates]),
        number: usize,
        tangents: &mut [(Tangents, f64)],
        is_decided: &mut [bool],
        notes: &mut Vec<String>,
    ) -> Result<(), BuildError> {
        if is_decided.iter().all(|is_decided| *is_decided) {
            return Ok(());
        }
        let sample = |step: usize| window.get(step - first).map(|states| states.sample.clone()).unwrap_or_default();
        let states: Window = [Vec::new(), sample(number), sample(number + 1), Vec::new()];
        let by_velocity = vec![(Tangents::Velocity, 1.0); tangents.len()];
        let joining = self.joining(plans, number, &by_velocity);
        let (_, found) = joining.join(&states);
        for (family, (name, _)) in plans.layout.families.iter().enumerate() {
            if is_decided[family] || found[family].matched == 0 {
                continue;
            }
            is_decided[family] = true;
            let has_velocities = window[number - first].has_velocities(&plans.layout, family);
            let factor = found[family].velocity_factor();
            let is_right = |scale: f64| factor.is_none_or(|factor| FACTORS.contains(&(factor / scale)));
            let about = &self.run.steps[self.steps[number].number].about;
            let assumed = about.cosmology.is_some_and(|cosmology| cosmology.hubble_assumed);
            let other = [OTHER_HUBBLE, 1.0 / OTHER_HUBBLE].into_iter().find(|scale| assumed && is_right(*scale));
            tangents[family] = match self.tracks.tangents {
                Some(Tangents::Velocity) if !has_velocities => {
                    let expected = "velocities for --tangents velocity";
                    return Err(ImportError::missing(&about.path, format!("{name}: velocities"), expected).into());
                }
                Some(asked) => (asked, 1.0),
                None if !has_velocities => {
                    notes.push(format!("{name}: no velocities, so tracks follow the differences of positions"));
                    (Tangents::Differences, 1.0)
                }
                None if is_right(1.0) => (Tangents::Velocity, 1.0),
                None if let Some(scale) = other => {
                    notes.push(format!("{name}: velocities fit displacements if H0 is {}", 100.0 / scale));
                    (Tangents::Velocity, scale)
                }
                None if self.is_unresolved(plans, number, &states, factor, family) => (Tangents::Velocity, 1.0),
                None => {
                    let factor = factor.unwrap_or(0.0);
                    notes.push(format!(
                        "{name}: displacements are {factor:.3} times what velocities say, so tracks follow the differences of positions"
                    ));
                    (Tangents::Differences, 1.0)
                }
            };
            if plans.by_row[family] && self.tracks.matching != Matching::None && has_velocities {
                self.check_order(*name, &found[family], is_right(tangents[family].1), &about.path)?;
            }
        }
        Ok(())
    }

    /// Whether displacements are as they are because the steps are too far apart for the orbits, and not because velocities are in
    /// another unit: no factor makes the two agree.
    fn is_unresolved(&self, plans: &Plans, number: usize, states: &Window, factor: Option<f64>, family: usize) -> bool {
        let Some(factor) = factor.filter(|factor| factor.abs() > 0.0) else { return true };
        let scaled = vec![(Tangents::Velocity, factor); plans.layout.families.len()];
        let (_, found) = self.joining(plans, number, &scaled).join(states);
        found[family].mass[1] > LOST * found[family].mass[0]
    }

    /// Whether displacements fit the velocities of particles that are matched by their rows.
    fn check_order(&self, name: FamilyName, found: &Found, is_right: bool, path: &Path) -> Result<(), BuildError> {
        let share = if found.mass[0] > 0.0 { found.mass[1] / found.mass[0] } else { 0.0 };
        if is_right && share <= LOST {
            return Ok(());
        }
        let factor = found.velocity_factor().unwrap_or(0.0);
        match self.tracks.matching {
            Matching::Order => {
                let what =
                    format!("displacements that are {factor:.3} times velocities, {:.0} % do not fit", 100.0 * share);
                let expected = "particles in one order for --match order";
                Err(ImportError::malformed(path, name.as_str(), what, expected).into())
            }
            _ => Err(missing_ids(path, name)),
        }
    }

    fn joining<'a>(&self, plans: &'a Plans, number: usize, tangents: &'a [(Tangents, f64)]) -> Joining<'a> {
        let at = |step: Option<usize>| step.and_then(|step| plans.clock.get(step)).copied().unwrap_or(f64::NAN);
        let unit = plans.layout.lattice.unit();
        Joining {
            layout: &plans.layout,
            is_matching: self.tracks.matching != Matching::None,
            clock: [at(number.checked_sub(1)), at(Some(number)), at(Some(number + 1)), at(Some(number + 2))],
            spans: [span(&plans.clock, number), span(&plans.clock, number + 1)],
            edge: plans.periodic.map(|edge| (edge / unit).round() as i64),
            tangents,
        }
    }

    /// Joins and writes one interval.
    #[allow(clippy::too_many_arguments, reason = "what is known of all intervals, of this one, and where it goes")]
    fn interval(
        &self,
        plans: &Plans,
        (first, window): (usize, &[StepStates]),
        number: usize,
        tangents: &[(Tangents, f64)],
        by_differences: bool,
        flow: &mut Option<FlowBuild>,
        writer: &mut RunFileWriter,
        progress: &dyn Progress,
    ) -> Result<(IntervalTracks, Vec<Found>, u64), BuildError> {
        let layout = &plans.layout;
        let at = |step: usize| step.checked_sub(first).and_then(|index| window.get(index));
        let (begin, end) = (&window[number - first], &window[number + 1 - first]);
        let joining = self.joining(plans, number, tangents);
        let space = Interval {
            lattice: layout.lattice,
            length: plans.clock[number + 1] - plans.clock[number],
            spans: joining.spans,
            box_size: plans.periodic,
        };
        let by_place: Vec<Plan> = (0..layout.families.len()).map(|family| begin.plan(layout, family, BUCKET)).collect();
        let starts: Vec<usize> = by_place
            .iter()
            .scan(0, |at, plan| {
                let start = *at;
                *at += plan.len();
                Some(start)
            })
            .collect();
        let buckets = by_place.iter().map(Plan::len).sum();
        let folder = self.options.temporary.clone().unwrap_or_else(|| folder_of(self.out).to_owned());
        let spill = Spill::new(self.out, &folder, self.memory() / 6, self.options.read);
        let sorted = Shuffle::new(buckets, track_words(layout), spill);
        let bucket_of =
            |track: &TrackRecord| starts[track.family] + by_place[track.family].bucket(morton_key(track.places[0]));
        let place = format!("interval {} of {}", number + 1, plans.clock.len() - 1);
        // Steps before this one are not looked at again.
        let needed_from = if number + 2 == plans.clock.len() { number + 2 } else { keep_from(number, by_differences) };
        let states = |bucket: usize, is_last: bool| -> Result<Window, BuildError> {
            let get = |step: usize| match at(step) {
                Some(states) if is_last && step < needed_from => states.shuffle.take(bucket),
                Some(states) => states.shuffle.get(bucket),
                None => Ok(Vec::new()),
            };
            let around = |step: Option<usize>| step.filter(|_| by_differences).map_or(Ok(Vec::new()), get);
            Ok([around(number.checked_sub(1))?, get(number)?, get(number + 1)?, around(Some(number + 2))?])
        };
        let next_length = plans.clock.get(number + 2).map(|next| next - plans.clock[number + 1]);
        let edge = joining.edge;
        let (options, out, clock) = (self.options, self.out, [plans.clock[number], plans.clock[number + 1]]);
        let step = FlowStep { layout, options, out, interval: number, space: &space, clock, next_length, edge };
        if number == 0 && self.tracks.flow.levels != Some(0) {
            let mut first = FlowBuild::new(&self.tracks.flow, begin, &step);
            let regions = Regions::new(&step, begin, 0);
            progress.begin("flow levels of the first step", layout.buckets as u64);
            (0..layout.buckets).into_par_iter().with_max_len(1).try_for_each(|bucket| {
                regions.put(&step, &joining.join(&states(bucket, false)?).0)?;
                progress.advance(1);
                Ok::<_, BuildError>(())
            })?;
            first.begin(&step, &regions)?;
            *flow = Some(first);
        }
        let regions = flow.is_some().then(|| Regions::new(&step, end, 1));
        progress.begin(&format!("{place}: matching"), layout.buckets as u64);
        let joined = (0..layout.buckets).into_par_iter().with_max_len(1).map(|bucket| {
            let (mut records, found) = joining.join(&states(bucket, true)?);
            match (flow.as_ref(), &regions) {
                (Some(flow), Some(regions)) => {
                    let clusters = flow.carried(bucket)?;
                    for record in records.chunks_exact_mut(track_words(layout)) {
                        let number = TrackRecord::of(record).numbers[0];
                        TrackRecord::set_number(record, clusters.get(number as usize).copied().unwrap_or(NOBODY));
                    }
                    regions.put(&step, &records)?;
                }
                _ => sorted.put(&records, |record| bucket_of(&TrackRecord::of(record)))?,
            }
            progress.advance(1);
            Ok(found)
        });
        let joined: Vec<Vec<Found>> = joined.collect::<Result<_, BuildError>>()?;
        let none = vec![Found::default(); layout.families.len()];
        let found = joined
            .into_iter()
            .fold(none, |all, more| all.into_iter().zip(more).map(|(all, more)| all.with(more)).collect());
        let mut on_disk = sorted.on_disk();
        let mut parts = vec![FlowParts::default(); layout.families.len()];
        if let (Some(flow), Some(regions)) = (flow.as_mut(), regions) {
            progress.begin(&format!("{place}: flow levels"), 1);
            parts = flow.advance(&step, &regions, &sorted, &bucket_of, writer)?;
            on_disk = sorted.on_disk() + regions.on_disk();
            progress.advance(1);
        }
        progress.begin(&format!("{place}: writing tracks"), buckets as u64);
        let mut families = Vec::with_capacity(layout.families.len());
        for (family, found) in found.iter().enumerate() {
            let range = starts[family]..starts[family] + by_place[family].len();
            let (nodes, index) = write_nodes(&sorted, range, layout, family, &space, flow.is_some(), writer, progress)?;
            let (section, index_crc) = writer.append_index(&index)?;
            let rounding = begin.rounding[family].with(end.rounding[family]);
            let mean = if rounding.count > 0 { rounding.sum / rounding.count as f64 } else { 0.0 };
            let mut matches = Matches { position_error: [mean, rounding.max], ..found.matches() };
            if tangents[family].0 != Tangents::Velocity {
                matches.velocity_factor = None;
            }
            families.push(FamilyTracks {
                matches,
                tracks: index.leaves().map(|leaf| leaf.sources).sum(),
                count: index.nodes.len() as u32,
                nodes,
                index: section,
                index_crc,
                flow: std::mem::take(&mut parts[family]),
            });
        }
        Ok((IntervalTracks { families }, found, on_disk))
    }

    /// Says which ids are repeated, and refuses what is mostly so.
    fn check_shared(&self, name: FamilyName, total: &Found, notes: &mut Vec<String>) -> Result<(), BuildError> {
        let Some(example) = total.shared else { return Ok(()) };
        let all = total.matched + total.vanished + total.changed;
        let path = &self.run.steps[self.steps[0].number].about.path;
        if self.tracks.matching != Matching::None && total.ambiguous as f64 > MOST_SHARED * all as f64 {
            let found = format!("{} of {all} that others have too, such as {example}", total.ambiguous);
            let expected = "ids of their own, or --match order, --match none or --stills-only";
            return Err(ImportError::malformed(path, format!("{name}: ids"), found, expected).into());
        }
        notes.push(format!(
            "{name}: up to {} ids are those of several particles at a step, such as {example}",
            total.shared_ids
        ));
        Ok(())
    }
}

/// The first step whose states are needed after an interval.
fn keep_from(interval: usize, by_differences: bool) -> usize {
    if by_differences { interval } else { interval + 1 }
}

fn is_new_in(families: &[(FamilyName, Vec<(String, Unit)>)], name: FamilyName) -> bool {
    families.iter().all(|(known, _)| *known != name)
}

/// A family has the same attributes at every step: what is derived at one may lack what it takes at another.
fn check_attributes(path: &Path, stream: &SourceStream, expected: &[(String, Unit)]) -> Result<(), BuildError> {
    let found = stream.all_attributes();
    if found.iter().map(|(name, _)| name).eq(expected.iter().map(|(name, _)| name)) {
        return Ok(());
    }
    let [found, expected] = [&found[..], expected].map(|attributes| {
        let names: Vec<&str> = attributes.iter().map(|(name, _)| name.as_str()).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    });
    let field = format!("{}: attributes", stream.family());
    Err(ImportError::malformed(path, field, found, format!("{expected}, as at other steps")).into())
}

fn missing_ids(path: &Path, name: FamilyName) -> BuildError {
    let file = path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
    let what = format!("{name}: ids: missing in {file}, expected ids, or --match order, or --stills-only");
    BuildError::Selection { path: path.to_owned(), what }
}
