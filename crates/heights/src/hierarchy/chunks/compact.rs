//! Stored samples in as little memory as keeps their values.

use deepfield_data::model::SampleType;

/// Numbers as singles where their type fits into these, else as doubles. NaN was not measured.
#[derive(Clone, Debug, PartialEq)]
pub enum Compact {
    /// Of i8 to u16 and f32.
    Single(Vec<f32>),
    /// Of i32, u32 and f64.
    Double(Vec<f64>),
}

impl Compact {
    /// Of samples of a type.
    pub fn new(sample_type: SampleType, stored: &[f64]) -> Compact {
        match is_single(sample_type) {
            true => Compact::Single(stored.iter().map(|value| *value as f32).collect()),
            false => Compact::Double(stored.to_vec()),
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Compact::Single(values) => values.len(),
            Compact::Double(values) => values.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them; NaN beyond the end.
    pub fn get(&self, at: usize) -> f64 {
        match self {
            Compact::Single(values) => values.get(at).copied().map_or(f64::NAN, f64::from),
            Compact::Double(values) => values.get(at).copied().unwrap_or(f64::NAN),
        }
    }

    /// Copies those from `first` on.
    pub fn copy(&self, first: usize, out: &mut [f64]) {
        let end = first + out.len();
        match self {
            Compact::Single(values) => {
                out.iter_mut().zip(&values[first..end]).for_each(|(out, value)| *out = f64::from(*value))
            }
            Compact::Double(values) => out.copy_from_slice(&values[first..end]),
        }
    }
}

/// Whether singles hold every value of a type.
pub fn is_single(sample_type: SampleType) -> bool {
    sample_type == SampleType::F32 || (sample_type.size() <= 2 && !sample_type.is_float())
}
