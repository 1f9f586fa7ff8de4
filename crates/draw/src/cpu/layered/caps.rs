//! What of a kernel lies between two parallel planes: its mass, how deep that lies on the average, and how wide it is.
//!
//! With `zeta` the distance of a plane from the particle's centre in units of `h`, the matter at one depth is the disc
//! `A(zeta) = 2 pi int_|zeta|^1 r W(r) dr`, with the second moment `A_2(zeta) = 2 pi int_|zeta|^1 (r^2 - zeta^2) r W(r) dr` of the
//! distance from the axis. Everything between two planes follows from the integrals of `A`, `zeta A` and `A_2` over depth.

use crate::model::Kernel;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// The integrals from -1 on, as a table with linear interpolation.
pub struct Caps {
    /// At `zeta = i / STEPS`: the integrals of `A` and `A_2` from 0, and of `zeta A` from there to 1.
    values: Vec<[f64; 3]>,
}

/// The part of a particle between two planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Its share of the mass.
    pub mass: f64,
    /// Mean depth, in `h` from the particle's centre.
    pub depth: f64,
    /// Smoothing length of a whole particle with the same second moment across, in units of `h`.
    pub width: f64,
}

impl Caps {
    const STEPS: usize = 2048;

    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static Caps {
        static TABLES: [OnceLock<Caps>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| Caps::compute(kernel))
    }

    fn compute(kernel: Kernel) -> Caps {
        let n = Caps::STEPS;
        let step = 1.0 / n as f64;
        let at = |i: usize| i as f64 * step;
        // Integrals of r W and r^3 W from each node to 1, by Simpson's rule.
        let mut inner = vec![[0.0; 2]; n + 1];
        for i in (0..n).rev() {
            let nodes = [at(i), at(i) + 0.5 * step, at(i + 1)];
            let simpson = |power: i32| {
                let [a, b, c] = nodes.map(|r| r.powi(power) * kernel.value(r));
                step / 6.0 * (a + 4.0 * b + c)
            };
            inner[i] = [inner[i + 1][0] + simpson(1), inner[i + 1][1] + simpson(3)];
        }
        let disc = |i: usize| {
            let [first, third] = inner[i];
            let (area, z) = (2.0 * PI * first, at(i));
            [area, 2.0 * PI * (third - z * z * first), z * area]
        };
        let mut values = vec![[0.0; 3]; n + 1];
        for i in 0..n {
            let (here, next) = (disc(i), disc(i + 1));
            values[i + 1] = std::array::from_fn(|k| values[i][k] + 0.5 * step * (here[k] + next[k]));
        }
        let [whole, _, moment] = values[n];
        let scale = 0.5 / whole;
        for value in &mut values {
            *value = [value[0] * scale, value[1] * scale, (moment - value[2]) * scale];
        }
        Caps { values }
    }

    /// Integrals of `A`, `A_2` and `zeta A` from -1 to `zeta`.
    fn below(&self, zeta: f64) -> [f64; 3] {
        let n = Caps::STEPS;
        let position = zeta.abs().min(1.0) * n as f64;
        let index = (position as usize).min(n - 1);
        let share = position - index as f64;
        let (low, high) = (self.values[index], self.values[index + 1]);
        let [mass, second, depth] = std::array::from_fn(|k| low[k] + share * (high[k] - low[k]));
        let half = self.values[n][1];
        match zeta < 0.0 {
            true => [0.5 - mass, half - second, -depth],
            false => [0.5 + mass, half + second, -depth],
        }
    }

    /// At equal steps of `zeta` from 0 to 1: the integrals of `A` and `A_2` from 0 to there, and of `zeta A` from there to 1.
    pub fn values(&self) -> &[[f64; 3]] {
        &self.values
    }

    /// The part between planes at `from` and `to`, in `h` from the centre. `None` where nothing is.
    pub fn between(&self, from: f64, to: f64) -> Option<Cut> {
        let (low, high) = (self.below(from), self.below(to));
        let [mass, second, depth] = std::array::from_fn(|k| high[k] - low[k]);
        let whole = 2.0 * self.values[Caps::STEPS][1];
        let width = (second / (mass * whole)).sqrt();
        (mass > 1e-9 && width > 0.0).then(|| Cut { mass, depth: depth / mass, width })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_particle_is_itself_and_parts_add_up() {
        for kernel in Kernel::ALL {
            let caps = Caps::of(kernel);
            let whole = caps.between(-3.0, 1.0).unwrap();
            assert!((whole.mass - 1.0).abs() < 1e-12 && (whole.width - 1.0).abs() < 1e-12 && whole.depth.abs() < 1e-12);
            let planes = [-1.0, -0.7, -0.2, 0.05, 0.4, 1.0];
            let parts: Vec<Cut> = planes.windows(2).filter_map(|pair| caps.between(pair[0], pair[1])).collect();
            assert!((parts.iter().map(|part| part.mass).sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(parts.iter().map(|part| part.mass * part.depth).sum::<f64>().abs() < 1e-9);
            assert!(parts.iter().zip(planes).all(|(part, from)| part.depth > from));
            assert!(caps.between(1.0, 2.0).is_none() && caps.between(0.3, 0.3).is_none());
        }
    }

    #[test]
    fn thin_parts_are_discs_of_the_kernel() {
        for kernel in Kernel::ALL {
            for zeta in [-0.8, -0.3, 0.0, 0.55] {
                let part = Caps::of(kernel).between(zeta - 0.002, zeta + 0.002).unwrap();
                // Mass of the disc by summing rings.
                let rings = (0..4000).map(|i| (f64::from(i) + 0.5) / 4000.0);
                let disc: f64 = rings.map(|q| 2.0 * PI * q * kernel.value(q.hypot(zeta)) / 4000.0).sum();
                assert!((part.mass / (0.004 * disc) - 1.0).abs() < 2e-3, "{kernel:?} {zeta}: {} {disc}", part.mass);
                assert!((part.depth - zeta).abs() < 1e-3 && part.width < 1.2, "{part:?}");
            }
        }
    }
}
