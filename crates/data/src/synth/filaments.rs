//! Gas in straight, thin filaments in any direction: what round splats cannot simplify.

use super::random::{Random, cbrt, cross};
use super::{Chunk, Generator, INTERNAL_ENERGY, Scalar};
use crate::model::{Bounds, FamilyName};
use std::f64::consts::PI;

/// Number of filaments; each has as many particles as any other.
const RODS: u64 = 60;
/// Length of each, in edges of the box in which their middles lie.
const LENGTH: f64 = 1.0;
/// Standard deviation of the distance from its axis along either direction across.
const THICKNESS: f64 = 0.002;
/// Number of neighbours within a smoothing length.
const NEIGHBOURS: f64 = 32.0;

/// The generator; the box has edge 1.
pub struct Filaments {
    seed: u64,
    count: u64,
    /// Middle, and direction.
    rods: Vec<[[f64; 3]; 2]>,
}

impl Filaments {
    /// `count` particles; where the filaments lie depends on the seed alone.
    pub fn new(seed: u64, count: u64) -> Filaments {
        let mut random = Random::new(seed, u64::MAX);
        let rod = |_| [std::array::from_fn(|_| random.uniform()), random.direction()];
        Filaments { seed, count, rods: (0..RODS).map(rod).collect() }
    }
}

impl Generator for Filaments {
    fn len(&self) -> u64 {
        self.count
    }

    fn family(&self) -> FamilyName {
        FamilyName::Gas
    }

    fn bounds(&self) -> Bounds {
        // Nothing is farther from an axis than some thicknesses.
        let reach = 0.5 * LENGTH + 10.0 * THICKNESS;
        Bounds { min: glam::DVec3::splat(-reach), max: glam::DVec3::splat(1.0 + reach) }
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
        let all = self.count as f64;
        for number in range {
            let [middle, along] = self.rods[(number % RODS) as usize];
            let (u, v) = across(along);
            let t = LENGTH * (random.uniform() - 0.5);
            let (a, b) = (THICKNESS * random.normal(), THICKNESS * random.normal());
            let position: [f64; 3] = std::array::from_fn(|k| middle[k] + t * along[k] + a * u[k] + b * v[k]);
            // A Gaussian across, even along.
            let square = (a * a + b * b) / (2.0 * THICKNESS * THICKNESS);
            let density = libm::exp(-square) / (RODS as f64 * LENGTH * 2.0 * PI * THICKNESS * THICKNESS);
            chunk.positions.push(position.map(|x| x as f32));
            chunk.velocities.push(along.map(|x| (100.0 * t * x) as f32));
            chunk.density.push(density as f32);
            chunk.smoothing_length.push(cbrt(3.0 * NEIGHBOURS / (4.0 * PI * density * all)) as f32);
            chunk.scalars[0].push((1.0 + square) as f32);
        }
        chunk
    }
}

/// Two directions across another one, and each other.
fn across(along: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let axis = (0..3).min_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs())).unwrap_or(0);
    let unit: [f64; 3] = std::array::from_fn(|k| f64::from(u8::from(k == axis)));
    let u = cross(along, unit);
    let length = u.iter().map(|x| x * x).sum::<f64>().sqrt();
    let u = u.map(|x| x / length);
    (u, cross(along, u))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::dataset;

    #[test]
    fn particles_lie_along_thin_rods() {
        let made = Filaments::new(3, 6000);
        assert_eq!(made.chunk(0), Filaments::new(3, 6000).chunk(0));
        let family = &dataset(&made).families[0];
        let mut squares = 0.0;
        for (i, at) in family.positions.iter().enumerate() {
            let [middle, along] = made.rods[i % RODS as usize];
            let away: [f64; 3] = std::array::from_fn(|k| at[k] - middle[k]);
            let t: f64 = (0..3).map(|k| away[k] * along[k]).sum();
            assert!(t.abs() <= 0.5 * LENGTH + 1e-5);
            squares += away.iter().map(|x| x * x).sum::<f64>() - t * t;
        }
        let deviation = (squares / (2.0 * family.positions.len() as f64)).sqrt();
        assert!((deviation / THICKNESS - 1.0).abs() < 0.03, "{deviation}");
        assert!(family.smoothing_length.iter().all(|h| *h > 0.0));
    }
}
