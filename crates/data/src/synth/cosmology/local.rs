//! Density and velocity dispersion around any point of the box, from where its cells have gone.

use super::field::Field;
use super::haloes::{Catalogue, UNCLAIMED};
use super::nfw::{Nfw, Profile, concentration};
use super::power::MEAN_DENSITY;
use crate::synth::random::Random;
use rayon::prelude::*;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};

/// Units of mass in a cell of mean density. Whole numbers add up to the same sum in any order.
const UNITS: f64 = 4096.0;
/// Most points that a halo is spread over.
const POINTS: f64 = 4096.0;

/// The grids.
pub struct Local {
    size: usize,
    /// Density in units of the mean.
    density: Vec<f32>,
    coarse: usize,
    /// Velocity dispersion along a line, km/s, on a grid of half as many cells along an edge.
    dispersion: Vec<f32>,
}

impl Local {
    /// The grids of a box whose cells hold `filling` of the mean density where no halo has claimed them, with haloes of
    /// particles of `mass` Msun/h.
    pub fn new(seed: u64, field: &Field, catalogue: &Catalogue, profile: &Profile, filling: f64, mass: f64) -> Local {
        let size = field.size;
        let coarse = size / 2;
        let cells: Vec<AtomicU32> = (0..size * size * size).map(|_| AtomicU32::new(0)).collect();
        // Number, three velocities and their squares.
        let moments: Vec<[AtomicI64; 5]> = (0..coarse * coarse * coarse).map(|_| Default::default()).collect();
        let speed = super::velocity_per_length();
        let cell = field.cell();
        field.displacement.par_chunks(size).enumerate().for_each(|(row, displacements)| {
            for (x, psi) in displacements.iter().enumerate() {
                let at = row * size + x;
                let place: [f64; 3] =
                    std::array::from_fn(|axis| field.corner(at)[axis] as f64 + f64::from(psi[axis]) / cell);
                let weight = f64::from(catalogue.remaining[at]) / f64::from(UNCLAIMED) * filling * UNITS;
                deposit(&cells, size, place, weight);
                let moment = &moments[nearest(place.map(|x| 0.5 * x), coarse)];
                let velocity = psi.map(|x| (f64::from(x) * speed * 16.0) as i64);
                moment[0].fetch_add(1, Ordering::Relaxed);
                for (sum, v) in moment[1..4].iter().zip(velocity) {
                    sum.fetch_add(v, Ordering::Relaxed);
                }
                moment[4].fetch_add(velocity.iter().map(|v| v * v).sum(), Ordering::Relaxed);
            }
        });
        let cell_mass = MEAN_DENSITY * cell * cell * cell;
        (0..catalogue.haloes.len()).into_par_iter().for_each(|index| {
            let halo = &catalogue.haloes[index];
            let particles = catalogue.particles_of(index) as f64;
            let share = particles * mass / cell_mass;
            let points = (0.25 * share).ceil().clamp(1.0, POINTS);
            let mut random = Random::new(seed ^ 0x706f_696e, index as u64);
            let whole = particles.max(1.0) * mass;
            let nfw = Nfw::new(profile, whole, concentration(whole), particles.max(1.0), super::NEIGHBOURS);
            for _ in 0..points as u64 {
                let direction = random.direction();
                let radius = nfw.radius(random.uniform());
                let place =
                    std::array::from_fn(|axis| (f64::from(halo.center[axis]) + radius * direction[axis]) / cell);
                deposit(&cells, size, place, share / points * UNITS);
            }
        });
        let density = cells.par_iter().map(|sum| (f64::from(sum.load(Ordering::Relaxed)) / UNITS) as f32).collect();
        let dispersion = moments.par_iter().map(|moment| {
            let [number, x, y, z, square] = moment.each_ref().map(|sum| sum.load(Ordering::Relaxed) as f64);
            let number = number.max(1.0);
            let variance = square / number - (x * x + y * y + z * z) / (number * number);
            ((variance.max(0.0) / 3.0).sqrt() / 16.0) as f32
        });
        Local { size, density, coarse, dispersion: dispersion.collect() }
    }

    /// Density in units of the mean, at a place in cells.
    pub fn density(&self, place: [f64; 3]) -> f64 {
        trilinear(&self.density, self.size, place)
    }

    /// Velocity dispersion along a line within about two cells, km/s.
    pub fn dispersion(&self, place: [f64; 3]) -> f64 {
        trilinear(&self.dispersion, self.coarse, place.map(|x| 0.5 * x))
    }
}

/// The cell of a coordinate, the next one, and how far it is on the way between them, in the periodic box.
pub fn between(x: f64, size: usize) -> (usize, usize, f64) {
    let truncated = x as i64;
    let floor = truncated - i64::from(truncated as f64 > x);
    // The size is a power of two.
    let cell = (floor & (size as i64 - 1)) as usize;
    (cell, (cell + 1) & (size - 1), x - floor as f64)
}

/// The eight corners around a place and their weights.
pub fn corners(place: [f64; 3], size: usize) -> [(usize, f64); 8] {
    let [(x0, x1, x), (y0, y1, y), (z0, z1, z)] = place.map(|x| between(x, size));
    let rows = [(z0, y0, (1.0 - z) * (1.0 - y)), (z0, y1, (1.0 - z) * y), (z1, y0, z * (1.0 - y)), (z1, y1, z * y)];
    std::array::from_fn(|corner| {
        let (z, y, weight) = rows[corner / 2];
        let (column, part) = if corner % 2 == 0 { (x0, 1.0 - x) } else { (x1, x) };
        ((z * size + y) * size + column, weight * part)
    })
}

fn trilinear(values: &[f32], size: usize, place: [f64; 3]) -> f64 {
    corners(place, size).iter().map(|&(at, weight)| weight * f64::from(values[at])).sum()
}

fn deposit(cells: &[AtomicU32], size: usize, place: [f64; 3], mass: f64) {
    for (at, weight) in corners(place, size) {
        cells[at].fetch_add((weight * mass + 0.5) as u32, Ordering::Relaxed);
    }
}

fn nearest(place: [f64; 3], size: usize) -> usize {
    let [x, y, z] = place.map(|x| between(x + 0.5, size).0);
    (z * size + y) * size + x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_surround_a_place() {
        let found = corners([15.25, 3.0, 7.5], 16);
        assert_eq!(found.iter().map(|(_, weight)| weight).sum::<f64>(), 1.0);
        assert_eq!(found[0], ((7 * 16 + 3) * 16 + 15, 0.375));
        assert_eq!(found[1], ((7 * 16 + 3) * 16, 0.125));
        let values: Vec<f32> = (0..4096).map(|at| (at / 256) as f32).collect();
        assert_eq!(trilinear(&values, 16, [1.2, 3.4, 7.5]), 7.5);
        // Beyond the edge the box begins again.
        assert_eq!(corners([-0.75, 3.0, 23.5], 16), found);
    }
}
