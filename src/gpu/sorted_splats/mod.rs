//! Order-dependent splatting (F12 5.9) on the adapter: particles by tiles, classified each on its own and blended front to back
//! for each pixel, as [`crate::cpu::sorted`] does, which its pictures are held against.

use super::light::{self, LightCells, LightView, prepare_light, show_light};
use super::matter::{LookupUniform, table};
use super::splat::constants::kernel_defs;
use super::splat::{SplatBuffers, prepare_splats};
use super::target::written;
use super::tiles::constants::walk_defs;
use super::tiles::layout::Tiling;
use super::tiles::pipelines::{
    TilePipelines, arrange_layout, init_when_used, layout, queue, read, uniform, walk_layout, write,
};
use super::tiles::{Drawing, TileList, TileRequest};
use super::timing::TimedPasses;
use super::view::SplatView;
use crate::cpu::volume::Classifier;
use crate::model::Kernel;
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
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// On a camera with a [`LightView`]: its particles are blended in the order of their depth (main world, extracted). Their table
/// tells densities. The view's footprint is the kernel.
#[derive(Component, Clone, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, SortedBindings))]
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

/// Adds the passes.
pub struct SortedSplatsPlugin;

impl Plugin for SortedSplatsPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<SortedSplats>::default());
        app.world_mut().get_resource_or_init::<TimedPasses>().0.push("blend");
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        init_when_used::<SortedSplats, SortedPipelines, _>(render_app, init_pipelines);
        render_app
            .add_systems(
                Render,
                prepare.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats).before(prepare_light),
            )
            .add_systems(
                Core3d,
                draw_sorted_splats
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
}

/// Shader definitions of the pass that blends.
pub fn blend_defs(kernel: Kernel, is_software: bool) -> Vec<bevy::shader::ShaderDefVal> {
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

fn init_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    tiles: Res<TilePipelines>,
) {
    let lookup = layout("deepfield matter", vec![uniform(size_of::<LookupUniform>(), false), read()]);
    let light = layout("deepfield blend", vec![uniform(size_of::<SortedUniform>(), false), write()]);
    let arrange_layouts = vec![arrange_layout(), lookup.clone()];
    let arrange = queue(&cache, &server, ("sorted/arrange.wgsl", "arrange"), arrange_layouts, vec![]);
    let of_kernel = |kernel| {
        let layouts = vec![walk_layout(), light.clone()];
        let defs = blend_defs(kernel, tiles.is_software);
        (kernel, queue(&cache, &server, ("sorted/blend.wgsl", "blend"), layouts, defs))
    };
    let blend = Kernel::ALL.into_iter().map(of_kernel).collect();
    commands.insert_resource(SortedPipelines { lookup, light, arrange, blend });
}

/// What the passes of a camera bind, and what that was made of.
#[derive(Component)]
pub struct SortedBindings {
    list: TileList,
    table: Buffer,
    arrange: BindGroup,
    blend: BindGroup,
    of: SortedSplats,
}

fn prepare(
    mut commands: Commands,
    mut cameras: Query<
        (Entity, &SplatView, &SortedSplats, Ref<SplatBuffers>, Option<&SortedBindings>, Option<&LightCells>),
        With<LightView>,
    >,
    pipelines: Option<Res<SortedPipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    for (entity, view, sorted, particles, before, cells) in &mut cameras {
        if before.is_some_and(|before| before.of == *sorted) && !particles.is_changed() {
            continue;
        }
        let request = TileRequest {
            planes: sorted.planes,
            least: sorted.classifier.least(),
            density_scale: sorted.density_scale,
            extent: 1.0,
            lead: 0.0,
            smallest: sorted.smallest,
            layers: None,
        };
        let tiling = Tiling::new(&view.view, &request);
        let known = before.map(|before| &before.list);
        let list = TileList::new(tiling, &particles, known, &tile_pipelines, &cache, (&device, &queue));
        let table = match before {
            Some(before) if Arc::ptr_eq(&before.of.classifier, &sorted.classifier) => before.table.clone(),
            _ => {
                let entries = table(&sorted.classifier);
                written(None, bytemuck::cast_slice(&entries), BufferUsages::STORAGE, &device, &queue)
            }
        };
        let uniform = |bytes: &[u8]| written(None, bytes, BufferUsages::UNIFORM, &device, &queue);
        let lookup = uniform(bytemuck::bytes_of(&LookupUniform::new(&sorted.classifier)));
        let light = uniform(bytemuck::bytes_of(&SortedUniform { termination: sorted.termination, unused: [0; 3] }));
        let cells = light::cells(cells, tiling.uniform.size, &device);
        let bind = |layout: &BindGroupLayoutDescriptor, uniform: &Buffer, buffer: &Buffer| {
            let entries = BindGroupEntries::sequential((uniform.as_entire_binding(), buffer.as_entire_binding()));
            device.create_bind_group("deepfield sorted splats", &cache.get_bind_group_layout(layout), &entries)
        };
        let arrange = bind(&pipelines.lookup, &lookup, &table);
        let blend = bind(&pipelines.light, &light, &cells.buffer);
        commands.entity(entity).insert((SortedBindings { list, table, arrange, blend, of: sorted.clone() }, cells));
    }
}

/// Draws the particles of a camera into its [`LightCells`].
pub fn draw_sorted_splats(
    view: ViewQuery<(&SplatBuffers, &SortedBindings, &mut LightCells, &LightView, &SortedSplats)>,
    pipelines: Option<Res<SortedPipelines>>,
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
    let blend = pipelines.blend.get(&particles.grids.kernel).and_then(|&id| get(id));
    let (Some(steps), Some(arrange), Some(walk)) = (tile_pipelines.ready(&cache), get(pipelines.arrange), blend) else {
        return;
    };
    context.command_encoder().clear_buffer(&cells.buffer, 0, None);
    let drawing =
        Drawing { arrange, arrange_group: Some(&bindings.arrange), walk, walk_group: &bindings.blend, name: "blend" };
    bindings.list.draw(particles, &steps, &drawing, &mut context);
    cells.complete = true;
}
