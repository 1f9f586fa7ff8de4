//! Modes that draw light, by an adapter's passes and by the processor: the same particles, the same colours, the same picture.

use crate::adapters::Adapters;
use crate::support::{Built, Random, built, demo, draw_nodes, view_of};
use deepfield::codec::VqBits;
use deepfield::codec::clusters::NO_CLASS;
use deepfield::color::Colors;
use deepfield::color::transfer::{Scale, TransferFunction};
use deepfield::cpu::layered::{self, Assignment};
use deepfield::cpu::screen_spheres::{SphereOptions, SurfaceColors, front};
use deepfield::cpu::volume::{Classifier, Light, VolumeLevels, VolumeOptions, VolumeReport, extents};
use deepfield::cpu::{self, Method, Positions, Splats, sorted};
use deepfield::gpu::depiction::request_nodes;
use deepfield::gpu::tile_passes::TilePasses;
use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, HeadlessNode, HeadlessRenderer, HeadlessRequest, Layered, LightView, NodeId,
    NodeUpload, Offscreen, Payload, RawParticle, SortedSplats, Spheres, TilePicture,
};
use deepfield::look::{Backend as DrawnBy, CameraConfig, LookPatch, Member, Shot};
use deepfield::mode::sample::Sample;
use deepfield::mode::{Depiction, LightPasses, LightPicture, Plan, Settings};
use deepfield::model::{Bounds, Kernel};
use deepfield::modes::{self, grid::Look};
use deepfield::picture::look::transfer_of;
use deepfield::picture::{Session, SessionOptions};
use deepfield::stream::{Scene, SceneNode};
use deepfield::view::cut::{ClipBox, Fade};
use deepfield::view::{CutSettings, Extent, Occluder, Periodic, Projection, View};
use glam::DVec3;
use std::sync::Arc;

/// Particles with densities, and how they are coloured.
struct Cloud {
    positions: Vec<[f64; 3]>,
    h: Vec<f32>,
    mass: Vec<f32>,
    density: Vec<f32>,
    attribute: Vec<f32>,
}

impl Cloud {
    /// Particles in the cube of width 2, with smoothing lengths from `smallest` to `largest`, evenly in their logarithm.
    fn random(count: usize, smallest: f64, largest: f64) -> Cloud {
        let mut random = Random(count as u64);
        let mut cloud = Cloud { positions: vec![], h: vec![], mass: vec![], density: vec![], attribute: vec![] };
        for _ in 0..count {
            let h = smallest * (largest / smallest).powf(random.next());
            let density = 10f64.powf(4.0 * random.next() - 2.0);
            cloud.positions.push([0; 3].map(|_| 2.0 * random.next() - 1.0));
            cloud.h.push(h as f32);
            cloud.density.push(density as f32);
            // What some sixty neighbours have.
            cloud.mass.push((0.1 * density * h.powi(3)) as f32);
            cloud.attribute.push(random.next() as f32);
        }
        cloud
    }

    fn batch(&self) -> Splats<'_> {
        let extent = cpu::Extent::World(&self.h);
        let splats = Splats::new(Positions::World(&self.positions), extent, &self.mass, Some(&self.attribute)).unwrap();
        splats.with_density(Some(&self.density)).unwrap()
    }

    fn classifier(&self) -> Arc<Classifier> {
        let levels = VolumeLevels { density: [1e-2, 1e2], attribute: [0.0, 1.0], unit_length: 0.3 };
        Arc::new(Classifier::new(&TransferFunction::of_volumes(true), levels, true))
    }

    fn request(&self, view: &View) -> HeadlessRequest {
        let particle = |i: usize| RawParticle {
            position: self.positions[i].map(|at| at as f32),
            smoothing_length: self.h[i],
            weight: self.mass[i],
            attribute: self.attribute[i],
            density: self.density[i],
            unused: 0.0,
        };
        let payload = Payload::World((0..self.h.len()).map(particle).collect());
        let id = NodeId { source: 0, page: 0, node: 0 };
        let node = HeadlessNode {
            upload: NodeUpload { id, min: DVec3::ZERO, size: 0.0, payload },
            table: None,
            weight_scale: 1.0,
            offset: DVec3::ZERO,
            sample: Sample::ALL,
            limit: NO_CLASS,
            reach: extents::of(&[self.batch()])[0],
        };
        HeadlessRequest {
            view: *view,
            mode: None,
            footprint: Footprint::Kernel(Kernel::CubicSpline),
            backend: Backend::Compute,
            culling: true,
            faintest: 0.0,
            nodes: vec![node],
            tables: vec![],
            attribute: true,
            transfer: None,
            repeat: 1,
            device: DeviceOptions::default(),
        }
    }
}

fn perspective(eye: [f64; 3], width: u32, height: u32) -> View {
    let projection = Projection::Perspective { fov_y: 0.8 };
    View::look_at(DVec3::from_array(eye), DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0), projection, width, height).unwrap()
}

fn orthographic(eye: [f64; 3], width: u32, height: u32) -> View {
    let projection = Projection::Orthographic { height: 2.1 };
    View::look_at(DVec3::from_array(eye), DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0), projection, width, height).unwrap()
}

/// Mean and largest difference of all channels, in steps of an eight-bit picture.
fn difference(found: &Colors, expected: &Colors) -> (f64, u8) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let (found, expected) = (found.image(), expected.image());
    let pairs = || found.rgba.as_flattened().iter().zip(expected.rgba.as_flattened()).map(|(a, b)| a.abs_diff(*b));
    let lit = expected.rgba.iter().filter(|pixel| pixel[..3].iter().any(|&byte| byte > 20)).count();
    assert!(lit * 20 > expected.rgba.len(), "an empty picture");
    let sum: f64 = pairs().map(f64::from).sum();
    (sum / expected.rgba.as_flattened().len() as f64, pairs().max().unwrap())
}

fn bits(colors: &Colors) -> Vec<u32> {
    colors.rgba.as_flattened().iter().map(|channel| channel.to_bits()).collect()
}

/// The light that a renderer draws.
fn drawn(renderer: &mut HeadlessRenderer) -> Colors {
    renderer.complete().unwrap();
    renderer.light().unwrap()
}

/// The light that a renderer draws of a cloud in the order of depth, which is the same to the last bit when it is drawn again; of
/// large ones that takes long. (Within layers there is no order.)
fn twice(renderer: &mut HeadlessRenderer, cloud: &Cloud) -> Colors {
    let light = drawn(renderer);
    if cloud.h.len() < 5_000 {
        renderer.measure(1).unwrap();
        assert!(bits(&renderer.light().unwrap()) == bits(&light), "another picture of the same");
    }
    light
}

const TERMINATION: f32 = 0.999;
/// More than any of the pictures needs.
const MEMORY: u64 = 1 << 30;

fn sorted_both(view: &View, cloud: &Cloud, (adapters, memory): (&mut Adapters, u64)) -> (Colors, Colors) {
    let classifier = cloud.classifier();
    let options = VolumeOptions { smallest: 1.5, ..VolumeOptions::default() };
    let (expected, report) = sorted::draw(view, &[cloud.batch()], &classifier, (TERMINATION, 1.0), &options).unwrap();
    let (renderer, number) = adapters.load(cloud.request(view));
    let component = SortedSplats {
        classifier,
        planes: report.planes,
        termination: TERMINATION,
        smallest: options.smallest,
        density_scale: 1.0,
    };
    renderer.insert((LightView::default(), TilePicture { number, mode: component, occlusion: false, memory }));
    (twice(renderer, cloud), expected)
}

#[test]
fn sorted_splats_are_blended_as_on_the_processor() {
    let wide = Cloud::random(3_000, 0.01, 0.6);
    let tiny = Cloud::random(60_000, 0.01, 0.04);
    let many = Cloud::random(30_000, 0.02, 0.1);
    let mut adapters = Adapters::default();
    for (name, view, cloud) in [
        ("wide", perspective([1.5, 1.0, 2.5], 161, 90), &wide),
        ("inside", perspective([0.2, 0.1, 0.4], 120, 97), &wide),
        ("tiny", perspective([1.5, 1.0, 2.5], 161, 90), &tiny),
        ("many", perspective([0.5, 1.5, 2.5], 161, 90), &many),
        ("parallel", orthographic([1.5, 1.0, 2.5], 150, 100), &many),
        ("parallel from within", orthographic([0.1, 0.1, 0.2], 90, 100), &wide),
    ] {
        let (found, expected) = sorted_both(&view, cloud, (&mut adapters, MEMORY));
        let (mean, most) = difference(&found, &expected);
        println!("{name}: mean {mean:.3}, at most {most}");
        assert!(mean < 0.02 && most <= 2, "{name}: mean {mean}, at most {most}");
    }
}

#[test]
fn slabs_of_depth_change_nothing() {
    let cloud = Cloud::random(60_000, 0.02, 0.1);
    let view = perspective([0.5, 1.5, 2.5], 121, 90);
    // Room for some 26000 particles.
    let limit = 1 << 20;
    let limits =
        wgpu::Limits { max_storage_buffer_binding_size: limit, max_buffer_size: limit, ..wgpu::Limits::default() };
    let small = DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() };
    // Small buffers, or little memory for all of them: some 12000.
    let mut few = [(Adapters::of(small), MEMORY), (Adapters::default(), 2 << 20)];
    let mut plenty = Adapters::default();
    let (whole, _) = sorted_both(&view, &cloud, (&mut plenty, MEMORY));
    for (adapters, memory) in &mut few {
        let (slabs, _) = sorted_both(&view, &cloud, (adapters, *memory));
        assert_eq!(difference(&slabs, &whole), (0.0, 0));
    }
    // Of layers some are more than one slab.
    for assignment in [Assignment::Nearest, Assignment::Kernel] {
        let (whole, _) = layered_both(&view, &cloud, (2, assignment), (&mut plenty, MEMORY));
        for (adapters, memory) in &mut few {
            let (slabs, _) = layered_both(&view, &cloud, (2, assignment), (adapters, *memory));
            let (mean, most) = difference(&slabs, &whole);
            assert!(mean < 0.01 && most <= 1, "{assignment:?}: mean {mean}, at most {most}");
        }
    }
}

fn spheres_both(adapters: &mut Adapters, view: &View, cloud: &Cloud, smoothing: f64) -> (Colors, Colors) {
    let options = SphereOptions { radius: 0.5, least: 0.1, smoothing, near: None, far: None, occlusion: true };
    let (mut front, report) = front(view, &[cloud.batch()], 1.0, &options).unwrap();
    front.smooth(view, smoothing);
    let light = Light { ambient: 0.12, specular: 0.15, shininess: 40.0 };
    let hue = |step: usize| [0.2 + 0.01 * step as f32, 0.9 - 0.01 * step as f32, 0.5, 1.0];
    let color = |_: f32, attribute: f32| {
        let [r, g, b, _] = hue((attribute.clamp(0.0, 1.0) * 63.0).round() as usize);
        [r, g, b]
    };
    let expected = front.shade(view, Some(&light), color);
    let colors = SurfaceColors {
        colors: (0..64).map(hue).collect(),
        of_attribute: true,
        scale: Scale::Linear,
        range: [0.0, 1.0],
    };
    let component = Spheres {
        radius: options.radius,
        least: options.least,
        smoothing,
        planes: report.planes,
        density_scale: 1.0,
        light: Some(light),
        colors,
    };
    let (renderer, number) = adapters.load(cloud.request(view));
    renderer.insert((LightView::default(), TilePicture { number, mode: component, occlusion: false, memory: MEMORY }));
    (twice(renderer, cloud), expected)
}

#[test]
fn spheres_are_lit_as_on_the_processor() {
    let wide = Cloud::random(3_000, 0.01, 0.4);
    let many = Cloud::random(30_000, 0.02, 0.1);
    let mut adapters = Adapters::default();
    for (name, view, cloud, smoothing) in [
        ("wide", perspective([1.5, 1.0, 2.5], 161, 90), &wide, 1.5),
        ("inside", perspective([0.2, 0.1, 0.4], 120, 97), &wide, 0.5),
        ("many", perspective([0.5, 1.5, 2.5], 161, 90), &many, 0.0),
        ("parallel", orthographic([1.5, 1.0, 2.5], 150, 100), &many, 1.5),
    ] {
        let (found, expected) = spheres_both(&mut adapters, &view, cloud, smoothing);
        let (mean, _) = difference(&found, &expected);
        // On silhouettes a pixel may show one sphere or the other.
        let pairs = found.rgba.iter().zip(&expected.rgba);
        let other = pairs.filter(|(a, b)| (0..4).any(|k| (a[k] - b[k]).abs() > 0.02)).count();
        println!("{name}: mean {mean:.3}, {other} others of {}", found.rgba.len());
        assert!(mean < 0.05 && other * 1000 < found.rgba.len(), "{name}: mean {mean}, {other} others");
    }
}

fn layered_both(
    view: &View,
    cloud: &Cloud,
    (layers, assignment): (u32, Assignment),
    (adapters, memory): (&mut Adapters, u64),
) -> (Colors, Colors) {
    let classifier = cloud.classifier();
    let options = VolumeOptions::default();
    let way = (layers, assignment, TERMINATION);
    let (expected, report) = layered::draw(view, &[cloud.batch()], &classifier, way, &options).unwrap();
    let component = Layered {
        classifier,
        planes: report.planes,
        layers,
        assignment,
        termination: TERMINATION,
        smallest: options.smallest,
        longest: cloud.h.iter().copied().fold(0.0, f32::max).into(),
    };
    let (renderer, number) = adapters.load(cloud.request(view));
    renderer.insert((LightView::default(), TilePicture { number, mode: component, occlusion: false, memory }));
    (drawn(renderer), expected)
}

#[test]
fn layers_are_blended_as_on_the_processor() {
    let wide = Cloud::random(3_000, 0.01, 0.6);
    let many = Cloud::random(20_000, 0.02, 0.1);
    // More splats lie over a tile than one invocation sums.
    let mut crowded = Cloud::random(30_000, 0.03, 0.06);
    crowded.positions.iter_mut().flatten().for_each(|x| *x *= 0.005);
    crowded.mass.iter_mut().for_each(|mass| *mass *= 0.02);
    let mut adapters = Adapters::default();
    for (name, view, cloud, way) in [
        ("crowded", perspective([0.02, 0.02, 0.2], 121, 90), &crowded, (3, Assignment::Nearest)),
        ("many, nearest", perspective([0.5, 1.5, 2.5], 101, 60), &many, (64, Assignment::Nearest)),
        ("many, cut", perspective([0.5, 1.5, 2.5], 101, 60), &many, (64, Assignment::Kernel)),
        ("wide, nearest", perspective([1.5, 1.0, 2.5], 101, 60), &wide, (16, Assignment::Nearest)),
        ("wide, cut", perspective([1.5, 1.0, 2.5], 101, 60), &wide, (16, Assignment::Kernel)),
        ("inside, cut", perspective([0.2, 0.1, 0.4], 80, 65), &wide, (12, Assignment::Kernel)),
        ("parallel, nearest", orthographic([1.5, 1.0, 2.5], 150, 100), &many, (100, Assignment::Nearest)),
        ("parallel, cut", orthographic([0.1, 0.1, 0.2], 90, 100), &wide, (20, Assignment::Kernel)),
    ] {
        let (found, expected) = layered_both(&view, cloud, way, (&mut adapters, MEMORY));
        let (mean, most) = difference(&found, &expected);
        println!("{name}: mean {mean:.3}, at most {most}");
        assert!(mean < 0.1 && most <= 6, "{name}: mean {mean}, at most {most}");
    }
}

/// One of 16^3 cubes within the cube of width 2.
fn cube(index: i32) -> Extent {
    let corner = DVec3::new(f64::from(index % 16), f64::from(index / 16 % 16), f64::from(index / 256));
    let min = corner / 8.0 - 1.0;
    Extent { bounds: Bounds { min, max: min + 0.1 }, margin: 0.02 }
}

#[test]
fn what_is_opaque_hides_what_it_hides_on_the_processor() {
    let cloud = Cloud::random(30_000, 0.05, 0.1);
    let batch = [cloud.batch()];
    let levels = VolumeLevels { density: [1e-2, 1e2], attribute: [0.0, 1.0], unit_length: 1e-3 };
    let classifier = Classifier::new(&TransferFunction::of_volumes(true), levels, true);
    let options = VolumeOptions { occlusion: true, ..VolumeOptions::default() };
    let spheres = SphereOptions { radius: 0.5, least: 1.0, smoothing: 1.5, near: None, far: None, occlusion: true };
    let colors =
        SurfaceColors { colors: [[1.0; 4]; 2].into(), of_attribute: true, scale: Scale::Linear, range: [0.0, 1.0] };
    let (termination, density_scale, layers, assignment) = (TERMINATION, 1.0, 48, Assignment::Kernel);
    let sorted_splats = LightPasses::Sorted { classifier: classifier.clone(), options, termination, density_scale };
    let in_layers = LightPasses::Layered { classifier: classifier.clone(), options, layers, assignment, termination };
    let as_spheres = LightPasses::Spheres { options: spheres, light: None, colors, density_scale };
    let mut adapters = Adapters::default();
    for view in [perspective([0.5, 1.5, 2.5], 161, 90), orthographic([1.5, 1.0, 2.5], 90, 100)] {
        let of = |report: VolumeReport| report.opaque.unwrap();
        let by_depth = sorted::draw(&view, &batch, &classifier, (termination, density_scale), &options).unwrap();
        let by_layer = layered::draw(&view, &batch, &classifier, (layers, assignment, termination), &options).unwrap();
        let (first, _) = front(&view, &batch, density_scale, &spheres).unwrap();
        for (name, passes, expected) in [
            ("sorted", &sorted_splats, of(by_depth.1)),
            ("layered", &in_layers, of(by_layer.1)),
            ("spheres", &as_spheres, Arc::new(first.opaque(&view, spheres.radius))),
        ] {
            let (renderer, number) = adapters.load(cloud.request(&view));
            let draw = TilePasses::of(passes, &view, &extents::of(&batch)).unwrap().unwrap();
            let (colors, found, _) = renderer.tiles(2 * number, draw.clone(), 1).unwrap();
            let [found, expected] = [found.unwrap(), expected]
                .map(|opaque| (0..16i32.pow(3)).map(|index| opaque.hides(&cube(index))).collect::<Vec<_>>());
            let differ = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            let hidden = expected.iter().filter(|hidden| **hidden).count();
            println!("{name}: {hidden} cubes hidden, {differ} otherwise than by the processor");
            assert!(hidden > 400 && differ * 50 <= hidden, "{name}: {hidden} {differ}");
            // Nobody waits for what nobody asked for, and the picture is the same.
            let mut unasked = draw;
            unasked.occlusion = false;
            let (same, none, _) = renderer.tiles(2 * number + 1, unasked, 1).unwrap();
            assert!(none.is_none() && difference(&same, &colors).1 <= 1, "{name}");
        }
    }
}

/// A page file in a view, as a mode draws it.
struct Pages {
    built: Built,
    depiction: Depiction,
}

impl Pages {
    fn new(mode: &str) -> Pages {
        let built = built(&demo(), VqBits::Eight);
        let mode = modes::find(mode).unwrap();
        let depiction = Depiction::new(mode, Settings::default(), None, built.file.metadata()).unwrap();
        Pages { built, depiction }
    }

    fn nodes(&self, view: &View) -> Vec<SceneNode> {
        Scene::new(Arc::clone(&self.built.file), u64::MAX).converge_blocking(view, 0.8).unwrap().nodes
    }

    fn processor(&self, view: &View, nodes: &[SceneNode], plan: &Plan) -> LightPicture {
        draw_nodes(view, &self.depiction, self.built.file.metadata(), nodes, Method::Pyramid, plan)
            .light(self.depiction.mode)
            .unwrap()
    }

    /// The same nodes for an adapter, with tables that tell densities.
    fn request(&self, view: &View, nodes: &[SceneNode], plan: &Plan) -> HeadlessRequest {
        let metadata = self.built.file.metadata();
        let request = request_nodes(view, &self.depiction, metadata, nodes, plan, Backend::Compute);
        HeadlessRequest { mode: None, ..request }
    }

    fn look(&self, picture: &LightPicture) -> Look {
        let transfer = transfer_of(&LookPatch::default(), &self.depiction);
        let classifier = Classifier::new(&transfer, picture.levels, self.depiction.attribute.is_some());
        Look { options: VolumeOptions::default(), transfer, levels: picture.levels, classifier }
    }
}

/// Views of a page file in pictures of so many rows: all of it, a part that fades, and a periodic box from within, some of whose particles are left
/// out.
fn page_views(pages: &Pages, rows: u32) -> Vec<(&'static str, View, Plan)> {
    let file = &pages.built.file;
    let bounds = file.metadata().bounds();
    let whole = view_of(pages.built.bounds(), DVec3::new(-0.7, 0.2, 0.4), 1.2, 4 * rows / 3, rows);
    let clip = Some(ClipBox { min: bounds.min + 0.1 * bounds.size(), max: bounds.min + 0.8 * bounds.size() });
    let fade = Some(Fade { start: 1.2 * bounds.size().x, length: bounds.size().x });
    let cut = CutSettings { clip, fade, ..CutSettings::default() }.cut();
    let eye = bounds.center() + DVec3::new(0.3, 0.2, 1.0) * bounds.size().length();
    let projection = Projection::Orthographic { height: 1.5 * bounds.size().y };
    let parallel = View::look_at(eye, bounds.center(), DVec3::Y, projection, rows, rows).unwrap();
    let tiled = CutSettings { periodic: Periodic::Tiled([3, 1, 2]), ..CutSettings::default() };
    let tiled = tiled.applied(&parallel, bounds.center(), file.metadata().periodic_box());
    let thinned = Plan { keep: 0.1, ..Plan::default() };
    vec![
        ("whole", whole, Plan::default()),
        ("cut", whole.with_cut(cut), Plan::default()),
        ("thinned", whole, thinned),
        ("periodic", tiled, Plan::default()),
    ]
}

#[test]
fn sorted_splats_of_page_files_are_the_processors() {
    let (pages, mut adapters) = (Pages::new("sorted-splats"), Adapters::default());
    for (name, view, plan) in page_views(&pages, 81) {
        let nodes = pages.nodes(&view);
        let expected = pages.processor(&view, &nodes, &plan);
        let look = pages.look(&expected);
        let (renderer, number) = adapters.load(pages.request(&view, &nodes, &plan));
        let component = SortedSplats {
            classifier: Arc::new(look.classifier),
            planes: expected.report.planes,
            termination: TERMINATION,
            smallest: look.options.smallest,
            density_scale: 1.0,
        };
        renderer
            .insert((LightView::default(), TilePicture { number, mode: component, occlusion: false, memory: MEMORY }));
        let (mean, most) = difference(&drawn(renderer), &expected.colors);
        println!("{name}: mean {mean:.3}, at most {most}");
        assert!(mean < 0.02 && most <= 2, "{name}: mean {mean}, at most {most}");
    }
}

#[test]
fn spheres_of_page_files_are_the_processors() {
    let (pages, mut adapters) = (Pages::new("spheres"), Adapters::default());
    for (name, view, plan) in page_views(&pages, 120) {
        let nodes = pages.nodes(&view);
        let expected = pages.processor(&view, &nodes, &plan);
        let settings = &pages.depiction.settings;
        let component = Spheres {
            radius: settings.number(&modes::spheres::RADIUS),
            least: expected.isovalues[0],
            smoothing: settings.number(&modes::spheres::SMOOTHING),
            planes: expected.report.planes,
            density_scale: 1.0,
            light: modes::grid::light(settings),
            colors: modes::spheres::surface_colors(&pages.look(&expected)),
        };
        let (renderer, number) = adapters.load(pages.request(&view, &nodes, &plan));
        renderer
            .insert((LightView::default(), TilePicture { number, mode: component, occlusion: false, memory: MEMORY }));
        let found = drawn(renderer);
        let (mean, _) = difference(&found, &expected.colors);
        let pairs = found.rgba.iter().zip(&expected.colors.rgba);
        let other = pairs.filter(|(a, b)| (0..4).any(|k| (a[k] - b[k]).abs() > 0.02)).count();
        println!("{name}: mean {mean:.3}, {other} others of {}", found.rgba.len());
        assert!(mean < 0.05 && other * 1000 < found.rgba.len(), "{name}: mean {mean}, {other} others");
    }
}

#[test]
fn pictures_wider_than_the_adapters_textures_are_the_processors() {
    let built = built(&demo(), VqBits::Eight);
    let (eye, target) = (Some([25.0, 25.0, 120.0]), Some([25.0; 3]));
    // A strip of some 60 degrees. Volumes go the same way, and take longer.
    let (mode, fov) = ("sorted-splats", Some(0.03));
    let camera = CameraConfig { eye, target, fov, ..CameraConfig::default() };
    let [by_processor, by_adapter] = [DrawnBy::Cpu, DrawnBy::Compute].map(|backend| {
        let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
        let member = [Member::new(built.file.path())];
        let opened = Session::open(&member, options, [], |path| Ok(path.to_owned()), Arc::new(())).unwrap();
        let mut session = opened.with_adapter(Some(Box::new(Offscreen::default())));
        let look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
        // The least of the largest textures that adapters have is 8192 pixels, and most of them have no more than 16384.
        let shot = Shot { look, camera, size: Some((16_500, 8)), ..Shot::default() };
        session.draw(&shot).unwrap().image(&shot).unwrap()
    });
    let (lit, largest) = by_processor.rgba.iter().zip(&by_adapter.rgba).fold((0, 0), |(lit, largest), (a, b)| {
        let apart = (0..4).map(|channel| a[channel].abs_diff(b[channel])).max();
        (lit + usize::from(a[0] > 40), largest.max(apart.unwrap_or(0)))
    });
    assert_eq!((by_adapter.width, by_adapter.height), (16_500, 8));
    assert!(lit > 50 && largest <= 2, "{mode}: {lit} pixels are lit, which differ by up to {largest} of 255");
}
