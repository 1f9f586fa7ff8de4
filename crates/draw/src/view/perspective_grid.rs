//! The perspective grid of F12 5.4: where the samples of a view's volume lie, in double precision.
//!
//! Grid coordinates are `x'` (columns, to the right), `y'` (rows, downwards) and `z'` (slices, away from the eye). Cell
//! `(i, j, k)` has its centre at `(i + 1/2, j + 1/2, k + 1/2)`. A cell is as wide as `1 / resolution` pixels, and slices
//! are as far apart as cells are wide, at every depth (equation 5.1):
//!
//! - perspective: `p_xy(z) = sigma z`, so `s_z(z') = n (f/n)^(z'/m)` (equation 5.2) with `m = lambda ln(f/n) / sigma`;
//! - orthographic: `p_xy = sigma` at every depth, so `s_z(z') = n + (f - n) z'/m` with `m = (f - n) / sigma`.
//!
//! `lambda` makes up for rays off the axis, which go further between two slices: by the secant of their angle,
//! `sqrt((k sigma/2)^2 + (l sigma/2)^2 + 1)` in the corners. (As printed in F12 the 1 stands behind the root, which would
//! be more than the corner ray's factor: 1.59 in place of 1.16 for 45 degrees.)

use super::{Extent, Projection, View};
use glam::DVec3;
use std::ops::Range;
use thiserror::Error;

/// A grid that cannot be made, and which setting to change.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GridError {
    /// The near plane is not in front of the far plane.
    #[error("near is {near}, expected a depth in front of far, which is {far}")]
    NearBehindFar {
        /// Depth of the near plane.
        near: f64,
        /// Depth of the far plane.
        far: f64,
    },
    /// A perspective view samples in front of the eye only.
    #[error("near is {0}, expected a depth greater than 0")]
    NearNotPositive(f64),
    /// No particle is between the near and the far plane and in the picture.
    #[error("eye, target: no particles are in view")]
    NothingInView,
    /// Cells per pixel outside what is sensible.
    #[error("resolution is {0}, expected a number greater than 0 and at most 4")]
    Resolution(f64),
    /// Far more slices than can be sampled.
    #[error("near is {near} and far {far}: {slices:.3e} slices, expected at most {}", PerspectiveGrid::MOST_SLICES)]
    TooManySlices {
        /// Depth of the near plane.
        near: f64,
        /// Depth of the far plane.
        far: f64,
        /// Slices that the range would need.
        slices: f64,
    },
}

/// How finely a view is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridOptions {
    /// Cells per pixel along each axis: 1, 1/2 and 1/3 are the full, half and third resolution.
    pub resolution: f64,
    /// Whether slices are as dense on the frustum's edge rays as cells are wide; else on the middle ray only.
    pub lambda: bool,
}

impl Default for GridOptions {
    fn default() -> GridOptions {
        GridOptions { resolution: 1.0, lambda: true }
    }
}

/// Where the samples of a view lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerspectiveGrid {
    /// Columns `k`, rows `l` and slices `m`.
    pub size: [u32; 3],
    /// Depth of the near plane `n`, world units.
    pub near: f64,
    /// Depth of the far plane `f`, world units.
    pub far: f64,
    /// Width of a cell: at depth 1 for a perspective view, everywhere for an orthographic one.
    pub sigma: f64,
    /// Width of a cell, pixels.
    pub cell: f64,
    /// Grid coordinates of the middle line of sight.
    pub middle: [f64; 2],
    /// Whether lines of sight diverge.
    pub perspective: bool,
}

/// A part of the grid, from front to back, that is resampled and drawn before the next (F12 5.7.1).
///
/// Drawing goes by steps: step `i` is the way from the centre of slice `i - 1` to that of slice `i`, step 0 the start and
/// step `m` the end. Gradients along a step need one slice more on both sides, so the last [`Slab::OVERLAP`] slices of a slab
/// are kept for the next one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Slab {
    /// The slices that are resampled.
    pub slices: Range<u32>,
    /// The steps that are drawn when they have been.
    pub steps: Range<u32>,
}

impl Slab {
    /// Slices that the next slab needs.
    pub const OVERLAP: u32 = 3;
}

impl PerspectiveGrid {
    /// More slices than this are refused.
    pub const MOST_SLICES: u32 = 1 << 20;
    /// What an automatic near plane leaves out in front of the eye, as a share of the far plane's depth.
    pub const NEAREST: f64 = 1.0 / 256.0;

    /// The width of a cell at depth 1 (perspective) or everywhere: the `sigma` of equation 5.1.
    pub fn sigma_of(view: &View, resolution: f64) -> f64 {
        1.0 / (resolution * view.focal_pixels())
    }

    /// The grid of `view` between two depths.
    ///
    /// # Errors
    /// [`GridError`] for planes or a resolution that make no sense.
    pub fn new(view: &View, [near, far]: [f64; 2], options: &GridOptions) -> Result<PerspectiveGrid, GridError> {
        let GridOptions { resolution, lambda } = *options;
        if !(resolution > 0.0 && resolution <= 4.0) {
            return Err(GridError::Resolution(resolution));
        }
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        if perspective && (near.is_nan() || near <= 0.0) {
            return Err(GridError::NearNotPositive(near));
        }
        if !(near < far && far - near < f64::INFINITY) {
            return Err(GridError::NearBehindFar { near, far });
        }
        let sigma = PerspectiveGrid::sigma_of(view, resolution);
        let cells = |pixels: u32| f64::from(pixels) * resolution;
        let [k, l] = [view.width, view.height].map(|pixels| (cells(pixels) - 1e-9).ceil().max(1.0));
        // From the middle line of sight to the further edge of the last cell.
        let middle = view.middle().map(|pixels| pixels * resolution);
        let far_side = |middle: f64, cells: f64| middle.max(cells - middle) * sigma;
        let corner = far_side(middle[0], k).hypot(far_side(middle[1], l));
        let slices = match (perspective, lambda) {
            (true, true) => (far / near).ln() / sigma * corner.hypot(1.0),
            (true, false) => (far / near).ln() / sigma,
            (false, _) => (far - near) / sigma,
        };
        if slices.is_nan() || slices > f64::from(PerspectiveGrid::MOST_SLICES) {
            return Err(GridError::TooManySlices { near, far, slices });
        }
        Ok(PerspectiveGrid {
            size: [k as u32, l as u32, (slices.ceil() as u32).max(1)],
            near,
            far,
            sigma,
            cell: 1.0 / resolution,
            middle,
            perspective,
        })
    }

    /// The depth of `z'`: `s_z`, equation 5.2.
    pub fn depth(&self, slice: f64) -> f64 {
        let share = slice / f64::from(self.size[2]);
        match self.perspective {
            true => self.near * (self.far / self.near).powf(share),
            false => self.near + (self.far - self.near) * share,
        }
    }

    /// The `z'` of a depth: the inverse of [`PerspectiveGrid::depth`]. Negative infinity or NaN for depths that a perspective
    /// view does not have.
    pub fn slice(&self, depth: f64) -> f64 {
        let share = match self.perspective {
            true => (depth / self.near).ln() / (self.far / self.near).ln(),
            false => (depth - self.near) / (self.far - self.near),
        };
        f64::from(self.size[2]) * share
    }

    /// Width of a cell at a depth: the sampling rate `p_xy` (equation 5.1).
    pub fn spacing(&self, depth: f64) -> f64 {
        if self.perspective { self.sigma * depth } else { self.sigma }
    }

    /// `ds_z / dz'` at a depth: the distance of slices there, on the middle line of sight.
    pub fn slice_spacing(&self, depth: f64) -> f64 {
        let m = f64::from(self.size[2]);
        match self.perspective {
            true => depth * (self.far / self.near).ln() / m,
            false => (self.far - self.near) / m,
        }
    }

    /// How much further it is between two slices along the ray through `(x', y')` than along the middle one.
    pub fn secant(&self, [x, y]: [f64; 2]) -> f64 {
        match self.perspective {
            true => {
                let slope = |at: f64, middle: f64| (at - middle) * self.sigma;
                (1.0 + slope(x, self.middle[0]).powi(2) + slope(y, self.middle[1]).powi(2)).sqrt()
            }
            false => 1.0,
        }
    }

    /// Camera coordinates of a grid position: `s` of F12 5.4.
    pub fn to_camera(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        let depth = self.depth(z);
        let spacing = self.spacing(depth);
        DVec3::new((x - self.middle[0]) * spacing, (self.middle[1] - y) * spacing, depth)
    }

    /// Grid position of camera coordinates: the inverse of [`PerspectiveGrid::to_camera`].
    pub fn to_grid(&self, camera: DVec3) -> [f64; 3] {
        let spacing = self.spacing(camera.z);
        [self.middle[0] + camera.x / spacing, self.middle[1] - camera.y / spacing, self.slice(camera.z)]
    }

    /// Camera coordinates of a cell's centre.
    pub fn center(&self, [i, j, k]: [u32; 3]) -> DVec3 {
        self.to_camera([i, j, k].map(|index| f64::from(index) + 0.5))
    }

    /// The slabs of the grid, from front to back: as thick as `memory` bytes allow where a cell takes `cell_bytes`, in whole
    /// `layer`s of slices and at least one layer.
    pub fn slabs(&self, memory: u64, cell_bytes: u64, layer: u32) -> Vec<Slab> {
        let [k, l, m] = self.size.map(u64::from);
        let slice = (k * l).saturating_mul(cell_bytes).max(1);
        let layer = u64::from(layer.max(1));
        let fits = (memory / slice).saturating_sub(u64::from(Slab::OVERLAP));
        let thickness = (fits / layer * layer).max(layer);
        let count = m.div_ceil(thickness);
        let step = |slab: u64| if slab == 0 { 0 } else { (slab * thickness - 1) as u32 };
        (0..count)
            .map(|slab| Slab {
                slices: (slab * thickness) as u32..((slab + 1) * thickness).min(m) as u32,
                steps: step(slab)..if slab + 1 == count { m as u32 + 1 } else { step(slab + 1) },
            })
            .collect()
    }
}

/// The extents that a view sees when smoothing lengths below `least` are raised to it, with the margins that they then have.
/// `least` is in world units: at depth 1, growing with depth, in perspective; at every depth otherwise.
pub fn seen(view: &View, extents: impl IntoIterator<Item = Extent>, least: f64) -> impl Iterator<Item = Extent> {
    extents.into_iter().filter_map(move |extent| {
        let least = match view.projection {
            Projection::Perspective { .. } => least * view.farthest_depth(&extent).max(0.0),
            Projection::Orthographic { .. } => least,
        };
        let raised = Extent { margin: extent.margin.max(least), ..extent };
        view.sees(&raised).then_some(raised)
    })
}

/// The depths between which extents that are [`seen`] reach; `None` if none is. A perspective view's begin at the eye.
pub fn depth_range(view: &View, seen: impl IntoIterator<Item = Extent>) -> Option<[f64; 2]> {
    let mut range: Option<[f64; 2]> = None;
    for extent in seen {
        let [near, far] = [view.nearest_depth(&extent) - extent.margin, view.farthest_depth(&extent) + extent.margin];
        let near = match view.projection {
            Projection::Perspective { .. } => near.max(0.0),
            Projection::Orthographic { .. } => near,
        };
        let known = range.get_or_insert([near, far]);
        *known = [known[0].min(near), known[1].max(far)];
    }
    range
}

/// The near and far plane: those that are set, else around the data (a perspective view's automatic near plane leaves
/// out [`PerspectiveGrid::NEAREST`] of the depth in front of the eye).
///
/// # Errors
/// [`GridError`] when nothing is in view, or near is not in front of far.
pub fn planes(
    data: Option<[f64; 2]>,
    near: Option<f64>,
    far: Option<f64>,
    perspective: bool,
) -> Result<[f64; 2], GridError> {
    if let (Some(near), Some(far)) = (near, far)
        && near >= far
    {
        return Err(GridError::NearBehindFar { near, far });
    }
    let data = data.ok_or(GridError::NothingInView)?;
    let far = far.unwrap_or(data[1]);
    let near = match near {
        Some(near) => near,
        None if perspective => data[0].max(PerspectiveGrid::NEAREST * far),
        None => data[0],
    };
    match near < far {
        true => Ok([near, far]),
        false if data[0] > far || data[1] < near => Err(GridError::NothingInView),
        false => Err(GridError::NearBehindFar { near, far }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use proptest::prelude::*;

    fn view(fov_y: f64, width: u32, height: u32) -> View {
        View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, Projection::Perspective { fov_y }, width, height).unwrap()
    }

    fn flat(height: f64) -> View {
        View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, Projection::Orthographic { height }, 64, 48).unwrap()
    }

    proptest! {
        #[test]
        fn the_mapping_is_inverted(
            fov in 0.1..2.4f64, near in 0.01..10.0f64, depth in 1.1..200.0f64,
            at in prop::array::uniform3(0.0..1.0f64), resolution in 0.2..1.5f64, ortho in any::<bool>(),
        ) {
            let view = if ortho { flat(near) } else { view(fov, 96, 64) };
            let options = GridOptions { resolution, lambda: true };
            let Ok(grid) = PerspectiveGrid::new(&view, [near, near * depth], &options) else { return Ok(()) };
            let place: [f64; 3] = std::array::from_fn(|axis| at[axis] * f64::from(grid.size[axis]));
            let back = grid.to_grid(grid.to_camera(place));
            for axis in 0..3 {
                prop_assert!((back[axis] - place[axis]).abs() < 1e-7 * f64::from(grid.size[axis]), "{place:?} {back:?}");
            }
            // Slices are never further apart than cells are wide, on the corner ray either.
            let z = grid.depth(place[2]);
            let corner = grid.secant([0.0, 0.0]);
            prop_assert!(grid.slice_spacing(z) * corner <= grid.spacing(z) * (1.0 + 1e-3));
            let numeric = (grid.depth(place[2] + 1e-4) - grid.depth(place[2] - 1e-4)) / 2e-4;
            prop_assert!((numeric / grid.slice_spacing(z) - 1.0).abs() < 1e-6);
        }

        #[test]
        fn slabs_hold_every_slice_and_step_once(memory in 0u64..1 << 24, layer in 1u32..40, depth in 1.01..100.0f64) {
            let grid = PerspectiveGrid::new(&view(0.8, 40, 30), [1.0, depth], &GridOptions::default()).unwrap();
            let slabs = grid.slabs(memory, 4, layer);
            let (mut slice, mut step) = (0, 0);
            for slab in &slabs {
                prop_assert_eq!((slab.slices.start, slab.steps.start), (slice, step));
                (slice, step) = (slab.slices.end, slab.steps.end);
                // A step's gradient needs the slice after it, if there is one.
                prop_assert!(slab.steps.end <= slice || slice == grid.size[2]);
                prop_assert!(slab.steps.start + Slab::OVERLAP > slab.slices.start);
            }
            prop_assert_eq!((slice, step), (grid.size[2], grid.size[2] + 1));
            let bytes = u64::from(grid.size[0] * grid.size[1]) * 4;
            let thickest = slabs.iter().map(|slab| slab.slices.len() as u64).max().unwrap();
            prop_assert!(thickest <= u64::from(layer) || (thickest + 3) * bytes <= memory);
        }
    }

    #[test]
    fn the_numbers_are_those_of_the_paper() {
        let grid = PerspectiveGrid::new(&view(0.9, 512, 512), [2.0, 6.0], &GridOptions::default()).unwrap();
        let sigma = 2.0 * 0.45f64.tan() / 512.0;
        assert!((grid.sigma - sigma).abs() < 1e-15);
        assert_eq!((grid.depth(0.0), grid.size[0], grid.size[1]), (2.0, 512, 512));
        assert!((grid.depth(f64::from(grid.size[2])) - 6.0).abs() < 1e-12);
        let lambda = (2.0 * (256.0 * sigma).powi(2) + 1.0).sqrt();
        assert_eq!(grid.size[2], (3.0f64.ln() / sigma * lambda).ceil() as u32);
        let half = GridOptions { resolution: 1.0 / 3.0, lambda: false };
        let third = PerspectiveGrid::new(&view(0.9, 512, 512), [2.0, 6.0], &half).unwrap();
        assert_eq!(third.size, [171, 171, (3.0f64.ln() / (3.0 * sigma)).ceil() as u32]);
        // The middle of the picture is the middle of the grid at any resolution.
        assert_eq!(third.to_camera([third.middle[0], third.middle[1], 3.0]).truncate(), glam::DVec2::ZERO);
    }

    #[test]
    fn an_orthographic_grid_is_uniform() {
        let grid = PerspectiveGrid::new(&flat(4.8), [-1.0, 2.0], &GridOptions::default()).unwrap();
        assert_eq!(grid.size, [64, 48, 30]);
        assert!((grid.depth(15.0) - 0.5).abs() < 1e-12 && grid.secant([0.0, 0.0]) == 1.0);
        assert!((grid.center([0, 0, 0]) - DVec3::new(-3.15, 2.35, -0.95)).length() < 1e-12);
    }

    #[test]
    fn wrong_planes_are_named() {
        let view = view(0.8, 40, 30);
        let message = |depths, resolution| {
            let options = GridOptions { resolution, lambda: true };
            PerspectiveGrid::new(&view, depths, &options).unwrap_err().to_string()
        };
        assert_eq!(message([3.0, 2.0], 1.0), "near is 3, expected a depth in front of far, which is 2");
        assert!(message([0.0, 2.0], 1.0).contains("near is 0, expected a depth greater than 0"));
        assert!(message([1.0, 2.0], 0.0).contains("resolution is 0"));
        assert!(message([1.0, f64::NAN], 1.0).contains("near is 1"));
        assert!(message([1e-300, 1e300], 4.0).contains("slices") || message([1e-300, 1e300], 4.0).contains("near"));
        assert_eq!(planes(None, None, None, true), Err(GridError::NothingInView));
        assert_eq!(planes(None, Some(2.0), Some(1.0), true), Err(GridError::NearBehindFar { near: 2.0, far: 1.0 }));
        assert_eq!(planes(Some([2.0, 3.0]), None, Some(1.0), true), Err(GridError::NothingInView));
        assert_eq!(planes(Some([0.0, 3.0]), None, Some(2.56), true), Ok([0.01, 2.56]));
        assert_eq!(planes(Some([-5.0, 3.0]), None, None, false), Ok([-5.0, 3.0]));
    }

    #[test]
    fn the_depths_of_data_are_those_in_view() {
        let view = view(0.8, 40, 30);
        let at = |x: f64, z: f64| Extent {
            bounds: Bounds { min: DVec3::new(x, 0.0, z), max: DVec3::new(x, 0.0, z) + 0.1 },
            margin: 0.2,
        };
        // The eye is at z = 1 and looks along -z; the second is beside the picture, the third behind the eye.
        let range = |view, least, extents: &[Extent]| depth_range(view, seen(view, extents.iter().copied(), least));
        let [near, far] = range(&view, 0.0, &[at(0.0, -1.1), at(90.0, -5.0), at(0.0, 4.0)]).unwrap();
        assert!((near - 1.8).abs() < 1e-12 && (far - 2.3).abs() < 1e-12, "{near} {far}");
        assert_eq!(range(&view, 0.0, &[at(90.0, -5.0)]), None);
        // A particle 2.1 from the eye that is raised to a quarter of its depth; one that is raised into the picture.
        let [near, far] = range(&view, 0.25, &[at(0.0, -1.1)]).unwrap();
        assert!((near - (2.0 - 0.525)).abs() < 1e-12 && (far - 2.1 * 1.25).abs() < 1e-12, "{near} {far}");
        assert!(range(&view, 0.0, &[at(5.0, -1.0)]).is_none() && range(&view, 2.0, &[at(5.0, -1.0)]).is_some());
        // A perspective view begins at the eye, an orthographic one has both sides of it.
        assert_eq!(range(&view, 0.0, &[at(0.0, 0.85)]).unwrap()[0], 0.0);
        let flat = View { projection: Projection::Orthographic { height: 1.0 }, ..view };
        let [near, far] = range(&flat, 0.4, &[at(0.0, 0.85)]).unwrap();
        assert!((near + 0.35).abs() < 1e-12 && (far - 0.55).abs() < 1e-12, "{near} {far}");
    }
}
