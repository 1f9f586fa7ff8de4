//! Particles in velocity fields: paths against closed ones and against finer integrations of the same field, ends and beginnings where
//! they should be, the same for any number of threads, and damaged files as errors of one line.

#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use deepfield_data::build::{BuildOptions, RunBuild, TrackOptions};
use deepfield_data::import::grid::head::nrrd_head;
use deepfield_data::import::vector_field::{FieldOptions, Seeds, TraceOptions, VectorField, trace};
use deepfield_data::import::{FieldKind, LoadOptions, Run, RunStep, Source};
use deepfield_data::model::{Bounds, Channel, Grid, Moment, ReadMethod, SampleType};
use deepfield_data::store::RunFile;
use deepfield_data::store::run::verify_run;
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An array as NumPy writes it.
fn npy(shape: &[usize], values: &[f64], is_double: bool) -> Vec<u8> {
    let kind = if is_double { "<f8" } else { "<f4" };
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    text += &" ".repeat((10 + text.len() + 1).next_multiple_of(64) - 11 - text.len());
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(((text.len() + 1) as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.push(b'\n');
    for value in values {
        match is_double {
            true => bytes.extend(value.to_le_bytes()),
            false => bytes.extend((*value as f32).to_le_bytes()),
        }
    }
    bytes
}

fn npz(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, array) in arrays {
        archive.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(array).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The nodes of a box that both ends belong to, or a period without its end: (z, y, x).
fn nodes(shape: [usize; 3], from: [f64; 3], to: [f64; 3], is_periodic: bool) -> Vec<[f64; 3]> {
    let along = |axis: usize, node: usize| {
        let cells = if is_periodic { shape[axis] } else { shape[axis].max(2) - 1 };
        from[axis] + (to[axis] - from[axis]) * node as f64 / cells as f64
    };
    let mut all = Vec::new();
    for z in 0..shape[2] {
        for y in 0..shape[1] {
            all.extend((0..shape[0]).map(|x| [along(0, x), along(1, y), along(2, z)]));
        }
    }
    all
}

fn bounds(from: [f64; 3], to: [f64; 3]) -> Option<Bounds> {
    Some(Bounds { min: from.into(), max: to.into() })
}

fn traced(path: &Path, options: &TraceOptions) -> Result<Run, String> {
    trace(&[path.to_owned()], options, ReadMethod::default(), &()).map_err(|error| error.to_string())
}

/// Places by id.
fn places(step: &RunStep) -> BTreeMap<u64, [f64; 3]> {
    let source = step.open(ReadMethod::default()).unwrap();
    let info = &source.description().families[0];
    let column = |kind: FieldKind| {
        let field = info.find(kind).unwrap();
        let mut values = vec![0.0; info.count as usize * info.fields[field].components];
        source.read(0, field, 0..info.count, &mut values).unwrap();
        values
    };
    let mut ids = vec![0; info.count as usize];
    source.read_ids(0, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut ids).unwrap();
    ids.into_iter().zip(column(FieldKind::Position).as_chunks::<3>().0.iter().copied()).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (DVec3::from(a) - DVec3::from(b)).length()
}

/// A step of the classic method of order 4.
fn rk4(rate: &dyn Fn(DVec3, f64) -> DVec3, at: DVec3, now: f64, h: f64) -> DVec3 {
    let a = rate(at, now);
    let b = rate(at + 0.5 * h * a, now + 0.5 * h);
    let c = rate(at + 0.5 * h * b, now + 0.5 * h);
    let d = rate(at + h * c, now + h);
    at + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
}

/// Where a particle is at the end of so many small steps between times, none of which is over a time of the field; `None` where it left.
fn fine(field: &VectorField, from: [f64; 3], [start, end]: [f64; 2], steps: usize) -> Option<DVec3> {
    let (mut at, mut now) = (DVec3::from(from), start);
    while now < end {
        let interval = field.interval(now).unwrap();
        let until = interval.times()[1].min(end);
        let h = (until - now) / steps as f64;
        let is_out = std::cell::Cell::new(false);
        let rate = |place: DVec3, time: f64| match interval.velocity(place.to_array(), time) {
            Some(velocity) => velocity.into(),
            None => {
                is_out.set(true);
                DVec3::ZERO
            }
        };
        for step in 0..steps {
            at = rk4(&rate, at, now + h * step as f64, h);
        }
        if is_out.get() {
            return None;
        }
        now = until;
    }
    Some(at)
}

/// A flat field that turns around the origin once in a time of 2 pi.
fn turning(folder: &Path) -> (PathBuf, FieldOptions) {
    let (from, to) = ([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]);
    let values: Vec<f64> = nodes([33, 17, 1], from, to, false).iter().flat_map(|[x, y, _]| [-y, *x]).collect();
    let path = written(folder, "turn.npy", &npy(&[17, 33, 2], &values, true));
    (path, FieldOptions { bounds: bounds(from, to), ..FieldOptions::default() })
}

#[test]
fn a_turn_ends_where_it_began() {
    let folder = tempfile::tempdir().unwrap();
    let (path, field) = turning(folder.path());
    let seeds: Vec<[f64; 3]> =
        (0..40).map(|k| f64::from(k) / 41.0).map(|r| [r * (9.0 * r).cos(), r * (9.0 * r).sin(), 0.0]).collect();
    let options = TraceOptions {
        field: field.clone(),
        seeds: Seeds::At(seeds.clone()),
        duration: Some(TAU),
        steps: 5,
        ..TraceOptions::default()
    };
    let run = traced(&path, &options).unwrap();
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 0.5 * PI, PI, 1.5 * PI, TAU]);
    let [quarter, whole] = [1, 4].map(|step| places(&run.steps[step]));
    for (id, seed) in seeds.iter().enumerate() {
        // Velocities are in single precision.
        assert!(distance(whole[&(id as u64)], *seed) < 1e-6, "{seed:?}: {:?}", whole[&(id as u64)]);
        assert!(distance(quarter[&(id as u64)], [-seed[1], seed[0], 0.0]) < 1e-6);
    }
    let source = run.steps[2].open(ReadMethod::default()).unwrap();
    let info = &source.description().families[0];
    let mut vorticity = vec![0.0; 40];
    source.read(0, info.named("vorticity").unwrap(), 0..40, &mut vorticity).unwrap();
    assert!(vorticity.iter().all(|value| (value - 2.0).abs() < 1e-5), "{vorticity:?}");
    // Twice the longest side at mean speed, without a duration.
    let usual = TraceOptions { field, ..TraceOptions::default() };
    let run = traced(&path, &usual).unwrap();
    let last = run.steps.last().unwrap().time;
    assert!((4.0..8.0).contains(&last), "{last}");
    // Each stands for its share of the square, in a layer as thick as they are apart.
    let first = run.steps[0].open(ReadMethod::default()).unwrap();
    let info = &first.description().families[0];
    let mut of = [0.0; 2];
    for (kind, value) in [FieldKind::Mass, FieldKind::Density].into_iter().zip(&mut of) {
        first.read(0, info.find(kind).unwrap(), 0..1, std::slice::from_mut(value)).unwrap();
    }
    let apart = (4.0 / info.count as f64).sqrt();
    assert!((of[0] / apart.powi(3) - 1.0).abs() < 1e-9 && (of[1] - 1.0).abs() < 1e-9, "{of:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Cells of any size, times at any distances, faces where slopes jump: paths are those of the interpolated field.
    #[test]
    fn paths_are_those_of_the_interpolated_field(
        steps in prop::array::uniform3(prop::collection::vec(0.3..1.5f64, 2..5)),
        time_steps in prop::collection::vec(0.2..0.8f64, 0..4),
        seed in prop::array::uniform3(0.0..1.0f64), random in 0_u64..1000, is_periodic: bool,
    ) {
        let sums = |steps: &[f64]| {
            let mut all = vec![0.0];
            steps.iter().for_each(|step| all.push(all[all.len() - 1] + step));
            all
        };
        let [x, y, z] = steps.each_ref().map(|steps| sums(steps));
        let times = sums(&time_steps);
        let shape = [times.len(), z.len(), y.len(), x.len()];
        let count = shape.iter().product::<usize>();
        let mut state = random;
        let mut component = || -> Vec<f64> {
            let mut value = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f64 / (1_u64 << 23) as f64 - 1.0
            };
            (0..count).map(|_| value()).collect()
        };
        let line = |values: &[f64]| npy(&[values.len()], values, true);
        let arrays = [
            ("u", npy(&shape, &component(), true)), ("v", npy(&shape, &component(), false)), ("w", npy(&shape, &component(), true)),
            ("x", line(&x)), ("y", line(&y)), ("z", line(&z)), ("t", line(&times)),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), "random.npz", &npz(&arrays));
        let field = FieldOptions { periodic: [is_periodic; 3], ..FieldOptions::default() };
        let end = times.last().copied().filter(|last| *last > 0.0).unwrap_or(1.5).min(1.5);
        let from: [f64; 3] = std::array::from_fn(|axis| seed[axis] * [&x, &y, &z][axis].last().unwrap());
        let options = TraceOptions {
            field: field.clone(), seeds: Seeds::At(vec![from]), duration: Some(end), steps: 4, tolerance: 1e-11, ..TraceOptions::default()
        };
        let run = traced(&path, &options);
        let opened = VectorField::open(&[path], &field, ReadMethod::default()).unwrap();
        let truth = fine(&opened, from, [0.0, end], 40_000);
        match (&run, truth) {
            (Ok(run), Some(truth)) if run.steps.len() == 4 => {
                let edge = run.steps[3].about.box_size;
                let apart = DVec3::from(places(&run.steps[3])[&0]) - truth;
                let apart = edge.map_or(apart, |edge| apart - edge * (apart / edge).round());
                prop_assert!(apart.length() < 1e-6, "{}", apart);
            }
            // What left is not there at the end.
            (Ok(run), truth) => prop_assert!(!is_periodic && run.steps.len() < 4 && truth.is_none(), "{:?}", truth),
            (Err(told), truth) => prop_assert!(!is_periodic && told.contains("second step") && truth.is_none(), "{} {:?}", told, truth),
        }
    }

    /// Where a saddle leads to is known.
    #[test]
    fn saddles_stretch_by_their_exponent(place in prop::array::uniform2(-0.9..0.9f64), rate in 0.2..2.0f64) {
        let (from, to) = ([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]);
        let values: Vec<f64> = nodes([9, 8, 1], from, to, false).iter().flat_map(|[x, y, _]| [-rate * x, rate * y]).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), "saddle.npy", &npy(&[8, 9, 2], &values, true));
        let options = TraceOptions {
            field: FieldOptions { bounds: bounds(from, to), ..FieldOptions::default() },
            seeds: Seeds::At(vec![[place[0], place[1], 0.0]]), duration: Some(1.0), steps: 11, ..TraceOptions::default()
        };
        // When it is at the edge.
        let leaves = (1.0 / place[1].abs()).ln() / rate;
        match traced(&path, &options) {
            Ok(run) => {
                for step in &run.steps {
                    let truth = [place[0] * (-rate * step.time).exp(), place[1] * (rate * step.time).exp(), 0.0];
                    prop_assert!(distance(places(step)[&0], truth) < 1e-6, "{}: {:?}", step.time, truth);
                }
                let last = run.steps.last().unwrap().time;
                prop_assert!(last < leaves + 1e-6 && (last + 0.1 > leaves - 1e-6 || last == 1.0), "{} {}", last, leaves);
            }
            Err(told) => prop_assert!(leaves < 0.1 + 1e-6 && told.contains("second step"), "{} {}", told, leaves),
        }
    }
}

/// The unsteady Arnold-Beltrami-Childress flow of the reference data.
fn abc([x, y, z]: [f64; 3], time: f64) -> [f64; 3] {
    let a = 3.0_f64.sqrt() * (1.0 + 0.5 * time.sin());
    let b = 2.0_f64.sqrt();
    [a * z.sin() + y.cos(), b * x.sin() + a * z.cos(), y.sin() + b * x.cos()]
}

#[test]
fn paths_of_the_abc_flow_are_as_near_as_its_samples() {
    let folder = tempfile::tempdir().unwrap();
    let (side, count, end) = (24, 9, 1.2);
    let all = nodes([side; 3], [0.0; 3], [TAU; 3], true);
    let interval = end / (count - 1) as f64;
    let values: Vec<f64> =
        (0..count).flat_map(|step| all.iter().flat_map(move |at| abc(*at, interval * step as f64))).collect();
    let path = written(folder.path(), "abc.npy", &npy(&[count, side, side, side, 3], &values, false));
    let field = FieldOptions {
        times: Some(format!("0:{interval}").parse().unwrap()),
        periodic: [true; 3],
        bounds: bounds([0.0; 3], [TAU; 3]),
        ..FieldOptions::default()
    };
    let seeds = Seeds::Spread { count: 20, within: None, random: 5 };
    let options = TraceOptions { field: field.clone(), seeds, steps: 7, ..TraceOptions::default() };
    let run = traced(&path, &options).unwrap();
    assert_eq!(run.steps[0].about.box_size, Some(TAU));
    let opened = VectorField::open(&[path], &field, ReadMethod::default()).unwrap();
    let (first, last) = (places(&run.steps[0]), places(&run.steps[6]));
    assert_eq!(last.len(), 20);
    // Between nodes the field is off by an eighth of the squared distance times its second derivatives, the sum of which is below the
    // sum of the amplitudes of both terms of a component; its slopes are below them, too.
    let slope = 1.5 * 3.0_f64.sqrt() + 2.0_f64.sqrt();
    let off = 3.0_f64.sqrt() * slope * (TAU / side as f64).powi(2) / 8.0;
    let bound = off / slope * ((slope * end).exp() - 1.0);
    let nearest = |by: DVec3| (by - TAU * (by / TAU).round()).length();
    let mut mean = 0.0;
    for (id, from) in &first {
        let own = DVec3::from(last[id]);
        let same = fine(&opened, *from, [0.0, end], 2000).unwrap();
        assert!(nearest(same - own) < 2e-6, "{id}: {}", nearest(same - own));
        let mut truth = DVec3::from(*from);
        for step in 0..2000 {
            let h = end / 2000.0;
            truth = rk4(&|at, time| abc(at.to_array(), time).into(), truth, h * f64::from(step), h);
        }
        assert!(nearest(truth - own) < bound, "{id}: {} of {bound}", nearest(truth - own));
        mean += nearest(truth - own) / 20.0;
    }
    println!("mean distance from the path of the formula: {mean:.2e}, bound {bound:.2e}");
}

/// A periodic box whose field is the same everywhere.
fn even(folder: &Path) -> (PathBuf, TraceOptions) {
    let path = written(folder, "even.npy", &npy(&[4, 4, 4, 3], &[1.0, 0.5, -0.25].repeat(64), false));
    let field = FieldOptions { periodic: [true; 3], bounds: bounds([2.0; 3], [3.0; 3]), ..FieldOptions::default() };
    let seeds = Seeds::Spread { count: 500, within: None, random: 1 };
    (path, TraceOptions { field, seeds, duration: Some(6.3), steps: 22, ..TraceOptions::default() })
}

#[test]
fn paths_go_on_behind_the_faces_of_a_periodic_box() {
    let folder = tempfile::tempdir().unwrap();
    let (path, options) = even(folder.path());
    let run = traced(&path, &options).unwrap();
    assert!(run.notes.iter().any(|note| note.contains("is the origin")), "{:?}", run.notes);
    let first = places(&run.steps[0]);
    for step in &run.steps {
        let now = places(step);
        assert_eq!((now.len(), step.about.box_size), (500, Some(1.0)));
        for (id, at) in &now {
            assert!(at.iter().all(|x| (0.0..1.0).contains(x)), "{at:?}");
            let by = DVec3::from(*at) - DVec3::from(first[id]) - step.time * DVec3::new(1.0, 0.5, -0.25);
            assert!((by - by.round()).length() < 1e-9, "{id} at {}: {by}", step.time);
        }
    }
    // A box that is no cube is left on the other side.
    let field = FieldOptions { periodic: [true, false, false], ..options.field.clone() };
    let run = traced(&path, &TraceOptions { field, ..options }).unwrap();
    let last = places(run.steps.last().unwrap());
    assert_eq!(run.steps[0].about.box_size, None);
    assert!(run.steps.len() < 22 && last.values().all(|at| (2.0..=3.0).contains(&at[1])), "{}", run.steps.len());
    assert!(last.values().any(|at| at[0] > 3.5));
}

#[test]
fn runs_of_traces_have_their_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let (path, options) = even(folder.path());
    let out = folder.path().join("flow.df");
    let (load, build, tracks) = (LoadOptions::default(), BuildOptions::default(), TrackOptions::default());
    let build = RunBuild { load: &load, options: &build, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    let files = [path.clone()];
    build.build_traced(&files, &options, &out, &()).unwrap();
    assert!(verify_run(&out, &()).unwrap().tracks >= 21 * 500);
    let run = Arc::new(RunFile::open(&out, ReadMethod::default()).unwrap());
    let matches = run.directory().intervals.iter().map(|interval| interval.families[0].matches.matched);
    assert!(matches.into_iter().all(|matched| matched == 500));
    // Between steps, too.
    let middle = run.at(Moment { step: 7, u: 0.5 }, Default::default()).unwrap();
    let first = places(&traced(&path, &options).unwrap().steps[0]);
    let field = middle.description().families[0].find(FieldKind::Position).unwrap();
    let mut found = vec![0.0; 1500];
    middle.read(0, field, 0..500, &mut found).unwrap();
    for (id, at) in middle.ids(0).unwrap().iter().zip(found.as_chunks::<3>().0) {
        let by = DVec3::from(*at) - DVec3::from(first[id]) - 2.25 * DVec3::new(1.0, 0.5, -0.25);
        assert!((by - by.round()).length() < 2e-3, "{id}: {by}");
    }
}

/// A field that flows to the right, towards where it has no numbers; a hole is in the middle.
fn shore(folder: &Path) -> (PathBuf, TraceOptions) {
    let (from, to) = ([0.0; 3], [4.0, 2.0, 0.0]);
    let is_land = |[x, y, _]: &[f64; 3]| *x > 3.01 || (x - 1.0).abs() < 0.26 && (y - 1.0).abs() < 0.26;
    let value = |at: &[f64; 3]| if is_land(at) { [f64::NAN; 2] } else { [1.0, 0.0] };
    let values: Vec<f64> = nodes([33, 17, 1], from, to, false).iter().flat_map(value).collect();
    let path = written(folder, "shore.npy", &npy(&[17, 33, 2], &values, false));
    let field = FieldOptions { bounds: bounds(from, to), ..FieldOptions::default() };
    (path, TraceOptions { field, steps: 9, duration: Some(2.0), ..TraceOptions::default() })
}

#[test]
fn nothing_begins_on_land_and_paths_end_there() {
    let folder = tempfile::tempdir().unwrap();
    let (path, options) = shore(folder.path());
    let run = traced(&path, &options).unwrap();
    let first = places(&run.steps[0]);
    assert_eq!(first.len(), 20_000);
    // In cells without land at a node.
    let is_sea = |at: &[f64; 3]| at[0] <= 3.0 + 1e-9 && !((at[0] - 1.0).abs() < 0.375 && (at[1] - 1.0).abs() < 0.375);
    assert!(first.values().all(is_sea));
    for step in &run.steps {
        let now = places(step);
        assert!(now.values().all(is_sea));
        for (id, at) in &first {
            let there = at[0] + step.time;
            let into_hole = (at[1] - 1.0).abs() < 0.375 && at[0] < 1.0 && there > 0.625;
            let is_left = there > 3.0 || into_hole;
            // What is at a shore at this very time may be on both sides of it.
            let is_near = (there - 3.0).abs() < 1e-9 || (there - 0.625).abs() < 1e-9;
            assert!(is_near || now.contains_key(id) != is_left, "{id} at {}: {at:?}", step.time);
        }
    }
    assert!(run.notes.iter().any(|note| note.ends_with("come to where it has no velocity")), "{:?}", run.notes);
    // Of places that are asked for, those on land are left out.
    let seeds = Seeds::At(vec![[0.5, 0.5, 0.0], [3.5, 1.0, 0.0], [1.0, 1.0, 0.0], [9.0, 0.0, 0.0]]);
    let few = traced(&path, &TraceOptions { seeds, ..options.clone() }).unwrap();
    assert_eq!(places(&few.steps[0]).into_iter().collect::<Vec<_>>(), [(0, [0.5, 0.5, 0.0])]);
    assert!(few.notes.iter().any(|note| note.starts_with("3 seeds are")), "{:?}", few.notes);
    // Within a box, or on a line.
    for (min, max) in [([0.0, 0.0, -1.0], [0.5, 0.5, 1.0]), ([0.25, 0.0, 0.0], [0.25, 2.0, 0.0])] {
        let within = bounds(min, max);
        let seeds = Seeds::Spread { count: 300, within, random: 0 };
        let some = traced(&path, &TraceOptions { seeds, ..options.clone() }).unwrap();
        let some = places(&some.steps[0]);
        assert!(some.len() == 300 && some.values().all(|at| within.unwrap().contains(DVec3::from(*at))));
    }
}

#[test]
fn threads_and_seeds_make_what_they_should() {
    let folder = tempfile::tempdir().unwrap();
    let (path, options) = shore(folder.path());
    let all = |threads: usize, random: u64| {
        let seeds = Seeds::Spread { count: 700, within: None, random };
        let options = TraceOptions { seeds, ..options.clone() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let run = pool.install(|| traced(&path, &options)).unwrap();
        run.steps.iter().flat_map(places).map(|(id, at)| (id, at.map(f64::to_bits))).collect::<Vec<_>>()
    };
    let one = all(1, 0);
    assert!(one == all(3, 0));
    assert!(one != all(1, 1));
}

#[test]
fn other_formats_and_several_files_are_fields() {
    let folder = tempfile::tempdir().unwrap();
    let mut grid = Grid::volume([5, 4, 3], SampleType::F32, Channel::numbered(3));
    grid.to_world = glam::DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0));
    // Twice as fast at the second time.
    let file = |name: &str, speed: f32, grid: &Grid| {
        let velocity = Vec3::new(speed, 0.0, 0.0).to_array();
        let values: Vec<u8> = velocity.repeat(60).iter().flat_map(|value| value.to_le_bytes()).collect();
        written(folder.path(), name, &[nrrd_head(grid, true).as_bytes(), &values].concat())
    };
    let files = [file("a.nrrd", 1.0, &grid), file("b.nrrd", 2.0, &grid)];
    let options = TraceOptions { seeds: Seeds::At(vec![[0.5, 1.5, 0.5]]), steps: 3, ..TraceOptions::default() };
    let run = trace(&files, &options, ReadMethod::default(), &()).unwrap();
    assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 0.5, 1.0]);
    // The integral of 1 + t.
    assert!(distance(places(&run.steps[2])[&0], [2.0, 1.5, 0.5]) < 1e-6);
    assert!(run.notes.iter().any(|note| note.contains("--times")), "{:?}", run.notes);
    let still = TraceOptions { instant: Some(0.5), duration: Some(2.0), ..options.clone() };
    let run = trace(&files, &still, ReadMethod::default(), &()).unwrap();
    assert!(distance(places(&run.steps[2])[&0], [3.5, 1.5, 0.5]) < 1e-6);
    let told = |files: &[PathBuf], options: &TraceOptions| {
        trace(files, options, ReadMethod::default(), &()).unwrap_err().to_string()
    };
    let other = file("c.nrrd", 1.0, &Grid { to_world: glam::DAffine3::IDENTITY, ..grid.clone() });
    let unlike = told(&[files[0].clone(), other], &options);
    assert!(unlike.contains("c.nrrd: found 5 x 4 x 3"), "{unlike}");
    let turned = glam::DAffine3::from_rotation_z(0.1);
    let turned = told(&[file("d.nrrd", 1.0, &Grid { to_world: turned, ..grid.clone() })], &options);
    assert!(turned.contains("d.nrrd: direction of axis x"), "{turned}");
    // A wind over an image of two values, whose first row is at the top.
    let image = Grid::image([4, 3], SampleType::F32, Channel::numbered(2));
    let values: Vec<u8> = (0..12).flat_map(|node| [0.0, (node / 4) as f32]).flat_map(f32::to_le_bytes).collect();
    let path = written(folder.path(), "e.nrrd", &[nrrd_head(&image, true).as_bytes(), &values].concat());
    let field = VectorField::open(&[path], &FieldOptions::default(), ReadMethod::default()).unwrap();
    assert_eq!(field.interval(0.0).unwrap().velocity([1.0, 0.25, 0.0], 0.0), Some([0.0, 1.75, 0.0]));
}

#[test]
fn what_is_no_field_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let whole = npy(&[2, 3, 4, 4, 3], &vec![0.5; 288], false);
    let told = |name: &str, bytes: &[u8], options: &TraceOptions| {
        let path = written(folder.path(), name, bytes);
        let text = traced(&path, options).unwrap_err();
        assert!(text.contains(&format!("{name}: ")) && !text.contains('\n'), "{text}");
        text
    };
    let usual = TraceOptions { seeds: Seeds::Spread { count: 10, within: None, random: 0 }, ..TraceOptions::default() };
    assert!(traced(&written(folder.path(), "whole.npy", &whole), &usual).is_ok());
    for length in [0, 5, 40, 127, whole.len() - 1] {
        let path = written(folder.path(), "cut.npy", &whole[..length]);
        let text = traced(&path, &usual).unwrap_err();
        assert!(text.contains("cut.npy: ") && !text.contains('\n'), "{text}");
    }
    for shape in [&[6][..], &[4, 4], &[4, 4, 4], &[2, 3, 4, 4], &[2, 2, 2, 2, 2, 3], &[1, 1, 1, 3]] {
        let count: usize = shape.iter().product();
        let text = told("axes.npy", &npy(shape, &vec![0.0; count], false), &usual);
        assert!(text.contains("axes.npy: shape: "), "{text}");
    }
    let huge = told("huge.npy", &npy(&[900_000, 300, 400, 400, 3], &[0.0; 10], false), &usual);
    assert!(huge.contains("huge.npy: data: found "), "{huge}");
    let with = |change: &dyn Fn(&mut TraceOptions)| {
        let mut options = usual.clone();
        change(&mut options);
        told("whole.npy", &whole, &options)
    };
    let cases: [(&dyn Fn(&mut TraceOptions), &str); 8] = [
        (&|options| options.field.times = Some("0,1,2".parse().unwrap()), "--times: found 3 times, expected 2"),
        (
            &|options| options.field.times = Some("1,0".parse().unwrap()),
            "times: found 2 others, expected 2 finite times",
        ),
        (&|options| options.duration = Some(7.0), "--duration: found 7, expected 1 at most"),
        (&|options| options.start = Some(1.0), "--start: found 1, expected a time from 0 to before 1"),
        (&|options| options.steps = 1, "--steps: found 1"),
        (&|options| options.instant = Some(-1.0), "time: found -1, expected 0 to 1"),
        (&|options| options.field.bounds = bounds([0.0; 3], [1.0, 0.0, 1.0]), "--box: found 0 to 0 along y"),
        (&|options| options.seeds = Seeds::At(vec![[-1.0; 3]]), "seeds: missing"),
    ];
    for (change, expected) in cases {
        let text = with(change);
        assert!(text.contains(expected), "{text}");
    }
    let still = told("still.npy", &npy(&[3, 4, 4, 3], &[0.0; 144], false), &usual);
    assert!(still.contains("velocities: found none that moves"), "{still}");
    let nothing = told(
        "nan.npy",
        &npy(&[3, 4, 4, 3], &[f64::NAN; 144], false),
        &TraceOptions { duration: Some(1.0), ..usual.clone() },
    );
    assert!(nothing.contains("seeds: missing"), "{nothing}");
    // Archives.
    let component = npy(&[2, 3, 4], &[1.0; 24], false);
    let times = |times: &[f64]| ("time", npy(&[times.len()], times, true));
    let archive = |arrays: &[(&str, Vec<u8>)]| told("a.npz", &npz(arrays), &usual);
    let pair = [("u", component.clone()), ("v", component.clone())];
    for wrong in [[0.0, f64::NAN], [0.0, f64::INFINITY], [1.0, 1.0], [2.0, 1.0]] {
        let text = archive(&[&pair[..], &[times(&wrong)]].concat());
        assert!(text.contains("a.npz: times: found 2 others"), "{text}");
    }
    let uneven = archive(&[&pair[..], &[times(&[0.0, 1.0]), ("x", npy(&[4], &[0.0, 1.0, 1.0, 2.0], true))]].concat());
    assert!(uneven.contains("a.npz: x: found others"), "{uneven}");
    let unlike = archive(&[("u", component.clone()), ("v", npy(&[3, 2, 4], &[1.0; 24], false))]);
    assert!(unlike.contains("expected the shape of u"), "{unlike}");
    let missing = TraceOptions {
        field: FieldOptions { components: vec!["u".into(), "n".into()], ..FieldOptions::default() },
        ..usual.clone()
    };
    let missing = told("b.npz", &npz(&pair), &missing);
    assert!(missing.contains("b.npz: array n: missing, expected one of u, v"), "{missing}");
    assert!(archive(&[("a", component)]).contains("a.npz: arrays: found a, expected u and v"));
    // Faster than any step can follow.
    let fast = npy(&[3, 4, 4, 3], &[1e30; 144], false);
    let periodic = FieldOptions { periodic: [true; 3], ..FieldOptions::default() };
    let fast = told("fast.npy", &fast, &TraceOptions { field: periodic, duration: Some(1.0), steps: 3, ..usual });
    assert!(fast.contains("no particle at the second step"), "{fast}");
}

fn reference(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("DEEPFIELD_DATA").unwrap()).join("vectorfields").join(name)
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn fields_of_the_reference_data_are_as_others_read_them() {
    let near = |have: Option<[f64; 3]>, want: [f64; 3]| {
        assert!(have.is_some_and(|have| distance(have, want) < 1e-6), "{have:?} {want:?}");
    };
    let field = FieldOptions { times: Some("0:1".parse().unwrap()), ..FieldOptions::default() };
    let abc = VectorField::open(&[reference("abc_unsteady_32.npy")], &field, ReadMethod::default()).unwrap();
    near(abc.interval(1.0).unwrap().velocity([7.0, 5.0, 3.0], 1.0), [1.975435, 3.512018, 1.107369]);
    let ocean = [reference("arctic20_ocean_uv.npz")];
    let ocean = VectorField::open(&ocean, &FieldOptions::default(), ReadMethod::default()).unwrap();
    assert_eq!((ocean.times().len(), ocean.times()[1] - ocean.times()[0]), (5, 86400.0));
    let (low, high) = (ocean.bounds().min, ocean.bounds().max);
    assert_eq!((high.z, low.z, high.x - low.x, high.y - low.y), (0.0, -3000.0, 90.0 * 20.0, 50.0 * 20.0));
    let start = ocean.interval(ocean.times()[0]).unwrap();
    near(
        start.velocity([low.x + 45.0 * 20.0, low.y + 25.0 * 20.0, 0.0], ocean.times()[0]),
        [0.0833257, -0.01556634, 0.0],
    );

    // Particles of the double gyre, against scipy's paths through the formula.
    let seeds = vec![[0.3, 0.4, 0.0], [1.0, 0.5, 0.0], [1.7, 0.8, 0.0]];
    let field = FieldOptions {
        times: Some("0:0.5".parse().unwrap()),
        bounds: bounds([0.0; 3], [2.0, 1.0, 0.0]),
        ..FieldOptions::default()
    };
    let options = TraceOptions { field, seeds: Seeds::At(seeds), steps: 11, ..TraceOptions::default() };
    let run = traced(&reference("double_gyre_unsteady.npy"), &options).unwrap();
    let ends = places(&run.steps[10]);
    for (id, truth) in
        [[1.771865, 0.3811238, 0.0], [0.2579209, 0.4873729, 0.0], [1.476916, 0.9000025, 0.0]].into_iter().enumerate()
    {
        let apart = distance(ends[&(id as u64)], truth);
        println!("double gyre, path {id}: {apart:.2e} from scipy's");
        assert!(apart < 2e-3, "{id}: {apart}");
    }
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn an_ocean_is_traced() {
    let seeds = || Seeds::Spread { count: 2000, within: None, random: 0 };
    // Its places are in km, its depths and velocities in m.
    let field = FieldOptions { bounds: bounds([0.0, 0.0, -3000.0], [1.8e6, 1e6, 0.0]), ..FieldOptions::default() };
    let options = TraceOptions { seeds: seeds(), field, ..TraceOptions::default() };
    let run = traced(&reference("arctic20_ocean_uv.npz"), &options).unwrap();
    assert_eq!(places(&run.steps[0]).len(), 2000);
    assert!(run.steps.len() == 61 && run.steps[60].about.particles() > 1000);
    // Nothing leaves a periodic box.
    let field = FieldOptions {
        times: Some("0:1.2566370614359172".parse().unwrap()),
        periodic: [true; 3],
        bounds: bounds([0.0; 3], [TAU; 3]),
        ..FieldOptions::default()
    };
    let options = TraceOptions { seeds: seeds(), field, ..TraceOptions::default() };
    let run = traced(&reference("abc_unsteady_32.npy"), &options).unwrap();
    assert_eq!(run.steps[60].about.particles(), 2000);
}
