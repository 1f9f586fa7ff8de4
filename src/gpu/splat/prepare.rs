//! Prepares a view's splat passes: grids, the list of nodes and particle blocks, buffers, bind groups.
//!
//! A picture whose camera, nodes and arena are what they were is not accumulated again.

use super::compute::{self, ComputeBindings, Scratch};
use super::draw_list::DrawList;
use super::layout::{Grids, SPLAT_BYTES};
use super::overdraw::CountOverdraw;
use super::particles::{self, ParticleBatch};
use super::pipelines::SplatPipelines;
use super::raster::{self, RasterBindings};
use super::resources::at_least;
use crate::gpu::arena::Arena;
use crate::gpu::capabilities::Technique;
use crate::gpu::integrals::IntegralView;
use crate::gpu::light::LightView;
use crate::gpu::mode_view::ModeView;
use crate::gpu::view::{DrawItem, Footprint, SplatView};
use crate::gpu::volume::VolumeView;
use crate::view::View;
use bevy::prelude::*;
use bevy::render::render_resource::{Buffer, BufferUsages, PipelineCache};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What both techniques need of one view.
pub struct Shared {
    /// The picture's cells, `P` and `P S` each, in rows of [`SplatBuffers::stride`]; for compute the whole pyramid.
    pub cells: Buffer,
    /// Those of the picture before, of the same view, where that is kept.
    pub last: Option<Buffer>,
    /// The view.
    pub uniform: Buffer,
    /// The nodes.
    pub nodes: Buffer,
    /// The blocks.
    pub blocks: Buffer,
}

/// What a technique binds.
pub enum Bindings {
    /// Compute passes.
    Compute(ComputeBindings),
    /// Blended quads.
    Raster(RasterBindings),
}

impl Bindings {
    /// Those of blended quads.
    pub fn raster(&self) -> Option<&RasterBindings> {
        match self {
            Bindings::Compute(_) => None,
            Bindings::Raster(bindings) => Some(bindings),
        }
    }
}

/// What the passes of one view need; on the render world's camera.
#[derive(Component)]
pub struct SplatBuffers {
    /// The grids in use.
    pub grids: Grids,
    /// Cells from a row of the picture to the next.
    pub stride: u32,
    /// What both techniques need.
    pub shared: Shared,
    /// What the technique binds; nothing where passes of a mode draw.
    pub bindings: Option<Bindings>,
    /// The particles, for passes of a mode's own and those that count; none for the splat passes.
    pub particles: Vec<ParticleBatch>,
    /// Whether every frame accumulates.
    pub always: bool,
    /// Set once the cells hold the picture.
    pub accumulated: AtomicBool,
    key: Key,
}

#[derive(Clone, PartialEq)]
struct Key {
    view: View,
    footprint: Footprint,
    culling: bool,
    faintest: f32,
    technique: Technique,
    has_passes: bool,
    items: Arc<[DrawItem]>,
    generation: u64,
}

impl Key {
    /// Whether the same is drawn; lists are the same only if they are one.
    fn is_same(&self, other: &Key) -> bool {
        self.generation == other.generation
            && self.view == other.view
            && self.footprint == other.footprint
            && self.culling == other.culling
            && self.faintest == other.faintest
            && self.technique == other.technique
            && self.has_passes == other.has_passes
            && Arc::ptr_eq(&self.items, &other.items)
    }
}

/// Prepares every camera that draws particles.
pub fn prepare_splats(
    mut commands: Commands,
    mut cameras: Query<(
        Entity,
        &SplatView,
        Option<&ModeView>,
        (Has<LightView>, Has<CountOverdraw>, Has<IntegralView>),
        Option<&VolumeView>,
        Option<&mut SplatBuffers>,
    )>,
    arena: Res<Arena>,
    mut scratch: ResMut<Scratch>,
    pipelines: Option<ResMut<SplatPipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, view, mode, (draws_light, counts, integrates), volume, mut before) in &mut cameras {
        if volume.is_some_and(|volume| !volume.ranges_only) {
            continue;
        }
        // Whoever sets a backend asks for the adapter's capabilities before.
        let Ok(technique) = pipelines.capabilities.technique(view.backend) else { continue };
        let key = Key {
            view: view.view,
            footprint: view.footprint,
            culling: view.culling,
            faintest: view.faintest,
            technique,
            has_passes: draws_light || counts || integrates || mode.is_some_and(ModeView::has_passes),
            items: view.items.clone(),
            generation: arena.generation,
        };
        if let Some(before) = &mut before
            && before.key.is_same(&key)
        {
            // The picture is what it was, however often it is drawn.
            before.bypass_change_detection().always = view.always;
            continue;
        }
        let buffers =
            build(key, view, before.as_deref(), &arena, &mut scratch, &mut pipelines, &cache, &device, &queue);
        let Some(buffers) = buffers else { continue };
        match before {
            Some(mut before) => *before = buffers,
            None => {
                commands.entity(entity).insert(buffers);
            }
        }
    }
}

fn build(
    key: Key,
    view: &SplatView,
    before: Option<&SplatBuffers>,
    arena: &Arena,
    scratch: &mut Scratch,
    pipelines: &mut SplatPipelines,
    cache: &PipelineCache,
    device: &RenderDevice,
    queue: &RenderQueue,
) -> Option<SplatBuffers> {
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let uniforms = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    let limit = device.limits().max_storage_buffer_binding_size;
    // Passes of a mode cut the particles as they like.
    let capacity = match key.technique {
        Technique::Compute if !key.has_passes => compute::MAX_BATCH.min(limit / (SPLAT_BYTES + SPLAT_BYTES / 4)).max(1),
        _ => u32::MAX.into(),
    };
    let list = DrawList::new((view.view.eye, view.view.time), &view.items, arena, capacity as u32);
    let ellipsoids = list.ellipsoids && !key.has_passes;
    let grids = Grids::new(&view.view, view.footprint, view.culling, view.faintest, ellipsoids);
    let (stride, cells) = match key.technique {
        Technique::Compute => (view.view.width, grids.cells),
        Technique::Raster => {
            let stride = raster::stride(view.view.width);
            (stride, stride * view.view.height)
        }
    };

    let kept = |buffer: fn(&Shared) -> &Buffer| before.map(|before| buffer(&before.shared).clone());
    let uniform =
        at_least(kept(|b| &b.uniform), size_of_val(&grids.uniform) as u64, uniforms, "deepfield splat view", device);
    queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&grids.uniform));
    let node_bytes: &[u8] = bytemuck::cast_slice(&list.nodes);
    let nodes = at_least(kept(|b| &b.nodes), node_bytes.len().max(64) as u64, storage, "deepfield drawn nodes", device);
    queue.write_buffer(&nodes, 0, node_bytes);
    let block_bytes: &[u8] = bytemuck::cast_slice(&list.blocks);
    let blocks =
        at_least(kept(|b| &b.blocks), block_bytes.len().max(16) as u64, storage, "deepfield drawn blocks", device);
    queue.write_buffer(&blocks, 0, block_bytes);
    let usage = storage | BufferUsages::COPY_SRC;
    // What is kept stays where it is, and the new picture gets another place: that of the one kept before, if there is one.
    let is_kept = |before: &&SplatBuffers| {
        view.keeps_last
            && before.key.view == key.view
            && before.key.technique == key.technique
            && before.stride == stride
    };
    // The same list with particles that have moved in the arena is no other picture: what was kept stays so.
    let is_same_list = |before: &&SplatBuffers| Arc::ptr_eq(&before.key.items, &key.items);
    let (last, free) = match before.filter(is_kept) {
        Some(before) if is_same_list(&before) => (before.shared.last.clone(), Some(before.shared.cells.clone())),
        Some(before) => (Some(before.shared.cells.clone()), before.shared.last.clone()),
        None => (None, kept(|b| &b.cells)),
    };
    let cells = at_least(free, u64::from(cells) * 8, usage, "deepfield picture", device);
    let shared = Shared { cells, last, uniform, nodes, blocks };

    let particles = match key.has_passes {
        true => particles::batches(&shared, &list, arena, cache, device),
        false => Vec::new(),
    };
    let bindings = match key.technique {
        _ if key.has_passes => None,
        Technique::Compute => {
            let pipelines = pipelines.compute.as_mut()?;
            pipelines.ask_for(grids.shape, cache);
            let gpu = (device, queue);
            Some(Bindings::Compute(compute::bind(&shared, &grids, &list, scratch, arena, pipelines, cache, gpu)))
        }
        Technique::Raster => {
            let pipelines = pipelines.raster.as_mut()?;
            pipelines.ask_for(grids.shape, cache);
            let before = before.and_then(|before| before.bindings.as_ref()).and_then(Bindings::raster);
            let gpu = (device, queue);
            Some(Bindings::Raster(raster::bind(&shared, &grids, &list, before, arena, pipelines, cache, gpu)))
        }
    };
    Some(SplatBuffers {
        grids,
        stride,
        shared,
        bindings,
        particles,
        always: view.always,
        accumulated: AtomicBool::new(false),
        key,
    })
}
