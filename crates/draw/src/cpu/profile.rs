//! Line-of-sight kernels as polynomials, for inner loops without tables.
//!
//! A profile of radius 1 is `f(z) = t^3 (c_0 + c_1 y + ... + c_8 y^8)` with `z` the squared distance, `t = 1 - z` and
//! `y = 2 t - 1`; it is zero for `t <= 0`. `t^3` gives it the smooth edge that kernels have. The coefficients are
//! a least-squares fit over the disc, scaled so that the plane integral is exactly 1. Over the disc the relative L1
//! distance from the cubic spline's `F` is 1.7e-4, from poly6's 2e-6, from the quartic and the quintic spline's 2.2e-4 and 8e-5, from
//! Wendland's C2, C4 and C6 4.6e-4, 2.7e-4 and 2.6e-4.

use super::table::LineTable;
use crate::model::Kernel;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Number of coefficients.
pub const TERMS: usize = 9;

/// Coefficients `c_j` of a profile, in ascending order.
pub type Profile = [f32; TERMS];

/// Splats between [`Profiles::SMALLEST`] and [`Profiles::LARGEST`] pixels are drawn with their mean over a pixel, so
/// that sampling at pixel centres gives area means. The pixel's square is replaced by its average over all
/// orientations: its anisotropy enters at fourth order, below 2e-4 of the peak at radius 3 and 1e-5 at radius 6.
pub struct Profiles {
    /// The kernel itself.
    pub sampled: Profile,
    /// Root of the kernel's second moment along one axis, in units of its radius.
    pub spread: f64,
    blurred: Vec<Profile>,
}

impl Profiles {
    /// Smallest radius, pixels, of a splat drawn with a blurred profile.
    pub const SMALLEST: f64 = 3.0;
    /// Largest radius, pixels, of a splat drawn with a blurred profile.
    pub const LARGEST: f64 = super::pyramid::SMALLEST_RADIUS;
    /// A blurred profile reaches this far beyond the splat's radius, pixels: half a pixel's diagonal.
    pub const REACH: f32 = 0.71;
    const STEPS: usize = 96;

    /// The profiles of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static Profiles {
        static PROFILES: [OnceLock<Profiles>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        PROFILES[kernel as usize].get_or_init(|| {
            let line = LineTable::of(kernel);
            let blurred = (0..=Profiles::STEPS)
                .map(|step| {
                    let share = step as f64 / Profiles::STEPS as f64;
                    let radius = Profiles::SMALLEST + share * (Profiles::LARGEST - Profiles::SMALLEST);
                    let reach = radius + f64::from(Profiles::REACH);
                    fit(|z| pixel_mean(line, radius, z.sqrt() * reach))
                })
                .collect();
            // With z = q^2: the integral of x^2 F over the plane is pi/2 times that of z F over z.
            let moment: f64 = (0..2000).map(|i| (f64::from(i) + 0.5) / 2000.0).map(|z| z * line.at_square(z)).sum();
            Profiles { sampled: fit(|z| line.at_square(z)), spread: (0.5 * PI * moment / 2000.0).sqrt(), blurred }
        })
    }

    /// The profile of a splat of `radius` pixels averaged over a pixel; its own radius is `radius + REACH`.
    pub fn blurred(&self, radius: f32) -> &Profile {
        let share = (radius - Profiles::SMALLEST as f32) / (Profiles::LARGEST - Profiles::SMALLEST) as f32;
        // The cast saturates: negative and NaN become 0.
        let step = (share * Profiles::STEPS as f32 + 0.5) as usize;
        &self.blurred[step.min(Profiles::STEPS)]
    }
}

/// Mean of a splat of `radius` over a pixel's square at `distance` from its centre, averaged over the square's
/// orientations; up to a factor.
fn pixel_mean(line: &LineTable, radius: f64, distance: f64) -> f64 {
    // Gauss-Legendre with six nodes on [-1/2, 1/2].
    const NODES: [(f64, f64); 3] = [
        (0.119_309_593_041_598_45, 0.233_956_967_286_345_52),
        (0.330_604_693_233_132_3, 0.180_380_786_524_069_3),
        (0.466_234_757_101_576, 0.085_662_246_189_585_18),
    ];
    let nodes = || NODES.iter().flat_map(|&(x, w)| [(-x, w), (x, w)]);
    let mut sum = 0.0;
    for turn in 0..4 {
        let (sin, cos) = ((f64::from(turn) + 0.5) * PI / 16.0).sin_cos();
        for (dy, wy) in nodes() {
            for (dx, wx) in nodes() {
                let (x, y) = (distance * cos + dx, distance * sin + dy);
                sum += wx * wy * line.at_square((x * x + y * y) / (radius * radius));
            }
        }
    }
    sum / 4.0
}

/// Fits a profile to `f(z)` over `z` in [0, 1], which is uniform in area, and scales it to unit plane integral.
fn fit(f: impl Fn(f64) -> f64) -> Profile {
    const SAMPLES: usize = 400;
    // Normal equations in Chebyshev polynomials of y, times t^3.
    let mut matrix = [[0.0; TERMS + 1]; TERMS];
    for sample in 0..SAMPLES {
        let z = (sample as f64 + 0.5) / SAMPLES as f64;
        let (t, y) = (1.0 - z, 1.0 - 2.0 * z);
        let mut basis = [t * t * t; TERMS];
        basis[1] *= y;
        for j in 2..TERMS {
            basis[j] = 2.0 * y * basis[j - 1] - basis[j - 2];
        }
        let value = f(z);
        for (row, &a) in matrix.iter_mut().zip(&basis) {
            for (entry, &b) in row.iter_mut().zip(basis.iter().chain([&value])) {
                *entry += a * b;
            }
        }
    }
    let chebyshev = solve(matrix);
    let mut coefficients = [0.0; TERMS];
    let (mut before, mut current) = ([0.0; TERMS], [0.0; TERMS]);
    before[0] = 1.0;
    current[1] = 1.0;
    for c in chebyshev {
        for (coefficient, power) in coefficients.iter_mut().zip(before) {
            *coefficient += c * power;
        }
        let mut next = [0.0; TERMS];
        for k in 0..TERMS {
            next[k] = if k > 0 { 2.0 * current[k - 1] } else { 0.0 } - before[k];
        }
        (before, current) = (current, next);
    }
    // Plane integral: pi times the integral over z.
    const STEPS: usize = 2000;
    let value = |z: f64| {
        let (t, y) = (1.0 - z, 1.0 - 2.0 * z);
        t * t * t * coefficients.iter().rev().fold(0.0, |sum, c| sum * y + c)
    };
    let integral = (0..STEPS).map(|i| value((i as f64 + 0.5) / STEPS as f64)).sum::<f64>() * PI / STEPS as f64;
    coefficients.map(|c| (c / integral) as f32)
}

/// Gaussian elimination with pivoting on rows.
pub(super) fn solve(mut matrix: [[f64; TERMS + 1]; TERMS]) -> [f64; TERMS] {
    for k in 0..TERMS {
        let pivot = (k..TERMS).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs())).unwrap_or(k);
        matrix.swap(k, pivot);
        for row in k + 1..TERMS {
            let factor = matrix[row][k] / matrix[k][k];
            let pivot = matrix[k];
            for (entry, known) in matrix[row].iter_mut().zip(pivot).skip(k) {
                *entry -= factor * known;
            }
        }
    }
    let mut solution = [0.0; TERMS];
    for k in (0..TERMS).rev() {
        let known: f64 = (k + 1..TERMS).map(|j| matrix[k][j] * solution[j]).sum();
        solution[k] = (matrix[k][TERMS] - known) / matrix[k][k];
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluate(profile: &Profile, z: f64) -> f64 {
        let (t, y) = (1.0 - z, 1.0 - 2.0 * z);
        t * t * t * profile.iter().rev().fold(0.0, |sum, &c| sum * y + f64::from(c))
    }

    #[test]
    fn profiles_follow_the_kernel_and_conserve() {
        for kernel in Kernel::ALL {
            let bound = match kernel {
                Kernel::CubicSpline | Kernel::QuinticSpline => 2e-4,
                Kernel::Poly6 => 5e-6,
                Kernel::QuarticSpline | Kernel::WendlandC4 | Kernel::WendlandC6 => 3e-4,
                Kernel::WendlandC2 => 6e-4,
            };
            let profiles = Profiles::of(kernel);
            let samples: Vec<f64> = (0..5000).map(|i| (f64::from(i) + 0.5) / 5000.0).collect();
            let distance: f64 = samples
                .iter()
                .map(|&z| (evaluate(&profiles.sampled, z) - kernel.projected(z.sqrt())).abs())
                .sum::<f64>();
            assert!(distance * PI / 5000.0 < bound, "{kernel:?}: {}", distance * PI / 5000.0);
            for radius in [3.0, 4.3, 6.0] {
                let integral = samples.iter().map(|&z| evaluate(profiles.blurred(radius), z)).sum::<f64>();
                assert!((integral * PI / 5000.0 - 1.0).abs() < 5e-6, "{kernel:?} {radius}: {}", integral * PI / 5000.0);
            }
        }
    }
}
