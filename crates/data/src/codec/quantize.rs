//! From the quantities of many particles to a codebook and one index for each particle.

mod batches;
mod steps;
mod sums;
mod training;
mod vectors;

use super::codebook::{Codebook, CodebookScope};
use super::packing::{CodeBits, VqBits};
use super::refinement::{Refinement, STEPS};
use crate::model::portable::{expect, expect_that, portable};
use rayon::prelude::*;
use std::ops::Range;

pub use batches::{BatchInfo, Batches, Coded, Quantities};
pub use steps::{CodedPart, Draft, SettledPart, Totals, Trained, group_parts, parts, parts_of_each};
pub use sums::Sums;
pub use vectors::Scaling;

/// The largest number of attributes beside mass, density and smoothing length: the quantiser's space has 8 dimensions.
pub const MAX_ATTRIBUTES: usize = 5;
/// Parts of the data whose sums are held at a time, and parts at least that it is cut into, so that many threads have work where there are
/// few groups.
const PARTS: usize = 16;

/// A codebook and what it codes.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantized<Kept> {
    /// The codebook.
    pub codebook: Codebook,
    /// How its lines run, where codes are refined.
    pub refinement: Option<Refinement>,
    /// The entry of each kept code.
    pub numbers: Vec<u16>,
    /// The batches, in order.
    pub batches: Vec<Coded<Kept>>,
}

portable!(Quantized<Kept> where Kept { codebook, refinement, numbers, batches });

impl<Kept> Quantized<Kept> {
    /// Whether it has so many batches and attributes, and no more entries than codes of these bits can name; else what was found and expected.
    pub fn check(&self, batches: usize, attributes: usize, bits: CodeBits) -> Result<(), String> {
        let Quantized { codebook, refinement, numbers, .. } = self;
        let is_of_leaves = codebook.scope == CodebookScope::Leaves;
        codebook.check(attributes, bits.of(is_of_leaves).entries())?;
        check_numbers(numbers, codebook)?;
        expect("errors of a codebook", codebook.errors.len(), 3 + attributes)?;
        expect("refined", refinement.is_some(), is_of_leaves && bits.is_refined())?;
        if let Some(lines) = refinement {
            expect("steps behind the last line", codebook.len() % STEPS, 0)?;
            lines.check(codebook.len() / STEPS)?;
        }
        expect("batches", self.batches.len(), batches)
    }

    /// Codes that stand for something.
    pub fn codes(&self) -> usize {
        if self.codebook.is_empty() { 0 } else { self.numbers.len() }
    }
}

/// Whether codes stand for entries of a codebook; else what was expected. Where it has none there is no code.
fn check_numbers(numbers: &[u16], codebook: &Codebook) -> Result<(), String> {
    let entries = codebook.len().max(1);
    let are_entries = numbers.iter().all(|number| usize::from(*number) < entries);
    expect_that(are_entries, "numbers of codes", "entries of their codebook")
}

/// Trains a codebook on `batches` and codes them. The result depends on the batches and their groups only, not on the number of threads. A
/// code's entry is computed from all particles that have it: the mean mass, the mass-weighted density, the smoothing length that
/// keeps their `sum m / h^2` (central column density), and attributes as [`super::AttributeMerge`] says; so `sum m` and `sum m rho` over
/// the batches are conserved. `books` is how many codebooks share the effort of training. Where codes are to be refined ([`Refinement`])
/// `bits` are those of a line.
///
/// # Errors
/// Those of the batches.
pub fn quantize<B: Batches>(
    batches: &B,
    scaling: &Scaling,
    bits: VqBits,
    scope: CodebookScope,
    books: usize,
    is_refined: bool,
) -> Result<Quantized<B::Kept>, B::Error> {
    let trained = Trained::of(batches, scaling, bits, scope, books, is_refined)?;
    let about: Vec<(u32, usize)> =
        (0..batches.len()).map(|batch| (batches.group(batch), batches.info(batch).particles)).collect();
    let parts = parts(&about);
    let group_of = |part: &Range<usize>| about[part.start].0;
    let mut totals = trained.totals(scaling);
    let mut kept = Vec::with_capacity(parts.len());
    for some in parts.chunks(PARTS) {
        let code = |part: &Range<usize>| trained.code(batches, part.clone(), scaling);
        let coded: Vec<_> = some.par_iter().map(code).collect::<Result<_, _>>()?;
        for (part, (codes, sums)) in some.iter().zip(coded) {
            kept.push(codes);
            totals.add(group_of(part), sums);
        }
    }
    let mut draft = totals.draft(&trained, scaling);
    if draft.is_of_lines() {
        let refine = |(part, kept): (&Range<usize>, Vec<B::Kept>)| draft.refine(batches, part.clone(), kept);
        let refined: Vec<_> = parts.par_iter().zip(kept).map(refine).collect::<Result<_, _>>()?;
        let (codes, counts): (Vec<_>, Vec<Vec<u64>>) = refined.into_iter().unzip();
        draft.conserve(&counts);
        kept = codes;
    }
    let settle = |(part, kept): (&Range<usize>, Vec<B::Kept>)| draft.settle(batches, part.clone(), kept, scaling);
    let settled: Vec<_> = parts.par_iter().zip(kept).map(settle).collect::<Result<_, _>>()?;
    let (mut batches, mut errors) = (Vec::with_capacity(batches.len()), Vec::with_capacity(parts.len()));
    for (part, (coded, own)) in parts.iter().zip(settled) {
        batches.extend(coded);
        errors.push((group_of(part), own));
    }
    Ok(draft.finished(&errors, batches))
}

#[cfg(test)]
mod tests {
    use super::super::scaling::{AttributeMerge, ColumnScaling, fast_log2};
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
                    .map(|v| {
                        let range = v.iter().fold((v[0], v[0]), |(low, high), &v| (v.min(low), v.max(high)));
                        (ColumnScaling::attribute(v, range, false), AttributeMerge::Mean)
                    })
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
                })
                .collect()
        }
    }

    struct InMemory<'a>(Vec<Quantities<'a>>);

    impl Batches for InMemory<'_> {
        type Error = std::convert::Infallible;
        type Kept = Vec<u16>;

        fn len(&self) -> usize {
            self.0.len()
        }

        fn info(&self, batch: usize) -> BatchInfo {
            BatchInfo::of(&self.0[batch])
        }

        fn group(&self, batch: usize) -> u32 {
            batch as u32 / 3
        }

        fn with<R>(&self, batch: usize, read: impl FnOnce(&Quantities) -> R) -> Result<R, Self::Error> {
            Ok(read(&self.0[batch]))
        }

        fn keep(&self, codes: Vec<u16>) -> Result<Vec<u16>, Self::Error> {
            Ok(codes)
        }

        fn codes(&self, kept: &Vec<u16>, _: usize, _: usize) -> Result<Vec<u16>, Self::Error> {
            Ok(kept.clone())
        }

        fn forget(&self, _: Vec<u16>) {}
    }

    fn run(
        columns: &Columns,
        len: usize,
        scope: CodebookScope,
        is_refined: bool,
    ) -> (Codebook, Vec<Vec<u16>>, Vec<Coded<Vec<u16>>>) {
        let batches = InMemory(columns.batches(len));
        let Ok(done) = quantize(&batches, &columns.scaling(), VqBits::Eight, scope, 1, is_refined);
        assert_eq!(done.refinement.is_some(), is_refined);
        let number = |code: &u16| done.numbers[usize::from(*code)];
        let codes = done.batches.iter().map(|coded| coded.codes.iter().map(number).collect()).collect();
        (done.codebook, codes, done.batches)
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
        #![proptest_config(crate::cases::cases(24))]

        #[test]
        fn sums_are_conserved(columns in columns(1..1500, 2), is_refined: bool) {
            let (book, codes, coded) = run(&columns, 100, CodebookScope::Leaves, is_refined);
            let codes: Vec<u16> = codes.concat();
            let sum = |value: &dyn Fn(usize) -> f64| (0..codes.len()).map(value).sum::<f64>();
            let entry = |i: usize| usize::from(codes[i]);
            let mass = sum(&|i| f64::from(columns.mass[i]));
            let decoded = sum(&|i| f64::from(book.mass[entry(i)]));
            prop_assert!((mass - decoded).abs() <= 1e-6 * mass);
            let told: f64 = coded.iter().map(|coded| coded.mass).sum();
            prop_assert!((told - decoded).abs() <= 1e-9 * mass);
            let presence = sum(&|i| f64::from(columns.mass[i]) * f64::from(columns.density[i]));
            let decoded = sum(&|i| f64::from(book.mass[entry(i)]) * f64::from(book.density[entry(i)]));
            prop_assert!((presence - decoded).abs() <= 1e-6 * presence);
            let most = 256 * if is_refined { STEPS } else { 1 };
            prop_assert!(book.len() <= most);
            prop_assert!(book.particles == codes.len() as u64);
        }

        /// Attributes keep their sums over masses, in all levels.
        #[test]
        fn attributes_weigh_with_mass(columns in columns(300..1500, 1), is_refined: bool) {
            let scopes = [
                (CodebookScope::Leaves, is_refined),
                (CodebookScope::VolumeDepth(3), false),
                (CodebookScope::Depth(3), false),
                (CodebookScope::Clusters, false),
            ];
            for (scope, is_refined) in scopes {
                let (book, codes, _) = run(&columns, 100, scope, is_refined);
                let codes: Vec<usize> = codes.concat().into_iter().map(usize::from).collect();
                let own = |i: usize| f64::from(columns.mass[i]);
                let sum: f64 = (0..codes.len()).map(|i| own(i) * f64::from(columns.attributes[0][i])).sum();
                let size: f64 = (0..codes.len()).map(|i| own(i) * f64::from(columns.attributes[0][i].abs())).sum();
                let entry = |&code: &usize| f64::from(book.mass[code]) * f64::from(book.attributes[0][code]);
                let decoded: f64 = codes.iter().map(entry).sum();
                prop_assert!((decoded - sum).abs() <= 1e-5 * size, "{scope:?}: {decoded} {sum}");
            }
        }

        /// Where density and smoothing length are a power of one another, refined codes have both far more exactly, and the attribute, too.
        #[test]
        fn refined_codes_are_finer(seeds in prop::collection::vec((0.0..10.0_f32, -3.0..3.0_f32), 2000..3000)) {
            let columns = Columns {
                mass: vec![1.0; seeds.len()],
                density: seeds.iter().map(|seed| (3.0 * seed.0 - 15.0).exp2()).collect(),
                smoothing_length: seeds.iter().map(|seed| (5.0 - seed.0).exp2()).collect(),
                attributes: vec![seeds.iter().map(|seed| seed.1).collect()],
            };
            let [plain, refined] = [false, true].map(|is_refined| run(&columns, 500, CodebookScope::Leaves, is_refined).0.errors);
            for (k, least) in [(1, 4.0), (2, 4.0), (3, 1.2)] {
                prop_assert!(least * refined[k].mean <= plain[k].mean, "{k}: {:?} {:?}", refined[k], plain[k]);
            }
        }

        /// Whatever run of its batch a particle is in: of all steps of its line.
        #[test]
        fn refined_codes_name_the_nearest_step(columns in columns(300..1500, 1)) {
            let batches = InMemory(columns.batches(700));
            let Ok(done) = quantize(&batches, &columns.scaling(), VqBits::Eight, CodebookScope::Leaves, 1, true);
            let finder = done.refinement.as_ref().unwrap().finder();
            let codes = done.batches.iter().flat_map(|coded| &coded.codes);
            for (&code, &h) in codes.zip(&columns.smoothing_length) {
                let (line, step) = (usize::from(code) / STEPS, usize::from(code) % STEPS);
                prop_assert_eq!(step, finder.step(line, fast_log2(h)));
                let off = |step: usize| (done.codebook.smoothing_length[Refinement::code(line, step)] / h).log2().abs();
                let nearest = (0..STEPS).map(off).fold(f32::INFINITY, f32::min);
                prop_assert!(off(step) <= nearest + 1e-4, "{} and {}", off(step), nearest);
            }
        }

        #[test]
        fn as_many_codes_as_particles_are_exact(columns in columns(1..250, 1)) {
            let (book, codes, _) = run(&columns, 64, CodebookScope::Leaves, false);
            for (i, code) in codes.concat().into_iter().map(usize::from).enumerate() {
                prop_assert_eq!(book.mass[code], columns.mass[i]);
                prop_assert_eq!(book.density[code], columns.density[i]);
                prop_assert_eq!(book.smoothing_length[code], columns.smoothing_length[i]);
                prop_assert_eq!(book.attributes[0][code], columns.attributes[0][i]);
            }
            prop_assert!(book.errors.iter().all(|error| error.max == 0.0));
        }

        /// As few as keep threads busy; none across groups.
        #[test]
        fn parts_are_runs_of_a_group(
            steps in prop::collection::vec((0..20_u32, 1..100_usize), 0..300),
            apart in 1..20_u32,
        ) {
            let mut group = 0;
            let batches: Vec<(u32, usize)> = steps
                .iter()
                .map(|&(step, particles)| {
                    group += step / apart;
                    (group, particles)
                })
                .collect();
            let parts = parts(&batches);
            prop_assert!(parts.iter().cloned().flatten().eq(0..batches.len()));
            let groups = batches.chunk_by(|a, b| a.0 == b.0).count();
            prop_assert!(parts.len() < groups + PARTS);
            for part in parts {
                let group = batches[part.start].0;
                let all: usize = batches.iter().filter(|batch| batch.0 == group).map(|batch| batch.1).sum();
                let own = &batches[part];
                prop_assert!(own.iter().all(|batch| batch.0 == group));
                let len: usize = own.iter().map(|batch| batch.1).sum();
                prop_assert!(len < all.div_ceil(PARTS.div_ceil(groups)) + 100, "{len} of {all} in {groups} groups");
            }
        }

        #[test]
        fn threads_do_not_matter(columns in columns(500..3000, 3)) {
            let in_pool = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| [false, true].map(|is_refined| run(&columns, 77, CodebookScope::Leaves, is_refined)))
            };
            prop_assert_eq!(in_pool(1), in_pool(3));
        }
    }
}
