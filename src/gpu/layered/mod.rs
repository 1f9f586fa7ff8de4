//! Layered splatting (F12 5.10) on the adapter, as [`crate::cpu::layered`] does, which its pictures are held against: particles by
//! tiles, sorted by layers. Each pixel sums its layers one after the other, and blends them. Where a particle belongs to the layer
//! of its centre, all layers together take one pass over the particles.

use super::light::{self, LightCells, LightView, prepare_light, show_light};
use super::matter::{LookupUniform, table};
use super::splat::constants::kernel_defs;
use super::splat::profile::Profile;
use super::splat::{SplatBuffers, prepare_splats};
use super::target::written;
use super::tiles::constants::walk_defs;
use super::tiles::layout::Tiling;
use super::tiles::pipelines::{
    TilePipelines, arrange_layout, init_when_used, layout, queue, read, uniform, walk_layout, write,
};
use super::tiles::{Drawing, Layering, TileList, TileRequest};
use super::timing::TimedPasses;
use super::view::SplatView;
use crate::cpu::layered::Assignment;
use crate::cpu::layered::caps::Caps;
use crate::cpu::volume::Classifier;
use crate::model::Kernel;
use crate::view::{Projection, View};
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId,
    PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::{Render, RenderApp, RenderSystems};
use bevy::shader::ShaderDefVal;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// On a camera with a [`LightView`]: its particles are drawn in layers (main world, extracted). Their weight is mass, and the view's
/// footprint is the kernel.
#[derive(Component, Clone, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, LayeredBindings))]
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

/// Adds the passes.
pub struct LayeredPlugin;

impl Plugin for LayeredPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Layered>::default());
        app.world_mut().get_resource_or_init::<TimedPasses>().0.push("layers");
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        init_when_used::<Layered, LayeredPipelines, _>(render_app, init_pipelines);
        render_app
            .add_systems(
                Render,
                prepare.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats).before(prepare_light),
            )
            .add_systems(
                Core3d,
                draw_layers
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
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

fn init_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    tiles: Res<TilePipelines>,
) {
    let view = || uniform(size_of::<LayerUniform>(), false);
    let caps = layout("deepfield caps", vec![view(), read()]);
    let matter = uniform(size_of::<LookupUniform>(), false);
    let blend = layout("deepfield layers", vec![matter, read(), view(), write(), write()]);
    let arrange_layouts = vec![arrange_layout(), caps.clone()];
    let arrange = queue(&cache, &server, ("layered/arrange.wgsl", "arrange"), arrange_layouts, vec![]);
    let of = |(kernel, oblique)| {
        let pipelines = ["blend", "finish"].map(|entry| {
            let layouts = vec![walk_layout(), blend.clone()];
            let defs = blend_defs(kernel, oblique, tiles.is_software);
            queue(&cache, &server, ("layered/blend.wgsl", entry), layouts, defs)
        });
        ((kernel, oblique), pipelines)
    };
    let variants = Kernel::ALL.into_iter().flat_map(|kernel| [(kernel, false), (kernel, true)]);
    let blends = variants.map(of).collect();
    commands.insert_resource(LayeredPipelines { caps, blend, arrange, blends });
}

/// What the passes of a camera bind, and what that was made of.
#[derive(Component)]
pub struct LayeredBindings {
    list: TileList,
    table: Buffer,
    pending: Buffer,
    arrange: BindGroup,
    blend: BindGroup,
    of: Layered,
}

fn prepare(
    mut commands: Commands,
    mut cameras: Query<
        (Entity, &SplatView, &Layered, Ref<SplatBuffers>, Option<&LayeredBindings>, Option<&LightCells>),
        With<LightView>,
    >,
    pipelines: Option<Res<LayeredPipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    for (entity, view, layered, particles, before, cells) in &mut cameras {
        if before.is_some_and(|before| before.of == *layered) && !particles.is_changed() {
            continue;
        }
        let request = TileRequest {
            planes: layered.planes,
            // Densities are those of the layers.
            least: -1.0,
            density_scale: 1.0,
            extent: 1.0,
            lead: 0.0,
            smallest: layered.smallest,
            layers: Some(Layering { count: layered.layers, spread: layered.spread(&view.view) }),
        };
        let tiling = Tiling::new(&view.view, &request);
        let known = before.map(|before| &before.list);
        let list = TileList::new(tiling, &particles, known, &tile_pipelines, &cache, (&device, &queue));
        let table = match before {
            Some(before) if Arc::ptr_eq(&before.of.classifier, &layered.classifier) => before.table.clone(),
            _ => {
                let entries = table(&layered.classifier);
                written(None, bytemuck::cast_slice(&entries), BufferUsages::STORAGE, &device, &queue)
            }
        };
        let kernel = particles.grids.kernel;
        let new = |bytes: &[u8], usage| written(None, bytes, usage, &device, &queue);
        let lookup = new(bytemuck::bytes_of(&LookupUniform::new(&layered.classifier)), BufferUsages::UNIFORM);
        let uniform = LayerUniform {
            termination: layered.termination,
            least: layered.classifier.least(),
            moment: Profile::of(kernel).moment,
            unused: 0.0,
        };
        let uniform = new(bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM);
        let caps: Vec<[f32; 4]> = Caps::of(kernel)
            .values()
            .iter()
            .map(|&[mass, second, depth]| [mass as f32, second as f32, depth as f32, 0.0])
            .collect();
        let caps = new(bytemuck::cast_slice(&caps), BufferUsages::STORAGE);
        let cells = light::cells(cells, tiling.uniform.size, &device);
        // As many bytes as light has: four numbers a pixel.
        let pending = match before {
            Some(before) if before.pending.size() == cells.buffer.size() => before.pending.clone(),
            _ => light::cells(None, tiling.uniform.size, &device).buffer,
        };
        let arrange = device.create_bind_group(
            "deepfield caps",
            &cache.get_bind_group_layout(&pipelines.caps),
            &BindGroupEntries::sequential((uniform.as_entire_binding(), caps.as_entire_binding())),
        );
        let blend = device.create_bind_group(
            "deepfield layers",
            &cache.get_bind_group_layout(&pipelines.blend),
            &BindGroupEntries::sequential((
                lookup.as_entire_binding(),
                table.as_entire_binding(),
                uniform.as_entire_binding(),
                pending.as_entire_binding(),
                cells.buffer.as_entire_binding(),
            )),
        );
        let bindings = LayeredBindings { list, table, pending, arrange, blend, of: layered.clone() };
        commands.entity(entity).insert((bindings, cells));
    }
}

/// Draws the particles of a camera into its [`LightCells`].
pub fn draw_layers(
    view: ViewQuery<(&SplatBuffers, &LayeredBindings, &mut LightCells, &LightView, &Layered)>,
    pipelines: Option<Res<LayeredPipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (particles, bindings, mut cells, _, _) = view.into_inner();
    if cells.complete && !particles.always {
        return;
    }
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    let get = |id| cache.get_compute_pipeline(id);
    let variant = (particles.grids.kernel, particles.grids.oblique);
    let blends = pipelines.blends.get(&variant).map(|ids| ids.map(get));
    let (Some(steps), Some(arrange), Some([Some(walk), Some(finish)])) =
        (tile_pipelines.ready(&cache), get(pipelines.arrange), blends)
    else {
        return;
    };
    for buffer in [&cells.buffer, &bindings.pending] {
        context.command_encoder().clear_buffer(buffer, 0, None);
    }
    let drawing =
        Drawing { arrange, arrange_group: Some(&bindings.arrange), walk, walk_group: &bindings.blend, name: "layers" };
    bindings.list.draw(particles, &steps, &drawing, &mut context);
    bindings.list.draw_tiles(finish, &bindings.blend, "layers", &mut context);
    cells.complete = true;
}
