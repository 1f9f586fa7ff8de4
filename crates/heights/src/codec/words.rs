//! Stored samples as whole numbers of the same order, and back: every bit of a number comes back, the sign of zero, too.

use super::values::Steps;
use deepfield_data::lanes::in_lanes;
use deepfield_data::model::SampleType;

/// Whole numbers of the samples of a type. Samples of 64 bits that are no floats are not known here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Words {
    /// The samples are whole numbers of these bounds.
    Whole(i64, i64),
    /// Singles.
    Single,
    /// Doubles.
    Double,
    /// The samples are rounded.
    Steps(Steps),
}

impl Words {
    /// Of a type; `None` where heights are not stored like this.
    pub(super) fn of(sample_type: SampleType) -> Option<Words> {
        Some(match sample_type {
            SampleType::I8 => Words::Whole(i8::MIN.into(), i8::MAX.into()),
            SampleType::U8 => Words::Whole(0, u8::MAX.into()),
            SampleType::I16 => Words::Whole(i16::MIN.into(), i16::MAX.into()),
            SampleType::U16 => Words::Whole(0, u16::MAX.into()),
            SampleType::I32 => Words::Whole(i32::MIN.into(), i32::MAX.into()),
            SampleType::U32 => Words::Whole(0, u32::MAX.into()),
            SampleType::F32 => Words::Single,
            SampleType::F64 => Words::Double,
            SampleType::I64 | SampleType::U64 => return None,
        })
    }

    /// Puts the words of samples into `out`. What was not measured becomes anything.
    pub(super) fn encode(self, stored: &[f64], out: &mut [i64]) {
        let pairs = out.iter_mut().zip(stored);
        match self {
            Words::Whole(..) => pairs.for_each(|(word, value)| *word = *value as i64),
            Words::Single => pairs.for_each(|(word, value)| {
                let bits = (*value as f32).to_bits() as i32;
                *word = i64::from(bits ^ (((bits >> 31) as u32) >> 1) as i32);
            }),
            Words::Double => pairs.for_each(|(word, value)| {
                let bits = value.to_bits() as i64;
                *word = bits ^ (((bits >> 63) as u64) >> 1) as i64;
            }),
            // As for `Values::round`.
            Words::Steps(steps) => in_lanes!({
                for (word, value) in pairs {
                    *word = steps.word(*value);
                }
            }),
        }
    }

    /// Puts the samples of words into `out`. False where a word is no finite sample of the type.
    pub(super) fn decode(self, words: &[i64], out: &mut [f64]) -> bool {
        let pairs = out.iter_mut().zip(words);
        let mut is_right = true;
        match self {
            Words::Whole(low, high) => pairs.for_each(|(value, word)| {
                is_right &= (low <= *word) & (*word <= high);
                *value = *word as f64;
            }),
            Words::Single => pairs.for_each(|(value, word)| {
                let bits = *word as i32;
                let single = f32::from_bits((bits ^ (((bits >> 31) as u32) >> 1) as i32) as u32);
                is_right &= (i64::from(bits) == *word) & single.is_finite();
                *value = single.into();
            }),
            Words::Double => pairs.for_each(|(value, word)| {
                *value = f64::from_bits((*word ^ (((*word >> 63) as u64) >> 1) as i64) as u64);
                is_right &= value.is_finite();
            }),
            Words::Steps(steps) => pairs.for_each(|(value, word)| {
                let found = steps.value(*word);
                is_right &= found.is_some();
                *value = found.unwrap_or_default();
            }),
        }
        is_right
    }

    /// Whether a word is a finite sample of the type.
    pub(super) fn is_one(self, word: i64) -> bool {
        self.decode(&[word], &mut [0.0])
    }
}
