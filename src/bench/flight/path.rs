//! The straight flight of F12 4.10.3: through the middle of the data at constant velocity, looking ahead.

use crate::model::Bounds;
use crate::view::{Projection, View, ViewError};
use glam::DVec3;

/// Direction of flight, not along any axis of the data, so that nodes come one after another.
const DIRECTION: DVec3 = DVec3::new(0.62, 0.37, 0.69);

/// A straight path through the middle of a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    start: DVec3,
    step: DVec3,
    fov_y: f64,
    /// How long it takes, seconds.
    pub seconds: f64,
}

impl Flight {
    /// A flight whose middle is the box's, with so many sides of the box (its longest) a second.
    pub fn through(bounds: Bounds, sides_per_second: f64, seconds: f64, fov_y: f64) -> Flight {
        let step = DIRECTION.normalize() * bounds.size().max_element() * sides_per_second;
        Flight { start: bounds.center() - 0.5 * seconds * step, step, fov_y, seconds }
    }

    /// World units per second.
    pub fn speed(&self) -> f64 {
        self.step.length()
    }

    /// The camera after so many seconds.
    ///
    /// # Errors
    /// As [`View::look_at`]: a box without extent gives no direction.
    pub fn view(&self, seconds: f64, width: u32, height: u32) -> Result<View, ViewError> {
        let eye = self.start + seconds * self.step;
        let projection = Projection::Perspective { fov_y: self.fov_y };
        let ahead = self.step.try_normalize().ok_or(ViewError::NoDirection)?;
        // Far enough that the direction does not suffer from rounding.
        let far = eye.abs().max_element().max(1e-300);
        View::look_at(eye, eye + ahead * far, DVec3::Y, projection, width, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_the_flight_is_the_middle_of_the_box() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(2230.0, 2000.0, 2230.0) };
        let flight = Flight::through(bounds, 12.76 / 2230.0, 175.0, 0.8);
        assert!((flight.speed() - 12.76).abs() < 1e-9);
        let [start, middle, end] = [0.0, 87.5, 175.0].map(|t| flight.view(t, 1200, 800).unwrap());
        assert!(middle.eye.distance(bounds.center()) < 1e-9);
        assert!((end.eye.distance(start.eye) - 2233.0).abs() < 1e-6);
        assert!(start.forward.distance(end.forward) < 1e-12 && start.forward.dot(end.eye - start.eye) > 2232.9);
        let nowhere = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        assert!(Flight::through(nowhere, 0.01, 1.0, 0.8).view(0.0, 8, 8).is_err());
    }
}
