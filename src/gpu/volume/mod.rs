//! Volumes and isosurfaces through the perspective grid (F12 chapter 5) by compute passes of the frame: step for step what
//! [`crate::cpu::volume`] does, which is what its pictures are held against.
//!
//! A camera with a [`VolumeView`] beside its [`SplatView`](super::SplatView) draws the particles of that list as a volume. The grid is cut
//! as the adapter's memory asks ([`cut`]); each frame draws as many slabs as it has time for ([`prepare`]), from front to back, and a
//! picture that is complete becomes the camera's [`LightCells`](super::light::LightCells). For each slab and each batch of the particles
//! that reach into it ([`pass`]):
//!
//! 1. `project`: particles are loaded from the arena, brought to camera space and enlarged to what the grid can hold.
//! 2. `count`, `pair`: they are binned, each to eight bins at most of one of several levels; a pair of bin and particle knows which
//!    quarters of the bin the particle may reach.
//! 3. `tally`, `move_pairs`: pairs of bin and particle are sorted by bins; equal ones keep their order, so that
//!    nothing depends on which workgroup is first.
//! 4. `gather`: each brick of 8 x 8 x 8 cells sums up its own particles, in registers; wide ones in bricks of the coarser grids
//!    that [`crate::cpu::volume::coarse`] brings them to, the tiers.
//!
//! Then, for each slab:
//!
//! 5. `bound`, `mark`, `need`, `choose`, `interpolate`: each tier gets what the next coarser one holds, where that may show.
//! 6. `cast_rays`: all rays go through it; what they have gathered is carried to the next one.
//! 7. `occlude`, `pyramid`: columns of bricks behind opaque pixels are left out from now on.
//!
//! Of a Cartesian grid ([`Shows::Cartesian`]) the view is one along an axis, and the finest tier holds all layers: no slab takes the
//! place of one before. In place of 6 and 7, when all of them are filled:
//!
//! 8. `find_rooms`: how dense the field is at most in rooms of it and around them.
//! 9. `march`: rays of the picture's camera go through it ([`march`]).
//!
//! What covers each pixel ([`mod@covering`]), or the surface whose light is smoothed, 6 keeps, and further passes take it over with the last slab.
//!
//! Of columns of particles ([`Shows::Columns`]) 1 to 5 are done for each by itself, and [`mod@column`] puts together what cells show.
//!
//! Of a sampled field ([`Shows::Field`]) two passes of its own ([`field`]) fill the bricks of each slab in place of 1 to 5.
//!
//! A job of [`Shows::Ranges`] does `measure` instead: the masses of all densities and attributes, which are read back without waiting.

pub mod column;
pub mod constants;
pub mod covering;
pub mod cut;
pub mod field;
pub mod layout;
pub mod programs;

pub mod march;

mod bindings;
mod pass;
mod prepare;
mod room;
mod store;
mod view;
mod work;

pub use pass::draw_volumes;
pub use prepare::VolumeWork;
pub use room::Room;
pub use view::{CartesianPicture, FieldPicture, Shows, VolumeFindings, VolumeJob, VolumeNews, VolumeView};

use super::arena::update_arena;
use super::light::show_light;
use super::splat::init_splat_pipelines;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};

/// Adds the volume passes, behind those of splats.
pub struct VolumePlugin;

impl Plugin for VolumePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<VolumeView>::default());
        let news = app.world_mut().get_resource_or_init::<VolumeNews>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(news)
            .add_systems(RenderStartup, prepare::init_volume_pipelines.after(init_splat_pipelines))
            .add_systems(
                Render,
                (
                    prepare::prepare_volumes.in_set(RenderSystems::PrepareBindGroups).after(update_arena),
                    prepare::ask_for_answers.in_set(RenderSystems::Cleanup),
                ),
            )
            .add_systems(
                Core3d,
                draw_volumes
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(show_light)
                    .before(main_transparent_pass_3d),
            );
    }
}
