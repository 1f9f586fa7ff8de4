//! Particles as spheres under one smooth surface (F12 5.9) on the adapter, as [`crate::cpu::screen_spheres`] does, which its
//! pictures are held against: the nearest sphere of each pixel, by tiles; a filter over their depths; normals and light.

use super::light::{self, LightCells, LightView, prepare_light, show_light};
use super::matter::map_to_place;
use super::splat::{SplatBuffers, prepare_splats};
use super::target::written;
use super::tiles::constants::walk_defs;
use super::tiles::layout::Tiling;
use super::tiles::pipelines::{
    TilePipelines, arrange_layout, init_when_used, layout, portion, queue, read, tile_view, uniform, walk_layout, write,
};
use super::tiles::{Drawing, TileList, TileRequest};
use super::timing::TimedPasses;
use super::view::SplatView;
use crate::cpu::screen_spheres::{ROUNDS, SurfaceColors};
use crate::cpu::volume::Light;
use crate::view::Projection;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId,
    ComputePassDescriptor, PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::{Render, RenderApp, RenderSystems};
use bytemuck::{Pod, Zeroable};

/// On a camera with a [`LightView`]: its particles are drawn as spheres (main world, extracted). Their table tells densities.
#[derive(Component, Clone, Debug, PartialEq, ExtractComponent)]
#[extract_component_sync_target((Self, SphereBindings))]
pub struct Spheres {
    /// Radius of a sphere, in smoothing lengths.
    pub radius: f64,
    /// Least density of a particle.
    pub least: f64,
    /// Radius of the filter, in radii of the sphere that a pixel shows; 0: none.
    pub smoothing: f64,
    /// Depths of the near plane, in front of which nothing is seen, and of the far one, behind which no sphere has its centre.
    pub planes: [f64; 2],
    /// Factor on the particles' own densities.
    pub density_scale: f32,
    /// How the surface is lit; plain colours without.
    pub light: Option<Light>,
    /// What colours it has.
    pub colors: SurfaceColors,
}

/// WGSL `SphereView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SphereUniform {
    /// Depth of the near plane.
    pub near: f32,
    /// Radius of the filter, in radii of the sphere that a pixel shows.
    pub smoothing: f32,
    /// 1: the surface is lit.
    pub lit: u32,
    /// See [`Light`].
    pub ambient: f32,
    /// See [`Light`].
    pub specular: f32,
    /// See [`Light`].
    pub shininess: f32,
    /// 1: colours follow the attribute; 0: the density.
    pub of_attribute: u32,
    /// 1: they follow the logarithm.
    pub log_scale: u32,
    /// Factor and offset from what they follow to its place among them.
    pub color_map: [f32; 2],
    /// Number of colours less one.
    pub last_color: f32,
    /// Padding.
    pub unused: f32,
}

impl SphereUniform {
    fn new(spheres: &Spheres) -> SphereUniform {
        let light = spheres.light.unwrap_or(Light { ambient: 1.0, specular: 0.0, shininess: 1.0 });
        let (color_map, log_scale) = map_to_place(spheres.colors.scale, spheres.colors.range);
        SphereUniform {
            near: spheres.planes[0] as f32,
            smoothing: spheres.smoothing as f32,
            lit: spheres.light.is_some().into(),
            ambient: light.ambient,
            specular: light.specular,
            shininess: light.shininess,
            of_attribute: spheres.colors.of_attribute.into(),
            log_scale,
            color_map,
            last_color: spheres.colors.colors.len().saturating_sub(1) as f32,
            unused: 0.0,
        }
    }
}

/// Adds the passes.
pub struct SpheresPlugin;

impl Plugin for SpheresPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Spheres>::default());
        app.world_mut().get_resource_or_init::<TimedPasses>().0.extend(["nearest", "surface"]);
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        init_when_used::<Spheres, SpherePipelines, _>(render_app, init_pipelines);
        render_app
            .add_systems(
                Render,
                prepare.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats).before(prepare_light),
            )
            .add_systems(
                Core3d,
                draw_spheres
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
}

/// Layouts and pipelines.
#[derive(Resource)]
pub struct SpherePipelines {
    hits: BindGroupLayoutDescriptor,
    surface: BindGroupLayoutDescriptor,
    arrange: CachedComputePipelineId,
    nearest: CachedComputePipelineId,
    smooth: CachedComputePipelineId,
    shade: CachedComputePipelineId,
}

fn init_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    tiles: Res<TilePipelines>,
) {
    let view = || uniform(size_of::<SphereUniform>(), false);
    let hits = layout("deepfield hits", vec![view(), write()]);
    let surface = layout("deepfield surface", vec![tile_view(), portion(), view(), read(), write(), read(), write()]);
    let queue = |shader, layout, defs| queue(&cache, &server, shader, layout, defs);
    let arrange = queue(("spheres/arrange.wgsl", "arrange"), vec![arrange_layout()], vec![]);
    let walk = vec![walk_layout(), hits.clone()];
    let nearest = queue(("spheres/nearest.wgsl", "nearest"), walk, walk_defs(tiles.is_software));
    let smooth = queue(("spheres/surface.wgsl", "smooth_hits"), vec![surface.clone()], vec![]);
    let shade = queue(("spheres/surface.wgsl", "shade"), vec![surface.clone()], vec![]);
    commands.insert_resource(SpherePipelines { hits, surface, arrange, nearest, smooth, shade });
}

/// What the passes of a camera bind, and what that was made of.
#[derive(Component)]
pub struct SphereBindings {
    list: TileList,
    hits: [Buffer; 2],
    nearest: BindGroup,
    /// From the first hits to the second, and back.
    surface: [BindGroup; 2],
    of: Spheres,
}

fn prepare(
    mut commands: Commands,
    cameras: Query<
        (Entity, &SplatView, &Spheres, Ref<SplatBuffers>, Option<&SphereBindings>, Option<&LightCells>),
        With<LightView>,
    >,
    pipelines: Option<Res<SpherePipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    for (entity, view, spheres, particles, before, cells) in &cameras {
        if before.is_some_and(|before| before.of == *spheres) && !particles.is_changed() {
            continue;
        }
        // A sphere may be seen whose centre lies before the near plane.
        let first = match view.view.projection {
            Projection::Perspective { .. } => f64::from(f32::MIN_POSITIVE),
            Projection::Orthographic { .. } => f64::from(f32::MIN),
        };
        let request = TileRequest {
            planes: [first, spheres.planes[1]],
            least: (spheres.least as f32).next_down(),
            density_scale: spheres.density_scale,
            extent: spheres.radius as f32,
            lead: 1.0,
            smallest: 0.0,
            layers: None,
        };
        let tiling = Tiling::new(&view.view, &request);
        let known = before.map(|before| &before.list);
        let list = TileList::new(tiling, &particles, known, &tile_pipelines, &cache, (&device, &queue));
        let cells = light::cells(cells, tiling.uniform.size, &device);
        // As many bytes as light has: four numbers a pixel.
        let hits = match before {
            Some(before) if before.hits[0].size() == cells.buffer.size() => before.hits.clone(),
            _ => [0, 1].map(|_| light::cells(None, tiling.uniform.size, &device).buffer),
        };
        let new = |bytes: &[u8], usage| written(None, bytes, usage, &device, &queue);
        let uniform = new(bytemuck::bytes_of(&SphereUniform::new(spheres)), BufferUsages::UNIFORM);
        let colors = new(bytemuck::cast_slice(&spheres.colors.colors), BufferUsages::STORAGE);
        let nearest = device.create_bind_group(
            "deepfield nearest",
            &cache.get_bind_group_layout(&pipelines.hits),
            &BindGroupEntries::sequential((uniform.as_entire_binding(), hits[0].as_entire_binding())),
        );
        let surface = [0, 1].map(|from: usize| {
            device.create_bind_group(
                "deepfield surface",
                &cache.get_bind_group_layout(&pipelines.surface),
                &BindGroupEntries::sequential((
                    list.uniform().as_entire_binding(),
                    list.portions(),
                    uniform.as_entire_binding(),
                    hits[from].as_entire_binding(),
                    hits[1 - from].as_entire_binding(),
                    colors.as_entire_binding(),
                    cells.buffer.as_entire_binding(),
                )),
            )
        });
        let bindings = SphereBindings { list, hits, nearest, surface, of: spheres.clone() };
        commands.entity(entity).insert((bindings, cells));
    }
}

/// Draws the particles of a camera into its [`LightCells`].
pub fn draw_spheres(
    view: ViewQuery<(&SplatBuffers, &SphereBindings, &mut LightCells, &LightView, &Spheres)>,
    pipelines: Option<Res<SpherePipelines>>,
    tile_pipelines: Option<Res<TilePipelines>>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (particles, bindings, mut cells, _, _) = view.into_inner();
    if cells.complete && !particles.always {
        return;
    }
    let (Some(pipelines), Some(tile_pipelines)) = (pipelines, tile_pipelines) else { return };
    let SpherePipelines { arrange, nearest, smooth, shade, .. } = &*pipelines;
    let found = [arrange, nearest, smooth, shade].map(|&id| cache.get_compute_pipeline(id));
    let (Some(steps), [Some(arrange), Some(walk), Some(smooth), Some(shade)]) = (tile_pipelines.ready(&cache), found)
    else {
        return;
    };
    context.command_encoder().clear_buffer(&bindings.hits[0], 0, None);
    let drawing = Drawing { arrange, arrange_group: None, walk, walk_group: &bindings.nearest, name: "nearest" };
    bindings.list.draw(particles, &steps, &drawing, &mut context);
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = context.command_encoder();
    let span = diagnostics.time_span(encoder, "surface");
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        let [x, y] = bindings.list.tiling().tiles;
        let mut run = |pipeline, round: usize| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bindings.surface[round % 2], &[bindings.list.numbered(round)]);
            pass.dispatch_workgroups(x, y, 1);
        };
        if bindings.of.smoothing > 0.0 {
            (0..2 * ROUNDS).for_each(|round| run(smooth, round));
        }
        run(shade, 0);
    }
    span.end(encoder);
    cells.complete = true;
}
