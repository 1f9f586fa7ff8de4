//! Which of the modes by tiles draws what a technique says, and between which planes.

use super::layered::Layered;
use super::over_splats::OverSplats;
use super::sorted_splats::SortedSplats;
use super::spheres::Spheres;
use super::tiles::TilePicture;
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::extents::planes_of;
use crate::mode::LightPasses;
use crate::view::perspective_grid::GridError;
use crate::view::{Extent, PerspectiveGrid, View};
use bevy::prelude::EntityCommands;
use std::sync::Arc;

/// What the passes by tiles draw, and whether it is told what that hides.
#[derive(Clone, Debug)]
pub struct TilePasses {
    mode: TileModes,
    /// Whether [`TileNews`](super::tiles::TileNews) says what the picture hides.
    pub occlusion: bool,
}

/// One of the modes by tiles.
#[derive(Clone, Debug)]
enum TileModes {
    /// Splats in the order of their depth.
    Sorted(SortedSplats),
    /// Splats over each other.
    Over(OverSplats),
    /// Splats in layers of depth.
    Layered(Layered),
    /// Spheres under one surface.
    Spheres(Spheres),
}

/// The pictures of all modes by tiles.
type TilePictures = (TilePicture<SortedSplats>, TilePicture<OverSplats>, TilePicture<Layered>, TilePicture<Spheres>);

impl TilePasses {
    /// What draws a view of particles that reach so far, as the processor would; `None` for passes that are not by tiles.
    ///
    /// # Errors
    /// [`VolumeError`] for planes that make no sense, and where nothing is in view.
    pub fn of(passes: &LightPasses, view: &View, extents: &[Extent]) -> Result<Option<TilePasses>, VolumeError> {
        let planes = |smallest: f64, ends| {
            let smallest = smallest * PerspectiveGrid::sigma_of(view, 1.0);
            planes_of(view, extents.iter().copied(), smallest, ends)
        };
        let (mode, occlusion) = match passes {
            LightPasses::March(..) | LightPasses::Columns(_) | LightPasses::Cartesian(..) => return Ok(None),
            LightPasses::Sorted { classifier, options, termination, density_scale } => {
                let mode = TileModes::Sorted(SortedSplats {
                    classifier: Arc::new(classifier.clone()),
                    planes: planes(options.smallest, [options.near, options.far])?,
                    termination: *termination,
                    smallest: options.smallest,
                    density_scale: *density_scale,
                });
                (mode, options.occlusion)
            }
            LightPasses::Over { colors, column, attribute } => {
                let planes = OverSplats::planes(view, extents).ok_or(GridError::NothingInView)?;
                let (colors, column, attribute) = (Arc::clone(colors), *column, *attribute);
                (TileModes::Over(OverSplats { colors, column, attribute, planes }), false)
            }
            LightPasses::Layered { classifier, options, layers, assignment, termination } => {
                let mode = TileModes::Layered(Layered {
                    classifier: Arc::new(classifier.clone()),
                    planes: planes(options.smallest, [options.near, options.far])?,
                    layers: *layers,
                    assignment: *assignment,
                    termination: *termination,
                    smallest: options.smallest,
                    longest: extents.iter().map(|extent| extent.margin).fold(0.0, f64::max),
                });
                (mode, options.occlusion)
            }
            LightPasses::Spheres { options, light, colors, density_scale } => {
                let mode = TileModes::Spheres(Spheres {
                    radius: options.radius,
                    least: options.least,
                    smoothing: options.smoothing,
                    planes: planes(0.0, [options.near, options.far])?,
                    density_scale: *density_scale,
                    light: *light,
                    colors: colors.clone(),
                });
                (mode, options.occlusion)
            }
        };
        Ok(Some(TilePasses { mode, occlusion }))
    }

    /// The spheres, if they are drawn.
    pub fn spheres(&self) -> Option<&Spheres> {
        match &self.mode {
            TileModes::Spheres(mode) => Some(mode),
            TileModes::Sorted(_) | TileModes::Over(_) | TileModes::Layered(_) => None,
        }
    }

    /// Depths of the first and the last particle that is drawn.
    pub fn planes(&self) -> [f64; 2] {
        match &self.mode {
            TileModes::Sorted(mode) => mode.planes,
            TileModes::Over(mode) => mode.planes,
            TileModes::Layered(mode) => mode.planes,
            TileModes::Spheres(mode) => mode.planes,
        }
    }

    /// Has a camera draw this picture, and no other by tiles; lists, and what is made of them, may take so many bytes.
    pub fn show(self, number: u64, memory: u64, camera: &mut EntityCommands) {
        let occlusion = self.occlusion;
        match self.mode {
            TileModes::Sorted(mode) => camera.insert(TilePicture { number, mode, occlusion, memory }).remove::<(
                TilePicture<OverSplats>,
                TilePicture<Layered>,
                TilePicture<Spheres>,
            )>(),
            TileModes::Over(mode) => camera.insert(TilePicture { number, mode, occlusion, memory }).remove::<(
                TilePicture<SortedSplats>,
                TilePicture<Layered>,
                TilePicture<Spheres>,
            )>(),
            TileModes::Layered(mode) => camera.insert(TilePicture { number, mode, occlusion, memory }).remove::<(
                TilePicture<SortedSplats>,
                TilePicture<OverSplats>,
                TilePicture<Spheres>,
            )>(),
            TileModes::Spheres(mode) => camera.insert(TilePicture { number, mode, occlusion, memory }).remove::<(
                TilePicture<SortedSplats>,
                TilePicture<OverSplats>,
                TilePicture<Layered>,
            )>(),
        };
    }

    /// Has a camera draw none.
    pub fn hide(camera: &mut EntityCommands) {
        camera.remove::<TilePictures>();
    }
}
