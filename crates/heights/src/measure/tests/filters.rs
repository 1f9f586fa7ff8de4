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
