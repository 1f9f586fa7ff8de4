//! Buffers that are kept from picture to picture while they are large enough.

use crate::gpu::field_samples::HeldSamples;
use bevy::platform::collections::HashMap;
use bevy::render::render_resource::{BindingResource, Buffer, BufferBinding, BufferDescriptor, BufferUsages};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::num::NonZeroU64;

/// A buffer, and how many of its bytes are in use.
#[derive(Clone, Debug)]
pub struct Held {
    /// The buffer.
    pub buffer: Buffer,
    /// Bytes in use.
    pub bytes: u64,
}

impl Held {
    /// All that is in use.
    pub fn binding(&self) -> BindingResource<'_> {
        self.part(self.bytes)
    }

    /// The first bytes: of a list of uniforms, which one being told with the bind group.
    pub fn part(&self, bytes: u64) -> BindingResource<'_> {
        BindingResource::Buffer(BufferBinding { buffer: &self.buffer, offset: 0, size: NonZeroU64::new(bytes) })
    }
}

/// Buffers by what they are for, and the samples of a field.
#[derive(Debug, Default)]
pub struct Store {
    buffers: HashMap<(&'static str, usize), Buffer>,
    /// The field that was drawn last.
    pub samples: Option<HeldSamples>,
}

impl Store {
    /// A buffer with room for `bytes`; what it holds is not said.
    pub fn room(&mut self, device: &RenderDevice, name: &'static str, index: usize, bytes: u64) -> Held {
        let bytes = bytes.next_multiple_of(4).max(16);
        let fits = |buffer: &&Buffer| buffer.size() >= bytes;
        if let Some(buffer) = self.buffers.get(&(name, index)).filter(fits) {
            return Held { buffer: buffer.clone(), bytes };
        }
        // Before the larger one is made.
        self.buffers.remove(&(name, index));
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some(name),
            size: bytes,
            usage: BufferUsages::STORAGE
                | BufferUsages::UNIFORM
                | BufferUsages::INDIRECT
                | BufferUsages::COPY_SRC
                | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.buffers.insert((name, index), buffer.clone());
        Held { buffer, bytes }
    }

    /// A buffer that holds these bytes.
    pub fn holding(
        &mut self,
        device: &RenderDevice,
        queue: &RenderQueue,
        name: &'static str,
        index: usize,
        bytes: &[u8],
    ) -> Held {
        let held = self.room(device, name, index, bytes.len() as u64);
        queue.write_buffer(&held.buffer, 0, bytes);
        held
    }

    /// What all of them take.
    pub fn bytes(&self) -> u64 {
        let samples = self.samples.as_ref().map_or(0, HeldSamples::bytes);
        self.buffers.values().map(|buffer| buffer.size()).sum::<u64>() + samples
    }

    /// Frees everything.
    pub fn clear(&mut self) {
        self.buffers.clear();
        self.samples = None;
    }
}
