//! Sums over each cell of a leaf: area of T, normals, light, and samples that are in no triangle.

use super::sums::{HALF_CELL, Sum, Sums, UNIT};
use crate::model::Cell;
use crate::model::light;
use deepfield_data::lanes::in_lanes;

/// A leaf's samples at full resolution, with a ring of those around it.
#[derive(Debug)]
pub struct Patch<'a> {
    /// The samples as they are stored, those of the ring among them; NaN where nothing was measured.
    pub stored: &'a [f64],
    /// Samples of a row, those of the ring among them.
    pub width: usize,
    /// Where the leaf's own begin: 0 or 1 rows and columns.
    pub margin: [usize; 2],
    /// The leaf's own rows and columns.
    pub size: [usize; 2],
    /// Of each plane the values of the leaf's own samples.
    pub planes: &'a [Vec<u8>],
}

impl Patch<'_> {
    /// A row of the leaf's own samples.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.stored[(row + self.margin[0]) * self.width + self.margin[1]..][..self.size[1]]
    }

    /// A sample by its row and column in the leaf, the ring's at -1 and at the size; NaN beside the field.
    fn around(&self, row: isize, column: isize) -> f64 {
        let (row, column) = (row + self.margin[0] as isize, column + self.margin[1] as isize);
        if row < 0 || column < 0 || column as usize >= self.width {
            return f64::NAN;
        }
        self.stored.get(row as usize * self.width + column as usize).copied().unwrap_or(f64::NAN)
    }

    /// Whether a measured sample is in no triangle.
    pub fn is_lone(&self, row: usize, column: usize) -> bool {
        let (row, column) = (row as isize, column as isize);
        let cell = |[r, c]: [isize; 2]| {
            let corners = [[r, c], [r, c + 1], [r + 1, c], [r + 1, c + 1]];
            Cell(corners.map(|[r, c]| self.around(r, c)))
        };
        let cells = [[row - 1, column - 1], [row - 1, column], [row, column - 1], [row, column]];
        cells.into_iter().all(|at| cell(at).measured() < 3)
    }
}

/// A triangle's normal, [`UNIT`] long, from its slopes along columns and rows.
#[inline(always)]
fn normal(along_columns: f32, along_rows: f32) -> [i32; 3] {
    let scale = UNIT as f32 / (1.0 + along_columns * along_columns + along_rows * along_rows).sqrt();
    // Added to so large a single, a number is rounded, and stands in the lowest bits: the same everywhere, and quick.
    const LARGE: f32 = 12_582_912.0;
    let round = |value: f32| (value + LARGE).to_bits() as i32 - LARGE.to_bits() as i32;
    [round(-along_columns * scale), round(-along_rows * scale), round(scale)]
}

/// Finite, however steep.
#[inline(always)]
fn slope(difference: f64, scale: f64) -> f32 {
    ((difference * scale) as f32).clamp(-1e9, 1e9)
}

/// Sums over the cells of a leaf; `slopes` turns differences of stored samples along columns and rows into slopes in space. `owns` says whether
/// the leaf has the field's last row and its last column, and so the samples that are in no triangle there.
pub fn sums(patch: &Patch<'_>, slopes: [f64; 2], owns: [bool; 2]) -> Sums {
    let [rows, columns] = patch.size.map(|count| count - 1);
    let mut out = Sums::new(rows, columns, patch.planes.len());
    for (row, sums) in out.sums.chunks_exact_mut(columns).enumerate() {
        let (upper, lower) = (patch.row(row), patch.row(row + 1));
        if is_whole(upper) && is_whole(lower) {
            in_lanes!(whole_row(upper, lower, slopes, sums));
        } else {
            broken_row(upper, lower, slopes, sums);
        }
    }
    lone(patch, owns, &mut out);
    for plane in 0..patch.planes.len() {
        lights(patch, plane, &mut out);
    }
    out
}

fn is_whole(row: &[f64]) -> bool {
    row.iter().fold(true, |is_whole, value| is_whole & !value.is_nan())
}

/// Cells of four measured corners each.
#[inline(always)]
fn whole_row(upper: &[f64], lower: &[f64], slopes: [f64; 2], sums: &mut [Sum]) {
    /// Cells at a time: enough to be worked on side by side.
    const LANES: usize = 16;
    let mut normals = [[0_i32; LANES]; 6];
    for (number, sums) in sums.chunks_mut(LANES).enumerate() {
        let first = number * LANES;
        let (upper, lower) = (&upper[first..], &lower[first..]);
        let (above, below) = (upper.first_chunk::<{ LANES + 1 }>(), lower.first_chunk::<{ LANES + 1 }>());
        let (Some(above), Some(below)) = (above, below) else {
            for ((sum, upper), lower) in sums.iter_mut().zip(upper.windows(2)).zip(lower.windows(2)) {
                let [p, q, s] = normal(slope(upper[1] - upper[0], slopes[0]), slope(lower[1] - upper[1], slopes[1]));
                let [t, u, v] = normal(slope(lower[1] - lower[0], slopes[0]), slope(lower[0] - upper[0], slopes[1]));
                *sum = Sum { area: 2, lone: 0, normal: [p + t, q + u, s + v] };
            }
            continue;
        };
        for lane in 0..LANES {
            let along_columns = slope(above[lane + 1] - above[lane], slopes[0]);
            let along_rows = slope(below[lane + 1] - above[lane + 1], slopes[1]);
            [normals[0][lane], normals[1][lane], normals[2][lane]] = normal(along_columns, along_rows);
        }
        for lane in 0..LANES {
            let along_columns = slope(below[lane + 1] - below[lane], slopes[0]);
            let along_rows = slope(below[lane] - above[lane], slopes[1]);
            [normals[3][lane], normals[4][lane], normals[5][lane]] = normal(along_columns, along_rows);
        }
        for (lane, sum) in sums.iter_mut().enumerate() {
            let normal = [
                normals[0][lane] + normals[3][lane],
                normals[1][lane] + normals[4][lane],
                normals[2][lane] + normals[5][lane],
            ];
            *sum = Sum { area: 2, lone: 0, normal };
        }
    }
}

fn broken_row(upper: &[f64], lower: &[f64], slopes: [f64; 2], sums: &mut [Sum]) {
    for ((sum, upper), lower) in sums.iter_mut().zip(upper.windows(2)).zip(lower.windows(2)) {
        for triangle in Cell([upper[0], upper[1], lower[0], lower[1]]).triangles() {
            let [_, along_columns, along_rows] = triangle.at;
            let normal = normal(slope(along_columns, slopes[0]), slope(along_rows, slopes[1]));
            sum.area += 1;
            sum.normal.iter_mut().zip(normal).for_each(|(sum, normal)| *sum += normal);
        }
    }
}

/// Counts samples that are in no triangle, each in the cell after it or, in the last row and column, in the one before.
fn lone(patch: &Patch<'_>, owns: [bool; 2], out: &mut Sums) {
    let [rows, columns] = patch.size;
    for row in 0..rows - usize::from(!owns[0]) {
        let samples = patch.row(row);
        if is_whole(samples) && columns > 2 && rows > 2 && is_whole(patch.row(if row == 0 { 1 } else { row - 1 })) {
            continue;
        }
        for column in 0..columns - usize::from(!owns[1]) {
            if !samples[column].is_nan() && patch.is_lone(row, column) {
                let cell = row.min(rows - 2) * (columns - 1) + column.min(columns - 2);
                out.sums[cell].lone += 1;
                for (plane, values) in patch.planes.iter().enumerate() {
                    let light = u64::from(light::table()[usize::from(values[row * columns + column])]);
                    let own = &mut out.light[cell * patch.planes.len() + plane];
                    own[0] += light;
                    own[1] += light * light;
                }
            }
        }
    }
}

/// Adds the light of a plane: of each cell the quarters next to its corners, as far as T is there.
fn lights(patch: &Patch<'_>, plane: usize, out: &mut Sums) {
    let (table, planes) = (light::table(), patch.planes.len());
    let columns = patch.size[1];
    let values = &patch.planes[plane];
    for row in 0..patch.size[0] - 1 {
        let (upper, lower) = (patch.row(row), patch.row(row + 1));
        for column in 0..columns - 1 {
            // Eighths of half a cell that are the corners'.
            let valid =
                [upper[column], upper[column + 1], lower[column], lower[column + 1]].map(|value| !value.is_nan());
            let parts: [u64; 4] = match valid {
                [true, true, true, true] => [4, 4, 4, 4],
                [true, true, false, true] => [2, 4, 0, 2],
                [true, false, true, true] => [2, 0, 4, 2],
                [false, true, true, true] => [0, 2, 2, 4],
                [true, true, true, false] => [4, 2, 2, 0],
                _ => continue,
            };
            let at = row * columns + column;
            let own = &mut out.light[(row * (columns - 1) + column) * planes + plane];
            for (part, at) in parts.into_iter().zip([at, at + 1, at + columns, at + columns + 1]) {
                let light = u64::from(table[usize::from(values[at])]);
                own[0] += part * (HALF_CELL / 8) * light;
                own[1] += part * (HALF_CELL / 8) * light * light;
            }
        }
    }
}
