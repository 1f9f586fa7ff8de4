//! Buffers and textures that are kept from picture to picture while they are large enough.

use bevy::render::render_resource::{
    BindingResource, Buffer, BufferBinding, BufferDescriptor, BufferUsages, Extent3d, Texture, TextureDescriptor,
    TextureDimension, TextureFormat, TextureUsages,
};
use bevy::render::renderer::RenderDevice;
use std::num::NonZeroU64;

/// Storage and uniform bindings may begin at multiples of this.
pub const ALIGNMENT: u64 = 256;

/// A buffer of at least `bytes`, kept from before if that is large enough.
pub fn at_least(
    existing: Option<Buffer>,
    bytes: u64,
    usage: BufferUsages,
    label: &'static str,
    device: &RenderDevice,
) -> Buffer {
    match existing {
        Some(buffer) if buffer.size() >= bytes => buffer,
        _ => device.create_buffer(&BufferDescriptor {
            label: Some(label),
            // Some room to grow, so that a moving camera does not allocate in every frame.
            size: (bytes + bytes / 4).next_multiple_of(ALIGNMENT),
            usage,
            mapped_at_creation: false,
        }),
    }
}

/// Bytes of buffers.
pub fn size_of_all<'a>(buffers: impl IntoIterator<Item = &'a Buffer>) -> u64 {
    buffers.into_iter().map(|buffer| buffer.size()).sum()
}

/// All of a buffer.
pub fn whole(buffer: &Buffer) -> BindingResource<'_> {
    buffer.as_entire_binding()
}

/// A range of a buffer, bytes.
pub fn slice(buffer: &Buffer, offset: u64, size: u64) -> BindingResource<'_> {
    BindingResource::Buffer(BufferBinding { buffer, offset, size: NonZeroU64::new(size) })
}

/// A texture of pairs of 32-bit floats that shaders draw into and read.
pub fn pairs(size: [u32; 2], label: &'static str, device: &RenderDevice) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some(label),
        size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format: TextureFormat::Rg32Float,
        usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}
