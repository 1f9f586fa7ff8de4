//! Samples of chunks on the adapter: one buffer of equal slots. A chunk is copied once while it stays; those that have not been drawn for
//! longest make room.

use super::constants::{CHUNK, UNMEASURED};
use super::layout::counted;
use crate::color::colors::to_encoded;
use crate::cpu::surface::look::Attribute;
use crate::cpu::surface::source::NodeSamples;
use crate::cpu::surface::stitch::Scene;
use crate::heights::hierarchy::chunks::ChunkKey;
use crate::heights::measure::Form;
use crate::picture::adapter::AdapterSurface;
use bevy::prelude::Resource;
use bevy::render::render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::tasks::block_on;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Weak};
use wgpu::ErrorFilter;

/// Samples of a slot: of the largest chunk, which closes a globe and has a column more than others.
const SLOT: u64 = ((CHUNK + 1) * (CHUNK + 2)) as u64;
/// Chunks that are handed over at once: each time the driver holds a copy of them.
const PORTION: usize = 64;

/// What the words of a slot mean.
#[derive(Clone, Debug, Default, PartialEq)]
struct Meaning {
    /// What the last word of a sample is.
    values: Values,
    /// The height that others are counted from.
    reference: f64,
}

/// What samples have beside heights, normals and coverage: a word, or nothing.
#[derive(Clone, Debug, Default, PartialEq)]
enum Values {
    #[default]
    None,
    /// Colours of up to four planes, a byte each.
    Planes(Vec<usize>),
    /// How much higher they are than an earlier field.
    Changes,
    /// The height of a form.
    Form(Arc<Form>),
}

/// The chunk in a slot.
#[derive(Debug, Default)]
struct Slot {
    /// As long as this is kept no other chunk has its address.
    samples: Weak<NodeSamples>,
    /// The picture that it was drawn in last.
    used: u64,
}

impl Chunk<'_> {
    /// The heights of a form at its samples.
    fn heights_of(&self, form: &Form, scene: &Scene) -> Vec<f64> {
        let [rows, columns] = [0, 1].map(|axis| scene.lattice.places(self.key, axis));
        let places = rows.iter().flat_map(|row| columns.iter().map(move |column| (*row as f64, *column as f64)));
        places.map(|(row, column)| form.height(scene.placed.file_place(row, column))).collect()
    }
}

/// Samples on the adapter (render world).
#[derive(Resource, Debug, Default)]
pub struct SurfaceArena {
    buffer: Option<Buffer>,
    meaning: Meaning,
    slots: Vec<Slot>,
    /// Slots by the addresses of what is in them.
    known: HashMap<usize, usize>,
    /// Counts pictures.
    picture: u64,
}

/// Where the chunks of a picture are.
pub struct Held {
    /// All slots.
    pub buffer: Buffer,
    slots: HashMap<usize, usize>,
    slot_words: u64,
}

impl Held {
    /// The first word of a chunk.
    pub fn first_word(&self, samples: &Arc<NodeSamples>) -> Option<u32> {
        self.slots.get(&address(samples)).map(|slot| (*slot as u64 * self.slot_words) as u32)
    }
}

fn address(samples: &Arc<NodeSamples>) -> usize {
    Arc::as_ptr(samples).addr()
}

/// A chunk that is drawn, or that one lies in.
pub struct Chunk<'a> {
    /// Which.
    pub key: ChunkKey,
    /// Its samples.
    pub samples: &'a Arc<NodeSamples>,
}

impl SurfaceArena {
    /// Bytes of the buffer.
    pub fn bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, |buffer| buffer.size())
    }

    /// Holds the chunks of a picture; `None` where there is no room for all of them in so much memory.
    pub fn hold(
        &mut self,
        job: &AdapterSurface,
        memory: u64,
        (device, queue): (&RenderDevice, &RenderQueue),
    ) -> Option<Held> {
        let scene = &job.scene;
        let drawn = scene.meshes.iter().map(|mesh| Chunk { key: mesh.node.key, samples: &mesh.samples });
        let above = scene.ancestors.iter().map(|(key, samples)| Chunk { key: *key, samples });
        let chunks: Vec<Chunk<'_>> = drawn.chain(above).collect();
        let meaning = Meaning { values: Values::of(job), reference: job.reference };
        if meaning != self.meaning {
            *self = SurfaceArena { picture: self.picture, meaning, ..SurfaceArena::default() };
        }
        self.picture += 1;
        let slot_words = self.meaning.words() * SLOT;
        let limits = device.limits();
        let most = memory.min(limits.max_buffer_size).min(limits.max_storage_buffer_binding_size);
        let most = most.min(4 * u64::from(u32::MAX)) / (4 * slot_words);
        if chunks.len() as u64 > most {
            return None;
        }
        let mut missing = Vec::new();
        for chunk in &chunks {
            match self.known.get(&address(chunk.samples)) {
                Some(slot) => self.slots[*slot].used = self.picture,
                None => missing.push(chunk),
            }
        }
        let free = self.slots.iter().filter(|slot| slot.used < self.picture).count();
        if missing.len() > free {
            let needed = self.slots.len() + missing.len() - free;
            self.grow(needed.max((2 * self.slots.len()).min(most as usize)), (device, queue))?;
        }
        self.copy(&missing, scene, queue);
        let found = |chunk: &Chunk<'_>| Some((address(chunk.samples), *self.known.get(&address(chunk.samples))?));
        let slots = chunks.iter().filter_map(found).collect();
        Some(Held { buffer: self.buffer.clone()?, slots, slot_words })
    }

    /// Makes room for so many chunks; `None` where the adapter has none.
    fn grow(&mut self, slots: usize, (device, queue): (&RenderDevice, &RenderQueue)) -> Option<()> {
        let size = 4 * self.meaning.words() * SLOT * slots as u64;
        let scope = device.wgpu_device().push_error_scope(ErrorFilter::OutOfMemory);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some("deepfield surface samples"),
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
        self.slots.resize_with(slots, Slot::default);
        Some(())
    }

    /// Copies chunks into slots that this picture does not need.
    fn copy(&mut self, missing: &[&Chunk<'_>], scene: &Scene, queue: &RenderQueue) {
        let Some(buffer) = self.buffer.clone() else { return };
        let mut free: Vec<usize> = (0..self.slots.len()).filter(|slot| self.slots[*slot].used < self.picture).collect();
        free.sort_by_key(|slot| self.slots[*slot].used);
        let mut free = free.into_iter();
        for portion in missing.chunks(PORTION) {
            let packed: Vec<Vec<u32>> = portion
                .par_iter()
                .map(|chunk| self.meaning.packed(chunk.samples, |form| chunk.heights_of(form, scene)))
                .collect();
            for (chunk, words) in portion.iter().zip(packed) {
                let Some(slot) = free.next() else { return };
                let before = self.slots[slot].samples.as_ptr().addr();
                if self.known.get(&before) == Some(&slot) {
                    self.known.remove(&before);
                }
                self.slots[slot] = Slot { samples: Arc::downgrade(chunk.samples), used: self.picture };
                self.known.insert(address(chunk.samples), slot);
                let first = 4 * self.meaning.words() * SLOT * slot as u64;
                queue.write_buffer(&buffer, first, bytemuck::cast_slice(&words));
            }
            // Or all copies would be there at the same time.
            queue.submit([]);
        }
    }
}

impl Values {
    /// What a picture is coloured by.
    fn of(job: &AdapterSurface) -> Values {
        match job.look.attribute {
            Attribute::Plane(plane) => Values::Planes(vec![plane]),
            Attribute::Texture(planes) => Values::Planes(planes.to_vec()),
            Attribute::Difference => Values::Changes,
            // Without a form residuals are heights above 0.
            Attribute::Residual => job.form.clone().map_or(Values::None, Values::Form),
            _ => Values::None,
        }
    }
}

impl Meaning {
    /// Words of a sample.
    fn words(&self) -> u64 {
        if self.values == Values::None { 3 } else { 4 }
    }

    /// A chunk's words: heights; x and y of normals; their z, and coverage; values. A form's heights are asked for.
    fn packed(&self, samples: &NodeSamples, heights_of: impl Fn(&Form) -> Vec<f64>) -> Vec<u32> {
        let count = samples.heights.len();
        let mut words = Vec::with_capacity(self.words() as usize * count);
        words.extend(samples.heights.iter().map(|height| counted(height, self.reference).min(UNMEASURED).to_bits()));
        let signed = |part: f32| u32::from((part.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
        words.extend(samples.normals.iter().map(|[x, y, _]| signed(x) | signed(y) << 16));
        let up = |normal: [f32; 3]| (normal[2].clamp(0.0, 1.0) * 65535.0).round() as u32;
        let normals = samples.normals.iter().enumerate();
        words.extend(normals.map(|(index, normal)| up(normal) | u32::from(samples.coverage_at(index)) << 16));
        match &self.values {
            Values::None => {}
            Values::Planes(planes) => words.extend(colors(samples, planes)),
            Values::Changes => {
                let change = |index| samples.changes.get(index).map_or(f64::NAN, |change| f64::from(*change));
                words.extend((0..count).map(|index| counted(change(index), 0.0).to_bits()));
            }
            Values::Form(form) => {
                words.extend(heights_of(form).into_iter().map(|height| counted(height, self.reference).to_bits()));
            }
        }
        words
    }
}

/// The colours of a chunk's samples: of each plane a byte.
fn colors<'a>(samples: &'a NodeSamples, planes: &'a [usize]) -> impl Iterator<Item = u32> + 'a {
    let byte = |plane: usize, index: usize| {
        let light = samples.planes.get(plane).and_then(|plane| plane.get(index)).copied().unwrap_or(0.0);
        (255.0 * to_encoded(light.clamp(0.0, 1.0))).round() as u32
    };
    (0..samples.heights.len()).map(move |index| {
        let bytes = planes.iter().take(4).enumerate();
        bytes.fold(0, |color, (place, plane)| color | byte(*plane, index) << (8 * place))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::surface::samples::{MeanNormal, SampleHeights, SampleNormals};

    #[test]
    fn samples_are_packed_as_shaders_read_them() {
        let samples = NodeSamples {
            rows: 1,
            columns: 2,
            heights: SampleHeights::of(&[1001.5, f64::NAN]),
            coverage: vec![7, 0],
            normals: SampleNormals::Parts([[1.0, -1.0, 0.0], [0.0, 0.0, 1.0]].map(MeanNormal::new).to_vec()),
            ranges: Vec::new(),
            planes: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
            changes: Vec::new(),
        };
        let nothing = |_: &Form| Vec::new();
        let meaning = Meaning { values: Values::Planes(vec![1, 0]), reference: 1000.0 };
        let expected = [1.5_f32.to_bits(), UNMEASURED.to_bits(), 0x8001_7fff, 0, 7 << 16, 0xffff, 0xff00, 0x00ff];
        assert_eq!(meaning.packed(&samples, nothing), expected);
        // What is not known of an earlier field has no number.
        let changes = NodeSamples { changes: vec![-2.5, f32::NAN], ..samples };
        let meaning = Meaning { values: Values::Changes, reference: 1000.0 };
        assert_eq!(meaning.packed(&changes, nothing)[6..], [(-2.5_f32).to_bits(), UNMEASURED.to_bits()]);
    }
}
