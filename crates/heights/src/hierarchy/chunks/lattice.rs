//! Where the samples of a level are, and how they are cut into chunks.

/// A chunk of the quadtree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChunkKey {
    /// 0 is full resolution.
    pub level: u8,
    /// Its row among the level's chunks.
    pub row: u32,
    /// Its column.
    pub column: u32,
}

impl ChunkKey {
    /// The four chunks of the next finer level that lie where it does, row by row; some may be beyond the rim. Of a leaf its like.
    pub fn quarters(self) -> [ChunkKey; 4] {
        [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| ChunkKey {
            level: self.level.saturating_sub(1),
            row: 2 * self.row + row,
            column: 2 * self.column + column,
        })
    }

    /// The chunk of a coarser level that it lies in; itself where the level is none.
    pub fn ancestor(self, level: u8) -> ChunkKey {
        let up = level.saturating_sub(self.level);
        ChunkKey { level: self.level.max(level), row: self.row >> up, column: self.column >> up }
    }
}

/// The samples of a chunk among those of its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// The first row, in samples of the level.
    pub row: u64,
    /// The first column.
    pub column: u64,
    /// How many rows; at least 2.
    pub rows: usize,
    /// How many columns; at least 2.
    pub columns: usize,
}

impl Part {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.rows * self.columns
    }

    /// Never: a chunk has at least 2 x 2.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The levels of a field. Pairs are rows, then columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Samples at full resolution; at least 2 each.
    pub samples: [u64; 2],
    /// A chunk has `2^side_bits` cells a side.
    pub side_bits: u32,
    /// Whether the last of the columns is the first one again. It is a sample of every level then, and the chunks that have the column before it
    /// have it as well, a cell more: so chunks are those of the field without it.
    pub is_closed: bool,
}

/// Cells of a chunk's side are 2 to this.
pub const SIDE_BITS: u32 = 8;

impl Lattice {
    /// Of a field, with chunks of 256 x 256 cells.
    pub fn new(rows: u64, columns: u64) -> Lattice {
        Lattice { samples: [rows, columns], side_bits: SIDE_BITS, is_closed: false }
    }

    /// The same with the first column behind the last one again.
    #[must_use]
    pub fn closed(self) -> Lattice {
        Lattice { samples: [self.samples[0], self.samples[1] + 1], is_closed: true, ..self }
    }

    /// Cells along an axis that are there more than chunks are made of.
    #[inline]
    fn more(&self, axis: usize) -> u64 {
        u64::from(self.is_closed && axis == 1)
    }

    /// Cells of a level along an axis that chunks are made of.
    #[inline]
    fn cells_of(&self, axis: usize, level: u32) -> u64 {
        (self.samples[axis] - self.more(axis) - 1).div_ceil(1 << level)
    }

    /// Cells of a chunk's side.
    pub fn side(&self) -> u64 {
        1 << self.side_bits
    }

    /// Samples of a level: every `2^level`-th, and the last.
    pub fn samples_of(&self, level: u32) -> [u64; 2] {
        [0, 1].map(|axis| self.cells_of(axis, level) + self.more(axis) + 1)
    }

    /// Chunks of a level.
    pub fn chunks_of(&self, level: u32) -> [u32; 2] {
        [0, 1].map(|axis| self.cells_of(axis, level).div_ceil(self.side()) as u32)
    }

    /// Number of levels: the last one has one chunk.
    pub fn levels(&self) -> u32 {
        (0..64 - self.side_bits).find(|level| self.chunks_of(*level) == [1, 1]).unwrap_or(63 - self.side_bits) + 1
    }

    /// The root.
    pub fn root(&self) -> ChunkKey {
        ChunkKey { level: self.top(), row: 0, column: 0 }
    }

    /// The coarsest level, which is one chunk.
    pub fn top(&self) -> u8 {
        (self.levels() - 1) as u8
    }

    /// The row (`axis` 0) or column (1) at full resolution of a level's sample.
    #[inline]
    pub fn place(&self, axis: usize, level: u32, index: u64) -> u64 {
        match index > self.cells_of(axis, level) {
            true => self.samples[axis] - 1,
            false => (index << level).min(self.samples[axis] - self.more(axis) - 1),
        }
    }

    /// The number of the cell of a level that a place at full resolution is in; places beyond the rim count as in what is next to them.
    #[inline]
    pub fn cell_at(&self, axis: usize, level: u32, place: f64) -> u64 {
        let cells = self.cells_of(axis, level);
        match self.more(axis) > 0 && place >= (self.samples[axis] - 2) as f64 {
            true => cells,
            false => ((place.max(0.0) / (1_u64 << level) as f64) as u64).min(cells - 1),
        }
    }

    /// The number in a level of the sample at a place at full resolution; `None` where the level has none there.
    pub fn sample_at(&self, axis: usize, level: u32, place: u64) -> Option<u64> {
        let last = self.samples[axis] - self.more(axis) - 1;
        match place > last {
            true => Some(self.cells_of(axis, level) + 1),
            false => (place == last || place.is_multiple_of(1 << level)).then(|| place.div_ceil(1 << level)),
        }
    }

    /// The index of a level's sample in the level below it.
    pub fn below(&self, axis: usize, level: u32, index: u64) -> u64 {
        let last = (self.samples[axis] - 1).div_ceil(1 << (level - 1));
        (2 * index).min(last)
    }

    /// What a sample stands for along an axis, for levels from 1 on: cells from the first up to the second. These parts of a level are the
    /// whole field, without overlap; those of the last sample may be empty, and then what the sample before it stands for is said of it, too.
    pub fn stands_for(&self, axis: usize, level: u32, index: u64) -> [u64; 2] {
        let (half, cells) = (1 << (level - 1), self.samples[axis] - 1);
        [((index << level).saturating_sub(half)).min(cells), ((index << level) + half).min(cells)]
    }

    /// Cells of T that a sample stands for.
    pub fn cells(&self, level: u32, [row, column]: [u64; 2]) -> u64 {
        let [rows, columns] = [(0, row), (1, column)]
            .map(|(axis, index)| self.stands_for(axis, level, index))
            .map(|[first, end]| end - first);
        rows * columns
    }

    /// The samples of a chunk.
    pub fn part(&self, key: ChunkKey) -> Part {
        let ((row, rows), (column, columns)) = (self.span(key, 0), self.span(key, 1));
        Part { row, column, rows, columns }
    }

    /// The first sample of a chunk in its level along an axis (0: rows), and the number of samples there.
    pub fn span(&self, key: ChunkKey, axis: usize) -> (u64, usize) {
        let first = u64::from([key.row, key.column][axis]) << self.side_bits;
        let left = self.cells_of(axis, key.level.into()).saturating_sub(first);
        let more = if left <= self.side() { self.more(axis) } else { 0 };
        (first, (left.min(self.side()) + more) as usize + 1)
    }

    /// Where a chunk's samples are along an axis at full resolution.
    pub fn places(&self, key: ChunkKey, axis: usize) -> Vec<u64> {
        let (first, count) = self.span(key, axis);
        (first..first + count as u64).map(|index| self.place(axis, key.level.into(), index)).collect()
    }

    /// A chunk's first and last row, and its first and last column, at full resolution.
    pub fn rectangle(&self, key: ChunkKey) -> [[u64; 2]; 2] {
        [0, 1].map(|axis| {
            let (first, count) = self.span(key, axis);
            [first, first + count as u64 - 1].map(|index| self.place(axis, key.level.into(), index))
        })
    }

    /// The samples of a leaf, with those around it: a ring of one where the field has them.
    pub fn ringed(&self, part: Part) -> Part {
        let [rows, columns] = self.samples;
        let (row, column) = (part.row.saturating_sub(1), part.column.saturating_sub(1));
        let end = |first: u64, count: usize, all: u64| (first + count as u64 + 1).min(all);
        Part {
            row,
            column,
            rows: (end(part.row, part.rows, rows) - row) as usize,
            columns: (end(part.column, part.columns, columns) - column) as usize,
        }
    }

    /// Whether there is such a chunk.
    pub fn has(&self, key: ChunkKey) -> bool {
        // Of levels that there are not nothing can be told.
        u32::from(key.level) < self.levels() && {
            let [rows, columns] = self.chunks_of(key.level.into());
            key.row < rows && key.column < columns
        }
    }

    /// A chunk's children, in order of rows and columns; none of leaves.
    pub fn children(&self, key: ChunkKey) -> impl Iterator<Item = ChunkKey> + use<> {
        let lattice = *self;
        key.quarters().into_iter().filter(move |child| key.level > 0 && lattice.has(*child))
    }

    /// A chunk's parent; none of the root.
    pub fn parent(&self, key: ChunkKey) -> Option<ChunkKey> {
        let parent = ChunkKey { level: key.level + 1, row: key.row / 2, column: key.column / 2 };
        self.has(parent).then_some(parent)
    }

    /// All chunks, level by level from the finest, row by row.
    pub fn keys(&self) -> impl Iterator<Item = ChunkKey> + use<> {
        let lattice = *self;
        (0..lattice.levels()).flat_map(move |level| {
            let [rows, columns] = lattice.chunks_of(level);
            (0..rows).flat_map(move |row| (0..columns).map(move |column| ChunkKey { level: level as u8, row, column }))
        })
    }

    /// Number of chunks of all levels.
    pub fn chunks(&self) -> u64 {
        (0..self.levels())
            .map(|level| self.chunks_of(level))
            .map(|[rows, columns]| u64::from(rows) * u64::from(columns))
            .sum()
    }

    /// A chunk's number in [`Lattice::keys`].
    pub fn number(&self, key: ChunkKey) -> usize {
        let before: usize = (0..u32::from(key.level))
            .map(|level| self.chunks_of(level))
            .map(|[rows, columns]| rows as usize * columns as usize)
            .sum();
        let [_, columns] = self.chunks_of(key.level.into());
        before + key.row as usize * columns as usize + key.column as usize
    }
}

#[cfg(test)]
mod tests;
