//! Along which directions values change in a node and just around it.
//!
//! The smallest nodes have two cells along each axis. These tell a mean, a slope along each axis and little more: what a wave or an edge of one
//! direction leaves in them, sets of several others show as well, or better. The cells next to the node tell which direction it is.

use super::cells::Cells;
use super::grid::Shape;
use super::sets::turned_directions;

/// How much values change along each direction, turned ones included: the mean square of slopes in a node and one cell around it, of the
/// largest one.
pub(super) struct Changes([f32; turned_directions(3)]);

impl Changes {
    pub fn around(cells: &Cells, at: Shape, weights: &[f32], directions: &[[f32; 3]]) -> Changes {
        let mut sums = [0.0_f32; 6];
        for (plane, weight) in weights.iter().enumerate() {
            sums.iter_mut().zip(cells.slopes(at, plane)).for_each(|(sum, own)| *sum += weight * own);
        }
        let [xx, yy, zz, xy, xz, yz] = sums;
        let mut changes = [0.0; turned_directions(3)];
        for (own, [x, y, z]) in changes.iter_mut().zip(directions) {
            *own = x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz);
        }
        let most = changes.iter().fold(0.0, |most, own| f32::max(most, *own));
        // Where nothing changes, or more than numbers can tell, no direction is before others.
        if most > 0.0 && most.is_finite() {
            changes.iter_mut().for_each(|own| *own /= most);
        } else {
            changes.fill(1.0);
        }
        Changes(changes)
    }

    /// How much values change along a direction, of the most.
    #[inline]
    pub fn along(&self, direction: usize) -> f32 {
        self.0[direction]
    }

    /// Whether values change more along one direction than along another.
    pub fn more(&self, one: usize, than: usize) -> bool {
        self.0[one] > self.0[than]
    }
}

impl Cells<'_> {
    /// The sums of squares and products of slopes along x, y and z of a plane: xx, yy, zz, xy, xz, yz. A slope is that of 2^D cells next to each
    /// other, times a constant, and all that are in the node or one cell beyond it count.
    fn slopes(&self, at: Shape, plane: usize) -> [f32; 6] {
        let values = &self.planes[plane].mean;
        let steps = [1, self.part.shape[0], self.part.shape[0] * self.part.shape[1]];
        let (mut first, mut end, mut step) = ([0; 3], [1; 3], [0; 3]);
        for k in (0..self.dimensions).filter(|&k| self.of[k] > 1) {
            first[k] = (at[k] * self.side).saturating_sub(1);
            end[k] = ((at[k] + 1) * self.side).min(self.of[k] - 1);
            step[k] = steps[k];
        }
        let [dx, dy, dz] = step;
        let mut sums = [0.0; 6];
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let row = self.part.index([first[0], y, z]);
                for i in row..row + end[0] - first[0] {
                    let v = [0, dz].map(|z| [0, dy].map(|y| [0, dx].map(|x| values[i + x + y + z])));
                    // Sums and differences along x of four pairs, of those along y, and of those along z.
                    let pair = |z: usize, y: usize| (v[z][y][0] + v[z][y][1], v[z][y][1] - v[z][y][0]);
                    let four = |z: usize| {
                        let ((s0, d0), (s1, d1)) = (pair(z, 0), pair(z, 1));
                        (s0 + s1, d0 + d1, s1 - s0)
                    };
                    let ((s0, x0, y0), (s1, x1, y1)) = (four(0), four(1));
                    let (x, y, z) = (x0 + x1, y0 + y1, s1 - s0);
                    let products = [x * x, y * y, z * z, x * y, x * z, y * z];
                    sums.iter_mut().zip(products).for_each(|(sum, own)| *sum += own);
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::super::bricks::Part;
    use super::super::grid::{place, volume};
    use super::super::pyramid::Means;
    use super::super::sets::direction;
    use super::*;

    /// Which direction the values of a node of two cells along each axis change along the most.
    fn most_along(dimensions: usize, of: Shape, at: Shape, value: impl Fn(Shape) -> f64) -> usize {
        let mean = (0..volume(of)).map(|i| value(place(of, i)) as f32).collect();
        let planes = [Means { mean, ..Means::default() }];
        let part = Part::whole(of);
        let cells = Cells { dimensions, side: 2, of, part, samples: 1.0, planes: &planes, are_samples: true };
        let directions: Vec<[f32; 3]> = (0..turned_directions(dimensions)).map(|n| direction(dimensions, n)).collect();
        let changes = Changes::around(&cells, at, &[1.0], &directions);
        (0..directions.len()).find(|&n| changes.along(n) == 1.0).unwrap_or(usize::MAX)
    }

    #[test]
    fn slopes_tell_directions_also_at_the_ends_of_a_grid() {
        for (dimensions, of) in [(2, [7, 6, 1]), (3, [6, 7, 5])] {
            for n in 0..turned_directions(dimensions) {
                let way = direction(dimensions, n).map(f64::from);
                let ramp = |at: Shape| (0..3).map(|k| way[k] * at[k] as f64).sum::<f64>();
                let last: Shape = std::array::from_fn(|k| (of[k] - 1) / 2);
                for at in [[0; 3], [1, 1, last[2].min(1)], last] {
                    assert_eq!(most_along(dimensions, of, at, ramp), n, "{dimensions}, {at:?}");
                }
            }
        }
        // A single line of cells changes along nothing else, and what is constant along all alike.
        assert_eq!(most_along(2, [1, 9, 1], [0, 2, 0], |at| at[1] as f64), 2);
        assert_eq!(most_along(3, [5, 5, 5], [1, 1, 1], |_| 3.0), 0);
    }
}
