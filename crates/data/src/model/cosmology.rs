//! The homogeneous universe that a comoving simulation is embedded in: matter, curvature and a cosmological constant
//! (Friedmann's equation without radiation).

use serde::{Deserialize, Serialize};

/// Parameters of the expansion today, at scale factor 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cosmology {
    /// Density of matter in units of the critical density.
    pub omega_matter: f64,
    /// Density of the cosmological constant in units of the critical density.
    pub omega_lambda: f64,
    /// Hubble's constant `H0` in the unit of stored velocities, without their powers of the scale factor, by the unit of stored
    /// comoving lengths: `dx/da` of stored velocities is then in the unit of stored positions. 100 for km/s and Mpc/h, 0.1 for
    /// km/s and kpc/h, 67.8 for km/s and Mpc where `h` is 0.678.
    pub hubble: f64,
    /// Whether the source names no units, so that [`Cosmology::hubble`] is 100 by custom (km/s and Mpc/h) and may be 0.1.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hubble_assumed: bool,
}

impl Cosmology {
    /// `1 - omega_matter - omega_lambda`: the curvature's share.
    pub fn omega_curvature(&self) -> f64 {
        1.0 - self.omega_matter - self.omega_lambda
    }

    /// `H(a)` in the unit of [`Cosmology::hubble`]: `H^2 = H0^2 (Om a^-3 + Ok a^-2 + OL)`. `None` where that is no positive
    /// number: the universe was never of that size.
    pub fn hubble_rate(&self, scale_factor: f64) -> Option<f64> {
        let a = scale_factor;
        let squared = self.omega_matter / (a * a * a) + self.omega_curvature() / (a * a) + self.omega_lambda;
        let rate = self.hubble * squared.sqrt();
        (a > 0.0 && rate > 0.0 && rate.is_finite()).then_some(rate)
    }

    /// Time since the beginning, the integral of `da / (a H(a))` from 0 on, in units of `1 / H0`'s unit, to a relative 1e-12.
    /// `None` where there is no such time: no matter, or a universe that turns round before it reaches that size.
    pub fn age(&self, scale_factor: f64) -> Option<f64> {
        let usable = |value: f64| value > 0.0 && value.is_finite();
        if !(usable(self.omega_matter) && usable(self.hubble) && usable(scale_factor)) {
            return None;
        }
        // With `a = x^2` nothing is singular at the beginning: `2 x^2 / sqrt(Om + Ok x^2 + OL x^6) dx`.
        let integrand = |x: f64| {
            let a = x * x;
            2.0 * a / (self.omega_matter + self.omega_curvature() * a + self.omega_lambda * a * a * a).sqrt()
        };
        let age = integral(integrand, scale_factor.sqrt())? / self.hubble;
        usable(age).then_some(age)
    }
}

/// `1 / (1 + z)`; `None` where that is no positive number.
pub fn scale_factor_of(redshift: f64) -> Option<f64> {
    let a = 1.0 / (1.0 + redshift);
    (a > 0.0 && a.is_finite()).then_some(a)
}

/// `1 / a - 1`; `None` where `scale_factor` is not positive and finite.
pub fn redshift_of(scale_factor: f64) -> Option<f64> {
    let z = 1.0 / scale_factor - 1.0;
    (scale_factor > 0.0 && scale_factor.is_finite() && z.is_finite()).then_some(z)
}

/// Nodes and weights of Gauss and Legendre's rule of 8 points on [-1, 1], those above 0.
const RULE: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// How much the two halves of a panel may differ from the whole, relative to the integral.
const TOLERANCE: f64 = 1e-14;

/// How many panels an integral is worth; smooth ones take some ten.
const PANELS: usize = 4096;

/// The integral of `f` from 0 to `to`, panels being halved where they are not yet exact; `None` where `f` is no number.
fn integral(f: impl Fn(f64) -> f64, to: f64) -> Option<f64> {
    let panel = |from: f64, to: f64| {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let sum: f64 =
            RULE.iter().map(|(node, weight)| weight * (f(middle - half * node) + f(middle + half * node))).sum();
        half * sum
    };
    let whole = panel(0.0, to);
    let mut open = vec![(0.0, to, whole)];
    let mut sum = 0.0;
    for _ in 0..PANELS {
        let Some((from, to, whole)) = open.pop() else { return Some(sum) };
        let middle = 0.5 * (from + to);
        let (left, right) = (panel(from, middle), panel(middle, to));
        let halves = left + right;
        if !halves.is_finite() {
            return None;
        }
        if (halves - whole).abs() <= TOLERANCE * (sum + halves).abs() {
            sum += halves;
        } else {
            open.push((middle, to, right));
            open.push((from, middle, left));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(omega_matter: f64, omega_lambda: f64, hubble: f64) -> Cosmology {
        Cosmology { omega_matter, omega_lambda, hubble, hubble_assumed: false }
    }

    fn close(found: f64, expected: f64) {
        assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn ages_in_closed_form() {
        for a in [1e-6, 1e-3, 0.02, 0.5, 1.0, 3.0, 100.0] {
            // Einstein and de Sitter.
            close(of(1.0, 0.0, 100.0).age(a).unwrap(), 2.0 / 300.0 * a.powf(1.5));
            // Flat, with a cosmological constant.
            for matter in [0.01, 0.308, 0.9] {
                let lambda: f64 = 1.0 - matter;
                let grown = (lambda / matter).sqrt() * a.powf(1.5);
                close(of(matter, lambda, 70.0).age(a).unwrap(), 2.0 / (3.0 * 70.0 * lambda.sqrt()) * grown.asinh());
            }
            // Open, without one: `Ok / Om a = sinh^2(eta / 2)`, and `t = Om / (2 Ok^1.5) (sinh eta - eta) / H0`; the difference
            // loses digits early on.
            let (matter, curvature) = (0.3, 0.7f64);
            let eta = 2.0 * (curvature / matter * a).sqrt().asinh();
            let expected = matter / (2.0 * curvature.powf(1.5)) * (eta.sinh() - eta);
            let found = of(matter, 0.0, 1.0).age(a).unwrap();
            assert!((found - expected).abs() < 1e-12 * expected + 1e-16 * eta, "{a}: {found} {expected}");
        }
        // Closed, without one: `t = Om / (2 |Ok|^1.5) (eta - sin eta)` up to the turn.
        let eta = 2.0 * (1.0f64 / 2.0 * 1.9).sqrt().asin();
        close(of(2.0, 0.0, 1.0).age(1.9).unwrap(), eta - eta.sin());
    }

    #[test]
    fn the_rate_is_friedmanns() {
        close(of(0.3, 0.7, 100.0).hubble_rate(1.0).unwrap(), 100.0);
        close(of(0.3, 0.7, 100.0).hubble_rate(0.5).unwrap(), 100.0 * (0.3f64 * 8.0 + 0.7).sqrt());
        close(of(0.3, 0.0, 0.1).hubble_rate(0.5).unwrap(), 0.1 * (0.3f64 * 8.0 + 0.7 * 4.0).sqrt());
    }

    #[test]
    fn what_never_was_has_no_rate_and_no_age() {
        // Closed: it turns at 2.
        assert_eq!(of(2.0, 0.0, 1.0).hubble_rate(2.1), None);
        assert_eq!(of(2.0, 0.0, 1.0).age(2.1), None);
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e308, -1e308, 1e-308];
        for (i, matter) in bad.into_iter().enumerate() {
            for lambda in bad {
                for (j, hubble) in bad.into_iter().enumerate() {
                    for a in bad.into_iter().chain([1.0]) {
                        let universe = of(matter, lambda, hubble);
                        let (rate, age) = (universe.hubble_rate(a), universe.age(a));
                        assert!(rate.iter().chain(&age).all(|value| *value > 0.0 && value.is_finite()));
                        assert!(age.is_none() || (i > 4 && j > 4), "{universe:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn redshifts_and_scale_factors_are_each_others_inverse() {
        for z in [0.0, 0.5, 3.0, 49.0, 1100.0, -0.5] {
            let a = scale_factor_of(z).unwrap();
            assert!((redshift_of(a).unwrap() - z).abs() < 1e-12 * (1.0 + z));
        }
        assert!([-1.0, -2.0, f64::NAN, f64::INFINITY].into_iter().all(|z| scale_factor_of(z).is_none()));
        assert!([0.0, -1.0, f64::NAN, f64::INFINITY].into_iter().all(|a| redshift_of(a).is_none()));
    }

    #[test]
    fn json_says_where_hubbles_constant_is_assumed() {
        let text = |universe| serde_json::to_string(&universe).unwrap();
        assert_eq!(text(of(0.3, 0.7, 100.0)), r#"{"omega_matter":0.3,"omega_lambda":0.7,"hubble":100.0}"#);
        let assumed = Cosmology { hubble_assumed: true, ..of(1.0, 0.0, 100.0) };
        assert!(text(assumed).ends_with(r#""hubble_assumed":true}"#));
        assert_eq!(serde_json::from_str::<Cosmology>(&text(assumed)).unwrap(), assumed);
    }
}
