//! Live particles in the renderer's arena: each state has nodes of its own, and is shown once all of them are there. The states before
//! go when no picture reads them any more, and states that come faster are left out.

use super::{LiveParticles, LiveSource};
use crate::codec::clusters::NO_CLASS;
use crate::gpu::depiction::world_payloads;
use crate::gpu::{DrawItem, NodeId, NodeState, NodeUpload, ParticleScene, Payload};
use crate::mode::Plan;
use crate::mode::sample::Sample;
use crate::view::{Extent, View};
use crate::window::listed::Listed;
use crate::window::look::Look;
use crate::window::scene::{Scene, Settings};
use crate::window::state::notices::Notices;
use crate::window::statistics::{ActiveBackend, Statistics};
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::collections::VecDeque;
use std::sync::Arc;

/// States that are on their way at a time, and that are still read.
const MOST_COMING: usize = 2;
const MOST_READ: usize = 2;
/// The arena's name for what is no page of an open file.
const LIVE: u32 = u32::MAX;

/// What a copy is of.
#[derive(Clone, Debug, PartialEq)]
struct CopyKey {
    state: u64,
    depiction: u64,
    generation: u32,
    families: Vec<bool>,
}

/// A state in the arena.
struct Copy {
    /// Tells states apart, from 1.
    number: u32,
    key: CopyKey,
    nodes: Vec<(NodeId, Extent)>,
    particles: u64,
}

/// What a state's copy is made of.
type Payloads = Vec<(Payload, DVec3, Extent)>;

/// The copies of live particles in the renderer's arena.
#[derive(Resource, Default)]
pub struct LiveCopies {
    shown: Option<Copy>,
    coming: VecDeque<Copy>,
    /// States that were shown, and the last picture of each.
    read: VecDeque<(Copy, u64)>,
    task: Option<(CopyKey, Task<Payloads>)>,
    /// What there was no room for, and whether that was told.
    refused: Option<CopyKey>,
    told_full: bool,
    /// Numbers of the picture that was asked for last and of the last complete one, where one takes several frames.
    pictures: Option<[u64; 2]>,
    /// Counts copies.
    count: u32,
}

impl LiveCopies {
    /// The number of the state that is shown; 0 where none is.
    pub fn number(&self) -> u32 {
        self.shown.as_ref().map_or(0, |shown| shown.number)
    }

    /// What a view draws of the state that is shown: all of it, in every image.
    pub(in crate::window) fn listed(&self, view: &View, plan: Plan) -> Listed {
        let nodes = self.shown.as_ref().map_or(&[][..], |shown| &shown.nodes);
        let image = |offset: DVec3| {
            nodes.iter().map(move |(node, extent)| {
                let item = DrawItem {
                    node: *node,
                    table: None,
                    weight_scale: 1.0,
                    offset,
                    sample: Sample::ALL,
                    limit: NO_CLASS,
                };
                (item, extent.moved(offset))
            })
        };
        let (items, extents): (Vec<_>, Vec<_>) = view.images.offsets().flat_map(image).unzip();
        let taken = self.shown.as_ref().map_or(0, |shown| shown.particles);
        Listed { items: items.into(), extents: extents.into(), plan, taken }
    }

    /// Says how far pictures are that take several frames: the numbers of the last that was asked for and of the last complete one.
    pub(in crate::window) fn note_pictures(&mut self, pictures: Option<[u64; 2]>) {
        if self.pictures != pictures {
            self.pictures = pictures;
        }
    }

    /// Whether no picture up to this number is on its way any more.
    fn is_done_with(&self, number: u64) -> bool {
        self.pictures.is_none_or(|[_, complete]| complete > number)
    }

    /// Queues a state's nodes for upload.
    fn send(&mut self, key: CopyKey, payloads: Payloads, particles: &ParticleScene) {
        self.count = self.count.wrapping_add(1).max(1);
        let number = self.count;
        let count = payloads.iter().map(|(payload, ..)| payload.len() as u64).sum();
        let name = move |node: usize| NodeId { source: LIVE, page: number, node: node as u32 };
        let nodes = payloads.iter().enumerate().map(|(index, (_, _, extent))| (name(index), *extent)).collect();
        let uploads = payloads.into_iter().enumerate();
        particles.insert_nodes(uploads.map(|(index, (payload, min, _))| NodeUpload {
            id: name(index),
            min,
            size: 0.0,
            payload,
        }));
        self.coming.push_back(Copy { number, key, nodes, particles: count });
    }

    fn forget(&mut self, particles: &ParticleScene) {
        self.task = None;
        self.refused = None;
        let read = self.read.drain(..).map(|(copy, _)| copy);
        read.chain(self.shown.take()).chain(self.coming.drain(..)).for_each(|copy| free(&copy, particles));
    }
}

fn free(copy: &Copy, particles: &ParticleScene) {
    particles.remove_nodes(copy.nodes.iter().map(|(node, _)| *node));
}

/// Brings the present state of live particles into the arena, where an adapter draws.
pub(in crate::window) fn copy_live(
    (live, active): (Res<LiveParticles>, Res<ActiveBackend>),
    (scene, look, settings): (Option<Res<Scene>>, Option<Res<Look>>, Res<Settings>),
    particles: Res<ParticleScene>,
    mut copies: ResMut<LiveCopies>,
    mut statistics: ResMut<Statistics>,
    mut notices: ResMut<Notices>,
) {
    let copies = &mut *copies;
    let (Some(scene), Some(look)) = (scene, look) else { return };
    let (Some(source), ActiveBackend::Gpu) = (live.source(), *active) else {
        copies.forget(&particles);
        if !live.is_shown() && statistics.live.is_some() {
            statistics.live = None;
        }
        return;
    };
    if let Some((key, task)) = &mut copies.task
        && let Some(payloads) = check_ready(task)
    {
        let key = key.clone();
        copies.task = None;
        copies.send(key, payloads, &particles);
    }
    // A picture that takes several frames reads its nodes until it is complete.
    while copies.read.front().is_some_and(|(_, last)| copies.is_done_with(*last)) {
        copies.read.pop_front().into_iter().for_each(|(copy, _)| free(&copy, &particles));
    }
    if let Some(first) = copies.coming.front() {
        let states: Vec<_> = first.nodes.iter().map(|(id, _)| particles.node_state(*id)).collect();
        if states.contains(&Some(NodeState::Rejected)) {
            // Once is enough: with every state of a simulation it would come again.
            if !std::mem::replace(&mut copies.told_full, true) {
                notices.error("the graphics memory is too small for live particles (residency.gpu_budget_mib)");
            }
            copies.refused = copies.coming.pop_front().inspect(|copy| free(copy, &particles)).map(|copy| copy.key);
        } else if copies.read.len() < MOST_READ && states.iter().all(|state| *state == Some(NodeState::Resident)) {
            let next = copies.coming.pop_front();
            statistics.live = next.as_ref().map(|copy| copy.key.state);
            let last = copies.pictures.map_or(0, |[asked, _]| asked);
            let before = std::mem::replace(&mut copies.shown, next);
            copies.read.extend(before.map(|copy| (copy, last)));
        }
    }
    let key = CopyKey {
        state: live.state(),
        depiction: look.depiction_revision,
        generation: scene.generation,
        families: settings.families.clone(),
    };
    let newest = copies.task.as_ref().map(|(key, _)| key);
    let newest = newest.or(copies.coming.back().or(copies.shown.as_ref()).map(|copy| &copy.key));
    if copies.task.is_some()
        || copies.coming.len() >= MOST_COMING
        || newest == Some(&key)
        || copies.refused.as_ref().is_some_and(|refused| *refused == key)
    {
        return;
    }
    match source {
        LiveSource::Buffer(lent) => {
            let payload = Payload::Lent { buffer: lent.buffer.clone(), count: lent.count };
            copies.send(key, vec![(payload, lent.origin, lent.extent)], &particles);
        }
        LiveSource::Dataset(dataset) => {
            let (dataset, depiction) = (Arc::clone(dataset), look.depiction.clone());
            let families = scene.metadata().families.iter().zip(&settings.families);
            let shown: Vec<_> = families.filter(|(_, shown)| **shown).map(|(family, _)| family.name).collect();
            let task = AsyncComputeTaskPool::get().spawn(async move {
                let families = dataset.families.iter().filter(|family| shown.contains(&family.name));
                families.flat_map(|family| world_payloads(&depiction, family)).collect()
            });
            copies.task = Some((key, task));
        }
    }
}
