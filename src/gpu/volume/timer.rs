//! GPU times of the passes of one slab, by timestamps, where the adapter has them.

use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::time::Duration;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet,
    QuerySetDescriptor, QueryType,
};

/// Bytes of a timestamp.
const STAMP: u64 = 8;

/// Timestamps around passes.
pub struct Timer {
    set: QuerySet,
    resolved: Buffer,
    passes: u32,
    nanoseconds: f32,
}

impl Timer {
    /// For this many passes; `None` where the adapter has no timestamps, or not so many.
    pub fn new(device: &RenderDevice, queue: &RenderQueue, passes: u32) -> Option<Timer> {
        let usable = device.features().contains(Features::TIMESTAMP_QUERY) && 2 * passes <= wgpu::QUERY_SET_MAX_QUERIES;
        usable.then(|| Timer {
            set: device.wgpu_device().create_query_set(&QuerySetDescriptor {
                label: Some("deepfield volume times"),
                ty: QueryType::Timestamp,
                count: 2 * passes,
            }),
            resolved: device.wgpu_device().create_buffer(&BufferDescriptor {
                label: Some("deepfield volume times"),
                size: 2 * STAMP * u64::from(passes),
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            passes,
            nanoseconds: queue.get_timestamp_period(),
        })
    }

    /// What a pass writes.
    pub fn around(&self, pass: u32) -> ComputePassTimestampWrites<'_> {
        ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        }
    }

    /// Copies all times to a buffer.
    pub fn copy(&self, encoder: &mut CommandEncoder, target: &Buffer, offset: u64) {
        encoder.resolve_query_set(&self.set, 0..2 * self.passes, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, target, offset, 2 * STAMP * u64::from(self.passes));
    }

    /// How long each pass took, from the copied bytes.
    pub fn read(&self, bytes: &[u8]) -> impl Iterator<Item = Duration> {
        let (stamps, _) = bytes.as_chunks::<8>();
        let period = f64::from(self.nanoseconds);
        let (spans, _) = stamps.as_chunks::<2>();
        spans.iter().map(move |[begin, end]| {
            let ticks = u64::from_le_bytes(*end).saturating_sub(u64::from_le_bytes(*begin));
            Duration::from_nanos((ticks as f64 * period) as u64)
        })
    }

    /// Bytes that [`Timer::copy`] copies.
    pub fn bytes(&self) -> u64 {
        2 * STAMP * u64::from(self.passes)
    }
}
