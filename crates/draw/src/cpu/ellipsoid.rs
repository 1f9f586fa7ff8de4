//! Ellipsoidal splats: kernels stretched linearly so that their covariance is a given matrix `C`.
//!
//! With the kernel's own variance `v` per axis, the support is `x^T M^-1 x <= 1` for `M = C / v`, and the density of a splat of
//! weight `w` is `w W(q) / sqrt(det M)`. `M = L L^T` is held by its factor `L`, so that all below are sums of squares and cross
//! products, which lose nothing however flat or thin the ellipsoid is.
//!
//! Along the ray `d = (u, v, 1)` from the eye, with the centre at `c`: stretched to a unit sphere, space has the impact
//! parameter `q^2 = (c x d)^T M (c x d) / d^T adj(M) d` and the ray's density is `w |d| / sqrt(d^T adj(M) d) F(q)`. Numerator and
//! denominator are quadratic along a row of pixels. The numerator vanishes for the ray through the centre: with
//! `e = d - c / c_z` it is `(c x e)^T M (c x e)`.

use super::ellipse::Ellipse;
use super::footprint::Row;
use crate::model::Covariance;
use crate::view::View;
use glam::{DMat3, DVec3};

/// Eigenvalues below this fraction of the largest are drawn as this fraction.
const FLATTEST: f64 = 1e-12;
/// Eigenvalues below this fraction of the largest, negative, are no rounding: entries are singles.
const INDEFINITE: f64 = -1e-6;

/// An ellipsoid in camera space.
#[derive(Clone, Copy, Debug)]
pub struct Ellipsoid {
    /// Centre, world units.
    pub camera: DVec3,
    /// `L`: maps the unit ball to the support, world units.
    pub axes: DMat3,
}

/// What an ellipsoid seen in perspective looks like from far away: moments to second order in its size over its distance.
#[derive(Clone, Copy, Debug)]
pub struct FarImage {
    /// An ellipse with the image's centre of light, and its second moments but for terms of fourth order.
    pub ellipse: Ellipse,
    /// Its flux over pixels, per weight.
    pub flux: f64,
    /// By how much depth and angle make the image differ from the ellipse: the first neglected term, relative.
    pub depth: f64,
}

impl Ellipsoid {
    /// The ellipsoid of a covariance around a centre in camera space. None when the matrix is not finite, zero, or has a negative
    /// eigenvalue beyond rounding.
    pub fn of(covariance: Covariance, variance: f64, camera: DVec3, view: &View) -> Option<Ellipsoid> {
        let to_camera = DMat3::from_cols(view.right, view.up, view.forward).transpose();
        let axes = to_camera * factor(covariance)? * variance.sqrt().recip();
        (axes.is_finite() && camera.is_finite()).then_some(Ellipsoid { camera, axes })
    }

    /// `M`.
    fn matrix(&self) -> DMat3 {
        self.axes * self.axes.transpose()
    }

    /// The same grown by `radius` (world units) in every direction, in the sum of squares.
    pub fn grown(&self, radius: f64) -> Ellipsoid {
        let matrix = self.matrix() + DMat3::from_diagonal(DVec3::splat(radius * radius));
        Ellipsoid { axes: cholesky(matrix).unwrap_or(self.axes), ..*self }
    }

    /// The same with every length multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Ellipsoid {
        Ellipsoid { axes: factor * self.axes, ..*self }
    }

    /// The same with principal semi-axes of at least `least`, and its shortest semi-axis then.
    ///
    /// A maximum along each principal axis, not a sum of squares: a ball becomes the ball that the same rule makes of it, and what is long
    /// enough keeps its length.
    pub fn at_least(&self, least: f64) -> (Ellipsoid, f64) {
        let matrix = self.matrix();
        let covariance = Covariance::of(matrix);
        if covariance.trace() <= least * least {
            return (Ellipsoid { axes: DMat3::from_diagonal(DVec3::splat(least)), ..*self }, least);
        }
        let (values, axes) = covariance.principal();
        let radii = values.max(DVec3::ZERO).map(f64::sqrt);
        match radii.z < least {
            true => {
                let axes = axes * DMat3::from_diagonal(radii.max(DVec3::splat(least)));
                (Ellipsoid { axes, ..*self }, least)
            }
            false => (*self, radii.z),
        }
    }

    /// Volume over that of the unit ball: the product of the semi-axes.
    pub fn volume(&self) -> f64 {
        self.axes.determinant().abs()
    }

    /// How far it reaches from its centre along a direction of camera space, in units of the direction's length times world units.
    pub fn reach(&self, direction: DVec3) -> f64 {
        (self.axes.transpose() * direction).length()
    }

    /// Factors of `adj(M)`: the columns of `L`'s cofactors.
    fn cofactors(&self) -> DMat3 {
        let [a, b, c] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b))
    }

    /// Half its extent in depth, world units.
    pub fn half_depth(&self) -> f64 {
        self.axes.row(2).length()
    }

    /// Shortest semi-axis over the longest.
    fn flatness(&self) -> f64 {
        let radii = Covariance::of(self.matrix()).radii();
        radii.z / radii.x
    }

    /// Its picture along parallel lines of sight, `focal` pixels a world unit, around `center`.
    pub fn parallel_image(&self, center: [f64; 2], focal: f64) -> Option<Ellipse> {
        Ellipse::of(center, focal * self.axes.row(0), -focal * self.axes.row(1))
    }

    /// Its outline in perspective, exactly: what the lines of sight touch. `middle` is where slopes are 0, pixels, `focal` pixels a unit of
    /// slope. None where it reaches behind the eye's plane, so that the outline is no ellipse.
    pub fn outline(&self, middle: [f64; 2], focal: f64) -> Option<Ellipse> {
        let (c, deep) = (self.camera, self.axes.row(2));
        let ahead = c.z * c.z - deep.length_squared();
        if c.z <= 0.0 || ahead <= 0.0 {
            return None;
        }
        // Its dual conic is `c c^T - M`. With the factors of `M` its moments are differences of squares that do not cancel for what is small.
        let rows = [0, 1].map(|k| c.z * self.axes.row(k) - c[k] * deep);
        let crosses = [0, 1].map(|k| self.axes.row(k).cross(deep));
        let moment = |k: usize, l: usize| (rows[k].dot(rows[l]) - crosses[k].dot(crosses[l])) * (focal / ahead).powi(2);
        let place = |k: usize| focal * (c[k] * c.z - self.axes.row(k).dot(deep)) / ahead;
        let height = moment(1, 1).sqrt();
        let lean = moment(0, 1) / height;
        let across = (moment(0, 0) - lean * lean).max(0.0).sqrt();
        let center = [middle[0] + place(0), middle[1] - place(1)];
        Ellipse::of(center, DVec3::new(-lean, across, 0.0), DVec3::new(height, 0.0, 0.0))
    }

    /// Its picture in perspective to second order; `center` is where its centre appears.
    pub fn far_image(&self, center: [f64; 2], focal: f64, variance: f64) -> Option<FarImage> {
        let c = self.camera;
        let scale = focal / c.z;
        // The rows of the projection's first derivative, times `L`.
        let rows = [0, 1].map(|k| self.axes.row(k) - c[k] / c.z * self.axes.row(2));
        // A mass element at `x` adds `|x| / z^3` to the flux at its place in the picture. Expected values over the density, with
        // the first and second derivatives of that at the centre.
        let square = c.length_squared();
        let along = self.axes.transpose() * c / square;
        let depth = self.axes.row(2) / c.z;
        let gradient = along - 4.0 * depth;
        let moved = rows.map(|row| variance * scale * row.dot(gradient));
        let spread: f64 = (0..3).map(|k| self.axes.col(k).length_squared()).sum::<f64>() / square;
        let second =
            0.5 * spread - 0.5 * along.length_squared() - 3.0 * along.dot(depth) + 6.0 * depth.length_squared();
        let flux = scale * scale * square.sqrt() / c.z * (1.0 + variance * second);
        let center = [center[0] + moved[0], center[1] - moved[1]];
        let ellipse = Ellipse::of(center, scale * rows[0], -scale * rows[1])?;
        Some(FarImage { ellipse, flux, depth: gradient.length() / 3.0 })
    }

    /// Shortest radius of the covered region in perspective, pixels: what a sampling grid must resolve.
    pub fn short_radius(&self, image: &FarImage, focal: f64) -> f64 {
        let [short, _] = image.ellipse.radii();
        let reach = self.half_depth() / self.camera.z;
        if reach < 0.1 {
            return short;
        }
        // What is farther away looks smaller; from nearby or inside, what is flat is seen as thin as it is flat.
        (short / (1.0 + reach)).min(focal * self.flatness())
    }

    /// The slopes between which it appears along one axis of the camera, 0 or 1; infinite when it reaches behind the eye plane.
    pub fn slopes(&self, axis: usize) -> [f64; 2] {
        let (across, deep) = (self.axes.row(axis), self.axes.row(2));
        let (c, z) = (self.camera[axis], self.camera.z);
        let ahead = z * z - deep.length_squared();
        if z <= 0.0 || ahead <= 0.0 {
            return [f64::NEG_INFINITY, f64::INFINITY];
        }
        // The planes through the eye that touch it: `(c - s z)^2 = |across - s deep|^2` for the slope `s`.
        let spread = ((z * across - c * deep).length_squared() - across.cross(deep).length_squared()).max(0.0).sqrt();
        let middle = c * z - across.dot(deep);
        [(middle - spread) / ahead, (middle + spread) / ahead]
    }

    /// The impact parameter along the row of rays with the slope `v`; `middle` is the x of slope 0, pixels, `focal` pixels a unit
    /// of slope.
    pub fn row(&self, v: f64, middle: f64, focal: f64) -> Row {
        let c = self.camera;
        let cofactors = self.cofactors();
        let to_ball = self.axes.transpose();
        // The numerator's form in the two slopes, relative to the centre's.
        let (right, up) = (to_ball * DVec3::new(0.0, c.z, -c.y), to_ball * DVec3::new(-c.z, 0.0, c.x));
        let across = right.length_squared();
        let miss = v - c.y / c.z;
        let along = c.x / c.z - right.dot(up) / across * miss;
        let offset = right.cross(up).length_squared() / across * miss * miss;
        // The denominator, whose smallest value is a cross product in closed form.
        let (start, step) = (v * cofactors.row(1) + cofactors.row(2), cofactors.row(0));
        let steepness = step.length_squared();
        let volume = self.axes.determinant();
        let least = (volume * (to_ball * DVec3::new(0.0, 1.0, -v))).length_squared() / steepness;
        let mut range = [f64::NEG_INFINITY, f64::INFINITY];
        let eye = cofactors.transpose() * c;
        if c.z <= self.half_depth() && eye.length() > volume.abs() {
            // Rays whose nearest point to the centre, in stretched space, lies behind the eye do not see it.
            let (ahead, rate) = (eye.dot(start), eye.dot(step));
            let limit = middle - focal * ahead / rate;
            if rate > 0.0 {
                range[0] = limit;
            } else if rate < 0.0 {
                range[1] = limit;
            } else if ahead <= 0.0 {
                range[1] = f64::NEG_INFINITY;
            }
        }
        Row {
            curvature: across / (focal * focal),
            middle: middle + focal * along,
            offset,
            depth: least,
            slope: steepness.sqrt() / focal,
            axis: middle - focal * start.dot(step) / steepness,
            ray: Some(1.0 + v * v),
            range,
        }
    }

    /// `P` of weight 1 along the ray through its centre, in units of `F(0)`.
    pub fn peak(&self) -> f64 {
        self.camera.length() / (self.cofactors().transpose() * self.camera).length()
    }
}

/// `L` with `L L^T` the covariance, in world space.
fn factor(covariance: Covariance) -> Option<DMat3> {
    let trace = covariance.trace();
    if !(trace > 0.0 && covariance.0.iter().all(|value| value.is_finite())) {
        return None;
    }
    // The coefficients of the characteristic polynomial are all positive when all eigenvalues are; their ratios bound the
    // smallest of them from below, with rounding left aside where singles cannot be flatter.
    let matrix = covariance.matrix() * trace.recip();
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let minors = x.x * y.y - x.y * x.y + x.x * z.z - x.z * x.z + y.y * z.z - y.z * y.z;
    let determinant = matrix.determinant();
    if minors > 0.0 && determinant > (1e-9 * minors).max(1e-13) {
        return Some(cholesky(matrix)? * trace.sqrt());
    }
    let (values, axes) = covariance.principal();
    if values.z < INDEFINITE * values.x {
        return None;
    }
    let radii = values.max(DVec3::splat(FLATTEST * values.x)).map(f64::sqrt);
    Some(axes * DMat3::from_diagonal(radii))
}

/// The lower triangular factor of a positive definite matrix.
fn cholesky(matrix: DMat3) -> Option<DMat3> {
    let [a, b, c] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let xx = a.x.sqrt();
    let (xy, xz) = (a.y / xx, a.z / xx);
    let yy = (b.y - xy * xy).sqrt();
    let yz = (b.z - xy * xz) / yy;
    let zz = (c.z - xz * xz - yz * yz).sqrt();
    let factor = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(0.0, yy, yz), DVec3::new(0.0, 0.0, zz));
    // NaN where a root was of a negative number, infinite where it was zero.
    (factor.is_finite() && zz > 0.0).then_some(factor)
}

#[cfg(test)]
mod tests;
