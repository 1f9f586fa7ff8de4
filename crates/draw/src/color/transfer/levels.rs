//! Numbers in place of automatic ranges.

use super::{Range, Scale, TransferFunction};
use crate::color::Accumulation;

/// The ranges in use for one picture, with [`Range::Auto`] replaced by numbers. `min < max`, both positive on a
/// logarithmic scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    /// `P_min`, `P_max`.
    pub p: [f64; 2],
    /// Ends of the range of `S`.
    pub s: [f64; 2],
}

impl TransferFunction {
    /// The ranges for a picture. Automatic ones come from percentiles of the pixels where anything was drawn (for `S`:
    /// of those that are not black), and never are empty. On a logarithmic scale a range that is not positive becomes
    /// the six decades below its maximum.
    pub fn levels(&self, picture: &Accumulation) -> Levels {
        let p = match self.range {
            Range::Fixed(min, max) => self.scale.usable([min, max]),
            Range::Auto => {
                let above = |least: f64| picture.p.iter().copied().filter(move |&p| f64::from(p) > least);
                let [max] = percentiles(above(0.0), [0.9995]);
                // The least that a scale begins with. What is fainter does not count below either: it is as much the
                // interpolation's ringing as light.
                let least = 1e-6 * max;
                let [quarter] = percentiles(above(least), [0.25]);
                // A little below the first quarter: the faint rims of kernels would waste most of the scale.
                let min = (0.25 * quarter).max(least);
                self.scale.usable([if self.scale == Scale::Log { min } else { 0.0 }, max])
            }
        };
        let hue = self.hue.clone().unwrap_or_default();
        let s = match hue.range {
            Range::Fixed(min, max) => hue.scale.usable([min, max]),
            Range::Auto => {
                let pairs = picture.p.iter().zip(&picture.ps);
                let lit = pairs.filter(|&(&value, _)| f64::from(value) > p[0]).map(|(&value, &ps)| ps / value);
                hue.scale.usable(Range::apart(percentiles(lit, [0.02, 0.98])))
            }
        };
        Levels { p, s }
    }
}

impl TransferFunction {
    /// Its ranges where no picture is asked for them.
    pub fn numbers(&self) -> Option<Levels> {
        let number = |scale: Scale, range: Range| match range {
            Range::Fixed(low, high) => Some(scale.usable([low, high])),
            Range::Auto => None,
        };
        let s = self.hue.as_ref().map_or(Some([0.0, 1.0]), |hue| number(hue.scale, hue.range));
        Some(Levels { p: number(self.scale, self.range)?, s: s? })
    }

    /// The same with these numbers in place of automatic ranges.
    pub fn with_levels(mut self, levels: &Levels) -> TransferFunction {
        let fixed = |scale: Scale, ends: [f64; 2]| {
            let [low, high] = scale.usable(ends);
            Range::Fixed(low, high)
        };
        if self.range == Range::Auto {
            self.range = fixed(self.scale, levels.p);
        }
        if let Some(hue) = self.hue.as_mut().filter(|hue| hue.range == Range::Auto) {
            hue.range = fixed(hue.scale, levels.s);
        }
        self
    }
}

/// Values at two shares of the sorted finite values; zeros for none. At most a few hundred thousand values are looked
/// at, evenly spread.
fn percentiles<const N: usize>(values: impl Iterator<Item = f32>, shares: [f64; N]) -> [f64; N] {
    const ENOUGH: usize = 1 << 18;
    let mut sample: Vec<f32> = values.filter(|value| value.is_finite()).collect();
    if sample.len() > 2 * ENOUGH {
        let step = sample.len() / ENOUGH;
        sample = sample.into_iter().step_by(step).collect();
    }
    if sample.is_empty() {
        return [0.0; N];
    }
    shares.map(|share| {
        let rank = ((sample.len() - 1) as f64 * share).round() as usize;
        f64::from(*sample.select_nth_unstable_by(rank, f32::total_cmp).1)
    })
}
