//! Ellipsoids on the adapter, held against the processor's exact integrals of the same.

use crate::adapters::Adapters;
use crate::integrals::{BACKENDS, ORTHO, PINHOLE, assert_same, look, node, request};
use crate::support::Random;
use deepfield::codec::clusters::NO_CLASS;
use deepfield::color::Accumulation;
use deepfield::color::composite::color_error;
use deepfield::color::transfer::{Levels, TransferFunction};
use deepfield::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw};
use deepfield::gpu::{
    Backend, Composite, DrawItem, Footprint, GpuCluster, HeadlessFrame, HeadlessRenderer, Payload, SplatView,
};
use deepfield::mode::sample::Sample;
use deepfield::model::{Covariance, Kernel};
use deepfield::picture::fade::faded;
use deepfield::view::{Projection, View};
use glam::{DMat3, DQuat, DVec3};

struct Ellipsoids {
    positions: Vec<[f64; 3]>,
    covariances: Vec<Covariance>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
    kernel: Kernel,
}

/// Ellipsoids around the origin, their longest semi-axes evenly in the logarithm, the others down to a `flattest` of that, turned in any way.
fn ellipsoids(n: usize, [least, most]: [f64; 2], flattest: f64, kernel: Kernel) -> Ellipsoids {
    let mut random = Random(7);
    let mut all = Ellipsoids { positions: vec![], covariances: vec![], weight: vec![], attribute: vec![], kernel };
    for _ in 0..n {
        let mut next = || random.next();
        all.positions.push([0; 3].map(|_| next() - 0.5));
        let long = least * (most / least).powf(next());
        let semi_axes = long * DVec3::new(1.0, flattest.powf(next()), flattest.powf(next()));
        let turn = DMat3::from_quat(DQuat::from_array([0; 4].map(|_| next() - 0.5)).normalize());
        let squares = DMat3::from_diagonal(kernel.variance() * semi_axes * semi_axes);
        all.covariances.push(Covariance::of(turn * squares * turn.transpose()));
        all.weight.push((0.5 + next()) as f32);
        all.attribute.push((100.0 * next()) as f32);
    }
    all
}

impl Ellipsoids {
    fn cpu(&self, view: &View) -> Accumulation {
        let (places, extent) = (Positions::World(&self.positions), Extent::Ellipsoids(&self.covariances));
        let splats = Splats::new(places, extent, &self.weight, Some(&self.attribute)).unwrap();
        let options = SplatOptions { method: Method::Exact, kernel: self.kernel, ..SplatOptions::default() };
        draw(view, &[splats], &options)
    }

    fn gpu(&self, adapters: &mut Adapters, view: &View, backend: Backend) -> HeadlessFrame {
        let min = DVec3::splat(-0.5);
        let cluster = |i: usize| {
            let covariance = self.covariances[i];
            GpuCluster {
                place: (DVec3::from_array(self.positions[i]) - min).as_vec3().to_array(),
                smoothing_length: (covariance.trace() / 3.0 / self.kernel.variance()).sqrt() as f32,
                moments: covariance.0,
                weight: self.weight[i],
                attribute: self.attribute[i],
                to: f32::MAX,
                ..GpuCluster::default()
            }
        };
        let payload = Payload::Ellipsoids((0..self.positions.len()).map(cluster).collect());
        let nodes = vec![node(min, 0.0, payload)];
        adapters.draw(request(view, Footprint::Kernel(self.kernel), backend, nodes, vec![]))
    }

    /// Along parallel lines of sight, and through a pinhole, which is so to second order only, both are within their limit of the truth.
    fn compare(&self, name: &str, limits: [f64; 2]) {
        let projections = [(ORTHO, "orthographic"), (PINHOLE, "perspective")];
        let mut adapters = Adapters::default();
        for ((projection, of_it), limit) in projections.into_iter().zip(limits) {
            let view = look(projection, 320, 240);
            let cpu = self.cpu(&view);
            for backend in BACKENDS {
                let gpu = self.gpu(&mut adapters, &view, backend);
                assert_eq!(gpu.stats.backend, backend.name());
                assert_same(&format!("{name}, {of_it}, {}", backend.name()), &gpu, &cpu, limit);
            }
        }
    }
}

/// The widest and the narrowest for their radius, and one between; round splats are compared with all of them.
const KERNELS: [Kernel; 3] = [Kernel::Poly6, Kernel::CubicSpline, Kernel::WendlandC6];

// Pixels are 1/200 to 1/240.
#[test]
fn of_pixels() {
    for kernel in KERNELS {
        ellipsoids(8000, [0.0004, 0.03], 0.2, kernel).compare("pixels", [2e-3; 2]);
    }
}

#[test]
fn slivers() {
    ellipsoids(3000, [0.004, 0.3], 0.002, Kernel::CubicSpline).compare("slivers", [6e-3, 1e-2]);
}

#[test]
fn large_ones() {
    for kernel in KERNELS {
        ellipsoids(300, [0.05, 0.6], 0.1, kernel).compare("large", [2e-3, 2e-2]);
    }
}

/// Light is the weight, wherever an ellipsoid is and whatever its size: sums over all pixels of the picture.
#[test]
fn light_is_the_weight() {
    let (projection, mut adapters) = (Projection::Orthographic { height: 4.0 }, Adapters::default());
    for (sizes, flattest) in [([1e-5, 1e-2], 0.01), ([1e-2, 0.5], 0.01), ([0.3, 0.9], 0.3)] {
        let all = ellipsoids(200, sizes, flattest, Kernel::CubicSpline);
        let view = look(projection, 320, 320);
        let total: f64 = all.weight.iter().map(|weight| f64::from(*weight)).sum();
        for backend in BACKENDS {
            let sum = all.gpu(&mut adapters, &view, backend).accumulation.sum() * (4.0_f64 / 320.0).powi(2);
            assert!((sum / total - 1.0).abs() < 1e-4, "{backend:?} {sizes:?}: {}", sum / total);
        }
    }
}

/// The picture of other particles is seen in the middle of a fade as the mean of both, and alone after it.
#[test]
fn a_picture_fades_in_over_the_one_before() {
    let view = look(ORTHO, 90, 70);
    let transfer = TransferFunction::default();
    let levels = Levels { p: [1e-3, 1e3], s: [0.0, 1.0] };
    for backend in BACKENDS {
        let part = |seed: f32| {
            let cluster = |i: usize| GpuCluster {
                place: [0.03 * i as f32, (seed * i as f32).fract(), 0.5],
                smoothing_length: 0.05,
                moments: [1e-4 * seed, 1e-4, 1e-4, 0.0, 0.0, 0.0],
                weight: 1.0,
                to: f32::MAX,
                ..GpuCluster::default()
            };
            node(DVec3::splat(-0.5), 0.0, Payload::Ellipsoids((0..30).map(cluster).collect()))
        };
        let mut nodes = vec![part(0.61), part(1.37)];
        nodes[1].upload.id.node = 1;
        let ids = [nodes[0].upload.id, nodes[1].upload.id];
        let request = request(&view, Footprint::Kernel(Kernel::default()), backend, nodes, vec![]);
        let mut renderer = HeadlessRenderer::open(&request).unwrap();
        let composite = Composite::new(&transfer, levels, false);
        let mut shown = |which: usize, keeps_last: bool, last: Option<f32>| {
            let item = DrawItem {
                node: ids[which],
                table: None,
                weight_scale: 1.0,
                offset: DVec3::ZERO,
                sample: Sample::ALL,
                limit: NO_CLASS,
            };
            renderer.show(SplatView {
                view,
                footprint: Footprint::Kernel(Kernel::default()),
                backend,
                culling: true,
                faintest: 0.0,
                items: [item].into(),
                always: false,
                keeps_last,
            });
            renderer.insert(Composite { last, ..composite.clone() });
            renderer.complete().unwrap();
            renderer.shown().unwrap()
        };
        let [before, after] = [shown(0, false, None), shown(1, false, None)];
        assert!(color_error(&before, &after).0 > 5.0);
        assert_eq!(shown(0, false, None), before);
        // Twice, so that the place of the picture that was kept serves again.
        for (which, [old, new]) in [(1, [&before, &after]), (0, [&after, &before])] {
            let middle = shown(which, true, Some(0.25));
            let mean = faded(old, new, 0.25);
            let worst =
                middle.rgba.as_flattened().iter().zip(mean.rgba.as_flattened()).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst <= Some(1), "{backend:?}: {worst:?}");
        }
        assert_eq!(shown(0, false, Some(0.25)), before, "nothing was kept");
    }
}
