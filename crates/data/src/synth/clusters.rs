//! A box of gas that looks like a cosmological simulation: haloes with a power-law mass function, curved filaments
//! between them, and a thin background. Smoothing lengths follow the local density as in SPH with 64 neighbours.

use super::random::{Random, cbrt, wrap};
use super::{Chunk, Generator, INTERNAL_ENERGY, Scalar};
use crate::model::{Bounds, FamilyName};
use std::f64::consts::PI;

/// Share of the particles in the background.
const BACKGROUND: f64 = 0.055;
/// Share of the particles in filaments.
const FILAMENTS: f64 = 0.25;
/// Number of haloes; each but the heaviest has a filament to a heavier neighbour.
const HALOES: usize = 400;
/// Number of neighbours within a smoothing length.
const NEIGHBOURS: f64 = 64.0;
/// Edge of the box, kpc/h.
const BOX: f64 = 100_000.0;
/// Mean mass density times the volume, 1e10 Msun/h.
const TOTAL_MASS: f64 = 1.3e6;

struct Halo {
    center: [f64; 3],
    /// Plummer radius.
    scale: f64,
    /// Share of all particles.
    share: f64,
}

struct Filament {
    /// Quadratic Bezier curve.
    points: [[f64; 3]; 3],
    length: f64,
    /// Radius of its core.
    scale: f64,
    share: f64,
}

/// The generator; all lengths within the unit box.
pub struct Clusters {
    seed: u64,
    count: u64,
    haloes: Vec<Halo>,
    filaments: Vec<Filament>,
    /// Upper ends of the shares of haloes, then filaments; what is left is background.
    ends: Vec<f64>,
}

impl Clusters {
    /// `count` particles; the structures depend on the seed alone.
    pub fn new(seed: u64, count: u64) -> Clusters {
        let mut random = Random::new(seed, u64::MAX);
        // Mass function dn/dM ~ M^-2 over a factor of 300.
        let mut masses: Vec<f64> = (0..HALOES).map(|_| 1.0 / (random.uniform() + 1.0 / 300.0)).collect();
        masses.sort_by(|a, b| b.total_cmp(a));
        let total: f64 = masses.iter().sum();
        let mut haloes: Vec<Halo> = Vec::with_capacity(HALOES);
        for mass in masses {
            // Later haloes gather around earlier, heavier ones.
            let host = (random.uniform() * haloes.len() as f64) as usize;
            let spread = 0.25 * random.uniform();
            let direction = random.direction();
            let center = match haloes.get(host) {
                Some(halo) if random.uniform() < 0.7 => {
                    std::array::from_fn(|k| wrap(halo.center[k] + spread * direction[k]))
                }
                _ => [random.uniform(), random.uniform(), random.uniform()],
            };
            let share = (1.0 - BACKGROUND - FILAMENTS) * mass / total;
            let contrast = 5e3 * (0.3 + 3.0 * random.uniform());
            haloes.push(Halo { center, share, scale: cbrt(3.0 * share / (4.0 * PI * contrast)) });
        }
        let mut filaments: Vec<Filament> = (1..HALOES)
            .map(|i| {
                let distance =
                    |j: usize| -> f64 { relative(haloes[i].center, haloes[j].center).iter().map(|x| x * x).sum() };
                let nearest = (0..i).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
                let start = haloes[i].center;
                let way = relative(start, haloes[nearest].center);
                let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
                let bend = random.direction().map(|x| 0.2 * length * x);
                let middle = std::array::from_fn(|k| start[k] + 0.5 * way[k] + bend[k]);
                let end = std::array::from_fn(|k| start[k] + way[k]);
                let scale = 0.002 + 0.003 * random.uniform();
                Filament { points: [start, middle, end], length, scale, share: length * scale }
            })
            .collect();
        let total: f64 = filaments.iter().map(|filament| filament.share).sum();
        filaments.iter_mut().for_each(|filament| filament.share *= FILAMENTS / total);
        let mut end = 0.0;
        let shares = haloes.iter().map(|halo| halo.share).chain(filaments.iter().map(|filament| filament.share));
        let ends = shares
            .map(|share| {
                end += share;
                end
            })
            .collect();
        Clusters { seed, count, haloes, filaments, ends }
    }

    /// A particle: position in the unit box, number density in units of the mean, velocity dispersion.
    fn particle(&self, random: &mut Random) -> ([f64; 3], f64, f64) {
        let choice = random.uniform();
        let index = self.ends.partition_point(|&end| end <= choice);
        if let Some(halo) = self.haloes.get(index) {
            let share = 0.98 * random.uniform();
            // Plummer: the share of the mass within x = r / scale is (x^2 / (1 + x^2))^(3/2).
            let power = cbrt(share * share);
            let square = power / (1.0 - power);
            let direction = random.direction();
            let radius = halo.scale * square.sqrt();
            let base = 1.0 + square;
            let density =
                halo.share * 3.0 / (4.0 * PI * halo.scale * halo.scale * halo.scale) / (base * base * base.sqrt());
            let dispersion = 900.0 * (halo.share / (halo.scale * base.sqrt())).sqrt();
            let position = std::array::from_fn(|k| halo.center[k] + radius * direction[k]);
            return (position, density + BACKGROUND, dispersion);
        }
        if let Some(filament) = self.filaments.get(index - self.haloes.len()) {
            let t = random.uniform();
            let share = 0.95 * random.uniform();
            let square = share / (1.0 - share);
            let direction = random.direction();
            let [a, b, c] = filament.points;
            let radius = filament.scale * square.sqrt();
            let position = std::array::from_fn(|k| {
                let on_curve = (1.0 - t) * (1.0 - t) * a[k] + 2.0 * t * (1.0 - t) * b[k] + t * t * c[k];
                on_curve + radius * direction[k]
            });
            let across = PI * filament.scale * filament.scale * (1.0 + square) * (1.0 + square);
            return (position, filament.share / (filament.length * across) + BACKGROUND, 60.0);
        }
        ([random.uniform(), random.uniform(), random.uniform()], BACKGROUND, 15.0)
    }
}

/// The shortest way from one point of the periodic unit box to another.
fn relative(from: [f64; 3], to: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let way = to[k] - from[k];
        way - (way + 0.5).floor()
    })
}

impl Generator for Clusters {
    fn len(&self) -> u64 {
        self.count
    }

    fn family(&self) -> FamilyName {
        FamilyName::Gas
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: glam::DVec3::ZERO, max: glam::DVec3::splat(BOX) }
    }

    fn particle_mass(&self) -> f64 {
        TOTAL_MASS / self.count.max(1) as f64
    }

    fn scalars(&self) -> &'static [Scalar] {
        &[INTERNAL_ENERGY]
    }

    fn chunk(&self, index: u64) -> Chunk {
        let range = self.chunk_range(index);
        let mut random = Random::new(self.seed, index);
        let mut chunk = Chunk::with_capacity((range.end - range.start) as usize, 1);
        let mean_density = TOTAL_MASS / (BOX * BOX * BOX);
        let all = self.count as f64;
        for _ in range {
            let (position, density, dispersion) = self.particle(&mut random);
            // Rounding may reach the box's edge, which is its beginning.
            let place = |x: f64| (wrap(x) * BOX) as f32;
            chunk.positions.push(position.map(|x| if place(x) < BOX as f32 { place(x) } else { 0.0 }));
            chunk.velocities.push(std::array::from_fn(|_| (dispersion * random.normal()) as f32));
            chunk.scalars[0].push((1.5 * dispersion * dispersion * (0.7 + 0.6 * random.uniform())) as f32);
            chunk.density.push((density * mean_density) as f32);
            let h = cbrt(3.0 * NEIGHBOURS / (4.0 * PI * density * all)) * BOX;
            // SPH smoothing lengths scatter a little.
            chunk.smoothing_length.push((h * (0.95 + 0.1 * random.uniform())) as f32);
        }
        chunk
    }
}

#[cfg(test)]
mod tests {
    use super::super::CHUNK;
    use super::*;
    use crate::synth::dataset;

    #[test]
    fn particles_follow_from_seed_and_index() {
        let (one, two) = (Clusters::new(5, 70_000), Clusters::new(5, 70_000));
        assert_eq!(one.chunk(1), two.chunk(1));
        assert_eq!(one.chunk(1).positions.len(), 70_000 - CHUNK as usize);
        assert_ne!(one.chunk(0), Clusters::new(6, 70_000).chunk(0));
        // The first bits of a known chunk: a change of them changes every published number.
        let first = one.chunk(0);
        let mut hash = 0u64;
        for value in first.positions.iter().flatten().chain(&first.smoothing_length) {
            hash = hash.rotate_left(5).wrapping_mul(0x2545_f491_4f6c_dd1d) ^ u64::from(value.to_bits());
        }
        assert_eq!(hash, KNOWN_HASH);
    }

    const KNOWN_HASH: u64 = 16_704_057_948_222_917_571;

    #[test]
    fn footprints_are_those_of_a_simulation() {
        let data = dataset(&Clusters::new(1, 200_000));
        let family = &data.families[0];
        let scale = 1024.0 / BOX;
        let pixels = |h: f32| PI * (f64::from(h) * scale).powi(2);
        let mean = family.smoothing_length.iter().map(|&h| pixels(h)).sum::<f64>() / 200_000.0;
        assert!((2500.0..3300.0).contains(&mean), "{mean} pixels a particle");
        let bounds = family.bounds();
        assert!(bounds.min.min_element() >= 0.0 && bounds.max.max_element() < BOX);
        assert!(family.density.iter().all(|&rho| rho > 0.0));
    }
}
