//! Equal slots of a buffer on the adapter. What is in one is copied once while it stays; what has not been drawn for longest makes room.

use bevy::render::render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::tasks::block_on;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Weak};
use wgpu::ErrorFilter;

/// What is handed over at once: each time the driver holds a copy of it.
const PORTION: usize = 64;

/// What is in a slot.
#[derive(Debug)]
struct Slot<T> {
    /// As long as this is kept nothing else has its address.
    content: Weak<T>,
    /// The picture that it was drawn in last.
    used: u64,
}

/// Slots on the adapter.
#[derive(Debug)]
pub struct Pool<T> {
    label: &'static str,
    /// Words of a slot.
    words: u64,
    buffer: Option<Buffer>,
    slots: Vec<Slot<T>>,
    /// Slots by the addresses of what is in them.
    known: HashMap<usize, usize>,
    /// Counts pictures.
    picture: u64,
}

/// Where what a picture needs is.
pub struct Held {
    /// All slots.
    pub buffer: Buffer,
    slots: HashMap<usize, usize>,
    slot_words: u64,
}

impl Held {
    /// The first word of something.
    pub fn first_word<T>(&self, content: &Arc<T>) -> Option<u32> {
        self.slots.get(&address(content)).map(|slot| (*slot as u64 * self.slot_words) as u32)
    }
}

fn address<T>(content: &Arc<T>) -> usize {
    Arc::as_ptr(content).addr()
}

impl<T: Send + Sync> Pool<T> {
    /// Without slots, which have so many words each.
    pub fn new(label: &'static str, words: u64) -> Pool<T> {
        Pool { label, words, buffer: None, slots: Vec::new(), known: HashMap::new(), picture: 0 }
    }

    /// Bytes of the buffer.
    pub fn bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, |buffer| buffer.size())
    }

    /// How many slots there may be in so much memory.
    pub fn most(&self, memory: u64, device: &RenderDevice) -> u64 {
        let limits = device.limits();
        let most = memory.min(limits.max_buffer_size).min(limits.max_storage_buffer_binding_size);
        most.min(4 * u64::from(u32::MAX)) / (4 * self.words)
    }

    /// Holds what a picture needs; `None` where there is no room for all of it in so much memory. The words of each are asked for by its number.
    pub fn hold(
        &mut self,
        wanted: &[&Arc<T>],
        memory: u64,
        (device, queue): (&RenderDevice, &RenderQueue),
        packed: impl Fn(usize) -> Vec<u32> + Sync,
    ) -> Option<Held> {
        let most = self.most(memory, device);
        if wanted.len() as u64 > most {
            return None;
        }
        self.picture += 1;
        let mut missing = Vec::new();
        for (number, content) in wanted.iter().enumerate() {
            match self.known.get(&address(content)) {
                Some(slot) => self.slots[*slot].used = self.picture,
                None => missing.push(number),
            }
        }
        let free = self.slots.iter().filter(|slot| slot.used < self.picture).count();
        // A picture that shows nothing has a buffer, too.
        if missing.len() > free || self.buffer.is_none() {
            let needed = (self.slots.len() + missing.len()).saturating_sub(free).max(1);
            self.grow(needed.max((2 * self.slots.len()).min(most as usize)), (device, queue))?;
        }
        self.copy(&missing, wanted, queue, packed);
        let found = |content: &&Arc<T>| Some((address(content), *self.known.get(&address(content))?));
        let slots = wanted.iter().filter_map(found).collect();
        Some(Held { buffer: self.buffer.clone()?, slots, slot_words: self.words })
    }

    /// Makes room for so many slots; `None` where the adapter has none.
    fn grow(&mut self, slots: usize, (device, queue): (&RenderDevice, &RenderQueue)) -> Option<()> {
        let size = 4 * self.words * slots as u64;
        let scope = device.wgpu_device().push_error_scope(ErrorFilter::OutOfMemory);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some(self.label),
            size,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        if block_on(scope.pop()).is_some() {
            return None;
        }
        if let Some(before) = &self.buffer {
            let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(before, 0, &buffer, 0, before.size());
            queue.submit([encoder.finish()]);
        }
        self.buffer = Some(buffer);
        self.slots.resize_with(slots, || Slot { content: Weak::new(), used: 0 });
        Some(())
    }

    /// Copies some of what is wanted into slots that this picture does not need.
    fn copy(
        &mut self,
        missing: &[usize],
        wanted: &[&Arc<T>],
        queue: &RenderQueue,
        packed: impl Fn(usize) -> Vec<u32> + Sync,
    ) {
        let Some(buffer) = self.buffer.clone() else { return };
        let mut free: Vec<usize> = (0..self.slots.len()).filter(|slot| self.slots[*slot].used < self.picture).collect();
        free.sort_by_key(|slot| self.slots[*slot].used);
        let mut free = free.into_iter();
        for portion in missing.chunks(PORTION) {
            let packed: Vec<Vec<u32>> = portion.par_iter().map(|number| packed(*number)).collect();
            for (number, words) in portion.iter().zip(packed) {
                let Some(slot) = free.next() else { return };
                let content = wanted[*number];
                let before = self.slots[slot].content.as_ptr().addr();
                if self.known.get(&before) == Some(&slot) {
                    self.known.remove(&before);
                }
                self.slots[slot] = Slot { content: Arc::downgrade(content), used: self.picture };
                self.known.insert(address(content), slot);
                queue.write_buffer(&buffer, 4 * self.words * slot as u64, bytemuck::cast_slice(&words));
            }
            // Or all copies would be there at the same time.
            queue.submit([]);
        }
    }
}
