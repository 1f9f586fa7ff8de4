//! How heights have changed since an earlier field: at each sample of a later field's chunks, later minus earlier. The earlier height is that of
//! its level whose samples are as close as the chunk's, so that where grids agree levels are subtracted from levels.

use super::paged::PagedSurface;
use super::samples::SampleHeights;
use super::source::{NodeSamples, SurfaceNodes};
use deepfield_heights::hierarchy::chunks::lattice::SIDE_BITS;
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use deepfield_heights::measure::alignment::{ON_SAMPLE, SAME};
use deepfield_heights::measure::{Alignment, height_between};
use deepfield_heights::model::Cell;
use deepfield_heights::store::HeightFile;
use std::sync::Arc;
use std::time::Instant;

/// An earlier field, and where a later one's samples are in it.
pub struct Since {
    earlier: PagedSurface,
    alignment: Alignment,
}

/// A level of the earlier field, with the chunks of it that are in use.
struct Level<'a> {
    nodes: &'a PagedSurface,
    level: u8,
    /// Rows and columns of its samples, and of its chunks.
    samples: [u64; 2],
    chunks: [u32; 2],
    known: Vec<(ChunkKey, Option<Arc<NodeSamples>>)>,
}

impl Since {
    /// An earlier field, of whose decoded chunks so many bytes are kept.
    pub fn new(earlier: Arc<HeightFile>, alignment: Alignment, budget_bytes: u64) -> Since {
        Since { earlier: PagedSurface::new(earlier, budget_bytes), alignment }
    }

    /// What of the earlier field cannot be read.
    pub fn error(&self) -> Option<String> {
        self.earlier.error()
    }

    /// Begins a picture; whether something of the earlier field is asked for again that could not be read.
    pub(super) fn begin(&self) -> bool {
        self.earlier.begin()
    }

    /// Whether something of the earlier field is to be tried again, since this was asked last, before it is told.
    pub(super) fn try_again(&self) -> bool {
        self.earlier.try_again()
    }

    /// When another picture may have what this one lacks of the earlier field.
    pub(super) fn again(&self) -> Option<Instant> {
        self.earlier.again()
    }

    /// What is to be told of the earlier field since the last call.
    pub(super) fn take_messages(&self) -> Vec<String> {
        self.earlier.take_messages()
    }

    /// The level of the earlier field whose samples are at least as close as those of a level of the later one.
    fn level(&self, own: u8) -> u8 {
        // Of full resolution changes are those of T.
        if own == 0 {
            return 0;
        }
        let [down, across] = self.alignment.step.map(f64::abs);
        let level = (down.min(across).log2() + f64::from(own) + SAME).floor();
        level.clamp(0.0, f64::from(self.earlier.lattice().top())) as u8
    }

    /// Where a row (axis 0) or a column of the later field is in a level of the earlier one, counted in its samples.
    fn index(&self, axis: usize, level: u8, number: u64) -> f64 {
        let place = self.alignment.place(axis, number);
        let place = if (place - place.round()).abs() <= SAME { place.round() } else { place };
        let lattice = self.earlier.lattice();
        let last = lattice.samples_of(level.into())[axis] - 2;
        let cell = ((place / (1_u64 << level) as f64).floor().max(0.0) as u64).min(last);
        let [from, to] = [cell, cell + 1].map(|index| lattice.place(axis, level.into(), index) as f64);
        cell as f64 + (place - from) / (to - from)
    }

    /// How much higher the samples of a later field's chunk, whose heights these are, are than the earlier field; NaN where either is not known.
    pub fn changes(&self, lattice: &Lattice, key: ChunkKey, heights: &SampleHeights) -> Vec<f32> {
        let level = self.level(key.level);
        let [rows, columns] = [0, 1].map(|axis| -> Vec<f64> {
            lattice.places(key, axis).into_iter().map(|place| self.index(axis, level, place)).collect()
        });
        let mut earlier = Level::new(&self.earlier, level);
        let mut changes = Vec::with_capacity(heights.len());
        for (line, row) in rows.iter().enumerate() {
            let first = line * columns.len();
            changes.extend(columns.iter().enumerate().map(|(number, column)| {
                let height = heights.at(first + number);
                match height.is_nan() {
                    true => f32::NAN,
                    false => (height - self.alignment.factor * earlier.height(*row, *column)) as f32,
                }
            }));
        }
        changes
    }

    /// How far the earlier field may be from what lies between its heights at the samples of a later field's chunk; infinite where it is not known
    /// in some of the places alone.
    pub fn unseen(&self, lattice: &Lattice, key: ChunkKey) -> f64 {
        let level = self.level(key.level);
        let (own, earlier) = (lattice.rectangle(key), self.earlier.lattice());
        let (mut ranges, mut is_on_samples) = ([[0_u32; 2]; 2], true);
        for axis in 0..2 {
            let ends = own[axis].map(|place| self.index(axis, level, place));
            let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            let last = (earlier.samples_of(level.into())[axis] - 1) as f64;
            if high < -SAME || low > last + SAME {
                return 0.0;
            }
            if low < -SAME || high > last + SAME {
                return f64::INFINITY;
            }
            // Backwards diagonals do not meet.
            let apart = self.alignment.step[axis] * f64::from(key.level).exp2();
            is_on_samples &= ends == ends.map(f64::round) && (apart - f64::from(level).exp2()).abs() <= SAME * apart;
            // The last sample of a chunk is the next one's first.
            let cells = [low.max(0.0).floor() as u64, (high.ceil() as u64).max(1) - 1];
            ranges[axis] = cells.map(|cell| (cell >> SIDE_BITS) as u32);
        }
        let [rows, columns] = ranges;
        let (mut most, mut is_known, mut is_open) = (0.0_f64, false, false);
        for (row, column) in
            (rows[0]..=rows[1]).flat_map(|row| (columns[0]..=columns[1]).map(move |column| (row, column)))
        {
            let Some(facts) = self.earlier.facts(ChunkKey { level, row, column }) else { return f64::INFINITY };
            is_known |= !facts.is_empty();
            is_open |= facts.is_empty() || facts.is_mixed();
            if is_known && is_open {
                return f64::INFINITY;
            }
            most = most.max(facts.delta + if is_on_samples { 0.0 } else { facts.step });
        }
        if is_known { self.alignment.factor * most } else { 0.0 }
    }
}

impl<'a> Level<'a> {
    fn new(nodes: &'a PagedSurface, level: u8) -> Level<'a> {
        let lattice = nodes.lattice();
        let (samples, chunks) = (lattice.samples_of(level.into()), lattice.chunks_of(level.into()));
        Level { nodes, level, samples, chunks, known: Vec::new() }
    }

    /// The samples of a chunk.
    fn chunk(&mut self, row: u32, column: u32) -> Option<&NodeSamples> {
        let key = ChunkKey { level: self.level, row, column };
        let number = match self.known.iter().position(|(known, _)| *known == key) {
            Some(number) => number,
            None => {
                // Rows are passed one after the other.
                self.known.retain(|(known, _)| known.row.abs_diff(row) < 2);
                self.known.push((key, self.nodes.samples(key)));
                self.known.len() - 1
            }
        };
        self.known[number].1.as_deref()
    }

    /// The heights of the cell that begins with a sample.
    fn cell(&mut self, row: u64, column: u64) -> Cell {
        let [down, right] = [row, column].map(|at| (at >> SIDE_BITS) as u32);
        let first = [row, column].map(|at| (at % (1 << SIDE_BITS)) as usize);
        let Some(NodeSamples { columns, heights, .. }) = self.chunk(down, right) else { return Cell([f64::NAN; 4]) };
        let at = first[0] * columns + first[1];
        Cell([at, at + 1, at + columns, at + columns + 1].map(|at| heights.get(at).unwrap_or(f64::NAN)))
    }

    /// The height of a sample.
    fn sample(&mut self, place: [u64; 2]) -> f64 {
        // The last row and column have no chunk that begins with them.
        let chunk = [0, 1].map(|axis| ((place[axis] >> SIDE_BITS) as u32).min(self.chunks[axis] - 1));
        let at = [0, 1].map(|axis| (place[axis] - (u64::from(chunk[axis]) << SIDE_BITS)) as usize);
        let Some(NodeSamples { columns, heights, .. }) = self.chunk(chunk[0], chunk[1]) else { return f64::NAN };
        heights.get(at[0] * columns + at[1]).unwrap_or(f64::NAN)
    }

    /// The height of the surface at a place between samples, or of a sample at its very place; NaN where there is none.
    fn height(&mut self, row: f64, column: f64) -> f64 {
        let size = self.samples;
        let near = [row.round(), column.round()];
        let is_there = (0..2).all(|axis| near[axis] >= 0.0 && near[axis] < size[axis] as f64);
        let away = (row - near[0]).hypot(column - near[1]);
        let sample = near.map(|at| at as u64);
        if is_there && away == 0.0 {
            return self.sample(sample);
        }
        match height_between(size, row, column, |row, column| self.cell(row, column)) {
            Some(height) => height,
            None if is_there && away < ON_SAMPLE => self.sample(sample),
            None => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests;
