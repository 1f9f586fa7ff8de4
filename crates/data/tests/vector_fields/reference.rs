//! Fields of the reference data.

use super::{bounds, distance, places, traced};
use deepfield_data::import::vector_field::{FieldOptions, Seeds, TraceOptions, VectorField};
use deepfield_data::model::ReadMethod;
use std::f64::consts::TAU;
use std::path::PathBuf;

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
    let seeds = |count: u64| Seeds::Spread { count, within: None, random: 0 };
    // Its places are in km, its depths and velocities in m.
    let field = FieldOptions { bounds: bounds([0.0, 0.0, -3000.0], [1.8e6, 1e6, 0.0]), ..FieldOptions::default() };
    let options = TraceOptions { seeds: seeds(2000), field, ..TraceOptions::default() };
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
    let options = TraceOptions { seeds: seeds(300), field, ..TraceOptions::default() };
    let run = traced(&reference("abc_unsteady_32.npy"), &options).unwrap();
    assert_eq!(run.steps[60].about.particles(), 300);
}
