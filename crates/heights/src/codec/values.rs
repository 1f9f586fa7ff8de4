//! Which values the samples of a file have: all of their type, or few enough that they lie within a bound of the source's.
//!
//! Whole numbers become multiples of an odd whole number; a multiple beyond the type's ends stands for the end itself. Floats become multiples
//! of a step of four significant bits, as far as 2^20 steps (singles) or 2^40 steps (doubles) from 0, so that each of them is a number of the
//! type; farther out, where numbers of the type are not much denser, all of them are left. Words count the values that are left, in their order.

use super::words::Words;
use deepfield_data::lanes::in_lanes;
use deepfield_data::model::{SampleType, Scale};

/// The values that stored samples may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values {
    sample_type: SampleType,
    steps: Option<Steps>,
}

impl Values {
    /// All of a type.
    pub fn all(sample_type: SampleType) -> Values {
        Values { sample_type, steps: None }
    }

    /// Those of a type that are multiples of a step, in stored samples; `None` where it is no step of that type.
    pub fn stepped(sample_type: SampleType, step: f64) -> Option<Values> {
        Some(Values { sample_type, steps: Some(Steps::new(sample_type, step)?) })
    }

    /// As few as have one within `error` of every sample's height, which [`Scale::value`] gives, to the last bit of its result. All of the type
    /// where rounding by so little makes no difference, as below 1 of whole numbers. `error` is above 0.
    pub fn within(sample_type: SampleType, scale: Scale, error: f64) -> Values {
        let step = Steps::within(sample_type, scale, error);
        step.and_then(|step| Values::stepped(sample_type, step)).unwrap_or(Values::all(sample_type))
    }

    /// Their type.
    pub fn sample_type(&self) -> SampleType {
        self.sample_type
    }

    /// What they are multiples of, unless all of the type may be.
    pub fn step(&self) -> Option<f64> {
        self.steps.map(|steps| steps.step)
    }

    /// The value that is nearest to a height between stored ones; NaN stays.
    pub fn nearest(&self, value: f64) -> f64 {
        match self.steps {
            Some(steps) => steps.nearest(value),
            None => nearest(self.sample_type, value),
        }
    }

    /// Rounds samples of the type.
    pub fn round(&self, stored: &mut [f64]) {
        if let Some(steps) = self.steps {
            // Newer processors round in one instruction.
            in_lanes!(steps.round(stored));
        }
    }

    /// How they become whole numbers; `None` where heights are not stored like this.
    pub(super) fn words(&self) -> Option<Words> {
        self.steps.map(Words::Steps).or_else(|| Words::of(self.sample_type))
    }
}

/// The value of the type that is nearest.
fn nearest(sample_type: SampleType, value: f64) -> f64 {
    match sample_type {
        SampleType::F64 => value,
        SampleType::F32 => f64::from(value as f32),
        _ => value.round(),
    }
}

/// Multiples of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Steps {
    step: f64,
    /// The type's least and largest value, and their words.
    ends: [f64; 2],
    words: [i64; 2],
    /// So many steps from 0 is where multiples end; floats beyond are all there.
    last: i64,
    /// Where that is.
    reach: f64,
    is_single: bool,
}

impl Steps {
    /// `None` where the step is none: of whole numbers an odd one of at least 3, of floats one of four significant bits that is far above the
    /// type's least number.
    fn new(sample_type: SampleType, step: f64) -> Option<Steps> {
        let ends = ends_of(sample_type)?;
        let is_step = match sample_type.is_float() {
            true => (least_step(sample_type)..=MOST_STEP).contains(&step) && four_bits(step) == step,
            false => (3.0..=2.0 * (ends[1] - ends[0]) + 1.0).contains(&step) && step % 2.0 == 1.0,
        };
        if !is_step {
            return None;
        }
        let last = last_of(sample_type);
        let reach = last.map_or(f64::MAX, |last| last as f64 * step);
        let is_single = sample_type == SampleType::F32;
        let steps = Steps { step, ends, words: [0; 2], last: last.unwrap_or(i64::MAX), reach, is_single };
        Some(Steps { words: ends.map(|end| steps.word(end)), ..steps })
    }

    /// The largest step that keeps heights within an error; `None` where nothing is to be rounded.
    fn within(sample_type: SampleType, scale: Scale, error: f64) -> Option<f64> {
        let ends = ends_of(sample_type)?;
        let slope = scale.slope.abs();
        let is_exact = scale.intercept == 0.0 && slope.to_bits() << 12 == 0;
        let most = if is_exact {
            error / slope
        } else {
            // Both heights are rounded as they are scaled.
            let farthest = match last_of(sample_type) {
                Some(last) => 2.0 * last as f64 * error,
                None => slope * ends[1].max(-ends[0]),
            };
            let rounding = 4.0 * f64::EPSILON * (farthest + scale.intercept.abs());
            (error - rounding) / slope * (1.0 - 2.0 * f64::EPSILON)
        };
        let step = match sample_type.is_float() {
            true => four_bits((2.0 * most).min(MOST_STEP)),
            false => 2.0 * most.floor().min(ends[1] - ends[0]) + 1.0,
        };
        let least = if sample_type.is_float() { least_step(sample_type) } else { 3.0 };
        (step >= least).then_some(step)
    }

    /// How many steps from 0 the nearest multiple is, of a value within reach.
    #[inline(always)]
    fn number(&self, value: f64) -> f64 {
        let number = (value / self.step).round_ties_even();
        // Quotients are rounded. This difference is not: with so few steps, and so few bits of a step, it is a double.
        let over = value - number * self.step;
        let half = 0.5 * self.step;
        number + f64::from(u8::from(over > half)) - f64::from(u8::from(over < -half))
    }

    #[inline(always)]
    fn multiple(&self, number: f64) -> f64 {
        // 0 has one sign.
        (number * self.step + 0.0).clamp(self.ends[0], self.ends[1])
    }

    #[inline(always)]
    fn nearest(&self, value: f64) -> f64 {
        if value.abs() <= self.reach {
            self.multiple(self.number(value))
        } else if self.is_single {
            f64::from(value as f32)
        } else {
            value
        }
    }

    #[inline(always)]
    fn round(&self, stored: &mut [f64]) {
        for value in stored {
            *value = self.nearest(*value);
        }
    }

    /// The whole number of a value that is left, in the same order; those of neighbours differ by 1. Of NaN it is anything.
    #[inline(always)]
    pub(super) fn word(&self, value: f64) -> i64 {
        if value.abs() <= self.reach {
            return self.number(value) as i64;
        }
        let beyond = self.last.wrapping_add(self.bits(value.abs()).wrapping_sub(self.bits(self.reach)));
        if value < 0.0 { beyond.wrapping_neg() } else { beyond }
    }

    /// The value of a word; `None` where it has none.
    #[inline(always)]
    pub(super) fn value(&self, word: i64) -> Option<f64> {
        if !(self.words[0]..=self.words[1]).contains(&word) {
            return None;
        }
        let beyond = word.abs().saturating_sub(self.last);
        if beyond <= 0 {
            return Some(self.multiple(word as f64));
        }
        let bits = self.bits(self.reach) + beyond;
        let value = if self.is_single { f64::from(f32::from_bits(bits as u32)) } else { f64::from_bits(bits as u64) };
        Some(if word < 0 { -value } else { value })
    }

    /// The bits of a float that is not negative: those of the next one are 1 more.
    #[inline(always)]
    fn bits(&self, value: f64) -> i64 {
        if self.is_single { i64::from((value as f32).to_bits()) } else { value.to_bits() as i64 }
    }
}

/// The largest step of floats: no multiple that counts is larger than all numbers.
const MOST_STEP: f64 = 1e290;

/// The least and the largest value of a type.
fn ends_of(sample_type: SampleType) -> Option<[f64; 2]> {
    Some(match Words::of(sample_type)? {
        Words::Whole(low, high) => [low as f64, high as f64],
        Words::Single => [-f64::from(f32::MAX), f64::from(f32::MAX)],
        _ => [-f64::MAX, f64::MAX],
    })
}

/// How many steps from 0 floats are rounded.
fn last_of(sample_type: SampleType) -> Option<i64> {
    match sample_type {
        SampleType::F32 => Some(1 << 20),
        SampleType::F64 => Some(1 << 40),
        _ => None,
    }
}

/// The least step of floats, all multiples of which are numbers of the type.
fn least_step(sample_type: SampleType) -> f64 {
    // 2^-146 is eight of the least singles.
    if sample_type == SampleType::F32 { 8.0 * f64::from(f32::from_bits(1)) } else { 1e-300 }
}

/// The number without all but its first four significant bits, which is nearer to 0.
fn four_bits(value: f64) -> f64 {
    f64::from_bits(value.to_bits() & !((1 << 49) - 1))
}
