//! What the volume shaders read: structures laid out as in WGSL, for a grid that has been cut into slabs and windows.
//!
//! `gpu::shaders`' tests compose the shaders and compare every structure here with the one there.

use super::column;
use super::constants::{BRICK, MOST_LEVELS};
use super::cut::Cut;
use super::view::VolumeJob;
use crate::color::transfer::Scale;
use crate::cpu::volume::bricks::BrickGrid;
use crate::cpu::volume::coarse;
use crate::cpu::volume::gather;
use crate::cpu::volume::surface::MOST_SURFACES;
use crate::cpu::volume::{Light, Scenery};
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// Bytes of WGSL `Reach` in bin.wgsl.
pub const REACH_BYTES: u64 = 12;

/// Bins that a particle may be in.
pub const MOST_BINS: u64 = 8;

/// Most tiers: the picture's own grid and the coarser ones.
pub const MOST_TIERS: usize = coarse::MOST_LEVELS;

/// WGSL `Tier`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TierUniform {
    /// Bricks along x and y of a window.
    pub window: [u32; 2],
    /// Layers that are held.
    pub ring: u32,
    /// Where its bricks begin among those that are held.
    pub first_brick: u32,
    /// Where its slices begin among those of all tiers.
    pub first_slice: u32,
    /// Its first level of bins.
    pub first_level: u32,
    /// Its levels of bins.
    pub level_count: u32,
    /// Padding.
    pub unused: u32,
}

/// WGSL `VolumeView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct VolumeUniform {
    /// Bricks along x and y of a window.
    pub window: [u32; 2],
    /// The middle line of sight, stored cells.
    pub middle: [f32; 2],
    /// From an attribute to its place among the hues.
    pub attribute_map: [f32; 2],
    /// Layers that are held.
    pub ring: u32,
    /// Slices of the grid.
    pub slices: u32,
    /// The last layer.
    pub last_layer: u32,
    /// Tiers in use.
    pub tier_count: u32,
    /// Bins of all levels.
    pub bin_count: u32,
    /// 1: perspective.
    pub perspective: u32,
    /// Surfaces in use.
    pub surface_count: u32,
    /// Width of a cell at depth 1 (perspective) or everywhere.
    pub sigma: f32,
    /// Depth of the near plane.
    pub near: f32,
    /// Slices for a factor of e in depth (perspective) or a unit of depth.
    pub slice_rate: f32,
    /// Most bricks that a slab fills.
    pub brick_room: u32,
    /// Densities up to this show nothing.
    pub least: f32,
    /// Densities up to this do not show in the volume.
    pub faintest: f32,
    /// Rays that are as opaque end.
    pub termination: f32,
    /// Leading bits of the density of the table's first entry.
    pub first_entry: u32,
    /// Number of intervals of the table less one.
    pub last_entry: u32,
    /// Index of the first hue in the table; 0: none.
    pub hues: u32,
    /// 1: hues follow the attribute's logarithm.
    pub attribute_log: u32,
    /// 1: surfaces are lit.
    pub lit: u32,
    /// See [`Light`].
    pub ambient: f32,
    /// See [`Light`].
    pub specular: f32,
    /// See [`Light`].
    pub shininess: f32,
    /// Index of the first entry of the plane of hues and places in the table; 0: none.
    pub plane: u32,
    /// Least smoothing length, cells.
    pub smallest: f32,
    /// The kernel's leading factor, for a smoothing length of 1.
    pub kernel_factor: f32,
    /// One of so many particles is drawn.
    pub stride: u32,
    /// Factor on the smoothing lengths of those.
    pub growth: f32,
    /// How cells of fields of columns are read: [`column::reading_of`].
    pub columns_read: u32,
    /// Width and height of the picture, cells.
    pub cells: [f32; 2],
    /// The tiers, finest first.
    pub tiers: [TierUniform; MOST_TIERS],
    /// First bin, and bins along x, y and z, of each level of each tier.
    pub levels: [[u32; 4]; MOST_LEVELS],
    /// Density, opacity, and 1 for a colour that is set.
    pub surfaces: [[f32; 4]; MOST_SURFACES],
    /// Colours of the surfaces.
    pub colors: [[f32; 4]; MOST_SURFACES],
}

/// WGSL `TierPortion`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TierPortion {
    /// The window's first brick: column, and row from bit 16 on.
    pub origin: u32,
    /// First layer that is filled, and their number from bit 24 on.
    pub layers: u32,
    /// Depth of the centre of their first slice.
    pub nearest: f32,
    /// Depth of the centre of their last slice.
    pub farthest: f32,
}

impl TierPortion {
    /// A window that begins with a brick, of which layers are filled whose ends have these depths.
    pub fn new([column, row]: [u32; 2], layers: &Range<u32>, [nearest, farthest]: [f32; 2]) -> TierPortion {
        let number = layers.len() as u32;
        debug_assert!(column < 1 << 16 && row < 1 << 16 && layers.start < 1 << 24 && number < 1 << 8);
        TierPortion { origin: column | row << 16, layers: layers.start | number << 24, nearest, farthest }
    }
}

/// WGSL `Portion`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Portion {
    /// The window's first brick.
    pub origin: [u32; 2],
    /// First pixel that the window draws.
    pub first_pixel: [u32; 2],
    /// Behind the last one.
    pub behind_pixel: [u32; 2],
    /// Where rows begin in the list of pixels' places.
    pub rows: u32,
    /// Where rows begin in the list of bricks' readers.
    pub brick_rows: u32,
    /// First layer of the slab.
    pub first_layer: u32,
    /// Number of its layers.
    pub layers: u32,
    /// First step.
    pub first_step: u32,
    /// Behind the last step.
    pub behind_step: u32,
    /// Particles of the batch.
    pub candidates: u32,
    /// 1: the first batch of the slab.
    pub opening: u32,
    /// Bricks of all tiers that are filled.
    pub bricks: u32,
    /// Padding.
    pub unused: u32,
    /// The same of each tier.
    pub tiers: [TierPortion; MOST_TIERS],
}

/// WGSL `Turn`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Turn {
    /// Number of the turn, the digit or the tier.
    pub number: u32,
    /// Padding.
    pub unused: [u32; 3],
}

/// The levels of bins over so many bricks: first bin, and bins along x, y and z, each; they begin with bin `first`. The last level is
/// so coarse that any particle touches at most two of its bins along each axis.
pub fn levels(bricks: [u32; 3], first: u32) -> Vec<[u32; 4]> {
    let mut levels = Vec::new();
    let mut bins = first;
    loop {
        let [x, y, z] = bricks.map(|bricks| ((bricks.max(1) - 1) >> levels.len()) + 1);
        levels.push([bins, x, y, z]);
        bins += x * y * z;
        if x.max(y).max(z) <= 2 {
            return levels;
        }
    }
}

impl VolumeUniform {
    /// What the shaders read of a job whose tiers have these bricks.
    pub fn new(job: &VolumeJob, grids: &[BrickGrid], cut: &Cut) -> VolumeUniform {
        let grid = &job.grid;
        let span = match grid.perspective {
            true => (grid.far / grid.near).ln(),
            false => grid.far - grid.near,
        };
        let (mut tiers, mut all_levels) = ([TierUniform::zeroed(); MOST_TIERS], [[0; 4]; MOST_LEVELS]);
        let (mut bin_count, mut first_level, mut first_brick, mut first_slice) = (0, 0, 0, 0);
        for ((out, tier), brick_grid) in tiers.iter_mut().zip(&cut.tiers).zip(grids) {
            let levels = levels([tier.window[0], tier.window[1], tier.layers], bin_count);
            *out = TierUniform {
                window: tier.window,
                ring: tier.ring,
                first_brick,
                first_slice,
                first_level: first_level as u32,
                level_count: levels.len() as u32,
                unused: 0,
            };
            bin_count = levels.last().map_or(bin_count, |[first, x, y, z]| first + x * y * z);
            all_levels[first_level..first_level + levels.len()].copy_from_slice(&levels);
            first_level += levels.len();
            first_brick += tier.bricks_held() as u32;
            first_slice += brick_grid.depth.len() as u32;
        }
        let finest = cut.finest();
        let uniform = VolumeUniform {
            window: finest.window,
            middle: grids[0].middle,
            ring: finest.ring,
            slices: grid.size[2],
            last_layer: grid.size[2].div_ceil(BRICK) - 1,
            tier_count: cut.tiers.len() as u32,
            bin_count,
            perspective: grid.perspective.into(),
            sigma: grid.sigma as f32,
            near: grid.near as f32,
            slice_rate: (f64::from(grid.size[2]) / span) as f32,
            brick_room: cut.tiers.iter().map(|tier| tier.columns() * tier.layers).sum(),
            smallest: job.options.smallest as f32,
            kernel_factor: gather::leading(job.options.kernel),
            stride: job.stride,
            growth: f64::from(job.stride).cbrt() as f32,
            cells: job.view.edges().map(|[low, high]| ((high - low) / grid.sigma) as f32),
            tiers,
            levels: all_levels,
            ..VolumeUniform::zeroed()
        };
        let shown = job.scenery().map_or(uniform, |scenery| uniform.with(scenery));
        // Of a Cartesian grid everything is wanted: beside a cell that shows, rays read one that does not.
        // Numbers of two fields have no bound in common.
        let is_apart = job.columns().is_some_and(|march| march.shown.surface.is_some());
        let least = if job.cartesian().is_some() || is_apart { 0.0 } else { shown.least };
        let columns_read = job.columns().map_or(0, column::reading_of);
        VolumeUniform { least, columns_read, ..shown }
    }

    /// With what is shown of the field.
    fn with(self, scenery: &Scenery) -> VolumeUniform {
        let tables = scenery.classifier.tables();
        let [min, max] = tables.attribute;
        let (attribute_map, attribute_log) = match tables.scale {
            Scale::Log => ([1.0 / (max / min).log2(), -min.log2() / (max / min).log2()], 1),
            Scale::Linear => ([1.0 / (max - min), -min / (max - min)], 0),
        };
        let either = scenery.light.or(scenery.volume_light);
        let light = either.unwrap_or(Light { ambient: 1.0, specular: 0.0, shininess: 1.0 });
        let (mut surfaces, mut colors) = ([[0.0; 4]; MOST_SURFACES], [[0.0; 4]; MOST_SURFACES]);
        for (index, surface) in scenery.surfaces.iter().take(MOST_SURFACES).enumerate() {
            let [r, g, b] = surface.color.unwrap_or_default();
            surfaces[index] = [surface.value, surface.opacity, f32::from(u8::from(surface.color.is_some())), 0.0];
            colors[index] = [r, g, b, 0.0];
        }
        // Larger than any density, and still a number that every driver can hold.
        let nothing = f32::MAX;
        VolumeUniform {
            attribute_map: attribute_map.map(|number| number as f32),
            surface_count: scenery.surfaces.len().min(MOST_SURFACES) as u32,
            least: scenery.least().min(nothing),
            faintest: if scenery.volume { scenery.classifier.least().min(nothing) } else { nothing },
            termination: scenery.termination,
            first_entry: tables.first,
            last_entry: tables.densities.len() as u32 - 2,
            hues: if tables.hues.is_empty() { 0 } else { tables.densities.len() as u32 },
            attribute_log,
            lit: scenery.light.is_some().into(),
            ambient: light.ambient,
            specular: light.specular,
            shininess: light.shininess,
            plane: if tables.plane.is_empty() { 0 } else { (tables.densities.len() + tables.hues.len()) as u32 },
            surfaces,
            colors,
            ..self
        }
    }
}

/// Depth, spacing, cells per length and thickness of each slice of each tier.
pub fn depths(grids: &[BrickGrid]) -> Vec<[f32; 4]> {
    let of_tier = |brick_grid: &BrickGrid| -> Vec<[f32; 4]> {
        let BrickGrid { depth, spacing, per_cell, thickness, .. } = brick_grid;
        (0..depth.len()).map(|slice| [depth[slice], spacing[slice], per_cell[slice], thickness[slice]]).collect()
    };
    grids.iter().flat_map(of_tier).collect()
}

/// For each column of pixels, then for each row, the stored cell before its rays, and the bits of the share of the way to the
/// next.
pub fn places(of_columns: &[(usize, f32)], of_rows: &[(usize, f32)]) -> Vec<[u32; 2]> {
    of_columns.iter().chain(of_rows).map(|&(cell, share)| [cell as u32, share.to_bits()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_end_where_two_bins_hold_all() {
        for bricks in [[1, 1, 1], [2, 2, 1], [65, 65, 15], [490, 280, 3], [8192, 1, 64]] {
            let levels = levels(bricks, 7);
            let [_, x, y, z] = levels[levels.len() - 1];
            assert!(x <= 2 && y <= 2 && z <= 2, "{bricks:?}");
            assert_eq!(levels[0], [7, bricks[0], bricks[1], bricks[2]]);
            for (fine, coarse) in levels.iter().zip(&levels[1..]) {
                assert_eq!(coarse[0], fine[0] + fine[1] * fine[2] * fine[3]);
            }
        }
    }

    #[test]
    fn all_tiers_levels_have_room() {
        // More bricks would have more bins than there are numbers.
        let mut bricks = [1 << 13, 1 << 13, 1];
        let mut all = 0;
        for _ in 0..MOST_TIERS {
            all += levels(bricks, 0).len();
            bricks = bricks.map(|bricks| bricks / 2 + 2);
        }
        assert!(all <= MOST_LEVELS, "{all}");
    }
}
