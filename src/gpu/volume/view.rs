//! What the main world says of a camera's volume, and what it hears of it.

use super::prepare::VolumeWork;
use crate::cpu::volume::{FieldRange, OpaqueDepths, Scenery, VolumeOptions};
use crate::gpu::light::LightCells;
use crate::view::{Extent, PerspectiveGrid, View};
use bevy::prelude::{Component, Resource};
use bevy::render::extract_component::ExtractComponent;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The particles in a camera's [`SplatView`](crate::gpu::SplatView) are drawn as a volume, in place of splats, or looked at as one.
#[derive(Component, Clone, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, VolumeWork, LightCells))]
pub struct VolumeView {
    /// How far the particles of each item in the list reach.
    pub extents: Arc<[Extent]>,
    /// The picture; an unchanged one is not drawn again.
    pub light: Option<VolumeJob>,
    /// Whose ranges are looked for.
    pub ranges: Option<VolumeJob>,
    /// Other passes draw the camera's light: only ranges are looked for.
    pub ranges_only: bool,
    /// Whether particles have an attribute.
    pub attribute: bool,
    /// Bytes of the adapter's memory that may be used.
    pub memory: u64,
    /// Slabs that one frame draws.
    pub slabs: u32,
}

/// A field, and what is wanted of it.
#[derive(Clone, Debug)]
pub struct VolumeJob {
    /// The caller's name for it: what comes back is for this number.
    pub number: u64,
    /// The camera and the pixels. The target may have more: then the picture is stretched.
    pub view: View,
    /// Where the samples lie.
    pub grid: PerspectiveGrid,
    /// How particles are summed. The planes are the grid's.
    pub options: VolumeOptions,
    /// One of so many particles is drawn, with the mass and the volume of all.
    pub stride: u32,
    /// What is wanted.
    pub shows: Shows,
}

/// What is wanted of a field.
#[derive(Clone, Debug)]
pub enum Shows {
    /// Its picture.
    Light(Arc<Scenery>),
    /// Between which values its mass lies.
    Ranges,
}

impl VolumeJob {
    /// Whether the same is wanted.
    pub fn is_same(&self, other: &VolumeJob) -> bool {
        let shows = match (&self.shows, &other.shows) {
            (Shows::Light(a), Shows::Light(b)) => Arc::ptr_eq(a, b),
            (Shows::Ranges, Shows::Ranges) => true,
            _ => false,
        };
        shows
            && self.number == other.number
            && self.view == other.view
            && self.grid == other.grid
            && self.options == other.options
            && self.stride == other.stride
    }
}

/// What has been found out about the volumes of a camera's frames.
#[derive(Clone, Debug, Default)]
pub struct VolumeFindings {
    /// The ranges of a job.
    pub ranges: Option<(u64, Option<FieldRange>)>,
    /// The last picture that is complete.
    pub drawn: Option<u64>,
    /// What a complete picture hides, where that was asked for.
    pub opaque: Option<(u64, Arc<OpaqueDepths>)>,
    /// Slabs that have been drawn of the present picture, and how many it has.
    pub slabs: [usize; 2],
    /// Pairs of a bin and a particle in it, over all slabs of the last complete picture.
    pub pairs: u64,
    /// Particles that the grid has enlarged, without those of slabs that nobody saw.
    pub raised: u64,
    /// Bricks that something may have reached.
    pub bricks: u64,
    /// Bytes on the adapter.
    pub bytes: u64,
    /// The job for which there was no room even for the thinnest slabs.
    pub no_room: Option<u64>,
    /// Slabs are thinner than asked for, since the adapter has no more memory.
    pub thinner: bool,
}

/// What the render world tells the main world of volumes. Clones share it.
#[derive(Resource, Clone, Debug, Default)]
pub struct VolumeNews(Arc<Mutex<VolumeFindings>>);

impl VolumeNews {
    /// What is known now.
    pub fn now(&self) -> VolumeFindings {
        self.lock().clone()
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, VolumeFindings> {
        // Every change is one assignment: whoever panicked left something consistent.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
