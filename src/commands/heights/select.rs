//! `deepfield select` of a height field: a rectangle of its samples as another file.

use super::StatedOptions;
use super::info::within;
use crate::commands::progress_bar::TerminalProgress;
use crate::commands::{CommandResult, print_line};
use crate::heights::OpenHeights;
use crate::heights::export::{ExportOptions, export_heights};
use crate::heights::measure::{Part, window_of};
use crate::heights::model::{HeightGrid, Heights, Window, units};
use std::path::Path;

/// Two opposite corners of a rectangle in x and y.
pub type Corners = [[f64; 2]; 2];

/// Two corners: x0,y0,x1,y1.
///
/// # Errors
/// What was expected.
pub fn rectangle(text: &str) -> Result<Corners, String> {
    match numbers(text).as_deref() {
        Some(&[x0, y0, x1, y1]) => Ok([[x0, y0], [x1, y1]]),
        _ => Err("expected two corners x0,y0,x1,y1 such as 0,0,10,5".into()),
    }
}

/// Finite numbers with commas between them.
pub fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|part| part.trim().parse().ok().filter(|value: &f64| value.is_finite())).collect()
}

/// The samples in a rectangle and on its edges, which may be over the seam of a globe.
///
/// # Errors
/// One line with the field's extent where there is none, and where it is over both ends of a field in degrees and over what is open between them.
pub fn window_in(path: &Path, grid: &HeightGrid, corners: Corners) -> Result<Window, String> {
    let refused = |found: &str| {
        let ([x0, y0], [x1, y1]) =
            (grid.place(0.0, 0.0), grid.place(grid.rows as f64 - 1.0, grid.columns as f64 - 1.0));
        let expected = format!("a part of x {x0} to {x1}, y {y0} to {y1}");
        format!("{}: region: found {found}, expected {expected}", path.display())
    };
    let window = window_of(grid, corners).ok_or_else(|| refused("no sample in it"))?;
    let is_again = |turn: f64| window_of(grid, corners.map(|[x, y]| [x + turn, y])).is_some();
    let is_open = units::is_degrees(&grid.xy_unit) && grid.around().is_none() && window.columns < grid.columns;
    match is_open && (is_again(360.0) || is_again(-360.0)) {
        true => Err(refused("samples at both ends of the field in it")),
        false => Ok(window),
    }
}

/// Selects and writes.
///
/// # Errors
/// When the data cannot be read, or the file not be written.
pub fn run(path: &Path, options: &StatedOptions, part: Option<Corners>, out: &Path) -> CommandResult {
    let open = options.open(path)?;
    let grid = open.grid();
    let window = match part {
        None => Window::all(grid),
        Some(corners) => window_in(path, grid, corners)?,
    };
    let turned = Part::turned(&open, window);
    let (field, window) = turned.as_ref().map_or((&open as &dyn Heights, window), |(part, window)| (part, *window));
    let all_valid = open.all_valid();
    let written = export_heights(field, window, out, &ExportOptions { all_valid }, &TerminalProgress::new())?;
    for note in within(&open).iter().chain(&written.notes) {
        eprintln!("note: {note}");
    }
    if matches!(&open, OpenHeights::Pages(file) if file.about().photo.is_some()) {
        eprintln!("note: the photo over the field is left out");
    }
    print_line(format_args!("{} of {} samples in {} were measured", written.valid, written.samples, out.display()))?;
    Ok(())
}
