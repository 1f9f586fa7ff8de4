//! Synthetic height fields of any size: every sample is a function of the seed and of its place, so that fields are
//! read in windows like any others, and are the same to the last bit on every machine and for any number of threads.

mod fbm;
mod holes;
mod noise;
mod shape;
mod surface;
#[cfg(test)]
mod tests;

pub use shape::SurfaceShape;
pub use surface::{SurfaceOptions, SyntheticSurface};

use crate::export::{ExportError, ExportOptions, NpyWriter, bands, export_heights, has_extension};
use crate::model::{Heights, Window};
use deepfield_data::model::{Progress, Unit};
use std::path::Path;

/// Writes a field in the format that the name says, in bounded memory. In `.npy` whole numbers stay such: where nothing
/// was measured they have the least value of their type. Nothing is left behind on failure.
///
/// # Errors
/// [`ExportError`] where the options cannot be, the ending is not known, or the file cannot be written.
pub fn write_surface(options: &SurfaceOptions, output: &Path, progress: &dyn Progress) -> Result<(), ExportError> {
    let mut options = options.clone();
    if has_extension(output, "x3p") && options.unit.is_unknown() {
        // The format has no lengths without a unit.
        options.unit = Unit::new("m");
    }
    let surface = SyntheticSurface::new(&options, output)?;
    let grid = surface.grid();
    if !has_extension(output, "npy") {
        let all_valid = Some(!surface.has_holes());
        export_heights(&surface, Window::all(grid), output, &ExportOptions { all_valid }, progress)?;
        return Ok(());
    }
    let mut writer = NpyWriter::create(output, [grid.columns, grid.rows], grid.sample_type)?;
    progress.begin("writing samples", grid.samples());
    let least = surface.least();
    let mut values = Vec::new();
    for window in bands(Window::all(grid)) {
        values.resize(window.samples() as usize, 0.0);
        surface.stored(window, &mut values)?;
        if !grid.sample_type.is_float() && surface.has_holes() {
            values.iter_mut().filter(|value| value.is_nan()).for_each(|value| *value = least);
        }
        writer.write(&values)?;
        progress.advance(window.samples());
    }
    writer.finish()
}
