//! The layer of selections over the picture: drawn again whenever the view, its nodes or the selections change.

use super::followed::FollowedSets;
use super::ids::LookedUp;
use super::prober::Prober;
use crate::explore::marks::{Layer, Marks, shown};
use crate::explore::{Data, Members, Region, SelectionSet, Shape};
use crate::model::FamilyName;
use crate::stream::SceneNode;
use crate::view::View;
use crate::window::pages::ViewSelection;
use crate::window::scene::{RunNow, Scene, Settings};
use crate::window::sheet::Sheet;
use bevy::prelude::*;
use bevy_egui::egui::{self, Color32, TextureHandle, TextureOptions};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// Particles up to which the layer is drawn within a frame, so that it moves with the picture; of more it is drawn on another thread
/// and shown when the camera rests.
const AT_ONCE: u64 = 200_000;
/// Colour of the region that is being looked at.
const PROBED: [u8; 3] = [0xff, 0xff, 0xff];

/// What a layer was drawn from.
#[derive(Clone, PartialEq)]
struct Key {
    view: View,
    revision: u64,
    generation: u32,
    sets: Vec<SelectionSet>,
    probed: Option<Members>,
    /// What was known of where ids are.
    looked_up: u64,
    /// What was known of who is followed in a run, and the time of it.
    followed: (u64, Option<f64>),
}

/// The layer.
#[derive(Resource, Default)]
pub struct MarkLayer {
    /// What is being drawn or has been drawn last.
    wanted: Option<Key>,
    coming: Option<Mutex<Receiver<Layer>>>,
    /// What has arrived, and the view that it belongs to.
    layer: Option<(Layer, View)>,
    sheet: Sheet,
    /// Whether the sheet shows `layer`.
    uploaded: bool,
}

impl MarkLayer {
    /// The layer as textures with their places as shares of the picture; none where there is no layer for this view.
    pub fn textures(&mut self, ctx: &egui::Context, view: &View) -> &[(TextureHandle, egui::Rect)] {
        let Some((layer, _)) = self.layer.as_ref().filter(|(_, drawn)| drawn == view) else { return &[] };
        if !self.uploaded {
            let pixel = |at: usize| {
                let [r, g, b, a] = layer.rgba[at];
                Color32::from_rgba_unmultiplied(r, g, b, a)
            };
            let size = [layer.width as usize, layer.height as usize];
            self.sheet.fill(ctx, ("selections", TextureOptions::NEAREST), size, pixel);
            self.uploaded = true;
        }
        self.sheet.tiles()
    }

    /// How the picture below it is tinted: black where selections are shown alone.
    pub fn tint(&self) -> Color32 {
        match &self.layer {
            Some((layer, _)) if layer.alone => Color32::BLACK,
            _ => Color32::WHITE,
        }
    }

    fn take(&mut self, layer: Layer, view: View) {
        self.layer = Some((layer, view));
        self.uploaded = false;
    }
}

/// Draws the layer where it is not what is wanted.
pub(super) fn draw_marks(
    mut layer: ResMut<MarkLayer>,
    scene: Option<Res<Scene>>,
    selection: Res<ViewSelection>,
    settings: Res<Settings>,
    prober: Res<Prober>,
    (looked_up, followed): (Res<LookedUp>, Res<FollowedSets>),
) {
    let layer = layer.bypass_change_detection();
    let (Some(scene), Some(view)) = (scene, selection.view) else { return };
    if let Some(coming) = &layer.coming {
        let answer = coming.lock().unwrap_or_else(PoisonError::into_inner).try_recv();
        match (answer, layer.wanted.as_ref().map(|key| key.view)) {
            (Err(TryRecvError::Empty), _) => return,
            (Ok(drawn), Some(of)) => layer.take(drawn, of),
            _ => {}
        }
        layer.coming = None;
    }
    let key = Key {
        view,
        revision: selection.revision,
        generation: scene.generation,
        sets: settings.selections.clone(),
        probed: prober.members.clone(),
        looked_up: looked_up.revision,
        followed: (followed.revision, scene.time),
    };
    if layer.wanted.as_ref() == Some(&key) {
        return;
    }
    let marks = marks_of(&scene, &key, &looked_up, &followed);
    if marks.is_empty() {
        layer.layer = None;
        layer.wanted = Some(key);
        return;
    }
    let nodes: Arc<[SceneNode]> = Arc::clone(&selection.nodes);
    let known = scene.metadata().families.iter().zip(&settings.families);
    let families: Vec<FamilyName> = known.filter(|(_, shown)| **shown).map(|(family, _)| family.name).collect();
    let count =
        |node: &SceneNode| node.page.nodes.get(node.node.node as usize).map_or(0, |node| u64::from(node.particles));
    // Who is followed in a run is marked by places that are known, whatever nodes are drawn.
    let looks_at_nodes =
        scene.following.is_none() || key.probed.is_some() || shown(&key.sets).0.iter().any(|set| !set.members.stay());
    if !looks_at_nodes || nodes.iter().map(count).sum::<u64>() <= AT_ONCE {
        let drawn = marks.draw(&view, &nodes, &families);
        layer.take(drawn, view);
    } else {
        let (send, receive) = channel();
        rayon::spawn(move || drop(send.send(marks.draw(&view, &nodes, &families))));
        layer.coming = Some(Mutex::new(receive));
    }
    layer.wanted = Some(key);
}

/// Whether a region is told by its outline, from wherever one looks; the whole needs none.
fn has_outline(region: &Region) -> bool {
    let is_solid = |shape: &Shape| matches!(shape, Shape::Sphere { .. } | Shape::Box { .. });
    region.is_whole() || (region.ranges.is_empty() && region.shapes.first().is_some_and(is_solid))
}

/// What is to be marked; regions that make no sense were refused where they came from.
fn marks_of(scene: &Scene, key: &Key, looked_up: &LookedUp, followed: &FollowedSets) -> Marks {
    let metadata = scene.metadata();
    let periodic = Data::Pages(&scene.file).periodic_edge().unwrap_or(None);
    let mut marks = Marks::new(&key.sets, metadata, periodic, |ids| looked_up.highlighter(ids)).unwrap_or_default();
    if let Some(now) = RunNow::of(scene) {
        for set in shown(&key.sets).0.into_iter().filter(|set| set.members.stay()) {
            if let Some(places) = followed.places(&set.members, &now) {
                marks.add_places(places, set.rgb().unwrap_or([255; 3]));
            }
        }
    }
    // What is kept as a selection has that one's colour.
    let kept = |members: &Members| key.sets.iter().any(|set| set.members == *members);
    match &key.probed {
        Some(Members::Region(region)) if !has_outline(region) && !key.probed.as_ref().is_some_and(kept) => {
            // It was checked before it was summed up.
            marks.add(region, PROBED, metadata, periodic).unwrap_or_default();
            marks
        }
        _ => marks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_is_shown_in_the_view_that_it_was_drawn_for() {
        let ctx = egui::Context::default();
        let around = |height| {
            let bounds = crate::model::Bounds { min: [0.0; 3].into(), max: [1.0; 3].into() };
            View::around(bounds, 0.8, 64, height).unwrap()
        };
        let mut layer = MarkLayer::default();
        assert!(layer.textures(&ctx, &around(48)).is_empty());
        layer.take(Layer { width: 64, height: 48, rgba: vec![[1, 2, 3, 255]; 64 * 48], alone: false }, around(48));
        assert_eq!((layer.textures(&ctx, &around(48)).len(), layer.textures(&ctx, &around(50)).len()), (1, 0));
    }
}
