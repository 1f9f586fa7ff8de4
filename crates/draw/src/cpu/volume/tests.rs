//! The whole way of a volume: analytic cases, and what must not change a picture; fields against exact sums, and surfaces.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod fields;
mod surfaces;

use super::*;
use crate::color::transfer::TransferFunction;
use crate::cpu::shadowing::covering_depths;
use crate::cpu::{Extent, Positions};
use crate::model::{Dataset, Family};
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

fn world(view: &View, camera: DVec3) -> DVec3 {
    view.eye + camera.x * view.right + camera.y * view.up + camera.z * view.forward
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
