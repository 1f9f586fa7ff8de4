//! `deepfield select` of a height field: a rectangle of its samples as another file.

use super::HeightsOptions;
use crate::commands::CommandResult;
use crate::commands::progress_bar::TerminalProgress;
use crate::heights::export::{ExportOptions, export_heights};
use crate::heights::model::{HeightGrid, Heights, Window};
use crate::model::ReadMethod;
use std::path::Path;

/// Where a rectangle is: its least and its largest x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// The least x and y.
    pub min: [f64; 2],
    /// The largest.
    pub max: [f64; 2],
}

/// Two corners: x0,y0,x1,y1.
///
/// # Errors
/// What was expected.
pub fn rectangle(text: &str) -> Result<Rectangle, String> {
    let parts: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|value: &f64| value.is_finite())).collect();
    match parts.as_deref() {
        Some(&[x0, y0, x1, y1]) => Ok(Rectangle { min: [x0.min(x1), y0.min(y1)], max: [x0.max(x1), y0.max(y1)] }),
        _ => Err("expected two corners x0,y0,x1,y1 such as 0,0,10,5".into()),
    }
}

impl Rectangle {
    /// The samples in it and on its edge; `None` where it has none.
    pub fn window(&self, grid: &HeightGrid) -> Option<Window> {
        let [mut row, mut column] = [[0.0; 2]; 2];
        for (end, corner) in [self.min, self.max].into_iter().enumerate() {
            let [r, c] = grid.row_column(corner);
            (row[end], column[end]) = (r, c);
        }
        let range = |[a, b]: [f64; 2], count: u64| {
            let (low, high) = (a.min(b), a.max(b));
            // What is on the edge but for rounding is in it.
            let near = 1e-9 * (1.0 + low.abs().max(high.abs()));
            let first = (low - near).ceil().max(0.0);
            let last = (high + near).floor().min(count as f64 - 1.0);
            (first <= last).then(|| (first as u64, (last - first) as u64 + 1))
        };
        let ((row, rows), (column, columns)) = (range(row, grid.rows)?, range(column, grid.columns)?);
        Some(Window { row, column, rows, columns })
    }

    /// The same, with why there is none.
    ///
    /// # Errors
    /// One line with the field's extent.
    pub fn window_of(&self, path: &Path, grid: &HeightGrid) -> Result<Window, String> {
        self.window(grid).ok_or_else(|| {
            let ([x0, y0], [x1, y1]) = (grid.place(0.0, 0.0), grid.place(grid.rows as f64 - 1.0, grid.columns as f64 - 1.0));
            format!("{}: --rectangle: found no sample in it, expected a part of x {x0} to {x1}, y {y0} to {y1}", path.display())
        })
    }
}

/// Selects and writes.
///
/// # Errors
/// When the data cannot be read, or the file not be written.
pub fn run(path: &Path, options: &HeightsOptions, part: Option<Rectangle>, out: &Path) -> CommandResult {
    let open = options.open(path, &[], ReadMethod::default())?;
    let grid = open.grid();
    let window = match part {
        None => Window::all(grid),
        Some(part) => part.window_of(path, grid)?,
    };
    let all_valid = open.all_valid();
    let written = export_heights(&open, window, out, &ExportOptions { all_valid }, &TerminalProgress::new())?;
    for note in &written.notes {
        eprintln!("note: {note}");
    }
    println!("{} of {} samples in {} were measured", written.valid, written.samples, out.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    #[test]
    fn samples_on_the_edge_belong_to_a_rectangle() {
        let grid = HeightGrid { origin: [1.0, 9.0], step: [0.1, -0.3], ..HeightGrid::new(11, 21, SampleType::F32) };
        let part = rectangle("1.3,9,1.2,8.4").unwrap();
        assert_eq!(part.window(&grid), Some(Window { row: 0, column: 2, rows: 3, columns: 2 }));
        assert_eq!(rectangle("-9,-9,99,99").unwrap().window(&grid), Some(Window::all(&grid)));
        assert_eq!(rectangle("1.11,9,1.19,8.4").unwrap().window(&grid), None);
        assert!(rectangle("1,2,3").is_err() && rectangle("1,2,3,nan").is_err());
    }
}
