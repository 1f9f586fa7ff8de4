//! The grid's field against the exact sum, and its pictures against analytic ones and the perspective grid's.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::cpu::volume::exact::ExactField;
use crate::cpu::volume::tests::{Cloud, RAMP, draw as draw_volume, look, merger, perspective, scenery};
use crate::cpu::volume::{Light, Surface};
use crate::model::Kernel;
use crate::synth::random::Random;
use crate::view::Projection;

const EXACTLY: VolumeOptions = VolumeOptions {
    grid: crate::view::perspective_grid::GridOptions { resolution: 1.0, lambda: true },
    near: None,
    far: None,
    memory: 1 << 30,
    smallest: 0.0,
    occlusion: true,
    kernel: Kernel::CubicSpline,
    smoothing: 0,
};

fn grid(cells: u32) -> CartesianOptions {
    CartesianOptions { cells, region: Region::Data, memory: 1 << 30 }
}

#[test]
fn the_field_comes_to_the_exact_sum() {
    let mut random = Random::new(7, 0);
    let mut cloud = Cloud::default();
    for _ in 0..200 {
        let [x, y, z] = [0; 3].map(|_| random.normal());
        cloud.push([x, 2.0 * y, z], 1.6, 1.0, x as f32);
    }
    let exact = ExactField::new(&[cloud.batch()], Kernel::CubicSpline);
    let view = perspective(DVec3::new(0.0, 0.0, 30.0), 60, 60);
    let extents = extents::of(&[cloud.batch()]);
    let points: Vec<DVec3> = (0..500).map(|_| DVec3::from_array([0; 3].map(|_| 1.5 * random.signed()))).collect();
    let errors = [32, 64, 128].map(|cells| {
        let (lattice, _) = Lattice::of(&view, &extents, &grid(cells), true, &EXACTLY).unwrap();
        let (field, _) = Cartesian::new(&[cloud.batch()], &lattice, &EXACTLY).unwrap();
        let (mut squares, mut norms) = ([0.0; 2], [0.0; 2]);
        for &point in &points {
            let (found, sample) = (field.at(point), exact.at(point));
            for (k, value) in [sample.density, sample.weighted].into_iter().enumerate() {
                squares[k] += (f64::from(found[k]) - value).powi(2);
                norms[k] += value * value;
            }
        }
        (squares[0] / norms[0]).sqrt().max((squares[1] / norms[1]).sqrt())
    });
    println!("relative L2 with 32, 64 and 128 cells: {errors:?}");
    assert!(errors[1] < 0.35 * errors[0] && errors[2] < 0.35 * errors[1] && errors[2] < 6e-3, "{errors:?}");
}

#[test]
fn opacity_of_a_homogeneous_slab_does_not_depend_on_cells() {
    let cloud = Cloud::lattice(20, 4.0);
    let scenery = scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 0.5, vec![]);
    let expected = 1.0 - 0.7f64.powf(1.2 / 0.5);
    let options = VolumeOptions { near: Some(2.4), far: Some(3.6), ..EXACTLY };
    for (cells, of) in [(20, Region::View), (75, Region::View), (60, Region::Data)] {
        let view = look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 1.2 }, 33, 21);
        let layout = CartesianOptions { region: of, ..grid(cells) };
        let (colors, _) = draw(&view, &[cloud.batch()], &scenery, &layout, &options).unwrap();
        for pixel in &colors.rgba {
            assert!((f64::from(pixel[3]) - expected).abs() < 1e-3, "{pixel:?} {expected} {cells}");
        }
    }
}

#[test]
fn more_cells_come_to_the_volume_of_the_perspective_grid() {
    let cloud = merger(8_000);
    let surfaces = vec![Surface { value: 1e-5, color: None, opacity: 0.5 }];
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, surfaces);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 90, 60);
    let options = VolumeOptions { near: Some(40.0), far: Some(200.0), ..EXACTLY };
    let (volume, _) = draw_volume(&view, &[cloud.batch()], &scenery, &options).unwrap();
    let errors = [48, 96, 192].map(|cells| {
        let layout = CartesianOptions { region: Region::View, ..grid(cells) };
        let (colors, report) = draw(&view, &[cloud.batch()], &scenery, &layout, &options).unwrap();
        assert!(report.crossings > Some(100) && report.samples > Some(1000), "{report:?}");
        let pairs = colors.rgba.as_flattened().iter().zip(volume.rgba.as_flattened());
        255.0 * pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / (4 * colors.rgba.len()) as f64
    });
    println!("mean difference of channels, of 255, with 48, 96 and 192 cells: {errors:.3?}");
    assert!(errors[1] < 0.8 * errors[0] && errors[2] < 0.8 * errors[1] && errors[2] < 3.0, "{errors:?}");
}

#[test]
fn a_surface_is_where_the_field_has_its_value() {
    // The surface of half the peak of one kernel is a sphere; lit from the eye, its brightness is the cosine.
    let mut cloud = Cloud::default();
    cloud.push([0.0; 3], 1.0, 1.0, 1.0);
    let peak = Kernel::CubicSpline.value(0.0);
    let radius = (1..1000).map(|i| f64::from(i) / 1000.0).find(|&r| Kernel::CubicSpline.value(r) < 0.5 * peak).unwrap();
    let surface = Surface { value: 0.5 * peak as f32, color: Some([1.0; 3]), opacity: 1.0 };
    let mut scenery = scenery(RAMP, [1e-2, 10.0], 1.0, vec![surface]);
    scenery.volume = false;
    scenery.light = Some(Light { ambient: 0.0, specular: 0.0, shininess: 1.0 });
    let view = look(DVec3::new(0.4, 0.1, 3.2), Projection::Orthographic { height: 1.6 }, 101, 101);
    let (colors, _) = draw(&view, &[cloud.batch()], &scenery, &grid(80), &EXACTLY).unwrap();
    let (mut wrong, mut squares, mut lit) = (0, 0.0, 0);
    for (index, pixel) in colors.rgba.iter().enumerate() {
        let away = ((index % 101) as f64 - 50.0).hypot((index / 101) as f64 - 50.0) / view.focal_pixels();
        wrong += u32::from((away < radius) != (pixel[3] > 0.5));
        if away < 0.9 * radius && pixel[3] > 0.5 {
            squares += ((1.0 - (away / radius).powi(2)).sqrt() - f64::from(pixel[0])).powi(2);
            lit += 1;
        }
    }
    let error = (squares / f64::from(lit)).sqrt();
    assert!(wrong < 60 && lit > 1000 && error < 0.02, "{wrong} {lit} {error}");
}

#[test]
fn a_grid_that_does_not_fit_is_refused() {
    let cloud = Cloud::lattice(4, 2.0);
    let scenery = scenery(RAMP, [1e-2, 10.0], 1.0, vec![]);
    let view = perspective(DVec3::new(0.0, 0.0, 9.0), 30, 20);
    let layout = CartesianOptions { cells: 4096, region: Region::Data, memory: 64 << 20 };
    let error = draw(&view, &[cloud.batch()], &scenery, &layout, &EXACTLY).unwrap_err().to_string();
    assert!(error.starts_with("cells is 4096, expected fewer: a grid of 4096 x 4096 x 4096 cells takes"), "{error}");
    assert!(error.ends_with("memory is 64 MiB"), "{error}");
}

#[test]
fn bricks_of_an_octree_hold_the_exact_sum() {
    let cloud = merger(4_000);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 90, 60);
    let (bounds, _) = region(&view, &extents::of(&[cloud.batch()]), Region::View, &EXACTLY).unwrap();
    // The middle of its picture shows all the points below, 21 around the origin at most, with as many pixels: what is beside it costs most.
    let fov_y = 2.0 * (28.0 / 60.0 * 0.4f64.tan()).atan();
    let middle = View { projection: Projection::Perspective { fov_y }, width: 28, height: 28, ..view };
    let exact = ExactField::new(&[cloud.batch()], Kernel::CubicSpline);
    let mut random = Random::new(2, 0);
    let points: Vec<DVec3> = (0..400).map(|_| DVec3::from_array([0; 3].map(|_| 12.0 * random.signed()))).collect();
    let errors = [1.0, 0.5].map(|width| {
        let mut field = octree::Octree::new(&[cloud.batch()], bounds, Kernel::CubicSpline, 0.0).unwrap();
        // Nearer by, cells would be many and small.
        field.prepare(&middle, width, 40.0);
        // In L2 the one point next to the densest particle would be all.
        let (mut amount, mut norm, mut seen) = ([0.0; 2], [0.0; 2], 0);
        for &point in &points {
            let place = field.place(point).as_vec3();
            let room = field.room(place, 0.0);
            if !room.empty {
                let expected = exact.at(point);
                let values = field.at(&room, place).into_iter().zip([expected.density, expected.weighted]);
                for (k, (found, value)) in values.enumerate() {
                    amount[k] += (f64::from(found) - value).abs();
                    norm[k] += value.abs();
                }
                seen += 1;
            }
        }
        assert!(seen > 300, "{seen}");
        (amount[0] / norm[0]).max(amount[1] / norm[1])
    });
    println!("relative L1 with cells of the view's width and of half of it: {errors:?}");
    assert!(errors[0] < 0.06 && errors[1] < 0.45 * errors[0], "{errors:?}");
}

#[test]
fn an_octree_keeps_what_it_has_and_draws_the_volume() {
    let cloud = merger(8_000);
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![Surface { value: 1e-5, color: None, opacity: 0.5 }]);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 90, 60);
    let options = VolumeOptions { near: Some(40.0), far: Some(200.0), ..EXACTLY };
    let (bounds, planes) = region(&view, &extents::of(&[cloud.batch()]), Region::View, &options).unwrap();
    let mut tree = octree::Octree::new(&[cloud.batch()], bounds, Kernel::CubicSpline, 0.0).unwrap();
    let first = tree.prepare(&view, 1.0, planes[0]);
    assert!(first.bricks > 50 && first.resampled == first.bricks, "{first:?}");
    let (colors, effort) = march::cast(&view, &tree, &scenery, planes);
    assert!(effort.crossings > 100 && effort.samples > 1000);
    let (volume, _) = draw_volume(&view, &[cloud.batch()], &scenery, &options).unwrap();
    let pairs = colors.rgba.as_flattened().iter().zip(volume.rgba.as_flattened());
    let error = 255.0 * pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / (4 * colors.rgba.len()) as f64;
    assert!(error < 1.0, "{error}");
    // The same view again, and one nearby.
    assert_eq!(tree.prepare(&view, 1.0, planes[0]).resampled, 0);
    assert_eq!(march::cast(&view, &tree, &scenery, planes).0, colors);
    let next = tree.prepare(&perspective(DVec3::new(60.5, 40.0, 89.7), 90, 60), 1.0, planes[0]);
    assert!(next.resampled < next.bricks / 4, "{next:?}");
}
