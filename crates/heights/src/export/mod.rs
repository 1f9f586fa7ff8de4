//! Height fields as files of other programs, band by band: [`export_heights`] writes what the name's ending says. Files
//! are written under another name first: whole, or not at all.

mod csv;
mod error;
mod esri_ascii;
mod new_file;
mod npy;
mod numbers;
mod png;
#[cfg(test)]
mod tests;
mod tiff;
mod x3p;

pub use error::ExportError;
pub use npy::NpyWriter;

use crate::model::{HeightError, HeightGrid, Heights, Window};
use deepfield_data::model::Progress;
use std::path::Path;

/// What is known of a field that is exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// Whether all samples of the field, not of the window alone, were measured; `None` is found out by reading it. It
    /// decides whether whole numbers stay such.
    pub all_valid: Option<bool>,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// Samples.
    pub samples: u64,
    /// Those among them that were measured.
    pub valid: u64,
    /// What the format cannot say, one sentence each.
    pub notes: Vec<String>,
}

/// A part of a field, on its way to a file.
struct Export<'h> {
    heights: &'h dyn Heights,
    window: Window,
    output: &'h Path,
    options: ExportOptions,
    progress: &'h dyn Progress,
}

/// A format that is written.
struct ExportFormat {
    /// How its files end, without the dot.
    extensions: &'static [&'static str],
    /// Writes one.
    write: fn(&Export) -> Result<Exported, ExportError>,
}

/// The formats that are written.
static FORMATS: &[ExportFormat] = &[
    ExportFormat { extensions: &["npy"], write: npy::write },
    ExportFormat { extensions: &["tif", "tiff"], write: tiff::write },
    ExportFormat { extensions: &["asc"], write: esri_ascii::write },
    ExportFormat { extensions: &["x3p"], write: x3p::write },
    ExportFormat { extensions: &["png"], write: png::write },
    ExportFormat { extensions: &["csv"], write: csv::write },
];

/// Writes a window of a field in the format that the ending of `output` says: `.npy`, `.tif`, `.asc`, `.x3p`, `.png` or
/// `.csv`. The same heights give the same bytes, wherever they are read from.
///
/// # Errors
/// [`ExportError`] where the ending is not known, the format cannot hold the heights, or they cannot be read or
/// written. Nothing is left behind.
pub fn export_heights(
    heights: &dyn Heights,
    window: Window,
    output: &Path,
    options: &ExportOptions,
    progress: &dyn Progress,
) -> Result<Exported, ExportError> {
    let known =
        FORMATS.iter().find(|format| format.extensions.iter().any(|extension| has_extension(output, extension)));
    let Some(format) = known else {
        let found =
            output.extension().map_or("none".to_owned(), |extension| format!(".{}", extension.to_string_lossy()));
        let known: Vec<String> = export_extensions().iter().map(|extension| format!(".{extension}")).collect();
        return Err(ExportError::refused(output, "ending", found, &format!("one of {}", known.join(", "))));
    };
    if !window.is_in(heights.grid()) {
        let found = format!("{} x {} from column {}, row {}", window.columns, window.rows, window.column, window.row);
        let expected = format!("a part of {}", heights.grid().described());
        return Err(ExportError::refused(output, "window", found, &expected));
    }
    progress.begin("writing samples", window.samples());
    (format.write)(&Export { heights, window, output, options: *options, progress })
}

/// The endings of files that [`export_heights`] writes, without dots.
pub fn export_extensions() -> Vec<&'static str> {
    FORMATS.iter().flat_map(|format| format.extensions).copied().collect()
}

/// Whether a name ends so, in any case.
pub(crate) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}

/// The most samples that are read at once.
const AT_ONCE: u64 = 1 << 22;

/// A window in parts, in the order of its samples row by row: whole rows, or parts of one row where these are long.
pub(crate) fn bands(window: Window) -> impl Iterator<Item = Window> {
    bands_of(window, false)
}

/// The same, from the last rows on where it is turned; rows of a part are in their order.
fn bands_of(window: Window, is_turned: bool) -> impl Iterator<Item = Window> {
    let rows = (AT_ONCE / window.columns.max(1)).max(1);
    let columns = window.columns.clamp(1, AT_ONCE);
    let parts = window.rows.div_ceil(rows);
    (0..parts).flat_map(move |part| {
        let above = if is_turned { parts - 1 - part } else { part } * rows;
        let (row, rows) = (window.row + above, rows.min(window.rows - above));
        (0..window.columns.div_ceil(columns)).map(move |part| {
            let before = part * columns;
            Window { row, column: window.column + before, rows, columns: columns.min(window.columns - before) }
        })
    })
}

impl Export<'_> {
    fn grid(&self) -> &HeightGrid {
        self.heights.grid()
    }

    /// Whether all samples of the field were measured.
    fn all_valid(&self) -> Result<bool, HeightError> {
        if let Some(known) = self.options.all_valid {
            return Ok(known);
        }
        let mut values = Vec::new();
        for band in bands(Window::all(self.grid())) {
            values.resize(band.samples() as usize, 0.0);
            self.heights.stored(band, &mut values)?;
            if values.iter().any(|value| value.is_nan()) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Hands the window's samples on, band by band: stored values, or heights. Returns how many were measured.
    fn each_band(
        &self,
        is_stored: bool,
        put: impl FnMut(Window, &[f64]) -> Result<(), ExportError>,
    ) -> Result<u64, ExportError> {
        self.each_band_of(bands(self.window), is_stored, false, put)
    }

    /// The same from the last row to the first.
    fn each_band_turned(
        &self,
        is_stored: bool,
        put: impl FnMut(Window, &[f64]) -> Result<(), ExportError>,
    ) -> Result<u64, ExportError> {
        self.each_band_of(bands_of(self.window, true), is_stored, true, put)
    }

    fn each_band_of(
        &self,
        bands: impl Iterator<Item = Window>,
        is_stored: bool,
        is_turned: bool,
        mut put: impl FnMut(Window, &[f64]) -> Result<(), ExportError>,
    ) -> Result<u64, ExportError> {
        let mut values = Vec::new();
        let mut valid = 0;
        for band in bands {
            values.resize(band.samples() as usize, 0.0);
            match is_stored {
                true => self.heights.stored(band, &mut values)?,
                false => self.heights.heights(band, &mut values)?,
            }
            if is_turned {
                let (width, rows) = (band.columns as usize, band.rows as usize);
                for row in 0..rows / 2 {
                    let (above, below) = values.split_at_mut((rows - 1 - row) * width);
                    above[row * width..][..width].swap_with_slice(&mut below[..width]);
                }
            }
            valid += values.iter().filter(|value| !value.is_nan()).count() as u64;
            put(band, &values)?;
            self.progress.advance(band.samples());
        }
        Ok(valid)
    }

    /// What was written.
    fn done(&self, valid: u64) -> Exported {
        Exported { samples: self.window.samples(), valid, notes: Vec::new() }
    }

    /// The place of the window's first sample.
    fn origin(&self) -> [f64; 2] {
        self.grid().place(self.window.row as f64, self.window.column as f64)
    }

    fn refused(&self, field: &str, found: impl ToString, expected: &str) -> ExportError {
        ExportError::refused(self.output, field, found, expected)
    }
}
