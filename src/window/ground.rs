//! What the camera stays above: the heights that are shown.

use super::camera::Ground;
use super::scene::{Scene, Settings};
use crate::modes::surface;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::sync::Arc;

/// How far the eye stays above the surface, of the box around it.
const CLEARANCE: f64 = 1e-3;

/// Tells the camera of the heights that are open, as high as they stand now, and of the clearance that is set; of a globe of that alone.
pub(super) fn follow_ground(scene: Option<Res<Scene>>, settings: Res<Settings>, mut ground: ResMut<Ground>) {
    let Some(scene) = scene.filter(|scene| scene.is_changed() || settings.is_changed()) else { return };
    let own = &settings.look.settings;
    let opened = scene.samples_for(settings.mode).and_then(|field| field.opened.ground());
    let heights = opened.and_then(|opened| Some((Arc::clone(opened), opened.placed(own).ok()?)));
    let Some((opened, placed)) = heights else {
        *ground = Ground::default();
        return;
    };
    let kept = own.number(&surface::CLEARANCE);
    let lift = (kept > 0.0).then(|| {
        let opened = Arc::clone(&opened);
        Arc::new(move |eye: DVec3| opened.lift(&placed, eye, kept)) as _
    });
    let size = opened.bounds(own).ok().filter(|_| placed.is_flat()).map(|bounds| bounds.size().length());
    let least = size.map(|size| {
        let least = move |eye: DVec3| {
            let column = (eye.x - placed.origin[0]) / placed.step[0];
            let row = (eye.y - placed.origin[1]) / placed.step[1];
            Some(placed.lifted(opened.most_at(row, column)?) + CLEARANCE * size)
        };
        Arc::new(least) as _
    });
    *ground = Ground { least, lift };
}
