//! Lines of sight: from pixels to rays and back, for flat pictures and for those of all directions.

use crate::view::{Cut, Extent, Panorama, Projection, Surround, View};
use glam::DVec3;

/// Largest growth of lengths across the radius of a dome, and along the circles of latitude, that the error of nodes reckons with.
const STRETCHED: f64 = 8.0;

/// Who looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// A camera with a flat picture.
    Flat(View),
    /// All directions around an eye.
    Around {
        /// Which pixel shows which direction.
        panorama: Panorama,
        /// Where it stands.
        eye: DVec3,
        /// What is left out and faded; depth is the distance.
        cut: Cut,
    },
}

/// What all rays of a picture have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// The place that is straight ahead, pixels.
    middle: [f64; 2],
    /// Pixels of a length of 1 at a depth of 1, in pictures without perspective at any.
    focal: f64,
}

impl Sight {
    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        match self {
            Sight::Flat(view) => [view.width, view.height],
            Sight::Around { panorama, .. } => [panorama.width, panorama.height],
        }
    }

    /// The same picture with `factor` times as many pixels along each axis.
    pub fn refined(&self, factor: u32) -> Sight {
        let [width, height] = self.size().map(|size| size.saturating_mul(factor));
        match *self {
            Sight::Flat(view) => Sight::Flat(view.resized(width, height)),
            Sight::Around { panorama, eye, cut } => {
                Sight::Around { panorama: Panorama { width, height, ..panorama }, eye, cut }
            }
        }
    }

    /// Where the eye is.
    pub fn eye(&self) -> DVec3 {
        match self {
            Sight::Flat(view) => view.eye,
            Sight::Around { eye, .. } => *eye,
        }
    }

    /// What is left out and faded.
    pub fn cut(&self) -> &Cut {
        match self {
            Sight::Flat(view) => &view.cut,
            Sight::Around { cut, .. } => cut,
        }
    }

    /// What rays are made with.
    pub fn lens(&self) -> Lens {
        match self {
            Sight::Flat(view) => Lens { middle: view.middle(), focal: view.focal_pixels() },
            Sight::Around { .. } => Lens { middle: [0.0; 2], focal: 1.0 },
        }
    }

    /// The ray of a place in the picture: its parameter is the depth. `None` where nothing is shown.
    pub fn ray(&self, place: [f64; 2]) -> Option<(DVec3, DVec3)> {
        self.ray_through(&self.lens(), place)
    }

    /// The same with what many rays have in common.
    #[inline]
    pub fn ray_through(&self, Lens { middle, focal }: &Lens, [x, y]: [f64; 2]) -> Option<(DVec3, DVec3)> {
        match self {
            Sight::Flat(view) => {
                let across = (x - middle[0]) / focal * view.right + (middle[1] - y) / focal * view.up;
                Some(match view.projection {
                    Projection::Perspective { .. } => (view.eye, across + view.forward),
                    Projection::Orthographic { .. } => (view.eye + across, view.forward),
                })
            }
            Sight::Around { panorama, eye, .. } => panorama.direction([x, y]).map(|direction| (*eye, direction)),
        }
    }

    /// Where something that is so far from the eye appears, and its depth; `None` behind a camera, and where nothing is shown.
    pub fn project(&self, relative: DVec3) -> Option<([f64; 2], f64)> {
        self.project_through(&self.lens(), relative)
    }

    /// The same with what many places have in common.
    #[inline]
    pub fn project_through(&self, Lens { middle, focal }: &Lens, relative: DVec3) -> Option<([f64; 2], f64)> {
        match self {
            Sight::Flat(view) => {
                let camera = DVec3::new(relative.dot(view.right), relative.dot(view.up), relative.dot(view.forward));
                let scale = match view.projection {
                    Projection::Perspective { .. } if camera.z > 0.0 => focal / camera.z,
                    Projection::Orthographic { .. } if camera.z >= 0.0 => *focal,
                    _ => return None,
                };
                Some(([middle[0] + camera.x * scale, middle[1] - camera.y * scale], camera.z))
            }
            Sight::Around { panorama, .. } => panorama.pixel(relative).map(|at| (at, relative.length())),
        }
    }

    /// The direction from a place to the eye, a unit vector.
    pub fn toward_eye(&self, relative: DVec3) -> DVec3 {
        match self {
            Sight::Flat(View { projection: Projection::Orthographic { .. }, forward, .. }) => -*forward,
            _ => (-relative).normalize_or_zero(),
        }
    }

    /// Pixels of a length of 1 at a depth, in the middle of the picture.
    pub fn pixels_at(&self, depth: f64) -> f64 {
        self.pixels_through(&self.lens(), depth)
    }

    /// The same with what many places have in common.
    #[inline]
    pub fn pixels_through(&self, Lens { focal, .. }: &Lens, depth: f64) -> f64 {
        match self {
            Sight::Flat(view) => match view.projection {
                Projection::Perspective { .. } => focal / depth,
                Projection::Orthographic { .. } => *focal,
            },
            Sight::Around { panorama, .. } => 1.0 / (panorama.pixel_angle() * depth),
        }
    }

    /// Whether any place of the box can be in the picture; never false for one that is.
    pub fn sees(&self, extent: &Extent) -> bool {
        match self {
            Sight::Flat(view) => view.sees(extent),
            Sight::Around { .. } => true,
        }
    }

    /// Largest displacement in the picture, in pixels, of any place in the box that is drawn at most `delta` from where it is.
    pub fn error_pixels(&self, extent: &Extent, delta: f64) -> f64 {
        if delta <= 0.0 {
            return 0.0;
        }
        match self {
            Sight::Flat(view) => view.error_pixels(extent, delta),
            Sight::Around { panorama, eye, .. } => {
                let outside = (extent.bounds.min - *eye).max(*eye - extent.bounds.max).max(DVec3::ZERO);
                let distance = outside.length() - extent.margin;
                if distance <= delta {
                    return f64::INFINITY;
                }
                // Across the radius a dome draws an angle `theta` from its axis longer by `theta / sin theta`.
                let stretched = match panorama.surround {
                    Surround::Dome { aperture, .. } => {
                        let angle = 0.5 * aperture.to_radians();
                        if angle < 3.0 { (angle / angle.sin()).clamp(1.0, STRETCHED) } else { STRETCHED }
                    }
                    Surround::Cube { .. } => 2.0,
                    _ => STRETCHED,
                };
                (delta / distance).min(1.0).asin() * stretched / panorama.pixel_angle()
            }
        }
    }
}
