//! What the camera stays above: the heights that are shown.

use super::camera::Ground;
use super::scene::{Scene, Settings};
use bevy::prelude::*;
use std::sync::Arc;

/// How far the eye stays above the surface, of the box around it.
const CLEARANCE: f64 = 1e-3;

/// Tells the camera of the heights that are open, as high as they stand now; of a globe nothing is told.
pub(super) fn follow_ground(scene: Option<Res<Scene>>, settings: Res<Settings>, mut ground: ResMut<Ground>) {
    let Some(scene) = scene.filter(|scene| scene.is_changed() || settings.is_changed()) else { return };
    let heights = scene.samples_for(settings.mode).and_then(|field| {
        let opened = field.opened.ground()?;
        let placed = opened.placed(&settings.look.settings).ok().filter(|placed| placed.is_flat())?;
        let clearance = CLEARANCE * opened.bounds(&settings.look.settings).ok()?.size().length();
        Some((Arc::clone(opened), placed, clearance))
    });
    ground.0 = heights.map(|(opened, placed, clearance)| {
        let least = move |eye: bevy::math::DVec3| {
            let column = (eye.x - placed.origin[0]) / placed.step[0];
            let row = (eye.y - placed.origin[1]) / placed.step[1];
            Some(placed.lifted(opened.most_at(row, column)?) + clearance)
        };
        Arc::new(least) as _
    });
}
