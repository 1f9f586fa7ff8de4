//! A page file as the ray caster reads it: ranges of blocks as large as chunks are those of the file's nodes; finer ones are made from leaves,
//! the ones used last of which are kept.

use super::course::Spread;
use super::on_globe::pick_on_globe;
use super::pick::{Pick, pick};
use super::pyramid::{Level, NOTHING, Pyramid, coarser, top_of};
use super::ray::{MinMax, Ray, Rise};
use crate::hierarchy::chunks::{ChunkKey, Lattice};
use crate::model::{Cell, HeightError, HeightGrid, Heights};
use crate::store::{Chunk, HeightFile};
use deepfield_data::codec::morton;
use deepfield_data::import::ImportError;
use deepfield_data::model::Scale;
use rayon::prelude::*;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The finest level of which ranges are made. A ray often looks at one leaf only, once: finer ones would cost more than they spare.
const FINEST: u32 = 3;

/// So many leaves of usual size are kept for all readers of a file: 40 MiB.
const KEPT: usize = 64;

/// A reader holds so many of them besides, which it finds without asking others.
const HELD: usize = 4;

/// Samples of a leaf of usual size, with those around it.
const USUAL: u64 = 259 * 259;

/// The heights of a leaf.
struct Leaf {
    /// The first row and column.
    first: [u64; 2],
    /// Samples of a row; 0 where nothing was measured.
    columns: usize,
    heights: Vec<f64>,
    /// Ranges of blocks from the finest level to that of which one block holds all cells.
    levels: Vec<Level>,
}

impl Leaf {
    fn nothing() -> Leaf {
        Leaf {
            first: [0; 2],
            columns: 0,
            heights: Vec::new(),
            levels: vec![Level { columns: 1, ranges: vec![NOTHING] }],
        }
    }

    fn new(chunk: Chunk, scale: Scale, finest: u32) -> Leaf {
        let Chunk { part, held, stored: mut heights, .. } = chunk;
        heights.iter_mut().for_each(|height| *height = scale.value(*height));
        let first = (part.row - held.row) as usize * held.columns + (part.column - held.column) as usize;
        let cells = [part.rows - 1, part.columns - 1];
        let mut levels = vec![finest_level(&heights[first..], held.columns, cells, 1 << finest)];
        while let Some(level) = levels.last().filter(|level| level.ranges.len() > 1) {
            levels.push(coarser(level));
        }
        Leaf { first: [held.row, held.column], columns: held.columns, heights, levels }
    }

    /// The range of all of it.
    fn all(&self) -> [f64; 2] {
        self.levels.last().and_then(|level| level.ranges.first()).copied().unwrap_or(NOTHING)
    }

    /// The range of a block so many levels above the finest.
    fn range(&self, above: u32, row: usize, column: usize) -> [f64; 2] {
        // Of a small leaf one block holds all before the level of leaves.
        let level = self.levels.get(above as usize);
        level.map_or_else(
            || self.all(),
            |level| level.ranges.get(row * level.columns + column).copied().unwrap_or(NOTHING),
        )
    }

    fn cell(&self, row: u64, column: u64) -> Cell {
        let [row, column] = [row.saturating_sub(self.first[0]) as usize, column.saturating_sub(self.first[1]) as usize];
        let first = row * self.columns + column;
        Cell(
            [first, first + 1, first + self.columns, first + self.columns + 1]
                .map(|at| self.heights.get(at).copied().unwrap_or(f64::NAN)),
        )
    }
}

/// Ranges of blocks of so many cells a side; `heights` begin with the first cell's first sample.
fn finest_level(heights: &[f64], width: usize, [rows, columns]: [usize; 2], size: usize) -> Level {
    let across = columns.div_ceil(size);
    let mut ranges = Vec::with_capacity(across * rows.div_ceil(size));
    let (mut lows, mut highs) = (vec![0.0; columns + 1], vec![0.0; columns + 1]);
    for row in (0..rows).step_by(size) {
        let own = size.min(rows - row);
        lows.fill(f64::INFINITY);
        highs.fill(f64::NEG_INFINITY);
        let mut is_whole = true;
        for samples in heights[row * width..].chunks(width).take(own + 1) {
            for ((low, high), height) in lows.iter_mut().zip(&mut highs).zip(samples) {
                *low = if *height < *low { *height } else { *low };
                *high = if *height > *high { *height } else { *high };
            }
            is_whole = samples[..=columns].iter().fold(is_whole, |is_whole, height| is_whole & !height.is_nan());
        }
        for column in (0..columns).step_by(size) {
            let (end, first) = ((column + size).min(columns), row * width + column);
            ranges.push(match is_whole {
                true => lows[column..=end].iter().zip(&highs[column..=end]).fold(NOTHING, joined),
                false => range_of_cells(&heights[first..], width, [own, end - column]),
            });
        }
    }
    Level { columns: across, ranges }
}

fn joined([low, high]: [f64; 2], (least, largest): (&f64, &f64)) -> [f64; 2] {
    [low.min(*least), high.max(*largest)]
}

/// The range of heights of triangles in rows and columns of cells, where some samples may be in none.
fn range_of_cells(heights: &[f64], width: usize, [rows, columns]: [usize; 2]) -> [f64; 2] {
    let mut range = NOTHING;
    for row in 0..rows {
        for first in row * width..row * width + columns {
            let cell = Cell([first, first + 1, first + width, first + width + 1].map(|at| heights[at]));
            if cell.measured() >= 3 {
                range = cell.0.iter().fold(range, |range, height| joined(range, (height, height)));
            }
        }
    }
    range
}

/// What all readers of a file share.
#[derive(Default)]
struct Shared {
    /// The leaf used last comes first.
    leaves: Mutex<Vec<(ChunkKey, Arc<Leaf>)>>,
    /// The least and the largest height of T, once they were asked for; `None` of them without any triangle.
    heights: Mutex<Option<Option<[f64; 2]>>>,
}

/// Nothing is left half done where a holder ends early.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A page file of any size for rays. It reads the leaves that rays come to, and keeps some of them: 40 MiB for all its clones, and 2.5 MiB for
/// each. A clone is cheap, and is what another thread casts rays through.
pub struct PagedPyramid<'a> {
    file: &'a HeightFile,
    top: u32,
    finest: u32,
    kept: usize,
    shared: Arc<Shared>,
    /// The leaf used last comes first.
    held: Vec<(ChunkKey, Arc<Leaf>)>,
    heights: Option<Option<[f64; 2]>>,
}

impl Clone for PagedPyramid<'_> {
    fn clone(&self) -> Self {
        PagedPyramid { shared: Arc::clone(&self.shared), held: Vec::new(), ..*self }
    }
}

impl<'a> PagedPyramid<'a> {
    /// Of an open file. Nothing is read yet.
    pub fn new(file: &'a HeightFile) -> PagedPyramid<'a> {
        let lattice = file.lattice();
        let top = top_of(lattice.samples.map(|samples| samples - 1));
        let finest = FINEST.min(top).min(lattice.side_bits);
        let kept = (KEPT as u64 * USUAL / (lattice.side() + 3).pow(2)).clamp(1, KEPT as u64) as usize;
        PagedPyramid { file, top, finest, kept, shared: Arc::default(), held: Vec::new(), heights: None }
    }

    /// The least and the largest height of T's samples; `None` without any triangle. Where some samples are in no triangle, the leaves with the
    /// least and the largest samples are read, once, until no other leaf can go beyond.
    ///
    /// # Errors
    /// Where a page is damaged.
    pub fn heights(&mut self) -> Result<Option<[f64; 2]>, HeightError> {
        if let Some(heights) = self.heights {
            return Ok(heights);
        }
        let shared = Arc::clone(&self.shared);
        let mut known = locked(&shared.heights);
        let heights = match *known {
            Some(heights) => heights,
            None => self.find_heights()?,
        };
        (*known, self.heights) = (Some(heights), Some(heights));
        Ok(heights)
    }

    fn find_heights(&mut self) -> Result<Option<[f64; 2]>, HeightError> {
        let (file, lattice) = (self.file, self.file.lattice());
        let facts = file.about().facts;
        if file.node(lattice.root()).is_none_or(|root| root.area == 0) {
            return Ok(None);
        }
        if facts.lone == 0 {
            return Ok(Some([facts.min, facts.max]));
        }
        let leaves = lattice.keys().take_while(|key| key.level == 0);
        let mut leaves: Vec<(ChunkKey, f64, f64)> = leaves
            .filter_map(|key| file.node(key).filter(|node| node.area > 0).map(|node| (key, node.min, node.max)))
            .collect();
        let [mut low, mut high] = NOTHING;
        leaves.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (key, least, _) in &leaves {
            if *least >= low {
                break;
            }
            let all = self.leaf(*key)?.all();
            (low, high) = (low.min(all[0]), high.max(all[1]));
        }
        leaves.sort_by(|a, b| b.2.total_cmp(&a.2));
        for (key, _, largest) in &leaves {
            if *largest <= high {
                break;
            }
            high = high.max(self.leaf(*key)?.all()[1]);
        }
        Ok((low <= high).then_some([low, high]))
    }

    /// A leaf, from what is held, else from what is kept, else from the file.
    fn leaf(&mut self, key: ChunkKey) -> Result<&Leaf, HeightError> {
        match self.held.iter().position(|(held, _)| *held == key) {
            Some(0) => {}
            Some(number) => self.held[..=number].rotate_right(1),
            None => {
                let leaf = self.read(key)?;
                self.held.truncate(HELD.min(self.kept) - 1);
                self.held.insert(0, (key, leaf));
            }
        }
        Ok(&self.held[0].1)
    }

    fn read(&self, key: ChunkKey) -> Result<Arc<Leaf>, HeightError> {
        if let Some(leaf) = kept(&mut locked(&self.shared.leaves), key) {
            return Ok(leaf);
        }
        // Others may read meanwhile, now and then the same leaf.
        let scale = self.file.about().grid.scale;
        let chunk = self.file.chunk(key)?;
        let leaf = Arc::new(chunk.map_or_else(Leaf::nothing, |chunk| Leaf::new(chunk, scale, self.finest)));
        let mut leaves = locked(&self.shared.leaves);
        if let Some(leaf) = kept(&mut leaves, key) {
            return Ok(leaf);
        }
        leaves.truncate(self.kept - 1);
        leaves.insert(0, (key, Arc::clone(&leaf)));
        Ok(leaf)
    }

    fn leaf_key(&self, row: u64, column: u64) -> ChunkKey {
        // No leaf has a number that does not fit.
        let [row, column] = [row, column].map(|number| u32::try_from(number).unwrap_or(u32::MAX));
        ChunkKey { level: 0, row, column }
    }
}

/// A leaf that is kept; it becomes the one used last.
fn kept(leaves: &mut [(ChunkKey, Arc<Leaf>)], key: ChunkKey) -> Option<Arc<Leaf>> {
    let number = leaves.iter().position(|(kept, _)| *kept == key)?;
    leaves[..=number].rotate_right(1);
    Some(Arc::clone(&leaves[0].1))
}

impl MinMax for PagedPyramid<'_> {
    type Error = HeightError;

    fn grid(&self) -> &HeightGrid {
        &self.file.about().grid
    }

    fn top(&self) -> u32 {
        self.top
    }

    fn finest(&self) -> u32 {
        self.finest
    }

    /// Of all cells it is exact; of blocks of one leaf and more, samples in no triangle count as well.
    fn range(&mut self, level: u32, row: u64, column: u64) -> Result<Option<[f64; 2]>, HeightError> {
        if level == self.top {
            return self.heights();
        }
        let side_bits = self.file.lattice().side_bits;
        let Some(below) = side_bits.checked_sub(level).filter(|below| *below > 0) else {
            let key = ChunkKey { level: (level - side_bits) as u8, ..self.leaf_key(row, column) };
            return Ok(self.file.node(key).filter(|node| node.area > 0).map(|node| [node.min, node.max]));
        };
        let (finest, mask) = (self.finest, (1 << below) - 1);
        let leaf = self.leaf(self.leaf_key(row >> below, column >> below))?;
        let [low, high] = leaf.range(level.saturating_sub(finest), (row & mask) as usize, (column & mask) as usize);
        Ok((low <= high).then_some([low, high]))
    }

    fn cell(&mut self, row: u64, column: u64) -> Result<Cell, HeightError> {
        let side_bits = self.file.lattice().side_bits;
        Ok(self.leaf(self.leaf_key(row >> side_bits, column >> side_bits))?.cell(row, column))
    }
}

/// A source is read for picks where that takes no more memory: bytes.
const MOST: u64 = 2 << 30;

/// Picks that one task makes, one after the other.
const TOGETHER: usize = 64;

/// How a field stands in the world that rays are of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stands {
    /// On a plane, with x and y as the file has them.
    Flat(Rise),
    /// On a globe about the world's origin.
    Globe(Spread),
}

/// What rays find, one for each, in their order; several are followed at a time. A source is read into memory; a page file (`pages`, of which
/// `heights` are not asked then) is read where rays go. `path` is what messages call the field.
///
/// # Errors
/// Where the field cannot be read: of the first ray that comes to such a place. Where it is no page file and would take more than 2 GiB of memory.
pub fn pick_all(
    path: &Path,
    heights: &dyn Heights,
    pages: Option<&HeightFile>,
    stands: &Stands,
    rays: &[Ray],
) -> Result<Vec<Pick>, HeightError> {
    if let Some(file) = pages {
        let mut field = PagedPyramid::new(file);
        // Here, where none waits for another.
        let range = field.heights()?;
        let order = match stands {
            Stands::Flat(rise) => by_leaf(file.lattice(), field.grid(), *rise, range, rays),
            Stands::Globe(_) => (0..rays.len()).collect(),
        };
        return picks(|| field.clone(), stands, rays, &order);
    }
    let (grid, bytes) = (heights.grid(), Pyramid::memory(heights.grid()));
    if bytes > MOST {
        let found = format!("{}, which take {} MiB of memory", grid.described(), bytes >> 20);
        let expected = format!("at most {} MiB, or a page file: build one", MOST >> 20);
        return Err(ImportError::malformed(path, "samples", found, expected).into());
    }
    let field = Pyramid::read(heights)?;
    let order: Vec<usize> = (0..rays.len()).collect();
    picks(|| &field, stands, rays, &order).map_err(|error| match error {})
}

/// Follows rays in an order, and gives what they find in their own.
fn picks<M: MinMax>(
    open: impl Fn() -> M + Send + Sync,
    stands: &Stands,
    rays: &[Ray],
    order: &[usize],
) -> Result<Vec<Pick>, M::Error> {
    let some = |field: &mut M, some: &[usize]| -> Vec<(usize, Result<Pick, M::Error>)> {
        let mut one = |number: usize| match stands {
            Stands::Flat(rise) => pick(field, *rise, &rays[number]),
            Stands::Globe(spread) => pick_on_globe(field, spread, &rays[number]),
        };
        some.iter().copied().map(|number| (number, one(number))).collect()
    };
    let mut found: Vec<(usize, Result<Pick, M::Error>)> =
        order.par_chunks(TOGETHER).map_init(open, |field, numbers| some(field, numbers)).flatten_iter().collect();
    found.sort_unstable_by_key(|(number, _)| *number);
    found.into_iter().map(|(_, pick)| pick).collect()
}

/// Numbers of rays, such that those follow one another that pass the field's middle height near one another.
fn by_leaf(lattice: &Lattice, grid: &HeightGrid, rise: Rise, range: Option<[f64; 2]>, rays: &[Ray]) -> Vec<usize> {
    let middle = range.map_or(0.0, |[low, high]| rise.world(0.5 * (low + high)));
    let key = |ray: &Ray| {
        let t = Some((middle - ray.origin[2]) / ray.direction[2]).filter(|t| t.is_finite()).unwrap_or(0.0).max(0.0);
        let [x, y, _] = ray.at(t);
        // What is no number is 0, and the conversion saturates.
        let [row, column] = grid.row_column([x, y]).map(|place| place as u64);
        let leaf = |axis: usize, place: u64| (place.min(lattice.samples[axis] - 1) >> lattice.side_bits) as u32;
        morton::encode([leaf(1, column), leaf(0, row), 0])
    };
    let keys: Vec<u64> = rays.par_iter().map(key).collect();
    let mut order: Vec<usize> = (0..rays.len()).collect();
    order.par_sort_by_key(|number| keys[*number]);
    order
}
