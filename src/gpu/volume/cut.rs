//! How a grid is cut to fit into the adapter's memory: into slabs of whole layers of bricks from front to back (F12 5.7.1),
//! and where not even two layers fit into one buffer, into windows of the picture.
//!
//! The coarser grids to which wide particles go ([`crate::cpu::volume::coarse`]) are cut along: a tier is one of these grids, and tier
//! 0 the picture's own.

use super::constants::{BRICK, CELLS};
use crate::cpu::volume::bricks::BORDER;
use crate::view::PerspectiveGrid;
use crate::view::perspective_grid::Slab;
use std::ops::Range;

/// Most layers of a slab: rays have a bit for each. Their loops over one slab stay far below what a software driver allows
/// (65535 rounds).
const MOST_LAYERS: u32 = 64;
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

/// What is held of one tier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tier {
    /// Bricks of the whole picture along x, y and z.
    pub bricks: [u32; 3],
    /// Bricks along x and y that a window holds.
    pub window: [u32; 2],
    /// Most layers that a slab fills.
    pub layers: u32,
    /// Layers that are held: those that a slab fills, and those before them that it reads.
    pub ring: u32,
}

impl Tier {
    /// Bricks of a window in one layer.
    pub fn columns(&self) -> u32 {
        self.window[0] * self.window[1]
    }

    /// Bricks that are held.
    pub fn bricks_held(&self) -> u64 {
        u64::from(self.columns()) * u64::from(self.ring)
    }

    /// The tiers of a window, finest first, where a slab has so many layers.
    fn all(bricks: [u32; 3], window: [u32; 2], layers: u32, count: usize) -> Vec<Tier> {
        let mut tiers = vec![Tier { bricks, window, layers, ring: layers + 1 }];
        while let Some(finer) = tiers.last().filter(|_| tiers.len() < count) {
            let bricks = finer.bricks.map(|bricks| read_by(0..bricks).end);
            let window = [0, 1].map(|axis: usize| most_read_by(finer.window[axis]).min(bricks[axis]));
            // Of the finest tier the last layer of the slab before is filled up too; of the others what a slab fills is at
            // most what is held.
            let ring = most_read_by(finer.ring).min(bricks[2]);
            tiers.push(Tier { bricks, window, layers: ring, ring });
        }
        tiers
    }
}

/// The bricks of the next tier that some of this tier read along an axis: brick `b` reads the eight cells from `4 b` on.
fn read_by(bricks: Range<u32>) -> Range<u32> {
    let half = BRICK / 2;
    half * bricks.start / BRICK..(half * bricks.end + half).div_ceil(BRICK)
}

/// How many bricks of the next tier so many of this tier read at most, wherever they lie.
fn most_read_by(bricks: u32) -> u32 {
    bricks.div_ceil(2) + 1
}

/// How a grid is cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cut {
    /// The picture's own grid, then the coarser ones; never empty.
    pub tiers: Vec<Tier>,
    /// The windows.
    pub windows: Vec<Window>,
    /// The slabs.
    pub slabs: Vec<Slab>,
}

impl Cut {
    /// Cuts a grid and its coarser ones, of `tiers` together, so that their cells, with one value or two each, take about
    /// `memory` bytes, and no more than `limit`. `None` where not even single bricks would fit.
    pub fn new(grid: &PerspectiveGrid, tiers: usize, attribute: bool, memory: u64, limit: u64) -> Option<Cut> {
        let [k, l, _] = grid.size;
        let bricks = Cut::bricks_of(grid);
        let sides = |parts: [u32; 2]| [0, 1].map(|axis: usize| bricks[axis].div_ceil(parts[axis]));
        let window_of = |parts: [u32; 2]| {
            let own = sides(parts);
            [0, 1].map(|axis: usize| (own[axis] + 2 * AROUND).min(bricks[axis]))
        };
        let with = |parts: [u32; 2], layers: u32| Tier::all(bricks, window_of(parts), layers, tiers.max(1));
        let mut parts = [1u32; 2];
        // Light and opacity of the pixels that a window draws.
        let rays = |own: [u32; 2]| {
            16 * own.map(|bricks| (f64::from(bricks * BRICK) * grid.cell + 1.0) as u64).iter().product::<u64>()
        };
        while bytes(&with(parts, 1), attribute) > limit || rays(sides(parts)) > limit {
            let own = sides(parts);
            let axis = usize::from(own[1] > own[0]);
            if own[axis] == 1 {
                return None;
            }
            parts[axis] += 1;
        }
        let fits = |layers: &u32| bytes(&with(parts, *layers), attribute) <= memory.min(limit);
        let layers = (1..=MOST_LAYERS.min(bricks[2])).rev().find(fits).unwrap_or(1);
        let tiers = with(parts, layers);
        let slices = u64::from(layers * BRICK);
        let slabs = grid.slabs(u64::from(k) * u64::from(l) * (slices + u64::from(Slab::OVERLAP)), 1, BRICK);
        let (own, window) = (sides(parts), window_of(parts));
        let window_at = |own_first: [u32; 2]| Window {
            origin: [0, 1].map(|axis: usize| own_first[axis].saturating_sub(AROUND).min(bricks[axis] - window[axis])),
            own_first,
            own_behind: [0, 1].map(|axis: usize| (own_first[axis] + own[axis]).min(bricks[axis])),
        };
        let starts = |axis: usize| (0..bricks[axis]).step_by(own[axis] as usize);
        let windows = starts(1).flat_map(|y| starts(0).map(move |x| [x, y])).map(window_at).collect();
        Some(Cut { tiers, windows, slabs })
    }

    /// Cuts a grid so that all of its finest tier is held, in one window, and slabs of about `slab` bytes fill it one after the other.
    /// `None` where that would take more than `memory` bytes.
    pub fn whole(grid: &PerspectiveGrid, tiers: usize, attribute: bool, slab: u64, memory: u64) -> Option<Cut> {
        let [k, l, m] = grid.size;
        let bricks = Cut::bricks_of(grid);
        let window = [bricks[0], bricks[1]];
        let with = |layers: u32| {
            let mut tiers = Tier::all(bricks, window, layers, tiers.max(1));
            tiers[0].ring = bricks[2].max(layers + 1);
            tiers
        };
        let fits = |layers: &u32| {
            let filled = u64::from(window[0] * window[1]) * u64::from(*layers) * brick_bytes(attribute);
            filled <= slab && bytes(&with(*layers), attribute) <= memory
        };
        let layers = (1..=MOST_LAYERS.min(bricks[2])).rev().find(fits).unwrap_or(1);
        let tiers = with(layers);
        if bytes(&tiers, attribute) > memory {
            return None;
        }
        let slices = u64::from(layers * BRICK);
        let slabs = grid.slabs(u64::from(k) * u64::from(l) * (slices + u64::from(Slab::OVERLAP)), 1, BRICK);
        debug_assert!(slabs.last().is_some_and(|slab| slab.slices.end == m));
        let all = Window { origin: [0; 2], own_first: [0; 2], own_behind: window };
        Some(Cut { tiers, windows: vec![all], slabs })
    }

    /// Bricks of a grid along x, y and z.
    fn bricks_of(grid: &PerspectiveGrid) -> [u32; 3] {
        let [k, l, m] = grid.size;
        let [across, down] = [k, l].map(|cells| (cells + 2 * BORDER as u32).div_ceil(BRICK));
        [across, down, m.div_ceil(BRICK)]
    }

    /// The tier that is drawn.
    pub fn finest(&self) -> &Tier {
        &self.tiers[0]
    }

    /// Bytes of the cells.
    pub fn bytes(&self, attribute: bool) -> u64 {
        bytes(&self.tiers, attribute)
    }

    /// Bricks that are held, of all tiers.
    pub fn bricks(&self) -> u64 {
        self.tiers.iter().map(Tier::bricks_held).sum()
    }

    /// Each tier's first brick of a window.
    pub fn origins(&self, window: &Window) -> Vec<[u32; 2]> {
        let mut origin = window.origin;
        let mut origins = vec![origin];
        for tier in &self.tiers[1..] {
            origin = [0, 1].map(|axis: usize| (origin[axis] / 2).min(tier.bricks[axis] - tier.window[axis]));
            origins.push(origin);
        }
        origins
    }

    /// For each slab the layers of each tier that it fills: its own, and those of the coarser tiers that no slab before it has
    /// filled and something in it reads.
    pub fn filled(&self) -> Vec<Vec<Range<u32>>> {
        let mut known = vec![0; self.tiers.len()];
        let of_slab = |slab: &Slab| {
            let own = slab.slices.start / BRICK..slab.slices.end.div_ceil(BRICK);
            // The last layer of the slab before is filled up where it has turned out to show.
            let mut reading = own.start.saturating_sub(1)..own.end;
            let mut filled = vec![own];
            for known in &mut known[1..] {
                let read = if reading.is_empty() { *known..*known } else { read_by(reading) };
                reading = read.start.max(*known)..read.end.max(*known);
                *known = reading.end;
                filled.push(reading.clone());
            }
            filled
        };
        self.slabs.iter().map(of_slab).collect()
    }
}

/// Bytes of the cells of tiers.
fn bytes(tiers: &[Tier], attribute: bool) -> u64 {
    brick_bytes(attribute) * tiers.iter().map(Tier::bricks_held).sum::<u64>()
}

/// Bytes of the cells of a brick.
fn brick_bytes(attribute: bool) -> u64 {
    u64::from(CELLS) * if attribute { 8 } else { 4 }
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
        fn all_of_a_grid_is_held_or_it_does_not_fit(
            size in prop::array::uniform3(1u32..700), slab in 0u64..1 << 26, tiers in 1usize..=7, attribute in any::<bool>(),
            room in 0.5..2.0f64,
        ) {
            let [k, l, m] = size;
            let grid = PerspectiveGrid {
                size, near: 0.0, far: f64::from(m), sigma: 1.0, cell: 1.0,
                middle: [k, l].map(|cells| 0.5 * f64::from(cells)), perspective: false,
            };
            let bricks = [k + 4, l + 4, m].map(|cells| u64::from(cells.div_ceil(BRICK)));
            let cells = bricks.iter().product::<u64>() * u64::from(CELLS) * if attribute { 8 } else { 4 };
            let memory = (room * cells as f64) as u64;
            let Some(cut) = Cut::whole(&grid, tiers, attribute, slab, memory) else {
                // Coarser grids of one slab, and a layer that is read besides, come on top.
                prop_assert!(room < 1.1 || bricks.iter().any(|&bricks| bricks < 16), "{bricks:?} {room}");
                return Ok(());
            };
            prop_assert!(cut.bytes(attribute) <= memory && cut.windows.len() == 1);
            prop_assert!(u64::from(cut.finest().ring) >= bricks[2]);
            let filled: Vec<u32> = cut.filled().iter().flat_map(|tiers| tiers[0].clone()).collect();
            prop_assert!(filled.iter().copied().eq(0..bricks[2] as u32), "{filled:?}");
        }

        #[test]
        fn every_brick_and_step_is_drawn_once(
            width in 1u32..900, height in 1u32..900, depth in 1.01..8.0f64, memory in 0u64..1 << 26,
            limit in 1u64 << 18..1 << 28, attribute in any::<bool>(), tiers in 1usize..=7,
        ) {
            let projection = Projection::Perspective { fov_y: 0.8 };
            let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, width, height).unwrap();
            let grid = PerspectiveGrid::new(&view, [1.0, depth], &GridOptions::default()).unwrap();
            let cut = Cut::new(&grid, tiers, attribute, memory, limit).unwrap();
            let finest = cut.finest();
            prop_assert!(cut.bytes(attribute) <= limit);
            let bricks = [width, height].map(|cells| (cells + 4).div_ceil(BRICK));
            let mut seen = vec![0; (bricks[0] * bricks[1]) as usize];
            for window in &cut.windows {
                for (axis, &bricks) in bricks.iter().enumerate() {
                    let (first, behind) = (window.own_first[axis], window.own_behind[axis]);
                    prop_assert!(first < behind);
                    // All neighbours that exist are in the window.
                    prop_assert!(window.origin[axis] <= first.saturating_sub(1));
                    prop_assert!(window.origin[axis] + finest.window[axis] >= (behind + 1).min(bricks));
                    prop_assert!(window.origin[axis] + finest.window[axis] <= bricks);
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
                prop_assert!((slab.slices.len() as u32) <= finest.layers * BRICK);
                step = slab.steps.end;
            }
            prop_assert_eq!(step, grid.size[2] + 1);

            // All that a brick reads of the next tier is held, and filled once.
            for window in &cut.windows {
                let origins = cut.origins(window);
                for (finer, tier) in origins.iter().zip(&cut.tiers).zip(origins.iter().zip(&cut.tiers).skip(1)) {
                    for axis in 0..2 {
                        let ends = |(first, tier): (&[u32; 2], &Tier)| first[axis]..first[axis] + tier.window[axis];
                        let (read, held) = (read_by(ends(finer)), ends(tier));
                        prop_assert!(held.start <= read.start && held.end >= read.end, "{held:?} {read:?}");
                    }
                }
            }
            let mut held = vec![0..0; cut.tiers.len()];
            for filled in cut.filled() {
                for (tier, layers) in filled.iter().enumerate() {
                    let Tier { bricks, layers: most, ring, .. } = cut.tiers[tier];
                    prop_assert!(layers.len() as u32 <= most && layers.end <= bricks[2], "{tier} {layers:?}");
                    if layers.is_empty() {
                        continue;
                    }
                    prop_assert!(tier > 0 || layers.start == held[0].end);
                    // What is overwritten is not read any more.
                    held[tier] = layers.end.saturating_sub(ring)..layers.end;
                    prop_assert!(held[tier].start <= layers.start);
                }
                for tier in 1..cut.tiers.len() {
                    let reading = match tier {
                        1 => filled[0].start.saturating_sub(1)..filled[0].end,
                        _ => filled[tier - 1].clone(),
                    };
                    if !reading.is_empty() {
                        let read = read_by(reading);
                        prop_assert!(held[tier].start <= read.start && held[tier].end >= read.end, "{tier} {held:?}");
                    }
                }
            }
        }
    }
}
