//! Samples of chunks on the adapter, each in a slot of a [`Pool`].

use super::constants::{CHUNK, UNMEASURED};
use super::list::counted;
use super::photo::PhotoTiles;
use super::pool::{Held, Pool};
use crate::color::colors::to_encoded;
use crate::cpu::surface::look::Attribute;
use crate::cpu::surface::source::NodeSamples;
use crate::cpu::surface::stitch::Scene;
use crate::heights::hierarchy::chunks::ChunkKey;
use crate::heights::measure::Form;
use crate::picture::adapter::AdapterSurface;
use bevy::prelude::Resource;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::sync::Arc;

/// Samples of a slot: of the largest chunk, which closes a globe and has a column more than others.
const SLOT: u64 = ((CHUNK + 1) * (CHUNK + 2)) as u64;

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

impl Chunk<'_> {
    /// The heights of a form at its samples.
    fn heights_of(&self, form: &Form, scene: &Scene) -> Vec<f64> {
        let [rows, columns] = [0, 1].map(|axis| scene.lattice.places(self.key, axis));
        let places = rows.iter().flat_map(|row| columns.iter().map(move |column| (*row as f64, *column as f64)));
        places.map(|(row, column)| form.height(scene.placed.file_place(row, column))).collect()
    }
}

/// Samples on the adapter, and a photo that lies over them (render world).
#[derive(Resource, Debug)]
pub struct SurfaceArena {
    meaning: Meaning,
    samples: Pool<NodeSamples>,
    photo: PhotoTiles,
}

impl Default for SurfaceArena {
    fn default() -> SurfaceArena {
        SurfaceArena::new(Meaning::default(), PhotoTiles::default())
    }
}

/// A chunk that is drawn, or that one lies in.
pub struct Chunk<'a> {
    /// Which.
    pub key: ChunkKey,
    /// Its samples.
    pub samples: &'a Arc<NodeSamples>,
}

impl SurfaceArena {
    fn new(meaning: Meaning, photo: PhotoTiles) -> SurfaceArena {
        let samples = Pool::new("deepfield surface samples", meaning.words() * SLOT);
        SurfaceArena { meaning, samples, photo }
    }

    /// Bytes of the buffers.
    pub fn bytes(&self) -> u64 {
        self.samples.bytes() + self.photo.bytes()
    }

    /// Holds the chunks of a picture, and its photo; `None` where there is no room for all of them in so much memory, of which a photo has a
    /// quarter.
    pub fn hold(
        &mut self,
        job: &AdapterSurface,
        memory: u64,
        adapter: (&RenderDevice, &RenderQueue),
    ) -> Option<(Held, Option<Held>)> {
        let scene = &job.scene;
        let drawn = scene.meshes.iter().map(|mesh| Chunk { key: mesh.node.key, samples: &mesh.samples });
        let above = scene.ancestors.iter().map(|(key, samples)| Chunk { key: *key, samples });
        let chunks: Vec<Chunk<'_>> = drawn.chain(above).collect();
        let meaning = Meaning { values: Values::of(job), reference: job.reference };
        if meaning != self.meaning {
            *self = SurfaceArena::new(meaning, std::mem::take(&mut self.photo));
        }
        let for_photo = if job.photo.is_some() { memory / 4 } else { 0 };
        let photo = match &job.photo {
            Some(cut) => Some(self.photo.hold(cut, for_photo, adapter)?),
            None => {
                self.photo = PhotoTiles::default();
                None
            }
        };
        let wanted: Vec<&Arc<NodeSamples>> = chunks.iter().map(|chunk| chunk.samples).collect();
        let meaning = &self.meaning;
        let packed = |number: usize| {
            let chunk = &chunks[number];
            meaning.packed(chunk.samples, |form| chunk.heights_of(form, scene))
        };
        let samples = self.samples.hold(&wanted, memory - for_photo, adapter, packed)?;
        Some((samples, photo))
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
            heights: SampleHeights::of(vec![1001.5, f64::NAN]),
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
