//! Reads buffers and textures back, waiting for the GPU.

use bevy::prelude::UVec2;
use bevy::render::render_resource::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, Extent3d, MapMode, PollType, TexelCopyBufferInfo,
    TexelCopyBufferLayout, Texture,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// Bytes per pixel of the textures that are read.
const PIXEL: u32 = 4;
/// Rows of a texture in a buffer begin at multiples of this.
const ROW_ALIGNMENT: u32 = 256;

fn staging(device: &RenderDevice, size: u64) -> Buffer {
    device.create_buffer(&BufferDescriptor {
        label: Some("deepfield readback"),
        size,
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Waits for the GPU and copies a staging buffer; `None` if it cannot be mapped.
fn map(device: &RenderDevice, buffer: &Buffer) -> Option<Vec<u8>> {
    let slice = buffer.slice(..);
    let (sender, receiver) = std::sync::mpsc::channel();
    slice.map_async(MapMode::Read, move |result| {
        // The receiver waits below; if it is gone nobody wants the answer.
        let _ = sender.send(result.is_ok());
    });
    device.poll(PollType::wait_indefinitely()).ok()?;
    if !receiver.recv().ok()? {
        return None;
    }
    let bytes = slice.get_mapped_range().to_vec();
    buffer.unmap();
    Some(bytes)
}

/// Bytes `offset` to `offset + size` of a buffer with usage COPY_SRC; both multiples of 4.
pub fn read_buffer(
    device: &RenderDevice,
    queue: &RenderQueue,
    source: &Buffer,
    offset: u64,
    size: u64,
) -> Option<Vec<u8>> {
    let buffer = staging(device, size);
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(source, offset, &buffer, 0, size);
    queue.submit([encoder.finish()]);
    map(device, &buffer)
}

/// The pixels of a texture with four bytes a pixel and usage COPY_SRC, row 0 at the top.
pub fn read_texture(
    device: &RenderDevice,
    queue: &RenderQueue,
    texture: &Texture,
    size: UVec2,
) -> Option<Vec<[u8; 4]>> {
    let row = (size.x * PIXEL).next_multiple_of(ROW_ALIGNMENT);
    let buffer = staging(device, u64::from(row) * u64::from(size.y));
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        TexelCopyBufferInfo {
            buffer: &buffer,
            layout: TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
        },
        Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
    );
    queue.submit([encoder.finish()]);
    let bytes = map(device, &buffer)?;
    let mut pixels = Vec::with_capacity(size.x as usize * size.y as usize);
    for line in bytes.chunks_exact(row as usize) {
        let (line, _) = line[..(size.x * PIXEL) as usize].as_chunks::<4>();
        pixels.extend_from_slice(line);
    }
    Some(pixels)
}
