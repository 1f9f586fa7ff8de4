//! Mean normals of a chunk, by what is left when its heights have said what they can.
//!
//! Of x and y that is the difference from the normal of the chunk's own surface, by its slopes between the samples before and after; of z that
//! from what would make the normal, with x and y as they are, as long as a unit. All is done in singles, whose sums, products, quotients and
//! roots are the same everywhere; rests are modulo 256, 128 for 0. Where heights say little, as of noise, normals are kept as they are.

use super::chunk::Code;
use crate::hierarchy::chunks::coarse::UP;
use crate::hierarchy::chunks::{ChunkKey, Part};

/// A single as the nearest byte.
#[inline(always)]
fn byte(value: f32) -> u8 {
    // Added to so large a single, a number is rounded, and stands in the lowest bits.
    (value + 12_582_912.0).to_bits() as u8
}

/// The z of a unit normal with these bytes of x and y.
#[inline(always)]
fn height_of([x, y]: [u8; 2]) -> u8 {
    let part = |byte: u8| (f32::from(byte) - 128.0) / 127.0;
    let (x, y) = (part(x), part(y));
    byte(255.0 * (1.0 - x * x - y * y).max(0.0).sqrt())
}

/// The bytes of x and y of the normals that a chunk's heights have, row by row.
struct Expected<'a> {
    part: Part,
    stored: &'a [f64],
    /// From differences to slopes, for the places of each column and row; those at the border have a neighbour on one side only.
    along_columns: Vec<f32>,
    along_rows: Vec<f32>,
}

impl<'a> Expected<'a> {
    fn new(code: &Code<'_>, key: ChunkKey, stored: &'a [f64]) -> Expected<'a> {
        let part = code.lattice.part(key);
        let scales = |axis: usize, first: u64, count: usize, slope: f64| -> Vec<f32> {
            let place = |index: usize| code.lattice.place(axis, key.level.into(), first + index as u64);
            let scale =
                |index: usize| slope / (place((index + 1).min(count - 1)) - place(index.saturating_sub(1))) as f64;
            (0..count).map(|index| scale(index) as f32).collect()
        };
        let along_columns = scales(1, part.column, part.columns, code.slopes[0]);
        let along_rows = scales(0, part.row, part.rows, code.slopes[1]);
        Expected { part, stored, along_columns, along_rows }
    }

    fn row(&self, row: usize, out: &mut [[u8; 2]]) {
        let columns = self.part.columns;
        let of = |row: usize| &self.stored[row * columns..][..columns];
        let (before, here, after) = (of(row.saturating_sub(1)), of(row), of((row + 1).min(self.part.rows - 1)));
        let along_rows = self.along_rows[row];
        for (column, out) in out.iter_mut().enumerate() {
            let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
            let slope = |difference: f64, scale: f32| {
                let slope = difference as f32 * scale;
                // Where there is no neighbour, or none that is near.
                if slope.abs() < 1e9 { slope } else { 0.0 }
            };
            let x = slope(here[right] - here[left], self.along_columns[column]);
            let y = slope(after[column] - before[column], along_rows);
            let scale = -127.0 / (1.0 + x * x + y * y).sqrt();
            *out = [byte(128.0 + x * scale), byte(128.0 + y * scale)];
        }
    }
}

/// How far from their neighbours, or from nothing, the bytes of some rows are.
fn size(bytes: &[u8], columns: usize) -> (u64, u64) {
    let (mut apart, mut far) = (0, 0);
    for rows in bytes.chunks_exact(2 * columns).step_by(8) {
        let (above, row) = rows.split_at(columns);
        for (left_and_own, up) in row.windows(2).zip(&above[1..]) {
            let expected = u8::midpoint(left_and_own[0], *up);
            apart += u64::from(left_and_own[1].abs_diff(expected));
            far += u64::from(left_and_own[1].abs_diff(UP[0]));
        }
    }
    (apart, far)
}

/// The x, y and z of a chunk's normals, or what is left of them: whether of x and y, and whether of z.
pub(super) fn taken_apart(
    code: &Code<'_>,
    key: ChunkKey,
    stored: &[f64],
    normals: &[[u8; 3]],
) -> ([bool; 2], [Vec<u8>; 3]) {
    let expected = Expected::new(code, key, stored);
    let columns = expected.part.columns;
    let mut row_of = vec![[0; 2]; columns];
    let mut rests = [0; 3].map(|_| Vec::with_capacity(normals.len()));
    for (row, normals) in normals.chunks_exact(columns).enumerate() {
        expected.row(row, &mut row_of);
        for (normal, expected) in normals.iter().zip(&row_of) {
            let z = height_of([normal[0], normal[1]]);
            for (axis, expected) in [expected[0], expected[1], z].into_iter().enumerate() {
                rests[axis].push(normal[axis].wrapping_sub(expected).wrapping_add(UP[0]));
            }
        }
    }
    let plain = [0, 1, 2].map(|axis| normals.iter().map(|normal| normal[axis]).collect::<Vec<u8>>());
    // Rests are at their best as they are, or by their neighbours.
    let is_better = |axes: &[usize]| {
        let sums = |parts: &[Vec<u8>; 3]| {
            axes.iter().map(|axis| size(&parts[*axis], columns)).fold((0, 0), |sum, own| (sum.0 + own.0, sum.1 + own.1))
        };
        let ((apart, far), (plainly_apart, _)) = (sums(&rests), sums(&plain));
        apart.min(far) <= plainly_apart
    };
    let is_rest = [is_better(&[0, 1]), is_better(&[2])];
    let [x, y, z] = rests;
    let [plain_x, plain_y, plain_z] = plain;
    let (x, y) = if is_rest[0] { (x, y) } else { (plain_x, plain_y) };
    (is_rest, [x, y, if is_rest[1] { z } else { plain_z }])
}

/// The normals of what [`taken_apart`] gave.
pub(super) fn put_together(
    code: &Code<'_>,
    key: ChunkKey,
    stored: &[f64],
    parts: &[Vec<u8>; 3],
    is_rest: [bool; 2],
) -> Vec<[u8; 3]> {
    let expected = Expected::new(code, key, stored);
    let columns = expected.part.columns;
    let mut row_of = vec![[UP[0]; 2]; columns];
    let mut out = Vec::with_capacity(stored.len());
    for row in 0..expected.part.rows {
        if is_rest[0] {
            expected.row(row, &mut row_of);
        }
        for (column, expected) in row_of.iter().enumerate() {
            let part = |axis: usize| parts[axis][row * columns + column];
            let whole = |axis: usize| expected[axis].wrapping_add(part(axis)).wrapping_sub(UP[0]);
            let (x, y) = (whole(0), whole(1));
            let z = if is_rest[1] { height_of([x, y]).wrapping_add(part(2)).wrapping_sub(UP[0]) } else { part(2) };
            out.push([x, y, z]);
        }
    }
    out
}
