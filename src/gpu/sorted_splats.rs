//! Order-dependent splatting (F12 5.9) on the adapter: particles by tiles, classified each on its own and blended front to back
//! for each pixel, as [`crate::cpu::sorted`] does, which its pictures are held against.

use super::capabilities::Capabilities;
use super::matter::{LookupUniform, table};
use super::splat::constants::kernel_defs;
use super::splat::layout::Grids;
use super::splat::resources::whole;
use super::tiles::constants::walk_defs;
use super::tiles::pipelines::{arrange_layout, layout, queue, read, uniform, walk_layout, write};
use super::tiles::spots::listed_within;
use super::tiles::{Binding, Canvas, Drawing, TileList, TileMode, TileRequest};
use crate::cpu::volume::{Classifier, OpaqueDepths};
use crate::model::Kernel;
use crate::view::View;
use bevy::asset::AssetServer;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId, PipelineCache,
};
use bevy::render::renderer::RenderContext;
use bevy::shader::ShaderDefVal;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// A camera's particles are blended in the order of their depth. Their table tells densities. The view's footprint is the kernel.
#[derive(Clone, Debug)]
pub struct SortedSplats {
    /// What densities and attributes emit and absorb.
    pub classifier: Arc<Classifier>,
    /// Depths of the first and the last particle that is drawn.
    pub planes: [f64; 2],
    /// Rays end at this opacity.
    pub termination: f32,
    /// Least smoothing length, pixels: smaller particles are enlarged to it, with their mass.
    pub smallest: f64,
    /// Factor on the particles' own densities.
    pub density_scale: f32,
}

impl PartialEq for SortedSplats {
    fn eq(&self, other: &SortedSplats) -> bool {
        Arc::ptr_eq(&self.classifier, &other.classifier)
            && self.planes == other.planes
            && self.termination == other.termination
            && self.smallest == other.smallest
            && self.density_scale == other.density_scale
    }
}

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

/// Layouts and pipelines.
#[derive(Resource)]
pub struct SortedPipelines {
    lookup: BindGroupLayoutDescriptor,
    light: BindGroupLayoutDescriptor,
    arrange: CachedComputePipelineId,
    blend: HashMap<Kernel, CachedComputePipelineId>,
}

/// What the passes of a camera bind.
pub struct SortedGroups {
    list: TileList,
    table: Buffer,
    arrange: BindGroup,
    blend: BindGroup,
}

impl TileMode for SortedSplats {
    type Pipelines = SortedPipelines;
    type Bound = SortedGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> SortedPipelines {
        let lookup = layout("deepfield matter", vec![uniform(size_of::<LookupUniform>(), false), read()]);
        let light = layout("deepfield blend", vec![uniform(size_of::<SortedUniform>(), false), write(), write()]);
        let arrange_layouts = vec![arrange_layout(), lookup.clone()];
        let arrange = queue(cache, server, ("sorted/arrange.wgsl", "arrange"), arrange_layouts, vec![]);
        let of_kernel = |kernel| {
            let layouts = vec![walk_layout(), light.clone()];
            let defs = blend_defs(kernel, on.is_software);
            (kernel, queue(cache, server, ("sorted/blend.wgsl", "blend"), layouts, defs))
        };
        let blend = Kernel::ALL.into_iter().map(of_kernel).collect();
        SortedPipelines { lookup, light, arrange, blend }
    }

    fn request(&self, _: &View, _: &Grids, memory: u64) -> TileRequest {
        TileRequest {
            planes: self.planes,
            least: self.classifier.least(),
            density_scale: self.density_scale,
            extent: 1.0,
            lead: 0.0,
            smallest: self.smallest,
            layers: None,
            over: None,
            at_a_time: listed_within(memory, TileList::SPOT_BYTES),
        }
    }

    fn bind(&self, before: Option<(&Self, &SortedGroups)>, to: &Binding<'_, Self>) -> SortedGroups {
        let table = match before {
            Some((before, groups)) if Arc::ptr_eq(&before.classifier, &self.classifier) => groups.table.clone(),
            _ => to.buffer(bytemuck::cast_slice(&table(&self.classifier)), BufferUsages::STORAGE),
        };
        let lookup = to.buffer(bytemuck::bytes_of(&LookupUniform::new(&self.classifier)), BufferUsages::UNIFORM);
        let light = SortedUniform { termination: self.termination, unused: [0; 3] };
        let light = to.buffer(bytemuck::bytes_of(&light), BufferUsages::UNIFORM);
        let arrange = to.group(&to.pipelines.lookup, &[lookup.as_entire_binding(), table.as_entire_binding()]);
        let blend = to.group(&to.pipelines.light, &[&light, &to.cells.buffer, to.ends].map(whole));
        let list = to.tiles(before.map(|(_, groups)| &groups.list));
        SortedGroups { list, table, arrange, blend }
    }

    fn bytes(bound: &SortedGroups) -> u64 {
        bound.list.bytes()
    }

    fn draw(&self, bound: &SortedGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        let get = |id| on.cache.get_compute_pipeline(id);
        let walk = get(*on.pipelines.blend.get(&on.particles.grids.shape.kernel)?)?;
        let arrange = get(on.pipelines.arrange)?;
        context.command_encoder().clear_buffer(&on.cells.buffer, 0, None);
        let drawing = Drawing {
            arrange,
            arrange_group: Some(&bound.arrange),
            walk,
            walk_group: &bound.blend,
            name: "blend",
            timer: on.timer,
        };
        bound.list.draw(on.spots, on.particles, &on.steps, &drawing, context);
        Some(())
    }
    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths {
        let depths = ends.iter().map(|&end| if end == 0.0 { f32::INFINITY } else { end });
        OpaqueDepths::new(view, depths.collect(), 1.0, self.smallest)
    }
}
