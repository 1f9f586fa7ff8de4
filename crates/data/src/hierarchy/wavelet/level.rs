//! The nodes of a level in a box: of each its large point, its directed set, and their errors.

use super::around::Changes;
use super::bricks::Part;
use super::cells::{Blend, Cells, scratch_len};
use super::choose::choose;
use super::error::Types;
use super::fit::{REACH, splines};
use super::grid::{Shape, children_in, for_each_place, for_each_place_with};
use super::kinds::tolerance;
use super::pyramid::{Means, counts};
use super::sets::{MOST, NONE, Set, nearest};
use super::tables::{Entry, Table, dot};
use super::tree::Level;
use rayon::prelude::*;

/// How much wider than the nodes that are built the box of what is known of their level is.
pub(super) const MARGIN: usize = REACH + 2;

/// How often each value is found anew where values of least squares lie outside of the range.
const DESCENTS: usize = 4;

/// What the nodes of a level in a box are built from.
pub(super) struct Nodes<'a> {
    /// 2 or 3.
    pub dimensions: usize,
    /// The level, 1 or more.
    pub level: usize,
    /// The shapes of the grid, of the level below and of the level.
    pub shapes: [Shape; 3],
    /// The nodes.
    pub part: Part,
    /// What is known of the nodes in a box that is [`MARGIN`] wider.
    pub own: (&'a [Means], Part),
    /// The cells of the nodes and of their neighbours.
    pub cells: Cells<'a>,
    /// How much each plane counts.
    pub weights: &'a [f32],
    /// The planes' ranges.
    pub ranges: &'a [(f32, f32)],
    /// By what sets are chosen.
    pub types: Types,
    /// The sets that the nodes may have, where something else than their errors chooses them.
    pub proposed: Option<&'a [u8]>,
    /// All sets in nodes of so many cells.
    pub table: &'a Table,
}

/// What is found of a node.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    laid: bool,
    set: u8,
    toward: u8,
    entry: u32,
    large_error: f32,
    set_error: f32,
    large_max: f32,
    set_max: f32,
}

/// What the work on a node needs: cells of all planes, and of one.
struct Scratch {
    x: Vec<f32>,
    /// What blended points leave.
    rest: Vec<f32>,
    own: Vec<f32>,
    shown: Vec<f32>,
    bounds: [Vec<f32>; 2],
    blend: Vec<f32>,
}

/// Takes the mean away.
fn centred(values: &mut [f32]) {
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    values.iter_mut().for_each(|v| *v -= mean);
}

impl Nodes<'_> {
    fn scratch(&self) -> Scratch {
        let (n, planes) = (self.table.cells, self.cells.planes.len());
        let cells = || vec![0.0; n];
        Scratch {
            x: vec![0.0; n * planes],
            rest: vec![0.0; n * planes],
            own: cells(),
            shown: cells(),
            bounds: [cells(), cells()],
            blend: vec![0.0; scratch_len(self.cells.side)],
        }
    }

    fn blend<'a>(&self, part: Part, values: &'a [f32]) -> Blend<'a> {
        Blend { dimensions: self.dimensions, of: self.shapes[2], part, values }
    }

    /// Whether a node's samples are all the same.
    fn is_constant(&self, at: Shape) -> bool {
        let node = self.own.1.index(at);
        self.own.0.iter().all(|means| means.low[node] == means.high[node])
    }

    /// Builds them; how many samples are numbers and what refining is worth is not known yet.
    pub fn build(&self) -> Level {
        let (d, of) = (self.dimensions, self.shapes[2]);
        // Which points blend depends on the values of their neighbours, and errors on which neighbours blend.
        let near = self.part.wider(1, d, of);
        let around = self.part.wider(2, d, of);
        let splines: Vec<Vec<f32>> = self
            .own
            .0
            .iter()
            .map(|means| splines(d, (&means.tent, &self.own.1), (&around, of), self.cells.side))
            .collect();
        let soft = self.soft(&near, &around, &splines);
        let large: Vec<Vec<f32>> = splines
            .iter()
            .zip(self.own.0)
            .map(|(spline, means)| {
                let value = |i: usize| {
                    let at = near.place(i);
                    if soft[i] { spline[around.index(at)] } else { means.mean[self.own.1.index(at)] }
                };
                (0..near.len()).into_par_iter().map(value).collect()
            })
            .collect();
        let place = |at: Shape| -> Shape { std::array::from_fn(|k| self.part.min[k] + at[k]) };
        let make = || self.scratch();
        let find = |scratch: &mut Scratch, at| self.find(scratch, place(at), (&near, &soft, &large));
        let found = for_each_place_with(self.part.shape, make, find);
        let points: Vec<Vec<[f32; MOST]>> = (0..self.cells.planes.len())
            .map(|p| {
                for_each_place_with(self.part.shape, make, |scratch, at| {
                    let found = &found[super::grid::index(self.part.shape, at)];
                    if found.set == NONE {
                        [0.0; MOST]
                    } else {
                        self.points(scratch, place(at), found, p, (&near, &large[p]))
                    }
                })
            })
            .collect();
        let column = |of: fn(&Found) -> f32| found.par_iter().map(of).collect::<Vec<f32>>();
        let own = |i: usize| near.index(self.part.place(i));
        let nodes = self.part.len();
        Level {
            shape: self.part.shape,
            large: large.iter().map(|large| (0..nodes).map(|i| large[own(i)]).collect()).collect(),
            soft: (0..nodes).map(|i| soft[own(i)]).collect(),
            laid: found.iter().map(|f| f.laid).collect(),
            set: found.iter().map(|f| f.set).collect(),
            toward: found.iter().map(|f| f.toward).collect(),
            points,
            large_error: column(|f| f.large_error),
            set_error: column(|f| f.set_error),
            large_max: column(|f| f.large_max),
            set_max: column(|f| f.set_max),
            samples: Vec::new(),
            refine: vec![0.0; nodes],
            direct: vec![0.0; nodes],
        }
    }

    /// Which points of a box blend: those whose error is less so.
    fn soft(&self, near: &Part, around: &Part, splines: &[Vec<f32>]) -> Vec<bool> {
        let n = self.table.cells;
        for_each_place_with(
            near.shape,
            || self.scratch(),
            |scratch, at| {
                let at: Shape = std::array::from_fn(|k| near.min[k] + at[k]);
                if self.is_constant(at) {
                    return false;
                }
                let node = self.own.1.index(at);
                let (x, u) = (&mut scratch.x[..n], &mut scratch.shown);
                let mut less = 0.0;
                for (p, means) in self.cells.planes.iter().enumerate() {
                    self.cells.node(at, &means.mean, x);
                    self.blend(*around, &splines[p]).show(self.cells.side, at, &mut scratch.blend, u);
                    let mean = self.own.0[p].mean[node];
                    let (mut crisp, mut blend) = (0.0, 0.0);
                    for (x, u) in x.iter().zip(&*u) {
                        crisp += (x - mean) * (x - mean);
                        blend += (x - u) * (x - u);
                    }
                    less += self.weights[p] * (crisp - blend);
                }
                less > 0.0
            },
        )
    }

    /// What a node is; `near` is the box of it and its neighbours, of which `soft` and `large` are known.
    fn find(&self, scratch: &mut Scratch, at: Shape, (near, soft, large): (&Part, &[bool], &[Vec<f32>])) -> Found {
        let mut found = Found { set_error: f32::INFINITY, set_max: f32::INFINITY, ..Found::default() };
        if self.is_constant(at) {
            return found;
        }
        let (n, number, side) = (self.table.cells, self.cells.planes.len(), self.cells.side);
        let node = near.index(at);
        let Scratch { x, rest, own, shown, bounds, blend } = scratch;
        let (mut variation, mut uneven) = (0.0, 0.0);
        for p in 0..number {
            let (x, rest) = (&mut x[p * n..(p + 1) * n], &mut rest[p * n..(p + 1) * n]);
            self.cells.node(at, &self.cells.planes[p].mean, x);
            self.blend(*near, &large[p]).show(side, at, blend, shown);
            rest.iter_mut().zip(&*x).zip(&*shown).for_each(|((rest, x), u)| *rest = x - u);
            if !soft[node] {
                shown.fill(large[p][node]);
            }
            let (error, most) = self.difference(at, p, (x, shown), bounds);
            found.large_error += error;
            found.large_max = found.large_max.max(most);
            centred(x);
            centred(rest);
            variation += self.weights[p] * dot(x, x);
            uneven += self.weights[p] * dot(rest, rest);
        }
        let count = counts(self.dimensions, self.shapes[0], self.level)(at) as f32;
        let share = count / (self.cells.samples * n as f32);
        found.large_error *= share;
        // Where one point is good enough, a set would take bytes of the file for nothing that is seen.
        if self.types == Types::Round || found.large_error <= tolerance(self.weights, self.ranges) * count {
            return found;
        }
        let children = children_in(self.dimensions, self.shapes[1], at).count();
        // Nodes of more cells tell by these which way they change.
        let changes = || Changes::around(&self.cells, at, self.weights, &self.table.directions);
        let few = (side == 2 && self.proposed.is_none()).then(changes);
        for laid in [false, true] {
            let (of, left) = if laid { (&*rest, uneven) } else { (&*x, variation) };
            let entry = match self.proposed {
                // At the grid's ends children may be as few.
                Some(proposed) => (self.table.of_code(proposed[self.part.index(at)]))
                    .filter(|&entry| self.table.entries[entry].set.points < children),
                None => choose(self.table, (of, left), self.weights, few.as_ref(), children),
            };
            let Some(entry) = entry else { continue };
            let chosen = &self.table.entries[entry];
            let (mut set_error, mut set_max) = (0.0, 0.0_f32);
            for p in 0..number {
                self.cells.node(at, &self.cells.planes[p].mean, own);
                let values = self.values(chosen, p, laid, if laid { &rest[p * n..(p + 1) * n] } else { own });
                if laid {
                    self.blend(*near, &large[p]).show(side, at, blend, shown);
                } else {
                    shown.fill(0.0);
                }
                for (k, shares) in chosen.shares.iter().enumerate() {
                    shown.iter_mut().zip(shares).for_each(|(u, share)| *u += share * values[k]);
                }
                let (error, most) = self.difference(at, p, (own, shown), bounds);
                set_error += error;
                set_max = set_max.max(most);
            }
            set_error *= share;
            if set_error < found.large_error.min(found.set_error) {
                (found.laid, found.set, found.entry) = (laid, chosen.code, entry as u32);
                (found.set_error, found.set_max) = (set_error, set_max);
            }
        }
        if let Some(n) = Set::direction_of(self.dimensions, found.set) {
            let [one, other] = nearest(self.dimensions, n);
            let is_other = one != other && few.unwrap_or_else(changes).more(other, one);
            found.toward = if is_other { other } else { one } as u8;
        }
        found
    }

    /// The values of a node's directed set, of one plane.
    fn points(
        &self,
        scratch: &mut Scratch,
        at: Shape,
        found: &Found,
        plane: usize,
        (near, large): (&Part, &[f32]),
    ) -> [f32; MOST] {
        let Scratch { own, shown, blend, .. } = scratch;
        self.cells.node(at, &self.cells.planes[plane].mean, own);
        if found.laid {
            self.blend(*near, large).show(self.cells.side, at, blend, shown);
            own.iter_mut().zip(&*shown).for_each(|(x, u)| *x -= u);
            centred(own);
        }
        self.values(&self.table.entries[found.entry as usize], plane, found.laid, own)
    }

    /// A set's values of least squares within the plane's range; of those that are laid on others within its span.
    fn values(&self, entry: &Entry, plane: usize, laid: bool, x: &[f32]) -> [f32; MOST] {
        let (low, high) = self.ranges[plane];
        let (low, high) = if laid { (low - high, high - low) } else { (low, high) };
        let mut values = [0.0; MOST];
        values.iter_mut().zip(&entry.solve).for_each(|(value, solve)| *value = dot(solve, x));
        let own = &mut values[..entry.solve.len()];
        if own.iter().all(|v| (low..=high).contains(v)) {
            return values;
        }
        // Some lie outside: the best that are inside, one after the other while those beside it stay.
        own.iter_mut().for_each(|v| *v = v.clamp(low, high));
        for _ in 0..DESCENTS {
            for (k, shares) in entry.shares.iter().enumerate() {
                let row = &entry.gram[k];
                let beside: f32 = (0..own.len()).filter(|&j| j != k).map(|j| row[j] * own[j]).sum();
                own[k] = ((dot(shares, x) - beside) / row[k]).clamp(low, high);
            }
        }
        values
    }

    /// The sum of squared differences over whole cells, weighted, and the largest difference.
    fn difference(&self, at: Shape, plane: usize, (x, u): (&[f32], &[f32]), bounds: &mut [Vec<f32>; 2]) -> (f32, f32) {
        let squares: f32 = x.iter().zip(u).map(|(x, u)| (x - u) * (x - u)).sum();
        let error = self.weights[plane] * (self.cells.samples * squares + self.cells.within(at, plane));
        let most = if self.cells.are_samples {
            x.iter().zip(u).map(|(x, u)| (x - u).abs()).fold(0.0, f32::max)
        } else {
            let [low, high] = bounds;
            let means = &self.cells.planes[plane];
            self.cells.node(at, &means.low, low);
            self.cells.node(at, &means.high, high);
            (0..x.len()).map(|c| (u[c] - low[c]).max(high[c] - u[c])).fold(0.0, f32::max)
        };
        (error, most)
    }
}

/// Samples that are numbers of the nodes of a level in a box, where all are.
pub(super) fn all_numbers(dimensions: usize, samples: Shape, level: usize, part: &Part) -> Vec<u32> {
    let count = counts(dimensions, samples, level);
    let of = |at: Shape| u32::try_from(count(std::array::from_fn(|k| part.min[k] + at[k]))).unwrap_or(u32::MAX);
    for_each_place(part.shape, of)
}
