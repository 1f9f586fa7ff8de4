//! What the shaders read that list particles by tiles: structures laid out as in WGSL.
//!
//! `gpu::shaders`' tests compose the shaders and compare every structure here with the one there.

use super::constants::{INTERVAL_BITS, MOST_LEVELS};
use super::{OverRequest, TileRequest};
use crate::gpu::splat::layout::TILE;
use crate::view::{Projection, View};
use bytemuck::{Pod, Zeroable};

/// WGSL `TileView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TileUniform {
    /// Picture size, pixels.
    pub size: [u32; 2],
    /// Where the middle line of sight meets the picture, pixels.
    pub middle: [f32; 2],
    /// Depths of the first and the last particle that is listed.
    pub planes: [f32; 2],
    /// Pixels per world unit (at depth 1 in perspective).
    pub focal: f32,
    /// 1: perspective.
    pub perspective: u32,
    /// Densities up to this are left out.
    pub least: f32,
    /// Factor on densities.
    pub density_scale: f32,
    /// Radius of what is drawn of a particle, in smoothing lengths.
    pub extent: f32,
    /// Particles are sorted by the depth of their centre less this share of their radius.
    pub lead: f32,
    /// Least smoothing length at depth 1 (perspective) or everywhere.
    pub smallest: f32,
    /// Key of the smallest depth.
    pub first_key: u32,
    /// Leading bits of a key name its interval of depths.
    pub interval_shift: u32,
    /// Levels of bins.
    pub level_count: u32,
    /// Layers of depth; 0: none.
    pub layers: u32,
    /// Layers for a factor of e in depth (perspective) or a unit of depth.
    pub layer_rate: f32,
    /// 1: a particle counts in each layer that it reaches.
    pub spread: u32,
    /// 1: particles lie over each other, are sorted by their distance from the eye and have their own columns in place of densities.
    pub over: u32,
    /// Radius of the kernel that blurs them, pixels.
    pub blur: f32,
    /// See [`super::OverRequest::column_factor`].
    pub column_factor: f32,
    /// See [`super::OverRequest::column_power`].
    pub column_power: f32,
    /// See [`super::OverRequest::column_area`].
    pub column_area: f32,
    /// First bin, and bins along x and y, of each level.
    pub levels: [[u32; 4]; MOST_LEVELS],
}

/// WGSL `Portion`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Portion {
    /// Length of a list, or the number of a digit.
    pub length: u32,
    /// Which of the slabs of depth.
    pub slab: u32,
    /// Number of the first block of particles.
    pub first_block: u32,
    /// The most that there may be.
    pub most: u32,
    /// Number of intervals of depth.
    pub intervals: u32,
    /// The most of a slab.
    pub at_once: u32,
    /// Padding.
    pub unused: [u32; 2],
}

/// Bytes of WGSL `Spot`, and of what modes make of it.
pub const SPOT_BYTES: u64 = 32;

/// WGSL `ordered`.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// The levels of bins over tiles: first bin, and bins along x and y, each; their number; and the number of bins.
fn levels(tiles: [u32; 2]) -> ([[u32; 4]; MOST_LEVELS], u32, u32) {
    let mut levels = [[0; 4]; MOST_LEVELS];
    let (mut bins, mut count) = (0, 0);
    for (level, out) in levels.iter_mut().enumerate() {
        let [x, y] = tiles.map(|tiles| ((tiles.max(1) - 1) >> level) + 1);
        *out = [bins, x, y, 0];
        bins += x * y;
        count += 1;
        if x.max(y) <= 2 {
            break;
        }
    }
    (levels, count, bins)
}

/// What the passes of a view need to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tiling {
    /// What the shaders read.
    pub uniform: TileUniform,
    /// Tiles along x and y.
    pub tiles: [u32; 2],
    /// Bins of all levels.
    pub bins: u32,
    /// Bits of what is sorted by.
    pub key_bits: u32,
    /// How often a particle may be listed.
    pub most_parts: u32,
    /// Most layers of a slab, where there are layers.
    pub layers_at_once: Option<u32>,
}

impl Tiling {
    /// The tiles of a view, and the particles that are listed in them.
    pub fn new(view: &View, request: &TileRequest) -> Tiling {
        let size = [view.width, view.height];
        let tiles = size.map(|pixels| pixels.div_ceil(TILE));
        let (levels, level_count, bins) = levels(tiles);
        let planes = request.planes.map(|depth| depth as f32);
        let [first_key, last_key] = planes.map(ordered);
        let layers = request.layers.map_or(0, |layers| layers.count);
        let spread = request.layers.and_then(|layers| layers.spread);
        let last = if layers > 0 { layers - 1 } else { last_key.saturating_sub(first_key) };
        let key_bits = u32::BITS - last.leading_zeros();
        let focal = view.focal_pixels();
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let [near, far] = request.planes;
        let span = if is_perspective { (far / near).ln() } else { far - near };
        let nothing = OverRequest { blur: 0.0, column_factor: 0.0, column_power: 0.0, column_area: 1.0 };
        let over = request.over.unwrap_or(nothing);
        let uniform = TileUniform {
            size,
            middle: view.middle().map(|pixels| pixels as f32),
            planes,
            focal: focal as f32,
            perspective: is_perspective.into(),
            least: request.least,
            density_scale: request.density_scale,
            extent: request.extent,
            lead: request.lead,
            smallest: (request.smallest / focal) as f32,
            first_key,
            interval_shift: key_bits.saturating_sub(INTERVAL_BITS),
            level_count,
            layers,
            layer_rate: (f64::from(layers) / span) as f32,
            spread: spread.is_some().into(),
            over: request.over.is_some().into(),
            blur: over.blur,
            column_factor: over.column_factor,
            column_power: over.column_power,
            column_area: over.column_area,
            levels,
        };
        let layers_at_once = request.layers.map(|layers| layers.at_once);
        Tiling { uniform, tiles, bins, key_bits, most_parts: spread.unwrap_or(1), layers_at_once }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_end_where_two_bins_hold_all() {
        for tiles in [[1, 1], [2, 1], [65, 15], [490, 280], [4096, 1]] {
            let (levels, count, bins) = levels(tiles);
            let [first, x, y, _] = levels[count as usize - 1];
            assert_eq!(bins, first + x * y);
            assert!(x <= 2 && y <= 2, "{tiles:?}");
            assert_eq!(levels[0], [0, tiles[0], tiles[1], 0]);
        }
    }

    #[test]
    fn keys_have_the_order_of_numbers() {
        let numbers = [f32::MIN, -3.5, -1e-30, 0.0, 1e-30, 2.0, 2.5, 1e9, f32::MAX];
        assert!(numbers.windows(2).all(|pair| ordered(pair[0]) < ordered(pair[1])));
    }
}
