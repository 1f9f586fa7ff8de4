//! What the particles of each code have together, of which its entry is made.

use super::batches::Quantities;
use super::vectors::Scaling;
use crate::codec::codebook::{Codebook, CodebookScope};
use crate::codec::refinement::Refinement;
use crate::codec::scaling::AttributeMerge;
use crate::model::portable::portable;

/// For each code: number of particles, then sums of `m`, `m rho`, `m / h^2`, and weighted attributes; and the range of the smoothing lengths.
pub struct Sums {
    scope: CodebookScope,
    columns: usize,
    counts: Vec<u64>,
    values: Vec<f64>,
    ranges: Vec<[f32; 2]>,
}

portable!(Sums { scope, columns, counts, values, ranges });

impl Sums {
    pub(super) fn new(codes: usize, columns: usize, scope: CodebookScope) -> Sums {
        let ranges = vec![[f32::INFINITY, 0.0]; codes];
        Sums { scope, columns, counts: vec![0; codes], values: vec![0.0; codes * columns], ranges }
    }

    #[inline]
    pub(super) fn add(&mut self, code: usize, from: &Quantities, i: usize, scaling: &Scaling) {
        let (m, rho, h) = (f64::from(from.mass[i]), f64::from(from.density[i]), f64::from(from.smoothing_length[i]));
        let row = &mut self.values[code * self.columns..][..self.columns];
        row[0] += m;
        row[1] += m * rho;
        row[2] += m / (h * h);
        for ((sum, (_, merge)), column) in row[3..].iter_mut().zip(&scaling.attributes).zip(&from.attributes) {
            *sum += match merge {
                // As particles are merged.
                AttributeMerge::Mean => m * f64::from(column[i]),
                AttributeMerge::Magnitude => (-0.4 * std::f64::consts::LN_10 * f64::from(column[i])).exp(),
            };
        }
        self.counts[code] += 1;
        let [shortest, longest] = &mut self.ranges[code];
        *shortest = shortest.min(from.smoothing_length[i]);
        *longest = longest.max(from.smoothing_length[i]);
    }

    pub(super) fn merge(&mut self, other: &Sums) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
        self.ranges.iter_mut().zip(&other.ranges).for_each(|(a, b)| *a = [a[0].min(b[0]), a[1].max(b[1])]);
    }

    /// The codes in use.
    fn used(&self) -> impl Iterator<Item = usize> {
        (0..self.counts.len()).filter(|&code| self.counts[code] > 0)
    }

    /// The sum of `m rho` of each code in use.
    pub(super) fn presence(&self) -> Vec<f64> {
        self.used().map(|code| self.values[code * self.columns + 1]).collect()
    }

    /// Lines for the codes in use, whose codebook this is; density follows this power of the smoothing length.
    pub(super) fn lines(&self, codebook: &Codebook, slope: f32) -> Refinement {
        Refinement {
            slope,
            density: codebook.density.clone(),
            shortest: self.used().map(|code| self.ranges[code][0]).collect(),
            longest: self.used().map(|code| self.ranges[code][1]).collect(),
        }
    }

    /// The codebook of the codes in use, and the new number of each code; 0 for one that is not in use.
    pub(super) fn codebook(&self, scaling: &Scaling) -> (Codebook, Vec<u16>) {
        let used: Vec<usize> = self.used().collect();
        let mut renumbered = vec![0; self.counts.len()];
        used.iter().enumerate().for_each(|(new, &old)| renumbered[old] = new as u16);
        let row = |code: usize| &self.values[code * self.columns..][..self.columns];
        let column = |value: &dyn Fn(&[f64], f64) -> f64| -> Vec<f32> {
            used.iter().map(|&code| single(value(row(code), self.counts[code] as f64))).collect()
        };
        let attributes = scaling.attributes.iter().enumerate();
        let codebook = Codebook {
            scope: self.scope,
            particles: self.counts.iter().sum(),
            mass: column(&|row, count| row[0] / count),
            density: column(&|row, _| row[1] / row[0]),
            smoothing_length: column(&|row, _| (row[0] / row[2]).sqrt()),
            attributes: attributes
                .map(|(k, (_, merge))| match merge {
                    AttributeMerge::Mean => column(&|row, _| row[3 + k] / row[0]),
                    AttributeMerge::Magnitude => column(&|row, count| -2.5 * (row[3 + k] / count).log10()),
                })
                .collect(),
            errors: Vec::new(),
        };
        (codebook, renumbered)
    }
}

/// The nearest finite single.
fn single(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}
