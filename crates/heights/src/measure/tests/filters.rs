//! Gaussian filters against their definition.

use super::truth::{assert_near, of, sines, with_holes};
use crate::measure::{Filter, Filtered, Part, roughness};
use crate::model::{HeightField, Heights, Lengths, Window};
use deepfield_data::model::Unit;
use std::f64::consts::PI;

fn read(heights: &dyn Heights, window: Window) -> Vec<f64> {
    let mut out = vec![0.0; window.samples() as usize];
    heights.heights(window, &mut out).unwrap();
    out
}

/// The weighted mean at a sample by a plain sum over all samples as far as the cut-off along both axes.
fn plain(field: &HeightField, cutoff: f64, row: u64, column: u64) -> f64 {
    let alpha = (2.0_f64.ln() / PI).sqrt();
    let (mut sum, mut weights) = (0.0, 0.0);
    for r in 0..field.grid.rows {
        for c in 0..field.grid.columns {
            let height = field.stored[(r * field.grid.columns + c) as usize];
            let (x, y) =
                ((c as f64 - column as f64) * field.grid.step[0], (r as f64 - row as f64) * field.grid.step[1]);
            if !height.is_nan() && x.abs() <= cutoff && y.abs() <= cutoff {
                let weight = (-PI * (x * x + y * y) / (alpha * cutoff).powi(2)).exp();
                (sum, weights) = (sum + weight * height, weights + weight);
            }
        }
    }
    sum / weights
}

#[test]
fn filters_are_weighted_means_of_measured_samples() {
    // Narrow and wide weights: plain sums and transforms.
    for (cutoff, steps) in [(7.3, [1.0, -0.5]), (60.0, [0.9, 1.7]), (500.0, [1.0, 1.0]), (0.2, [1.0, 1.0])] {
        let mut field =
            with_holes(of(90, 70, |row, column| 1e4 + (row * 0.3).sin() + (column * column * 0.01).cos()), 0.2, 2);
        field.grid.step = steps;
        let all = Window::all(&field.grid);
        let filtered = Filtered::new(&field, Filter::Short(cutoff), all).unwrap();
        let found = read(&filtered, all);
        let long = read(&Filtered::new(&field, Filter::Long(cutoff), all).unwrap(), all);
        for n in (0..90 * 70).step_by(97) {
            let own = field.stored[n];
            assert_eq!(own.is_nan(), found[n].is_nan());
            if !own.is_nan() {
                let wanted = plain(&field, cutoff, n as u64 / 90, n as u64 % 90);
                assert!((found[n] - wanted).abs() < 1e-9, "{cutoff}: {}, not {wanted}", found[n]);
                assert!((long[n] - (own - wanted)).abs() < 1e-9);
            }
        }
        // A window is the same part of the whole, and is read in parts.
        let window = Window { row: 11, column: 17, rows: 40, columns: 30 };
        let part = Filtered::new(&field, Filter::Short(cutoff), window).unwrap();
        let inner = Window { row: 5, column: 3, rows: 9, columns: 8 };
        let wanted = read(&filtered, Window { row: 16, column: 20, ..inner });
        for (a, b) in read(&part, inner).iter().zip(&wanted) {
            assert!(a.is_nan() && b.is_nan() || (a - b).abs() < 1e-9, "{a}, not {b}");
        }
    }
}

#[test]
fn half_of_a_wave_of_the_cutoff_passes() {
    let field = of(512, 64, |_, column| 20.0 * (2.0 * PI * column / 64.0).sin());
    let window = Window { row: 0, column: 128, rows: 64, columns: 256 };
    for filter in [Filter::Short(64.0), Filter::Long(64.0)] {
        let filtered = Filtered::new(&field, filter, window).unwrap();
        let sq = roughness(&filtered).unwrap().iso.sq.unwrap();
        assert_near(sq, 20.0 / 8.0_f64.sqrt(), 1e-4, "Sq");
    }
    let waves = sines(256, 256, 16.0, 1.0);
    let window = Window { row: 64, column: 64, rows: 128, columns: 128 };
    let short = roughness(&Filtered::new(&waves, Filter::Short(16.0), window).unwrap()).unwrap().iso.sq.unwrap();
    assert_near(short, 0.125, 1e-4, "both axes");
    let none = roughness(&Filtered::new(&waves, Filter::Short(0.0), window).unwrap()).unwrap();
    assert_eq!(none, roughness(&Part::of_window(&waves, window).unwrap()).unwrap());
}

#[test]
fn of_degrees_the_cutoff_is_in_metres() {
    // Rows from 70 degrees north to the equator; a degree on a sphere of this radius is 1 metre.
    let radius = 180.0 / PI;
    let mut field = with_holes(of(60, 71, |row, column| (row * 0.3).sin() + (column * column * 0.01).cos()), 0.2, 2);
    (field.grid.origin, field.grid.step) = ([10.0, 70.0], [1.0, -1.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    let (lengths, cutoff, all) = (Lengths::on(&field.grid, radius), 6.0, Window::all(&field.grid));
    let found = read(&Filtered::on(&field, lengths, Filter::Short(cutoff), all).unwrap(), all);
    let alpha = (std::f64::consts::LN_2 / PI).sqrt();
    for n in (0..60 * 71).step_by(61).filter(|n| !field.stored[*n].is_nan()) {
        let (row, column) = (n / 60, n % 60);
        let mut sums = [0.0; 2];
        for other in 0..71 {
            let narrow = (70.0 - other as f64).to_radians().cos();
            for beside in 0..60 {
                let height = field.stored[other * 60 + beside];
                let apart = [narrow * column.abs_diff(beside) as f64, row.abs_diff(other) as f64];
                if !height.is_nan() && apart.iter().all(|apart| *apart <= cutoff) {
                    let square = apart[0].powi(2) + apart[1].powi(2);
                    let weight = narrow * (-PI * square / (alpha * cutoff).powi(2)).exp();
                    sums = [sums[0] + weight * height, sums[1] + weight];
                }
            }
        }
        // Rows whose widths differ by less than a hundredth are alike.
        assert!((found[n] - sums[0] / sums[1]).abs() < 5e-3, "{n}: {}, not {}", found[n], sums[0] / sums[1]);
    }
}

#[test]
fn a_field_that_goes_round_a_globe_has_no_seam() {
    // Plain sums, transforms, and cut-offs of more than a round; with the first column once more at the end, and without.
    for (columns, again, degrees) in [
        (72_u64, false, 12.0),
        (72, true, 12.0),
        (71, false, 90.0),
        (360, true, 80.0),
        (36, true, 500.0),
        (36, false, 4e4),
    ] {
        let width = columns + u64::from(again);
        let height = |row: u64, column: u64, turned: u64| {
            let turn = 2.0 * PI * ((column + turned) % columns) as f64 / columns as f64;
            100.0 + (3.0 * turn).cos() + 0.3 * (5.0 * turn + row as f64).sin()
        };
        let turned = |by: u64| {
            let values = (0..width * 25).map(|n| height(n / width, n % width, by)).collect();
            let mut field = HeightField::of(width, 25, values);
            field.grid.step = [360.0 / columns as f64, 3.0];
            field.grid.origin = [-180.0, -36.0];
            field.grid.xy_unit = Unit::new("deg");
            field.grid.height_unit = Unit::new("m");
            field
        };
        let cutoff = degrees / 180.0 * PI * crate::model::lengths::EARTH;
        let filtered = |by: u64| {
            let field = turned(by);
            let all = Window::all(&field.grid);
            read(&Filtered::new(&field, Filter::Short(cutoff), all).unwrap(), all)
        };
        let (whole, half) = (filtered(0), filtered(columns / 2));
        for n in 0..width * 25 {
            let (row, column) = (n / width, n % width);
            let wanted = whole[(row * width + (column + columns / 2) % columns) as usize];
            assert!((half[n as usize] - wanted).abs() < 1e-9, "{columns} {degrees}: {row} {column}");
        }
        // A wave of one row alone keeps its shape: the same share of it passes everywhere.
        let mut field = turned(0);
        field.stored = (0..width * 25).map(|n| (6.0 * PI * (n % width) as f64 / columns as f64).cos()).collect();
        let all = Window::all(&field.grid);
        let waves = read(&Filtered::new(&field, Filter::Short(cutoff), all).unwrap(), all);
        for (found, own) in waves.chunks(width as usize).zip(field.stored.chunks(width as usize)) {
            let share = found[0];
            assert!((0.0..1.0 + 1e-12).contains(&share.abs()) && share > -1e-4, "{share}");
            assert!(
                found.iter().zip(own).all(|(found, own)| (found - share * own).abs() < 1e-9),
                "{columns} {degrees}"
            );
        }
    }
}
