//! Sorted splats: analytic cases, the order in each tile, and what must not change a picture.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::cpu::volume::Scenery;
use crate::cpu::volume::exact::ExactField;
use crate::cpu::volume::stretched::tests::{Ellipsoids, rotation};
use crate::cpu::volume::tests::{Cloud, RAMP, look, merger, perspective, scenery};
use crate::model::Kernel;
use crate::synth::random::Random;
use crate::view::Projection;
use glam::DMat3;

fn sorted(view: &View, cloud: &Cloud, densities: &[f32], scenery: &Scenery) -> Colors {
    let batch = cloud.batch().with_density(Some(densities)).unwrap();
    let options = VolumeOptions { smallest: 0.0, ..VolumeOptions::default() };
    draw(view, &[batch], &scenery.classifier, (scenery.termination, 1.0), &options).unwrap().0
}

#[test]
fn the_order_of_the_input_changes_nothing() {
    let mut cloud = merger(6_000);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 100, 70);
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
    let density = |cloud: &Cloud| -> Vec<f32> {
        cloud.h.iter().zip(&cloud.mass).map(|(h, mass)| 12.0 * mass / h.powi(3)).collect()
    };
    // Some at the same depth exactly.
    for i in 0..200 {
        cloud.positions[i + 200] = cloud.positions[i];
    }
    let first = sorted(&view, &cloud, &density(&cloud), &scenery);
    assert!(first.rgba.iter().any(|pixel| pixel[3] > 0.5));
    let mut random = Random::new(8, 1);
    for i in (1..cloud.h.len()).rev() {
        let j = (random.uniform() * (i + 1) as f64) as usize;
        cloud.positions.swap(i, j);
        cloud.h.swap(i, j);
        cloud.mass.swap(i, j);
        cloud.attribute.swap(i, j);
    }
    let second = sorted(&view, &cloud, &density(&cloud), &scenery);
    let bits = |colors: &Colors| colors.rgba.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&first), bits(&second));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(bits(&first), bits(&pool.install(|| sorted(&view, &cloud, &density(&cloud), &scenery))));
}

#[test]
fn one_particle_is_its_optical_depth_and_the_nearer_one_hides_the_farther() {
    // 0.3 for each 0.5 at any density above 0.1.
    let slab = "(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])";
    let plain = scenery(slab, [0.1, 10.0], 0.5, vec![]);
    let mut cloud = Cloud::default();
    cloud.push([0.1, -0.05, 0.3], 0.5, 0.2, 7.0);
    let view = look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 1.2 }, 64, 64);
    let kappa = -(0.7f64.ln()) / 0.5;
    let at = view.to_camera(DVec3::from_array(cloud.positions[0]));
    for (index, pixel) in sorted(&view, &cloud, &[1.5], &plain).rgba.iter().enumerate() {
        let [x, y] = [(index % 64) as f64 - 31.5, 31.5 - (index / 64) as f64].map(|at| at * 1.2 / 64.0);
        let q = (x - at.x).hypot(y - at.y) / 0.5;
        let depth = kappa / 1.5 * 0.2 * Kernel::CubicSpline.projected(q) / 0.25;
        let expected = 1.0 - (-depth).exp();
        assert!((f64::from(pixel[3]) - expected).abs() < 1e-3, "{pixel:?} {expected}");
    }
    // Two opaque ones, of low and of high attribute.
    let colored = scenery(
        "(opacity: [(0.0, 0.0), (0.01, 1.0)], brightness: [(0.0, 0.5)], hue: Some((color_map: \"plasma\", scale: linear, \
         range: auto)))",
        [0.1, 10.0],
        0.01,
        vec![],
    );
    let pixel = |depths: [f64; 2]| {
        let mut cloud = Cloud::default();
        cloud.push([0.0, 0.0, depths[0]], 0.5, 1.0, -1.0);
        cloud.push([0.0, 0.0, depths[1]], 0.5, 1.0, 1.0);
        sorted(&view, &cloud, &[2.0, 2.0], &colored).rgba[32 * 64 + 32]
    };
    assert_ne!(pixel([0.0, 1.0]), pixel([1.0, 0.0]));
    let mut alone = Cloud::default();
    alone.push([0.0, 0.0, 1.0], 0.5, 1.0, 1.0);
    let near = sorted(&view, &alone, &[2.0], &colored).rgba[32 * 64 + 32];
    assert!((0..3).all(|k| (pixel([0.0, 1.0])[k] - near[k]).abs() < 0.01), "{near:?}");
}

#[test]
fn a_homogeneous_block_has_its_optical_depth() {
    let cloud = Cloud::lattice(20, 4.0);
    let scenery = scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 2.5, vec![]);
    let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 1.2 }, 33, 21);
    let expected = 1.0 - 0.7f64.powf(4.0 / 2.5);
    for pixel in &sorted(&view, &cloud, &vec![1.0; cloud.h.len()], &scenery).rgba {
        assert!((f64::from(pixel[3]) - expected).abs() < 0.03, "{pixel:?} {expected}");
    }
}

#[test]
fn particles_without_densities_are_refused() {
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
    let view = perspective(DVec3::new(0.0, 0.0, 9.0), 30, 20);
    let error =
        draw(&view, &[Cloud::lattice(3, 2.0).batch()], &scenery.classifier, (1.0, 1.0), &VolumeOptions::default());
    assert!(error.unwrap_err().to_string().starts_with("density is not there"));
}

#[test]
fn one_ellipsoid_is_its_optical_depth_along_each_ray() {
    let slab = "(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])";
    let plain = scenery(slab, [0.1, 10.0], 0.5, vec![]);
    let kappa = -(0.7f64.ln()) / 0.5;
    let mut random = Random::new(4, 4);
    // The widest and the narrowest for their radius, and one between.
    for kernel in [Kernel::Poly6, Kernel::CubicSpline, Kernel::WendlandC6] {
        let mut all = Ellipsoids::default();
        let (middle, longest) = (DVec3::new(0.1, -0.05, 0.2), 0.7);
        all.push(middle, DVec3::new(longest, 0.4, 0.15), rotation(&mut random), kernel, [0.3, 1.0]);
        let field = ExactField::new(&[all.batch()], kernel);
        let options = VolumeOptions { smallest: 0.0, kernel, ..VolumeOptions::default() };
        for view in [
            look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 1.6 }, 40, 40),
            perspective(DVec3::new(0.3, 0.2, 2.0), 40, 40),
        ] {
            let batch = all.batch().with_density(Some(&[1.5])).unwrap();
            let found = draw(&view, &[batch], &plain.classifier, (1.0, 1.0), &options).unwrap().0;
            let lens = Lens::new(&view);
            let world = |camera: DVec3| view.eye + camera.x * view.right + camera.y * view.up + camera.z * view.forward;
            let mut covered = 0;
            for (index, pixel) in found.rgba.iter().enumerate() {
                let (start, direction) = lens.sight([(index % 40) as f64 + 0.5, (index / 40) as f64 + 0.5]);
                let step = 0.005;
                let places = (0..800).map(|i| world(start + (f64::from(i) + 0.5) * step * direction));
                // Elsewhere there is nothing.
                let places = places.filter(|place| place.distance(middle) < 1.01 * longest);
                let column: f64 = places.map(|place| field.at(place).density * step).sum();
                let expected = 1.0 - (-kappa / 1.5 * column * direction.length()).exp();
                assert!((f64::from(pixel[3]) - expected).abs() < 1e-3, "{kernel:?} {index}: {pixel:?} {expected}");
                covered += usize::from(expected > 0.01);
            }
            assert!(covered > 60, "{kernel:?}: {covered}");
        }
    }
}

#[test]
fn long_ellipsoids_hide_each_other_where_each_is_in_front() {
    // Two opaque rods, of low and of high attribute, cross in depth like an X seen from its side: centres say nothing.
    let colored = scenery(
        "(opacity: [(0.0, 0.0), (0.01, 1.0)], brightness: [(0.0, 0.5)], hue: Some((color_map: \"plasma\", scale: linear, \
         range: auto)))",
        [0.1, 10.0],
        0.01,
        vec![],
    );
    let rod = |attribute: f32, slope: f64, deeper: f64| {
        let mut all = Ellipsoids::default();
        let axes = DMat3::from_rotation_y(slope);
        let radii = DVec3::new(2.0, 0.4, 0.05);
        all.push(DVec3::new(0.0, 0.0, deeper), radii, axes, Kernel::CubicSpline, [1.0, attribute]);
        all
    };
    for (view, way) in [
        (look(DVec3::new(0.0, 0.0, 5.0), Projection::Perspective { fov_y: 0.2 }, 128, 32), "perspective"),
        (look(DVec3::new(0.0, 0.0, 5.0), Projection::Orthographic { height: 1.0 }, 128, 32), "parallel"),
    ] {
        let picture = |rods: &[&Ellipsoids]| {
            let batches: Vec<Splats<'_>> =
                rods.iter().map(|rod| rod.batch().with_density(Some(&[2.0])).unwrap()).collect();
            draw(&view, &batches, &colored.classifier, (1.0, 1.0), &VolumeOptions::default()).unwrap().0.rgba
        };
        let [at_left, at_right] = [16 * 128 + 48, 16 * 128 + 80];
        // Whichever centre is nearer.
        for deeper in [1e-3, -1e-3] {
            let (falling, rising) = (rod(-1.0, 0.5, deeper), rod(1.0, -0.5, 0.0));
            let both = picture(&[&falling, &rising]);
            let [falling, rising] = [&falling, &rising].map(|rod| picture(&[rod]));
            for at in [at_left, at_right] {
                assert!((0..3).any(|k| (falling[at][k] - rising[at][k]).abs() > 0.05), "{way}");
            }
            let is = |at: usize, alone: &[[f32; 4]]| (0..3).all(|k| (both[at][k] - alone[at][k]).abs() < 0.01);
            let order = [is(at_left, &falling), is(at_left, &rising), is(at_right, &falling), is(at_right, &rising)];
            assert_eq!(order, [true, false, false, true], "{way} {deeper}");
        }
    }
}

#[test]
fn the_order_of_ellipsoids_in_the_input_changes_nothing() {
    let mut random = Random::new(9, 9);
    let mut all = Ellipsoids::default();
    for index in 0..600 {
        // Pairs at the same place, of different shapes.
        let place = if index % 2 == 0 { [0; 3].map(|_| random.normal()) } else { all.positions[index - 1] };
        let radii = DVec3::new(1.0, 0.3, 0.05) * random.uniform();
        let values = [1.0, random.uniform() as f32];
        all.push(DVec3::from_array(place), radii, rotation(&mut random), Kernel::CubicSpline, values);
    }
    let view = perspective(DVec3::new(0.5, 0.4, 6.0), 100, 70);
    let scenery = scenery(RAMP, [1e-3, 1e2], 4.0, vec![]);
    let picture = |all: &Ellipsoids| {
        let densities = vec![2.0; all.mass.len()];
        let batch = all.batch().with_density(Some(&densities)).unwrap();
        let colors = draw(&view, &[batch], &scenery.classifier, (0.99, 1.0), &VolumeOptions::default()).unwrap().0;
        colors.rgba.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>()
    };
    let first = picture(&all);
    all.positions.reverse();
    all.covariances.reverse();
    all.mass.reverse();
    all.attribute.reverse();
    assert!(first == picture(&all));
}
