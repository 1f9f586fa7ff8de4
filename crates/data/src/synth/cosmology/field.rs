//! The linear density of a periodic box and the displacements that follow from it.
//!
//! Every mode follows from the seed and its wave vector alone, so that boxes of any number of particles hold the same
//! universe, with more or fewer of its small modes. Displacements are Zel'dovich's on large scales, `psi = i k delta /
//! k^2`; on small scales, where these would overshoot, they are those of spherical collapse: `div psi = 3 (sqrt(1 - 2/3
//! delta) - 1)`, at least -3 (Kitaura and Hess 2013; Bernardeau 1994), which lets filaments and knots stay thin.

use super::local::{between, corners};
use super::power::Power;
use crate::model::fft::{ComplexCube, Direction};
use crate::model::mixing::mix_bits;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Below this length Zel'dovich's displacements give way to those of spherical collapse, Mpc/h.
const COLLAPSE_SCALE: f64 = 3.0;
/// Smoothing of the density that collapses, Mpc/h.
const SMOOTHING: f64 = 0.5;
/// Smoothing of the density in which the heaviest haloes are looked for, Mpc/h.
pub const PEAK_SCALE: f64 = 4.0;

/// The box after its linear density has moved it.
pub struct Field {
    /// Cells along an edge.
    pub size: usize,
    /// Edge of the box, Mpc/h.
    pub edge: f64,
    /// Displacement of the corner `x, y, z` of every cell, index `(z * size + y) * size + x`, Mpc/h.
    pub displacement: Vec<[f32; 3]>,
    /// Linear density contrast, smoothed a little.
    pub contrast: Vec<f32>,
    /// Local maxima of the contrast at [`PEAK_SCALE`], highest first.
    pub peaks: Vec<u32>,
}

/// Half of the Fourier transform of a real field: `kx >= 0`.
struct Spectrum {
    size: usize,
    edge: f64,
    values: Vec<[f32; 2]>,
}

impl Field {
    /// The field of a seed on `size` cells along an edge of `edge` Mpc/h; `size` is a power of two from 16 to 1024.
    pub fn new(seed: u64, size: usize, edge: f64, power: &Power) -> Field {
        let mut spectrum = Spectrum::new(seed, size, edge, power);
        let mut cube = ComplexCube::new(size);
        let smooth = |k2: f64, scale: f64| libm::exp(-0.5 * k2 * scale * scale) as f32;
        // Two real fields in one transform: the second times i.
        let smoothings = |k2: f64| [smooth(k2, SMOOTHING), smooth(k2, PEAK_SCALE)];
        spectrum.fill(&mut cube, smoothings, |[re, im], _, [a, b]| [a * re - b * im, a * im + b * re]);
        cube.transform(Direction::Inverse);
        let peaks = maxima(size, &cube.im);
        let contrast = cube.re.clone();
        cube.re.par_iter_mut().for_each(|value| *value = collapse(*value));
        cube.im.par_iter_mut().for_each(|value| *value = 0.0);
        cube.transform(Direction::Forward);
        spectrum.mix(&cube, |k2| smooth(k2, COLLAPSE_SCALE));
        let mut displacement = vec![[0f32; 3]; size * size * size];
        // psi = -i k D / k^2 for D = div psi; x and y in one transform, z alone.
        let inverse_square = |k2: f64| [if k2 > 0.0 { (1.0 / k2) as f32 } else { 0.0 }, 0.0];
        spectrum.fill(&mut cube, inverse_square, |[re, im], k, [f, _]| {
            let psi = [im * f, -re * f];
            [psi[0] * k[0] - psi[1] * k[1], psi[1] * k[0] + psi[0] * k[1]]
        });
        cube.transform(Direction::Inverse);
        displacement.par_iter_mut().zip(cube.re.par_iter().zip(&cube.im)).for_each(|(psi, (x, y))| {
            (psi[0], psi[1]) = (*x, *y);
        });
        spectrum.fill(&mut cube, inverse_square, |[re, im], k, [f, _]| [im * f * k[2], -re * f * k[2]]);
        cube.transform(Direction::Inverse);
        displacement.par_iter_mut().zip(&cube.re).for_each(|(psi, z)| psi[2] = *z);
        Field { size, edge, displacement, contrast, peaks }
    }

    /// Edge of a cell, Mpc/h.
    pub fn cell(&self) -> f64 {
        self.edge / self.size as f64
    }

    /// Place of a cell's corner, in cells.
    pub fn corner(&self, at: usize) -> [usize; 3] {
        // The size is a power of two.
        let (bits, mask) = (self.size.trailing_zeros(), self.size - 1);
        [at & mask, at >> bits & mask, at >> (2 * bits)]
    }

    /// How much denser what is at a cell's corner gets, where its stream is alone: by differences to the next corners.
    pub fn compression(&self, at: usize) -> f32 {
        let size = self.size;
        let [x, y, z] = self.corner(at);
        let next = |x: usize| (x + 1) & (size - 1);
        let along = [(z * size + y) * size + next(x), (z * size + next(y)) * size + x, (next(z) * size + y) * size + x];
        let per_cell = (1.0 / self.cell()) as f32;
        let here = self.displacement[at];
        let [a, b, c] = along.map(|at| {
            let there = self.displacement[at];
            [0, 1, 2].map(|i| (there[i] - here[i]) * per_cell)
        });
        let (xx, yy, zz) = (1.0 + a[0], 1.0 + b[1], 1.0 + c[2]);
        let volume = xx * (yy * zz - b[2] * c[1]) - a[1] * (b[0] * zz - b[2] * c[0]) + a[2] * (b[0] * c[1] - yy * c[0]);
        1.0 / volume.abs().max(1e-3)
    }

    /// Displacement between the corners of the cells, at a place in cells, and its gradient: `gradient[j][i]` is the
    /// change of component `i` along axis `j`, a pure number.
    pub fn displacement_at(&self, place: [f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        let [x, y, z] = place.map(|x| between(x, self.size).2);
        let psi = corners(place, self.size).map(|(at, _)| self.displacement[at].map(f64::from));
        let mix =
            |a: [f64; 3], b: [f64; 3], part: f64| -> [f64; 3] { std::array::from_fn(|i| a[i] + part * (b[i] - a[i])) };
        let slope = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| (b[i] - a[i]) / self.cell()) };
        let along_x = [0, 2, 4, 6].map(|corner| mix(psi[corner], psi[corner + 1], x));
        let along_xy = [mix(along_x[0], along_x[1], y), mix(along_x[2], along_x[3], y)];
        let change_x = [0, 2, 4, 6].map(|corner| slope(psi[corner], psi[corner + 1]));
        let change_x = mix(mix(change_x[0], change_x[1], y), mix(change_x[2], change_x[3], y), z);
        let change_y = mix(slope(along_x[0], along_x[1]), slope(along_x[2], along_x[3]), z);
        (mix(along_xy[0], along_xy[1], z), [change_x, change_y, slope(along_xy[0], along_xy[1])])
    }
}

/// Divergence of the displacement of a sphere with linear contrast `delta`.
fn collapse(delta: f32) -> f32 {
    if delta < 1.5 { 3.0 * ((1.0 - delta / 1.5).sqrt() - 1.0) } else { -3.0 }
}

/// A random number of a mode: a hash of the seed and the wave vector.
fn hash(seed: u64, k: [i32; 3]) -> u64 {
    let packed = k.iter().fold(0u64, |packed, &k| packed << 20 | (k + (1 << 19)) as u64);
    mix_bits(mix_bits(seed ^ 0x517c_c1b7_2722_0a95).wrapping_add(packed.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

impl Spectrum {
    /// The Gaussian modes of the linear density.
    fn new(seed: u64, size: usize, edge: f64, power: &Power) -> Spectrum {
        let half = size / 2;
        let unit = 2.0 * PI / edge;
        let volume = edge * edge * edge;
        // The amplitude depends on the square of the wave number, which is an integer.
        let amplitude: Vec<f64> = (0..=3 * half * half)
            .into_par_iter()
            .map(|square| (power.at(unit * (square as f64).sqrt()) / volume).sqrt())
            .collect();
        let mode = |k: [i32; 3]| {
            let square = k.iter().map(|&k| (k * k) as usize).sum::<usize>();
            if square == 0 || k.iter().any(|k| k.unsigned_abs() as usize == half) {
                return [0.0; 2];
            }
            // A real field has conjugate modes at k and -k: one of them decides for both.
            let flip = (k[0], k[1], k[2]) < (0, 0, 0);
            let bits = hash(seed, if flip { k.map(|k| -k) } else { k });
            let radius = ((bits >> 32) as f64 + 0.5) / (1u64 << 32) as f64;
            let angle = 2.0 * PI * (bits & 0xffff_ffff) as f64 / (1u64 << 32) as f64;
            let radius = amplitude[square] * (-libm::log(radius)).sqrt();
            let (sin, cos) = libm::sincos(angle);
            [(radius * cos) as f32, (radius * if flip { -sin } else { sin }) as f32]
        };
        let mut values = vec![[0f32; 2]; (half + 1) * size * size];
        values.par_chunks_mut(half + 1).enumerate().for_each(|(row, values)| {
            let (z, y) = (signed(row / size, size), signed(row % size, size));
            values.iter_mut().enumerate().for_each(|(x, value)| *value = mode([x as i32, y, z]));
        });
        Spectrum { size, edge, values }
    }

    /// Puts `f(value, wave vector in h/Mpc, factors)` of every mode into the cube, where the factors depend on the square
    /// of the wave number.
    fn fill(
        &self,
        cube: &mut ComplexCube,
        factors: impl Fn(f64) -> [f32; 2] + Sync,
        f: impl Fn([f32; 2], [f32; 3], [f32; 2]) -> [f32; 2] + Sync,
    ) {
        let (size, half) = (self.size, self.size / 2);
        let unit = 2.0 * PI / self.edge;
        let table: Vec<[f32; 2]> =
            (0..=3 * half * half).into_par_iter().map(|square| factors(unit * unit * square as f64)).collect();
        let rows = cube.re.par_chunks_mut(size).zip(cube.im.par_chunks_mut(size)).enumerate();
        rows.for_each(|(row, (re, im))| {
            let (z, y) = (row / size, row % size);
            let mirrored = ((size - z) % size * size + (size - y) % size) * (half + 1);
            let (ky, kz) = (signed(y, size), signed(z, size));
            for x in 0..size {
                let kx = signed(x, size);
                let value = if x <= half {
                    self.values[row * (half + 1) + x]
                } else {
                    let [re, im] = self.values[mirrored + size - x];
                    [re, -im]
                };
                let square = (kx * kx + ky * ky + kz * kz) as usize;
                let k = [kx, ky, kz].map(|k| (unit * f64::from(k)) as f32);
                [re[x], im[x]] = f(value, k, table[square]);
            }
        });
    }

    /// From the linear density to the divergence of the displacement: minus itself where `weight` is 1, the transform of
    /// the collapsed field (not yet divided by the number of cells) where it is 0.
    fn mix(&mut self, collapsed: &ComplexCube, weight: impl Fn(f64) -> f32 + Sync) {
        let (size, half) = (self.size, self.size / 2);
        let unit = 2.0 * PI / self.edge;
        let norm = 1.0 / (size * size * size) as f32;
        let table: Vec<f32> =
            (0..=3 * half * half).into_par_iter().map(|square| weight(unit * unit * square as f64)).collect();
        self.values.par_chunks_mut(half + 1).enumerate().for_each(|(row, values)| {
            let (ky, kz) = (signed(row % size, size), signed(row / size, size));
            for (x, value) in values.iter_mut().enumerate() {
                let k = [x as i32, ky, kz];
                // Odd derivatives have no place for the highest wave number.
                if k.iter().any(|k| k.unsigned_abs() as usize == half) {
                    *value = [0.0; 2];
                    continue;
                }
                let linear = table[k.iter().map(|&k| (k * k) as usize).sum::<usize>()];
                let at = row * size + x;
                let small = [collapsed.re[at] * norm, collapsed.im[at] * norm];
                *value = [0, 1].map(|part| -linear * value[part] + (1.0 - linear) * small[part]);
            }
        });
    }
}

/// The signed wave number at an index.
fn signed(index: usize, size: usize) -> i32 {
    if index > size / 2 { index as i32 - size as i32 } else { index as i32 }
}

/// Indices of the cells that are higher than their 26 neighbours in the periodic box, highest first.
fn maxima(size: usize, values: &[f32]) -> Vec<u32> {
    let of_slab = |z: usize| {
        let around = |i: usize| [(i + size - 1) % size, i, (i + 1) % size];
        let mut found = Vec::new();
        for y in 0..size {
            let row = (z * size + y) * size;
            for x in 0..size {
                let value = values[row + x];
                // Most cells fail at once.
                if value <= 0.0 || value <= values[row + (x + 1) % size] || value <= values[row + (x + size - 1) % size]
                {
                    continue;
                }
                let highest = around(z).iter().all(|z| {
                    around(y).iter().all(|y| {
                        around(x).iter().all(|x| {
                            // Equal neighbours are both maxima; the cell itself is its own neighbour.
                            values[(z * size + y) * size + x] <= value
                        })
                    })
                });
                if highest {
                    found.push((row + x) as u32);
                }
            }
        }
        found
    };
    let mut peaks: Vec<u32> = (0..size).into_par_iter().flat_map_iter(of_slab).collect();
    peaks.par_sort_by(|&a, &b| values[b as usize].total_cmp(&values[a as usize]).then(a.cmp(&b)));
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_have_the_power_of_the_input() {
        let (size, edge) = (64, 400.0);
        let power = Power::new();
        // One box holds few of the largest waves; three seeds narrow the scatter.
        let spectra: Vec<Vec<[f64; 2]>> = (1..=3).map(|seed| measured(&Field::new(seed, size, edge, &power))).collect();
        for (shell, tolerance) in [(3, 0.25), (5, 0.15), (8, 0.1), (12, 0.1)] {
            let mean = |part: usize| spectra.iter().map(|spectrum| spectrum[shell][part]).sum::<f64>() / 3.0;
            let (found, k) = (mean(0), mean(1));
            let expected = power.at(k);
            assert!((found / expected - 1.0).abs() < tolerance, "k {k}: {found} against {expected}");
        }
    }

    /// Power of the divergence of the displacement and mean wave number in shells of the fundamental wave number.
    fn measured(field: &Field) -> Vec<[f64; 2]> {
        let size = field.size;
        let mut shells = vec![[0.0; 3]; size];
        let mut cubes: Vec<ComplexCube> = Vec::new();
        for axis in 0..3 {
            let mut cube = ComplexCube::new(size);
            cube.re.iter_mut().zip(&field.displacement).for_each(|(value, psi)| *value = psi[axis]);
            cube.transform(Direction::Forward);
            cubes.push(cube);
        }
        let unit = 2.0 * PI / field.edge;
        for at in 0..size * size * size {
            let k = [at % size, at / size % size, at / size / size].map(|i| unit * f64::from(signed(i, size)));
            let length = k.iter().map(|k| k * k).sum::<f64>().sqrt();
            let dot = |of: &dyn Fn(&ComplexCube) -> f32| -> f64 {
                cubes.iter().zip(k).map(|(cube, k)| k * f64::from(of(cube))).sum()
            };
            let (re, im) = (dot(&|cube| cube.re[at]), dot(&|cube| cube.im[at]));
            let shell = &mut shells[((length / unit).round() as usize).min(size - 1)];
            (shell[0], shell[1], shell[2]) = (shell[0] + re * re + im * im, shell[1] + length, shell[2] + 1.0);
        }
        let cells = (size * size * size) as f64;
        let volume = field.edge * field.edge * field.edge;
        shells.iter().map(|shell| [shell[0] / shell[2] * volume / (cells * cells), shell[1] / shell[2]]).collect()
    }

    #[test]
    fn every_size_holds_the_same_universe() {
        let power = Power::new();
        let (coarse, fine) = (Field::new(3, 32, 200.0, &power), Field::new(3, 64, 200.0, &power));
        let (mut same, mut all) = (0.0, 0.0);
        for (at, psi) in coarse.displacement.iter().enumerate() {
            let (x, y, z) = (at % 32, at / 32 % 32, at / 1024);
            let other = fine.displacement[(2 * z * 64 + 2 * y) * 64 + 2 * x];
            for axis in 0..3 {
                same += f64::from((psi[axis] - other[axis]) * (psi[axis] - other[axis]));
                all += f64::from(psi[axis] * psi[axis]);
            }
        }
        assert!(same / all < 0.1, "{same} of {all}");
    }

    #[test]
    fn peaks_are_maxima_in_order() {
        let field = Field::new(1, 32, 100.0, &Power::new());
        assert!(!field.peaks.is_empty());
        let mut values = vec![0.0; 16 * 16 * 16];
        values[0] = 2.0;
        values[(8 * 16 + 15) * 16 + 3] = 3.0;
        values[(8 * 16 + 15) * 16 + 4] = 1.0;
        assert_eq!(maxima(16, &values), [((8 * 16 + 15) * 16 + 3) as u32, 0]);
    }
}
