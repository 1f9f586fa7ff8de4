//! What the particles of each code have together, of which its entry is made.

use super::batches::Quantities;
use super::vectors::Scaling;
use crate::codec::codebook::{Codebook, CodebookScope};
use crate::codec::refinement::Refinement;
use crate::codec::scaling::AttributeMerge;
use crate::model::portable::{expect, portable, total};
use std::ops::Range;

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

    /// Adds a run of particles with these codes.
    pub(super) fn add(&mut self, codes: &[u32], from: &Quantities, run: Range<usize>, scaling: &Scaling) {
        let Sums { columns, counts, values, ranges, .. } = self;
        let mass = &from.mass[run.clone()];
        let others = from.density[run.clone()].iter().zip(&from.smoothing_length[run.clone()]);
        for ((&code, &mass), (&density, &length)) in codes.iter().zip(mass).zip(others) {
            let code = code as usize;
            let (m, rho, h) = (f64::from(mass), f64::from(density), f64::from(length));
            let row = &mut values[code * *columns..][..3];
            row[0] += m;
            row[1] += m * rho;
            row[2] += m / (h * h);
            counts[code] += 1;
            let [shortest, longest] = &mut ranges[code];
            *shortest = if length < *shortest { length } else { *shortest };
            *longest = if length > *longest { length } else { *longest };
        }
        for (place, ((_, merge), column)) in (3..).zip(scaling.attributes.iter().zip(&from.attributes)) {
            let particles = codes.iter().zip(mass).zip(&column[run.clone()]);
            let mut add = |code: u32, value: f64| values[code as usize * *columns + place] += value;
            match merge {
                // As particles are merged.
                AttributeMerge::Mean => {
                    particles.for_each(|((&code, &mass), &value)| add(code, f64::from(mass) * f64::from(value)));
                }
                AttributeMerge::Magnitude => {
                    let flux = |value: f32| (-0.4 * std::f64::consts::LN_10 * f64::from(value)).exp();
                    particles.for_each(|((&code, _), &value)| add(code, flux(value)));
                }
            }
        }
    }

    /// Whether others have as many codes and columns as these, and are of so many particles; else what was found and expected.
    pub(super) fn check(&self, others: &Sums, particles: u64) -> Result<(), String> {
        expect("columns", others.columns, self.columns)?;
        expect("codes", others.counts.len(), self.counts.len())?;
        expect("values", others.values.len(), self.values.len())?;
        expect("ranges", others.ranges.len(), self.ranges.len())?;
        expect("particles by code", total(others.counts.iter().copied()), particles)
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
