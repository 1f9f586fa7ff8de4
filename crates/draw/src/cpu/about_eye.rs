//! Particles about the eye: what a ray that begins at the eye meets of them, in every direction.
//!
//! Kernels that fill more than 30 degrees to each side of the eye, or hold it, belong to no plane of a picture: a ray counts what of them
//! lies before the eye ([`super::half_line`]), whichever side of a face's plane their centre is on. They are smooth, so rays [`STEP`]
//! apart, with bilinear interpolation between them, have them to 1e-3 of each one's peak.
//!
//! Ellipsoids are looked at in the space in which they are balls; such rays cannot resolve very flat ones, which are made thicker
//! ([`FLATTEST`]).

use super::half_line::HalfLine;
use super::{Extent, Splats};
use crate::model::Kernel;
use crate::view::View;
use glam::{DMat3, DVec3};

/// Particles nearer than so many smoothing lengths, or longest semi-axes, are about the eye.
pub const NEAR: f64 = 2.0;
/// The shortest semi-axis of an ellipsoid that is, over the longest.
const FLATTEST: f64 = 0.1;
/// Distance of the rays that are followed, radians.
const STEP: f64 = 0.008;

/// The space in which a particle's support is the unit ball.
#[derive(Clone, Copy)]
pub(super) struct Stretched {
    /// From world units.
    pub to_ball: DMat3,
    /// Volume of the support over that of the unit ball.
    pub volume: f64,
}

impl Stretched {
    /// That of a particle of a batch whose semi-axes are longer by `blur` (world units, in the sum of squares); of an ellipsoid with
    /// semi-axes of at least `flattest` of the longest. None without an extent in space.
    pub fn of(batch: &Splats<'_>, index: usize, kernel: Kernel, [flattest, blur]: [f64; 2]) -> Option<Stretched> {
        let (radii, axes) = match batch.extent() {
            Extent::Pixels(_) => return None,
            Extent::World(lengths) => (DVec3::splat(f64::from(lengths[index])), DMat3::IDENTITY),
            Extent::Ellipsoids(covariances) => {
                let (values, axes) = covariances[index].principal();
                ((values / kernel.variance()).max(DVec3::ZERO).map(f64::sqrt), axes)
            }
        };
        let radii = radii.map(|radius| radius.hypot(blur));
        let radii = radii.max(DVec3::splat(flattest * radii.max_element()));
        let to_ball = DMat3::from_diagonal(radii.recip()) * axes.transpose();
        let is_solid = radii.min_element() > 0.0 && to_ball.is_finite();
        is_solid.then_some(Stretched { to_ball, volume: radii.element_product() })
    }
}

/// A particle about the eye.
#[derive(Clone, Copy)]
pub(super) struct AboutEye {
    /// Its middle relative to the eye, where it is a ball.
    place: DVec3,
    to_ball: DMat3,
    /// What [`AboutEye::met`] is multiplied with for a weight of 1: the inverse of its volume.
    pub amplitude: f64,
}

impl AboutEye {
    /// A particle of a batch, blurred as in [`Stretched::of`].
    pub fn of(batch: &Splats<'_>, index: usize, eye: DVec3, kernel: Kernel, blur: f64) -> Option<AboutEye> {
        let Stretched { to_ball, volume } = Stretched::of(batch, index, kernel, [FLATTEST, blur])?;
        let place = to_ball * (batch.positions().world(index) - eye);
        let amplitude = volume.recip();
        (place.is_finite() && amplitude.is_finite()).then_some(AboutEye { place, to_ball, amplitude })
    }

    /// What a ray from the eye, a unit vector, meets of its kernel.
    pub fn met(&self, table: &HalfLine, ray: DVec3) -> f64 {
        self.met_until(table, ray, f64::INFINITY)
    }

    /// The same of a ray that ends at a distance from the eye.
    pub fn met_until(&self, table: &HalfLine, ray: DVec3, end: f64) -> f64 {
        let ray = self.to_ball * ray;
        let longer = ray.length();
        let along = self.place.dot(ray) / longer;
        let square = (self.place.length_squared() - along * along).max(0.0);
        // What lies before the eye, without what lies behind the end.
        let beyond = if end.is_finite() { table.at(square, along - end * longer) } else { 0.0 };
        (table.at(square, along) - beyond) / longer
    }
}

/// Whether a particle of a batch, blurred by `blur` (world units), is about the eye.
pub(super) fn is_about(batch: &Splats<'_>, index: usize, eye: DVec3, blur: f64) -> bool {
    // By the default kernel, which reaches farthest of all.
    let h = batch.farthest(index).map_or(0.0, f64::from);
    if !(h > 0.0 && h.is_finite()) {
        return false;
    }
    let h = h.hypot(blur);
    (batch.positions().world(index) - eye).length_squared() < (NEAR * h).powi(2)
}

/// Pixels between the rays that are followed in a view.
pub(super) fn step(view: &View) -> f64 {
    (STEP * view.focal_pixels()).floor().max(1.0)
}

/// The direction of the ray through a point of the picture, pixels.
pub(super) fn ray(view: &View, point: [f64; 2]) -> DVec3 {
    (view.at_depth(point, 1.0) - view.eye).normalize()
}
