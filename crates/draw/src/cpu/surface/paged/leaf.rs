//! Coverage and normals of full resolution, which files do not keep: of T around each sample, so that they are the same on both sides of a
//! border between leaves.
//!
//! A sample stands for what is nearer to it than to others along rows and columns: of a whole cell a quarter, of a triangle half at the right
//! angle and a quarter at each other corner. Sums are taken in the same order for all samples.

use super::super::samples::MeanNormal;
use deepfield_data::lanes::in_lanes;
use deepfield_heights::model::Cell;
use std::ops::Range;

/// Heights with as many of those around a leaf as the field has, at most one row and one column on each side.
pub(super) struct Held<'a> {
    /// Row by row; NaN where nothing was measured.
    pub(super) heights: &'a [f64],
    /// How many are in a row.
    pub(super) columns: usize,
    /// How many rows and columns come before the leaf's own.
    pub(super) margin: [usize; 2],
    /// The leaf's own rows and columns.
    pub(super) size: [usize; 2],
}

/// Coverage, 0 to 255, and mean normals of a leaf's own samples.
pub(super) type About = (Vec<u8>, Vec<MeanNormal>);

/// Kinds of cells: two triangles; one, without one of the corners 0 to 3 (1 to 4); none; beside the field.
const WHOLE: u8 = 0;
const NONE: u8 = 5;
const OUTSIDE: u8 = 6;

/// By the kind, how much of a cell's triangles each of its corners stands for, in cells.
const SHARES: [[[f32; 2]; 4]; 7] = [
    [[0.125, 0.125], [0.25, 0.0], [0.0, 0.25], [0.125, 0.125]],
    [[0.0, 0.0], [0.125, 0.0], [0.125, 0.0], [0.25, 0.0]],
    [[0.125, 0.0], [0.0, 0.0], [0.25, 0.0], [0.125, 0.0]],
    [[0.125, 0.0], [0.25, 0.0], [0.0, 0.0], [0.125, 0.0]],
    [[0.25, 0.0], [0.125, 0.0], [0.125, 0.0], [0.0, 0.0]],
    [[0.0; 2]; 4],
    [[0.0; 2]; 4],
];

/// A row of cells.
#[derive(Default)]
struct CellRow {
    /// Of each cell's first and second triangle x, y and z of the unit normal; 0 where there is none.
    units: [[Vec<f64>; 3]; 2],
    kinds: Vec<u8>,
    is_whole: bool,
}

impl CellRow {
    fn new(cells: usize) -> CellRow {
        let zeros = || vec![0.0; cells];
        let units = [0, 1].map(|_| [zeros(), zeros(), zeros()]);
        CellRow { units, kinds: vec![OUTSIDE; cells], is_whole: false }
    }

    /// Cells between two rows of samples; without these, cells beside the field.
    fn fill(&mut self, between: Option<(&[f64], &[f64])>, slopes: [f64; 2]) {
        self.is_whole = false;
        let Some((upper, lower)) = between else {
            self.kinds.fill(OUTSIDE);
            self.units.iter_mut().flatten().for_each(|part| part.fill(0.0));
            return;
        };
        if is_whole(upper) && is_whole(lower) {
            self.is_whole = true;
            self.kinds.fill(WHOLE);
            let (b, e) = (&upper[1..], &lower[1..]);
            let [first, second] = &mut self.units;
            in_lanes!({
                units([b, upper], [e, b], slopes, first);
                units([e, lower], [lower, upper], slopes, second);
            });
            return;
        }
        for (at, (up, low)) in upper.windows(2).zip(lower.windows(2)).enumerate() {
            let cell = Cell([up[0], up[1], low[0], low[1]]);
            self.kinds[at] = match (cell.measured(), cell.0.iter().position(|height| height.is_nan())) {
                (4, _) => WHOLE,
                (3, Some(corner)) => corner as u8 + 1,
                _ => NONE,
            };
            let mut triangles = cell.triangles();
            for [x, y, z] in &mut self.units {
                let unit = triangles.next().map_or([0.0; 3], |triangle| unit([triangle.at[1], triangle.at[2]], slopes));
                [x[at], y[at], z[at]] = unit;
            }
        }
    }

    /// The two normals of a cell; one that is beside the field counts nothing.
    fn cell(&self, at: Option<usize>) -> (u8, [[f64; 3]; 2]) {
        let Some(at) = at.filter(|at| *at < self.kinds.len()) else { return (OUTSIDE, [[0.0; 3]; 2]) };
        (self.kinds[at], [0, 1].map(|slot| [0, 1, 2].map(|axis| self.units[slot][axis][at])))
    }
}

fn is_whole(row: &[f64]) -> bool {
    row.iter().fold(true, |is_whole, height| is_whole & !height.is_nan())
}

/// The unit normal of a triangle, by what a column and a row add to its height.
#[inline(always)]
fn unit([along_columns, along_rows]: [f64; 2], slopes: [f64; 2]) -> [f64; 3] {
    let [x, y] = [along_columns * slopes[0], along_rows * slopes[1]];
    let length = (x * x + y * y + 1.0).sqrt();
    [-x / length, -y / length, 1.0 / length]
}

/// The unit normals of triangles whose heights grow by differences of these rows.
#[inline(always)]
fn units(columns: [&[f64]; 2], rows: [&[f64]; 2], slopes: [f64; 2], [x, y, z]: &mut [Vec<f64>; 3]) {
    let count = x.len();
    let [right, left] = columns.map(|row| &row[..count]);
    let [below, above] = rows.map(|row| &row[..count]);
    let (x, y, z) = (&mut x[..count], &mut y[..count], &mut z[..count]);
    for at in 0..count {
        [x[at], y[at], z[at]] = unit([right[at] - left[at], below[at] - above[at]], slopes);
    }
}

/// What a leaf's own samples stand for. `slopes` turns differences of heights along columns and rows into slopes.
pub(super) fn about(held: &Held<'_>, slopes: [f64; 2]) -> About {
    let ([first_row, first_column], [rows, columns]) = (held.margin, held.size);
    let cells = held.columns.saturating_sub(1);
    let row_of = |row: usize| held.heights.get(row * held.columns..(row + 1) * held.columns);
    let (mut above, mut below) = (CellRow::new(cells), CellRow::new(cells));
    let before = first_row.checked_sub(1).and_then(row_of);
    below.fill(before.zip(row_of(first_row)), slopes);
    let mut out = (Vec::with_capacity(rows * columns), Vec::with_capacity(rows * columns));
    let mut means = [0, 1, 2].map(|_| vec![0.0; columns]);
    for row in first_row..first_row + rows {
        std::mem::swap(&mut above, &mut below);
        below.fill(row_of(row).zip(row_of(row + 1)), slopes);
        let samples = row_of(row).unwrap_or_default();
        // Samples between two cells of the rows, of which all have all they stand for.
        let inner = match above.is_whole && below.is_whole {
            true => first_column.max(1)..(first_column + columns).min(cells),
            false => 0..0,
        };
        let own = first_column..first_column + columns;
        let (before, after) = match inner.is_empty() {
            true => (own.clone(), own.end..own.end),
            false => (own.start..inner.start, inner.end..own.end),
        };
        let each = |columns: Range<usize>, out: &mut About| {
            for column in columns {
                let is_measured = samples.get(column).is_some_and(|height| !height.is_nan());
                let (coverage, normal) = about_sample(&above, &below, column, is_measured);
                out.0.push(coverage);
                out.1.push(MeanNormal::new(normal));
            }
        };
        each(before, &mut out);
        if !inner.is_empty() {
            for (axis, means) in means.iter_mut().enumerate() {
                in_lanes!(whole_means(&above, &below, axis, inner.start, &mut means[..inner.len()]));
            }
            out.0.extend(std::iter::repeat_n(u8::MAX, inner.len()));
            let [x, y, z] = &means;
            let normals = x.iter().zip(y).zip(z).take(inner.len());
            out.1.extend(normals.map(|((x, y), z)| MeanNormal::new([*x, *y, *z])));
        }
        each(after, &mut out);
    }
    out
}

/// A part of the mean normals of samples from `first` on whose four cells are whole: as [`about_sample`] has it.
#[inline(always)]
fn whole_means(above: &CellRow, below: &CellRow, axis: usize, first: usize, out: &mut [f32]) {
    let count = out.len();
    let (before, after) = (first - 1..first - 1 + count, first..first + count);
    let [up_left, up_left_second] = [0, 1].map(|slot| &above.units[slot][axis][before.clone()]);
    let up = &above.units[1][axis][after.clone()];
    let left = &below.units[0][axis][before];
    let [own, own_second] = [0, 1].map(|slot| &below.units[slot][axis][after.clone()]);
    for at in 0..count {
        // From 0 on, so that no sum is a negative zero.
        let sum = 0.0 + 0.125 * up_left[at] + 0.125 * up_left_second[at] + 0.25 * up[at];
        out[at] = (sum + 0.25 * left[at] + 0.125 * own[at] + 0.125 * own_second[at]) as f32;
    }
}

/// Coverage and mean normal of a sample.
fn about_sample(above: &CellRow, below: &CellRow, column: usize, is_measured: bool) -> (u8, [f32; 3]) {
    let (mut area, mut total, mut sum) = (0.0_f32, 0.0_f32, [0.0_f64; 3]);
    let before = column.checked_sub(1);
    for (row, at, corner) in
        [(above, before, 3), (above, Some(column), 2), (below, before, 1), (below, Some(column), 0)]
    {
        let (kind, units) = row.cell(at);
        total += if kind == OUTSIDE { 0.0 } else { 0.25 };
        for (share, unit) in SHARES[usize::from(kind)][corner].into_iter().zip(units) {
            area += share;
            (0..3).for_each(|k| sum[k] += f64::from(share) * unit[k]);
        }
    }
    let coverage = match is_measured {
        false => 0,
        true if area >= total => u8::MAX,
        true => (255.0 * area / total).round().clamp(1.0, 254.0) as u8,
    };
    let normal = if area > 0.0 { sum.map(|sum| (sum / f64::from(area)) as f32) } else { [0.0, 0.0, 1.0] };
    (coverage, normal)
}
