//! The material ratio curve and what ISO 25178-2 reads from it: Sk, Spk, Svk, Smr1, Smr2.
//!
//! The curve gives the height above which a share of the samples lies. Its middle part is where the secant over 40 % of the samples is least
//! steep; a straight line fitted to that part and continued to 0 % and 100 % bounds the core (ISO 13565-2).

use super::bands::map_bands;
use super::iso::Roughness;
use crate::model::{HeightError, Heights};
use rayon::prelude::*;

/// Up to so many samples are sorted; of more, heights are counted in classes.
pub(crate) const SORTED: u64 = 1 << 20;

/// Classes of equal width that are counted first.
const COARSE: usize = 1 << 14;

/// Classes that the coarse ones are parted into, by how many samples each has.
const FINE: usize = 1 << 20;

/// Points of the curve between which the least steep secant is looked for.
const SECANTS: usize = 10_000;

/// The material ratio curve of a field whose numbers these are: percents of its measured samples from 0 to 100, and the height above which so many of
/// them are. Nothing where none was measured.
///
/// # Errors
/// Where the field cannot be read.
pub fn material_ratio(heights: &dyn Heights, found: &Roughness) -> Result<Vec<[f64; 2]>, HeightError> {
    let (Some(mean), Some(sp), Some(sv)) = (found.mean, found.iso.sp, found.iso.sv) else { return Ok(Vec::new()) };
    let curve = Curve::read(heights, [mean - sv, mean + sp], found.valid)?;
    Ok((0..=100).map(|percent| [f64::from(percent), curve.height(f64::from(percent) / 100.0)]).collect())
}

/// Heights that bound the core, and what is above and below it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Height of the core.
    pub sk: f64,
    /// Reduced height of the peaks above the core.
    pub spk: f64,
    /// Reduced depth of the valleys below the core.
    pub svk: f64,
    /// Share of the samples above the core, percent.
    pub smr1: f64,
    /// Share of the samples above the valleys, percent.
    pub smr2: f64,
}

/// Heights in falling order, each standing for a number of samples: between two, the curve is linear from middle to middle.
pub(crate) struct Curve {
    /// Height, and the share of samples above the middle of those that it stands for.
    points: Vec<(f64, f64)>,
}

impl Curve {
    /// Of all samples; `range` is their least and largest height, `valid` their number.
    ///
    /// # Errors
    /// Where they cannot be read.
    pub(crate) fn read(heights: &dyn Heights, range: [f64; 2], valid: u64) -> Result<Curve, HeightError> {
        if valid <= SORTED {
            let own = map_bands(heights, 0, |band| {
                band.rows()
                    .flat_map(|(_, row)| row.iter().copied().filter(|height| !height.is_nan()))
                    .collect::<Vec<f64>>()
            })?;
            let mut all = own.concat();
            all.par_sort_unstable_by(|a, b| b.total_cmp(a));
            let share = |index: usize| (index as f64 + 0.5) / all.len() as f64;
            return Ok(Curve {
                points: all.iter().enumerate().map(|(index, height)| (*height, share(index))).collect(),
            });
        }
        let coarse = Classes {
            bounds: (0..=COARSE).map(|n| range[0] + (range[1] - range[0]) * n as f64 / COARSE as f64).collect(),
        };
        let counts = coarse.count(heights)?;
        // Classes of many samples are parted into many.
        let mut bounds = vec![range[0]];
        for (number, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let (low, high) = (coarse.bounds[number], coarse.bounds[number + 1]);
            let parts = 1 + (*count as f64 / valid as f64 * FINE as f64) as usize;
            if bounds.last().is_some_and(|last| *last < low) {
                bounds.push(low);
            }
            bounds.extend((1..=parts).map(|part| low + (high - low) * part as f64 / parts as f64));
        }
        let fine = Classes { bounds };
        let counts = fine.count(heights)?;
        let mut above = 0;
        let mut points = Vec::new();
        for (number, count) in counts.iter().enumerate().rev().filter(|(_, count)| **count > 0) {
            let middle = 0.5 * (fine.bounds[number] + fine.bounds[number + 1]);
            points.push((middle, (above as f64 + 0.5 * *count as f64) / valid as f64));
            above += count;
        }
        Ok(Curve { points })
    }

    /// The height above which a share of the samples lies.
    fn height(&self, share: f64) -> f64 {
        let after = self.points.partition_point(|point| point.1 < share);
        let (first, last) = (after.saturating_sub(1), after.min(self.points.len() - 1));
        let ((high, from), (low, to)) = (self.points[first], self.points[last]);
        if to > from { high + (low - high) * ((share - from) / (to - from)).clamp(0.0, 1.0) } else { high }
    }

    /// The core and what is beside it; `None` where all heights are equal or there are none.
    pub(crate) fn material(&self) -> Option<Material> {
        let (highest, lowest) = (self.points.first()?.0, self.points.last()?.0);
        if highest <= lowest {
            return None;
        }
        let heights: Vec<f64> = (0..=SECANTS).map(|n| self.height(n as f64 / SECANTS as f64)).collect();
        let wide = SECANTS * 2 / 5;
        // The first of equally steep ones; what rounding makes of equal ones does not count.
        let steepness = |first: usize| heights[first] - heights[first + wide];
        let slack = 1e-9 * (highest - lowest);
        let least = (0..=SECANTS - wide).map(steepness).fold(f64::INFINITY, f64::min);
        let first = (0..=SECANTS - wide).find(|first| steepness(*first) <= least + slack)?;
        let part = &heights[first..=first + wide];
        let count = part.len() as f64;
        let middle = (first as f64 + 0.5 * wide as f64) / SECANTS as f64;
        let share = |index: usize| (first + index) as f64 / SECANTS as f64 - middle;
        let mean = part.iter().sum::<f64>() / count;
        let (products, squares) = part.iter().enumerate().fold((0.0, 0.0), |(products, squares), (index, height)| {
            (products + share(index) * (height - mean), squares + share(index) * share(index))
        });
        let slope = products / squares;
        let (top, bottom) = (mean - slope * middle, mean + slope * (1.0 - middle));
        let smr1 = self.share_above(top);
        let smr2 = self.share_above(bottom);
        // A triangle over the same share with the same area.
        let peaks = if smr1 > 0.0 { 2.0 * self.area(0.0, smr1, top) / smr1 } else { 0.0 };
        let valleys = if smr2 < 1.0 { -2.0 * self.area(smr2, 1.0, bottom) / (1.0 - smr2) } else { 0.0 };
        let (spk, svk) = (peaks.max(0.0), valleys.max(0.0));
        Some(Material { sk: top - bottom, spk, svk, smr1: 100.0 * smr1, smr2: 100.0 * smr2 })
    }

    /// The share of the samples above a height.
    fn share_above(&self, height: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 > height);
        let Some(last) = after.checked_sub(1) else { return 0.0 };
        let Some((low, to)) = self.points.get(after) else { return 1.0 };
        let (high, from) = self.points[last];
        from + (to - from) * (high - height) / (high - low)
    }

    /// The area between the curve and a height from one share to another; heights below it count as negative.
    fn area(&self, from: f64, to: f64, height: f64) -> f64 {
        let first = self.points.partition_point(|point| point.1 <= from);
        let mut last = (from, self.height(from));
        let mut sum = 0.0;
        let inside = self.points[first..].iter().take_while(|point| point.1 < to).map(|point| (point.1, point.0));
        for (share, here) in inside.chain(std::iter::once((to, self.height(to)))) {
            sum += (share - last.0) * (0.5 * (here + last.1) - height);
            last = (share, here);
        }
        sum
    }
}

/// Classes of heights between bounds that grow.
struct Classes {
    bounds: Vec<f64>,
}

impl Classes {
    /// The number of samples in each class; the last bound belongs to the last.
    fn count(&self, heights: &dyn Heights) -> Result<Vec<u64>, HeightError> {
        let classes = self.bounds.len() - 1;
        let (low, width) = (self.bounds[0], self.bounds[classes] - self.bounds[0]);
        // Where in the bounds to begin to look: a table of equal steps.
        let table: Vec<usize> = (0..=COARSE)
            .map(|n| {
                self.bounds.partition_point(|bound| *bound <= low + width * n as f64 / COARSE as f64).saturating_sub(1)
            })
            .collect();
        let bands = map_bands(heights, 0, |band| {
            let mut own = Vec::new();
            for height in band.rows().flat_map(|(_, row)| row.iter()).filter(|height| !height.is_nan()) {
                let step = ((height - low) / width * COARSE as f64) as usize;
                let (from, to) = (table[step.saturating_sub(1).min(COARSE)], table[(step + 2).min(COARSE)] + 1);
                let part = &self.bounds[from..=to.min(classes)];
                let class = from + part.partition_point(|bound| bound <= height).saturating_sub(1);
                own.push(class.min(classes - 1) as u32);
            }
            own.sort_unstable();
            own.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u64)).collect::<Vec<(u32, u64)>>()
        })?;
        let mut counts = vec![0; classes];
        for (class, count) in bands.into_iter().flatten() {
            counts[class as usize] += count;
        }
        Ok(counts)
    }
}
