//! Layered splatting (F12 5.10) on the adapter, as [`crate::cpu::layered`] does, which its pictures are held against.
//!
//! For each slab of layers, front to back:
//!
//! 1. [`SpotList`](super::tiles::SpotList) lists its particles, once for each layer that they reach.
//! 2. `count`, a sum, `place`: the splats of what lies in each layer, in the order of layers and bins.
//! 3. For each group of layers: their pyramids are summed and brought to the finest level, by the passes that sum splats
//!    ([`super::splat::compute::sums`]); `blend` classifies each pixel's layers and blends them.

mod sums;

pub use sums::{LayerGroup, LayerSums};

use super::capabilities::Capabilities;
use super::matter::{LookupUniform, table};
use super::splat::compute::sums::SumPipelines;
use super::splat::layout::{Grids, Shape, SplatUniform};
use super::splat::resources::whole;
use super::tiles::pipelines::{layout, queue, read, tile_view, uniform, write};
use super::tiles::{Binding, Canvas, Layering, TileMode, TileRequest};
use crate::cpu::layered::caps::Caps;
use crate::cpu::layered::{Assignment, layers_between, opaque};
use crate::cpu::volume::{Classifier, OpaqueDepths};
use crate::model::Kernel;
use crate::view::{Projection, View};
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId, ComputePassDescriptor,
    PipelineCache, ShaderStages,
};
use bevy::render::renderer::RenderContext;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// A camera's particles are drawn in layers. Their weight is mass, and the view's footprint is the kernel.
#[derive(Clone, Debug)]
pub struct Layered {
    /// What densities and attributes emit and absorb.
    pub classifier: Arc<Classifier>,
    /// Depths where the first layer begins and the last one ends.
    pub planes: [f64; 2],
    /// Number of layers.
    pub layers: u32,
    /// Which layers a particle counts in.
    pub assignment: Assignment,
    /// Rays end at this opacity.
    pub termination: f32,
    /// Least smoothing length, pixels: smaller particles are enlarged to it, with their mass.
    pub smallest: f64,
    /// No particle has a longer smoothing length, world units.
    pub longest: f64,
}

impl PartialEq for Layered {
    fn eq(&self, other: &Layered) -> bool {
        Arc::ptr_eq(&self.classifier, &other.classifier)
            && self.planes == other.planes
            && self.layers == other.layers
            && self.assignment == other.assignment
            && self.termination == other.termination
            && self.smallest == other.smallest
            && self.longest == other.longest
    }
}

impl Layered {
    /// The most layers that a particle reaches, if it counts in each: those at the near plane in perspective.
    fn spread(&self, view: &View) -> Option<u32> {
        if self.assignment == Assignment::Nearest {
            return None;
        }
        let [near, far] = self.planes;
        let enlarged = self.smallest / view.focal_pixels();
        let share = match view.projection {
            Projection::Perspective { .. } => {
                let h = self.longest.max(enlarged * far);
                (1.0 + 2.0 * h / near).ln() / (far / near).ln()
            }
            Projection::Orthographic { .. } => 2.0 * self.longest.max(enlarged) / (far - near),
        };
        // Both ends may lie within a layer, and rounding may make it one more.
        Some(((share * f64::from(self.layers)).ceil() as u32).saturating_add(2).min(self.layers))
    }
}

/// WGSL `LayerView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LayerUniform {
    /// Rays that are as opaque end.
    pub termination: f32,
    /// Densities up to this show nothing.
    pub least: f32,
    /// Padding.
    pub unused: [f32; 2],
}

/// Where passes bind what says which layers they are at: a [`LayerGroup`], which moves, and the slabs.
const LAYER_BINDINGS: [u32; 2] = [2, 3];
/// Pixels of a workgroup of `blend`, along each axis.
const BLEND_GROUP: u32 = 8;

/// Layouts and pipelines.
#[derive(Resource)]
pub struct LayeredPipelines {
    project: BindGroupLayoutDescriptor,
    layers: BindGroupLayoutDescriptor,
    canvas: BindGroupLayoutDescriptor,
    matter: BindGroupLayoutDescriptor,
    plan_layout: BindGroupLayoutDescriptor,
    plan: CachedComputePipelineId,
    count: CachedComputePipelineId,
    place: CachedComputePipelineId,
    blend: CachedComputePipelineId,
    sums: SumPipelines,
}

/// What the passes of a camera bind.
pub struct LayeredGroups {
    sums: LayerSums,
    table: Buffer,
    canvas: BindGroup,
    matter: BindGroup,
}

impl TileMode for Layered {
    type Pipelines = LayeredPipelines;
    type Bound = LayeredGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> LayeredPipelines {
        let view = || uniform(size_of::<SplatUniform>(), false);
        let spots = vec![view(), tile_view(), read(), read(), write(), write(), write(), read()];
        let project = layout("deepfield splats of layers", spots);
        let group = || [uniform(size_of::<LayerGroup>(), true), read()];
        let numbered = LAYER_BINDINGS.into_iter().zip(group());
        let entries: Vec<_> = numbered.map(|(index, entry)| entry.build(index, ShaderStages::COMPUTE)).collect();
        let layers = BindGroupLayoutDescriptor::new("deepfield layers of a slab", &entries);
        let light = uniform(size_of::<LayerUniform>(), false);
        let canvas = layout("deepfield blend of layers", vec![view(), tile_view(), light, read(), write(), write()]);
        let lookup = [uniform(size_of::<LookupUniform>(), false), read()];
        let matter = layout("deepfield matter of layers", lookup.into_iter().chain(group()).collect());
        let of = |entry| {
            let layouts = vec![project.clone(), layers.clone()];
            queue(cache, server, ("layered/project.wgsl", entry), layouts, vec![])
        };
        let plan_layout = layout("deepfield plan of layers", vec![write()]);
        let plan_layouts = vec![plan_layout.clone(), layers.clone()];
        let blend_layouts = vec![canvas.clone(), matter.clone()];
        let mut sums = SumPipelines::new(server, cache, on.vector_subgroups, Some(layers.clone()));
        for (kernel, oblique) in Kernel::ALL.into_iter().flat_map(|kernel| [(kernel, false), (kernel, true)]) {
            sums.ask_for(Shape { kernel, oblique, ellipsoids: false }, cache);
        }
        LayeredPipelines {
            plan: queue(cache, server, ("layered/plan.wgsl", "plan"), plan_layouts, vec![]),
            count: of("count"),
            place: of("place"),
            blend: queue(cache, server, ("layered/blend.wgsl", "blend"), blend_layouts, vec![]),
            sums,
            project,
            layers,
            canvas,
            matter,
            plan_layout,
        }
    }

    fn request(&self, view: &View, grids: &Grids, memory: u64) -> TileRequest {
        let at_once = sums::layers_of_slab(self.layers, grids, memory);
        TileRequest {
            planes: self.planes,
            // Densities are those of the layers.
            least: -1.0,
            density_scale: 1.0,
            extent: 1.0,
            lead: 0.0,
            smallest: self.smallest,
            layers: Some(Layering { count: self.layers, spread: self.spread(view), at_once }),
            over: None,
            at_a_time: sums::listed_within(memory, grids),
        }
    }

    fn bind(&self, before: Option<(&Self, &LayeredGroups)>, to: &Binding<'_, Self>) -> LayeredGroups {
        let table = match before {
            Some((before, groups)) if Arc::ptr_eq(&before.classifier, &self.classifier) => groups.table.clone(),
            _ => to.buffer(bytemuck::cast_slice(&table(&self.classifier)), BufferUsages::STORAGE),
        };
        let lookup = to.buffer(bytemuck::bytes_of(&LookupUniform::new(&self.classifier)), BufferUsages::UNIFORM);
        let uniform = LayerUniform { termination: self.termination, least: self.classifier.least(), unused: [0.0; 2] };
        let uniform = to.buffer(bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM);
        let caps: Vec<[f32; 4]> = Caps::of(to.particles.grids.shape.kernel)
            .values()
            .iter()
            .map(|&[mass, second, depth]| [mass as f32, second as f32, depth as f32, 0.0])
            .collect();
        let caps = to.buffer(bytemuck::cast_slice(&caps), BufferUsages::STORAGE);
        let sums = LayerSums::new(before.map(|(_, groups)| &groups.sums), &caps, to);
        let view = &to.particles.shared.uniform;
        let canvas = [view, to.spots.uniform(), &uniform, sums.cells(), &to.cells.buffer, to.ends];
        let canvas = to.group(&to.pipelines.canvas, &canvas.map(whole));
        let matter = sums.with([lookup.as_entire_binding(), table.as_entire_binding()], to);
        LayeredGroups { sums, table, canvas, matter }
    }

    fn bytes(bound: &LayeredGroups) -> u64 {
        bound.sums.bytes()
    }

    fn draw(&self, bound: &LayeredGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        let LayeredPipelines { plan, count, place, blend, .. } = on.pipelines;
        let get = |&id| on.cache.get_compute_pipeline(id);
        let (plan, project, blend) = (get(plan)?, [get(count)?, get(place)?], get(blend)?);
        let grids = &on.particles.grids;
        let sum = on.pipelines.sums.ready(grids, on.cache)?;
        let LayeredGroups { sums, canvas, matter, .. } = bound;
        let encoder = context.command_encoder();
        let span = on.timer.begin("layers", encoder);
        encoder.clear_buffer(&on.cells.buffer, 0, None);
        on.spots.divide(on.particles, &on.steps, encoder);
        sums.plan(plan, encoder);
        for slab in 0..on.spots.slabs() {
            on.spots.gather(slab, on.particles, &on.steps, encoder);
            sums.project(slab, on.spots, project, &on.steps, encoder);
            for layers in sums.groups(slab) {
                sums.sums.accumulate(sum, grids, false, Some(layers), encoder);
                sums.sums.reconstruct(sum, grids, Some(layers), encoder);
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                pass.set_pipeline(blend);
                pass.set_bind_group(0, canvas, &[]);
                pass.set_bind_group(1, matter, &[layers.offset]);
                layers.dispatch(on.pipelines.sums.workgroups(grids).len() as u32, &mut pass);
            }
        }
        span.end(encoder);
        Some(())
    }
    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths {
        let grid = layers_between(view, self.planes, self.layers);
        opaque(view, &grid, self.smallest, ends.iter().map(|&end| (end >= 1.0).then_some(end as u32)))
    }
}
