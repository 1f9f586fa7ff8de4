//! Layers against column densities, against volumes, and against what is known of a homogeneous slab.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::cpu::volume::Scenery;
use crate::cpu::volume::tests::{Cloud, RAMP, draw as draw_volume, look, merger, perspective, scenery};
use crate::cpu::{Method, draw as draw_splats};
use crate::model::Kernel;

fn layered(view: &View, cloud: &Cloud, scenery: &Scenery, layers: u32, options: &VolumeOptions) -> Colors {
    let way = (layers, Assignment::Kernel, scenery.termination);
    draw(view, &[cloud.batch()], &scenery.classifier, way, options).unwrap().0
}

/// Mean distance of channels.
fn mean_difference(a: &Colors, b: &Colors) -> f64 {
    let pairs = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened());
    pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / (4 * a.rgba.len()) as f64
}

#[test]
fn one_layer_is_the_column_density_classified() {
    let cloud = merger(5_000);
    let scenery = scenery(RAMP, [1e-11, 1e-7], 100.0, vec![]);
    let options = VolumeOptions { smallest: 0.0, near: Some(1.0), far: Some(1400.0), ..VolumeOptions::default() };
    let height = 90.0;
    for view in [
        perspective(DVec3::new(60.0, 40.0, 700.0), 90, 60),
        look(DVec3::new(60.0, 40.0, 700.0), Projection::Orthographic { height }, 60, 50),
    ] {
        let colors = layered(&view, &cloud, &scenery, 1, &options);
        let columns =
            draw_splats(&view, &[cloud.batch()], &SplatOptions { method: Method::Exact, ..SplatOptions::default() });
        let mut visible = 0;
        for (index, found) in colors.rgba.iter().enumerate() {
            let at = [index % view.width as usize, index / view.width as usize].map(|at| at as f64 + 0.5);
            let secant = match view.projection {
                Projection::Perspective { .. } => {
                    let slope = |at: f64, size: u32| (at - 0.5 * f64::from(size)) / view.focal_pixels();
                    (1.0 + slope(at[0], view.width).powi(2) + slope(at[1], view.height).powi(2)).sqrt()
                }
                Projection::Orthographic { .. } => 1.0,
            };
            let distance = (1399.0 * secant) as f32;
            let matter = scenery.classifier.matter(columns.p[index] / distance, columns.ps[index] / distance);
            let alpha = 1.0 - (-matter.extinction * distance).exp();
            assert!((found[3] - alpha).abs() < 3e-3, "{found:?} {alpha} at {at:?}");
            visible += u32::from(alpha > 0.1);
        }
        assert!(visible > 1000, "{visible}");
    }
}

#[test]
fn more_layers_come_to_the_volume() {
    let cloud = merger(20_000);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 120, 80);
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
    let options = VolumeOptions::default();
    let (volume, report) = draw_volume(&view, &[cloud.batch()], &scenery, &options).unwrap();
    let errors: Vec<f64> = [1, 8, 32, report.grid[2]]
        .map(|layers| 255.0 * mean_difference(&layered(&view, &cloud, &scenery, layers, &options), &volume))
        .to_vec();
    println!("mean difference of channels, of 255, with 1, 8, 32 and {} layers: {errors:.3?}", report.grid[2]);
    assert!(errors.windows(2).all(|pair| pair[1] < 0.75 * pair[0] || pair[1] < 0.4), "{errors:?}");
    assert!(errors[3] < 0.4, "{errors:?}");
}

#[test]
fn opacity_of_a_homogeneous_slab_does_not_depend_on_layers() {
    let cloud = Cloud::lattice(20, 4.0);
    let scenery = scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 0.5, vec![]);
    let expected = 1.0 - 0.7f64.powf(1.2 / 0.5);
    let view = look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 1.2 }, 33, 21);
    let options = VolumeOptions { near: Some(2.4), far: Some(3.6), ..VolumeOptions::default() };
    for layers in [1, 7, 60] {
        for pixel in &layered(&view, &cloud, &scenery, layers, &options).rgba {
            assert!((f64::from(pixel[3]) - expected).abs() < 2e-4, "{pixel:?} {expected} {layers}");
        }
    }
}

#[test]
fn all_of_a_particle_is_in_some_layer() {
    let cloud = merger(3_000);
    let view = perspective(DVec3::new(60.0, 40.0, 700.0), 40, 30);
    let sigma = PerspectiveGrid::sigma_of(&view, 1.0);
    let particles =
        project(&view, &[cloud.batch()], &Taken { sigma, smallest: 0.0, stride: 1, kernel: Kernel::default() });
    let mass: f64 = particles.chunks.iter().flatten().map(|particle| f64::from(particle.mass)).sum();
    for assignment in [Assignment::Kernel, Assignment::Nearest] {
        let size = [40, 30, 50];
        let grid =
            PerspectiveGrid { size, near: 1.0, far: 2000.0, sigma, cell: 1.0, middle: [20.0, 15.0], perspective: true };
        let edges = (0..=50).map(|layer| grid.depth(f64::from(layer))).collect();
        let cutter = Cutter { edges, grid, caps: Caps::of(Kernel::CubicSpline), assignment };
        let held: f64 =
            columns(&cutter, &particles, 0..50).iter().flat_map(|layer| &layer.mass).map(|&m| f64::from(m)).sum();
        assert!((held / mass - 1.0).abs() < 1e-4, "{assignment:?}: {held} of {mass}");
    }
}

#[test]
fn threads_change_nothing_and_no_layers_are_refused() {
    let cloud = merger(4_000);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 70, 50);
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| layered(&view, &cloud, &scenery, 20, &VolumeOptions::default()))
    };
    assert_eq!(with(1), with(2));
    let way = (0, Assignment::Kernel, 1.0);
    let error = draw(&view, &[cloud.batch()], &scenery.classifier, way, &VolumeOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "layers is 0, expected a number from 1 to 4096");
}
