//! SPH smoothing kernels with compact support (F12 3.2.2), three-dimensional and integrated along a line of sight.
//!
//! Both kernels vanish at and beyond `r = h`, so `h` is the support radius. Everything here is dimensionless: lengths
//! are in units of `h`, so `W = value / h^3`, `dW/dr = slope / h^4` and the line-of-sight integral `F = projected / h^2`.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A smoothing kernel `W(r, h)`, normalised to unit volume integral.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// The M4 cubic spline, the kernel of Gadget and most astrophysical codes (F12 3.2.2, `W_spline`).
    #[default]
    CubicSpline,
    /// The poly6 kernel of fluid codes (F12 3.2.2, `W_poly6`).
    Poly6,
}

impl Kernel {
    /// Every kernel.
    pub const ALL: [Kernel; 2] = [Kernel::CubicSpline, Kernel::Poly6];

    /// `h^3 W(q h, h)` for `q = r / h`: the dimensionless kernel, zero for `q >= 1`.
    pub fn value(self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Kernel::CubicSpline if q <= 0.5 => 8.0 / PI * (1.0 - 6.0 * q * q + 6.0 * q * q * q),
            Kernel::CubicSpline => 8.0 / PI * 2.0 * (1.0 - q).powi(3),
            Kernel::Poly6 => 315.0 / (64.0 * PI) * (1.0 - q * q).powi(3),
        }
    }

    /// Variance of `W` along each axis, in units of `h^2`: a third of the integral of `q^2 W` over space. A projection leaves it
    /// as it is.
    ///
    /// In closed form: 3/40 for the cubic spline, 1/11 for poly6.
    pub fn variance(self) -> f64 {
        match self {
            Kernel::CubicSpline => 3.0 / 40.0,
            Kernel::Poly6 => 1.0 / 11.0,
        }
    }

    /// `h^4 dW/dr` at `r = q h`: the length of the gradient with its sign (never positive); the gradient itself points
    /// along `r` (F12 3.2.2).
    pub fn slope(self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Kernel::CubicSpline if q <= 0.5 => 48.0 / PI * (-2.0 * q + 3.0 * q * q),
            Kernel::CubicSpline => -48.0 / PI * (1.0 - q).powi(2),
            Kernel::Poly6 => -945.0 / (32.0 * PI) * q * (1.0 - q * q).powi(2),
        }
    }

    /// `h^2 F(q h, h)`: the integral of `W` along the whole line that passes the particle at distance `s = q h`, zero
    /// for `q >= 1`. Its integral over the plane is 1.
    ///
    /// In closed form. With `L = sqrt(1 - q^2)`, the truncated power `(1 - r)_+^3` integrates to
    /// `g(q) = L/2 + 13/4 q^2 L - (3 q^2 + 3/4 q^4) arcosh(1/q)`, and the spline is
    /// `8/pi (2 (1 - r)_+^3 - 8 (1/2 - r)_+^3)`.
    pub fn projected(self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Kernel::CubicSpline => 8.0 / PI * (2.0 * truncated_cube_line(q) - 0.5 * truncated_cube_line(2.0 * q)),
            Kernel::Poly6 => 9.0 / (2.0 * PI) * (1.0 - q * q).powi(3) * (1.0 - q * q).sqrt(),
        }
    }
}

/// Integral of `(1 - r)^3` over the part of a line at distance `q` that lies within `r <= 1`.
fn truncated_cube_line(q: f64) -> f64 {
    if q >= 1.0 {
        return 0.0;
    }
    let q2 = q * q;
    let half_chord = (1.0 - q2).sqrt();
    // arcosh(1/q) grows without bound as q falls to 0, but is multiplied by q^2.
    let arcosh = if q > 0.0 { ((1.0 + half_chord) / q).ln() } else { 0.0 };
    0.5 * half_chord + 3.25 * q2 * half_chord - (3.0 * q2 + 0.75 * q2 * q2) * arcosh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule with `n` steps.
    fn integrate(from: f64, to: f64, n: usize, f: impl Fn(f64) -> f64) -> f64 {
        let step = (to - from) / n as f64;
        (0..n).map(|i| f(from + (i as f64 + 0.5) * step)).sum::<f64>() * step
    }

    #[test]
    fn volume_and_plane_integrals_are_one() {
        for kernel in Kernel::ALL {
            let volume = integrate(0.0, 1.0, 20_000, |q| 4.0 * PI * q * q * kernel.value(q));
            let plane = integrate(0.0, 1.0, 20_000, |q| 2.0 * PI * q * kernel.projected(q));
            assert!((volume - 1.0).abs() < 1e-8, "{kernel:?}: {volume}");
            assert!((plane - 1.0).abs() < 1e-8, "{kernel:?}: {plane}");
        }
    }

    #[test]
    fn variances_are_second_moments() {
        for kernel in Kernel::ALL {
            let volume = integrate(0.0, 1.0, 20_000, |q| 4.0 / 3.0 * PI * q.powi(4) * kernel.value(q));
            let plane = integrate(0.0, 1.0, 20_000, |q| PI * q.powi(3) * kernel.projected(q));
            let expected = kernel.variance();
            assert!((volume - expected).abs() < 1e-8, "{kernel:?}: {volume}");
            assert!((plane - expected).abs() < 1e-8, "{kernel:?}: {plane}");
        }
    }

    #[test]
    fn projection_is_the_line_integral() {
        for kernel in Kernel::ALL {
            for i in 0..=100 {
                let q = f64::from(i) / 100.0;
                let line = 2.0 * integrate(0.0, 1.0, 20_000, |z| kernel.value(q.hypot(z)));
                let closed = kernel.projected(q);
                assert!((line - closed).abs() < 1e-7, "{kernel:?} at {q}: {line} against {closed}");
            }
        }
    }

    #[test]
    fn slope_is_the_derivative() {
        for kernel in Kernel::ALL {
            for i in 1..200 {
                let q = f64::from(i) / 200.0;
                let numeric = (kernel.value(q + 1e-6) - kernel.value(q - 1e-6)) / 2e-6;
                assert!((numeric - kernel.slope(q)).abs() < 1e-4, "{kernel:?} at {q}");
            }
        }
    }

    #[test]
    fn nothing_beyond_the_support() {
        for kernel in Kernel::ALL {
            for q in [1.0, 1.5, f64::INFINITY] {
                assert_eq!([kernel.value(q), kernel.slope(q), kernel.projected(q)], [0.0; 3]);
            }
            assert!(kernel.projected(1.0 - 1e-9) < 1e-12 && kernel.projected(0.0) > 1.0);
        }
    }
}
