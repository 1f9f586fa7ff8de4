//! What drawing reads of a field: facts of chunks, which choose them, and their samples.

use super::photo::PhotoTiles;
use super::samples::{SampleHeights, SampleNormals};
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use std::sync::Arc;

/// What a chunk says of itself before its samples are read. Lengths are in the field's unit of heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeFacts {
    /// The largest vertical distance of its surface from T.
    pub delta: f64,
    /// The largest step between neighbouring samples of its level, diagonals included.
    pub step: f64,
    /// The least of T's heights in its rectangle and its own.
    pub min: f64,
    /// The largest of them.
    pub max: f64,
    /// The least and the largest coverage of its samples. `[0, 0]`: nothing is there.
    pub coverage: [u8; 2],
    /// How far what it looks like may differ from what finer levels look like: the largest difference of mean normals, or of colour
    /// planes from 0 to 1.
    pub deviation: f32,
    /// How far changes since an earlier field may be from what lies between those of its samples; infinite where some are not known, 0 where
    /// none are asked for.
    pub change: f64,
}

impl NodeFacts {
    /// Whether there is surface in some of its places only.
    pub fn is_mixed(&self) -> bool {
        self.coverage != [u8::MAX; 2] && !self.is_empty()
    }

    /// Whether nothing was measured here.
    pub fn is_empty(&self) -> bool {
        self.coverage[1] == 0
    }
}

/// The samples of a chunk, row by row, shared borders included.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeSamples {
    /// Rows of samples.
    pub rows: usize,
    /// Samples of a row.
    pub columns: usize,
    /// Heights as in the file; fitted where the sample itself was not measured but stands for some that were; NaN elsewhere.
    pub heights: SampleHeights,
    /// The share of valid area in what a sample stands for, 255 for all of it, at least 1 where there is any measured sample. At full
    /// resolution a measured sample in no triangle has 1. Empty where all have 255.
    pub coverage: Vec<u8>,
    /// Means of unit normals over the valid area in plan (at true height, not renormalised): x and y in the world's directions, z up.
    pub normals: SampleNormals,
    /// The least and the largest height of what a sample stands for. Empty at full resolution.
    pub ranges: Vec<[f32; 2]>,
    /// Means of the colour planes over the valid area, in linear light from 0 to 1.
    pub planes: Vec<Vec<f32>>,
    /// How much higher each sample is than an earlier field was there, in the unit of heights; NaN where that is not known. Empty where nobody
    /// asks for it.
    pub changes: Vec<f32>,
}

impl NodeSamples {
    /// The coverage of a sample.
    #[inline]
    pub fn coverage_at(&self, index: usize) -> u8 {
        self.coverage.get(index).copied().unwrap_or(u8::MAX)
    }

    /// The least and the largest height of what a sample stands for.
    #[inline]
    pub fn range_at(&self, index: usize) -> [f32; 2] {
        self.ranges.get(index).copied().unwrap_or([self.heights.at(index) as f32; 2])
    }
}

/// A field as a quadtree of chunks. Several threads may ask at once.
pub trait SurfaceNodes: Sync {
    /// Where its samples are.
    fn lattice(&self) -> Lattice;

    /// What a chunk says of itself; `None` where it is not known yet.
    fn facts(&self, key: ChunkKey) -> Option<NodeFacts>;

    /// A chunk's samples; `None` where they are not there (yet).
    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>>;

    /// Whether a chunk's samples are there.
    fn is_there(&self, _: ChunkKey) -> bool {
        true
    }

    /// How many bytes of samples there is room for at once.
    fn room(&self) -> u64 {
        u64::MAX
    }

    /// How many of these a chunk takes, about.
    fn bytes(&self, _: ChunkKey) -> u64 {
        0
    }

    /// The photo that lies over it.
    fn photo(&self) -> Option<&dyn PhotoTiles> {
        None
    }
}
