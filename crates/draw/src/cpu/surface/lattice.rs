//! The quadtree over a field's samples: nested levels, and chunks of 256 x 256 of their cells.
//!
//! Level `k` takes every `2^k`-th sample of a row and of a column, and the last one. So the samples of a level are among those of the finer
//! ones, the diagonals of whole cells are unions of finer ones, and every level reaches the field's rim; only its last cells are shorter.

/// Cells along a chunk's side.
pub const CHUNK: u64 = 256;

/// A chunk of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeKey {
    /// Its level: 0 is full resolution.
    pub level: u8,
    /// Which chunk of a column of chunks.
    pub row: u32,
    /// Which chunk of a row of chunks.
    pub column: u32,
}

impl NodeKey {
    /// The four chunks of the next finer level that lie where it does; some may be beyond the rim.
    pub fn children(self) -> [NodeKey; 4] {
        [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| NodeKey {
            level: self.level.saturating_sub(1),
            row: 2 * self.row + row,
            column: 2 * self.column + column,
        })
    }

    /// The chunk of a coarser level that it lies in.
    pub fn ancestor(self, level: u8) -> NodeKey {
        let up = level.saturating_sub(self.level);
        NodeKey { level: self.level.max(level), row: self.row >> up, column: self.column >> up }
    }
}

/// The samples of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Rows and columns of samples, each at least 2.
    pub samples: [u64; 2],
}

impl Lattice {
    /// Cells of a level along columns (from row to row) and along rows.
    pub fn cells(&self, level: u8) -> [u64; 2] {
        self.samples.map(|samples| (samples - 1).div_ceil(1 << level))
    }

    /// Where sample number `index` of a level is along an axis (0: rows), counted in samples of full resolution.
    pub fn position(&self, axis: usize, level: u8, index: u64) -> u64 {
        (index << level).min(self.samples[axis] - 1)
    }

    /// The level that is one chunk.
    pub fn top(&self) -> u8 {
        (0..64).find(|level| self.cells(*level).iter().all(|cells| *cells <= CHUNK)).unwrap_or(63)
    }

    /// The chunk that the whole field is.
    pub fn root(&self) -> NodeKey {
        NodeKey { level: self.top(), row: 0, column: 0 }
    }

    /// Whether there is such a chunk.
    pub fn has(&self, key: NodeKey) -> bool {
        // Of levels that there are not nothing can be told.
        key.level <= self.top() && {
            let [rows, columns] = self.cells(key.level);
            u64::from(key.row) * CHUNK < rows && u64::from(key.column) * CHUNK < columns
        }
    }

    /// The first sample of a chunk in its level along an axis, and the number of samples there, shared ones included.
    pub fn span(&self, key: NodeKey, axis: usize) -> (u64, usize) {
        let first = u64::from([key.row, key.column][axis]) * CHUNK;
        let cells = self.cells(key.level)[axis].saturating_sub(first).min(CHUNK);
        (first, cells as usize + 1)
    }

    /// Where a chunk's samples are along an axis, counted in samples of full resolution.
    pub fn positions(&self, key: NodeKey, axis: usize) -> Vec<u64> {
        let (first, count) = self.span(key, axis);
        (first..first + count as u64).map(|index| self.position(axis, key.level, index)).collect()
    }

    /// The first and the last row, and the first and the last column of a chunk, counted in samples of full resolution.
    pub fn rectangle(&self, key: NodeKey) -> [[u64; 2]; 2] {
        [0, 1].map(|axis| {
            let (first, count) = self.span(key, axis);
            [first, first + count as u64 - 1].map(|index| self.position(axis, key.level, index))
        })
    }
}
