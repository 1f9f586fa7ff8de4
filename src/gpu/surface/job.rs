//! What a camera is told to draw of measured heights, and what is known of it.

use super::work::SurfaceWork;
use crate::cpu::surface::look::Look;
use crate::cpu::surface::select::Technique;
use crate::cpu::surface::stitch::Scene;
use crate::picture::adapter::AdapterSurface;
use crate::view::View;
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponent;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What is drawn.
#[derive(Clone)]
pub struct SurfaceJob {
    /// The chunks, and what they lie in.
    pub scene: Arc<Scene>,
    /// The camera, whose pixels are the samples of the picture.
    pub view: View,
    /// Samples along the side of a pixel.
    pub parts: u32,
    /// What it looks like.
    pub look: Look,
    /// What it is drawn as: no rays.
    pub technique: Technique,
    /// The height that others are counted from; the same for all pictures of a field.
    pub reference: f64,
    /// Whether the adapter's rasteriser finds what is seen, and not compute passes.
    pub is_raster: bool,
}

impl SurfaceJob {
    /// Of what a session asks an adapter for.
    pub fn new(job: &AdapterSurface<'_>, is_raster: bool) -> SurfaceJob {
        SurfaceJob {
            scene: Arc::clone(job.scene),
            view: *job.view,
            parts: job.parts.max(1),
            look: job.look.clone(),
            technique: job.technique,
            reference: job.reference,
            is_raster,
        }
    }

    /// Width and height of the picture, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.view.width, self.view.height].map(|samples| samples / self.parts)
    }
}

/// On a camera with a [`LightView`](crate::gpu::LightView): it shows measured heights (main world, extracted).
#[derive(Component, Clone, ExtractComponent)]
#[extract_component_sync_target((Self, SurfaceWork))]
pub struct SurfaceView {
    /// The caller's name for the picture.
    pub number: u64,
    /// What is drawn.
    pub job: Arc<SurfaceJob>,
    /// Bytes that samples may take.
    pub memory: u64,
}

/// What has been found out about a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceFindings {
    /// Its number.
    pub number: u64,
    /// Whether there was no room for it: then nothing is drawn.
    pub no_room: bool,
}

/// What the render world tells the main world of surfaces. Clones share it.
#[derive(Resource, Clone, Debug, Default)]
pub struct SurfaceNews(Arc<Mutex<SurfaceFindings>>);

impl SurfaceNews {
    /// What is known now.
    pub fn now(&self) -> SurfaceFindings {
        *self.lock()
    }

    /// Tells.
    pub(super) fn tell(&self, found: SurfaceFindings) {
        *self.lock() = found;
    }

    fn lock(&self) -> MutexGuard<'_, SurfaceFindings> {
        // Every change is one assignment: whoever panicked left something consistent.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
