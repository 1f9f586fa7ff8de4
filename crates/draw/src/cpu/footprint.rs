//! The picture of one particle: which pixels it covers, and how far each pixel's line of sight passes from it.
//!
//! Along a row of pixels the squared impact parameter in units of `h` is
//! `q^2(x) = (curvature (x - middle)^2 + offset) / (1 + u^2 + v^2)`, with the ray `(u, v, 1)` in camera space. For an
//! orthographic view, and for splats of fixed size in pixels, the divisor is 1.
//!
//! In perspective, with the particle at `c` in camera space, `s^2 = |c x d|^2 / |d|^2` for the ray `d = (u, v, 1)`. That
//! is the exact distance for every pixel (F12 4.9.1 reaches the same through a face that looks at the eye), and the
//! covered region is the exact ellipse.

use super::{Extent, Splats};
use crate::model::Kernel;
use crate::view::{Projection, View};
use glam::DVec3;

/// The footprint of one particle. Lengths in pixels, `(0, 0)` the picture's top left corner.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// Smallest x and y of the covered region; infinite when it is unbounded.
    pub min: [f64; 2],
    /// Largest x and y of the covered region.
    pub max: [f64; 2],
    /// Shortest radius of the covered region: what a sampling grid must resolve.
    pub radius: f64,
    /// `P` is `amplitude * F(q)`: `w / h^2`.
    pub amplitude: f64,
    /// `P S` is `amplitude_s * F(q)`: `w a / h^2`.
    pub amplitude_s: f64,
    /// How the impact parameter depends on the pixel.
    pub shape: Shape,
}

impl Footprint {
    /// Lets a sphere grow to the smallest radius that a grid of samples resolves, with the same flux; the factor on its
    /// amplitudes.
    pub fn grow_to(&mut self, smallest: f64) -> f64 {
        let grow = smallest / self.radius;
        let (true, Shape::Sphere { camera, h }) = (grow > 1.0, self.shape) else { return 1.0 };
        let share = 1.0 / (grow * grow);
        self.shape = Shape::Sphere { camera, h: h * grow };
        self.amplitude *= share;
        self.amplitude_s *= share;
        for k in 0..2 {
            let (middle, half) = (0.5 * (self.min[k] + self.max[k]), 0.5 * (self.max[k] - self.min[k]));
            (self.min[k], self.max[k]) = (middle - half * grow, middle + half * grow);
        }
        share
    }
}

/// How the impact parameter depends on the pixel.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// A circle of [`Footprint::radius`] around this point.
    Circle {
        /// Centre, pixels.
        center: [f64; 2],
    },
    /// A sphere seen through a pinhole.
    Sphere {
        /// Centre in camera space, world units.
        camera: DVec3,
        /// Smoothing length, world units.
        h: f64,
    },
}

/// The impact parameter along one row of pixels.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Coefficient of `(x - middle)^2`, 1/pixel^2.
    pub curvature: f64,
    /// Where along the row the numerator is smallest, pixels.
    pub middle: f64,
    /// Smallest value of the numerator.
    pub offset: f64,
    /// `1 + v^2` of the row; infinite focal length: 1.
    pub depth: f64,
    /// What a pixel along the row adds to the ray's slope; 0 for circles, which look the same wherever they are.
    pub slope: f64,
    /// First and last x whose line of sight meets the particle in front of the eye, pixels.
    pub range: [f64; 2],
}

/// What all footprints of a view share.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    view: View,
    focal: f64,
    middle: [f64; 2],
}

impl Lens {
    /// The lens of a view.
    pub fn new(view: &View) -> Lens {
        Lens { view: *view, focal: view.focal_pixels(), middle: view.middle() }
    }

    /// Horizontal slope `u` of a ray at `x` is `(x - lens.ray()[0]) * lens.ray()[1]`; zero slope for parallel rays.
    pub fn ray(&self) -> [f64; 2] {
        match self.view.projection {
            Projection::Perspective { .. } => [self.middle[0], 1.0 / self.focal],
            Projection::Orthographic { .. } => [self.middle[0], 0.0],
        }
    }

    /// The footprint of one particle of a batch; `None` when it cannot be drawn: at or behind the eye plane, of no extent,
    /// or not finite.
    pub fn footprint(&self, splats: &Splats<'_>, index: usize) -> Option<Footprint> {
        let weight = f64::from(splats.weight()[index]);
        let weight_s = splats.attribute().map_or(0.0, |attribute| weight * f64::from(attribute[index]));
        let camera = self.view.to_camera(splats.positions().world(index));
        // NaN compares false, so that it is dropped too. In front of a parallel projection's eye plane only as well.
        if !(camera.z > 0.0 && camera.z.is_finite() && weight.is_finite() && weight_s.is_finite()) {
            return None;
        }
        let (radius, per_area, sphere) = match (splats.extent(), self.view.projection) {
            (Extent::Pixels(radius), _) => (f64::from(radius), 1.0, None),
            (Extent::World(h), Projection::Orthographic { .. }) => {
                (f64::from(h[index]) * self.focal, self.focal * self.focal, None)
            }
            (Extent::World(h), Projection::Perspective { .. }) => (0.0, 0.0, Some(f64::from(h[index]))),
        };
        match sphere {
            Some(h) => self.sphere(camera, h, weight, weight_s),
            None => {
                if !(radius > 0.0 && radius.is_finite()) {
                    return None;
                }
                let center = self.center(camera)?;
                let amplitude = per_area / (radius * radius);
                Some(Footprint {
                    min: center.map(|x| x - radius),
                    max: center.map(|x| x + radius),
                    radius,
                    amplitude: weight * amplitude,
                    amplitude_s: weight_s * amplitude,
                    shape: Shape::Circle { center },
                })
            }
        }
    }

    /// Pixels per world unit at depth 1, as [`View::focal_pixels`].
    pub fn focal(&self) -> f64 {
        self.focal
    }

    /// Where a point in camera space appears, pixels: as [`View::to_pixels`], whose focal length costs a tangent each time.
    pub fn center(&self, camera: DVec3) -> Option<[f64; 2]> {
        let scale = match self.view.projection {
            Projection::Perspective { .. } if camera.z > 0.0 => self.focal / camera.z,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => self.focal,
        };
        Some([self.middle[0] + camera.x * scale, self.middle[1] - camera.y * scale])
    }

    /// The tangent of the angle between the view's axis and a point of the picture (pixels), as a vector.
    pub fn slope(&self, point: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (point[k] - self.middle[k]) * self.ray()[1])
    }

    /// The most that a particle adds to `P` of any pixel (F12 4.7.3, `P_i`): its peak, or where it is smaller than a pixel,
    /// all of it in one.
    pub fn presence(&self, footprint: &Footprint, kernel: Kernel) -> f64 {
        let whole = match footprint.shape {
            Shape::Circle { .. } => footprint.radius * footprint.radius,
            Shape::Sphere { camera, h } => (h * self.focal / camera.z).powi(2),
        };
        footprint.amplitude * whole.min(kernel.projected(0.0))
    }

    /// Whether a footprint reaches into the picture grown by `margin` pixels on each side.
    pub fn sees(&self, footprint: &Footprint, margin: f64) -> bool {
        let size = [f64::from(self.view.width), f64::from(self.view.height)];
        (0..2).all(|k| footprint.max[k] > -margin && footprint.min[k] < size[k] + margin)
    }

    /// The footprint of a particle of weight 1 with its centre in camera space and its smoothing length in world units, in any
    /// projection; `None` when it cannot be drawn.
    pub fn at(&self, camera: DVec3, h: f64) -> Option<Footprint> {
        match self.view.projection {
            Projection::Perspective { .. } if camera.z > 0.0 => self.sphere(camera, h, 1.0, 0.0),
            Projection::Perspective { .. } => None,
            Projection::Orthographic { .. } => {
                let center = self.center(camera)?;
                let radius = h * self.focal;
                let (min, max) = (center.map(|x| x - radius), center.map(|x| x + radius));
                (radius > 0.0 && radius.is_finite()).then(|| Footprint {
                    min,
                    max,
                    radius,
                    amplitude: 1.0 / (h * h),
                    amplitude_s: 0.0,
                    shape: Shape::Circle { center },
                })
            }
        }
    }

    /// The footprint of a sphere in a perspective view, with its centre in camera space.
    pub fn sphere(&self, camera: DVec3, h: f64, weight: f64, weight_s: f64) -> Option<Footprint> {
        if !(h > 0.0 && h.is_finite() && camera.is_finite()) {
            return None;
        }
        let distance = camera.length();
        // The image turns fastest where it comes nearest to the axis: at angle theta - alpha off it.
        let (sin_alpha, cos_theta) = (h / distance, camera.z / distance);
        let cos_near = if sin_alpha < 1.0 {
            let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
            let cos_alpha = (1.0 - sin_alpha * sin_alpha).sqrt();
            if sin_theta > sin_alpha { cos_theta * cos_alpha + sin_theta * sin_alpha } else { 1.0 }
        } else {
            1.0
        };
        let radius = self.focal * sin_alpha.min(1.0) / cos_near;
        let (mut min, mut max) = ([f64::NEG_INFINITY; 2], [f64::INFINITY; 2]);
        let ahead = camera.z * camera.z - h * h;
        if ahead > 0.0 && camera.z > h {
            // The planes through the eye that touch the sphere.
            for (k, across) in [camera.x, -camera.y].into_iter().enumerate() {
                let spread = h * (across * across + ahead).sqrt();
                min[k] = self.middle[k] + self.focal * (across * camera.z - spread) / ahead;
                max[k] = self.middle[k] + self.focal * (across * camera.z + spread) / ahead;
            }
        }
        let amplitude = 1.0 / (h * h);
        Some(Footprint {
            min,
            max,
            radius,
            amplitude: weight * amplitude,
            amplitude_s: weight_s * amplitude,
            shape: Shape::Sphere { camera, h },
        })
    }

    /// The impact parameter of a footprint along the row at height `y` (pixels, downwards).
    pub fn row(&self, footprint: &Footprint, y: f64) -> Row {
        match footprint.shape {
            Shape::Circle { center } => {
                let curvature = 1.0 / (footprint.radius * footprint.radius);
                let offset = (y - center[1]) * (y - center[1]) * curvature;
                let range = [f64::NEG_INFINITY, f64::INFINITY];
                Row { curvature, middle: center[0], offset, depth: 1.0, slope: 0.0, range }
            }
            Shape::Sphere { camera: c, h } => {
                let v = (self.middle[1] - y) / self.focal;
                let numerator = c.z * c.z + c.y * c.y;
                let miss = c.y - c.z * v;
                let ahead = c.z + c.y * v;
                let scale = 1.0 / (h * h);
                let mut range = [f64::NEG_INFINITY, f64::INFINITY];
                if c.z <= h && c.length_squared() > h * h {
                    // Rays whose nearest point to the particle lies behind the eye do not see it: c . d > 0.
                    let limit = self.middle[0] - self.focal * ahead / c.x;
                    if c.x > 0.0 {
                        range[0] = limit;
                    } else if c.x < 0.0 {
                        range[1] = limit;
                    } else if ahead <= 0.0 {
                        range[1] = f64::NEG_INFINITY;
                    }
                }
                Row {
                    curvature: numerator * scale / (self.focal * self.focal),
                    middle: self.middle[0] + self.focal * c.x * ahead / numerator,
                    offset: miss * miss * (1.0 + c.x * c.x / numerator) * scale,
                    depth: 1.0 + v * v,
                    slope: self.ray()[1],
                    range,
                }
            }
        }
    }

    /// `q^2` at `x` of a row, pixels.
    pub fn square(&self, row: &Row, x: f64) -> f64 {
        if x < row.range[0] || x > row.range[1] {
            return f64::INFINITY;
        }
        let u = (x - self.middle[0]) * row.slope;
        let along = x - row.middle;
        (row.curvature * along * along + row.offset) / (row.depth + u * u)
    }
}
