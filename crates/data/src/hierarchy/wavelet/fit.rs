//! Values of large points whose footprints overlap: those of least squares.
//!
//! Where all nodes of a level are drawn as one large point each, and each point reaches to the middles of its neighbours with a weight
//! that falls linearly, the level is a spline of first degree. Its values of least error solve `T V = U^T s`, where `U` spreads values
//! to cells and `T = U^T U` couples neighbours only: per axis a filter with three taps, whose inverse falls by 0.27 from node to node. It is
//! cut off after [`REACH`] nodes, so a value depends on samples up to that far away and on no others.

use super::grid::{Shape, for_each_place, index, volume};

/// How many nodes away a node's value still depends on samples.
pub const REACH: usize = 7;

/// A filter along an axis: output `i` is the sum of `taps[j]` times input `i * stride + j - before`, mirrored at the ends of `whole` inputs and
/// clamped to those that are there.
struct Filter {
    taps: Vec<f32>,
    stride: usize,
    before: usize,
}

fn along(values: &[f32], shape: Shape, axis: usize, outputs: usize, filter: &Filter) -> (Vec<f32>, Shape) {
    let step: usize = shape[..axis].iter().product();
    let (present, whole) = (shape[axis], (outputs * filter.stride) as isize);
    let mut to = shape;
    to[axis] = outputs;
    // Where each output's inputs lie, once for all lines.
    let inputs: Vec<u32> = (0..outputs)
        .flat_map(|i| (0..filter.taps.len()).map(move |j| (i * filter.stride + j) as isize - filter.before as isize))
        .map(|at| {
            let period = 2 * whole;
            let folded = at.rem_euclid(period);
            let folded = if folded >= whole { period - 1 - folded } else { folded };
            ((folded as usize).min(present - 1) * step) as u32
        })
        .collect();
    let taps = filter.taps.len();
    let out = for_each_place(to, |at| {
        let mut from = at;
        from[axis] = 0;
        let base = index(shape, from);
        let inputs = &inputs[at[axis] * taps..(at[axis] + 1) * taps];
        inputs.iter().zip(&filter.taps).map(|(&i, t)| t * values[base + i as usize]).sum::<f32>()
    });
    (out, to)
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

/// The values of least squares of a level whose nodes have `side` cells along each axis; `cells` are the cells' means.
pub fn overlapping(dimensions: usize, cells: &[f32], shape: Shape, nodes: Shape, side: usize) -> Vec<f32> {
    let mut values = cells.to_vec();
    let mut at = shape;
    for (axis, &count) in nodes.iter().enumerate().take(dimensions) {
        let filter = Filter { taps: tent(side), stride: side, before: side / 2 };
        (values, at) = along(&values, at, axis, count, &filter);
    }
    for (axis, &count) in nodes.iter().enumerate().take(dimensions) {
        let filter = Filter { taps: inverse(side), stride: 1, before: REACH };
        (values, at) = along(&values, at, axis, count, &filter);
    }
    debug_assert_eq!(volume(at), values.len());
    values
}
