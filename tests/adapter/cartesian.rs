//! Cartesian grids by compute passes against the processor: the same particles, box, cells and rays.

use crate::clouds::{Cloud, Renderer, difference, look, near, renderer};
use deepfield::color::Colors;
use deepfield::cpu::cartesian::{self, CartesianOptions, Region};
use deepfield::cpu::volume::{Scenery, VolumeOptions, VolumeReport};
use deepfield::gpu::GpuError;
use deepfield::mode::LightPasses;
use deepfield::view::{Projection, View};
use glam::DVec3;

/// Room for any of these grids.
const MEMORY: u64 = 1 << 30;

fn grid(cells: u32, region: Region) -> CartesianOptions {
    CartesianOptions { cells, region, memory: MEMORY }
}

fn on_cpu(view: &View, cloud: &Cloud, scenery: &Scenery, laid: &CartesianOptions) -> (Colors, VolumeReport) {
    cartesian::draw(view, &[cloud.batch()], scenery, laid, &VolumeOptions::default()).unwrap()
}

fn on_adapter(
    renderer: &mut Renderer,
    view: &View,
    cloud: &Cloud,
    scenery: &Scenery,
    laid: &CartesianOptions,
    options: &VolumeOptions,
) -> Result<(Colors, usize), GpuError> {
    let passes = LightPasses::Cartesian(scenery.clone(), *options, *laid);
    renderer.pass(view, cloud, &passes).map(|(colors, found)| (colors, found.slabs[1]))
}

/// The flat view of a perspective one.
fn flat(eye: [f64; 3], height: f64, width: u32, rows: u32) -> View {
    look(DVec3::from_array(eye), Projection::Orthographic { height }, width, rows)
}

#[test]
fn grids_are_resampled_and_marched_as_on_the_processor() {
    let mut renderer = renderer();
    let merger = Cloud::merger(20_000);
    let mut plain = Cloud::merger(20_000);
    plain.attribute = None;
    let views = [
        ("from outside", near([25.0, 18.0, 40.0], 120, 90)),
        ("from afar", look(DVec3::new(2.5e4, 1.8e4, 4e4), Projection::Perspective { fov_y: 8e-4 }, 90, 120)),
        ("from within", near([2.0, 1.0, 3.0], 96, 72)),
        ("parallel", flat([20.0, 14.0, 35.0], 24.0, 101, 72)),
        ("along an axis", flat([0.0, 0.0, 40.0], 24.0, 64, 64)),
    ];
    for (from, view) in &views {
        for region in [Region::View, Region::Data] {
            for (of, cloud) in [("attribute", &merger), ("density", &plain)] {
                for (what, scenery) in [
                    ("volume", cloud.volume()),
                    ("surfaces", cloud.surfaces(false, [0.2, 0.4, 1.0])),
                    ("both", cloud.surfaces(true, [0.2, 0.4, 1.0])),
                ] {
                    let laid = grid(70, region);
                    let (expected, _) = on_cpu(view, cloud, &scenery, &laid);
                    let options = VolumeOptions::default();
                    let (found, _) = on_adapter(&mut renderer, view, cloud, &scenery, &laid, &options).unwrap();
                    let (l2, most) = difference(&found, &expected);
                    println!("{what} of {of}, {from}, {region:?}: L2 {l2:.2e}, at most {most:.2e}");
                    // A value between two hues may be rounded to either.
                    let bound = if cloud.attribute.is_some() { 3e-4 } else { 6e-5 };
                    assert!(l2 < bound, "{what} of {of}, {from}, {region:?}: L2 {l2}, at most {most}");
                }
            }
        }
    }
}

#[test]
fn wide_particles_reach_all_of_a_grid() {
    let mut renderer = renderer();
    let wide = Cloud::wide(400);
    let view = near([2.5, 1.8, 4.0], 100, 80);
    for cells in [24, 100] {
        let (scenery, laid) = (wide.surfaces(true, [0.2, 0.4, 1.0]), grid(cells, Region::View));
        let (expected, _) = on_cpu(&view, &wide, &scenery, &laid);
        let (found, _) = on_adapter(&mut renderer, &view, &wide, &scenery, &laid, &VolumeOptions::default()).unwrap();
        let (l2, most) = difference(&found, &expected);
        println!("{cells} cells: L2 {l2:.2e}, at most {most:.2e}");
        assert!(l2 < 5e-5, "{cells} cells: L2 {l2}, at most {most}");
    }
}

#[test]
fn slabs_of_a_grid_change_nothing() {
    let mut renderer = renderer();
    let merger = Cloud::merger(20_000);
    let view = near([25.0, 18.0, 40.0], 100, 72);
    let (scenery, laid) = (merger.surfaces(true, [0.2, 0.4, 1.0]), grid(90, Region::Data));
    let mut with = |memory: u64| {
        let options = VolumeOptions { memory, ..VolumeOptions::default() };
        on_adapter(&mut renderer, &view, &merger, &scenery, &laid, &options).unwrap()
    };
    let (one, [whole, thin]) = (with(1 << 30), [with(1 << 30), with(1)]);
    assert!(one.1 == 1 && thin.1 > 5, "{} and {} slabs", one.1, thin.1);
    assert_eq!(one.0, whole.0, "the same to the last bit");
    let (l2, most) = difference(&thin.0, &one.0);
    println!("slabs: L2 {l2:.2e}, at most {most:.2e}");
    assert!(l2 < 1e-5 && most < 1e-3, "slabs: {l2} {most}");
}

#[test]
fn a_grid_that_is_held_is_not_filled_again() {
    let merger = Cloud::merger(20_000);
    let (here, there) = (near([25.0, 18.0, 40.0], 100, 72), near([-30.0, 18.0, 20.0], 64, 90));
    let laid = grid(64, Region::Data);
    let options = VolumeOptions { memory: 1, ..VolumeOptions::default() };
    let passes = |scenery, laid| LightPasses::Cartesian(scenery, options, laid);
    let (surfaces, volume) = (merger.surfaces(true, [0.2, 0.4, 1.0]), merger.volume());
    let mut renderer = renderer();
    let (fresh, filled) = renderer.pass(&there, &merger, &passes(volume.clone(), laid)).unwrap();
    let slabs = filled.slabs[1];
    assert!(slabs > 5, "{slabs}");
    renderer.pass(&here, &merger, &passes(surfaces, laid)).unwrap();
    let (kept, found) = renderer.again(&there, &merger, &passes(volume.clone(), laid)).unwrap();
    assert_eq!(found.slabs, [1, 1]);
    assert_eq!(kept, fresh);
    // Another grid is.
    let (_, found) = renderer.again(&there, &merger, &passes(volume, grid(65, Region::Data))).unwrap();
    assert!(found.slabs[1] >= slabs, "{:?}", found.slabs);
}

#[test]
fn a_grid_that_does_not_fit_is_refused_and_what_fits_is_told() {
    let merger = Cloud::merger(2_000);
    let view = near([25.0, 18.0, 40.0], 60, 40);
    let mut small = renderer();
    small.memory = 16 << 20;
    let options = VolumeOptions::default();
    let mut with =
        |cells| on_adapter(&mut small, &view, &merger, &merger.volume(), &grid(cells, Region::Data), &options);
    let Err(GpuError::GridTooLarge { most }) = with(400) else { panic!("400 cells fit") };
    println!("at most {most} cells");
    assert!((64..200).contains(&most), "{most}");
    with(most).unwrap();
    assert!(with(most + most / 8).is_err());
}
