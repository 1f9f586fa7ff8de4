//! Particles as spheres under one smooth surface (F12 5.9) on the adapter, as [`crate::cpu::screen_spheres`] does, which its
//! pictures are held against: the nearest sphere of each pixel, by tiles; a filter over their depths; normals and light.

use super::capabilities::Capabilities;
use super::matter::map_to_place;
use super::readback::read_buffer;
use super::splat::layout::Grids;
use super::splat::resources::whole;
use super::tiles::constants::walk_defs;
use super::tiles::pipelines::{arrange_layout, layout, portion, queue, read, tile_view, uniform, walk_layout, write};
use super::tiles::spots::listed_within;
use super::tiles::{Binding, Canvas, Drawing, TileBindings, TileList, TileMode, TileRequest, opaque_depths};
use crate::cpu::screen_spheres::{Front, Hit, ROUNDS, SurfaceColors};
use crate::cpu::volume::{Light, OpaqueDepths};
use crate::view::{Projection, View};
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, BindGroupLayoutDescriptor, Buffer, BufferUsages, CachedComputePipelineId, ComputePassDescriptor,
    PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};
use bytemuck::{Pod, Zeroable};

/// Behind everything: WGSL `FAR`.
const FAR: f32 = 3e38;

/// A camera's particles are drawn as spheres. Their table tells densities.
#[derive(Clone, Debug, PartialEq)]
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

/// What the passes of a camera bind.
pub struct SphereGroups {
    list: TileList,
    hits: [Buffer; 2],
    nearest: BindGroup,
    /// From the first hits to the second, and back.
    surface: [BindGroup; 2],
}

impl TileMode for Spheres {
    type Pipelines = SpherePipelines;
    type Bound = SphereGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> SpherePipelines {
        let view = || uniform(size_of::<SphereUniform>(), false);
        let hits = layout("deepfield hits", vec![view(), write(), write()]);
        let surface =
            layout("deepfield surface", vec![tile_view(), portion(), view(), read(), write(), read(), write()]);
        let queue = |shader, layout, defs| queue(cache, server, shader, layout, defs);
        let arrange = queue(("spheres/arrange.wgsl", "arrange"), vec![arrange_layout()], vec![]);
        let walk = vec![walk_layout(), hits.clone()];
        let nearest = queue(("spheres/nearest.wgsl", "nearest"), walk, walk_defs(on.is_software));
        let smooth = queue(("spheres/surface.wgsl", "smooth_hits"), vec![surface.clone()], vec![]);
        let shade = queue(("spheres/surface.wgsl", "shade"), vec![surface.clone()], vec![]);
        SpherePipelines { hits, surface, arrange, nearest, smooth, shade }
    }

    fn request(&self, view: &View, _: &Grids, memory: u64) -> TileRequest {
        // A sphere may be seen whose centre lies before the near plane.
        let first = match view.projection {
            Projection::Perspective { .. } => f64::from(f32::MIN_POSITIVE),
            Projection::Orthographic { .. } => f64::from(f32::MIN),
        };
        TileRequest {
            planes: [first, self.planes[1]],
            least: (self.least as f32).next_down(),
            density_scale: self.density_scale,
            extent: self.radius as f32,
            lead: 1.0,
            smallest: 0.0,
            layers: None,
            over: None,
            at_a_time: listed_within(memory, TileList::SPOT_BYTES),
        }
    }

    fn bind(&self, before: Option<(&Self, &SphereGroups)>, to: &Binding<'_, Self>) -> SphereGroups {
        let list = to.tiles(before.map(|(_, groups)| &groups.list));
        let hits = [0, 1].map(|index: usize| to.pixels(before.map(|(_, groups)| &groups.hits[index])));
        let uniform = to.buffer(bytemuck::bytes_of(&SphereUniform::new(self)), BufferUsages::UNIFORM);
        let colors = to.buffer(bytemuck::cast_slice(&self.colors.colors), BufferUsages::STORAGE);
        let nearest = to.group(&to.pipelines.hits, &[&uniform, &hits[0], to.ends].map(whole));
        let surface = [0, 1].map(|from: usize| {
            let bound = [
                to.spots.uniform().as_entire_binding(),
                list.portions(),
                uniform.as_entire_binding(),
                hits[from].as_entire_binding(),
                hits[1 - from].as_entire_binding(),
                colors.as_entire_binding(),
                to.cells.buffer.as_entire_binding(),
            ];
            to.group(&to.pipelines.surface, &bound)
        });
        SphereGroups { list, hits, nearest, surface }
    }

    fn bytes(bound: &SphereGroups) -> u64 {
        bound.list.bytes()
    }

    fn draw(&self, bound: &SphereGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        let SpherePipelines { arrange, nearest, smooth, shade, .. } = on.pipelines;
        let get = |&id| on.cache.get_compute_pipeline(id);
        let (arrange, walk, smooth, shade) = (get(arrange)?, get(nearest)?, get(smooth)?, get(shade)?);
        context.command_encoder().clear_buffer(&bound.hits[0], 0, None);
        let (name, timer) = ("nearest", on.timer);
        let drawing = Drawing { arrange, arrange_group: None, walk, walk_group: &bound.nearest, name, timer };
        bound.list.draw(on.spots, on.particles, &on.steps, &drawing, context);
        let encoder = context.command_encoder();
        let span = on.timer.begin("surface", encoder);
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            let [x, y] = on.spots.tiling().tiles;
            let mut run = |pipeline, round: usize| {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bound.surface[round % 2], &[bound.list.numbered(round)]);
                pass.dispatch_workgroups(x, y, 1);
            };
            if self.smoothing > 0.0 {
                (0..2 * ROUNDS).for_each(|round| run(smooth, round));
            }
            run(shade, 0);
        }
        span.end(encoder);
        Some(())
    }

    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths {
        // Before they are smoothed: smoothing looks at no more than what each pixel shows.
        opaque_depths(view, ends, 0.0).reaching(self.radius)
    }
}

/// The smoothed surface that a camera's last complete picture shows; `None` where that cannot be read.
pub fn shown(bindings: &TileBindings<Spheres>, device: &RenderDevice, queue: &RenderQueue) -> Option<Front> {
    let (groups, view) = bindings.drawn();
    let bytes = size_of::<Hit>() as u64 * u64::from(view.width) * u64::from(view.height);
    // Rounds are even, and the last one comes back to the first hits.
    let found = read_buffer(device, queue, &groups.hits[0], 0, bytes)?;
    let found: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&found);
    let hit = |[depth, radius, density, attribute]: [f32; 4]| match depth < FAR && radius > 0.0 {
        true => Hit { depth, radius, density, attribute },
        false => Hit::NONE,
    };
    Some(Front { width: view.width as usize, hits: found.into_iter().map(hit).collect() })
}
