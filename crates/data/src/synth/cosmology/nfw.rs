//! Haloes with the density profile of Navarro, Frenk and White (1997), `rho ~ 1 / (x (1 + x)^2)` for `x = r / r_s`.
//!
//! Lengths in Mpc/h, masses in Msun/h, velocities in km/s, densities in units of the mean.

use super::power::MEAN_DENSITY;
use std::f64::consts::PI;

/// Mean density within a halo's edge: beyond the virial radius, about where what falls in turns round for the first time,
/// so that haloes fade into what is around them.
pub const OVERDENSITY: f64 = 70.0;
/// Largest concentration.
pub const MOST_CONCENTRATED: f64 = 40.0;
/// Newton's constant, (km/s)^2 Mpc / Msun.
const NEWTON: f64 = 4.300_917e-9;

/// Entries of the tables.
const ENTRIES: usize = 4096;

/// Mass within `x`, in units of `4 pi rho_s r_s^3`.
pub fn enclosed(x: f64) -> f64 {
    // The series keeps what the difference of nearly equal numbers loses.
    if x < 1e-3 { x * x * (0.5 - x * 2.0 / 3.0 + x * x * 0.75) } else { libm::log1p(x) - x / (1.0 + x) }
}

/// The profile's functions as tables.
pub struct Profile {
    /// `x` at equal steps of the square root of the mass within.
    radius: Vec<f64>,
    /// Velocity dispersion in units of the largest circular velocity at equal steps of the fourth root of `x`.
    dispersion: Vec<f64>,
    /// Square root of the mass within the last radius, and fourth root of that radius.
    ends: [f64; 2],
}

impl Profile {
    /// Fills the tables.
    pub fn new() -> Profile {
        let ends = [enclosed(MOST_CONCENTRATED).sqrt(), MOST_CONCENTRATED.sqrt().sqrt()];
        let mut x = 0.0;
        let radius = (0..=ENTRIES)
            .map(|i| {
                let root = ends[0] * i as f64 / ENTRIES as f64;
                // Newton's iteration from the entry before; the slope of the mass is x / (1 + x)^2.
                x = f64::max(x, root);
                for _ in 0..50 {
                    let slope = x / ((1.0 + x) * (1.0 + x));
                    if slope > 0.0 {
                        x -= (enclosed(x) - root * root) / slope;
                    }
                }
                x
            })
            .collect();
        // A fit to the solution of Jeans's equation for isotropic orbits, within some per cent for 0.01 < x < 100.
        let dispersion = (0..=ENTRIES)
            .map(|i| {
                let fourth = ends[1] * i as f64 / ENTRIES as f64;
                let x = fourth * fourth * fourth * fourth;
                1.4393 * libm::pow(x, 0.354) / (1.0 + 1.1756 * libm::pow(x, 0.725))
            })
            .collect();
        Profile { radius, dispersion, ends }
    }

    /// The `x` within which there is that mass.
    pub fn radius(&self, mass: f64) -> f64 {
        interpolate(&self.radius, mass.sqrt() / self.ends[0])
    }

    fn dispersion(&self, x: f64) -> f64 {
        interpolate(&self.dispersion, x.sqrt().sqrt() / self.ends[1])
    }
}

/// Between the entries of a table, `part` of the way from the first to the last.
fn interpolate(table: &[f64], part: f64) -> f64 {
    let at = part.clamp(0.0, 1.0) * (table.len() - 1) as f64;
    let index = (at as usize).min(table.len() - 2);
    table[index] + (at - index as f64) * (table[index + 1] - table[index])
}

/// Mean concentration of haloes of a mass: a fit to simulations (10.14 at 2e12 for an overdensity of 200; Duffy et al.
/// 2008), carried on to the edge.
pub fn concentration(mass: f64) -> f64 {
    16.0 * libm::pow(mass / 2e12, -0.081)
}

/// The edge of a halo.
pub fn edge(mass: f64) -> f64 {
    libm::cbrt(3.0 * mass / (4.0 * PI * OVERDENSITY * MEAN_DENSITY))
}

/// A halo, as its particles need it.
pub struct Nfw<'a> {
    profile: &'a Profile,
    /// The radius `r_s`.
    pub scale: f64,
    /// Mass within the edge, in units of `4 pi rho_s r_s^3`.
    whole: f64,
    /// `rho_s`.
    density: f64,
    /// Largest circular velocity.
    velocity: f64,
    /// Radius of the sphere around the centre that holds as many particles as half a smoothing kernel, in units of
    /// `r_s`: nearer structure cannot be resolved.
    core: f64,
}

impl<'a> Nfw<'a> {
    /// The halo of a mass with that concentration, made of `particles`, of which a kernel holds `neighbours`.
    pub fn new(profile: &'a Profile, mass: f64, concentration: f64, particles: f64, neighbours: f64) -> Nfw<'a> {
        let edge = edge(mass);
        let scale = edge / concentration;
        let whole = enclosed(concentration);
        let density = mass / (4.0 * PI * scale * scale * scale * whole * MEAN_DENSITY);
        // The circular velocity is largest at x = 2.163, where the mass within is 0.467.
        let velocity = (NEWTON * mass * 0.4674 / (whole * 2.163 * scale)).sqrt();
        let core = profile.radius(whole * (0.5 * neighbours / particles).min(0.9));
        Nfw { profile, scale, whole, density, velocity, core }
    }

    /// The radius within which there is that share of the mass, Mpc/h.
    pub fn radius(&self, share: f64) -> f64 {
        self.scale * self.profile.radius(share * self.whole)
    }

    /// Density that particles can resolve and velocity dispersion along a line, at a radius.
    pub fn local(&self, radius: f64) -> (f64, f64) {
        let x = radius / self.scale;
        let x = (x * x + self.core * self.core).sqrt();
        (self.density / (x * (1.0 + x) * (1.0 + x)), self.velocity * self.profile.dispersion(x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::random::Random;

    #[test]
    fn radii_invert_the_enclosed_mass() {
        let profile = Profile::new();
        for x in [1e-3, 0.01, 0.3, 1.0, 5.0, 39.0] {
            let found = profile.radius(enclosed(x));
            assert!((found / x - 1.0).abs() < 1e-3, "{x}: {found}");
        }
    }

    #[test]
    fn sampled_haloes_have_the_profile() {
        let profile = Profile::new();
        let (mass, concentration, particles) = (1e14, 10.0, 100_000);
        let halo = Nfw::new(&profile, mass, concentration, f64::from(particles), 32.0);
        let mut random = Random::new(3, 4);
        let mut radii: Vec<f64> = (0..particles).map(|_| halo.radius(random.uniform())).collect();
        radii.sort_by(f64::total_cmp);
        assert!(radii[radii.len() - 1] <= edge(mass) * 1.001);
        for part in [0.01, 0.03, 0.1, 0.3, 0.6, 0.9] {
            let radius = part * edge(mass);
            let within = radii.partition_point(|&r| r < radius) as f64;
            let expected = enclosed(part * concentration) / enclosed(concentration) * f64::from(particles);
            assert!((within - expected).abs() < 5.0 * expected.sqrt(), "{part}: {within} against {expected}");
        }
        // The mean density within the edge, and the density at the edge from the slope of the mass.
        let sphere = 4.0 / 3.0 * PI * libm::pow(edge(mass), 3.0) * MEAN_DENSITY;
        assert!((mass / sphere / OVERDENSITY - 1.0).abs() < 1e-9);
        let (low, high) = (halo.radius(0.5), halo.radius(0.5001));
        let shell = 1e-4 * mass / (4.0 / 3.0 * PI * (libm::pow(high, 3.0) - libm::pow(low, 3.0)) * MEAN_DENSITY);
        let (density, dispersion) = halo.local(0.5 * (low + high));
        assert!((shell / density - 1.0).abs() < 0.02, "{shell} against {density}");
        // A cluster of 1e14 Msun/h has some 500 km/s.
        assert!((300.0..700.0).contains(&dispersion), "{dispersion}");
    }
}
