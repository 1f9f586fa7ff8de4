//! Lattices of points and where they are in the world, bricks of their cells, and the samples of a field at a brick's
//! points.

use crate::model::Bounds;
use glam::{DAffine3, DMat3, DVec3};

/// Cells along an edge of a block: the smallest part of a brick that may be left out.
pub const BLOCK: usize = 8;

/// Points of a brick's samples before its own along each axis; as many are behind. Slopes and curved edges need them.
pub const BEFORE: usize = 1;

/// Cells along an axis at most: the number of an edge is made of three numbers of 20 bits.
pub const MOST_CELLS: u32 = (1 << 20) - 1;

/// A regular lattice of points, and the cubes between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Point 0 along each axis, world units.
    pub origin: DVec3,
    /// From a point to the next along each axis, world units; positive.
    pub spacing: f64,
    /// Number of cells along each axis, at most [`MOST_CELLS`].
    pub cells: [u32; 3],
}

impl Lattice {
    /// A lattice that holds `bounds` and a cell more on each side, with points at multiples of `spacing`; `None` where
    /// it would have more than [`MOST_CELLS`] cells along an axis.
    pub fn around(bounds: Bounds, spacing: f64) -> Option<Lattice> {
        let first = (bounds.min / spacing).floor() - 1.0;
        let last = (bounds.max / spacing).ceil() + 1.0;
        let cells = last - first;
        let fits = first.is_finite() && cells.cmpge(DVec3::ONE).all() && cells.max_element() <= f64::from(MOST_CELLS);
        let cells = cells.to_array().map(|cells| cells as u32);
        fits.then_some(Lattice { origin: first * spacing, spacing, cells })
    }

    /// Where the points of a number are along an axis.
    #[inline]
    pub fn coordinate(&self, axis: usize, point: i64) -> f64 {
        self.origin[axis] + self.spacing * point as f64
    }

    /// The middle, world units.
    pub fn center(&self) -> DVec3 {
        self.origin + 0.5 * self.spacing * DVec3::from_array(self.cells.map(f64::from))
    }

    /// The first cells of all bricks of `side` cells along each edge.
    pub fn bricks(&self, side: usize) -> Vec<[u32; 3]> {
        let axis = |axis: usize| (0..self.cells[axis]).step_by(side);
        axis(2).flat_map(|z| axis(1).flat_map(move |y| axis(0).map(move |x| [x, y, z]))).collect()
    }
}

/// What becomes of a surface at the outer faces of the lattice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Faces {
    /// It ends there; its volume is that of a closed one alone. For fields that are low there.
    #[default]
    Open,
    /// It ends there, and what the faces cut off belongs to its volume.
    Cut,
    /// Flat caps in the faces close it.
    Capped,
}

/// From a lattice to the world, where its own coordinates are not the world's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticePlacement {
    to_world: DAffine3,
    /// For slopes of the field, and normals along them.
    normals: DMat3,
}

impl LatticePlacement {
    /// By an invertible map.
    pub fn new(to_world: DAffine3) -> LatticePlacement {
        LatticePlacement { to_world, normals: to_world.matrix3.inverse().transpose() }
    }

    /// Where a point of the lattice's coordinates is, world units.
    pub(super) fn point(&self, at: DVec3) -> DVec3 {
        self.to_world.transform_point3(at)
    }

    /// The direction in the world of a normal of length 1.
    pub(super) fn normal(&self, normal: DVec3) -> DVec3 {
        (self.normals * normal).try_normalize().unwrap_or(normal)
    }

    /// Whether what is counter-clockwise becomes clockwise.
    pub(super) fn is_mirrored(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }
}

/// What a field is at the points of a brick and at one point more on each side.
#[derive(Clone, Debug)]
pub struct Samples {
    side: usize,
    /// The field, x first: [`Samples::index`]; NaN where it has no value, which counts as low. Points that no active
    /// block and no point beside one has may hold anything.
    pub values: Vec<f64>,
    /// How much there is of what the field is a mean of, in the same order: where that is less than
    /// [`super::Field::least_filled`] the field ends. Empty where it is known everywhere.
    pub filled: Vec<f64>,
    /// `sum w A W` of the attribute `A` whose mean is wanted, in the same order, where [`Samples::weights`] are `sum w W`;
    /// empty where none is.
    pub weighted: Vec<f64>,
    /// Whether the surface may pass each of the [`Samples::blocks`] cubed blocks, x first.
    pub active: Vec<bool>,
}

impl Samples {
    /// Those of a brick with `side` cells along each edge, a multiple of [`BLOCK`], of a field that ends somewhere or does
    /// not, with or without an attribute.
    pub fn new(side: usize, ends: bool, has_attribute: bool) -> Samples {
        debug_assert!(side > 0 && side.is_multiple_of(BLOCK));
        let row = side + 1 + 2 * BEFORE;
        let (points, blocks) = (row * row * row, side / BLOCK);
        let column = |is_wanted: bool| vec![0.0; if is_wanted { points } else { 0 }];
        Samples {
            side,
            values: column(true),
            filled: column(ends),
            weighted: column(has_attribute),
            active: vec![false; blocks * blocks * blocks],
        }
    }

    /// Bytes of memory that they take.
    pub fn memory(side: usize, ends: bool, has_attribute: bool) -> u64 {
        let row = (side + 1 + 2 * BEFORE) as u64;
        row * row * row * 8 * (1 + u64::from(ends) + u64::from(has_attribute))
    }

    /// Zero everywhere, and no block active.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
        self.filled.fill(0.0);
        self.weighted.fill(0.0);
        self.active.fill(false);
    }

    /// What the attribute's mean is weighted with, summed up: how much of what the field is a mean of there is, or the field.
    pub fn weights(&self) -> &[f64] {
        if self.filled.is_empty() { &self.values } else { &self.filled }
    }

    /// Cells along an edge of the brick.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Blocks along an edge of the brick.
    pub fn blocks(&self) -> usize {
        self.side / BLOCK
    }

    /// Points along an edge, those around the brick included.
    pub fn row(&self) -> usize {
        self.side + 1 + 2 * BEFORE
    }

    /// The place of a point among the values; point 0 is the one before the brick's first.
    #[inline]
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.row() + y) * self.row() + x
    }
}
