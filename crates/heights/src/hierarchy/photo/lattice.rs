//! Levels and tiles of a photo. A texel of level k stands for `2^k` x `2^k` pixels, as far as there are such.

use crate::hierarchy::chunks::{ChunkKey, Lattice, Part};

/// Texels along a tile's side.
pub const TILE: u64 = 256;

/// A tile of a level, by its row and column among them.
pub type TileKey = ChunkKey;

/// The levels of a photo. The last one is the first that is a single tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotoLattice {
    size: [u64; 2],
    /// Texels lie between the samples of a lattice as cells do, and so tiles are numbered as chunks are.
    tiles: Lattice,
}

impl PhotoLattice {
    /// Of rows and columns of pixels, at least 1 of each.
    pub fn new(size: [u64; 2]) -> PhotoLattice {
        PhotoLattice {
            size,
            tiles: Lattice { samples: size.map(|count| count + 1), side_bits: TILE.ilog2(), is_closed: false },
        }
    }

    /// Rows and columns of pixels.
    pub fn size(&self) -> [u64; 2] {
        self.size
    }

    /// Rows and columns of a level's texels.
    pub fn size_of(&self, level: u32) -> [u64; 2] {
        self.size.map(|count| count.div_ceil(1 << level))
    }

    /// Number of levels.
    pub fn levels(&self) -> u32 {
        self.tiles.levels()
    }

    /// Rows and columns of a level's tiles.
    pub fn tiles_of(&self, level: u32) -> [u32; 2] {
        self.tiles.chunks_of(level)
    }

    /// Number of tiles of all levels.
    pub fn tiles(&self) -> u64 {
        self.tiles.chunks()
    }

    /// All tiles, level by level from the finest, row by row.
    pub fn keys(&self) -> impl Iterator<Item = TileKey> + use<> {
        self.tiles.keys()
    }

    /// A tile's number among them.
    pub fn number(&self, key: TileKey) -> usize {
        self.tiles.number(key)
    }

    /// Whether there is such a tile.
    pub fn has(&self, key: TileKey) -> bool {
        self.tiles.has(key)
    }

    /// The tiles of the next finer level that lie where a tile does.
    pub fn children(&self, key: TileKey) -> impl Iterator<Item = TileKey> + use<> {
        self.tiles.children(key)
    }

    /// The pixels that a texel of a level stands for along an axis (0: rows), from the first up to the second.
    pub fn pixels(&self, axis: usize, level: u32, index: u64) -> [u64; 2] {
        [index << level, ((index + 1) << level).min(self.size[axis])]
    }

    /// How many pixels a texel of a level, by its row and column, stands for.
    pub fn pixels_of(&self, level: u32, [row, column]: [u64; 2]) -> u64 {
        let count = |axis: usize, index: u64| {
            let [first, end] = self.pixels(axis, level, index);
            end.saturating_sub(first)
        };
        count(0, row) * count(1, column)
    }

    /// A tile's texels.
    pub fn part(&self, key: TileKey) -> Part {
        let axis = |axis: usize, number: u32| {
            let (first, count) = (u64::from(number) * TILE, self.size_of(key.level.into())[axis]);
            (first, count.saturating_sub(first).min(TILE) as usize)
        };
        let ((row, rows), (column, columns)) = (axis(0, key.row), axis(1, key.column));
        Part { row, column, rows, columns }
    }
}
