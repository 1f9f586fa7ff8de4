//! Which haloes there are and where: masses from the mass function; places before the box moved at the peaks of the linear
//! density for the heaviest, and where the box will be compressed for the others, so that they end up in the knots and
//! filaments of the web.

use super::field::{Field, PEAK_SCALE};
use super::nfw::{Nfw, Profile, concentration};
use super::power::{MEAN_DENSITY, MassFunction, Power, lagrangian_radius};
use crate::synth::random::{Random, wrap};
use rayon::prelude::*;

/// Share of the particles in haloes, as far as the box can hold them: about what the mass function has above 1e10 Msun/h.
pub const SHARE: f64 = 0.45;
/// Particles of the smallest halo.
const LEAST: f64 = 16.0;
/// Most haloes; in larger data the smallest are heavier. It bounds the memory.
const MOST: f64 = 1_000_000.0;
/// A halo with this many particles has satellites.
const WITH_SATELLITES: u64 = 1000;
/// Share of a halo in its satellites, and the heaviest of them.
const SATELLITES: f64 = 0.12;
const HEAVIEST_SATELLITE: f64 = 0.08;
/// Satellites are at least as heavy as this share of their host.
const LIGHTEST_SATELLITE: f64 = 3e-5;
/// A cell of which nothing has been claimed.
pub const UNCLAIMED: u8 = 255;

/// A halo, or a satellite in one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halo {
    /// Centre in the box, Mpc/h.
    pub center: [f32; 3],
    /// Velocity, km/s.
    pub velocity: [f32; 3],
    /// Index of its first particle.
    pub first: u64,
}

/// All haloes of a box.
pub struct Catalogue {
    /// Each host, heaviest first, followed by its satellites.
    pub haloes: Vec<Halo>,
    /// Particles in all of them.
    pub particles: u64,
    /// How much of each cell is not in any halo, from 0 to [`UNCLAIMED`].
    pub remaining: Vec<u8>,
}

impl Catalogue {
    /// The haloes of `count` particles of `mass` each in the box.
    pub fn new(seed: u64, field: &Field, power: &Power, profile: &Profile, count: u64, mass: f64) -> Catalogue {
        let volume = field.edge * field.edge * field.edge;
        let masses = masses(seed, &MassFunction::new(power), volume, mass);
        let mut claims = Claims::new(field);
        let places = claims.places(seed, &masses);
        let mut catalogue = Catalogue { haloes: Vec::new(), particles: 0, remaining: Vec::new() };
        let mut random = Random::new(seed, u64::MAX - 2);
        for (&halo, place) in masses.iter().zip(&places) {
            let particles = (halo / mass + random.uniform()) as u64;
            if particles == 0 || (catalogue.particles + particles) as f64 > 1.2 * SHARE * count as f64 {
                continue;
            }
            let (displacement, _) = field.displacement_at(place.map(|x| x / field.cell()));
            let velocity = displacement.map(|psi| (psi * super::velocity_per_length()) as f32);
            let center = std::array::from_fn(|axis| place[axis] + displacement[axis]);
            catalogue.with_satellites(&mut random, field.edge, profile, particles, mass, center, velocity);
        }
        catalogue.remaining = claims.remaining;
        catalogue
    }

    /// Adds a halo of that many particles, some of them in satellites.
    fn with_satellites(
        &mut self,
        random: &mut Random,
        edge: f64,
        profile: &Profile,
        particles: u64,
        mass: f64,
        center: [f64; 3],
        velocity: [f32; 3],
    ) {
        let own = |x: f64| wrap(x / edge) * edge;
        let mut satellites = Vec::new();
        let mut left = particles;
        if particles >= WITH_SATELLITES {
            let whole = particles as f64;
            let host = Nfw::new(profile, whole * mass, concentration(whole * mass), whole, super::NEIGHBOURS);
            // Numbers fall as mass to the -1.9; the lower end is such that all together have their share.
            let lightest = (LEAST / whole).max(LIGHTEST_SATELLITE);
            let integral = |power: f64| (libm::pow(HEAVIEST_SATELLITE, power) - libm::pow(lightest, power)) / power;
            let number = SATELLITES * integral(-0.9) / integral(0.1);
            let (light, heavy) = (libm::pow(lightest, -0.9), libm::pow(HEAVIEST_SATELLITE, -0.9));
            for index in 0..number as u64 {
                let from_top = (index as f64 + random.uniform()) / number;
                let share = libm::pow(heavy + from_top * (light - heavy), -1.0 / 0.9);
                let satellite = (share * whole) as u64;
                // Few survive in the middle.
                let radius = host.radius(0.05 + 0.95 * random.uniform());
                let (_, dispersion) = host.local(radius);
                let direction = random.direction();
                let place = std::array::from_fn(|axis| own(center[axis] + radius * direction[axis]) as f32);
                let kick = velocity.map(|v| v + (dispersion * random.normal()) as f32);
                satellites.push((satellite, place, kick));
                left -= satellite.min(left);
            }
        }
        self.push(left, center.map(|x| own(x) as f32), velocity);
        for (particles, center, velocity) in satellites {
            self.push(particles, center, velocity);
        }
    }

    fn push(&mut self, particles: u64, center: [f32; 3], velocity: [f32; 3]) {
        self.haloes.push(Halo { center, velocity, first: self.particles });
        self.particles += particles;
    }

    /// Number of particles of a halo.
    pub fn particles_of(&self, index: usize) -> u64 {
        self.haloes.get(index + 1).map_or(self.particles, |next| next.first) - self.haloes[index].first
    }
}

/// Masses of the haloes of a volume, falling, for particles of `particle` Msun/h.
fn masses(seed: u64, function: &MassFunction, volume: f64, particle: f64) -> Vec<f64> {
    let mut least = LEAST * particle;
    // Where the smallest haloes are not resolved, more of the heavier ones stand for them.
    let number = loop {
        let (above, share) = function.above(least);
        let number = volume * above * (SHARE / share.max(1e-300)).min(6.0);
        if number <= MOST {
            break number;
        }
        least *= 1.25;
    };
    let whole = number as u64;
    let density = function.above(least).0;
    (0..whole)
        .into_par_iter()
        .map(|index| {
            let within = Random::new(seed ^ 0x6d61_7373, index).uniform();
            function.mass_at((index as f64 + within) / number * density)
        })
        .collect()
}

/// What haloes have taken of the box before it moved.
struct Claims<'a> {
    field: &'a Field,
    remaining: Vec<u8>,
}

impl Claims<'_> {
    fn new(field: &Field) -> Claims<'_> {
        Claims { field, remaining: vec![UNCLAIMED; field.contrast.len()] }
    }

    /// Where haloes of these masses, falling, were before the box moved, Mpc/h.
    fn places(&mut self, seed: u64, masses: &[f64]) -> Vec<[f64; 3]> {
        let cell = self.field.cell();
        let mut places: Vec<[f64; 3]> = Vec::with_capacity(masses.len());
        let mut next = 0;
        if PEAK_SCALE >= 0.8 * cell {
            let until = masses.partition_point(|&mass| lagrangian_radius(mass) >= 1.5 * PEAK_SCALE);
            let mut peaks = self.field.peaks.iter();
            while next < until {
                // The next peak that no halo has claimed yet.
                let Some(&peak) = peaks.find(|&&peak| self.remaining[peak as usize] > UNCLAIMED / 2) else { break };
                places.push(self.field.corner(peak as usize).map(|x| x as f64 * cell));
                self.claim(peak as usize, masses[next]);
                next += 1;
            }
        }
        let mut cells = self.dense_cells(seed, masses.len() - next);
        let mut random = Random::new(seed, u64::MAX - 1);
        for (index, &mass) in masses[next..].iter().enumerate() {
            // A few tries for one that no other halo has claimed.
            for _ in 0..8 {
                let last = cells.len() - index;
                let choice = index + ((random.uniform() * last as f64) as usize).min(last - 1);
                cells.swap(index, choice);
                if self.remaining[cells[index] as usize] > UNCLAIMED / 2 {
                    break;
                }
            }
            let chosen = cells[index] as usize;
            let corner = self.field.corner(chosen);
            places.push(corner.map(|x| (x as f64 + random.uniform() - 0.5) * cell));
            self.claim(chosen, mass);
        }
        places
    }

    /// `count` cells chosen at random, in their order, more of them where the box gets dense.
    fn dense_cells(&self, seed: u64, count: usize) -> Vec<u32> {
        let size = self.field.size;
        let weight = |at: usize| -> f64 {
            let compression = f64::from(self.field.compression(at).clamp(0.02, 10.0));
            let bias = f64::from(libm::expf(0.5 * self.field.contrast[at].clamp(-4.0, 4.0)));
            f64::from(self.remaining[at]) * compression * compression * bias + 1e-6
        };
        let rows: Vec<f64> =
            (0..size * size).into_par_iter().map(|row| (0..size).map(|x| weight(row * size + x)).sum()).collect();
        let mut total = 0.0;
        let starts: Vec<f64> = rows
            .iter()
            .map(|row| {
                total += row;
                total - row
            })
            .collect();
        let step = total / count.max(1) as f64;
        let offset = Random::new(seed, u64::MAX - 3).uniform();
        // The choices are the multiples of a step; each row finds its own.
        let choices = |at: f64| ((at / step - offset).ceil().max(0.0) as usize).min(count);
        let found: Vec<Vec<u32>> = (0..size * size)
            .into_par_iter()
            .map(|row| {
                let (from, to) = (choices(starts[row]), starts.get(row + 1).map_or(count, |&end| choices(end)));
                let mut cells = Vec::with_capacity(to.saturating_sub(from));
                let mut end = starts[row];
                let mut x = 0;
                for choice in from..to {
                    let target = (choice as f64 + offset) * step;
                    while x < size {
                        let next = end + weight(row * size + x);
                        if next > target || x == size - 1 {
                            break;
                        }
                        end = next;
                        x += 1;
                    }
                    cells.push((row * size + x) as u32);
                }
                cells
            })
            .collect();
        found.into_iter().flatten().collect()
    }

    /// Takes the sphere that holds `mass` around the corner of a cell.
    fn claim(&mut self, at: usize, mass: f64) {
        let size = self.field.size as i64;
        let cell = self.field.cell();
        let cell_mass = MEAN_DENSITY * cell * cell * cell;
        if mass < cell_mass {
            let taken = (mass / cell_mass * f64::from(UNCLAIMED)) as u8;
            self.remaining[at] = self.remaining[at].saturating_sub(taken);
            return;
        }
        let radius = lagrangian_radius(mass) / cell;
        let reach = radius as i64;
        let [x, y, z] = self.field.corner(at).map(|x| x as i64);
        for dz in -reach..=reach {
            for dy in -reach..=reach {
                let row = ((z + dz).rem_euclid(size) * size + (y + dy).rem_euclid(size)) * size;
                for dx in -reach..=reach {
                    if ((dx * dx + dy * dy + dz * dz) as f64) < radius * radius {
                        self.remaining[(row + (x + dx).rem_euclid(size)) as usize] = 0;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn haloes_hold_their_share_and_sit_on_peaks() {
        let (count, edge) = (1_000_000, 100.0);
        let (power, profile) = (Power::new(), Profile::new());
        let field = Field::new(1, 64, edge, &power);
        let mass = MEAN_DENSITY * edge * edge * edge / count as f64;
        let catalogue = Catalogue::new(1, &field, &power, &profile, count, mass);
        let share = catalogue.particles as f64 / count as f64;
        assert!((0.4..=0.6).contains(&share), "{share}");
        assert!(catalogue.haloes.len() > 500);
        let sum: u64 = (0..catalogue.haloes.len()).map(|index| catalogue.particles_of(index)).sum();
        assert_eq!(sum, catalogue.particles);
        for halo in &catalogue.haloes {
            assert!(halo.center.iter().all(|&x| (0.0..=100.0).contains(&x)), "{halo:?}");
        }
        // What they have taken of the box is about what they hold.
        let left = catalogue.remaining.iter().map(|&part| f64::from(part)).sum::<f64>();
        let taken = 1.0 - left / f64::from(UNCLAIMED) / catalogue.remaining.len() as f64;
        assert!((0.6..=1.1).contains(&(taken / share)), "{taken} of {share}");
        // Cells in haloes are denser than the others.
        let mean = |inside: bool| {
            let cells = catalogue.remaining.iter().zip(&field.contrast).filter(|(left, _)| (**left < 128) == inside);
            let (sum, number) = cells.fold((0.0, 0), |(sum, n), (_, &delta)| (sum + f64::from(delta), n + 1));
            sum / f64::from(number)
        };
        assert!(mean(true) > mean(false) + 0.8, "{} {}", mean(true), mean(false));
    }
}
