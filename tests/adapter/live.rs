//! Particles that change from frame to frame: written anew, or lying in a buffer of somebody else's on the adapter.

use crate::support::{sum_nodes, view_from};
use deepfield::codec::clusters::NO_CLASS;
use deepfield::color::Accumulation;
use deepfield::color::accumulation::relative_error;
use deepfield::gpu::depiction::world_payloads;
use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, HeadlessNode, HeadlessRenderer, HeadlessRequest, NodeId, NodeUpload, Payload,
    RawParticle,
};
use deepfield::mode::sample::Sample;
use deepfield::mode::{Depiction, Settings};
use deepfield::model::Dataset;
use deepfield::modes;
use deepfield::store::{InMemory, Tree};
use deepfield::stream::first_nodes;
use deepfield::synth::merger::Merger;
use deepfield::view::{Extent, View};
use glam::DVec3;
use wgpu::BufferUsages;
use wgpu::util::BufferInitDescriptor;

fn request(view: &View, payloads: Vec<(Payload, DVec3, Extent)>) -> HeadlessRequest {
    let node = |(index, (payload, min, reach)): (usize, (Payload, DVec3, Extent))| HeadlessNode {
        upload: NodeUpload { id: NodeId { source: 0, page: 0, node: index as u32 }, min, size: 0.0, payload },
        table: None,
        weight_scale: 1.0,
        offset: DVec3::ZERO,
        sample: Sample::ALL,
        limit: NO_CLASS,
        reach,
    };
    HeadlessRequest {
        view: *view,
        mode: None,
        footprint: Footprint::Kernel(deepfield::model::Kernel::CubicSpline),
        backend: Backend::Compute,
        culling: true,
        faintest: 0.0,
        nodes: payloads.into_iter().enumerate().map(node).collect(),
        tables: Vec::new(),
        attribute: true,
        transfer: None,
        repeat: 1,
        device: DeviceOptions::default(),
    }
}

fn particles(payload: &Payload) -> &[RawParticle] {
    match payload {
        Payload::World(particles) => particles,
        other => panic!("{other:?}"),
    }
}

fn data() -> (Dataset, Depiction, View) {
    let dataset = deepfield::synth::dataset(&Merger::new(5, 20_000));
    let tree = InMemory::new(dataset.clone());
    let depiction = Depiction::new(modes::first(), Settings::default(), None, tree.metadata()).unwrap();
    let view = view_from(&dataset, DVec3::new(0.35, 0.3, 1.0), 1.5, 160, 120);
    (dataset, depiction, view)
}

#[test]
fn live_particles_are_drawn_as_the_processor_draws_them() {
    let (dataset, depiction, view) = data();
    let payloads = dataset.families.iter().flat_map(|family| world_payloads(&depiction, family)).collect();
    let mut renderer = HeadlessRenderer::open(&request(&view, payloads)).unwrap();
    renderer.complete().unwrap();
    let (found, _) = renderer.accumulation(true).unwrap();
    let tree = InMemory::new(dataset);
    let expected = sum_nodes(&view, &depiction, tree.metadata(), &first_nodes(&tree, &view).unwrap());
    let (l1, l2) = relative_error(&found.p, &expected.p);
    assert!(l1 < 1e-3 && l2 < 1e-3, "L1 {l1}, L2 {l2}");
}

#[test]
fn a_buffer_that_is_on_the_adapter_is_read_where_it_is() {
    let (dataset, depiction, view) = data();
    let (uploaded, origin, reach) = world_payloads(&depiction, &dataset.families[0]).swap_remove(0);
    let all = particles(&uploaded).to_vec();
    let count = all.len() as u32;
    let mut renderer = HeadlessRenderer::open(&request(&view, vec![(uploaded, origin, reach)])).unwrap();
    renderer.complete().unwrap();
    let (copied, _) = renderer.accumulation(true).unwrap();

    // The buffer is written on the adapter, as a simulation there does; it has room for more particles than are drawn.
    let (device, queue) = renderer.device();
    let mut words: Vec<u8> = bytemuck::cast_slice(&all).to_vec();
    words.extend([0xff; 4096]);
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let buffer = device.create_buffer_with_data(&BufferInitDescriptor { label: None, contents: &words, usage });
    let lent = |buffer| (Payload::Lent { buffer, count }, origin, reach);
    let draw = |renderer: &mut HeadlessRenderer, buffer: &bevy::render::render_resource::Buffer| {
        renderer.load(&request(&view, vec![lent(buffer.clone())])).unwrap();
        renderer.complete().unwrap();
        renderer.accumulation(true).unwrap().0
    };
    let found = draw(&mut renderer, &buffer);
    // Sums of splats differ by the order in which they come.
    let differs = |a: &Accumulation, b: &Accumulation| relative_error(&a.p, &b.p).1;
    assert!(differs(&found, &copied) < 1e-6, "the same particles in another buffer: {}", differs(&found, &copied));
    assert_eq!(renderer.scene().stats().resident_bytes, 0, "nothing is copied");

    // What is written there is what is drawn next.
    let moved: Vec<RawParticle> =
        all.iter().map(|particle| RawParticle { weight: 2.0 * particle.weight, ..*particle }).collect();
    queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&moved));
    let later = draw(&mut renderer, &buffer);
    renderer.load(&request(&view, vec![(Payload::World(moved), origin, reach)])).unwrap();
    renderer.complete().unwrap();
    let (expected, _) = renderer.accumulation(true).unwrap();
    let [same, other] = [&expected, &copied].map(|known| differs(&later, known));
    assert!(same < 1e-6 && other > 0.5, "{same} {other}");
}

#[test]
fn a_buffer_that_shaders_cannot_read_is_refused() {
    let (dataset, depiction, view) = data();
    let (payload, origin, reach) = world_payloads(&depiction, &dataset.families[0]).swap_remove(0);
    let all = particles(&payload).to_vec();
    let mut renderer = HeadlessRenderer::bare(&DeviceOptions::default(), Backend::Compute).unwrap();
    let (device, _) = renderer.device();
    for (usage, count) in [(BufferUsages::COPY_DST, all.len()), (BufferUsages::STORAGE, all.len() + 1)] {
        let contents = bytemuck::cast_slice(&all);
        let buffer = device.create_buffer_with_data(&BufferInitDescriptor { label: None, contents, usage });
        let lent = (Payload::Lent { buffer, count: count as u32 }, origin, reach);
        assert!(renderer.load(&request(&view, vec![lent])).is_err(), "{usage:?} {count}");
    }
    // The renderer draws what comes next.
    renderer.load(&request(&view, vec![(payload, origin, reach)])).unwrap();
    renderer.complete().unwrap();
    assert!(renderer.accumulation(true).unwrap().0.sum() > 0.0);
}
