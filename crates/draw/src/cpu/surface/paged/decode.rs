//! Chunks of a page file as they are drawn.
//!
//! Leaves keep no normals and no coverage: both follow from the samples and the ring of those around them, so that they are the same on both
//! sides of a border.

use super::super::source::NodeSamples;
use super::slopes::is_same;
use crate::color::colors::to_linear;
use deepfield_data::model::Scale;
use deepfield_heights::hierarchy::chunks::Part;
use deepfield_heights::hierarchy::chunks::coarse::normal_of;
use deepfield_heights::model::Cell;
use deepfield_heights::store::{Chunk, HeightAbout};

/// What a chunk's values mean.
pub(super) struct Decoder {
    scale: Scale,
    planes: usize,
    /// From differences of heights to slopes.
    slopes: [f64; 2],
    /// By how much steeper these are than those that the file's normals are made of, where they differ.
    steeper: Option<[f32; 2]>,
    /// Light of each value of a plane.
    light: [f32; 256],
}

/// The unit normals of a cell's triangles, and which triangles it has.
#[derive(Clone, Copy)]
struct CellNormals {
    units: [[f64; 3]; 2],
    kind: usize,
}

/// Kinds of cells: two triangles; one, without one of the corners 0 to 3; none; beside the field.
const WHOLE: usize = 0;
const NONE: usize = 5;
const OUTSIDE: usize = 6;

/// How much of a cell's triangles is nearest to each of its corners: of a triangle half is at the right angle.
const SHARES: [[[f32; 2]; 4]; 7] = [
    [[0.125, 0.125], [0.25, 0.0], [0.0, 0.25], [0.125, 0.125]],
    [[0.0, 0.0], [0.125, 0.0], [0.125, 0.0], [0.25, 0.0]],
    [[0.125, 0.0], [0.0, 0.0], [0.25, 0.0], [0.125, 0.0]],
    [[0.125, 0.0], [0.25, 0.0], [0.0, 0.0], [0.125, 0.0]],
    [[0.25, 0.0], [0.125, 0.0], [0.125, 0.0], [0.0, 0.0]],
    [[0.0; 2]; 4],
    [[0.0; 2]; 4],
];

impl CellNormals {
    const OUTSIDE: CellNormals = CellNormals { units: [[0.0; 3]; 2], kind: OUTSIDE };

    fn of(cell: Cell, slopes: [f64; 2]) -> CellNormals {
        let mut units = [[0.0; 3]; 2];
        for (unit, triangle) in units.iter_mut().zip(cell.triangles()) {
            let [x, y] = [triangle.at[1] * slopes[0], triangle.at[2] * slopes[1]];
            let length = (x * x + y * y + 1.0).sqrt();
            *unit = [-x / length, -y / length, 1.0 / length];
        }
        let kind = match (cell.measured(), cell.0.iter().position(|height| height.is_nan())) {
            (4, _) => WHOLE,
            (3, Some(corner)) => corner + 1,
            _ => NONE,
        };
        CellNormals { units, kind }
    }
}

impl Decoder {
    /// For a file, and a world in which differences of heights are such slopes.
    pub(super) fn new(about: &HeightAbout, slopes: [f64; 2]) -> Decoder {
        let scale = about.grid.scale;
        let kept = about.slopes.map(|slope| slope / scale.slope);
        let steeper = [0, 1].map(|axis| slopes[axis] / kept[axis]);
        let is_usable = steeper.iter().all(|steeper| steeper.is_finite() && *steeper != 0.0);
        Decoder {
            scale,
            planes: about.grid.planes.len(),
            slopes,
            steeper: (is_usable && !is_same(slopes, kept)).then(|| steeper.map(|steeper| steeper as f32)),
            light: std::array::from_fn(|value| to_linear(value as f32 / 255.0)),
        }
    }

    /// From differences of heights to slopes.
    pub(super) fn slopes(&self) -> [f64; 2] {
        self.slopes
    }

    /// A chunk's samples.
    pub(super) fn samples(&self, chunk: Chunk) -> NodeSamples {
        let Chunk { key, part, held, mut stored, coverage, normals, planes } = chunk;
        stored.iter_mut().for_each(|value| *value = self.scale.value(*value));
        let planes =
            planes.iter().map(|plane| plane.iter().map(|value| self.light[usize::from(*value)]).collect()).collect();
        let (rows, columns) = (part.rows, part.columns);
        if key.level == 0 {
            let (coverage, normals) = self.leaf(&stored, &held, &part);
            return NodeSamples {
                rows,
                columns,
                heights: own(stored, &held, &part),
                coverage,
                normals,
                ranges: Vec::new(),
                planes,
            };
        }
        let normals = match normals.is_empty() {
            true => vec![[0.0, 0.0, 1.0]; part.len()],
            false => normals.into_iter().map(|bytes| self.turned(normal_of(bytes))).collect(),
        };
        NodeSamples { rows, columns, heights: stored, coverage, normals, ranges: Vec::new(), planes }
    }

    /// A chunk that nothing is in.
    pub(super) fn nothing(&self, [rows, columns]: [usize; 2]) -> NodeSamples {
        let count = rows * columns;
        NodeSamples {
            rows,
            columns,
            heights: vec![f64::NAN; count],
            coverage: vec![0; count],
            normals: vec![[0.0, 0.0, 1.0]; count],
            ranges: Vec::new(),
            planes: vec![vec![0.0; count]; self.planes],
        }
    }

    /// A mean normal of the file in the world: turned, and as long as it was.
    fn turned(&self, normal: [f32; 3]) -> [f32; 3] {
        let Some([along_columns, along_rows]) = self.steeper else { return normal };
        let length = |[x, y, z]: [f32; 3]| (x * x + y * y + z * z).sqrt();
        let turned = [normal[0] * along_columns, normal[1] * along_rows, normal[2]];
        let grown = length(turned);
        if grown > 0.0 { turned.map(|part| part * (length(normal) / grown)) } else { normal }
    }

    /// Coverage (nothing where all is) and normals of a leaf's own samples, from the heights that it holds.
    fn leaf(&self, heights: &[f64], held: &Part, part: &Part) -> (Vec<u8>, Vec<[f32; 3]>) {
        let margin = [(part.row - held.row) as usize, (part.column - held.column) as usize];
        // A row of cells, with one that is outside at both ends: sample `c` is between cells `c` and `c + 1`.
        let cells = |below: usize, out: &mut Vec<CellNormals>| {
            out.clear();
            out.push(CellNormals::OUTSIDE);
            if below == 0 || below == held.rows {
                out.resize(held.columns + 1, CellNormals::OUTSIDE);
                return;
            }
            let (upper, lower) = heights[(below - 1) * held.columns..(below + 1) * held.columns].split_at(held.columns);
            let corners = upper.windows(2).zip(lower.windows(2));
            out.extend(corners.map(|(up, low)| CellNormals::of(Cell([up[0], up[1], low[0], low[1]]), self.slopes)));
            out.push(CellNormals::OUTSIDE);
        };
        let (mut above, mut below) = (Vec::with_capacity(held.columns + 1), Vec::with_capacity(held.columns + 1));
        let (mut coverage, mut normals) = (Vec::with_capacity(part.len()), Vec::with_capacity(part.len()));
        cells(margin[0], &mut below);
        for row in margin[0]..margin[0] + part.rows {
            std::mem::swap(&mut above, &mut below);
            cells(row + 1, &mut below);
            for column in margin[1]..margin[1] + part.columns {
                let around =
                    [(&above[column], 3), (&above[column + 1], 2), (&below[column], 1), (&below[column + 1], 0)];
                let is_measured = !heights[row * held.columns + column].is_nan();
                let (share, normal) = about_sample(around, is_measured);
                coverage.push(share);
                normals.push(normal);
            }
        }
        if coverage.iter().all(|share| *share == u8::MAX) {
            coverage.clear();
        }
        (coverage, normals)
    }
}

/// Coverage and mean normal of what is nearest to a sample, from the cells around it, each with the number of the corner that the sample is.
#[inline]
fn about_sample(around: [(&CellNormals, usize); 4], is_measured: bool) -> (u8, [f32; 3]) {
    let (mut area, mut total, mut sum) = (0.0_f32, 0.0_f32, [0.0_f64; 3]);
    for (cell, corner) in around {
        total += if cell.kind == OUTSIDE { 0.0 } else { 0.25 };
        for (share, unit) in SHARES[cell.kind][corner].into_iter().zip(cell.units) {
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

/// The leaf's own of the heights that it holds.
fn own(heights: Vec<f64>, held: &Part, part: &Part) -> Vec<f64> {
    if held == part {
        return heights;
    }
    let first = (part.row - held.row) as usize * held.columns + (part.column - held.column) as usize;
    let rows = heights[first..].chunks(held.columns).take(part.rows);
    rows.flat_map(|row| &row[..part.columns]).copied().collect()
}
