//! Means, ranges and variations of samples over the nodes of every level.

use super::grid::{Shape, children, coarser, for_each_place, place, volume};
use rayon::prelude::*;

/// One level of a plane's pyramid; level 0 are the samples themselves.
#[derive(Clone, Debug, Default)]
pub struct Means {
    /// Mean of a node's samples.
    pub mean: Vec<f32>,
    /// Smallest of them.
    pub low: Vec<f32>,
    /// Largest of them.
    pub high: Vec<f32>,
    /// Sum of their squared deviations from the mean. Laur's and Hanrahan's error is the root of its mean (WM03 equation 5, whose sign
    /// within the root is a misprint: `mean s^2 - (mean s)^2` is meant).
    pub variation: Vec<f32>,
}

/// Number of samples of every node of a level.
pub(super) fn counts(dimensions: usize, samples: Shape, level: usize) -> impl Fn(Shape) -> usize + Sync {
    let side: Shape = std::array::from_fn(|k| if k < dimensions { 1 << level } else { 1 });
    move |at: Shape| (0..3).map(|k| (samples[k] - (at[k] * side[k]).min(samples[k])).min(side[k])).product()
}

/// The shapes of all levels, the samples' first; the last has one node.
pub(super) fn shapes(dimensions: usize, samples: Shape) -> Vec<Shape> {
    let mut shapes = vec![samples];
    let mut shape = samples;
    while volume(shape) > 1 {
        shape = coarser(dimensions, shape);
        shapes.push(shape);
    }
    shapes
}

/// The pyramid of a plane above its samples; element 0 is level 1.
pub(super) fn means(dimensions: usize, shapes: &[Shape], samples: &[f32]) -> Vec<Means> {
    let mut levels: Vec<Means> = Vec::with_capacity(shapes.len());
    for level in 1..shapes.len() {
        let (finer, shape) = (shapes[level - 1], shapes[level]);
        let count = counts(dimensions, shapes[0], level - 1);
        let below = levels.last();
        let of = |at: Shape| {
            let (mut low, mut high, mut sum, mut number) = (f32::INFINITY, f32::NEG_INFINITY, 0.0_f64, 0.0_f64);
            for child in children(dimensions, finer, at) {
                let n = count(place(finer, child)) as f64;
                let (mean, least, most) = below.map_or((samples[child], samples[child], samples[child]), |b| {
                    (b.mean[child], b.low[child], b.high[child])
                });
                low = low.min(least);
                high = high.max(most);
                sum += n * f64::from(mean);
                number += n;
            }
            // Rounding must not leave the range: a constant stays what it is.
            let mean = ((sum / number) as f32).clamp(low, high);
            let mut variation = 0.0_f64;
            for child in children(dimensions, finer, at) {
                let n = count(place(finer, child)) as f64;
                let (own, inner) = below.map_or((samples[child], 0.0), |b| (b.mean[child], b.variation[child]));
                let off = f64::from(own) - f64::from(mean);
                variation += n * off * off + f64::from(inner);
            }
            (mean, low, high, variation as f32)
        };
        let all = for_each_place(shape, of);
        levels.push(Means {
            mean: all.par_iter().map(|v| v.0).collect(),
            low: all.par_iter().map(|v| v.1).collect(),
            high: all.par_iter().map(|v| v.2).collect(),
            variation: all.par_iter().map(|v| v.3).collect(),
        });
    }
    levels
}
