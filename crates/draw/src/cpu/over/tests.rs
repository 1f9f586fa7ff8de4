#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod faces;

use super::*;
use crate::color::transfer::TransferFunction;
use crate::cpu::volume::tests::{look, merger, perspective};
use crate::cpu::{Method, Positions, SplatOptions, draw_counted};
use crate::model::Covariance;
use crate::synth::random::Random;
use glam::DVec3;

/// Of the mass and the density of all splats here.
const COLUMN: OwnColumn = OwnColumn { power: Some(1), particle: 1.0, variance: 0.075, density_scale: 1.0 };

/// Splats of any shape with densities and attributes.
#[derive(Clone, Default)]
struct Scene {
    positions: Vec<[f64; 3]>,
    covariances: Vec<Covariance>,
    weight: Vec<f32>,
    density: Vec<f32>,
    attribute: Vec<f32>,
}

impl Scene {
    fn push(&mut self, position: [f64; 3], covariance: Covariance, weight: f32, attribute: f32) {
        self.positions.push(position);
        self.covariances.push(covariance);
        self.weight.push(weight);
        self.density.push(1.0);
        self.attribute.push(attribute);
    }

    fn batch(&self) -> Splats<'_> {
        let extent = Extent::Ellipsoids(&self.covariances);
        let batch = Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute));
        batch.unwrap().with_density(Some(&self.density)).unwrap()
    }

    /// Flat and long ones at random, some of them at one place if they `coincide`.
    fn random(count: usize, seed: u64, coincide: bool) -> Scene {
        let mut random = Random::new(seed, 1);
        let mut scene = Scene::default();
        for i in 0..count {
            let mut value = || 2.0 * random.uniform() - 1.0;
            let axes = glam::DMat3::from_quat(glam::DQuat::from_xyzw(value(), value(), value(), 1.1).normalize());
            let radii = DVec3::new(0.25, 0.05, 0.1) * (1.2 + value());
            let covariance = Covariance::of(axes * glam::DMat3::from_diagonal(radii * radii) * axes.transpose());
            let place = if coincide && i % 5 == 4 { scene.positions[i - 1] } else { [value(), value(), value()] };
            scene.push(place, covariance, 1.0 + value() as f32, value() as f32);
        }
        scene
    }

    fn shuffled(&self, seed: u64) -> Scene {
        let mut random = Random::new(seed, 2);
        let mut scene = self.clone();
        for i in (1..scene.weight.len()).rev() {
            let j = (random.uniform() * (i + 1) as f64) as usize;
            scene.positions.swap(i, j);
            scene.covariances.swap(i, j);
            scene.weight.swap(i, j);
            scene.attribute.swap(i, j);
        }
        scene
    }
}

fn colors(range: [f64; 2]) -> SplatColors {
    let [low, high] = range;
    let text = format!(
        "(range: fixed({low}, {high}), opacity: [(0.0, 0.0), (1.0, 0.9)], brightness: [(0.0, 0.5)], \
         hue: (color_map: \"plasma\", scale: linear, range: fixed(-1.0, 1.0)))"
    );
    let transfer = TransferFunction::parse(&text, "t").unwrap();
    SplatColors::new(&transfer, transfer.numbers().unwrap())
}

fn picture(view: &View, batch: Splats<'_>, colors: &SplatColors, order: Order) -> Colors {
    let over = Over { order, kernel: Kernel::CubicSpline, colors, column: COLUMN, around: None };
    draw(view, &[batch], &over).0
}

fn bits(colors: &Colors) -> Vec<u32> {
    colors.rgba.as_flattened().iter().map(|c| c.to_bits()).collect()
}

/// Largest difference of any channel, and the mean of all.
fn difference(a: &Colors, b: &Colors) -> (f32, f32) {
    let pairs = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened());
    let differ = pairs.map(|(a, b)| (a - b).abs());
    let (largest, sum) = differ.fold((0.0, 0.0), |(largest, sum): (f32, f32), d| (largest.max(d), sum + d));
    (largest, sum / (4 * a.rgba.len()) as f32)
}

#[test]
fn the_nearer_one_of_two_lies_over_the_other() {
    let colors = colors([0.01, 1.0]);
    let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 2.0 }, 65, 65);
    let (h, variance) = (0.5, Kernel::CubicSpline.variance());
    let round = Covariance::round((h * h * variance) as f32);
    for nearer in [1.0, -1.0] {
        let mut scene = Scene::default();
        scene.push([0.0, 0.0, nearer], round, 0.07, 0.8);
        scene.push([0.0, 0.0, -nearer], round, 0.05, -0.6);
        let drawn = picture(&view, scene.batch(), &colors, Order::Exact);
        let radius = h.hypot(LOW_PASS * 2.0 / 65.0);
        // In the middle, and a few pixels beside it.
        for column in [32, 36, 40] {
            let q = f64::from(column - 32) * 2.0 / 65.0 / radius;
            let depth = |weight: f64| colors.depth() * weight * Kernel::CubicSpline.projected(q) / (radius * radius);
            let own = COLUMN.of(1.0, Some(1.0), 1.0);
            let layer =
                |weight: f64, attribute: f32| (1.0 - (-depth(weight)).exp(), colors.light(own, Some(attribute)));
            let (first, second) = (layer(0.07, 0.8), layer(0.05, -0.6));
            let [front, back] = if nearer > 0.0 { [first, second] } else { [second, first] };
            let found = drawn.rgba[32 * 65 + column as usize];
            for k in 0..3 {
                let expected = front.0 * f64::from(front.1[k]) + (1.0 - front.0) * back.0 * f64::from(back.1[k]);
                assert!((f64::from(found[k]) - expected).abs() < 2e-3, "{column}: {found:?} {expected}");
            }
            let opacity = 1.0 - (-depth(0.12)).exp();
            assert!((f64::from(found[3]) - opacity).abs() < 2e-3, "{column}: {found:?} {opacity}");
        }
    }
}

#[test]
fn the_order_of_the_input_and_threads_change_nothing() {
    let (scene, colors) = (Scene::random(3_000, 5, true), colors([0.1, 100.0]));
    let view = perspective(DVec3::new(1.0, 2.0, 4.0), 90, 70);
    let first = picture(&view, scene.batch(), &colors, Order::Exact);
    assert!(first.rgba.iter().any(|pixel| pixel[3] > 0.5) && first.rgba.iter().any(|pixel| pixel[3] < 0.1));
    let shuffled = scene.shuffled(7);
    assert_eq!(bits(&first), bits(&picture(&view, shuffled.batch(), &colors, Order::Exact)));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for order in Order::ALL {
        let all = picture(&view, scene.batch(), &colors, order);
        assert_eq!(bits(&all), bits(&pool.install(|| picture(&view, scene.batch(), &colors, order))), "{order:?}");
    }
}

#[test]
fn finer_buckets_come_nearer_to_the_exact_order() {
    let (scene, colors) = (Scene::random(4_000, 11, false), colors([0.1, 100.0]));
    let view = perspective(DVec3::new(-2.0, 1.0, 3.0), 80, 60);
    let exact = picture(&view, scene.batch(), &colors, Order::Exact);
    let off = |order| difference(&exact, &picture(&view, scene.batch(), &colors, order)).1;
    let [none, coarse, fine] = [Order::None, Order::CoarseBuckets, Order::Buckets].map(off);
    assert!(fine < 0.5 * coarse && coarse < 0.2 * none && fine < 1e-4, "{fine} {coarse} {none}");
}

#[test]
fn opacity_is_that_of_the_sum_however_matter_is_divided() {
    let colors = colors([0.01, 20.0]);
    for view in [
        perspective(DVec3::new(0.4, 0.9, 5.0), 120, 90),
        look(DVec3::new(0.0, 3.0, 3.0), Projection::Orthographic { height: 2.5 }, 120, 90),
    ] {
        let mut scene = Scene::random(40, 3, false);
        // Wide ones, which the blur of a pixel leaves nearly as they are.
        for covariance in &mut scene.covariances {
            let grown = 0.5 * covariance.matrix() + glam::DMat3::from_diagonal(DVec3::splat(0.02));
            *covariance = Covariance::of(grown);
        }
        let all = picture(&view, scene.batch(), &colors, Order::Exact);
        let options = SplatOptions { method: Method::Exact, ..SplatOptions::default() };
        let (sums, _) = draw_counted(&view, &[scene.batch()], &options);
        for (pixel, p) in all.rgba.iter().zip(&sums.p) {
            let expected = 1.0 - (-colors.depth() * f64::from(*p)).exp();
            assert!((f64::from(pixel[3]) - expected).abs() < 0.02, "{pixel:?} {expected}");
        }
        // Each as two of half the weight.
        let mut halves = scene.clone();
        halves.weight.iter_mut().for_each(|weight| *weight *= 0.5);
        for i in 0..40 {
            halves.push(scene.positions[i], scene.covariances[i], 0.5 * scene.weight[i], scene.attribute[i]);
        }
        let (largest, _) = difference(&all, &picture(&view, halves.batch(), &colors, Order::Exact));
        assert!(largest < 2e-3, "{largest}");
    }
}

#[test]
fn small_splats_keep_their_light_wherever_they_are() {
    let colors = colors([0.01, 1000.0]);
    let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 2.0 }, 40, 40);
    let area = (2.0f64 / 40.0).powi(2);
    let mut random = Random::new(4, 4);
    for shape in [[1e-8, 1e-8, 1e-8, 0.0, 0.0, 0.0], [1e-3, 1e-9, 1e-9, 0.0, 0.0, 0.0]] {
        for _ in 0..20 {
            let mut scene = Scene::default();
            scene.push([random.uniform() - 0.5, random.uniform() - 0.5, 0.0], Covariance(shape), 1e-4, 0.0);
            let drawn = picture(&view, scene.batch(), &colors, Order::Exact);
            let depth = |pixel: &[f32; 4]| -(1.0 - f64::from(pixel[3])).ln() / colors.depth();
            let sum: f64 = drawn.rgba.iter().map(depth).sum::<f64>() * area;
            assert!((sum / 1e-4 - 1.0).abs() < 0.01, "{sum}");
        }
    }
}

#[test]
fn what_cannot_be_seen_is_left_out() {
    let colors = colors([0.01, 1.0]);
    let view = perspective(DVec3::new(0.0, 0.0, 5.0), 30, 20);
    let mut scene = Scene::default();
    let round = Covariance::round(0.1);
    for (place, covariance, weight) in [
        ([0.0, 0.0, 9.0], round, 1.0),
        ([f64::NAN, 0.0, 0.0], round, 1.0),
        ([0.0; 3], Covariance::default(), 1.0),
        ([0.0; 3], Covariance::round(f32::NAN), 1.0),
        ([0.0; 3], round, 0.0),
        ([0.0; 3], round, -1.0),
        ([0.0; 3], round, f32::NAN),
    ] {
        scene.push(place, covariance, weight, 0.0);
    }
    for order in Order::ALL {
        assert!(picture(&view, scene.batch(), &colors, order).rgba.iter().all(|pixel| *pixel == [0.0; 4]));
        assert!(picture(&view, Scene::default().batch(), &colors, order).rgba.iter().all(|pixel| *pixel == [0.0; 4]));
    }
}

#[test]
fn balls_are_round_ellipsoids() {
    let cloud = merger(2_000);
    let view = perspective(DVec3::new(60.0, 40.0, 90.0), 80, 60);
    let variance = Kernel::CubicSpline.variance();
    let covariances: Vec<Covariance> = cloud
        .h
        .iter()
        .map(|h| {
            let square = (f64::from(*h).powi(2) * variance) as f32;
            Covariance([square, square, square * 1.0001, 0.0, 0.0, 0.0])
        })
        .collect();
    let density = vec![1e-3; cloud.h.len()];
    let colors = colors([1e-4, 1.0]);
    let stretched = Splats::new(
        Positions::World(&cloud.positions),
        Extent::Ellipsoids(&covariances),
        &cloud.mass,
        Some(&cloud.attribute),
    )
    .unwrap()
    .with_density(Some(&density))
    .unwrap();
    let balls = cloud.batch().with_density(Some(&density)).unwrap();
    let found =
        difference(&picture(&view, balls, &colors, Order::Exact), &picture(&view, stretched, &colors, Order::Exact));
    assert!(found.1 < 1e-3, "{found:?}");
}
