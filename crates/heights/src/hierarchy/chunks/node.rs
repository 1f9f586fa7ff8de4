//! What is known of a chunk without its samples.

/// How much of what a chunk's samples stand for is T.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coverage {
    /// Nothing: the chunk has no page.
    #[default]
    None,
    /// Some is, some is not.
    Partial,
    /// All of it.
    Whole,
}

/// A node of the quadtree. Heights are in the height unit of the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChunkNode {
    /// The largest vertical distance between the chunk's surface and T: 0 of leaves. On chunks whose cells are at most 256 samples wide it is
    /// exact, on others an upper bound.
    pub delta: f64,
    /// The paper's `h_max`: the largest step along an edge of the chunk's surface. With the diagonal `b` of one of its cells, and the step in
    /// the same unit, no edge is longer than `d = sqrt(b^2 + step^2)`.
    pub step: f64,
    /// The least height of all samples below it, and of its own; infinite without any.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// Area of T in it, in halves of cells at full resolution.
    pub area: u64,
    /// How much is covered.
    pub coverage: Coverage,
    /// How far, at most, normals of what a sample stands for are from their mean: the root of the mean of the squared distances between unit
    /// normals and the mean, from 0 to 1.
    pub normal_deviation: f32,
    /// The same of colours, in linear light, the largest of all planes.
    pub colour_deviation: f32,
}

impl Default for ChunkNode {
    fn default() -> ChunkNode {
        ChunkNode {
            delta: 0.0,
            step: 0.0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            area: 0,
            coverage: Coverage::None,
            normal_deviation: 0.0,
            colour_deviation: 0.0,
        }
    }
}
