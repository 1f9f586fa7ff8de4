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
    pub fn triangles(&self) -> impl Iterator<Item = Triangle> + use<> {
        let cell = *self;
        (0..2).map_while(move |slot| cell.triangle(slot))
    }

    /// One of its triangles; `None` where there are not as many.
    #[inline]
    pub fn triangle(&self, slot: usize) -> Option<Triangle> {
        let [a, b, d, e] = self.0;
        let (at, edge, corners) = match ([!a.is_nan(), !b.is_nan(), !d.is_nan(), !e.is_nan()], slot) {
            ([true, true, _, true], 0) => ([a, b - a, e - b], [0.0, 1.0, -1.0], [0, 1, 3]),
            ([true, true, true, true], 1) | ([true, false, true, true], 0) => {
                ([a, e - d, d - a], [0.0, -1.0, 1.0], [0, 2, 3])
            }
            ([false, true, true, true], 0) => ([b + d - e, e - d, e - b], [-1.0, 1.0, 1.0], [1, 2, 3]),
            ([true, true, true, false], 0) => ([a, b - a, d - a], [1.0, -1.0, -1.0], [0, 1, 2]),
            _ => return None,
        };
        Some(Triangle { at, edge, corners })
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
