//! Paths whose truth is closed, or a finer integration of the same field.

use super::{bounds, distance, nodes, npy, npz, places, traced, written};
use deepfield_data::import::FieldKind;
use deepfield_data::import::vector_field::{FieldOptions, Seeds, TraceOptions, VectorField};
use deepfield_data::model::ReadMethod;
use glam::DVec3;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

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
            if is_out.get() {
                return None;
            }
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
    let seeds = Seeds::Spread { count: 500, within: None, random: 0 };
    let usual = TraceOptions { field, seeds, ..TraceOptions::default() };
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
    #![proptest_config(ProptestConfig::with_cases(8))]

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
        // Fine paths through cells take long.
        if id.is_multiple_of(3) {
            let same = fine(&opened, *from, [0.0, end], 2000).unwrap();
            assert!(nearest(same - own) < 2e-6, "{id}: {}", nearest(same - own));
        }
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
