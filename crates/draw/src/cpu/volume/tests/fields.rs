//! Resampled fields and their gradients against exact sums and analytic ones.

use super::*;
use crate::cpu::volume::block::{BEFORE, Block, FRONT, Numbers, Place};
use crate::cpu::volume::bricks::{BORDER, BRICK, Slab};
use crate::cpu::volume::exact::ExactField;
use crate::cpu::volume::surface::gradient;

/// The whole grid in one slab.
fn resampled(view: &View, cloud: &Cloud, options: &VolumeOptions) -> (Prepared, Slab) {
    let prepared = prepare(view, &[cloud.batch()], options).unwrap();
    let layers = 0..prepared.brick_grid().bricks[2];
    let (layers, _) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
    (prepared, Slab { first: 0, layers })
}

/// Errors of a resampled field against the exact sums.
#[derive(Debug)]
struct Errors {
    density: f64,
    weighted: f64,
    gradient: f64,
    /// Mean angle between gradients, degrees, weighted by their length.
    angle: f64,
    samples: usize,
}

/// Looks at every `stride`-th cell that holds something.
fn compare(view: &View, cloud: &Cloud, options: &VolumeOptions, stride: usize) -> Errors {
    let (prepared, slab) = resampled(view, cloud, options);
    let (grid, brick_grid) = (&prepared.grid, prepared.brick_grid());
    let field = ExactField::new(&[cloud.batch()], options.kernel);
    let [k, l, m] = grid.size.map(|size| size as usize);
    let (mut squares, mut norms) = ([0.0f64; 3], [0.0f64; 3]);
    let (mut angle, mut weight, mut samples) = (0.0, 0.0, 0);
    let mut block = Block::default();
    for index in (0..k * l * m).step_by(stride) {
        let cell = [index % k, index / k % l, index / k / l];
        let found = slab.at(cell, brick_grid);
        if found[0] == 0.0 {
            continue;
        }
        samples += 1;
        let center = grid.center(cell.map(|c| c as u32));
        let exact = field.at(world(view, center));
        let mut add = |k: usize, error: f64, norm: f64| {
            squares[k] += error * error;
            norms[k] += norm * norm;
        };
        add(0, f64::from(found[0]) - exact.density, exact.density);
        add(1, f64::from(found[1]) - exact.weighted, exact.weighted);
        if cell[2] < 2 || cell[2] + 2 > m {
            continue;
        }
        // At the end of the step into the cell.
        let [x, y] = [cell[0] + BORDER, cell[1] + BORDER];
        let layer = ((cell[2] + 1) / BRICK).min(brick_grid.bricks[2] - 1);
        if !block.fill(&slab, brick_grid, [x / BRICK, y / BRICK, layer], 0.0) {
            continue;
        }
        let place = Place { x: x % BRICK + BEFORE, y: y % BRICK + BEFORE, shares: [0.0; 2] };
        let middle = [0, 1].map(|axis| (cell[axis] as f64 + 0.5 - grid.middle[axis]) as f32);
        let z = cell[2] + FRONT - layer * BRICK;
        let ours = gradient((&block, Numbers::Volume), brick_grid, &place, middle, cell[2], z, 1.0).map(f64::from);
        let ours = ours[0] * view.right + ours[1] * view.up + ours[2] * view.forward;
        let error = (ours - exact.gradient).length();
        squares[2] += error * error;
        norms[2] += exact.gradient.length_squared();
        if ours.length() > 0.0 && exact.gradient.length() > 0.0 {
            angle += exact.gradient.length() * ours.angle_between(exact.gradient).to_degrees();
            weight += exact.gradient.length();
        }
    }
    let [density, weighted, gradient] = [0, 1, 2].map(|k| (squares[k] / norms[k]).sqrt());
    Errors { density, weighted, gradient, angle: angle / weight, samples }
}

const EXACTLY: VolumeOptions = VolumeOptions {
    grid: GridOptions { resolution: 1.0, lambda: true },
    near: None,
    far: None,
    memory: 1 << 30,
    smallest: 0.0,
    occlusion: true,
    kernel: Kernel::CubicSpline,
    smoothing: 0,
};

#[test]
fn the_field_is_the_exact_sum_on_a_merger() {
    let cloud = merger(8_000);
    for kernel in Kernel::ALL {
        let options = VolumeOptions { kernel, ..EXACTLY };
        let views = [
            perspective(DVec3::new(60.0, 40.0, 90.0), 96, 64),
            look(DVec3::new(60.0, 40.0, 90.0), Projection::Orthographic { height: 60.0 }, 80, 60),
        ];
        // Views know nothing of kernels.
        let count = if kernel == Kernel::CubicSpline { views.len() } else { 1 };
        for view in views.into_iter().take(count) {
            // An orthographic view of the envelope's whole depth has few cells across.
            let options = VolumeOptions { near: Some(20.0), far: Some(220.0), ..options };
            let errors = compare(&view, &cloud, &options, 97);
            assert!(errors.samples > 1000 && errors.density < 1e-4 && errors.weighted < 1e-4, "{kernel:?} {errors:?}");
        }
    }
}

#[test]
fn wide_particles_are_interpolated_within_the_tolerance() {
    // Kernels from one to four hundred cells, seen from outside and from within.
    let mut random = Random::new(11, 0);
    let mut cloud = Cloud::default();
    for _ in 0..600 {
        let place = [0; 3].map(|_| 2.0 * random.normal());
        let h = 0.05 * 60f64.powf(random.uniform());
        cloud.push(place, h as f32, (h * h) as f32, random.uniform() as f32);
    }
    for kernel in Kernel::ALL {
        for eye in [DVec3::new(1.0, 2.0, 9.0), DVec3::new(0.3, 0.1, 1.0)] {
            let view = perspective(eye, 160, 120);
            let options = VolumeOptions { kernel, near: Some(0.1), far: Some(16.0), ..EXACTLY };
            let errors = compare(&view, &cloud, &options, 4999);
            println!("{kernel:?} from {eye}: {errors:?}");
            // Interpolation errs by the fourth derivative.
            let bound = 3e-4 * (Kernel::CubicSpline.variance() / kernel.variance()).max(1.0).powi(3);
            assert!(
                errors.samples > 1000 && errors.density < bound && errors.weighted < bound,
                "{kernel:?} {errors:?}"
            );
            let prepared = prepare(&view, &[cloud.batch()], &options).unwrap();
            assert!(prepared.levels.len() > 2, "{}", prepared.levels.len());
        }
    }
}

#[test]
fn half_and_third_resolutions_sample_the_same_field() {
    let cloud = merger(5_000);
    for resolution in [0.5, 1.0 / 3.0] {
        let options = VolumeOptions { grid: GridOptions { resolution, lambda: false }, ..EXACTLY };
        let errors = compare(&perspective(DVec3::new(30.0, 20.0, 60.0), 130, 95), &cloud, &options, 37);
        assert!(errors.samples > 500 && errors.density < 1e-4, "{errors:?}");
    }
}

#[test]
fn gradients_of_resolved_kernels_are_those_of_the_kernel() {
    // A smooth ball, with 10 and 20 cells to a smoothing length: the error is the differences' own, of second order.
    let mut random = Random::new(7, 0);
    let mut cloud = Cloud::default();
    for _ in 0..200 {
        let [x, y, z] = [0; 3].map(|_| random.normal());
        cloud.push([x, y, z], 1.6, 1.0, 1.0);
    }
    let errors =
        [64, 128].map(|side| compare(&perspective(DVec3::new(0.0, 2.0, 9.0), side, side), &cloud, &EXACTLY, 23));
    assert!(errors[0].gradient < 0.02 && errors[0].angle < 1.0, "{errors:?}");
    assert!(errors[1].gradient < 0.35 * errors[0].gradient, "{errors:?}");
}

#[test]
fn one_particle_is_its_kernel() {
    let mut cloud = Cloud::default();
    cloud.push([0.1, -0.2, 0.3], 0.5, 2.0, 7.0);
    let view = perspective(DVec3::new(0.5, 0.3, 3.0), 64, 64);
    let (prepared, slab) = resampled(&view, &cloud, &EXACTLY);
    let [k, l, m] = prepared.grid.size;
    let (mut mass, mut cells) = (0.0, 0);
    for index in 0..k * l * m {
        let cell = [index % k, index / k % l, index / k / l];
        let [density, weighted] = slab.at(cell.map(|c| c as usize), prepared.brick_grid()).map(f64::from);
        let center = prepared.grid.center(cell);
        let away = (world(&view, center) - DVec3::new(0.1, -0.2, 0.3)).length();
        let expected = 2.0 * Kernel::CubicSpline.value(away / 0.5) / 0.125;
        assert!((density - expected).abs() < 2e-5 * 2.0 / 0.125, "{density} {expected}");
        assert!((weighted - 7.0 * density).abs() <= 1e-5 * weighted);
        let width = prepared.grid.spacing(center.z);
        mass += density * width * width * prepared.grid.slice_spacing(center.z);
        cells += u32::from(density > 0.0);
    }
    assert!(cells > 1000 && (mass / 2.0 - 1.0).abs() < 1e-2, "{cells} cells hold {mass}");
}

#[test]
fn particles_below_the_grid_keep_their_mass() {
    let mut random = Random::new(1, 2);
    let view = look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 2.0 }, 40, 40);
    for _ in 0..40 {
        let mut cloud = Cloud::default();
        cloud.push([0; 3].map(|_| 0.3 * random.signed()), 1e-4, 3.0, 1.0);
        let options = VolumeOptions { near: Some(2.0), far: Some(4.0), ..VolumeOptions::default() };
        let (prepared, slab) = resampled(&view, &cloud, &options);
        let [k, l, m] = prepared.grid.size.map(|size| size as usize);
        assert_eq!(prepared.particles.raised, 1);
        let cells = (0..k * l * m).map(|i| slab.at([i % k, i / k % l, i / k / l], prepared.brick_grid())[0]);
        let mass: f64 = cells.map(f64::from).sum::<f64>() * 0.05f64.powi(3);
        assert!((mass / 3.0 - 1.0).abs() < 0.015, "{mass}");
        // Left as it is, it falls between the cells.
        let (prepared, slab) = resampled(&view, &cloud, &VolumeOptions { smallest: 0.0, ..options });
        assert!(prepared.particles.raised == 0 && slab.layers.iter().flatten().flatten().count() == 0);
    }
}

#[test]
fn a_uniform_lattice_has_its_density_everywhere() {
    let cloud = Cloud::lattice(24, 2.0);
    let view = perspective(DVec3::new(0.2, 0.1, 3.5), 48, 48);
    let (prepared, slab) = resampled(&view, &cloud, &EXACTLY);
    let [k, l, m] = prepared.grid.size;
    let mut inside = 0;
    for index in 0..k * l * m {
        let cell = [index % k, index / k % l, index / k / l];
        let at = world(&view, prepared.grid.center(cell));
        if at.abs().max_element() < 0.75 {
            let [density, weighted] = slab.at(cell.map(|c| c as usize), prepared.brick_grid()).map(f64::from);
            assert!((density - 1.0).abs() < 0.01, "{density} at {at}");
            // The mean of a linear attribute is that attribute.
            assert!((weighted / density - at.x).abs() < 0.02, "{} at {at}", weighted / density);
            inside += 1;
        }
    }
    assert!(inside > 5000);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn the_field_is_the_exact_sum_on_real_data() {
    let folder = std::env::var_os("DEEPFIELD_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        std::path::PathBuf::from,
    );
    let options = crate::import::LoadOptions {
        families: vec![crate::model::FamilyName::Gas],
        ..crate::import::LoadOptions::default()
    };
    for (file, attribute) in
        [("sequences/star_merger/snapshot_012.hdf5", "internal-energy"), ("particles/fire_galaxy_a.hdf5", "speed")]
    {
        let dataset = crate::import::load(&folder.join(file), &options, &()).unwrap();
        let family = &dataset.families[0];
        let named = family.attribute(attribute).map_or(family.attributes[0].name.as_str(), |_| attribute);
        let mut cloud = Cloud::of(family, named);
        let middle: [f64; 3] = {
            let positions = &cloud.positions;
            std::array::from_fn(|axis| {
                let mut values: Vec<f64> = positions.iter().map(|position| position[axis]).collect();
                values.sort_by(f64::total_cmp);
                values[values.len() / 2]
            })
        };
        cloud.positions.iter_mut().for_each(|p| (0..3).for_each(|axis| p[axis] -= middle[axis]));
        let mut distances: Vec<f64> = cloud.positions.iter().map(|&p| DVec3::from_array(p).length()).collect();
        distances.sort_by(f64::total_cmp);
        let size = distances[distances.len() * 3 / 4];
        for distance in [0.8, 3.0] {
            let view = perspective(DVec3::new(0.5, 0.4, 1.0).normalize() * distance * size, 160, 120);
            let errors = compare(&view, &cloud, &VolumeOptions { kernel: dataset.kernel, ..EXACTLY }, 241);
            println!("{file} from {distance} sizes: {errors:?}");
            assert!(errors.samples > 1000 && errors.density < 1e-4 && errors.weighted < 1e-4, "{errors:?}");
        }
    }
}
