//! Between which values the samples below each node lie.
//!
//! What a transfer function shows of a node is known from that alone: where it shows all values of the range alike, one point does
//! (WM03 section 4.5), as long as what is drawn stays within the range.

use super::cut::{Cut, Drawn};
use super::grid::{Shape, children, for_each_place, index};
use super::tree::Hierarchy;
use rayon::prelude::*;

/// Smallest and largest sample of one channel below each node, level by level, the finest first; `[inf, -inf]` where none is a number.
/// What counts as air does not count.
#[derive(Clone, Debug, Default)]
pub struct Ranges(Vec<Vec<[f32; 2]>>);

impl Ranges {
    /// Those of a channel's samples.
    pub fn new(hierarchy: &Hierarchy, channel: &[f32]) -> Ranges {
        let mut levels: Vec<Vec<[f32; 2]>> = Vec::new();
        let mut finer = hierarchy.shape;
        let holes = &hierarchy.planes.holes;
        for level in &hierarchy.levels {
            let below = levels.last();
            levels.push(for_each_place(level.shape, |at| {
                children(hierarchy.dimensions, finer, at).fold([f32::INFINITY, f32::NEG_INFINITY], |range, child| {
                    let [low, high] = match below {
                        Some(below) => below[child],
                        None if holes.get(child) == Some(&true) => [f32::NAN; 2],
                        None => [channel[child]; 2],
                    };
                    // Comparisons with NaN leave the range as it is.
                    [if low < range[0] { low } else { range[0] }, if high > range[1] { high } else { range[1] }]
                })
            }));
            finer = level.shape;
        }
        Ranges(levels)
    }

    /// The range of a node of a level (0: the finest).
    pub fn of(&self, level: usize, node: usize) -> [f32; 2] {
        self.0[level][node]
    }

    /// Brings values that a cut shows of the channel back into the range of the node that is drawn there as its large point, of those nodes
    /// that `is_held` names by level and index.
    pub fn hold(
        &self,
        hierarchy: &Hierarchy,
        cut: &Cut,
        values: &mut [f32],
        is_held: impl Fn(usize, usize) -> bool + Sync,
    ) {
        let (shape, holes) = (hierarchy.shape, &hierarchy.planes.holes);
        let row_of = |place: usize, level: usize, axis: usize| {
            if axis < hierarchy.dimensions { place >> (level + 1) } else { 0 }
        };
        values.par_chunks_mut(shape[0].max(1)).enumerate().for_each(|(row, values)| {
            for (level, nodes) in hierarchy.levels.iter().enumerate() {
                let at =
                    |x: usize| -> Shape { [x, row_of(row % shape[1], level, 1), row_of(row / shape[1], level, 2)] };
                let first = index(nodes.shape, at(0));
                for (x, values) in values.chunks_mut(2 << level).enumerate() {
                    let node = first + x;
                    let [low, high] = self.0[level][node];
                    if low <= high && cut.drawn[level][node] == Drawn::Large && is_held(level, node) {
                        let first = row * shape[0] + (x << (level + 1));
                        let shown = values.iter_mut().enumerate().filter(|(i, _)| holes.get(first + i) != Some(&true));
                        shown.for_each(|(_, value)| *value = value.clamp(low, high));
                    }
                }
            }
        });
    }
}
