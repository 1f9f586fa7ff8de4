//! Tracks of one family over one interval: both states of each particle, and where and what it is in between.

use super::lattice::Lattice;
use super::spline::HermiteSpline;
use crate::codec::AttributeMerge;
use crate::model::Bounds;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What is known of a track beside its states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TrackFlags(pub u8);

impl TrackFlags {
    /// It is not in the family at the beginning: its weight rises from 0 to 1.
    pub const COMES: u8 = 1;
    /// It is not in the family at the end: its weight falls to 0.
    pub const GOES: u8 = 2;
    /// Its steps are too far apart for a spline: it fades from its first place to its last.
    pub const FADES: u8 = 4;
    /// All of them.
    pub const ALL: u8 = 7;

    /// Whether all of `flags` are set.
    pub fn has(self, flags: u8) -> bool {
        self.0 & flags == flags
    }

    /// Which of three kinds it is counted in: those that come, those that go, and those that fade and do neither.
    pub fn kind(self) -> Option<usize> {
        match () {
            () if self.has(Self::COMES) => Some(0),
            () if self.has(Self::GOES) => Some(1),
            () if self.has(Self::FADES) => Some(2),
            () => None,
        }
    }

    /// The weights at both ends, 0 or 1.
    pub fn weights(self) -> [f64; 2] {
        [Self::COMES, Self::GOES].map(|flag| if self.has(flag) { 0.0 } else { 1.0 })
    }
}

/// How particles move between steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Along splines, fading where steps are too far apart for them.
    #[default]
    Auto,
    /// Along cubic Hermite splines (F12 equation 6.1), all of them.
    Hermite,
    /// Along straight lines.
    Linear,
    /// Not at all: each particle fades from its first place to its last.
    Fade,
    /// Not at all: the step before is shown.
    Hold,
}

impl Interpolation {
    /// Each of them.
    pub const ALL: [Interpolation; 5] =
        [Interpolation::Auto, Interpolation::Hermite, Interpolation::Linear, Interpolation::Fade, Interpolation::Hold];

    /// Its word on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Interpolation::Auto => "auto",
            Interpolation::Hermite => "hermite",
            Interpolation::Linear => "linear",
            Interpolation::Fade => "fade",
            Interpolation::Hold => "hold",
        }
    }
}

impl std::str::FromStr for Interpolation {
    type Err = String;

    fn from_str(text: &str) -> Result<Interpolation, String> {
        let found = Interpolation::ALL.into_iter().find(|known| known.name() == text);
        found.ok_or_else(|| "expected auto, hermite, linear, fade or hold".into())
    }
}

/// The quantities of tracks at one end, a value for each track.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackEnd {
    /// Coordinates on the [`Lattice`]; at the end that of the image that the track reaches, which may lie beyond a face of the box.
    pub places: Vec<[i64; 3]>,
    /// Velocities as movements on the lattice ([`Lattice::movement`]).
    pub movements: Vec<[i64; 3]>,
    /// Masses.
    pub mass: Vec<f32>,
    /// Densities.
    pub density: Vec<f32>,
    /// Smoothing lengths.
    pub smoothing_length: Vec<f32>,
    /// Attributes.
    pub attributes: Vec<Vec<f32>>,
}

/// Tracks, in columns of one length. What is missing at one end has the values of the other there, and goes on along its velocity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// The particles' ids.
    pub ids: Vec<u64>,
    /// What else is known of each.
    pub flags: Vec<TrackFlags>,
    /// Both ends.
    pub ends: [TrackEnd; 2],
}

/// The interval that tracks are on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// What coordinates are.
    pub lattice: Lattice,
    /// Its length, in the clock's unit.
    pub length: f64,
    /// The spans of movements at both ends: the longer ones of the intervals that adjoin the steps.
    pub spans: [f64; 2],
    /// The edge of the periodic box, whose corner is the origin.
    pub box_size: Option<f64>,
}

/// Particles at a moment, in columns of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moving {
    /// Their ids.
    pub ids: Vec<u64>,
    /// World positions.
    pub positions: Vec<[f64; 3]>,
    /// Velocities, world units by the clock's.
    pub velocities: Vec<[f64; 3]>,
    /// Masses, by the particle's weight at that moment.
    pub mass: Vec<f32>,
    /// Densities.
    pub density: Vec<f32>,
    /// Smoothing lengths.
    pub smoothing_length: Vec<f32>,
    /// Attributes.
    pub attributes: Vec<Vec<f32>>,
}

impl Interval {
    /// The spline of a track, world units.
    pub fn spline(&self, tracks: &Tracks, i: usize) -> HermiteSpline {
        let [begin, end] = &tracks.ends;
        self.spline_of([begin.places[i], end.places[i]], [begin.movements[i], end.movements[i]])
    }

    /// The spline between two states on the lattice, world units.
    pub fn spline_of(&self, places: [[i64; 3]; 2], movements: [[i64; 3]; 2]) -> HermiteSpline {
        let unit = self.lattice.unit();
        HermiteSpline {
            positions: places.map(|place| DVec3::from(self.lattice.position(place))),
            tangents: [0, 1].map(|end| {
                let movement = DVec3::from(movements[end].map(|v| v as f64));
                movement * (unit * self.length / self.spans[end])
            }),
        }
    }

    /// How many edges of the periodic box so many units of the lattice are; `None` where that is no whole number.
    pub(super) fn edges(&self, units: i64) -> Option<i64> {
        if units == 0 {
            return Some(0);
        }
        let edge = (self.box_size? / self.lattice.unit()).round() as i64;
        (edge > 0 && units % edge == 0).then(|| units / edge)
    }

    /// Where what moves within these bounds may be drawn: what leaves a periodic box comes in again on the other side.
    pub fn in_box(&self, bounds: Bounds) -> Bounds {
        let Some(edge) = self.box_size else { return bounds };
        let sticks_out = bounds.min.cmplt(DVec3::ZERO) | bounds.max.cmpge(DVec3::splat(edge));
        Bounds {
            min: DVec3::select(sticks_out, DVec3::ZERO, bounds.min),
            max: DVec3::select(sticks_out, DVec3::splat(edge), bounds.max),
        }
    }

    /// A position where it lies in the box.
    fn wrapped(&self, position: DVec3) -> DVec3 {
        match self.box_size {
            Some(edge) => position.map(|x| {
                let inside = x - edge * (x / edge).floor();
                // A tiny negative number is rounded to the edge.
                if inside < edge { inside } else { 0.0 }
            }),
            None => position,
        }
    }
}

impl Tracks {
    /// Tracks without a particle, with so many attributes.
    pub fn new(attributes: usize) -> Tracks {
        let end = || TrackEnd { attributes: vec![Vec::new(); attributes], ..TrackEnd::default() };
        Tracks { ends: [end(), end()], ..Tracks::default() }
    }

    /// Appends some tracks of others with as many attributes, by their numbers there; ids where those have them.
    pub fn extend_from(&mut self, other: &Tracks, rows: &[u32]) {
        let rows = || rows.iter().map(|row| *row as usize);
        if !other.ids.is_empty() {
            self.ids.extend(rows().map(|row| other.ids[row]));
        }
        self.flags.extend(rows().map(|row| other.flags[row]));
        for (own, other) in self.ends.iter_mut().zip(&other.ends) {
            own.places.extend(rows().map(|row| other.places[row]));
            own.movements.extend(rows().map(|row| other.movements[row]));
            let columns = [
                (&mut own.mass, &other.mass),
                (&mut own.density, &other.density),
                (&mut own.smoothing_length, &other.smoothing_length),
            ];
            for (own, other) in columns.into_iter().chain(own.attributes.iter_mut().zip(&other.attributes)) {
                own.extend(rows().map(|row| other[row]));
            }
        }
    }

    /// Number of tracks.
    pub fn len(&self) -> usize {
        self.flags.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.flags.is_empty()
    }

    /// Appends the particles as they are at `u` of the interval, from 0 to 1; what has no weight then is left out. `rules` says of each
    /// attribute how it is averaged.
    pub fn at(
        &self,
        interval: &Interval,
        u: f64,
        interpolation: Interpolation,
        rules: &[AttributeMerge],
        out: &mut Moving,
    ) {
        let u = if interpolation == Interpolation::Hold { 0.0 } else { u };
        out.attributes.resize_with(rules.len(), Vec::new);
        for i in 0..self.len() {
            let flags = self.flags[i];
            let weights = flags.weights();
            let shares = [(1.0 - u) * weights[0], u * weights[1]];
            let spline = interval.spline(self, i);
            if self.fades(i, interpolation) && u > 0.0 && u < 1.0 {
                for end in [0, 1].into_iter().filter(|end| shares[*end] > 0.0) {
                    let velocity = spline.tangents[end] / interval.length;
                    let mass = shares[end] * f64::from(self.ends[end].mass[i]);
                    self.put(i, end as f64, rules, out);
                    out.place(interval.wrapped(spline.positions[end]), velocity, mass);
                }
                continue;
            }
            let mass = shares[0] * f64::from(self.ends[0].mass[i]) + shares[1] * f64::from(self.ends[1].mass[i]);
            if shares[0] + shares[1] <= 0.0 {
                continue;
            }
            let (position, velocity) = match interpolation {
                Interpolation::Linear => {
                    let [begin, end] = spline.positions;
                    (begin + u * (end - begin), (end - begin) / interval.length)
                }
                _ => (spline.position(u), spline.derivative(u) / interval.length),
            };
            self.put(i, u, rules, out);
            out.place(interval.wrapped(position), velocity, mass);
        }
    }

    /// How many particles [`Tracks::drawn_at`] gives, at any time.
    pub fn drawn(&self, interpolation: Interpolation) -> usize {
        self.len() + (0..self.len()).filter(|i| self.fades(*i, interpolation)).count()
    }

    /// Whether a track fades from its first place to its last.
    pub(super) fn fades(&self, i: usize, interpolation: Interpolation) -> bool {
        match interpolation {
            Interpolation::Auto => self.flags[i].has(TrackFlags::FADES),
            Interpolation::Fade => true,
            Interpolation::Hermite | Interpolation::Linear | Interpolation::Hold => false,
        }
    }

    /// The particles as they are at `u` of the interval, from 0 to 1, for pictures: as [`Tracks::at`] has them, but always as many, some
    /// without mass, and without ids and velocities. Those that fade are at their first place, and once more at their last behind all
    /// others. Only some of them where `which` has their numbers, each below [`Tracks::drawn`].
    pub fn drawn_at(
        &self,
        interval: &Interval,
        u: f64,
        interpolation: Interpolation,
        rules: &[AttributeMerge],
        which: Option<&[u32]>,
    ) -> Moving {
        // What stands still at the last step is that step.
        let u = if interpolation == Interpolation::Hold && u < 1.0 { 0.0 } else { u };
        let fades = |i: usize| self.fades(i, interpolation);
        let twice: Vec<u32> = (0..self.len()).filter(|i| fades(*i)).map(|i| i as u32).collect();
        // Each track, and where it is looked at: on its way, or at one of its ends.
        let place = |number: usize| match number.checked_sub(self.len()) {
            Some(second) => (twice[second] as usize, Some(1)),
            None => (number, fades(number).then_some(0)),
        };
        let drawn: Vec<(usize, Option<usize>)> = match which {
            Some(which) => which.iter().map(|number| place(*number as usize)).collect(),
            None => (0..self.len() + twice.len()).map(place).collect(),
        };
        let position = |&(i, end): &(usize, Option<usize>)| {
            let at = |end: usize| DVec3::from(interval.lattice.position(self.ends[end].places[i]));
            let position = match (end, interpolation) {
                (Some(end), _) => at(end),
                (None, Interpolation::Linear) => at(0) + u * (at(1) - at(0)),
                (None, _) => interval.spline(self, i).position(u),
            };
            interval.wrapped(position).to_array()
        };
        let mass = |&(i, end): &(usize, Option<usize>)| {
            let [first, last] = self.flags[i].weights();
            let shares = [((1.0 - u) * first) as f32, (u * last) as f32];
            let of = |end: usize| shares[end] * self.ends[end].mass[i];
            end.map_or_else(|| of(0) + of(1), of)
        };
        let column = |of: &dyn Fn(&TrackEnd) -> &[f32], is_log: bool| -> Vec<f32> {
            let ends = [of(&self.ends[0]), of(&self.ends[1])];
            let value = |&(i, end): &(usize, Option<usize>)| match end {
                Some(end) => ends[end][i],
                None => between(ends[0][i], ends[1][i], u, is_log),
            };
            drawn.iter().map(value).collect()
        };
        let attribute =
            |(k, rule): (usize, &AttributeMerge)| column(&|end| &end.attributes[k], *rule != AttributeMerge::Magnitude);
        Moving {
            ids: Vec::new(),
            velocities: Vec::new(),
            positions: drawn.iter().map(position).collect(),
            mass: drawn.iter().map(mass).collect(),
            density: column(&|end| &end.density, true),
            smoothing_length: column(&|end| &end.smoothing_length, true),
            attributes: rules.iter().enumerate().map(attribute).collect(),
        }
    }

    /// Appends what changes along a track, but for its place and mass.
    fn put(&self, i: usize, u: f64, rules: &[AttributeMerge], out: &mut Moving) {
        let [begin, end] = &self.ends;
        out.ids.push(self.ids.get(i).copied().unwrap_or(0));
        out.density.push(between(begin.density[i], end.density[i], u, true));
        out.smoothing_length.push(between(begin.smoothing_length[i], end.smoothing_length[i], u, true));
        for (k, (column, rule)) in out.attributes.iter_mut().zip(rules).enumerate() {
            let is_log = *rule != AttributeMerge::Magnitude;
            column.push(between(begin.attributes[k][i], end.attributes[k][i], u, is_log));
        }
    }
}

impl Moving {
    fn place(&mut self, position: DVec3, velocity: DVec3, mass: f64) {
        self.positions.push(position.to_array());
        self.velocities.push(velocity.to_array());
        self.mass.push(mass as f32);
    }
}

/// A value between those of both ends: linear in the logarithm where `is_log` and both are positive, else linear; exactly theirs at 0
/// and 1, and never outside of them.
fn between(begin: f32, end: f32, u: f64, is_log: bool) -> f32 {
    if u <= 0.0 || begin == end {
        return begin;
    }
    if u >= 1.0 {
        return end;
    }
    let share = u as f32;
    let value = if is_log && begin > 0.0 && end > 0.0 {
        begin * (share * (end / begin).ln()).exp()
    } else {
        begin * (1.0 - share) + share * end
    };
    value.clamp(begin.min(end), begin.max(end))
}
