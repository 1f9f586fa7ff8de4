//! What of lines and marks lies behind the surfaces that are shown.

use crate::picture::surface::{Piece, SurfaceDepths, pieces};
use bevy::math::DVec3;
use bevy::prelude::*;
use std::sync::Arc;

/// Stretches that a straight line through the world is cut into.
const STRETCHES: u32 = 96;

/// How far surfaces are away in the picture that is shown.
#[derive(Resource, Clone, Default)]
pub struct Hiding(pub Option<Arc<SurfaceDepths>>);

impl Hiding {
    /// Whether a place is behind a surface.
    pub fn hides(&self, place: DVec3) -> bool {
        self.0.as_ref().is_some_and(|depths| depths.hides(place))
    }

    /// A line through places, in parts that are seen and parts that are hidden.
    pub fn pieces(&self, places: &[DVec3]) -> Vec<Piece> {
        pieces(places, |place| self.hides(place))
    }

    /// The straight line between two places as such.
    pub fn straight(&self, from: DVec3, to: DVec3) -> Vec<Piece> {
        let steps = if self.0.is_some() { STRETCHES } else { 1 };
        let places: Vec<DVec3> = (0..=steps).map(|step| from.lerp(to, f64::from(step) / f64::from(steps))).collect();
        self.pieces(&places)
    }
}
