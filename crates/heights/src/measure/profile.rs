//! T along a polyline: exact, as T is linear between two crossings of its edges.

use super::great_circle::in_turns;
use super::part::Part;
use super::tiles::{Tiles, height_in};
use crate::model::{HeightError, HeightGrid, Heights, Lengths, units};
use rayon::prelude::*;

/// A point of a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfilePoint {
    /// How far along the polyline it is, in plan.
    pub distance: f64,
    /// Its place.
    pub x: f64,
    /// Its place.
    pub y: f64,
    /// T's height, in the unit of heights; NaN in a gap.
    pub height: f64,
}

/// T along a polyline. Between two points of which both have heights it is linear; in a gap, between its two ends, stands one point without a
/// height, half-way.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Both ends, every corner of the polyline, every crossing with an edge of T, both ends of each gap and one point inside it.
    pub points: Vec<ProfilePoint>,
    /// The polyline's length in plan.
    pub length: f64,
    /// The length over T.
    pub valid_length: f64,
}

/// Parameters of crossings are one where no more roundings than so many lie between them: where three edges meet.
const SAME: f64 = 8.0 * f64::EPSILON;

/// T along a polyline in x and y. Points that are no numbers are left out; of fewer than two points nothing is told.
///
/// # Errors
/// Where the field cannot be read.
pub fn profile(heights: &dyn Heights, polyline: &[[f64; 2]]) -> Result<Profile, HeightError> {
    let corners: Vec<[f64; 2]> = polyline.iter().copied().filter(|[x, y]| x.is_finite() && y.is_finite()).collect();
    let mut tiles = Tiles::new(heights);
    let mut drawn = Drawn { points: Vec::new(), gap: None, valid: Sum::default(), legs: Vec::new() };
    let mut length = Sum::default();
    for leg in corners.windows(2) {
        let part = (leg[1][0] - leg[0][0]).hypot(leg[1][1] - leg[0][1]);
        if part > 0.0 {
            drawn.leg(&mut tiles, Leg { before: length.value(), length: part, from: leg[0], to: leg[1] })?;
            length.add(part);
        }
    }
    let valid_length = drawn.valid.value();
    Ok(Profile { points: drawn.finish(), length: length.value(), valid_length })
}

/// Longitudes of a line are at most so many degrees from the field's.
const FARTHEST: f64 = 3600.0;

/// The same with distances that are these lengths: of places in degrees, of the line that is straight in them. Over a field that goes round a
/// globe it goes on behind the seam, where x begins anew.
///
/// # Errors
/// As [`profile`].
pub fn profile_on(heights: &dyn Heights, lengths: &Lengths, polyline: &[[f64; 2]]) -> Result<Profile, HeightError> {
    let grid = heights.grid();
    let corners: Vec<[f64; 2]> = polyline.iter().copied().filter(|[x, y]| x.is_finite() && y.is_finite()).collect();
    let is_near = corners.iter().all(|[x, _]| (x - grid.origin[0]).abs() <= FARTHEST);
    if grid.around().is_some() && is_near {
        profile_of_pieces(heights, lengths, &in_turns(grid, &corners))
    } else {
        profile_of_piece(heights, lengths, &corners)
    }
}

/// T along polylines, one behind the other. A field that goes round a globe is closed between its last column and its first.
///
/// # Errors
/// As [`profile`].
pub fn profile_of_pieces(
    heights: &dyn Heights,
    lengths: &Lengths,
    pieces: &[Vec<[f64; 2]>],
) -> Result<Profile, HeightError> {
    let closed = Part::closed(heights);
    let heights = closed.as_ref().map_or(heights, |closed| closed);
    let mut whole = Profile { points: Vec::new(), length: 0.0, valid_length: 0.0 };
    for piece in pieces {
        let found = profile_of_piece(heights, lengths, piece)?;
        let before = whole.length;
        whole
            .points
            .extend(found.points.into_iter().map(|point| ProfilePoint { distance: before + point.distance, ..point }));
        whole.length += found.length;
        whole.valid_length += found.valid_length;
    }
    Ok(whole)
}

/// [`profile_on`] a polyline of numbers that does not cross a seam.
fn profile_of_piece(heights: &dyn Heights, lengths: &Lengths, corners: &[[f64; 2]]) -> Result<Profile, HeightError> {
    let mut found = profile(heights, corners)?;
    if !units::is_degrees(&heights.grid().xy_unit) {
        return Ok(found);
    }
    // Where each leg begins and ends: by the profile's own distance, and by length.
    let mut legs = Vec::new();
    let (mut before, mut way) = (Sum::default(), Sum::default());
    for leg in corners.windows(2) {
        let part = (leg[1][0] - leg[0][0]).hypot(leg[1][1] - leg[0][1]);
        if part > 0.0 {
            legs.push((before.value(), part, way.value(), [leg[0], leg[1]]));
            before.add(part);
            way.add(lengths.along(leg[0], leg[1]));
        }
    }
    let length = way.value();
    let at = |distance: f64| {
        let next = legs.partition_point(|(begin, ..)| *begin <= distance);
        let Some((begin, part, way, [from, to])) = legs.get(next.saturating_sub(1)) else { return 0.0 };
        let share = ((distance - begin) / part).clamp(0.0, 1.0);
        let place = std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
        way + lengths.along(*from, place)
    };
    found.points.par_iter_mut().for_each(|point| point.distance = at(point.distance));
    let mut valid = Sum::default();
    for pair in found.points.windows(2).filter(|pair| pair.iter().all(|point| !point.height.is_nan())) {
        valid.add(pair[1].distance - pair[0].distance);
    }
    Ok(Profile { length, valid_length: valid.value(), ..found })
}

/// A sum with what rounding took from it (Neumaier).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    pub(crate) fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() { (self.sum - sum) + value } else { (value - sum) + self.sum };
        self.sum = sum;
    }

    pub(crate) fn value(&self) -> f64 {
        self.sum + self.lost
    }
}

/// A straight part of the polyline.
#[derive(Clone, Copy)]
struct Leg {
    /// The distance of its start.
    before: f64,
    length: f64,
    from: [f64; 2],
    to: [f64; 2],
}

impl Leg {
    fn at(&self, part: f64) -> [f64; 2] {
        match part {
            0.0 => self.from,
            1.0 => self.to,
            _ => std::array::from_fn(|axis| self.from[axis] + part * (self.to[axis] - self.from[axis])),
        }
    }

    fn point(&self, part: f64, height: f64) -> ProfilePoint {
        let [x, y] = self.at(part);
        ProfilePoint { distance: self.before + part * self.length, x, y, height }
    }
}

struct Drawn {
    points: Vec<ProfilePoint>,
    legs: Vec<Leg>,
    /// Where the gap that is open began: the index of its first point.
    gap: Option<usize>,
    valid: Sum,
}

impl Drawn {
    /// Adds a leg.
    fn leg(&mut self, tiles: &mut Tiles<'_>, leg: Leg) -> Result<(), HeightError> {
        self.legs.push(leg);
        let grid = tiles.grid();
        let mut last = None;
        for pair in crossings(grid, leg.from, leg.to).windows(2) {
            let [row, column] = grid.row_column(leg.at(0.5 * (pair[0] + pair[1])));
            let Some(on) = tiles.triangle(row, column)? else {
                self.open(leg.point(pair[0], f64::NAN), leg.point(pair[1], f64::NAN));
                last = None;
                continue;
            };
            // The part's ends are on the same triangle's edges.
            let height = |part: f64| {
                let [row, column] = grid.row_column(leg.at(part));
                let (u, v) = (column - on.column as f64, row - on.row as f64);
                height_in(&on.cell, &on.triangle, u.clamp(0.0, 1.0), v.clamp(0.0, 1.0))
            };
            self.close(leg.point(pair[0], height(pair[0])));
            // A diagonal that no triangle has is no edge.
            if last.replace((on.row, on.column, on.triangle.corners)) == Some((on.row, on.column, on.triangle.corners))
            {
                self.points.pop();
            }
            self.points.push(leg.point(pair[1], height(pair[1])));
            self.valid.add((pair[1] - pair[0]) * leg.length);
        }
        Ok(())
    }

    /// A part without a surface.
    fn open(&mut self, start: ProfilePoint, end: ProfilePoint) {
        if self.gap.is_none() {
            if self.points.is_empty() {
                self.points.push(start);
            }
            self.gap = Some(self.points.len() - 1);
        }
        // Corners and crossings inside a gap are no points of the profile: its last end moves on.
        let first = self.gap.unwrap_or(0);
        self.points.truncate(first + 1);
        self.points.push(end);
    }

    /// A part of T begins.
    fn close(&mut self, start: ProfilePoint) {
        if let Some(first) = self.gap.take() {
            self.points.truncate(first + 1);
            self.between(first, start);
            self.points.push(start);
        } else if self.points.is_empty() {
            self.points.push(start);
        }
    }

    /// The point half-way along the polyline between a gap's ends.
    fn between(&mut self, first: usize, end: ProfilePoint) {
        let distance = 0.5 * (self.points[first].distance + end.distance);
        let number = self.legs.partition_point(|leg| leg.before <= distance).saturating_sub(1);
        if let Some(leg) = self.legs.get(number) {
            let part = ((distance - leg.before) / leg.length).clamp(0.0, 1.0);
            self.points.push(ProfilePoint { distance, ..leg.point(part, f64::NAN) });
        }
    }

    fn finish(mut self) -> Vec<ProfilePoint> {
        if let (Some(first), Some(end)) = (self.gap.take(), self.points.last().copied()) {
            self.points.truncate(first + 1);
            self.between(first, end);
            self.points.push(end);
        }
        self.points
    }
}

/// The parameters, from 0 to 1, at which a leg crosses lines of the grid and diagonals of both kinds, with both ends.
fn crossings(grid: &HeightGrid, from: [f64; 2], to: [f64; 2]) -> Vec<f64> {
    let [row, column] = grid.row_column(from);
    let [last_row, last_column] = grid.row_column(to);
    let (down, right) = (last_row - row, last_column - column);
    // The part of the leg over the field.
    let slab = |start: f64, way: f64, last: f64| -> [f64; 2] {
        if way == 0.0 {
            return if (0.0..=last).contains(&start) { [0.0, 1.0] } else { [1.0, 0.0] };
        }
        let (one, other) = (-start / way, (last - start) / way);
        [one.min(other), one.max(other)]
    };
    let (along, across) = (slab(row, down, (grid.rows - 1) as f64), slab(column, right, (grid.columns - 1) as f64));
    let (enter, leave) = (along[0].max(across[0]).max(0.0), along[1].min(across[1]).min(1.0));
    let mut found = vec![0.0, 1.0];
    if enter <= leave {
        found.extend([enter, leave]);
        let reach = leave - enter;
        for (start, way) in [(row, down), (column, right), (column - row, right - down), (column + row, right + down)] {
            let (first, last) = (start + enter * way, start + leave * way);
            let (low, high) = (first.min(last).ceil(), first.max(last).floor());
            if way == 0.0 || low.partial_cmp(&high).is_none_or(std::cmp::Ordering::is_gt) || reach == 0.0 {
                continue;
            }
            let lines = (high - low) as u64;
            found.extend((0..=lines).map(|line| (low + line as f64 - start) / way));
        }
    }
    found.retain(|part| (0.0..=1.0).contains(part));
    found.sort_unstable_by(f64::total_cmp);
    let size = |ends: [f64; 2]| ends[0].abs().max(ends[1].abs());
    let least = SAME * (1.0 + size([row, last_row]).max(size([column, last_column])) / down.abs().max(right.abs()));
    let mut parts: Vec<f64> = Vec::with_capacity(found.len());
    for part in found {
        match parts.last_mut() {
            Some(last) if part - *last <= least => {
                // The leg's own ends are kept as they are.
                if part == 1.0 && *last > 0.0 {
                    *last = part;
                }
            }
            _ => parts.push(part),
        }
    }
    if parts.last() != Some(&1.0) {
        parts.push(1.0);
    }
    parts
}
