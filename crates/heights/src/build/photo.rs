//! The pyramid of a photo, while the field's rows go by: rows of pixels as soon as it is known how much of them lies on T, means of them, and tiles
//! of all levels, finer ones first.

use super::HeightBuildError;
use super::bands::FieldRows;
use crate::hierarchy::photo::means::{self, LightSum, Texel};
use crate::hierarchy::photo::shares::{RowShares, Shares};
use crate::hierarchy::photo::{PhotoLattice, TILE, TileKey};
use crate::model::{HeightGrid, PhotoAbout, PhotoRows};
use crate::store::{HeightFileWriter, tile};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Rows of pixels that are worked on at a time.
const BLOCK: usize = 32;

/// A photo under way.
pub(super) struct PhotoPass<'a> {
    photo: Box<dyn PhotoRows + 'a>,
    lattice: PhotoLattice,
    shares: Shares,
    /// Shares of the rows from `next` on.
    block: Vec<RowShares>,
    next: u64,
    levels: Vec<LevelTexels>,
}

/// Texels of a level that tiles still need.
#[derive(Debug, Default)]
struct LevelTexels {
    first: u64,
    rows: VecDeque<Vec<Texel>>,
    /// The row of tiles that is written next.
    next_tiles: u32,
    /// Sums of a row that has no other one to be joined with yet.
    single: Option<Vec<LightSum>>,
}

/// Memory that the work on a photo takes, bytes.
pub(super) fn memory(photo: &dyn PhotoRows) -> u64 {
    let [_, columns] = photo.about().size;
    // Of each level rows of texels for tiles, and sums of those that are worked on; all coarser levels together are as wide as the finest one.
    let texels = 2 * (TILE + BLOCK as u64) * size_of::<Texel>() as u64;
    let sums = BLOCK as u64 * size_of::<LightSum>() as u64;
    // Tiles that are worked on by each thread: of each texel words of three planes and what is left of them.
    let tiles = rayon::current_num_threads() as u64 * TILE * TILE * 64;
    columns * (texels + sums + BLOCK as u64 * 4) + tiles + photo.memory_bytes()
}

impl<'a> PhotoPass<'a> {
    /// Of a photo over a field.
    pub(super) fn new(photo: Box<dyn PhotoRows + 'a>, grid: &HeightGrid) -> PhotoPass<'a> {
        let lattice = PhotoLattice::new(photo.about().size);
        let levels = (0..lattice.levels()).map(|_| LevelTexels::default()).collect();
        let shares = Shares::new(photo.about(), grid);
        PhotoPass { lattice, shares, block: Vec::new(), next: 0, levels, photo }
    }

    /// What is known of it.
    pub(super) fn about(&self) -> &PhotoAbout {
        self.photo.about()
    }

    /// Goes on with the rows of cells from one up to another; the last rows of pixels come with the field's last row of cells.
    pub(super) fn cells(
        &mut self,
        rows: &FieldRows,
        cells: std::ops::Range<u64>,
        is_last: bool,
        writer: &mut HeightFileWriter,
    ) -> Result<(), HeightBuildError> {
        let mut samples = [Vec::new(), Vec::new()];
        let mut are_whole = [false; 2];
        let read = |row: u64, out: &mut Vec<f64>| {
            if let Some(row) = rows.get(row) {
                out.resize(row.stored.len(), 0.0);
                row.stored.copy(0, out);
            }
            out.iter().fold(true, |is_whole, value| is_whole & !value.is_nan())
        };
        are_whole[1] = read(cells.start, &mut samples[1]);
        for row in cells.clone() {
            samples.swap(0, 1);
            are_whole = [are_whole[1], read(row + 1, &mut samples[1])];
            let halves = (are_whole != [true; 2]).then(|| halves(&samples[0], &samples[1]));
            self.shares.add(row, halves.as_deref());
            let is_end = is_last && row + 1 == cells.end;
            while let Some(shares) = self.shares.next(row + 1, is_end) {
                self.block.push(shares);
                if self.block.len() == BLOCK {
                    self.work(writer)?;
                }
            }
        }
        if is_last { self.work(writer) } else { Ok(()) }
    }

    /// Works on the rows whose shares are known.
    fn work(&mut self, writer: &mut HeightFileWriter) -> Result<(), HeightBuildError> {
        let (first, shares) = (self.next, std::mem::take(&mut self.block));
        if shares.is_empty() {
            return Ok(());
        }
        let [rows, columns] = self.lattice.size().map(|count| count as usize);
        let planes = self.about().planes();
        self.next += shares.len() as u64;
        let is_last = self.next == rows as u64;
        let mut values = vec![0; shares.len() * columns * planes];
        self.photo.rows(first, shares.len() as u64, &mut values)?;
        let texels: Vec<Vec<Texel>> = values
            .par_chunks_exact(columns * planes)
            .map(|row| row.chunks_exact(planes).map(texel).collect())
            .collect();
        drop(values);
        if self.levels.len() > 1 {
            // Blocks have an even number of rows, but for the last one.
            let sums = texels.par_chunks(2).zip(shares.par_chunks(2)).map(|(rows, shares)| {
                let sums = |(row, shares): (&Vec<Texel>, &RowShares)| -> Vec<LightSum> { of_row(row, shares) };
                let mut sums = rows.iter().zip(shares).map(sums);
                means::joined(&sums.next().unwrap_or_default(), sums.next().as_deref())
            });
            let sums = sums.collect();
            self.levels[0].rows.extend(texels);
            self.coarser(sums, is_last);
        } else {
            self.levels[0].rows.extend(texels);
        }
        self.write(writer)
    }

    /// Makes the rows of coarser levels of the next sums of level 1.
    fn coarser(&mut self, mut sums: Vec<Vec<LightSum>>, is_last: bool) {
        for level in 1..self.levels.len() {
            let own = &mut self.levels[level];
            let (lattice, start) = (self.lattice, own.first + own.rows.len() as u64);
            let texels =
                |(row, sums): (usize, &Vec<LightSum>)| means::texels(&lattice, level as u32, start + row as u64, sums);
            let made: Vec<Vec<Texel>> = sums.par_iter().enumerate().map(texels).collect();
            own.rows.extend(made);
            if let Some(single) = own.single.take() {
                sums.insert(0, single);
            }
            if sums.len() % 2 == 1 && !is_last {
                own.single = sums.pop();
            }
            sums = sums.par_chunks(2).map(|pair| means::joined(&pair[0], pair.get(1).map(Vec::as_slice))).collect();
        }
    }

    /// Writes the rows of tiles that are complete, and forgets rows that nothing needs any more.
    fn write(&mut self, writer: &mut HeightFileWriter) -> Result<(), HeightBuildError> {
        let (lattice, planes) = (self.lattice, self.photo.about().planes());
        for (level, own) in self.levels.iter_mut().enumerate() {
            let [tile_rows, tile_columns] = lattice.tiles_of(level as u32);
            while own.next_tiles < tile_rows {
                let key = |column: u32| TileKey { level: level as u8, row: own.next_tiles, column };
                let part = lattice.part(key(0));
                if part.row + part.rows as u64 > own.first + own.rows.len() as u64 {
                    break;
                }
                let keys: Vec<TileKey> = (0..tile_columns).map(key).collect();
                for some in keys.chunks(4 * rayon::current_num_threads().max(1)) {
                    let coded: Vec<Vec<u8>> = some.par_iter().map(|key| own.tile(&lattice, *key, planes)).collect();
                    for (key, bytes) in some.iter().zip(coded) {
                        writer.tile(*key, &bytes)?;
                    }
                }
                own.next_tiles += 1;
                own.forget(u64::from(own.next_tiles) * TILE);
            }
        }
        Ok(())
    }
}

impl LevelTexels {
    fn tile(&self, lattice: &PhotoLattice, key: TileKey, planes: usize) -> Vec<u8> {
        let part = lattice.part(key);
        let mut texels = Vec::with_capacity(part.len());
        for row in part.row..part.row + part.rows as u64 {
            if let Some(row) = self.rows.get((row - self.first) as usize) {
                texels.extend_from_slice(&row[part.column as usize..][..part.columns]);
            }
        }
        tile::encode(&texels, part.columns, planes)
    }

    fn forget(&mut self, row: u64) {
        while self.first < row && self.rows.pop_front().is_some() {
            self.first += 1;
        }
    }
}

/// Halves of cells between two rows of samples that are T.
fn halves(upper: &[f64], lower: &[f64]) -> Vec<u8> {
    let half = |(upper, lower): (&[f64], &[f64])| {
        let measured = upper.iter().chain(lower).filter(|height| !height.is_nan()).count();
        measured.saturating_sub(2) as u8
    };
    upper.windows(2).zip(lower.windows(2)).map(half).collect()
}

/// A pixel as a texel of the finest level, which looks as it is, whatever lies below it.
fn texel(values: &[u8]) -> Texel {
    match *values {
        [red, green, blue] => [red, green, blue, u8::MAX],
        _ => [values[0], values[0], values[0], u8::MAX],
    }
}

/// Sums of each pixel of a row.
fn of_row(row: &[Texel], shares: &RowShares) -> Vec<LightSum> {
    let sum = |(column, texel): (usize, &Texel)| {
        let share = shares.as_ref().map_or(u8::MAX, |shares| shares[column]);
        LightSum::of([texel[0], texel[1], texel[2], share], 1)
    };
    row.iter().enumerate().map(sum).collect()
}

#[cfg(test)]
mod tests;
