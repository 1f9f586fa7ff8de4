//! Synthetic images and volumes, whose truth is known: a wave, an edge, a blob; many blobs; two noisy plateaus.
//!
//! A sample follows from the seed and its place alone, rows in any order, by functions that give the same bits on any machine.

use super::random::Random;
use crate::hierarchy::wavelet::sets::{direction, directions};
use crate::model::{Channel, Grid, SampleType};
use std::f64::consts::PI;

/// How many blobs there are in images and volumes of them.
const BLOBS: [u64; 2] = [48, 256];
/// Standard deviation of the one blob, samples.
const SIGMA: f64 = 16.0;
/// A blob ends so many standard deviations from its centre, where it is below a hundredth of a step of 8 bits.
const REACH: f64 = 5.0;
/// What there is between blobs.
const BACKGROUND: f64 = 12.0;
/// The values of the plateaus, and the standard deviation of their noise.
const PLATEAUS: [f64; 2] = [60.0, 180.0];
const NOISE: f64 = 5.0;
/// Keeps the random numbers of rows apart from those of blobs.
const ROWS: u64 = 1 << 40;

/// What a grid shows. Lengths are in samples, from the middle of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A plane wave of amplitude 100 around 128, whose frequency is in the middle of octave `level`: `0.75 / 2^level` cycles a sample.
    Wave {
        /// From 1 on: the level of the nodes that it needs.
        level: u32,
        /// Which of the directions of point sets, 4 of images and 13 of volumes.
        direction: usize,
        /// Degrees that it is turned by from there, in the plane of x and y.
        angle: f64,
    },
    /// A soft edge from 40 to 210, along a line (a plane through z) that rises by so many degrees from x to y, a little beside the middle.
    Edge {
        /// Degrees.
        angle: f64,
    },
    /// A Gaussian of height 200, 16 samples wide.
    Blob,
    /// Gaussians of any place, height and width on a dark ground: 48 in images, 256 in volumes.
    Blobs,
    /// Two halves of equal value with noise.
    Plateaus,
}

/// One of many blobs: its weights along each axis.
struct Blob {
    along: [Vec<f64>; 3],
    /// The first place along each axis that has a weight.
    first: [usize; 3],
}

/// A synthetic image or volume.
pub struct SyntheticGrid {
    kind: Kind,
    dimensions: usize,
    shape: [u64; 3],
    seed: u64,
    blobs: Vec<Blob>,
}

impl SyntheticGrid {
    /// A grid of so many samples along x, y and, of volumes, z. Directions beyond the last begin again.
    pub fn new(kind: Kind, dimensions: usize, shape: [u64; 3], seed: u64) -> SyntheticGrid {
        let blobs = if kind == Kind::Blobs {
            (0..BLOBS[usize::from(dimensions == 3)]).map(|n| blob(dimensions, shape, seed, n)).collect()
        } else {
            Vec::new()
        };
        SyntheticGrid { kind, dimensions, shape, seed, blobs }
    }

    /// 2 or 3.
    pub fn dimensions(&self) -> usize {
        self.dimensions
    }

    /// Samples along each axis.
    pub fn shape(&self) -> [u64; 3] {
        self.shape
    }

    /// Bytes where there are blobs or noise, singles where a sample is known exactly.
    pub fn sample_type(&self) -> SampleType {
        match self.kind {
            Kind::Blobs | Kind::Plateaus => SampleType::U8,
            _ => SampleType::F32,
        }
    }

    /// What its files say of it.
    pub fn grid(&self) -> Grid {
        let [width, height, _] = self.shape;
        match self.dimensions {
            2 => Grid::image([width, height], self.sample_type(), Channel::numbered(1)),
            _ => Grid::volume(self.shape, self.sample_type(), Channel::numbered(1)),
        }
    }

    /// Appends the samples of a row: number `y + z * height`, little-endian.
    pub fn row(&self, row: u64, out: &mut Vec<u8>) {
        let (y, z) = (row % self.shape[1], row / self.shape[1]);
        let from_middle = |at: u64, axis: usize| at as f64 - 0.5 * (self.shape[axis] as f64 - 1.0);
        let (y_off, z_off) = (from_middle(y, 1), if self.dimensions == 3 { from_middle(z, 2) } else { 0.0 });
        let single = |out: &mut Vec<u8>, value: f64| out.extend_from_slice(&(value as f32).to_le_bytes());
        // The cast saturates.
        let byte = |out: &mut Vec<u8>, value: f64| out.push((value + 0.5) as u8);
        let columns = 0..self.shape[0];
        match self.kind {
            Kind::Wave { level, direction: n, angle } => {
                let way = turned(direction(self.dimensions, n % directions(self.dimensions)).map(f64::from), angle);
                let step = 2.0 * PI * 0.75 * libm::exp2(-f64::from(level));
                for x in columns {
                    let along = way[0] * from_middle(x, 0) + way[1] * y_off + way[2] * z_off;
                    single(out, 128.0 + 100.0 * libm::cos(step * along));
                }
            }
            Kind::Edge { angle } => {
                let across = turned([1.0, 0.0, 0.0], angle + 90.0);
                for x in columns {
                    let distance = across[0] * from_middle(x, 0) + across[1] * y_off + 0.3;
                    single(out, 40.0 + 170.0 / (1.0 + libm::exp(-2.2 * distance)));
                }
            }
            Kind::Blob => {
                for x in columns {
                    let x_off = from_middle(x, 0);
                    let square = x_off * x_off + y_off * y_off + z_off * z_off;
                    single(out, 200.0 * libm::exp(-square / (2.0 * SIGMA * SIGMA)));
                }
            }
            Kind::Blobs => {
                let mut values = vec![BACKGROUND; self.shape[0] as usize];
                self.blobs.iter().for_each(|blob| blob.add(y, z, &mut values));
                values.iter().for_each(|value| byte(out, *value));
            }
            Kind::Plateaus => {
                let mut random = Random::new(self.seed, ROWS + row);
                for x in columns {
                    let plateau = PLATEAUS[usize::from(2 * x >= self.shape[0])];
                    byte(out, plateau + NOISE * random.normal());
                }
            }
        }
    }
}

/// A direction turned by degrees in the plane of x and y.
fn turned(way: [f64; 3], degrees: f64) -> [f64; 3] {
    let (sin, cos) = (libm::sin(degrees.to_radians()), libm::cos(degrees.to_radians()));
    [cos * way[0] - sin * way[1], sin * way[0] + cos * way[1], way[2]]
}

/// Blob `number`: its widths go from a 128th to a 12th of the sides' geometric mean, as many of each size as of any other.
fn blob(dimensions: usize, shape: [u64; 3], seed: u64, number: u64) -> Blob {
    let mut random = Random::new(seed, number);
    let side = libm::pow(shape.iter().map(|side| *side as f64).product(), 1.0 / dimensions as f64);
    let sigma = (side / 12.0 * libm::pow(12.0 / 128.0, random.uniform())).max(0.7);
    let height = 30.0 + 170.0 * random.uniform();
    let mut first = [0; 3];
    let along = std::array::from_fn(|axis| {
        if axis >= dimensions {
            return vec![1.0];
        }
        let side = shape[axis] as f64;
        let centre = random.uniform() * side - 0.5;
        let from = (centre - REACH * sigma).max(0.0);
        let end = (centre + REACH * sigma).min(side - 1.0);
        first[axis] = from as usize;
        let scale = if axis == 0 { height } else { 1.0 };
        let weight = |at: usize| {
            let off = (at as f64 - centre) / sigma;
            scale * libm::exp(-0.5 * off * off)
        };
        (from as usize..=end.max(from) as usize).map(weight).collect()
    });
    Blob { along, first }
}

impl Blob {
    /// Adds a row of the blob.
    fn add(&self, y: u64, z: u64, values: &mut [f64]) {
        let weight = |axis: usize, at: u64| -> Option<f64> {
            let at = usize::try_from(at).ok()?.checked_sub(self.first[axis])?;
            self.along[axis].get(at).copied()
        };
        let (Some(by_y), Some(by_z)) = (weight(1, y), weight(2, z)) else { return };
        let own = by_y * by_z;
        let values = values.get_mut(self.first[0]..).unwrap_or_default();
        values.iter_mut().zip(&self.along[0]).for_each(|(value, along)| *value += own * along);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn singles(grid: &SyntheticGrid) -> Vec<f32> {
        let mut bytes = Vec::new();
        let [_, height, depth] = grid.shape();
        (0..height * depth).for_each(|row| grid.row(row, &mut bytes));
        bytes.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect()
    }

    #[test]
    fn waves_have_the_period_of_their_octave() {
        for level in 1..4 {
            let kind = Kind::Wave { level, direction: 2, angle: 0.0 };
            let values = singles(&SyntheticGrid::new(kind, 2, [24, 64, 1], 1));
            // Three quarters of a wave over 2^level samples along y, nothing along x.
            let period = 4 << level;
            for y in 0..64 - period {
                for x in 0..24 {
                    assert!((values[y * 24 + x] - values[(y + period) * 24 + x]).abs() < 1e-3);
                    assert!((values[y * 24 + x] - values[y * 24]).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn blobs_and_edges_are_where_they_should_be() {
        let values = singles(&SyntheticGrid::new(Kind::Blob, 3, [33, 33, 33], 1));
        assert!((values[(16 * 33 + 16) * 33 + 16] - 200.0).abs() < 1e-4);
        assert!((values[(16 * 33 + 16) * 33 + 32] / 200.0 - (-0.5_f32).exp()).abs() < 1e-5);
        let values = singles(&SyntheticGrid::new(Kind::Edge { angle: 0.0 }, 2, [16, 64, 1], 1));
        assert!((values[0] - 40.0).abs() < 0.1 && (values[63 * 16] - 210.0).abs() < 0.1);
    }

    #[test]
    fn seeded_grids_are_the_same_and_others_differ() {
        for kind in [Kind::Blobs, Kind::Plateaus] {
            let rows = |seed: u64| {
                let grid = SyntheticGrid::new(kind, 3, [40, 20, 10], seed);
                let mut bytes = Vec::new();
                (0..200).for_each(|row| grid.row(row, &mut bytes));
                bytes
            };
            let own = rows(1);
            assert!(own.len() == 8000 && own == rows(1) && own != rows(2));
            let (least, most) = own.iter().fold((255, 0), |(least, most), v| (*v.min(&least), *v.max(&most)));
            assert!(least < 60 && most > 120, "{least} {most}");
        }
    }
}
