//! A run at any moment as a source: what its tracks say between two steps, read as a snapshot is. Of all particles, of those that may be
//! in some place, or of some that are known.

use super::RunFile;
use super::kept::Kept;
use super::members::MemberTracks;
use super::track_layout::TrackFamily;
use super::tracks::TrackNode;
use crate::codec::AttributeMerge;
use crate::hierarchy::spacetime::{Interpolation, Interval, Moving};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{Moment, Unit, scale_factor_of};
use crate::store::error::StoreError;
use std::ops::Range;
use std::sync::Arc;

/// The particles of a run at a moment. Leaves are decoded as they are asked for, so a snapshot may be larger than memory.
pub struct RunSnapshot {
    run: Arc<RunFile>,
    about: Description,
    families: Vec<FamilySnapshot>,
    number: usize,
    interval: Interval,
    u: f64,
    kept: Kept<(usize, usize), Moving>,
    faded_mass: f64,
}

struct FamilySnapshot {
    /// Its number in the run.
    number: usize,
    leaves: Vec<TrackNode>,
    /// All that there is of it, where that is in memory; as if it were of one leaf.
    held: Option<Arc<Moving>>,
    /// The first row of each leaf that has some, and the leaf.
    starts: Vec<(u64, usize)>,
    interpolation: Interpolation,
    rules: Vec<AttributeMerge>,
    /// What velocities by the clock are multiplied with to be as the snapshots have them.
    velocity: f64,
}

/// Which of [`Moving`]'s columns a field is.
const COLUMNS: [(&str, FieldKind, usize); 6] = [
    ("position", FieldKind::Position, 3),
    ("velocity", FieldKind::Velocity, 3),
    ("mass", FieldKind::Mass, 1),
    ("smoothing-length", FieldKind::SmoothingLength, 1),
    ("density", FieldKind::Density, 1),
    ("id", FieldKind::Id, 1),
];

/// Which particles of a moment are asked for. Of a part, families without a particle stay, so that they can be named at any time.
enum Part<'a> {
    /// All of them.
    All,
    /// Those of the leaves of which this is so.
    Leaves(&'a dyn Fn(&TrackNode) -> bool),
    /// Those with these tracks.
    Members(&'a MemberTracks),
}

impl RunFile {
    /// The particles at a moment, as `interpolation` moves them between the steps around it. At a step that is where the tracks begin
    /// which go on from there; at the last one, where those end that came there.
    ///
    /// # Errors
    /// Where the run has no tracks, or they cannot be read or are damaged.
    pub fn at(self: &Arc<Self>, moment: Moment, interpolation: Interpolation) -> Result<RunSnapshot, StoreError> {
        self.part_at(moment, interpolation, Part::All)
    }

    /// The same of the leaves of tracks alone of which `keep` says so by what the index knows of them.
    ///
    /// # Errors
    /// As [`RunFile::at`].
    pub fn leaves_at(
        self: &Arc<Self>,
        moment: Moment,
        interpolation: Interpolation,
        keep: impl Fn(&TrackNode) -> bool,
    ) -> Result<RunSnapshot, StoreError> {
        self.part_at(moment, interpolation, Part::Leaves(&keep))
    }

    /// The same of particles whose tracks are known: those over the interval of [`RunFile::interval_at`].
    ///
    /// # Errors
    /// As [`RunFile::at`].
    pub fn members_at(
        self: &Arc<Self>,
        moment: Moment,
        interpolation: Interpolation,
        members: &MemberTracks,
    ) -> Result<RunSnapshot, StoreError> {
        self.part_at(moment, interpolation, Part::Members(members))
    }

    /// The interval that says where particles are at a moment, and the place in it: of the last step, the end of the last interval.
    pub fn interval_at(&self, moment: Moment) -> (usize, f64) {
        let last = self.directory().intervals.len();
        if moment.step >= last { (last.saturating_sub(1), 1.0) } else { (moment.step, moment.u) }
    }

    fn part_at(
        self: &Arc<Self>,
        moment: Moment,
        interpolation: Interpolation,
        part: Part<'_>,
    ) -> Result<RunSnapshot, StoreError> {
        let layout = self.tracks()?;
        let (number, u) = self.interval_at(moment);
        // What stands still at the last step is that step.
        let interpolation = match interpolation {
            Interpolation::Hold if u >= 1.0 => Interpolation::Hermite,
            other => other,
        };
        let interval = self.interval(number)?;
        let held = if interpolation == Interpolation::Hold { Moment { u: 0.0, ..moment } } else { moment };
        let time = self.time(held);
        let still = self.still(number)?;
        let redshift = self.redshift(held);
        let scale_factor = self.directory().is_comoving().then(|| redshift.and_then(scale_factor_of)).flatten();
        let factor = layout.velocity_factor(self.directory().clock, time, scale_factor);
        let mut about = Description {
            length_unit: self.directory().length_unit.clone(),
            mass_unit: self.directory().mass_unit.clone(),
            kernel: still.metadata().kernel,
            time: Some(time),
            redshift,
            scale_factor,
            cosmology: layout.cosmology,
            motion: layout.motion,
            box_size: self.directory().box_size,
            ..Description::unitless(self.path(), "deepfield-run", self.bytes())
        };
        let (mut families, mut faded_mass) = (Vec::new(), 0.0);
        for (family, info) in layout.families.iter().enumerate() {
            let interpolation = info.moved(interpolation);
            let velocity = 1.0 / (factor * info.velocity_scale);
            let rules = info.rules();
            let keep = match &part {
                Part::All => &|_: &TrackNode| true,
                Part::Leaves(keep) => *keep,
                Part::Members(members) => {
                    let mut moving = Moving::default();
                    let tracks = members.families.get(family).filter(|_| members.interval == number);
                    if let Some(own) = tracks {
                        own.tracks.at(&interval, u, interpolation, &rules, &mut moving);
                    }
                    moving.velocities.as_flattened_mut().iter_mut().for_each(|v| *v *= velocity);
                    let rows = moving.mass.len() as u64;
                    about.families.push(described(info, rows, &about));
                    let starts = if rows > 0 { vec![(0, 0)] } else { Vec::new() };
                    let (leaves, held) = (Vec::new(), Some(Arc::new(moving)));
                    families.push(FamilySnapshot {
                        number: family,
                        leaves,
                        held,
                        starts,
                        interpolation,
                        rules,
                        velocity,
                    });
                    continue;
                }
            };
            let leaves: Vec<TrackNode> =
                self.track_index(number, family)?.leaves().filter(|leaf| keep(leaf)).cloned().collect();
            let (mut starts, mut rows) = (Vec::with_capacity(leaves.len()), 0);
            for (leaf, known) in leaves.iter().enumerate() {
                let own = known.particles(u, interpolation);
                if own > 0 {
                    starts.push((rows, leaf));
                }
                rows += own;
                faded_mass += match interpolation {
                    Interpolation::Auto if u > 0.0 && u < 1.0 => known.faded_mass,
                    Interpolation::Fade if u > 0.0 && u < 1.0 => known.mass[0],
                    _ => 0.0,
                };
            }
            if rows > 0 || !matches!(part, Part::All) {
                about.families.push(described(info, rows, &about));
                families.push(FamilySnapshot {
                    number: family,
                    leaves,
                    held: None,
                    starts,
                    interpolation,
                    rules,
                    velocity,
                });
            }
        }
        let (run, kept) = (Arc::clone(self), Kept::default());
        Ok(RunSnapshot { run, about, families, number, interval, u, kept, faded_mass })
    }
}

impl RunSnapshot {
    /// The ids of all particles of a family, or their rows where they have none.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn ids(&self, family: usize) -> Result<Vec<u64>, ImportError> {
        let count = self.about.families.get(family).map_or(0, |info| info.count);
        let mut ids = vec![0; count as usize];
        self.rows(family, 0..count, |at, moving, rows| ids[at..at + rows.len()].copy_from_slice(&moving.ids[rows]))?;
        Ok(ids)
    }

    /// The ids of some particles of a family, by their rows, which rise; their rows in the sources where they have none.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn ids_of(&self, family: usize, rows: &[u64]) -> Result<Vec<u64>, ImportError> {
        let mut ids = Vec::with_capacity(rows.len());
        let mut rows = rows.iter().copied().peekable();
        while let Some(first) = rows.peek().copied() {
            let own = self.families.get(family).map_or(&[][..], |own| &own.starts);
            let next = own.partition_point(|(start, _)| *start <= first);
            let count = self.about.families.get(family).map_or(0, |info| info.count);
            let end = own.get(next).map_or(count, |(start, _)| *start);
            if first >= end {
                break;
            }
            self.rows(family, first..end, |_, moving, part| {
                while let Some(row) = rows.next_if(|row| *row < end) {
                    ids.extend(moving.ids.get(part.start + (row - first) as usize));
                }
            })?;
        }
        Ok(ids)
    }

    /// Mass of what fades from place to place.
    pub fn faded_mass(&self) -> f64 {
        self.faded_mass
    }

    /// A leaf's particles.
    fn leaf(&self, family: &FamilySnapshot, leaf: usize) -> Result<Arc<Moving>, StoreError> {
        if let Some(held) = &family.held {
            return Ok(Arc::clone(held));
        }
        self.kept.get((family.number, leaf), || {
            let about = &family.leaves[leaf];
            let tracks = self.run.node_tracks(self.number, family.number, about, true)?;
            let mut moving = Moving::default();
            tracks.at(&self.interval, self.u, family.interpolation, &family.rules, &mut moving);
            if moving.ids.len() as u64 != about.particles(self.u, family.interpolation) {
                let place = format!("interval {}, family {}, leaf {leaf}", self.number, family.number);
                return Err(self.run.damaged(place, "as many tracks that come, go and fade as its index says"));
            }
            moving.velocities.as_flattened_mut().iter_mut().for_each(|v| *v *= family.velocity);
            Ok(moving)
        })
    }

    /// Hands all rows of a range to `put`, some at a time: the place of the first one in the range, the leaf's particles, and which of
    /// them.
    fn rows(
        &self,
        family: usize,
        range: Range<u64>,
        mut put: impl FnMut(usize, &Moving, Range<usize>),
    ) -> Result<(), ImportError> {
        let own = &self.families[family];
        let mut row = range.start;
        while row < range.end {
            let (first, leaf) = own.starts[own.starts.partition_point(|(first, _)| *first <= row) - 1];
            let moving = self.leaf(own, leaf).map_err(|error| {
                ImportError::malformed(self.run.path(), "tracks", error.to_string(), "tracks as they were written")
            })?;
            let end = range.end.min(first + moving.ids.len() as u64);
            put((row - range.start) as usize, &moving, (row - first) as usize..(end - first) as usize);
            row = end;
        }
        Ok(())
    }
}

/// What a family says of itself.
fn described(info: &TrackFamily, rows: u64, about: &Description) -> FamilyInfo {
    let unit = |kind| match kind {
        FieldKind::Position | FieldKind::SmoothingLength => about.length_unit.clone(),
        FieldKind::Mass => about.mass_unit.clone(),
        FieldKind::Velocity => info.velocity_unit.clone(),
        _ => Unit::default(),
    };
    let has_ids = |kind| kind != FieldKind::Id || info.has_ids;
    let columns = COLUMNS.into_iter().filter(|(_, kind, _)| has_ids(*kind));
    let mut fields: Vec<Field> = columns
        .map(|(name, kind, components)| Field {
            name: name.into(),
            stored_as: name.into(),
            unit: unit(kind),
            components,
            kind,
        })
        .collect();
    fields.extend(info.attributes.iter().map(|(name, unit)| Field {
        name: name.clone(),
        stored_as: name.clone(),
        unit: unit.clone(),
        components: 1,
        kind: FieldKind::Other,
    }));
    FamilyInfo { name: info.name, count: rows, fields }
}

impl Source for RunSnapshot {
    fn description(&self) -> &Description {
        &self.about
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let found = self.about.check_range(family, field, &range, out.len())?;
        let components = found.components;
        let before = self.about.families[family].fields[..field].iter();
        let attribute = before.filter(|field| field.kind == FieldKind::Other).count();
        self.rows(family, range, |at, moving, rows| {
            let out = &mut out[at * components..(at + rows.len()) * components];
            let column = match found.kind {
                FieldKind::Position => return out.copy_from_slice(moving.positions[rows].as_flattened()),
                FieldKind::Velocity => return out.copy_from_slice(moving.velocities[rows].as_flattened()),
                FieldKind::Id => {
                    return out.iter_mut().zip(&moving.ids[rows]).for_each(|(out, id)| *out = *id as f64);
                }
                FieldKind::Mass => &moving.mass,
                FieldKind::SmoothingLength => &moving.smoothing_length,
                FieldKind::Density => &moving.density,
                FieldKind::Other => &moving.attributes[attribute],
            };
            out.iter_mut().zip(&column[rows]).for_each(|(out, value)| *out = f64::from(*value));
        })
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        self.about.check_range(family, field, &range, out.len())?;
        self.rows(family, range, |at, moving, rows| out[at..at + rows.len()].copy_from_slice(&moving.ids[rows]))
    }
}
