//! The steps from batches to codes, each of which works on parts of the batches that anybody may have: training, coding, refining, settling.
//! What parts hand on is folded in their order, sums by groups first, so that it does not matter who has them.

use super::batches::{Batches, Coded};
use super::sums::Sums;
use super::training::{effort, sample};
use super::vectors::{RUN, Scaling};
use super::{PARTS, Quantized, check_numbers};
use crate::codec::codebook::{Codebook, CodebookScope, QuantityError};
use crate::codec::packing::{CodeBits, VqBits};
use crate::codec::quantizer::Quantizer;
use crate::codec::refinement::{Bend, Refinement, STEPS};
use crate::codec::scaling::{ColumnScaling, fast_log2_all};
use crate::model::portable::{Portable, expect, expect_within, portable};
use std::ops::Range;

/// The quantiser's space, whose dimensions are a power of two.
enum Space {
    Narrow(Quantizer<4>),
    Wide(Quantizer<8>),
}

impl Portable for Space {
    fn put(&self, to: &mut Vec<u8>) {
        match self {
            Space::Narrow(quantizer) => {
                false.put(to);
                quantizer.put(to);
            }
            Space::Wide(quantizer) => {
                true.put(to);
                quantizer.put(to);
            }
        }
    }

    fn take(from: &mut &[u8]) -> Option<Space> {
        match bool::take(from)? {
            false => Quantizer::take(from).map(Space::Narrow),
            true => Quantizer::take(from).map(Space::Wide),
        }
    }
}

/// A quantiser that has been trained.
pub struct Trained {
    scope: CodebookScope,
    space: Space,
    /// How the space is bent, where codes are refined.
    bend: Option<Bend>,
}

portable!(Trained { scope, space, bend });

/// What one part hands on when it is coded: its codes, and what the particles of each code have together.
pub type CodedPart<Kept> = (Vec<Kept>, Sums);

/// What one part hands on in the end: its batches, and sum and maximum of each quantity's errors.
pub type SettledPart<Kept> = (Vec<Coded<Kept>>, Vec<QuantityError>);

impl Trained {
    /// Trains a quantiser on some of the particles of all batches; see [`super::quantize`].
    ///
    /// # Errors
    /// Those of the batches.
    pub fn of<B: Batches>(
        batches: &B,
        scaling: &Scaling,
        bits: VqBits,
        scope: CodebookScope,
        books: usize,
        is_refined: bool,
    ) -> Result<Trained, B::Error> {
        let (space, bend) = if scaling.attributes.len() <= 1 {
            let (quantizer, bend) = trained::<4, B>(batches, scaling, bits, books, is_refined)?;
            (Space::Narrow(quantizer), bend)
        } else {
            let (quantizer, bend) = trained::<8, B>(batches, scaling, bits, books, is_refined)?;
            (Space::Wide(quantizer), bend)
        };
        Ok(Trained { scope, space, bend })
    }

    /// Codes the batches of a part.
    ///
    /// # Errors
    /// Those of the batches.
    pub fn code<B: Batches>(
        &self,
        batches: &B,
        part: Range<usize>,
        scaling: &Scaling,
    ) -> Result<CodedPart<B::Kept>, B::Error> {
        match &self.space {
            Space::Narrow(quantizer) => self.code_in(quantizer, batches, part, scaling),
            Space::Wide(quantizer) => self.code_in(quantizer, batches, part, scaling),
        }
    }

    fn code_in<const L: usize, B: Batches>(
        &self,
        quantizer: &Quantizer<L>,
        batches: &B,
        part: Range<usize>,
        scaling: &Scaling,
    ) -> Result<CodedPart<B::Kept>, B::Error> {
        let mut sums = Sums::new(quantizer.len(), columns(scaling), self.scope);
        let (mut vectors, mut codes) = ([[0.0; L]; RUN], [0; RUN]);
        let code = |batch: usize| {
            let codes = batches.with(batch, |batch| {
                let mut all = Vec::with_capacity(batch.len());
                for first in (0..batch.len()).step_by(RUN) {
                    let run = first..batch.len().min(first + RUN);
                    let codes = &mut codes[..run.len()];
                    scaling.vectors(batch, run.clone(), &mut vectors);
                    if let Some(bend) = self.bend {
                        vectors[..run.len()].iter_mut().for_each(|vector| bend.bend(vector));
                    }
                    quantizer.codes(&vectors[..run.len()], codes);
                    sums.add(codes, batch, run, scaling);
                    all.extend(codes.iter().map(|&code| code as u16));
                }
                all
            })?;
            batches.keep(codes)
        };
        let kept: Result<Vec<_>, _> = part.map(code).collect();
        kept.map(|kept| (kept, sums))
    }

    /// Number of its codes.
    fn codes(&self) -> usize {
        match &self.space {
            Space::Narrow(quantizer) => quantizer.len(),
            Space::Wide(quantizer) => quantizer.len(),
        }
    }

    /// Whether its codes have these bits, and are refined where those of its particles are; else what was found and expected.
    pub fn check(&self, bits: CodeBits) -> Result<(), String> {
        expect_within("code words", self.codes() as u64, 1..=bits.entries.entries() as u64)?;
        expect("refined", self.bend.is_some(), self.scope == CodebookScope::Leaves && bits.is_refined())
    }

    /// Sums of no part yet.
    pub fn totals(&self, scaling: &Scaling) -> Totals {
        Totals { all: Sums::new(self.codes(), columns(scaling), self.scope), own: None }
    }
}

/// Columns that are summed up.
fn columns(scaling: &Scaling) -> usize {
    4 + scaling.attributes.len()
}

fn trained<const L: usize, B: Batches>(
    batches: &B,
    scaling: &Scaling,
    bits: VqBits,
    books: usize,
    is_refined: bool,
) -> Result<(Quantizer<L>, Option<Bend>), B::Error> {
    let (sample_len, limits) = effort(bits, books);
    let mut sample = sample::<L, B>(batches, scaling, sample_len)?;
    let bend = is_refined.then(|| Bend::of(&sample));
    if let Some(bend) = bend {
        sample.iter_mut().for_each(|vector| bend.bend(vector));
    }
    Ok((Quantizer::train(&mut sample, bits.entries(), limits, &|| batches.go_on()), bend))
}

/// Sums of parts, of each group by itself and then of all.
pub struct Totals {
    all: Sums,
    /// Of the group at hand.
    own: Option<(u32, Sums)>,
}

impl Totals {
    /// Whether these can be sums of a part with so many particles; else what was found and expected.
    pub fn check(&self, sums: &Sums, particles: u64) -> Result<(), String> {
        self.all.check(sums, particles)
    }

    /// Adds those of the part that comes next.
    pub fn add(&mut self, group: u32, sums: Sums) {
        match &mut self.own {
            Some((same, own)) if *same == group => own.merge(&sums),
            _ => {
                if let Some((_, before)) = self.own.replace((group, sums)) {
                    self.all.merge(&before);
                }
            }
        }
    }

    /// The codebook of all parts.
    pub fn draft(mut self, trained: &Trained, scaling: &Scaling) -> Draft {
        if let Some((_, last)) = self.own {
            self.all.merge(&last);
        }
        let (codebook, numbers) = self.all.codebook(scaling);
        let [_, density, smoothing_length] = &scaling.quantities;
        let lines = trained.bend.map(|bend| self.all.lines(&codebook, bend.power(density, smoothing_length)));
        let presence = if lines.is_some() { self.all.presence() } else { Vec::new() };
        Draft { codebook, numbers, lines, presence }
    }
}

/// A codebook before all is known of it.
#[derive(Clone, Debug)]
pub struct Draft {
    codebook: Codebook,
    /// The entry of each code; of lines, the line.
    numbers: Vec<u16>,
    lines: Option<Refinement>,
    /// The sum of `m rho` of each line.
    presence: Vec<f64>,
}

portable!(Draft { codebook, numbers, lines, presence });

impl Draft {
    /// Whether it is of so many attributes, and numbers and columns of the same entries, of no more than these bits can name; else what was
    /// found and expected.
    pub fn check(&self, attributes: usize, bits: CodeBits) -> Result<(), String> {
        let Draft { codebook, numbers, lines, presence } = self;
        codebook.check(attributes, bits.of(codebook.scope == CodebookScope::Leaves).entries())?;
        check_numbers(numbers, codebook)?;
        let Some(lines) = lines else { return expect("presence", presence.len(), 0) };
        if self.is_of_lines() {
            expect("presence", presence.len(), codebook.len())?;
            lines.check(codebook.len())
        } else {
            expect("steps behind the last line", codebook.len() % STEPS, 0)?;
            lines.check(codebook.len() / STEPS)
        }
    }

    /// Codes that stand for something.
    fn codes(&self) -> usize {
        if self.codebook.is_empty() { 0 } else { self.numbers.len() }
    }

    /// Whether codes are still those of lines, which are to be refined.
    pub fn is_of_lines(&self) -> bool {
        !self.presence.is_empty()
    }

    /// Replaces the codes of a part by refined ones; counts them.
    ///
    /// # Errors
    /// Those of the batches.
    pub fn refine<B: Batches>(
        &self,
        batches: &B,
        part: Range<usize>,
        kept: Vec<B::Kept>,
    ) -> Result<(Vec<B::Kept>, Vec<u64>), B::Error> {
        let Some(lines) = &self.lines else { return Ok((kept, Vec::new())) };
        let (finder, numbers) = (lines.finder(), &self.numbers);
        let mut counts = vec![0; self.codebook.len() * STEPS];
        let code = |(batch, kept): (usize, B::Kept)| {
            let mut codes = batches.codes(&kept, batch, self.codes())?;
            batches.forget(kept);
            batches.with(batch, |batch| {
                let mut octaves = [0.0; RUN];
                for (codes, lengths) in codes.chunks_mut(RUN).zip(batch.smoothing_length.chunks(RUN)) {
                    fast_log2_all(1.0, lengths, &mut octaves);
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
        let kept: Result<Vec<_>, _> = part.zip(kept).map(code).collect();
        kept.map(|kept| (kept, counts))
    }

    /// Makes the steps of lines, of which each part has counted its own, conserve what the lines do, `sum m rho` and the mass of a particle.
    pub fn conserve<'a>(&mut self, parts: impl IntoIterator<Item = &'a Vec<u64>>) {
        let Some(lines) = &mut self.lines else { return };
        let mut counts = vec![0; self.codebook.len() * STEPS];
        for own in parts {
            counts.iter_mut().zip(own).for_each(|(sum, count)| *sum += count);
        }
        lines.conserve(&self.presence, &self.codebook.mass, &counts);
        self.codebook = lines.unrolled(self.codebook.clone());
        // Refined codes name their entries.
        self.numbers = (0..self.codebook.len()).map(|code| code as u16).collect();
        self.presence = Vec::new();
    }

    /// What the batches of a part decode to, and the sum and the maximum of each quantity's errors.
    ///
    /// # Errors
    /// Those of the batches.
    pub fn settle<B: Batches>(
        &self,
        batches: &B,
        part: Range<usize>,
        kept: Vec<B::Kept>,
        scaling: &Scaling,
    ) -> Result<SettledPart<B::Kept>, B::Error> {
        let Draft { codebook, numbers, .. } = self;
        let mut errors = vec![QuantityError::default(); 3 + scaling.attributes.len()];
        let coded = part.zip(kept).map(|(batch, kept)| {
            // Renumbered once, for all columns.
            let mut entries = batches.codes(&kept, batch, self.codes())?;
            entries.iter_mut().for_each(|code| *code = numbers[usize::from(*code)]);
            let mut coded = Coded { codes: kept, mass: 0.0, mass_density: 0.0, smoothing_length_max: 0.0 };
            for entry in entries.iter().map(|&entry| usize::from(entry)) {
                let mass = f64::from(codebook.mass[entry]);
                coded.mass += mass;
                coded.mass_density += mass * f64::from(codebook.density[entry]);
                coded.smoothing_length_max = coded.smoothing_length_max.max(codebook.smoothing_length[entry]);
            }
            batches.with(batch, |batch| {
                let (mut decoded, mut own) = ([0.0; RUN], [0.0; RUN]);
                let mut measure = |k: usize, scaling: &ColumnScaling, values: &[f32], book: &[f32]| {
                    let QuantityError { mean: mut sum, mut max } = errors[k];
                    for (values, entries) in values.chunks(RUN).zip(entries.chunks(RUN)) {
                        for (decoded, &entry) in decoded.iter_mut().zip(entries) {
                            *decoded = book[usize::from(entry)];
                        }
                        scaling.errors(values, &decoded, &mut own);
                        for &error in &own[..values.len()] {
                            sum += error;
                            // One instruction where `max` takes several, because that minds what is not a number.
                            max = if error > max { error } else { max };
                        }
                    }
                    errors[k] = QuantityError { mean: sum, max };
                };
                measure(0, &scaling.quantities[0], batch.mass, &codebook.mass);
                measure(1, &scaling.quantities[1], batch.density, &codebook.density);
                measure(2, &scaling.quantities[2], batch.smoothing_length, &codebook.smoothing_length);
                let columns = batch.attributes.iter().zip(&codebook.attributes);
                for (k, ((scaling, _), (values, book))) in (3..).zip(scaling.attributes.iter().zip(columns)) {
                    measure(k, scaling, values, book);
                }
            })?;
            Ok(coded)
        });
        let coded = coded.collect::<Result<_, _>>()?;
        Ok((coded, errors))
    }

    /// The codebook and the batches that it codes. Of parts in their order, each with its group, these are the errors.
    pub fn finished<Kept>(self, errors: &[(u32, Vec<QuantityError>)], batches: Vec<Coded<Kept>>) -> Quantized<Kept> {
        let Draft { mut codebook, numbers, lines, .. } = self;
        let quantities = 3 + codebook.attributes.len();
        codebook.errors = (0..quantities)
            .map(|k| {
                let of_group = |group: &[(u32, Vec<QuantityError>)]| group.iter().map(|own| own.1[k].mean).sum::<f64>();
                let sum: f64 = errors.chunk_by(|a, b| a.0 == b.0).map(of_group).sum();
                let max = errors.iter().fold(0.0, |max: f64, own| max.max(own.1[k].max));
                QuantityError { mean: sum / codebook.particles.max(1) as f64, max }
            })
            .collect();
        Quantized { codebook, refinement: lines, numbers, batches }
    }
}

/// Runs of batches, of which groups and particles are told: parts of about the same number of particles of each group.
pub fn parts(batches: &[(u32, usize)]) -> Vec<Range<usize>> {
    let groups = || batches.chunk_by(|a, b| a.0 == b.0);
    let each = parts_of_each(groups().count());
    let mut first = 0;
    let parts_of = |group: &[(u32, usize)]| {
        let parts = group_parts(first, group.iter().map(|(_, particles)| *particles), each);
        first += group.len();
        parts
    };
    groups().flat_map(parts_of).collect()
}

/// Parts that each of so many groups is cut into, about.
pub fn parts_of_each(groups: usize) -> usize {
    PARTS.div_ceil(groups.max(1))
}

/// The parts, about `each`, of the batches of a group, of which these are the particles, behind `first` others.
pub fn group_parts(
    first: usize,
    particles: impl ExactSizeIterator<Item = usize> + Clone,
    each: usize,
) -> Vec<Range<usize>> {
    let goal = particles.clone().sum::<usize>().div_ceil(each).max(1);
    let end = first + particles.len();
    let (mut parts, mut start, mut len) = (Vec::new(), first, 0);
    for (batch, particles) in (first..).zip(particles) {
        len += particles;
        if len >= goal || batch + 1 == end {
            parts.push(start..batch + 1);
            (start, len) = (batch + 1, 0);
        }
    }
    parts
}
