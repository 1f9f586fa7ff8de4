//! Light that passes have drawn, as it is shown in a camera's target.

use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::{BufferInitDescriptor, BufferUsages};
use bevy::render::renderer::RenderDevice;
use bevy::render::{Render, RenderApp, RenderSystems};
use deepfield::color::colors::to_encoded;
use deepfield::color::{Bloom, Colors, Image};
use deepfield::gpu::light::prepare_light;
use deepfield::gpu::{
    Backend, DeviceOptions, Fading, Footprint, Glow, HeadlessRenderer, HeadlessRequest, LightCells, LightView, plugins,
};
use deepfield::model::Kernel;
use deepfield::view::{Projection, View};
use glam::DVec3;
use std::sync::{Arc, Once};

const SIZE: [u32; 2] = [61, 37];

/// Puts known light of this size into the camera's cells.
#[derive(Component, Clone, ExtractComponent)]
struct Known([u32; 2]);

fn known(size: [u32; 2]) -> Colors {
    let [width, height] = size;
    let pixel = |index: u32| {
        let [x, y] = [index % width, index / width].map(|at| at as f32);
        // From nothing to beyond white.
        [x / 50.0, y * y / 1300.0, ((x * 7.0 + y * 13.0) % 64.0) / 64.0, 1.0 - x / 100.0]
    };
    Colors { width, height, rgba: (0..width * height).map(pixel).collect() }
}

fn fill(mut commands: Commands, cameras: Query<(Entity, &Known)>, device: Res<RenderDevice>) {
    for (camera, &Known(size)) in &cameras {
        let buffer = device.create_buffer_with_data(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&known(size).rgba),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC,
        });
        commands.entity(camera).insert(LightCells { buffer, size, complete: true });
    }
}

fn plugin(app: &mut App) {
    app.add_plugins(ExtractComponentPlugin::<Known>::default());
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
    render_app.add_systems(Render, fill.in_set(RenderSystems::PrepareBindGroups).before(prepare_light));
}

fn renderer() -> HeadlessRenderer {
    // Applications of other tests in the same process have it too.
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| plugins::register(plugin));
    let projection = Projection::Perspective { fov_y: 0.8 };
    let request = HeadlessRequest {
        view: View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, SIZE[0], SIZE[1]).unwrap(),
        mode: None,
        footprint: Footprint::Kernel(Kernel::CubicSpline),
        backend: Backend::Auto,
        culling: true,
        faintest: 0.0,
        nodes: vec![],
        tables: vec![],
        attribute: false,
        transfer: None,
        repeat: 1,
        device: DeviceOptions::default(),
    };
    HeadlessRenderer::open(&request).unwrap()
}

fn largest_difference(found: &Image, expected: &Image) -> u8 {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let pairs = found.rgba.as_flattened().iter().zip(expected.rgba.as_flattened());
    pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn light_is_shown_as_the_processor_encodes_it() {
    let mut renderer = renderer();
    renderer.insert((LightView::default(), Known(SIZE)));
    renderer.complete().unwrap();
    assert_eq!(renderer.light().unwrap(), known(SIZE));
    let image = known(SIZE).image();
    assert!(largest_difference(&renderer.shown().unwrap(), &image) <= 1);

    // A quarter of it is seen through the picture before.
    let before = Image { width: SIZE[0], height: SIZE[1], rgba: vec![[200, 100, 0, 255]; image.rgba.len()] };
    renderer.insert(LightView { before: Some(Fading { image: Arc::new(before), share: 0.25 }) });
    let mixed = |pixel: &[u8; 4]| {
        let mix = |k: usize, before: f32| (0.75 * before + 0.25 * f32::from(pixel[k])).round() as u8;
        [mix(0, 200.0), mix(1, 100.0), mix(2, 0.0), 255]
    };
    let expected = Image { rgba: image.rgba.iter().map(mixed).collect(), ..image };
    assert!(largest_difference(&renderer.shown().unwrap(), &expected) <= 1);
}

#[test]
fn bright_light_spreads_as_on_the_processor() {
    let mut renderer = renderer();
    // One level, and as many as there are; from the middle of what is there on, and from nothing.
    for (strength, threshold, radius) in [(0.8, 0.5, 0.01), (0.6, 0.3, 1.0), (1.0, 0.0, 0.2)] {
        let bloom = Bloom { strength, threshold, radius };
        renderer.insert((LightView::default(), Known(SIZE), Glow(bloom)));
        renderer.complete().unwrap();
        assert_eq!(renderer.light().unwrap(), known(SIZE));
        let expected = bloom.image(&known(SIZE));
        assert!(largest_difference(&expected, &known(SIZE).image()) > 20, "{bloom:?}");
        let found = renderer.shown().unwrap();
        let difference = largest_difference(&found, &expected);
        assert!(difference <= 1, "{bloom:?}: {difference}");
    }
    // Off, it is the light itself.
    renderer.insert(Glow(Bloom { strength: 0.0, ..Bloom::default() }));
    assert!(largest_difference(&renderer.shown().unwrap(), &known(SIZE).image()) <= 1);
}

#[test]
fn light_of_fewer_pixels_is_stretched() {
    let small = [23, 16];
    let mut renderer = renderer();
    renderer.insert((LightView::default(), Known(small)));
    renderer.complete().unwrap();
    let light = known(small);
    let expected = |index: u32| {
        let at = |axis: usize, pixel: u32| {
            let place = (f64::from(pixel) + 0.5) * f64::from(small[axis]) / f64::from(SIZE[axis]) - 0.5;
            let place = place.clamp(0.0, f64::from(small[axis] - 1));
            (place as u32, (place as u32 + 1).min(small[axis] - 1), place.fract() as f32)
        };
        let ((left, right, u), (low, high, v)) = (at(0, index % SIZE[0]), at(1, index / SIZE[0]));
        let cell = |x: u32, y: u32, k: usize| light.rgba[(y * small[0] + x) as usize][k];
        let channel = |k: usize| {
            let row = |y: u32| cell(left, y, k) * (1.0 - u) + cell(right, y, k) * u;
            (255.0 * to_encoded((row(low) * (1.0 - v) + row(high) * v).clamp(0.0, 1.0))).round() as u8
        };
        [channel(0), channel(1), channel(2), 255]
    };
    let expected = Image { width: SIZE[0], height: SIZE[1], rgba: (0..SIZE[0] * SIZE[1]).map(expected).collect() };
    assert!(largest_difference(&renderer.shown().unwrap(), &expected) <= 1);
}
