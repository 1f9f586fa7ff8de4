//! The material ratio curve of a region of heights, as a table and as a plot.

use super::profile::{is_plot, named, plot};
use crate::color::output::{write_atomically, write_png};
use crate::commands::CommandResult;
use crate::commands::arguments::PictureSize;
use crate::heights::model::HeightGrid;
use std::fmt::Write as _;
use std::path::Path;

/// What goes to the right.
const ACROSS: &str = "material ratio [%]";

/// Writes a curve of the file at `path`, shares and heights, to `out`: as a table, or as a plot of this size.
///
/// # Errors
/// When the file's name says neither, or it cannot be written.
pub fn write(
    out: &Path,
    path: &Path,
    grid: &HeightGrid,
    curve: &[[f64; 2]],
    size: Option<PictureSize>,
) -> CommandResult {
    if is_plot(out)? {
        return Ok(write_png(out, &plot(path, ACROSS, grid, curve, size))?);
    }
    let mut text = format!("{ACROSS},{}\n", named("height", &grid.height_unit));
    for [share, height] in curve {
        writeln!(text, "{share},{height}")?;
    }
    Ok(write_atomically(out, text.as_bytes())?)
}
