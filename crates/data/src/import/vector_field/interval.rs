//! The field between two of its times.

use super::axis::Axis;
use super::cell::{Cell, ORDERS, hermite};
use rayon::prelude::*;
use std::sync::Arc;

/// Velocities at all nodes at one time, x fastest; none of them is a number where the field has none.
pub(super) type Slab = Vec<[f32; 3]>;

/// The field between two of its times; of a steady one at all times.
#[derive(Clone)]
pub struct Interval {
    axes: Arc<[Axis; 3]>,
    /// The slabs before, at both ends, and behind; of a steady field one, the second.
    slabs: [Option<Arc<Slab>>; 4],
    times: [f64; 4],
}

impl Interval {
    /// A field that stays as it is.
    pub(super) fn steady(axes: &Arc<[Axis; 3]>, slab: Arc<Slab>) -> Interval {
        Interval { axes: Arc::clone(axes), slabs: [None, Some(slab), None, None], times: [0.0, 0.0, 1.0, 1.0] }
    }

    /// The field between the second and the third of these.
    pub(super) fn unsteady(axes: &Arc<[Axis; 3]>, slabs: [Option<Arc<Slab>>; 4], times: [f64; 4]) -> Interval {
        Interval { axes: Arc::clone(axes), slabs, times }
    }

    fn is_steady(&self) -> bool {
        self.slabs[2].is_none()
    }

    /// The times at its ends; without end of a steady field.
    pub fn times(&self) -> [f64; 2] {
        if self.is_steady() { [f64::NEG_INFINITY, f64::INFINITY] } else { [self.times[1], self.times[2]] }
    }

    /// Velocity at a place, length units per unit of time; `None` outside, and in cells one of whose nodes has none.
    pub fn velocity(&self, place: [f64; 3], time: f64) -> Option<[f64; 3]> {
        let (cell, shares) = self.locate(place)?;
        Some(self.cell(cell)?.velocity(shares, time))
    }

    /// The cell that a place is in, and where in it.
    pub(super) fn locate(&self, place: [f64; 3]) -> Option<([i64; 3], [f64; 3])> {
        let [x, y, z] = &*self.axes;
        let found = [x.locate(place[0])?, y.locate(place[1])?, z.locate(place[2])?];
        Some((found.map(|(cell, _)| cell), found.map(|(_, share)| share)))
    }

    /// The axes.
    pub(super) fn axes(&self) -> &[Axis; 3] {
        &self.axes
    }

    /// What is in a cell; `None` where there is no such cell, or one of its nodes has no velocity at one of both ends.
    pub(super) fn cell(&self, number: [i64; 3]) -> Option<Cell> {
        let axes = &*self.axes;
        if axes.iter().zip(number).any(|(axis, cell)| !axis.has(cell)) {
            return None;
        }
        let ends: [[usize; 2]; 3] = std::array::from_fn(|axis| axes[axis].ends(number[axis]));
        let widths: [f64; 3] = std::array::from_fn(|axis| axes[axis].width(number[axis]));
        let orders = if self.is_steady() { 1 } else { ORDERS };
        let length = self.times[2] - self.times[1];
        let mut cell = Cell { coefficients: [[[0.0; 3]; 8]; ORDERS], orders, start: self.times[1], length, widths };
        for corner in 0..8 {
            let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| ends[axis][corner >> axis & 1]);
            let powers = self.node(x + axes[0].len() * (y + axes[1].len() * z))?;
            for (coefficients, power) in cell.coefficients.iter_mut().zip(powers) {
                coefficients[corner] = std::array::from_fn(|axis| power[axis] / widths[axis]);
            }
        }
        Some(cell)
    }

    /// The velocity of a node as powers of a share of the interval.
    fn node(&self, index: usize) -> Option<[[f64; 3]; ORDERS]> {
        let values = self.slabs.each_ref().map(|slab| {
            let value = slab.as_ref()?.get(index)?.map(f64::from);
            value.iter().all(|part| part.is_finite()).then_some(value)
        });
        if self.is_steady() {
            return values[1].map(|value| [value, [0.0; 3], [0.0; 3], [0.0; 3]]);
        }
        let mut powers = [[0.0; 3]; ORDERS];
        for axis in 0..3 {
            let own = hermite(values.map(|value| value.map(|value| value[axis])), self.times)?;
            for (power, own) in powers.iter_mut().zip(own) {
                power[axis] = own;
            }
        }
        Some(powers)
    }

    /// The velocities at all nodes at a time.
    pub(super) fn at(&self, time: f64) -> Slab {
        let share = (time - self.times[1]) / (self.times[2] - self.times[1]);
        let count = self.axes.iter().map(Axis::len).product();
        let value = |index: usize| {
            let Some(powers) = self.node(index) else { return [f32::NAN; 3] };
            std::array::from_fn(|axis| powers.iter().rev().fold(0.0, |sum, power| sum * share + power[axis]) as f32)
        };
        (0_usize..count).into_par_iter().map(value).collect()
    }
}
