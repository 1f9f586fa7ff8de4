//! What parts that were read tell of all parts: totals, ratios of totals, and their errors.
//!
//! Most parts are as merged particles say, and a few are not. A sample may miss the few that matter to a total; then neither the total nor the
//! variance among the parts that were read tells of them. Parts differ from what is said by particles that lie elsewhere, or have other values,
//! than those that they were merged to, which is about as likely of all. So the squares of differences go with what is said of a part, at a
//! rate that all totals of one kind (bins, shells) tell together, and no error is less than that rate makes it (a generalized variance
//! function; Wolter, Introduction to Variance Estimation, 7). What merged particles say nothing of has its own variance alone.

use super::Estimated;
use super::parts::{Drawn, Part};
use crate::explore::error::ExploreError;
use std::ops::Range;

/// Standard errors that an error is told as: of bins to which many parts contribute, one in some hundreds is farther off.
const STANDARD_ERRORS: f64 = 3.0;

/// Totals over all particles.
pub(in crate::explore) struct Totals {
    pub values: Vec<f64>,
    /// Three standard errors of them, by how much the parts differ that were read.
    errors: Vec<f64>,
    /// The same of [`Estimated::ratios`].
    ratio_errors: Vec<f64>,
    /// What merged particles say of all parts, without signs.
    said: Vec<f64>,
    /// What they say of those that were read.
    said_of_read: Vec<f64>,
    /// By how much these have more: sums of squares.
    squares: Vec<f64>,
    /// The same of what is above in a ratio, less the ratio times what is below.
    ratio_squares: Vec<f64>,
    /// Three standard errors where the squares of all parts would have the sum 1.
    unit: f64,
}

/// By how much parts differ from what is said of them.
struct Misfit {
    /// Sum of squares, of those that were read.
    squares: f64,
    /// What the squares go with, of those that were read and of all.
    of_read: f64,
    of_all: f64,
}

impl Totals {
    /// Three standard errors of totals of one kind.
    pub fn errors_of(&self, kind: Range<usize>) -> Vec<f64> {
        let misfit = |total: usize| Misfit {
            squares: self.squares[total],
            of_read: self.said_of_read[total],
            of_all: self.said[total],
        };
        let least = self.least_errors(kind.clone().map(misfit).collect());
        least.zip(&self.errors[kind]).map(|(least, &error)| error.max(least)).collect()
    }

    /// Three standard errors of ratios of one kind, which are means; `of`: the weight, the weighted sum of the values and that of their squares.
    pub fn mean_errors_of(&self, kind: Range<usize>, of: impl Fn(usize) -> [usize; 3]) -> Vec<f64> {
        let misfit = |(place, ratio): (usize, usize)| {
            let [weight, sum, squares] = of(place);
            let mean = self.values[sum] / self.values[weight];
            let has_mean = self.values[weight] > 0.0 && mean.is_finite();
            let size = |said: &[f64]| if has_mean { said[squares] + mean * mean * said[weight] } else { 0.0 };
            Misfit { squares: self.ratio_squares[ratio], of_read: size(&self.said_of_read), of_all: size(&self.said) }
        };
        let least = self.least_errors(kind.clone().enumerate().map(misfit).collect());
        let errors = least.zip(&self.ratio_errors[kind]).enumerate();
        errors.map(|(place, (least, &error))| error.max(least / self.values[of(place)[0]])).collect()
    }

    /// Three standard errors of ratios, each by itself.
    pub fn ratio_errors(&self) -> &[f64] {
        &self.ratio_errors
    }

    /// Errors by the rate that is the same of all: each counts by what of it was read.
    fn least_errors(&self, misfits: Vec<Misfit>) -> impl Iterator<Item = f64> {
        let told = || misfits.iter().filter(|misfit| misfit.of_all > 0.0);
        let squares: f64 = told().map(|misfit| misfit.squares / misfit.of_all).sum();
        let read: f64 = told().map(|misfit| misfit.of_read / misfit.of_all).sum();
        let (rate, unit) = (if squares > 0.0 { squares / read } else { 0.0 }, self.unit);
        misfits.into_iter().map(
            move |Misfit { of_all, .. }| {
                if of_all > 0.0 && rate > 0.0 { unit * (rate * of_all).sqrt() } else { 0.0 }
            },
        )
    }

    /// Those of one of several questions.
    pub fn part(&self, totals: Range<usize>, ratios: Range<usize>) -> Totals {
        let of = |all: &[f64]| all[totals.clone()].to_vec();
        Totals {
            values: of(&self.values),
            errors: of(&self.errors),
            ratio_errors: self.ratio_errors[ratios.clone()].to_vec(),
            said: of(&self.said),
            said_of_read: of(&self.said_of_read),
            squares: of(&self.squares),
            ratio_squares: self.ratio_squares[ratios].to_vec(),
            unit: self.unit,
        }
    }
}

/// What is known of all parts by those that were read.
pub(super) struct Sample<'a, G: Estimated> {
    gather: &'a G,
    /// What is in no part.
    known: G::Part,
    /// What those that were read hold together.
    inside: G::Part,
    /// Totals of what is in no part, and of what merged particles say of all parts.
    said: Vec<f64>,
    /// What merged particles say of all parts and of those that were read, without signs.
    sizes: [Vec<f64>; 2],
    /// By how much parts that were read have more than was said of them: sums, and sums of squares.
    differences: [Vec<f64>; 2],
    ratios: Vec<[usize; 2]>,
    /// Sums of the products of these differences of each ratio.
    products: Vec<f64>,
    /// Those of a part.
    own: Vec<f64>,
    pub read: usize,
    pub parts: usize,
    /// Whether parts were read as a whole.
    are_whole: bool,
}

impl<'a, G: Estimated> Sample<'a, G> {
    pub fn new(gather: &'a G, known: G::Part, parts: &[Part]) -> Sample<'a, G> {
        let none = vec![0.0; gather.totals()];
        let mut said = none.clone();
        gather.count(&known, &mut said);
        let mut size = none.clone();
        for share in parts.iter().flat_map(|part| &part.shares) {
            said[share.total as usize] += f64::from(share.value);
            size[share.total as usize] += f64::from(share.value.abs());
        }
        let ratios = gather.ratios();
        Sample {
            gather,
            known,
            inside: gather.part(),
            said,
            sizes: [size, none.clone()],
            differences: [none.clone(), none.clone()],
            products: vec![0.0; ratios.len()],
            ratios,
            own: none,
            read: 0,
            parts: parts.len(),
            are_whole: true,
        }
    }

    /// Adds a part that was read.
    pub fn add(&mut self, drawn: Drawn<G::Part>) -> Result<(), ExploreError> {
        let own = &mut self.own;
        own.fill(0.0);
        if !drawn.is_counted {
            self.gather.count(&drawn.found, own);
        }
        drawn.beside.iter().for_each(|&(total, value)| own[total as usize] += value);
        for share in &drawn.said {
            own[share.total as usize] -= f64::from(share.value);
            self.sizes[1][share.total as usize] += f64::from(share.value.abs());
        }
        let [sums, squares] = &mut self.differences;
        sums.iter_mut().zip(&*own).for_each(|(sum, own)| *sum += own);
        squares.iter_mut().zip(&*own).for_each(|(sum, own)| *sum += own * own);
        let products = self.products.iter_mut().zip(&self.ratios);
        products.for_each(|(sum, &[above, below])| *sum += own[above] * own[below]);
        self.read += 1;
        self.are_whole &= drawn.is_whole;
        self.gather.join(&mut self.inside, drawn.found)
    }

    /// Whether there is nothing that was not read.
    pub fn is_all(&self) -> bool {
        self.read == self.parts && self.are_whole
    }

    /// Parts for one that was read.
    fn factor(&self) -> f64 {
        if self.read > 0 { self.parts as f64 / self.read as f64 } else { 0.0 }
    }

    /// The error of a total of which parts have this much in sum, and the squares of which have this sum.
    fn error(&self, sum: f64, squares: f64) -> f64 {
        if self.read < 2 {
            return f64::INFINITY;
        }
        let (read, parts) = (self.read as f64, self.parts as f64);
        let variance = ((squares - sum * sum / read) / (read - 1.0)).max(0.0);
        self.unit() * (parts * variance).sqrt()
    }

    /// The error of a total of which the squares of what parts have would have the sum 1.
    fn unit(&self) -> f64 {
        let left = if self.are_whole { 1.0 - self.read as f64 / self.parts as f64 } else { 1.0 };
        STANDARD_ERRORS * (self.factor() * left).sqrt()
    }

    pub fn totals(&self) -> Totals {
        let [sums, squares] = &self.differences;
        let factor = self.factor();
        let values: Vec<f64> = self.said.iter().zip(sums).map(|(said, sum)| said + factor * sum).collect();
        let errors = sums.iter().zip(squares).map(|(&sum, &squares)| self.error(sum, squares)).collect();
        let of_ratio = |(&[above, below], product): (&[usize; 2], &f64)| {
            if values[below] <= 0.0 {
                return (f64::INFINITY, 0.0);
            }
            let ratio = values[above] / values[below];
            let sum = sums[above] - ratio * sums[below];
            let squares = squares[above] - 2.0 * ratio * product + ratio * ratio * squares[below];
            (self.error(sum, squares) / values[below], squares.max(0.0))
        };
        let (ratio_errors, ratio_squares) = self.ratios.iter().zip(&self.products).map(of_ratio).unzip();
        let [said, said_of_read] = self.sizes.clone();
        Totals {
            values,
            errors,
            ratio_errors,
            said,
            said_of_read,
            squares: squares.clone(),
            ratio_squares,
            unit: self.unit(),
        }
    }

    /// All particles that were read, each as many times as it stands for others; exact where all were.
    pub fn found(self) -> Result<G::Part, ExploreError> {
        let factor = self.factor();
        let Sample { gather, mut known, inside, .. } = self;
        let inside = if factor > 1.0 { gather.scaled(inside, factor) } else { inside };
        gather.join(&mut known, inside)?;
        Ok(known)
    }
}

#[cfg(test)]
mod tests {
    use super::super::parts::Share;
    use super::*;
    use crate::explore::batch::{Batch, Gather};
    use crate::model::mixing::{GOLDEN, as_share, mix_bits};
    use crate::store::PageId;

    const BINS: usize = 6;

    /// By bin the weights, then sums of values, then those of their squares.
    struct Bins;

    impl Gather for Bins {
        type Part = Vec<f64>;

        fn part(&self) -> Vec<f64> {
            vec![0.0; 3 * BINS]
        }

        fn take(&self, _part: &mut Vec<f64>, _batch: &Batch) {}

        fn join(&self, whole: &mut Vec<f64>, next: Vec<f64>) -> Result<(), ExploreError> {
            self.count(&next, whole);
            Ok(())
        }
    }

    impl Estimated for Bins {
        fn totals(&self) -> usize {
            3 * BINS
        }

        fn ratios(&self) -> Vec<[usize; 2]> {
            (0..BINS).map(|bin| [BINS + bin, bin]).collect()
        }

        fn count(&self, part: &Vec<f64>, totals: &mut [f64]) {
            totals.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
        }

        fn merged(&self, _batch: &Batch, _per_mass: f64, _say: &mut dyn FnMut(usize, f64)) {}

        fn scaled(&self, part: Vec<f64>, factor: f64) -> Vec<f64> {
            part.into_iter().map(|value| factor * value).collect()
        }

        fn errors(&self, totals: &Totals) -> (Vec<f64>, f64) {
            (totals.errors_of(0..BINS), 0.0)
        }
    }

    /// Parts of 20 groups in two bins, with values that differ a thousandfold; one group in a hundred is in the next bin, though it is said to
    /// be in its own.
    #[test]
    fn errors_hold_where_few_parts_are_other_than_is_said_and_are_hardly_larger_than_they_need_be() {
        const PARTS: usize = 300;
        const READ: usize = 48;
        const DRAWS: usize = 40;
        let mut state = 0_u64;
        let mut next = move || {
            state = state.wrapping_add(GOLDEN);
            as_share(mix_bits(state))
        };
        let shares = |said: &[f64]| -> Vec<Share> {
            (0..).zip(said).map(|(total, &value)| Share { total, value: value as f32 }).collect()
        };
        let (mut made, mut parts) = (Vec::new(), Vec::new());
        for _ in 0..PARTS {
            let first = (next() * BINS as f64) as usize;
            let (mut own, mut said) = (Bins.part(), Bins.part());
            for group in 0..20 {
                let (bin, value) = ((first + group % 2) % BINS, 10_f64.powf(3.0 * next()));
                let there = if next() < 0.01 { (bin + 1) % BINS } else { bin };
                for (total, sum) in [1.0, value, value * value].into_iter().enumerate() {
                    own[total * BINS + there] += sum;
                    said[total * BINS + bin] += sum;
                }
            }
            let mut part = Part::root(PageId(0), true, 1);
            part.shares = shares(&said);
            parts.push(part);
            made.push((own, said));
        }
        let mut exact = Bins.part();
        made.iter().for_each(|(own, _)| Bins.count(own, &mut exact));
        let (mut held, mut told_squares, mut off_squares) = (0, 0.0, 0.0);
        for _ in 0..DRAWS {
            let mut sample = Sample::new(&Bins, Bins.part(), &parts);
            for read in 0..READ {
                let other = read + (next() * (PARTS - read) as f64) as usize;
                made.swap(read, other);
                let (own, said) = &made[read];
                let (found, said, beside) = (own.clone(), shares(said), Vec::new());
                let drawn = Drawn { found, said, beside, is_counted: false, particles: 1, pages: 1, is_whole: true };
                sample.add(drawn).unwrap();
            }
            let totals = sample.totals();
            let errors = totals.mean_errors_of(0..BINS, |bin| [0, 1, 2].map(|total| total * BINS + bin));
            for (bin, error) in errors.into_iter().enumerate() {
                let mean = |of: &[f64]| of[BINS + bin] / of[bin];
                let off = mean(&totals.values) - mean(&exact);
                held += usize::from(off.abs() <= error);
                told_squares += (error / mean(&exact)).powi(2);
                off_squares += (off / mean(&exact)).powi(2);
            }
        }
        assert!(held as f64 > 0.9 * (DRAWS * BINS) as f64, "{held} of {}", DRAWS * BINS);
        // Three standard errors are what is told.
        let times = (told_squares / off_squares).sqrt();
        assert!((2.0..6.0).contains(&times), "{times} times the error");
    }
}
