//! Long tracks: chains of tracks over 2, 4, 8, ... intervals as one spline each, for runs of thousands of steps.
//!
//! A long track leads over a [`Stretch`] of intervals, from the state where the first track of its chain begins to the one where the last
//! one ends: so it meets shorter tracks to the bit at both ends, and needs no states of its own. It is joined of one track over each
//! half of its stretch, and only where both are the same matter: the first is the only one that ends in its cluster and the second the
//! only one that begins there, and neither comes or goes. So whatever long tracks are taken in the place of their parts, everybody is
//! drawn once at any time.
//!
//! On each half the difference of its spline to that of the half is a cubic one, too, whose norm is bounded ([`HermiteSpline::bound`]);
//! with what the half itself may be off that is how far the long track is from the tracks over single intervals. So a build or a check
//! keeps no more of what was before than the tracks over one half for each scale, whose other half is to come ([`Chains`]).

use super::spline::HermiteSpline;
use super::tracks::{Interval, TrackFlags, Tracks};
use rayon::prelude::*;
use std::ops::Range;

/// How far the mass of a chain may be from that of a long track, whose mass is linear, as a share of it, in the middle of a stretch.
const MASS: f32 = 1.0 / 256.0;
/// The largest number of [`recorded_error`].
pub const LEAST_ERROR: u8 = 63;
/// Images of the periodic box that a long track may end in, along each axis to both sides.
pub const MOST_IMAGES: i64 = 1 << 20;
/// `2^(-n/4)`.
const QUARTERS: [f64; 4] = [1.0, 0.840_896_415_253_714_5, std::f64::consts::FRAC_1_SQRT_2, 0.594_603_557_501_360_5];

/// So many intervals one after another as a power of two says; the number of the first one is a multiple of that.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Stretch {
    /// How many: 1, 2, 4, ...
    pub scale: usize,
    /// How many of them come before it.
    pub number: usize,
}

impl Stretch {
    /// One interval.
    pub fn interval(interval: usize) -> Stretch {
        Stretch { scale: 1, number: interval }
    }

    /// Its intervals; an empty range where there are no such numbers.
    pub fn intervals(self) -> Range<usize> {
        let first = self.number.saturating_mul(self.scale);
        first..first.saturating_add(self.scale)
    }

    /// The last of its intervals.
    pub fn last(self) -> usize {
        self.intervals().end.saturating_sub(1)
    }

    /// Both halves; `None` of one interval.
    pub fn halves(self) -> Option<[Stretch; 2]> {
        let (scale, first) = (self.scale / 2, self.number.saturating_mul(2));
        (scale > 0).then(|| [first, first.saturating_add(1)].map(|number| Stretch { scale, number }))
    }

    /// The stretches of two intervals and more that end with an interval, the shortest first.
    pub fn ending_with(interval: usize) -> impl Iterator<Item = Stretch> {
        let end = interval + 1;
        (1..=end.trailing_zeros()).map(move |exponent| Stretch { scale: 1 << exponent, number: (end >> exponent) - 1 })
    }
}

/// How far a long track is from the tracks over single intervals, as it is recorded: a level's error by the fourth root of two to the
/// power of `number`.
pub fn recorded_error(level_error: f64, number: u8) -> f64 {
    level_error * QUARTERS[usize::from(number % 4)] / (1_u64 << (number / 4).min(63)) as f64
}

/// The largest number whose error is not below `error`; `None` where that is above the level's.
fn error_number(level_error: f64, error: f64) -> Option<u8> {
    (0..=LEAST_ERROR).rev().find(|number| recorded_error(level_error, *number) >= error)
}

/// A track over a stretch of two intervals or more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LongTrack {
    /// The tracks over both halves, by their numbers among those over them: long ones, or where a half is one interval, tracks of the level.
    pub halves: [u32; 2],
    /// By how many edges of a periodic box the place where it ends is beyond that of the last track of its chain.
    pub image: [i64; 3],
    /// Its error as [`recorded_error`] has it.
    pub error: u8,
}

/// A track over a stretch, as far as it matters for longer ones.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Link {
    /// Its number among the tracks over the stretch.
    number: u32,
    /// The clusters where it begins and ends, where no other track does.
    clusters: [Option<u32>; 2],
    /// Where it begins and ends, on the lattice; the image that it reaches.
    places: [[i64; 3]; 2],
    movements: [[i64; 3]; 2],
    /// As that of a [`LongTrack`].
    image: [i64; 3],
    mass: [f32; 2],
    /// How far it is from the tracks over single intervals.
    error: f64,
}

/// The tracks over a stretch that longer ones may consist of.
#[derive(Clone, Debug)]
pub struct Links {
    /// The stretch as if it were one interval.
    space: Interval,
    /// The clock at both ends.
    clock: [f64; 2],
    list: Vec<Link>,
}

impl Links {
    /// The tracks of a level over an interval that keep together: `clusters` says where each begins and ends, `clock` when.
    pub fn of_interval(tracks: &Tracks, clusters: &[Vec<u32>; 2], space: Interval, clock: [f64; 2]) -> Links {
        let alone = [0, 1].map(|end| alone(&clusters[end]));
        let link = |i: usize| {
            let at = |end: usize| alone[end][i].then(|| clusters[end][i]);
            let of = |end: usize| &tracks.ends[end];
            Link {
                number: i as u32,
                clusters: [at(0), at(1)],
                places: [0, 1].map(|end| of(end).places[i]),
                movements: [0, 1].map(|end| of(end).movements[i]),
                image: [0; 3],
                mass: [0, 1].map(|end| of(end).mass[i]),
                error: 0.0,
            }
        };
        let is_there = |i: &usize| !tracks.flags[*i].has(TrackFlags::COMES) && !tracks.flags[*i].has(TrackFlags::GOES);
        let list = (0..tracks.len()).filter(is_there).map(link).filter(|link| link.clusters != [None; 2]).collect();
        Links { space, clock, list }
    }

    /// The stretch that consists of this one and the next, as an interval.
    fn union(&self, next: &Links) -> Interval {
        let spans = [self.space.spans[0], next.space.spans[1]];
        Interval { length: next.clock[1] - self.clock[0], spans, ..self.space }
    }

    /// All long tracks over this stretch and the next one that are within a level's error of the shorter ones, and these as parts of
    /// longer ones still.
    pub fn join(&self, next: &Links, level_error: f64) -> (Vec<LongTrack>, Links) {
        let space = self.union(next);
        let mut begins: Vec<(u32, usize)> =
            next.list.iter().enumerate().filter_map(|(i, link)| Some((link.clusters[0]?, i))).collect();
        begins.sort_unstable();
        let join = |first: &Link| {
            let cluster = first.clusters[1]?;
            let found = begins.binary_search_by_key(&cluster, |(begin, _)| *begin).ok()?;
            let second = &next.list[begins[found].1];
            let joined = self.joined(first, next, second, &space)?;
            let error = error_number(level_error, joined.error)?;
            let long = LongTrack { halves: [first.number, second.number], image: joined.image, error };
            Some((long, Link { error: recorded_error(level_error, error), ..joined }))
        };
        let found: Vec<(LongTrack, Link)> = self.list.par_iter().filter_map(join).collect();
        let (long, mut list): (Vec<LongTrack>, Vec<Link>) = found.into_iter().unzip();
        list.iter_mut().zip(0..).for_each(|(link, number)| link.number = number);
        (long, Links { space, clock: [self.clock[0], next.clock[1]], list })
    }

    /// The same of long tracks that are known; `None` where one of them is none: its halves are not the same matter, or it is farther
    /// from them than it says.
    pub fn follow(&self, next: &Links, long: &[LongTrack], level_error: f64) -> Option<Links> {
        let space = self.union(next);
        let of = |links: &[Link], number: u32| -> Option<Link> {
            links.binary_search_by_key(&number, |link| link.number).ok().map(|i| links[i])
        };
        let follow = |(number, long): (usize, &LongTrack)| {
            let [first, second] = [of(&self.list, long.halves[0])?, of(&next.list, long.halves[1])?];
            let joined = self.joined(&first, next, &second, &space)?;
            let error = recorded_error(level_error, long.error);
            // Sums of floats are the same everywhere but for rounding.
            let holds = joined.error <= error * (1.0 + 1e-9) && joined.image == long.image;
            holds.then_some(Link { number: number as u32, error, ..joined })
        };
        let list = long.par_iter().enumerate().map(follow).collect::<Option<Vec<Link>>>()?;
        Some(Links { space, clock: [self.clock[0], next.clock[1]], list })
    }

    /// The track that consists of one of these and one of the next stretch, if they are the same matter.
    fn joined(&self, first: &Link, next: &Links, second: &Link, space: &Interval) -> Option<Link> {
        let goes_on = first.clusters[1].is_some() && first.clusters[1] == second.clusters[0];
        if !goes_on || first.movements[1] != second.movements[0] {
            return None;
        }
        // The second one as it goes on from the image that the first one reaches.
        let mut shift = [0; 3];
        let mut image = [0; 3];
        for axis in 0..3 {
            shift[axis] = first.places[1][axis].checked_sub(second.places[0][axis])?;
            image[axis] = second.image[axis].checked_add(space.edges(shift[axis])?)?;
            if image[axis].abs() > MOST_IMAGES {
                return None;
            }
        }
        let moved = |place: [i64; 3]| std::array::from_fn(|axis| place[axis].saturating_add(shift[axis]));
        let second = Link { places: second.places.map(moved), ..*second };
        let whole = Link {
            number: 0,
            clusters: [first.clusters[0], second.clusters[1]],
            places: [first.places[0], second.places[1]],
            movements: [first.movements[0], second.movements[1]],
            image,
            mass: [first.mass[0], second.mass[1]],
            error: 0.0,
        };
        let spline = whole.spline(space);
        let middle = self.space.length / space.length;
        let mass = whole.mass[0] + (whole.mass[1] - whole.mass[0]) * middle as f32;
        let is_as_heavy = |own: f32| (own - mass).abs() <= MASS * mass.abs();
        if !is_as_heavy(first.mass[1]) || !is_as_heavy(second.mass[0]) {
            return None;
        }
        let off = |part: [f64; 2], half: &Link, own: &Interval| {
            spline.part(part).minus(&half.spline(own)).bound() + half.error
        };
        let error = off([0.0, middle], first, &self.space).max(off([middle, 1.0], &second, &next.space));
        Some(Link { error, ..whole })
    }
}

impl Link {
    fn spline(&self, space: &Interval) -> HermiteSpline {
        space.spline_of(self.places, self.movements)
    }
}

/// Which numbers no other one equals.
fn alone(numbers: &[u32]) -> Vec<bool> {
    let mut order: Vec<(u32, u32)> = numbers.iter().copied().zip(0..).collect();
    order.sort_unstable();
    let mut alone = vec![false; numbers.len()];
    for group in order.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, only)] = group {
            alone[*only as usize] = true;
        }
    }
    alone
}

/// The tracks of a level that longer ones may consist of, as intervals come one by one: of each scale at most one stretch, whose other half
/// is to come.
#[derive(Clone, Debug, Default)]
pub struct Chains {
    halves: Vec<Option<Links>>,
}

impl Chains {
    /// Goes on with the tracks over the next interval, and calls `join` for each stretch that ends with it, the shortest first, with the
    /// tracks over both halves.
    ///
    /// # Errors
    /// Those of `join`.
    pub fn push<E>(
        &mut self,
        interval: usize,
        links: Links,
        mut join: impl FnMut(Stretch, &Links, &Links) -> Result<Links, E>,
    ) -> Result<(), E> {
        let mut last = links;
        let mut exponent = 0;
        for stretch in Stretch::ending_with(interval) {
            if let Some(first) = self.halves.get_mut(exponent).and_then(Option::take) {
                last = join(stretch, &first, &last)?;
            }
            exponent += 1;
        }
        if self.halves.len() <= exponent {
            self.halves.resize(exponent + 1, None);
        }
        self.halves[exponent] = Some(last);
        Ok(())
    }
}
