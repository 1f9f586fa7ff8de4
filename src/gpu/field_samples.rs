//! The samples of a field on the adapter, kept from picture to picture: the levels that have been needed, a texture for each channel.

use crate::cpu::field::{Field, FieldLevel, ValueAxis};
use bevy::render::render_resource::{
    Buffer, BufferInitDescriptor, BufferUsages, Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo,
    Texture, TextureAspect, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
    TextureViewDescriptor,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::tasks::block_on;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use wgpu::ErrorFilter;

/// Bytes that are handed over at once, about: each time the driver holds a copy of them.
const PORTION: usize = 64 << 20;

/// A level of a field.
#[derive(Debug)]
pub struct HeldLevel {
    /// The samples of the channel that is shown, and of the one that colours it.
    textures: [Texture; 2],
    /// Where the largest value of each block is placed, and on which axis.
    most: Option<(ValueAxis, Buffer)>,
}

/// Levels of a field on the adapter.
#[derive(Debug)]
pub struct HeldSamples {
    field: Arc<Field>,
    hue: Option<usize>,
    levels: BTreeMap<usize, HeldLevel>,
}

/// Which levels a picture is filled from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Finest(usize);

impl Finest {
    /// The level in place of one that would be right but for want of memory.
    pub fn in_place_of(self, level: usize) -> usize {
        level.max(self.0)
    }

    /// By how many levels the finest of those that would be right is too fine.
    pub fn missing(self, wanted: &BTreeSet<usize>) -> usize {
        wanted.first().map_or(0, |first| self.0.saturating_sub(*first))
    }

    fn all(self, wanted: &BTreeSet<usize>) -> BTreeSet<usize> {
        wanted.iter().map(|level| self.in_place_of(*level)).collect()
    }
}

impl HeldSamples {
    /// Holds what a picture needs of a field and a channel that colours it, of the levels that are `wanted` or the next coarser ones for
    /// which there is room in `memory` bytes; `None` where there is none for any.
    pub fn load(
        slot: &mut Option<HeldSamples>,
        (field, hue): (&Arc<Field>, Option<usize>),
        wanted: &BTreeSet<usize>,
        memory: u64,
        means: (&RenderDevice, &RenderQueue),
    ) -> Option<Finest> {
        let is_same = |held: &HeldSamples| Arc::ptr_eq(&held.field, field) && held.hue == hue;
        let known = slot.take().filter(is_same);
        let mut held = known.unwrap_or_else(|| HeldSamples { field: Arc::clone(field), hue, levels: BTreeMap::new() });
        let most = means.0.limits().max_texture_dimension_3d as usize;
        for finest in (0..field.channels[0].levels.len()).map(Finest) {
            let needed = finest.all(wanted);
            let fits = |level: &usize| field.channels[0].levels[*level].shape.iter().all(|side| *side <= most);
            if !needed.iter().all(fits) || bytes_of(field, hue, &needed) > memory {
                continue;
            }
            if held.bytes() + bytes_of(field, hue, &needed) > memory {
                held.levels.retain(|level, _| needed.contains(level));
            }
            if held.add(&needed, means) {
                *slot = Some(held);
                return Some(finest);
            }
            // The coarser ones are small beside what has not fitted.
            held.levels.clear();
        }
        None
    }

    /// Uploads levels that are not there; whether there was room.
    fn add(&mut self, needed: &BTreeSet<usize>, means: (&RenderDevice, &RenderQueue)) -> bool {
        for &level in needed {
            if self.levels.contains_key(&level) {
                continue;
            }
            let of = |channel: usize| &self.field.channels[channel].levels[level];
            let Some(shown) = upload(of(0), means) else { return false };
            let hue = match self.hue {
                Some(hue) => match upload(of(hue), means) {
                    Some(hue) => hue,
                    None => return false,
                },
                None => shown.clone(),
            };
            self.levels.insert(level, HeldLevel { textures: [shown, hue], most: None });
        }
        true
    }

    /// Places the largest values of a level's blocks on an axis; the buffer that has them, if the level is there.
    pub fn places(&mut self, level: usize, axis: &ValueAxis, device: &RenderDevice) -> Option<&Buffer> {
        let held = self.levels.get_mut(&level)?;
        if held.most.as_ref().is_some_and(|(known, _)| known == axis) {
            return held.most.as_ref().map(|(_, buffer)| buffer);
        }
        let most = self.field.channels[0].levels[level].most_of_blocks();
        let places: Vec<f32> = most.map(|most| most.map_or(0.0, |most| axis.place(most))).collect();
        let buffer = device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some("deepfield volume blocks"),
            contents: bytemuck::cast_slice(&places),
            usage: BufferUsages::STORAGE,
        });
        Some(&held.most.insert((*axis, buffer)).1)
    }

    /// The channels of a level: that which is shown, and the one that colours it; `None` if it is not there.
    pub fn of_level(&self, level: usize) -> Option<[TextureView; 2]> {
        let textures = &self.levels.get(&level)?.textures;
        Some(textures.each_ref().map(|texture| texture.create_view(&TextureViewDescriptor::default())))
    }

    /// Bytes of the samples that are held.
    pub fn bytes(&self) -> u64 {
        bytes_of(&self.field, self.hue, &self.levels.keys().copied().collect())
    }
}

/// Bytes of levels of a field.
fn bytes_of(field: &Field, hue: Option<usize>, levels: &BTreeSet<usize>) -> u64 {
    let bytes = |level: &usize| 4 * field.channels[0].levels[*level].values.len() as u64;
    levels.iter().map(bytes).sum::<u64>() * if hue.is_some() { 2 } else { 1 }
}

/// A texture of a level's values, bit for bit; `None` where the adapter has no room for it.
fn upload(level: &FieldLevel, (device, queue): (&RenderDevice, &RenderQueue)) -> Option<Texture> {
    let [width, height, depth] = level.shape.map(|side| side as u32);
    let scope = device.wgpu_device().push_error_scope(ErrorFilter::OutOfMemory);
    let texture = device.create_texture(&TextureDescriptor {
        label: Some("deepfield volume samples"),
        size: Extent3d { width, height, depth_or_array_layers: depth },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D3,
        format: TextureFormat::R32Uint,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    if block_on(scope.pop()).is_some() {
        return None;
    }
    let slice = level.shape[0] * level.shape[1];
    let slices = (PORTION / 4 / slice).max(1);
    for (values, first) in level.values.chunks(slices * slice).zip((0..).step_by(slices)) {
        let to = TexelCopyTextureInfo {
            texture: &texture,
            mip_level: 0,
            origin: Origin3d { x: 0, y: 0, z: first },
            aspect: TextureAspect::All,
        };
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: Some(height) };
        let depth_or_array_layers = (values.len() / slice) as u32;
        let size = Extent3d { width, height, depth_or_array_layers };
        queue.write_texture(to, bytemuck::cast_slice(values), layout, size);
        // Or all copies would be there at the same time.
        queue.submit([]);
    }
    Some(texture)
}
