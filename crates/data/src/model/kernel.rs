//! SPH smoothing kernels with compact support (F12 3.2.2), three-dimensional and integrated along a line of sight.
//!
//! All kernels vanish at and beyond `r = h`, so `h` is the support radius. Everything here is dimensionless: lengths
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
    /// The M5 quartic spline (Dehnen and Aly 2012, table 1).
    QuarticSpline,
    /// The M6 quintic spline (Dehnen and Aly 2012, table 1).
    QuinticSpline,
    /// Wendland's function C2 in three dimensions (Dehnen and Aly 2012, table 1).
    WendlandC2,
    /// Wendland's function C4 in three dimensions (Dehnen and Aly 2012, table 1).
    WendlandC4,
    /// Wendland's function C6 in three dimensions (Dehnen and Aly 2012, table 1).
    WendlandC6,
}

/// Most pieces of a kernel.
const PIECES: usize = 3;
/// Terms of a piece's polynomial in `q`.
const TERMS: usize = 12;

/// A kernel that is a sum of polynomials in `q`, each of which counts up to an end, times a factor.
struct Pieces {
    factor: f64,
    /// Where each ends, and its coefficients.
    parts: [(f64, [f64; TERMS]); PIECES],
}

/// The quartic spline: `(1 - q)^4 - 5 (3/5 - q)^4 + 10 (1/5 - q)^4`.
const QUARTIC_SPLINE: Pieces =
    Pieces { factor: 15625.0 / (512.0 * PI), parts: [power(4, 1.0, 1.0), power(4, -5.0, 0.6), power(4, 10.0, 0.2)] };
/// The quintic spline: `(1 - q)^5 - 6 (2/3 - q)^5 + 15 (1/3 - q)^5`.
const QUINTIC_SPLINE: Pieces = Pieces {
    factor: 2187.0 / (40.0 * PI),
    parts: [power(5, 1.0, 1.0), power(5, -6.0, 2.0 / 3.0), power(5, 15.0, 1.0 / 3.0)],
};
/// `(1 - q)^4 (1 + 4 q)`.
const WENDLAND_C2: Pieces = wendland(21.0 / (2.0 * PI), 4, [1.0, 4.0, 0.0, 0.0]);
/// `(1 - q)^6 (1 + 6 q + 35/3 q^2)`.
const WENDLAND_C4: Pieces = wendland(495.0 / (32.0 * PI), 6, [1.0, 6.0, 35.0 / 3.0, 0.0]);
/// `(1 - q)^8 (1 + 8 q + 25 q^2 + 32 q^3)`.
const WENDLAND_C6: Pieces = wendland(1365.0 / (64.0 * PI), 8, [1.0, 8.0, 25.0, 32.0]);

/// `factor (end - q)^degree`, up to the end.
const fn power(degree: usize, factor: f64, end: f64) -> (f64, [f64; TERMS]) {
    let mut all = [0.0; TERMS];
    all[0] = factor;
    let mut done = 0;
    while done < degree {
        let mut k = TERMS - 1;
        while k > 0 {
            all[k] = end * all[k] - all[k - 1];
            k -= 1;
        }
        all[0] *= end;
        done += 1;
    }
    (end, all)
}

/// `factor (1 - q)^degree` times a polynomial.
const fn wendland(factor: f64, degree: usize, times: [f64; 4]) -> Pieces {
    let (end, powers) = power(degree, 1.0, 1.0);
    let mut all = [0.0; TERMS];
    let mut k = 0;
    while k < TERMS {
        let mut j = 0;
        while j < times.len() && j <= k {
            all[k] += times[j] * powers[k - j];
            j += 1;
        }
        k += 1;
    }
    Pieces { factor, parts: [(end, all), (0.0, [0.0; TERMS]), (0.0, [0.0; TERMS])] }
}

impl Pieces {
    /// The integral along the whole line at distance `q`.
    ///
    /// The powers' integrals follow from each other: with `I_k` the integral of `r^k` from the line's nearest point to the sphere of
    /// radius `R`, half a chord `L` away, `d(z r^k) = ((k + 1) r^k - k q^2 r^(k-2)) dz` gives `(k + 1) I_k = L R^k + k q^2 I_(k-2)`.
    fn along_line(&self, q: f64) -> f64 {
        let q2 = q * q;
        let mut sum = 0.0;
        for (end, coefficients) in self.parts.iter().filter(|(end, _)| q < *end) {
            let half_chord = (end * end - q2).sqrt();
            // I_(k-2) and I_(k-1). That of 1/r grows without bound as q falls to 0, but is multiplied by q^2.
            let inverse = if q > 0.0 { ((end + half_chord) / q).ln() } else { 0.0 };
            let mut before = [inverse, half_chord];
            let mut power = *end;
            sum += coefficients[0] * half_chord;
            for (k, coefficient) in coefficients.iter().enumerate().skip(1) {
                let degree = k as f64;
                let next = (half_chord * power + degree * q2 * before[0]) / (degree + 1.0);
                sum += coefficient * next;
                before = [before[1], next];
                power *= end;
            }
        }
        // Where next to nothing is left, rounding could leave less.
        (2.0 * self.factor * sum).max(0.0)
    }
}

impl Kernel {
    /// Every kernel.
    pub const ALL: [Kernel; 7] = [
        Kernel::CubicSpline,
        Kernel::Poly6,
        Kernel::QuarticSpline,
        Kernel::QuinticSpline,
        Kernel::WendlandC2,
        Kernel::WendlandC4,
        Kernel::WendlandC6,
    ];

    /// Its name in settings and in what is told of files.
    pub const fn name(self) -> &'static str {
        match self {
            Kernel::CubicSpline => "cubic-spline",
            Kernel::Poly6 => "poly6",
            Kernel::QuarticSpline => "quartic-spline",
            Kernel::QuinticSpline => "quintic-spline",
            Kernel::WendlandC2 => "wendland-c2",
            Kernel::WendlandC4 => "wendland-c4",
            Kernel::WendlandC6 => "wendland-c6",
        }
    }

    /// That of a name.
    pub fn of_name(name: &str) -> Option<Kernel> {
        Kernel::ALL.into_iter().find(|kernel| kernel.name() == name)
    }

    /// What [`Kernel::value`] is a multiple of, for code that computes the rest in its own way.
    pub const fn factor(self) -> f64 {
        match self {
            Kernel::CubicSpline => 8.0 / PI,
            Kernel::Poly6 => 315.0 / (64.0 * PI),
            Kernel::QuarticSpline => QUARTIC_SPLINE.factor,
            Kernel::QuinticSpline => QUINTIC_SPLINE.factor,
            Kernel::WendlandC2 => WENDLAND_C2.factor,
            Kernel::WendlandC4 => WENDLAND_C4.factor,
            Kernel::WendlandC6 => WENDLAND_C6.factor,
        }
    }

    /// `h^3 W(q h, h)` for `q = r / h`: the dimensionless kernel, zero for `q >= 1`.
    pub fn value(self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Kernel::CubicSpline if q <= 0.5 => 8.0 / PI * (1.0 - 6.0 * q * q + 6.0 * q * q * q),
            Kernel::CubicSpline => 8.0 / PI * 2.0 * (1.0 - q).powi(3),
            Kernel::Poly6 => 315.0 / (64.0 * PI) * (1.0 - q * q).powi(3),
            Kernel::QuarticSpline => {
                let [a, b, c] = [1.0, 0.6, 0.2].map(|end: f64| (end - q).max(0.0).powi(4));
                self.factor() * (a - 5.0 * b + 10.0 * c)
            }
            Kernel::QuinticSpline => {
                let [a, b, c] = [1.0, 2.0 / 3.0, 1.0 / 3.0].map(|end: f64| (end - q).max(0.0).powi(5));
                self.factor() * (a - 6.0 * b + 15.0 * c)
            }
            Kernel::WendlandC2 => self.factor() * (1.0 - q).powi(4) * (1.0 + 4.0 * q),
            Kernel::WendlandC4 => self.factor() * (1.0 - q).powi(6) * (1.0 + q * (6.0 + 35.0 / 3.0 * q)),
            Kernel::WendlandC6 => self.factor() * (1.0 - q).powi(8) * (1.0 + q * (8.0 + q * (25.0 + 32.0 * q))),
        }
    }

    /// Variance of `W` along each axis, in units of `h^2`: a third of the integral of `q^2 W` over space. A projection leaves it
    /// as it is.
    ///
    /// In closed form: 3/40 for the cubic spline, 1/11 for poly6, 23/375 and 7/135 for the quartic and the quintic spline, 1/15, 2/39
    /// and 1/24 for Wendland's C2, C4 and C6.
    pub fn variance(self) -> f64 {
        match self {
            Kernel::CubicSpline => 3.0 / 40.0,
            Kernel::Poly6 => 1.0 / 11.0,
            Kernel::QuarticSpline => 23.0 / 375.0,
            Kernel::QuinticSpline => 7.0 / 135.0,
            Kernel::WendlandC2 => 1.0 / 15.0,
            Kernel::WendlandC4 => 2.0 / 39.0,
            Kernel::WendlandC6 => 1.0 / 24.0,
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
            Kernel::QuarticSpline => {
                let [a, b, c] = [1.0, 0.6, 0.2].map(|end: f64| (end - q).max(0.0).powi(3));
                -4.0 * self.factor() * (a - 5.0 * b + 10.0 * c)
            }
            Kernel::QuinticSpline => {
                let [a, b, c] = [1.0, 2.0 / 3.0, 1.0 / 3.0].map(|end: f64| (end - q).max(0.0).powi(4));
                -5.0 * self.factor() * (a - 6.0 * b + 15.0 * c)
            }
            Kernel::WendlandC2 => -20.0 * self.factor() * q * (1.0 - q).powi(3),
            Kernel::WendlandC4 => -56.0 / 3.0 * self.factor() * q * (1.0 - q).powi(5) * (1.0 + 5.0 * q),
            Kernel::WendlandC6 => -22.0 * self.factor() * q * (1.0 - q).powi(7) * (1.0 + q * (7.0 + 16.0 * q)),
        }
    }

    /// `h^2 F(q h, h)`: the integral of `W` along the whole line that passes the particle at distance `s = q h`, zero
    /// for `q >= 1`. Its integral over the plane is 1.
    ///
    /// In closed form. With `L = sqrt(1 - q^2)`, the truncated power `(1 - r)_+^3` integrates to
    /// `g(q) = L/2 + 13/4 q^2 L - (3 q^2 + 3/4 q^4) arcosh(1/q)`, and the spline is
    /// `8/pi (2 (1 - r)_+^3 - 8 (1/2 - r)_+^3)`. The others are sums of such integrals of powers of `r`.
    pub fn projected(self, q: f64) -> f64 {
        if q >= 1.0 {
            return 0.0;
        }
        match self {
            Kernel::CubicSpline => 8.0 / PI * (2.0 * truncated_cube_line(q) - 0.5 * truncated_cube_line(2.0 * q)),
            Kernel::Poly6 => 9.0 / (2.0 * PI) * (1.0 - q * q).powi(3) * (1.0 - q * q).sqrt(),
            Kernel::QuarticSpline => QUARTIC_SPLINE.along_line(q),
            Kernel::QuinticSpline => QUINTIC_SPLINE.along_line(q),
            Kernel::WendlandC2 => WENDLAND_C2.along_line(q),
            Kernel::WendlandC4 => WENDLAND_C4.along_line(q),
            Kernel::WendlandC6 => WENDLAND_C6.along_line(q),
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
            // Wendland's C6 is a sum of terms of a thousand.
            assert!(kernel.projected(1.0 - 1e-9) < 1e-11 && kernel.projected(0.0) > 1.0);
        }
    }

    #[test]
    fn names_are_those_of_files() {
        for kernel in Kernel::ALL {
            assert_eq!(serde_json::to_string(&kernel).ok(), Some(format!("\"{}\"", kernel.name())));
            assert_eq!(Kernel::of_name(kernel.name()), Some(kernel));
            // Tables of all kernels are read by number.
            assert_eq!(Kernel::ALL[kernel as usize], kernel);
        }
        assert_eq!(Kernel::of_name("gauss"), None);
    }

    /// Supports over smoothing scales, Dehnen and Aly (2012), table 1.
    #[test]
    fn published_widths_are_the_kernels() {
        for (kernel, support) in [
            (Kernel::CubicSpline, 1.825_742),
            (Kernel::QuarticSpline, 2.018_932),
            (Kernel::QuinticSpline, 2.195_775),
            (Kernel::WendlandC2, 1.936_492),
            (Kernel::WendlandC4, 2.207_940),
            (Kernel::WendlandC6, 2.449_490),
        ] {
            // Their smoothing scale is twice the standard deviation.
            let found = 0.5 * kernel.variance().sqrt().recip();
            assert!((found - support).abs() < 1e-6, "{kernel:?}: {found}");
        }
    }
}
