//! The heights that a picture shows, at nodes a few pixels apart: to follow lines in.

use super::super::raster::Visibility;
use super::super::resolve::Resolver;
use super::ContourLabel;
use rayon::prelude::*;

/// Nodes are so far apart, in ems, but not less than two pixels.
const STEP: f64 = 0.18;
/// How far from where a picture's heights have it a line may be looked for, in distances of nodes.
const NEAR: f64 = 1.0;

/// What a node shows: height, row, column; NaN where nothing is.
pub(super) type Node = [f64; 3];

/// Heights of a picture.
pub(super) struct Relief<'r, 'a> {
    resolver: &'r Resolver<'a>,
    seen: &'r Visibility,
    /// Samples along a pixel's side.
    parts: usize,
    /// Pixels from a node to the next.
    pub step: usize,
    /// Nodes of a row, and rows.
    pub nodes: [usize; 2],
    /// Width and height, pixels.
    pub size: [f64; 2],
    values: Vec<Node>,
    /// Whether the cell to the right of a node and below it is one piece of the surface.
    whole: Vec<bool>,
}

/// A plane through values at the corners of a cell: in its middle, and what a pixel to the right and down adds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub middle: f64,
    pub rise: [f64; 2],
}

impl Plane {
    pub(super) fn steepness(&self) -> f64 {
        self.rise[0].hypot(self.rise[1])
    }
}

impl<'r, 'a> Relief<'r, 'a> {
    /// Of a picture whose pixels have `parts` samples along a side, for letters of `em` pixels.
    pub(super) fn new(resolver: &'r Resolver<'a>, seen: &'r Visibility, parts: u32, em: f64) -> Relief<'r, 'a> {
        let (parts, step) = (parts as usize, ((STEP * em).round() as usize).max(2));
        let size = [seen.width / parts, seen.height / parts];
        let nodes = size.map(|size| size.div_ceil(step));
        let node = |index: usize| {
            let [x, y] = [index % nodes[0], index / nodes[0]].map(|at| at * step * parts + parts / 2);
            sample(resolver, seen, [x, y]).unwrap_or([f64::NAN; 3])
        };
        let values: Vec<Node> = (0..nodes[0] * nodes[1]).into_par_iter().map(node).collect();
        let mut relief = Relief {
            resolver,
            seen,
            parts,
            step,
            nodes,
            size: size.map(|side| side as f64),
            values,
            whole: Vec::new(),
        };
        relief.whole = (0..nodes[0] * nodes[1]).into_par_iter().map(|index| relief.is_one_piece(index)).collect();
        relief
    }

    /// Where a node is in the picture, pixels.
    fn place(&self, index: usize) -> f64 {
        (index * self.step * self.parts + self.parts / 2) as f64 / self.parts as f64 + 0.5 / self.parts as f64
    }

    /// The middle of a cell, pixels.
    pub(super) fn middle(&self, [x, y]: [usize; 2]) -> [f64; 2] {
        [x, y].map(|index| self.place(index) + 0.5 * self.step as f64)
    }

    /// The corners of a cell that is one piece: from left to right, from top to bottom.
    pub(super) fn corners(&self, [x, y]: [usize; 2]) -> Option<[Node; 4]> {
        let index = y * self.nodes[0] + x;
        let is_whole = *self.whole.get(index)?;
        is_whole.then(|| [0, 1, self.nodes[0], self.nodes[0] + 1].map(|next| self.values[index + next]))
    }

    /// The plane through one value of a cell's corners.
    pub(super) fn plane(&self, corners: &[Node; 4], value: usize) -> Plane {
        let [a, b, c, d] = corners.map(|corner| corner[value]);
        let step = 2.0 * self.step as f64;
        Plane { middle: 0.25 * (a + b + c + d), rise: [(b + d - a - c) / step, (c + d - a - b) / step] }
    }

    /// Whether rows and columns go on evenly across a cell: where one part of the surface hides another they jump.
    fn is_one_piece(&self, index: usize) -> bool {
        let [columns, rows] = self.nodes;
        if index % columns + 1 >= columns || index / columns + 1 >= rows {
            return false;
        }
        let [a, b, c, d] = [0, 1, columns, columns + 1].map(|next| self.values[index + next]);
        let apart = |p: Node, q: Node| (p[1] - q[1]).hypot(p[2] - q[2]);
        let twist = (a[1] + d[1] - b[1] - c[1]).hypot(a[2] + d[2] - b[2] - c[2]);
        let sides = [apart(a, b), apart(c, d), apart(a, c), apart(b, d)];
        // NaN is no piece.
        twist <= 0.5 * sides.into_iter().fold(0.0, f64::max)
            && sides[0].max(sides[1]) <= 3.0 * sides[0].min(sides[1])
            && sides[2].max(sides[3]) <= 3.0 * sides[2].min(sides[3])
    }

    /// The height at a place of the picture and its rise, between nodes.
    fn at(&self, at: [f64; 2]) -> Option<(f64, [f64; 2])> {
        let step = self.step as f64;
        let cell = [0, 1].map(|k| ((at[k] - self.place(0)) / step).floor());
        if cell.iter().any(|cell| *cell < 0.0) || (0..2).any(|k| cell[k] as usize >= self.nodes[k]) {
            return None;
        }
        let cell = cell.map(|cell| cell as usize);
        let [a, b, c, d] = self.corners(cell)?.map(|corner| corner[0]);
        let [u, v] = [0, 1].map(|k| (at[k] - self.place(cell[k])) / step);
        let (top, bottom) = (a + u * (b - a), c + u * (d - c));
        Some((top + v * (bottom - top), [((1.0 - v) * (b - a) + v * (d - c)) / step, (bottom - top) / step]))
    }

    /// The places of a line from one of its places on, for so many pixels one way: with its higher side to the right where `way` is 1. `None`
    /// where it ends before.
    pub(super) fn along(&self, from: [f64; 2], level: f64, way: f64, reach: f64) -> Option<Vec<[f64; 2]>> {
        let step = self.step as f64;
        let (mut at, mut places) = (from, Vec::new());
        let mut left = reach;
        while left > 0.0 {
            let (_, rise) = self.at(at)?;
            let steep = rise[0].hypot(rise[1]);
            if steep <= 0.0 {
                return None;
            }
            let length = left.min(step);
            let next = [at[0] - way * length * rise[1] / steep, at[1] + way * length * rise[0] / steep];
            // Back onto the line.
            let (height, rise) = self.at(next)?;
            let steep = rise[0].hypot(rise[1]).max(f64::MIN_POSITIVE);
            let off = (level - height) / steep;
            if off.abs() > NEAR * step {
                return None;
            }
            at = [0, 1].map(|k| next[k] + off * rise[k] / steep);
            places.push(at);
            left -= length;
        }
        Some(places)
    }

    /// A place of the line near one that is between nodes: between the picture's own samples. `None` where there is none.
    pub(super) fn onto(&self, from: [f64; 2], level: f64) -> Option<[f64; 2]> {
        let parts = self.parts as f64;
        let mut at = from;
        for _ in 0..6 {
            let sample_at = at.map(|pixels| pixels * parts - 0.5);
            let corner = sample_at.map(f64::floor);
            if (0..2).any(|k| corner[k] < 0.0 || corner[k] + 1.0 >= [self.seen.width, self.seen.height][k] as f64) {
                return None;
            }
            let [x, y] = corner.map(|corner| corner as usize);
            let height = |x: usize, y: usize| sample(self.resolver, self.seen, [x, y]).map(|[height, ..]| height);
            let [a, b, c, d] = [height(x, y)?, height(x + 1, y)?, height(x, y + 1)?, height(x + 1, y + 1)?];
            let [u, v] = [0, 1].map(|k| sample_at[k] - corner[k]);
            let (top, bottom) = (a + u * (b - a), c + u * (d - c));
            let rise = [((1.0 - v) * (b - a) + v * (d - c)) * parts, (bottom - top) * parts];
            let steep = rise[0].hypot(rise[1]);
            let off = (level - top - v * (bottom - top)) / steep;
            if !off.is_finite() {
                return None;
            }
            if off.abs() < 0.1 {
                return Some(at);
            }
            at = [0, 1].map(|k| at[k] + off.clamp(-1.0, 1.0) * rise[k] / steep);
            if (at[0] - from[0]).hypot(at[1] - from[1]) > NEAR * self.step as f64 {
                return None;
            }
        }
        None
    }

    /// Whether what is behind a text is one piece of the surface.
    pub(super) fn is_whole(&self, label: &ContourLabel) -> bool {
        let [left, top, right, bottom] = label.area();
        let step = self.step as f64;
        let ends = |low: f64, high: f64| {
            let [low, high] = [low, high].map(|at| ((at - self.place(0)) / step).floor().max(0.0) as usize);
            low..=high
        };
        ends(top, bottom).all(|y| {
            ends(left, right).all(|x| !label.holds(self.middle([x, y]), 0.5 * step) || self.corners([x, y]).is_some())
        })
    }
}

/// Height, row and column at a sample of the picture.
fn sample(resolver: &Resolver<'_>, seen: &Visibility, [x, y]: [usize; 2]) -> Option<Node> {
    let shown = seen.at(y * seen.width + x)?;
    let hit = resolver.look(shown, [x as f64 + 0.5, y as f64 + 0.5]).filter(|hit| !hit.is_membrane && !hit.is_pole)?;
    let [row, column, height] = hit.under;
    Some([height, row, column])
}
