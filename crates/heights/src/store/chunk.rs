//! A chunk as bytes and back.
//!
//! Of a leaf: its samples, and a ring of one around them where the field has them ([`crate::codec::heights`]); its planes. Of a chunk of
//! another level: a byte whose bit 0 says that coverage is kept, bit 1 that normals are, bit 2 that of their x and y only what is left is, and
//! bit 3 the same of z ([`super::normals`]); its samples; coverage; x, y and z of normals; its planes. Where a leaf was not measured at all, its
//! planes are kept still. Coverage that is not kept is 255; normals that are not kept point up.

use super::normals;
use crate::codec::heights;
use crate::codec::values::Values;
use crate::hierarchy::chunks::coarse::UP;
use crate::hierarchy::chunks::{ChunkKey, Lattice, Part};

/// Bit of the first byte: coverage is kept.
const COVERAGE: u8 = 1;
/// Bit of the first byte: normals are kept.
const NORMALS: u8 = 2;
/// Bit of the first byte: of x and y of normals what is left is kept.
const XY_RESTS: u8 = 4;
/// Bit of the first byte: of z of normals what is left is kept.
const Z_RESTS: u8 = 8;

/// The samples of a chunk.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    /// Which one it is.
    pub key: ChunkKey,
    /// Its own samples, among those of its level.
    pub part: Part,
    /// The samples that `stored` has: of a leaf a ring of those around its own, too, where the field has them, so that slopes at its border are
    /// those of its neighbours; else its own.
    pub held: Part,
    /// Samples as they are stored, row by row; NaN where there is nothing. Those of other levels than 0 that were not measured, but stand for
    /// something that was, have a height that fits.
    pub stored: Vec<f64>,
    /// Of levels from 1 on the share of T in what each own sample stands for: 0 nothing, 255 all; empty where all is, and in leaves.
    pub coverage: Vec<u8>,
    /// Of levels from 1 on mean normals ([`crate::hierarchy::chunks::coarse::normal_of`]); empty where all point up, and in leaves.
    pub normals: Vec<[u8; 3]>,
    /// Of each colour plane the values of its own samples.
    pub planes: Vec<Vec<u8>>,
}

impl Chunk {
    /// A sample, as it is stored, by its row and column among the chunk's own; NaN where there is nothing.
    pub fn stored_at(&self, row: usize, column: usize) -> f64 {
        let (row, column) =
            (row + (self.part.row - self.held.row) as usize, column + (self.part.column - self.held.column) as usize);
        self.stored.get(row * self.held.columns + column).copied().unwrap_or(f64::NAN)
    }

    /// How much of what an own sample of a level from 1 on stands for is T, 0 to 255.
    pub fn coverage_at(&self, row: usize, column: usize) -> u8 {
        self.coverage.get(row * self.part.columns + column).copied().unwrap_or(255)
    }

    /// The mean normal's bytes of an own sample of a level from 1 on.
    pub fn normal_at(&self, row: usize, column: usize) -> [u8; 3] {
        self.normals.get(row * self.part.columns + column).copied().unwrap_or(UP)
    }
}

/// What chunks of a file are coded with.
#[derive(Clone, Copy, Debug)]
pub struct Code<'a> {
    /// The levels and chunks.
    pub lattice: &'a Lattice,
    /// Which values samples have.
    pub values: Values,
    /// From differences of stored samples along columns and rows to slopes in space.
    pub slopes: [f64; 2],
}

/// The bytes of a leaf. `stored` is `held` samples, `columns` in a row; planes have `own` columns.
pub fn encode_leaf(values: &Values, stored: &[f64], columns: usize, planes: &[Vec<u8>], own: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(stored.len() * 2);
    heights::encode(values, stored, columns, &mut out);
    planes.iter().for_each(|plane| heights::encode_bytes(plane, own, &mut out));
    out
}

/// The bytes of a chunk of another level.
pub fn encode_coarse(
    code: &Code<'_>,
    key: ChunkKey,
    stored: &[f64],
    coverage: &[u8],
    normals: &[[u8; 3]],
    planes: &[Vec<u8>],
) -> Vec<u8> {
    let columns = code.lattice.part(key).columns;
    let mut out = Vec::with_capacity(stored.len() * 3);
    let has_coverage = coverage.iter().any(|coverage| *coverage != 255);
    let has_normals = normals.iter().any(|normal| *normal != UP);
    let (is_rest, parts) =
        if has_normals { normals::taken_apart(code, key, stored, normals) } else { Default::default() };
    let flags = [(has_coverage, COVERAGE), (has_normals, NORMALS), (is_rest[0], XY_RESTS), (is_rest[1], Z_RESTS)];
    out.push(flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, bit)| bit).sum());
    heights::encode(&code.values, stored, columns, &mut out);
    if has_coverage {
        heights::encode_bytes(coverage, columns, &mut out);
    }
    parts.iter().filter(|part| !part.is_empty()).for_each(|part| heights::encode_bytes(part, columns, &mut out));
    planes.iter().for_each(|plane| heights::encode_bytes(plane, columns, &mut out));
    out
}

/// Reads a chunk from all of the bytes; `None` where they are none.
pub fn decode(bytes: &[u8], key: ChunkKey, code: &Code<'_>, planes: usize) -> Option<Chunk> {
    let Code { lattice, values, .. } = *code;
    let part = lattice.part(key);
    let held = if key.level == 0 { lattice.ringed(part) } else { part };
    let mut rest = bytes;
    let flags = match key.level {
        0 => 0,
        _ => {
            let (&flags, after) = rest.split_first()?;
            rest = after;
            flags
        }
    };
    if flags & !(COVERAGE | NORMALS | XY_RESTS | Z_RESTS) != 0 {
        return None;
    }
    let mut stored = vec![0.0; held.len()];
    rest = rest.get(heights::decode(&values, rest, held.columns, &mut stored)?..)?;
    let mut plane = || -> Option<Vec<u8>> {
        let mut values = vec![0; part.len()];
        rest = rest.get(heights::decode_bytes(rest, part.columns, &mut values)?..)?;
        Some(values)
    };
    let coverage = if flags & COVERAGE != 0 { plane()? } else { Vec::new() };
    let normals = if flags & NORMALS != 0 {
        let parts = [plane()?, plane()?, plane()?];
        normals::put_together(code, key, &stored, &parts, [flags & XY_RESTS != 0, flags & Z_RESTS != 0])
    } else {
        Vec::new()
    };
    let planes = (0..planes).map(|_| plane()).collect::<Option<Vec<_>>>()?;
    rest.is_empty().then_some(Chunk { key, part, held, stored, coverage, normals, planes })
}

/// About how many bytes a chunk takes in memory where it is drawn: four a height, one of coverage, three of a normal, one of each plane.
pub fn memory(part: &Part, level: u8, planes: usize) -> u64 {
    part.len() as u64 * (4 + if level == 0 { 0 } else { 4 } + planes as u64)
}
