//! The surface T of a field: what a cell of four samples holds.
//!
//! A cell with four measured corners is two triangles, split along (r, c)-(r + 1, c + 1); with three, the triangle of these; with fewer,
//! nothing: there is no surface elsewhere.

/// The heights at a cell's corners: (r, c), (r, c + 1), (r + 1, c), (r + 1, c + 1). NaN is not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell(pub [f64; 4]);

/// A triangle of a cell: its height is `at[0] + at[1] u + at[2] v` where `edge[0] + edge[1] u + edge[2] v >= 0`, with `u` (along columns) and
/// `v` (along rows) from 0 to 1 across the cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Height at the cell's first corner, and its changes along columns and rows.
    pub at: [f64; 3],
    /// Which half of the cell is the triangle's.
    pub edge: [f64; 3],
    /// The cell's corners, of 0 to 3, that are the triangle's, in order.
    pub corners: [usize; 3],
}

impl Cell {
    /// Its triangles: two, one or none.
    #[inline]
    pub fn triangles(&self) -> impl Iterator<Item = Triangle> {
        let [a, b, d, e] = self.0;
        let valid = self.0.map(|height| !height.is_nan());
        let found: [Option<Triangle>; 2] = match valid {
            [true, true, true, true] => [
                Some(Triangle { at: [a, b - a, e - b], edge: [0.0, 1.0, -1.0], corners: [0, 1, 3] }),
                Some(Triangle { at: [a, e - d, d - a], edge: [0.0, -1.0, 1.0], corners: [0, 2, 3] }),
            ],
            [true, true, false, true] => {
                [Some(Triangle { at: [a, b - a, e - b], edge: [0.0, 1.0, -1.0], corners: [0, 1, 3] }), None]
            }
            [true, false, true, true] => {
                [Some(Triangle { at: [a, e - d, d - a], edge: [0.0, -1.0, 1.0], corners: [0, 2, 3] }), None]
            }
            [false, true, true, true] => {
                [Some(Triangle { at: [b + d - e, e - d, e - b], edge: [-1.0, 1.0, 1.0], corners: [1, 2, 3] }), None]
            }
            [true, true, true, false] => {
                [Some(Triangle { at: [a, b - a, d - a], edge: [1.0, -1.0, -1.0], corners: [0, 1, 2] }), None]
            }
            _ => [None, None],
        };
        found.into_iter().flatten()
    }

    /// How many corners are measured.
    #[inline]
    pub fn measured(&self) -> usize {
        self.0.iter().filter(|height| !height.is_nan()).count()
    }

    /// T's height at a place in the cell; NaN where there is no surface. On the diagonal both triangles have the same.
    pub fn height(&self, u: f64, v: f64) -> f64 {
        let inside = |triangle: &Triangle| {
            let [k, m, n] = triangle.edge;
            k + m * u + n * v >= 0.0
        };
        self.triangles().find(inside).map_or(f64::NAN, |Triangle { at: [p, q, s], .. }| p + q * u + s * v)
    }
}
