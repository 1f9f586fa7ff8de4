//! A projected kernel as two products of a function of `x` and the same of `y`, in polynomials: what integrals over rectangles are made of.
//!
//! `F(x, y) = U_1'(x) U_1'(y) - U_2'(x) U_2'(y)` with odd polynomials `U` of degree 15, the best approximation of rank 2 over `[-1, 1]^2`
//! (relative L2 error of the cubic spline 1.5e-3 before, below 8e-4 after averaging over pixels of a quarter of the radius, and less for
//! larger pixels; before it 6e-4 of the quartic, 7e-4 of the quintic spline, 2.4e-3 of Wendland's C4, below 4e-3 of C2, C6 and poly6).
//! Integrals over pixels are products of differences of `U`, so they telescope: a splat's pixels add up to exactly its weight.

use crate::model::Kernel;
use std::sync::OnceLock;

/// Terms of the polynomials.
pub const TERMS: usize = 8;

/// Coefficients of `x, x^3, .. x^15` of an odd polynomial.
pub type Odd = [f32; TERMS];

/// The two functions of a kernel.
#[derive(Clone, Copy, Debug)]
pub struct KernelProducts {
    /// `U_1`.
    pub first: Odd,
    /// `U_2`.
    pub second: Odd,
}

/// What of a kernel lies between its middle and a height.
#[derive(Clone, Copy, Debug)]
pub struct HeightMoments {
    /// Its mass: an odd polynomial.
    pub mass: Odd,
    /// Its first moment: coefficients of `y^2, y^4, .. y^16`.
    pub mean: [f32; TERMS],
    /// Its second moment: coefficients of `y^3, y^5, .. y^17`.
    pub square: [f32; TERMS],
}

impl KernelProducts {
    /// Those of a kernel.
    pub const fn of(kernel: Kernel) -> KernelProducts {
        match kernel {
            Kernel::CubicSpline => CUBIC_SPLINE,
            Kernel::Poly6 => POLY6,
            Kernel::QuarticSpline => QUARTIC_SPLINE,
            Kernel::QuinticSpline => QUINTIC_SPLINE,
            Kernel::WendlandC2 => WENDLAND_C2,
            Kernel::WendlandC4 => WENDLAND_C4,
            Kernel::WendlandC6 => WENDLAND_C6,
        }
    }
}

impl HeightMoments {
    /// Those of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static HeightMoments {
        static MOMENTS: [OnceLock<HeightMoments>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        MOMENTS[kernel as usize].get_or_init(|| {
            let KernelProducts { first, second } = KernelProducts::of(kernel);
            let whole = |all: &Odd| 2.0 * all.iter().map(|&c| f64::from(c)).sum::<f64>();
            let mass = |k: usize| whole(&first) * f64::from(first[k]) - whole(&second) * f64::from(second[k]);
            // The mass per height times a power of the height, integrated term by term.
            let [mass, mean, square] = [1, 2, 3]
                .map(|order| std::array::from_fn(|k| ((2 * k + 1) as f64 / (2 * k + order) as f64 * mass(k)) as f32));
            HeightMoments { mass, mean, square }
        })
    }

    /// The kernel's variance, as these have it.
    pub fn variance(&self) -> f32 {
        2.0 * self.square.iter().sum::<f32>()
    }
}

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const CUBIC_SPLINE: KernelProducts = KernelProducts {
    first: [
        1.386026385e+00,
        -2.548320675e+00,
        3.716331782e+00,
        -3.610026278e+00, //
        2.150414900e+00,
        -6.080737705e-01,
        -2.642697544e-02,
        4.173924852e-02,
    ],
    second: [
        -1.145484466e-01,
        1.117772937e+00,
        -3.530588300e+00,
        7.083196061e+00, //
        -9.548409758e+00,
        8.086179920e+00,
        -3.805519286e+00,
        7.527505421e-01,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const POLY6: KernelProducts = KernelProducts {
    first: [
        1.206535464e+00,
        -1.504410433e+00,
        1.218097621e+00,
        -4.756587208e-01, //
        4.998647679e-02,
        7.670463789e-03,
        -1.441682252e-03,
        2.020483516e-03,
    ],
    second: [
        -1.560457586e-01,
        1.049876479e+00,
        -1.780130035e+00,
        1.269972934e+00, //
        -4.467097250e-01,
        3.419382221e-01,
        -3.325327629e-01,
        1.066165969e-01,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const QUARTIC_SPLINE: KernelProducts = KernelProducts {
    first: [
        1.548898697e+00,
        -3.632066488e+00,
        7.010941505e+00,
        -9.661204338e+00, //
        9.397742271e+00,
        -6.165656567e+00,
        2.438182592e+00,
        -4.355205595e-01,
    ],
    second: [
        -1.102834344e-01,
        1.274600625e+00,
        -4.275371552e+00,
        7.990879059e+00, //
        -9.199106216e+00,
        6.482040882e+00,
        -2.556676388e+00,
        4.302323461e-01,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const QUINTIC_SPLINE: KernelProducts = KernelProducts {
    first: [
        1.695671320e+00,
        -4.810859203e+00,
        1.128435230e+01,
        -1.872592926e+01, //
        2.143042755e+01,
        -1.602480888e+01,
        6.993887901e+00,
        -1.341656208e+00,
    ],
    second: [
        -1.097438335e-01,
        1.531405568e+00,
        -6.223434925e+00,
        1.404930019e+01, //
        -1.941687584e+01,
        1.634293747e+01,
        -7.688264847e+00,
        1.547640920e+00,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C2: KernelProducts = KernelProducts {
    first: [
        1.488527298e+00,
        -3.346325397e+00,
        6.900489807e+00,
        -1.164365578e+01, //
        1.498555946e+01,
        -1.296609497e+01,
        6.466530800e+00,
        -1.383620024e+00,
    ],
    second: [
        -6.559342146e-02,
        2.856881022e-01,
        1.933291554e+00,
        -1.080932045e+01, //
        2.260751343e+01,
        -2.435138702e+01,
        1.347802353e+01,
        -3.040623665e+00,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C4: KernelProducts = KernelProducts {
    first: [
        1.707059026e+00,
        -4.969437599e+00,
        1.228899670e+01,
        -2.210634041e+01, //
        2.782416153e+01,
        -2.284922218e+01,
        1.083194828e+01,
        -2.226045609e+00,
    ],
    second: [
        -8.499727398e-02,
        9.573826194e-01,
        -2.097761393e+00,
        -4.565951973e-02, //
        6.844524384e+00,
        -1.109150600e+01,
        7.422675610e+00,
        -1.871177554e+00,
    ],
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C6: KernelProducts = KernelProducts {
    first: [
        1.901113868e+00,
        -6.824675560e+00,
        2.016303253e+01,
        -4.117296219e+01, //
        5.592384338e+01,
        -4.777423859e+01,
        2.305079079e+01,
        -4.765984058e+00,
    ],
    second: [
        -9.530234337e-02,
        1.513205051e+00,
        -6.327507019e+00,
        1.384100437e+01, //
        -1.761985779e+01,
        1.312151718e+01,
        -5.294445038e+00,
        8.917338848e-01,
    ],
};

#[cfg(test)]
mod tests {
    use super::*;

    fn value(odd: &Odd, x: f64) -> f64 {
        odd.iter().rev().fold(0.0, |sum, &c| sum * x * x + f64::from(c)) * x
    }

    #[test]
    fn products_have_the_whole_weight_and_the_right_shape() {
        for kernel in Kernel::ALL {
            let KernelProducts { first, second } = KernelProducts::of(kernel);
            let whole = 4.0 * (value(&first, 1.0).powi(2) - value(&second, 1.0).powi(2));
            assert!((whole - 1.0).abs() < 1e-6, "{kernel:?}: {whole}");
            // Integrals over the cells of an 8 x 8 grid over the support.
            for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
                let edge = |k: i32| f64::from(k) / 4.0 - 1.0;
                let over = |odd: &Odd, k: i32| value(odd, edge(k + 1)) - value(odd, edge(k));
                let found = over(&first, i) * over(&first, j) - over(&second, i) * over(&second, j);
                let n = 40;
                let mut expected = 0.0;
                for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                    let at = |k: i32, s: i32| edge(k) + (f64::from(s) + 0.5) / f64::from(n) / 4.0;
                    expected += kernel.projected(at(i, a).hypot(at(j, b))) / f64::from(n * n) / 16.0;
                }
                assert!((found - expected).abs() < 3e-4, "{kernel:?} cell {i} {j}: {found} {expected}");
            }
        }
    }

    #[test]
    fn moments_are_the_kernels_own() {
        for kernel in Kernel::ALL {
            let moments = HeightMoments::of(kernel);
            let whole = 2.0 * value(&moments.mass, 1.0);
            // Coefficients of up to 60, in single precision.
            assert!((whole - 1.0).abs() < 5e-6, "{kernel:?}: {whole}");
            assert!((f64::from(moments.variance()) / kernel.variance() - 1.0).abs() < 5e-3, "{kernel:?}");
            // The upper half's mean height, by the midpoint rule over the disc.
            let n = 400;
            let at = |k: i32| (f64::from(k) + 0.5) / f64::from(n);
            let (mut mass, mut height) = (0.0, 0.0);
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let value = kernel.projected(at(i).hypot(at(j)));
                (mass, height) = (mass + value, height + value * at(j));
            }
            let found = f64::from(moments.mean.iter().sum::<f32>()) / value(&moments.mass, 1.0);
            assert!((found / (height / mass) - 1.0).abs() < 5e-3, "{kernel:?}: {found}, expected {}", height / mass);
        }
    }
}
