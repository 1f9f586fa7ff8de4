//! Chunks of a page file as they are drawn.

use super::super::samples::{MeanNormal, SampleHeights, SampleNormals};
use super::super::source::NodeSamples;
use super::leaf::{self, Held};
use super::normals::{Ground, of_heights, refined};
use super::slopes::is_same;
use crate::color::colors::to_linear;
use deepfield_data::lanes::in_lanes;
use deepfield_data::model::Scale;
use deepfield_heights::hierarchy::chunks::{Lattice, Part};
use deepfield_heights::store::{Chunk, HeightAbout};

/// Normals of slopes that are flattened by this are made anew: what is left of their z in a byte says too little.
const NEEDLE: f64 = 1.0 / 16.0;

/// What becomes of the normals that a file keeps.
#[derive(Clone, Copy)]
enum Turn {
    /// They stay.
    Not,
    /// The world is by so much steeper along columns and rows.
    By([f32; 2]),
    /// They are those of a needle, and none of the world's.
    Anew,
}

/// What a chunk's values mean.
pub(super) struct Decoder {
    scale: Scale,
    planes: usize,
    /// From differences of heights to slopes.
    slopes: [f64; 2],
    /// Those that the file's normals are made of.
    kept: [f64; 2],
    /// What becomes of these.
    turn: Turn,
    /// Light of each value of a plane.
    light: [f32; 256],
}

impl Decoder {
    /// For a file, and a world in which differences of heights are such slopes.
    pub(super) fn new(about: &HeightAbout, slopes: [f64; 2]) -> Decoder {
        let scale = about.grid.scale;
        let kept = about.slopes.map(|slope| slope / scale.slope);
        let steeper = [0, 1].map(|axis| slopes[axis] / kept[axis]);
        let is_usable = steeper.iter().all(|steeper| steeper.is_finite() && *steeper != 0.0);
        let turn = match is_usable && !is_same(slopes, kept) {
            false => Turn::Not,
            true if steeper.iter().any(|steeper| steeper.abs() < NEEDLE) => Turn::Anew,
            true => Turn::By(steeper.map(|steeper| steeper as f32)),
        };
        Decoder {
            scale,
            planes: about.grid.planes.len(),
            slopes,
            kept,
            turn,
            light: std::array::from_fn(|value| to_linear(value as f32 / 255.0)),
        }
    }

    /// From differences of heights to slopes.
    pub(super) fn slopes(&self) -> [f64; 2] {
        self.slopes
    }

    /// A chunk's samples.
    pub(super) fn samples(&self, chunk: Chunk, lattice: &Lattice) -> NodeSamples {
        let Chunk { key, part, held, mut stored, coverage, normals, planes } = chunk;
        if self.scale != Scale::NONE {
            in_lanes!(scale(&mut stored, self.scale));
        }
        let planes =
            planes.iter().map(|plane| plane.iter().map(|value| self.light[usize::from(*value)]).collect()).collect();
        let (rows, columns) = (part.rows, part.columns);
        if key.level == 0 {
            let margin = [(part.row - held.row) as usize, (part.column - held.column) as usize];
            let around = Held { heights: &stored, columns: held.columns, margin, size: [rows, columns] };
            let (mut coverage, normals) = leaf::about(&around, self.slopes);
            if coverage.iter().all(|share| *share == u8::MAX) {
                coverage = Vec::new();
            }
            return NodeSamples {
                rows,
                columns,
                heights: SampleHeights::of(own(stored, &held, &part)),
                coverage,
                normals: SampleNormals::Parts(normals),
                ranges: Vec::new(),
                planes,
                changes: Vec::new(),
            };
        }
        let places = [0, 1].map(|axis| lattice.places(key, axis));
        let ground = |slopes: [f64; 2]| Ground { heights: &stored, places, slopes };
        let normals = match self.turn {
            Turn::Not => refined(&ground(self.kept), &normals, |normal| normal),
            Turn::By(steeper) => refined(&ground(self.kept), &normals, |normal| turned(normal, steeper)),
            Turn::Anew => of_heights(&ground(self.slopes)),
        };
        let up = MeanNormal::new([0.0, 0.0, 1.0]);
        let normals = match normals.iter().all(|normal| *normal == up) {
            true => SampleNormals::Up(part.len()),
            false => SampleNormals::Parts(normals),
        };
        let heights = SampleHeights::of(stored);
        NodeSamples { rows, columns, heights, coverage, normals, ranges: Vec::new(), planes, changes: Vec::new() }
    }

    /// A chunk that nothing is in.
    pub(super) fn nothing(&self, [rows, columns]: [usize; 2]) -> NodeSamples {
        let count = rows * columns;
        NodeSamples {
            rows,
            columns,
            heights: SampleHeights::Single(vec![f32::NAN; count]),
            coverage: vec![0; count],
            normals: SampleNormals::Up(count),
            ranges: Vec::new(),
            planes: vec![vec![0.0; count]; self.planes],
            changes: Vec::new(),
        }
    }
}

/// Makes heights of stored samples, as [`Scale::value`] does.
#[inline(always)]
fn scale(samples: &mut [f64], Scale { slope, intercept }: Scale) {
    samples.iter_mut().for_each(|sample| *sample = slope.mul_add(*sample, intercept));
}

/// A mean normal where all is so much steeper along columns and rows: turned, and as long as it was.
fn turned(normal: [f32; 3], [along_columns, along_rows]: [f32; 2]) -> [f32; 3] {
    let length = |[x, y, z]: [f32; 3]| (x * x + y * y + z * z).sqrt();
    let turned = [normal[0] * along_columns, normal[1] * along_rows, normal[2]];
    let grown = length(turned);
    if grown > 0.0 { turned.map(|part| part * (length(normal) / grown)) } else { normal }
}

/// The leaf's own of the heights that it holds.
fn own(heights: Vec<f64>, held: &Part, part: &Part) -> Vec<f64> {
    if held == part {
        return heights;
    }
    let first = (part.row - held.row) as usize * held.columns + (part.column - held.column) as usize;
    let mut own = Vec::with_capacity(part.len());
    for row in heights[first..].chunks(held.columns).take(part.rows) {
        own.extend_from_slice(&row[..part.columns]);
    }
    own
}
