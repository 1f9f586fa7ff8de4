//! A part of the picture, and how particles are drawn into it: several pixels of a row in SIMD lanes.
//!
//! Every pixel gets the numbers that it would get if one pixel were drawn after the other, by the same operations and in the same order:
//! what a file tells does not depend on lanes.

use crate::lanes::in_lanes;
use crate::model::Kernel;

/// Pixels of a row that are drawn together.
const LANES: usize = 8;
/// Their centres.
const CENTERS: [f32; LANES] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5];
/// Resolutions that kernels are drawn with, each half of that before it; windows are multiples of the coarsest one's pixels.
const LEVELS: usize = 8;
/// Finest pixels along a pixel of the coarsest resolution.
pub(super) const COARSEST: usize = 1 << (LEVELS - 1);
/// The coarsest resolution is taken at which a kernel's radius still has at least half of so many pixels.
const RADIUS: f32 = 6.0;
/// Narrower kernels are drawn as if they had this radius, pixels: the grid cannot tell them apart.
const LEAST_RADIUS: f32 = 1.5;
/// Pixels whose centres lie farther than this beyond a kernel's end are left out: rounding brings none of them back inside.
const MARGIN: f32 = 0.0625;
/// Steps of the square of the distance in the kernel's table.
const STEPS: usize = 512;
/// With this a small whole number is in the last bits of a single.
const IN_LAST_BITS: f32 = 8_388_608.0;

/// The projected kernel with a radius of 1, over equal steps of the square of the distance: its value where a step begins, and by how much
/// it rises until the next one. At the end and beyond it is 0.
#[derive(Debug)]
pub(super) struct Profile(Box<[[f32; 2]; 2 * STEPS]>);

impl Profile {
    /// Of this kernel.
    pub fn new(kernel: Kernel) -> Profile {
        let value = |step: usize| kernel.projected((step as f64 / STEPS as f64).sqrt()) as f32;
        let values: Vec<f32> = (0..=STEPS).map(value).collect();
        let mut steps = Box::new([[0.0; 2]; 2 * STEPS]);
        for (step, pair) in steps.iter_mut().zip(values.windows(2)) {
            *step = [pair[0], pair[1] - pair[0]];
        }
        Profile(steps)
    }

    /// The values at these squares of distances, one of which is so many steps.
    #[inline(always)]
    fn at(&self, squares: &[f32; LANES], steps: f32) -> [f32; LANES] {
        let (mut numbers, mut shares) = ([0_u32; LANES], [0.0_f32; LANES]);
        for lane in 0..LANES {
            let at = (squares[lane] * steps).min(STEPS as f32);
            let whole = at.floor();
            // A cast would ask each lane by itself whether an integer can be as large.
            numbers[lane] = (whole + IN_LAST_BITS).to_bits();
            shares[lane] = at - whole;
        }
        let mut values = [0.0; LANES];
        for lane in 0..LANES {
            // The table's length is a power of two, so that no number has to be checked.
            let [start, rise] = self.0[numbers[lane] as usize & (2 * STEPS - 1)];
            values[lane] = start + shares[lane] * rise;
        }
        values
    }
}

/// A particle as it is drawn: with what the source has, and with what that decodes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat {
    /// Pixels of the picture.
    pub place: [f32; 2],
    /// Both radii, pixels.
    pub radii: [f32; 2],
    /// Both masses.
    pub masses: [f32; 2],
}

impl Splat {
    /// How far it reaches, pixels.
    pub fn reach(&self) -> f32 {
        self.radii.into_iter().fold(LEAST_RADIUS, f32::max)
    }
}

/// A part of the picture at all resolutions: what the source has, and what codes add to it.
pub(super) struct Window {
    /// Its first pixel.
    first: [usize; 2],
    levels: Vec<Level>,
}

/// One resolution.
struct Level {
    columns: usize,
    rows: usize,
    /// What codes add, row by row, each of [`Level::stride`] pixels.
    differences: Vec<f32>,
    /// What the source has, in the same way.
    own: Vec<f32>,
}

impl Window {
    /// An empty one; `size` is a multiple of [`COARSEST`].
    pub fn new(first: [usize; 2], size: [usize; 2]) -> Window {
        Window { first, levels: (0..LEVELS).map(|level| Level::new(size.map(|size| size >> level))).collect() }
    }

    /// Adds particles, and their differences.
    pub fn draw(&mut self, splats: &[Splat], profile: &Profile) {
        in_lanes!({
            for splat in splats {
                self.add(splat, profile);
            }
        });
    }

    #[inline(always)]
    fn add(&mut self, splat: &Splat, profile: &Profile) {
        let Splat { place, radii, masses } = *splat;
        let (mut level, mut scale) = (0, 1.0);
        while radii[0] * scale >= RADIUS && level + 1 < LEVELS {
            (level, scale) = (level + 1, 0.5 * scale);
        }
        let radii = radii.map(|radius| (radius * scale).max(LEAST_RADIUS));
        let steps = radii.map(|radius| STEPS as f32 / (radius * radius));
        // Mass over area, of the finest pixels.
        let heights = [0, 1].map(|k| masses[k] * scale * scale / (radii[k] * radii[k]));
        let place = [0, 1].map(|axis| (place[axis] - self.first[axis] as f32) * scale);
        let reach = radii[0].max(radii[1]) + MARGIN;
        // Casts saturate: what lies outside the window is cut off.
        let range = |x: f32, size: usize| (x - reach + 0.5) as usize..((x + reach + 0.5) as usize).min(size);
        let level = &mut self.levels[level];
        let (rows, stride) = (range(place[1], level.rows), level.stride());
        for first in range(place[0], level.columns).step_by(LANES) {
            let mut across = [0.0; LANES];
            for (square, center) in across.iter_mut().zip(CENTERS) {
                let distance = first as f32 + center - place[0];
                *square = distance * distance;
            }
            for row in rows.clone() {
                let up = row as f32 + 0.5 - place[1];
                let mut squares = [0.0; LANES];
                for lane in 0..LANES {
                    squares[lane] = up * up + across[lane];
                }
                let source = profile.at(&squares, steps[0]);
                // Both of a particle that is narrow.
                let decoded = if steps[0] == steps[1] { source } else { profile.at(&squares, steps[1]) };
                // Lanes beyond the kernel add nothing; those beyond the row fall into the room behind it.
                let at = row * stride + first;
                let differences = level.differences[at..].first_chunk_mut::<LANES>();
                let (Some(differences), Some(own)) = (differences, level.own[at..].first_chunk_mut::<LANES>()) else {
                    continue;
                };
                // All are read before any is written: as far as the compiler knows both may be the same memory.
                let (mut sums, mut totals) = (*differences, *own);
                for lane in 0..LANES {
                    let value = heights[0] * source[lane];
                    sums[lane] += heights[1] * decoded[lane] - value;
                    totals[lane] += value;
                }
                (*differences, *own) = (sums, totals);
            }
        }
    }

    /// The sums of squares of the difference and of the picture over the finest pixels.
    pub fn squares(mut self) -> [f64; 2] {
        self.gather().fold([0.0; 2], |sum, pixel| [0, 1].map(|k| sum[k] + f64::from(pixel[k]).powi(2)))
    }

    /// The finest pixels, row by row, when all resolutions have been added to them: difference and picture.
    fn gather(&mut self) -> impl Iterator<Item = [f32; 2]> {
        for level in (1..LEVELS).rev() {
            let (finer, coarser) = self.levels.split_at_mut(level);
            let (Some(fine), Some(coarse)) = (finer.last_mut(), coarser.first()) else { continue };
            fine.add(coarse);
        }
        self.levels[0].pixels()
    }
}

impl Level {
    fn new([columns, rows]: [usize; 2]) -> Level {
        let empty = || vec![0.0; rows * (columns + LANES)];
        Level { columns, rows, differences: empty(), own: empty() }
    }

    /// From one row to the next: behind each there is room for lanes that reach over its end.
    fn stride(&self) -> usize {
        self.columns + LANES
    }

    /// Adds the next coarser resolution.
    fn add(&mut self, coarse: &Level) {
        let strides = [self.stride(), coarse.stride()];
        for (fine, more) in [(&mut self.differences, &coarse.differences), (&mut self.own, &coarse.own)] {
            for (row, pixels) in fine.chunks_exact_mut(strides[0]).enumerate() {
                let above = &more[row / 2 * strides[1]..][..coarse.columns];
                for (pair, value) in pixels.as_chunks_mut::<2>().0.iter_mut().zip(above) {
                    pair.iter_mut().for_each(|pixel| *pixel += value);
                }
            }
        }
    }

    /// The pixels, row by row: difference and picture.
    fn pixels(&self) -> impl Iterator<Item = [f32; 2]> {
        let (columns, stride) = (self.columns, self.stride());
        let rows = self.differences.chunks_exact(stride).zip(self.own.chunks_exact(stride));
        rows.flat_map(move |(differences, own)| differences.iter().zip(own).take(columns)).map(|(&a, &b)| [a, b])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The finest pixels by one pixel after the other, each kernel in the whole square around it.
    fn plainly(size: [usize; 2], first: [usize; 2], splats: &[Splat], kernel: Kernel) -> Vec<[f32; 2]> {
        let value = |step: usize| kernel.projected((step as f64 / STEPS as f64).sqrt()) as f32;
        let table: Vec<f32> = (0..STEPS + 2).map(value).collect();
        let mut levels: Vec<Vec<[f32; 2]>> =
            (0..LEVELS).map(|level| vec![[0.0; 2]; (size[0] >> level) * (size[1] >> level)]).collect();
        for splat in splats {
            let (mut level, mut scale) = (0, 1.0);
            while splat.radii[0] * scale >= RADIUS && level + 1 < LEVELS {
                (level, scale) = (level + 1, 0.5 * scale);
            }
            let radii = splat.radii.map(|radius| (radius * scale).max(LEAST_RADIUS));
            let place = [0, 1].map(|axis| (splat.place[axis] - first[axis] as f32) * scale);
            let reach = radii[0].max(radii[1]);
            let [columns, rows] = size.map(|size| size >> level);
            let range = |x: f32, size: usize| (x - reach) as usize..((x + reach) as usize).min(size - 1) + 1;
            for row in range(place[1], rows) {
                for column in range(place[0], columns) {
                    let [x, y] = [column as f32 + 0.5 - place[0], row as f32 + 0.5 - place[1]];
                    let [own, decoded] = [0, 1].map(|k| {
                        let steps = STEPS as f32 / (radii[k] * radii[k]);
                        let at = ((y * y + x * x) * steps).min(STEPS as f32);
                        let step = at as usize;
                        let value = table[step] + (at - step as f32) * (table[step + 1] - table[step]);
                        splat.masses[k] * scale * scale / (radii[k] * radii[k]) * value
                    });
                    let pixel = &mut levels[level][row * columns + column];
                    *pixel = [pixel[0] + (decoded - own), pixel[1] + own];
                }
            }
        }
        for level in (1..LEVELS).rev() {
            let (width, half) = (size[0] >> (level - 1), size[0] >> level);
            for i in 0..levels[level - 1].len() {
                let more = levels[level][i / width / 2 * half + i % width / 2];
                let pixel = &mut levels[level - 1][i];
                *pixel = [pixel[0] + more[0], pixel[1] + more[1]];
            }
        }
        levels.swap_remove(0)
    }

    proptest! {
        #![proptest_config(crate::cases::cases(16))]

        /// To the last bit, wherever particles lie and however far decoded radii are off.
        #[test]
        fn lanes_draw_what_single_pixels_do(
            size in prop::array::uniform2(1..3_usize), first in prop::array::uniform2(0..3_usize),
            kernel in prop::sample::select(Kernel::ALL.to_vec()),
            particles in prop::collection::vec(
                (
                    prop::array::uniform2(-0.2..1.2_f32), -3.0..10.0_f32,
                    prop_oneof![4 => -0.3..0.3_f32, 1 => -9.0..9.0_f32], 0.5..2.0_f32,
                ),
                1..20,
            ),
        ) {
            let (size, first) = (size.map(|size| size * COARSEST), first.map(|first| first * COARSEST));
            let splat = |&(place, octave, wider, heavier): &([f32; 2], f32, f32, f32)| Splat {
                place: [0, 1].map(|axis| first[axis] as f32 + place[axis] * size[axis] as f32),
                radii: [octave.exp2(), (octave + wider).exp2()],
                masses: [0.01, 0.01 * heavier],
            };
            let splats: Vec<Splat> = particles.iter().map(splat).collect();
            let expected = plainly(size, first, &splats, kernel);
            let mut window = Window::new(first, size);
            window.draw(&splats, &Profile::new(kernel));
            let bits = |pixel: [f32; 2]| pixel.map(f32::to_bits);
            prop_assert!(window.gather().map(bits).eq(expected.into_iter().map(bits)));
        }
    }
}
