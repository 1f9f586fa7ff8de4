//! Bloom of what the adapter draws: the data camera's light spreads as the settings say.

use super::pass_times::LastPasses;
use super::picture::DataCamera;
use super::scene::Settings;
use super::state::notices::Notices;
use super::statistics::{ActiveBackend, Converged};
use crate::gpu::{Glow, bloom};
use bevy::prelude::*;
use bevy::render::renderer::RenderDevice;

/// Tells the data camera how its light spreads; a picture whose light does not do so yet has not converged.
pub(super) fn follow_bloom(
    mut commands: Commands,
    (settings, active, passes): (Option<Res<Settings>>, Res<ActiveBackend>, Res<LastPasses>),
    device: Option<Res<RenderDevice>>,
    camera: Single<(Entity, &Camera, Option<&Glow>), With<DataCamera>>,
    (mut converged, mut notices): (ResMut<Converged>, ResMut<Notices>),
    mut told: Local<bool>,
) {
    let (entity, camera, shown) = camera.into_inner();
    let size = camera.physical_viewport_size().map_or([0; 2], |size| size.to_array());
    let asked = settings.map(|settings| settings.bloom).filter(|bloom| !bloom.is_off() && active.is_on_adapter());
    let has_room = device.is_some_and(|device| bloom::has_room(size, &device));
    if asked.is_some() && !has_room && !std::mem::replace(&mut *told, true) {
        notices.error("the graphics adapter has no room for bloom of so many pixels: light does not spread");
    }
    let wanted = asked.filter(|_| has_room).map(Glow);
    if shown.copied() != wanted {
        match wanted {
            Some(glow) => {
                commands.entity(entity).insert(glow);
            }
            None => {
                commands.entity(entity).remove::<Glow>();
            }
        }
    }
    converged.0 &= wanted.is_none() || passes.has(bloom::PASS);
}
