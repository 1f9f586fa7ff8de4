//! The tracks of a run as a source: two rows for each, its states at both ends of its interval. They are those of particles, of the
//! clusters of a flow level, or of particles with the clusters that hold them.

use super::RunFile;
use super::flow::FlowTracks;
use super::kept::Kept;
use super::members::{MemberTracks, Wanted};
use super::track_layout::TrackFamily;
use super::tracks::TrackNode;
use crate::hierarchy::spacetime::{Interval, Tracks};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{Moment, PhysicalFactors, Unit};
use crate::store::error::StoreError;
use std::ops::Range;
use std::sync::Arc;

/// Whose tracks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PathsOf {
    /// Those of particles.
    #[default]
    Particles,
    /// Those of a flow level's clusters, from 1 on.
    Clusters(usize),
    /// Those of particles, with the tracks and clusters of a flow level that hold them.
    Members(usize),
}

impl PathsOf {
    fn level(self) -> Option<usize> {
        match self {
            PathsOf::Particles => None,
            PathsOf::Clusters(level) | PathsOf::Members(level) => Some(level),
        }
    }
}

/// Tracks over some intervals.
pub struct RunPaths {
    run: Arc<RunFile>,
    of: PathsOf,
    about: Description,
    families: Vec<FamilyPaths>,
    intervals: Vec<Interval>,
    first_interval: usize,
    kept: Kept<LeafPlace, Rows>,
    flows: Kept<LeafPlace, FlowTracks>,
}

/// Which leaf: interval (from the first on), family and number; of clusters, which have no leaves, which level.
type LeafPlace = (usize, usize, usize);

/// Tracks that are read together.
struct Rows {
    tracks: Tracks,
    /// What flow levels say of them: track, clusters at both ends, and of clusters how many particles they stand for.
    flow: Option<FlowColumns>,
}

struct FlowColumns {
    track: Vec<u32>,
    clusters: [Vec<u32>; 2],
    counts: Vec<u32>,
}

struct FamilyPaths {
    /// Its number in the run.
    number: usize,
    leaves: Vec<LeafPart>,
    about: Vec<Vec<TrackNode>>,
}

/// What is asked of a leaf.
struct LeafPart {
    /// Number of its first track that is asked for, in the family.
    first: u64,
    place: LeafPlace,
    /// Number of its first track in the interval.
    first_track: u64,
    /// The tracks that are asked for; all where it is `None`.
    rows: Option<Vec<u32>>,
    count: u64,
}

/// Columns beside attributes: name, kind, components.
const COLUMNS: [(&str, FieldKind, usize); 13] = [
    ("position", FieldKind::Position, 3),
    ("velocity", FieldKind::Velocity, 3),
    ("mass", FieldKind::Mass, 1),
    ("smoothing-length", FieldKind::SmoothingLength, 1),
    ("density", FieldKind::Density, 1),
    ("id", FieldKind::Id, 1),
    ("interval", FieldKind::Other, 1),
    ("track", FieldKind::Other, 1),
    ("u", FieldKind::Other, 1),
    ("tau", FieldKind::Other, 1),
    ("cluster", FieldKind::Other, 1),
    ("count", FieldKind::Other, 1),
    ("volume", FieldKind::Other, 1),
];

impl RunPaths {
    /// The tracks of all intervals that have more than a moment in common with the time from one moment to another.
    ///
    /// # Errors
    /// Where the run has no tracks or no such flow level, or their indices cannot be read or are damaged.
    pub fn open(run: Arc<RunFile>, of: PathsOf, from: Moment, to: Moment) -> Result<RunPaths, StoreError> {
        RunPaths::opened(run, of, from, to, None)
    }

    /// The same of certain particles alone; clusters are no particles, and come all of them.
    ///
    /// # Errors
    /// As [`RunPaths::open`].
    pub fn of_members(
        run: Arc<RunFile>,
        of: PathsOf,
        from: Moment,
        to: Moment,
        wanted: Wanted<'_>,
    ) -> Result<RunPaths, StoreError> {
        RunPaths::opened(run, of, from, to, Some(wanted))
    }

    fn opened(
        run: Arc<RunFile>,
        of: PathsOf,
        from: Moment,
        to: Moment,
        wanted: Option<Wanted<'_>>,
    ) -> Result<RunPaths, StoreError> {
        let layout = run.tracks()?;
        let levels = layout.flow_errors.len();
        if let Some(level) = of.level().filter(|level| !(1..=levels).contains(level)) {
            return Err(StoreError::NoFlowLevel { path: run.path().to_path_buf(), level, levels });
        }
        let end = if to.u > 0.0 { to.step + 1 } else { to.step };
        let range = from.step..end.min(run.directory().intervals.len());
        let intervals = range.clone().map(|interval| run.interval(interval)).collect::<Result<Vec<_>, _>>()?;
        let mut about = Description {
            length_unit: run.directory().length_unit.clone(),
            mass_unit: run.directory().mass_unit.clone(),
            ..Description::unitless(run.path(), "deepfield-run", run.bytes())
        };
        // By interval and family: leaves, and which of their tracks.
        let mut rows: Vec<Vec<Vec<(u32, Vec<u32>)>>> = Vec::new();
        if let Some(wanted) = wanted {
            let mut before: Option<MemberTracks> = None;
            for interval in range.clone() {
                let mut members = match &before {
                    Some(before) => run.carry_members(before, wanted)?,
                    None => run.find_members(interval, wanted)?,
                };
                rows.push(members.families.iter_mut().map(|family| std::mem::take(&mut family.rows)).collect());
                before = Some(members);
            }
        }
        let mut families = Vec::new();
        for (number, info) in layout.families.iter().enumerate() {
            let mut nodes: Vec<Vec<TrackNode>> = Vec::with_capacity(intervals.len());
            let (mut leaves, mut first) = (Vec::new(), 0);
            for (interval, step) in range.clone().enumerate() {
                if let PathsOf::Clusters(level) = of {
                    let (tracks, _) = run.family_tracks(step, number)?.flow.levels[level - 1];
                    let count = u64::from(tracks);
                    if count > 0 {
                        leaves.push(LeafPart {
                            first,
                            place: (interval, number, level),
                            first_track: 0,
                            rows: None,
                            count,
                        });
                    }
                    first += count;
                    nodes.push(Vec::new());
                    continue;
                }
                let index = run.track_index(step, number)?;
                let mut first_track = 0;
                let own = rows.get_mut(interval).and_then(|families| families.get_mut(number));
                let mut members = own.map(std::mem::take).unwrap_or_default().into_iter().peekable();
                for (leaf, known) in index.leaves().enumerate() {
                    let own = members.next_if(|(other, _)| *other as usize == leaf).map(|(_, rows)| rows);
                    let count = match &own {
                        Some(rows) => rows.len() as u64,
                        None if wanted.is_some() => 0,
                        None => u64::from(known.tracks),
                    };
                    if count > 0 {
                        leaves.push(LeafPart { first, place: (interval, number, leaf), first_track, rows: own, count });
                    }
                    first += count;
                    first_track += u64::from(known.tracks);
                }
                nodes.push(index.leaves().cloned().collect());
            }
            // Who asks for ids that nobody has is told that there are none of them.
            if first > 0 || wanted.is_some() {
                about.families.push(described(info, of, 2 * first, &about));
                let about = nodes;
                families.push(FamilyPaths { number, leaves, about });
            }
        }
        let (kept, flows) = (Kept::default(), Kept::default());
        Ok(RunPaths { about, of, families, intervals, first_interval: range.start, kept, flows, run })
    }

    /// What positions and velocities are multiplied with in the physical frame, by the values of the clock at the steps, which rise. `None`
    /// where the steps do not say enough.
    pub fn physical(&self) -> Option<Vec<(f64, PhysicalFactors)>> {
        let directory = self.run.directory();
        let clock = directory.tracks.as_ref()?.clock.iter().enumerate();
        let factors = |(step, tau): (usize, &f64)| {
            Some((*tau, PhysicalFactors::of_tracks(&self.run.epoch(step)?, directory.clock)?))
        };
        clock.map(factors).collect()
    }

    /// A flow level of a family over an interval.
    fn flow(&self, (interval, family, level): LeafPlace) -> Result<Arc<FlowTracks>, StoreError> {
        let read = || self.run.flow_tracks(self.first_interval + interval, family, level);
        self.flows.get((interval, family, level), read)
    }

    /// Tracks that are read together.
    fn leaf(&self, family: &FamilyPaths, place: LeafPlace) -> Result<Arc<Rows>, StoreError> {
        let (interval, _, leaf) = place;
        let number = self.first_interval + interval;
        self.kept.get(place, || {
            if let PathsOf::Clusters(_) = self.of {
                let FlowTracks { tracks, counts, clusters, .. } = self.run.flow_tracks(number, family.number, leaf)?;
                let track = (0..counts.len() as u32).collect();
                return Ok(Rows { tracks, flow: Some(FlowColumns { track, clusters, counts }) });
            }
            let about = &family.about[interval][leaf];
            let tracks = self.run.node_tracks(number, family.number, about, true)?;
            let PathsOf::Members(level) = self.of else { return Ok(Rows { tracks, flow: None }) };
            let mut track = self.run.leaf_flow(number, family.number, about)?;
            for coarser in 2..=level {
                let flow = self.flow((interval, family.number, coarser))?;
                // The one whose children it is among; each is among those of one.
                let parent = |own: &mut u32| *own = flow.children.partition_point(|first| first <= own) as u32 - 1;
                track.iter_mut().for_each(parent);
            }
            let flow = self.flow((interval, family.number, level))?;
            let clusters = [0, 1].map(|end| track.iter().map(|own| flow.clusters[end][*own as usize]).collect());
            Ok(Rows { tracks, flow: Some(FlowColumns { track, clusters, counts: Vec::new() }) })
        })
    }

    /// Hands every row of a range to `put`: its place in the range, the leaf's place, its tracks, the first one's number in the interval,
    /// which of them, and which end.
    fn rows(&self, family: usize, range: Range<u64>, mut put: impl FnMut(usize, &Row)) -> Result<(), ImportError> {
        let own = &self.families[family];
        let damaged = |error: StoreError| {
            let expected = "tracks as they were written";
            ImportError::malformed(self.run.path(), "tracks", error.to_string(), expected)
        };
        let mut row = range.start;
        while row < range.end {
            let number = own.leaves.partition_point(|leaf| leaf.first <= row / 2) - 1;
            let leaf = &own.leaves[number];
            let read = self.leaf(own, leaf.place).map_err(damaged)?;
            let end = range.end.min(2 * (leaf.first + leaf.count));
            let is_whole = leaf.rows.is_some() || read.tracks.len() as u64 == leaf.count;
            if end <= row || !is_whole {
                let expected = "as many tracks as the directory says";
                return Err(ImportError::malformed(self.run.path(), "tracks", "another number of them", expected));
            }
            for at in row..end {
                let i = (at / 2 - leaf.first) as usize;
                let i = leaf.rows.as_ref().map_or(i, |rows| rows[i] as usize);
                let row = Row {
                    tracks: &read.tracks,
                    flow: read.flow.as_ref(),
                    interval: leaf.place.0,
                    i,
                    track: leaf.first_track + i as u64,
                    end: (at % 2) as usize,
                };
                put((at - range.start) as usize, &row);
            }
            row = end;
        }
        Ok(())
    }
}

/// One end of a track.
struct Row<'a> {
    tracks: &'a Tracks,
    flow: Option<&'a FlowColumns>,
    interval: usize,
    i: usize,
    track: u64,
    end: usize,
}

/// What a family says of itself.
fn described(info: &TrackFamily, of: PathsOf, rows: u64, about: &Description) -> FamilyInfo {
    let unit = |kind| match kind {
        FieldKind::Position | FieldKind::SmoothingLength => about.length_unit.clone(),
        FieldKind::Mass => about.mass_unit.clone(),
        _ => Unit::default(),
    };
    let field = |name: &str, kind, unit, components| Field {
        name: name.into(),
        stored_as: name.into(),
        unit,
        components,
        kind,
    };
    let is_cluster = matches!(of, PathsOf::Clusters(_));
    let is_there = |name: &str| match name {
        "id" => info.has_ids && !is_cluster,
        "cluster" => of != PathsOf::Particles,
        "count" | "volume" => is_cluster,
        _ => true,
    };
    let columns = COLUMNS.into_iter().filter(|(name, ..)| is_there(name));
    let mut fields: Vec<Field> =
        columns.map(|(name, kind, components)| field(name, kind, unit(kind), components)).collect();
    fields.extend(info.attributes.iter().map(|(name, unit)| field(name, FieldKind::Other, unit.clone(), 1)));
    FamilyInfo { name: info.name, count: rows, fields }
}

impl Source for RunPaths {
    fn description(&self) -> &Description {
        &self.about
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let found = self.about.check_range(family, field, &range, out.len())?;
        let components = found.components;
        let attributes = self.about.families[family].fields[..field]
            .iter()
            .filter(|other| other.kind == FieldKind::Other && !COLUMNS.iter().any(|(name, ..)| *name == other.name))
            .count();
        let clock = |interval: usize, end: usize| {
            let layout = self.run.directory().tracks.as_ref();
            layout.and_then(|layout| layout.clock.get(self.first_interval + interval + end)).copied().unwrap_or(0.0)
        };
        self.rows(family, range, |at, row| {
            let Row { tracks, flow, interval, i, track, end } = *row;
            let own = &tracks.ends[end];
            let space = &self.intervals[interval];
            let out = &mut out[at * components..(at + 1) * components];
            match (found.kind, found.name.as_str()) {
                (FieldKind::Position, _) => out.copy_from_slice(&space.lattice.position(own.places[i])),
                (FieldKind::Velocity, _) => {
                    let unit = space.lattice.unit() / space.spans[end];
                    out.iter_mut().zip(own.movements[i]).for_each(|(out, v)| *out = v as f64 * unit);
                }
                (FieldKind::Mass, _) => out[0] = tracks.flags[i].weights()[end] * f64::from(own.mass[i]),
                (FieldKind::SmoothingLength, _) => out[0] = f64::from(own.smoothing_length[i]),
                (FieldKind::Density, _) => out[0] = f64::from(own.density[i]),
                (FieldKind::Id, _) => out[0] = tracks.ids[i] as f64,
                (_, "interval") => out[0] = (self.first_interval + interval) as f64,
                (_, "track") => out[0] = flow.map_or(track as f64, |flow| f64::from(flow.track[i])),
                (_, "cluster") => out[0] = flow.map_or(f64::NAN, |flow| f64::from(flow.clusters[end][i])),
                (_, "count") => out[0] = flow.map_or(f64::NAN, |flow| f64::from(flow.counts[i])),
                (_, "volume") => {
                    let density = f64::from(own.density[i]);
                    let mass = tracks.flags[i].weights()[end] * f64::from(own.mass[i]);
                    out[0] = if density > 0.0 { mass / density } else { 0.0 };
                }
                (_, "u") => out[0] = end as f64,
                (_, "tau") => out[0] = clock(interval, end),
                _ => out[0] = own.attributes.get(attributes).map_or(f64::NAN, |column| f64::from(column[i])),
            }
        })
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        self.about.check_range(family, field, &range, out.len())?;
        self.rows(family, range, |at, row| out[at] = row.tracks.ids[row.i])
    }
}
