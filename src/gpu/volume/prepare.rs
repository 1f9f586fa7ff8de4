//! Follows what the main world wants drawn: begins pictures, says which of their slabs a frame draws, and takes in what is complete.

use super::bindings::EFFORT;
use super::programs::VolumePipelines;
use super::room::Room;
use super::store::{Held, Store};
use super::view::{Shows, VolumeJob, VolumeNews, VolumeView};
use super::work::{Means, Work};
use crate::cpu::volume::range::{CLASSES, Histogram};
use crate::cpu::volume::{FieldRange, OpaqueDepths, raycast};
use crate::gpu::answer::Answer;
use crate::gpu::arena::Arena;
use crate::gpu::light::LightCells;
use crate::gpu::splat::{SplatBuffers, SplatPipelines};
use crate::gpu::view::SplatView;
use bevy::prelude::*;
use bevy::render::render_resource::PipelineCache;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::tasks::block_on;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::Poll;
use std::time::{Duration, Instant};
use wgpu::ErrorFilter;

/// After this time it is tried again whether there is as much memory as wanted.
const PATIENCE: Duration = Duration::from_secs(10);

/// The volumes of one camera that are on their way (render world).
#[derive(Component, Default)]
pub struct VolumeWork {
    store: Store,
    light: Option<Work>,
    ranges: Option<Work>,
    planned: [Range<usize>; 2],
    /// What complete ones have to say.
    answers: Vec<(VolumeJob, Answer)>,
    /// Memory that was there when there was less than wanted, and when that was found out.
    lowered: Option<(u64, Instant)>,
    /// A job that did not fit at all, and when.
    refused: Option<(u64, Instant)>,
}

impl VolumeWork {
    /// Where the surface of each pixel of the picture lies, and its colour, where that keeps one.
    pub(super) fn faces(&self) -> Option<&[Held; 2]> {
        let light = self.light.as_ref().filter(|light| light.variant.keeps_faces())?;
        Some(&light.buffers.faces)
    }

    /// What the frame draws: pictures, and their slabs.
    pub fn planned(&self) -> impl Iterator<Item = (&Work, &Range<usize>)> {
        let work = [&self.ranges, &self.light].into_iter().zip(&self.planned);
        work.filter_map(|(work, planned)| Some((work.as_ref()?, planned))).filter(|(_, planned)| !planned.is_empty())
    }
}

/// Prepares every camera that draws a volume.
pub fn prepare_volumes(
    mut commands: Commands,
    mut cameras: Query<(
        Entity,
        Option<(&VolumeView, &SplatView)>,
        Option<&mut VolumeWork>,
        Option<&mut LightCells>,
        Has<SplatBuffers>,
    )>,
    arena: Res<Arena>,
    pipelines: Option<ResMut<VolumePipelines>>,
    cache: Res<PipelineCache>,
    (device, queue): (Res<RenderDevice>, Res<RenderQueue>),
    news: Res<VolumeNews>,
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, wanted, work, cells, has_splats) in &mut cameras {
        let Some((shown, list)) = wanted else { continue };
        if has_splats && !shown.ranges_only {
            commands.entity(entity).remove::<SplatBuffers>();
        }
        let Some(mut work) = work else {
            commands.entity(entity).insert(VolumeWork::default());
            continue;
        };
        let means = Means { arena: &arena, device: &device, queue: &queue, cache: &cache, vectors: pipelines.vectors };
        let work = &mut *work;
        work.take_in(&news);
        // A picture that is on its way is completed: a camera that moves in every frame would see none else.
        if work.light.as_mut().is_some_and(|light| !light.is_complete() && !light.is_intact(&list.view, &arena)) {
            work.light = None;
        }
        if shown.light.is_none() {
            let had_light = work.light.take().is_some();
            if had_light {
                // Ranges need less.
                work.store.clear();
            }
            if cells.is_some() && (had_light || !shown.ranges_only) {
                commands.entity(entity).remove::<LightCells>();
            }
        }
        let begun = [(0, &shown.ranges), (1, &shown.light)].map(|(index, job)| {
            let Some(job) = job else { return false };
            work.follow(index, job, shown, list, &means, &news)
        });
        if let Some(mut cells) = cells
            && begun[1]
        {
            cells.complete = false;
        }
        if begun.contains(&true) {
            for work in [&work.ranges, &work.light].into_iter().flatten() {
                pipelines.ask_for(work.variant, &cache);
            }
        }
        let plan = |work: &Option<Work>| {
            let Some(work) = work else { return 0..0 };
            let done = work.done.load(Ordering::Relaxed);
            done..work.slabs.len().min(done + shown.slabs.max(1) as usize)
        };
        work.planned = [plan(&work.ranges), plan(&work.light)];
        if !work.planned[0].is_empty() {
            // The picture has to wait for its colours, and for the buffers that both use.
            work.planned[1] = 0..0;
        }
        let mut news = news.lock();
        news.bytes = work.store.bytes();
        if let Some(light) = &work.light {
            news.slabs = [light.done.load(Ordering::Relaxed), light.slabs.len()];
            if light.is_complete() {
                let buffer = light.target.clone();
                let view = light.job.seen_from();
                let size = [view.width, view.height];
                if let Some(buffer) = buffer {
                    commands.entity(entity).insert(LightCells { buffer, size, complete: true });
                }
            }
        }
    }
}

impl VolumeWork {
    /// Notes what is complete, and takes in what has been read back.
    fn take_in(&mut self, news: &VolumeNews) {
        for work in [&mut self.ranges, &mut self.light].into_iter().flatten().filter(|work| work.is_complete()) {
            if let Some(answer) = work.answer.take() {
                answer.copied();
                self.answers.push((work.job.clone(), answer));
            }
        }
        self.answers.retain(|(job, answer)| {
            let Poll::Ready(bytes) = answer.take() else { return true };
            let number = job.number;
            let mut news = news.lock();
            match job.shows {
                Shows::Ranges => news.ranges = Some((number, bytes.and_then(|bytes| range_of(&bytes)))),
                Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Field(_) => {
                    let (effort, ends) =
                        bytes.as_deref().unwrap_or_default().split_at_checked(EFFORT as usize).unwrap_or_default();
                    let (numbers, _) = effort.as_chunks::<4>();
                    if let [pairs, bricks, raised] = numbers {
                        [news.pairs, news.bricks, news.raised] =
                            [pairs, bricks, raised].map(|number| u32::from_le_bytes(*number).into());
                    }
                    let opaque = (!ends.is_empty()).then(|| (number, Arc::new(opaque_of(job, ends))));
                    (news.opaque, news.drawn) = (opaque, Some(number));
                }
            }
            false
        });
    }

    /// Begins a job if it is another one than before; whether it did.
    fn follow(
        &mut self,
        index: usize,
        job: &VolumeJob,
        shown: &VolumeView,
        list: &SplatView,
        means: &Means<'_>,
        news: &VolumeNews,
    ) -> bool {
        let known = if index == 0 { &mut self.ranges } else { &mut self.light };
        if let Some(known) = known {
            let same = known.is_current(job, &list.view, &list.items, means.arena);
            if same || !known.is_complete() {
                return false;
            }
        }
        let recent = |since: &Instant| since.elapsed() < PATIENCE;
        if self.refused.as_ref().is_some_and(|(number, since)| *number == job.number && recent(since)) {
            return false;
        }
        if self.lowered.as_ref().is_some_and(|(_, since)| !recent(since)) {
            self.lowered = None;
        }
        let limits = means.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let mut memory = self.lowered.map_or(shown.memory, |(bytes, _)| bytes.min(shown.memory)).max(Room::LEAST);
        let held = known.as_mut().and_then(|known| {
            let holds = known.holds_grid_of(job, shown.attribute, &list.items, means.arena);
            holds.then(|| known.buffers.of_grid())
        });
        *known = None;
        loop {
            // A sixteenth is for uniforms and lists of bins.
            let free = (memory - memory / 16).saturating_sub(Room::of_pixels(job));
            let room = match job.shows {
                // Beside the half that a picture's cells may take, and the third that particles may, which both share.
                Shows::Ranges => Room::of(free, job.options.memory.min(free / 6), limit),
                Shows::Light(_) | Shows::Columns(_) => Room::of(free, job.options.memory, limit),
                Shows::Cartesian(_) => Room::of_whole(free, limit),
                Shows::Field(_) => Room::beside_samples(free, job.options.memory, limit),
            };
            let scope = means.device.wgpu_device().push_error_scope(ErrorFilter::OutOfMemory);
            let begun = Work::begin(job, shown, (job.camera(&list.view), &list.items), &room, &mut self.store, means);
            let is_full = block_on(scope.pop()).is_some();
            match begun {
                Some(mut work) if !is_full => {
                    // If not, one of them had to be made anew.
                    if held == Some(work.buffers.of_grid()) {
                        work.keep_grid();
                    }
                    let mut news = news.lock();
                    news.thinner = self.lowered.is_some();
                    news.coarser = work.coarser.map(|by| (job.number, by));
                    *known = Some(work);
                    return true;
                }
                Some(_) if memory / 2 >= Room::LEAST => {
                    memory /= 2;
                    self.store.clear();
                    self.lowered = Some((memory, Instant::now()));
                }
                _ => {
                    self.store.clear();
                    self.refused = Some((job.number, Instant::now()));
                    let mut news = news.lock();
                    news.most_cells = job.cartesian().map(|picture| picture.most_cells(shown.attribute, room.cells));
                    news.no_room = Some(job.number);
                    return false;
                }
            }
        }
    }
}

impl Work {
    /// Whether all of its slabs have been drawn.
    pub fn is_complete(&self) -> bool {
        self.done.load(Ordering::Relaxed) == self.slabs.len()
    }
}

/// Asks for what complete pictures have to say.
pub fn ask_for_answers(cameras: Query<&VolumeWork>) {
    cameras.iter().flat_map(|work| &work.answers).for_each(|(_, answer)| answer.ask());
}

/// The ranges of a field by the masses of its classes; `None` where there is no mass.
fn range_of(bytes: &[u8]) -> Option<FieldRange> {
    let (words, _) = bytes.as_chunks::<4>();
    let masses: Vec<f64> = words.iter().map(|word| f64::from(f32::from_le_bytes(*word))).collect();
    let (densities, attributes) = masses.split_at_checked(CLASSES)?;
    FieldRange::of(&Histogram(densities.to_vec()), &Histogram(attributes.to_vec())).ok()
}

/// What a picture hides, by the steps in which its rays ended: shares of a cell, below 1, are those of rays that go on.
fn opaque_of(job: &VolumeJob, bytes: &[u8]) -> OpaqueDepths {
    let behind = raycast::depths_behind(&job.grid);
    let (words, _) = bytes.as_chunks::<4>();
    let depth = |word: &[u8; 4]| {
        let end = f32::from_le_bytes(*word);
        let known = behind.get(end as usize).copied().filter(|_| end >= 1.0);
        known.unwrap_or(f32::INFINITY)
    };
    OpaqueDepths::new(&job.view, words.iter().map(depth).collect(), job.grid.cell, job.options.smallest)
}

/// Creates the pipelines at start-up, and again after a lost device.
pub fn init_volume_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    splats: Option<Res<SplatPipelines>>,
    cameras: Query<Entity, With<VolumeWork>>,
) {
    let Some(splats) = splats else { return };
    cameras.iter().for_each(|camera| {
        commands.entity(camera).remove::<(VolumeWork, LightCells)>();
    });
    if splats.capabilities.compute {
        commands.insert_resource(VolumePipelines::new(&server, splats.capabilities.vector_subgroups));
    }
}
