//! Parts of contour lines: found in a band of rows, and joined where they meet.

use super::contours::crossing;
use crate::model::{Cell, HeightGrid};
use std::collections::{HashMap, VecDeque};
use std::hash::{BuildHasherDefault, Hasher};

/// An edge of T: four times the number of its first sample (row by row), and its kind: 0 along a row, 1 along a column, 2 and 3 the diagonals.
pub(super) type Edge = u64;

/// A part of a line, whose ends lie on edges of T.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    /// Which level.
    pub level: u32,
    /// Its points.
    pub points: VecDeque<[f64; 2]>,
    /// The edges of its ends where it may go on; of a closed line, or at a border or a hole, none.
    pub ends: [Option<Edge>; 2],
}

impl Chain {
    /// Which of its ends is on an edge.
    fn end_at(&self, edge: Edge) -> usize {
        usize::from(self.ends[0] != Some(edge))
    }

    /// Appends another, whose end on an edge is this one's as well.
    fn join(mut self, edge: Edge, mut other: Chain) -> Chain {
        // The longer one stays as it is.
        if self.points.len() < other.points.len() {
            std::mem::swap(&mut self, &mut other);
        }
        let (end, start) = (self.end_at(edge), other.end_at(edge));
        self.ends[end] = other.ends[1 - start];
        if start == 0 {
            other.points.pop_front();
        } else {
            other.points.pop_back();
        }
        let mut add =
            |point: [f64; 2]| if end == 0 { self.points.push_front(point) } else { self.points.push_back(point) };
        if start == 0 {
            other.points.into_iter().for_each(&mut add);
        } else {
            other.points.into_iter().rev().for_each(&mut add);
        }
        self
    }
}

/// Mixes numbers of edges; a quick hash is enough for what no one chooses.
#[derive(Default)]
pub(super) struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u32(&mut self, value: u32) {
        self.write_u64(u64::from(value));
    }

    fn write_u64(&mut self, value: u64) {
        let mixed = (self.0.rotate_left(23) ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ (mixed >> 29);
    }
}

type Ends = HashMap<(Edge, u32), usize, BuildHasherDefault<Mix>>;

/// Chains that grow together.
#[derive(Default)]
pub(super) struct Stitch {
    chains: Vec<Option<Chain>>,
    /// Places in `chains` that are free.
    free: Vec<usize>,
    ends: Ends,
}

impl Stitch {
    /// Adds a chain, joins it with those that end on its edges, and gives what is thereby done: closed, or without an open end.
    pub(super) fn add(&mut self, mut chain: Chain) -> Option<Chain> {
        for edge in chain.ends.into_iter().flatten() {
            let Some(other) = self.take(edge, chain.level) else { continue };
            let [one, two] = chain.ends;
            let is_ring =
                chain.ends.iter().all(Option::is_some) && (other.ends == [one, two] || other.ends == [two, one]);
            chain = chain.join(edge, other);
            if is_ring {
                chain.ends = [None, None];
                return Some(chain);
            }
        }
        if chain.ends == [None, None] {
            return Some(chain);
        }
        self.keep(chain);
        None
    }

    fn keep(&mut self, chain: Chain) {
        let level = chain.level;
        let ends = chain.ends;
        let place = match self.free.pop() {
            Some(place) => {
                self.chains[place] = Some(chain);
                place
            }
            None => {
                self.chains.push(Some(chain));
                self.chains.len() - 1
            }
        };
        for edge in ends.into_iter().flatten() {
            self.ends.insert((edge, level), place);
        }
    }

    /// Takes out the chain that ends on an edge.
    fn take(&mut self, edge: Edge, level: u32) -> Option<Chain> {
        let place = *self.ends.get(&(edge, level))?;
        let chain = self.chains[place].take()?;
        self.free.push(place);
        for edge in chain.ends.into_iter().flatten() {
            self.ends.remove(&(edge, level));
        }
        Some(chain)
    }

    /// Ends on edges above a row of samples go on nowhere; gives the chains that are done thereby.
    pub(super) fn close_above(&mut self, row: u64, columns: u64) -> Vec<Chain> {
        let first = 4 * row * columns;
        let mut closed: Vec<(Edge, u32)> = self.ends.keys().copied().filter(|(edge, _)| *edge < first).collect();
        closed.sort_unstable();
        let mut done = Vec::new();
        for (edge, level) in closed {
            let Some(place) = self.ends.remove(&(edge, level)) else { continue };
            let Some(chain) = &mut self.chains[place] else { continue };
            let end = chain.end_at(edge);
            chain.ends[end] = None;
            if chain.ends == [None, None] {
                done.extend(self.chains[place].take());
                self.free.push(place);
            }
        }
        done
    }

    /// All that are left, in order, with the ends that are left.
    fn rest(self) -> impl Iterator<Item = Chain> {
        self.chains.into_iter().flatten()
    }
}

/// Rows of samples.
pub(super) struct Band<'a> {
    /// The field's grid.
    pub grid: &'a HeightGrid,
    /// The first row.
    pub first: u64,
    /// Heights of whole rows, at least two.
    pub heights: &'a [f64],
}

/// The chains of a band at levels, which grow. Ends are open on its first and last row, unless these are the field's.
pub(super) fn chains_of(band: &Band<'_>, levels: &[f64]) -> Vec<Chain> {
    let columns = band.grid.columns;
    let width = columns as usize;
    let mut stitch = Stitch::default();
    let mut done = Vec::new();
    let (mut upper_below, mut lower_below) = (vec![0; width], vec![0; width]);
    count_below(&band.heights[..width], levels, &mut lower_below);
    for (number, (upper, lower)) in
        band.heights.chunks_exact(width).zip(band.heights.chunks_exact(width).skip(1)).enumerate()
    {
        let row = band.first + number as u64;
        std::mem::swap(&mut upper_below, &mut lower_below);
        count_below(lower, levels, &mut lower_below);
        for (column, (up, low)) in upper_below.windows(2).zip(lower_below.windows(2)).enumerate() {
            let below = [up[0], up[1], low[0], low[1]];
            // Most cells have no line in them.
            if below == [below[0]; 4] {
                continue;
            }
            let cell = Cell([upper[column], upper[column + 1], lower[column], lower[column + 1]]);
            let first = row * columns + column as u64;
            for triangle in cell.triangles() {
                let own = triangle.corners.map(|corner| below[corner]);
                let crossed = own[0].min(own[1]).min(own[2])..own[0].max(own[1]).max(own[2]);
                if crossed.is_empty() {
                    continue;
                }
                let corners = triangle
                    .corners
                    .map(|corner| (first + corner as u64 / 2 * columns + corner as u64 % 2, cell.0[corner]));
                for level in crossed {
                    let chain = segment(band.grid, corners, level, levels[level as usize]);
                    done.extend(stitch.add(chain));
                }
            }
        }
    }
    let rows = (band.heights.len() / width) as u64;
    let last = band.first + rows - 1;
    let (has_above, has_below) = (band.first > 0, last + 1 < band.grid.rows);
    // Of edges along the first row and along the last.
    let (top, bottom) = (4 * (band.first + 1) * columns, 4 * last * columns);
    for mut chain in stitch.rest() {
        for end in &mut chain.ends {
            let is_open = |edge: Edge| {
                let is_along = edge & 3 == 0;
                is_along && ((has_above && edge < top) || (has_below && edge >= bottom))
            };
            *end = end.filter(|edge| is_open(*edge));
        }
        done.push(chain);
    }
    done
}

/// How many of the levels each height of a row is not below; of what was not measured any number.
fn count_below(row: &[f64], levels: &[f64], out: &mut [u32]) {
    // Neighbours are mostly between the same levels.
    let (mut count, mut between) = (0, [f64::INFINITY, f64::NEG_INFINITY]);
    for (out, &height) in out.iter_mut().zip(row) {
        if !(between[0] <= height && height < between[1]) {
            count = levels.partition_point(|level| *level <= height);
            let before = count.checked_sub(1).map_or(f64::NEG_INFINITY, |before| levels[before]);
            between = [before, levels.get(count).copied().unwrap_or(f64::INFINITY)];
        }
        *out = count as u32;
    }
}

/// The part of a level's line in a triangle, of whose samples some are below and some are not.
fn segment(grid: &HeightGrid, corners: [(u64, f64); 3], level: u32, height: f64) -> Chain {
    let mut points = VecDeque::with_capacity(4);
    let mut ends = [None; 2];
    for (one, other) in [(0, 1), (1, 2), (0, 2)] {
        let ((low, from), (high, to)) = (corners[one], corners[other]);
        if (from >= height) != (to >= height) {
            ends[points.len().min(1)] = Some(edge_of(grid, low, high));
            points.push_back(crossing(grid, height, [low, high], [from, to]));
        }
    }
    Chain { level, points, ends }
}

/// The edge between two samples, the lower number first.
fn edge_of(grid: &HeightGrid, low: u64, high: u64) -> Edge {
    let kind = match high - low {
        1 if grid.columns > 2 || high / grid.columns == low / grid.columns => 0,
        apart if apart == grid.columns => 1,
        apart if apart == grid.columns + 1 => 2,
        _ => 3,
    };
    4 * low + kind
}
