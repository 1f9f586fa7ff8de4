//! What is seen at a place of the picture: a particle, or a surface.

use super::heights::Asked;
use crate::view::View;
use crate::window::hidden::Hiding;
use crate::window::pages::ViewSelection;
use crate::window::pick::{Picked, pick};
use crate::window::scene::{Scene, Settings};
use bevy::ecs::system::SystemParam;
use bevy::math::DVec3;
use bevy::prelude::*;

/// What is seen.
pub enum Seen {
    /// A particle near the mouse.
    Particle(Picked),
    /// A field, at this place.
    Surface(DVec3),
    /// Neither.
    Nothing,
}

/// What the picture shows, for those who ask what is seen in it.
#[derive(SystemParam)]
pub struct InSight<'w> {
    scene: Option<Res<'w, Scene>>,
    settings: Res<'w, Settings>,
    selection: Res<'w, ViewSelection>,
    hiding: Res<'w, Hiding>,
}

impl InSight<'_> {
    /// What is seen at a pixel; `None` while there is no picture.
    pub fn at(&self, at: [f64; 2]) -> Option<Seen> {
        let (scene, view) = (self.scene.as_ref()?, self.selection.view?);
        let fields = scene.fields(&self.settings);
        let asked = Asked { fields: &fields, settings: &self.settings.look.settings, view };
        Some(self.seen(&asked, at, scene))
    }

    /// The nearer one of a particle near the mouse and the fields under it. Where heights are shown alone no particle is.
    fn seen(&self, asked: &Asked<'_>, at: [f64; 2], scene: &Scene) -> Seen {
        let view: View = asked.view;
        let is_about_heights = !asked.fields.is_empty() && scene.is_about_heights(self.settings.mode);
        let depth = |place: DVec3| view.to_camera(place).z;
        let picked = if is_about_heights { None } else { pick(&view, scene.metadata(), &self.selection.nodes, at) };
        let picked = picked.filter(|picked| !self.hiding.hides(picked.position));
        match (picked, asked.place(at)) {
            (Some(picked), Some(place)) if depth(place) < depth(picked.position) => Seen::Surface(place),
            (Some(picked), _) => Seen::Particle(picked),
            (None, Some(place)) => Seen::Surface(place),
            (None, None) => Seen::Nothing,
        }
    }
}
