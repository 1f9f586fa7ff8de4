//! The layer of selections over the picture: drawn again whenever the view, its nodes or the selections change.

use super::ids::LookedUp;
use super::prober::Prober;
use crate::app::pages::ViewSelection;
use crate::app::scene::{Scene, Settings};
use crate::explore::marks::{Layer, Marks};
use crate::explore::{Data, Members, Region, SelectionSet, Shape};
use crate::stream::SceneNode;
use crate::view::View;
use bevy::prelude::*;
use bevy_egui::egui::{self, Color32, ColorImage, TextureHandle, TextureOptions};
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
}

/// The layer.
#[derive(Resource, Default)]
pub struct MarkLayer {
    /// What is being drawn or has been drawn last.
    wanted: Option<Key>,
    coming: Option<Mutex<Receiver<Layer>>>,
    /// What has arrived, and the view that it belongs to.
    layer: Option<(Layer, View)>,
    texture: Option<TextureHandle>,
    /// Whether `texture` shows `layer`.
    uploaded: bool,
}

impl MarkLayer {
    /// The layer as a texture, if there is one for this view.
    pub fn texture(&mut self, ctx: &egui::Context, view: &View) -> Option<egui::TextureId> {
        let (layer, drawn) = self.layer.as_ref()?;
        if drawn != view {
            return None;
        }
        if !self.uploaded {
            let size = [layer.width as usize, layer.height as usize];
            let image = ColorImage::from_rgba_unmultiplied(size, layer.rgba.as_flattened());
            match &mut self.texture {
                Some(texture) => texture.set(image, TextureOptions::NEAREST),
                None => self.texture = Some(ctx.load_texture("selections", image, TextureOptions::NEAREST)),
            }
            self.uploaded = true;
        }
        self.texture.as_ref().map(TextureHandle::id)
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
    looked_up: Res<LookedUp>,
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
    };
    if layer.wanted.as_ref() == Some(&key) {
        return;
    }
    let marks = marks_of(&scene, &key, &looked_up);
    if marks.is_empty() {
        layer.layer = None;
        layer.wanted = Some(key);
        return;
    }
    let nodes: Arc<[SceneNode]> = Arc::clone(&selection.nodes);
    let count =
        |node: &SceneNode| node.page.nodes.get(node.node.node as usize).map_or(0, |node| u64::from(node.particles));
    if nodes.iter().map(count).sum::<u64>() <= AT_ONCE {
        let drawn = marks.draw(&view, scene.file.metadata(), &nodes);
        layer.take(drawn, view);
    } else {
        let (send, receive) = channel();
        let file = Arc::clone(&scene.file);
        rayon::spawn(move || drop(send.send(marks.draw(&view, file.metadata(), &nodes))));
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
fn marks_of(scene: &Scene, key: &Key, looked_up: &LookedUp) -> Marks {
    let metadata = scene.file.metadata();
    let periodic = Data::Pages(&scene.file).periodic_edge().unwrap_or(None);
    let mut marks = Marks::new(&key.sets, metadata, periodic, |ids| looked_up.highlighter(ids)).unwrap_or_default();
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
