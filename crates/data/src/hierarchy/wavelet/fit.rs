//! Values of large points whose footprints overlap: those of least squares.
//!
//! Where all nodes of a level are drawn as one large point each, and each point reaches to the middles of its neighbours with a weight
//! that falls linearly, the level is a spline of first degree. Its values of least error solve `T V = U^T s`, where `U` spreads values
//! to cells and `T = U^T U` couples neighbours only: per axis a filter with three taps, whose inverse falls by 0.27 from node to node. It is
//! cut off after [`REACH`] nodes, so a value depends on samples up to that far away and on no others: bricks are built one by one, and
//! each finds what it would have found in the whole grid.

use super::bricks::Part;
use super::grid::Shape;
use rayon::prelude::*;
use std::ops::Range;

/// How many nodes away a node's value still depends on samples.
pub(super) const REACH: usize = 7;

/// A filter along an axis: output `i` is the sum of `taps[j]` times input `i * stride + j - before`, mirrored at the ends of `stride` times
/// `outputs` inputs and clamped to the `inputs` that there are, both in the whole level.
struct Filter {
    taps: Vec<f32>,
    stride: usize,
    before: usize,
    outputs: usize,
    inputs: usize,
}

/// The outputs `to` from the values in a box that has all their inputs.
fn along(values: &[f32], part: &Part, axis: usize, to: Range<usize>, filter: &Filter) -> (Vec<f32>, Part) {
    let step: usize = part.shape[..axis].iter().product();
    let whole = (filter.outputs * filter.stride) as isize;
    let mut out = *part;
    (out.min[axis], out.shape[axis]) = (to.start, to.len());
    // Where each output's inputs lie, once for all lines.
    let inputs: Vec<u32> = to
        .flat_map(|i| (0..filter.taps.len()).map(move |j| (i * filter.stride + j) as isize - filter.before as isize))
        .map(|at| {
            let period = 2 * whole;
            let folded = at.rem_euclid(period);
            let folded = if folded >= whole { period - 1 - folded } else { folded };
            (((folded as usize).min(filter.inputs - 1) - part.min[axis]) * step) as u32
        })
        .collect();
    let taps = filter.taps.len();
    let mut outputs = vec![0.0_f32; out.len()];
    let row = out.shape[0].max(1);
    // Short rows together, as one task.
    let rows = outputs.par_chunks_mut(row).with_min_len((2048 / row).max(1)).enumerate();
    rows.for_each(|(r, outputs)| {
        let at = [0, r % out.shape[1], r / out.shape[1]];
        let mut from = at;
        from[axis] = 0;
        let base = super::grid::index(part.shape, from);
        if axis == 0 {
            for (output, inputs) in outputs.iter_mut().zip(inputs.chunks_exact(taps)) {
                *output = inputs.iter().zip(&filter.taps).map(|(&i, t)| t * values[base + i as usize]).sum();
            }
            return;
        }
        // Whole rows at once, each sum to the same bit as one alone: a sum of floats begins with this zero.
        outputs.fill(-0.0);
        for (&i, t) in inputs[at[axis] * taps..(at[axis] + 1) * taps].iter().zip(&filter.taps) {
            let first = base + i as usize;
            outputs.iter_mut().zip(&values[first..first + row]).for_each(|(sum, v)| *sum += t * v);
        }
    });
    (outputs, out)
}

/// The weights of a point at the cells around it: it reaches from its node's middle one extent to each side, `side` cells a node.
fn tent(side: usize) -> Vec<f32> {
    let n = 2 * side;
    (0..n).map(|j| 1.0 - ((j as f32 + 0.5) / side as f32 - 1.0).abs()).collect()
}

/// The taps of the inverse of `T` along an axis, for `side` cells a node.
fn inverse(side: usize) -> Vec<f32> {
    let w: Vec<f64> = tent(side).into_iter().map(f64::from).collect();
    let own: f64 = w.iter().map(|w| w * w).sum();
    let next: f64 = (0..side).map(|j| w[j] * w[j + side]).sum();
    let root = (own * own - 4.0 * next * next).max(0.0).sqrt();
    let ratio = if next > 0.0 { (root - own) / (2.0 * next) } else { 0.0 };
    let raw: Vec<f64> = (-(REACH as i32)..=REACH as i32)
        .map(|k| libm::pow(ratio.abs(), f64::from(k.abs())) * if k % 2 == 0 { 1.0 } else { -1.0 })
        .collect();
    // A constant stays one: the weights of a point sum to `own + 2 next`.
    let sum: f64 = raw.iter().sum::<f64>() * (own + 2.0 * next);
    raw.into_iter().map(|v| (v / sum) as f32).collect()
}

/// The cells that [`tents`] of the nodes in a box needs, of a level of cells of the shape `of`.
pub(super) fn cells_of_tents(dimensions: usize, nodes: &Part, side: usize, of: Shape) -> Part {
    let end = nodes.end();
    let before = side / 2;
    let first: Shape =
        std::array::from_fn(|k| if k < dimensions { (nodes.min[k] * side).saturating_sub(before) } else { 0 });
    let last: Shape = std::array::from_fn(|k| if k < dimensions { (end[k] * side + before).min(of[k]) } else { of[k] });
    Part { min: first, shape: std::array::from_fn(|k| last[k] - first[k]) }
}

/// `U^T s` of the nodes in a box of a level of the shape `of`, with `side` cells a node along each axis: from means of cells in a box of
/// a level of the shape `cells_of`.
pub(super) fn tents(
    dimensions: usize,
    (cells, cells_part, cells_of): (&[f32], &Part, Shape),
    (nodes, of): (&Part, Shape),
    side: usize,
) -> Vec<f32> {
    let (mut values, mut part) = (Vec::new(), *cells_part);
    let end = nodes.end();
    for axis in 0..dimensions {
        let (taps, before) = (tent(side), side / 2);
        let filter = Filter { taps, stride: side, before, outputs: of[axis], inputs: cells_of[axis] };
        let from = if axis == 0 { cells } else { &values };
        (values, part) = along(from, &part, axis, nodes.min[axis]..end[axis], &filter);
    }
    values
}

/// The values of least squares of the nodes in a box of a level of the shape `of`, from tents in a box that is [`REACH`] wider.
pub(super) fn splines(
    dimensions: usize,
    (tents, tents_part): (&[f32], &Part),
    (nodes, of): (&Part, Shape),
    side: usize,
) -> Vec<f32> {
    let (mut values, mut part) = (Vec::new(), *tents_part);
    let end = nodes.end();
    for axis in 0..dimensions {
        let filter = Filter { taps: inverse(side), stride: 1, before: REACH, outputs: of[axis], inputs: of[axis] };
        let from = if axis == 0 { tents } else { &values };
        (values, part) = along(from, &part, axis, nodes.min[axis]..end[axis], &filter);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::super::grid::{index, place, volume};
    use super::*;
    use crate::synth::random::Random;

    #[test]
    fn rows_at_once_are_what_each_line_alone_is() {
        let mut random = Random::new(5, 1);
        // Part of a level of 40 cells along the axis, its end among them.
        let lengths = [23, 37, 5];
        let from = |axis: usize| -> Part {
            let mut part = Part { min: [0; 3], shape: std::array::from_fn(|k| lengths[(k + 3 - axis) % 3]) };
            part.min[axis] = 17;
            part
        };
        let along_x = from(0);
        let values: Vec<f32> = (0..along_x.len()).map(|_| random.signed() as f32).collect();
        let splines = Filter { taps: inverse(4), stride: 1, before: REACH, outputs: 40, inputs: 40 };
        let tents = Filter { taps: tent(2), stride: 2, before: 1, outputs: 20, inputs: 40 };
        for (to, filter) in [(24..40, splines), (10..20, tents)] {
            let (expected, whole) = along(&values, &along_x, 0, to.clone(), &filter);
            for (i, own) in expected.iter().enumerate() {
                let [output, y, z] = whole.place(i);
                let inputs = (0..filter.taps.len()).map(|j| {
                    let at = (output * filter.stride + j) as isize - filter.before as isize;
                    let at = if at < 40 { at } else { 79 - at };
                    filter.taps[j] * values[along_x.index([at as usize, y, z])]
                });
                assert_eq!(own.to_bits(), inputs.sum::<f32>().to_bits());
            }
            for axis in [1, 2] {
                // The same with axes turned round.
                let part = from(axis);
                let turned = |at: Shape| -> Shape { std::array::from_fn(|k| at[(k + axis) % 3]) };
                let same: Vec<f32> = (0..volume(part.shape))
                    .map(|i| values[index(along_x.shape, turned(place(part.shape, i)))])
                    .collect();
                let (found, out) = along(&same, &part, axis, to.clone(), &filter);
                for (i, own) in found.iter().enumerate() {
                    let other = expected[index(whole.shape, turned(place(out.shape, i)))];
                    assert_eq!(own.to_bits(), other.to_bits(), "{axis}, {i}");
                }
            }
        }
    }
}
