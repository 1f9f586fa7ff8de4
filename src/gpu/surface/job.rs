//! What a camera is told to draw of measured heights, and what is known of it.

use super::work::SurfaceWork;
use crate::gpu::news::News;
use crate::picture::adapter::AdapterSurface;
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponent;
use std::sync::Arc;

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

/// What is known of surfaces.
pub type SurfaceNews = News<SurfaceFindings>;
