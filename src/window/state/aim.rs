//! Where the picture looks from the camera, where a window displays another part than the middle.

use crate::view::{Projection, View, ViewError};
use bevy::math::DVec3;
use bevy::prelude::*;

/// Where the picture looks from the camera.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Unit vectors to the picture's right, top and middle, in the camera's frame (right, up, forward).
    pub axes: [DVec3; 3],
    /// Height, radians.
    pub fov_y: f64,
}

impl Aim {
    /// The view of the picture, of `size` pixels, from the camera's own.
    ///
    /// # Errors
    /// [`ViewError`] for a camera that cannot see anything.
    pub fn view(&self, camera: &View, size: UVec2) -> Result<View, ViewError> {
        let world = |axis: DVec3| axis.x * camera.right + axis.y * camera.up + axis.z * camera.forward;
        let [_, up, forward] = self.axes.map(world);
        // A length that is not lost beside the eye's place.
        let length = camera.eye.length().max(1.0);
        let projection = Projection::Perspective { fov_y: self.fov_y };
        View::look_at(camera.eye, camera.eye + length * forward, up, projection, size.x, size.y)
    }
}
