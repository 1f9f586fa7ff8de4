//! What the samples of a picture show, read back.

use super::work::SurfaceWork;
use crate::gpu::readback::read_buffer;
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// The number of what each sample of a picture that has been drawn shows, row by row; [`NONE`](super::constants::NONE) where nothing is. `None`
/// where that cannot be read.
pub fn numbers(work: &SurfaceWork, device: &RenderDevice, queue: &RenderQueue) -> Option<Vec<u32>> {
    let (buffer, stride, [width, height]) = work.shown()?;
    let bytes = 4 * u64::from(stride) * u64::from(height);
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(device, queue, buffer, 0, bytes)?);
    let rows = words.chunks_exact(stride as usize).flat_map(|row| &row[..width as usize]);
    // Passes keep them inverted: nothing is 0.
    Some(rows.map(|word| !word).collect())
}

/// How many pixels of a picture whose colours have been drawn are covered by what was measured. `None` where that cannot be read.
pub fn covered(work: &SurfaceWork, device: &RenderDevice, queue: &RenderQueue) -> Option<f64> {
    let (buffer, pixels) = work.covered()?;
    let shares: Vec<f32> = bytemuck::pod_collect_to_vec(&read_buffer(device, queue, buffer, 0, 4 * pixels)?);
    Some(shares.into_iter().map(f64::from).sum())
}
