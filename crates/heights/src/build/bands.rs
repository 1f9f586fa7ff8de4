//! The rows of a field that are in memory at a time.

use super::{HeightBuildError, Measured, Seen};
use crate::codec::values::Values;
use crate::hierarchy::chunks::Part;
use crate::hierarchy::chunks::compact::{Compact, is_single};
use crate::hierarchy::chunks::deviation::Range;
use crate::hierarchy::chunks::lattice::Lattice;
use crate::model::{HeightGrid, Window};
use rayon::prelude::*;
use std::collections::VecDeque;

/// A row at full resolution.
#[derive(Debug)]
pub(super) struct FieldRow {
    pub(super) stored: Compact,
    pub(super) planes: Vec<Vec<u8>>,
}

/// Rows that follow one another.
#[derive(Debug, Default)]
pub(super) struct FieldRows {
    first: u64,
    rows: VecDeque<FieldRow>,
}

/// How much memory a build takes, and how many rows are read at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    pub(super) bytes: u64,
    pub(super) rows: u64,
}

/// What a build of rows so long takes; fewer rows are read at once where it may take less.
pub(super) fn plan(grid: &HeightGrid, lattice: &Lattice, memory: Option<u64>) -> Plan {
    let (columns, side) = (grid.columns, lattice.side() + 2);
    let (size, planes) = (if is_single(grid.sample_type) { 4 } else { 8 }, grid.planes.len() as u64);
    // Two bands that are worked on, and one that is read; of other levels as much as a band and a half; a third of a band of sums.
    let bands = 3 * side * (size + planes);
    let levels = side * 3 / 2 * (size + 6 + planes);
    let sums = side / 3 * (20 + 16 * planes);
    // Leaves that are worked on by each thread, and the program.
    let fixed = (rayon::current_num_threads() as u64) * (16 + 8 * planes) * (side * side * 4) + (24 << 20);
    let bytes = columns * (bands + levels + sums) + fixed + lattice.chunks() * 64;
    let row = columns * (8 + planes);
    let wanted = (32_u64 << 20).min(memory.map_or(u64::MAX, |memory| memory / 16));
    let rows = (wanted / row.max(1)).clamp(1, lattice.side());
    // A power of two: sources in tiles have these in whole.
    let rows = 1 << rows.ilog2();
    Plan { bytes: bytes + rows * row, rows }
}

impl FieldRows {
    /// The first row that is not there.
    pub(super) fn end(&self) -> u64 {
        self.first + self.rows.len() as u64
    }

    /// A row.
    pub(super) fn get(&self, row: u64) -> Option<&FieldRow> {
        self.rows.get(usize::try_from(row.checked_sub(self.first)?).ok()?)
    }

    /// Adds rows.
    pub(super) fn extend(&mut self, rows: Vec<FieldRow>) {
        self.rows.extend(rows);
    }

    /// Forgets rows before this one.
    pub(super) fn forget(&mut self, row: u64) {
        while self.first < row && self.rows.pop_front().is_some() {
            self.first += 1;
        }
    }

    /// Samples of a part, as they are stored.
    pub(super) fn stored(&self, part: &Part) -> Vec<f64> {
        let mut out = vec![f64::NAN; part.len()];
        for (number, out) in out.chunks_exact_mut(part.columns).enumerate() {
            if let Some(row) = self.get(part.row + number as u64) {
                row.stored.copy(part.column as usize, out);
            }
        }
        out
    }

    /// Values of a plane.
    pub(super) fn plane(&self, plane: usize, part: &Part) -> Vec<u8> {
        let mut out = Vec::with_capacity(part.len());
        for row in (0..part.rows).filter_map(|row| self.get(part.row + row as u64)) {
            out.extend_from_slice(&row.planes[plane][part.column as usize..][..part.columns]);
        }
        out.resize(part.len(), 0);
        out
    }
}

/// Reads rows from `first` up to `end`, some at a time, and rounds their samples to values. What is no finite number was not measured.
pub(super) fn read(
    source: &dyn Measured,
    values: &Values,
    first: u64,
    end: u64,
    at_once: u64,
) -> Result<(Vec<FieldRow>, Seen), HeightBuildError> {
    let grid = source.grid();
    let width = grid.columns as usize;
    let mut out = Vec::with_capacity((end - first) as usize);
    let (mut stored, mut plane, mut seen) = (Vec::new(), Vec::new(), Seen::none());
    let mut row = first;
    while row < end {
        // Reads end at multiples of what is read at once, so that tiles are read once.
        let rows = (at_once - row % at_once).min(end - row);
        let window = Window::rows(grid, row, rows);
        stored.resize(rows as usize * width, 0.0);
        seen = seen.and(&source.measured(window, &mut stored)?);
        let at = out.len();
        let compact: Vec<(FieldRow, Range)> = stored
            .par_chunks_exact_mut(width)
            .map(|row| {
                row.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = f64::NAN);
                let mut range = Range::NONE;
                if values.step().is_some() {
                    row.iter().for_each(|value| range.add(*value));
                    values.round(row);
                }
                (FieldRow { stored: Compact::new(grid.sample_type, row), planes: Vec::new() }, range)
            })
            .collect();
        out.extend(compact.into_iter().map(|(row, range)| {
            seen.range.join(range);
            row
        }));
        for number in 0..grid.planes.len() {
            plane.resize(rows as usize * width, 0);
            source.plane(number, window, &mut plane)?;
            out[at..]
                .iter_mut()
                .zip(plane.chunks_exact(width))
                .for_each(|(row, values)| row.planes.push(values.to_vec()));
        }
        row += rows;
    }
    Ok((out, seen))
}
