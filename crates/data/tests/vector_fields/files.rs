//! Files of fields in other formats, several of them, and what is none.

use super::{bounds, distance, npy, npz, places, traced, written};
use deepfield_data::import::grid::head::nrrd_head;
use deepfield_data::import::vector_field::{FieldOptions, Seeds, TraceOptions, VectorField, trace};
use deepfield_data::model::{Channel, Grid, ReadMethod, SampleType};
use glam::{DVec3, Vec3};
use std::path::PathBuf;

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
