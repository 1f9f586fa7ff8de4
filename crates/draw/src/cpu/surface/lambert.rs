//! Lambert's shading of many facets at once, of which the mean of their unit normals over the area in plan is known.
//!
//! A facet with the slope vector `a = (-dh/dx, -dh/dy, 1)` has the normal `a / |a|`, shows an eye in direction `e` the area `(a . e)+` of each
//! unit in plan, and has the light `(a . l)+ / |a|` on it. Slopes are taken for normally distributed, alike along both axes. With the mean
//! normal `n`: its `z` is the mean of `1 / |a|`; `n / n_z` is taken for the mean slope; and `1 / n_z^2 = 1 + |mean slope|^2 + 2 s^2` gives the
//! variance `s^2`: what the mean lost in length. Facets that are alike lose nothing, and then this is Lambert's law.

use glam::DVec3;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// The mean normal of facets, seen by an eye.
#[derive(Clone, Copy, Debug)]
pub struct Facets {
    /// Mean slope vector.
    slope: DVec3,
    /// Variance of a slope along an axis.
    variance: f64,
    /// The mean of `1 / |a|`.
    up: f64,
}

/// So many deviations off nearly nothing of a normal distribution is.
const FAR: f64 = 6.5;

/// The mean of a normal distribution's positive part, and the share of it that is positive.
fn positive(mean: f64, deviation: f64) -> [f64; 2] {
    if deviation <= 1e-9 * mean.abs() {
        return [mean.max(0.0), if mean > 0.0 { 1.0 } else { 0.0 }];
    }
    let place = mean / deviation;
    // What is further off is less than a part in 10^9.
    if place > FAR {
        return [mean, 1.0];
    }
    let share = 0.5 * libm::erfc(-place * FRAC_1_SQRT_2);
    let density = (-0.5 * place * place).exp() / (2.0 * PI).sqrt();
    [mean * share + deviation * density, share]
}

impl Facets {
    /// Facets of a mean normal, whose slopes are so many times steeper than it says.
    pub fn new(normal: DVec3, steeper: f64) -> Facets {
        let up = normal.z.max(1e-6);
        let slope = DVec3::new(normal.x / up, normal.y / up, 1.0);
        let variance = (0.5 * ((up * up).recip() - slope.length_squared())).max(0.0) * steeper * steeper;
        let slope = DVec3::new(slope.x * steeper, slope.y * steeper, 1.0);
        let up = if steeper == 1.0 { up } else { (slope.length_squared() + 2.0 * variance).sqrt().recip() };
        Facets { slope, variance, up }
    }

    /// The mean light on what is seen, from 0 to 1: normals are turned to the eye. `light` and `eye` are unit vectors towards them.
    pub fn lit(&self, light: DVec3, eye: DVec3) -> f64 {
        // From below the back is seen, and what is on the other side is lit.
        let turned = if self.slope.dot(eye) < 0.0 { -1.0 } else { 1.0 };
        let (seen, towards) = (turned * self.slope.dot(eye), turned * self.slope.dot(light));
        let across = |a: DVec3, b: DVec3| self.variance * (a.x * b.x + a.y * b.y);
        let [shown, share] = positive(seen, across(eye, eye).sqrt());
        if shown <= 0.0 {
            return 0.0;
        }
        let [mean, lit_share] = match light == eye {
            // What is seen is lit.
            true => [towards, 1.0],
            false => positive(towards, across(light, light).sqrt()),
        };
        (self.up * (mean + across(light, eye) * share * lit_share / shown)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_facet_is_lamberts() {
        let normal = DVec3::new(0.3, -0.2, 0.9).normalize();
        let (light, eye) = (DVec3::new(-0.5, 0.1, 0.8).normalize(), DVec3::new(0.1, -0.7, 0.6).normalize());
        assert!((Facets::new(normal, 1.0).lit(light, eye) - normal.dot(light)).abs() < 1e-9);
        assert!((Facets::new(normal, 1.0).lit(eye, eye) - normal.dot(eye)).abs() < 1e-9);
        let below = -normal;
        assert!((Facets::new(normal, 1.0).lit(below, below) - 1.0).abs() < 1e-9);
    }

    /// From above the shading of the mean normal is the mean of the shadings.
    #[test]
    fn from_above_means_are_exact() {
        let normals =
            [DVec3::new(0.2, 0.1, 0.95), DVec3::new(-0.3, 0.2, 0.9), DVec3::new(0.1, -0.3, 0.9)].map(DVec3::normalize);
        let mean = normals.iter().sum::<DVec3>() / 3.0;
        let light = DVec3::new(-0.2, 0.3, 0.93).normalize();
        let expected = normals.iter().map(|normal| normal.dot(light)).sum::<f64>() / 3.0;
        assert!((Facets::new(mean, 1.0).lit(light, DVec3::Z) - expected).abs() < 2e-3);
    }

    /// From aside, against facets with such slopes.
    #[test]
    fn from_aside_what_is_seen_counts() {
        let (mean_slope, deviation) = ([0.2, -0.1], 0.4);
        let (light, eye) = (DVec3::new(-0.5, 0.5, 0.7).normalize(), DVec3::new(0.4, -0.5, 0.7).normalize());
        let (mut normal, mut lit, mut own, mut weight) = (DVec3::ZERO, 0.0, 0.0, 0.0);
        let count = 400;
        let place = |k: i32| 4.0 * (2.0 * (f64::from(k) + 0.5) / f64::from(count) - 1.0);
        let mut all = 0.0;
        for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
            let (u, v) = (place(i), place(j));
            let density = (-0.5 * (u * u + v * v)).exp();
            let a = DVec3::new(mean_slope[0] + deviation * u, mean_slope[1] + deviation * v, 1.0);
            all += density;
            normal += density * a.normalize();
            let seen = density * a.dot(eye).max(0.0);
            weight += seen;
            lit += seen * a.normalize().dot(light).max(0.0);
            own += seen * a.normalize().dot(eye).max(0.0);
        }
        let facets = Facets::new(normal / all, 1.0);
        assert!((facets.lit(light, eye) - lit / weight).abs() < 0.02, "{} {}", facets.lit(light, eye), lit / weight);
        assert!((facets.lit(eye, eye) - own / weight).abs() < 0.02, "{} {}", facets.lit(eye, eye), own / weight);
    }
}
