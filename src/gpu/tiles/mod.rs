//! Particles by the tiles of the picture that they reach, front to back: for modes whose pictures depend on the order.
//!
//! [`SpotList`] cuts a camera's particles into slabs of depth that fit into memory. For each slab, from front to back:
//!
//! 1. `count`, `gather`: particles are decoded and projected; those that are seen are written in the order of the draw list.
//!
//! [`TileList`] then, for the same slab:
//!
//! 2. `number_spots`, then `tally` and `move_pairs` for each digit of their keys: they are sorted by depth. The mode's own
//!    pass brings what it draws of them into that order, and says which tiles that reaches (`deepfield::tile_reach`).
//! 3. `count_pairs`, `write_pairs`: pairs of bin and particle, four at most for each particle of any size; sorted by
//!    bins, `find_ranges` finds each bin's. Sorting keeps the order of equal keys, so that nothing depends on
//!    which workgroup is first.
//! 4. The mode's own pass walks over each tile's particles, one invocation for each pixel (`deepfield::tile_walk`): its
//!    bins in all levels, merged.
//!
//! Particles of equal depth have the order of the draw list. A mode that draws slabs is a [`TileMode`]; layers
//! ([`crate::gpu::layered`]) need no order within them and sum splats in place of 2 to 4.

pub mod constants;
pub mod layout;
pub mod pipelines;

mod list;
mod mode;
pub mod spots;

pub use list::{Drawing, TileList};
pub use mode::{
    Binding, Canvas, TileBindings, TileFindings, TileMode, TileNews, TilePicture, TilePlugin, opaque_depths,
};
pub use spots::SpotList;

/// Layers of depth, equally deep but for the depth itself in perspective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layering {
    /// How many there are between the planes.
    pub count: u32,
    /// The most that one particle reaches, if it is listed in each of them; without, it is listed in that of its centre.
    pub spread: Option<u32>,
    /// The most of a slab.
    pub at_once: u32,
}

/// How particles are listed that lie over each other: by their distance from the eye, blurred, with their own columns
/// ([`crate::color::splat_colors::OwnColumn`]) in place of densities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverRequest {
    /// Radius of the kernel that blurs, pixels.
    pub blur: f32,
    /// The own column of the density 1; 0: densities tell nothing.
    pub column_factor: f32,
    /// The power of the density by which it changes.
    pub column_power: f32,
    /// What the column through a particle's middle, where densities tell nothing, is divided by, and by the squared smoothing length.
    pub column_area: f32,
}

/// Which particles are listed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileRequest {
    /// Depths of the first and the last particle.
    pub planes: [f64; 2],
    /// Densities up to this are left out.
    pub least: f32,
    /// Factor on densities.
    pub density_scale: f32,
    /// Radius of what is drawn of a particle, in smoothing lengths.
    pub extent: f32,
    /// Particles are sorted by the depth of their centre less this share of their radius.
    pub lead: f32,
    /// Least smoothing length, pixels.
    pub smallest: f64,
    /// Layers that particles are sorted by, in place of their depth.
    pub layers: Option<Layering>,
    /// That they lie over each other, where they do.
    pub over: Option<OverRequest>,
    /// Most particles that are listed at a time.
    pub at_a_time: u64,
}
