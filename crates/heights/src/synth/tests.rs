#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use deepfield_data::model::SampleType;
use proptest::prelude::*;

fn surface(options: &SurfaceOptions) -> SyntheticSurface {
    SyntheticSurface::new(options, Path::new("test.npy")).unwrap()
}

fn stored(surface: &SyntheticSurface, window: Window) -> Vec<f64> {
    let mut out = vec![0.0; window.samples() as usize];
    surface.stored(window, &mut out).unwrap();
    out
}

fn all(options: &SurfaceOptions) -> Vec<f64> {
    let surface = surface(options);
    stored(&surface, Window::all(surface.grid()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// Any window is a part of the whole, to the bit, for every shape.
    #[test]
    fn windows_are_parts_of_the_whole(
        shape in 0_usize..6, seed: u64, columns in 2_u64..700, rows in 2_u64..200, at in (0.0..1.0, 0.0..1.0, 0.0..1.0, 0.0..1.0),
    ) {
        let options = SurfaceOptions {
            seed, invalid: 0.1, noise: 0.5, sample_type: SampleType::F64, hurst: 0.5, ..SurfaceOptions::new(SurfaceShape::ALL[shape], columns, rows)
        };
        let surface = surface(&options);
        let whole = all(&options);
        let part = |count: u64, at: f64, size: f64| {
            let first = (count as f64 * at) as u64;
            (first, 1 + ((count - first - 1) as f64 * size) as u64)
        };
        let ((row, high), (column, wide)) = (part(rows, at.0, at.1), part(columns, at.2, at.3));
        let window = Window { row, column, rows: high, columns: wide };
        for (line, row) in stored(&surface, window).chunks(wide as usize).zip(row..) {
            let first = (row * columns + column) as usize;
            let same = line.iter().zip(&whole[first..]).all(|(a, b)| a.to_bits() == b.to_bits());
            prop_assert!(same, "row {row}");
        }
    }
}

/// Rough ground takes fewer bytes where heights may be off: nearly log2 of twice the error fewer bits a sample.
#[test]
fn rough_ground_is_smaller_within_a_bound() {
    use crate::build::{HeightBuildOptions, HeightOrigin, build_heights};
    use crate::model::HeightField;
    use crate::store::HeightFile;
    let folder = tempfile::tempdir().unwrap();
    for (sample_type, errors) in [(SampleType::F32, [0.05, 1.0]), (SampleType::I16, [1.0, 4.0])] {
        let options = SurfaceOptions { hurst: 0.2, sample_type, ..SurfaceOptions::new(SurfaceShape::Fbm, 600, 500) };
        let field = HeightField { grid: surface(&options).grid().clone(), stored: all(&options), planes: Vec::new() };
        let path = folder.path().join("field.df");
        let bytes = |height_error| {
            let options = HeightBuildOptions { height_error, ..HeightBuildOptions::default() };
            build_heights(&field, &HeightOrigin::default(), &options, &path, &()).unwrap();
            let file = HeightFile::open(&path, Default::default()).unwrap();
            let mut stored = vec![0.0; field.stored.len()];
            file.stored(Window::all(&field.grid), &mut stored).unwrap();
            let error = height_error.unwrap_or(0.0);
            assert!(stored.iter().zip(&field.stored).all(|(found, own)| (found - own).abs() <= error));
            file.bytes() as f64
        };
        let [lossless, fine, coarse] = [None, Some(errors[0]), Some(errors[1])].map(bytes);
        let bits = (2.0 * errors[1] / (2.0 * errors[0] + if sample_type.is_float() { 0.0 } else { 1.0 })).log2();
        assert!(fine < 0.95 * lossless && coarse < fine - 0.5 * bits / 8.0 * 300_000.0, "{lossless}, {fine}, {coarse}");
    }
}

#[test]
fn the_motion_has_its_hurst_exponent_in_all_directions() {
    for hurst in [0.2, 0.5, 0.8] {
        let n = 1024_usize;
        // The mean of some seeds: one has few features of its own size.
        let mut sums = [[0.0; 6]; 3];
        for seed in 0..4 {
            let options = SurfaceOptions {
                hurst,
                seed,
                sample_type: SampleType::F64,
                ..SurfaceOptions::new(SurfaceShape::Fbm, n as u64, n as u64)
            };
            let heights = all(&options);
            for (direction, [down, right]) in [[0, 1], [1, 0], [1, 1]].into_iter().enumerate() {
                for (power, sum) in sums[direction].iter_mut().enumerate() {
                    let [down, right] = [down << power, right << power];
                    for row in (0..n - down).step_by(3) {
                        let line = |row: usize| &heights[row * n..][..n];
                        let pairs = line(row).iter().zip(&line(row + down)[right..]);
                        *sum += pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / ((n - down) * (n - right)) as f64;
                    }
                }
            }
        }
        for sums in sums {
            let slope = |from: usize, to: usize| (sums[to] / sums[from]).log2() / (2 * (to - from)) as f64;
            assert!((slope(2, 4) - hurst).abs() < 0.05, "{} of {hurst}", slope(2, 4));
            for power in 0..5 {
                assert!(
                    (slope(power, power + 1) - hurst).abs() < 0.07,
                    "{} of {hurst} at lag {}",
                    slope(power, power + 1),
                    1 << power
                );
            }
        }
        // As steep across as along.
        assert!((sums[0][3] / sums[1][3] - 1.0).abs() < 0.2, "{sums:?}");
        let diagonal = sums[2][3] / sums[0][3] / 2_f64.powf(hurst);
        assert!((diagonal - 1.0).abs() < 0.2, "{diagonal}");
    }
}

#[test]
fn threads_do_not_change_a_bit_and_seeds_do() {
    let options = SurfaceOptions { invalid: 0.2, ..SurfaceOptions::new(SurfaceShape::Holes, 900, 500) };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| all(&options)).iter().map(|height| height.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(on(1), on(3));
    let other = all(&SurfaceOptions { seed: 1, ..options.clone() });
    assert_ne!(other.iter().map(|height| height.to_bits()).collect::<Vec<_>>(), on(1));
}

/// The same bytes on every machine: what a few samples were when this was written.
#[test]
fn samples_are_those_of_any_machine() {
    let options =
        SurfaceOptions { sample_type: SampleType::F64, seed: 7, ..SurfaceOptions::new(SurfaceShape::Fbm, 1000, 700) };
    let heights = all(&options);
    let found = [0, 1, 1000, 345_678, 699_999].map(|place: usize| heights[place].to_bits());
    assert_eq!(found, KNOWN, "{found:x?}");
}

const KNOWN: [u64; 5] =
    [0xc031_c38b_aa68_3172, 0xc031_88e1_729a_59d9, 0xc032_0474_e783_faff, 0xc029_8781_0d4b_cf31, 0x4012_fc77_6a43_97a9];

#[test]
fn shapes_have_their_formulas() {
    let at = |shape: SurfaceShape, columns: u64, rows: u64| {
        all(&SurfaceOptions { sample_type: SampleType::F64, ..SurfaceOptions::new(shape, columns, rows) })
    };
    let step = at(SurfaceShape::Step, 7, 3);
    assert_eq!(step[..7], [0.0, 0.0, 0.0, 0.0, 1000.0, 1000.0, 1000.0]);
    let plane = at(SurfaceShape::Plane, 5, 4);
    assert!((plane[3 * 5 + 4] - (0.1 * 4.0 + 0.2 * 3.0)).abs() < 1e-15);
    let sines = at(SurfaceShape::Sines, 700, 300);
    assert_eq!(sines[64 * 700 + 64], 20.0);
    assert_eq!(sines[(64 + 128) * 700 + 64 + 512], -20.0);
    let cap = at(SurfaceShape::SphereCap, 301, 201);
    let [top, rim] = [cap[100 * 301 + 150], cap[0]];
    assert!((top - 0.4 * 90.0).abs() < 1e-9 && rim == 0.0, "{top}");
}

#[test]
fn whole_numbers_fit_their_type_and_mark_holes_by_the_least() {
    let folder = tempfile::tempdir().unwrap();
    for sample_type in SampleType::ALL {
        for shape in SurfaceShape::ALL {
            let options = SurfaceOptions { sample_type, invalid: 0.1, seed: 5, ..SurfaceOptions::new(shape, 300, 200) };
            let path = folder.path().join("field.npy");
            write_surface(&options, &path, &()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(bytes.len(), 128 + 60_000 * sample_type.size());
            let mut values = Vec::new();
            sample_type.decode(&bytes[128..], 1, &mut values);
            let least = surface(&options).least();
            let is_hole = |value: &f64| if sample_type.is_float() { value.is_nan() } else { *value == least };
            let share = values.iter().filter(|value| is_hole(value)).count() as f64 / 60_000.0;
            let bar = if shape == SurfaceShape::Holes { 0.12..0.5 } else { 0.09..0.11 };
            assert!(bar.contains(&share), "{shape} {sample_type}: {share}");
            // None of the others is clipped.
            let valid = || values.iter().filter(|value| !is_hole(value)).copied();
            let (low, high) = (valid().fold(f64::INFINITY, f64::min), valid().fold(f64::NEG_INFINITY, f64::max));
            assert!(high - low >= 10.0, "{shape} {sample_type}: {low} to {high}");
            if matches!(shape, SurfaceShape::Fbm | SurfaceShape::Holes) && !sample_type.is_float() {
                let top = valid().filter(|value| *value == high).count();
                assert!(sample_type.size() == 1 || top < 3, "{shape} {sample_type}: {top} at {high}");
            }
        }
    }
}

#[test]
fn options_that_cannot_be_are_refused_in_one_line() {
    let good = SurfaceOptions::new(SurfaceShape::Plane, 10, 10);
    for (options, field) in [
        (SurfaceOptions { columns: 1, ..good.clone() }, "size"),
        (SurfaceOptions { columns: 1 << 39, rows: 1 << 39, ..good.clone() }, "size"),
        (SurfaceOptions { invalid: 1.0, ..good.clone() }, "invalid"),
        (SurfaceOptions { invalid: f64::NAN, ..good.clone() }, "invalid"),
        (SurfaceOptions { noise: -1.0, ..good.clone() }, "noise"),
        (SurfaceOptions { hurst: 1.0, ..good.clone() }, "hurst"),
        (SurfaceOptions { spacing: [0.0, 1.0], ..good.clone() }, "spacing"),
    ] {
        let error = write_surface(&options, Path::new("/nowhere/a.npy"), &()).unwrap_err().to_string();
        assert!(error.contains(&format!("a.npy: {field}: found")) && !error.contains('\n'), "{error}");
    }
    let error = write_surface(&good, Path::new("a.xyz"), &()).unwrap_err().to_string();
    assert!(error.contains(".npy") && error.contains(".x3p"), "{error}");
    assert!("cube".parse::<SurfaceShape>().unwrap_err().contains("sphere-cap"));
}
