//! The lens of the camera: whether lines of sight are parallel, and how much one sees.

/// Projection and field of view, as the panel edits them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Vertical field of view, degrees.
    pub fov_deg: f64,
    /// Whether lines of sight are parallel. The picture is then as high as the field of view is at the target, so that
    /// switching keeps the target's size and zooming works alike.
    pub parallel: bool,
}

impl Lens {
    /// Height of the picture at a distance from the eye, world units.
    pub fn height_at(&self, distance: f64) -> f64 {
        2.0 * distance * (0.5 * self.fov_deg.to_radians()).tan()
    }

    /// The field of view at which the picture is `height` high at `distance`, degrees.
    pub fn fov_of(height: f64, distance: f64) -> f64 {
        (2.0 * (0.5 * height / distance).atan()).to_degrees()
    }
}
