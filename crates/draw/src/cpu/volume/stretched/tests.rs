//! Ellipsoids on their way to a grid: shapes, fields against exact sums, and what must not change a picture.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::cpu::volume::bricks::Slab;
use crate::cpu::volume::exact::ExactField;
use crate::cpu::volume::resample::Resampler;
use crate::cpu::volume::tests::{RAMP, look, perspective, scenery};
use crate::cpu::volume::{self, Prepared, VolumeOptions, prepare};
use crate::cpu::{Extent, Positions, Splats};
use crate::model::{Covariance, Kernel};
use crate::synth::random::Random;
use crate::view::{Projection, View};
use glam::DQuat;

/// Columns of ellipsoids that own their values.
#[derive(Clone, Default)]
pub(in crate::cpu) struct Ellipsoids {
    pub positions: Vec<[f64; 3]>,
    pub covariances: Vec<Covariance>,
    pub mass: Vec<f32>,
    pub attribute: Vec<f32>,
}

/// Any rotation.
pub(in crate::cpu) fn rotation(random: &mut Random) -> DMat3 {
    DMat3::from_quat(DQuat::from_array([0; 4].map(|_| random.normal())).normalize())
}

impl Ellipsoids {
    /// Adds one with these semi-axes of a kernel along the columns of a rotation.
    pub fn push(&mut self, position: DVec3, radii: DVec3, axes: DMat3, kernel: Kernel, [mass, attribute]: [f32; 2]) {
        let matrix = axes * DMat3::from_diagonal(kernel.variance() * radii * radii) * axes.transpose();
        self.positions.push(position.to_array());
        self.covariances.push(Covariance::of(matrix));
        self.mass.push(mass);
        self.attribute.push(attribute);
    }

    /// Some around the origin, of very different sizes, each down to `flattest` as thin as it is long.
    fn some(count: usize, sizes: [f64; 2], flattest: f64, kernel: Kernel) -> Ellipsoids {
        let mut random = Random::new(31, 0);
        let mut all = Ellipsoids::default();
        for _ in 0..count {
            let place = DVec3::from_array([0; 3].map(|_| 2.0 * random.normal()));
            let long = sizes[0] * (sizes[1] / sizes[0]).powf(random.uniform());
            let radii = long * DVec3::new(1.0, flattest.powf(random.uniform()), flattest.powf(random.uniform()));
            let values = [(long * long) as f32, random.uniform() as f32];
            all.push(place, radii, rotation(&mut random), kernel, values);
        }
        all
    }

    pub fn batch(&self) -> Splats<'_> {
        let extent = Extent::Ellipsoids(&self.covariances);
        Splats::new(Positions::World(&self.positions), extent, &self.mass, Some(&self.attribute)).unwrap()
    }

    /// All of it turned around the origin.
    fn turned(&self, turn: DMat3) -> Ellipsoids {
        let position = |position: &[f64; 3]| (turn * DVec3::from_array(*position)).to_array();
        let covariance = |covariance: &Covariance| Covariance::of(turn * covariance.matrix() * turn.transpose());
        Ellipsoids {
            positions: self.positions.iter().map(position).collect(),
            covariances: self.covariances.iter().map(covariance).collect(),
            ..self.clone()
        }
    }
}

/// The whole grid in one slab.
fn resampled(view: &View, batch: Splats<'_>, options: &VolumeOptions) -> (Prepared, Slab) {
    let prepared = prepare(view, &[batch], options).unwrap();
    let layers = 0..prepared.brick_grid().bricks[2];
    let (layers, _) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
    (prepared, Slab { first: 0, layers })
}

/// Cells of a grid, every `stride`-th.
fn cells(prepared: &Prepared, stride: usize) -> impl Iterator<Item = [usize; 3]> + use<> {
    let [k, l, m] = prepared.grid.size.map(|size| size as usize);
    (0..k * l * m).step_by(stride).map(move |index| [index % k, index / k % l, index / k / l])
}

#[test]
fn triangular_factors_are_of_the_same_ellipsoid_and_slices_reach_as_far_as_their_points() {
    let mut random = Random::new(21, 0);
    for _ in 0..100 {
        let mut row = || DVec3::new(random.normal(), random.normal(), 0.05 * random.normal());
        let ellipsoid = Ellipsoid { camera: DVec3::ZERO, axes: DMat3::from_cols(row(), row(), row()) };
        let shape = Stretched::of(&ellipsoid, 0.0);
        let same = shape.ellipsoid(DVec3::ZERO);
        let [a, b] = [&ellipsoid, &same].map(|ellipsoid| ellipsoid.axes * ellipsoid.axes.transpose());
        assert!((a - b).to_cols_array().iter().all(|off| off.abs() < 1e-5), "{a} {b}");
        let mut inside = || DVec3::new(random.normal(), random.normal(), random.normal()).normalize();
        let (front, back) = (-0.4 * shape.half_depth(), 0.7 * shape.half_depth());
        let spans = shape.between([front, back]).unwrap();
        let mut found = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for _ in 0..8000 {
            let point = same.axes * inside();
            assert!((shape.to_ball(point).length() - 1.0).abs() < 1e-6);
            if point.z < f64::from(front) || point.z > f64::from(back) {
                continue;
            }
            for (axis, found) in found.iter_mut().enumerate() {
                *found = [found[0].min(point[axis]), found[1].max(point[axis])];
            }
        }
        for (span, found) in spans.map(|span| span.map(f64::from)).into_iter().zip(found) {
            let wide = span[1] - span[0];
            assert!(found[0] >= span[0] - 1e-5 * wide && found[1] <= span[1] + 1e-5 * wide, "{found:?} {span:?}");
            assert!(found[1] - found[0] > 0.8 * wide, "{found:?} {span:?}");
        }
        assert!(shape.between([shape.half_depth(), 9.0]).is_none());
    }
}

#[test]
fn fields_are_the_exact_sums() {
    for kernel in Kernel::ALL {
        let all = Ellipsoids::some(600, [0.1, 1.5], 0.1, kernel);
        let field = ExactField::new(&[all.batch()], kernel);
        let views = [
            perspective(DVec3::new(0.3, 0.1, 1.0), 150, 110),
            perspective(DVec3::new(3.0, 5.0, 12.0), 150, 110),
            look(DVec3::new(6.0, 4.0, 9.0), Projection::Orthographic { height: 6.0 }, 120, 90),
        ];
        // Views know nothing of kernels.
        let count = if kernel == Kernel::CubicSpline { views.len() } else { 1 };
        for view in views.into_iter().take(count) {
            let options =
                VolumeOptions { kernel, smallest: 0.0, near: Some(0.2), far: Some(20.0), ..VolumeOptions::default() };
            let (prepared, slab) = resampled(&view, all.batch(), &options);
            let (mut squares, mut norms, mut most, mut samples) = ([0.0; 2], [0.0; 2], 0, 0);
            for cell in cells(&prepared, 97) {
                let center = prepared.grid.center(cell.map(|c| c as u32));
                let world = view.eye + center.x * view.right + center.y * view.up + center.z * view.forward;
                let exact = field.at(world);
                let found = slab.at(cell, prepared.brick_grid()).map(f64::from);
                for (k, exact) in [exact.density, exact.weighted].into_iter().enumerate() {
                    squares[k] += (found[k] - exact).powi(2);
                    norms[k] += exact * exact;
                }
                samples += usize::from(exact.particles > 0);
                most = most.max(exact.particles);
            }
            let errors = [0, 1].map(|k: usize| (squares[k] / norms[k]).sqrt());
            // Interpolation of wide ones errs by the fourth derivative.
            let bound = 5e-4 * (Kernel::CubicSpline.variance() / kernel.variance()).max(1.0).powi(3);
            assert!(
                samples > 500 && most > 3 && errors.iter().all(|&error| error < bound),
                "{kernel:?}: {errors:?} of {samples}"
            );
        }
    }
}

#[test]
fn balls_are_the_round_particles_that_they_are() {
    let mut random = Random::new(5, 2);
    let (mut all, mut lengths) = (Ellipsoids::default(), Vec::new());
    for _ in 0..400 {
        // From below a cell to half of the picture.
        let h = 0.004 * 300f64.powf(random.uniform());
        let place = DVec3::from_array([0; 3].map(|_| random.normal()));
        let values = [(h * h) as f32, random.uniform() as f32];
        all.push(place, DVec3::splat(h), rotation(&mut random), Kernel::CubicSpline, values);
        lengths.push(h as f32);
    }
    let round = Splats::new(Positions::World(&all.positions), Extent::World(&lengths), &all.mass, Some(&all.attribute))
        .unwrap();
    let view = perspective(DVec3::new(1.0, 2.0, 6.0), 120, 90);
    for smallest in [0.0, 2.0, 5.0] {
        let options = VolumeOptions { smallest, near: Some(0.5), far: Some(11.0), ..VolumeOptions::default() };
        let [(prepared, a), (other, b)] = [round, all.batch()].map(|batch| resampled(&view, batch, &options));
        assert_eq!(
            [prepared.particles.raised, prepared.particles.len()],
            [other.particles.raised, other.particles.len()]
        );
        let (mut off, mut peak) = (0.0f32, 0.0f32);
        for cell in cells(&prepared, 1) {
            let [a, b] = [&a, &b].map(|slab| slab.at(cell, prepared.brick_grid()));
            off = off.max((a[0] - b[0]).abs());
            peak = peak.max(a[0]);
        }
        assert!(peak > 0.0 && off < 2e-5 * peak, "{off} of {peak}");
    }
}

#[test]
fn what_is_thinner_than_the_grid_keeps_its_mass() {
    let mut random = Random::new(17, 0);
    for radii in [DVec3::new(0.5, 0.5, 1e-3), DVec3::new(0.5, 1e-3, 1e-3), DVec3::splat(1e-3)] {
        for _ in 0..6 {
            let mut all = Ellipsoids::default();
            let place = DVec3::from_array([0; 3].map(|_| random.uniform()));
            all.push(place, radii, rotation(&mut random), Kernel::CubicSpline, [3.0, 1.0]);
            let view = look(DVec3::new(1.0, 2.0, 9.0), Projection::Orthographic { height: 3.0 }, 60, 60);
            let (prepared, slab) = resampled(&view, all.batch(), &VolumeOptions::default());
            assert_eq!(prepared.particles.raised, 1);
            let sum: f64 = cells(&prepared, 1).map(|at| f64::from(slab.at(at, prepared.brick_grid())[0])).sum();
            let mass = sum * 0.05f64.powi(3);
            assert!((mass / 3.0 - 1.0).abs() < 0.015, "{radii}: {mass}");
        }
    }
}

#[test]
fn turning_everything_changes_nothing() {
    let all = Ellipsoids::some(300, [0.02, 1.0], 0.02, Kernel::CubicSpline);
    let scenery = scenery(RAMP, [0.1, 30.0], 1.0, vec![]);
    let mut random = Random::new(3, 3);
    let (eye, up) = (DVec3::new(2.0, 3.0, 9.0), DVec3::new(0.1, 1.0, 0.0));
    let picture = |turn: DMat3| {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(turn * eye, DVec3::ZERO, turn * up, projection, 90, 70).unwrap();
        let options = VolumeOptions { near: Some(2.0), far: Some(18.0), ..VolumeOptions::default() };
        volume::draw(&view, &[all.turned(turn).batch()], &scenery, &options).unwrap().0.rgba
    };
    let first = picture(DMat3::IDENTITY);
    assert!(first.iter().any(|pixel| pixel[3] > 0.3));
    for _ in 0..3 {
        let turned = picture(rotation(&mut random));
        let off = first.iter().zip(&turned).flat_map(|(a, b)| (0..4).map(|k| (a[k] - b[k]).abs())).fold(0.0, f32::max);
        assert!(off < 1e-3, "{off}");
    }
}

#[test]
fn exact_sums_of_an_ellipsoid_have_its_mass_its_moments_and_its_gradient() {
    let mut random = Random::new(13, 0);
    for kernel in Kernel::ALL {
        let mut all = Ellipsoids::default();
        let place = DVec3::new(0.2, -0.1, 0.3);
        all.push(place, DVec3::new(1.0, 0.6, 0.3), rotation(&mut random), kernel, [2.0, 0.0]);
        let field = ExactField::new(&[all.batch()], kernel);
        let (mut mass, mut moments) = (0.0, DMat3::ZERO);
        let step = 0.04;
        for index in 0..50 * 50 * 50 {
            let away = step * DVec3::new(f64::from(index % 50), f64::from(index / 50 % 50), f64::from(index / 2500));
            let away = away - 24.5 * step;
            let share = field.at(place + away).density * step.powi(3);
            mass += share;
            moments += share * DMat3::from_cols(away.x * away, away.y * away, away.z * away);
        }
        assert!((mass / 2.0 - 1.0).abs() < 1e-3, "{kernel:?}: {mass}");
        let expected = all.covariances[0].matrix();
        let off = (moments * mass.recip() - expected).to_cols_array().into_iter().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(off < 2e-3 * all.covariances[0].trace(), "{moments} {expected}");
        for _ in 0..20 {
            let point = place + 0.2 * DVec3::from_array([0; 3].map(|_| random.normal()));
            let gradient = field.at(point).gradient;
            for axis in DVec3::AXES {
                let [ahead, back] = [1e-6, -1e-6].map(|step| field.at(point + step * axis).density);
                assert!(((ahead - back) / 2e-6 - gradient.dot(axis)).abs() < 1e-3 * gradient.length().max(1.0));
            }
        }
    }
}
