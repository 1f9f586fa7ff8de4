//! Particles about the eye: what of a kernel lies before the eye along a ray, for pictures of all directions.
//!
//! A perspective picture drops what is behind the eye's plane and counts the whole line of sight through a kernel that the eye
//! is in. Around the eye there is no such plane: each ray begins at the eye, and a kernel counts with what of it the ray goes
//! through. With the kernel's centre at `c`, the ray meets `F(q)/h^2 * share(q, z)`, where `q h` is the distance of ray and centre,
//! and `z` the centre's place along the ray, in half-chords: 1 and more for a kernel all of which is ahead.

use super::table::LineTable;
use crate::model::Kernel;
use std::sync::OnceLock;

/// Rows of the table: impact parameters.
const ROWS: usize = 64;
/// Columns: places of the centre along the ray.
const COLUMNS: usize = 128;
/// Steps of the integral for each column.
const STEPS: usize = 8;

/// The share of a kernel's line integral that lies before the eye, read with bilinear interpolation to 1e-3.
pub struct HalfLine {
    shares: Vec<f64>,
    /// The share of all of a kernel that lies on one side of a plane, for planes from one end of it to the other.
    fronts: Vec<f64>,
    line: &'static LineTable,
}

impl HalfLine {
    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static HalfLine {
        static TABLES: [OnceLock<HalfLine>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| HalfLine::compute(kernel))
    }

    fn compute(kernel: Kernel) -> HalfLine {
        let mut shares = Vec::with_capacity((ROWS + 1) * (COLUMNS + 1));
        for row in 0..=ROWS {
            // At the rim there is no chord; its limit is what lies just within.
            let q = (row as f64 / ROWS as f64).min(0.9999);
            let half = (1.0 - q * q).sqrt();
            let step = 2.0 * half / (COLUMNS * STEPS) as f64;
            let value = |index: usize| kernel.value(q.hypot((index as f64 + 0.5) * step - half));
            let mut sums = vec![0.0];
            for column in 0..COLUMNS {
                let part: f64 = (column * STEPS..(column + 1) * STEPS).map(value).sum();
                sums.push(sums[column] + part);
            }
            let all = sums[COLUMNS];
            shares.extend(sums.iter().map(|sum| if all > 0.0 { sum / all } else { 0.0 }));
        }
        let table = HalfLine { shares, fronts: Vec::new(), line: LineTable::of(kernel) };
        let front = |along: f64| -> f64 {
            let ring = |row: usize| (row as f64 + 0.5) / ROWS as f64;
            (0..ROWS).map(|row| ring(row) * table.at(ring(row).powi(2), along)).sum()
        };
        let all = front(f64::INFINITY);
        let fronts = (0..=COLUMNS).map(|column| front(2.0 * column as f64 / COLUMNS as f64 - 1.0) / all).collect();
        HalfLine { fronts, ..table }
    }

    /// The share of all of a kernel of `h` 1 that lies before a plane, which is so far behind its centre.
    pub fn front(&self, plane: f64) -> f64 {
        let place = 0.5 * (plane.clamp(-1.0, 1.0) + 1.0) * COLUMNS as f64;
        let index = (place as usize).min(COLUMNS - 1);
        let share = place - index as f64;
        self.fronts[index] * (1.0 - share) + self.fronts[index + 1] * share
    }

    /// What a ray from the eye meets of a kernel of `h` 1: `square` is the squared distance of ray and centre, `along` the
    /// centre's place along the ray.
    pub fn at(&self, square: f64, along: f64) -> f64 {
        let whole = self.line.at_square(square);
        let half_square = 1.0 - square;
        if whole <= 0.0 || along * along >= half_square {
            return if along > 0.0 { whole } else { 0.0 };
        }
        let locate = |place: f64, count: usize| {
            let place = place.clamp(0.0, 1.0) * count as f64;
            let index = (place as usize).min(count - 1);
            (index, place - index as f64)
        };
        let (row, v) = locate(square.max(0.0).sqrt(), ROWS);
        let (column, u) = locate(0.5 * (1.0 + along / half_square.sqrt()), COLUMNS);
        let read = |row: usize| {
            let at = row * (COLUMNS + 1) + column;
            self.shares[at] * (1.0 - u) + self.shares[at + 1] * u
        };
        whole * (read(row) * (1.0 - v) + read(row + 1) * v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_before_planes_are_integrals_over_all_of_a_kernel() {
        for kernel in Kernel::ALL {
            let table = HalfLine::of(kernel);
            // Of a ball of kernel values, the disc at `z` holds the integral of 2 pi r W.
            let disc = |z: f64| -> f64 {
                let ring = |k: i32| (f64::from(k) + 0.5) / 500.0;
                (0..500).map(|k| ring(k) * kernel.value(ring(k).hypot(z))).sum()
            };
            let discs: Vec<f64> = (0..400).map(|k| disc((f64::from(k) + 0.5) / 200.0 - 1.0)).collect();
            let all: f64 = discs.iter().sum();
            for k in [0, 30, 100, 200, 250, 333, 400] {
                let (expected, found) = (discs[..k].iter().sum::<f64>() / all, table.front(k as f64 / 200.0 - 1.0));
                assert!((found - expected).abs() < 2e-3, "{kernel:?} {k}: {found}, expected {expected}");
            }
            assert_eq!((table.front(-7.0), table.front(-1.0)), (0.0, 0.0));
        }
    }

    #[test]
    fn shares_are_integrals_along_the_half_line() {
        for kernel in Kernel::ALL {
            let table = HalfLine::of(kernel);
            for i in 0..400 {
                let (q, along) = (f64::from(i % 20) / 20.0, f64::from(i / 20) / 8.0 - 1.2);
                let steps = 4000;
                let step = 3.0 / f64::from(steps);
                let sum: f64 =
                    (0..steps).map(|k| kernel.value(q.hypot((f64::from(k) + 0.5) * step - along))).sum::<f64>() * step;
                let found = table.at(q * q, along);
                assert!((found - sum).abs() < 1e-3 * kernel.projected(0.0), "{kernel:?} {q} {along}: {found} {sum}");
            }
        }
    }
}
