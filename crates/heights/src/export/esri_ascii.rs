//! Esri ASCII grids: rows from north to south, and places from west to east.

use super::new_file::NewFile;
use super::{Export, ExportError, Exported, bands};
use crate::model::Window;
use rayon::prelude::*;
use std::fmt::Write as _;

/// What stands for no data where no height is such.
const NO_DATA: f64 = -9999.0;

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let grid = export.grid();
    let window = export.window;
    let [dx, dy] = grid.step;
    if dx < 0.0 {
        return Err(export.refused(
            "spacing",
            format!("{dx}, {dy}"),
            "columns from west to east, as the format has them",
        ));
    }
    // The format knows rows from north to south only.
    let is_turned = dy > 0.0;
    let last = Window { row: window.row + window.rows - 1, rows: 1, ..window };
    let lowest = if is_turned { window } else { last };
    let [x, y] = grid.place(lowest.row as f64, lowest.column as f64);
    // Equal but for the rounding of what was calculated from corners.
    let is_square = (dx - dy.abs()).abs() <= 1e-12 * dx;
    let cell = if is_square { format!("cellsize {dx:?}\n") } else { format!("dx {dx:?}\ndy {:?}\n", dy.abs()) };
    let no_data = no_data(export)?;
    let mut file = NewFile::create(export.output, 0)?;
    let head = format!(
        "ncols {}\nnrows {}\nxllcenter {x:?}\nyllcenter {y:?}\n{cell}NODATA_value {}\n",
        window.columns,
        window.rows,
        Word(no_data)
    );
    file.write(head.as_bytes())?;
    let end = window.column + window.columns;
    let put = |band: Window, values: &[f64]| {
        let ends_row = band.column + band.columns == end;
        let lines: Vec<String> =
            values.par_chunks(band.columns as usize).map(|line| text(line, no_data, ends_row)).collect();
        lines.iter().try_for_each(|line| file.write(line.as_bytes()))
    };
    let valid = if is_turned { export.each_band_turned(false, put)? } else { export.each_band(false, put)? };
    file.finish()?;
    let mut done = export.done(valid);
    if is_turned {
        done.notes.push("rows are written from the last to the first: the format has them from north to south".into());
    }
    Ok(done)
}

/// What stands for no data: below all heights where one of them is the usual number.
fn no_data(export: &Export) -> Result<f64, ExportError> {
    let mut values = Vec::new();
    let (mut least, mut is_taken) = (NO_DATA, false);
    for band in bands(export.window) {
        values.resize(band.samples() as usize, 0.0);
        export.heights.heights(band, &mut values)?;
        is_taken |= values.contains(&NO_DATA);
        least = values.iter().copied().fold(least, f64::min);
    }
    if !is_taken {
        return Ok(NO_DATA);
    }
    // Far enough below to be another number, however large.
    let below = (2.0 * least - 1.0).floor();
    Ok(if below.is_finite() { below } else { f64::MIN })
}

/// A number as the format has it: whole ones without a point.
struct Word(f64);

impl std::fmt::Display for Word {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.fract() == 0.0 && self.0.abs() < 1e15 && !(self.0 == 0.0 && self.0.is_sign_negative()) {
            return write!(f, "{}", self.0 as i64);
        }
        write!(f, "{:?}", self.0)
    }
}

fn text(line: &[f64], no_data: f64, ends_row: bool) -> String {
    let mut text = String::with_capacity(line.len() * 8);
    for height in line {
        let word = Word(if height.is_nan() { no_data } else { *height });
        // Writing to a string cannot fail.
        let _ = write!(text, "{word} ");
    }
    if ends_row {
        text.pop();
        text.push('\n');
    }
    text
}
