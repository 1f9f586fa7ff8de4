//! Volumes and isosurfaces by compute passes against the CPU ray caster: the same particles, grid and settings.

use crate::clouds::{Cloud, Renderer, difference, look, near, renderer};
use crate::support::{alone, built, demo, view_of};
use deepfield::codec::VqBits;
use deepfield::color::Colors;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::volume::extents::planes_and_widest;
use deepfield::cpu::volume::range;
use deepfield::cpu::volume::{
    Classifier, FieldRange, Light, Scenery, VolumeLevels, VolumeOptions, VolumeReport, draw, prepare,
};
use deepfield::gpu::volume::Shows;
use deepfield::gpu::{DeviceOptions, LightView, Offscreen, VolumeFindings, VolumeJob, VolumeView, Withheld};
use deepfield::hierarchy::Purpose;
use deepfield::look::LookPatch;
use deepfield::mode::{Adapter, Depiction, Needs, Plan, SettingValue, Settings};
use deepfield::model::{Bounds, Kernel};
use deepfield::modes;
use deepfield::picture::Subject;
use deepfield::picture::adapter::{Adapter as _, AdapterJob, AdapterValues, Passes};
use deepfield::picture::decode::decoded_nodes;
use deepfield::picture::look::transfer_of;
use deepfield::stream::Scene;
use deepfield::view::perspective_grid::GridOptions;
use deepfield::view::{Extent, Occluder, Projection, View};
use glam::DVec3;
use std::sync::Arc;

fn on_cpu(view: &View, cloud: &Cloud, scenery: &Scenery, options: &VolumeOptions) -> (Colors, VolumeReport) {
    draw(view, &[cloud.batch()], scenery, options).unwrap()
}

/// Against the CPU renderer, which brings wide particles to coarser grids too.
fn compare(
    renderer: &mut Renderer,
    view: &View,
    cloud: &Cloud,
    scenery: &Scenery,
    options: &VolumeOptions,
    what: &str,
) {
    compare_with(&on_cpu(view, cloud, scenery, options), renderer.draw(view, cloud, scenery, options), what);
}

fn compare_with((expected, counted): &(Colors, VolumeReport), (found, report): (Colors, VolumeFindings), what: &str) {
    let (l2, most) = difference(&found, expected);
    println!("{what}: L2 {l2:.2e}, at most {most:.2e}, {} slabs, {} pairs", report.slabs[1], report.pairs);
    assert!(l2 < 5e-5, "{what}: L2 {l2}, at most {most}");
    let (raised, wanted) = (report.raised, counted.raised);
    println!("{what}: {raised} raised, {wanted} by the CPU");
    // Some lie right at a side of the picture, or are right as large as the grid wants them.
    assert!(raised.abs_diff(wanted) <= 1 + wanted / 1000, "{what}: {raised} raised, {wanted} by the CPU");
}

#[test]
fn regions_of_density_and_attribute_are_the_cpus() {
    let mut renderer = renderer();
    let cloud = Cloud::merger(20_000);
    let plane = "(plane: (opacity: 0.2, brightness: 0.6, regions: [ \
                 (at: (0.6, 0.3), radius: (0.3, 0.25), opacity: 4.0, color: \"#30ff60\"), \
                 (at: (0.8, 0.7), radius: (0.2, 0.4), soft: 1.0, opacity: 2.0)]))";
    let plane = TransferFunction::parse(plane, "plane").unwrap().plane;
    let transfer = TransferFunction { plane, ..TransferFunction::of_volumes(true) };
    let levels = VolumeLevels { density: cloud.density, attribute: cloud.range, unit_length: cloud.unit };
    let planar = Scenery { classifier: Classifier::new(&transfer, levels, true), ..cloud.volume() };
    let (view, options) = (near([2.0, 1.0, 3.0], 96, 72), VolumeOptions::default());
    let [with, without] = [&planar, &cloud.volume()].map(|scenery| on_cpu(&view, &cloud, scenery, &options).0);
    assert!(difference(&with, &without).0 > 0.1, "the regions do not show");
    // A value between two hues may be rounded to either.
    let (found, _) = renderer.draw(&view, &cloud, &planar, &options);
    let (l2, most) = difference(&found, &with);
    println!("regions: L2 {l2:.2e}, at most {most:.2e}");
    assert!(l2 < 2e-4, "regions: L2 {l2}, at most {most}");
}

#[test]
fn volumes_are_the_cpus() {
    let mut renderer = renderer();
    let options = VolumeOptions::default();
    let one = Cloud::one();
    compare(&mut renderer, &near([0.5, 0.3, 3.0], 64, 48), &one, &one.volume(), &options, "one particle");
    let lattice = Cloud::lattice(12);
    for kernel in Kernel::ALL {
        let options = VolumeOptions { kernel, ..options };
        let view = near([1.5, 1.3, 3.6], 96, 64);
        compare(&mut renderer, &view, &lattice, &lattice.volume(), &options, &format!("lattice, {kernel:?}"));
    }
    let flat = look(DVec3::new(1.0, 2.0, 3.0), Projection::Orthographic { height: 3.0 }, 70, 70);
    compare(&mut renderer, &flat, &lattice, &lattice.volume(), &options, "lattice, orthographic");
    let merger = Cloud::merger(6_000);
    for resolution in [1.0, 0.5, 1.0 / 3.0] {
        let options = VolumeOptions { grid: GridOptions { resolution, lambda: true }, ..options };
        let view = near([25.0, 18.0, 40.0], 150, 101);
        compare(
            &mut renderer,
            &view,
            &merger,
            &merger.volume(),
            &options,
            &format!("merger at resolution {resolution}"),
        );
    }
    // As adapters draw that are not the processor in disguise.
    let withheld = Withheld { subgroup: true, ..Withheld::default() };
    let mut other = Renderer::open(&DeviceOptions { withheld, ..DeviceOptions::default() });
    let view = near([25.0, 18.0, 40.0], 90, 70);
    compare(&mut other, &view, &merger, &merger.volume(), &options, "merger without subgroups");
    // Some particles are larger than the picture, and the eye is within them.
    let options = VolumeOptions { near: Some(2.0), far: Some(60.0), ..options };
    compare(&mut renderer, &near([6.0, 4.0, 9.0], 80, 60), &merger, &merger.volume(), &options, "within the merger");
}

#[test]
fn wide_kernels_go_to_the_cpus_coarser_grids() {
    let mut renderer = renderer();
    let cloud = Cloud::wide(600);
    let options = VolumeOptions::default();
    let view = near([1.5, 1.3, 3.6], 160, 120);
    let prepared = prepare(&view, &[cloud.batch()], &options).unwrap();
    let mut of_level = vec![0; prepared.levels.len()];
    let bodies = (0..prepared.particles.chunks.len()).flat_map(|chunk| prepared.particles.bodies(chunk));
    bodies.for_each(|body| of_level[prepared.level_of(&body)] += 1);
    println!("particles of each level: {of_level:?}");
    assert!(of_level.len() >= 4 && of_level.iter().all(|particles| *particles > 0), "{of_level:?}");
    let volume = cloud.volume();
    let drawn = on_cpu(&view, &cloud, &volume, &options);
    let of_volume = |renderer: &mut Renderer, what: &str| {
        compare_with(&drawn, renderer.draw(&view, &cloud, &volume, &options), what);
    };
    of_volume(&mut renderer, "wide kernels");
    let surfaces = cloud.surfaces(true, [0.2, 0.4, 1.0]);
    compare(&mut renderer, &view, &cloud, &surfaces, &options, "surfaces of wide kernels");
    for scenery in [&volume, &surfaces] {
        // Thin slabs read layers of coarser grids that slabs before them have filled.
        let thin = VolumeOptions { memory: 1, ..options };
        compare(&mut renderer, &view, &cloud, scenery, &thin, "wide kernels in thin slabs");
    }
    let within = VolumeOptions { near: Some(0.05), far: Some(4.0), ..options };
    // The eye is within all of them: the picture is dim, and interpolation rounds otherwise.
    let inside = near([0.3, 0.2, 0.6], 90, 70);
    let (found, _) = renderer.draw(&inside, &cloud, &cloud.volume(), &within);
    let (l2, most) = difference(&found, &on_cpu(&inside, &cloud, &cloud.volume(), &within).0);
    assert!(l2 < 3e-4 && most < 5e-5, "within wide kernels: L2 {l2}, at most {most}");
    let plain = Cloud { attribute: None, ..Cloud::wide(600) };
    let flat = look(DVec3::new(1.0, 2.0, 3.0), Projection::Orthographic { height: 3.0 }, 110, 90);
    compare(&mut renderer, &flat, &plain, &plain.volume(), &options, "wide kernels, orthographic");
    let withheld = Withheld { subgroup: true, ..Withheld::default() };
    let mut other = Renderer::open(&DeviceOptions { withheld, ..DeviceOptions::default() });
    of_volume(&mut other, "wide kernels without subgroups");

    // Windows of the picture, each with its own part of every grid.
    let limits =
        wgpu::Limits { max_storage_buffer_binding_size: 1 << 20, max_buffer_size: 1 << 20, ..Default::default() };
    let mut small = Renderer::open(&DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() });
    of_volume(&mut small, "wide kernels in windows");
}

#[test]
fn crowded_bricks_lose_nothing() {
    // More than a brick lists at a time, and than it gathers in a turn, with and without subgroups.
    let (crowd, options) = (Cloud::crowd(36_000), VolumeOptions::default());
    let view = near([0.5, 0.3, 3.0], 64, 48);
    compare(&mut renderer(), &view, &crowd, &crowd.volume(), &options, "a crowd");
    let withheld = Withheld { subgroup: true, ..Withheld::default() };
    let mut other = Renderer::open(&DeviceOptions { withheld, ..DeviceOptions::default() });
    compare(&mut other, &view, &crowd, &crowd.volume(), &options, "a crowd without subgroups");
}

#[test]
fn surfaces_are_the_cpus() {
    let mut renderer = renderer();
    let options = VolumeOptions::default();
    let one = Cloud::one();
    let view = near([0.5, 0.3, 3.0], 64, 48);
    compare(&mut renderer, &view, &one, &one.surfaces(false, [0.3, 0.5, 1.0]), &options, "one particle");
    let merger = Cloud::merger(6_000);
    for resolution in [1.0, 0.5] {
        let options = VolumeOptions { grid: GridOptions { resolution, lambda: true }, ..options };
        let view = near([25.0, 18.0, 40.0], 90, 70);
        for volume in [false, true] {
            let what = format!("merger at resolution {resolution}, with volume: {volume}");
            compare(&mut renderer, &view, &merger, &merger.surfaces(volume, [0.2, 0.4, 1.0]), &options, &what);
        }
        let dark = Scenery { light: None, ..merger.surfaces(false, [0.2, 0.4, 1.0]) };
        compare(&mut renderer, &view, &merger, &dark, &options, "without light");
    }
}

#[test]
fn smoothed_surfaces_are_the_cpus() {
    let merger = Cloud::merger(6_000);
    let scenery = merger.surfaces(false, [0.2, 0.4, 1.0]);
    let eye = DVec3::new(25.0, 18.0, 40.0);
    let mut limits = wgpu::Limits { max_storage_buffer_binding_size: 1 << 20, ..wgpu::Limits::default() };
    limits.max_buffer_size = limits.max_storage_buffer_binding_size;
    let small = DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() };
    let (mut renderer, mut windows) = (renderer(), Renderer::open(&small));
    for projection in [Projection::Perspective { fov_y: 0.8 }, Projection::Orthographic { height: 36.0 }] {
        let view = look(eye, projection, 90, 70);
        let plain = on_cpu(&view, &merger, &scenery, &VolumeOptions::default()).0;
        // From the first directions to the others, and back.
        for smoothing in [1, 6] {
            let options = VolumeOptions { smoothing, ..VolumeOptions::default() };
            let expected = on_cpu(&view, &merger, &scenery, &options).0;
            let (changed, _) = difference(&expected, &plain);
            let found = renderer.draw(&view, &merger, &scenery, &options).0;
            let (l2, most) = difference(&found, &expected);
            println!("{projection:?}, {smoothing} steps: L2 {l2:.2e}, at most {most:.2e}, changed by {changed:.2e}");
            // Where pixels are just about of one surface rounding decides.
            assert!(l2 < 2e-3 && l2 < 0.2 * changed, "{projection:?}, {smoothing} steps: L2 {l2} of {changed}");

            // In slabs and windows, each projection once.
            if (smoothing > 1) == matches!(projection, Projection::Perspective { .. }) {
                let (parts, report) = windows.draw(&view, &merger, &scenery, &options);
                assert!(report.slabs[1] > 1);
                let (l2, most) = difference(&parts, &found);
                assert!(l2 < 1e-4, "{projection:?}, windows: L2 {l2}, at most {most}");
            }
        }
    }
}

#[test]
fn lit_volumes_are_the_cpus() {
    let mut renderer = renderer();
    let merger = Cloud::merger(6_000);
    let view = near([25.0, 18.0, 40.0], 90, 70);
    let volume_light = Some(Light { ambient: 0.12, specular: 0.15, shininess: 40.0 });
    for (resolution, surfaces) in [(1.0, false), (0.5, false), (1.0, true)] {
        let options = VolumeOptions { grid: GridOptions { resolution, lambda: true }, ..VolumeOptions::default() };
        let plain = if surfaces { merger.surfaces(true, [0.2, 0.4, 1.0]) } else { merger.volume() };
        let lit = Scenery { volume_light, ..plain.clone() };
        let [without, with] = [&plain, &lit].map(|scenery| on_cpu(&view, &merger, scenery, &options).0);
        assert!(difference(&with, &without).0 > 0.02, "light does not show");
        let (l2, most) = difference(&renderer.draw(&view, &merger, &lit, &options).0, &with);
        println!("resolution {resolution}, with surfaces: {surfaces}: L2 {l2:.2e}, at most {most:.2e}");
        // Where a gradient is next to nothing its direction is that of rounding.
        assert!(l2 < 5e-4, "resolution {resolution}, with surfaces: {surfaces}: L2 {l2}, at most {most}");
    }
}

#[test]
fn slabs_windows_and_batches_change_nothing() {
    let merger = Cloud::merger(20_000);
    let view = near([25.0, 18.0, 40.0], 140, 100);
    let scenery = merger.surfaces(true, [0.2, 0.4, 1.0]);
    let grid = GridOptions { resolution: 0.5, lambda: false };
    let with = |memory| VolumeOptions { memory, grid, ..VolumeOptions::default() };
    let mut renderer = renderer();
    let (one, whole) = renderer.draw(&view, &merger, &scenery, &with(1 << 30));
    let (again, _) = renderer.draw(&view, &merger, &scenery, &with(1 << 30));
    assert_eq!(one, again, "the same to the last bit");
    let (many, thin) = renderer.draw(&view, &merger, &scenery, &with(1));
    assert!(whole.slabs[1] == 1 && thin.slabs[1] > 5, "{:?} {:?}", whole.slabs, thin.slabs);
    let (l2, most) = difference(&many, &one);
    println!("slabs: {l2} {most} {:?}", thin.slabs);
    assert!(l2 < 1e-5 && most < 1e-3, "slabs: {l2} {most}");

    // Cells of half the picture fit, and 16384 particles.
    let mut limits = wgpu::Limits { max_storage_buffer_binding_size: 1 << 19, ..wgpu::Limits::default() };
    limits.max_buffer_size = limits.max_storage_buffer_binding_size;
    let small = DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() };
    let (parts, report) = Renderer::open(&small).draw(&view, &merger, &scenery, &with(1 << 30));
    assert!(report.slabs[1] >= 2 * thin.slabs[1], "{:?}", report.slabs);
    let (l2, most) = difference(&parts, &one);
    println!("windows and batches: {l2} {most} {:?}", report.slabs);
    assert!(l2 < 1e-5 && most < 1e-3, "windows and batches: {l2} {most}");
}

/// One of 16^3 cubes around the origin.
fn cube(index: i32) -> Extent {
    let min = DVec3::new(f64::from(index % 16), f64::from(index / 16 % 16), f64::from(index / 256)) * 2.0 - 16.0;
    Extent { bounds: Bounds { min, max: min + 1.0 }, margin: 0.1 }
}

#[test]
fn what_is_hidden_is_left_out_and_changes_nothing() {
    let merger = Cloud::merger(20_000);
    let view = near([25.0, 18.0, 40.0], 100, 72);
    let mut renderer = renderer();
    for (scenery, what) in [(merger.surfaces(false, [1.0; 3]), "surfaces"), (merger.volume(), "volume")] {
        let with = |occlusion| VolumeOptions { memory: 1, occlusion, ..VolumeOptions::default() };
        let (all, more) = renderer.draw(&view, &merger, &scenery, &with(false));
        let (culled, less) = renderer.draw(&view, &merger, &scenery, &with(true));
        println!("{what}: {} pairs, culled {}", more.pairs, less.pairs);
        assert_eq!(all, culled, "{what}");
        // What streaming may leave out is what the CPU's picture hides.
        let (_, expected) = on_cpu(&view, &merger, &scenery, &with(true));
        let [found, expected] = [less.opaque.as_ref().map(|(_, opaque)| &**opaque), expected.opaque.as_deref()];
        let [found, expected] = [found, expected].map(Option::unwrap);
        let extents: Vec<Extent> = (0..16i32.pow(3)).map(cube).collect();
        let [found, expected] =
            [found, expected].map(|opaque| extents.iter().map(|at| opaque.hides(at)).collect::<Vec<_>>());
        let differ = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
        let hidden = found.iter().filter(|hidden| **hidden).count();
        println!("{what}: {hidden} cubes hidden, {differ} otherwise than by the CPU");
        assert!(hidden > 0 && differ <= hidden / 50, "{what}: {hidden} {differ}");
        assert!(more.opaque.is_none() && less.pairs < more.pairs, "{what}: {} {}", more.pairs, less.pairs);
    }
}

#[test]
fn the_demo_data_look_as_on_the_cpu() {
    alone("volumes::the_demo_data_look_as_on_the_cpu", || {
        let built = built(&demo(), VqBits::Eight);
        let metadata = built.file.metadata();
        let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 120, 80);
        let mut adapter = Offscreen::default();
        for mode in modes::all().into_iter().filter(|mode| mode.technique.adapter() == Adapter::Light) {
            let mut settings = Settings::default();
            // A driver without a card takes a minute for 128 layers.
            for (name, fewer) in [("layers", 8.0), ("cells", 96.0)] {
                if mode.own_settings().any(|setting| setting.name == name) {
                    settings.0.insert(name.into(), SettingValue::Number(fewer));
                }
            }
            let depiction = Depiction::new(mode, settings, None, metadata).unwrap();
            let selection = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap();
            let transfer = transfer_of(&LookPatch::default(), &depiction);
            let subject = Subject::new(metadata, &depiction, &transfer, metadata.bounds().size().length());
            let (plan, nodes) = (Plan::default(), &selection.nodes);
            let before = decoded_nodes();
            let job = AdapterJob {
                view: &view,
                depiction: &depiction,
                metadata,
                nodes,
                plan: &plan,
                passes: Passes::Compute,
                light: None,
                repeat: 1,
            };
            let light = subject.light(&view, &mut |options| adapter.ranges(&job, options)).unwrap().unwrap();
            let frame = adapter.draw(&AdapterJob { light: Some(&light), ..job }).unwrap();
            assert_eq!(decoded_nodes(), before, "{}: the adapter alone loads particles", mode.name);
            let AdapterValues::Light(found, _) = frame.values else { panic!("{}: no light", mode.name) };
            let drawn = subject.draw_nodes(&view, nodes, &plan).unwrap().light(mode).unwrap();
            // Ranges are those of the processor's sketch but for rounding at the borders of its classes.
            for (found, expected) in
                [(light.levels.density, drawn.levels.density), (light.levels.attribute, drawn.levels.attribute)]
            {
                for (a, b) in found.iter().zip(expected) {
                    assert!((a - b).abs() <= 0.02 * b.abs(), "{}: {found:?} {expected:?}", mode.name);
                }
            }
            let (l2, most) = difference(&found, &drawn.colors);
            println!("{}: L2 {l2:.2e}, at most {most:.2e}", mode.name);
            // On the silhouettes of spheres a pixel may show one or the other.
            let Needs { purpose, of_data, .. } = mode.technique.needs(&Settings::default());
            let bound = match purpose == Purpose::Samples || of_data {
                true => 5e-5,
                false => 2e-2,
            };
            assert!(l2 < bound, "{}: {l2} {most}", mode.name);
        }
    });
}

#[test]
fn ranges_are_those_of_the_processors_sketch() {
    let mut renderer = renderer();
    let options = VolumeOptions::default();
    for cloud in [Cloud::merger(20_000), Cloud::merger(600_000), Cloud::lattice(12)] {
        for view in [near([25.0, 18.0, 40.0], 300, 200), near([6.0, 4.0, 9.0], 80, 120)] {
            let expected = range::measure(&view, &[cloud.batch()], &options).unwrap();
            let found = renderer.ranges(&view, &cloud, &options).unwrap();
            println!("{found:?} {expected:?}");
            let pairs = |of: fn(&FieldRange) -> [f64; 2]| of(&found).into_iter().zip(of(&expected));
            for (a, b) in pairs(|range| range.density).chain(pairs(|range| range.attribute)) {
                // A class is 1/64 of an octave wide, and what wide particles add is interpolated by the processor.
                assert!((a - b).abs() <= 0.035 * b.abs(), "{found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn volumes_work_within_their_budget() {
    let merger = Cloud::merger(200_000);
    let view = near([25.0, 18.0, 40.0], 200, 150);
    let (mut renderer, options) = (renderer(), VolumeOptions::default());
    let (whole, most) = renderer.draw(&view, &merger, &merger.volume(), &options);
    let mut small = Renderer { memory: 24 << 20, ..Renderer::open(&DeviceOptions::default()) };
    let (thin, least) = small.draw(&view, &merger, &merger.volume(), &options);
    println!("{} and {} bytes, {:?} and {:?} slabs", most.bytes, least.bytes, most.slabs, least.slabs);
    assert!(most.bytes > 40 << 20 && least.bytes < 24 << 20, "{} {}", most.bytes, least.bytes);
    assert!(least.slabs[1] > most.slabs[1], "{:?} {:?}", most.slabs, least.slabs);
    let (l2, largest) = difference(&thin, &whole);
    assert!(l2 < 1e-5, "{l2} {largest}");
}

#[test]
fn a_device_that_is_lost_between_slabs_is_an_error_and_the_next_one_draws() {
    let cloud = Cloud::lattice(12);
    let view = near([1.2, 0.9, 2.4], 64, 48);
    let options = VolumeOptions { memory: 1 << 20, ..VolumeOptions::default() };
    let mut lost = renderer();
    lost.memory = 1 << 20;
    lost.number += 1;
    let extents = lost.load(&view, &cloud);
    let (grid, _) = planes_and_widest(&view, extents.iter().copied(), &options).unwrap();
    let shows = Shows::Light(Arc::new(cloud.volume()));
    let job = VolumeJob { number: 1, view, grid, options, stride: 1, shows, covers: false };
    let volume = VolumeView { slabs: 1, ..lost.view(&cloud, extents, job) };
    lost.renderer.insert((LightView::default(), volume));
    let done = |renderer: &Renderer| renderer.renderer.volume_findings().slabs;
    while done(&lost)[0] == 0 {
        lost.renderer.frame().unwrap();
    }
    let [before, all] = done(&lost);
    assert!(before < all, "{before} of {all} slabs: the device is to be lost between them");
    lost.renderer.device().0.wgpu_device().destroy();
    let error = (0..4).find_map(|_| lost.renderer.frame().err()).expect("frames on a lost device are errors");
    assert!(error.to_string().contains("64x48 pixels"), "{error}");
    drop(lost);
    let (found, _) = renderer().draw(&view, &cloud, &cloud.volume(), &options);
    let (l2, _) = difference(&found, &on_cpu(&view, &cloud, &cloud.volume(), &options).0);
    assert!(l2 < 1e-2, "{l2}");
}
