//! Leaves: source particles, placed as exactly as their smoothing lengths ask for.

use super::piece::{Piece, Words};
use super::sorted::Sorted;
use super::{Context, Encoding};
use crate::codec::coordinates::{LEAF_BITS, bin, pack_leaf, unpack_leaf};
use crate::codec::positions::{BLOCK, coarsen_leaf};
use crate::hierarchy::NodeKey;
use crate::model::Bounds;
use std::ops::Range;

/// A particle's position is rounded to a grid at least this many times finer than the smallest smoothing length of the
/// [`BLOCK`] particles that it is stored with (or to 21 bits a coordinate, if that is coarser): its centre moves by less than
/// 1/590 of its kernel's radius, so that by the time that is a pixel the kernel is larger than most pictures.
const STEPS_PER_SMOOTHING_LENGTH: f64 = 512.0;

/// The leaf that holds a run of the sorted particles.
pub(super) fn leaf(context: &Context, sorted: &Sorted, key: NodeKey, range: Range<usize>) -> Piece<Words> {
    let columns = sorted.columns.slice(range.clone());
    let units = &sorted.units[range.clone()];
    let NodeKey { depth, x, y, z } = key.cell();
    let cells = f64::from(depth).exp2();
    // A power of two has an exact reciprocal.
    let step = 1.0 / cells;
    let quantum = key.size(context.root) / f64::from(1 << LEAF_BITS);
    let cell = [x, y, z].map(f64::from);
    let mut words = Vec::with_capacity(range.len());
    let (mut bounds, mut delta_squared) = (Bounds::of(units.iter().copied()), 0.0_f64);
    for (units, lengths) in units.chunks(BLOCK).zip(columns.smoothing_length.chunks(BLOCK)) {
        let smallest = lengths.iter().fold(f32::INFINITY, |least, &h| least.min(h));
        let steps = (f64::from(smallest) / (STEPS_PER_SMOOTHING_LENGTH * quantum)).log2();
        // The cast saturates: what needs all bits keeps them.
        let levels = if context.options.exact_positions { 0 } else { (steps.floor() as u32).min(LEAF_BITS - 1) };
        for (unit, &h) in units.iter().zip(lengths) {
            let bins = std::array::from_fn(|axis| bin(unit[axis] * cells - cell[axis], LEAF_BITS));
            let word = coarsen_leaf(pack_leaf(bins, f64::from(h) <= quantum), levels);
            let fraction = unpack_leaf(word);
            let decoded: [f64; 3] = std::array::from_fn(|axis| (cell[axis] + f64::from(fraction[axis])) * step);
            let distance: f64 = (0..3).map(|axis| (decoded[axis] - unit[axis]).powi(2)).sum();
            delta_squared = delta_squared.max(distance);
            bounds = bounds.with(decoded.into());
            words.push(word);
        }
    }
    let masses = || columns.mass.iter().zip(&columns.density).map(|(&m, &rho)| (f64::from(m), f64::from(rho)));
    Piece {
        key,
        first: sorted.keys[range.start],
        encoding: Encoding::Leaf,
        whole: true,
        particles: range.len() as u64,
        points: words.iter().filter(|&&word| word >> 63 != 0).count() as u64,
        sources: range.len() as u64,
        input: 0,
        merged: range.len() as u64,
        delta: delta_squared.sqrt(),
        bounds,
        smoothing_length_max: columns.smoothing_length.iter().fold(0.0, |most, &h| h.max(most)),
        mass: masses().map(|(m, _)| m).sum(),
        mass_density: masses().map(|(m, rho)| m * rho).sum(),
        data: Words::Leaf(words, columns),
    }
}
