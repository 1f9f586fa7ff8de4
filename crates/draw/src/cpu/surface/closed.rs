//! A globe's field whose first column follows a spacing after its last one: as it is drawn it has the first column once more.

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

impl<'a> Closed<'a> {
    /// Of a field that is placed with a column more than it has; `None` where it is placed as it is.
    pub fn of(source: &'a dyn SurfaceNodes, placed: &Placed) -> Option<Closed<'a>> {
        let mut lattice = source.lattice();
        let [rows, columns] = lattice.samples;
        if placed.around != Some(columns) || placed.samples != [columns + 1, rows] {
            return None;
        }
        lattice.samples[1] += 1;
        Some(Closed { source, lattice })
    }

    /// The first chunk of the row of one that has the seam.
    fn first(&self, key: ChunkKey) -> Option<ChunkKey> {
        let [_, columns] = self.lattice.chunks_of(key.level.into());
        (key.column + 1 == columns).then_some(ChunkKey { column: 0, ..key })
    }
}

impl SurfaceNodes for Closed<'_> {
    fn lattice(&self) -> Lattice {
        self.lattice
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        let own = self.source.facts(key)?;
        let Some(first) = self.first(key) else { return Some(own) };
        let first = self.source.facts(first)?;
        let (one, other) = match (own.is_empty(), first.is_empty()) {
            (true, true) => return Some(own),
            (true, false) => (first, first),
            (false, true) => (own, own),
            (false, false) => (own, first),
        };
        let (min, max) = (one.min.min(other.min), one.max.max(other.max));
        Some(NodeFacts {
            // Between the last sample that a coarse level has and the first column T may be anywhere between the heights of both.
            delta: if key.level == 0 { one.delta } else { max - min },
            step: max - min,
            min,
            max,
            coverage: [own.coverage[0].min(first.coverage[0]), own.coverage[1].max(first.coverage[1])],
            deviation: one.deviation.max(other.deviation),
        })
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let own = self.source.samples(key)?;
        let Some(first) = self.first(key) else { return Some(own) };
        let first = self.source.samples(first)?;
        let (_, columns) = self.lattice.span(key, 1);
        // A coarse level has the first column in the place of the last one, unless that is a sample of its own.
        let kept = own.columns.min(columns - 1);
        let (rows, own_width, first_width) = (own.rows, own.columns, first.columns);
        fn joined<T: Copy>(
            [own, first]: [&[T]; 2],
            [own_width, first_width, kept]: [usize; 3],
            rows: usize,
            missing: Option<T>,
        ) -> Vec<T> {
            if own.is_empty() && first.is_empty() {
                return Vec::new();
            }
            let mut all = Vec::with_capacity(rows * (kept + 1));
            for row in 0..rows {
                let own = own.get(row * own_width..row * own_width + kept);
                match (own, missing) {
                    (Some(own), _) => all.extend_from_slice(own),
                    (None, Some(missing)) => all.extend(std::iter::repeat_n(missing, kept)),
                    (None, None) => return Vec::new(),
                }
                all.extend(first.get(row * first_width).copied().or(missing));
            }
            all
        }
        let widths = [own_width, first_width, kept];
        let heights = [&own.heights, &first.heights].map(|heights| heights.iter().collect::<Vec<f64>>());
        let heights = joined([&heights[0], &heights[1]], widths, rows, None);
        let normals =
            [&own.normals, &first.normals].map(|normals| normals.iter().map(MeanNormal::new).collect::<Vec<_>>());
        let normals = joined([&normals[0], &normals[1]], widths, rows, None);
        Some(Arc::new(NodeSamples {
            rows,
            columns,
            heights: SampleHeights::of(&heights),
            coverage: joined([&own.coverage, &first.coverage], widths, rows, Some(u8::MAX)),
            normals: SampleNormals::Parts(normals),
            ranges: joined([&own.ranges, &first.ranges], widths, rows, None),
            planes: own
                .planes
                .iter()
                .zip(&first.planes)
                .map(|(own, first)| joined([own, first], widths, rows, None))
                .collect(),
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
