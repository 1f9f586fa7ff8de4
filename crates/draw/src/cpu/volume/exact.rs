//! The exact SPH sum at any point, in double precision (F12 3.2, 3.3): the reference for every resampled field.
//!
//! `rho(r) = sum m_j W(|r - r_j|, h_j)`, the mass-weighted mean of an attribute
//! `S(r) = sum m_j A_j W / sum m_j W`, and gradients by the kernel's derivative, `grad W = W'(r) (r - r_j) / |r - r_j|`. An ellipsoid of the
//! covariance `C` has `W(q) / sqrt(det M)` with `q^2 = d^T M^-1 d` and `M = C / v`, for the kernel's variance `v`.
//!
//! Particles are sorted by the power of two above their smoothing length or longest semi-axis, and within each such class into cubes of that
//! width, so that a point looks at 27 cubes of each class, however much smoothing lengths differ.

use super::super::{Extent, Splats};
use crate::model::Kernel;
use glam::{DMat3, DVec3, I64Vec3};
use std::collections::{BTreeMap, HashMap};

/// Particles of one class of smoothing lengths, by cube.
type Class = HashMap<I64Vec3, Vec<u32>>;

/// A field that can be asked for its value anywhere.
pub struct ExactField {
    kernel: Kernel,
    /// World position, and support.
    places: Vec<(DVec3, Support)>,
    /// `m`, and `m A`.
    masses: Vec<(f64, f64)>,
    /// Exponent of the cubes' width, and the cubes.
    classes: BTreeMap<i32, Class>,
}

/// Where a kernel is not zero.
#[derive(Clone, Copy)]
enum Support {
    /// Within `h`.
    Ball(f64),
    /// Where this matrix takes the way from the centre into the unit ball.
    Ellipsoid(DMat3),
}

impl Support {
    /// That of a particle of a batch and its longest radius; `None` where it has none in world units.
    fn of(batch: &Splats<'_>, index: usize, kernel: Kernel) -> Option<(Support, f64)> {
        match batch.extent() {
            Extent::World(lengths) => Some((Support::Ball(f64::from(lengths[index])), f64::from(lengths[index]))),
            Extent::Pixels(_) => None,
            Extent::Ellipsoids(covariances) => {
                let (values, axes) = covariances[index].principal();
                let radii = (values / kernel.variance()).map(f64::sqrt);
                let to_ball = DMat3::from_diagonal(radii.recip()) * axes.transpose();
                Some((Support::Ellipsoid(to_ball), radii.x))
            }
        }
    }

    /// Whether it can be divided by.
    fn is_usable(&self) -> bool {
        match self {
            Support::Ball(h) => *h > 0.0 && h.is_finite(),
            Support::Ellipsoid(to_ball) => to_ball.is_finite(),
        }
    }

    /// This far from the centre: `q`, what the kernel's value there is multiplied by, and the gradient of `q` (none at the centre).
    fn at(&self, away: DVec3) -> (f64, f64, Option<DVec3>) {
        let distance = away.length();
        match self {
            Support::Ball(h) => (distance / h, (h * h * h).recip(), (distance > 0.0).then(|| away / (distance * h))),
            Support::Ellipsoid(to_ball) => {
                let inside = *to_ball * away;
                let q = inside.length();
                (q, to_ball.determinant().abs(), (q > 0.0).then(|| to_ball.transpose() * inside / q))
            }
        }
    }
}

/// What the field is at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// `sum m W`: the density.
    pub density: f64,
    /// `sum m A W`.
    pub weighted: f64,
    /// Gradient of the density, world axes.
    pub gradient: DVec3,
    /// Number of particles within whose support the point lies.
    pub particles: u32,
}

impl Sample {
    /// The attribute's mean; 0 where there is no density.
    pub fn mean(&self) -> f64 {
        if self.density > 0.0 { self.weighted / self.density } else { 0.0 }
    }
}

impl ExactField {
    /// The field of batches in world units; particles with a value that is not finite, or no extent, are left out, and those
    /// whose extent is in pixels.
    pub fn new(batches: &[Splats<'_>], kernel: Kernel) -> ExactField {
        let mut field = ExactField { kernel, places: Vec::new(), masses: Vec::new(), classes: BTreeMap::new() };
        for batch in batches {
            for i in 0..batch.len() {
                let Some((support, longest)) = Support::of(batch, i, kernel) else { break };
                let (position, mass) = (batch.positions().world(i), f64::from(batch.weight()[i]));
                let attribute = batch.attribute().map_or(0.0, |values| f64::from(values[i]));
                if !(position.is_finite() && mass.is_finite() && attribute.is_finite() && support.is_usable()) {
                    continue;
                }
                let class = longest.log2().ceil() as i32;
                let cube = cube(position, class);
                let index = field.places.len() as u32;
                field.classes.entry(class).or_default().entry(cube).or_default().push(index);
                field.places.push((position, support));
                field.masses.push((mass, mass * attribute));
            }
        }
        field
    }

    /// The field at a world position.
    pub fn at(&self, point: DVec3) -> Sample {
        let mut sample = Sample::default();
        for (&class, cubes) in &self.classes {
            let middle = cube(point, class);
            for offset in 0..27 {
                let offset = I64Vec3::new(offset % 3 - 1, offset / 3 % 3 - 1, offset / 9 - 1);
                for &index in cubes.get(&(middle + offset)).into_iter().flatten() {
                    let (position, support) = self.places[index as usize];
                    let (q, per_volume, growth) = support.at(point - position);
                    if q >= 1.0 {
                        continue;
                    }
                    let (mass, weighted) = self.masses[index as usize];
                    let value = self.kernel.value(q) * per_volume;
                    sample.density += mass * value;
                    sample.weighted += weighted * value;
                    sample.particles += 1;
                    sample.gradient += mass * self.kernel.slope(q) * per_volume * growth.unwrap_or(DVec3::ZERO);
                }
            }
        }
        sample
    }
}

/// The cube that holds a position, for cubes `2^class` wide.
fn cube(position: DVec3, class: i32) -> I64Vec3 {
    (position / 2.0f64.powi(class)).floor().as_i64vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::{Extent, Positions};

    #[test]
    fn sums_are_those_over_all_particles_and_gradients_their_derivative() {
        let mut random = crate::synth::random::Random::new(5, 1);
        let mut next = || random.uniform();
        let positions: Vec<[f64; 3]> = (0..300).map(|_| [next(), next(), next()]).collect();
        // Three decades of smoothing lengths.
        let lengths: Vec<f32> = (0..300).map(|_| 10f64.powf(-3.0 + 3.0 * next()) as f32).collect();
        let mass: Vec<f32> = (0..300).map(|_| next() as f32).collect();
        let splats = Splats::new(Positions::World(&positions), Extent::World(&lengths), &mass, Some(&lengths)).unwrap();
        for kernel in Kernel::ALL {
            let field = ExactField::new(&[splats], kernel);
            for _ in 0..50 {
                let point = DVec3::new(next(), next(), next());
                let found = field.at(point);
                let direct = |point: DVec3| -> f64 {
                    (0..300)
                        .map(|i| {
                            let h = f64::from(lengths[i]);
                            let q = (point - DVec3::from_array(positions[i])).length() / h;
                            f64::from(mass[i]) * kernel.value(q) / h.powi(3)
                        })
                        .sum()
                };
                assert!((found.density - direct(point)).abs() <= 1e-12 * found.density.max(1.0));
                for axis in DVec3::AXES {
                    let numeric = (direct(point + 1e-6 * axis) - direct(point - 1e-6 * axis)) / 2e-6;
                    let scale = found.gradient.length().max(1.0);
                    assert!(
                        (numeric - found.gradient.dot(axis)).abs() < 1e-3 * scale,
                        "{numeric} {:?}",
                        found.gradient
                    );
                }
                assert!(found.mean() <= 1.0);
            }
        }
    }
}
