//! What passes have to say, read back without a frame that waits for it.

use bevy::render::render_resource::{Buffer, BufferDescriptor, BufferUsages, MapMode};
use bevy::render::renderer::RenderDevice;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::task::Poll;

/// Nothing has been copied yet.
const OPEN: u8 = 0;
/// It has, or will have been when the frame is submitted.
const COPIED: u8 = 1;
/// It is on its way.
const ASKED: u8 = 2;
/// It can be read.
const THERE: u8 = 3;
/// It has been read, or cannot be.
const DONE: u8 = 4;

/// A buffer that is read once: passes copy to it, [`Answer::copied`] says so, and [`Answer::ask`] asks for it when the frame has been
/// submitted. Clones share it.
#[derive(Clone)]
pub struct Answer {
    buffer: Buffer,
    state: Arc<AtomicU8>,
}

impl Answer {
    /// One of so many bytes.
    pub fn new(bytes: u64, label: &'static str, device: &RenderDevice) -> Answer {
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some(label),
            size: bytes,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Answer { buffer, state: Arc::new(AtomicU8::new(OPEN)) }
    }

    /// What passes copy to.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Whether nothing has been copied yet.
    pub fn is_open(&self) -> bool {
        self.state.load(Ordering::Acquire) == OPEN
    }

    /// All of it is copied by the commands of this frame, or was by those of earlier ones.
    pub fn copied(&self) {
        // What has been asked for already is not asked for again.
        let _ = self.state.compare_exchange(OPEN, COPIED, Ordering::AcqRel, Ordering::Acquire);
    }

    /// Asks for what has been copied, once. No commands that copy to it may be waiting for their submission.
    pub fn ask(&self) {
        if self.state.compare_exchange(COPIED, ASKED, Ordering::AcqRel, Ordering::Acquire).is_ok() {
            let state = Arc::clone(&self.state);
            self.buffer.slice(..).map_async(MapMode::Read, move |result| {
                state.store(if result.is_ok() { THERE } else { DONE }, Ordering::Release);
            });
        }
    }

    /// The bytes, once; `None` where they cannot be read, or have been.
    pub fn take(&self) -> Poll<Option<Vec<u8>>> {
        match self.state.load(Ordering::Acquire) {
            THERE => {
                let bytes = self.buffer.slice(..).get_mapped_range().to_vec();
                self.buffer.unmap();
                self.state.store(DONE, Ordering::Release);
                Poll::Ready(Some(bytes))
            }
            DONE => Poll::Ready(None),
            _ => Poll::Pending,
        }
    }
}
