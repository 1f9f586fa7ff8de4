//! The open file's pages, and the view that they are read for.

use super::camera::Viewpoint;
use super::lens::view_of;
use super::look::Look;
use super::picture::{DataCamera, Picture};
use super::preset::ResidencyPreset;
use super::scene::{Scene, Settings};
use super::statistics::ActiveBackend;
use crate::picture::stand_in::StandIn;
use crate::store::PageId;
use crate::stream::Streamer;
use crate::view::View;
use crate::window::state::aim::Aim;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use std::collections::HashMap;

/// What the sides of the flat view are divided by while a panorama is shown, which reads its pages itself: what is ahead of the camera is
/// known well enough for the speed of flights, and little memory is taken for it.
const SURROUND_SHRINK: u32 = 8;

/// The open file's pages.
#[derive(Resource)]
pub struct Streaming {
    /// Which pages are in memory, and what is done about the others.
    pub streamer: Streamer,
    pub(super) entities: HashMap<PageId, Entity>,
    /// The [`Scene::generation`] of the file.
    pub generation: u32,
    /// When it is seen, the data's unit of time, and when it will be in a moment.
    pub(super) time: f64,
    pub(super) next: Vec<f64>,
    pub(super) preset: ResidencyPreset,
    pub(super) told_memory: bool,
    /// What stands in for what there is no time for.
    pub(super) stand_in: StandIn,
}

impl Streaming {
    /// Nothing of the scene's file is resident yet.
    pub fn new(scene: &Scene, preset: &ResidencyPreset, copies: bool) -> Streaming {
        let mut streamer = Streamer::new(scene.tree(), preset.stream_options());
        streamer.keep_copies(copies.then(|| preset.copy_options()));
        Streaming {
            streamer,
            entities: HashMap::new(),
            generation: scene.generation,
            time: scene.moving.as_ref().map_or(0.0, |moving| moving.time),
            next: Vec::new(),
            preset: preset.clone(),
            told_memory: false,
            stand_in: StandIn::default(),
        }
    }

    /// The entity of a page that is loading, resident or failed.
    pub fn entity(&self, page: PageId) -> Option<Entity> {
        self.entities.get(&page).copied()
    }
}

/// What the window looks at.
#[derive(SystemParam)]
pub struct Present<'w, 's> {
    pub(super) settings: Res<'w, Settings>,
    picture: Res<'w, Picture>,
    pub(super) look: Option<Res<'w, Look>>,
    aim: Option<Res<'w, Aim>>,
    backend: Res<'w, ActiveBackend>,
    camera: Single<'w, 's, &'static Viewpoint, With<DataCamera>>,
}

impl Present<'_, '_> {
    /// The present view.
    pub fn view(&self, streaming: &Streaming) -> Option<View> {
        self.view_from(&self.camera, streaming)
    }

    /// The view from elsewhere.
    pub(super) fn view_from(&self, viewpoint: &Viewpoint, streaming: &Streaming) -> Option<View> {
        let periodic = streaming.streamer.residency.tree().metadata().periodic_box();
        let size = match *self.backend {
            ActiveBackend::Surround => (self.picture.size() / SURROUND_SHRINK).max(UVec2::ONE),
            _ => self.picture.size(),
        };
        let view = view_of(viewpoint, &self.settings, periodic, size, self.aim.as_deref()).ok()?;
        Some(View { time: streaming.time, ..view })
    }

    /// What has to stay the same for a picture to say anything of the next: the scene's generation and the depiction's revision.
    pub fn key(&self, streaming: &Streaming) -> (u32, u64) {
        (streaming.generation, self.look.as_ref().map_or(0, |look| look.depiction_revision))
    }
}
