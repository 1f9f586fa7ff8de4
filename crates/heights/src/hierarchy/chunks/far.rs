//! Levels whose cells are larger than a leaf: few samples, made when all leaves are known.

use super::coarse::{self, Below, Row};
use super::compact::Compact;
use super::deviation::Range;
use super::lattice::Lattice;
use super::sums::{WideLight, WideSum};
use crate::codec::values::Values;

/// What is known of every cell of a level: at first of leaves.
#[derive(Clone, Debug)]
pub struct Far {
    lattice: Lattice,
    values: Values,
    level: u32,
    /// Samples of the level, row by row.
    heights: Vec<Compact>,
    /// Of each cell what is in it.
    sums: Vec<WideSum>,
    /// Light of each cell's planes.
    light: Vec<WideLight>,
    planes: usize,
    /// T minus the level's surface in each cell.
    ranges: Vec<Range>,
}

impl Far {
    /// From the level whose cells are the leaves: its samples, and of each leaf what is in it.
    pub fn new(
        lattice: Lattice,
        values: Values,
        heights: Vec<Compact>,
        (sums, light): (Vec<WideSum>, Vec<WideLight>),
        planes: usize,
        ranges: Vec<Range>,
    ) -> Far {
        Far { lattice, values, level: lattice.side_bits, heights, sums, light, planes, ranges }
    }

    /// T minus the surface of the level that was made last, in each of its cells, row by row.
    pub fn ranges(&self) -> &[Range] {
        &self.ranges
    }

    /// Makes the next level.
    pub fn next_level(&mut self) -> Vec<Row> {
        let (lattice, level) = (self.lattice, self.level + 1);
        let [_, below_columns] = lattice.samples_of(self.level).map(|count| count as usize - 1);
        let [rows, columns] = lattice.samples_of(level).map(|count| count as usize);
        let about = self.gathered(below_columns, 1, [rows, columns]);
        let make = |row: usize| {
            let own = coarse::stand_in(&lattice, 0, level, row as u64) as usize;
            let at = lattice.below(0, level, row as u64) as usize;
            let heights =
                [at.checked_sub(1).and_then(|at| self.heights.get(at)), self.heights.get(at), self.heights.get(at + 1)];
            let below = Below { lattice, level, row: row as u64, values: self.values, heights };
            let light = |column: usize, plane: usize| {
                about.1[(own * columns + column) * self.planes + plane].map(|light| light as f64)
            };
            coarse::row(&below, self.planes, |column| about.0[own * columns + column], light)
        };
        let made: Vec<Row> = (0..rows).map(make).collect();
        let heights: Vec<Compact> = made.iter().map(|row| row.stored.clone()).collect();
        self.ranges = self.ranges_to(&heights);
        (self.sums, self.light) = self.gathered(below_columns, 0, [rows - 1, columns - 1]);
        (self.heights, self.level) = (heights, level);
        made
    }

    /// Adds what cell (r, c) has to ((r + shift) / 2, (c + shift) / 2).
    fn gathered(&self, from: usize, shift: usize, [rows, columns]: [usize; 2]) -> (Vec<WideSum>, Vec<WideLight>) {
        let planes = self.planes;
        let (mut sums, mut light) = (vec![WideSum::default(); rows * columns], vec![[0; 2]; rows * columns * planes]);
        for (at, sum) in self.sums.iter().enumerate() {
            let to = (at / from + shift) / 2 * columns + (at % from + shift) / 2;
            sums[to].add(sum);
            for plane in 0..planes {
                let (own, other) = (&mut light[to * planes + plane], &self.light[at * planes + plane]);
                own[0] += other[0];
                own[1] += other[1];
            }
        }
        (sums, light)
    }

    /// Bounds on T minus the surface of the next level, which has these samples: what is known of T minus this level's surface in each cell, and
    /// how far that is from the next one.
    fn ranges_to(&self, heights: &[Compact]) -> Vec<Range> {
        let (lattice, level) = (self.lattice, self.level + 1);
        let [_, columns] = lattice.samples_of(level).map(|count| count as usize - 1);
        let mut ranges = vec![Range::NONE; columns * (heights.len() - 1)];
        let [_, below_columns] = lattice.samples_of(self.level).map(|count| count as usize - 1);
        for (at, range) in self.ranges.iter().enumerate().filter(|(_, range)| range.low <= range.high) {
            let (row, column) = (at / below_columns, at % below_columns);
            let corners = |rows: &[Compact], row: usize, column: usize| {
                [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[down, across]| rows[row + down].get(column + across))
            };
            let here = corners(&self.heights, row, column);
            let above = corners(heights, row / 2, column / 2);
            let place = |axis: usize, level: u32, index: usize| lattice.place(axis, level, index as u64) as f64;
            let size = [(0, row / 2), (1, column / 2)]
                .map(|(axis, index)| place(axis, level, index + 1) - place(axis, level, index));
            let is_whole = here.iter().chain(&above).all(|height| !height.is_nan());
            let mut apart = Range::NONE;
            if is_whole && size[0] == size[1] && size[0] == (1_u64 << level) as f64 {
                // The diagonal is one of this level's edges: the difference is flat on both halves of the cell.
                for (corner, height) in here.into_iter().enumerate() {
                    let u = (place(1, self.level, column + corner % 2) - place(1, level, column / 2)) / size[1];
                    let v = (place(0, self.level, row + corner / 2) - place(0, level, row / 2)) / size[0];
                    apart.add(height - crate::model::Cell(above).height(u, v));
                }
            } else {
                let (mut low, mut high) = (Range::NONE, Range::NONE);
                here.iter().for_each(|height| low.add(*height));
                above.iter().for_each(|height| high.add(*height));
                apart = Range { low: low.low - high.high, high: low.high - high.low };
            }
            let own = &mut ranges[row / 2 * columns + column / 2];
            own.join(Range { low: range.low + apart.low, high: range.high + apart.high });
        }
        ranges
    }
}
