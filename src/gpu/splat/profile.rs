//! The projected kernel as polynomials for the shaders.
//!
//! - Sampled splats: `F(u) = (1 - u)^2 sum_k c_k u^k` for `u = (s/h)^2`, a least-squares fit of degree 9 over the disc
//!   (relative L2 error 1e-4 for the cubic spline, 4e-7 for poly6, 1.6e-4 and 4e-5 for the quartic and the quintic spline, 4.2e-4, 1.8e-4
//!   and 1.4e-4 for Wendland's C2, C4 and C6; for these five the middle counts more, by `u^(-1/2)`) with plane integral 1; and the same form for
//!   half the Laplacian of `F`, by which the value at a pixel's centre becomes the mean over the pixel:
//!   `mean = F + (side^2 / 24) laplacian F + O(side^4)`.
//! - Small splats: products of functions of `x` and `y` ([`crate::cpu::kernel_products`]).
//! - Tilted ellipses among them, of correlation `rho`: `F_rho = F + rho d_x d_y g + (rho^2 / 2) d_x^2 d_y^2 k`, where
//!   `g(u) = (1/2) int_u^1 F` and `k(u) = (1/2) int_u^1 g` (each derivative by `rho` of an elliptical profile is that of a
//!   smoother one). `g ~ V(x) V(y)` and `k ~ K(x) K(y)`, `B = K'`, to 1.5 % (cubic spline) and 2.6 % (poly6); for the others, which are
//!   better, `V'(x) V'(y)` and `B'(x) B'(y)` are the best products for the derivatives. The pixels'
//!   integrals are products of differences of `V` and of `B`.

use crate::cpu::kernel_products::{KernelProducts, Odd};
use crate::model::Kernel;

/// Polynomial coefficients of one kernel, as the shaders take them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// `c_0 .. c_9` of `F`, padded with zeros.
    pub profile: [[f32; 4]; 3],
    /// The same for half the Laplacian of `F`.
    pub laplacian: [[f32; 4]; 3],
    /// Coefficients of `x, x^3, .. x^15` of `U_1`.
    pub first: Odd,
    /// The same of `U_2`.
    pub second: Odd,
    /// Coefficients of `1, x^2, .. x^14` of `V`.
    pub shear: [[f32; 4]; 2],
    /// Coefficients of `x, x^3, .. x^15` of `B`.
    pub bend: [[f32; 4]; 2],
    /// Variance of `F` along an axis, for `h = 1`.
    pub moment: f32,
}

impl Profile {
    /// The polynomials of a kernel.
    pub fn of(kernel: Kernel) -> &'static Profile {
        match kernel {
            Kernel::CubicSpline => &CUBIC_SPLINE,
            Kernel::Poly6 => &POLY6,
            Kernel::QuarticSpline => &QUARTIC_SPLINE,
            Kernel::QuinticSpline => &QUINTIC_SPLINE,
            Kernel::WendlandC2 => &WENDLAND_C2,
            Kernel::WendlandC4 => &WENDLAND_C4,
            Kernel::WendlandC6 => &WENDLAND_C6,
        }
    }

    /// Coefficients of `1, u, .. u^9` of `F''(u)`, padded with zeros. The mean over a pixel of an ellipse with the form `q^2 = d^T Q d` has, beside
    /// half the Laplacian of what is round, `F'' (|Q d|^2 - q^2 trace Q / 2) / 6`.
    pub fn curvature(&self) -> [[f32; 4]; 3] {
        let c: Vec<f64> = self.profile.as_flattened().iter().map(|&c| f64::from(c)).collect();
        let at = |k: usize| c.get(k).copied().unwrap_or(0.0);
        // (1 - u)^2 sum_k c_k u^k, multiplied out.
        let whole = |k: usize| {
            let before = |back: usize| k.checked_sub(back).map_or(0.0, at);
            at(k) - 2.0 * before(1) + before(2)
        };
        let second = |k: usize| ((k + 2) * (k + 1)) as f64 * whole(k + 2);
        std::array::from_fn(|row| std::array::from_fn(|k| second(4 * row + k) as f32))
    }
}

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const CUBIC_SPLINE: Profile = Profile {
    profile: [
        [1.909686193e+00, -6.668011254e+00, 1.630538913e+01, -8.267063995e+01],
        [4.180446417e+02, -1.275165191e+03, 2.289536922e+03, -2.399831510e+03],
        [1.362277529e+03, -3.238641406e+02, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-2.102829037e+01, 2.181932642e+02, -2.017755679e+03, 1.921456754e+04],
        [-1.040334665e+05, 3.192632633e+05, -5.767321709e+05, 6.097657462e+05],
        [-3.495512533e+05, 8.398557715e+04, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::CubicSpline).first,
    second: KernelProducts::of(Kernel::CubicSpline).second,
    shear: [
        [4.002460005e-01, -2.463285004e+00, 6.814398558e+00, -1.120057706e+01],
        [1.190444666e+01, -8.103990644e+00, 3.202944773e+00, -5.541832849e-01],
    ],
    bend: [
        [-1.499691316e+00, 9.234523357e+00, -2.568374748e+01, 4.285762445e+01],
        [-4.689582865e+01, 3.335997014e+01, -1.395351567e+01, 2.580665162e+00],
    ],
    moment: 7.500000031e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const POLY6: Profile = Profile {
    profile: [
        [1.432394097e+00, -2.148525088e+00, 5.349018227e-01, 1.208580169e-01],
        [-1.905043173e-01, 9.235163540e-01, -2.149698794e+00, 3.007302177e+00],
        [-2.253148869e+00, 7.197558515e-01, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-1.003337796e+01, 3.123240333e+01, -2.437941578e+01, 5.334248081e+02],
        [-3.663978191e+03, 1.454854899e+04, -3.377048307e+04, 4.557178023e+04],
        [-3.302890626e+04, 9.970722617e+03, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::Poly6).first,
    second: KernelProducts::of(Kernel::Poly6).second,
    shear: [
        [4.014427198e-01, -1.904012125e+00, 3.534270306e+00, -3.153394336e+00],
        [1.297730469e+00, -1.852810144e-01, 3.357014568e-02, -2.432616546e-02],
    ],
    bend: [
        [-1.389106978e+00, 6.555982795e+00, -1.209877812e+01, 1.073254019e+01],
        [-4.431438236e+00, 7.171621661e-01, -1.884276824e-01, 1.020658702e-01],
    ],
    moment: 9.090909114e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const QUARTIC_SPLINE: Profile = Profile {
    profile: [
        [2.387612516e+00, -1.172791105e+01, 2.624798458e+01, -2.486805458e+01],
        [-7.642330453e+01, 4.555508272e+02, -1.101446524e+03, 1.431913659e+03],
        [-9.674219519e+02, 2.661107039e+02, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-3.309416723e+01, 3.601877791e+02, -1.102382721e+03, 1.194016394e+02],
        [1.652798965e+04, -8.315903601e+04, 2.025443738e+05, -2.674780745e+05],
        [1.828688515e+05, -5.070664230e+04, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::QuarticSpline).first,
    second: KernelProducts::of(Kernel::QuarticSpline).second,
    shear: [
        [3.997525480e-01, -2.926203245e+00, 9.728375336e+00, -1.916599509e+01],
        [2.406548669e+01, -1.900576518e+01, 8.596125619e+00, -1.691776672e+00],
    ],
    bend: [
        [-1.546219459e+00, 1.081198911e+01, -3.423261599e+01, 6.398525432e+01],
        [-7.593742609e+01, 5.653358995e+01, -2.408123745e+01, 4.466665599e+00],
    ],
    moment: 6.133333221e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const QUINTIC_SPLINE: Profile = Profile {
    profile: [
        [2.864651949e+00, -1.833777553e+01, 5.454246819e+01, -9.652421352e+01],
        [9.193664366e+01, 2.454277260e+01, -2.256513073e+02, 3.286615803e+02],
        [-2.207871568e+02, 5.879345528e+01, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-4.810972175e+01, 6.532903619e+02, -2.571627435e+03, 3.546538035e+03],
        [8.806846111e+03, -5.520291019e+04, 1.266755948e+05, -1.551406513e+05],
        [9.937092198e+04, -2.611113869e+04, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::QuinticSpline).first,
    second: KernelProducts::of(Kernel::QuinticSpline).second,
    shear: [
        [3.993874777e-01, -3.506258482e+00, 1.399274864e+01, -3.267448494e+01],
        [4.748148461e+01, -4.219994746e+01, 2.093147616e+01, -4.424406017e+00],
    ],
    bend: [
        [-1.689308593e+00, 1.419802429e+01, -5.386436928e+01, 1.188627391e+02],
        [-1.628338175e+02, 1.366170846e+02, -6.422481243e+01, 1.293445977e+01],
    ],
    moment: 5.185185000e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C2: Profile = Profile {
    profile: [
        [2.226720098e+00, -1.165246512e+01, 5.206436997e+01, -2.687916355e+02],
        [1.120967556e+03, -3.145518642e+03, 5.618453928e+03, -6.091739753e+03],
        [3.641089720e+03, -9.178987072e+02, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-3.198963887e+01, 5.332230578e+02, -5.226578725e+03, 3.762644080e+04],
        [-1.728826876e+05, 4.968807269e+05, -8.871694470e+05, 9.528970099e+05],
        [-5.623627959e+05, 1.398423250e+05, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::WendlandC2).first,
    second: KernelProducts::of(Kernel::WendlandC2).second,
    shear: [
        [3.996511274e-01, -2.676744866e+00, 8.395247808e+00, -1.664188831e+01],
        [2.255624945e+01, -2.007293805e+01, 1.033135324e+01, -2.290930406e+00],
    ],
    bend: [
        [-1.467039736e+00, 9.309719160e+00, -2.775403685e+01, 5.269683009e+01],
        [-6.894374242e+01, 5.946193633e+01, -2.969881832e+01, 6.395151748e+00],
    ],
    moment: 6.666667014e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C4: Profile = Profile {
    profile: [
        [2.917322985e+00, -2.026198031e+01, 8.078541845e+01, -2.866633092e+02],
        [9.209777094e+02, -2.257243160e+03, 3.743289201e+03, -3.877900331e+03],
        [2.248218828e+03, -5.545560113e+02, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-5.209839547e+01, 8.799769598e+02, -6.395031802e+03, 3.475042427e+04],
        [-1.373225737e+05, 3.639344609e+05, -6.187841611e+05, 6.434692606e+05],
        [-3.711677222e+05, 9.074872061e+04, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::WendlandC4).first,
    second: KernelProducts::of(Kernel::WendlandC4).second,
    shear: [
        [3.992198586e-01, -3.529083230e+00, 1.424071711e+01, -3.386643253e+01],
        [5.042261521e+01, -4.603955743e+01, 2.345337415e+01, -5.080853145e+00],
    ],
    bend: [
        [-1.688715573e+00, 1.420155635e+01, -5.406501263e+01, 1.205453098e+02],
        [-1.680852380e+02, 1.442843630e+02, -6.955751724e+01, 1.436525423e+01],
    ],
    moment: 5.128205195e-02,
};

#[allow(clippy::excessive_precision, reason = "fitted in double precision")]
const WENDLAND_C6: Profile = Profile {
    profile: [
        [3.620412433e+00, -3.248482504e+01, 1.489956753e+02, -4.977687780e+02],
        [1.357745426e+03, -2.898085297e+03, 4.397179314e+03, -4.309371376e+03],
        [2.409234973e+03, -5.794749764e+02, 0.000000000e+00, 0.000000000e+00],
    ],
    laplacian: [
        [-7.938219347e+01, 1.575355633e+03, -1.154447982e+04, 5.462031773e+04],
        [-1.870133988e+05, 4.498966964e+05, -7.200569686e+05, 7.199788461e+05],
        [-4.042324835e+05, 9.691498490e+04, 0.000000000e+00, 0.000000000e+00],
    ],
    first: KernelProducts::of(Kernel::WendlandC6).first,
    second: KernelProducts::of(Kernel::WendlandC6).second,
    shear: [
        [3.983320280e-01, -4.343388723e+00, 2.114888345e+01, -5.842494026e+01],
        [9.692806767e+01, -9.520992548e+01, 5.086299992e+01, -1.136002860e+01],
    ],
    bend: [
        [-1.872311095e+00, 1.934226471e+01, -8.829134304e+01, 2.275302898e+02],
        [-3.526268334e+02, 3.253203310e+02, -1.643720167e+02, 3.496961864e+01],
    ],
    moment: 4.166666791e-02,
};

#[cfg(test)]
mod tests {
    use super::*;

    fn flat<const N: usize>(rows: [[f32; 4]; N]) -> Vec<f64> {
        rows.iter().flatten().map(|&c| f64::from(c)).collect()
    }

    fn disc(coefficients: &[f64], u: f64) -> f64 {
        (1.0 - u).powi(2) * coefficients.iter().rev().fold(0.0, |sum, c| sum * u + c)
    }

    #[test]
    fn sampled_profile_follows_the_kernel() {
        for kernel in Kernel::ALL {
            let c = flat(Profile::of(kernel).profile);
            let peak = kernel.projected(0.0);
            let n = 1000;
            let mut integral = 0.0;
            for i in 0..n {
                let u = (f64::from(i) + 0.5) / f64::from(n);
                let error = (disc(&c, u) - kernel.projected(u.sqrt())).abs();
                // Wendland's C2 is the least smooth in the middle.
                let bound = if kernel == Kernel::WendlandC2 { 6e-4 } else { 2e-4 };
                assert!(error < bound * peak, "{kernel:?} at u = {u}: {error}");
                integral += disc(&c, u) * std::f64::consts::PI / f64::from(n);
            }
            assert!((integral - 1.0).abs() < 1e-5, "{kernel:?}: {integral}");
        }
    }

    #[test]
    fn laplacian_is_the_profiles_own() {
        for kernel in Kernel::ALL {
            let (c, l) = (flat(Profile::of(kernel).profile), flat(Profile::of(kernel).laplacian));
            let f = |u: f64| disc(&c, u);
            for i in 5..90 {
                let u = f64::from(i) / 100.0;
                let step = 1e-3;
                let first = (f(u + step) - f(u - step)) / (2.0 * step);
                let second = (f(u + step) - 2.0 * f(u) + f(u - step)) / (step * step);
                // (1/2) laplacian F for u = x^2 + y^2.
                let expected = 2.0 * first + 2.0 * u * second;
                let bound = if kernel == Kernel::WendlandC2 { 0.6 } else { 0.35 };
                assert!((disc(&l, u) - expected).abs() < bound, "{kernel:?} at u = {u}: {} {expected}", disc(&l, u));
            }
        }
    }

    #[test]
    fn tilted_small_profile_is_the_ellipses() {
        // The correction of third order is left out: rho^3 / 6 of a few times the peak.
        for (kernel, rho) in Kernel::ALL.into_iter().flat_map(|kernel| [(kernel, 0.1), (kernel, -0.3)]) {
            let profile = Profile::of(kernel);
            let odd = |rows: [[f32; 4]; 2], x: f64| flat(rows).iter().rev().fold(0.0, |sum, c| sum * x * x + c) * x;
            let even = |rows: [[f32; 4]; 2], x: f64| flat(rows).iter().rev().fold(0.0, |sum, c| sum * x * x + c);
            let (mut error, mut without, mut whole) = (0.0, 0.0, 0.0);
            for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
                let edge = |k: i32| f64::from(k) / 4.0 - 1.0;
                let change = |f: &dyn Fn(f64) -> f64, k: i32| f(edge(k + 1)) - f(edge(k));
                let pair = |f: &dyn Fn(f64) -> f64| change(f, i) * change(f, j);
                let of = |all: Odd, x: f64| all.iter().rev().fold(0.0, |sum, &c| sum * x * x + f64::from(c)) * x;
                let round = pair(&|x| of(profile.first, x)) - pair(&|x| of(profile.second, x));
                let found =
                    round + rho * pair(&|x| even(profile.shear, x)) + 0.5 * rho * rho * pair(&|x| odd(profile.bend, x));
                let n = 20;
                let mut expected = 0.0;
                for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                    let at = |k: i32, s: i32| edge(k) + (f64::from(s) + 0.5) / f64::from(n) / 4.0;
                    let (x, y) = (at(i, a), at(j, b));
                    let square = (x * x - 2.0 * rho * x * y + y * y) / (1.0 - rho * rho);
                    let value = kernel.projected(square.sqrt()) / (1.0 - rho * rho).sqrt();
                    expected += value / f64::from(n * n) / 16.0;
                }
                error += (found - expected).powi(2);
                without += (round - expected).powi(2);
                whole += expected * expected;
            }
            let (error, without) = ((error / whole).sqrt(), (without / whole).sqrt());
            assert!(error < 0.08 * rho.abs() && error < 0.15 * without, "{kernel:?}, {rho}: {error}, {without}");
        }
    }
}
