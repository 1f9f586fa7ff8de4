//! Gas of a merger of two white dwarfs: their dense cores on a close orbit, a disk and two tidal tails around them, and
//! a thin envelope of ejecta a hundred times as wide, with clumps and a shocked shell.
//!
//! The densities of all parts are known in closed form, so that smoothing lengths follow from the density at a particle's
//! place: they differ about 1400-fold, as in the data sets of F12 chapter 5. Lengths in Mm, masses in Msun.

use super::random::{Random, cbrt};
use super::{Chunk, Generator, INTERNAL_ENERGY, Scalar};
use crate::model::{Bounds, FamilyName};
use std::f64::consts::PI;

/// Particles within a smoothing length.
const NEIGHBOURS: f64 = 50.0;
/// Newton's constant, (km/s)^2 Mm / Msun.
const NEWTON: f64 = 1.327e8;
/// Mass of everything, Msun.
const MASS: f64 = 1.3;
/// Temperature in K to internal energy in (km/s)^2: ions of carbon and oxygen with their electrons.
const ENERGY: f64 = 1.5 * 8.254e-3 / 1.75;

/// Shares of the mass: two cores, the disk, two tails, the envelope.
const SHARES: [f64; 6] = [0.44, 0.27, 0.13, 0.05, 0.05, 0.06];
/// Centres and Plummer radii of the cores.
const CORES: [([f64; 3], f64); 2] = [([-9.0, 0.0, 0.0], 4.0), ([15.0, 0.0, 0.0], 5.0)];
/// Radius over which the disk thins out, and its thickness in units of the radius.
const DISK: (f64, f64) = (16.0, 0.16);
/// What is added to the radius where orbits around both stars are fast, Mm.
const DISK_SOFTENING: f64 = 8.0;
/// Radius at which the tails begin, how far they turn, and the factor by which they recede meanwhile.
const TAIL: (f64, f64, f64) = (13.0, 1.7 * PI, 15.0);
/// Width of a tail in units of the distance from the middle.
const TAIL_WIDTH: f64 = 0.085;
/// Radii of the envelope: where its density begins to fall steeply, and its edge.
const ENVELOPE: (f64, f64) = (230.0, 600.0);
/// Velocity at the envelope's edge, km/s.
const EXPANSION: f64 = 9000.0;
/// Strongest relative variation of the envelope's density.
const CLUMPS: f64 = 0.75;

/// How a particle moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// With its star around the other one.
    Core,
    /// Around the middle.
    Disk,
    /// Away: tails and envelope.
    Ejecta,
}

/// A particle.
pub(super) struct Drawn {
    /// What it belongs to.
    pub part: Part,
    /// Mm.
    pub place: [f64; 3],
    /// km/s.
    pub velocity: [f64; 3],
    /// K.
    pub temperature: f64,
    /// Msun/Mm^3.
    pub density: f64,
    /// Mm.
    pub smoothing_length: f64,
}

/// The rate at which the stars move around each other, radians in a unit of time, Mm/(km/s).
pub(super) fn orbital_rate() -> f64 {
    let separation = CORES[1].0[0] - CORES[0].0[0];
    orbital((SHARES[0] + SHARES[1]) * MASS, separation) / separation
}

/// The rate at which the disk turns at a distance from the middle.
pub(super) fn disk_rate(radius: f64) -> f64 {
    let softened = radius + DISK_SOFTENING;
    orbital(0.8 * MASS, softened) / softened
}

/// Velocity of a circular orbit, km/s.
fn orbital(mass: f64, distance: f64) -> f64 {
    (NEWTON * mass / distance).sqrt()
}

/// The generator.
pub struct Merger {
    seed: u64,
    count: u64,
    /// Waves that make the envelope clumpy: wave vectors on the unit sphere and phases.
    waves: Vec<([f64; 3], f64)>,
}

impl Merger {
    /// `count` particles.
    pub fn new(seed: u64, count: u64) -> Merger {
        let mut random = Random::new(seed, u64::MAX);
        let waves = (0..9).map(|i| {
            let number = 3.0 + 2.5 * f64::from(i);
            (random.direction().map(|x| x * number), 2.0 * PI * random.uniform())
        });
        Merger { seed, count, waves: waves.collect() }
    }

    /// A random place in a part, by the part's own density.
    fn place(&self, part: usize, random: &mut Random) -> [f64; 3] {
        match part {
            0 | 1 => {
                let (center, scale) = CORES[part];
                // Plummer: the share of the mass within x = r / scale is (x^2 / (1 + x^2))^(3/2).
                let share = 0.97 * random.uniform();
                let power = cbrt(share * share);
                let radius = scale * (power / (1.0 - power)).sqrt();
                let direction = random.direction();
                std::array::from_fn(|axis| center[axis] + radius * direction[axis])
            }
            2 => {
                let (scale, thickness) = DISK;
                let radius = -scale * libm::log((1.0 - random.uniform()) * (1.0 - random.uniform()));
                let (sin, cos) = libm::sincos(2.0 * PI * random.uniform());
                let height = thickness * (radius + 1.0) * normals(random)[0];
                [radius * cos, radius * sin, height]
            }
            3 | 4 => {
                let along = 1.0 - (1.0 - random.uniform()).sqrt();
                let (radius, angle) = tail(along, part == 4);
                let [across, up] = normals(random).map(|x| x * TAIL_WIDTH * radius);
                let (sin, cos) = libm::sincos(angle);
                [(radius + across) * cos, (radius + across) * sin, up]
            }
            _ => loop {
                // Clumps by rejection.
                let radius = envelope_radius(random.uniform());
                let place = random.direction().map(|x| x * radius);
                if random.uniform() * (1.0 + CLUMPS) < self.clumps(place, radius) {
                    return place;
                }
            },
        }
    }

    /// Density of every part at a place, Msun/Mm^3.
    fn densities(&self, place: [f64; 3]) -> [f64; 6] {
        let [x, y, z] = place;
        let core = |index: usize| {
            let (center, scale) = CORES[index];
            let square: f64 = (0..3).map(|axis| (place[axis] - center[axis]) * (place[axis] - center[axis])).sum();
            let base = 1.0 + square / (scale * scale);
            SHARES[index] * MASS * 3.0 / (4.0 * PI * scale * scale * scale) / (base * base * base.sqrt())
        };
        let radius = (x * x + y * y).sqrt();
        let (scale, thickness) = DISK;
        let height = thickness * (radius + 1.0);
        let surface = SHARES[2] * MASS / (2.0 * PI * scale * scale) * libm::exp(-radius / scale);
        let disk = surface / ((2.0 * PI).sqrt() * height) * libm::exp(-0.5 * z * z / (height * height));
        let whole = (radius * radius + z * z).sqrt();
        let envelope = if whole < ENVELOPE.1 { envelope_density(whole) * self.clumps(place, whole) } else { 0.0 };
        let angle = libm::atan2(y, x);
        [core(0), core(1), disk, tail_density(radius, angle, z, false), tail_density(radius, angle, z, true), envelope]
    }

    /// Factor of the envelope's density, 1 on average and at its edge.
    fn clumps(&self, place: [f64; 3], radius: f64) -> f64 {
        let direction = place.map(|x| x / radius.max(1e-9));
        // Fingers: the waves turn with the radius.
        let twist = 1.5 * radius / ENVELOPE.0;
        let sum: f64 = self
            .waves
            .iter()
            .map(|(k, phase)| {
                libm::sin(k[0] * direction[0] + k[1] * direction[1] + k[2] * direction[2] + phase + twist)
            })
            .sum();
        let fade = 1.0 - (radius / ENVELOPE.1) * (radius / ENVELOPE.1);
        1.0 + CLUMPS * fade * (sum / 3.0).clamp(-1.0, 1.0)
    }

    /// A random particle: its part, its place and its state there.
    pub(super) fn draw(&self, random: &mut Random) -> Drawn {
        let mut choice = random.uniform();
        let part = SHARES.iter().position(|share| {
            choice -= share;
            choice < 0.0
        });
        let part = part.unwrap_or(0);
        let mut place = self.place(part, random);
        while place.iter().map(|x| x * x).sum::<f64>() >= ENVELOPE.1 * ENVELOPE.1 {
            place = self.place(part, random);
        }
        let densities = self.densities(place);
        let density: f64 = densities.iter().sum();
        let (velocity, temperature) = self.state(place, &densities, random);
        let smoothing_length = cbrt(3.0 * NEIGHBOURS * self.particle_mass() / (4.0 * PI * density));
        let part = match part {
            0 | 1 => Part::Core,
            2 => Part::Disk,
            _ => Part::Ejecta,
        };
        Drawn { part, place, velocity, temperature, density, smoothing_length }
    }

    /// Velocity in km/s and temperature in K.
    fn state(&self, place: [f64; 3], densities: &[f64; 6], random: &mut Random) -> ([f64; 3], f64) {
        let [x, y, z] = place;
        let radius = (x * x + y * y).sqrt().max(1e-6);
        let whole = (radius * radius + z * z).sqrt();
        let around = [-y / radius, x / radius, 0.0];
        let turn = orbital_rate();
        let inner = orbital(0.8 * MASS, radius + DISK_SOFTENING);
        let tails = orbital(0.9 * MASS, radius + DISK_SOFTENING);
        let shell = (whole / ENVELOPE.0 - 1.0) / 0.08;
        let hot = 3e7 * libm::exp(-0.5 * shell * shell);
        let core = |index: usize| {
            let (_, scale) = CORES[index];
            let center = SHARES[index] * MASS * 3.0 / (4.0 * PI * scale * scale * scale);
            let compressed = cbrt(densities[index] / center + 1e-9);
            4e6 + [3e7, 5e7][index] * compressed * compressed
        };
        // Of each part: velocity around the middle and away from it, and temperature.
        let parts: [(f64, f64, f64); 6] = [
            (turn * radius, 0.0, core(0)),
            (turn * radius, 0.0, core(1)),
            (inner, 0.0, 4e8 / (1.0 + radius / 10.0)),
            (0.7 * tails, 0.6 * tails, 2e6 * TAIL.0 / radius + 2e5),
            (0.7 * tails, 0.6 * tails, 2e6 * TAIL.0 / radius + 2e5),
            (0.0, EXPANSION * whole / ENVELOPE.1, 1e4 + 2e5 * ENVELOPE.0 / (whole + 10.0) + hot),
        ];
        let total: f64 = densities.iter().sum();
        let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| -> f64 {
            parts.iter().zip(densities).map(|(part, density)| of(part) * density).sum::<f64>() / total
        };
        let (turning, leaving, temperature) = (mean(&|part| part.0), mean(&|part| part.1), mean(&|part| part.2));
        let sound = (ENERGY * temperature).sqrt();
        let velocity = std::array::from_fn(|axis| {
            turning * around[axis] + leaving * place[axis] / whole.max(1e-6) + 0.1 * sound * random.normal()
        });
        (velocity, temperature * (0.9 + 0.2 * random.uniform()))
    }
}

/// Two normal numbers.
fn normals(random: &mut Random) -> [f64; 2] {
    let radius = (-2.0 * libm::log(1.0 - random.uniform())).sqrt();
    let (sin, cos) = libm::sincos(2.0 * PI * random.uniform());
    [radius * cos, radius * sin]
}

/// Radius and angle of a point of a tail, 0 at its root and 1 at its tip.
fn tail(along: f64, other: bool) -> (f64, f64) {
    let (start, turn, factor) = TAIL;
    (start * libm::exp(along * libm::log(factor)), turn * along + if other { PI } else { 0.0 })
}

/// Density of a tail: a Gaussian across it in the radius and the height; the mass in an angle falls to 0 at the tip.
fn tail_density(radius: f64, angle: f64, height: f64, other: bool) -> f64 {
    let (start, turn, factor) = TAIL;
    let begin = if other { PI } else { 0.0 };
    let mut sum = 0.0;
    // The angle is known up to whole turns.
    for winding in 0..2 {
        let from_root = angle - begin;
        let from_root = from_root - 2.0 * PI * (from_root / (2.0 * PI)).floor() + 2.0 * PI * f64::from(winding);
        if from_root > turn {
            break;
        }
        let center = start * libm::exp(from_root / turn * libm::log(factor));
        let width = TAIL_WIDTH * center;
        let [across, up] = [(radius - center) / width, height / width];
        let distance = across * across + up * up;
        if distance < 40.0 {
            // Mass per angle over the area across, which lies at this radius.
            let per_angle = SHARES[3] * MASS * 2.0 * (1.0 - from_root / turn) / turn;
            sum += per_angle / radius.max(1.0) / (2.0 * PI * width * width) * libm::exp(-0.5 * distance);
        }
    }
    sum
}

/// Density of the envelope without clumps: as 1/r within, as r^-7 outside.
fn envelope_density(radius: f64) -> f64 {
    let (bend, edge) = ENVELOPE;
    let outer = 1.0 - 1.0 / fourth(edge / bend);
    let scale = SHARES[5] * MASS / (PI * bend * bend * bend * (2.0 + outer));
    let x = (radius / bend).max(1e-3);
    scale / if x < 1.0 { x } else { fourth(x) * x * x * x }
}

/// The radius within which there is that share of the envelope.
fn envelope_radius(share: f64) -> f64 {
    let (bend, edge) = ENVELOPE;
    let outer = 1.0 - 1.0 / fourth(edge / bend);
    let mass = share * (2.0 + outer);
    if mass < 2.0 { bend * (mass / 2.0).sqrt() } else { bend / (1.0 - (mass - 2.0)).sqrt().sqrt() }
}

fn fourth(x: f64) -> f64 {
    x * x * x * x
}

impl Generator for Merger {
    fn len(&self) -> u64 {
        self.count
    }

    fn family(&self) -> FamilyName {
        FamilyName::Gas
    }

    fn bounds(&self) -> Bounds {
        // Only the disk's and the tails' thin ends could reach beyond the envelope's edge, and are held back there.
        Bounds { min: glam::DVec3::splat(-ENVELOPE.1), max: glam::DVec3::splat(ENVELOPE.1) }
    }

    fn periodic(&self) -> bool {
        false
    }

    fn length_unit(&self) -> &'static str {
        "Mm"
    }

    fn mass_unit(&self) -> &'static str {
        "Msun"
    }

    fn particle_mass(&self) -> f64 {
        MASS / self.count.max(1) as f64
    }

    fn scalars(&self) -> &'static [Scalar] {
        &[INTERNAL_ENERGY, Scalar { label: "TEMP", name: "temperature", unit: "K" }]
    }

    fn chunk(&self, index: u64) -> Chunk {
        let range = self.chunk_range(index);
        let mut random = Random::new(self.seed, index);
        let mut chunk = Chunk::with_capacity((range.end - range.start) as usize, 2);
        for _ in range {
            let drawn = self.draw(&mut random);
            chunk.positions.push(drawn.place.map(|x| x as f32));
            chunk.velocities.push(drawn.velocity.map(|v| v as f32));
            chunk.density.push(drawn.density as f32);
            chunk.smoothing_length.push(drawn.smoothing_length as f32);
            chunk.scalars[0].push((ENERGY * drawn.temperature) as f32);
            chunk.scalars[1].push(drawn.temperature as f32);
        }
        chunk
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::dataset;

    #[test]
    fn densities_are_those_of_the_particles() {
        // Counted in shells and in boxes around the cores, the disk and the tails.
        let merger = Merger::new(1, 400_000);
        let data = dataset(&merger);
        let family = &data.families[0];
        let mass = merger.particle_mass();
        let boxes: [([f64; 3], f64); 5] = [
            (CORES[0].0, 2.0),
            (CORES[1].0, 3.0),
            ([0.0, 30.0, 0.0], 3.0),
            ([-70.0, 0.0, 0.0], 6.0),
            ([100.0, 100.0, 100.0], 40.0),
        ];
        for (center, half) in boxes {
            let inside = family.positions.iter().filter(|p| (0..3).all(|axis| (p[axis] - center[axis]).abs() < half));
            let found = inside.count() as f64 * mass / (8.0 * half * half * half);
            // The mean of the density over the box.
            let mut random = Random::new(2, 2);
            let samples = 4000;
            let expected: f64 = (0..samples)
                .map(|_| {
                    let place = center.map(|x| x + half * random.signed());
                    merger.densities(place).iter().sum::<f64>()
                })
                .sum::<f64>()
                / f64::from(samples);
            assert!((found / expected - 1.0).abs() < 0.15, "{center:?}: {found} against {expected}");
        }
    }

    #[test]
    fn smoothing_lengths_differ_as_in_the_data_sets_of_the_paper() {
        for seed in 1..4 {
            let data = dataset(&Merger::new(seed, 200_000));
            let family = &data.families[0];
            let (min, max) = family.smoothing_length.iter().fold((f32::MAX, 0f32), |(a, b), &h| (a.min(h), b.max(h)));
            assert!((1000.0..2000.0).contains(&(max / min)), "{}", max / min);
            let constant = 3.0 * NEIGHBOURS / (4.0 * PI);
            for i in 0..family.len() {
                let h = f64::from(family.smoothing_length[i]);
                let found = h * h * h * f64::from(family.density[i]) / f64::from(family.mass[i]);
                assert!((found / constant - 1.0).abs() < 1e-5);
            }
            let temperature = family.attribute("temperature").expect("temperature");
            let (cold, hot) = temperature.values.iter().fold((f32::MAX, 0f32), |(a, b), &t| (a.min(t), b.max(t)));
            assert!(cold > 1e3 && hot / cold > 1e3, "{cold} {hot}");
            assert!(data.bounds().size().max_element() < 2.0 * ENVELOPE.1);
        }
    }
}
