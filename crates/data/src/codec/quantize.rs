//! From the quantities of many particles to a codebook and one index for each particle.

mod batches;
mod sums;
mod training;
mod vectors;

use super::codebook::{Codebook, CodebookScope, QuantityError};
use super::packing::VqBits;
use super::quantizer::Quantizer;
use super::refinement::{Bend, Refinement, STEPS};
use super::scaling::{ColumnScaling, fast_log2};
use rayon::prelude::*;
use std::ops::Range;
use sums::Sums;
use training::{effort, sample};
use vectors::RUN;

pub use batches::{BatchInfo, Batches, Coded, Quantities};
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
    if scaling.attributes.len() <= 1 {
        quantize_in::<4, B>(batches, scaling, bits, scope, books, is_refined)
    } else {
        quantize_in::<8, B>(batches, scaling, bits, scope, books, is_refined)
    }
}

fn quantize_in<const L: usize, B: Batches>(
    batches: &B,
    scaling: &Scaling,
    bits: VqBits,
    scope: CodebookScope,
    books: usize,
    is_refined: bool,
) -> Result<Quantized<B::Kept>, B::Error> {
    let (sample_len, limits) = effort(bits, books);
    let mut sample = sample::<L, B>(batches, scaling, sample_len)?;
    let bend = is_refined.then(|| Bend::of(&sample));
    if let Some(bend) = bend {
        sample.iter_mut().for_each(|vector| bend.bend(vector));
    }
    let quantizer = Quantizer::train(&mut sample, bits.entries(), limits, &|| batches.go_on());
    drop(sample);
    let about: Vec<(u32, usize)> =
        (0..batches.len()).map(|batch| (batches.group(batch), batches.info(batch).particles)).collect();
    let parts = parts(&about);
    let group_of = |part: &Range<usize>| about[part.start].0;
    let columns = 4 + scaling.attributes.len();
    let code_part = |part: &Range<usize>| -> Result<(Vec<B::Kept>, Sums), B::Error> {
        let mut sums = Sums::new(quantizer.len(), columns, scope);
        let (mut vectors, mut codes) = ([[0.0; L]; RUN], [0; RUN]);
        let code = |batch: usize| {
            let codes = batches.with(batch, |batch| {
                let mut all = Vec::with_capacity(batch.len());
                for first in (0..batch.len()).step_by(RUN) {
                    let run = first..batch.len().min(first + RUN);
                    let codes = &mut codes[..run.len()];
                    scaling.vectors(batch, run.clone(), &mut vectors);
                    if let Some(bend) = bend {
                        vectors[..run.len()].iter_mut().for_each(|vector| bend.bend(vector));
                    }
                    quantizer.codes(&vectors[..run.len()], codes);
                    run.zip(&*codes).for_each(|(i, &code)| sums.add(code as usize, batch, i, scaling));
                    all.extend(codes.iter().map(|&code| code as u16));
                }
                all
            })?;
            batches.keep(codes)
        };
        let kept: Result<Vec<_>, _> = part.clone().map(code).collect();
        kept.map(|kept| (kept, sums))
    };
    let mut totals = Sums::new(quantizer.len(), columns, scope);
    // Of the group at hand.
    let mut own: Option<(u32, Sums)> = None;
    let mut kept = Vec::with_capacity(parts.len());
    for parts in parts.chunks(PARTS) {
        let coded: Vec<_> = parts.par_iter().map(code_part).collect::<Result<_, _>>()?;
        for (group, (codes, sums)) in parts.iter().map(group_of).zip(coded) {
            kept.push(codes);
            match &mut own {
                Some((same, own)) if *same == group => own.merge(&sums),
                _ => {
                    if let Some((_, before)) = own.replace((group, sums)) {
                        totals.merge(&before);
                    }
                }
            }
        }
    }
    if let Some((_, last)) = own {
        totals.merge(&last);
    }
    let (mut codebook, mut numbers) = totals.codebook(scaling);
    let mut refinement = None;
    if let Some(bend) = bend {
        let [_, density, smoothing_length] = &scaling.quantities;
        let mut lines = totals.lines(&codebook, bend.power(density, smoothing_length));
        let presence = totals.presence();
        kept = refine(batches, &parts, kept, &mut lines, &numbers, (&presence[..], &codebook.mass[..]))?;
        codebook = lines.unrolled(codebook);
        // Refined codes name their entries.
        numbers = (0..codebook.len()).map(|code| code as u16).collect();
        refinement = Some(lines);
    }
    let settled: Vec<(Vec<Coded<B::Kept>>, Vec<QuantityError>)> = parts
        .par_iter()
        .zip(kept)
        .map(|(part, kept)| settle(batches, part.clone().zip(kept), scaling, &codebook, &numbers))
        .collect::<Result<_, _>>()?;
    let errors: Vec<(u32, &[QuantityError])> =
        parts.iter().map(group_of).zip(settled.iter().map(|(_, errors)| &errors[..])).collect();
    codebook.errors = (0..columns - 1)
        .map(|k| {
            let of_group = |group: &[(u32, &[QuantityError])]| group.iter().map(|own| own.1[k].mean).sum::<f64>();
            let sum: f64 = errors.chunk_by(|a, b| a.0 == b.0).map(of_group).sum();
            let max = errors.iter().fold(0.0, |max: f64, own| max.max(own.1[k].max));
            QuantityError { mean: sum / codebook.particles.max(1) as f64, max }
        })
        .collect();
    let batches = settled.into_iter().flat_map(|(coded, _)| coded).collect();
    Ok(Quantized { codebook, refinement, numbers, batches })
}

/// Replaces codes of lines, of which `numbers` has the lines, by refined ones; and makes the steps conserve what the lines do, `sum m rho`
/// and the mass of a particle.
fn refine<B: Batches>(
    batches: &B,
    parts: &[Range<usize>],
    kept: Vec<Vec<B::Kept>>,
    lines: &mut Refinement,
    numbers: &[u16],
    (presence, mass): (&[f64], &[f32]),
) -> Result<Vec<Vec<B::Kept>>, B::Error> {
    let finder = lines.finder();
    let refined: Vec<(Vec<B::Kept>, Vec<u64>)> = parts
        .par_iter()
        .zip(kept)
        .map(|(part, kept)| {
            let mut counts = vec![0; mass.len() * STEPS];
            let code = |(batch, kept): (usize, B::Kept)| {
                let mut codes = batches.codes(&kept)?;
                batches.forget(kept);
                batches.with(batch, |batch| {
                    let mut octaves = [0.0; RUN];
                    for (codes, lengths) in codes.chunks_mut(RUN).zip(batch.smoothing_length.chunks(RUN)) {
                        // A loop of its own, so that it is one for SIMD lanes.
                        octaves.iter_mut().zip(lengths).for_each(|(octaves, &length)| *octaves = fast_log2(length));
                        for (code, &octaves) in codes.iter_mut().zip(&octaves) {
                            let line = usize::from(numbers[usize::from(*code)]);
                            let refined = Refinement::code(line, finder.step(line, octaves));
                            counts[refined] += 1;
                            *code = refined as u16;
                        }
                    }
                })?;
                batches.keep(codes)
            };
            let kept: Result<Vec<_>, _> = part.clone().zip(kept).map(code).collect();
            kept.map(|kept| (kept, counts))
        })
        .collect::<Result<_, _>>()?;
    let mut counts = vec![0; mass.len() * STEPS];
    for (_, own) in &refined {
        counts.iter_mut().zip(own).for_each(|(sum, count)| *sum += count);
    }
    lines.conserve(presence, mass, &counts);
    Ok(refined.into_iter().map(|(kept, _)| kept).collect())
}

/// Runs of batches, of which groups and particles are told: parts of about the same number of particles of each group.
fn parts(batches: &[(u32, usize)]) -> Vec<Range<usize>> {
    let groups = || batches.chunk_by(|a, b| a.0 == b.0);
    let each = PARTS.div_ceil(groups().count().max(1));
    let mut parts = Vec::new();
    let mut first = 0;
    for group in groups() {
        let total: usize = group.iter().map(|(_, particles)| particles).sum();
        let goal = total.div_ceil(each).max(1);
        let (end, mut len) = (first + group.len(), 0);
        for (batch, (_, particles)) in (first..).zip(group) {
            len += particles;
            if len >= goal || batch + 1 == end {
                parts.push(first..batch + 1);
                (first, len) = (batch + 1, 0);
            }
        }
    }
    parts
}

/// What the batches of a part decode to, and the sum and the maximum of each quantity's errors.
fn settle<B: Batches>(
    batches: &B,
    part: impl Iterator<Item = (usize, B::Kept)>,
    scaling: &Scaling,
    codebook: &Codebook,
    numbers: &[u16],
) -> Result<(Vec<Coded<B::Kept>>, Vec<QuantityError>), B::Error> {
    let mut errors = vec![QuantityError::default(); 3 + scaling.attributes.len()];
    let coded = part.map(|(batch, kept)| {
        // Renumbered once, for all columns.
        let mut entries = batches.codes(&kept)?;
        entries.iter_mut().for_each(|code| *code = numbers[usize::from(*code)]);
        let mut coded = Coded { codes: kept, mass: 0.0, mass_density: 0.0, smoothing_length_max: 0.0 };
        for entry in entries.iter().map(|&entry| usize::from(entry)) {
            let mass = f64::from(codebook.mass[entry]);
            coded.mass += mass;
            coded.mass_density += mass * f64::from(codebook.density[entry]);
            coded.smoothing_length_max = coded.smoothing_length_max.max(codebook.smoothing_length[entry]);
        }
        batches.with(batch, |batch| {
            let mut measure = |k: usize, scaling: &ColumnScaling, values: &[f32], decoded: &[f32]| {
                let QuantityError { mean: mut sum, mut max } = errors[k];
                for (&value, &entry) in values.iter().zip(&entries) {
                    let error = scaling.error(value, decoded[usize::from(entry)]);
                    sum += error;
                    max = max.max(error);
                }
                errors[k] = QuantityError { mean: sum, max };
            };
            measure(0, &scaling.quantities[0], batch.mass, &codebook.mass);
            measure(1, &scaling.quantities[1], batch.density, &codebook.density);
            measure(2, &scaling.quantities[2], batch.smoothing_length, &codebook.smoothing_length);
            for (k, (scaling, _)) in scaling.attributes.iter().enumerate() {
                measure(3 + k, scaling, batch.attributes[k], &codebook.attributes[k]);
            }
        })?;
        Ok(coded)
    });
    let coded = coded.collect::<Result<_, _>>()?;
    Ok((coded, errors))
}

#[cfg(test)]
mod tests {
    use super::super::scaling::AttributeMerge;
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

        fn codes(&self, kept: &Vec<u16>) -> Result<Vec<u16>, Self::Error> {
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
