//! The one pass over a field's rows.
//!
//! A band of rows that is as high as a leaf is read while the one before it is worked on. Of a band, leaves are looked at and written; the
//! levels whose cells are no larger than leaves get their rows; distances from T are measured in the band before it, of which all coarse samples
//! are known by then; chunks that are complete are written, finer levels first. Levels above come at the end: they are small.

use super::bands::{self, FieldRows};
use super::coarse_chunk::{self, CoarseChunk};
use super::photo::{self, PhotoPass};
use super::{HeightBuildError, HeightBuildOptions, HeightOrigin, Measured, Seen};
use crate::codec::values::Values;
use crate::hierarchy::chunks::cells::Patch;
use crate::hierarchy::chunks::compact::Compact;
use crate::hierarchy::chunks::deviation::{self, Fine, Range};
use crate::hierarchy::chunks::far::Far;
use crate::hierarchy::chunks::leaf::{self, Leaf};
use crate::hierarchy::chunks::rows::LevelRows;
use crate::hierarchy::chunks::sums::{WideLight, WideSum};
use crate::hierarchy::chunks::{ChunkKey, ChunkNode, Coverage, Lattice};
use crate::import::proportions;
use crate::model::{Facts, HeightGrid};
use crate::store::chunk::{self, Code};
use crate::store::{HeightAbout, HeightFileWriter, Rounded};
use deepfield_data::model::Scale;
use deepfield_data::model::progress::Progress;
use deepfield_data::store::writer::CompletePageFile;
use rayon::prelude::*;
use std::path::Path;

/// A build under way.
struct Pass<'a> {
    grid: &'a HeightGrid,
    values: Values,
    lattice: Lattice,
    slopes: [f64; 2],
    writer: HeightFileWriter,
    rows: FieldRows,
    /// Levels from 1 on whose cells are no larger than leaves.
    levels: Vec<LevelRows>,
    /// Of each of them the row of chunks that is written next.
    next_chunks: Vec<u32>,
    /// Of levels above: the samples that they are made of, and what is known of leaves.
    corners: Vec<Compact>,
    sums: Vec<WideSum>,
    light: Vec<WideLight>,
    ranges: Vec<Range>,
    valid: u64,
    sum: f64,
    total: WideSum,
    photo: Option<PhotoPass<'a>>,
}

/// Builds a file with chunks of any size, of samples that are rounded like this, if they are.
pub(super) fn build(
    source: &dyn Measured,
    origin: &HeightOrigin,
    options: &HeightBuildOptions,
    rounded: Option<Rounded>,
    lattice: Lattice,
    output: &Path,
    progress: &dyn Progress,
) -> Result<HeightAbout, HeightBuildError> {
    let grid = source.grid();
    let values = rounded.map_or(Values::all(grid.sample_type), |rounded| rounded.values);
    let memory = options.memory;
    let plan = bands::plan(grid, &lattice, memory);
    let photo = source.photo_rows();
    let bytes = plan.bytes + photo.as_deref().map_or(0, photo::memory);
    if let Some(memory) = memory.filter(|memory| *memory < bytes) {
        let (needed, allowed) = (bytes.div_ceil(1 << 20), memory >> 20);
        let photo =
            photo.map(|photo| photo.about().size).map(|[rows, columns]| format!(" and a photo of {columns} x {rows}"));
        let photo = photo.unwrap_or_default();
        return Err(HeightBuildError::Memory { path: output.into(), columns: grid.columns, photo, needed, allowed });
    }
    let planes = grid.planes.len();
    let near = lattice.side_bits.min(lattice.levels() - 1);
    let mut pass = Pass {
        grid,
        values,
        lattice,
        slopes: super::slopes(grid),
        writer: HeightFileWriter::create(output, lattice, planes)?,
        rows: FieldRows::default(),
        levels: (1..=near).map(|level| LevelRows::new(lattice, level, planes)).collect(),
        next_chunks: vec![0; near as usize],
        corners: Vec::new(),
        sums: Vec::new(),
        light: Vec::new(),
        ranges: Vec::new(),
        valid: 0,
        sum: 0.0,
        total: WideSum::default(),
        photo: photo.map(|photo| PhotoPass::new(photo, grid)),
    };
    if let Some(photo) = &pass.photo {
        pass.writer.photo(photo.about().clone());
    }
    let bands = lattice.chunks_of(0)[0];
    // A band ends with a row more than its own: the ring around its leaves.
    let end_of = |band: u32| (u64::from(band + 1) * lattice.side() + 2).min(grid.rows);
    progress.begin("building", grid.rows);
    let (rows, mut seen) = bands::read(source, &values, 0, end_of(0), plan.rows)?;
    pass.rows.extend(rows);
    for band in 0..bands {
        let (from, to) = (pass.rows.end(), if band + 1 < bands { end_of(band + 1) } else { pass.rows.end() });
        let (worked, read) = rayon::join(|| pass.band(band), || bands::read(source, &values, from, to, plan.rows));
        worked?;
        let (rows, more) = read?;
        seen = seen.and(&more);
        pass.rows.extend(rows);
        progress.advance((u64::from(band + 1) * lattice.side()).min(grid.rows) - u64::from(band) * lattice.side());
    }
    pass.far()?;
    let (file, about) = pass.finish(origin, rounded, &seen)?;
    let written = if options.is_temporary { file.persist_for_now() } else { file.persist() };
    written?;
    Ok(about)
}

impl Pass<'_> {
    fn code(&self) -> Code<'_> {
        Code { lattice: &self.lattice, values: self.values, slopes: self.slopes }
    }

    fn is_last(&self, band: u32) -> bool {
        band + 1 == self.lattice.chunks_of(0)[0]
    }

    fn keys_of_band(&self, band: u32) -> impl Iterator<Item = ChunkKey> + use<> {
        (0..self.lattice.chunks_of(0)[1]).map(move |column| ChunkKey { level: 0, row: band, column })
    }

    /// Works on a band.
    fn band(&mut self, band: u32) -> Result<(), HeightBuildError> {
        self.leaves(band)?;
        self.make_rows(band);
        if band > 0 {
            self.measure(band - 1);
        }
        if self.is_last(band) {
            self.measure(band);
        }
        self.write_chunks()?;
        self.photo(band)?;
        self.forget(band);
        Ok(())
    }

    /// Looks at the leaves of a band and writes them.
    fn leaves(&mut self, band: u32) -> Result<(), HeightBuildError> {
        let keys: Vec<ChunkKey> = self.keys_of_band(band).collect();
        for some in keys.chunks(4 * rayon::current_num_threads().max(1)) {
            let looked: Vec<(Leaf, Vec<u8>)> = some.par_iter().map(|key| self.leaf(*key)).collect();
            for (key, (leaf, bytes)) in some.iter().zip(looked) {
                self.take_leaf(*key, leaf, &bytes)?;
            }
        }
        Ok(())
    }

    fn leaf(&self, key: ChunkKey) -> (Leaf, Vec<u8>) {
        let part = self.lattice.part(key);
        let held = self.lattice.ringed(part);
        let stored = self.rows.stored(&held);
        let planes: Vec<Vec<u8>> = (0..self.grid.planes.len()).map(|plane| self.rows.plane(plane, &part)).collect();
        let [rows, columns] = self.lattice.samples;
        let owns = [part.row + part.rows as u64 == rows, part.column + part.columns as u64 == columns];
        let patch = Patch {
            stored: &stored,
            width: held.columns,
            margin: [(part.row - held.row) as usize, (part.column - held.column) as usize],
            size: [part.rows, part.columns],
            planes: &planes,
        };
        let looked = leaf::leaf(&patch, self.slopes, owns, self.levels.len() as u32);
        let is_empty = looked.low > looked.high && planes.iter().flatten().all(|value| *value == 0);
        let bytes = match is_empty {
            true => Vec::new(),
            false => chunk::encode_leaf(&self.values, &stored, held.columns, &planes, part.columns),
        };
        (looked, bytes)
    }

    fn take_leaf(&mut self, key: ChunkKey, leaf: Leaf, bytes: &[u8]) -> Result<(), HeightBuildError> {
        if !bytes.is_empty() {
            self.writer.chunk(key, bytes)?;
        }
        let [min, max] = scaled(self.grid.scale, leaf.low, leaf.high);
        let step = leaf.step * self.grid.scale.slope.abs();
        if let Some(node) = self.writer.node(key) {
            let coverage = match (leaf.low <= leaf.high, leaf.is_whole) {
                (false, _) => Coverage::None,
                (true, true) => Coverage::Whole,
                (true, false) => Coverage::Partial,
            };
            *node = ChunkNode { min, max, step, area: leaf.total.area, coverage, ..*node };
        }
        let part = self.lattice.part(key);
        for (number, (rows, sums)) in self.levels.iter_mut().zip(&leaf.levels).enumerate() {
            rows.add([part.row, part.column].map(|first| first >> (number + 1)), sums);
        }
        self.valid += leaf.valid;
        self.sum += leaf.sum;
        self.total.add(&leaf.total);
        if self.lattice.levels() > self.lattice.side_bits + 1 {
            self.sums.push(leaf.total);
            self.light.extend(leaf.light);
        }
        Ok(())
    }

    /// Makes the rows of all near levels that a band completes: those before its last one, which the next band has a part in.
    fn make_rows(&mut self, band: u32) {
        let last = self.is_last(band);
        for number in 0..self.levels.len() {
            let level = number as u32 + 1;
            let end = match last {
                true => self.lattice.samples_of(level)[0],
                false => (u64::from(band + 1) << self.lattice.side_bits) >> level,
            };
            let (below, own) = self.levels.split_at_mut(number);
            let (rows, below) = (&self.rows, below.last());
            let height = |row: u64| match below {
                None => rows.get(row).map(|row| &row.stored),
                Some(below) => below.get(row).map(|row| &row.stored),
            };
            let start = own[0].made();
            own[0].make(end, self.values, height);
            if level == self.lattice.side_bits && self.lattice.levels() > level + 1 {
                self.corners.extend((start..end).filter_map(|row| own[0].get(row)).map(|row| row.stored.clone()));
            }
        }
    }

    /// Measures how far all near levels are from T in a band.
    fn measure(&mut self, band: u32) {
        let keys: Vec<ChunkKey> = self.keys_of_band(band).collect();
        let all: Vec<Vec<Range>> = keys.par_iter().map(|key| self.ranges(*key)).collect();
        let slope = self.grid.scale.slope.abs();
        for (key, ranges) in keys.iter().zip(all) {
            for (number, range) in ranges.iter().enumerate() {
                let level = number as u8 + 1;
                let above = ChunkKey { level, row: key.row >> level, column: key.column >> level };
                if let Some(node) = self.writer.node(above) {
                    node.delta = node.delta.max(range.most() * slope);
                }
            }
            if self.lattice.levels() > self.lattice.side_bits + 1 {
                self.ranges.push(ranges.last().copied().unwrap_or(Range::NONE));
            }
        }
    }

    fn ranges(&self, key: ChunkKey) -> Vec<Range> {
        let part = self.lattice.part(key);
        let stored = self.rows.stored(&part);
        let fine = Fine { stored: &stored, size: [part.rows, part.columns] };
        let range = |(number, rows): (usize, &LevelRows)| {
            let level = number as u32 + 1;
            let [count, columns] = fine.size.map(|count| (count - 1).div_ceil(1 << level) + 1);
            let mut coarse = vec![f64::NAN; count * columns];
            for (number, out) in coarse.chunks_exact_mut(columns).enumerate() {
                if let Some(row) = rows.get((part.row >> level) + number as u64) {
                    row.stored.copy((part.column >> level) as usize, out);
                }
            }
            deviation::range(fine, level, &coarse)
        };
        self.levels.iter().enumerate().map(range).collect()
    }

    /// Writes the chunks of near levels that are complete.
    fn write_chunks(&mut self) -> Result<(), HeightBuildError> {
        for number in 0..self.levels.len() {
            let level = number as u8 + 1;
            let [chunk_rows, chunk_columns] = self.lattice.chunks_of(level.into());
            while self.next_chunks[number] < chunk_rows {
                let key = |column| ChunkKey { level, row: self.next_chunks[number], column };
                let part = self.lattice.part(key(0));
                if part.row + part.rows as u64 > self.levels[number].made() {
                    break;
                }
                let keys: Vec<ChunkKey> = (0..chunk_columns).map(key).collect();
                self.next_chunks[number] += 1;
                for some in keys.chunks(4 * rayon::current_num_threads().max(1)) {
                    let (rows, planes, code) = (&self.levels[number], self.grid.planes.len(), self.code());
                    let make = |key: &ChunkKey| coarse_chunk::make(&code, planes, *key, |row| rows.get(row));
                    let made: Vec<CoarseChunk> = some.par_iter().map(make).collect();
                    for (key, chunk) in some.iter().zip(made) {
                        self.take_chunk(*key, &chunk)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn take_chunk(&mut self, key: ChunkKey, chunk: &CoarseChunk) -> Result<(), HeightBuildError> {
        if let Some(bytes) = &chunk.bytes {
            self.writer.chunk(key, bytes)?;
        }
        let [mut min, mut max] = scaled(self.grid.scale, chunk.low, chunk.high);
        let mut area = 0;
        for child in self.lattice.children(key) {
            if let Some(child) = self.writer.node(child) {
                (min, max, area) = (min.min(child.min), max.max(child.max), area + child.area);
            }
        }
        let step = chunk.step * self.grid.scale.slope.abs();
        let [normal_deviation, colour_deviation] = chunk.deviation.map(|deviation| f32::from(deviation) / 255.0);
        if let Some(node) = self.writer.node(key) {
            *node = ChunkNode {
                min,
                max,
                step,
                area,
                coverage: chunk.coverage,
                normal_deviation,
                colour_deviation,
                ..*node
            };
        }
        Ok(())
    }

    /// Goes on with the photo.
    fn photo(&mut self, band: u32) -> Result<(), HeightBuildError> {
        let [start, end] = [band, band + 1].map(|band| u64::from(band) << self.lattice.side_bits);
        let (cells, is_last) = (start..end.min(self.grid.rows - 1), self.is_last(band));
        match &mut self.photo {
            Some(photo) => photo.cells(&self.rows, cells, is_last, &mut self.writer),
            None => Ok(()),
        }
    }

    /// Forgets what nothing needs any more after a band.
    fn forget(&mut self, band: u32) {
        let band_row = u64::from(band) << self.lattice.side_bits;
        self.rows.forget(band_row.saturating_sub(1));
        for number in 0..self.levels.len() {
            let level = number as u32 + 1;
            let above = self.levels.get(number + 1).map_or(u64::MAX, |above| (2 * above.made()).saturating_sub(1));
            let chunks = u64::from(self.next_chunks[number]) << self.lattice.side_bits;
            self.levels[number].forget((band_row >> level).min(above).min(chunks));
        }
    }

    /// Makes and writes the levels above the near ones.
    fn far(&mut self) -> Result<(), HeightBuildError> {
        let (first, levels, planes) = (self.lattice.side_bits + 1, self.lattice.levels(), self.grid.planes.len());
        if first >= levels {
            return Ok(());
        }
        let sums = (std::mem::take(&mut self.sums), std::mem::take(&mut self.light));
        let (corners, ranges) = (std::mem::take(&mut self.corners), std::mem::take(&mut self.ranges));
        let mut far = Far::new(self.lattice, self.values, corners, sums, planes, ranges);
        for level in first..levels {
            let rows = far.next_level();
            let columns = self.lattice.samples_of(level)[1] as usize - 1;
            let [chunk_rows, chunk_columns] = self.lattice.chunks_of(level);
            for (row, column) in (0..chunk_rows).flat_map(|row| (0..chunk_columns).map(move |column| (row, column))) {
                let key = ChunkKey { level: level as u8, row, column };
                let part = self.lattice.part(key);
                let made = coarse_chunk::make(&self.code(), planes, key, |row| rows.get(row as usize));
                self.take_chunk(key, &made)?;
                let mut range = Range::NONE;
                for row in part.row as usize..part.row as usize + part.rows - 1 {
                    let first = row * columns + part.column as usize;
                    far.ranges()[first..first + part.columns - 1].iter().for_each(|own| range.join(*own));
                }
                if let Some(node) = self.writer.node(key) {
                    node.delta = range.most() * self.grid.scale.slope.abs();
                }
            }
        }
        Ok(())
    }

    fn finish(
        mut self,
        origin: &HeightOrigin,
        rounded: Option<Rounded>,
        seen: &Seen,
    ) -> Result<(CompletePageFile, HeightAbout), HeightBuildError> {
        let samples = self.grid.samples();
        if self.valid == 0 {
            return Err(HeightBuildError::Nothing { path: origin.path.clone(), invalid: samples, samples });
        }
        if let Some(Rounded { error, .. }) = rounded.filter(|_| origin.rounded.is_none()) {
            // A level field may be off by what it likes: it stays level.
            let range = (seen.range.high - seen.range.low) * self.grid.scale.slope.abs();
            if error > range && range > 0.0 {
                let expected = format!("at most the range of heights, {range}");
                let (path, found) = (origin.path.clone(), error.to_string());
                return Err(HeightBuildError::Rounding { path, found, expected });
            }
        }
        let root = self.lattice.root();
        let (min, max) = self.leaves_range();
        let facts = Facts {
            valid: self.valid,
            lone: self.total.lone,
            min,
            max,
            mean: self.grid.scale.value(self.sum / self.valid as f64),
        };
        debug_assert!(self.writer.node(root).is_some_and(|node| node.min <= min && node.max >= max));
        let found = [seen.suspects.note(self.grid), proportions::note(self.grid, [min, max])];
        // A page file that this is built from has told it.
        let found = found.into_iter().flatten().filter(|note| !origin.notes.contains(note));
        let notes = origin.notes.iter().cloned().chain(found).collect();
        let about = HeightAbout {
            source: origin.path.clone(),
            format: origin.format.clone(),
            source_bytes: origin.bytes,
            has_spacing: origin.has_spacing,
            notes,
            grid: self.grid.clone(),
            facts,
            invalid: seen.invalid,
            area: self.total.area,
            slopes: self.slopes,
            levels: Vec::new(),
            rounded,
            photo: None,
        };
        Ok(self.writer.complete(about)?)
    }

    /// The least and the largest height of all leaves.
    fn leaves_range(&mut self) -> (f64, f64) {
        let [rows, columns] = self.lattice.chunks_of(0);
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            if let Some(node) = self.writer.node(ChunkKey { level: 0, row, column }) {
                range = (range.0.min(node.min), range.1.max(node.max));
            }
        }
        range
    }
}

/// The heights of the least and the largest stored value, in order; infinite where there is none.
fn scaled(scale: Scale, low: f64, high: f64) -> [f64; 2] {
    if low > high {
        return [f64::INFINITY, f64::NEG_INFINITY];
    }
    let [one, other] = [scale.value(low), scale.value(high)];
    [one.min(other), one.max(other)]
}
