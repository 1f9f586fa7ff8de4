//! Files of images and volumes: every sample comes back, and so does the hierarchy; nothing that is broken goes unnoticed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::grid::{GridBuildOptions, build_grid};
use deepfield_data::hierarchy::wavelet::{Hierarchy, Metric, Options, Samples, Types, errors};
use deepfield_data::import::{GridOptions, open_grid};
use deepfield_data::model::{ReadMethod, Region};
use deepfield_data::store::GridFile;
use deepfield_data::store::grid::verify_grid;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A NumPy array of this type and shape (slowest axis first) with these bytes.
fn npy(folder: &Path, kind: &str, shape: &[usize], bytes: &[u8]) -> PathBuf {
    let shape: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    text += &" ".repeat((64 - (11 + text.len()) % 64) % 64);
    text.push('\n');
    let head = [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes()].concat();
    let path = folder.join("grid.npy");
    std::fs::write(&path, [&head[..], bytes].concat()).unwrap();
    path
}

fn build(source: &Path, output: &Path, threads: usize) {
    build_as(source, output, &GridBuildOptions { threads: Some(threads), ..GridBuildOptions::default() });
}

fn build_as(source: &Path, output: &Path, options: &GridBuildOptions) {
    let source = open_grid(source, &GridOptions::default()).unwrap();
    build_grid(&source, options, output, &()).unwrap();
}

/// Something smooth with an edge and a little noise.
fn samples(count: usize, seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    (0..count)
        .map(|i| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let edge = if i % 37 > 20 { 90 } else { 0 };
            (edge + (i / 50) % 60 + (state >> 60) as usize) as u8
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn grids_come_back_bit_for_bit(
        kind in prop::sample::select(vec![("|u1", 1), ("|i1", 1), ("<u2", 2), (">i2", 2), ("<i4", 4), ("<f4", 4), ("<f8", 8), ("<u8", 8)]),
        shape in prop::array::uniform3(1usize..90), volume in any::<bool>(), seed in any::<u64>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let shape = if volume { vec![shape[0] / 4 + 1, shape[1], shape[2]] } else { vec![shape[0] * 7, shape[1] * 7] };
        let count: usize = shape.iter().product();
        let bytes = samples(count * kind.1, seed);
        let source = npy(folder.path(), kind.0, &shape, &bytes);
        let [one, two] = ["one.df", "two.df"].map(|name| folder.path().join(name));
        build(&source, &one, 1);
        build(&source, &two, 2);
        prop_assert_eq!(std::fs::read(&one).unwrap(), std::fs::read(&two).unwrap(), "the same for any number of threads");
        verify_grid(&one, &()).unwrap();
        let (file, opened) = (GridFile::open(&one, ReadMethod::default()).unwrap(), open_grid(&source, &GridOptions::default()).unwrap());
        prop_assert_eq!(&file.about().grid, opened.grid());
        let whole = opened.grid().region();
        let part = Region { min: whole.max.map(|side| side / 3), max: whole.max.map(|side| side / 3 + side.div_ceil(2).min(side - side / 3)) };
        for region in [whole, part] {
            let len = region.shape().iter().product::<u64>() as usize * kind.1;
            let (mut own, mut theirs) = (vec![0; len], vec![0; len]);
            file.read(&region, &mut own).unwrap();
            opened.read(&region, &mut theirs).unwrap();
            prop_assert!(own == theirs);
        }
        let beyond = Region { max: whole.max.map(|side| side + 1), ..whole };
        prop_assert!(file.read(&beyond, &mut []).is_err());
    }
}

/// What a file holds of a hierarchy draws the samples as well as the hierarchy itself does, and few points draw them worse than many.
#[test]
fn few_points_are_near_and_more_are_nearer() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (192, 160);
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let disc = if (x - 90.0).hypot(y - 70.0) < 50.0 { 120.0 } else { 20.0 };
        (disc + 30.0 * (x / 23.0).sin() + 0.2 * y) as u8
    };
    let bytes: Vec<u8> = (0..width * height).map(value).collect();
    let source = npy(folder.path(), "|u1", &[height, width], &bytes);
    let output = folder.path().join("grid.df");
    build(&source, &output, 2);
    let file = GridFile::open(&output, ReadMethod::default()).unwrap();
    let planes = file.planes().unwrap();
    let hierarchy = file.hierarchy(&planes).unwrap();
    let samples = Samples { dimensions: 2, shape: [width, height, 1], channels: vec![&planes[0]] };
    let mut before = f32::INFINITY;
    for share in [0.01, 0.02, 0.05, 0.1, 0.2, 0.4] {
        let most = (share * (width * height) as f64) as usize;
        let cut = hierarchy.cut_of_points(most);
        assert!(cut.points <= most && cut.points * 10 > most * 9, "{} of {most} points", cut.points);
        let off = errors(&samples, &hierarchy.reconstruct(&samples, &cut));
        assert!(off.rms < before, "{share}: {} after {before}", off.rms);
        before = off.rms;
    }
    assert!(before < 1.0, "{before}");
    for most in [20.0, 5.0, 1.0, 0.0] {
        let (cut, drawn) = hierarchy.cut_within(&samples, most);
        assert!(errors(&samples, &drawn).max <= most && cut.points <= width * height);
    }
}

#[test]
fn every_flipped_bit_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let source = npy(folder.path(), "<u2", &[7, 20, 30], &samples(2 * 7 * 20 * 30, 5));
    let output = folder.path().join("grid.df");
    build(&source, &output, 1);
    let whole = std::fs::read(&output).unwrap();
    for at in (0..whole.len()).step_by(11) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        std::fs::write(&output, &bytes).unwrap();
        assert!(verify_grid(&output, &()).is_err(), "byte {at}");
    }
    for len in (0..whole.len()).step_by(whole.len() / 64) {
        std::fs::write(&output, &whole[..len]).unwrap();
        assert!(verify_grid(&output, &()).is_err(), "{len} bytes");
    }
}

/// Points by measured errors and by coefficients, in several bricks, with what is known of nodes in memory and in a file: the same bytes.
#[test]
fn memory_and_threads_change_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (1800, 1700);
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let ring = if (x - 800.0).hypot(y - 700.0) % 160.0 < 70.0 { 90.0 } else { 20.0 };
        (ring + 50.0 + 40.0 * (x * 0.05 + y * 0.021).sin()) as u8
    };
    let bytes: Vec<u8> = (0..width * height).map(value).collect();
    let source = npy(folder.path(), "|u1", &[height, width], &bytes);
    for (types, metric) in [(Types::Measured, Metric::Residual), (Types::Gabor, Metric::Gabor)] {
        let points = Options { types, metric, colours: false };
        let of = |name: &str, threads: usize, memory: Option<u64>| {
            let output = folder.path().join(name);
            let options = GridBuildOptions { points, threads: Some(threads), memory, temporary: None };
            build_as(&source, &output, &options);
            std::fs::read(output).unwrap()
        };
        // In the smaller memory one brick at a time, and what is known of nodes in a file.
        assert!(of("all.df", 3, None) == of("little.df", 1, Some(17 << 20)));
        verify_grid(&folder.path().join("little.df"), &()).unwrap();
    }
    // Too little for a single brick: nothing is begun.
    let source = open_grid(&source, &GridOptions::default()).unwrap();
    let options = GridBuildOptions { memory: Some(4 << 20), ..GridBuildOptions::default() };
    let output = folder.path().join("none.df");
    let error = build_grid(&source, &options, &output, &()).unwrap_err().to_string();
    assert!(error.contains("none.df: a brick of 1800 x 1700 of uint8 takes about") && !output.exists(), "{error}");
}

/// Samples that are no numbers stay what they are, and points are fitted around them.
#[test]
fn holes_come_back_and_points_go_around_them() {
    let folder = tempfile::tempdir().unwrap();
    let shape = [40, 90, 70];
    let value = |i: usize| {
        let (x, y, z) = ((i % 70) as f32, (i / 70 % 90) as f32, (i / 6300) as f32);
        let is_hole = (x - 30.0).hypot(y - 60.0) < 12.0 || i % 97 == 5 || x > 64.0 && y > 64.0;
        if is_hole { f32::NAN } else { 0.3 * x + (0.1 * y).sin() * 20.0 + z }
    };
    let values: Vec<f32> = (0..shape.iter().product()).map(value).collect();
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let source = npy(folder.path(), "<f4", &shape, &bytes);
    let [one, two] = ["one.df", "two.df"].map(|name| folder.path().join(name));
    build(&source, &one, 1);
    build(&source, &two, 3);
    assert!(std::fs::read(&one).unwrap() == std::fs::read(&two).unwrap());
    let file = GridFile::open(&one, ReadMethod::default()).unwrap();
    let planes = file.planes().unwrap();
    assert!(planes[0].iter().zip(&values).all(|(a, b)| a == b || a.is_nan() && b.is_nan()));
    let hierarchy = file.hierarchy(&planes).unwrap();
    let samples = Samples { dimensions: 3, shape: [70, 90, 40], channels: vec![&planes[0]] };
    let numbers = values.iter().filter(|v| v.is_finite()).count();
    assert_eq!(hierarchy.levels[0].samples.iter().map(|n| *n as usize).sum::<usize>(), numbers);
    assert_eq!(hierarchy.levels.last().unwrap().samples[0] as usize, numbers);
    let cut = hierarchy.cut_of_points(numbers / 20);
    let shown = hierarchy.reconstruct(&samples, &cut);
    assert!(shown[0].iter().zip(&values).all(|(a, b)| a.is_finite() == b.is_finite()));
    let off = errors(&samples, &shown);
    assert!(off.rms < 2.0, "{}", off.rms);
}

/// Whatever chooses points and says what an error is: the file is whole, more points are nearer, and bounds hold.
#[test]
fn published_points_keep_the_promises_of_measured_ones() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (300, 220);
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let stripes =
            if x < 150.0 { 40.0 * (0.75 * std::f64::consts::PI * 0.5 * (x + y) * 0.5_f64.sqrt()).cos() } else { 0.0 };
        let edge = if y > 0.3 * x + 60.0 { 120.0 } else { 60.0 };
        (edge + stripes) as u8
    };
    let bytes: Vec<u8> = (0..width * height).map(value).collect();
    let source = npy(folder.path(), "|u1", &[height, width], &bytes);
    for (types, metric) in [
        (Types::Gabor, Metric::Residual),
        (Types::Gabor, Metric::Gabor),
        (Types::Measured, Metric::Gabor),
        (Types::Round, Metric::Gabor),
        (Types::Measured, Metric::Rms),
    ] {
        let output = folder.path().join("grid.df");
        let points = Options { types, metric, colours: false };
        build_as(&source, &output, &GridBuildOptions { points, ..GridBuildOptions::default() });
        verify_grid(&output, &()).unwrap();
        let file = GridFile::open(&output, ReadMethod::default()).unwrap();
        assert_eq!(file.about().options, points);
        let planes = file.planes().unwrap();
        let hierarchy = file.hierarchy(&planes).unwrap();
        let samples = Samples { dimensions: 2, shape: [width, height, 1], channels: vec![&planes[0]] };
        let mut before = f32::INFINITY;
        for share in [0.02, 0.08, 0.32, 0.7] {
            let most = (share * (width * height) as f64) as usize;
            let cut = hierarchy.cut_of_points(most);
            let off = errors(&samples, &hierarchy.reconstruct(&samples, &cut));
            assert!(cut.points <= most && off.rms < before, "{types:?} {metric:?} {share}: {} {}", cut.points, off.rms);
            before = off.rms;
        }
        for most in [20.0, 2.0, 0.0] {
            let (cut, drawn) = hierarchy.cut_within(&samples, most);
            assert!(errors(&samples, &drawn).max <= most && cut.points <= width * height);
        }
        let directed: u64 = file.about().levels.iter().flat_map(|level| &level.types.directed).sum();
        assert_eq!(directed > 0, types != Types::Round);
        // In memory the same hierarchy.
        let built = Hierarchy::build(&samples, &points);
        for (own, read) in built.levels.iter().zip(&hierarchy.levels) {
            assert!(own.set == read.set && own.soft == read.soft && own.laid == read.laid);
        }
    }
}
