//! NumPy's `.npy`: one array of rows, NaN where nothing was measured.

use super::new_file::NewFile;
use super::numbers::{encode, written_type};
use super::{Export, ExportError, Exported};
use deepfield_data::model::SampleType;
use std::path::Path;

/// Writes an array of two axes, from the first row on.
pub struct NpyWriter {
    file: NewFile,
    sample_type: SampleType,
    bytes: Vec<u8>,
}

impl NpyWriter {
    /// An array of so many columns and rows.
    ///
    /// # Errors
    /// When the file cannot be created, or its disk has too little room.
    pub fn create(output: &Path, [columns, rows]: [u64; 2], sample_type: SampleType) -> Result<NpyWriter, ExportError> {
        let samples = columns.saturating_mul(rows);
        let mut file = NewFile::create(output, samples.saturating_mul(sample_type.size() as u64).saturating_add(128))?;
        file.write(&head([columns, rows], sample_type))?;
        Ok(NpyWriter { file, sample_type, bytes: Vec::new() })
    }

    /// Appends samples, row by row.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write(&mut self, values: &[f64]) -> Result<(), ExportError> {
        encode(self.sample_type, values, &mut self.bytes);
        self.file.write(&self.bytes)
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn finish(self) -> Result<(), ExportError> {
        self.file.finish()
    }
}

/// What the file begins with: format 1.0, a multiple of 64 bytes long.
fn head([columns, rows]: [u64; 2], sample_type: SampleType) -> Vec<u8> {
    let size = sample_type.size();
    let order = if size == 1 { '|' } else { '<' };
    let kind = if sample_type.is_float() { 'f' } else { sample_type.name().chars().next().unwrap_or('u') };
    let text = format!("{{'descr': '{order}{kind}{size}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
    let mut head = b"\x93NUMPY\x01\x00".to_vec();
    head.extend_from_slice(&(length as u16).to_le_bytes());
    head.extend_from_slice(format!("{text:<width$}\n", width = length - 1).as_bytes());
    head
}

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let sample_type = written_type(export.grid(), || export.all_valid())?;
    let window = export.window;
    let mut writer = NpyWriter::create(export.output, [window.columns, window.rows], sample_type)?;
    let valid = export.each_band(!sample_type.is_float(), |_, values| writer.write(values))?;
    writer.finish()?;
    Ok(export.done(valid))
}
