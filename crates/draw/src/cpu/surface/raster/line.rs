//! Samples of a chunk's row in the picture, many at a time: what a column and a row add to a place is worked out once, by the same operations as
//! [`Vantage::relative`](super::super::placed::Vantage::relative) and in the same order, so that every bit is the same.

use super::super::stitch::Mesh;
use super::{Corner, FURTHEST, ONE, Raster, Spot};
use glam::DVec3;
use std::ops::Range;

/// From so far on numbers are not rounded by adding a large one: twice that many parts of pixels are no picture.
const LARGE: f64 = (1_i64 << 51) as f64;
/// Added to this a number below [`LARGE`] is rounded, and stands in the lowest bits.
const ROUNDS: f64 = 1.5 * (1_i64 << 52) as f64;

/// A place in parts of pixels.
#[inline(always)]
pub(super) fn part(pixels: f64) -> i64 {
    let scaled = pixels * ONE as f64;
    match scaled.abs() < LARGE {
        true => rounded(scaled),
        false => scaled.clamp(-FURTHEST, FURTHEST) as i64,
    }
}

#[inline(always)]
fn rounded(scaled: f64) -> i64 {
    ((scaled + ROUNDS).to_bits() as i64).wrapping_sub(ROUNDS.to_bits() as i64)
}

/// Corners of some columns of a row.
#[derive(Default)]
pub(super) struct Line {
    /// From the eye: right, up, forward.
    camera: [Vec<f64>; 3],
    place: [Vec<i64>; 2],
    linear: Vec<f64>,
    /// Heights, and then `z` from the eye.
    heights: Vec<f64>,
}

/// What the columns of a chunk of a flat field add to places from the eye: right, up, forward.
#[derive(Default)]
pub(super) struct Across([Vec<f64>; 3]);

impl Across {
    /// Of some of a chunk's columns.
    pub(super) fn fill(&mut self, raster: &Raster<'_>, columns: &[u64]) {
        let ways = raster.ways();
        for (own, way) in self.0.iter_mut().zip(ways) {
            own.clear();
            own.extend(columns.iter().map(|column| raster.vantage.x(*column) * way.x));
        }
    }
}

impl Line {
    /// A corner; `index` counts from the line's first column.
    pub(super) fn corner(&self, index: usize) -> Corner {
        let camera = DVec3::new(self.camera[0][index], self.camera[1][index], self.camera[2][index]);
        Corner { camera, spot: self.spot(index) }
    }

    /// Where it is, and how deep.
    #[inline(always)]
    pub(super) fn spot(&self, index: usize) -> Spot {
        Spot { place: self.place_of(index), linear: self.linear[index] }
    }

    /// Where it is, parts of pixels.
    #[inline(always)]
    pub(super) fn place_of(&self, index: usize) -> [i64; 2] {
        [self.place[0][index], self.place[1][index]]
    }

    /// How far before the eye the corners are; NaN where there is none.
    pub(super) fn depths(&self) -> &[f64] {
        &self.camera[2]
    }

    /// Puts a chunk's samples in the picture.
    pub(super) fn fill(
        &mut self,
        raster: &Raster<'_>,
        mesh: &Mesh,
        row: usize,
        columns: &Range<usize>,
        across: &Across,
    ) {
        let count = columns.len();
        self.heights.resize(count, 0.0);
        mesh.surface_line(row, columns, &mut self.heights);
        self.camera.iter_mut().for_each(|part| part.resize(count, 0.0));
        self.place.iter_mut().for_each(|part| part.resize(count, 0));
        self.linear.resize(count, 0.0);
        match raster.vantage.is_flat() {
            true => self.place_flat(raster, mesh.rows[row], across),
            false => self.place_curved(raster, mesh.rows[row], &mesh.columns[columns.clone()]),
        }
        self.project(raster);
    }

    fn place_flat(&mut self, raster: &Raster<'_>, row: u64, across: &Across) {
        let y = raster.vantage.y(row);
        self.heights.iter_mut().for_each(|height| *height = raster.vantage.z(*height));
        for ((own, across), way) in self.camera.iter_mut().zip(&across.0).zip(raster.ways()) {
            let (down, up) = (y * way.y, way.z);
            for ((own, across), z) in own.iter_mut().zip(across).zip(&self.heights) {
                *own = (across + down) + z * up;
            }
        }
    }

    fn place_curved(&mut self, raster: &Raster<'_>, row: u64, columns: &[u64]) {
        let ways = raster.ways();
        for (index, (column, height)) in columns.iter().zip(&self.heights).enumerate() {
            let relative = raster.vantage.relative(row, *column, *height);
            for (own, way) in self.camera.iter_mut().zip(ways) {
                own[index] = relative.dot(way);
            }
        }
    }

    fn project(&mut self, raster: &Raster<'_>) {
        let ([x, y], [right, down], focal) = (&mut self.place, raster.middle, raster.focal);
        let count = self.linear.len();
        let (x, y, linear) = (&mut x[..count], &mut y[..count], &mut self.linear[..count]);
        let [across, up, ahead] = [0, 1, 2].map(|k| &self.camera[k][..count]);
        let mut is_near = true;
        for index in 0..count {
            let scale = if raster.is_perspective { focal / ahead[index] } else { focal };
            let to_right = (right + across[index] * scale) * ONE as f64;
            let downwards = (down - up[index] * scale) * ONE as f64;
            is_near &= (to_right.abs() < LARGE) & (downwards.abs() < LARGE);
            x[index] = rounded(to_right);
            y[index] = rounded(downwards);
            linear[index] = if raster.is_perspective { 1.0 / ahead[index] } else { ahead[index] };
        }
        if !is_near {
            for index in 0..count {
                let scale = if raster.is_perspective { focal / ahead[index] } else { focal };
                x[index] = part(right + across[index] * scale);
                y[index] = part(down - up[index] * scale);
            }
        }
    }
}
