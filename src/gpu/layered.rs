//! Layered splatting (F12 5.10) on the adapter, as [`crate::cpu::layered`] does, which its pictures are held against: particles by
//! tiles, sorted by layers. Each pixel sums its layers one after the other, and blends them. Where a particle belongs to the layer
//! of its centre, all layers together take one pass over the particles.

use super::matter::{LookupUniform, table};
use super::splat::constants::kernel_defs;
use super::splat::profile::Profile;
use super::tiles::constants::walk_defs;
use super::tiles::pipelines::{arrange_layout, layout, queue, read, uniform, walk_layout, write};
use super::tiles::{Binding, Canvas, Drawing, Layering, TileMode, TileRequest};
use crate::cpu::layered::Assignment;
use crate::cpu::layered::caps::Caps;
use crate::cpu::volume::Classifier;
use crate::model::Kernel;
use crate::view::{Projection, View};
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
    /// See [`Profile::moment`].
    pub moment: f32,
    /// Padding.
    pub unused: f32,
}

/// Shader definitions of the pass that blends.
pub fn blend_defs(kernel: Kernel, oblique: bool, is_software: bool) -> Vec<ShaderDefVal> {
    let mut defs = [kernel_defs(kernel), walk_defs(is_software)].concat();
    if oblique {
        defs.push("OBLIQUE".into());
    }
    defs
}

/// Layouts and pipelines.
#[derive(Resource)]
pub struct LayeredPipelines {
    caps: BindGroupLayoutDescriptor,
    blend: BindGroupLayoutDescriptor,
    arrange: CachedComputePipelineId,
    /// That which blends, and that which blends the last layers.
    blends: HashMap<(Kernel, bool), [CachedComputePipelineId; 2]>,
}

/// What the passes of a camera bind.
pub struct LayeredGroups {
    table: Buffer,
    /// What is not blended yet.
    pending: Buffer,
    arrange: BindGroup,
    blend: BindGroup,
}

impl TileMode for Layered {
    const PASSES: &'static [&'static str] = &["layers"];
    type Pipelines = LayeredPipelines;
    type Bound = LayeredGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, is_software: bool) -> LayeredPipelines {
        let view = || uniform(size_of::<LayerUniform>(), false);
        let caps = layout("deepfield caps", vec![view(), read()]);
        let matter = uniform(size_of::<LookupUniform>(), false);
        let blend = layout("deepfield layers", vec![matter, read(), view(), write(), write()]);
        let arrange_layouts = vec![arrange_layout(), caps.clone()];
        let arrange = queue(cache, server, ("layered/arrange.wgsl", "arrange"), arrange_layouts, vec![]);
        let of = |(kernel, oblique)| {
            let pipelines = ["blend", "finish"].map(|entry| {
                let layouts = vec![walk_layout(), blend.clone()];
                let defs = blend_defs(kernel, oblique, is_software);
                queue(cache, server, ("layered/blend.wgsl", entry), layouts, defs)
            });
            ((kernel, oblique), pipelines)
        };
        let variants = Kernel::ALL.into_iter().flat_map(|kernel| [(kernel, false), (kernel, true)]);
        let blends = variants.map(of).collect();
        LayeredPipelines { caps, blend, arrange, blends }
    }

    fn request(&self, view: &View) -> TileRequest {
        TileRequest {
            planes: self.planes,
            // Densities are those of the layers.
            least: -1.0,
            density_scale: 1.0,
            extent: 1.0,
            lead: 0.0,
            smallest: self.smallest,
            layers: Some(Layering { count: self.layers, spread: self.spread(view) }),
        }
    }

    fn bind(&self, before: Option<(&Self, &LayeredGroups)>, to: &Binding<'_, Self>) -> LayeredGroups {
        let table = match before {
            Some((before, groups)) if Arc::ptr_eq(&before.classifier, &self.classifier) => groups.table.clone(),
            _ => to.buffer(bytemuck::cast_slice(&table(&self.classifier)), BufferUsages::STORAGE),
        };
        let lookup = to.buffer(bytemuck::bytes_of(&LookupUniform::new(&self.classifier)), BufferUsages::UNIFORM);
        let uniform = LayerUniform {
            termination: self.termination,
            least: self.classifier.least(),
            moment: Profile::of(to.kernel).moment,
            unused: 0.0,
        };
        let uniform = to.buffer(bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM);
        let caps: Vec<[f32; 4]> = Caps::of(to.kernel)
            .values()
            .iter()
            .map(|&[mass, second, depth]| [mass as f32, second as f32, depth as f32, 0.0])
            .collect();
        let caps = to.buffer(bytemuck::cast_slice(&caps), BufferUsages::STORAGE);
        let pending = to.pixels(before.map(|(_, groups)| &groups.pending));
        let arrange = to.group(&to.pipelines.caps, &[uniform.as_entire_binding(), caps.as_entire_binding()]);
        let blended = [&lookup, &table, &uniform, &pending, &to.cells.buffer].map(|buffer| buffer.as_entire_binding());
        let blend = to.group(&to.pipelines.blend, &blended);
        LayeredGroups { table, pending, arrange, blend }
    }

    fn draw(&self, bound: &LayeredGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        let get = |id| on.cache.get_compute_pipeline(id);
        let variant = (on.particles.grids.kernel, on.particles.grids.oblique);
        let [walk, finish] = on.pipelines.blends.get(&variant)?.map(get);
        let (walk, finish, arrange) = (walk?, finish?, get(on.pipelines.arrange)?);
        for buffer in [&on.cells.buffer, &bound.pending] {
            context.command_encoder().clear_buffer(buffer, 0, None);
        }
        let drawing =
            Drawing { arrange, arrange_group: Some(&bound.arrange), walk, walk_group: &bound.blend, name: "layers" };
        on.list.draw(on.particles, &on.steps, &drawing, context);
        on.list.draw_tiles(finish, &bound.blend, "layers", context);
        Some(())
    }
}
