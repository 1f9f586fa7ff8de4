//! Where nothing was measured: single samples at random, and round holes.

use super::noise::Noise;

/// Round holes: of each size a lattice with at most one hole a cell.
const SIZES: [(i64, f64); 3] = [(24, 0.15), (96, 0.2), (480, 0.3)];

/// Which samples were not measured.
#[derive(Clone, Debug)]
pub(super) struct Holes {
    /// The share of single samples.
    share: f64,
    single: Noise,
    /// Of each lattice its spacing, the share of cells with a hole, and where it is.
    round: Vec<(i64, f64, Noise)>,
}

impl Holes {
    /// Single samples of this share, and round holes where these are wanted.
    pub(super) fn new(seed: u64, share: f64, has_round: bool) -> Holes {
        let sizes: &[(i64, f64)] = if has_round { &SIZES } else { &[] };
        let round =
            sizes.iter().map(|(size, share)| (*size, *share, Noise::new(seed, 0x4000 + *size as u64))).collect();
        Holes { share, single: Noise::new(seed, 0x2000), round }
    }

    /// Whether there are none anywhere.
    pub(super) fn is_none(&self) -> bool {
        self.share <= 0.0 && self.round.is_empty()
    }

    /// Makes the samples of a row, from a column on, NaN where there is a hole.
    pub(super) fn open(&self, row: i64, column: i64, line: &mut [f64]) {
        if self.share > 0.0 {
            let noise = self.single.row(row);
            for (column, sample) in (column..).zip(&mut *line) {
                if noise.uniform(column) < self.share {
                    *sample = f64::NAN;
                }
            }
        }
        let end = column + line.len() as i64;
        for (size, share, noise) in &self.round {
            // A hole's middle is in its cell, and its radius at most half of the spacing.
            let cells = |from: i64, to: i64| (from - size).div_euclid(*size)..=(to + size).div_euclid(*size);
            for cell_row in cells(row, row) {
                let noise = noise.row(cell_row);
                for cell in cells(column, end) {
                    let number = |which: i64| noise.uniform(cell * 4 + which);
                    if number(0) >= *share {
                        continue;
                    }
                    let spacing = *size as f64;
                    let radius = spacing * (0.15 + 0.35 * number(1));
                    let middle = |cell: i64, which: i64| (cell as f64 + number(which)) * spacing;
                    let away = row as f64 - middle(cell_row, 2);
                    let square = radius * radius - away * away;
                    if square <= 0.0 {
                        continue;
                    }
                    let (at, half) = (middle(cell, 3), square.sqrt());
                    let first = ((at - half).ceil() as i64).max(column);
                    let last = ((at + half).floor() as i64).min(end - 1);
                    if first <= last {
                        line[(first - column) as usize..=(last - column) as usize].fill(f64::NAN);
                    }
                }
            }
        }
    }
}
