//! From where paths are looked at: the one view of a flat picture, or all that a picture is put together from. What is chosen for one of
//! them is chosen for all, so that no face of a panorama shows where it ends, and both eyes see the same.

use super::MARGIN_PX;
use crate::model::Bounds;
use crate::view::{Extent, Projection, View};
use glam::DVec3;

/// The views of a picture.
pub struct Sight {
    /// With room around them for what reaches into them.
    views: Vec<View>,
    around: Option<Around>,
    /// Height of the picture of one eye, pixels; of a cube, its edge.
    pub height: u32,
}

/// Looking in all directions.
struct Around {
    eye: DVec3,
    /// The angle of a pixel.
    pixel: f64,
    /// How far eyes are from there at most, world units.
    away: f64,
}

impl Sight {
    /// Of a flat picture, or one for each of two eyes that look in parallel, of this height.
    pub fn flat(views: impl IntoIterator<Item = View>, height: u32) -> Sight {
        let views = views.into_iter().map(|view| view.padded(MARGIN_PX)).collect();
        Sight { views, around: None, height }
    }

    /// In all directions that `faces` around an eye show, with pixels of so many radians; the picture is put together from eyes that are at
    /// most `away` from there.
    pub fn around(faces: impl IntoIterator<Item = View>, eye: DVec3, pixel: f64, away: f64, height: u32) -> Sight {
        let around = Some(Around { eye, pixel, away });
        Sight { around, ..Sight::flat(faces, height) }
    }

    /// Displacements to the images of a periodic box.
    pub fn offsets(&self) -> Vec<DVec3> {
        self.views.first().map_or_else(Vec::new, |view| view.images.offsets().collect())
    }

    /// Whether any of what lies in `bounds`, or within `margin` of it, may be seen.
    pub fn sees(&self, bounds: Bounds, margin: f64) -> bool {
        let away = self.around.as_ref().map_or(0.0, |around| around.away);
        let extent = Extent { bounds, margin: margin + away };
        self.views.iter().any(|view| view.cut.reaches(&bounds) && view.sees(&extent))
    }

    /// How many pixels `error` is at most of what lies within it of `bounds`.
    pub fn pixels(&self, bounds: Bounds, error: f64) -> f64 {
        let at = |nearest: f64, focal: f64| if nearest > 0.0 { error * focal / nearest } else { f64::INFINITY };
        if let Some(Around { eye, pixel, away }) = self.around {
            let nearest = eye.distance(eye.clamp(bounds.min, bounds.max)) - error - away;
            return at(nearest, 1.0 / pixel);
        }
        let extent = Extent { bounds, margin: error };
        let of_view = |view: &View| match view.projection {
            Projection::Orthographic { .. } => error * view.focal_pixels(),
            Projection::Perspective { .. } => at(view.nearest_depth(&extent) - error, view.focal_pixels()),
        };
        self.views.iter().map(of_view).fold(0.0, f64::max)
    }
}
