//! Splats in the layout that viewers of 3D Gaussian splats read (Kerbl et al. 2023): PLY, binary, little-endian, 17 floats each.
//!
//! | properties | what they are |
//! |---|---|
//! | `x y z` | the middle, relative to a point of the data that a comment names, since floats are too short for places far from 0 |
//! | `nx ny nz` | 0; viewers expect them |
//! | `f_dc_0 f_dc_1 f_dc_2` | colour, sRGB as it is displayed: `(colour - 0.5) / C0`, the constant term of spherical harmonics |
//! | `opacity` | `ln(a / (1 - a))` of the opacity `a` in the middle |
//! | `scale_0 scale_1 scale_2` | natural logarithms of the standard deviations along the principal axes, largest first |
//! | `rot_0 rot_1 rot_2 rot_3` | unit quaternion w, x, y, z that turns the axes of space into these |
//!
//! **Opacity.** Through a splat of weight `w` whose standard deviations have the geometric mean `s`, the column in the middle is
//! `w / (2 pi s^2)`, exactly for a round one and in the mean of directions for others: a splat of these files has one opacity from all
//! sides. With an optical depth of `k` for a column of 1 it is `1 - exp(-k w / (2 pi s^2))`, within [`OPACITIES`].

use super::Out;
use super::ply::{self, count_line};
use crate::model::{Covariance, Unit};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::TAU;
use std::io::{self, Write};

/// The constant spherical harmonic, `1 / (2 sqrt(pi))`.
pub const C0: f64 = 0.28209479177387814;

/// Opacities that are written: fainter splats are dropped by viewers, and opaque ones have no finite logit.
pub const OPACITIES: [f64; 2] = [0.004, 0.99];

/// Bytes of one splat.
pub const BYTES: usize = PROPERTIES.len() * size_of::<f32>();

/// The properties, all floats.
const PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// Variances below this share of the largest are written as this share: a disc without thickness has no logarithm.
const FLATTEST: f64 = 1e-12;

/// One splat.
#[derive(Clone, Copy, Debug)]
pub struct GaussianSplat {
    /// Its middle, relative to the file's origin.
    pub place: DVec3,
    /// Gamma-encoded sRGB.
    pub color: [f32; 3],
    /// Weight, whose columns have optical depths.
    pub weight: f64,
    /// Second moments.
    pub covariance: Covariance,
}

impl GaussianSplat {
    /// Its opacity where a column of 1 has this optical depth.
    pub fn opacity(&self, depth: f64) -> f64 {
        let column = self.weight / (TAU * self.covariance.mean_radius().powi(2));
        let opacity = 1.0 - (-depth * column).exp();
        // Of a splat so flat that its mean radius is 0, the column is infinite, and its opacity 1.
        if opacity.is_nan() { OPACITIES[0] } else { opacity.clamp(OPACITIES[0], OPACITIES[1]) }
    }

    /// Its 17 numbers; `None` for one without extent or with values that are not finite.
    pub fn row(&self, depth: f64) -> Option<[f32; PROPERTIES.len()]> {
        let (variances, axes) = self.covariance.principal();
        let largest = variances.x;
        if !(largest > 0.0 && largest.is_finite() && axes.is_finite() && self.place.is_finite()) {
            return None;
        }
        let scales = variances.max(DVec3::splat(FLATTEST * largest)).to_array().map(|variance| 0.5 * variance.ln());
        let turn = quaternion(axes);
        let opacity = self.opacity(depth);
        let mut row = [0.0; PROPERTIES.len()];
        let mut fill = |at: usize, values: &[f64]| {
            row[at..at + values.len()].iter_mut().zip(values).for_each(|(out, value)| *out = *value as f32);
        };
        fill(0, &self.place.to_array());
        fill(6, &self.color.map(|color| (f64::from(color) - 0.5) / C0));
        fill(9, &[(opacity / (1.0 - opacity)).ln()]);
        fill(10, &scales);
        fill(13, &[turn.w, turn.x, turn.y, turn.z]);
        Some(row)
    }
}

/// The rotation of unit axes, turned into a right-handed system; with a positive w.
fn quaternion(axes: DMat3) -> DQuat {
    let right = if axes.determinant() < 0.0 { DMat3::from_cols(axes.x_axis, axes.y_axis, -axes.z_axis) } else { axes };
    let turn = DQuat::from_mat3(&right).normalize();
    if turn.w < 0.0 { -turn } else { turn }
}

/// A file of splats that is being written.
pub struct GaussianSplats<'a> {
    out: Out<'a>,
    /// Where the number of splats is, which is known when all are written.
    count_at: u64,
    rows: u64,
}

impl<'a> GaussianSplats<'a> {
    /// Begins a file of splats around `origin`, with lengths in `unit`.
    ///
    /// # Errors
    /// When nothing can be written.
    pub fn new(mut out: Out<'a>, origin: DVec3, unit: &Unit) -> io::Result<GaussianSplats<'a>> {
        let mut header =
            String::from("ply\nformat binary_little_endian 1.0\ncomment 3D Gaussian splats by deepfield\n");
        let [x, y, z] = origin.to_array();
        header.push_str(&format!("comment origin: {x} {y} {z}, which x y z are relative to\n"));
        if !unit.is_unknown() {
            header.push_str(&format!("comment unit of length: {}\n", unit.0.replace(['\n', '\r'], " ")));
        }
        header.push_str("element vertex ");
        let count_at = header.len() as u64;
        header.push_str(&count_line(0));
        for name in PROPERTIES {
            header.push_str(&format!("property float {name}\n"));
        }
        header.push_str("end_header\n");
        out.write_all(header.as_bytes())?;
        Ok(GaussianSplats { out, count_at, rows: 0 })
    }

    /// Writes splats as rows.
    ///
    /// # Errors
    /// When nothing can be written.
    pub fn write(&mut self, rows: &[[f32; PROPERTIES.len()]]) -> io::Result<()> {
        self.rows += rows.len() as u64;
        let bytes: Vec<u8> = rows.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
        self.out.write_all(&bytes)
    }

    /// Writes what is left; how many splats the file has.
    ///
    /// # Errors
    /// When nothing can be written.
    pub fn finish(self) -> io::Result<u64> {
        ply::finish(self.out, self.count_at, self.rows)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_are_what_the_splat_is(
            turn in prop::array::uniform4(-1.0..1.0f64), powers in prop::array::uniform3(-3.0..3.0f64), depth in 0.0..1e3f64,
        ) {
            let turn = DQuat::from_array(turn);
            prop_assume!(turn.length() > 0.01);
            let axes = DMat3::from_quat(turn.normalize());
            let variances = DVec3::from_array(powers).map(|power| 10f64.powf(power));
            let covariance = Covariance::of(axes * DMat3::from_diagonal(variances) * axes.transpose());
            let splat = GaussianSplat { place: DVec3::ONE, color: [0.0, 0.5, 1.0], weight: 0.01, covariance };
            let row = splat.row(depth).unwrap().map(f64::from);
            let found = DQuat::from_xyzw(row[14], row[15], row[16], row[13]);
            prop_assert!((found.length() - 1.0).abs() < 1e-6);
            let (found, scales) = (DMat3::from_quat(found), DVec3::new(row[10], row[11], row[12]).exp());
            let rebuilt = found * DMat3::from_diagonal(scales * scales) * found.transpose();
            prop_assert!(rebuilt.abs_diff_eq(covariance.matrix(), 1e-5 * variances.max_element()), "{rebuilt}");
            let colors = [6, 7, 8].map(|k| 0.5 + C0 * row[k]);
            prop_assert!((0..3).all(|k| (colors[k] - 0.5 * k as f64).abs() < 1e-6));
            let opacity = 1.0 / (1.0 + (-row[9]).exp());
            prop_assert!((opacity - splat.opacity(depth)).abs() < 1e-6);
            prop_assert!((OPACITIES[0] - 1e-9..=OPACITIES[1] + 1e-9).contains(&splat.opacity(depth)));
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_no_row() {
        let splat = |covariance| GaussianSplat { place: DVec3::ZERO, color: [1.0; 3], weight: 1.0, covariance };
        assert!(splat(Covariance::default()).row(1.0).is_none());
        assert!(splat(Covariance::round(f32::NAN)).row(1.0).is_none());
        assert!(splat(Covariance::round(f32::INFINITY)).row(1.0).is_none());
        // Without thickness, it is a thin one, and opaque.
        let flat = splat(Covariance([4.0, 1.0, 0.0, 0.0, 0.0, 0.0])).row(1.0).unwrap();
        assert!(flat.iter().all(|value| value.is_finite()) && flat[12] < -10.0 && flat[9] > 4.0, "{flat:?}");
        let nan = GaussianSplat { weight: f64::NAN, ..splat(Covariance::round(1.0)) };
        assert!(nan.row(1.0).unwrap().iter().all(|value| value.is_finite()));
    }
}
