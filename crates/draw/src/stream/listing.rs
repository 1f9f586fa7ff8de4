//! Views whose pages do not fit into memory together: what they draw is listed first, without particles ([`Outline`]), and then visited some
//! pages at a time, in the order of the list.
//!
//! [`Outline`]: super::outline::Outline

use super::outline::Held;
use super::{Scene, SceneNode};
use crate::model::spare_memory;
use crate::store::{NodeRef, PageId, StoreError};
use crate::view::{Detail, Drawn, Extent, View, select};
use std::collections::HashSet;

/// What a view draws, without the pages that hold it.
#[derive(Clone, Debug)]
pub struct Listing {
    /// The nodes; none is an ancestor of another.
    pub nodes: Vec<Drawn<NodeRef>>,
    /// Whether everything that the view needs at its error bound could be looked at.
    pub converged: bool,
    /// Particles in the nodes.
    pub particles: u64,
    /// Whether any of the nodes is drawn as clusters.
    pub has_clusters: bool,
    /// The view.
    view: View,
    /// Pixels from which on leaves are looked at particle by particle.
    tau: f64,
}

impl Listing {
    /// Some of its nodes.
    #[must_use]
    pub fn of_nodes(&self, nodes: Vec<Drawn<NodeRef>>) -> Listing {
        Listing { particles: nodes.iter().map(|drawn| drawn.particles).sum(), nodes, ..*self }
    }
}

/// What was found while a list was visited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visited {
    /// Whether every node was there.
    pub is_complete: bool,
    /// Largest screen-space error among them, pixels.
    pub error_pixels: f64,
}

/// Pages that are visited at a time take so much at most, bytes, and this share of the budget: others are read meanwhile. When so much has made
/// room, it is given back to the system.
const GROUP_BYTES: u64 = 64 << 20;
const GROUP_SHARE: u64 = 4;

impl Scene {
    /// Selects what a view draws in this detail, waiting for the disk: looks at every page that it needs, and holds none of them. Where even what
    /// they tell of their nodes is too much, it is selected coarser ([`Scene::take_coarser`]). What there is to tell about that is handed to `tell`, a
    /// sentence at a time.
    ///
    /// # Errors
    /// [`StoreError`] if a root page cannot be read, since then nothing can be drawn.
    pub fn list(
        &mut self,
        view: &View,
        detail: impl Into<Detail>,
        tell: &mut dyn FnMut(String),
    ) -> Result<Listing, StoreError> {
        let (view, asked) = (self.timed(view), detail.into());
        let (mut detail, mut selection) = (asked, self.outlined(&view, asked, &|_, _| false, tell)?.0);
        if self.is_full(&selection) {
            detail = self.fitted(&view, asked, Held::Outlines, tell)?;
            selection = self.outlined(&view, detail, &|_, _| false, tell)?.0;
        }
        self.is_coarser |= detail != asked;
        let has_steps = |drawn: &Drawn<NodeRef>| self.outline.has_steps(drawn.id);
        Ok(Listing {
            converged: selection.is_converged(),
            particles: selection.particles(),
            has_clusters: selection.draw.iter().any(has_steps),
            nodes: selection.draw,
            tau: detail.tolerance(&view),
            view,
        })
    }

    /// The nodes that a view draws in this detail, as far as is known from the views that were listed before.
    pub fn known(&self, view: &View, detail: impl Into<Detail>) -> Vec<Drawn<NodeRef>> {
        let view = self.timed(view);
        select(&view, detail, &self.outline, &self.roots(&view)).draw
    }

    /// What the particles of a listed node reach, where that is known without them.
    pub fn extent_of(&self, drawn: &Drawn<NodeRef>) -> Option<Extent> {
        Some(self.outline.extent(drawn.id)?.moved(drawn.offset))
    }

    /// Keeps what pages tell of their nodes, of those that are in memory: they may make room then.
    pub(super) fn look_at(&mut self, pages: impl IntoIterator<Item = PageId>) {
        for page in pages {
            if let Some(page) = self.streamer.residency.page(page) {
                self.outline.add(page);
            }
        }
        self.streamer.begin();
        self.streamer.residency.set_aside(self.outline.bytes());
    }

    /// Hands over the listed nodes with their pages, some at a time and in their order, waiting for the disk; while they are in use, the pages of
    /// those after them are read ahead, and at the end those of `next`. Nodes whose pages cannot be had are left out.
    ///
    /// # Errors
    /// The first of `each`.
    pub fn visit<E>(
        &mut self,
        listing: &Listing,
        next: &[Drawn<NodeRef>],
        tell: &mut dyn FnMut(String),
        each: &mut dyn FnMut(&[SceneNode]) -> Result<(), E>,
    ) -> Result<Visited, E> {
        let mut visited = Visited { is_complete: true, error_pixels: 0.0 };
        let mut rest = &listing.nodes[..];
        while !rest.is_empty() {
            let (group, after) = rest.split_at(self.group_of(rest));
            loop {
                self.streamer.begin();
                let is_lacking = self.streamer.hold(group.iter().map(|drawn| drawn.id));
                self.make_room();
                if !is_lacking || !self.streamer.is_busy() {
                    break;
                }
                let (_, of_roots) = self.wait(tell);
                of_roots.into_iter().for_each(|(_, message)| tell(message));
            }
            let node = |drawn: &Drawn<NodeRef>| SceneNode::of(&self.streamer, &listing.view, listing.tau, drawn);
            let nodes: Vec<SceneNode> = group.iter().filter_map(node).collect();
            visited.is_complete &= nodes.len() == group.len();
            visited.error_pixels = nodes.iter().fold(visited.error_pixels, |most, node| most.max(node.error_pixels));
            self.streamer.read_ahead(after.iter().chain(next).map(|drawn| drawn.id));
            self.make_room();
            each(&nodes)?;
            rest = after;
        }
        Ok(visited)
    }

    /// Begins to read what is missing, in the place of pages that are freed before it comes.
    pub(super) fn make_room(&mut self) {
        self.streamer.serve();
        self.freed_bytes += self.streamer.free_evicted();
        if self.freed_bytes >= GROUP_BYTES {
            self.freed_bytes = 0;
            spare_memory::give_back();
        }
    }

    /// How many of these nodes are visited together: one at least.
    fn group_of(&self, nodes: &[Drawn<NodeRef>]) -> usize {
        let residency = &self.streamer.residency;
        let most = GROUP_BYTES.min(residency.statistics().budget_bytes / GROUP_SHARE);
        let (mut pages, mut bytes) = (HashSet::new(), 0);
        let fits = |drawn: &&Drawn<NodeRef>| {
            if pages.insert(drawn.id.page) {
                bytes += residency.tree().page_memory(drawn.id.page);
            }
            bytes <= most
        };
        nodes.iter().take_while(fits).count().max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{self, BuildOptions};
    use crate::hierarchy::OctreeOptions;
    use crate::store::PageFile;
    use crate::synth::merger::Merger;
    use crate::view::Projection;
    use glam::DVec3;
    use std::sync::Arc;

    #[test]
    fn what_is_known_of_pages_takes_no_more_than_there_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("merger.df");
        let octree = OctreeOptions { leaf_capacity: 40, ..OctreeOptions::default() };
        let options = BuildOptions { octree, page_bytes: 4 << 10, ..BuildOptions::default() };
        build::build(crate::synth::dataset(&Merger::new(3, 20_000)), &options, &path, &()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        let (middle, size) = (file.metadata().bounds().center(), file.metadata().bounds().size().max_element());
        let projection = Projection::Orthographic { height: 1.2 * size };
        let view = View::look_at(middle + 2.0 * size * DVec3::Z, middle, DVec3::Y, projection, 64, 64).unwrap();
        let mut whole = Scene::new(Arc::clone(&file), u64::MAX);
        let all = whole.list(&view, 0.0, &mut |_| {}).unwrap();
        assert!(all.converged && !whole.take_coarser());
        // Less than what all pages tell.
        let budget = whole.outline.bytes() / 4 * 3;
        let mut scene = Scene::new(Arc::clone(&file), budget);
        let (selection, _) = scene.outlined(&view, Detail::from(0.0), &|_, _| false, &mut |_| {}).unwrap();
        let known = scene.outline.bytes();
        assert!(!selection.is_converged() && known <= budget, "{known} bytes of {budget}");
        let listing = scene.list(&view, 0.0, &mut |_| {}).unwrap();
        let (known, nodes) = (scene.outline.bytes(), listing.nodes.len());
        assert!(scene.take_coarser() && known <= budget / 2, "{known} bytes of {budget}");
        assert!(nodes > 0 && nodes < all.nodes.len(), "{nodes} nodes of {}", all.nodes.len());
        // Nor does it take from pages for which there is just enough.
        let bytes = (0..file.page_count()).map(|page| file.page_memory(PageId(page))).sum();
        let mut scene = Scene::new(file, bytes);
        scene.list(&view, 0.0, &mut |_| {}).unwrap();
        scene.take_coarser();
        assert!(scene.outline.bytes() > 0);
        assert!(scene.converge_blocking(&view, 0.0).unwrap().converged && !scene.take_coarser());
    }
}
