//! Merging the particles of a grid node's cells, for splats (F12 4.7.3); [`super::volume`] has the rule for volumes.
//!
//! In each of the 256^3 cells of edge `q`, particles with `h <= q` ("points") become one; those with larger `h`
//! ("sprites") are merged in groups whose smoothing lengths differ by at most `fusion * q`. A merged particle has the sum
//! of the masses and the mass-weighted mean position, smoothing length, density (so that `sum m rho` is kept, F12 4.1) and
//! attributes. F12 4.2 weights attributes with `m rho`, by which its one mode draws; all modes but that one, and stars as points of light, draw
//! `m`, or `m / rho` times something, and a file has one value of each attribute. Its position is quantised to a quarter of the cell along each axis.

use super::block::{Block, Box3, Content, View};
use super::sorted::{Columns, Sorted, keyed_depth};
use super::{Context, Purpose};
use crate::codec::AttributeMerge;
use crate::codec::coordinates::{CELL_BITS, GRID_BITS, GRID_POINT, pack_grid};
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::{NodeKey, RootCell};

/// What merging needs to know beside the particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Merger<'a> {
    /// The cell of the node that the merged particles belong to.
    cell: NodeKey,
    /// Bits of a particle's key below those that tell the merging cell.
    shift: u32,
    /// The merging cell at the corner of what keys are over.
    corner: [u32; 3],
    root: RootCell,
    /// Largest difference of smoothing lengths that sprites may have, in cells.
    pub fusion: f64,
    /// Merge rule of each attribute.
    pub rules: &'a [AttributeMerge],
    /// What is merged for.
    pub levels: Purpose,
}

/// What a group of particles becomes, positions and attributes aside.
pub(super) struct Merged {
    pub mass: f64,
    pub density: f64,
    pub smoothing_length: f32,
    /// The point flag.
    pub point: bool,
}

impl<'a> Merger<'a> {
    /// What merges the particles of a node.
    pub fn new(context: &Context<'a>, levels: Purpose, key: NodeKey) -> Merger<'a> {
        let cell = key.cell();
        // Keys are over a cell of this many depths above.
        let keyed = u32::from(cell.depth - keyed_depth(cell.depth));
        Merger {
            cell,
            shift: 3 * (MORTON_BITS - CELL_BITS - keyed),
            corner: [cell.x, cell.y, cell.z].map(|v| v >> keyed << (keyed + CELL_BITS)),
            root: context.root,
            fusion: context.options.fusion,
            rules: context.rules,
            levels,
        }
    }

    /// Edge of a merging cell, world units.
    fn cell_size(&self) -> f64 {
        self.cell.size(self.root) * (-f64::from(CELL_BITS)).exp2()
    }

    /// Merges what lies in neighbouring runs of cells into one block. Runs that share a merging cell must come as one content.
    pub fn merge(&self, contents: &[Content], sorted: &Sorted) -> Block {
        let len: usize = contents.iter().map(Content::len).sum();
        let mut out = Block {
            keys: Vec::with_capacity(len),
            units: Vec::with_capacity(len),
            boxes: Vec::with_capacity(len),
            columns: Columns::with_capacity(self.rules.len(), len),
            words: Vec::with_capacity(len),
            delta_squared: 0.0,
        };
        let mut scratch = Vec::new();
        for content in contents {
            self.merge_view(&content.view(sorted, self.cell.depth), &mut out, &mut scratch);
        }
        out
    }

    fn merge_view(&self, from: &View, out: &mut Block, scratch: &mut Vec<u32>) {
        let (shift, q) = (self.shift, self.cell_size());
        let mut start = 0;
        while start < from.keys.len() {
            let cell = from.keys[start] >> shift;
            let len = from.keys[start..].iter().take_while(|&&key| key >> shift == cell).count();
            if self.levels == Purpose::Samples {
                self.merge_volumes(from, start..start + len, q, out, scratch);
            } else if len == 1 {
                self.push_single(from, start, q, out);
            } else {
                // Smallest first: the points come first, and sprites to be merged are neighbours.
                scratch.clear();
                scratch.extend(start as u32..(start + len) as u32);
                let h = |i: u32| from.smoothing_length[i as usize];
                scratch.sort_unstable_by(|&a, &b| h(a).total_cmp(&h(b)).then(a.cmp(&b)));
                let mut rest = &scratch[..];
                while let Some(&first) = rest.first() {
                    let smallest = f64::from(h(first));
                    let limit = if smallest <= q { q } else { smallest + self.fusion * q };
                    // What is not a number is within no limit.
                    let size = rest.iter().take_while(|&&i| f64::from(h(i)) <= limit).count().max(1);
                    let (group, after) = rest.split_at(size);
                    if let [one] = group {
                        self.push_single(from, *one as usize, q, out);
                    } else {
                        self.push_group(from, group, q, out);
                    }
                    rest = after;
                }
            }
            start += len;
        }
    }

    #[inline]
    pub(super) fn push_single(&self, from: &View, i: usize, q: f64, out: &mut Block) {
        let columns = &mut out.columns;
        columns.mass.push(from.mass[i]);
        columns.density.push(from.density[i]);
        columns.smoothing_length.push(from.smoothing_length[i]);
        columns.attributes.iter_mut().zip(&from.attributes).for_each(|(out, values)| out.push(values[i]));
        let point = f64::from(from.smoothing_length[i]) <= q;
        self.push_position(from.keys[i], from.units[i], from.box_of(i), point, out);
    }

    fn push_group(&self, from: &View, group: &[u32], q: f64, out: &mut Block) {
        let (mut mass, mut presence, mut smoothing, mut position) = (0.0, 0.0, 0.0, [0.0; 3]);
        for &i in group {
            let i = i as usize;
            let m = f64::from(from.mass[i]);
            mass += m;
            presence += m * f64::from(from.density[i]);
            smoothing += m * f64::from(from.smoothing_length[i]);
            position.iter_mut().zip(from.units[i]).for_each(|(sum, x)| *sum += m * x);
        }
        let h = single(smoothing / mass);
        let density = presence / mass;
        let merged = Merged { mass, density, smoothing_length: h, point: f64::from(h) <= q };
        self.push_merged(from, group, position.map(|x| x / mass), &merged, out);
    }

    /// Stores a merged particle; attributes are averaged with mass.
    pub(super) fn push_merged(&self, from: &View, group: &[u32], unit: [f64; 3], merged: &Merged, out: &mut Block) {
        let columns = &mut out.columns;
        columns.mass.push(single(merged.mass));
        columns.density.push(single(merged.density));
        columns.smoothing_length.push(merged.smoothing_length);
        for ((out, values), rule) in columns.attributes.iter_mut().zip(&from.attributes).zip(self.rules) {
            let members = group.iter().map(|&i| i as usize);
            out.push(single(match rule {
                AttributeMerge::Mean => {
                    members.map(|i| f64::from(from.mass[i]) * f64::from(values[i])).sum::<f64>() / merged.mass
                }
                AttributeMerge::Magnitude => {
                    let flux: f64 = members.map(|i| 10.0_f64.powf(-0.4 * f64::from(values[i]))).sum();
                    -2.5 * flux.log10()
                }
            }));
        }
        let first = group[0] as usize;
        let around = group.iter().map(|&i| from.box_of(i as usize)).reduce(Box3::union).unwrap_or_default();
        self.push_position(from.keys[first], unit, around, merged.point, out);
    }

    /// Stores a position and its packed form, in the cell of `key`: rounding must not move a centroid to the next one.
    #[inline]
    fn push_position(&self, key: u64, unit: [f64; 3], around: Box3, point: bool, out: &mut Block) {
        let bins = f64::from(1_u32 << (u32::from(self.cell.depth) + GRID_BITS));
        // A power of two has an exact reciprocal.
        let step = 1.0 / bins;
        let cell = morton::decode(key >> self.shift);
        let mut bin = [0_u32; 3];
        let mut center = [0.0; 3];
        for axis in 0..3 {
            let first = (self.corner[axis] + cell[axis]) << (GRID_BITS - CELL_BITS);
            bin[axis] = ((unit[axis] * bins) as u32).clamp(first, first + (1 << (GRID_BITS - CELL_BITS)) - 1);
            center[axis] = (f64::from(bin[axis]) + 0.5) * step;
        }
        out.keys.push(key);
        out.units.push(unit);
        out.words.push(pack_grid(bin, point));
        out.boxes.push(around);
        out.delta_squared = out.delta_squared.max(around.reach_squared(center));
    }
}

/// The nearest finite single.
pub(super) fn single(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// Whether a grid word is a point.
pub(super) fn is_point(word: u32) -> bool {
    word & GRID_POINT != 0
}
