//! What covers the pixels of a picture, read back.

use super::prepare::VolumeWork;
use super::store::Held;
use crate::cpu::shadowing::Covering;
use crate::gpu::readback::read_buffer;
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// What covers each pixel of a camera's last complete picture, of one that keeps it, with the light that it has there. `None` where that cannot be
/// read.
pub fn read(work: &VolumeWork, device: &RenderDevice, queue: &RenderQueue) -> Option<Covering> {
    let pixels = |held: &Held| -> Option<Vec<[f32; 4]>> {
        let found = read_buffer(device, queue, &held.buffer, 0, held.bytes)?;
        Some(bytemuck::pod_collect_to_vec(&found))
    };
    let [points, tints] = work.faces()?;
    let (points, tints) = (pixels(points)?, pixels(tints)?);
    let depth = |(point, tint): (&[f32; 4], &[f32; 4])| if tint[3] > 0.0 { point[2] } else { f32::INFINITY };
    let depths = points.iter().zip(&tints).map(depth).collect();
    let light = tints.iter().map(|[red, green, blue, share]| [red, green, blue].map(|channel| share * channel));
    Some(Covering { depths, light: Some(light.collect()), slack: 0.0 })
}
