//! The filters that tell how much of a frequency and a direction there is at a place (WM03 section 4.1): Gaussians in the frequency domain.
//!
//! Octave m has the frequencies from `2^-(m+1)` to `2^-m` cycles a sample. Its filters are centred at `omega_c = 2^-m - dw`, `dw = 2^(-m-2)`
//! (equation 3), in the direction of each set of points: 4 in 2D and 13 in 3D, unit vectors to the faces, edges and corners of a
//! cube. Along the direction a Gaussian falls to half its height at the octave's ends, where it meets those of the next octaves; across it
//! at half of 45 degrees. Equations 2 and 4 turn the centre twice and give no width that follows the octave: here a
//! filter's centre is `omega_c` times its direction. Since neither octaves nor directions are evenly spaced, the sum of all Gaussians is not
//! constant, so each is divided by it: what a frequency holds is shared among the filters. So that none answers to a constant, a Gaussian
//! ends where it is a 64th of its height.
//!
//! On a pyramid each octave is found where it is the finest but for aliasing: at a level of samples `2^(m-1)` apart, where it has the
//! frequencies from 1/4 to 1/2.

use super::sets::{direction, directions};
use rayon::prelude::*;
use std::f64::consts::LN_2;

/// `omega_c` of the octave from 1/4 to 1/2, cycles a cell.
pub const CENTRE: f64 = 0.375;
/// `dw` of that octave.
const HALF_WIDTH: f64 = 0.125;
/// Octaves on each side that take part of what a frequency holds.
const NEAR: i32 = 2;
/// The height at which a Gaussian ends.
const END: f64 = 1.0 / 64.0;
/// How often a Gaussian has halved there.
const HALVINGS: f64 = 6.0;
/// Gaussians of a direction and of the opposite one do not meet.
const _: () = assert!(HALVINGS < (CENTRE / HALF_WIDTH) * (CENTRE / HALF_WIDTH));
/// What is not worth a multiplication.
const LEAST: f32 = 1e-4;
/// Directions at most.
const MOST: usize = directions(3);

/// The filters of the octave from 1/4 to 1/2 cycles a cell.
#[derive(Clone, Debug)]
pub struct Bank {
    /// Unit vectors.
    directions: Vec<[f64; 3]>,
    /// The Gaussian of this octave.
    own: Gaussian,
    /// Those of all octaves that take part of what a frequency of this one holds.
    near: Vec<Gaussian>,
}

/// A Gaussian around a frequency of any direction, whose widths follow that frequency and which ends at [`END`].
#[derive(Clone, Copy, Debug)]
struct Gaussian {
    centre: f64,
    /// It has half of its height at this distance along its direction.
    half_along: f64,
    /// And at the root of this across it.
    half_across_squared: f64,
}

impl Gaussian {
    /// That of an octave so many below the one from 1/4 to 1/2.
    fn of_octave(octave: i32) -> Gaussian {
        let centre = CENTRE * libm::exp2(f64::from(-octave));
        let half_across = centre * libm::sin(std::f64::consts::FRAC_PI_8);
        Gaussian { centre, half_along: centre * (HALF_WIDTH / CENTRE), half_across_squared: half_across * half_across }
    }

    /// Its height so far along its direction, the square of the distance across it being `across_squared`.
    #[inline]
    fn height(&self, along: f64, across_squared: f64) -> f64 {
        let along = (along - self.centre) / self.half_along;
        let halvings = along * along + across_squared / self.half_across_squared;
        // Most filters are far from a frequency.
        if halvings >= HALVINGS {
            return 0.0;
        }
        let height = libm::exp(-LN_2 * halvings);
        ((height - END) / (1.0 - END)).max(0.0)
    }
}

impl Bank {
    /// The filters in so many dimensions of an octave below so many others.
    pub fn new(dimensions: usize, finer: usize) -> Bank {
        let directions = (0..directions(dimensions)).map(|n| unit(direction(dimensions, n))).collect();
        let finer = (finer as i32).min(NEAR);
        let near = (-finer..=NEAR).map(Gaussian::of_octave).collect();
        Bank { directions, own: Gaussian::of_octave(0), near }
    }

    /// The response of each filter to a frequency, cycles a cell: 0 to 1, and 0 for filters that there are in more dimensions only.
    pub fn responses(&self, frequency: [f64; 3]) -> [f64; MOST] {
        let square = frequency.iter().map(|f| f * f).sum::<f64>();
        let mut responses = [0.0; MOST];
        // How far along each direction the frequency is, and the square of how far across it.
        let mut places = [(0.0, 0.0); MOST];
        let places = &mut places[..self.directions.len()];
        for ((along, place), own) in self.directions.iter().zip(places.iter_mut()).zip(&mut responses) {
            let t: f64 = (0..3).map(|k| along[k] * frequency[k]).sum();
            let across_squared = (square - t * t).max(0.0);
            (*place, *own) = ((t.abs(), across_squared), self.own.height(t, across_squared));
        }
        if responses.iter().all(|own| *own <= 0.0) {
            return responses;
        }
        // A frequency and its opposite are one: of both, none but that on a Gaussian's side of 0 is within it.
        let mut sum = 0.0;
        for gaussian in &self.near {
            for &(along, across_squared) in places.iter() {
                sum += gaussian.height(along, across_squared);
            }
        }
        responses.iter_mut().for_each(|own| *own /= sum);
        responses
    }

    /// Of each filter the cells of the transform of a box of `size` along each axis that it passes, and how much of them.
    pub fn tables(&self, dimensions: usize, size: usize) -> Vec<Vec<(u32, f32)>> {
        let frequency = |k: usize| if 2 * k < size { k as f64 } else { k as f64 - size as f64 } / size as f64;
        let of_cell = |cell: usize| {
            let at = [cell % size, cell / size % size, cell / (size * size)];
            self.responses(std::array::from_fn(|k| if k < dimensions { frequency(at[k]) } else { 0.0 }))
        };
        let rows = size.pow(dimensions as u32 - 1);
        let passed = (0..rows).into_par_iter().map(|row| {
            let mut tables = vec![Vec::new(); self.directions.len()];
            for cell in row * size..(row + 1) * size {
                for (table, response) in tables.iter_mut().zip(of_cell(cell)) {
                    if response as f32 > LEAST {
                        table.push((cell as u32, response as f32));
                    }
                }
            }
            tables
        });
        let join = |mut all: Vec<Vec<(u32, f32)>>, more: Vec<Vec<(u32, f32)>>| {
            all.iter_mut().zip(more).for_each(|(table, more)| table.extend(more));
            all
        };
        passed.reduce(|| vec![Vec::new(); self.directions.len()], join)
    }

    /// Whether two directions are next to each other: less than 60 degrees apart.
    pub fn are_neighbours(&self, a: usize, b: usize) -> bool {
        (0..3).map(|k| self.directions[a][k] * self.directions[b][k]).sum::<f64>().abs() > 0.5001
    }
}

/// A vector of unit length to double precision.
fn unit(vector: [f32; 3]) -> [f64; 3] {
    let vector = vector.map(f64::from);
    let length = libm::sqrt(vector.iter().map(|v| v * v).sum::<f64>());
    vector.map(|v| v / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frequencies all around, at distances from the centre of the coarsest of `octaves` to the end of the finest.
    fn frequencies(dimensions: usize, octaves: i32) -> Vec<[f64; 3]> {
        let mut all = Vec::new();
        for i in 0..40 {
            let (turn, rise) = (0.157 * f64::from(i), if dimensions == 3 { 0.37 * f64::from(i) } else { 0.0 });
            let way = [turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin()];
            for k in 0..=20 {
                let distance = 0.5 * 2.0_f64.powf(-f64::from(k) / 20.0 * (f64::from(octaves) - 0.5));
                all.push(way.map(|w| w * distance));
            }
        }
        all
    }

    #[test]
    fn responses_of_impulses_sum_to_a_constant() {
        // An impulse holds all frequencies alike, so its responses sum to what the filters sum to.
        for dimensions in [2, 3] {
            let octaves = 4;
            let banks: Vec<Bank> = (0..octaves).map(|finer| Bank::new(dimensions, finer)).collect();
            for frequency in frequencies(dimensions, octaves as i32) {
                let mut sum = 0.0;
                for (octave, bank) in banks.iter().enumerate() {
                    let scale = (1_u32 << octave) as f64;
                    for sign in [scale, -scale] {
                        sum += bank.responses(frequency.map(|f| sign * f)).iter().sum::<f64>();
                    }
                }
                assert!((sum - 1.0).abs() < 0.05, "{dimensions}: {frequency:?}: {sum}");
            }
        }
    }

    #[test]
    fn responses_are_the_shares_of_gaussians_in_the_sum_of_all() {
        let gaussian = |along: [f64; 3], centre: f64, frequency: [f64; 3]| {
            let t: f64 = (0..3).map(|k| along[k] * frequency[k]).sum();
            let across_squared = (frequency.iter().map(|f| f * f).sum::<f64>() - t * t).max(0.0);
            let (half_along, half_across) = (centre / 3.0, centre * (std::f64::consts::PI / 8.0).sin());
            let distance = ((t - centre) / half_along).powi(2) + across_squared / half_across.powi(2);
            ((0.5_f64.powf(distance) - END) / (1.0 - END)).max(0.0)
        };
        for (dimensions, finer) in [(2, 0), (2, 1), (2, 3), (3, 0), (3, 1), (3, 3)] {
            let bank = Bank::new(dimensions, finer);
            for frequency in frequencies(dimensions, 4) {
                let mut sum = 0.0;
                for octave in -(finer.min(2) as i32)..=2 {
                    let centre = CENTRE * 0.5_f64.powi(octave);
                    for &along in &bank.directions {
                        sum += gaussian(along, centre, frequency) + gaussian(along, centre, frequency.map(|f| -f));
                    }
                }
                let found = bank.responses(frequency);
                for (filter, &along) in bank.directions.iter().enumerate() {
                    let own = gaussian(along, CENTRE, frequency);
                    let defined = if own > 0.0 { own / sum } else { 0.0 };
                    let response = found[filter];
                    assert!((response - defined).abs() < 1e-12, "{frequency:?}, {filter}: {response} {defined}");
                }
                assert!(found[bank.directions.len()..].iter().all(|response| *response == 0.0));
            }
        }
    }

    #[test]
    fn constants_are_not_answered() {
        for dimensions in [2, 3] {
            let bank = Bank::new(dimensions, 1);
            assert!(bank.responses([0.0; 3]).iter().all(|response| *response == 0.0));
        }
    }

    #[test]
    fn directions_are_unit_vectors_and_filters_even_about_them() {
        for dimensions in [2, 3] {
            let bank = Bank::new(dimensions, 0);
            assert_eq!(bank.directions.len(), directions(dimensions));
            for (filter, along) in bank.directions.iter().enumerate() {
                assert!((along.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
                // The axis to a corner has a third of a turn as its symmetry, not half of one: even but for what neighbours take.
                let most = if along.iter().all(|v| v.abs() > 0.5) { 0.15 } else { 1e-6 };
                let centre = bank.responses(along.map(|v| CENTRE * v))[filter];
                assert!(centre > 0.5);
                for frequency in frequencies(dimensions, 1) {
                    let t: f64 = (0..3).map(|k| along[k] * frequency[k]).sum();
                    let other: [f64; 3] = std::array::from_fn(|k| 2.0 * t * along[k] - frequency[k]);
                    let (one, other) = (bank.responses(frequency)[filter], bank.responses(other)[filter]);
                    assert!((one - other).abs() < most, "{filter}: {one} {other}");
                }
            }
        }
    }

    #[test]
    fn neighbours_share_what_is_between_them() {
        for dimensions in [2, 3] {
            let bank = Bank::new(dimensions, 1);
            let all = &bank.directions;
            // A face and the edge next to it; an octave and the next finer one.
            let (a, b) = if dimensions == 2 { (0, 1) } else { (0, 3) };
            let between: [f64; 3] = std::array::from_fn(|k| all[a][k] + all[b][k]);
            let length = between.iter().map(|v| v * v).sum::<f64>().sqrt();
            let between = between.map(|v| CENTRE * v / length);
            let shared = bank.responses(between);
            assert!((shared[a] - shared[b]).abs() < 1e-6);
            assert!(bank.are_neighbours(a, b) && !bank.are_neighbours(0, if dimensions == 2 { 2 } else { 1 }));
            let end = all[0].map(|v| 0.5 * v);
            let finer = Bank::new(dimensions, 0).responses(end.map(|f| 0.5 * f))[0];
            let own = bank.responses(end)[0];
            assert!((own - finer).abs() < 0.02 && (0.3..0.55).contains(&own), "{own} {finer}");
        }
    }
}
