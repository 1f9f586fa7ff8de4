//! The exact SPH sum at any point, in double precision (F12 3.2, 3.3): the reference for every resampled field.
//!
//! `rho(r) = sum m_j W(|r - r_j|, h_j)`, the mass-weighted mean of an attribute
//! `S(r) = sum m_j A_j W / sum m_j W`, and gradients by the kernel's derivative, `grad W = W'(r) (r - r_j) / |r - r_j|`.
//!
//! Particles are sorted by the power of two above their smoothing length, and within each such class into cubes of that
//! width, so that a point looks at 27 cubes of each class, however much smoothing lengths differ.

use super::super::Splats;
use crate::model::Kernel;
use glam::{DVec3, I64Vec3};
use std::collections::{BTreeMap, HashMap};

/// Particles of one class of smoothing lengths, by cube.
type Class = HashMap<I64Vec3, Vec<u32>>;

/// A field that can be asked for its value anywhere.
pub struct ExactField {
    kernel: Kernel,
    /// World position, and `h`.
    places: Vec<(DVec3, f64)>,
    /// `m`, and `m A`.
    masses: Vec<(f64, f64)>,
    /// Exponent of the cubes' width, and the cubes.
    classes: BTreeMap<i32, Class>,
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
                let Some(h) = batch.ball(i) else { break };
                let (position, mass) = (batch.positions().world(i), f64::from(batch.weight()[i]));
                let attribute = batch.attribute().map_or(0.0, |values| f64::from(values[i]));
                let h = f64::from(h);
                if !(position.is_finite() && mass.is_finite() && attribute.is_finite() && h > 0.0 && h.is_finite()) {
                    continue;
                }
                let class = h.log2().ceil() as i32;
                let cube = cube(position, class);
                let index = field.places.len() as u32;
                field.classes.entry(class).or_default().entry(cube).or_default().push(index);
                field.places.push((position, h));
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
                    let (position, h) = self.places[index as usize];
                    let away = point - position;
                    let distance = away.length();
                    let q = distance / h;
                    if q >= 1.0 {
                        continue;
                    }
                    let (mass, weighted) = self.masses[index as usize];
                    let value = self.kernel.value(q) / (h * h * h);
                    sample.density += mass * value;
                    sample.weighted += weighted * value;
                    sample.particles += 1;
                    if distance > 0.0 {
                        sample.gradient += mass * self.kernel.slope(q) / (h * h * h * h) / distance * away;
                    }
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
