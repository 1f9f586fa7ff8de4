//! What the sets of [`super::sets`] look like in cells: with them a node's error for every set is a few scalar products.

use super::sets::{MOST, Set, VARIANTS, turned_directions};

/// A set in a node of a number of cells.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub code: u8,
    pub set: Set,
    /// Vectors of one length, orthogonal to each other and to a constant: with the constant they span what the set can show. The sum of
    /// squared products with cells is how much of the cells' variation it explains.
    pub basis: Vec<Vec<f32>>,
    /// Products with cells that give the points' values of least squares.
    pub solve: Vec<Vec<f32>>,
    /// Shares of the points in each cell.
    pub shares: Vec<Vec<f32>>,
}

/// All sets for nodes of `side` cells along each axis.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub cells: usize,
    pub entries: Vec<Entry>,
    /// For each direction its wide set of three points, or of two, with which directions are compared first.
    pub wide: Vec<Option<usize>>,
    /// For each direction its entries.
    pub of_direction: Vec<std::ops::Range<usize>>,
}

/// The sum of products, in a fixed order.
#[inline]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut sums = [0.0_f32; LANES];
    let (a_parts, b_parts) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = a_parts.remainder().iter().zip(b_parts.remainder()).map(|(a, b)| a * b).sum();
    if a.len() < LANES {
        // The nodes with the fewest cells are the most.
        return rest;
    }
    for (a, b) in a_parts.zip(b_parts) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f32>() + rest
}

/// The middle of a cell in a node of unit extent.
pub(super) fn middle(dimensions: usize, side: usize, cell: usize) -> [f32; 3] {
    let at = [cell % side, cell / side % side, cell / (side * side)];
    std::array::from_fn(|k| if k < dimensions { (at[k] as f32 + 0.5) / side as f32 - 0.5 } else { 0.0 })
}

impl Table {
    pub fn new(dimensions: usize, side: usize) -> Table {
        let cells = side.pow(dimensions as u32);
        let mut table = Table { cells, entries: Vec::new(), wide: Vec::new(), of_direction: Vec::new() };
        for n in 0..turned_directions(dimensions) {
            let first = table.entries.len();
            for variant in 0..VARIANTS {
                let code = (1 + n * VARIANTS + variant) as u8;
                if let Some(entry) = Set::of(dimensions, code).and_then(|set| Entry::new(dimensions, side, code, set)) {
                    // Few cells cannot tell many sets apart.
                    let same = |other: &Entry| {
                        other.set.points == entry.set.points
                            && other
                                .shares
                                .iter()
                                .zip(&entry.shares)
                                .all(|(a, b)| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.02))
                    };
                    if !table.entries[first..].iter().any(same) {
                        table.entries.push(entry);
                    }
                }
            }
            let range = first..table.entries.len();
            let widest = |points: usize| range.clone().find(|&i| table.entries[i].set.points == points);
            table.wide.push(widest(3).or_else(|| widest(2)));
            table.of_direction.push(range);
        }
        table
    }

    /// The entry of the set that a byte tells; `None` where it tells none, or these nodes have too few cells for it.
    pub fn of_code(&self, code: u8) -> Option<usize> {
        let range = self.of_direction.get(Set::direction_of(code)?)?.clone();
        range.into_iter().find(|&entry| self.entries[entry].code == code)
    }
}

impl Entry {
    /// `None` where a point has next to no cell, or the node too few cells to need the set.
    fn new(dimensions: usize, side: usize, code: u8, set: Set) -> Option<Entry> {
        let cells = side.pow(dimensions as u32);
        let k = set.points;
        if k >= cells {
            return None;
        }
        let mut shares = vec![vec![0.0_f32; cells]; k];
        (0..cells).for_each(|cell| {
            let own = set.shares(middle(dimensions, side, cell));
            shares.iter_mut().zip(own).for_each(|(shares, own)| shares[cell] = own);
        });
        // A point that owns less than a sixteenth of the node, or less than half of its largest cell, is none.
        let most = |s: &Vec<f32>| s.iter().fold(0.0_f32, |m, &v| m.max(v));
        if shares.iter().any(|s| s.iter().sum::<f32>() < (cells as f32 / 24.0).max(0.45) || most(s) < 0.45) {
            return None;
        }
        let wide: Vec<Vec<f64>> = shares.iter().map(|s| s.iter().map(|&v| f64::from(v)).collect()).collect();
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let gram: [[f64; MOST]; MOST] = std::array::from_fn(|i| {
            std::array::from_fn(
                |j| if i < k && j < k { product(&wide[i], &wide[j]) } else { f64::from(u8::from(i == j)) },
            )
        });
        let inverse = invert(gram)?;
        let solve = (0..k)
            .map(|i| (0..cells).map(|c| (0..k).map(|j| inverse[i][j] * wide[j][c]).sum::<f64>() as f32).collect())
            .collect();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for vector in &wide[1..] {
            let mean = vector.iter().sum::<f64>() / cells as f64;
            let mut v: Vec<f64> = vector.iter().map(|v| v - mean).collect();
            for b in &basis {
                let along = product(&v, b);
                v.iter_mut().zip(b).for_each(|(v, b)| *v -= along * b);
            }
            let length = product(&v, &v).sqrt();
            if length < 1e-3 {
                return None;
            }
            v.iter_mut().for_each(|v| *v /= length);
            basis.push(v);
        }
        let basis = basis.into_iter().map(|b| b.into_iter().map(|v| v as f32).collect()).collect();
        Some(Entry { code, set, basis, solve, shares })
    }
}

/// The inverse of a symmetric matrix that is not near to a singular one.
fn invert(m: [[f64; MOST]; MOST]) -> Option<[[f64; MOST]; MOST]> {
    let minor = |i: usize, j: usize| {
        let at = |r: usize, c: usize| m[(i + r) % 3][(j + c) % 3];
        at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1)
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let scale: f64 = (0..3).map(|i| m[i][i]).product();
    (determinant > 1e-4 * scale).then(|| std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / determinant)))
}
