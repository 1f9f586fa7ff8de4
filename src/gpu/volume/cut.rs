//! How a grid is cut to fit into the adapter's memory: into slabs of whole layers of bricks from front to back (F12 5.7.1),
//! and where not even two layers fit into one buffer, into windows of the picture.

use super::constants::{BRICK, CELLS};
use crate::cpu::volume::bricks::BORDER;
use crate::view::PerspectiveGrid;
use crate::view::perspective_grid::Slab;

/// Most layers of a slab: a ray's loops over one slab stay far below what a software driver allows (65535 rounds).
const MOST_LAYERS: u64 = 64;
/// Bricks around those whose pixels a window draws: rays read two cells beyond their own.
const AROUND: u32 = 1;

/// A part of the picture that is drawn at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Its first brick, neighbours included.
    pub origin: [u32; 2],
    /// First brick whose pixels are drawn.
    pub own_first: [u32; 2],
    /// Behind the last one.
    pub own_behind: [u32; 2],
}

/// How a grid is cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Bricks along x and y that a window holds.
    pub window: [u32; 2],
    /// The windows.
    pub windows: Vec<Window>,
    /// Bricks along x of the whole picture.
    pub bricks_across: u32,
    /// Layers of a slab.
    pub layers: u32,
    /// Layers that are held: those of a slab and the last of the one before, for interpolation and gradients.
    pub ring: u32,
    /// The slabs.
    pub slabs: Vec<Slab>,
}

impl Cut {
    /// Cuts a grid so that its cells, with one value or two each, take about `memory` bytes, and no more than `limit`.
    /// `None` where not even single bricks would fit.
    pub fn new(grid: &PerspectiveGrid, attribute: bool, memory: u64, limit: u64) -> Option<Cut> {
        let [k, l, m] = grid.size;
        let bricks = [k, l].map(|cells| (cells + 2 * BORDER as u32).div_ceil(BRICK));
        let brick = u64::from(CELLS) * if attribute { 8 } else { 4 };
        let layer = |window: [u32; 2]| brick * u64::from(window[0]) * u64::from(window[1]);
        let sides = |parts: [u32; 2]| [0, 1].map(|axis: usize| bricks[axis].div_ceil(parts[axis]));
        let window_of = |parts: [u32; 2]| {
            let own = sides(parts);
            [0, 1].map(|axis: usize| (own[axis] + 2 * AROUND).min(bricks[axis]))
        };
        let mut parts = [1u32; 2];
        // Light and opacity of the pixels that a window draws.
        let rays = |own: [u32; 2]| {
            16 * own.map(|bricks| (f64::from(bricks * BRICK) * grid.cell + 1.0) as u64).iter().product::<u64>()
        };
        while 2 * layer(window_of(parts)) > limit || rays(sides(parts)) > limit {
            let own = sides(parts);
            let axis = usize::from(own[1] > own[0]);
            if own[axis] == 1 {
                return None;
            }
            parts[axis] += 1;
        }
        let (own, window) = (sides(parts), window_of(parts));
        let fits = (memory.min(limit) / layer(window)).saturating_sub(1);
        let layers = fits.clamp(1, MOST_LAYERS).min(u64::from(m.div_ceil(BRICK))) as u32;
        let slices = u64::from(layers * BRICK);
        let slabs = grid.slabs(u64::from(k) * u64::from(l) * (slices + u64::from(Slab::OVERLAP)), 1, BRICK);
        let window_at = |own_first: [u32; 2]| Window {
            origin: [0, 1].map(|axis: usize| own_first[axis].saturating_sub(AROUND).min(bricks[axis] - window[axis])),
            own_first,
            own_behind: [0, 1].map(|axis: usize| (own_first[axis] + own[axis]).min(bricks[axis])),
        };
        let starts = |axis: usize| (0..bricks[axis]).step_by(own[axis] as usize);
        let windows = starts(1).flat_map(|y| starts(0).map(move |x| [x, y])).map(window_at).collect();
        Some(Cut { window, windows, bricks_across: bricks[0], layers, ring: layers + 1, slabs })
    }

    /// Bytes of the cells.
    pub fn bytes(&self, attribute: bool) -> u64 {
        self.bricks() * u64::from(CELLS) * if attribute { 8 } else { 4 }
    }

    /// Bricks that are held.
    pub fn bricks(&self) -> u64 {
        u64::from(self.columns()) * u64::from(self.ring)
    }

    /// Bricks of a window in one layer.
    pub fn columns(&self) -> u32 {
        self.window[0] * self.window[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::perspective_grid::GridOptions;
    use crate::view::{Projection, View};
    use glam::DVec3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_brick_and_step_is_drawn_once(
            width in 1u32..900, height in 1u32..900, depth in 1.01..8.0f64, memory in 0u64..1 << 26,
            limit in 1u64 << 17..1 << 28, attribute in any::<bool>(),
        ) {
            let projection = Projection::Perspective { fov_y: 0.8 };
            let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, width, height).unwrap();
            let grid = PerspectiveGrid::new(&view, [1.0, depth], &GridOptions::default()).unwrap();
            let cut = Cut::new(&grid, attribute, memory, limit).unwrap();
            prop_assert!(cut.bytes(attribute) <= limit);
            let bricks = [width, height].map(|cells| (cells + 4).div_ceil(BRICK));
            let mut seen = vec![0; (bricks[0] * bricks[1]) as usize];
            for window in &cut.windows {
                for (axis, &bricks) in bricks.iter().enumerate() {
                    let (first, behind) = (window.own_first[axis], window.own_behind[axis]);
                    prop_assert!(first < behind);
                    // All neighbours that exist are in the window.
                    prop_assert!(window.origin[axis] <= first.saturating_sub(1));
                    prop_assert!(window.origin[axis] + cut.window[axis] >= (behind + 1).min(bricks));
                    prop_assert!(window.origin[axis] + cut.window[axis] <= bricks);
                }
                for y in window.own_first[1]..window.own_behind[1] {
                    for x in window.own_first[0]..window.own_behind[0] {
                        seen[(y * bricks[0] + x) as usize] += 1;
                    }
                }
            }
            prop_assert!(seen.iter().all(|&times| times == 1));
            let mut step = 0;
            for slab in &cut.slabs {
                prop_assert_eq!((slab.slices.start % BRICK, slab.steps.start), (0, step));
                prop_assert!((slab.slices.len() as u32) <= cut.layers * BRICK);
                step = slab.steps.end;
            }
            prop_assert_eq!(step, grid.size[2] + 1);
        }
    }
}
