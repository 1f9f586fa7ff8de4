//! T by its definition, and fields of formulas.

use crate::model::{Cell, HeightField};

/// T's height at a row and a column with fractions: every cell near by is asked, closed.
pub fn height(field: &HeightField, row: f64, column: f64) -> Option<f64> {
    let grid = &field.grid;
    for r in 0..grid.rows - 1 {
        for c in 0..grid.columns - 1 {
            let (u, v) = (column - c as f64, row - r as f64);
            let eps = 1e-9;
            if u.min(v) < -eps || u.max(v) > 1.0 + eps {
                continue;
            }
            for triangle in cell(field, r, c).triangles() {
                if triangle.edge[0] + triangle.edge[1] * u + triangle.edge[2] * v >= -eps {
                    return Some(triangle.at[0] + triangle.at[1] * u + triangle.at[2] * v);
                }
            }
        }
    }
    None
}

pub fn cell(field: &HeightField, row: u64, column: u64) -> Cell {
    let (first, columns) = ((row * field.grid.columns + column) as usize, field.grid.columns as usize);
    Cell([first, first + 1, first + columns, first + columns + 1].map(|n| field.stored[n]))
}

/// A field of a formula of row and column.
pub fn of(columns: u64, rows: u64, mut formula: impl FnMut(f64, f64) -> f64) -> HeightField {
    let heights = (0..columns * rows).map(|n| formula((n / columns) as f64, (n % columns) as f64)).collect();
    HeightField::of(columns, rows, heights)
}

/// A sin x sin y with so many samples a wave.
pub fn sines(columns: u64, rows: u64, wave: f64, amplitude: f64) -> HeightField {
    let k = 2.0 * std::f64::consts::PI / wave;
    of(columns, rows, |row, column| amplitude * (k * row).sin() * (k * column).sin())
}

/// Takes a share of the samples away.
pub fn with_holes(mut field: HeightField, share: f64, seed: u64) -> HeightField {
    let mut next = super::rays::random(seed);
    field.stored.iter_mut().for_each(|height| *height = if next() < share { f64::NAN } else { *height });
    field
}

pub fn assert_near(found: f64, wanted: f64, relative: f64, what: &str) {
    assert!((found - wanted).abs() <= relative * (wanted.abs() + 1.0), "{what}: {found}, not {wanted}");
}
