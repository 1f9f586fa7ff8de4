//! Which of the modes by tiles draws what a technique says, and between which planes.

use super::layered::Layered;
use super::sorted_splats::SortedSplats;
use super::spheres::Spheres;
use super::tiles::TilePicture;
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::extents::planes_of;
use crate::mode::LightPasses;
use crate::view::{Extent, PerspectiveGrid, View};
use bevy::prelude::EntityCommands;
use std::sync::Arc;

/// What the passes by tiles draw.
#[derive(Clone, Debug)]
pub enum TilePasses {
    /// Splats in the order of their depth.
    Sorted(SortedSplats),
    /// Splats in layers of depth.
    Layered(Layered),
    /// Spheres under one surface.
    Spheres(Spheres),
}

/// The pictures of all modes by tiles.
type TilePictures = (TilePicture<SortedSplats>, TilePicture<Layered>, TilePicture<Spheres>);

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
        Ok(Some(match passes {
            LightPasses::March(..) | LightPasses::Cartesian(..) => return Ok(None),
            LightPasses::Sorted { classifier, options, termination, density_scale } => {
                TilePasses::Sorted(SortedSplats {
                    classifier: Arc::new(classifier.clone()),
                    planes: planes(options.smallest, [options.near, options.far])?,
                    termination: *termination,
                    smallest: options.smallest,
                    density_scale: *density_scale,
                })
            }
            LightPasses::Layered { classifier, options, layers, assignment, termination } => {
                TilePasses::Layered(Layered {
                    classifier: Arc::new(classifier.clone()),
                    planes: planes(options.smallest, [options.near, options.far])?,
                    layers: *layers,
                    assignment: *assignment,
                    termination: *termination,
                    smallest: options.smallest,
                    longest: extents.iter().map(|extent| extent.margin).fold(0.0, f64::max),
                })
            }
            LightPasses::Spheres { options, light, colors, density_scale } => TilePasses::Spheres(Spheres {
                radius: options.radius,
                least: options.least,
                smoothing: options.smoothing,
                planes: planes(0.0, [options.near, options.far])?,
                density_scale: *density_scale,
                light: *light,
                colors: colors.clone(),
            }),
        }))
    }

    /// Depths of the first and the last particle that is drawn.
    pub fn planes(&self) -> [f64; 2] {
        match self {
            TilePasses::Sorted(mode) => mode.planes,
            TilePasses::Layered(mode) => mode.planes,
            TilePasses::Spheres(mode) => mode.planes,
        }
    }

    /// Has a camera draw this picture, and no other by tiles.
    pub fn show(self, number: u64, camera: &mut EntityCommands) {
        match self {
            TilePasses::Sorted(mode) => {
                camera.insert(TilePicture { number, mode }).remove::<(TilePicture<Layered>, TilePicture<Spheres>)>()
            }
            TilePasses::Layered(mode) => camera
                .insert(TilePicture { number, mode })
                .remove::<(TilePicture<SortedSplats>, TilePicture<Spheres>)>(),
            TilePasses::Spheres(mode) => camera
                .insert(TilePicture { number, mode })
                .remove::<(TilePicture<SortedSplats>, TilePicture<Layered>)>(),
        };
    }

    /// Has a camera draw none.
    pub fn hide(camera: &mut EntityCommands) {
        camera.remove::<TilePictures>();
    }
}
