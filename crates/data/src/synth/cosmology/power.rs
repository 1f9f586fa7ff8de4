//! A flat Lambda-CDM universe today: the linear power spectrum (Eisenstein and Hu 1998, without wiggles) and the
//! numbers of haloes that follow from it (Sheth and Tormen 1999). Lengths in Mpc/h, masses in Msun/h.

use std::f64::consts::{E, PI};

/// Matter in units of the critical density.
pub const OMEGA_MATTER: f64 = 0.3;
/// Baryons, for the shape of the spectrum alone.
const OMEGA_BARYON: f64 = 0.045;
/// Hubble's constant in 100 km/s/Mpc.
pub const HUBBLE: f64 = 0.7;
/// Slope of the primordial spectrum.
const SLOPE: f64 = 0.96;
/// Linear fluctuation in spheres of 8 Mpc/h.
pub const SIGMA_8: f64 = 0.8;
/// Mean density of matter, Msun/h in a cubic Mpc/h.
pub const MEAN_DENSITY: f64 = 2.775_366_27e11 * OMEGA_MATTER;
/// Linear overdensity at which a sphere has collapsed.
const COLLAPSE: f64 = 1.686;

/// Rate of growth `dln D / dln a` today, about `Omega^0.55`.
pub fn growth_rate() -> f64 {
    libm::pow(OMEGA_MATTER, 0.55)
}

/// The linear power spectrum today.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Power {
    amplitude: f64,
}

impl Power {
    /// The spectrum that has [`SIGMA_8`].
    pub fn new() -> Power {
        let raw = Power { amplitude: 1.0 };
        let sigma = raw.sigma(8.0);
        Power { amplitude: SIGMA_8 * SIGMA_8 / (sigma * sigma) }
    }

    /// `P(k)` in (Mpc/h)^3, `k` in h/Mpc; 0 for `k = 0`.
    pub fn at(&self, k: f64) -> f64 {
        if k <= 0.0 {
            return 0.0;
        }
        let transfer = transfer(k);
        self.amplitude * libm::pow(k, SLOPE) * transfer * transfer
    }

    /// Fluctuation of the linear density in spheres of `radius`.
    pub fn sigma(&self, radius: f64) -> f64 {
        let window = |x: f64| {
            // The series keeps what the difference of nearly equal numbers loses.
            if x < 0.05 { 1.0 - x * x / 10.0 } else { 3.0 * (libm::sin(x) - x * libm::cos(x)) / (x * x * x) }
        };
        self.integral(|k| window(k * radius) * window(k * radius)).sqrt()
    }

    /// Integral of `P(k) f(k) d^3k / (2 pi)^3`.
    pub fn integral(&self, f: impl Fn(f64) -> f64) -> f64 {
        const STEPS: usize = 2000;
        let (from, to) = (libm::log(1e-4), libm::log(100.0));
        let step = (to - from) / STEPS as f64;
        let value = |i: usize| {
            let k = libm::exp(from + (i as f64 + 0.5) * step);
            k * k * k * self.at(k) * f(k)
        };
        (0..STEPS).map(value).sum::<f64>() * step / (2.0 * PI * PI)
    }
}

impl Default for Power {
    fn default() -> Self {
        Power::new()
    }
}

/// The transfer function without acoustic oscillations (Eisenstein and Hu 1998, equations 26 and 28 to 31).
fn transfer(k: f64) -> f64 {
    let matter = OMEGA_MATTER * HUBBLE * HUBBLE;
    let baryon = OMEGA_BARYON * HUBBLE * HUBBLE;
    let share = OMEGA_BARYON / OMEGA_MATTER;
    let sound = 44.5 * libm::log(9.83 / matter) / (1.0 + 10.0 * libm::pow(baryon, 0.75)).sqrt();
    let alpha = 1.0 - 0.328 * libm::log(431.0 * matter) * share + 0.38 * libm::log(22.3 * matter) * share * share;
    let x = 0.43 * k * HUBBLE * sound;
    let x2 = x * x;
    let shape = OMEGA_MATTER * HUBBLE * (alpha + (1.0 - alpha) / (1.0 + x2 * x2));
    let theta = 2.725 / 2.7;
    let q = k * theta * theta / shape;
    let log = libm::log(2.0 * E + 1.8 * q);
    let c = 14.2 + 731.0 / (1.0 + 62.5 * q);
    log / (log + c * q * q)
}

/// Radius of the sphere of mean density that holds `mass`.
pub fn lagrangian_radius(mass: f64) -> f64 {
    libm::cbrt(3.0 * mass / (4.0 * PI * MEAN_DENSITY))
}

/// How many haloes there are of which mass.
pub struct MassFunction {
    /// Natural logarithms of mass, rising.
    log_mass: Vec<f64>,
    /// Haloes in a cubic Mpc/h heavier than that.
    above: Vec<f64>,
    /// Share of all matter in haloes heavier than that.
    share: Vec<f64>,
}

impl MassFunction {
    /// From 1e6 to 1e16 Msun/h.
    pub fn new(power: &Power) -> MassFunction {
        const STEPS: usize = 400;
        let (from, to) = (libm::log(1e6), libm::log(1e16));
        let step = (to - from) / STEPS as f64;
        let log_mass: Vec<f64> = (0..=STEPS).map(|i| from + i as f64 * step).collect();
        // Few spheres are enough: sigma is smooth in log mass.
        const KNOTS: usize = 40;
        let knots: Vec<f64> = (0..=KNOTS)
            .map(|i| libm::log(power.sigma(lagrangian_radius(libm::exp(from + (to - from) * i as f64 / KNOTS as f64)))))
            .collect();
        let log_sigma = |i: usize| {
            let at = i as f64 * KNOTS as f64 / STEPS as f64;
            let knot = (at as usize).min(KNOTS - 1);
            knots[knot] + (at - knot as f64) * (knots[knot + 1] - knots[knot])
        };
        let (mut above, mut share) = (vec![0.0; STEPS + 1], vec![0.0; STEPS + 1]);
        for i in (0..STEPS).rev() {
            let (low, high) = (log_sigma(i), log_sigma(i + 1));
            let sigma = libm::exp(0.5 * (low + high));
            let mass = libm::exp(log_mass[i] + 0.5 * step);
            let within = collapsed(sigma) * (low - high);
            above[i] = above[i + 1] + MEAN_DENSITY / mass * within;
            share[i] = share[i + 1] + within;
        }
        MassFunction { log_mass, above, share }
    }

    /// Haloes in a cubic Mpc/h heavier than `mass`, and the share of all matter that is in them.
    pub fn above(&self, mass: f64) -> (f64, f64) {
        let log = libm::log(mass);
        let upper = self.log_mass.partition_point(|&x| x <= log).clamp(1, self.log_mass.len() - 1);
        let part =
            ((log - self.log_mass[upper - 1]) / (self.log_mass[upper] - self.log_mass[upper - 1])).clamp(0.0, 1.0);
        let at = |values: &[f64]| values[upper - 1] + part * (values[upper] - values[upper - 1]);
        (at(&self.above), at(&self.share))
    }

    /// The mass above which there are `number` haloes in a cubic Mpc/h.
    pub fn mass_at(&self, number: f64) -> f64 {
        let upper = self.above.partition_point(|&n| n > number).clamp(1, self.above.len() - 1);
        let (low, high) = (self.above[upper - 1], self.above[upper]);
        // Exponential between the knots; the last has nothing above it.
        let part = if high > 0.0 && number > 0.0 {
            libm::log(low / number) / libm::log(low / high)
        } else {
            1.0 - number / low.max(f64::MIN_POSITIVE)
        };
        let part = part.clamp(0.0, 1.0);
        libm::exp(self.log_mass[upper - 1] + part * (self.log_mass[upper] - self.log_mass[upper - 1]))
    }
}

/// Mass per interval of `ln sigma` that has collapsed (Sheth and Tormen).
fn collapsed(sigma: f64) -> f64 {
    let (norm, a, p) = (0.3222, 0.707, 0.3);
    let nu = COLLAPSE / sigma;
    let scaled = a * nu * nu;
    norm * (2.0 * scaled / PI).sqrt() * (1.0 + libm::pow(scaled, -p)) * libm::exp(-0.5 * scaled)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spectrum_has_its_amplitude_and_slopes() {
        let power = Power::new();
        assert!((power.sigma(8.0) - SIGMA_8).abs() < 1e-12);
        // On the largest scales nothing has changed the primordial spectrum; on small scales it falls as k^(n-4) ln^2 k.
        let slope = |k: f64| libm::log(power.at(k * 1.01) / power.at(k / 1.01)) / libm::log(1.01 * 1.01);
        assert!((slope(1e-4) - SLOPE).abs() < 0.02, "{}", slope(1e-4));
        assert!((-2.9..-2.2).contains(&slope(10.0)), "{}", slope(10.0));
        // The peak of a universe of Gamma = 0.2 is near 0.02 h/Mpc.
        assert!(slope(0.01) > 0.0 && slope(0.04) < 0.0);
    }

    #[test]
    fn haloes_are_as_many_as_known() {
        let function = MassFunction::new(&Power::new());
        // About one cluster above 1e14 in a cube of 35 Mpc/h; 0.2 to 0.35 of all matter above 1e12.
        let (clusters, _) = function.above(1e14);
        assert!((1e-5..4e-5).contains(&clusters), "{clusters}");
        let (_, share) = function.above(1e12);
        assert!((0.2..0.4).contains(&share), "{share}");
        assert!(function.above(1e6).1 < 1.0);
        for mass in [1e8, 3e11, 2e14] {
            assert!((function.mass_at(function.above(mass).0) / mass - 1.0).abs() < 0.02);
        }
    }
}
