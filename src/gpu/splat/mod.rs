//! Splatting: accumulates `P` and `P S` (F12 4.9) on an image pyramid, by one of two techniques.
//!
//! Splats below [`layout::sampled_radius`] pixels are integrated over pixels (their weight is conserved exactly); larger
//! ones are sampled at the cell centres of the pyramid level where their radius is one to two times that many cells, with
//! the second-order correction from sample to pixel mean. So a splat touches a bounded number of cells, whatever its
//! size. Then each level is interpolated and added to the next finer one, coarse to fine.
//!
//! [`compute`], for each camera with a [`super::SplatView`]:
//!
//! 1. `count`: decode, project, cull; each splat finds its pyramid level by its radius, and its bin of 8 x 8 cells.
//! 2. `scan`, `place`: splats in the order of their bins.
//! 3. `accumulate`: every 8 x 8 tile of every level sums the splats of the bins around it, in registers; where there are
//!    very many, further workgroups sum slices of them, and `merge` adds those.
//! 4. `reconstruct`: coarse to fine.
//!
//! Why bins instead of one atomic addition for each splat and cell: on a software driver an atomic addition costs about
//! 20 ns, an evaluation in a vector of eight cells below 1 ns.
//!
//! [`raster`], for adapters without compute shaders:
//!
//! 1. `blend`: one quad for each splat, drawn into its level's part of an atlas with additive blending.
//! 2. `upsample`: coarse to fine, along x and then along y.

pub mod compute;
pub mod constants;
pub mod draw_list;
pub mod layout;
pub mod overdraw;
pub mod profile;
pub mod raster;
pub mod resources;

mod particles;
mod pass;
mod pipelines;
mod prepare;

pub use overdraw::{CountOverdraw, OverdrawBuffers, OverdrawPlugin};
pub use particles::{ParticleBatch, particle_layout, workgroups};
pub use pass::accumulate_splats;
pub use pipelines::{SplatPipelines, init_splat_pipelines, pipeline_error};
pub use prepare::{Bindings, SplatBuffers, prepare_splats};

use super::arena::{Arena, update_arena};
use super::capabilities::Withheld;
use super::mode_view::ModeView;
use super::scene::ParticleScene;
use super::view::SplatView;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};

/// Adds the splat passes. Needs a [`ParticleScene`] in the main world.
pub struct SplatPlugin;

impl Plugin for SplatPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins((
            OverdrawPlugin,
            ExtractComponentPlugin::<SplatView>::default(),
            ExtractComponentPlugin::<ModeView>::default(),
        ));
        let scene = app.world().get_resource::<ParticleScene>().cloned();
        let withheld = app.world().get_resource::<Withheld>().copied();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        if let Some(scene) = scene {
            render_app.insert_resource(scene);
        }
        if let Some(withheld) = withheld {
            render_app.insert_resource(withheld);
        }
        render_app
            .init_resource::<Arena>()
            .init_resource::<compute::Scratch>()
            .add_systems(RenderStartup, pipelines::init_splat_pipelines)
            .add_systems(
                Render,
                (update_arena, prepare::prepare_splats).chain().in_set(RenderSystems::PrepareBindGroups),
            )
            .add_systems(
                Core3d,
                accumulate_splats
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(main_transparent_pass_3d),
            );
    }
}
