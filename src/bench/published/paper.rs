//! What HE03 measured (tables 1 to 3): VIRGO, 16.8 million particles, on a Pentium 4 with 2.8 GHz and a GeForce FX 5800 Ultra.

use serde::Serialize;

/// A level in pictures of 500 x 500. Times in milliseconds; pairs for `delta_n` 1 and 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PaperLevel {
    /// Points.
    pub points: u64,
    /// Mean projected diameter, pixels.
    pub pixels: f64,
    /// All points, added up by the processor.
    pub software: f64,
    /// All points by vertex programs from arrays.
    pub arrays: [f64; 2],
    /// Adaptive within 2 pixels, down to this level. In the last three levels the two stand the other way round in the text that
    /// we have.
    pub adaptive: [f64; 2],
    /// All points, sorted by quicksort with `delta_n` 1, then blended by the processor.
    pub sorted_exact: f64,
    /// The same in fine and in coarse buckets, with `delta_n` 2.
    pub sorted_buckets: [f64; 2],
    /// Adaptive, sorted in coarse buckets.
    pub sorted_adaptive: [f64; 2],
}

/// Levels 6 to 2.
pub const LEVELS: [PaperLevel; 5] = [
    PaperLevel {
        points: 16_800_000,
        pixels: 0.5,
        software: 847.0,
        arrays: [1389.0, 427.0],
        adaptive: [104.0, 153.0],
        sorted_exact: 6670.0,
        sorted_buckets: [4760.0, 3570.0],
        sorted_adaptive: [252.0, 690.0],
    },
    PaperLevel {
        points: 3_300_000,
        pixels: 0.6,
        software: 433.0,
        arrays: [262.0, 85.0],
        adaptive: [93.0, 79.0],
        sorted_exact: 1320.0,
        sorted_buckets: [1040.0, 752.0],
        sorted_adaptive: [233.0, 356.0],
    },
    PaperLevel {
        points: 671_000,
        pixels: 0.9,
        software: 120.0,
        arrays: [50.0, 17.0],
        adaptive: [17.0, 47.0],
        sorted_exact: 298.0,
        sorted_buckets: [238.0, 182.0],
        sorted_adaptive: [126.0, 78.0],
    },
    PaperLevel {
        points: 123_000,
        pixels: 1.5,
        software: 48.0,
        arrays: [10.0, 3.7],
        adaptive: [3.7, 10.0],
        sorted_exact: 85.0,
        sorted_buckets: [71.0, 61.0],
        sorted_adaptive: [28.0, 16.0],
    },
    PaperLevel {
        points: 24_000,
        pixels: 2.9,
        software: 26.0,
        arrays: [2.7, 1.8],
        adaptive: [1.8, 2.7],
        sorted_exact: 41.0,
        sorted_buckets: [28.0, 29.0],
        sorted_adaptive: [6.1, 3.2],
    },
];

/// A picture of another size, adaptive with `delta_n` 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PaperViewport {
    /// Pixels along an edge.
    pub edge: u32,
    /// Milliseconds.
    pub ms: f64,
    /// Points that were drawn.
    pub points: u64,
}

/// Sizes of the viewport table; 500 is in the table of levels.
pub const VIEWPORTS: [PaperViewport; 4] = [
    PaperViewport { edge: 160, ms: 9.5, points: 56_700 },
    PaperViewport { edge: 400, ms: 75.0, points: 648_000 },
    PaperViewport { edge: 700, ms: 348.0, points: 3_543_418 },
    PaperViewport { edge: 1000, ms: 769.0, points: 8_182_000 },
];

/// Bytes that the structure takes for each particle: 160 MB of points and 32 MB of clusters.
pub const BYTES_PER_PARTICLE: f64 = 11.4;
