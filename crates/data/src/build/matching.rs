//! Who is who at two steps: the states of a bucket of ids, joined to tracks.

use super::states::{State, StateLayout};
use crate::hierarchy::spacetime::lattice::Lattice;
use crate::hierarchy::spacetime::{HermiteSpline, TrackFlags, chord, difference_at};
use crate::store::run::{Matches, Tangents};
use glam::DVec3;
use std::cmp::Ordering;

/// Words of a track before its values.
const FIXED: usize = 24;
/// Where the numbers of its ends are.
const NUMBERS: usize = 22;
/// The number of nobody.
pub(super) const NOBODY: u32 = u32::MAX;
/// Pairs of particles with one id that are compared at most; beyond that none of them is matched.
const MOST_PAIRS: usize = 1 << 14;

/// A track on its way to the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrackRecord<'a> {
    pub id: u64,
    pub family: usize,
    pub flags: TrackFlags,
    /// How badly velocities account for the displacement ([`HermiteSpline::unresolved`]).
    pub unresolved: f32,
    pub places: [[i64; 3]; 2],
    /// `dx/dtau` at both ends.
    pub velocities: [[f32; 3]; 2],
    /// The particle's numbers in its bucket of ids at both steps; [`NOBODY`] where it is not there. Where flow levels are built, the first
    /// one becomes that of its cluster at the beginning, and then of its track of the finest level.
    pub numbers: [u32; 2],
    /// Mass, density, smoothing length, then attributes at both ends.
    pub values: [&'a [f32]; 2],
}

/// Words of a record with so many attributes.
pub(super) fn track_words(layout: &StateLayout) -> usize {
    // A state's words without its id, family, place and velocity.
    FIXED + 2 * (layout.words - 12)
}

impl TrackRecord<'_> {
    /// Reads a record.
    #[inline]
    pub fn of(record: &[u32]) -> TrackRecord<'_> {
        let (begin, end) = record[FIXED..].split_at((record.len() - FIXED) / 2);
        let long = |at: usize| u64::from(record[at]) | u64::from(record[at + 1]) << 32;
        let place = |at: usize| std::array::from_fn(|axis| long(at + 2 * axis) as i64);
        let velocity = |at: usize| std::array::from_fn(|axis| f32::from_bits(record[at + axis]));
        TrackRecord {
            id: long(0),
            family: (record[2] & 0xff_ffff) as usize,
            flags: TrackFlags((record[2] >> 24) as u8),
            unresolved: f32::from_bits(record[3]),
            places: [place(4), place(10)],
            velocities: [velocity(16), velocity(19)],
            numbers: [record[NUMBERS], record[NUMBERS + 1]],
            values: [begin, end].map(bytemuck::cast_slice),
        }
    }

    /// Gives the beginning another number.
    pub fn set_number(record: &mut [u32], number: u32) {
        record[NUMBERS] = number;
    }

    /// Everything of a record but its numbers.
    pub fn content(record: &[u32]) -> (&[u32], &[u32]) {
        (&record[..NUMBERS], &record[FIXED..])
    }

    fn put(&self, out: &mut Vec<u32>) {
        let long = |value: u64| [value as u32, (value >> 32) as u32];
        out.extend(long(self.id));
        out.push(self.family as u32 | u32::from(self.flags.0) << 24);
        out.push(self.unresolved.to_bits());
        self.places.as_flattened().iter().for_each(|x| out.extend(long(*x as u64)));
        out.extend(self.velocities.as_flattened().iter().map(|v| v.to_bits()));
        out.extend(self.numbers);
        self.values.into_iter().for_each(|values| out.extend_from_slice(bytemuck::cast_slice(values)));
    }
}

/// What is found by joining, of one family.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Found {
    pub matched: u64,
    pub born: u64,
    pub vanished: u64,
    pub changed: u64,
    pub ambiguous: u64,
    /// Ids that several particles share at the beginning, and the smallest of them.
    pub shared_ids: u64,
    pub shared: Option<u64>,
    pub crossing: u64,
    /// Mass of what is matched, and of what of it is unresolved.
    pub mass: [f64; 2],
    /// Sums of `dx.w` and `w.w`.
    pub products: [f64; 2],
}

impl Found {
    pub fn with(self, other: Found) -> Found {
        Found {
            matched: self.matched + other.matched,
            born: self.born + other.born,
            vanished: self.vanished + other.vanished,
            changed: self.changed + other.changed,
            ambiguous: self.ambiguous + other.ambiguous,
            shared_ids: self.shared_ids + other.shared_ids,
            shared: self.shared.into_iter().chain(other.shared).min(),
            crossing: self.crossing + other.crossing,
            mass: [0, 1].map(|k| self.mass[k] + other.mass[k]),
            products: [0, 1].map(|k| self.products[k] + other.products[k]),
        }
    }

    /// How much longer displacements are than velocities say; `None` where nothing is known to move.
    pub fn velocity_factor(&self) -> Option<f64> {
        let [along, own] = self.products;
        (own > 0.0).then(|| along / own).filter(|factor| factor.is_finite())
    }

    /// What the directory says of it.
    pub fn matches(&self) -> Matches {
        Matches {
            matched: self.matched,
            born: self.born,
            vanished: self.vanished,
            changed: self.changed,
            ambiguous: self.ambiguous,
            crossing: self.crossing,
            unresolved: if self.mass[0] > 0.0 { self.mass[1] / self.mass[0] } else { 0.0 },
            velocity_factor: self.velocity_factor(),
            ..Matches::default()
        }
    }
}

/// Shares of displacement that velocities do not account for above which a track is unresolved.
pub(super) const UNRESOLVED: f32 = 0.25;

/// How the states of an interval are joined.
#[derive(Clone, Debug)]
pub(super) struct Joining<'a> {
    pub layout: &'a StateLayout,
    /// Whether anybody is matched at all.
    pub is_matching: bool,
    /// The clock at the step before, at both ends, and at the step after; what there is no step for is `NaN`.
    pub clock: [f64; 4],
    /// The spans of movements at both ends.
    pub spans: [f64; 2],
    /// Edge of the periodic box in units of the lattice.
    pub edge: Option<i64>,
    /// Of each family: where tangents come from, and what velocities are multiplied with.
    pub tangents: &'a [(Tangents, f64)],
}

/// The states of one bucket at the four steps around an interval: at both ends, and where tangents are differences before and after.
pub(super) type Window = [Vec<u32>; 4];

/// A state, with the place and the velocity that its track has there.
#[derive(Clone, Copy)]
struct Known<'a> {
    state: State<'a>,
    place: [i64; 3],
    velocity: DVec3,
}

impl<'a> Known<'a> {
    fn new(joining: &Joining, state: State<'a>, velocity: DVec3) -> Known<'a> {
        Known { state, place: state.place, velocity }.within(joining, state.smoothing_length())
    }

    /// The same as exactly as particles with this smoothing length are placed.
    fn within(self, joining: &Joining, smoothing_length: f32) -> Known<'a> {
        let exponent = joining.layout.lattice.exponent(smoothing_length);
        Known { place: Lattice::settled(self.state.place, exponent), ..self }
    }
}

/// What is known of one id at both ends of the interval; kept from id to id, so that none asks for memory.
#[derive(Default)]
struct Scratch<'a> {
    begin: Vec<Known<'a>>,
    end: Vec<Known<'a>>,
    pair_of: Vec<Option<usize>>,
    taken: Vec<bool>,
}

/// The records of a step by their ids, and of one id by everything that they hold: the id, and which record it is.
fn sorted(records: &[u32], words: usize) -> Vec<(u64, u32)> {
    let of = |i: u32| &records[i as usize * words..(i as usize + 1) * words];
    let id = |record: &[u32]| u64::from(record[0]) | u64::from(record[1]) << 32;
    let mut order: Vec<(u64, u32)> = records.chunks_exact(words).map(id).zip(0..).collect();
    order.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| of(a.1)[2..].cmp(&of(b.1)[2..])));
    order
}

impl Joining<'_> {
    /// The tracks of a bucket as records, and what was found of each family.
    pub fn join(&self, window: &Window) -> (Vec<u32>, Vec<Found>) {
        let words = self.layout.words;
        let orders: Vec<Vec<(u64, u32)>> = window.iter().map(|records| sorted(records, words)).collect();
        let state = |step: usize, at: usize| {
            let i = orders[step][at].1 as usize;
            State { number: at as u32, ..State::of(&window[step][i * words..(i + 1) * words]) }
        };
        let mut out = Vec::with_capacity(track_words(self.layout) * orders[1].len().max(orders[2].len()));
        let mut found = vec![Found::default(); self.layout.families.len()];
        let mut at = [0; 4];
        let group = |step: usize, at: &mut usize, id: u64| {
            let own = &orders[step][*at..];
            let begin = *at + own.iter().take_while(|entry| entry.0 < id).count();
            *at = begin + orders[step][begin..].iter().take_while(|entry| entry.0 == id).count();
            begin..*at
        };
        let mut all: [Vec<State>; 4] = Default::default();
        let mut scratch = Scratch::default();
        loop {
            let next = |step: usize| orders[step].get(at[step]).map(|entry| entry.0);
            let Some(id) = [next(1), next(2)].into_iter().flatten().min() else { break };
            for (step, states) in all.iter_mut().enumerate() {
                states.clear();
                states.extend(group(step, &mut at[step], id).map(|at| state(step, at)));
            }
            self.of_one_id(&all, &mut scratch, &mut out, &mut found);
        }
        (out, found)
    }

    /// Everything that has one id.
    fn of_one_id<'s>(
        &self,
        all: &[Vec<State<'s>>; 4],
        scratch: &mut Scratch<'s>,
        out: &mut Vec<u32>,
        found: &mut [Found],
    ) {
        let Scratch { begin, end, pair_of, taken } = scratch;
        for (step, known) in [(1, &mut *begin), (2, &mut *end)] {
            known.clear();
            known.extend(all[step].iter().map(|state| Known::new(self, *state, self.velocity(all, step, state))));
        }
        if begin.len() > 1 || end.len() > 1 {
            for known in &*begin {
                let own = &mut found[known.state.family];
                own.ambiguous += 1;
                own.shared = own.shared.into_iter().chain([known.state.id]).min();
            }
        }
        if let (true, Some(first)) = (begin.len() > 1, begin.first()) {
            found[first.state.family].shared_ids += 1;
        }
        pair_of.clear();
        pair_of.resize(begin.len(), None);
        taken.clear();
        taken.resize(end.len(), false);
        if !self.is_matching {
            // Each step stands for itself.
        } else if let ([_], [_]) = (&begin[..], &end[..]) {
            (pair_of[0], taken[0]) = (Some(0), true);
        } else if begin.len() * end.len() <= MOST_PAIRS {
            self.nearest_pairs(begin, end, pair_of, taken);
        }
        for (known, pair) in begin.iter().zip(&*pair_of) {
            match pair.map(|other: usize| &end[other]) {
                Some(other) => self.matched(known, other, out, found),
                None => self.vanished(known, out, found),
            }
        }
        for known in end.iter().zip(&*taken).filter(|(_, taken)| !**taken).map(|(known, _)| known) {
            self.born(known, out, found);
        }
    }

    /// Pairs particles that share an id by how near each is to where the other goes: those of one family first, and none that are
    /// farther apart than twice what they may have moved.
    fn nearest_pairs(&self, begin: &[Known], end: &[Known], pair_of: &mut [Option<usize>], taken: &mut [bool]) {
        let length = self.clock[2] - self.clock[1];
        let unit = self.layout.lattice.unit();
        let mut pairs: Vec<(bool, f64, usize, usize)> = Vec::new();
        for (i, a) in begin.iter().enumerate() {
            for (k, b) in end.iter().enumerate() {
                let place = self.image(a, b);
                let moved = difference(place, a.place) * unit;
                let off = (moved - 0.5 * length * (a.velocity + b.velocity)).length();
                let reach = 2.0 * length * a.velocity.length().max(b.velocity.length());
                // What rests is where it was, as far as places are known.
                let rounding = f64::from(a.state.smoothing_length().max(b.state.smoothing_length())) / 256.0;
                if moved.length() <= reach.max(if reach > 0.0 { 0.0 } else { rounding }) {
                    pairs.push((a.state.family != b.state.family, off, i, k));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
        for (_, _, i, k) in pairs {
            if pair_of[i].is_none() && !taken[k] {
                (pair_of[i], taken[k]) = (Some(k), true);
            }
        }
    }

    /// `dx/dtau` of a state at one of both ends.
    fn velocity(&self, all: &[Vec<State>; 4], step: usize, state: &State) -> DVec3 {
        let (tangents, scale) = self.tangents[state.family];
        match tangents {
            Tangents::Velocity => {
                let velocity = DVec3::from(state.velocity.map(f64::from)) * scale;
                if velocity.is_finite() { velocity } else { DVec3::ZERO }
            }
            Tangents::Differences => self.difference(all, step, state),
            Tangents::None => DVec3::ZERO,
        }
    }

    /// The velocity from the places at the steps around one, where the id is there only once at each.
    fn difference(&self, all: &[Vec<State>; 4], step: usize, state: &State) -> DVec3 {
        let only = |step: usize| match &all[step][..] {
            [only] => Some(only),
            _ => None,
        };
        if only(step).is_none() {
            return DVec3::ZERO;
        }
        let unit = self.layout.lattice.unit();
        let position = |other: &State| difference(self.nearest_image(state.place, other.place), state.place) * unit;
        // Three steps that have it: those around the step, or at the ends of its presence the nearest ones that there are.
        let around = |steps: [usize; 3]| -> Option<DVec3> {
            let states = [only(steps[0])?, only(steps[1])?, only(steps[2])?];
            let at = steps.iter().position(|other| *other == step)?;
            Some(difference_at(steps.map(|step| self.clock[step]), states.map(position), at))
        };
        let two = |a: usize, b: usize| -> Option<DVec3> {
            Some(chord([self.clock[a], self.clock[b]], [position(only(a)?), position(only(b)?)]))
        };
        let is_there = |step: usize| self.clock[step].is_finite();
        let (before, after) = (step - 1, step + 1);
        let velocity = match (is_there(before), is_there(after)) {
            (true, true) => around([before, step, after]).or_else(|| two(step, after)).or_else(|| two(before, step)),
            // One-sided at the ends of the run.
            (false, _) if step == 1 && is_there(3) => around([1, 2, 3]).or_else(|| two(1, 2)),
            (_, false) if step == 2 && is_there(0) => around([0, 1, 2]).or_else(|| two(1, 2)),
            _ => two(1, 2),
        };
        velocity.filter(|velocity| velocity.is_finite()).unwrap_or(DVec3::ZERO)
    }

    /// The image of `place` that is nearest to `to`.
    pub fn nearest_image(&self, to: [i64; 3], place: [i64; 3]) -> [i64; 3] {
        match self.edge {
            Some(edge) => std::array::from_fn(|axis| place[axis] + edge * nearest(to[axis] - place[axis], edge)),
            None => place,
        }
    }

    /// The image of a track's end that is nearest to where the velocities lead.
    fn image(&self, a: &Known, b: &Known) -> [i64; 3] {
        let way = 0.5 * (self.clock[2] - self.clock[1]) * (a.velocity + b.velocity) / self.layout.lattice.unit();
        let predicted = std::array::from_fn(|axis| a.place[axis].saturating_add(way[axis].round() as i64));
        self.nearest_image(predicted, b.place)
    }

    fn matched(&self, a: &Known, b: &Known, out: &mut Vec<u32>, found: &mut [Found]) {
        // What changes its family is placed as exactly as either asks for.
        let h = a.state.smoothing_length().min(b.state.smoothing_length());
        let both = [a, b].map(|known| if a.state.family == b.state.family { *known } else { known.within(self, h) });
        let [a, b] = &both;
        let place = self.image(a, b);
        let spline = self.spline([a, b], place);
        let own = &mut found[a.state.family];
        own.crossing += u64::from(place != b.place);
        let is_straight = self.tangents[a.state.family].0 == Tangents::None;
        let unresolved =
            if is_straight { 0.0 } else { spline.unresolved(f64::from(a.state.smoothing_length())) as f32 };
        // By places as the sources have them: what has just begun to move is no farther than places are rounded.
        let turned = difference(place, b.place) + difference(b.state.place, a.state.place);
        let moved = turned * self.layout.lattice.unit();
        let way = 0.5 * (spline.tangents[0] + spline.tangents[1]);
        if self.tangents[a.state.family].0 == Tangents::Velocity {
            own.products[0] += moved.dot(way);
            own.products[1] += way.dot(way);
        }
        let mass = f64::from(a.state.values[0]);
        own.mass[0] += mass;
        own.mass[1] += if unresolved > UNRESOLVED { mass } else { 0.0 };
        let record = |family: usize, flags: u8, values: [&[f32]; 2], out: &mut Vec<u32>| {
            let flags = TrackFlags(flags);
            let numbers = numbers(flags, [a.state.number, b.state.number]);
            let velocities = [a, b].map(|known| known.velocity.as_vec3().to_array());
            let places = [a.place, place];
            TrackRecord { id: a.state.id, family, flags, unresolved, places, velocities, numbers, values }.put(out);
        };
        if a.state.family == b.state.family {
            own.matched += 1;
            record(a.state.family, 0, [a.state.values, b.state.values], out);
        } else {
            own.changed += 1;
            record(a.state.family, TrackFlags::GOES, [a.state.values; 2], out);
            record(b.state.family, TrackFlags::COMES, [b.state.values; 2], out);
        }
    }

    /// On along its velocity, as it will be stored, so that its end is where the spline says.
    fn vanished(&self, known: &Known, out: &mut Vec<u32>, found: &mut [Found]) {
        found[known.state.family].vanished += 1;
        let way = self.way(known, 0);
        let end = std::array::from_fn(|axis| known.place[axis] + way[axis]);
        self.alone(known, TrackFlags::GOES, [known.place, end], out);
    }

    fn born(&self, known: &Known, out: &mut Vec<u32>, found: &mut [Found]) {
        found[known.state.family].born += 1;
        let way = self.way(known, 1);
        let begin = std::array::from_fn(|axis| known.place[axis] - way[axis]);
        self.alone(known, TrackFlags::COMES, [begin, known.place], out);
    }

    /// How far a state moves within the interval if its velocity stays, as it is rounded at `end`.
    fn way(&self, known: &Known, end: usize) -> [i64; 3] {
        let lattice: &Lattice = &self.layout.lattice;
        let exponent = lattice.exponent(known.state.smoothing_length());
        let movement = lattice.movement(known.velocity.to_array(), self.spans[end], exponent);
        let rate = (self.clock[2] - self.clock[1]) / self.spans[end];
        movement.map(|v| (v as f64 * rate).round() as i64)
    }

    fn alone(&self, known: &Known, flags: u8, places: [[i64; 3]; 2], out: &mut Vec<u32>) {
        let velocity = known.velocity.as_vec3().to_array();
        let record = TrackRecord {
            id: known.state.id,
            family: known.state.family,
            flags: TrackFlags(flags),
            unresolved: 0.0,
            places,
            velocities: [velocity; 2],
            numbers: numbers(TrackFlags(flags), [known.state.number; 2]),
            values: [known.state.values; 2],
        };
        record.put(out);
    }

    fn spline(&self, ends: [&Known; 2], place: [i64; 3]) -> HermiteSpline {
        let lattice = &self.layout.lattice;
        let length = self.clock[2] - self.clock[1];
        HermiteSpline {
            positions: [ends[0].place, place].map(|place| DVec3::from(lattice.position(place))),
            tangents: ends.map(|known| known.velocity * length),
        }
    }
}

/// The numbers of those that are there.
fn numbers(flags: TrackFlags, of: [u32; 2]) -> [u32; 2] {
    let is_there = [!flags.has(TrackFlags::COMES), !flags.has(TrackFlags::GOES)];
    [0, 1].map(|end| if is_there[end] { of[end] } else { NOBODY })
}

/// `a - b`, in units of the lattice.
fn difference(a: [i64; 3], b: [i64; 3]) -> DVec3 {
    DVec3::from(std::array::from_fn(|axis| a[axis].wrapping_sub(b[axis]) as f64))
}

/// `distance / edge` to the nearest whole number.
fn nearest(distance: i64, edge: i64) -> i64 {
    let half = edge / 2;
    match distance.cmp(&0) {
        Ordering::Less => -((half - distance) / edge),
        _ => (half + distance) / edge,
    }
}
