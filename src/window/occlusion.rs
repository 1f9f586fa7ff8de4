//! What the picture hides of the file (F12 5.7.2): volumes that have been drawn hide nodes, and nothing below those is read.
//!
//! Every picture says at which depth its pixels became opaque. Traversal leaves the nodes behind as they are
//! ([`Occlusion::occluder`]), and page entities say whether all of their nodes are hidden ([`PageOcclusion`]): what is below those is
//! not read ahead, and they make room first. While the camera moves, what is still hidden is told from the last picture as far as
//! that can be ([`OpaqueDepths::seen_from`]), until there is a new one. A
//! picture that was drawn before everything had come may hide too much: then the next one says so, and what it shows is asked
//! for. Pictures of complete selections hide together only what each of them does, so that this comes to an end.

use super::page_entities::{PageExtent, PageKey, PageOcclusion};
use super::streaming::{Present, Streaming};
use crate::cpu::volume::OpaqueDepths;
use crate::cpu::volume::behind::FromElsewhere;
use crate::view::{Occluder, View};
use bevy::prelude::*;
use std::sync::Arc;

/// What the last pictures hide.
#[derive(Resource, Default)]
pub struct Occlusion {
    /// What has to stay the same for a picture to say anything: the scene's generation and the depiction's revision.
    key: (u32, u64),
    latest: Option<Arc<OpaqueDepths>>,
    /// What all pictures of complete selections hide.
    settled: Option<Arc<OpaqueDepths>>,
    current: Option<Arc<OpaqueDepths>>,
    /// Counts up with every change of what is hidden.
    pub revision: u64,
}

impl Occlusion {
    /// A picture of all particles was drawn, with what it hides, of a selection that was complete or not.
    pub fn drew(&mut self, opaque: Option<Arc<OpaqueDepths>>, key: (u32, u64), complete: bool) {
        let Some(new) = opaque.filter(|opaque| !opaque.is_clear()) else {
            if self.current.is_some() {
                *self = Occlusion { key, revision: self.revision + 1, ..default() };
            }
            return;
        };
        let same = |old: &Arc<OpaqueDepths>| old.is_of(new.view());
        if self.key != key || !self.latest.as_ref().is_none_or(same) {
            *self = Occlusion { key, revision: self.revision, ..default() };
        }
        if complete {
            let settled = match &self.settled {
                // Pictures in motion have fewer pixels; they say less.
                Some(old) if old.view().width > new.view().width => Arc::clone(old),
                Some(old) => old.and(&new).map_or_else(|| Arc::clone(&new), Arc::new),
                None => Arc::clone(&new),
            };
            self.settled = Some(settled);
        }
        let current = match &self.settled {
            None => Arc::clone(&new),
            Some(settled) => settled.and(&new).map_or_else(|| Arc::clone(settled), Arc::new),
        };
        if self.current.as_ref() != Some(&current) {
            self.current = Some(current);
            self.revision += 1;
        }
        self.latest = Some(new);
    }

    /// What hides nodes from a view.
    pub fn occluder(&self, view: &View, key: (u32, u64)) -> Option<Arc<dyn Occluder>> {
        self.current.as_ref().filter(|_| self.key == key)?.occluder(view)
    }

    /// What is hidden from everywhere within `reach` of a view's eye, wherever it looks.
    fn lasting(&self, view: &View, key: (u32, u64), reach: f64) -> Option<FromElsewhere> {
        self.current.as_ref().filter(|_| self.key == key)?.seen_from(view, reach)
    }
}

/// Asks what hides nodes and pages from the present view: nodes as they are looked at, pages from everywhere that the camera may be until
/// something has been read.
pub(super) fn occlude(
    streaming: Option<ResMut<Streaming>>,
    occlusion: Res<Occlusion>,
    present: Present,
    mut pages: Query<(&PageExtent, &mut PageOcclusion)>,
) {
    let Some(mut streaming) = streaming else { return };
    let Some(view) = present.view(&streaming) else { return };
    let key = present.key(&streaming);
    streaming.streamer.occluder = occlusion.occluder(&view, key);
    let lasting = occlusion.lasting(&view, key, streaming.streamer.prefetch_distance());
    for (PageExtent(extent), mut state) in &mut pages {
        let hides = |lasting: &FromElsewhere| view.images.offsets().all(|offset| lasting.hides(&extent.moved(offset)));
        let is_hidden = lasting.as_ref().is_some_and(hides);
        state.set_if_neq(if is_hidden { PageOcclusion::Hidden } else { PageOcclusion::Seen });
    }
}

/// Tells the streamer which pages are hidden.
pub(super) fn hide_pages(
    streaming: Option<ResMut<Streaming>>,
    changed: Query<(&PageKey, &PageOcclusion), Changed<PageOcclusion>>,
) {
    let Some(mut streaming) = streaming else { return };
    for (key, state) in &changed {
        streaming.streamer.hide(key.id, *state == PageOcclusion::Hidden);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use crate::view::{Extent, Projection};
    use bevy::math::DVec3;

    fn view(side: u32) -> View {
        let projection = Projection::Perspective { fov_y: 0.8 };
        View::look_at(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO, DVec3::Y, projection, side, side).unwrap()
    }

    fn opaque(side: u32, depth: f32) -> Option<Arc<OpaqueDepths>> {
        Some(Arc::new(OpaqueDepths::new(&view(side), vec![depth; (side * side) as usize], 1.0, 2.0)))
    }

    /// Something at this depth in the middle of the picture.
    fn at(depth: f64) -> Extent {
        let min = DVec3::new(0.0, 0.0, 10.0 - depth - 0.1);
        Extent { bounds: Bounds { min, max: min + 0.1 }, margin: 0.0 }
    }

    #[test]
    fn complete_pictures_hide_only_what_all_of_them_do() {
        let key = (1, 1);
        let mut occlusion = Occlusion::default();
        let hides = |occlusion: &Occlusion, depth: f64| {
            occlusion.occluder(&view(64), key).is_some_and(|occluder| occluder.hides(&at(depth)))
        };
        assert!(!hides(&occlusion, 9.0));
        // While pages come in, the latest picture counts.
        occlusion.drew(opaque(16, 5.0), key, false);
        assert!(hides(&occlusion, 9.0) && !hides(&occlusion, 4.0));
        occlusion.drew(opaque(16, 3.0), key, false);
        assert!(hides(&occlusion, 4.5));
        let revision = occlusion.revision;
        occlusion.drew(opaque(64, 6.0), key, true);
        assert!(occlusion.revision > revision && !hides(&occlusion, 5.0) && hides(&occlusion, 9.0));
        // A picture of fewer pixels, or one that hides more, changes nothing then.
        let revision = occlusion.revision;
        for (side, depth) in [(16, 2.0), (16, 9.0), (64, 4.0)] {
            occlusion.drew(opaque(side, depth), key, true);
        }
        assert!(occlusion.revision == revision && !hides(&occlusion, 5.0) && hides(&occlusion, 9.0));
        occlusion.drew(opaque(64, 8.0), key, true);
        assert!(!hides(&occlusion, 7.5) && hides(&occlusion, 9.5));
        // From a little aside it is the same, but for the picture's edges; from elsewhere nothing is known.
        let from = |occlusion: &Occlusion, eye: DVec3| {
            let view = View { eye, ..view(64) };
            occlusion.occluder(&view, key).is_some_and(|occluder| occluder.hides(&at(9.5)))
        };
        assert!(from(&occlusion, DVec3::new(0.2, 0.1, 10.1)) && !from(&occlusion, DVec3::new(0.0, 0.0, 1.0)));
        // Another depiction, a clear picture: nothing is known.
        assert!(occlusion.occluder(&view(64), (1, 2)).is_none());
        occlusion.drew(opaque(64, f32::INFINITY), key, true);
        assert!(occlusion.occluder(&view(64), key).is_none());
    }
}
