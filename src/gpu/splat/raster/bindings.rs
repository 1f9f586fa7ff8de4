//! Textures and bind groups of the blended quads of one view.

use super::pipeline::RasterPipelines;
use crate::gpu::arena::Arena;
use crate::gpu::splat::draw_list::DrawList;
use crate::gpu::splat::layout::{Grids, Pass};
use crate::gpu::splat::prepare::Shared;
use crate::gpu::splat::resources::{ALIGNMENT, at_least, pairs, slice};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, Buffer, BufferUsages, PipelineCache, Texture, TextureView, TextureViewDescriptor,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

/// A texture and its view.
#[derive(Clone)]
pub struct Target {
    /// The texture.
    pub texture: Texture,
    /// All of it.
    pub view: TextureView,
}

impl Target {
    fn new(size: [u32; 2], label: &'static str, device: &RenderDevice) -> Target {
        let texture = pairs(size, label, device);
        let view = texture.create_view(&TextureViewDescriptor::default());
        Target { texture, view }
    }
}

/// How one level becomes complete.
#[derive(Clone)]
pub struct Upsampling {
    /// As wide as the level, as high as the next coarser one.
    pub along_x: Target,
    /// The complete level.
    pub along_y: Target,
}

/// What the passes of one view bind.
pub struct RasterBindings {
    /// The levels' splats.
    pub atlas: Target,
    /// For each chunk: bindings of `blend`, and for each block its instances.
    pub chunks: Vec<(BindGroup, Vec<Range<u32>>)>,
    /// For each level but the last, finest first.
    pub levels: Vec<Upsampling>,
    /// Bindings of `upsample` along x and along y, for each of `levels`.
    pub upsample: Vec<[BindGroup; 2]>,
    passes: Buffer,
    size: [u32; 2],
}

/// Binds what the passes of a view need.
pub fn bind(
    shared: &Shared,
    grids: &Grids,
    list: &DrawList,
    before: Option<&RasterBindings>,
    arena: &Arena,
    pipelines: &RasterPipelines,
    cache: &PipelineCache,
    (device, queue): (&RenderDevice, &RenderQueue),
) -> RasterBindings {
    let levels = &grids.uniform.levels[..grids.uniform.level_count as usize];
    let pass_size = size_of::<Pass>() as u64;
    let same = before.filter(|before| before.size == grids.uniform.size && before.levels.len() + 1 == levels.len());
    let (atlas, targets, passes) = match same {
        Some(before) => (before.atlas.clone(), before.levels.clone(), before.passes.clone()),
        None => {
            let targets = levels.windows(2).map(|pair| Upsampling {
                along_x: Target::new([pair[0].width, pair[1].height], "deepfield level along x", device),
                along_y: Target::new([pair[0].width, pair[0].height], "deepfield level", device),
            });
            let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
            let bytes = levels.len() as u64 * ALIGNMENT;
            let passes = at_least(None, bytes, usage, "deepfield upsampling passes", device);
            (Target::new(grids.uniform.atlas, "deepfield atlas", device), targets.collect(), passes)
        }
    };
    let upsample = targets.iter().enumerate().map(|(index, target)| {
        // The coarsest level has nothing to be added: it is complete in the atlas.
        let (source, corner) = match targets.get(index + 1) {
            Some(coarser) => (&coarser.along_y, [0, 0]),
            None => (&atlas, [levels[0].width, levels[index + 1].atlas_row]),
        };
        let pass = Pass { level: index as u32 + 1, source: corner, ..Pass::default() };
        queue.write_buffer(&passes, index as u64 * ALIGNMENT, bytemuck::bytes_of(&pass));
        [source, &target.along_x].map(|source| {
            device.create_bind_group(
                "deepfield upsample",
                &cache.get_bind_group_layout(&pipelines.upsample_layout),
                &BindGroupEntries::sequential((
                    shared.uniform.as_entire_binding(),
                    slice(&passes, index as u64 * ALIGNMENT, pass_size),
                    &source.view,
                    &atlas.view,
                )),
            )
        })
    });
    let upsample = upsample.collect();
    let tables = arena.table_buffer().unwrap_or(&shared.nodes);
    let ranges = list.batches.iter().flat_map(|batch| &batch.ranges);
    let chunks = ranges.map(|range| {
        let (offset, bytes) = range.bytes();
        let group = device.create_bind_group(
            "deepfield blend",
            &cache.get_bind_group_layout(&pipelines.blend_layout),
            &BindGroupEntries::sequential((
                shared.uniform.as_entire_binding(),
                shared.nodes.as_entire_binding(),
                slice(&shared.blocks, offset, bytes),
                arena.chunk(range.chunk).as_entire_binding(),
                arena.chunk(range.chunk).as_entire_binding(),
                tables.as_entire_binding(),
            )),
        );
        (group, list.instances(range))
    });
    RasterBindings { chunks: chunks.collect(), atlas, levels: targets, upsample, passes, size: grids.uniform.size }
}
