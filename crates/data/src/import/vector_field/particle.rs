//! A particle that a field carries along, cell by cell: within a cell the field is smooth, so that steps keep their order, and no step
//! goes over a face.

use super::cell::Cell;
use super::interval::Interval;
use super::step::{Stepped, step};

/// Steps between two times that are asked for, from which on a particle is given up.
const MOST_STEPS: usize = 40_000;
/// Cells that one step may go at most.
const LONGEST: f64 = 1.0;
/// How near to a face a step has to end that goes there, cells.
const NEAR: f64 = 1e-5;
/// What lies no farther beyond a face counts as within, cells.
const BEYOND: f64 = 1e-9;
/// Corrections of the length of a step that goes to a face.
const CORRECTIONS: usize = 4;
/// Halvings of a step in search of the place where it leaves a cell.
const HALVINGS: usize = 40;
/// Faces crossed with no time between them, from which on a step regards none.
const MOST_CROSSED: usize = 6;

/// Why a particle goes no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// It left the field's box.
    Left,
    /// It came to a cell one of whose nodes has no velocity.
    Void,
    /// It takes too many steps.
    Lost,
}

/// A particle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Particle {
    /// Who it is.
    pub id: u64,
    /// Why it goes no further.
    pub end: Option<End>,
    /// The cell that it is in; of periodic axes it goes on counting.
    cell: [i64; 3],
    /// Where in it, cells from its beginning.
    place: [f64; 3],
    /// The length of its next step.
    step: f64,
}

/// What is told of a particle.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    /// Who it is.
    pub id: u64,
    /// Where it is; beyond the box where it went through faces of a periodic one.
    pub position: [f64; 3],
    /// Its velocity.
    pub velocity: [f64; 3],
    /// The vorticity around it.
    pub vorticity: f64,
}

impl Particle {
    /// One at a place; `None` where the field has no velocity.
    pub(super) fn new(interval: &Interval, id: u64, position: [f64; 3]) -> Option<Particle> {
        let (cell, place) = interval.locate(position)?;
        interval.cell(cell)?;
        Some(Particle { id, end: None, cell, place, step: f64::INFINITY })
    }

    /// Where it is and how it moves; `None` where it goes no further.
    pub(super) fn state(&self, interval: &Interval, time: f64) -> Option<State> {
        if self.end.is_some() {
            return None;
        }
        let cell = interval.cell(self.cell)?;
        let axes = interval.axes();
        Some(State {
            id: self.id,
            position: std::array::from_fn(|axis| axes[axis].place(self.cell[axis], self.place[axis])),
            velocity: cell.velocity(self.place, time),
            vorticity: cell.vorticity(self.place, time),
        })
    }

    /// Carries it from one time to a later one, both within the interval. `tolerance`: the error of a step, in cells.
    pub(super) fn advance(&mut self, interval: &Interval, from: f64, until: f64, tolerance: f64) {
        if self.end.is_none()
            && let Err(end) = self.carried(interval, from, until, tolerance)
        {
            self.end = Some(end);
        }
    }

    fn carried(&mut self, interval: &Interval, from: f64, until: f64, tolerance: f64) -> Result<(), End> {
        let mut cell = interval.cell(self.cell).ok_or(End::Void)?;
        let (mut now, mut crossed) = (from, 0);
        for _ in 0..MOST_STEPS {
            if now >= until {
                return Ok(());
            }
            let rate = |place: [f64; 3], time: f64| cell.rate(place, time);
            let first = rate(self.place, now);
            let fastest = first.iter().fold(0.0, |most: f64, part| most.max(part.abs()));
            let left = until - now;
            let length = self.step.min(left).min(LONGEST / fastest);
            let whole = step(rate, self.place, first, now, length);
            let error = whole.error / tolerance;
            // A step of order 5; what is no number is refused, too.
            let factor = if error > 0.0 { (0.9 * error.powf(-0.2)).clamp(0.2, 5.0) } else { 5.0 };
            if error.is_nan() || error > 1.0 {
                self.step = if error.is_finite() { length * factor } else { 0.1 * length };
                continue;
            }
            let leaving = self.leaving(first, &whole, length).filter(|_| crossed < MOST_CROSSED);
            let Some(Leaving { axis, forward, share }) = leaving else {
                self.place = whole.to;
                now = if length == left { until } else { now + length };
                self.step = length * factor;
                crossed = 0;
                continue;
            };
            let passed = self.go_to_face(&cell, first, now, length, (axis, forward, share));
            now += passed;
            crossed = if passed > 0.0 { 0 } else { crossed + 1 };
            self.step = length * factor;
            let (next, back) = if forward { (1, 1.0) } else { (-1, -1.0) };
            self.cell[axis] += next;
            if !interval.axes()[axis].has(self.cell[axis]) {
                return Err(End::Left);
            }
            self.place[axis] -= back;
            cell = interval.cell(self.cell).ok_or(End::Void)?;
            // One step as far as this in a direction that leads nowhere.
            if crossed == MOST_CROSSED {
                self.step = (self.step * NEAR).max(f64::EPSILON * now.abs());
            }
        }
        Err(End::Lost)
    }

    /// Goes to the face that a step leaves the cell through; the time that takes.
    fn go_to_face(
        &mut self,
        cell: &Cell,
        first: [f64; 3],
        now: f64,
        length: f64,
        (axis, forward, share): (usize, bool, f64),
    ) -> f64 {
        if share <= 0.0 {
            return 0.0;
        }
        let face = if forward { 1.0 } else { 0.0 };
        let rate = |place: [f64; 3], time: f64| cell.rate(place, time);
        let mut passed = share * length;
        let mut there = step(rate, self.place, first, now, passed);
        for _ in 0..CORRECTIONS {
            let off = face - there.to[axis];
            let next = passed + off / there.rate[axis];
            if off.abs() <= NEAR || !(f64::MIN_POSITIVE..=length).contains(&next) {
                break;
            }
            passed = next;
            there = step(rate, self.place, first, now, passed);
        }
        self.place = there.to;
        passed
    }

    /// The face that a step leaves the cell through first.
    fn leaving(&self, first: [f64; 3], whole: &Stepped, length: f64) -> Option<Leaving> {
        let mut found: Option<Leaving> = None;
        for (axis, slope) in first.iter().enumerate() {
            let path = Path {
                from: self.place[axis],
                to: whole.to[axis],
                first: slope * length,
                last: whole.rate[axis] * length,
            };
            for forward in [false, true] {
                let earlier = |share: &f64| found.as_ref().is_none_or(|found| *share < found.share);
                if let Some(share) = path.leaves(forward).filter(earlier) {
                    found = Some(Leaving { axis, forward, share });
                }
            }
        }
        found
    }
}

/// Where a step leaves a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leaving {
    axis: usize,
    /// Through the face at the axis' end.
    forward: bool,
    /// When, in steps.
    share: f64,
}

/// A step along one axis, as the cubic that begins and ends as it does.
#[derive(Clone, Copy, Debug)]
struct Path {
    from: f64,
    to: f64,
    /// Its slopes at both ends, for a share of the step.
    first: f64,
    last: f64,
}

impl Path {
    /// The powers of a share.
    fn powers(&self) -> [f64; 4] {
        let rise = self.to - self.from;
        [self.from, self.first, 3.0 * rise - 2.0 * self.first - self.last, self.first + self.last - 2.0 * rise]
    }

    fn at(&self, share: f64) -> f64 {
        self.powers().iter().rev().fold(0.0, |sum, power| sum * share + power)
    }

    /// How far beyond a face it is.
    fn beyond(&self, forward: bool, share: f64) -> f64 {
        if forward { self.at(share) - 1.0 } else { -self.at(share) }
    }

    /// The share of the step at which it leaves through a face: in between, where it only comes back.
    fn leaves(&self, forward: bool) -> Option<f64> {
        let starts_beyond = self.beyond(forward, 0.0) > BEYOND;
        let goes_on = if forward { self.first > 0.0 } else { self.first < 0.0 };
        if starts_beyond && goes_on {
            return Some(0.0);
        }
        let [_, b, c, d] = self.powers();
        // Where it turns: b + 2 c s + 3 d s^2 = 0.
        let root = (c * c - 3.0 * b * d).sqrt();
        let far = -(c + root.copysign(c));
        let mut turns = [b / far, far / (3.0 * d), 1.0];
        for turn in &mut turns {
            // None in between, among them what is no number.
            if !(f64::MIN_POSITIVE..=1.0).contains(turn) {
                *turn = 1.0;
            }
        }
        turns.sort_unstable_by(f64::total_cmp);
        let mut inside = if starts_beyond { None } else { Some(0.0) };
        for turn in turns {
            let beyond = self.beyond(forward, turn);
            if let Some(mut inside) = inside.filter(|_| beyond > BEYOND) {
                let mut outside = turn;
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (inside + outside);
                    if self.beyond(forward, middle) > 0.0 {
                        outside = middle;
                    } else {
                        inside = middle;
                    }
                }
                return Some(outside);
            }
            if beyond <= 0.0 {
                inside = Some(turn);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A path leaves where it is beyond a face for the first time.
        #[test]
        fn paths_leave_where_they_first_cross(
            from in 0.0..1.0f64, to in -1.0..2.0f64, first in -4.0..4.0f64, last in -4.0..4.0f64, forward: bool,
        ) {
            let path = Path { from, to, first, last };
            let beyond = |share: f64| path.beyond(forward, share);
            let first = (0..=4000).map(|k| f64::from(k) / 4000.0).find(|share| beyond(*share) > 1e-6);
            match (path.leaves(forward), first) {
                (Some(share), Some(first)) => {
                    prop_assert!(share <= first && beyond(share).abs() < 1e-6, "{} {}", share, first);
                }
                (None, Some(first)) => prop_assert!(false, "not found: {}", first),
                // A touch.
                (Some(share), None) => prop_assert!(beyond(share).abs() < 1e-6),
                (None, None) => {}
            }
        }
    }

    #[test]
    fn what_starts_beyond_a_face_and_comes_in_does_not_leave() {
        let path = |from: f64, to: f64, slope: f64| Path { from, to, first: slope, last: slope };
        assert_eq!(path(-1e-6, 0.5, 0.5).leaves(false), None);
        assert_eq!(path(-1e-6, -0.5, -0.5).leaves(false), Some(0.0));
        assert_eq!(path(1.0 + 1e-6, 1.5, 0.5).leaves(true), Some(0.0));
        // It rests on the face.
        assert_eq!(path(1.0, 1.0, 0.0).leaves(true), None);
    }
}
