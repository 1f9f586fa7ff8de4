//! The course of a ray over a globe: which rows, columns and heights it passes when.
//!
//! Along a ray longitude goes one way, heights fall and then rise (a distance from a convex body is a convex function), and latitude turns at
//! most once where it matters. A ray is parted where they turn, so that in each part all three go one way: a box of rows, columns and heights
//! holds one stretch of it, whose ends are found between two places by Newton's steps.

use crate::model::{Globe, HeightGrid};
use std::f64::consts::TAU;

/// How much wider than they are boxes and cells are, in cells.
const HAIR: f64 = 1e-9;
/// Most steps to a place; each of them at least halves where it may be.
const STEPS: u32 = 60;
/// Turns of the globe at which a field may lie about a ray's longitudes.
const TURNS: std::ops::RangeInclusive<i32> = -2..=2;
/// Parts of a ray, and turns of each that meet a field.
const MOST: usize = 9;

/// A field on a globe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The body.
    pub globe: Globe,
    /// Longitude and latitude of sample (0, 0), degrees.
    pub origin: [f64; 2],
    /// From a column and from a row to the next, degrees.
    pub step: [f64; 2],
    /// The last column and the last row.
    pub last: [f64; 2],
    /// Where height 0 stands above the globe, and what a unit of height adds.
    pub lift: [f64; 2],
}

impl Spread {
    /// A grid in degrees on a globe.
    pub fn new(globe: Globe, grid: &HeightGrid, lift: [f64; 2]) -> Spread {
        let last = [grid.columns - 1, grid.rows - 1].map(|last| last as f64);
        Spread { globe, origin: grid.origin, step: grid.step, last, lift }
    }

    /// Where heights stand, the lower one first.
    pub fn lifted(&self, heights: [f64; 2]) -> [f64; 2] {
        let [a, b] = heights.map(|height| self.lift[1].mul_add(height, self.lift[0]));
        [a.min(b), a.max(b)]
    }

    /// The parts of a ray that may pass over the field below the height `top`, in their order, between two parameters.
    pub fn courses(&self, origin: [f64; 3], direction: [f64; 3], part: [f64; 2], top: f64) -> Courses<'_> {
        let mut courses = Courses { found: [None; MOST] };
        let line = Line { origin, direction };
        let is_ray = origin.iter().chain(&direction).all(|part| part.is_finite()) && dot(direction, direction) > 0.0;
        let reach = self.globe.reach() + top.max(0.0);
        let Some([from, to]) = line.within(reach * (1.0 + 1e-9), part).filter(|_| is_ray) else { return courses };
        // Where it is lowest, and where its latitude turns.
        let lowest = line.turn([from, to], |line, t| dot(line.direction, self.globe.above(line.at(t)).1));
        let northernmost = line.turn([from, to], |line, t| {
            let up = self.globe.above(line.at(t)).1;
            let away = up[0].hypot(up[1]);
            let level = if away > 0.0 { [up[0] / away, up[1] / away] } else { [1.0, 0.0] };
            dot(line.direction, [-up[2] * level[0], -up[2] * level[1], away])
        });
        let cuts = match (lowest, northernmost) {
            (Some(a), Some(b)) => [from, a.min(b), a.max(b), to],
            (Some(a), None) | (None, Some(a)) => [from, a, to, to],
            (None, None) => [from, to, to, to],
        };
        let mut count = 0;
        for ends in cuts.windows(2).filter(|ends| ends[0] < ends[1]) {
            let one = Course::new(self, line, [ends[0], ends[1]]);
            for course in TURNS.filter_map(|turns| one.turned(turns)) {
                if count < MOST {
                    courses.found[count] = Some(course);
                    count += 1;
                }
            }
        }
        courses
    }
}

/// Parts of a ray.
pub struct Courses<'a> {
    found: [Option<Course<'a>>; MOST],
}

impl<'a> Courses<'a> {
    /// In the order of their parameters.
    pub fn iter(&self) -> impl Iterator<Item = &Course<'a>> {
        self.found.iter().flatten()
    }
}

#[derive(Clone, Copy, Debug)]
struct Line {
    origin: [f64; 3],
    direction: [f64; 3],
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Line {
    fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| t.mul_add(self.direction[axis], self.origin[axis]))
    }

    /// The part of it in a ball about the origin.
    fn within(&self, radius: f64, [from, to]: [f64; 2]) -> Option<[f64; 2]> {
        let square = dot(self.direction, self.direction);
        let nearest = -dot(self.origin, self.direction) / square;
        let place = self.at(nearest);
        let half = ((radius * radius - dot(place, place)) / square).sqrt();
        let (from, to) = (from.max(nearest - half), to.min(nearest + half));
        (from < to).then_some([from, to])
    }

    /// Where something changes its sign between two parameters, if its ends differ.
    fn turn(&self, [from, to]: [f64; 2], value: impl Fn(&Line, f64) -> f64) -> Option<f64> {
        let (first, last) = (value(self, from), value(self, to));
        (first * last < 0.0).then(|| between([from, to], [first, last], |t| value(self, t)))
    }
}

/// Where a function that has these values at two ends, of which one is above 0 and the other one below, is 0: by secants, and by halves
/// where these are slow.
fn between([mut a, mut b]: [f64; 2], [mut low, mut high]: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    // Which end has stayed.
    let mut stayed = 0;
    for step in 0..STEPS {
        let secant = a - low * (b - a) / (high - low);
        let t = if step % 4 == 3 || !(secant > a && secant < b) { 0.5 * (a + b) } else { secant };
        if t <= a || t >= b {
            break;
        }
        let here = value(t);
        if here == 0.0 {
            return t;
        }
        if (here > 0.0) == (high > 0.0) {
            (b, high) = (t, here);
            if stayed == -1 {
                low *= 0.5;
            }
            stayed = -1;
        } else {
            (a, low) = (t, here);
            if stayed == 1 {
                high *= 0.5;
            }
            stayed = 1;
        }
        if b - a <= 4.0 * f64::EPSILON * a.abs().max(b.abs()) {
            break;
        }
    }
    if low.abs() < high.abs() { a } else { b }
}

/// A part of a ray along which longitude, latitude and height each go one way.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    spread: &'a Spread,
    line: Line,
    /// Its first and its last parameter.
    pub span: [f64; 2],
    /// The middle of its longitudes, degrees.
    middle: f64,
    /// What is added to longitudes, degrees.
    turned: f64,
}

/// Where a cell meets a course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// The ray's parameter.
    pub t: f64,
    /// Row, with a fraction.
    pub row: f64,
    /// Column, with a fraction.
    pub column: f64,
}

impl<'a> Course<'a> {
    fn new(spread: &'a Spread, line: Line, span: [f64; 2]) -> Course<'a> {
        let [first, last] = span.map(|t| {
            let [x, y, _] = line.at(t);
            y.atan2(x)
        });
        // Less than half a turn: a line is on one side of the axis.
        let way = (last - first + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        Course { spread, line, span, middle: (first + 0.5 * way).to_degrees(), turned: 0.0 }
    }

    /// So many turns further, where it meets the field.
    fn turned(mut self, turns: i32) -> Option<Course<'a>> {
        self.turned = 360.0 * f64::from(turns);
        let ends = self.span.map(|t| self.place(t)[1]);
        (ends[0].max(ends[1]) >= -HAIR && ends[0].min(ends[1]) <= self.spread.last[0] + HAIR).then_some(self)
    }

    /// Row, column and what is above the globe at a parameter.
    pub fn place(&self, t: f64) -> [f64; 3] {
        let [longitude, latitude, height] = self.spread.globe.geodetic(self.line.at(t));
        let longitude = longitude + 360.0 * ((self.middle - longitude) / 360.0).round() + self.turned;
        let Spread { origin, step, .. } = self.spread;
        [(latitude - origin[1]) / step[1], (longitude - origin[0]) / step[0], height]
    }

    /// The stretch of a span in a box, a hair wider than it is; `heights` are above the globe. `None` where it passes by.
    pub fn within(&self, rows: [f64; 2], columns: [f64; 2], heights: [f64; 2], span: [f64; 2]) -> Option<[f64; 2]> {
        let ends = span.map(|t| self.place(t));
        let (low, high) = (heights[0], heights[1]);
        let hair = HAIR * (high - low) + 1e-12 * low.abs().max(high.abs()) + 1e-14 * self.spread.globe.reach();
        let boxes =
            [[rows[0] - HAIR, rows[1] + HAIR], [columns[0] - HAIR, columns[1] + HAIR], [low - hair, high + hair]];
        let passes = |axis: usize| {
            let (a, b) = (ends[0][axis], ends[1][axis]);
            a.max(b) >= boxes[axis][0] && a.min(b) <= boxes[axis][1]
        };
        if !(0..3).all(passes) {
            return None;
        }
        let [mut from, mut to] = span;
        for axis in [1, 0, 2] {
            let [low, high] = boxes[axis];
            let (a, b) = (ends[0][axis], ends[1][axis]);
            let (enters, leaves) = if a <= b { (low, high) } else { (high, low) };
            // Ahead of the value is on the course's way.
            let way = if a <= b { 1.0 } else { -1.0 };
            if way * (a - enters) < 0.0 {
                from = from.max(self.at(axis, enters, span, [a, b]));
            }
            if way * (b - leaves) > 0.0 {
                to = to.min(self.at(axis, leaves, span, [a, b]));
            }
        }
        // Where it is found is not exact.
        let slack = 1e-13 * from.abs().max(to.abs());
        let (from, to) = ((from - slack).max(span[0]), (to + slack).min(span[1]));
        (from <= to).then_some([from, to])
    }

    /// Where in a span a row (axis 0), a column (1) or what is above the globe (2) has a value between those at its ends.
    fn at(&self, axis: usize, value: f64, span: [f64; 2], ends: [f64; 2]) -> f64 {
        let Line { origin, direction } = self.line;
        if axis == 1 {
            // A plane through the axis.
            let longitude = self.spread.step[0].mul_add(value, self.spread.origin[0]) - self.turned;
            let (sin, cos) = longitude.to_radians().sin_cos();
            let t = (sin * origin[0] - cos * origin[1]) / (cos * direction[1] - sin * direction[0]);
            if t.is_finite() {
                return t.clamp(span[0], span[1]);
            }
        }
        if axis == 0 {
            // A cone about the axis, whose point is where the normals of this latitude meet.
            let latitude = self.spread.step[1].mul_add(value, self.spread.origin[1]);
            let (sin, cos) = latitude.to_radians().sin_cos();
            let [_, middle] = self.spread.globe.axis(latitude);
            let beyond = |t: f64| {
                let [x, y, z] = self.line.at(t);
                (z - middle) * cos - x.hypot(y) * sin
            };
            let found = span.map(beyond);
            if found[0] * found[1] < 0.0 {
                return between(span, found, beyond);
            }
        }
        between(span, ends.map(|end| end - value), |t| self.place(t)[axis] - value)
    }

    /// Where a span meets a triangle's plane `[p, q, s]` over a cell (heights above the globe `p + q u + s v`) that begins at a row and a column and
    /// is so many rows and columns large: at most two places, the nearer one first.
    pub fn meets(
        &self,
        first: [f64; 2],
        size: [f64; 2],
        [p, q, s]: [f64; 3],
        [from, to]: [f64; 2],
    ) -> [Option<Crossing>; 2] {
        let above = |t: f64| {
            let [row, column, height] = self.place(t);
            height - (p + q * (column - first[1]) / size[1] + s * (row - first[0]) / size[0])
        };
        let crossing = |t: f64| {
            let [row, column, _] = self.place(t);
            Crossing { t, row, column }
        };
        let (start, end) = (above(from), above(to));
        if start == 0.0 || end == 0.0 || (start > 0.0) != (end > 0.0) {
            let t = match (start == 0.0, end == 0.0) {
                (true, _) => from,
                (_, true) => to,
                _ => between([from, to], [start, end], above),
            };
            return [Some(crossing(t)), None];
        }
        // From above the surface a ray may pass below it and rise again.
        let small = 1e-3 * (to - from);
        if start < 0.0 || above(from + small) >= start || above(to - small) >= end {
            return [None; 2];
        }
        let (mut low, mut high) = (from, to);
        for _ in 0..48 {
            let (one, other) = (low + 0.382 * (high - low), high - 0.382 * (high - low));
            let found = [above(one), above(other)];
            let lowest = if found[0] < found[1] { (one, found[0]) } else { (other, found[1]) };
            if lowest.1 < 0.0 {
                let ends = [([from, lowest.0], [start, lowest.1]), ([lowest.0, to], [lowest.1, end])];
                return ends.map(|(span, values)| Some(crossing(between(span, values, above))));
            }
            if found[0] < found[1] { high = other } else { low = one }
        }
        [None; 2]
    }
}
