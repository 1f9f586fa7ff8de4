//! Samples that were decoded into memory, each in the type it is stored in.

use super::source::Samples;
use crate::model::Window;
use deepfield_data::import::ImportError;

/// A type of stored samples.
pub(super) trait Stored: Copy + Send + Sync + 'static {
    /// The sample as a number. Whole numbers above 2^53 are rounded.
    fn number(self) -> f64;
}

macro_rules! stored {
    ($($kind:ty)*) => {
        $(impl Stored for $kind {
            #[allow(clippy::unnecessary_cast, reason = "one of the types is the number's own")]
            fn number(self) -> f64 {
                self as f64
            }
        })*
    };
}
stored!(i8 u8 i16 u16 i32 u32 i64 u64 f32 f64);

/// Samples, row by row.
pub(super) struct InMemory<T> {
    columns: u64,
    samples: Vec<T>,
}

impl<T: Stored> InMemory<T> {
    /// Samples in rows of `columns`; as many as the grid has, which the caller checks.
    pub(super) fn new(columns: u64, samples: Vec<T>) -> InMemory<T> {
        InMemory { columns, samples }
    }
}

/// The samples of a window among all; those that are not there are left as they are.
fn gather<T: Copy, U>(all: &[T], columns: u64, window: Window, out: &mut [U], of: impl Fn(T) -> U) {
    let width = (window.columns as usize).max(1);
    for (number, out) in out.chunks_mut(width).enumerate() {
        let first = (window.row as usize + number) * columns as usize + window.column as usize;
        for (out, sample) in out.iter_mut().zip(all.get(first..).unwrap_or_default()) {
            *out = of(*sample);
        }
    }
}

impl<T: Stored> Samples for InMemory<T> {
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        gather(&self.samples, self.columns, window, out, T::number);
        Ok(())
    }
}
