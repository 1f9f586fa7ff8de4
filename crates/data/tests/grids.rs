//! Files of images and volumes: every sample comes back, and so does the hierarchy; nothing that is broken goes unnoticed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::grid::{GridBuildOptions, build_grid};
use deepfield_data::hierarchy::wavelet::{
    Drawn, Hierarchy, LevelKinds, Metric, Options, Samples, Types, Weighting, errors,
};
use deepfield_data::import::{GridOptions, open_grid};
use deepfield_data::model::{ReadMethod, Region};
use deepfield_data::store::GridFile;
use deepfield_data::store::grid::verify_grid;
use deepfield_data::synth::grids::{Kind, SyntheticGrid};
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
    #![proptest_config(ProptestConfig::with_cases(12))]

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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// A level shows the samples hardly worse than the one above it, but for what is good enough in one point; the last are the samples.
    #[test]
    fn finer_levels_are_nearer(
        dimensions in 2usize..4, side in 20usize..48, turn in 0.0f32..3.0, radius in 4.0f32..14.0,
    ) {
        let value = |i: usize| {
            let at = [i % side, i / side % side, i / (side * side)].map(|x| x as f32 - 0.4 * side as f32);
            let ball = if at.iter().map(|x| x * x).sum::<f32>() < radius * radius { 150.0 } else { 40.0 };
            ball + 30.0 * (0.3 * (at[0] * turn.cos() + at[1] * turn.sin()) + 0.2 * at[2]).sin()
        };
        let values: Vec<f32> = (0..side.pow(dimensions as u32)).map(value).collect();
        let (samples, hierarchy) = hierarchy_of(dimensions, side, &values, Types::Measured);
        let [least, most] = [f32::min, f32::max].map(|of| values.iter().copied().reduce(of).unwrap());
        let mut before = f32::INFINITY;
        for level in (0..=hierarchy.levels.len()).rev() {
            let cut = hierarchy.cut_of_level(level);
            prop_assert!(level == 0 || cut.leaves == 0 && cut.points > 0, "level {}: {} samples", level, cut.leaves);
            let below = cut.drawn.iter().take(level.saturating_sub(1));
            prop_assert!(below.flatten().all(|how| *how == Drawn::Not), "nothing finer than level {}", level);
            let off = errors(&samples, &hierarchy.reconstruct(&samples, &cut));
            let good_enough = (most - least) / 512.0;
            // A few large nodes may happen to fit better than their children do.
            prop_assert!(off.rms <= 1.25 * before + good_enough, "level {}: {} after {}", level, off.rms, before);
            before = off.rms;
        }
        prop_assert_eq!(before, 0.0);
    }
}

/// What a number of points is chosen for is what becomes small.
#[test]
fn points_are_chosen_for_what_is_asked() {
    let side = 128;
    let value = |i: usize| {
        let (x, y) = ((i % side) as f32, (i / side) as f32);
        let ring = if ((x - 60.0).hypot(y - 50.0) % 40.0) < 17.0 { 90.0 } else { 20.0 };
        ring + 8.0 * (0.9 * x + 1.3 * y).sin() + if i.is_multiple_of(1999) { 120.0 } else { 0.0 }
    };
    let values: Vec<f32> = (0..side * side).map(value).collect();
    let (samples, hierarchy) = hierarchy_of(2, side, &values, Types::Measured);
    let curve = hierarchy.curve();
    for most in [200, 1000, 4000] {
        let [rms, max, same, coarse] =
            [Weighting::Rms, Weighting::Max, Weighting::Levels(vec![1.0]), Weighting::Levels(vec![0.0, 0.3])].map(
                |weighting| {
                    let cut = hierarchy.cut_weighted(&curve, most, &weighting);
                    assert!(
                        cut.points <= most && (cut.points * 2 > most || cut.leaves == 0),
                        "{} of {most}",
                        cut.points
                    );
                    (cut.leaves, errors(&samples, &hierarchy.reconstruct(&samples, &cut)))
                },
            );
        assert!(
            rms.1.rms <= 1.001 * max.1.rms && rms.1.rms <= 1.001 * coarse.1.rms,
            "{most}: {rms:?} {max:?} {coarse:?}"
        );
        assert!(max.1.max <= rms.1.max, "{most}: {max:?} {rms:?}");
        assert!((same.1.rms / rms.1.rms - 1.0).abs() < 0.05, "{most}: {same:?} {rms:?}");
        assert_eq!(coarse.0, 0, "{most}: no sample counts");
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
    let image = |width: usize, height: usize| {
        let value = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            let ring = if (x - 800.0).hypot(y - 700.0) % 160.0 < 70.0 { 90.0 } else { 20.0 };
            (ring + 50.0 + 40.0 * (x * 0.05 + y * 0.021).sin()) as u8
        };
        let bytes: Vec<u8> = (0..width * height).map(value).collect();
        npy(folder.path(), "|u1", &[height, width], &bytes)
    };
    // So large that what is known of nodes does not fit in the smaller memory: of coefficients that is four times as much.
    let (measured, gabor) = ((1600, 1500), (780, 740));
    for (types, metric, (width, height)) in
        [(Types::Gabor, Metric::Gabor, gabor), (Types::Measured, Metric::Residual, measured)]
    {
        let source = image(width, height);
        let points = Options { types, metric, ..Options::default() };
        let of = |name: &str, threads: usize, memory: Option<u64>| {
            let output = folder.path().join(name);
            let options = GridBuildOptions { points, threads: Some(threads), memory, temporary: None };
            build_as(&source, &output, &options);
            std::fs::read(output).unwrap()
        };
        // In the smaller memory one brick at a time, and what is known of nodes in a file.
        assert!(of("all.df", 3, None) == of("little.df", 1, Some(15 << 20)));
        verify_grid(&folder.path().join("little.df"), &()).unwrap();
    }
    // Too little for a single brick: nothing is begun.
    let source = open_grid(&folder.path().join("grid.npy"), &GridOptions::default()).unwrap();
    let options = GridBuildOptions { memory: Some(4 << 20), ..GridBuildOptions::default() };
    let output = folder.path().join("none.df");
    let error = build_grid(&source, &options, &output, &()).unwrap_err().to_string();
    assert!(error.contains("none.df: a brick of 1600 x 1500 of uint8 takes about") && !output.exists(), "{error}");
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

/// No points stand for what counts as air, and its samples stay what they are.
#[test]
fn air_takes_no_points() {
    let folder = tempfile::tempdir().unwrap();
    let side = 48;
    let value = |i: usize| {
        let at = [i % side, i / side % side, i / (side * side)].map(|x| x as f64 - 23.0);
        let is_inside = at.iter().map(|x| x * x).sum::<f64>() < 196.0;
        // Air with noise around a ball that is smooth.
        let noise = (i as u64).wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407) >> 40;
        if is_inside { (120.0 + at[0] + 0.5 * at[1]) as u8 } else { (noise % 5) as u8 }
    };
    let bytes: Vec<u8> = (0..side * side * side).map(value).collect();
    let source = npy(folder.path(), "|u1", &[side, side, side], &bytes);
    let built = |name: &str, ignore_below: Option<f32>, threads: usize| {
        let output = folder.path().join(name);
        let points = Options { ignore_below, ..Options::default() };
        build_as(&source, &output, &GridBuildOptions { points, threads: Some(threads), ..GridBuildOptions::default() });
        verify_grid(&output, &()).unwrap();
        let written = std::fs::read(&output).unwrap();
        (GridFile::open(&output, ReadMethod::default()).unwrap(), written)
    };
    let (file, written) = built("air.df", Some(5.0), 1);
    assert!(written == built("again.df", Some(5.0), 3).1, "the same for any number of threads");
    assert_eq!(file.about().options.ignore_below, Some(5.0));
    assert!(file.about().notes.iter().any(|note| note.contains("below 5 count as air")), "{:?}", file.about().notes);
    let planes = file.planes().unwrap();
    assert!(planes[0].iter().zip(&bytes).all(|(a, b)| *a == f32::from(*b)), "every sample is there");
    let hierarchy = file.hierarchy(&planes).unwrap();
    let samples = Samples { dimensions: 3, shape: [side; 3], channels: vec![&planes[0]] };
    let matter = bytes.iter().filter(|value| **value >= 5).count();
    assert_eq!(hierarchy.levels.last().unwrap().samples[0] as usize, matter);
    assert!(hierarchy.ranges[0].0 >= 90.0, "{:?}", hierarchy.ranges);
    let options = Options { ignore_below: Some(5.0), ..Options::default() };
    let in_memory = Hierarchy::build(&samples, &options);
    assert_eq!(in_memory.levels.last().unwrap().samples[0] as usize, matter);
    // Without air fewer points are as near.
    let (cut, shown) = hierarchy.cut_within(&samples, 1.0);
    assert!(errors(&samples, &shown).max <= 1.0 && cut.points <= matter);
    let is_air = |(value, _): &(&u8, &f32)| **value < 5;
    assert!(bytes.iter().zip(&shown[0]).filter(is_air).all(|(value, shown)| *shown == f32::from(*value)));
    let (all, with_air) = built("all.df", None, 2);
    assert_eq!(all.about().options.ignore_below, None);
    let noisy = all.hierarchy(&planes).unwrap().cut_within(&samples, 1.0).0;
    assert!(cut.points * 4 < noisy.points, "{} of {} points", cut.points, noisy.points);
    // Where nothing is below, the file is the one without.
    assert!(built("none.df", Some(0.0), 2).1 == with_air);
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
        let points = Options { types, metric, ..Options::default() };
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

/// A synthetic image or volume of one side.
fn synthetic(kind: Kind, dimensions: usize, side: u64) -> Vec<f32> {
    let grid = SyntheticGrid::new(kind, dimensions, [side, side, if dimensions == 3 { side } else { 1 }], 1);
    let mut bytes = Vec::new();
    (0..side.pow(dimensions as u32 - 1)).for_each(|row| grid.row(row, &mut bytes));
    bytes.chunks_exact(4).map(|v| f32::from_le_bytes(v.try_into().unwrap())).collect()
}

fn hierarchy_of(dimensions: usize, side: usize, values: &[f32], types: Types) -> (Samples<'_>, Hierarchy) {
    let shape = [side, side, if dimensions == 3 { side } else { 1 }];
    let samples = Samples { dimensions, shape, channels: vec![values] };
    let options = Options { types, ..Options::default() };
    let hierarchy = Hierarchy::build(&samples, &options);
    (samples, hierarchy)
}

/// Of a level's nodes the least share, over these directions, that is directed along a wave whose frequency is in the middle of its octave.
fn directed_along_waves(
    dimensions: usize,
    side: usize,
    level: u32,
    angle: f64,
    directions: impl Iterator<Item = usize>,
) -> f64 {
    let share = |direction: usize| {
        let values = synthetic(Kind::Wave { level, direction, angle }, dimensions, side as u64);
        let (_, hierarchy) = hierarchy_of(dimensions, side, &values, Types::Measured);
        let LevelKinds { nodes, directed, .. } = &hierarchy.kinds()[level as usize - 1];
        directed[direction] as f64 / *nodes as f64
    };
    directions.map(share).fold(1.0, f64::min)
}

#[test]
fn truth_of_waves_in_images() {
    // Turned either way: no direction is before its mirror image. Any angle and level, angle and direction, and level and direction meet.
    for (turn, angle) in [0.0, 10.0, -10.0].into_iter().enumerate() {
        for level in 1_u32..=3 {
            let directions = (0_usize..4).filter(|direction| (turn + level as usize + direction).is_multiple_of(3));
            let share = directed_along_waves(2, 128, level, angle, directions);
            assert!(share >= 0.95, "level {level}, {angle} degrees off: {share}");
        }
    }
}

#[test]
fn truth_of_waves_in_volumes() {
    // Every other of the 13 directions, and the others.
    for (level, first) in [(1, 0), (2, 1)] {
        let share = directed_along_waves(3, 48, level, 0.0, (first..13).step_by(2));
        assert!(share >= 0.95, "level {level}: {share}");
    }
}

/// Nodes on an edge are directed along it, and sets of points spare what round ones need.
#[test]
fn truth_of_edges() {
    // The direction that values change along, and the other neighbour of one between two.
    for (angle, across) in [
        (0.0, [2, 2]),
        (45.0, [3, 3]),
        (90.0, [0, 0]),
        (135.0, [1, 1]),
        (22.5, [2, 3]),
        (67.5, [3, 0]),
        (112.5, [0, 1]),
        (157.5, [1, 2]),
    ] {
        let values = synthetic(Kind::Edge { angle }, 2, 256);
        let (samples, hierarchy) = hierarchy_of(2, 256, &values, Types::Measured);
        for (level, kinds) in hierarchy.kinds().iter().enumerate().take(2) {
            let all: usize = kinds.directed.iter().sum();
            let along = (0..4).filter(|n| across.contains(n)).map(|n| kinds.directed[n]).sum::<usize>();
            assert!(all > 50 && along as f64 >= 0.9 * all as f64, "{angle} degrees, {level}: {:?}", kinds.directed);
        }
        let points = hierarchy.cut_within(&samples, 4.0).0.points;
        let (samples, round) = hierarchy_of(2, 256, &values, Types::Round);
        let round = round.cut_within(&samples, 4.0).0.points;
        assert!(points as f64 <= 0.6 * round as f64, "{angle} degrees: {points} points, round {round}");
    }
}

#[test]
fn truth_of_what_has_no_direction() {
    let values = synthetic(Kind::Blob, 2, 256);
    let (samples, hierarchy) = hierarchy_of(2, 256, &values, Types::Measured);
    let cut = hierarchy.cut_of_points(values.len() / 50);
    let off = errors(&samples, &hierarchy.reconstruct(&samples, &cut));
    assert!(off.rms <= 200.0 * 10.0_f32.powf(-50.0 / 20.0), "a blob: {}", off.rms);

    let (samples, hierarchy) = hierarchy_of(2, 90, &[7.25; 90 * 90], Types::Measured);
    let (cut, grid) = hierarchy.cut_within(&samples, 0.0);
    assert!(cut.points == 1 && grid[0].iter().all(|v| *v == 7.25), "a constant: {} points", cut.points);

    let noise: Vec<f32> = samples_of_noise(128 * 128);
    let (samples, hierarchy) = hierarchy_of(2, 128, &noise, Types::Measured);
    let cut = hierarchy.cut_within(&samples, 0.5).0;
    assert_eq!((cut.points, cut.leaves), (noise.len(), noise.len()));
}

/// Bytes without any pattern.
fn samples_of_noise(count: usize) -> Vec<f32> {
    let mut state = 9_u64;
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as f32
    };
    (0..count).map(next).collect()
}
