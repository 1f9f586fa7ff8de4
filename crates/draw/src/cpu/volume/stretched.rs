//! Ellipsoids as a grid's resampling wants them: the upper triangular factor of `M = L L^T`, in single precision.
//!
//! Where `d` is the way from the centre in camera space, the kernel's argument is `q^2 = |L^-1 d|^2`. With an upper triangular `L` that is,
//! from depth to row to column, `w = d_z / L_zz`, `v = (d_y - L_yz w) / L_yy`, `u = (d_x - L_xy v - L_xz w) / L_xx`: a slice of cells cuts an
//! ellipse out of the ellipsoid and a row of cells an interval out of the ellipse, all in closed form; a row's cells cost what they cost
//! of a ball, and sums of squares lose nothing however flat the ellipsoid is.

use super::super::ellipsoid::Ellipsoid;
use super::particles::Particle;
use glam::{DMat3, DVec3};

/// The shape of one ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretched {
    /// `L`: xx, xy, xz, yy, yz, zz, world units.
    pub factor: [f32; 6],
    /// Shortest semi-axis, world units.
    pub shortest: f32,
}

impl Stretched {
    /// The shape of an ellipsoid with this shortest semi-axis.
    pub fn of(ellipsoid: &Ellipsoid, shortest: f64) -> Stretched {
        // The rows of any factor, made triangular from below by rotations that leave `L L^T` as it is.
        let [x, y, z] = [0, 1, 2].map(|row| ellipsoid.axes.row(row));
        let zz = z.length();
        let deep = z / zz;
        let (xz, yz) = (x.dot(deep), y.dot(deep));
        let (x, y) = (x - xz * deep, y - yz * deep);
        let yy = y.length();
        let high = y / yy;
        let xy = x.dot(high);
        let xx = (x - xy * high).length();
        Stretched { factor: [xx, xy, xz, yy, yz, zz].map(|value| value as f32), shortest: shortest as f32 }
    }

    /// Half its extent in depth.
    pub fn half_depth(&self) -> f32 {
        self.factor[5]
    }

    /// What of it lies between two depths, relative to its centre: from where to where it reaches there along x and along y. `None` for
    /// nothing.
    pub fn between(&self, depths: [f32; 2]) -> Option<[[f32; 2]; 2]> {
        let [xx, xy, xz, yy, yz, zz] = self.factor;
        let [front, back] = depths.map(|depth| (depth / zz).clamp(-1.0, 1.0));
        if depths[0] >= zz || depths[1] <= -zz {
            return None;
        }
        // At `w` it reaches to `tilt w + width sqrt(1 - w^2)`, which is concave.
        let most = |tilt: f32, width: f32| {
            let w = (tilt / tilt.hypot(width)).clamp(front, back);
            tilt * w + width * (1.0 - w * w).max(0.0).sqrt()
        };
        let span = |tilt: f32, width: f32| [-most(-tilt, width), most(tilt, width)];
        Some([span(xz, xx.hypot(xy)), span(yz, yy)])
    }

    /// The ellipsoid around a centre in camera space.
    pub fn ellipsoid(&self, camera: DVec3) -> Ellipsoid {
        let [xx, xy, xz, yy, yz, zz] = self.factor.map(f64::from);
        let axes = DMat3::from_cols(DVec3::new(xx, 0.0, 0.0), DVec3::new(xy, yy, 0.0), DVec3::new(xz, yz, zz));
        Ellipsoid { camera, axes }
    }

    /// `L^-1 d`.
    pub fn to_ball(&self, d: DVec3) -> DVec3 {
        let [xx, xy, xz, yy, yz, zz] = self.factor.map(f64::from);
        let w = d.z / zz;
        let v = (d.y - yz * w) / yy;
        DVec3::new((d.x - xy * v - xz * w) / xx, v, w)
    }
}

/// A particle, and its shape if it is no ball.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Its place and what it weighs.
    pub particle: &'a Particle,
    /// The shape of an ellipsoid.
    pub shape: Option<&'a Stretched>,
}

impl Body<'_> {
    /// Depths between which it reaches.
    pub fn depths(&self) -> [f32; 2] {
        let [_, _, z, h] = self.particle.place;
        let half = self.shape.map_or(h, Stretched::half_depth);
        [z - half, z + half]
    }

    /// What a grid has to resolve: the smoothing length, or the shortest semi-axis.
    pub fn shortest(&self) -> f32 {
        self.shape.map_or(self.particle.place[3], |shape| shape.shortest)
    }
}

#[cfg(test)]
pub(in crate::cpu) mod tests;
