//! Cameras and their projections, in double precision and relative to the eye.
//!
//! Camera space is right-handed with `x = forward x up` to the right, `y` up and `z` along the viewing direction
//! (depth grows away from the eye). Pixel `(0, 0)` is the top left corner of the top left pixel; pixel centres lie
//! at half-integers.

use super::{Cut, Images};
use crate::model::Bounds;
use glam::DVec3;
use thiserror::Error;

/// How camera space meets the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// A pinhole; `fov_y` is the vertical field of view in radians, within (0, pi).
    Perspective {
        /// Vertical field of view, radians.
        fov_y: f64,
    },
    /// Parallel lines of sight; `height` is the picture's height in world units.
    Orthographic {
        /// Picture height, world units.
        height: f64,
    },
}

/// A camera that cannot see anything, and why.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ViewError {
    /// A coordinate is NaN or infinite.
    #[error("camera {0} is not finite")]
    NotFinite(&'static str),
    /// Eye and target coincide.
    #[error("camera eye and target are the same point")]
    NoDirection,
    /// Up is zero or along the viewing direction.
    #[error("camera up is zero or parallel to the viewing direction, expected another direction (--up X,Y,Z)")]
    NoUp,
    /// The field of view or height is out of range.
    #[error("camera {name} is {value}, expected {expected}")]
    OutOfRange {
        /// Which setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A picture without pixels, or with more than any adapter can hold.
    #[error("picture size {0}x{1} is outside 1x1 to 32768x32768")]
    Size(u32, u32),
}

/// A camera and the size of its picture. The basis is orthonormal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position in world units.
    pub eye: DVec3,
    /// Unit vector to the right of the picture.
    pub right: DVec3,
    /// Unit vector to the top of the picture.
    pub up: DVec3,
    /// Unit vector along the line of sight through the picture's middle.
    pub forward: DVec3,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Where the middle line of sight meets the picture, from its middle, pixels to the right and down: not zero for a part of
    /// a larger picture, and for an eye beside the middle of a screen.
    pub shift: [f64; 2],
    /// What is left out and faded.
    pub cut: Cut,
    /// The images of a periodic box that are drawn.
    pub images: Images,
    /// When it is seen, in the data's unit of time; data without a time is there always.
    pub time: f64,
}

impl View {
    /// A camera at `eye` that looks to `target` with `up` pointing up in the picture.
    pub fn look_at(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        projection: Projection,
        width: u32,
        height: u32,
    ) -> Result<View, ViewError> {
        for (name, vector) in [("eye", eye), ("target", target), ("up", up)] {
            if !vector.is_finite() {
                return Err(ViewError::NotFinite(name));
            }
        }
        match projection {
            Projection::Perspective { fov_y } if !(fov_y > 0.0 && fov_y < std::f64::consts::PI) => {
                return Err(ViewError::OutOfRange {
                    name: "field of view",
                    value: fov_y.to_degrees(),
                    expected: "between 0 and 180 degrees",
                });
            }
            Projection::Orthographic { height } if !(height > 0.0 && height.is_finite()) => {
                return Err(ViewError::OutOfRange { name: "height", value: height, expected: "a positive length" });
            }
            _ => {}
        }
        if !(1..=32768).contains(&width) || !(1..=32768).contains(&height) {
            return Err(ViewError::Size(width, height));
        }
        let forward = (target - eye).try_normalize().ok_or(ViewError::NoDirection)?;
        let right = forward.cross(up.normalize_or_zero()).try_normalize().ok_or(ViewError::NoUp)?;
        let up = right.cross(forward);
        let shift = [0.0; 2];
        Ok(View {
            eye,
            right,
            up,
            forward,
            projection,
            width,
            height,
            shift,
            cut: Cut::NONE,
            images: Images::ONE,
            time: 0.0,
        })
    }

    /// The same camera that leaves out and fades what `cut` says.
    pub fn with_cut(&self, cut: Cut) -> View {
        View { cut, ..*self }
    }

    /// The view of an image of the data that is displaced by `offset`, in the data's own coordinates.
    pub fn of_image(&self, offset: DVec3) -> View {
        View { eye: self.eye - offset, cut: self.cut.moved(-offset), images: Images::ONE, ..*self }
    }

    /// The same camera with a picture that is `pixels` larger on every side.
    pub fn padded(&self, pixels: u32) -> View {
        let [width, height] = [self.width, self.height].map(|size| size.saturating_add(2 * pixels));
        View { projection: self.projection_of(height), width, height, ..*self }
    }

    /// The same camera with as many pixels; its height shows what it showed.
    pub fn resized(&self, width: u32, height: u32) -> View {
        let growth = f64::from(height) / f64::from(self.height);
        View { width, height, shift: self.shift.map(|pixels| pixels * growth), ..*self }
    }

    /// The part of the picture that is so large and has its top left corner at these pixels, which may lie outside.
    pub fn part(&self, corner: [f64; 2], width: u32, height: u32) -> View {
        let middle = self.middle();
        let shift = [middle[0] - corner[0] - 0.5 * f64::from(width), middle[1] - corner[1] - 0.5 * f64::from(height)];
        View { projection: self.projection_of(height), width, height, shift, ..*self }
    }

    /// The projection of a picture with pixels of the same size that is `height` pixels high.
    fn projection_of(&self, height: u32) -> Projection {
        let growth = f64::from(height) / f64::from(self.height);
        match self.projection {
            Projection::Perspective { fov_y } => {
                Projection::Perspective { fov_y: 2.0 * (growth * (0.5 * fov_y).tan()).atan() }
            }
            Projection::Orthographic { height } => Projection::Orthographic { height: height * growth },
        }
    }

    /// Where the middle line of sight meets the picture, pixels.
    pub fn middle(&self) -> [f64; 2] {
        [0.5 * f64::from(self.width) + self.shift[0], 0.5 * f64::from(self.height) + self.shift[1]]
    }

    /// The camera coordinates of the picture's edges, left and right, bottom and top: at depth 1 in a perspective view, at every
    /// depth in an orthographic one.
    pub fn edges(&self) -> [[f64; 2]; 2] {
        let ([x, y], focal) = (self.middle(), self.focal_pixels());
        let [width, height] = [self.width, self.height].map(f64::from);
        [[-x / focal, (width - x) / focal], [(y - height) / focal, y / focal]]
    }

    /// How far the picture reaches from the middle line of sight to its further edge along each axis, as [`View::edges`].
    pub(super) fn reach(&self) -> [f64; 2] {
        self.edges().map(|[low, high]| high.max(-low))
    }

    /// A view of the whole box from a little above its front, as near as the picture's edges allow.
    pub fn around(bounds: Bounds, fov_y: f64, width: u32, height: u32) -> Result<View, ViewError> {
        const DIRECTION: DVec3 = DVec3::new(0.35, 0.3, 1.0);
        const MARGIN: f64 = 1.05;
        let center = bounds.center();
        let projection = Projection::Perspective { fov_y };
        if !center.is_finite() {
            return Err(ViewError::NotFinite("eye"));
        }
        // Far from the origin, as in centimetres from a galaxy's middle, a step of 1 is lost in rounding.
        let mut view = View::look_at(DIRECTION, DVec3::ZERO, DVec3::Y, projection, width, height)?;
        let tangent_y = (0.5 * fov_y).tan();
        let tangent_x = tangent_y * f64::from(width) / f64::from(height);
        let half = (0.5 * bounds.size()).max(DVec3::splat(center.abs().max_element().max(1e-30) * 1e-9));
        // A corner at `x, y, z` from the middle is in the picture from distance `max(|x| / tan_x, |y| / tan_y) - z` on.
        let distance = (0..8)
            .map(|corner| {
                let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                let offset = half * DVec3::new(sign(0), sign(1), sign(2));
                let across = (offset.dot(view.right) / tangent_x).abs().max((offset.dot(view.up) / tangent_y).abs());
                MARGIN * across - offset.dot(view.forward)
            })
            .fold(0.0, f64::max);
        view.eye = center - distance * view.forward;
        Ok(view)
    }

    /// Camera-space coordinates of a world position: right, up, depth.
    pub fn to_camera(&self, world: DVec3) -> DVec3 {
        let relative = world - self.eye;
        DVec3::new(relative.dot(self.right), relative.dot(self.up), relative.dot(self.forward))
    }

    /// The factor on the weight of a particle at a world position, from 0 to 1: see [`Cut::fade`].
    pub fn fade(&self, world: DVec3) -> f64 {
        self.cut.fade(if self.cut.around { world.distance(self.eye) } else { self.to_camera(world).z })
    }

    /// The world position at a depth that appears at pixel coordinates: the inverse of [`View::to_camera`] and
    /// [`View::to_pixels`].
    pub fn at_depth(&self, [x, y]: [f64; 2], depth: f64) -> DVec3 {
        let scale = match self.projection {
            Projection::Perspective { .. } => depth / self.focal_pixels(),
            Projection::Orthographic { .. } => 1.0 / self.focal_pixels(),
        };
        let middle = self.middle();
        let (right, up) = ((x - middle[0]) * scale, (middle[1] - y) * scale);
        self.eye + right * self.right + up * self.up + depth * self.forward
    }

    /// Pixels per world unit: for a perspective view at depth 1 (divide by the depth), for an orthographic one
    /// everywhere. Pixels are square.
    pub fn focal_pixels(&self) -> f64 {
        match self.projection {
            Projection::Perspective { fov_y } => f64::from(self.height) / (2.0 * (0.5 * fov_y).tan()),
            Projection::Orthographic { height } => f64::from(self.height) / height,
        }
    }

    /// Pixel coordinates (x to the right, y down) of a point in camera space; `None` at or behind the eye of a
    /// perspective view.
    pub fn to_pixels(&self, camera: DVec3) -> Option<[f64; 2]> {
        let scale = match self.projection {
            Projection::Perspective { .. } if camera.z > 0.0 => self.focal_pixels() / camera.z,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => self.focal_pixels(),
        };
        let middle = self.middle();
        Some([middle[0] + camera.x * scale, middle[1] - camera.y * scale])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_padded_picture_holds_the_picture() {
        for projection in [Projection::Perspective { fov_y: 0.9 }, Projection::Orthographic { height: 7.0 }] {
            let view = View::look_at(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, projection, 40, 30).unwrap();
            let padded = view.padded(5);
            assert_eq!((padded.width, padded.height), (50, 40));
            for point in [DVec3::ZERO, DVec3::new(1.0, -2.0, 0.5)] {
                let [at, moved] = [view, padded].map(|view| view.to_pixels(view.to_camera(point)).unwrap());
                assert!((0..2).all(|k| (moved[k] - at[k] - 5.0).abs() < 1e-9), "{projection:?}: {at:?} {moved:?}");
            }
        }
    }

    #[test]
    fn a_part_shows_what_the_whole_does() {
        for projection in [Projection::Perspective { fov_y: 0.9 }, Projection::Orthographic { height: 7.0 }] {
            let view = View::look_at(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, projection, 40, 30).unwrap();
            let part = view.part([-3.0, 11.5], 17, 50);
            let larger = part.resized(34, 100);
            let [x, y] = part.edges();
            for point in [DVec3::ZERO, DVec3::new(1.0, -2.0, 0.5)] {
                let camera = view.to_camera(point);
                let [at, moved, twice] = [view, part, larger].map(|view| view.to_pixels(camera).unwrap());
                assert!((at[0] + 3.0 - moved[0]).abs() < 1e-9 && (at[1] - 11.5 - moved[1]).abs() < 1e-9);
                assert!((0..2).all(|k| (twice[k] - 2.0 * moved[k]).abs() < 1e-9));
                let depth = if matches!(projection, Projection::Perspective { .. }) { camera.z } else { 1.0 };
                let across = (camera.x / depth - x[0]) / (x[1] - x[0]);
                let down = (y[1] - camera.y / depth) / (y[1] - y[0]);
                assert!((across * 17.0 - moved[0]).abs() < 1e-9 && (down * 50.0 - moved[1]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn places_at_a_depth_appear_where_they_were_asked_for() {
        for projection in [Projection::Perspective { fov_y: 0.9 }, Projection::Orthographic { height: 7.0 }] {
            let view = View::look_at(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, projection, 40, 30).unwrap();
            for (pixel, depth) in [([3.0, 4.5], 2.0), ([39.0, 29.5], 70.0), ([20.0, 15.0], 1e-6)] {
                let camera = view.to_camera(view.at_depth(pixel, depth));
                let found = view.to_pixels(camera).unwrap();
                assert!((camera.z / depth - 1.0).abs() < 1e-8, "{camera}");
                assert!((0..2).all(|k| (found[k] - pixel[k]).abs() < 1e-6), "{projection:?}: {found:?} {pixel:?}");
            }
        }
    }

    #[test]
    fn a_view_around_a_box_holds_it_and_wastes_little() {
        for (width, height) in [(1200, 800), (300, 900)] {
            let bounds = Bounds { min: DVec3::new(-1.0, 10.0, -5.0), max: DVec3::new(4.0, 11.0, 20.0) };
            let view = View::around(bounds, 0.8, width, height).unwrap();
            let mut fill = 0.0f64;
            for corner in 0..8 {
                let pick = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
                let camera = view.to_camera(DVec3::new(pick(0), pick(1), pick(2)));
                let [x, y] = view.to_pixels(camera).unwrap();
                let across = (2.0 * x / f64::from(width) - 1.0).abs().max((2.0 * y / f64::from(height) - 1.0).abs());
                assert!(across <= 1.0);
                fill = fill.max(across);
            }
            assert!(fill > 0.9, "{fill}");
        }
        let point = Bounds { min: DVec3::splat(3.0), max: DVec3::splat(3.0) };
        assert!(View::around(point, 0.8, 64, 64).unwrap().eye.is_finite());
        // In centimetres, with the origin far from the middle.
        let galaxy = Bounds { min: DVec3::splat(-1e21), max: DVec3::splat(5e23) };
        let view = View::around(galaxy, 0.8, 64, 64).unwrap();
        let [x, y] = view.to_pixels(view.to_camera(galaxy.center())).unwrap();
        assert!((x - 32.0).abs() < 1e-6 && (y - 32.0).abs() < 1e-6, "{x} {y}");
    }
}
