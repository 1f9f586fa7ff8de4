//! Means, ranges and variations of samples over the nodes of every level.

use super::bricks::Part;
use super::grid::{Shape, children_in, for_each_place};
use rayon::prelude::*;

/// What the nodes in a box of a level are, of one plane; at level 0 there are only means, the samples themselves.
#[derive(Clone, Debug, Default)]
pub(super) struct Means {
    /// Mean of a node's samples.
    pub mean: Vec<f32>,
    /// Smallest of them.
    pub low: Vec<f32>,
    /// Largest of them.
    pub high: Vec<f32>,
    /// Sum of their squared deviations from the mean. Laur's and Hanrahan's error is the root of its mean (WM03 equation 5, whose sign
    /// within the root is a misprint: `mean s^2 - (mean s)^2` is meant).
    pub variation: Vec<f32>,
    /// What overlapping points ask for, see [`super::fit::tents`]; none where they are not needed.
    pub tent: Vec<f32>,
}

/// Numbers of a node that [`Means`] has.
pub(super) const WIDTH: usize = 5;

impl Means {
    /// The columns of plane `plane` of numbers side by side, [`WIDTH`] a plane.
    pub fn of_row(row: &[f32], planes: usize, plane: usize) -> Means {
        let column = |k: usize| row.iter().skip(WIDTH * plane + k).step_by(WIDTH * planes).copied().collect();
        Means { mean: column(0), low: column(1), high: column(2), variation: column(3), tent: column(4) }
    }

    /// Numbers of all planes' columns side by side.
    pub fn to_rows(planes: &[Means]) -> Vec<f32> {
        let count = planes.first().map_or(0, |means| means.mean.len());
        let mut rows = Vec::with_capacity(count * WIDTH * planes.len());
        for i in 0..count {
            for means in planes {
                let tent = means.tent.get(i).copied().unwrap_or(0.0);
                rows.extend_from_slice(&[means.mean[i], means.low[i], means.high[i], means.variation[i], tent]);
            }
        }
        rows
    }
}

/// Number of samples of every node of a level.
pub(super) fn counts(dimensions: usize, samples: Shape, level: usize) -> impl Fn(Shape) -> usize + Sync {
    let side: Shape = std::array::from_fn(|k| if k < dimensions { 1 << level } else { 1 });
    move |at: Shape| (0..3).map(|k| (samples[k] - (at[k] * side[k]).min(samples[k])).min(side[k])).product()
}

/// The nodes in a box of a level, from those of the level below in a box that has all their children. `samples` is the shape of the
/// grid, `finer` that of the level below, which is `level`.
pub(super) fn means(
    dimensions: usize,
    samples: Shape,
    (level, finer): (usize, Shape),
    (below, below_part): (&Means, &Part),
    part: &Part,
) -> Means {
    let count = counts(dimensions, samples, level);
    let of = |at: Shape| {
        let at: Shape = std::array::from_fn(|k| part.min[k] + at[k]);
        let (mut low, mut high, mut sum, mut number) = (f32::INFINITY, f32::NEG_INFINITY, 0.0_f64, 0.0_f64);
        for child in children_in(dimensions, finer, at) {
            let (n, i) = (count(child) as f64, below_part.index(child));
            let mean = below.mean[i];
            let (least, most) = if level == 0 { (mean, mean) } else { (below.low[i], below.high[i]) };
            low = low.min(least);
            high = high.max(most);
            sum += n * f64::from(mean);
            number += n;
        }
        // Rounding must not leave the range: a constant stays what it is.
        let mean = ((sum / number) as f32).clamp(low, high);
        let mut variation = 0.0_f64;
        for child in children_in(dimensions, finer, at) {
            let (n, i) = (count(child) as f64, below_part.index(child));
            let inner = if level == 0 { 0.0 } else { below.variation[i] };
            let off = f64::from(below.mean[i]) - f64::from(mean);
            variation += n * off * off + f64::from(inner);
        }
        (mean, low, high, variation as f32)
    };
    let all = for_each_place(part.shape, of);
    Means {
        mean: all.par_iter().map(|v| v.0).collect(),
        low: all.par_iter().map(|v| v.1).collect(),
        high: all.par_iter().map(|v| v.2).collect(),
        variation: all.par_iter().map(|v| v.3).collect(),
        tent: Vec::new(),
    }
}
