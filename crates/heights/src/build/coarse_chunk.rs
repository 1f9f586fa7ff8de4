//! A chunk of a level above full resolution, from the level's rows.

use crate::hierarchy::chunks::coarse::Row;
use crate::hierarchy::chunks::leaf::largest_step;
use crate::hierarchy::chunks::{ChunkKey, Coverage};
use crate::store::chunk::{self, Code};

/// A chunk's bytes, and what its samples say, as they are stored.
#[derive(Debug)]
pub(super) struct CoarseChunk {
    /// Nothing where nothing is covered.
    pub(super) bytes: Option<Vec<u8>>,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) step: f64,
    pub(super) coverage: Coverage,
    pub(super) deviation: [u8; 2],
}

/// Makes a chunk. `row` gives the level's rows.
pub(super) fn make<'a>(
    code: &Code<'_>,
    planes: usize,
    key: ChunkKey,
    row: impl Fn(u64) -> Option<&'a Row>,
) -> CoarseChunk {
    let part = code.lattice.part(key);
    let columns = part.column as usize..part.column as usize + part.columns;
    let mut stored = vec![f64::NAN; part.len()];
    let (mut coverage, mut normals) = (Vec::with_capacity(part.len()), Vec::with_capacity(part.len()));
    let mut values: Vec<Vec<u8>> = vec![Vec::with_capacity(part.len()); planes];
    let mut deviation = [0; 2];
    for (number, stored) in stored.chunks_exact_mut(part.columns).enumerate() {
        let Some(row) = row(part.row + number as u64) else { continue };
        row.stored.copy(columns.start, stored);
        coverage.extend_from_slice(&row.coverage[columns.clone()]);
        normals.extend_from_slice(&row.normals[columns.clone()]);
        values.iter_mut().zip(&row.planes).for_each(|(values, row)| values.extend_from_slice(&row[columns.clone()]));
        for own in &row.deviation[columns.clone()] {
            deviation = [deviation[0].max(own[0]), deviation[1].max(own[1])];
        }
    }
    let whole = coverage.iter().all(|coverage| *coverage == 255);
    let is_none = coverage.iter().all(|coverage| *coverage == 0);
    let rows = stored.chunks_exact(part.columns);
    let step = largest_step(rows, stored.iter().all(|height| !height.is_nan()));
    let there = || stored.iter().filter(|height| !height.is_nan());
    CoarseChunk {
        low: there().copied().fold(f64::INFINITY, f64::min),
        high: there().copied().fold(f64::NEG_INFINITY, f64::max),
        step,
        coverage: match (is_none, whole) {
            (true, _) => Coverage::None,
            (false, true) => Coverage::Whole,
            (false, false) => Coverage::Partial,
        },
        deviation,
        bytes: (!is_none).then(|| chunk::encode_coarse(code, key, &stored, &coverage, &normals, &values)),
    }
}
