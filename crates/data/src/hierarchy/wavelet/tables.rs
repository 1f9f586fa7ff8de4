//! What the sets of [`super::sets`] look like in cells: with them a node's error for every set is a few scalar products.

use super::sets::{MOST, Set, direction, turned_directions, variants};

/// What is left of a vector that others span all but for rounding, of its length.
const NEARLY_SPANNED: f32 = 0.05;

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
    /// Products of the points' shares with each other, summed over cells.
    pub gram: [[f32; MOST]; MOST],
}

/// All sets for nodes of `side` cells along each axis.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub dimensions: usize,
    pub cells: usize,
    pub entries: Vec<Entry>,
    /// All directions, turned ones included.
    pub directions: Vec<[f32; 3]>,
    /// For each direction vectors of one length, orthogonal to each other and to a constant, with which directions are compared first: they
    /// span its wide set of three points, or of two, and in the smallest nodes all of its sets.
    pub spans: Vec<Vec<Vec<f32>>>,
    /// For each direction its entries.
    pub of_direction: Vec<std::ops::Range<usize>>,
}

/// The sum of products, in a fixed order.
#[inline]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    if let (Ok(a), Ok(b)) = (<&[f32; 8]>::try_from(a), <&[f32; 8]>::try_from(b)) {
        // The smallest nodes of volumes, of which there are most: sums that do not wait for each other.
        let p: [f32; 8] = std::array::from_fn(|k| a[k] * b[k]);
        return ((p[0] + p[4]) + (p[2] + p[6])) + ((p[1] + p[5]) + (p[3] + p[7]));
    }
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
        let all = turned_directions(dimensions);
        let directions = (0..all).map(|n| direction(dimensions, n)).collect();
        let (spans, of_direction) = (Vec::with_capacity(all), Vec::with_capacity(all));
        let mut table = Table { dimensions, cells, entries: Vec::new(), directions, spans, of_direction };
        for n in 0..all {
            let first = table.entries.len();
            for variant in 0..variants(dimensions) {
                let code = Set::code(dimensions, n, variant);
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
            let wide = widest(3).or_else(|| widest(2)).into_iter().collect();
            let compared: Vec<usize> = if side == 2 { range.clone().collect() } else { wide };
            table.spans.push(span(compared.iter().flat_map(|&entry| &table.entries[entry].basis)));
            table.of_direction.push(range);
        }
        table
    }

    /// The entry of the set that a byte tells; `None` where it tells none, or these nodes have too few cells for it.
    pub fn of_code(&self, code: u8) -> Option<usize> {
        let range = self.of_direction.get(Set::direction_of(self.dimensions, code)?)?.clone();
        range.into_iter().find(|&entry| self.entries[entry].code == code)
    }
}

/// Vectors of one length, orthogonal to each other, that span others of one length.
fn span<'a>(vectors: impl Iterator<Item = &'a Vec<f32>>) -> Vec<Vec<f32>> {
    let mut spans: Vec<Vec<f32>> = Vec::new();
    for vector in vectors {
        let mut rest = vector.clone();
        // Twice, since the first time leaves what rounding makes of it.
        for _ in 0..2 {
            for own in &spans {
                let along = dot(&rest, own);
                rest.iter_mut().zip(own).for_each(|(v, own)| *v -= along * own);
            }
        }
        let length = dot(&rest, &rest).sqrt();
        if length > NEARLY_SPANNED {
            rest.iter_mut().for_each(|v| *v /= length);
            spans.push(rest);
        }
    }
    spans
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
        Some(Entry { code, set, basis, solve, shares, gram: gram.map(|row| row.map(|v| v as f32)) })
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
