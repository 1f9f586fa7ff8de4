//! The nearest neighbours of all entries of a leaf together: the leaves that they lie in are found once, and their places are
//! looked through in SIMD lanes.
//!
//! Once the `wanted`-th nearest entry of `p` is known to be at distance `h_p`, the ball of radius `h_p + |q - p|` around `q`
//! holds as many, so that no search has to grow. Most searches need not even go that far: neighbours have similar `h`, and
//! if a ball a little larger than those of the others holds enough, it is the answer. What lies in the ball is listed in
//! single precision relative to the centres of leaves, with a margin for rounding, the `wanted`-th of the list is selected, and
//! what is close to it looked at in double precision.

use super::tree::{LEAF, Near, Tree, farthest_last};
use glam::{DVec3, Vec3};
use pulp::Simd;

/// Leaves beyond which entries are looked up one by one: at the edge of a dense clump a common list is long.
const MOST_LEAVES: usize = 1 << 11;

/// Bound on the error of a distance in single precision, as a share of the largest coordinate.
const ROUNDING: f32 = 1e-6;

/// Distances, as a share of the box around all particles, below which single precision is not used, as their squares underflow.
const SMALL: f64 = 1e-15;

/// By how much the first ball that is tried is larger than that of the nearest entry before.
const MARGIN: f64 = 1.1;

/// How far beyond the first entry's ball leaves are fetched, as a multiple of it.
const REACH: f64 = 1.5;

/// The places of a leaf for SIMD lanes.
pub(super) struct Block {
    /// The middle of the leaf's box.
    pub center: DVec3,
    /// Places relative to it, by axis. Lanes that are left over are too far away for any search.
    pub at: [[f32; LEAF]; 3],
    /// The leaf's first entry.
    pub first: u32,
}

/// Memory for the searches of a thread, and what is known from the leaf before.
#[derive(Default)]
pub(super) struct Group {
    /// Boxes of the leaves around, relative to the group's centre: by axis the minima, then the maxima, then the longest
    /// edges; filled up with empty boxes to a multiple of [`LEAF`].
    boxes: [Vec<f32>; 7],
    /// Those leaves' numbers.
    leaves: Vec<u32>,
    /// By leaf: positive where it lies outside a ball.
    outside: Vec<f32>,
    /// Indices of the leaves that a ball touches.
    touched: Vec<u32>,
    /// Bits of the squared distance (high half) and entry of what lies in the ball, and room for a block more.
    list: Vec<u64>,
    near: Vec<Near>,
    band: Vec<Near>,
    waiting: Vec<u32>,
    /// Entries whose `wanted`-th neighbour has been found, with its distance.
    known: Vec<(DVec3, f64)>,
}

struct Search<'a, F> {
    group: &'a mut Group,
    tree: &'a Tree,
    leaf: u32,
    wanted: usize,
    found: F,
}

impl<F: FnMut(u32, &[Near])> pulp::WithSimd for Search<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.group.search_lanes(simd, self.tree, self.leaf, self.wanted, self.found);
    }
}

impl Group {
    /// Calls `found` for every entry of a leaf, in any order, with its `wanted` nearest entries, itself included and the
    /// farthest last (`wanted` at most the number of entries). A group serves one tree and one `wanted`.
    pub(super) fn search(&mut self, tree: &Tree, leaf: u32, wanted: usize, found: impl FnMut(u32, &[Near])) {
        pulp::Arch::new().dispatch(Search { group: self, tree, leaf, wanted, found });
    }

    #[inline(always)]
    fn search_lanes<S: Simd>(
        &mut self,
        simd: S,
        tree: &Tree,
        leaf: u32,
        wanted: usize,
        mut found: impl FnMut(u32, &[Near]),
    ) {
        let node = tree.nodes[tree.leaves[leaf as usize] as usize];
        let center = node.center();
        // The first one is in the middle, so that its ball says much about the others.
        let distance = |entry: &u32| tree.at[*entry as usize].distance_squared(center);
        let first = (node.start..node.end).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(node.start);
        let (bound, _) = self.bound(tree.at[first as usize]);
        self.known.clear();
        self.alone(tree, first, wanted, bound);
        found(first, &self.near);
        let (at, h) = self.known[0];
        let farthest = (node.start..node.end).map(|entry| tree.at[entry as usize].distance(at)).fold(0.0, f64::max);
        let reach = (h + farthest).min(REACH * h) * (1.0 + 1e-9);
        let together = reach > SMALL && self.gather(tree, leaf, reach);
        for entry in (node.start..node.end).filter(|entry| *entry != first) {
            let at = tree.at[entry as usize];
            let (bound, similar) = self.bound(at);
            let guess = (MARGIN * similar).min(bound).min(reach);
            let mut is_found = false;
            if together && bound > SMALL {
                for radius in [guess, bound.min(reach)] {
                    is_found = is_found || self.among(simd, tree, center, at, radius, wanted, radius == bound);
                }
            }
            if is_found {
                let h = self.near.last().map_or(0.0, |near| near.squared.sqrt());
                self.known.push((at, h));
            } else {
                self.alone(tree, entry, wanted, bound);
            }
            found(entry, &self.near);
        }
    }

    /// The radius of a ball around a place that holds enough, from what is known, and that of the nearest entry.
    #[inline(always)]
    fn bound(&self, at: DVec3) -> (f64, f64) {
        let (mut bound, mut nearest, mut similar) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        for (other, h) in &self.known {
            let distance = other.distance(at);
            bound = bound.min(h + distance);
            similar = if distance < nearest { *h } else { similar };
            nearest = nearest.min(distance);
        }
        (bound * (1.0 + 1e-9), similar)
    }

    /// Looks up one entry by itself.
    fn alone(&mut self, tree: &Tree, entry: u32, wanted: usize, bound: f64) {
        let at = tree.at[entry as usize];
        tree.nearest(at, wanted, bound * bound, &mut self.near);
        let farthest = farthest_last(&mut self.near);
        self.known.push((at, farthest.sqrt()));
    }

    /// Finds the leaves within `reach` of a leaf's box; whether they are few enough.
    #[inline(always)]
    fn gather(&mut self, tree: &Tree, leaf: u32, reach: f64) -> bool {
        for column in &mut self.boxes {
            column.clear();
        }
        self.leaves.clear();
        self.waiting.clear();
        self.waiting.push(0);
        let own = &tree.nodes[tree.leaves[leaf as usize] as usize];
        let center = own.center();
        while let Some(index) = self.waiting.pop() {
            let node = &tree.nodes[index as usize];
            if node.bounds.distance_to(&own.bounds) > reach * reach {
                continue;
            }
            if node.right != 0 {
                self.waiting.push(node.right);
                self.waiting.push(index + 1);
                continue;
            }
            if self.leaves.len() == MOST_LEAVES {
                return false;
            }
            let [min, max] = [(node.bounds.min - center).as_vec3(), (node.bounds.max - center).as_vec3()];
            let edge = (max - min).max_element();
            for (column, value) in self.boxes.iter_mut().zip([min.x, min.y, min.z, max.x, max.y, max.z, edge]) {
                column.push(value);
            }
            self.leaves.push(node.leaf);
        }
        let filled = self.leaves.len().next_multiple_of(LEAF);
        let empty = [f32::MAX, f32::MAX, f32::MAX, f32::MIN, f32::MIN, f32::MIN, 0.0];
        for (column, value) in self.boxes.iter_mut().zip(empty) {
            column.resize(filled, value);
        }
        self.outside.resize(filled, 0.0);
        self.touched.resize(filled, 0);
        true
    }

    /// Brings the leaves that a ball touches to the front of `touched`; how many they are.
    #[inline(always)]
    fn touch<S: Simd>(&mut self, simd: S, at: Vec3, radius: f32) -> usize {
        let [min_x, min_y, min_z, max_x, max_y, max_z, edge] = &self.boxes;
        let (min_x, min_y, min_z) = (S::as_simd_f32s(min_x).0, S::as_simd_f32s(min_y).0, S::as_simd_f32s(min_z).0);
        let (max_x, max_y, max_z) = (S::as_simd_f32s(max_x).0, S::as_simd_f32s(max_y).0, S::as_simd_f32s(max_z).0);
        let edge = S::as_simd_f32s(edge).0;
        let (outside, _) = S::as_mut_simd_f32s(&mut self.outside);
        let (x, y, z) = (simd.splat_f32s(at.x), simd.splat_f32s(at.y), simd.splat_f32s(at.z));
        let (zero, share) = (simd.splat_f32s(0.0), simd.splat_f32s(ROUNDING));
        let base = simd.splat_f32s(radius + ROUNDING * (radius + at.length()));
        for (index, outside) in outside.iter_mut().enumerate() {
            let dx = simd.max_f32s(simd.sub_f32s(min_x[index], x), simd.sub_f32s(x, max_x[index]));
            let dy = simd.max_f32s(simd.sub_f32s(min_y[index], y), simd.sub_f32s(y, max_y[index]));
            let dz = simd.max_f32s(simd.sub_f32s(min_z[index], z), simd.sub_f32s(z, max_z[index]));
            let (dx, dy, dz) = (simd.max_f32s(dx, zero), simd.max_f32s(dy, zero), simd.max_f32s(dz, zero));
            let squared = simd.mul_add_e_f32s(dx, dx, simd.mul_add_e_f32s(dy, dy, simd.mul_f32s(dz, dz)));
            let most = simd.mul_add_e_f32s(edge[index], share, base);
            *outside = simd.sub_f32s(squared, simd.mul_f32s(most, most));
        }
        let mut count = 0;
        let touched = &mut self.touched[..self.outside.len()];
        for (index, outside) in self.outside.iter().enumerate() {
            touched[count] = index as u32;
            count += usize::from(*outside <= 0.0);
        }
        count
    }

    /// Brings the `wanted` nearest entries of a place into `near`, the farthest last, if a ball of that radius, all of it
    /// among the leaves that were fetched, holds as many. That it does may be `sure`.
    #[inline(always)]
    fn among<S: Simd>(
        &mut self,
        simd: S,
        tree: &Tree,
        center: DVec3,
        at: DVec3,
        radius: f64,
        wanted: usize,
        sure: bool,
    ) -> bool {
        let radius = radius as f32;
        let touched = self.touch(simd, (at - center).as_vec3(), radius);
        if self.list.len() < touched * LEAF {
            self.list.resize(2 * touched * LEAF, 0);
        }
        let mut length = 0;
        let mut error = 0.0f32;
        for index in &self.touched[..touched] {
            let leaf = self.leaves[*index as usize];
            // Coordinates relative to the leaf's centre are at most its box and the ball large.
            let slack = ROUNDING * (self.boxes[6][*index as usize] + radius);
            let most = (radius + slack) * (radius + slack);
            error = error.max(slack);
            let block = &tree.blocks[leaf as usize];
            let squared = squared_distances(simd, block, (at - block.center).as_vec3());
            let Some(slots) = self.list[length..].first_chunk_mut::<LEAF>() else { return false };
            let mut kept = 0usize;
            #[allow(clippy::needless_range_loop, reason = "an iterator over the array is not unrolled")]
            for lane in 0..LEAF {
                let entry = block.first.wrapping_add(lane as u32);
                // Before the last lane fewer than all are kept.
                slots[kept % LEAF] = u64::from(squared[lane].to_bits()) << 32 | u64::from(entry);
                kept = kept.wrapping_add(usize::from(squared[lane] <= most));
            }
            length += kept;
        }
        if length < wanted {
            return false;
        }
        let list = &mut self.list[..length];
        let (nearer, limit, farther) = list.select_nth_unstable(wanted - 1);
        let distance = |key: u64| f32::from_bits((key >> 32) as u32);
        let limit_distance = distance(*limit).sqrt();
        if !sure && limit_distance + 2.0 * error > radius {
            return false;
        }
        // What is close to the limit is put in order by distances in double precision.
        let low = (limit_distance - 2.0 * error).max(0.0).powi(2);
        let high = (limit_distance + 2.0 * error).powi(2);
        let near = |key: u64| {
            let entry = key as u32;
            Near { squared: tree.at[entry as usize].distance_squared(at), entry }
        };
        self.near.clear();
        self.band.clear();
        self.band.push(near(*limit));
        for key in nearer {
            if distance(*key) < low { self.near.push(near(*key)) } else { self.band.push(near(*key)) }
        }
        for key in farther {
            if distance(*key) <= high {
                self.band.push(near(*key));
            }
        }
        if self.band.len() > 1 {
            self.band.sort_unstable_by(|a, b| a.squared.total_cmp(&b.squared));
        }
        let missing = wanted.saturating_sub(self.near.len());
        self.near.extend_from_slice(&self.band[..missing.min(self.band.len())]);
        true
    }
}

/// Squared distances of a place from those of a block.
#[inline(always)]
fn squared_distances<S: Simd>(simd: S, block: &Block, at: Vec3) -> [f32; LEAF] {
    let mut squared = [0.0; LEAF];
    let ((x, _), (y, _), (z, _)) =
        (S::as_simd_f32s(&block.at[0]), S::as_simd_f32s(&block.at[1]), S::as_simd_f32s(&block.at[2]));
    let (out, _) = S::as_mut_simd_f32s(&mut squared);
    let (at_x, at_y, at_z) = (simd.splat_f32s(at.x), simd.splat_f32s(at.y), simd.splat_f32s(at.z));
    for (index, out) in out.iter_mut().enumerate() {
        let dx = simd.sub_f32s(x[index], at_x);
        let dy = simd.sub_f32s(y[index], at_y);
        let dz = simd.sub_f32s(z[index], at_z);
        *out = simd.mul_add_e_f32s(dx, dx, simd.mul_add_e_f32s(dy, dy, simd.mul_f32s(dz, dz)));
    }
    squared
}
