//! What the GPU backends accumulate, held against the CPU's exact integrals on the same particles.
#![cfg(feature = "viewer")]
#![allow(clippy::unwrap_used, reason = "tests")]

use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, HeadlessFrame, HeadlessNode, HeadlessRequest, NodeId, NodeUpload, Payload,
    RawParticle, render_headless,
};
use deepfield::model::Kernel;
use deepfield::raster::{Accumulation, Extent, Method, Positions, RasterOptions, Splats, draw};
use deepfield::view::{Projection, View};
use glam::DVec3;

/// A small, fast generator of numbers in [0, 1): the same on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

struct Particles {
    positions: Vec<[f64; 3]>,
    smoothing_length: Vec<f32>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
}

/// Particles around the origin, with smoothing lengths from `h_min` to `h_max`, evenly in their logarithm.
fn particles(n: usize, size: f64, h_min: f64, h_max: f64, seed: u64) -> Particles {
    let mut random = Random(seed);
    let mut all = Particles { positions: vec![], smoothing_length: vec![], weight: vec![], attribute: vec![] };
    for _ in 0..n {
        all.positions.push([0; 3].map(|_| size * (random.next() - 0.5)));
        all.smoothing_length.push((h_min * (h_max / h_min).powf(random.next())) as f32);
        all.weight.push((0.5 + random.next()) as f32);
        all.attribute.push((100.0 * random.next()) as f32);
    }
    all
}

impl Particles {
    fn cpu(&self, view: &View, extent: Option<f32>) -> Accumulation {
        let extent = extent.map_or(Extent::World(&self.smoothing_length), Extent::Pixels);
        let splats =
            Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute)).unwrap();
        draw(view, &[splats], &RasterOptions { method: Method::Exact, kernel: Kernel::CubicSpline })
    }

    fn node(&self, view: &View) -> HeadlessNode {
        let raw = (0..self.positions.len())
            .map(|i| RawParticle {
                position: view.to_camera(DVec3::from_array(self.positions[i])).as_vec3().to_array(),
                smoothing_length: self.smoothing_length[i],
                weight: self.weight[i],
                attribute: self.attribute[i],
                unused: [0.0; 2],
            })
            .collect();
        HeadlessNode {
            upload: NodeUpload {
                id: NodeId { source: 0, page: 0, node: 0 },
                min: DVec3::ZERO,
                size: 0.0,
                payload: Payload::Camera(raw),
            },
            table: None,
            weight_scale: 1.0,
        }
    }

    fn gpu(&self, view: &View, footprint: Footprint, backend: Backend) -> HeadlessFrame {
        render_headless(HeadlessRequest {
            view: *view,
            footprint,
            backend,
            nodes: vec![self.node(view)],
            tables: vec![],
            attribute: true,
            transfer: None,
            repeat: 1,
            device: DeviceOptions::default(),
        })
        .unwrap()
    }
}

fn look(projection: Projection, width: u32, height: u32) -> View {
    View::look_at(DVec3::new(1.3, 0.7, 2.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
}

/// Relative L1 and L2 error of `P`, then of `P S`.
fn errors(gpu: &Accumulation, cpu: &Accumulation) -> [(f64, f64); 2] {
    use deepfield::raster::accumulation::relative_error;
    [relative_error(&gpu.p, &cpu.p), relative_error(&gpu.ps, &cpu.ps)]
}

fn compare(name: &str, particles: &Particles, view: &View, backend: Backend) {
    let gpu = particles.gpu(view, Footprint::Kernel(Kernel::CubicSpline), backend);
    let cpu = particles.cpu(view, None);
    let errors = errors(&gpu.accumulation, &cpu);
    println!("{name}: {errors:?}, {:?}", gpu.stats);
    for (l1, l2) in errors {
        assert!(l1 < 1e-3 && l2 < 1e-3, "{name}: relative L1 {l1}, L2 {l2}");
    }
}

const ORTHO: Projection = Projection::Orthographic { height: 1.2 };
const PINHOLE: Projection = Projection::Perspective { fov_y: 0.8 };

// The picture is 240 pixels high and shows about one unit: pixels are 1/200 to 1/240.
#[test]
fn small_splats() {
    let particles = particles(20_000, 1.0, 0.0002, 0.018, 1);
    compare("small, orthographic", &particles, &look(ORTHO, 320, 240), Backend::Compute);
    compare("small, perspective", &particles, &look(PINHOLE, 320, 240), Backend::Compute);
}

#[test]
fn medium_splats() {
    let particles = particles(5_000, 1.0, 0.018, 0.1, 2);
    compare("medium, orthographic", &particles, &look(ORTHO, 320, 240), Backend::Compute);
    compare("medium, perspective", &particles, &look(PINHOLE, 320, 240), Backend::Compute);
}

#[test]
fn large_splats() {
    let particles = particles(500, 1.0, 0.1, 1.0, 3);
    compare("large, orthographic", &particles, &look(ORTHO, 320, 240), Backend::Compute);
    compare("large, perspective", &particles, &look(PINHOLE, 320, 240), Backend::Compute);
}
