//! The field of particles at the points of bricks, and which bricks and blocks a surface may pass at all.
//!
//! In a box a sum of kernels is at most that of their values at the points of the box nearest to each particle, and at
//! least that of the farthest ones, since kernels fall with the distance; a mean is between the values of the particles
//! whose kernels reach the box. Where that says on which side of the surface the whole box is, the field is not summed
//! up there.

use super::particles::{Leaf, Particle, Particles};
use super::periodic::PeriodicSpace;
use crate::cpu::mesh::{BEFORE, BLOCK, Faces, Field, Lattice, Samples};
use crate::explore::error::ExploreError;
use crate::model::{Bounds, Kernel};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// Parts along each edge of a box whose limits are found together.
const PARTS: usize = 8;

/// Rounding of a sum, relative to it.
const ROUNDING: f64 = 1e-9;

/// The bricks that a surface may pass.
pub(super) struct Plan {
    /// The first cell of each.
    pub bricks: Vec<[u32; 3]>,
    /// The leaves that reach a cube of bricks, by the cube's first cell.
    leaves: HashMap<[u32; 3], Vec<u32>>,
}

/// Where the surface is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Level {
    /// Where the density is this (F12 equation 3.1).
    Density(f64),
    /// Where the mean of a column is `isovalue` (the sum of F12's equation 3.2 by that of its weights `m / rho`), and where
    /// that is no longer known, since the sum of weights falls below `least_filled`.
    Mean { isovalue: f64, least_filled: f64 },
}

/// The density of particles, or the mean of a column.
pub(super) struct ParticleField<'a> {
    pub particles: &'a Particles<'a>,
    pub leaves: &'a [Leaf],
    pub lattice: Lattice,
    pub level: Level,
    /// Cells along an edge of a brick.
    pub side: usize,
    pub has_attribute: bool,
    /// The box that the field goes round.
    pub periodic: Option<PeriodicSpace>,
    /// What becomes of the surface at that box's faces.
    pub faces: Faces,
}

/// Between what the field is in each part of a box.
struct Limits {
    /// Of the sum of weights.
    upper: Vec<f64>,
    lower: Vec<f64>,
    /// The smallest and the largest value of the particles that reach each part; empty where the field is their density.
    values: Vec<[f64; 2]>,
}

impl ParticleField<'_> {
    /// Which bricks to look into; `None` where there are more than `most`.
    pub fn plan(&self, most: u64) -> Result<Option<Plan>, ExploreError> {
        let mut plan = Plan { bricks: Vec::new(), leaves: HashMap::new() };
        let longest = self.lattice.cells.into_iter().max().unwrap_or(0) as usize;
        let mut part = self.side;
        while part * PARTS < longest {
            part *= PARTS;
        }
        let all: Vec<u32> = (0..self.leaves.len() as u32).collect();
        Ok(self.divide([0; 3], part, all, most, &mut plan)?.then_some(plan))
    }

    /// Looks into a cube of [`PARTS`] cubed parts with `part` cells along each edge. False where there are too many
    /// bricks.
    fn divide(
        &self,
        corner: [u32; 3],
        part: usize,
        leaves: Vec<u32>,
        most: u64,
        plan: &mut Plan,
    ) -> Result<bool, ExploreError> {
        self.particles.go_on()?;
        let share = leaves.len().div_ceil(4 * rayon::current_num_threads()).max(8);
        let found: Vec<Result<Limits, ExploreError>> =
            leaves.par_chunks(share).map(|leaves| self.limits(leaves, corner, part, PARTS)).collect();
        let mut limits = self.no_limits(PARTS);
        for part in found {
            limits.add(&part?);
        }
        let mut bricks = Vec::new();
        for index in 0..PARTS * PARTS * PARTS {
            let place = [index % PARTS, index / PARTS % PARTS, index / PARTS / PARTS];
            let first = [0, 1, 2].map(|axis| corner[axis] as usize + place[axis] * part);
            let is_in = (0..3).all(|axis| first[axis] < self.lattice.cells[axis] as usize);
            let first = first.map(|cell| cell as u32);
            if !is_in || !limits.is_active(index, self.level, self.is_at_face(first, part)) {
                continue;
            }
            if part == self.side {
                bricks.push(first);
                continue;
            }
            // The points around a brick are summed up with it.
            let bounds = self.bounds(first, 1 + BEFORE as i64, part);
            let below = leaves.iter().copied().filter(|&leaf| self.reaches(leaf, &bounds)).collect();
            if !self.divide(first, part / PARTS, below, most, plan)? {
                return Ok(false);
            }
        }
        if !bricks.is_empty() {
            plan.bricks.extend(bricks);
            plan.leaves.insert(corner, leaves);
        }
        Ok(plan.bricks.len() as u64 <= most)
    }

    /// The box of cells from `before` points before `first` to as many behind `side` cells.
    fn bounds(&self, first: [u32; 3], before: i64, side: usize) -> Bounds {
        let point = |offset: i64| {
            DVec3::from_array([0, 1, 2].map(|axis| self.lattice.coordinate(axis, i64::from(first[axis]) + offset)))
        };
        Bounds { min: point(-before), max: point(side as i64 + before) }
    }

    /// Between what the field of these leaves is in each of `parts` cubed parts with `part` cells along each edge.
    fn limits(&self, leaves: &[u32], corner: [u32; 3], part: usize, parts: usize) -> Result<Limits, ExploreError> {
        let kernel = self.particles.kernel();
        let (edge, origin) = (self.lattice.spacing * part as f64, self.bounds(corner, 0, part).min);
        let mut limits = self.no_limits(parts);
        let leaves = leaves.iter().map(|&leaf| &self.leaves[leaf as usize]);
        let bounds = Bounds { min: origin, max: origin + edge * parts as f64 };
        self.particles.each(leaves, |particle| match self.periodic {
            None => limits.take(particle, kernel, origin, edge, parts),
            Some(periodic) => {
                periodic.each_image(particle, &bounds, |image| limits.take(image, kernel, origin, edge, parts));
            }
        })?;
        Ok(limits)
    }

    /// Those of no particles.
    fn no_limits(&self, parts: usize) -> Limits {
        let all = parts * parts * parts;
        let values = match self.level {
            Level::Density(_) => Vec::new(),
            Level::Mean { .. } => vec![[f64::INFINITY, f64::NEG_INFINITY]; all],
        };
        Limits { upper: vec![0.0; all], lower: vec![0.0; all], values }
    }

    /// The leaves that reach a brick and the points around it, in their order.
    fn leaves_of(&self, plan: &Plan, corner: [u32; 3]) -> Vec<u32> {
        let cube = (self.side * PARTS) as u32;
        let Some(leaves) = plan.leaves.get(&corner.map(|cell| cell / cube * cube)) else { return Vec::new() };
        let bounds = self.bounds(corner, 1 + BEFORE as i64, self.side);
        leaves.iter().copied().filter(|&leaf| self.reaches(leaf, &bounds)).collect()
    }

    /// Whether a leaf's particles may reach a box.
    fn reaches(&self, leaf: u32, bounds: &Bounds) -> bool {
        let leaf = &self.leaves[leaf as usize];
        self.periodic.map_or_else(|| leaf.reaches(bounds), |periodic| periodic.reaches(leaf, bounds))
    }

    /// Whether a cube of cells is at a face of the lattice that cuts off what is above the isovalue there.
    fn is_at_face(&self, first: [u32; 3], side: usize) -> bool {
        let is_at = |axis: usize| first[axis] == 0 || first[axis] as usize + side >= self.lattice.cells[axis] as usize;
        self.faces != Faces::Open && (0..3).any(is_at)
    }
}

impl Limits {
    fn add(&mut self, other: &Limits) {
        self.upper.iter_mut().zip(&other.upper).for_each(|(sum, part)| *sum += part);
        self.lower.iter_mut().zip(&other.lower).for_each(|(sum, part)| *sum += part);
        self.values.iter_mut().zip(&other.values).for_each(|(ends, [low, high])| {
            *ends = [ends[0].min(*low), ends[1].max(*high)];
        });
    }

    /// Whether a part may have points on both sides of the surface, or within it at a face that cuts it off.
    fn is_active(&self, index: usize, level: Level, is_at_face: bool) -> bool {
        let (upper, lower) = (self.upper[index] * (1.0 + ROUNDING), self.lower[index] * (1.0 - ROUNDING));
        let (may_be_within, may_be_without) = match level {
            Level::Density(isovalue) => (upper >= isovalue, lower < isovalue),
            Level::Mean { isovalue, least_filled } => {
                let [smallest, largest] = self.values[index];
                let rounding = ROUNDING * smallest.abs().max(largest.abs());
                let (is_high, is_low) = (largest + rounding >= isovalue, smallest - rounding < isovalue);
                (upper >= least_filled && is_high, lower < least_filled || is_low)
            }
        };
        may_be_within && (may_be_without || is_at_face)
    }

    /// Adds a particle to the parts that its kernel reaches. Lengths here are in units of a part's edge.
    fn take(&mut self, particle: &Particle, kernel: Kernel, origin: DVec3, edge: f64, parts: usize) {
        let place = (particle.position - origin) / edge;
        let reach = particle.smoothing_length / edge;
        let (mut first, mut last) = ([0_usize; 3], [0_usize; 3]);
        // Squares of the smallest and the largest distance from each row of parts, relative to the reach.
        let (mut nearest, mut farthest) = ([[0.0; PARTS]; 3], [[0.0; PARTS]; 3]);
        for axis in 0..3 {
            let (low, high) = ((place[axis] - reach).floor(), (place[axis] + reach).floor());
            if high < 0.0 || low >= parts as f64 {
                return;
            }
            first[axis] = low.max(0.0) as usize;
            last[axis] = high.min((parts - 1) as f64) as usize;
            for i in first[axis]..=last[axis] {
                let (from, to) = (i as f64 - place[axis], (i + 1) as f64 - place[axis]);
                let near = from.max(-to).max(0.0) / reach;
                let far = from.abs().max(to.abs()) / reach;
                nearest[axis][i] = near * near;
                farthest[axis][i] = far * far;
            }
        }
        let weight = particle.weight / particle.smoothing_length.powi(3);
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let near = nearest[2][z] + nearest[1][y];
                let far = farthest[2][z] + farthest[1][y];
                for x in first[0]..=last[0] {
                    let index = (z * parts + y) * parts + x;
                    let (near, far) = (near + nearest[0][x], far + farthest[0][x]);
                    if near < 1.0 {
                        self.upper[index] += weight * kernel.value(near.sqrt());
                        if let Some(ends) = self.values.get_mut(index) {
                            *ends = [ends[0].min(particle.quantity), ends[1].max(particle.quantity)];
                        }
                    }
                    if far < 1.0 {
                        self.lower[index] += weight * kernel.value(far.sqrt());
                    }
                }
            }
        }
    }
}

/// A field with the bricks that are looked into.
pub(super) struct Planned<'a> {
    pub field: &'a ParticleField<'a>,
    pub plan: &'a Plan,
}

impl Field for Planned<'_> {
    type Error = ExploreError;

    fn has_attribute(&self) -> bool {
        self.field.has_attribute
    }

    fn least_filled(&self) -> Option<f64> {
        match self.field.level {
            Level::Density(_) => None,
            Level::Mean { least_filled, .. } => Some(least_filled),
        }
    }

    fn faces(&self) -> Faces {
        self.field.faces
    }

    fn sample(&self, corner: [u32; 3], samples: &mut Samples) -> Result<(), ExploreError> {
        let ParticleField { particles, leaves: all, lattice, level, side, has_attribute, periodic, .. } = *self.field;
        particles.go_on()?;
        let leaves = self.field.leaves_of(self.plan, corner);
        let limits = self.field.limits(&leaves, corner, BLOCK, side / BLOCK)?;
        let blocks = samples.blocks();
        for (index, active) in samples.active.iter_mut().enumerate() {
            let place = [index % blocks, index / blocks % blocks, index / blocks / blocks];
            let first = [0, 1, 2].map(|axis| corner[axis] + (place[axis] * BLOCK) as u32);
            *active = limits.is_active(index, level, self.field.is_at_face(first, BLOCK));
        }
        let spans = Spans::of(samples);
        if spans.are_empty() {
            return Ok(());
        }
        let row = samples.row();
        let axes = [0, 1, 2].map(|axis| Axis::of(&lattice, axis, corner[axis], row, periodic));
        let (kernel, is_mean) = (particles.kernel(), matches!(level, Level::Mean { .. }));
        let (mut along_x, mut along_y, mut along_z) = (Vec::new(), Vec::new(), Vec::new());
        particles.each(leaves.iter().map(|&leaf| &all[leaf as usize]), |particle| {
            let inverse = 1.0 / particle.smoothing_length;
            let weight = particle.weight * inverse * inverse * inverse;
            for (axis, along) in [&mut along_x, &mut along_y, &mut along_z].into_iter().enumerate() {
                axes[axis].reached(particle.position[axis], particle.smoothing_length, along);
            }
            for &(z, in_z) in &along_z {
                for &(y, in_y) in &along_y {
                    let in_row = in_z + in_y;
                    if in_row >= 1.0 {
                        continue;
                    }
                    let span = &spans.rows[z * row + y];
                    let start = samples.index([0, y, z]);
                    let after = along_x.partition_point(|(x, _)| *x < span.start);
                    for &(x, in_x) in along_x[after..].iter().take_while(|(x, _)| *x < span.end) {
                        let squared = in_row + in_x;
                        if squared < 1.0 {
                            let share = weight * kernel.value(squared.sqrt());
                            if is_mean {
                                samples.values[start + x] += particle.quantity * share;
                                samples.filled[start + x] += share;
                            } else {
                                samples.values[start + x] += share;
                            }
                            if has_attribute {
                                samples.weighted[start + x] += particle.attribute * share;
                            }
                        }
                    }
                }
            }
        })?;
        // Where there is nothing a mean has no value.
        samples.values.iter_mut().zip(&samples.filled).for_each(|(value, filled)| *value /= filled);
        Ok(())
    }
}

/// The points of a brick along an axis.
struct Axis {
    /// Where they are; in a periodic box the point of the box that each is.
    coordinates: Vec<f64>,
    /// Where the first one is, on from the others even where that is beyond a periodic box.
    start: f64,
    spacing: f64,
    periodic: Option<PeriodicSpace>,
}

impl Axis {
    fn of(lattice: &Lattice, axis: usize, corner: u32, row: usize, periodic: Option<PeriodicSpace>) -> Axis {
        let first = i64::from(corner) - BEFORE as i64;
        let last = i64::from(lattice.cells[axis]);
        let coordinate = |point: i64| match periodic {
            // The last point is the first one again.
            Some(_) => lattice.coordinate(axis, point.rem_euclid(last)),
            None => lattice.coordinate(axis, point),
        };
        let end = match periodic {
            // Beyond the point behind the last nobody looks.
            Some(_) => (first + row as i64).min(last + 1 + BEFORE as i64),
            None => first + row as i64,
        };
        let coordinates = (first..end).map(coordinate).collect();
        Axis { coordinates, start: lattice.coordinate(axis, first), spacing: lattice.spacing, periodic }
    }

    /// Collects the points that a kernel around `center` reaches, in order, and the square of each one's distance
    /// relative to the kernel's radius, below 1.
    fn reached(&self, center: f64, radius: f64, into: &mut Vec<(usize, f64)>) {
        into.clear();
        let (inverse, count) = (1.0 / radius, self.coordinates.len());
        let mut done = 0;
        let mut add = |shift: f64| {
            // One more on each side, so that rounding here decides nothing: distances do.
            let low = ((center + shift - radius - self.start) / self.spacing).floor();
            let high = ((center + shift + radius - self.start) / self.spacing).ceil() + 1.0;
            let (low, high) = (low.clamp(0.0, count as f64) as usize, high.clamp(0.0, count as f64) as usize);
            for point in low.max(done)..high {
                let difference = self.coordinates[point] - center;
                let difference = self.periodic.map_or(difference, |periodic| periodic.nearest(difference));
                let distance = difference * inverse;
                if distance * distance < 1.0 {
                    into.push((point, distance * distance));
                }
            }
            done = done.max(high);
        };
        match self.periodic {
            None => add(0.0),
            Some(periodic) => periodic.shifts().into_iter().for_each(add),
        }
    }
}

/// For each row of points along x the part that active blocks need, and the points beside them.
struct Spans {
    rows: Vec<std::ops::Range<usize>>,
}

impl Spans {
    fn of(samples: &Samples) -> Spans {
        let (row, blocks) = (samples.row(), samples.blocks());
        let mut rows = vec![row..0; row * row];
        for (index, _) in samples.active.iter().enumerate().filter(|(_, active)| **active) {
            let [x, y, z] =
                [index % blocks, index / blocks % blocks, index / blocks / blocks].map(|block| block * BLOCK);
            // A block's own points and those before and behind.
            let points = 2 * BEFORE + BLOCK + 1;
            for z in z..z + points {
                for span in &mut rows[z * row + y..z * row + y + points] {
                    *span = span.start.min(x)..span.end.max(x + points);
                }
            }
        }
        Spans { rows }
    }

    fn are_empty(&self) -> bool {
        self.rows.iter().all(std::ops::Range::is_empty)
    }
}
