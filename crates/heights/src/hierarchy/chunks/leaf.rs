//! What is found in a leaf at full resolution.

use super::cells::{self, Patch};
use super::sums::{Sums, WideLight, WideSum};

/// What a leaf's samples say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Leaf {
    /// Measured samples: those of the last row and column are the next leaf's.
    pub valid: u64,
    /// The sum of their stored values.
    pub sum: f64,
    /// Whether all samples were measured, those of the last row and column among them.
    pub is_whole: bool,
    /// The least stored value of all its samples; infinite without any.
    pub low: f64,
    /// The largest.
    pub high: f64,
    /// The largest step along an edge of T.
    pub step: f64,
    /// Of levels from 1 on what the leaf adds to their samples, those of all four borders among them.
    pub levels: Vec<Sums>,
    /// Sums over all cells.
    pub total: WideSum,
    /// And their light.
    pub light: Vec<WideLight>,
}

/// Looks at a leaf. `levels` is how many levels of samples it adds to.
pub fn leaf(patch: &Patch<'_>, slopes: [f64; 2], owns: [bool; 2], levels: u32) -> Leaf {
    let mut out = Leaf { is_whole: true, low: f64::INFINITY, high: f64::NEG_INFINITY, ..Leaf::default() };
    let [rows, columns] = patch.size;
    for row in 0..rows {
        let samples = patch.row(row);
        let mut is_whole = true;
        for value in samples {
            out.low = if *value < out.low { *value } else { out.low };
            out.high = if *value > out.high { *value } else { out.high };
            is_whole &= !value.is_nan();
        }
        out.is_whole &= is_whole;
        if row + usize::from(!owns[0]) < rows {
            let own = &samples[..columns - usize::from(!owns[1])];
            let valid = own.iter().filter(|value| !value.is_nan());
            out.valid += valid.clone().count() as u64;
            out.sum += valid.sum::<f64>();
        }
    }
    out.step = largest_step((0..rows).map(|row| patch.row(row)), out.is_whole);
    let mut blocks = cells::sums(patch, slopes, owns);
    for level in 1..=levels {
        let [rows, columns] = patch.size.map(|count| (count - 1).div_ceil(1 << level) + 1);
        out.levels.push(blocks.about_samples(rows, columns));
        blocks = blocks.halved();
    }
    // Short of the top there is more than one block left.
    for sum in &blocks.sums {
        out.total.add(&(*sum).into());
    }
    out.light = vec![[0; 2]; patch.planes.len()];
    for (at, light) in blocks.light.iter().enumerate() {
        let own = &mut out.light[at % patch.planes.len()];
        own[0] += u128::from(light[0]);
        own[1] += u128::from(light[1]);
    }
    out
}

/// The largest step along an edge of the surface of these samples, diagonals among them.
pub fn largest_step<'a>(rows: impl Iterator<Item = &'a [f64]>, is_whole: bool) -> f64 {
    let larger = |most: f64, step: f64| if step.abs() > most { step.abs() } else { most };
    let mut most = 0.0;
    let mut above: Option<&[f64]> = None;
    for row in rows {
        most = row.windows(2).fold(most, |most, pair| larger(most, pair[1] - pair[0]));
        if let Some(above) = above {
            most = row.iter().zip(above).fold(most, |most, (value, up)| larger(most, value - up));
            most = row[1..].iter().zip(above).fold(most, |most, (value, up)| larger(most, value - up));
            if !is_whole {
                // Where a corner is missing the edge may be the other diagonal.
                for (up, own) in above.windows(2).zip(row.windows(2)) {
                    if up[0].is_nan() || own[1].is_nan() {
                        most = larger(most, up[1] - own[0]);
                    }
                }
            }
        }
        above = Some(row);
    }
    most
}
