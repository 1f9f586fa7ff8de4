//! The CPU renderer against integrals that are known, and the fast path against the exact one.

use deepfield::color::Accumulation;
use deepfield::color::accumulation::relative_error;
use deepfield::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw};
use deepfield::model::Kernel;
use deepfield::view::{Projection, View};
use glam::DVec3;
use proptest::prelude::*;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};

/// Uniform in [0, 1).
fn uniform(random: &mut Pcg64Mcg) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn options(method: Method, kernel: Kernel) -> SplatOptions {
    SplatOptions { method, kernel, ..SplatOptions::default() }
}

/// Looks along -z onto the rectangle from the origin to the picture's size, one unit a pixel, y upwards.
fn front(width: u32, height: u32) -> View {
    let eye = DVec3::new(0.5 * f64::from(width), 0.5 * f64::from(height), 1e4);
    let projection = Projection::Orthographic { height: f64::from(height) };
    View::look_at(eye, eye - DVec3::Z, DVec3::Y, projection, width, height).expect("a view")
}

#[derive(Default)]
struct Cloud {
    positions: Vec<[f64; 3]>,
    h: Vec<f32>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
}

impl Cloud {
    /// Particles in a box of `size` with a corner at the origin, radii log-uniform.
    fn new(seed: u64, count: usize, size: [f64; 3], radii: [f64; 2]) -> Cloud {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut cloud = Cloud::default();
        for _ in 0..count {
            cloud.positions.push(size.map(|s| s * uniform(&mut random)));
            cloud.h.push((radii[0] * (radii[1] / radii[0]).powf(uniform(&mut random))) as f32);
            cloud.weight.push((0.5 + uniform(&mut random)) as f32);
            cloud.attribute.push((uniform(&mut random) * 10.0 - 3.0) as f32);
        }
        cloud
    }

    fn draw(&self, view: &View, method: Method, kernel: Kernel) -> Accumulation {
        draw(view, &[self.splats(Some(&self.attribute))], &options(method, kernel))
    }

    fn splats<'a>(&'a self, attribute: Option<&'a [f32]>) -> Splats<'a> {
        Splats::new(Positions::World(&self.positions), Extent::World(&self.h), &self.weight, attribute)
            .expect("columns")
    }

    fn total(&self) -> f64 {
        self.weight.iter().map(|&w| f64::from(w)).sum()
    }
}

/// Brute force: mean over `n` x `n` rays in each pixel of the sum over particles.
fn brute(view: &View, cloud: &Cloud, kernel: Kernel, n: u32) -> Vec<f32> {
    let focal = view.focal_pixels();
    let particles: Vec<DVec3> = cloud.positions.iter().map(|&p| view.to_camera(DVec3::from_array(p))).collect();
    let ray = |x: f64, y: f64| {
        let u = (x - 0.5 * f64::from(view.width)) / focal;
        let v = (0.5 * f64::from(view.height) - y) / focal;
        match view.projection {
            Projection::Perspective { .. } => (DVec3::ZERO, DVec3::new(u, v, 1.0).normalize()),
            Projection::Orthographic { .. } => (DVec3::new(u, v, 0.0), DVec3::Z),
        }
    };
    let mut picture = Vec::new();
    for y in 0..view.height {
        for x in 0..view.width {
            let mut sum = 0.0;
            for sub in 0..n * n {
                let at = |base: u32, k: u32| f64::from(base) + (f64::from(k) + 0.5) / f64::from(n);
                let (origin, direction) = ray(at(x, sub % n), at(y, sub / n));
                for (k, &particle) in particles.iter().enumerate() {
                    let (h, relative) = (f64::from(cloud.h[k]), particle - origin);
                    let inside = relative.length() < h;
                    if particle.z > 0.0 && (relative.dot(direction) > 0.0 || inside) {
                        let s = relative.cross(direction).length();
                        sum += f64::from(cloud.weight[k]) * kernel.projected(s / h) / (h * h);
                    }
                }
            }
            picture.push((sum / f64::from(n * n)) as f32);
        }
    }
    picture
}

/// The widest and the narrowest for their radius, and one between.
const KERNELS: [Kernel; 3] = [Kernel::Poly6, Kernel::CubicSpline, Kernel::WendlandC6];

#[test]
fn single_particle_of_any_size_keeps_its_mass() {
    for kernel in KERNELS {
        for (method, bound) in [(Method::Exact, 1e-6), (Method::Pyramid, 1e-4)] {
            for i in (1..60).step_by(2) {
                let radius = 0.1 * 3000.0f64.powf(f64::from(i) / 59.0);
                let cloud = Cloud {
                    positions: vec![[320.3 + 0.017 * f64::from(i), 319.8 - 0.013 * f64::from(i), 0.0]],
                    h: vec![radius as f32],
                    weight: vec![2.5],
                    attribute: vec![-4.0],
                };
                let picture = cloud.draw(&front(640, 640), method, kernel);
                let sum_s: f64 = picture.ps.iter().map(|&v| f64::from(v)).sum();
                let error = (picture.sum() / 2.5 - 1.0).abs().max((sum_s / -10.0 - 1.0).abs());
                assert!(error < bound, "{kernel:?} {method:?} radius {radius}: {error}");
            }
        }
    }
}

proptest! {
    #![proptest_config(crate::cases::cases(12))]

    #[test]
    fn picture_holds_the_mass_in_any_orthographic_view(seed: u64, turn in -1.0..1.0f64, roll in 0.1..3.0f64) {
        let cloud = Cloud::new(seed, 300, [1.0; 3], [2e-4, 0.5]);
        let eye = DVec3::new(turn * 9.0, 4.0, 7.0);
        let up = DVec3::new(roll.sin(), roll.cos(), 0.3);
        let projection = Projection::Orthographic { height: 3.0 };
        let view = View::look_at(eye, DVec3::splat(0.5), up, projection, 420, 400).expect("view");
        let pixel = 1.0 / view.focal_pixels();
        for (method, bound) in [(Method::Exact, 1e-5), (Method::Pyramid, 1e-4)] {
            for kernel in Kernel::ALL {
                let sum = cloud.draw(&view, method, kernel).sum() * pixel * pixel;
                prop_assert!((sum / cloud.total() - 1.0).abs() < bound, "{method:?} {kernel:?}: {}", sum / cloud.total());
            }
        }
    }
}

#[test]
fn exact_is_the_area_mean_of_the_line_integral() {
    for kernel in KERNELS {
        for (radii, n, bound) in [([0.1, 1.0], 200, 3e-3), ([1.0, 5.0], 40, 5e-4), ([10.0, 30.0], 10, 2e-4)] {
            let cloud = Cloud::new(7, 5, [24.0, 20.0, 3.0], radii);
            // Midpoints err by the second derivative, which is that of the standard deviation.
            let bound = bound * (Kernel::CubicSpline.variance() / kernel.variance()).max(1.0);
            let view = front(24, 20);
            let (l1, l2) =
                relative_error(&cloud.draw(&view, Method::Exact, kernel).p, &brute(&view, &cloud, kernel, n));
            assert!(l1 < bound && l2 < bound, "{kernel:?} {radii:?}: {l1} {l2}");
        }
    }
}

#[test]
fn exact_perspective_is_the_ray_integral() {
    let eye = DVec3::new(0.5, 0.4, 2.2);
    let projection = Projection::Perspective { fov_y: 1.2 };
    let view = View::look_at(eye, DVec3::splat(0.4), DVec3::Y, projection, 40, 36).expect("view");
    // From particles below a pixel to such that hold the eye.
    for (radii, n, bound) in [([0.01, 0.05], 100, 2e-3), ([0.05, 0.4], 20, 5e-4), ([0.5, 4.0], 8, 5e-4)] {
        let cloud = Cloud::new(3, 12, [1.0, 1.0, 2.4], radii);
        let expected = brute(&view, &cloud, Kernel::CubicSpline, n);
        let (l1, l2) = relative_error(&cloud.draw(&view, Method::Exact, Kernel::CubicSpline).p, &expected);
        assert!(l1 < bound && l2 < bound, "{radii:?}: {l1} {l2}");
    }
}

#[test]
fn pyramid_stays_close_to_exact() {
    let view = front(500, 380);
    let octaves = [0.1, 1.0, 3.0, 6.0, 12.0, 50.0, 300.0, 3000.0];
    for kernel in Kernel::ALL {
        // Every kernel at all sizes together, and those at the ends and in the middle at each of them.
        let alone = octaves.windows(2).map(|w| [w[0], w[1]]).filter(|_| KERNELS.contains(&kernel));
        for radii in alone.chain([[0.1, 300.0]]) {
            let count = if radii[1] > 60.0 { 250 } else { 2500 };
            let cloud = Cloud::new(11, count, [500.0, 380.0, 100.0], radii);
            let exact = cloud.draw(&view, Method::Exact, kernel);
            let fast = cloud.draw(&view, Method::Pyramid, kernel);
            let (l1, l2) = fast.error_against(&exact);
            let (s1, s2) = relative_error(&fast.ps, &exact.ps);
            println!("{kernel:?} {radii:?}: L1 {l1:.1e} L2 {l2:.1e}, P S {s1:.1e} {s2:.1e}");
            assert!(l1 < 1e-3 && l2 < 1e-3, "{kernel:?} {radii:?}: {l1} {l2}");
            assert!(s1 < 2e-3 && s2 < 2e-3, "{kernel:?} {radii:?}: {s1} {s2} in P S");
        }
    }
}

#[test]
fn pyramid_stays_close_to_exact_in_perspective() {
    for (fov_y, eye) in [(0.6, [3.0, 2.0, 4.0]), (1.3, [0.8, 0.7, 1.5]), (1.9, [0.5, 0.5, 0.5])] {
        let (eye, target) = (DVec3::from_array(eye), DVec3::new(0.3, 0.4, 0.1));
        let view = View::look_at(eye, target, DVec3::Y, Projection::Perspective { fov_y }, 400, 300).expect("view");
        for radii in [[2e-4, 2e-3], [2e-3, 2e-2], [2e-2, 0.2], [0.2, 2.0]] {
            let cloud = Cloud::new(5, 1500, [1.0; 3], radii);
            let exact = cloud.draw(&view, Method::Exact, Kernel::CubicSpline);
            let fast = cloud.draw(&view, Method::Pyramid, Kernel::CubicSpline);
            let (l1, l2) = fast.error_against(&exact);
            println!("{fov_y} {radii:?}: L1 {l1:.1e} L2 {l2:.1e}");
            assert!(l1 < 1e-3 && l2 < 1e-3, "{fov_y} {radii:?}: {l1} {l2}");
        }
    }
}

#[test]
fn small_particle_in_perspective_has_the_ellipses_flux() {
    // A particle at 30 degrees off the axis: sum of P (z / focal)^2 is w sec(theta).
    let projection = Projection::Perspective { fov_y: 1.4 };
    let view = View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, projection, 600, 600).expect("view");
    let (z, tan) = (10.0f64, 30f64.to_radians().tan());
    let cloud = Cloud { positions: vec![[z * tan, 0.0, -z]], h: vec![0.02], weight: vec![3.0], attribute: vec![1.0] };
    for method in [Method::Exact, Method::Pyramid] {
        let sum = cloud.draw(&view, method, Kernel::CubicSpline).sum() * (z / view.focal_pixels()).powi(2);
        assert!((sum / (3.0 * (1.0 + tan * tan).sqrt()) - 1.0).abs() < 2e-4, "{method:?}: {sum}");
    }
}

#[test]
fn uniform_lattice_is_flat() {
    let mut cloud = Cloud::default();
    for j in -8..30 {
        for i in -8..30 {
            cloud.positions.push([f64::from(i) * 4.0 + 0.7, f64::from(j) * 4.0 + 1.1, 0.0]);
            cloud.h.push(24.0);
            cloud.weight.push(16.0);
            cloud.attribute.push(5.0);
        }
    }
    for method in [Method::Exact, Method::Pyramid] {
        let picture = cloud.draw(&front(80, 80), method, Kernel::CubicSpline);
        for (index, &p) in picture.p.iter().enumerate() {
            assert!((p - 1.0).abs() < 1e-3, "{method:?} pixel {index}: {p}");
            assert!((picture.s(index).expect("drawn") - 5.0).abs() < 1e-4, "{method:?} pixel {index}");
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let cloud = Cloud::new(2, 60_000, [300.0, 300.0, 50.0], [0.2, 40.0]);
    let view = front(300, 300);
    let draw_with = |threads: usize, method| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| cloud.draw(&view, method, Kernel::CubicSpline))
    };
    let fast = draw_with(1, Method::Pyramid);
    assert!([2, 3, 8].into_iter().all(|threads| draw_with(threads, Method::Pyramid) == fast));
    let exact = draw_with(1, Method::Exact);
    assert!(draw_with(3, Method::Exact) == exact);
}

#[test]
fn relative_positions_and_channels_agree() {
    let cloud = Cloud::new(4, 500, [64.0, 64.0, 5.0], [0.5, 20.0]);
    let origin = DVec3::new(10.0, -3.0, 2.0);
    let offset = |&p: &[f64; 3]| (DVec3::from_array(p) - origin).as_vec3().to_array();
    let offsets: Vec<[f32; 3]> = cloud.positions.iter().map(offset).collect();
    let positions = Positions::Relative { origin, scale: 1.0, offsets: &offsets };
    let relative = Splats::new(positions, Extent::World(&cloud.h), &cloud.weight, None).expect("columns");
    let (view, options) = (front(64, 64), SplatOptions::default());
    let with_s = cloud.draw(&view, Method::Pyramid, Kernel::CubicSpline);
    let without = draw(&view, &[relative], &options);
    assert!(without.ps.is_empty() && with_s.has_attribute());
    assert!(without.error_against(&with_s).0 < 1e-5);
    assert_eq!(draw(&view, &[], &options).sum(), 0.0);
    let whole = cloud.splats(None);
    let twice = draw(&view, &[whole, whole], &options);
    assert!((twice.sum() / (2.0 * with_s.sum()) - 1.0).abs() < 1e-6);
}

#[test]
fn what_cannot_be_drawn_is_left_out() {
    let bad = [f64::NAN, f64::INFINITY, 1e300];
    let positions: Vec<[f64; 3]> =
        bad.iter().map(|&x| [x, 5.0, 0.0]).chain([[5.0, 5.0, 2e4], [5.0, 5.0, 0.0]]).collect();
    let (h, weight) = ([1.0, 1.0, 1.0, 1.0, f32::NAN], [1.0; 5]);
    let splats = Splats::new(Positions::World(&positions), Extent::World(&h), &weight, None).expect("columns");
    let perspective = View { projection: Projection::Perspective { fov_y: 1.0 }, ..front(10, 10) };
    for view in [front(10, 10), perspective] {
        for method in [Method::Exact, Method::Pyramid] {
            assert_eq!(draw(&view, &[splats], &options(method, Kernel::Poly6)).sum(), 0.0);
        }
    }
    let error = Splats::new(Positions::World(&positions), Extent::World(&h[1..]), &weight, None).expect_err("lengths");
    assert_eq!(error.to_string(), "smoothing length has 4 values, expected 5");
}

#[test]
fn stars_have_their_flux_at_any_distance() {
    let positions = [[0.0, 0.0, -3.0], [0.1, 0.2, -900.0]];
    let projection = Projection::Perspective { fov_y: 0.9 };
    let view = View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, projection, 64, 48).expect("view");
    for radius in [0.8, 2.5, 9.0] {
        let splats = Splats::new(Positions::World(&positions), Extent::Pixels(radius), &[4.0, 1.0], None);
        for method in [Method::Exact, Method::Pyramid] {
            let splats = splats.clone().expect("columns");
            let sum = draw(&view, &[splats], &options(method, Kernel::Poly6)).sum();
            assert!((sum - 5.0).abs() < 1e-4, "{method:?} {radius}: {sum}");
        }
    }
}

#[test]
fn discs_of_any_size_have_their_flux_in_perspective() {
    let mut cloud = Cloud::new(21, 400, [1.0; 3], [0.1, 0.2]);
    cloud.positions.iter_mut().for_each(|position| position.iter_mut().for_each(|x| *x -= 0.5));
    let eye = DVec3::new(1.3, 0.7, 2.0);
    let projection = Projection::Perspective { fov_y: 0.8 };
    let view = View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, 480, 480).expect("a view");
    for radius in [0.7, 2.5, 6.0, 29.0, 60.0] {
        let splats = Splats::new(Positions::World(&cloud.positions), Extent::Pixels(radius), &cloud.weight, None);
        let splats = splats.expect("columns");
        let [exact, pyramid] = [Method::Exact, Method::Pyramid]
            .map(|method| draw(&view, std::slice::from_ref(&splats), &options(method, Kernel::CubicSpline)));
        let (l1, l2) = relative_error(&pyramid.p, &exact.p);
        assert!(l1 < 1e-3 && l2 < 1e-3, "radius {radius}: L1 {l1}, L2 {l2}");
        assert!(
            (exact.sum() / cloud.total() - 1.0).abs() < 1e-3,
            "radius {radius}: {} of {}",
            exact.sum(),
            cloud.total()
        );
    }
}
