//! Ellipsoidal splats against integrals of their density along rays, against spheres, and the fast method against the exact one.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::cases::cases;
use crate::color::Accumulation;
use crate::color::accumulation::relative_error;
use crate::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw, draw_counted};
use crate::model::{Covariance, Kernel};
use crate::view::{Projection, View};
use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;

/// Numbers in [0, 1), the same for the same seed: a multiplicative generator's upper bits.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.next()
    }

    /// A rotation, all equally likely.
    fn rotation(&mut self) -> DMat3 {
        loop {
            let turn = DQuat::from_array([0; 4].map(|_| self.between(-1.0, 1.0)));
            if (0.01..1.0).contains(&turn.length()) {
                return DMat3::from_quat(turn.normalize());
            }
        }
    }
}

#[derive(Clone, Default)]
struct Cloud {
    positions: Vec<[f64; 3]>,
    covariances: Vec<Covariance>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
}

impl Cloud {
    /// One splat of weight 2.5 whose support has these semi-axes.
    fn one(position: DVec3, semi_axes: DVec3, rotation: DMat3, kernel: Kernel) -> Cloud {
        let mut cloud = Cloud::default();
        cloud.push(position, semi_axes, rotation, kernel, 2.5, -4.0);
        cloud
    }

    fn push(
        &mut self,
        position: DVec3,
        semi_axes: DVec3,
        rotation: DMat3,
        kernel: Kernel,
        weight: f32,
        attribute: f32,
    ) {
        let variances = DMat3::from_diagonal(kernel.variance() * semi_axes * semi_axes);
        self.positions.push(position.to_array());
        self.covariances.push(Covariance::of(rotation * variances * rotation.transpose()));
        self.weight.push(weight);
        self.attribute.push(attribute);
    }

    /// Splats in a box with a corner at the origin: their longest semi-axes log-uniform between `radii`, the others down to a `flattest`
    /// of that.
    fn random(seed: u64, count: usize, size: [f64; 3], radii: [f64; 2], flattest: f64, kernel: Kernel) -> Cloud {
        let mut numbers = Numbers(seed);
        let mut cloud = Cloud::default();
        for _ in 0..count {
            let position = DVec3::from_array(size.map(|s| s * numbers.next()));
            let long = radii[0] * (radii[1] / radii[0]).powf(numbers.next());
            let semi_axes = long * DVec3::new(1.0, flattest.powf(numbers.next()), flattest.powf(numbers.next()));
            let rotation = numbers.rotation();
            let (weight, attribute) = (numbers.between(0.5, 1.5) as f32, numbers.between(-3.0, 7.0) as f32);
            cloud.push(position, semi_axes, rotation, kernel, weight, attribute);
        }
        cloud
    }

    fn splats(&self) -> Splats<'_> {
        let extent = Extent::Ellipsoids(&self.covariances);
        Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute)).unwrap()
    }

    fn draw(&self, view: &View, method: Method, kernel: Kernel) -> Accumulation {
        draw(view, &[self.splats()], &SplatOptions { method, kernel, ..SplatOptions::default() })
    }

    fn total(&self) -> f64 {
        self.weight.iter().map(|&w| f64::from(w)).sum()
    }
}

/// Looks along -z onto the rectangle from the origin to the picture's size, one unit a pixel, y upwards.
fn front(width: u32, height: u32) -> View {
    let eye = DVec3::new(0.5 * f64::from(width), 0.5 * f64::from(height), 1e4);
    let projection = Projection::Orthographic { height: f64::from(height) };
    View::look_at(eye, eye - DVec3::Z, DVec3::Y, projection, width, height).unwrap()
}

/// Looks from the origin along -z.
fn pinhole(fov_y: f64, width: u32, height: u32) -> View {
    View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, Projection::Perspective { fov_y }, width, height).unwrap()
}

/// The ellipsoid `x^T M^-1 x < 1` around a centre.
struct Stretched {
    center: DVec3,
    inverse: DMat3,
}

impl Stretched {
    /// How small `x^T M^-1 x` becomes along a line, and by how much it grows with the square of the way from there.
    fn least(&self, origin: DVec3, direction: DVec3) -> (f64, f64) {
        let from = origin - self.center;
        let across = self.inverse * direction;
        let curvature = direction.dot(across);
        let nearest = from - from.dot(across) / curvature * direction;
        (nearest.dot(self.inverse * nearest), curvature)
    }
}

/// A splat as rays meet it.
struct Target {
    support: Stretched,
    /// Where the ray through a pixel's middle passes if any ray of the pixel meets the support.
    around: Stretched,
    /// Weight over volume.
    density: f64,
}

impl Target {
    fn all(view: &View, cloud: &Cloud, kernel: Kernel) -> Vec<Target> {
        let of = |(i, covariance): (usize, &Covariance)| {
            let (matrix, center) = (covariance.matrix() * kernel.variance().recip(), DVec3::from(cloud.positions[i]));
            let depth = match view.projection {
                Projection::Perspective { .. } => {
                    center.distance(view.eye) + (covariance.trace() / kernel.variance()).sqrt()
                }
                Projection::Orthographic { .. } => 1.0,
            };
            // The most by which rays of a pixel are apart from its middle's in the support. The sum of `A` and `B` lies in `2 (A^2 + B^2)`.
            let apart = depth * 0.5f64.sqrt() / view.focal_pixels();
            let around = 2.0 * (matrix + DMat3::from_diagonal(DVec3::splat(apart * apart)));
            let [support, around] = [matrix, around].map(|matrix| Stretched { center, inverse: matrix.inverse() });
            Target { support, around, density: f64::from(cloud.weight[i]) / matrix.determinant().sqrt() }
        };
        cloud.covariances.iter().enumerate().map(of).collect()
    }

    /// The density along a ray, by the midpoint rule within the support.
    fn along_ray(&self, kernel: Kernel, origin: DVec3, direction: DVec3) -> f64 {
        const STEPS: u32 = 60;
        let (least, curvature) = self.support.least(origin, direction.normalize());
        if least >= 1.0 {
            return 0.0;
        }
        let half = ((1.0 - least) / curvature).sqrt();
        let step = 2.0 * half / f64::from(STEPS);
        let at = |k: u32| {
            let away = (f64::from(k) + 0.5) * step - half;
            kernel.value((least + curvature * away * away).max(0.0).sqrt())
        };
        self.density * step * (0..STEPS).map(at).sum::<f64>()
    }
}

/// Means over `n` x `n` rays in each pixel.
fn brute(view: &View, cloud: &Cloud, kernel: Kernel, n: u32) -> Vec<f32> {
    let targets = Target::all(view, cloud, kernel);
    let ray = |at: [f64; 2]| {
        let point = view.at_depth(at, 1.0);
        match view.projection {
            Projection::Perspective { .. } => (view.eye, point - view.eye),
            Projection::Orthographic { .. } => (point, view.forward),
        }
    };
    let mean = |pixel: u32| {
        let [x, y] = [pixel % view.width, pixel / view.width].map(f64::from);
        let (origin, middle) = ray([x + 0.5, y + 0.5]);
        let met: Vec<&Target> = targets.iter().filter(|target| target.around.least(origin, middle).0 < 1.0).collect();
        if met.is_empty() {
            return 0.0;
        }
        let within = |k: u32| (f64::from(k) + 0.5) / f64::from(n);
        let sum: f64 = (0..n * n)
            .map(|sub| {
                let (origin, direction) = ray([x + within(sub % n), y + within(sub / n)]);
                met.iter().map(|target| target.along_ray(kernel, origin, direction)).sum::<f64>()
            })
            .sum();
        (sum / f64::from(n * n)) as f32
    };
    (0..view.width * view.height).map(mean).collect()
}

/// Largest difference, relative to the largest value.
fn worst(found: &[f32], expected: &[f32]) -> f64 {
    let peak = expected.iter().copied().fold(0.0, f32::max);
    let difference = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    f64::from(difference) / f64::from(peak)
}

#[test]
fn exact_pictures_are_line_integrals() {
    let mut numbers = Numbers(3);
    for kernel in Kernel::ALL {
        for (size, n) in [(0.8, 64), (6.0, 24), (25.0, 12), (70.0, 6)] {
            let semi_axes = size * DVec3::new(1.0, 0.5, 0.1);
            let parallel = Cloud::one(DVec3::new(13.3, 10.8, 0.0), semi_axes, numbers.rotation(), kernel);
            let view = front(26, 22);
            let error = worst(&parallel.draw(&view, Method::Exact, kernel).p, &brute(&view, &parallel, kernel, n));
            assert!(error < 1e-3, "{kernel:?} {size}: {error} parallel");
            // From far away to such that hold the eye.
            for distance in [3.0, 30.0, 1000.0] {
                let view = pinhole(0.9, 26, 22);
                let scale = distance / view.focal_pixels();
                let place = distance * DVec3::new(0.15, -0.1, -1.0);
                let cloud = Cloud::one(place, scale * semi_axes, numbers.rotation(), kernel);
                let error = worst(&cloud.draw(&view, Method::Exact, kernel).p, &brute(&view, &cloud, kernel, n));
                assert!(error < 1e-3, "{kernel:?} {size} at {distance}: {error} perspective");
            }
        }
    }
}

#[test]
fn exact_pictures_of_slivers_are_line_integrals() {
    let mut numbers = Numbers(8);
    for _ in 0..6 {
        let kernel = Kernel::CubicSpline;
        let semi_axes = DVec3::new(9.0, 0.5, 0.1);
        let cloud = Cloud::one(DVec3::new(8.3, 7.8, 0.0), semi_axes, numbers.rotation(), kernel);
        let error =
            worst(&cloud.draw(&front(17, 15), Method::Exact, kernel).p, &brute(&front(17, 15), &cloud, kernel, 200));
        assert!(error < 1e-3, "{error}");
    }
}

#[test]
fn light_is_the_weight_at_any_size() {
    let mut numbers = Numbers(21);
    for kernel in Kernel::ALL {
        for flattest in [1.0f64, 0.3, 0.03, 0.001] {
            for i in 0..24 {
                let long = 1e-3 * 1e5f64.powf(f64::from(i) / 23.0);
                let semi_axes = long * DVec3::new(1.0, flattest.powf(numbers.next()), flattest);
                // All of it is in the picture, and of what the pyramid's levels make of it.
                let middle: u32 = match long {
                    ..12.0 => 32,
                    ..40.0 => 96,
                    _ => 160,
                };
                let [x, y] = [0.3 + numbers.next(), -0.2 - numbers.next()].map(|off| f64::from(middle) + off);
                let place = DVec3::new(x, y, 0.0);
                let cloud = Cloud::one(place, semi_axes, numbers.rotation(), kernel);
                for method in [Method::Exact, Method::Pyramid] {
                    let picture = cloud.draw(&front(2 * middle, 2 * middle), method, kernel);
                    let sum_s: f64 = picture.ps.iter().map(|&v| f64::from(v)).sum();
                    let error = (picture.sum() / 2.5 - 1.0).abs().max((sum_s / -10.0 - 1.0).abs());
                    // The fast method's samples of what is sampled are what those of balls are.
                    let bound = match (method, kernel) {
                        (Method::Exact, _) => 1e-6,
                        (_, Kernel::CubicSpline | Kernel::Poly6) => 5e-5,
                        // Narrower ones for the same radius have fewer samples across them.
                        _ => 5e-4,
                    };
                    assert!(error < bound, "{kernel:?} {method:?} {semi_axes}: {error}");
                }
            }
        }
    }
}

#[test]
fn fast_pictures_stay_close_to_exact_ones() {
    let view = front(300, 240);
    let octaves = [0.03, 0.3, 1.0, 3.0, 6.0, 12.0, 50.0, 300.0];
    for (k, kernel) in Kernel::ALL.into_iter().enumerate() {
        for (f, flattest) in [0.5, 0.1, 0.001].into_iter().enumerate() {
            // A third of all, in which any kernel and flatness, kernel and range, and flatness and range meet.
            let ranges = octaves.windows(2).map(|w| [w[0], w[1]]).chain([[0.1, 100.0]]);
            for radii in ranges.skip((k + f) % 3).step_by(3) {
                let count = if radii[1] > 60.0 { 150 } else { 1500 };
                let cloud = Cloud::random(11, count, [300.0, 240.0, 100.0], radii, flattest, kernel);
                let exact = cloud.draw(&view, Method::Exact, kernel);
                let fast = cloud.draw(&view, Method::Pyramid, kernel);
                let (l1, l2) = fast.error_against(&exact);
                let (s1, s2) = relative_error(&fast.ps, &exact.ps);
                println!("{kernel:?} {flattest} {radii:?}: L1 {l1:.1e} L2 {l2:.1e}, P S {s1:.1e} {s2:.1e}");
                // Two products are less of poly6 and Wendland's functions than of splines, and needles have their corners within a pixel.
                let is_spline = [Kernel::CubicSpline, Kernel::QuarticSpline, Kernel::QuinticSpline].contains(&kernel);
                let (most_l1, most_l2) =
                    (if is_spline { 2e-3 } else { 4e-3 }, if flattest < 0.01 { 7e-3 } else { 3e-3 });
                assert!(l1 < most_l1 && l2 < most_l2, "{kernel:?} {flattest} {radii:?}: {l1} {l2}");
                assert!(s1 < most_l1 && s2 < most_l2, "{kernel:?} {flattest} {radii:?}: {s1} {s2} in P S");
            }
        }
    }
}

#[test]
fn fast_pictures_stay_close_to_exact_ones_in_perspective() {
    let kernel = Kernel::CubicSpline;
    for (fov_y, eye) in [(0.6, [3.0, 2.0, 4.0]), (1.3, [0.8, 0.7, 1.5]), (1.9, [0.5, 0.5, 0.5])] {
        let (eye, target) = (DVec3::from_array(eye), DVec3::new(0.3, 0.4, 0.1));
        let view = View::look_at(eye, target, DVec3::Y, Projection::Perspective { fov_y }, 300, 240).unwrap();
        for (radii, count) in [([2e-4, 2e-3], 1500), ([2e-3, 2e-2], 1500), ([2e-2, 0.2], 400), ([0.2, 2.0], 50)] {
            let cloud = Cloud::random(5, count, [1.0; 3], radii, 0.1, kernel);
            let exact = cloud.draw(&view, Method::Exact, kernel);
            let fast = cloud.draw(&view, Method::Pyramid, kernel);
            let (l1, l2) = fast.error_against(&exact);
            println!("{fov_y} {radii:?}: L1 {l1:.1e} L2 {l2:.1e}");
            // Those at arm's length are ellipses to second order only.
            let is_far = radii[1] < 0.01;
            let [most_l1, most_l2] = if is_far { [1e-3, 2.5e-3] } else { [6e-3, 1.5e-2] };
            assert!(l1 < most_l1 && l2 < most_l2, "{fov_y} {radii:?}: {l1} {l2}");
        }
    }
}

#[test]
fn round_ellipsoids_are_balls() {
    let mut numbers = Numbers(4);
    for kernel in Kernel::ALL {
        let mut cloud = Cloud::default();
        let mut lengths = Vec::new();
        for _ in 0..300 {
            let place = DVec3::new(64.0 * numbers.next(), 64.0 * numbers.next(), -100.0 * numbers.next());
            let sigma = (0.02 * 1000f64.powf(numbers.next())) as f32;
            cloud.push(place, DVec3::ONE, DMat3::IDENTITY, kernel, 1.5, 2.0);
            let last = cloud.covariances.len() - 1;
            cloud.covariances[last] = Covariance::round(sigma * sigma);
            lengths.push((f64::from(sigma * sigma) / kernel.variance()).sqrt() as f32);
        }
        let extent = Extent::World(&lengths);
        let balls =
            Splats::new(Positions::World(&cloud.positions), extent, &cloud.weight, Some(&cloud.attribute)).unwrap();
        let eye = DVec3::new(32.0, 32.0, 60.0);
        let perspective =
            View::look_at(eye, eye - DVec3::Z, DVec3::Y, Projection::Perspective { fov_y: 0.9 }, 64, 64).unwrap();
        for view in [front(64, 64), perspective] {
            for method in [Method::Exact, Method::Pyramid] {
                let options = SplatOptions { method, kernel, ..SplatOptions::default() };
                let (l1, l2) = draw(&view, &[cloud.splats()], &options).error_against(&draw(&view, &[balls], &options));
                assert!(l1 < 1e-6 && l2 < 1e-6, "{kernel:?} {method:?}: {l1} {l2}");
                // Nearly round ones, which are drawn as ellipsoids, look the same.
                let mut nearly = cloud.clone();
                nearly.covariances.iter_mut().for_each(|covariance| covariance.0[0] *= 1.000_001);
                let (l1, l2) =
                    draw(&view, &[nearly.splats()], &options).error_against(&draw(&view, &[balls], &options));
                assert!(l1 < 3e-3 && l2 < 3e-3, "{kernel:?} {method:?}: {l1} {l2} nearly round");
            }
        }
    }
}

/// Second moments (xx, yy, xy) of a picture of this size about a point, the mean over `n` x `n` places of the grid of pixels.
fn second_moments(cloud: &Cloud, n: u32, [width, height]: [u32; 2], method: Method, kernel: Kernel) -> [f64; 3] {
    let mut mean = [0.0; 3];
    let mut moved = cloud.clone();
    for k in 0..n * n {
        let [x, y] = [k % n, k / n].map(|k| (f64::from(k) + 0.5) / f64::from(n));
        let place = DVec3::from_array(cloud.positions[0]) + DVec3::new(x, y, 0.0);
        moved.positions[0] = place.to_array();
        let picture = moved.draw(&front(width, height), method, kernel);
        let mut sums = [0.0; 4];
        for (index, &p) in (0..).zip(&picture.p) {
            let [column, row] = [index % width, index / width].map(|at| f64::from(at) + 0.5);
            let (x, y) = (column - place.x, f64::from(height) - row - place.y);
            let terms = [1.0, x * x, y * y, x * y];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += f64::from(p) * term);
        }
        (0..3).for_each(|k| mean[k] += sums[k + 1] / sums[0] / f64::from(n * n));
    }
    mean
}

#[test]
fn second_moments_are_those_of_the_covariance_and_a_pixel() {
    let mut numbers = Numbers(77);
    for kernel in Kernel::ALL {
        for (size, flattest) in [(0.4, 0.2), (3.0, 0.003), (4.0, 0.5), (9.0, 0.2), (20.0, 0.7), (60.0, 0.1)] {
            let semi_axes = size * DVec3::new(1.0, flattest, flattest);
            // What is smaller than a pixel has them in the mean over its places only.
            let (n, picture) = if size * flattest < 3.0 { (8, [64, 48]) } else { (1, [180, 160]) };
            let [x, y] = picture.map(|side| 0.5 * f64::from(side));
            let cloud = Cloud::one(DVec3::new(x, y, 0.0), semi_axes, numbers.rotation(), kernel);
            let [xx, yy, _, xy, ..] = cloud.covariances[0].0.map(f64::from);
            let pixel = (1.0 - f64::from(n * n).recip() * f64::from(n > 1)) / 12.0;
            let scale = pixel + size * size * kernel.variance();
            // Narrow ones have fewer samples across them on the pyramid's levels.
            let of_levels = if matches!(kernel, Kernel::CubicSpline | Kernel::Poly6) { 2e-3 } else { 1e-2 };
            for (method, bound) in [(Method::Exact, 5e-4), (Method::Pyramid, of_levels)] {
                let found = second_moments(&cloud, n, picture, method, kernel);
                let expected = [xx + pixel, yy + pixel, xy];
                let worst = (0..3).map(|k| (found[k] - expected[k]).abs() / scale).fold(0.0, f64::max);
                let bound = if n > 1 { 2e-2 } else { bound };
                assert!(worst < bound, "{kernel:?} {method:?} {size} {flattest}: {worst} {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn threads_change_no_bit_of_ellipsoids() {
    let cloud = Cloud::random(2, 40_000, [300.0, 300.0, 50.0], [0.2, 40.0], 0.05, Kernel::CubicSpline);
    let eye = DVec3::new(150.0, 150.0, 260.0);
    let perspective =
        View::look_at(eye, eye - DVec3::Z, DVec3::Y, Projection::Perspective { fov_y: 0.9 }, 300, 300).unwrap();
    for view in [front(300, 300), perspective] {
        let draw_with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| cloud.draw(&view, Method::Pyramid, Kernel::CubicSpline))
        };
        let one = draw_with(1);
        assert!([2, 8].into_iter().all(|threads| draw_with(threads) == one));
    }
}

#[test]
fn what_is_no_covariance_is_left_out() {
    let mut bad = vec![
        Covariance::default(),
        Covariance::round(-1.0),
        Covariance::round(f32::NAN),
        Covariance([1.0, 1.0, -0.1, 0.0, 0.0, 0.0]),
        Covariance([1.0, 1.0, 1.0, 2.0, 0.0, 0.0]),
        Covariance([f32::MAX, 1.0, 1.0, 0.0, f32::INFINITY, 0.0]),
    ];
    for k in 0..6 {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut values = [3.0, 2.0, 1.0, 0.1, 0.2, 0.3];
            values[k] = value;
            bad.push(Covariance(values));
        }
    }
    let (positions, weight) = (vec![[5.0, 5.0, 0.0]; bad.len()], vec![1.0; bad.len()]);
    let splats = Splats::new(Positions::World(&positions), Extent::Ellipsoids(&bad), &weight, None).unwrap();
    let perspective = View { projection: Projection::Perspective { fov_y: 1.0 }, ..front(10, 10) };
    for view in [front(10, 10), perspective] {
        for method in [Method::Exact, Method::Pyramid] {
            let options = SplatOptions { method, ..SplatOptions::default() };
            let (picture, counts) = draw_counted(&view, &[splats], &options);
            assert!(picture.sum() == 0.0 && counts.drawn == 0, "{counts:?}");
        }
    }
    let error = Splats::new(Positions::World(&positions), Extent::Ellipsoids(&bad[1..]), &weight, None).unwrap_err();
    assert_eq!(error.to_string(), format!("covariance has {} values, expected {}", bad.len() - 1, bad.len()));
}

#[test]
fn flat_and_line_like_ones_have_their_light() {
    // Matrices that are singular but for rounding: rods and discs of no thickness, along axes and turned.
    let mut numbers = Numbers(6);
    for values in [DVec3::new(4.0, 0.0, 0.0), DVec3::new(4.0, 4.0, 0.0), DVec3::new(100.0, 1e-9, 0.0)] {
        for k in 0..12 {
            let rotation = if k == 0 { DMat3::IDENTITY } else { numbers.rotation() };
            let mut cloud = Cloud::one(DVec3::new(60.2, 59.6, 0.0), DVec3::ONE, rotation, Kernel::CubicSpline);
            cloud.covariances[0] = Covariance::of(rotation * DMat3::from_diagonal(values) * rotation.transpose());
            for method in [Method::Exact, Method::Pyramid] {
                let sum = cloud.draw(&front(120, 120), method, Kernel::CubicSpline).sum();
                assert!((sum / 2.5 - 1.0).abs() < 1e-5, "{method:?} {values} turn {k}: {sum}");
                let eye = DVec3::new(60.0, 60.0, 90.0);
                let projection = Projection::Perspective { fov_y: 1.0 };
                let view = View::look_at(eye, eye - DVec3::Z, DVec3::Y, projection, 100, 100).unwrap();
                let picture = cloud.draw(&view, method, Kernel::CubicSpline);
                let light = picture.sum() * (90.0 / view.focal_pixels()).powi(2);
                assert!((light / 2.5 - 1.0).abs() < 0.05, "{method:?} {values} turn {k}: {light} in perspective");
            }
        }
    }
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn whatever_the_matrix_pictures_are_finite(
        entries in prop::array::uniform6(prop_oneof![-1e3..1e3f32, -1e-6..1e-6f32, Just(0.0f32), any::<f32>()]),
        place in prop::array::uniform3(-30.0..30.0f64), fov_y in 0.1..2.5f64,
    ) {
        let cloud = Cloud {
            positions: vec![place],
            covariances: vec![Covariance(entries)],
            weight: vec![1.0],
            attribute: vec![1.0],
        };
        let views = [front(24, 20), View { eye: DVec3::new(12.0, 10.0, 30.0), ..front(24, 20) }, pinhole(fov_y, 24, 20)];
        for view in views {
            let picture = cloud.draw(&view, Method::Pyramid, Kernel::CubicSpline);
            prop_assert!(picture.p.iter().all(|p| p.is_finite()));
        }
    }

    #[test]
    fn the_mass_is_that_in_view_in_any_orthographic_view(seed: u64, turn in -1.0..1.0f64, roll in 0.1..3.0f64) {
        let cloud = Cloud::random(seed, 60, [1.0; 3], [2e-4, 0.5], 0.01, Kernel::CubicSpline);
        let eye = DVec3::new(turn * 9.0, 4.0, 7.0);
        let up = DVec3::new(roll.sin(), roll.cos(), 0.3);
        let view = View::look_at(eye, DVec3::splat(0.5), up, Projection::Orthographic { height: 3.0 }, 220, 200).unwrap();
        let pixel = 1.0 / view.focal_pixels();
        for (method, bound) in [(Method::Exact, 1e-6), (Method::Pyramid, 1e-5)] {
            let sum = cloud.draw(&view, method, Kernel::CubicSpline).sum() * pixel * pixel;
            prop_assert!((sum / cloud.total() - 1.0).abs() < bound, "{method:?}: {}", sum / cloud.total());
        }
    }
}
