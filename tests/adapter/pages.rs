//! Page files on the GPU techniques: the same selection, the same picture and the same colours as on the CPU.

use crate::adapters::Adapters;
use crate::support::golden::check_against;
use crate::support::{Built, built, built_plainly, demo, draw_nodes, sum_nodes, view_of};
use deepfield::codec::VqBits;
use deepfield::color::accumulation::relative_error;
use deepfield::color::composite::{color_error, composite, composite_at, composite_glowing};
use deepfield::color::transfer::{Levels, TransferFunction};
use deepfield::color::{Accumulation, Bloom};
use deepfield::cpu::{Counts, Method};
use deepfield::gpu::depiction::request_nodes;
use deepfield::gpu::{Backend, Composite, Glow, HeadlessFrame, HeadlessRenderer, HeadlessRequest, render_headless};
use deepfield::mode::{Depiction, Plan, Settings};
use deepfield::model::Bounds;
use deepfield::modes;
use deepfield::store::PageFile;
use deepfield::stream::{Scene, SceneNode};
use deepfield::view::{Cut, View};
use glam::DVec3;
use std::sync::Arc;

const BACKENDS: [Backend; 2] = [Backend::Compute, Backend::Raster];

/// One selection, drawn by the CPU and by the GPU techniques, with its mode's usual colours.
fn draw_both<const N: usize>(
    adapters: &mut Adapters,
    file: &Arc<PageFile>,
    mode: &str,
    view: &View,
    backends: [Backend; N],
) -> (Accumulation, [HeadlessFrame; N]) {
    let metadata = file.metadata();
    let mode = modes::find(mode).unwrap();
    let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
    let selection = Scene::new(Arc::clone(file), u64::MAX).converge_blocking(view, 0.8).unwrap();
    let cpu = sum_nodes(view, &depiction, metadata, &selection.nodes);
    let frames = backends.map(|backend| {
        let transfer = TransferFunction::preset(mode.transfer[usize::from(cpu.has_attribute())]);
        let request = request_nodes(view, &depiction, metadata, &selection.nodes, &Plan::default(), backend);
        adapters.draw(HeadlessRequest { transfer, ..request })
    });
    (cpu, frames)
}

#[test]
fn every_mode_draws_its_golden_image_on_the_gpu() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 240, 160);
    let mut adapters = Adapters::default();
    for mode in modes::all().into_iter().filter(|mode| mode.takes_particles() && !mode.is_light()) {
        let (cpu, frames) = draw_both(&mut adapters, &built.file, mode.name, &view, BACKENDS);
        for (backend, gpu) in BACKENDS.into_iter().zip(frames) {
            let (_, error) = relative_error(&gpu.accumulation.p, &cpu.p);
            assert!(error < 1e-3, "{} on {}: L2 of P {error}", mode.name, backend.name());
            check_against(mode.name, &gpu.picture.unwrap());
        }
    }
}

#[test]
fn near_and_far_views_agree_with_the_cpu() {
    let built = built(&demo(), VqBits::Eight);
    let mut adapters = Adapters::default();
    for distance in [0.05, 0.4, 6.0] {
        let view = view_of(built.bounds(), DVec3::new(-0.7, 0.2, 0.4), distance, 300, 200);
        let (cpu, frames) = draw_both(&mut adapters, &built.file, "density-squared", &view, BACKENDS);
        for (backend, gpu) in BACKENDS.into_iter().zip(frames) {
            let (l1, l2) = relative_error(&gpu.accumulation.p, &cpu.p);
            println!("distance {distance}, {}: L1 {l1}, L2 {l2}", backend.name());
            assert!(l1 < 1e-3 && l2 < 1e-3, "distance {distance}, {}: L1 {l1}, L2 {l2}", backend.name());
        }
    }
}

#[test]
fn what_a_view_leaves_out_and_fades_is_that_of_the_cpu() {
    let built = built(&demo(), VqBits::Eight);
    let bounds = built.bounds();
    let view = view_of(bounds, DVec3::new(-0.7, 0.2, 0.4), 1.2, 200, 150);
    let cut = Cut {
        bounds: Bounds { min: bounds.min + 0.3 * bounds.size(), max: DVec3::INFINITY },
        fade_start: bounds.size().x,
        fade_rate: 2.0 / bounds.size().x,
        around: false,
    };
    let cut = view.with_cut(cut);
    let mut adapters = Adapters::default();
    for mode in ["column-density", "points"] {
        let (cpu, frames) = draw_both(&mut adapters, &built.file, mode, &cut, BACKENDS);
        for (backend, gpu) in BACKENDS.into_iter().zip(frames) {
            let (l1, l2) = relative_error(&gpu.accumulation.p, &cpu.p);
            assert!(l1 < 1e-3 && l2 < 1e-3, "{mode} on {}: L1 {l1}, L2 {l2}", backend.name());
        }
        let (whole, []) = draw_both(&mut adapters, &built.file, mode, &view, []);
        assert!(cpu.sum() < 0.5 * whole.sum(), "{mode}: {} of {}", cpu.sum(), whole.sum());
    }
}

#[test]
fn colors_are_the_cpus() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 161, 90);
    let mut adapters = Adapters::default();
    for mode in ["column-density", "density-squared", "points"] {
        let (_, [gpu]) = draw_both(&mut adapters, &built.file, mode, &view, [Backend::Compute]);
        let preset = modes::find(mode).unwrap().transfer[usize::from(gpu.accumulation.has_attribute())];
        let expected = composite(&gpu.accumulation, &TransferFunction::preset(preset).unwrap());
        let found = gpu.picture.unwrap();
        let difference =
            expected.rgba.as_flattened().iter().zip(found.rgba.as_flattened()).map(|(a, b)| a.abs_diff(*b));
        assert!(difference.max().unwrap() <= 1, "{mode}");
    }
}

#[test]
fn regions_have_the_cpus_colors() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 161, 90);
    let metadata = built.file.metadata();
    let mode = modes::find("density-squared").unwrap();
    let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
    let selection = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap();
    let request = request_nodes(&view, &depiction, metadata, &selection.nodes, &Plan::default(), Backend::Compute);
    let text = "(brightness: [(0.0, 0.0), (0.3, 0.6), (1.0, 1.0)], opacity: [(0.0, 0.2), (1.0, 1.0)], hue: (), \
                plane: (brightness: 0.5, regions: [(at: (0.6, 0.4), radius: (0.4, 0.3), color: \"#30ff00\")]))";
    let transfer = TransferFunction::parse(text, "regions").unwrap();
    let gpu = render_headless(HeadlessRequest { transfer: Some(transfer.clone()), ..request }).unwrap();
    let expected = composite(&gpu.accumulation, &transfer);
    let found = gpu.picture.unwrap();
    let pairs = expected.rgba.as_flattened().iter().zip(found.rgba.as_flattened());
    assert!(pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap() <= 1);
    let usual = composite(&gpu.accumulation, &TransferFunction::preset("density-hue").unwrap());
    assert!(usual.rgba != found.rgba);
}

#[test]
fn bright_light_of_sums_spreads_as_on_the_processor() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_of(built.bounds(), DVec3::new(0.35, 0.3, 1.0), 1.5, 161, 90);
    let metadata = built.file.metadata();
    let mode = modes::find("density-squared").unwrap();
    let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
    let nodes = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap().nodes;
    let bloom = Bloom { strength: 0.5, threshold: 0.4, radius: 0.2 };
    for backend in BACKENDS {
        let request = request_nodes(&view, &depiction, metadata, &nodes, &Plan::default(), backend);
        let mut renderer = HeadlessRenderer::open(&request).unwrap();
        renderer.complete().unwrap();
        let (sums, _) = renderer.accumulation(request.attribute).unwrap();
        let transfer = TransferFunction::preset("density-hue").unwrap();
        let usual = transfer.levels(&sums);
        // A part of the picture lies above its range, some of it by more than counts.
        let levels = Levels { p: [usual.p[0], usual.p[1] / 30.0], ..usual };
        renderer.insert((Composite::new(&transfer, levels, sums.has_attribute()), Glow(bloom)));
        renderer.complete().unwrap();
        let found = renderer.shown().unwrap();
        let expected = composite_glowing(&sums, &transfer, &levels, &bloom);
        let pairs = expected.rgba.as_flattened().iter().zip(found.rgba.as_flattened());
        let difference = pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(difference <= 2, "{}: {difference}", backend.name());
        let (_, glow) = color_error(&expected, &composite_at(&sums, &transfer, &levels));
        assert!(glow > 20.0, "{}: {glow}", backend.name());
    }
}

#[test]
fn page_files_are_drawn_where_buffers_are_small() {
    let built = built_plainly();
    let view = view_of(built.bounds(), DVec3::new(-0.7, 0.2, 0.4), 1.5, 160, 120);
    let metadata = built.file.metadata();
    let depiction = Depiction::new(modes::first(), Settings::default(), None, metadata).unwrap();
    let nodes = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap().nodes;
    let cpu = sum_nodes(&view, &depiction, metadata, &nodes);
    let limit = 1 << 19;
    let bytes: u64 = nodes.iter().map(particle_bytes).sum();
    assert!(bytes > 3 * limit, "{bytes} bytes of particles fit few buffers");
    for backend in BACKENDS {
        let mut request = request_nodes(&view, &depiction, metadata, &nodes, &Plan::default(), backend);
        let limits =
            wgpu::Limits { max_storage_buffer_binding_size: limit, max_buffer_size: limit, ..wgpu::Limits::default() };
        request.device.constrained_limits = Some(limits);
        let gpu = render_headless(request).unwrap();
        let (l1, l2) = relative_error(&gpu.accumulation.p, &cpu.p);
        assert!(l1 < 1e-3 && l2 < 1e-3, "{}: L1 {l1}, L2 {l2}", backend.name());
    }
}

/// Bytes of a node's particles on the adapter: positions of eight bytes in leaves, of four elsewhere, and codes of two.
fn particle_bytes(drawn: &SceneNode) -> u64 {
    let node = &drawn.page.nodes[drawn.node.node as usize];
    u64::from(node.particles) * if node.is_leaf() { 10 } else { 6 }
}

/// A page file in a view, drawn with plans.
struct Shot {
    built: Built,
    view: View,
    depiction: Depiction,
    nodes: Vec<SceneNode>,
}

impl Shot {
    fn new(distance: f64) -> Shot {
        let built = built(&demo(), VqBits::Eight);
        let view = view_of(built.bounds(), DVec3::new(-0.7, 0.2, 0.4), distance, 160, 120);
        let metadata = built.file.metadata();
        let depiction = Depiction::new(modes::first(), Settings::default(), None, metadata).unwrap();
        let nodes = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap().nodes;
        Shot { built, view, depiction, nodes }
    }

    fn cpu(&self, plan: &Plan) -> (Accumulation, Counts) {
        let metadata = self.built.file.metadata();
        let drawn = draw_nodes(&self.view, &self.depiction, metadata, &self.nodes, Method::Pyramid, plan);
        drawn.sums(self.depiction.mode).unwrap()
    }

    fn gpu(&self, adapters: &mut Adapters, plan: &Plan, backend: Backend) -> HeadlessFrame {
        let metadata = self.built.file.metadata();
        adapters.draw(request_nodes(&self.view, &self.depiction, metadata, &self.nodes, plan, backend))
    }
}

#[test]
fn thinned_pictures_keep_the_particles_that_the_cpu_keeps() {
    // Some particles of every rank are kept, and only few ranks are looked at.
    let importance = |keep| Plan { keep, ..Plan::default() };
    let even = Plan { share: 0.2, ..Plan::default() };
    let mut adapters = Adapters::default();
    for (distance, plan, backends, limit) in [
        (1.5, importance(0.1), &BACKENDS[..], 1e-3),
        (4.0, importance(0.01), &BACKENDS[..1], 4e-3),
        (1.5, even, &BACKENDS[..], 1e-3),
    ] {
        let shot = Shot::new(distance);
        let ((all, of), (cpu, counts)) = (shot.cpu(&Plan::default()), shot.cpu(&plan));
        assert!(relative_error(&cpu.p, &all.p).1 > 1e-2 && counts.drawn < of.drawn * 9 / 10, "{counts:?} of {of:?}");
        for &backend in backends {
            let gpu = shot.gpu(&mut adapters, &plan, backend);
            let (l1, l2) = relative_error(&gpu.accumulation.p, &cpu.p);
            println!("{plan:?}, {}: L1 {l1}, L2 {l2}, {counts:?} {:?}", backend.name(), gpu.stats.splats);
            // The errors of few splats do not average out.
            assert!(l1 < limit && l2 < limit, "{plan:?}, {}: L1 {l1}, L2 {l2}", backend.name());
            if let Some(splats) = gpu.stats.splats {
                // They differ in how far outside the picture a small splat is still sorted; from afar all are in it.
                let differ = if distance > 3.0 { 0 } else { counts.drawn / 50 };
                assert!(splats.abs_diff(counts.drawn) <= differ, "{splats} of {counts:?}");
            }
        }
    }
}

#[test]
fn faint_particles_are_dropped_as_on_the_cpu() {
    let (shot, mut adapters) = (Shot::new(0.8), Adapters::default());
    let brightest = shot.cpu(&Plan::default()).0.p.iter().copied().fold(0.0, f32::max);
    let plan = Plan { faintest: 3e-4 * brightest, ..Plan::default() };
    let (cpu, counts) = shot.cpu(&plan);
    assert!(counts.faint > 1000 && counts.drawn > 1000, "{counts:?}");
    for backend in BACKENDS {
        let (_, l2) = relative_error(&shot.gpu(&mut adapters, &plan, backend).accumulation.p, &cpu.p);
        // Particles right at the limit may differ by rounding.
        assert!(l2 < 2e-3, "{}: L2 {l2}", backend.name());
    }
}

#[test]
fn culling_changes_nothing_but_rounding() {
    let (shot, mut adapters) = (Shot::new(0.15), Adapters::default());
    for backend in BACKENDS {
        let with = shot.gpu(&mut adapters, &Plan::default(), backend);
        let without = shot.gpu(&mut adapters, &Plan { culling: false, ..Plan::default() }, backend);
        let (_, l2) = relative_error(&without.accumulation.p, &with.accumulation.p);
        assert!(l2 < 1e-5 && with.stats.splats == without.stats.splats, "{}: {l2}", backend.name());
    }
}
