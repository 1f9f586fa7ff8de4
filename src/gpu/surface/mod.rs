//! Measured heights: what [`crate::cpu::surface`] draws on the processor.
//!
//! The processor chooses chunks and joins them; a camera with a [`SurfaceView`] beside its [`LightView`](crate::gpu::LightView) draws them:
//!
//! 1. [`arena`] holds the samples of chunks, and the tiles of a [`photo`] that lies over them, which are copied once while they stay ([`pool`]).
//! 2. What is seen at each sample of the picture, as a number of a triangle or a point: by compute passes (`cells`, `fans`, `large`), which
//!    draw all twice, for the least depth and then for the least number that has it; or, in as many passes, by `rays` through chunks with
//!    `cells` for points alone; or by the adapter's rasteriser with a buffer of depths.
//!    Places of corners are those of the sample alone, so that chunks have no cracks between them.
//! 3. `resolve` finds the place that each sample shows, and its colour, and sums the samples of each pixel.
//!
//! Shaders are compiled when the first picture needs them, and without what it does not need ([`pipelines::Variant`]). What only parts of chunks have,
//! rims of holes and membranes over them, is listed by squares of a chunk.
//!
//! What is seen can be read back ([`seen`]), for those who look for places in double precision.

pub mod arena;
mod cast;
pub mod constants;
mod globe;
pub mod job;
pub mod layout;
pub mod list;
pub mod photo;
pub mod pipelines;
pub mod pool;
pub mod seen;
mod squares;
pub mod work;

pub use arena::SurfaceArena;
pub use job::{SurfaceFindings, SurfaceNews, SurfaceView};

use super::light::{prepare_light, show_light};
use super::splat::prepare_splats;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use pipelines::queue_surface_pipelines;

/// Adds the passes that draw surfaces.
pub struct SurfacePlugin;

impl Plugin for SurfacePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<SurfaceView>::default());
        let news = app.world_mut().get_resource_or_init::<SurfaceNews>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        let is_used = |surfaces: Query<(), With<SurfaceView>>| !surfaces.is_empty();
        render_app
            .insert_resource(news)
            .init_resource::<SurfaceArena>()
            .add_systems(RenderStartup, work::forget)
            .add_systems(
                Render,
                (
                    queue_surface_pipelines.in_set(RenderSystems::Queue).run_if(is_used),
                    work::prepare_surfaces
                        .in_set(RenderSystems::PrepareBindGroups)
                        .after(prepare_splats)
                        .before(prepare_light),
                ),
            )
            .add_systems(
                Core3d,
                work::draw_surfaces
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
}
