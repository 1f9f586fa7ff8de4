//! What the splat shaders read: structures laid out as in WGSL, and the grids of cells, tiles and bins of a view.
//!
//! `gpu::shaders`' tests compose the shaders and compare every structure here with the one there.

use super::constants::kernel_defs;
use super::profile::Profile;
use crate::gpu::view::Footprint;
use crate::model::Kernel;
use crate::view::{Projection, View};
use bevy::shader::ShaderDefVal;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Splats with a radius of at least this many cells are sampled; those of a smaller radius in pixels are integrated.
/// A splat in level `l` has a radius from this to twice that in cells of `2^l` pixels.
///
/// Kernels that are narrower for their support are as well sampled from a larger radius on: a lone splat of this radius is reconstructed
/// to 2e-3 to 4e-3 (L2), and of twice that to 3e-4.
pub const fn sampled_radius(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::CubicSpline | Kernel::Poly6 => 4.0,
        Kernel::QuarticSpline => 4.5,
        Kernel::WendlandC2 => 4.75,
        Kernel::QuinticSpline | Kernel::WendlandC4 => 5.0,
        Kernel::WendlandC6 => 5.5,
    }
}
/// Most particles of a block.
pub const BLOCK: u32 = 1024;
/// Edge of a tile and of a bin, cells.
pub const TILE: u32 = 8;
/// Most levels that a pyramid has.
pub const MAX_LEVELS: usize = 16;
/// Taps of the reconstruction filter, for each of its two phases.
pub const RECONSTRUCTION_TAPS: u32 = 8;
/// Cells that four finer cells are reconstructed from, along each axis.
pub const RECONSTRUCTION_WINDOW: u32 = RECONSTRUCTION_TAPS + 2;
/// Cells of the finer level that one invocation of the reconstruction fills, along x and y.
pub const RECONSTRUCTED: [u32; 2] = [4, 16];
/// Cells around the picture in every level but the finest, so that the filter finds all it needs. Even.
pub const PAD: u32 = RECONSTRUCTION_TAPS;

/// WGSL `Level`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Level {
    /// Cells along x, padding included.
    pub width: u32,
    /// Cells along y, padding included.
    pub height: u32,
    /// Cells before the picture's first.
    pub pad: u32,
    /// Index of the first cell.
    pub first_cell: u32,
    /// Tiles along x.
    pub tiles_x: u32,
    /// Tiles in finer levels.
    pub first_tile: u32,
    /// Bins along x.
    pub bins_x: u32,
    /// Bins along y.
    pub bins_y: u32,
    /// Index of the first bin.
    pub first_bin: u32,
    /// Bins around the cells.
    pub margin: u32,
    /// Pixels per cell.
    pub scale: f32,
    /// First row of the level in the atlas of the blended technique.
    pub atlas_row: u32,
    /// First bin of the ellipses that are sampled in the level, and of those that are integrated over pixels. Their grids are ever coarser
    /// (see [`stretched_bins`]); 0 where there are no ellipses.
    pub ellipse_bins: [u32; 2],
    /// See [`sampled_radius`]; the same in every level.
    pub sampled_radius: f32,
    /// Padding.
    pub unused: u32,
}

/// WGSL `SplatView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatUniform {
    /// Picture size, pixels.
    pub size: [u32; 2],
    /// Size of a texture that holds all levels: the finest to the left, the others in a column to its right.
    pub atlas: [u32; 2],
    /// Where the middle line of sight meets the picture, pixels.
    pub middle: [f32; 2],
    /// Tiles of all levels.
    pub tile_count: u32,
    /// Cells of all levels.
    pub cell_count: u32,
    /// Pixels per world unit (at depth 1 in perspective).
    pub focal: f32,
    /// Particles at this depth or before it are dropped.
    pub near: f32,
    /// 1 for perspective.
    pub perspective: u32,
    /// Radius in pixels, or 0.
    pub fixed_radius: f32,
    /// Most splats of a range of bins that one invocation sums.
    pub slice: u32,
    /// Number of levels.
    pub level_count: u32,
    /// First bin of the small splats.
    pub small_bin: u32,
    /// Bin of the splats that every tile of the last level looks at.
    pub everywhere_bin: u32,
    /// Number of bins.
    pub bin_count: u32,
    /// See [`Profile::moment`].
    pub moment: f32,
    /// Particles that add less than this to every pixel are dropped.
    pub faintest: f32,
    /// The projected kernel in its middle.
    pub peak: f32,
    /// Whether particles outside the picture are dropped.
    pub culling: u32,
    /// 1: particles are left out and faded as the next fields say.
    pub cut: u32,
    /// Depth up to which particles keep their weight.
    pub fade_start: f32,
    /// Rate of the exponential by which weights fall behind that.
    pub fade_rate: f32,
    /// Camera axis to the right.
    pub right: [f32; 4],
    /// Camera axis to the top.
    pub up: [f32; 4],
    /// Camera axis along the line of sight.
    pub forward: [f32; 4],
    /// Lowest corner of the box that is drawn, relative to the eye in world axes.
    pub clip_min: [f32; 4],
    /// Highest corner of that box.
    pub clip_max: [f32; 4],
    /// Camera coordinates of the direction that depth is measured in for what fades.
    pub fade_along: [f32; 4],
    /// The levels, finest first.
    pub levels: [Level; MAX_LEVELS],
}

/// WGSL `Node`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    /// Whole steps from the node's lowest corner to the eye.
    pub eye_steps: [i32; 3],
    /// World units per step of a packed coordinate.
    pub step: f32,
    /// The eye's place within its step, from the step's middle; of raw particles the eye's place from the node's origin, world
    /// units.
    pub eye_rest: [f32; 3],
    /// See [`crate::mode::sample::Sample`].
    pub growth: f32,
    /// First word of the positions, or of raw particles.
    pub positions: u32,
    /// First word of the codes.
    pub codes: u32,
    /// First entry of the table.
    pub table: u32,
    /// Entries of the table.
    pub table_length: u32,
    /// An [`Encoding`].
    pub encoding: u32,
    /// Factor on every weight.
    pub weight_scale: f32,
    /// Number of particles.
    pub count: u32,
    /// See [`crate::mode::sample::Sample`]; of clusters the limit by which they are drawn.
    pub seed: u32,
    /// See [`crate::mode::sample::Sample`].
    pub scale: f32,
    /// See [`crate::mode::sample::Sample`]; 0: all particles are drawn.
    pub ranks: u32,
    /// See [`crate::mode::sample::Sample`]; 1: true.
    pub even: u32,
    /// Of moving particles the edge of the periodic box that they are wrapped into, world units; 0: there is none.
    pub edge: f32,
    /// Of moving particles the corner of that box, from the node's origin, world units.
    pub corner: [f32; 3],
    /// Of moving particles how far they are on their way, from 0 to 1.
    pub u: f32,
}

/// Most steps between a node's corner and the eye that are counted whole; the difference to any packed coordinate fits an `i32`.
const MOST_STEPS: f64 = (1 << 30) as f64;

impl Node {
    /// Where an eye is in a node with this lowest corner, as [`Node::eye_steps`] and [`Node::eye_rest`]. A packed coordinate
    /// stands for the middle of its step. Without steps (`step` 0: raw particles) all is rest.
    pub fn eye(eye: DVec3, min: DVec3, step: f64) -> ([i32; 3], [f32; 3]) {
        let offset = eye - min;
        if step == 0.0 {
            return ([0; 3], offset.as_vec3().to_array());
        }
        let steps = offset / step - 0.5;
        // Beyond that the rest is large, and its rounding still small against the distance.
        let whole = steps.round().clamp(DVec3::splat(-MOST_STEPS), DVec3::splat(MOST_STEPS));
        (whole.as_ivec3().to_array(), (steps - whole).as_vec3().to_array())
    }
}

/// WGSL `ENCODING_*`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Encoding {
    /// Grid positions.
    Grid = 0,
    /// Leaf positions.
    Leaf = 1,
    /// Raw particles in world axes.
    World = 2,
    /// Raw particles in camera space.
    Camera = 3,
    /// Particles on their way through an interval, in world axes.
    Moving = 4,
    /// Clusters, in world axes.
    Clusters = 5,
}

/// WGSL `Block`: particles of one node that one workgroup projects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Block {
    /// Index of the node.
    pub node: u32,
    /// First candidate.
    pub first: u32,
    /// Number of candidates.
    pub count: u32,
    /// Where its places begin.
    pub place: u32,
}

/// WGSL `Pass`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Pass {
    /// 1: add to the cells; 0: overwrite them.
    pub add: u32,
    /// 1: further slices of crowded tiles; 0: every tile's first.
    pub further: u32,
    /// The coarser level of a reconstruction.
    pub level: u32,
    /// Padding.
    pub unused: u32,
    /// Where the coarser level begins in the texture that holds it.
    pub source: [u32; 2],
    /// Padding.
    pub unused_end: [u32; 2],
}

/// Most further slices of a picture: workgroups along one dimension.
const MAX_SLICES: u64 = 65535;
/// Bytes of a further slice.
pub const SLICE_BYTES: u64 = 8;
/// Bytes of its sums.
pub const PATCH_BYTES: u64 = (TILE * TILE) as u64 * 8;
/// Bytes of WGSL `Splat`.
pub const SPLAT_BYTES: u64 = 32;
/// Bytes of WGSL `Place`.
pub const PLACE_BYTES: u64 = 8;

/// The uniform of a view, with its grids, and their sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grids {
    /// What the shaders read.
    pub uniform: SplatUniform,
    /// Cells of the whole pyramid.
    pub cells: u32,
    /// Tiles of the whole pyramid.
    pub tiles: u32,
    /// What shaders are compiled for.
    pub shape: Shape,
}

/// What splats look like, for which shaders are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// The kernel.
    pub kernel: Kernel,
    /// Whether splats are spheres seen in perspective, whose pictures are longer than wide off the axis.
    pub oblique: bool,
    /// Whether some are ellipsoids.
    pub ellipsoids: bool,
}

impl Shape {
    /// The definitions that shaders are compiled with.
    pub fn defs(self) -> Vec<ShaderDefVal> {
        let mut defs = kernel_defs(self.kernel);
        let flags = [(self.oblique, "OBLIQUE"), (self.ellipsoids, "ELLIPSOIDS")];
        defs.extend(flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, name)| name.into()));
        defs
    }
}

/// Bins of the ellipses of a level with so many tiles along x and y: those of a grid as fine as the tiles, of one of twice the edge, and so
/// on to one that has a single bin for all tiles; each has some bins around, and an ellipse is in the finest whose margin it does not reach
/// beyond. One more is for what reaches further than any. So a tile looks at few bins, however long and thin ellipses are.
fn stretched_bins([mut x, mut y]: [u32; 2], margin: u32) -> u32 {
    let mut bins = 1;
    loop {
        bins += (x + 2 * margin) * (y + 2 * margin);
        if x <= 1 && y <= 1 {
            return bins;
        }
        [x, y] = [x.div_ceil(2), y.div_ceil(2)];
    }
}

/// How many grids [`stretched_bins`] counts.
fn stretched_grids([x, y]: [u32; 2]) -> u32 {
    x.max(y).next_power_of_two().ilog2() + 1
}

impl SplatUniform {
    /// The same for particles that another camera than the one at `own` sees: they fade with their depth for that one.
    pub fn fading_for(self, own: &View, seen_by: &View) -> SplatUniform {
        let [x, y, z] = [own.right, own.up, own.forward].map(|axis| axis.dot(seen_by.forward) as f32);
        let start = seen_by.cut.fade_start - seen_by.forward.dot(own.eye - seen_by.eye);
        SplatUniform { fade_along: [x, y, z, 0.0], fade_start: start as f32, ..self }
    }
}

impl Grids {
    /// The most slices beyond the first of every tile that `splats` can make: each splat is in ranges of
    /// `(2 margin + 1)^2` tiles, or of all tiles of the last level.
    pub fn most_slices(&self, splats: u64) -> u64 {
        (splats / u64::from(self.uniform.slice) * self.most_tiles()).clamp(1, MAX_SLICES)
    }

    /// The bytes of further slices that each splat may ask for.
    pub fn slice_bytes(&self) -> u64 {
        (self.most_tiles() * (SLICE_BYTES + PATCH_BYTES)).div_ceil(self.uniform.slice.into())
    }

    /// The most tiles that one splat is summed for.
    fn most_tiles(&self) -> u64 {
        let levels = &self.uniform.levels[..self.uniform.level_count as usize];
        if self.shape.ellipsoids {
            return self.tiles.into();
        }
        let around = levels.iter().map(|level| u64::from(2 * level.margin + 1).pow(2)).max().unwrap_or(0);
        around.max(levels.last().map_or(0, |level| u64::from(self.tiles - level.first_tile)))
    }

    /// Lays out the grids of a view; with `ellipsoids` for such as well.
    pub fn new(view: &View, footprint: Footprint, culling: bool, faintest: f32, ellipsoids: bool) -> Grids {
        let focal = view.focal_pixels();
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let longest = f64::from(view.width.max(view.height));
        // The last level still resolves a splat that fills the picture, or, in perspective, a right angle.
        let coarsest = if perspective { longest.min(focal) } else { longest };
        let (kernel, fixed_radius) = match footprint {
            Footprint::Kernel(kernel) => (kernel, 0.0),
            Footprint::Pixels { radius } => (Kernel::CubicSpline, radius.max(0.01)),
        };
        let sampled_radius = sampled_radius(kernel);
        let doublings = (coarsest / (2.0 * f64::from(sampled_radius))).log2().floor();
        let level_count = (doublings.max(0.0) as usize + 1).min(MAX_LEVELS);
        // In tiles. That of the cubic spline is 1.
        let radius = 2.0 * f64::from(sampled_radius) / f64::from(TILE);
        let margin = if perspective {
            // A sphere's picture at the corner is longer than wide by the secant of the angle off the axis.
            let [x, y] = view.edges().map(|[low, high]| high.max(-low));
            (1.15 * radius * x.hypot(y).hypot(1.0)).ceil().clamp(1.0, 12.0) as u32
        } else {
            radius.ceil() as u32
        };

        let (mut cells, mut tiles, mut bins, mut atlas_row) = (0, 0, 0, 0);
        let mut levels = [Level::default(); MAX_LEVELS];
        let mut small_bin = 0;
        for (l, level) in levels[..level_count].iter_mut().enumerate() {
            let pad = if l == 0 { 0 } else { PAD };
            let [width, height] = [view.width, view.height].map(|size| size.div_ceil(1 << l) + 2 * pad);
            let [tiles_x, tiles_y] = [width, height].map(|size| size.div_ceil(TILE));
            let [bins_x, bins_y] = [tiles_x, tiles_y].map(|tiles| tiles + 2 * margin);
            *level = Level {
                width,
                height,
                pad,
                first_cell: cells,
                tiles_x,
                first_tile: tiles,
                bins_x,
                bins_y,
                first_bin: bins,
                margin,
                scale: (1_u32 << l) as f32,
                atlas_row,
                sampled_radius,
                ..Level::default()
            };
            atlas_row = if l == 0 { 0 } else { atlas_row + height };
            cells += width * height;
            tiles += tiles_x * tiles_y;
            bins += bins_x * bins_y;
            if l == 0 {
                small_bin = bins;
                bins += bins_x * bins_y;
            }
        }

        let everywhere_bin = bins;
        bins += 1;
        let ellipsoids = ellipsoids && matches!(footprint, Footprint::Kernel(_));
        let mut ranges = 2 * (2 * margin + 1) + 1;
        if ellipsoids {
            for (l, level) in levels[..level_count].iter_mut().enumerate() {
                let tiles = [level.width, level.height].map(|size| size.div_ceil(TILE));
                for first in &mut level.ellipse_bins[..if l == 0 { 2 } else { 1 }] {
                    *first = bins;
                    bins += stretched_bins(tiles, margin);
                }
            }
            let finest = [levels[0].width, levels[0].height].map(|size| size.div_ceil(TILE));
            ranges += 2 * ((2 * margin + 1) * stretched_grids(finest) + 1);
        }

        let widest = levels[1..level_count].iter().map(|level| level.width).max().unwrap_or(0);
        let atlas = [view.width + widest, view.height.max(atlas_row)];
        let axis = |axis: glam::DVec3| axis.as_vec3().extend(0.0).to_array();
        // Shaders need not know infinity.
        let corner = |corner: glam::DVec3| axis(corner.clamp(glam::DVec3::splat(-1e37), glam::DVec3::splat(1e37)));
        let uniform = SplatUniform {
            right: axis(view.right),
            up: axis(view.up),
            forward: axis(view.forward),
            size: [view.width, view.height],
            atlas,
            middle: view.middle().map(|pixels| pixels as f32),
            tile_count: tiles,
            cell_count: cells,
            focal: focal as f32,
            near: 0.0,
            perspective: u32::from(perspective),
            fixed_radius,
            slice: slice(ranges),
            level_count: level_count as u32,
            small_bin,
            everywhere_bin,
            // The last one is for what is outside the picture.
            bin_count: bins + 1,
            moment: Profile::of(kernel).moment,
            faintest,
            peak: kernel.projected(0.0) as f32,
            culling: u32::from(culling),
            cut: u32::from(!view.cut.is_none()),
            fade_start: view.cut.fade_start as f32,
            fade_rate: view.cut.fade_rate as f32,
            clip_min: corner(view.cut.bounds.min - view.eye),
            clip_max: corner(view.cut.bounds.max - view.eye),
            fade_along: [0.0, 0.0, 1.0, 0.0],
            levels,
        };
        let shape = Shape { kernel, oblique: perspective && fixed_radius == 0.0, ellipsoids };
        Grids { uniform, cells, tiles, shape }
    }
}

/// Weights of the cells at -4 .. 3 for a value at -1/4 of a cell: the least-squares solution for the spectra of cubic
/// splines with radii from their [`sampled_radius`] to twice that, reproducing constants and ramps exactly. Its error is
/// 6e-4 in L2 for each axis.
pub const RECONSTRUCTION: [f32; RECONSTRUCTION_TAPS as usize] =
    [-0.005_387_49, 0.028_831_85, -0.091_422_73, 0.291_506_86, 0.875_815_4, -0.128_552_04, 0.035_465_39, -0.006_257_25];

/// Splats of a range of bins that one invocation sums, of so many ranges that a tile looks at, each with a round
/// of a loop for each splat and one for every eight; a software driver's limit for all loops together is 65535.
fn slice(ranges: u32) -> u32 {
    (48_000 / ranges).clamp(1, 4096)
}

/// What each cell of a reconstruction window gives to each of four finer cells.
pub fn reconstruction_window() -> [[f32; 4]; RECONSTRUCTION_WINDOW as usize] {
    let mut weights = [[0.0; 4]; RECONSTRUCTION_WINDOW as usize];
    // The window's first cell lies at -4; finer cell k lies at k/2 - 1/4. Even ones lie a quarter before the cell k/2,
    // odd ones a quarter behind it, which is the mirror image.
    for k in 0..4 {
        for (tap, &weight) in RECONSTRUCTION.iter().enumerate() {
            let mirrored = RECONSTRUCTION_TAPS as usize - tap;
            weights[if k % 2 == 0 { tap } else { mirrored } + k / 2][k] = weight;
        }
    }
    weights
}
