//! What the picture hides of the file (F12 5.7.2): volumes that have been drawn hide nodes, and nothing below those is read.
//!
//! Every picture says at which depth its pixels became opaque. Traversal leaves the nodes behind as they are
//! ([`Occlusion::occluder`]), and page entities say whether all that was looked at in them is hidden ([`PageOcclusion`]). A
//! picture that was drawn before everything had come may hide too much: then the next one says so, and what it shows is asked
//! for. Pictures of complete selections hide together only what each of them does, so that this comes to an end.

use crate::cpu::volume::OpaqueDepths;
use crate::store::{NodeRef, PageId};
use crate::view::{Occluder, Selection, View};
use bevy::prelude::*;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Whether anything of a page shows.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PageOcclusion {
    /// Something does, or may.
    #[default]
    Seen,
    /// All of its nodes that were looked at are behind something.
    Hidden,
}

/// What the pictures of the present view hide.
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
    /// A picture was drawn, with what it hides, of a selection that was complete or not.
    pub fn drew(&mut self, opaque: Option<Arc<OpaqueDepths>>, key: (u32, u64), complete: bool) {
        let Some(new) = opaque.filter(|opaque| !opaque.is_clear()) else {
            if self.current.is_some() {
                *self = Occlusion { key, revision: self.revision + 1, ..default() };
            }
            return;
        };
        let same = |old: &Arc<OpaqueDepths>| is_same_camera(old.view(), new.view());
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
        let current = self.current.as_ref().filter(|_| self.key == key)?;
        is_same_camera(current.view(), view).then(|| Arc::clone(current) as Arc<dyn Occluder>)
    }
}

/// Whether two views are one but for their pixels.
fn is_same_camera(a: &View, b: &View) -> bool {
    View { width: b.width, height: b.height, ..*a } == *b
}

/// The pages of the nodes that were looked at, and whether all of those are hidden.
pub fn of_pages(selection: &Selection<NodeRef>) -> HashMap<PageId, PageOcclusion> {
    let hidden: HashSet<NodeRef> = selection.hidden.iter().copied().collect();
    let mut pages = HashMap::new();
    for id in &selection.visited {
        let own = if hidden.contains(id) { PageOcclusion::Hidden } else { PageOcclusion::Seen };
        let page = pages.entry(id.page).or_insert(own);
        if own == PageOcclusion::Seen {
            *page = own;
        }
    }
    pages
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
        // Another depiction, another camera, a clear picture: nothing is known.
        assert!(occlusion.occluder(&view(64), (1, 2)).is_none());
        assert!(occlusion.occluder(&View { eye: DVec3::ONE, ..view(64) }, key).is_none());
        occlusion.drew(opaque(64, f32::INFINITY), key, true);
        assert!(occlusion.occluder(&view(64), key).is_none());
    }

    #[test]
    fn a_page_is_hidden_if_all_that_was_looked_at_in_it_is() {
        let node = |page: u32, node: u32| NodeRef { page: PageId(page), node };
        let selection = Selection {
            draw: Vec::new(),
            missing: Vec::new(),
            visited: vec![node(0, 0), node(1, 0), node(1, 1), node(2, 0), node(2, 1)],
            hidden: vec![node(1, 0), node(2, 0), node(2, 1)],
        };
        let pages = of_pages(&selection);
        let found = [0, 1, 2].map(|page| pages[&PageId(page)]);
        assert_eq!(found, [PageOcclusion::Seen, PageOcclusion::Seen, PageOcclusion::Hidden]);
    }
}
