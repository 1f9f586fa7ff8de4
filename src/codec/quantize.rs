//! From the quantities of many particles to a codebook and one index for each particle.

use super::codebook::{Codebook, CodebookScope, QuantityError};
use super::packing::VqBits;
use super::quantizer::{LbgLimits, Quantizer};
use super::scaling::{AttributeMerge, ColumnScaling};
use rayon::prelude::*;

/// The largest number of attributes beside mass, density and smoothing length: the quantiser's space has 8 dimensions.
pub const MAX_ATTRIBUTES: usize = 5;
/// Sums are taken over this many parts of the data, whatever the number of threads.
const PARTS: usize = 16;

/// Quantities of a run of particles. All slices have the same length, but `skipped` may be empty: none is skipped.
#[derive(Clone, Debug)]
pub struct Quantities<'a> {
    /// Masses.
    pub mass: &'a [f32],
    /// Densities.
    pub density: &'a [f32],
    /// Smoothing lengths.
    pub smoothing_length: &'a [f32],
    /// Attributes, in the family's order.
    pub attributes: Vec<&'a [f32]>,
    /// Particles that get a code but count for nothing.
    pub skipped: &'a [bool],
}

impl Quantities<'_> {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }

    fn counts(&self, i: usize) -> bool {
        self.skipped.is_empty() || !self.skipped[i]
    }
}

/// How the columns of a family are scaled and merged; the same for all its codebooks.
#[derive(Clone, Debug)]
pub struct Scaling {
    /// Of mass, density, smoothing length.
    pub quantities: [ColumnScaling; 3],
    /// Of each attribute.
    pub attributes: Vec<(ColumnScaling, AttributeMerge)>,
}

impl Scaling {
    /// The mean coordinate of densities.
    pub fn mean_density(&self, densities: &[f32]) -> f32 {
        let sum: f64 = densities.iter().map(|density| f64::from(self.quantities[1].map(*density))).sum();
        (sum / densities.len().max(1) as f64) as f32
    }

    fn vector<const L: usize>(&self, from: &Quantities, i: usize) -> [f32; L] {
        let mut vector = [0.0; L];
        vector[0] = self.quantities[0].map(from.mass[i]);
        vector[1] = self.quantities[1].map(from.density[i]);
        vector[2] = self.quantities[2].map(from.smoothing_length[i]);
        for ((place, (scaling, _)), column) in vector[3..].iter_mut().zip(&self.attributes).zip(&from.attributes) {
            *place = scaling.map(column[i]);
        }
        vector
    }
}

/// Vectors for each entry in the sample where several codebooks share the effort.
const LEAST_SAMPLE: usize = 32;

/// Training effort for a number of bits, and a number of codebooks that share it: vectors in the sample, and LBG's limits. The sample is large enough to give
/// each code a few vectors, and bounded, so that training does not grow with the data.
fn effort(bits: VqBits, books: usize) -> (usize, LbgLimits) {
    let (sample, limits) = match bits {
        VqBits::Eight => (1 << 15, LbgLimits { k_max: 8, epsilon: 0.01 }),
        VqBits::Twelve => (1 << 17, LbgLimits { k_max: 3, epsilon: 0.02 }),
        VqBits::Sixteen => (1 << 18, LbgLimits { k_max: 1, epsilon: 0.05 }),
    };
    ((sample / books.max(1)).max(LEAST_SAMPLE * bits.entries()).min(sample), limits)
}

/// Trains a codebook on `batches` and codes them; returns one column of codes for each batch. The result depends on the
/// batches only, not on the number of threads. A code's entry is computed from all particles that have it: the mean
/// mass, the mass-weighted density, the smoothing length that keeps their `sum m / h^2` (central column density), and
/// attributes as [`AttributeMerge`] says; so `sum m` and `sum m rho` over the batches are conserved. `books` is how many
/// codebooks share the effort of training.
pub fn quantize(
    batches: &[Quantities],
    scaling: &Scaling,
    bits: VqBits,
    scope: CodebookScope,
    books: usize,
) -> (Codebook, Vec<Vec<u16>>) {
    if scaling.attributes.len() <= 1 {
        quantize_in::<4>(batches, scaling, bits, scope, books)
    } else {
        quantize_in::<8>(batches, scaling, bits, scope, books)
    }
}

fn quantize_in<const L: usize>(
    batches: &[Quantities],
    scaling: &Scaling,
    bits: VqBits,
    scope: CodebookScope,
    books: usize,
) -> (Codebook, Vec<Vec<u16>>) {
    let (sample_len, limits) = effort(bits, books);
    let mut sample = sample::<L>(batches, scaling, sample_len);
    let quantizer = Quantizer::train(&mut sample, bits.entries(), limits);
    drop(sample);
    let parts = parts(batches);
    let columns = 4 + scaling.attributes.len();
    let mut coded: Vec<(Vec<Vec<u16>>, Sums)> = parts
        .par_iter()
        .map(|part| {
            let mut sums = Sums::new(quantizer.len(), columns);
            let codes = part
                .iter()
                .map(|batch| {
                    (0..batch.len())
                        .map(|i| {
                            let code = quantizer.code(&scaling.vector(batch, i)) as usize;
                            if batch.counts(i) {
                                sums.add(code, batch, i, scaling);
                            }
                            code as u16
                        })
                        .collect()
                })
                .collect();
            (codes, sums)
        })
        .collect();
    let mut totals = Sums::new(quantizer.len(), columns);
    for (_, sums) in &coded {
        totals.merge(sums);
    }
    let (mut codebook, renumbered) = totals.codebook(scaling, scope);
    coded.par_iter_mut().flat_map_iter(|(codes, _)| codes.iter_mut().flatten()).for_each(|code| {
        *code = renumbered[usize::from(*code)];
    });
    codebook.errors = errors(&parts, &coded, scaling, &codebook);
    (codebook, coded.into_iter().flat_map(|(codes, _)| codes).collect())
}

/// Contiguous runs of batches of about the same number of particles.
fn parts<'a, 'b>(batches: &'a [Quantities<'b>]) -> Vec<&'a [Quantities<'b>]> {
    let total: usize = batches.iter().map(Quantities::len).sum();
    let goal = total.div_ceil(PARTS).max(1);
    let mut parts = Vec::with_capacity(PARTS);
    let (mut first, mut len) = (0, 0);
    for (i, batch) in batches.iter().enumerate() {
        len += batch.len();
        if len >= goal || i + 1 == batches.len() {
            parts.push(&batches[first..=i]);
            (first, len) = (i + 1, 0);
        }
    }
    parts
}

/// About `len` vectors for training (all of them if there are no more). Half of the sample is spread evenly over the
/// particles, half over their shares of `sum m` and `sum m rho`: what dominates the picture gets its codes even if it is
/// rare. Without that, one bright outlier can end in a cluster of faint particles, whose mean it then is.
fn sample<const L: usize>(batches: &[Quantities], scaling: &Scaling, len: usize) -> Vec<[f32; L]> {
    let total: usize = batches.iter().map(Quantities::len).sum();
    let everything = total <= len;
    let shares = |batch: &Quantities, i: usize| {
        let mass = f64::from(batch.mass[i]);
        [mass, mass * f64::from(batch.density[i])]
    };
    let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
    let sums: Vec<[f64; 2]> =
        batches.par_iter().map(|batch| (0..batch.len()).map(|i| shares(batch, i)).fold([0.0; 2], add)).collect();
    let by_count = 0.5 * len as f64 / total.max(1) as f64;
    let by_share = sums
        .iter()
        .copied()
        .fold([0.0; 2], add)
        .map(|all| if all > 0.0 && all.is_finite() { 0.25 * len as f64 / all } else { 0.0 });
    let weight = |[mass, presence]: [f64; 2]| mass * by_share[0] + presence * by_share[1];
    // Where each batch starts in the running sum that decides which particles are taken.
    let starts: Vec<f64> = batches
        .iter()
        .zip(&sums)
        .scan(0.0, |at, (batch, &sum)| {
            let start = *at;
            *at += batch.len() as f64 * by_count + weight(sum);
            Some(start)
        })
        .collect();
    let parts: Vec<Vec<[f32; L]>> = batches
        .par_iter()
        .zip(starts)
        .map(|(batch, start)| {
            let mut at = start;
            let taken = (0..batch.len()).filter(|&i| {
                let before = at.floor();
                at += by_count + weight(shares(batch, i));
                batch.counts(i) && (everything || at.floor() > before)
            });
            taken.map(|i| scaling.vector(batch, i)).collect()
        })
        .collect();
    parts.concat()
}

/// For each code: number of particles, then sums of `m`, `m rho`, `m / h^2`, weights, and weighted attributes.
struct Sums {
    columns: usize,
    counts: Vec<u64>,
    values: Vec<f64>,
}

impl Sums {
    fn new(codes: usize, columns: usize) -> Sums {
        Sums { columns, counts: vec![0; codes], values: vec![0.0; codes * columns] }
    }

    #[inline]
    fn add(&mut self, code: usize, from: &Quantities, i: usize, scaling: &Scaling) {
        let (m, rho, h) = (f64::from(from.mass[i]), f64::from(from.density[i]), f64::from(from.smoothing_length[i]));
        let weight = m * rho;
        let row = &mut self.values[code * self.columns..][..self.columns];
        row[0] += m;
        row[1] += weight;
        row[2] += m / (h * h);
        for ((sum, (_, merge)), column) in row[3..].iter_mut().zip(&scaling.attributes).zip(&from.attributes) {
            *sum += match merge {
                AttributeMerge::Mean => weight * f64::from(column[i]),
                AttributeMerge::Magnitude => (-0.4 * std::f64::consts::LN_10 * f64::from(column[i])).exp(),
            };
        }
        self.counts[code] += 1;
    }

    fn merge(&mut self, other: &Sums) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
    }

    /// The codebook of the codes in use, and the new number of each code. Codes that only skipped particles have get
    /// number 0; nobody decodes them.
    fn codebook(&self, scaling: &Scaling, scope: CodebookScope) -> (Codebook, Vec<u16>) {
        let used: Vec<usize> = (0..self.counts.len()).filter(|&code| self.counts[code] > 0).collect();
        let mut renumbered = vec![0; self.counts.len()];
        used.iter().enumerate().for_each(|(new, &old)| renumbered[old] = new as u16);
        let row = |code: usize| &self.values[code * self.columns..][..self.columns];
        let column = |value: &dyn Fn(&[f64], f64) -> f64| -> Vec<f32> {
            used.iter().map(|&code| single(value(row(code), self.counts[code] as f64))).collect()
        };
        let attributes = scaling.attributes.iter().enumerate();
        let codebook = Codebook {
            scope,
            particles: self.counts.iter().sum(),
            mass: column(&|row, count| row[0] / count),
            density: column(&|row, _| row[1] / row[0]),
            smoothing_length: column(&|row, _| (row[0] / row[2]).sqrt()),
            attributes: attributes
                .map(|(k, (_, merge))| match merge {
                    AttributeMerge::Mean => column(&|row, _| row[3 + k] / row[1]),
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

/// Mean and maximum error of each quantity over all particles that count.
fn errors(
    parts: &[&[Quantities]],
    coded: &[(Vec<Vec<u16>>, Sums)],
    scaling: &Scaling,
    codebook: &Codebook,
) -> Vec<QuantityError> {
    let columns = 3 + scaling.attributes.len();
    let measured: Vec<Vec<(f64, f64)>> = parts
        .par_iter()
        .zip(coded)
        .map(|(part, (codes, _))| {
            let mut errors = vec![(0.0, 0.0_f64); columns];
            for (batch, codes) in part.iter().zip(codes) {
                let mut measure = |k: usize, scaling: &ColumnScaling, values: &[f32], entries: &[f32]| {
                    let (mut sum, mut max) = errors[k];
                    for (i, (&value, &code)) in values.iter().zip(codes).enumerate() {
                        if batch.counts(i) {
                            let error = scaling.error(value, entries[usize::from(code)]);
                            sum += error;
                            max = max.max(error);
                        }
                    }
                    errors[k] = (sum, max);
                };
                measure(0, &scaling.quantities[0], batch.mass, &codebook.mass);
                measure(1, &scaling.quantities[1], batch.density, &codebook.density);
                measure(2, &scaling.quantities[2], batch.smoothing_length, &codebook.smoothing_length);
                for (k, (scaling, _)) in scaling.attributes.iter().enumerate() {
                    measure(3 + k, scaling, batch.attributes[k], &codebook.attributes[k]);
                }
            }
            errors
        })
        .collect();
    (0..columns)
        .map(|k| {
            let sum: f64 = measured.iter().map(|errors| errors[k].0).sum();
            let max = measured.iter().fold(0.0, |max: f64, errors| max.max(errors[k].1));
            QuantityError { mean: sum / codebook.particles.max(1) as f64, max }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Debug)]
    struct Columns {
        mass: Vec<f32>,
        density: Vec<f32>,
        smoothing_length: Vec<f32>,
        attributes: Vec<Vec<f32>>,
    }

    impl Columns {
        fn scaling(&self) -> Scaling {
            Scaling {
                quantities: [&self.mass, &self.density, &self.smoothing_length].map(|v| ColumnScaling::positive(v)),
                attributes: self
                    .attributes
                    .iter()
                    .map(|v| (ColumnScaling::attribute(v, false), AttributeMerge::Mean))
                    .collect(),
            }
        }

        fn batches(&self, len: usize) -> Vec<Quantities<'_>> {
            let range = |i: usize| i * len..((i + 1) * len).min(self.mass.len());
            (0..self.mass.len().div_ceil(len))
                .map(|i| Quantities {
                    mass: &self.mass[range(i)],
                    density: &self.density[range(i)],
                    smoothing_length: &self.smoothing_length[range(i)],
                    attributes: self.attributes.iter().map(|v| &v[range(i)]).collect(),
                    skipped: &[],
                })
                .collect()
        }
    }

    fn columns(count: std::ops::Range<usize>, attributes: usize) -> impl Strategy<Value = Columns> {
        let row = (-20.0..20.0_f32, -30.0..30.0_f32, -10.0..10.0_f32, prop::collection::vec(-5.0..5.0_f32, attributes));
        prop::collection::vec(row, count).prop_map(move |rows| Columns {
            mass: rows.iter().map(|row| row.0.exp2()).collect(),
            density: rows.iter().map(|row| row.1.exp2()).collect(),
            smoothing_length: rows.iter().map(|row| row.2.exp2()).collect(),
            attributes: (0..attributes).map(|k| rows.iter().map(|row| row.3[k]).collect()).collect(),
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn sums_are_conserved(columns in columns(1..1500, 2)) {
            let (book, codes) = quantize(&columns.batches(100), &columns.scaling(), VqBits::Eight, CodebookScope::Leaves, 1);
            let codes: Vec<u16> = codes.concat();
            let sum = |value: &dyn Fn(usize) -> f64| (0..codes.len()).map(value).sum::<f64>();
            let entry = |i: usize| usize::from(codes[i]);
            let mass = sum(&|i| f64::from(columns.mass[i]));
            let decoded = sum(&|i| f64::from(book.mass[entry(i)]));
            prop_assert!((mass - decoded).abs() <= 1e-6 * mass);
            let presence = sum(&|i| f64::from(columns.mass[i]) * f64::from(columns.density[i]));
            let decoded = sum(&|i| f64::from(book.mass[entry(i)]) * f64::from(book.density[entry(i)]));
            prop_assert!((presence - decoded).abs() <= 1e-6 * presence);
            prop_assert!(book.len() <= 256 && book.particles == codes.len() as u64);
        }

        #[test]
        fn as_many_codes_as_particles_are_exact(columns in columns(1..250, 1)) {
            let (book, codes) = quantize(&columns.batches(64), &columns.scaling(), VqBits::Eight, CodebookScope::Leaves, 1);
            for (i, code) in codes.concat().into_iter().map(usize::from).enumerate() {
                prop_assert_eq!(book.mass[code], columns.mass[i]);
                prop_assert_eq!(book.density[code], columns.density[i]);
                prop_assert_eq!(book.smoothing_length[code], columns.smoothing_length[i]);
                prop_assert_eq!(book.attributes[0][code], columns.attributes[0][i]);
            }
            prop_assert!(book.errors.iter().all(|error| error.max == 0.0));
        }

        #[test]
        fn threads_do_not_matter(columns in columns(500..3000, 3)) {
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| quantize(&columns.batches(77), &columns.scaling(), VqBits::Eight, CodebookScope::Depth(2), 1))
            };
            prop_assert_eq!(run(1), run(3));
        }
    }
}
