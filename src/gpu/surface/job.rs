//! What a camera is told to draw of measured heights, and what is known of it.

use super::work::SurfaceWork;
use crate::picture::adapter::AdapterSurface;
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponent;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// On a camera with a [`LightView`](crate::gpu::LightView): it shows measured heights (main world, extracted).
#[derive(Component, Clone, ExtractComponent)]
#[extract_component_sync_target((Self, SurfaceWork))]
pub struct SurfaceView {
    /// The caller's name for the picture.
    pub number: u64,
    /// What is drawn.
    pub job: Arc<AdapterSurface>,
    /// Bytes that samples may take.
    pub memory: u64,
    /// Whether colours are drawn; else only what each sample shows is found.
    pub is_colored: bool,
}

/// What has been found out about a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceFindings {
    /// Its number.
    pub number: u64,
    /// Whether there was no room for it: then nothing is drawn.
    pub no_room: bool,
    /// Whether it has been drawn.
    pub is_drawn: bool,
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
