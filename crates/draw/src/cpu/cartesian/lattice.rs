//! How a Cartesian grid is laid: the box that is resampled, its cells, and the parallel view along an axis whose grid it is.
//!
//! All of that follows from extents ([`crate::cpu::volume::extents`]), so that a renderer that never has the particles in memory
//! lays the same grid.

use crate::cpu::volume::bricks::BORDER;
use crate::cpu::volume::{VolumeError, VolumeOptions, extents};
use crate::model::Bounds;
use crate::view::perspective_grid::{GridError, seen};
use crate::view::{Cut, Extent, Images, PerspectiveGrid, Projection, View};
use glam::DVec3;

/// Which box is resampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Region {
    /// Around the extents in view, as far as the view reaches.
    #[default]
    View,
    /// Around all extents.
    Data,
}

/// How a grid is laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CartesianOptions {
    /// Cells along the longest side of the box.
    pub cells: u32,
    /// Which box.
    pub region: Region,
    /// Memory that the cells may take if none is empty, bytes.
    pub memory: u64,
}

/// A grid that has been laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The parallel view whose grid it is, with a pixel for each column of cells: along -z with y up, so that x is to the right.
    pub view: View,
    /// The cells of the box, and before its first and behind its last slice [`BORDER`] more.
    pub grid: PerspectiveGrid,
    /// Cells of the box along x, y and z.
    pub cells: [u32; 3],
}

/// A box of nothing: what boxes grow from.
const NOTHING: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

/// The box that a region is, and the depths between which rays go.
///
/// # Errors
/// [`VolumeError::Grid`] when nothing is in view or the planes make no sense.
pub fn region(
    view: &View,
    extents: &[Extent],
    region: Region,
    options: &VolumeOptions,
) -> Result<(Bounds, [f64; 2]), VolumeError> {
    let depths = extents::planes_of(view, extents.iter().copied(), 0.0, [options.near, options.far])?;
    let around = |bounds: Bounds, extent: Extent| {
        let Extent { bounds: own, margin } = extent;
        Bounds { min: bounds.min.min(own.min - margin), max: bounds.max.max(own.max + margin) }
    };
    if region == Region::Data {
        return Ok((extents.iter().copied().fold(NOTHING, around), depths));
    }
    let data = seen(view, extents.iter().copied(), 0.0).fold(NOTHING, around);
    let edges = view.edges();
    let frustum = (0..8).fold(NOTHING, |bounds, corner| {
        let depth = depths[corner / 4];
        let scale = match view.projection {
            Projection::Perspective { .. } => depth,
            Projection::Orthographic { .. } => 1.0,
        };
        let [x, y] = [0, 1].map(|axis: usize| edges[axis][corner >> axis & 1] * scale);
        let at = view.eye + x * view.right + y * view.up + depth * view.forward;
        Bounds { min: bounds.min.min(at), max: bounds.max.max(at) }
    });
    let bounds = Bounds { min: data.min.max(frustum.min), max: data.max.min(frustum.max) };
    match (bounds.max - bounds.min).min_element() > 0.0 {
        true => Ok((bounds, depths)),
        false => Err(GridError::NothingInView.into()),
    }
}

impl Lattice {
    /// The grid for a view of extents, and the depths between which rays go. `attribute`: whether cells hold one.
    ///
    /// # Errors
    /// As [`region`] and [`Lattice::new`].
    pub fn of(
        view: &View,
        extents: &[Extent],
        cartesian: &CartesianOptions,
        attribute: bool,
        options: &VolumeOptions,
    ) -> Result<(Lattice, [f64; 2]), VolumeError> {
        let (bounds, planes) = region(view, extents, cartesian.region, options)?;
        Ok((Lattice::new(bounds, cartesian, attribute)?, planes))
    }

    /// The grid of a box.
    ///
    /// # Errors
    /// [`VolumeError::Setting`] when its cells would take more memory than allowed.
    pub fn new(bounds: Bounds, cartesian: &CartesianOptions, attribute: bool) -> Result<Lattice, VolumeError> {
        let size = bounds.max - bounds.min;
        let cell = size.max_element() / f64::from(cartesian.cells.max(1));
        let border = 2 * BORDER as u64;
        let cells = size.to_array().map(|side| ((side / cell - 1e-9).ceil() as u64).max(1));
        let bytes =
            cells.iter().fold(4 * (1 + u64::from(attribute)), |product, side| product.saturating_mul(side + border));
        if bytes > cartesian.memory || cells.iter().any(|&side| side > 1 << 16) {
            let [k, l, m] = cells;
            let mib = |bytes: u64| bytes.div_ceil(1 << 20);
            return Err(VolumeError::Setting {
                field: "cells",
                found: cartesian.cells.to_string(),
                expected: format!(
                    "fewer: a grid of {k} x {l} x {m} cells takes {} MiB, and memory is {} MiB",
                    mib(bytes),
                    mib(cartesian.memory)
                ),
            });
        }
        let cells = cells.map(|side| side as u32);
        Ok(Lattice::with(bounds.min, cell, cells))
    }

    /// The grid of cells of a width, the first of which has its corner with the least coordinates at `min`.
    fn with(min: DVec3, cell: f64, cells: [u32; 3]) -> Lattice {
        let [k, l, m] = cells;
        let eye = min + cell * DVec3::new(0.5 * f64::from(k), 0.5 * f64::from(l), f64::from(m));
        let view = View {
            eye,
            right: DVec3::X,
            up: DVec3::Y,
            forward: DVec3::NEG_Z,
            projection: Projection::Orthographic { height: f64::from(l) * cell },
            width: k,
            height: l,
            shift: [0.0; 2],
            cut: Cut::NONE,
            images: Images::ONE,
            time: 0.0,
        };
        let slices = m + 2 * BORDER as u32;
        let near = -(BORDER as f64) * cell;
        let grid = PerspectiveGrid {
            size: [k, l, slices],
            near,
            far: near + f64::from(slices) * cell,
            sigma: cell,
            cell: 1.0,
            middle: [k, l].map(|cells| 0.5 * f64::from(cells)),
            perspective: false,
        };
        Lattice { view, grid, cells }
    }

    /// A grid of the same box with so many cells along its longest side.
    pub fn coarser(&self, cells: u32) -> Lattice {
        let longest = self.cells.into_iter().max().unwrap_or(1);
        let factor = f64::from(longest) / f64::from(cells.max(1));
        let least = self.middle() - 0.5 * self.grid.sigma * DVec3::from(self.cells.map(f64::from));
        let fewer = self.cells.map(|side| ((f64::from(side) / factor - 1e-9).ceil() as u32).max(1));
        Lattice::with(least, self.grid.sigma * factor, fewer)
    }

    /// The middle of the box, world coordinates.
    pub fn middle(&self) -> DVec3 {
        self.view.eye + 0.5 * f64::from(self.cells[2]) * self.grid.sigma * self.view.forward
    }

    /// Stored coordinates of a world position: those of cells, with [`BORDER`] cells on every side.
    pub fn place(&self, world: DVec3) -> DVec3 {
        let [x, y, z] = self.grid.to_grid(self.view.to_camera(world));
        DVec3::new(x + BORDER as f64, y + BORDER as f64, z)
    }

    /// The box in stored coordinates.
    pub fn bounds(&self) -> [DVec3; 2] {
        let [k, l, slices] = self.grid.size.map(f64::from);
        let border = BORDER as f64;
        [DVec3::splat(border), DVec3::new(k + border, l + border, slices - border)]
    }
}
