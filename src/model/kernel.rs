//! SPH smoothing kernels with compact support (F12 3.2.2), three-dimensional and integrated along a line of sight.
//!
//! Both kernels vanish at and beyond `r = h`, so `h` is the support radius.

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
}
