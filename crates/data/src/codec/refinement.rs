//! Finer smoothing lengths for the codes of leaves.
//!
//! A picture shows the error of a smoothing length at once, as a peak that is too wide or too narrow, and density all but follows from
//! it: `rho h^3` hardly differs between particles of one mass. So an entry of a codebook need not hold one smoothing length: it is
//! a line, along which the smoothing length goes from the shortest to the longest of its particles in equal ratios, and density goes
//! with a power of it. A code names an entry, and in [`REFINEMENT_BITS`] more bits a step on its line. The quantiser sees density as far as
//! the smoothing length does not tell it, and little of the smoothing length ([`Bend`]), so that the entries are there for what is left:
//! masses, scatter, attributes.
//!
//! Whoever decodes sees a common codebook: each step of each line is an entry of it ([`Refinement::unrolled`]).

use super::codebook::Codebook;
use super::scaling::{ColumnScaling, fast_log2};
use crate::model::portable::{expect, portable};

/// Bits of a refined code beside those that name its line.
pub const REFINEMENT_BITS: u32 = 4;
/// Steps of a line.
pub const STEPS: usize = 1 << REFINEMENT_BITS;

/// How much more the quantiser looks at what the smoothing length leaves of density than at density itself, and how much at the
/// smoothing length; both were chosen on a generated box (`docs/results.md`).
const LEFT_OVER: f32 = 2.0;
const ALONG: f32 = 0.5;
/// Steepest power of the smoothing length that density may follow: of data where it follows none, noise would make it any.
const STEEPEST: f32 = 4.0;
/// Coordinates of density and smoothing length in the quantiser's space.
const DENSITY: usize = 1;
const SMOOTHING_LENGTH: usize = 2;

/// How the lines of a codebook run. All columns have an item for each line.
#[derive(Clone, Debug, PartialEq)]
pub struct Refinement {
    /// The power of the smoothing length that density follows along a line: about -3.
    pub slope: f32,
    /// Density in the middle.
    pub density: Vec<f32>,
    /// Smoothing length of the near end: the shortest of any particle.
    pub shortest: Vec<f32>,
    /// That of the far end: the longest.
    pub longest: Vec<f32>,
}

portable!(Refinement { slope, density, shortest, longest });

impl Refinement {
    /// The number in the unrolled codebook of a step of a line.
    pub fn code(line: usize, step: usize) -> usize {
        line << REFINEMENT_BITS | step
    }

    /// Whether all columns have an item for each of so many lines; else what was found and expected.
    pub fn check(&self, lines: usize) -> Result<(), String> {
        let columns = [&self.density, &self.shortest, &self.longest].into_iter();
        columns.map(Vec::len).try_for_each(|found| expect("lines of a codebook", found, lines))
    }

    /// Whether the slope is one that a codebook has, and every line has a positive beginning and does not end before it.
    pub fn is_sound(&self) -> bool {
        let mut ends = self.shortest.iter().zip(&self.longest);
        self.slope.abs() <= STEEPEST
            && ends.all(|(shortest, longest)| 0.0 < *shortest && shortest <= longest && longest.is_finite())
    }

    /// Smoothing lengths of a line's steps, and the factors on its density.
    fn steps(&self, line: usize) -> [(f32, f64); STEPS] {
        let (shortest, longest) = (f64::from(self.shortest[line]), f64::from(self.longest[line]));
        let (ratio, slope) = (longest / shortest, f64::from(self.slope));
        let step = ratio.powf(1.0 / STEPS as f64);
        let thinner = step.powf(slope);
        // From the middle of the first step, which is as far before the line's middle as the last one's is behind it.
        let mut at = (shortest * step.sqrt(), ratio.powf(slope * (0.5 / STEPS as f64 - 0.5)));
        std::array::from_fn(|_| {
            let (smoothing_length, factor) = at;
            at = (smoothing_length * step, factor * thinner);
            (positive(smoothing_length), factor)
        })
    }

    /// The codebook in which each step of each line is an entry; all but the smoothing length and the density of an entry are those that
    /// `lines` has for its line.
    pub fn unrolled(&self, lines: Codebook) -> Codebook {
        let repeated = |column: &[f32]| -> Vec<f32> {
            column.iter().flat_map(|&value| std::iter::repeat_n(value, STEPS)).collect()
        };
        let count = self.density.len();
        let (mut density, mut smoothing_length) =
            (Vec::with_capacity(count * STEPS), Vec::with_capacity(count * STEPS));
        for (line, &middle) in self.density.iter().enumerate() {
            for (length, factor) in self.steps(line) {
                smoothing_length.push(length);
                density.push(positive(f64::from(middle) * factor));
            }
        }
        Codebook {
            mass: repeated(&lines.mass),
            density,
            smoothing_length,
            attributes: lines.attributes.iter().map(|column| repeated(column)).collect(),
            ..lines
        }
    }

    /// Makes the steps conserve `sum m rho`, as far as singles can: `presence` is that sum for each line, `mass` the mass of one of its
    /// particles, and `counts` says how many of them there are on each step of each line.
    pub fn conserve(&mut self, presence: &[f64], mass: &[f32], counts: &[u64]) {
        for (line, presence) in presence.iter().enumerate() {
            let counts = &counts[Refinement::code(line, 0)..][..STEPS];
            let sum: f64 = self.steps(line).iter().zip(counts).map(|((_, factor), &count)| count as f64 * factor).sum();
            self.density[line] = positive(presence / (f64::from(mass[line]) * sum));
        }
    }

    /// What finds the step of a smoothing length.
    pub fn finder(&self) -> Finder {
        let of = |(&shortest, &longest): (&f32, &f32)| {
            let (start, width) = (fast_log2(shortest), fast_log2(longest) - fast_log2(shortest));
            // A line without length has its one particle's smoothing length on all steps.
            [start, if width > 0.0 { STEPS as f32 / width } else { 0.0 }]
        };
        Finder { lines: self.shortest.iter().zip(&self.longest).map(of).collect() }
    }
}

/// Finds steps.
pub struct Finder {
    /// For each line where it starts, in octaves, and its steps in one.
    lines: Vec<[f32; 2]>,
}

impl Finder {
    /// The step of a line whose smoothing length is nearest, in ratio, to one of so many octaves: its [`fast_log2`].
    #[inline]
    pub fn step(&self, line: usize, octaves: f32) -> usize {
        let [start, steps] = self.lines[line];
        // The cast saturates: what rounding puts before the line is on its first step. To bytes it takes the fewest instructions.
        usize::from(((octaves - start) * steps) as u8).min(STEPS - 1)
    }
}

/// The quantiser's space as refined codes have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// How the coordinate of density follows that of the smoothing length.
    slope: f32,
}

portable!(Bend { slope });

impl Bend {
    /// By how these vectors lie: the line of regression.
    pub fn of<const L: usize>(sample: &[[f32; L]]) -> Bend {
        let count = sample.len().max(1) as f64;
        let mean = |axis: usize| sample.iter().map(|vector| f64::from(vector[axis])).sum::<f64>() / count;
        let (density, smoothing_length) = (mean(DENSITY), mean(SMOOTHING_LENGTH));
        let (mut product, mut square) = (0.0, 0.0);
        for vector in sample {
            let along = f64::from(vector[SMOOTHING_LENGTH]) - smoothing_length;
            product += along * (f64::from(vector[DENSITY]) - density);
            square += along * along;
        }
        let slope = (product / square) as f32;
        Bend { slope: if slope.is_finite() { slope.clamp(-STEEPEST, STEEPEST) } else { 0.0 } }
    }

    /// Bends a vector of the quantiser's usual space.
    #[inline]
    pub fn bend<const L: usize>(self, vector: &mut [f32; L]) {
        vector[DENSITY] = LEFT_OVER * (vector[DENSITY] - self.slope * vector[SMOOTHING_LENGTH]);
        vector[SMOOTHING_LENGTH] *= ALONG;
    }

    /// The power of the smoothing length that density follows, of columns scaled like this.
    pub fn power(self, density: &ColumnScaling, smoothing_length: &ColumnScaling) -> f32 {
        (self.slope * smoothing_length.octave() / density.octave()).clamp(-STEEPEST, STEEPEST)
    }
}

/// The nearest positive normal single.
fn positive(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

#[cfg(test)]
mod tests {
    use super::super::codebook::CodebookScope;
    use super::*;
    use proptest::prelude::*;

    fn lines(count: usize) -> Codebook {
        Codebook {
            scope: CodebookScope::Leaves,
            particles: 0,
            mass: (0..count).map(|line| 1.0 + line as f32).collect(),
            density: vec![1.0; count],
            smoothing_length: vec![1.0; count],
            attributes: vec![(0..count).map(|line| -(line as f32)).collect()],
            errors: Vec::new(),
        }
    }

    proptest! {
        /// A step is half of a step's ratio off at most, and steps differ by one ratio from end to end.
        #[test]
        fn the_nearest_step_is_half_a_step_off(
            shortest in -60.0..60.0_f32, octaves in 0.0..8.0_f32, share in 0.0..1.0_f32, slope in -4.0..4.0_f32,
        ) {
            let refinement = Refinement {
                slope,
                density: vec![3.0, 5.0],
                shortest: vec![1.0, shortest.exp2()],
                longest: vec![1.0, (shortest + octaves).exp2()],
            };
            let h = (shortest + share * octaves).exp2();
            let book = refinement.unrolled(lines(2));
            prop_assert_eq!(book.len(), 2 * STEPS);
            let step = refinement.finder().step(1, fast_log2(h));
            let code = Refinement::code(1, step);
            let off = (book.smoothing_length[code] / h).log2().abs();
            prop_assert!(off <= octaves / (2.0 * STEPS as f32) + 6e-5, "{off} of {octaves} octaves");
            prop_assert_eq!((book.mass[code], book.attributes[0][code]), (2.0, -1.0));
            // Density follows the power of the smoothing length, from its middle on.
            let middle = (shortest + 0.5 * octaves).exp2();
            let expected = f64::from(slope) * f64::from(book.smoothing_length[code] / middle).log2();
            prop_assert!((f64::from(book.density[code] / 5.0).log2() - expected).abs() < 1e-3);
            // What has one smoothing length keeps it, to the last bit.
            prop_assert!(book.smoothing_length[..STEPS].iter().all(|&h| h == 1.0));
            prop_assert_eq!(refinement.finder().step(0, fast_log2(1.0)), 0);
        }

        #[test]
        fn steps_conserve_presence(
            octaves in 0.0..3.0_f32, slope in -4.0..0.0_f32, counts in prop::collection::vec(0..1000_u64, STEPS), more in 1..9_u64,
        ) {
            let counts: Vec<u64> = counts.into_iter().map(|count| count + more).collect();
            let mut refinement =
                Refinement { slope, density: vec![1.0], shortest: vec![0.25], longest: vec![0.25 * octaves.exp2()] };
            refinement.conserve(&[1234.5], &[1.0], &counts);
            let book = refinement.unrolled(lines(1));
            let sum: f64 = counts.iter().zip(&book.density).map(|(&count, &density)| count as f64 * f64::from(density)).sum();
            prop_assert!((sum / 1234.5 - 1.0).abs() < 1e-6, "{}", sum);
        }

        /// Where density follows from the smoothing length nothing is left of it, however columns are weighted.
        #[test]
        fn a_power_law_is_found(power in -3.5..1.0_f32, weight in 1.0..4.0_f32) {
            let lengths: Vec<f32> = (0..200).map(|i| (i as f32 * 0.03).exp2()).collect();
            let scaling = [ColumnScaling::positive(&lengths), ColumnScaling::positive(&lengths).weighted(weight)];
            let vector = |h: &f32| [0.0, scaling[0].map(7.0 * h.powf(power)), scaling[1].map(*h), 0.0];
            let mut vectors: Vec<[f32; 4]> = lengths.iter().map(vector).collect();
            let bend = Bend::of(&vectors);
            prop_assert!((bend.power(&scaling[0], &scaling[1]) - power).abs() < 1e-3);
            vectors.iter_mut().for_each(|vector| bend.bend(vector));
            prop_assert!(vectors.iter().all(|vector| (vector[DENSITY] - vectors[0][DENSITY]).abs() < 1e-2));
        }
    }

    #[test]
    fn columns_that_are_constant_have_no_slope() {
        for sample in [&[][..], &[[1.0, 2.0, 3.0, 0.0]], &[[1.0, 2.0, 3.0, 0.0], [1.0, 9.0, 3.0, 0.0]]] {
            assert_eq!(Bend::of(sample), Bend { slope: 0.0 });
        }
    }
}
