//! Where a ray may pass, told quickly: by products with the inverse of its direction, in boxes whose ends are farther out than
//! [`within`](super::within) has them, by more than what is rounded. So it only leaves out what `within` leaves out, too, and whether squares that
//! are left are met is told there: the picture is the same to the bit.

use super::super::placed::GridRay;
use super::{Range, hair_along, hair_of};

/// How much farther out ends are: in hairs, and in parts of the numbers that they are told from.
const HAIRS: f64 = 4.0;
const ROUNDED: f64 = 1e-14;

/// How far beyond its ends a stretch may meet something, in cells and in parts of the places: by far more than hairs, and what is rounded.
const WIDER: f64 = 1e-6;

/// No end.
const ALL: Range = [f64::NEG_INFINITY, f64::INFINITY];

/// A ray, and what it has in common for all boxes. Axes are its own: columns, rows, heights.
pub(super) struct Passing<'a> {
    pub(super) ray: &'a GridRay,
    /// The stretch of it that is looked at.
    pub(super) part: [f64; 2],
    /// Rows and columns of the parts of four, in the order in which the ray may be in them.
    pub(super) order: [[usize; 2]; 4],
    /// Its origin, farther ahead and farther back than it is.
    ahead: [f64; 3],
    back: [f64; 3],
    inverse: [f64; 3],
}

impl<'a> Passing<'a> {
    /// For boxes that are all in this one.
    pub(super) fn new(ray: &'a GridRay, part: [f64; 2], [rows, columns]: [[f64; 2]; 2], range: Range) -> Passing<'a> {
        let most = [columns[1], rows[1], range[0].abs().max(range[1].abs())];
        let hairs = [hair_along(columns[1]), hair_along(rows[1]), hair_of(range)];
        let (mut ahead, mut back, mut inverse) = (ray.origin, ray.origin, [0.0; 3]);
        for axis in 0..3 {
            inverse[axis] = ray.direction[axis].recip();
            // What hardly moves has no inverse that says anything; what does not move has one that says on which side it stays.
            let is_lost = inverse[axis].is_infinite() && ray.direction[axis] != 0.0;
            let wider = HAIRS * hairs[axis] + ROUNDED * (ray.origin[axis].abs() + most[axis]);
            let wider = if is_lost { f64::INFINITY } else { wider };
            ahead[axis] += wider;
            back[axis] -= wider;
            if is_lost {
                inverse[axis] = 1.0;
            }
        }
        // 1 where it goes to smaller numbers.
        let (down, right) = (usize::from(ray.direction[1] < 0.0), usize::from(ray.direction[0] < 0.0));
        let order = [[down, right], [down, 1 - right], [1 - down, right], [1 - down, 1 - right]];
        Passing { ray, part, order, ahead, back, inverse }
    }

    /// The part of a span in a box; `None` where the ray passes by.
    #[inline]
    pub(super) fn through(&self, [rows, columns]: [[f64; 2]; 2], range: Range, span: [f64; 2]) -> Option<[f64; 2]> {
        self.over(range, self.cut(1, rows, self.cut(0, columns, span)))
    }

    /// The part of a span in a range of heights.
    #[inline]
    pub(super) fn over(&self, range: Range, span: [f64; 2]) -> Option<[f64; 2]> {
        let [from, to] = self.cut(2, range, span);
        (range[0] <= range[1] && from <= to).then_some([from, to])
    }

    #[inline]
    fn cut(&self, axis: usize, [low, high]: Range, [from, to]: [f64; 2]) -> [f64; 2] {
        // Where an end is no number it counts nothing: the other one tells of rays that stay beside the box.
        let a = (low - self.ahead[axis]) * self.inverse[axis];
        let b = (high - self.back[axis]) * self.inverse[axis];
        [from.max(a.min(b)), to.min(a.max(b))]
    }

    /// The places of an axis that a stretch of the ray is between, farther out than anything that it meets there.
    #[inline]
    pub(super) fn ends(&self, axis: usize, [from, to]: [f64; 2]) -> [f64; 2] {
        let (origin, direction) = (self.ray.origin[axis], self.ray.direction[axis]);
        // However long it is.
        if direction == 0.0 {
            return [origin - WIDER * (1.0 + origin.abs()), origin + WIDER * (1.0 + origin.abs())];
        }
        let (a, b) = (from * direction + origin, to * direction + origin);
        let wider = WIDER * (1.0 + origin.abs() + a.abs().max(b.abs()));
        [a.min(b) - wider, a.max(b) + wider]
    }

    /// The stretches of the ray before and beyond a place of an axis; all of it where there is none.
    #[inline]
    pub(super) fn halves(&self, axis: usize, place: Option<f64>) -> [Range; 2] {
        let Some(place) = place else { return [ALL, ALL] };
        let inverse = self.inverse[axis];
        let (before, beyond) = ((place - self.back[axis]) * inverse, (place - self.ahead[axis]) * inverse);
        match inverse > 0.0 {
            true => [[f64::NEG_INFINITY, before], [beyond, f64::INFINITY]],
            false => [[before, f64::INFINITY], [f64::NEG_INFINITY, beyond]],
        }
    }
}
