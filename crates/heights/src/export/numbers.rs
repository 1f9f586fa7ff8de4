//! Which numbers heights are written as, and their bytes.

use crate::model::HeightGrid;
use deepfield_data::model::{SampleType, Scale};
use rayon::prelude::*;

/// How a field's heights are written: whole numbers as they are stored where all of the field were measured and need no
/// scale, else floats, of 32 bits where the source's are such and need no scale.
pub(super) fn written_type(
    grid: &HeightGrid,
    all_valid: impl FnOnce() -> Result<bool, crate::model::HeightError>,
) -> Result<SampleType, crate::model::HeightError> {
    if grid.scale != Scale::NONE {
        return Ok(SampleType::F64);
    }
    if grid.sample_type.is_float() || all_valid()? {
        return Ok(grid.sample_type);
    }
    Ok(SampleType::F64)
}

/// The bytes of numbers, the least significant first, in place of what is in `bytes`. Numbers that a type of whole
/// numbers cannot hold become its nearest.
pub(super) fn encode(sample_type: SampleType, values: &[f64], bytes: &mut Vec<u8>) {
    /// Numbers that a task encodes.
    const PART: usize = 1 << 14;
    fn each<const N: usize>(values: &[f64], bytes: &mut [u8], of: impl Fn(f64) -> [u8; N] + Sync) {
        bytes.par_chunks_mut(PART * N).zip(values.par_chunks(PART)).for_each(|(bytes, values)| {
            for (place, value) in bytes.as_chunks_mut::<N>().0.iter_mut().zip(values) {
                *place = of(*value);
            }
        });
    }
    bytes.resize(values.len() * sample_type.size(), 0);
    match sample_type {
        SampleType::I8 => each(values, bytes, |value| (value as i8).to_le_bytes()),
        SampleType::U8 => each(values, bytes, |value| (value as u8).to_le_bytes()),
        SampleType::I16 => each(values, bytes, |value| (value as i16).to_le_bytes()),
        SampleType::U16 => each(values, bytes, |value| (value as u16).to_le_bytes()),
        SampleType::I32 => each(values, bytes, |value| (value as i32).to_le_bytes()),
        SampleType::U32 => each(values, bytes, |value| (value as u32).to_le_bytes()),
        SampleType::I64 => each(values, bytes, |value| (value as i64).to_le_bytes()),
        SampleType::U64 => each(values, bytes, |value| (value as u64).to_le_bytes()),
        SampleType::F32 => each(values, bytes, |value| (value as f32).to_le_bytes()),
        SampleType::F64 => each(values, bytes, f64::to_le_bytes),
    }
}
