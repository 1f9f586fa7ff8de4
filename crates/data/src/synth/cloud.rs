//! A flat Gaussian cloud, turned: what one ellipsoid represents.

use super::random::{Random, cbrt, cross};
use super::{Chunk, Generator, INTERNAL_ENERGY, Scalar};
use crate::model::{Bounds, FamilyName};
use std::f64::consts::PI;

/// Standard deviations along its axes.
const DEVIATIONS: [f64; 3] = [1.0, 0.2, 0.05];
/// Number of neighbours within a smoothing length.
const NEIGHBOURS: f64 = 32.0;

/// The generator.
pub struct Cloud {
    seed: u64,
    count: u64,
    /// The directions of its axes.
    axes: [[f64; 3]; 3],
}

impl Cloud {
    /// `count` particles; how it is turned depends on the seed alone.
    pub fn new(seed: u64, count: u64) -> Cloud {
        let mut random = Random::new(seed, u64::MAX);
        let (a, b) = (random.direction(), random.direction());
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        let b: [f64; 3] = std::array::from_fn(|k| b[k] - dot(a, b) * a[k]);
        let length = dot(b, b).sqrt();
        let b = b.map(|x| x / length);
        Cloud { seed, count, axes: [a, b, cross(a, b)] }
    }
}

impl Generator for Cloud {
    fn len(&self) -> u64 {
        self.count
    }

    fn family(&self) -> FamilyName {
        FamilyName::Gas
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: glam::DVec3::splat(-10.0), max: glam::DVec3::splat(10.0) }
    }

    fn periodic(&self) -> bool {
        false
    }

    fn particle_mass(&self) -> f64 {
        1.0 / self.count.max(1) as f64
    }

    fn scalars(&self) -> &'static [Scalar] {
        &[INTERNAL_ENERGY]
    }

    fn chunk(&self, index: u64) -> Chunk {
        let range = self.chunk_range(index);
        let mut random = Random::new(self.seed, index);
        let mut chunk = Chunk::with_capacity((range.end - range.start) as usize, 1);
        let volume: f64 = DEVIATIONS.iter().product();
        for _ in range {
            let along: [f64; 3] = std::array::from_fn(|_| random.normal());
            let half: f64 = 0.5 * along.iter().map(|x| x * x).sum::<f64>();
            let density = libm::exp(-half) / (2.0 * PI * (2.0 * PI).sqrt() * volume);
            let place = |k: usize| (0..3).map(|axis| DEVIATIONS[axis] * along[axis] * self.axes[axis][k]).sum::<f64>();
            chunk.positions.push([place(0) as f32, place(1) as f32, place(2) as f32]);
            chunk.velocities.push([0.0; 3]);
            chunk.density.push(density as f32);
            let h = cbrt(3.0 * NEIGHBOURS / (4.0 * PI * density * self.count as f64));
            // Far outside hardly a particle is near another.
            chunk.smoothing_length.push(h.min(1.0) as f32);
            chunk.scalars[0].push((1.0 + half) as f32);
        }
        chunk
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::dataset;

    #[test]
    fn its_moments_are_those_of_its_axes() {
        let made = Cloud::new(2, 20_000);
        let family = &dataset(&made).families[0];
        for (axis, deviation) in made.axes.iter().zip(DEVIATIONS) {
            let along = |at: &[f64; 3]| (0..3).map(|k| at[k] * axis[k]).sum::<f64>();
            let squares: f64 = family.positions.iter().map(|at| along(at).powi(2)).sum();
            let found = (squares / family.positions.len() as f64).sqrt();
            assert!((found / deviation - 1.0).abs() < 0.02, "{found} {deviation}");
        }
    }
}
