//! Which pixels a splat covers, blurred so that nothing between the pixels' middles is lost.
//!
//! In a flat picture by a kernel of [`LOW_PASS`] of its pixels. A panorama's faces have pixels that are narrower towards their edges: there
//! by as many of the panorama's pixels, as an angle, which is a growth of the splat in space, the same on every face. What then surrounds
//! the eye belongs to no face's plane ([`about_eye`]).

use super::LOW_PASS;
use crate::cpu::about_eye::{self, AboutEye};
use crate::cpu::ellipse::Ellipse;
use crate::cpu::ellipsoid::Ellipsoid;
use crate::cpu::footprint::{Footprint, Lens, Shape};
use crate::cpu::front_to_back::Cover;
use crate::cpu::{Extent, Splats};
use crate::model::Kernel;
use crate::view::View;
use glam::DVec3;

/// Ellipsoids whose depth and angle make their flat picture differ by less from an ellipse are drawn as one.
const FAR: f64 = 0.02;

/// What splats of a picture look like.
pub(super) struct Appearance<'a> {
    /// The camera.
    pub view: &'a View,
    /// The kernel that smoothing lengths belong to.
    pub kernel: Kernel,
    /// See [`super::Over::around`].
    pub around: Option<f64>,
}

impl Appearance<'_> {
    /// Which pixels a splat of a batch covers, and what it adds to `P` where `F`, or what a ray meets of it, is 1. None when it cannot be
    /// drawn.
    pub fn of(&self, lens: &Lens, batch: &Splats<'_>, index: usize) -> Option<(Cover, f64)> {
        match self.around {
            Some(pixel) => self.of_face(lens, batch, index, pixel),
            None => {
                let footprint = lens.footprint(batch, index, self.kernel)?;
                let footprint = blurred(lens.seen_from_far(footprint, self.kernel, FAR), lens.focal())?;
                Some((Cover::Footprint(footprint), footprint.amplitude))
            }
        }
    }

    /// The same on a face of a panorama whose pixels are `pixel` radians wide.
    fn of_face(&self, lens: &Lens, batch: &Splats<'_>, index: usize, pixel: f64) -> Option<(Cover, f64)> {
        let view = self.view;
        let world = batch.positions().world(index);
        let weight = f64::from(batch.weight()[index]);
        let (camera, distance) = (view.to_camera(world), (world - view.eye).length());
        let blur = LOW_PASS * pixel * distance;
        if about_eye::is_about(batch, index, view.eye, blur) {
            let about = AboutEye::of(batch, index, view.eye, self.kernel, blur)?;
            return Some((Cover::All(about), weight * about.amplitude));
        }
        let footprint = match batch.extent() {
            Extent::Pixels(radius) => {
                // At unit distance it subtends its angle, and has its flux over a pixel's solid angle.
                let h = (f64::from(radius) * pixel).min(1.5).sin().hypot(LOW_PASS * pixel);
                let footprint = lens.at(camera / distance, h)?;
                Footprint { amplitude: weight * pixel * pixel * footprint.amplitude, ..footprint }
            }
            Extent::World(lengths) => {
                let h = f64::from(lengths[index]);
                if !(h > 0.0 && h.is_finite()) {
                    return None;
                }
                let footprint = lens.at(camera, h.hypot(blur))?;
                Footprint { amplitude: weight * footprint.amplitude, ..footprint }
            }
            Extent::Ellipsoids(covariances) => {
                if camera.z <= 0.0 {
                    return None;
                }
                let variance = self.kernel.variance();
                let ellipsoid = Ellipsoid::of(covariances[index], variance, camera, view)?.grown(blur);
                lens.ellipsoid(ellipsoid, variance, [weight, 0.0])?
            }
        };
        Some((Cover::Footprint(footprint), footprint.amplitude))
    }
}

/// A footprint blurred by a kernel of [`LOW_PASS`] pixels: variances add up, and the flux stays what it is.
fn blurred(footprint: Footprint, focal: f64) -> Option<Footprint> {
    let weights = |area: f64| [footprint.amplitude, footprint.amplitude_s].map(|amplitude| amplitude * area);
    match footprint.shape {
        Shape::Circle { center } => {
            let radius = footprint.radius.hypot(LOW_PASS);
            let share = (footprint.radius / radius).powi(2);
            let [amplitude, amplitude_s] = weights(share);
            let (min, max) = (center.map(|x| x - radius), center.map(|x| x + radius));
            Some(Footprint { min, max, radius, amplitude, amplitude_s, ..footprint })
        }
        Shape::Ellipse(ellipse) => {
            let [width, height] = ellipse.extent();
            let (low, lean) = (LOW_PASS * LOW_PASS, ellipse.shear * height * height);
            let down = (height * height + low).sqrt();
            let across = (width * width + low - (lean / down).powi(2)).max(0.0).sqrt();
            let wide = Ellipse::of(ellipse.center, DVec3::new(lean / down, across, 0.0), DVec3::new(down, 0.0, 0.0))?;
            Footprint::ellipse(wide, weights(ellipse.area()))
        }
        // What has no end in the picture is large enough.
        Shape::Sphere { .. } if !footprint.min.into_iter().chain(footprint.max).all(f64::is_finite) => Some(footprint),
        Shape::Sphere { .. } => {
            let mut grown = footprint;
            grown.grow_to(footprint.radius.hypot(LOW_PASS), focal);
            Some(grown)
        }
        Shape::Ellipsoid(ellipsoid) => Some(Footprint {
            min: footprint.min.map(|x| x - LOW_PASS),
            max: footprint.max.map(|x| x + LOW_PASS),
            radius: footprint.radius.hypot(LOW_PASS),
            shape: Shape::Ellipsoid(ellipsoid.grown(LOW_PASS * ellipsoid.camera.z / focal)),
            ..footprint
        }),
    }
}
