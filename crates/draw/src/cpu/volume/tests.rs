//! The whole way of a volume: fields against exact sums, analytic cases, and what must not change a picture.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::block::{BEFORE, Block, FRONT, Numbers, Place};
use super::bricks::{BORDER, BRICK, Slab};
use super::exact::ExactField;
use super::surface::{Crossings, gradient};
use super::*;
use crate::color::transfer::{Scale, TransferFunction};
use crate::cpu::field::{Field, FieldBricks, ValueAxis};
use crate::cpu::shadowing::covering_depths;
use crate::cpu::{Extent, Positions};
use crate::model::{Channel, Dataset, Family, Grid, SampleType, Unit};
use crate::synth::merger::Merger;
use crate::synth::random::Random;
use crate::view::Projection;
use glam::DVec3;

/// Columns of particles that own their values.
#[derive(Clone, Default)]
pub(in crate::cpu) struct Cloud {
    pub positions: Vec<[f64; 3]>,
    pub h: Vec<f32>,
    pub mass: Vec<f32>,
    pub attribute: Vec<f32>,
}

impl Cloud {
    pub fn push(&mut self, position: [f64; 3], h: f32, mass: f32, attribute: f32) {
        self.positions.push(position);
        self.h.push(h);
        self.mass.push(mass);
        self.attribute.push(attribute);
    }

    fn of(family: &Family, attribute: &str) -> Cloud {
        Cloud {
            positions: family.positions.clone(),
            h: family.smoothing_length.clone(),
            mass: family.mass.clone(),
            attribute: family.attribute(attribute).unwrap().values.clone(),
        }
    }

    pub fn batch(&self) -> Splats<'_> {
        Splats::new(Positions::World(&self.positions), Extent::World(&self.h), &self.mass, Some(&self.attribute))
            .unwrap()
    }

    /// A lattice of `count^3` particles in a cube of this width around the origin, with mass density 1.
    pub fn lattice(count: i32, width: f64) -> Cloud {
        let spacing = width / f64::from(count);
        let mut cloud = Cloud::default();
        for index in 0..count.pow(3) {
            let at = |n: i32| (f64::from(n % count) + 0.5) * spacing - 0.5 * width;
            let position = [at(index), at(index / count), at(index / count / count)];
            cloud.push(position, 2.6 * spacing as f32, spacing.powi(3) as f32, position[0] as f32);
        }
        cloud
    }
}

pub(in crate::cpu) fn draw(
    view: &View,
    batches: &[Splats<'_>],
    scenery: &Scenery,
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    super::draw(view, batches, scenery, options)
}

pub(in crate::cpu) fn merger(count: u64) -> Cloud {
    let dataset: Dataset = crate::synth::dataset(&Merger::new(3, count));
    Cloud::of(&dataset.families[0], "internal-energy")
}

pub(in crate::cpu) fn look(eye: DVec3, projection: Projection, width: u32, height: u32) -> View {
    View::look_at(eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0), projection, width, height).unwrap()
}

pub(in crate::cpu) fn perspective(eye: DVec3, width: u32, height: u32) -> View {
    look(eye, Projection::Perspective { fov_y: 0.8 }, width, height)
}

/// The whole grid in one slab.
fn resampled(view: &View, cloud: &Cloud, options: &VolumeOptions) -> (Prepared, Slab) {
    let prepared = prepare(view, &[cloud.batch()], options).unwrap();
    let layers = 0..prepared.brick_grid().bricks[2];
    let (layers, _) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
    (prepared, Slab { first: 0, layers })
}

fn world(view: &View, camera: DVec3) -> DVec3 {
    view.eye + camera.x * view.right + camera.y * view.up + camera.z * view.forward
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

pub(in crate::cpu) fn scenery(transfer: &str, density: [f64; 2], unit_length: f64, surfaces: Vec<Surface>) -> Scenery {
    let transfer = TransferFunction::parse(transfer, "test").unwrap();
    let levels = VolumeLevels { density, attribute: [-1.0, 1.0], unit_length };
    Scenery {
        classifier: Classifier::new(&transfer, levels, true),
        volume: true,
        surfaces,
        light: Some(Light { ambient: 0.2, specular: 0.2, shininess: 20.0 }),
        volume_light: None,
        termination: 1.0,
    }
}

pub(in crate::cpu) const RAMP: &str = "(opacity: [(0.0, 0.0), (1.0, 0.4)], brightness: [(0.0, 0.1), (1.0, 1.0)])";

#[test]
fn opacity_of_a_homogeneous_slab_does_not_depend_on_sampling() {
    let cloud = Cloud::lattice(20, 4.0);
    // 0.3 for each 0.5 at any density above 0.1; 1.2 deep between the planes, everywhere within the lattice.
    let scenery = scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 0.5, vec![]);
    let expected = 1.0 - 0.7f64.powf(1.2 / 0.5);
    for (resolution, lambda) in [(1.0, true), (0.5, true), (1.0 / 3.0, false), (2.0, false)] {
        for projection in [Projection::Orthographic { height: 1.2 }, Projection::Perspective { fov_y: 0.3 }] {
            let view = look(DVec3::new(0.0, 0.0, 3.0), projection, 33, 21);
            let options = VolumeOptions {
                grid: GridOptions { resolution, lambda },
                near: Some(2.4),
                far: Some(3.6),
                ..VolumeOptions::default()
            };
            let (colors, report) = draw(&view, &[cloud.batch()], &scenery, &options).unwrap();
            let grid = prepare(&view, &[cloud.batch()], &options).unwrap().grid;
            for (index, pixel) in colors.rgba.iter().enumerate() {
                let at = [(index % 33) as f64 + 0.5, (index / 33) as f64 + 0.5].map(|at| at / grid.cell);
                let expected = 1.0 - (1.0 - expected).powf(grid.secant(at));
                let found = f64::from(pixel[3]);
                assert!((found - expected).abs() < 2e-4, "{found} {expected} {:?} {resolution}", report.grid);
                // White light, as bright as it is opaque.
                assert!((pixel[0] - pixel[3]).abs() < 0.05, "{pixel:?}");
            }
        }
    }
}

/// Check 22: light of an opaque path before, in and behind a slab of known opacity.
#[test]
fn paths_are_seen_through_what_of_a_slab_is_before_them() {
    use crate::cpu::layered::{self, Assignment};
    use crate::cpu::paths::{PathFragment, PathFragments};
    let cloud = Cloud::lattice(10, 4.0);
    // 0.3 for each 0.5 at any density above 0.1; 1.2 deep between the planes, everywhere within the lattice.
    let scenery = scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 0.5, vec![]);
    let (width, height, red) = (33, 21, [1.0, 0.25, 0.0]);
    let path = |depth: f64, alpha: f32| PathFragment { depth: depth as f32, color: red, alpha };
    for (resolution, projection) in
        [(1.0, Projection::Orthographic { height: 1.2 }), (0.5, Projection::Perspective { fov_y: 0.3 })]
    {
        let view = look(DVec3::new(0.0, 0.0, 3.0), projection, width, height);
        let options = VolumeOptions {
            grid: GridOptions { resolution, lambda: true },
            near: Some(2.4),
            far: Some(3.6),
            ..VolumeOptions::default()
        };
        let draw = |fragments: &[PathFragment]| {
            let paths = PathFragments::everywhere([width as usize, height as usize], fragments);
            let volume = draw_with_paths(&view, &[cloud.batch()], &scenery, &options, Some(&paths)).unwrap().0;
            let way = (16, Assignment::Kernel, scenery.termination);
            let layers =
                layered::draw_with_paths(&view, &[cloud.batch()], &scenery.classifier, way, &options, Some(&paths));
            // In the middle, where rays go straight through.
            [volume, layers.unwrap().0].map(|colors| colors.rgba[10 * 33 + 16])
        };
        let through = |depth: f64| 0.7f64.powf((depth.clamp(2.4, 3.6) - 2.4) / 0.5) as f32;
        for (kind, alone) in draw(&[]).into_iter().enumerate() {
            assert!((alone[3] - (1.0 - through(3.6))).abs() < 3e-4, "{kind}: {alone:?}");
            let white = [0, 1, 2].map(|k| alone[k] / alone[3]);
            for depth in [1.5, 2.4, 2.41, 2.77, 3.0, 3.0123, 3.59, 3.6, 7.0] {
                let (found, share) = (draw(&[path(depth, 1.0)])[kind], through(depth));
                for k in 0..3 {
                    let light = share * red[k] + (1.0 - share) * white[k];
                    assert!((found[k] - light).abs() <= 1e-3, "{kind} {depth}: {found:?} {light}");
                }
                assert!((found[3] - 1.0).abs() <= 1e-3, "{kind} {depth}: {found:?}");
            }
            // Several that are half transparent, two of them in one cell.
            let all = [1.0, 2.8, 2.8001, 3.3, 9.0].map(|depth| path(depth, 0.5));
            let found = draw(&all)[kind];
            let (mut light, mut open, mut at) = ([0.0f32; 3], 1.0, 1.0);
            let mut pass = |next: f64, alpha: f32| {
                let share = through(next) / through(at);
                (0..3).for_each(|k| light[k] += open * ((1.0 - share) * white[k] + share * alpha * red[k]));
                (open, at) = (open * share * (1.0 - alpha), next);
            };
            all.iter().for_each(|path| pass(f64::from(path.depth), path.alpha));
            assert!((0..3).all(|k| (found[k] - light[k]).abs() <= 1e-3), "{kind}: {found:?} {light:?}");
            assert!((found[3] - (1.0 - open)).abs() <= 1e-3, "{kind}: {found:?} {open}");
        }
    }
}

pub(in crate::cpu) fn difference(a: &Colors, b: &Colors) -> f32 {
    let pairs = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn bricks_are_left_out_only_where_none_around_them_shows() {
    let (cloud, view, _) = merger_scene();
    let options = VolumeOptions::default();
    let prepared = prepare(&view, &[cloud.batch()], &options).unwrap();
    assert!(prepared.levels.len() > 2);
    let [columns, rows, layers] = prepared.brick_grid().bricks;
    let with = |least: f32, thickness: usize| -> Vec<_> {
        let mut resampler = Resampler::new(&prepared, options.kernel).showing_above(least);
        let slabs = (0..layers).step_by(thickness).map(|first| first..(first + thickness).min(layers));
        slabs.flat_map(|layers| resampler.resample(layers, &[]).0).collect()
    };
    let all = with(0.0, layers);
    let count = |layers: &[bricks::Layer]| layers.iter().flatten().flatten().count();
    for (least, thickness) in [(1e-7, layers), (1e-7, 3), (1e-6, 5), (1e-5, layers)] {
        let some = with(least, thickness);
        for (place, brick) in
            all.iter().flatten().enumerate().filter_map(|(place, brick)| Some((place, brick.as_ref()?)))
        {
            let at = [place % columns, place / columns % rows, place / columns / rows];
            if brick.densest <= least {
                continue;
            }
            let near = |axis: usize, count: usize| at[axis].saturating_sub(1)..(at[axis] + 2).min(count);
            for (z, y, x) in near(2, layers)
                .flat_map(|z| near(1, rows).map(move |y| (z, y)))
                .flat_map(|(z, y)| near(0, columns).map(move |x| (z, y, x)))
            {
                let [found, expected] = [&some, &all].map(|layers| layers[z][y * columns + x].as_ref());
                let cells =
                    |brick: Option<&bricks::Brick>| brick.map(|brick| (brick.density.clone(), brick.weighted.clone()));
                assert!(
                    cells(found) == cells(expected),
                    "{x} {y} {z} beside {at:?}, above {least} in layers of {thickness}"
                );
            }
        }
        println!("above {least}, {thickness} layers at once: {} of {} bricks", count(&some), count(&all));
        assert!(count(&some) < count(&all));
    }
}

fn merger_scene() -> (Cloud, View, Scenery) {
    let surface = |value, opacity, color| Surface { value, color, opacity };
    let surfaces =
        vec![surface(1e-6, 0.3, Some([0.9, 0.3, 0.1])), surface(1e-5, 0.5, None), surface(1e-4, 0.9, Some([1.0; 3]))];
    let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, surfaces);
    let mut cloud = merger(20_000);
    // And a few that coarser grids take.
    for at in [-20.0, 0.0, 25.0] {
        cloud.push([at, 0.5 * at, 10.0], 60.0, 0.05, 0.4);
    }
    (cloud, perspective(DVec3::new(60.0, 40.0, 90.0), 120, 80), scenery)
}

#[test]
fn slabs_change_nothing() {
    let (cloud, view, scenery) = merger_scene();
    let with = |memory, resolution| {
        let grid = GridOptions { resolution, lambda: true };
        draw(&view, &[cloud.batch()], &scenery, &VolumeOptions { memory, grid, ..VolumeOptions::default() }).unwrap()
    };
    for resolution in [1.0, 0.5] {
        let (whole, one) = with(1 << 32, resolution);
        let (parts, many) = with(0, resolution);
        assert!(one.slabs == 1 && many.slabs >= 10, "{} {}", one.slabs, many.slabs);
        assert!(one.crossings > Some(1000) && one.samples > Some(10_000), "{one:?}");
        assert!(difference(&whole, &parts) < 1e-6, "{}", difference(&whole, &parts));
        let brightest = whole.rgba.as_flattened().iter().fold(0.0f32, |a, &b| a.max(b));
        assert!(brightest > 0.5);
    }
}

#[test]
fn occlusion_changes_nothing() {
    // An opaque cube in the middle of the picture, before and beside other matter.
    let mut cloud = Cloud::lattice(16, 2.0);
    let mut random = Random::new(4, 4);
    for _ in 0..2000 {
        let place = [6.0 * random.signed(), 6.0 * random.signed(), -2.0 - 4.0 * random.uniform()];
        cloud.push(place, 0.5, 0.02, random.uniform() as f32);
    }
    let surface = Surface { value: 0.7, color: None, opacity: 0.9 };
    let mut scenery = scenery(RAMP, [1e-3, 1.0], 0.3, vec![surface]);
    scenery.termination = 0.97;
    for (resolution, width, height) in [(1.0, 160, 120), (0.5, 300, 200)] {
        let view = perspective(DVec3::new(0.5, 0.2, 7.0), width, height);
        let with = |occlusion| {
            let grid = GridOptions { resolution, lambda: true };
            let options = VolumeOptions { memory: 0, occlusion, grid, ..VolumeOptions::default() };
            draw(&view, &[cloud.batch()], &scenery, &options).unwrap()
        };
        let ((shown, all), (culled, fewer)) = (with(false), with(true));
        assert_eq!(shown, culled);
        assert!(all.hidden == 0 && fewer.hidden > 0 && fewer.pairs < all.pairs, "{all:?} {fewer:?}");
    }
}

/// Rays that end at the first surface that covers find it where those do that see all.
#[test]
fn what_casts_shadows_covers_where_all_of_it_does() {
    let (cloud, view, mut scenery) = merger_scene();
    (scenery.volume, scenery.surfaces[1].opacity) = (false, 0.6);
    let depths = |scenery: &Scenery| {
        let (parts, report) = draw_in_parts(&view, &[cloud.batch()], scenery, &VolumeOptions::default()).unwrap();
        (covering_depths(&parts), report.crossings)
    };
    let casting = scenery.casting().unwrap();
    let ((all, of_all), (first, fewer)) = (depths(&scenery), depths(&casting));
    assert!(casting.surfaces.len() == 2 && fewer < of_all, "{fewer:?} {of_all:?}");
    for (all, first) in all.iter().zip(&first) {
        assert!(all == first || (all - first).abs() < 1e-5 * all, "{all} {first}");
    }
    assert!(all.iter().filter(|depth| depth.is_finite()).count() > 50);
    let faint = scenery.surfaces.iter().map(|surface| Surface { opacity: 0.49, ..*surface }).collect();
    assert!(Scenery { surfaces: faint, ..scenery.clone() }.casting().is_none());
}

#[test]
fn rays_that_end_early_lose_less_than_a_grey_level() {
    let (cloud, view, mut scenery) = merger_scene();
    let with = |scenery: &Scenery| draw(&view, &[cloud.batch()], scenery, &VolumeOptions::default()).unwrap().0;
    let whole = with(&scenery);
    scenery.termination = 0.999;
    assert!(difference(&whole, &with(&scenery)) < 1.0 / 255.0);
}

#[test]
fn threads_change_nothing() {
    let (cloud, view, scenery) = merger_scene();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| draw(&view, &[cloud.batch()], &scenery, &VolumeOptions::default()).unwrap().0)
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn a_surface_is_where_the_field_has_its_value() {
    // A ball of one kernel: the surface of half its peak is a sphere. Lit from the eye without ambient light, its brightness
    // is the cosine.
    let mut cloud = Cloud::default();
    cloud.push([0.0; 3], 1.0, 1.0, 1.0);
    let peak = Kernel::CubicSpline.value(0.0);
    let radius = (1..1000).map(|i| f64::from(i) / 1000.0).find(|&r| Kernel::CubicSpline.value(r) < 0.5 * peak).unwrap();
    let surface = Surface { value: 0.5 * peak as f32, color: Some([1.0; 3]), opacity: 1.0 };
    for projection in [Projection::Orthographic { height: 1.6 }, Projection::Perspective { fov_y: 0.5 }] {
        for resolution in [1.0, 0.5] {
            let view = look(DVec3::new(0.0, 0.0, 3.2), projection, 101, 101);
            let mut scenery = scenery(RAMP, [1e-2, 10.0], 1.0, vec![surface]);
            scenery.volume = false;
            scenery.light = Some(Light { ambient: 0.0, specular: 0.0, shininess: 1.0 });
            let options = VolumeOptions { grid: GridOptions { resolution, lambda: true }, ..VolumeOptions::default() };
            let (colors, _) = draw(&view, &[cloud.batch()], &scenery, &options).unwrap();
            let (mut wrong, mut squares, mut lit) = (0, 0.0, 0);
            for (index, pixel) in colors.rgba.iter().enumerate() {
                let focal = view.focal_pixels();
                let [x, y] = [(index % 101) as f64 - 50.0, 50.0 - (index / 101) as f64].map(|at| at / focal);
                let (origin, ray) = match projection {
                    Projection::Orthographic { .. } => (DVec3::new(x, y, -3.2), DVec3::Z),
                    Projection::Perspective { .. } => (DVec3::new(0.0, 0.0, -3.2), DVec3::new(x, y, 1.0).normalize()),
                };
                let along = origin.dot(ray);
                let root = along * along - origin.length_squared() + radius * radius;
                wrong += u32::from((root > 0.0) != (pixel[3] > 0.5));
                if root > 0.04 && pixel[3] > 0.5 {
                    let normal = (origin + (-along - root.sqrt()) * ray) / radius;
                    squares += (normal.dot(ray).abs() - f64::from(pixel[0])).powi(2);
                    lit += 1;
                }
            }
            let error = (squares / f64::from(lit)).sqrt();
            assert!(wrong < 60 && lit > 1000 && error < 0.01, "{projection:?} {resolution}: {wrong} {lit} {error}");
        }
    }
}

#[test]
fn surfaces_of_samples_face_as_the_body_that_was_sampled() {
    // A ball in bytes, whose border is a few samples wide, in cells of two thirds of a sample.
    let (middle, radius) = (DVec3::new(31.3, 31.6, 31.1), 20.3);
    let value = |i: usize| {
        let at = DVec3::new((i % 64) as f64, (i / 64 % 64) as f64, (i / 4096) as f64);
        (255.0 / (1.0 + ((at.distance(middle) - radius) / 0.75).exp())).round() as f32
    };
    let samples = Grid::volume([64; 3], SampleType::U8, Channel::numbered(1));
    let values: Vec<f32> = (0..64 * 64 * 64).map(value).collect();
    let field = Field::new(&samples, vec![("value".into(), Unit::default(), values)], None);
    let axis = ValueAxis::new(Scale::Linear, [0.0, 255.0]);
    let surface = Surface { value: axis.place(127.5), color: None, opacity: 1.0 };
    let eye = middle + 80.0 * DVec3::new(0.3, 0.5, 0.8).normalize();
    for projection in [Projection::Orthographic { height: 52.0 }, Projection::Perspective { fov_y: 0.8 }] {
        let view = View::look_at(eye, middle, DVec3::Y, projection, 80, 80).unwrap();
        let grid = PerspectiveGrid::new(&view, [50.0, 110.0], &GridOptions::default()).unwrap();
        let brick_grid = BrickGrid::new(&grid);
        let mut bricks = FieldBricks::new(&field, axis, &view, &grid, &brick_grid);
        let (layers, _) = bricks.fill(0..brick_grid.bricks[2], &[]);
        let slab = Slab { first: 0, layers };
        let mut block = Block::default();
        // By samples, and by differences of cells: the angles' squares and the largest, degrees.
        let (mut squares, mut largest, mut found) = ([0.0f64; 2], [0.0f64; 2], 0u32);
        for index in (0..80 * 80).step_by(7) {
            let [i, j]: [usize; 2] = [index % 80, index / 80];
            for step in 2..brick_grid.slices - 1 {
                let around = [0, 1, 2, 3].map(|slice: usize| slab.at([i, j, step - 2 + slice], &brick_grid)[0]);
                let crossings = Crossings::find(around, &[surface]);
                let Some(at) = crossings.iter().next().map(|crossing| crossing.at) else { continue };
                let place = [i as f64 + 0.5, j as f64 + 0.5];
                let hit = world(&view, grid.to_camera([place[0], place[1], step as f64 - 0.5 + f64::from(at)]));
                let [x, y] = [i + BORDER, j + BORDER];
                let layer = ((step + 1) / BRICK).min(brick_grid.bricks[2] - 1);
                assert!(block.fill(&slab, &brick_grid, [x / BRICK, y / BRICK, layer], 0.0));
                let cell = Place { x: x % BRICK + BEFORE, y: y % BRICK + BEFORE, shares: [0.0; 2] };
                let away = [0, 1].map(|axis: usize| (place[axis] - grid.middle[axis]) as f32);
                let z = step + FRONT - layer * BRICK;
                let by_samples = bricks.slope(place, step, at, surface.value).unwrap();
                let by_cells = gradient((&block, Numbers::Surfaces), &brick_grid, &cell, away, step, z, at);
                for (k, slope) in [by_samples, by_cells].into_iter().enumerate() {
                    let slope = DVec3::from_array(slope.map(f64::from));
                    let slope = slope.x * view.right + slope.y * view.up + slope.z * view.forward;
                    let angle = slope.angle_between(middle - hit).to_degrees();
                    squares[k] += angle * angle;
                    largest[k] = largest[k].max(angle);
                }
                found += 1;
            }
        }
        let [by_samples, by_cells] = squares.map(|square| (square / f64::from(found)).sqrt());
        println!("{found} places: {by_samples:.3} and {by_cells:.3} degrees, at most {largest:.3?}");
        assert!(found > 400 && by_samples < 0.25 && largest[0] < 0.7, "{by_samples} {largest:?}");
        assert!(by_cells > 0.6 && largest[1] > 1.5, "{by_cells} {largest:?}");
    }
}

#[test]
fn the_range_is_that_of_the_data() {
    let cloud = Cloud::lattice(24, 2.0);
    let view = perspective(DVec3::new(0.2, 0.1, 3.5), 300, 200);
    let range = range::measure(&view, &[cloud.batch()], &VolumeOptions::default()).unwrap();
    assert!((range.density[1] - 1.0).abs() < 0.1 && range.density[0] <= 0.01 * range.density[1], "{range:?}");
    assert!((-1.1..-0.7).contains(&range.attribute[0]) && (0.7..1.1).contains(&range.attribute[1]), "{range:?}");
}

#[test]
fn nothing_in_view_is_said() {
    let cloud = Cloud::lattice(3, 2.0);
    let view = View { forward: DVec3::Z, right: DVec3::NEG_X, ..perspective(DVec3::new(0.0, 0.0, 9.0), 30, 20) };
    let (_, _, scenery) = merger_scene();
    let error = draw(&view, &[cloud.batch()], &scenery, &VolumeOptions::default()).unwrap_err();
    assert!(error.to_string().contains("no particles are in view"), "{error}");
    assert!(draw(&view, &[], &scenery, &VolumeOptions::default()).is_err());
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
            let view = perspective(DVec3::new(0.5, 0.4, 1.0).normalize() * distance * size, 256, 192);
            let errors = compare(&view, &cloud, &VolumeOptions { kernel: dataset.kernel, ..EXACTLY }, 997);
            println!("{file} from {distance} sizes: {errors:?}");
            assert!(errors.samples > 1000 && errors.density < 1e-4 && errors.weighted < 1e-4, "{errors:?}");
        }
    }
}
