//! Particles by tiles that are blended front to back, each pixel on its own: what modes share that differ in what a particle emits and absorbs.

use super::capabilities::Capabilities;
use super::splat::constants::kernel_defs;
use super::splat::resources::whole;
use super::tiles::constants::walk_defs;
use super::tiles::pipelines::{arrange_layout, layout, queue, read, uniform, walk_layout, write};
use super::tiles::{Binding, Canvas, Drawing, TileList, TileMode};
use crate::model::Kernel;
use bevy::asset::AssetServer;
use bevy::platform::collections::HashMap;
use bevy::render::render_resource::{
    BindGroup, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId, PipelineCache,
};
use bevy::render::renderer::RenderContext;
use bevy::shader::ShaderDefVal;
use bytemuck::{Pod, Zeroable};

/// WGSL `Sorted`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SortedUniform {
    /// Rays that are as opaque end.
    pub termination: f32,
    /// Padding.
    pub unused: [u32; 3],
}

/// Shader definitions of the pass that blends.
pub fn blend_defs(kernel: Kernel, is_software: bool) -> Vec<ShaderDefVal> {
    [kernel_defs(kernel), walk_defs(is_software)].concat()
}

/// Layouts and pipelines of a mode.
pub struct BlendPipelines {
    look: BindGroupLayoutDescriptor,
    light: BindGroupLayoutDescriptor,
    arrange: CachedComputePipelineId,
    blend: HashMap<Kernel, CachedComputePipelineId>,
}

impl BlendPipelines {
    /// Has those compiled whose shader `path` looks up in a table, by a uniform of so many bytes, what each particle shows.
    pub fn new(
        (server, cache, on): (&AssetServer, &PipelineCache, &Capabilities),
        label: &'static str,
        look_bytes: usize,
        path: &'static str,
    ) -> BlendPipelines {
        let look = layout(label, vec![uniform(look_bytes, false), read()]);
        let light = layout("deepfield blend", vec![uniform(size_of::<SortedUniform>(), false), write(), write()]);
        let arrange = queue(cache, server, (path, "arrange"), vec![arrange_layout(), look.clone()], vec![]);
        let of_kernel = |kernel| {
            let layouts = vec![walk_layout(), light.clone()];
            let defs = blend_defs(kernel, on.is_software);
            (kernel, queue(cache, server, ("sorted/blend.wgsl", "blend"), layouts, defs))
        };
        let blend = Kernel::ALL.into_iter().map(of_kernel).collect();
        BlendPipelines { look, light, arrange, blend }
    }
}

/// What the passes of a camera bind.
pub struct BlendGroups {
    list: TileList,
    table: Buffer,
    arrange: BindGroup,
    blend: BindGroup,
}

impl BlendGroups {
    /// Binds a mode's uniform and table, and ends rays at this opacity; buffers are taken over from the list before.
    pub fn new<M: TileMode>(
        pipelines: &BlendPipelines,
        (look, table): (&[u8], Buffer),
        termination: f32,
        before: Option<&BlendGroups>,
        to: &Binding<'_, M>,
    ) -> BlendGroups {
        let look = to.buffer(look, BufferUsages::UNIFORM);
        let light = SortedUniform { termination, unused: [0; 3] };
        let light = to.buffer(bytemuck::bytes_of(&light), BufferUsages::UNIFORM);
        let arrange = to.group(&pipelines.look, &[&look, &table].map(whole));
        let blend = to.group(&pipelines.light, &[&light, &to.cells.buffer, to.ends].map(whole));
        let list = to.tiles(before.map(|groups| &groups.list));
        BlendGroups { list, table, arrange, blend }
    }

    /// The table that is looked up.
    pub fn table(&self) -> Buffer {
        self.table.clone()
    }

    /// Bytes of the list.
    pub fn bytes(&self) -> u64 {
        self.list.bytes()
    }

    /// Draws into the camera's pixels; `None` while pipelines are not compiled.
    pub fn draw<M: TileMode>(
        &self,
        pipelines: &BlendPipelines,
        on: &Canvas<'_, M>,
        context: &mut RenderContext,
    ) -> Option<()> {
        let get = |id| on.cache.get_compute_pipeline(id);
        let walk = get(*pipelines.blend.get(&on.particles.grids.shape.kernel)?)?;
        let arrange = get(pipelines.arrange)?;
        context.command_encoder().clear_buffer(&on.cells.buffer, 0, None);
        let drawing = Drawing {
            arrange,
            arrange_group: Some(&self.arrange),
            walk,
            walk_group: &self.blend,
            name: "blend",
            timer: on.timer,
        };
        self.list.draw(on.spots, on.particles, &on.steps, &drawing, context);
        Some(())
    }
}
