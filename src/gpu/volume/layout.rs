//! What the volume shaders read: structures laid out as in WGSL, for a grid that has been cut into slabs and windows.
//!
//! `gpu::shaders`' tests compose the shaders and compare every structure here with the one there.

use super::constants::{BRICK, MOST_LEVELS};
use super::cut::Cut;
use super::view::{Shows, VolumeJob};
use crate::color::transfer::Scale;
use crate::cpu::volume::bricks::BrickGrid;
use crate::cpu::volume::surface::MOST_SURFACES;
use crate::cpu::volume::{Light, Scenery};
use crate::model::Kernel;
use bytemuck::{Pod, Zeroable};
use std::f32::consts::PI;

/// Bins that a particle may be in.
pub const MOST_BINS: u64 = 8;

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
    /// Levels of bins.
    pub level_count: u32,
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
    /// First bin, and bins along x, y and z, of each level.
    pub levels: [[u32; 4]; MOST_LEVELS],
    /// Density, opacity, and 1 for a colour that is set.
    pub surfaces: [[f32; 4]; MOST_SURFACES],
    /// Colours of the surfaces.
    pub colors: [[f32; 4]; MOST_SURFACES],
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
    /// Depth of the centre of the slab's first slice.
    pub nearest: f32,
    /// Depth of the centre of its last slice.
    pub farthest: f32,
}

/// WGSL `Turn`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Turn {
    /// Number of the turn or the digit.
    pub number: u32,
    /// Padding.
    pub unused: [u32; 3],
}

/// The levels of bins over a slab of a window: first bin, and bins along x, y and z, each; their number; and the number of
/// bins. The last level is so coarse that any particle touches at most two of its bins along each axis.
pub fn levels(bricks: [u32; 3]) -> ([[u32; 4]; MOST_LEVELS], u32, u32) {
    let mut levels = [[0; 4]; MOST_LEVELS];
    let (mut bins, mut count) = (0, 0);
    for (level, out) in levels.iter_mut().enumerate() {
        let [x, y, z] = bricks.map(|bricks| ((bricks.max(1) - 1) >> level) + 1);
        *out = [bins, x, y, z];
        bins += x * y * z;
        count += 1;
        if x.max(y).max(z) <= 2 {
            break;
        }
    }
    (levels, count, bins)
}

impl VolumeUniform {
    /// What the shaders read of a job.
    pub fn new(job: &VolumeJob, brick_grid: &BrickGrid, cut: &Cut) -> VolumeUniform {
        let grid = &job.grid;
        let span = match grid.perspective {
            true => (grid.far / grid.near).ln(),
            false => grid.far - grid.near,
        };
        let (levels, level_count, bin_count) = levels([cut.window[0], cut.window[1], cut.layers]);
        let uniform = VolumeUniform {
            window: cut.window,
            middle: brick_grid.middle,
            ring: cut.ring,
            slices: grid.size[2],
            last_layer: grid.size[2].div_ceil(BRICK) - 1,
            level_count,
            bin_count,
            perspective: grid.perspective.into(),
            sigma: grid.sigma as f32,
            near: grid.near as f32,
            slice_rate: (f64::from(grid.size[2]) / span) as f32,
            smallest: job.options.smallest as f32,
            kernel_factor: match job.options.kernel {
                Kernel::CubicSpline => 8.0 / PI,
                Kernel::Poly6 => 315.0 / (64.0 * PI),
            },
            stride: job.stride,
            growth: f64::from(job.stride).cbrt() as f32,
            levels,
            ..VolumeUniform::zeroed()
        };
        match &job.shows {
            Shows::Ranges => uniform,
            Shows::Light(scenery) => uniform.with(scenery),
        }
    }

    /// With what is shown of the field.
    fn with(self, scenery: &Scenery) -> VolumeUniform {
        let tables = scenery.classifier.tables();
        let [min, max] = tables.attribute;
        let (attribute_map, attribute_log) = match tables.scale {
            Scale::Log => ([1.0 / (max / min).log2(), -min.log2() / (max / min).log2()], 1),
            Scale::Linear => ([1.0 / (max - min), -min / (max - min)], 0),
        };
        let light = scenery.light.unwrap_or(Light { ambient: 1.0, specular: 0.0, shininess: 1.0 });
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

/// The shader's table: densities, then hues, then the plane.
pub fn table(scenery: &Scenery) -> Vec<[f32; 4]> {
    let tables = scenery.classifier.tables();
    tables
        .densities
        .iter()
        .copied()
        .chain(tables.hues.iter().map(|&[r, g, b]| [r, g, b, 0.0]))
        .chain(tables.plane.iter().copied())
        .collect()
}

/// Depth, spacing, cells per length and thickness of each slice.
pub fn depths(brick_grid: &BrickGrid) -> Vec<[f32; 4]> {
    let of = |slice: usize| {
        [brick_grid.depth[slice], brick_grid.spacing[slice], brick_grid.per_cell[slice], brick_grid.thickness[slice]]
    };
    (0..brick_grid.depth.len()).map(of).collect()
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
            let (levels, count, bins) = levels(bricks);
            let [first, x, y, z] = levels[count as usize - 1];
            assert_eq!(bins, first + x * y * z);
            assert!(x <= 2 && y <= 2 && z <= 2, "{bricks:?}");
            assert_eq!(levels[0], [0, bricks[0], bricks[1], bricks[2]]);
        }
    }
}
