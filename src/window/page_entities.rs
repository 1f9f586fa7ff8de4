//! What page entities say: which page each is, where it stands, and whether anything of it shows.
//!
//! A page comes, is copied for the adapter where that draws, and goes: each step is an event of the log (`RUST_LOG=deepfield=debug`),
//! and how many pages stand where is in [`Statistics`].

use super::statistics::{PageCounts, Statistics};
use crate::model::Bounds;
use crate::store::{Page, PageId};
use crate::view::Extent;
use bevy::prelude::*;
use std::sync::Arc;

/// Which page an entity is.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PageKey {
    /// Number of the page in its file.
    pub id: PageId,
    /// The [`super::scene::Scene::generation`] of the file.
    pub generation: u32,
}

/// Where a page stands on its way into memory.
#[derive(Component, Clone, Debug)]
pub enum PageStatus {
    /// It is being read.
    Loading,
    /// In memory.
    Resident(Arc<Page>),
    /// It cannot be read; the text says why.
    Failed(String),
}

/// The box around a resident page's nodes, and how far their particles reach.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct PageExtent(pub Extent);

impl PageExtent {
    /// That of a page.
    pub fn of(page: &Page) -> PageExtent {
        let bounds = page.nodes.iter().fold(Bounds::EMPTY, |bounds, node| bounds.union(node.bounds));
        let margin = page.nodes.iter().fold(0.0, |most: f32, node| most.max(node.smoothing_length_max));
        PageExtent(Extent { bounds, margin: f64::from(margin) })
    }
}

/// Where a renderer's copy of a page stands; only while a renderer keeps copies.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuSlot {
    /// On its way.
    Queued,
    /// There: the page may be drawn.
    Resident,
}

/// Whether the renderer draws from copies of pages; if not, it draws from main memory and every resident page counts.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageCopies(pub bool);

/// Whether anything of a resident page shows.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PageOcclusion {
    /// Something does, or may.
    #[default]
    Seen,
    /// All of its nodes are behind something, from wherever the camera may be until something has been read.
    Hidden,
}

/// Where a page stands, all in all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    Reading,
    InMemory,
    Copying,
    Drawable,
    Failed,
}

impl Standing {
    fn of(status: &PageStatus, slot: Option<&GpuSlot>, copies: PageCopies) -> Standing {
        match (status, slot) {
            (PageStatus::Loading, _) => Standing::Reading,
            (PageStatus::Failed(_), _) => Standing::Failed,
            (PageStatus::Resident(_), Some(GpuSlot::Queued)) => Standing::Copying,
            (PageStatus::Resident(_), None) if copies.0 => Standing::InMemory,
            (PageStatus::Resident(_), _) => Standing::Drawable,
        }
    }
}

/// Counts the pages, and tells which of them stand elsewhere than before.
pub(super) fn tell_standings(
    pages: Query<(&PageKey, Ref<PageStatus>, Option<Ref<GpuSlot>>, &PageOcclusion)>,
    copies: Res<PageCopies>,
    mut statistics: ResMut<Statistics>,
) {
    let mut counts = PageCounts::default();
    for (key, status, slot, occlusion) in &pages {
        let standing = Standing::of(&status, slot.as_deref(), *copies);
        *match standing {
            Standing::Reading => &mut counts.reading,
            Standing::InMemory => &mut counts.in_memory,
            Standing::Copying => &mut counts.copying,
            Standing::Drawable => &mut counts.drawable,
            Standing::Failed => &mut counts.failed,
        } += 1;
        counts.hidden += usize::from(*occlusion == PageOcclusion::Hidden);
        if status.is_changed() || slot.is_some_and(|slot| slot.is_changed()) {
            debug!(page = key.id.0, ?standing);
        }
    }
    statistics.pages = counts;
}

/// Tells that a page's memory is given back.
pub(super) fn tell_evicted(removed: On<Remove, PageKey>, pages: Query<&PageKey>) {
    if let Ok(key) = pages.get(removed.entity) {
        debug!(page = key.id.0, standing = "Evicted");
    }
}
