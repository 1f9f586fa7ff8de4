//! The picture of one particle: which pixels it covers, and how far each pixel's line of sight passes from it.
//!
//! Along a row of pixels the squared impact parameter in units of `h` is
//! `q^2(x) = (curvature (x - middle)^2 + offset) / (1 + u^2 + v^2)`, with the ray `(u, v, 1)` in camera space. For an
//! orthographic view, and for splats of fixed size in pixels, the divisor is 1.
//!
//! In perspective, with the particle at `c` in camera space, `s^2 = |c x d|^2 / |d|^2` for the ray `d = (u, v, 1)`. That
//! is the exact distance for every pixel (F12 4.9.1 reaches the same through a face that looks at the eye), and the
//! covered region is the exact ellipse. Ellipsoids have other quadratics above and below: see [`super::ellipsoid`].

use super::ellipse::Ellipse;
use super::ellipsoid::{Ellipsoid, FarImage};
use super::table::LineTable;
use super::{Extent, Splats};
use crate::model::{Covariance, Kernel};
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
    /// `P` is `amplitude * F(q)`: `w / h^2`. For an ellipsoid, whose rays have factors of their own ([`Lens::line`]), `w`.
    pub amplitude: f64,
    /// `P S` is `amplitude_s * F(q)`: the same times the attribute.
    pub amplitude_s: f64,
    /// How the impact parameter depends on the pixel.
    pub shape: Shape,
}

impl Footprint {
    /// An ellipse in the picture with the flux of `weights`, pixels times the unit of `P`.
    pub fn ellipse(ellipse: Ellipse, weights: [f64; 2]) -> Option<Footprint> {
        let [amplitude, amplitude_s] = weights.map(|weight| weight / ellipse.area());
        let (center, half) = (ellipse.center, ellipse.extent());
        Some(Footprint {
            min: [0, 1].map(|k| center[k] - half[k]),
            max: [0, 1].map(|k| center[k] + half[k]),
            radius: ellipse.radii()[0],
            amplitude,
            amplitude_s,
            shape: Shape::Ellipse(ellipse),
        })
    }

    /// Lets a sphere grow to the smallest radius that a grid of samples resolves, with the same flux; the factor on its
    /// amplitudes. Ellipsoids grow by as much in every direction.
    pub fn grow_to(&mut self, smallest: f64, focal: f64) -> f64 {
        let grow = smallest / self.radius;
        if grow.is_nan() || grow <= 1.0 {
            return 1.0;
        }
        let share = match self.shape {
            Shape::Circle { .. } | Shape::Ellipse(_) => return 1.0,
            Shape::Sphere { camera, h } => {
                self.shape = Shape::Sphere { camera, h: h * grow };
                for k in 0..2 {
                    let (middle, half) = (0.5 * (self.min[k] + self.max[k]), 0.5 * (self.max[k] - self.min[k]));
                    (self.min[k], self.max[k]) = (middle - half * grow, middle + half * grow);
                }
                1.0 / (grow * grow)
            }
            Shape::Ellipsoid(ellipsoid) => {
                self.shape = Shape::Ellipsoid(ellipsoid.grown(smallest * ellipsoid.camera.z / focal));
                (self.min, self.max) = (self.min.map(|x| x - smallest), self.max.map(|x| x + smallest));
                1.0
            }
        };
        self.radius = smallest;
        self.amplitude *= share;
        self.amplitude_s *= share;
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
    /// An ellipsoid along parallel lines of sight, or from far away.
    Ellipse(Ellipse),
    /// An ellipsoid seen through a pinhole.
    Ellipsoid(Ellipsoid),
}

/// The impact parameter along one row of pixels: a quadratic over a quadratic.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Coefficient of `(x - middle)^2`, 1/pixel^2.
    pub curvature: f64,
    /// Where along the row the numerator is smallest, pixels.
    pub middle: f64,
    /// Smallest value of the numerator.
    pub offset: f64,
    /// Smallest value of the denominator. For spheres `1 + v^2` of the row; for what looks the same wherever it is, 1.
    pub depth: f64,
    /// Root of the denominator's coefficient of `(x - axis)^2`. For spheres what a pixel along the row adds to the ray's slope;
    /// for what looks the same wherever it is, 0.
    pub slope: f64,
    /// Where along the row the denominator is smallest, pixels.
    pub axis: f64,
    /// `1 + v^2` of the row where the amplitude is the ray's length over the denominator's root.
    pub ray: Option<f64>,
    /// First and last x whose line of sight meets the particle in front of the eye, pixels.
    pub range: [f64; 2],
}

impl Row {
    /// First and last x of the row's part that is covered, pixels; first above last where there is none.
    pub fn section(&self) -> [f64; 2] {
        // Numerator below denominator, around the numerator's middle.
        let (steepness, apart) = (self.slope * self.slope, self.middle - self.axis);
        let curvature = self.curvature - steepness;
        let left = self.offset - self.depth - steepness * apart * apart;
        if curvature <= 0.0 {
            return self.range;
        }
        let middle = steepness * apart;
        let square = middle * middle - curvature * left;
        if square < 0.0 {
            return [f64::INFINITY, f64::NEG_INFINITY];
        }
        let end = |side: f64| self.middle + (middle + side * square.sqrt()) / curvature;
        [end(-1.0).max(self.range[0]), end(1.0).min(self.range[1])]
    }
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
    /// or not finite. Covariances become ellipsoids of `kernel`.
    pub fn footprint(&self, splats: &Splats<'_>, index: usize, kernel: Kernel) -> Option<Footprint> {
        let (camera, weights) = self.before_eye(splats, index)?;
        match splats.extent() {
            Extent::Pixels(radius) => self.circle(camera, f64::from(radius), 1.0, weights),
            Extent::World(h) => self.ball(camera, f64::from(h[index]), weights),
            Extent::Ellipsoids(covariances) => self.stretched(camera, covariances[index], kernel, weights),
        }
    }

    /// The place in camera space, the smoothing length and the weights of a particle that is a ball seen through a pinhole; `None` for
    /// others, and for what cannot be drawn.
    #[inline]
    pub fn ball_ahead(&self, splats: &Splats<'_>, index: usize) -> Option<(DVec3, f64, [f64; 2])> {
        match (splats.extent(), self.view.projection) {
            (Extent::World(h), Projection::Perspective { .. }) => {
                let (camera, weights) = self.before_eye(splats, index)?;
                let h = f64::from(h[index]);
                (h > 0.0 && camera.is_finite()).then_some((camera, h, weights))
            }
            _ => None,
        }
    }

    /// The place in camera space and the weights of what can be drawn of a batch.
    #[inline]
    fn before_eye(&self, splats: &Splats<'_>, index: usize) -> Option<(DVec3, [f64; 2])> {
        let weight = f64::from(splats.weight()[index]);
        let weight_s = splats.attribute().map_or(0.0, |attribute| weight * f64::from(attribute[index]));
        let camera = self.view.to_camera(splats.positions().world(index));
        // NaN compares false, so that it is dropped too. In front of a parallel projection's eye plane only as well.
        let can_be = camera.z > 0.0 && camera.z.is_finite() && weight.is_finite() && weight_s.is_finite();
        can_be.then_some((camera, [weight, weight_s]))
    }

    /// A circle around where a point of camera space appears; its amplitude has the unit `per_area`, in pixels.
    fn circle(&self, camera: DVec3, radius: f64, per_area: f64, weights: [f64; 2]) -> Option<Footprint> {
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let center = self.center(camera)?;
        let [amplitude, amplitude_s] = weights.map(|weight| weight * per_area / (radius * radius));
        let (min, max) = (center.map(|x| x - radius), center.map(|x| x + radius));
        Some(Footprint { min, max, radius, amplitude, amplitude_s, shape: Shape::Circle { center } })
    }

    /// A kernel of the smoothing length `h`.
    fn ball(&self, camera: DVec3, h: f64, weights: [f64; 2]) -> Option<Footprint> {
        match self.view.projection {
            Projection::Orthographic { .. } => self.circle(camera, h * self.focal, self.focal * self.focal, weights),
            Projection::Perspective { .. } => self.sphere(camera, h, weights[0], weights[1]),
        }
    }

    /// A kernel stretched to a covariance. A round one is the ball that it is.
    fn stretched(&self, camera: DVec3, covariance: Covariance, kernel: Kernel, weights: [f64; 2]) -> Option<Footprint> {
        let variance = kernel.variance();
        let [xx, yy, zz, xy, xz, yz] = covariance.0;
        if xx == yy && yy == zz && [xy, xz, yz] == [0.0; 3] {
            return self.ball(camera, (f64::from(xx) / variance).sqrt(), weights);
        }
        self.ellipsoid(Ellipsoid::of(covariance, variance, camera, &self.view)?, variance, weights)
    }

    /// The footprint of an ellipsoid of a kernel with this variance, of these weights; `None` when it cannot be drawn.
    pub fn ellipsoid(&self, ellipsoid: Ellipsoid, variance: f64, weights: [f64; 2]) -> Option<Footprint> {
        match self.view.projection {
            Projection::Orthographic { .. } => {
                let ellipse = ellipsoid.parallel_image(self.center(ellipsoid.camera)?, self.focal)?;
                Footprint::ellipse(ellipse, weights.map(|weight| weight * self.focal * self.focal))
            }
            Projection::Perspective { .. } => self.ellipsoid_through_pinhole(ellipsoid, variance, weights),
        }
    }

    /// The footprint of an ellipsoid in a perspective view.
    fn ellipsoid_through_pinhole(&self, ellipsoid: Ellipsoid, variance: f64, weights: [f64; 2]) -> Option<Footprint> {
        let image = self.far_image(&ellipsoid, variance)?;
        let [horizontal, vertical] = [0, 1].map(|axis| ellipsoid.slopes(axis).map(|slope| slope * self.focal));
        let [x, y] = self.middle;
        Some(Footprint {
            min: [x + horizontal[0], y - vertical[1]],
            max: [x + horizontal[1], y - vertical[0]],
            radius: ellipsoid.short_radius(&image, self.focal),
            amplitude: weights[0],
            amplitude_s: weights[1],
            shape: Shape::Ellipsoid(ellipsoid),
        })
    }

    /// A footprint with an ellipsoid replaced by the ellipse that it looks like from far away, where the two differ by less
    /// than `depth` ([`FarImage::depth`]).
    pub fn seen_from_far(&self, footprint: Footprint, kernel: Kernel, depth: f64) -> Footprint {
        let Shape::Ellipsoid(ellipsoid) = footprint.shape else { return footprint };
        let image = self.far_image(&ellipsoid, kernel.variance()).filter(|image| image.depth < depth);
        let far = image.and_then(|image| {
            let weights = [footprint.amplitude, footprint.amplitude_s].map(|weight| weight * image.flux);
            Footprint::ellipse(image.ellipse, weights)
        });
        far.unwrap_or(footprint)
    }

    /// What an ellipsoid looks like from far away, for a kernel's variance.
    pub fn far_image(&self, ellipsoid: &Ellipsoid, variance: f64) -> Option<FarImage> {
        ellipsoid.far_image(self.center(ellipsoid.camera)?, self.focal, variance)
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

    /// The line of sight at a point of the picture (pixels): a point of it at depth 0 in camera space, and what it moves by with depth.
    pub fn sight(&self, point: [f64; 2]) -> (DVec3, DVec3) {
        let [x, y] = [point[0] - self.middle[0], self.middle[1] - point[1]].map(|at| at / self.focal);
        match self.view.projection {
            Projection::Perspective { .. } => (DVec3::ZERO, DVec3::new(x, y, 1.0)),
            Projection::Orthographic { .. } => (DVec3::new(x, y, 0.0), DVec3::Z),
        }
    }

    /// The tangent of the angle between the view's axis and a point of the picture (pixels), as a vector.
    pub fn slope(&self, point: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (point[k] - self.middle[k]) * self.ray()[1])
    }

    /// The most that a particle adds to `P` of any pixel (F12 4.7.3, `P_i`): its peak, or where it is smaller than a pixel,
    /// all of it in one.
    pub fn presence(&self, footprint: &Footprint, kernel: Kernel) -> f64 {
        let (factor, whole) = match footprint.shape {
            Shape::Circle { .. } => (1.0, footprint.radius * footprint.radius),
            Shape::Sphere { camera, h } => (1.0, (h * self.focal / camera.z).powi(2)),
            Shape::Ellipse(ellipse) => (1.0, ellipse.area()),
            Shape::Ellipsoid(ellipsoid) => {
                let image = self.far_image(&ellipsoid, kernel.variance());
                (ellipsoid.peak(), image.map_or(f64::INFINITY, |image| image.ellipse.area()))
            }
        };
        footprint.amplitude * factor * whole.min(kernel.projected(0.0))
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
            Projection::Perspective { .. } if camera.z.is_nan() || camera.z <= 0.0 => None,
            _ => self.ball(camera, h, [1.0, 0.0]),
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
                Row { curvature, middle: center[0], offset, depth: 1.0, slope: 0.0, axis: center[0], ray: None, range }
            }
            Shape::Ellipse(Ellipse { center, shear, half }) => {
                let middle = center[0] + shear * (y - center[1]);
                let offset = ((y - center[1]) / half[1]).powi(2);
                let (curvature, range) = ((half[0] * half[0]).recip(), [f64::NEG_INFINITY, f64::INFINITY]);
                Row { curvature, middle, offset, depth: 1.0, slope: 0.0, axis: middle, ray: None, range }
            }
            Shape::Ellipsoid(ellipsoid) => ellipsoid.row((self.middle[1] - y) / self.focal, self.middle[0], self.focal),
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
                    axis: self.middle[0],
                    ray: None,
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
        let u = (x - row.axis) * row.slope;
        let along = x - row.middle;
        (row.curvature * along * along + row.offset) / (row.depth + u * u)
    }

    /// The factor on the footprint's amplitude that the ray at `x` of a row (pixels) has of its own: 1 but for ellipsoids in perspective.
    pub fn ray_factor(&self, row: &Row, x: f64) -> f64 {
        let Some(depth) = row.ray else { return 1.0 };
        let [middle, rate] = self.ray();
        let (own, u) = ((x - row.axis) * row.slope, (x - middle) * rate);
        ((depth + u * u) / (row.depth + own * own)).sqrt()
    }

    /// `P` at `x` of a row, pixels, in units of the footprint's amplitude.
    pub fn line(&self, line: &LineTable, row: &Row, x: f64) -> f64 {
        let value = line.at_square(self.square(row, x));
        if value > 0.0 { value * self.ray_factor(row, x) } else { value }
    }
}
