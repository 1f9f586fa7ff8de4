//! Where paths begin and end: at the faces of boxes, or behind them, on land, and in runs that keep them.

use super::{bounds, nodes, npy, places, traced, written};
use deepfield_data::build::{BuildOptions, RunBuild, TrackOptions};
use deepfield_data::import::vector_field::{FieldOptions, Seeds, TraceOptions};
use deepfield_data::import::{FieldKind, LoadOptions, Source};
use deepfield_data::model::{Moment, ReadMethod};
use deepfield_data::store::RunFile;
use deepfield_data::store::run::verify_run;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
