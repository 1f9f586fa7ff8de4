//! What only parts of a chunk have, as shaders look it up: the chunk in squares, row by row, of which each says where the lists have what is in it.

use super::constants::{NONE, SQUARE};
use super::list::counted;
use crate::cpu::surface::rims::RimSquare;
use crate::cpu::surface::stitch::Mesh;

/// Lists a chunk's squares; `NONE` where there is nothing in any.
fn listed<T>(squares: &[Option<T>], words: impl Fn(&T, &mut Vec<u32>), lists: &mut Vec<u32>) -> u32 {
    if squares.iter().all(Option::is_none) {
        return NONE;
    }
    let first = lists.len();
    lists.resize(first + squares.len(), NONE);
    for (index, square) in squares.iter().enumerate() {
        if let Some(square) = square {
            lists[first + index] = lists.len() as u32;
            words(square, lists);
        }
    }
    first as u32
}

/// Lists the cells of a chunk that have rims: four of them in a word, the first one lowest.
pub fn of_rims(squares: &[Option<RimSquare>], lists: &mut Vec<u32>) -> u32 {
    let words = |cells: &RimSquare, lists: &mut Vec<u32>| {
        lists.extend(cells.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)));
    };
    listed(squares, words, lists)
}

/// Lists the heights of a chunk's membrane, from the reference.
pub fn of_membrane(mesh: &Mesh, reference: f64, lists: &mut Vec<u32>) -> u32 {
    let Some(fill) = mesh.membrane() else { return NONE };
    let (rows, columns, side) = (mesh.samples.rows, mesh.samples.columns, SQUARE as usize);
    let (tall, wide) = (rows.div_ceil(side), columns.div_ceil(side));
    let square = |index: usize| {
        let [down, right] = [index / wide, index % wide].map(|at| at * side);
        let places = (0..side * side).map(|at| [down + at / side, right + at % side]);
        // The last squares may be beyond the chunk.
        let height = |[row, column]: [usize; 2]| {
            if row < rows && column < columns { fill[row * columns + column] } else { f64::NAN }
        };
        let heights: Vec<f64> = places.map(height).collect();
        heights.iter().any(|height| !height.is_nan()).then_some(heights)
    };
    let squares: Vec<Option<Vec<f64>>> = (0..tall * wide).map(square).collect();
    let words = |heights: &Vec<f64>, lists: &mut Vec<u32>| {
        lists.extend(heights.iter().map(|height| counted(*height, reference).to_bits()));
    };
    listed(&squares, words, lists)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_found_as_shaders_look_for_them() {
        let mut cells = [0; (SQUARE * SQUARE) as usize];
        (cells[0], cells[13]) = (1, 16);
        let mut lists = vec![7];
        let rims = of_rims(&[None, Some(cells)], &mut lists) as usize;
        assert_eq!((rims, lists.len(), lists[1], lists[2]), (1, 3 + 16, NONE, 3));
        // Row 1 and column 5 of the square.
        let index = SQUARE as usize + 5;
        assert_eq!(lists[3 + index / 4] >> (8 * (index % 4)) & 255, 16);
        assert_eq!(lists[3] & 255, 1);
        assert_eq!(of_rims(&[None, None], &mut lists), NONE);
        assert_eq!(lists.len(), 19);
    }
}
