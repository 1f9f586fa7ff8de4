//! A globe's field whose first column follows a spacing after its last one: as it is drawn it has the first column once more.
//!
//! Of every level the last column and the first one again are samples next to each other, so that what lies between them, a cell wide, is of
//! full resolution along rows. The chunks that have the last column have it, a cell more than others.

use super::photo::PhotoTiles;
use super::placed::Placed;
use super::samples::{MeanNormal, SampleHeights, SampleNormals};
use super::source::{NodeFacts, NodeSamples, SurfaceNodes};
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use std::sync::Arc;

/// A field with its first column behind the last one.
pub struct Closed<'a> {
    source: &'a dyn SurfaceNodes,
    lattice: Lattice,
}

/// The heights of the last column and of the first, at the rows of a chunk.
struct Sides {
    last: Vec<f64>,
    first: Vec<f64>,
    /// The least and the largest coverage in the first column.
    coverage: [u8; 2],
}

impl<'a> Closed<'a> {
    /// Of a field that is placed with a column more than it has; `None` where it is placed as it is.
    pub fn of(source: &'a dyn SurfaceNodes, placed: &Placed) -> Option<Closed<'a>> {
        let lattice = source.lattice();
        let [rows, columns] = lattice.samples;
        let is_open = placed.around == Some(columns) && placed.samples == [columns + 1, rows];
        is_open.then(|| Closed { source, lattice: lattice.closed() })
    }

    /// The first chunk of the row of one that has the seam.
    fn first(&self, key: ChunkKey) -> Option<ChunkKey> {
        let [_, columns] = self.lattice.chunks_of(key.level.into());
        (key.column + 1 == columns).then_some(ChunkKey { column: 0, ..key })
    }

    fn sides(&self, key: ChunkKey, first: ChunkKey) -> Option<Sides> {
        let (own, first) = (self.source.samples(key)?, self.source.samples(first)?);
        let (mut last_column, mut first_column, mut coverage) = (Vec::new(), Vec::new(), [u8::MAX, 0]);
        for row in 0..own.rows {
            let at = row * first.columns;
            last_column.push(own.heights.get((row + 1) * own.columns - 1)?);
            first_column.push(first.heights.get(at)?);
            let share = first.coverage_at(at);
            coverage = [coverage[0].min(share), coverage[1].max(share)];
        }
        Some(Sides { last: last_column, first: first_column, coverage })
    }
}

impl Sides {
    /// The least and the largest height of the first column.
    fn range(&self) -> [f64; 2] {
        self.first.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], height| {
            // What is not measured is neither.
            [low.min(*height), high.max(*height)]
        })
    }

    /// The largest step from the last column to the first, diagonals included.
    fn step(&self) -> f64 {
        let across = self.first.iter().zip(&self.last);
        let down = self.first.iter().skip(1).zip(&self.last);
        let up = self.first.iter().zip(self.last.iter().skip(1));
        across.chain(down).chain(up).map(|(first, last)| (first - last).abs()).fold(0.0, f64::max)
    }

    /// By how much that step changes from a row to the next at most.
    fn turn(&self) -> f64 {
        let across: Vec<f64> = self.first.iter().zip(&self.last).map(|(first, last)| first - last).collect();
        across.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
    }
}

impl SurfaceNodes for Closed<'_> {
    fn lattice(&self) -> Lattice {
        self.lattice
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        let own = self.source.facts(key)?;
        let Some(first_key) = self.first(key).filter(|_| !own.is_empty()) else { return Some(own) };
        let first = self.source.facts(first_key)?;
        if first.is_empty() {
            return Some(NodeFacts { coverage: [0, own.coverage[1]], ..own });
        }
        let Some(sides) = self.sides(key, first_key) else {
            // Nothing is known of what lies between.
            let (min, max) = (own.min.min(first.min), own.max.max(first.max));
            let delta = if key.level == 0 { 0.0 } else { max - min };
            return Some(NodeFacts { delta, step: max - min, min, max, ..own });
        };
        let [low, high] = sides.range();
        let coverage = [own.coverage[0].min(sides.coverage[0]), own.coverage[1].max(sides.coverage[1])];
        // Between full rows T is next to the first column as far from it as the first chunk's surface is.
        let (min, max) = ((low - first.delta).max(first.min), (high + first.delta).min(first.max));
        let (min, max) = (own.min.min(min), own.max.max(max));
        let delta = match key.level {
            0 => own.delta,
            // Who is open somewhere has edges elsewhere than T.
            _ if coverage != [u8::MAX; 2] => own.delta.max(first.delta).max(max - min),
            // On both sides it is as far from T as they are; on the diagonal of a cell between them the sides' own changes along rows come to
            // at most a quarter of what they differ by.
            _ => own.delta.max(first.delta) + 0.25 * sides.turn(),
        };
        Some(NodeFacts {
            delta,
            step: own.step.max(sides.step()),
            min,
            max,
            coverage,
            deviation: own.deviation.max(first.deviation),
            change: own.change.max(first.change),
        })
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let own = self.source.samples(key)?;
        let Some(first) = self.first(key) else { return Some(own) };
        let first = self.source.samples(first)?;
        let (rows, widths) = (own.rows, [own.columns, first.columns]);
        fn joined<T: Copy>([own, first]: [&[T]; 2], widths: [usize; 2], rows: usize, missing: Option<T>) -> Vec<T> {
            if own.is_empty() && first.is_empty() {
                return Vec::new();
            }
            let mut all = Vec::with_capacity(rows * (widths[0] + 1));
            for row in 0..rows {
                match (own.get(row * widths[0]..(row + 1) * widths[0]), missing) {
                    (Some(own), _) => all.extend_from_slice(own),
                    (None, Some(missing)) => all.extend(std::iter::repeat_n(missing, widths[0])),
                    (None, None) => return Vec::new(),
                }
                all.extend(first.get(row * widths[1]).copied().or(missing));
            }
            all
        }
        let heights = [&own.heights, &first.heights].map(|heights| heights.iter().collect::<Vec<f64>>());
        let normals =
            [&own.normals, &first.normals].map(|normals| normals.iter().map(MeanNormal::new).collect::<Vec<_>>());
        let normals = joined([&normals[0], &normals[1]], widths, rows, None);
        Some(Arc::new(NodeSamples {
            rows,
            columns: own.columns + 1,
            heights: SampleHeights::of(joined([&heights[0], &heights[1]], widths, rows, None)),
            coverage: joined([&own.coverage, &first.coverage], widths, rows, Some(u8::MAX)),
            normals: SampleNormals::Parts(normals),
            ranges: joined([&own.ranges, &first.ranges], widths, rows, None),
            planes: own
                .planes
                .iter()
                .zip(&first.planes)
                .map(|(own, first)| joined([own, first], widths, rows, None))
                .collect(),
            changes: joined([&own.changes, &first.changes], widths, rows, None),
        }))
    }

    fn is_there(&self, key: ChunkKey) -> bool {
        self.source.is_there(key) && self.first(key).is_none_or(|first| self.source.is_there(first))
    }

    fn room(&self) -> u64 {
        self.source.room()
    }

    fn bytes(&self, key: ChunkKey) -> u64 {
        self.source.bytes(key)
    }

    fn photo(&self) -> Option<&dyn PhotoTiles> {
        self.source.photo()
    }
}

#[cfg(test)]
mod tests;
