//! The hierarchy: for each node above the samples its large point, its directed set, and their errors.

use super::cut::prices;
use super::error::{Options, Types};
use super::fit::overlapping;
use super::grid::{Samples, Shape, factors, for_each_place, index, volume};
use super::planes::{Planes, range};
use super::pyramid::{Means, counts, means, shapes};
use super::sets::{MOST, NONE};
use super::tables::{Table, dot};
use rayon::prelude::*;

/// Cells along an axis of a node, at most: what is finer counts as variation within a cell.
const SIDES: [usize; 2] = [8, 8];

/// A level of nodes; `levels[0]` has those of 2^D samples.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Number of nodes.
    pub shape: Shape,
    /// Of each plane: the large point's value.
    pub large: Vec<Vec<f32>>,
    /// Whether the large point blends with its neighbours; else it ends at the node's border.
    pub soft: Vec<bool>,
    /// Whether the directed set lies on what blended large points show, its own among them: then its points' values are theirs without
    /// the large point's. Else it ends at the node's border by itself.
    pub laid: Vec<bool>,
    /// The directed set, a byte of [`super::sets::Set`].
    pub set: Vec<u8>,
    /// Of each plane: the values of its points.
    pub points: Vec<Vec<[f32; MOST]>>,
    /// Sum of squared differences, weighted over planes, of the large point.
    pub large_error: Vec<f32>,
    /// The same of the directed set; infinite where there is none.
    pub set_error: Vec<f32>,
    /// Largest difference in any plane, of the large point.
    pub large_max: Vec<f32>,
    /// The same of the directed set.
    pub set_max: Vec<f32>,
    /// Samples that are numbers.
    pub samples: Vec<u32>,
    /// The error that a point more must spare so that the node is refined; see [`super::cut`].
    pub refine: Vec<f32>,
    /// The same so that the directed set is drawn in place of the large point.
    pub direct: Vec<f32>,
}

/// A hierarchy of points over samples.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    /// 2 or 3.
    pub dimensions: usize,
    /// Number of samples.
    pub shape: Shape,
    /// What it was built of.
    pub planes: Planes,
    /// Nodes, the finest first; none for a single sample.
    pub levels: Vec<Level>,
    /// By what sets were chosen.
    pub types: Types,
    /// Each plane's range.
    pub ranges: Vec<(f32, f32)>,
}

/// What a node's cells are: means of a level of the pyramid.
struct Cells<'a> {
    dimensions: usize,
    side: usize,
    shape: Shape,
    /// Samples of a whole cell.
    samples: f32,
    planes: Vec<&'a [f32]>,
    low: Vec<&'a [f32]>,
    high: Vec<&'a [f32]>,
    variation: Vec<Option<&'a [f32]>>,
}

impl Cells<'_> {
    fn node(&self, at: Shape, from: &[f32], out: &mut [f32]) {
        let s = self.side;
        let depth = if self.dimensions == 2 { 1 } else { s };
        let mut to = 0;
        for z in 0..depth {
            let z = if depth == 1 { 0 } else { (at[2] * s + z).min(self.shape[2] - 1) };
            for y in 0..s {
                let y = (at[1] * s + y).min(self.shape[1] - 1);
                let row = (z * self.shape[1] + y) * self.shape[0];
                let x = at[0] * s;
                if x + s <= self.shape[0] {
                    out[to..to + s].copy_from_slice(&from[row + x..row + x + s]);
                } else {
                    (0..s).for_each(|k| out[to + k] = from[row + (x + k).min(self.shape[0] - 1)]);
                }
                to += s;
            }
        }
    }

    fn within(&self, at: Shape, plane: usize) -> f32 {
        let Some(variation) = self.variation[plane] else { return 0.0 };
        let s = self.side;
        let end: Shape = std::array::from_fn(|k| {
            let side = if k < self.dimensions { s } else { 1 };
            ((at[k] + 1) * side).min(self.shape[k])
        });
        let first: Shape = std::array::from_fn(|k| if k < self.dimensions { at[k] * s } else { 0 });
        let mut sum = 0.0;
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let row = index(self.shape, [0, y, z]);
                sum += variation[row + first[0]..row + end[0]].iter().sum::<f32>();
            }
        }
        sum
    }
}

/// What a level of points that blend shows in a node's cells.
fn blended(
    dimensions: usize,
    side: usize,
    shape: Shape,
    at: Shape,
    values: &[f32],
    scratch: &mut [f32],
    out: &mut [f32],
) {
    // Three values along each axis, those outside as the next one inside.
    let near =
        |k: usize, step: usize| if k < dimensions { (at[k] + step).saturating_sub(1).min(shape[k] - 1) } else { 0 };
    let weights = |c: usize| {
        let d = (c as f32 + 0.5) / side as f32 - 0.5;
        if d < 0.0 { (0, -d) } else { (2, d) }
    };
    let depth = if dimensions == 2 { 1 } else { 3 };
    // Along x: rows of cells for the nine neighbours in y and z.
    let (rows, planes) = scratch.split_at_mut(9 * side);
    for z in 0..depth {
        for y in 0..3 {
            let line = index(shape, [0, near(1, y), if depth == 1 { 0 } else { near(2, z) }]);
            let v: [f32; 3] = std::array::from_fn(|x| values[line + near(0, x)]);
            for c in 0..side {
                let (other, w) = weights(c);
                rows[(z * 3 + y) * side + c] = v[1] + w * (v[other] - v[1]);
            }
        }
    }
    for z in 0..depth {
        for c in 0..side {
            let (other, w) = weights(c);
            for x in 0..side {
                let (own, next) = (rows[(z * 3 + 1) * side + x], rows[(z * 3 + other) * side + x]);
                planes[(z * side + c) * side + x] = own + w * (next - own);
            }
        }
    }
    if depth == 1 {
        out[..side * side].copy_from_slice(&planes[..side * side]);
        return;
    }
    let area = side * side;
    for c in 0..side {
        let (other, w) = weights(c);
        for i in 0..area {
            let (own, next) = (planes[area + i], planes[other * area + i]);
            out[c * area + i] = own + w * (next - own);
        }
    }
}

/// What is found of a node.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    laid: bool,
    set: u8,
    entry: u32,
    large_error: f32,
    set_error: f32,
    large_max: f32,
    set_max: f32,
}

impl Hierarchy {
    /// Builds the hierarchy of samples.
    pub fn build(samples: &Samples, options: &Options) -> Hierarchy {
        let planes = Planes::new(samples, options.colours);
        let shapes = shapes(samples.dimensions, samples.shape);
        let pyramids: Vec<Vec<Means>> =
            planes.values.iter().map(|plane| means(samples.dimensions, &shapes, plane)).collect();
        let ranges: Vec<(f32, f32)> = planes.values.iter().map(|plane| range(plane)).collect();
        let mut hierarchy = Hierarchy {
            dimensions: samples.dimensions,
            shape: samples.shape,
            planes,
            levels: Vec::new(),
            types: options.types,
            ranges,
        };
        for level in 1..shapes.len() {
            let made = hierarchy.level(level, &shapes, &pyramids, options);
            hierarchy.levels.push(made);
        }
        prices(&mut hierarchy, &pyramids, options.metric);
        hierarchy
    }

    fn level(&self, level: usize, shapes: &[Shape], pyramids: &[Vec<Means>], options: &Options) -> Level {
        let d = self.dimensions;
        let side = (1_usize << level.min(16)).min(SIDES[d - 2]);
        let below = level - side.trailing_zeros() as usize;
        let (shape, own) = (shapes[level], level - 1);
        let pick = |of: fn(&Means) -> &Vec<f32>| -> Vec<&[f32]> {
            let planes = self.planes.values.iter().zip(pyramids);
            planes.map(|(plane, p)| if below == 0 { plane.as_slice() } else { of(&p[below - 1]).as_slice() }).collect()
        };
        let cells = Cells {
            dimensions: d,
            side,
            shape: shapes[below],
            samples: (1_u64 << (below * d).min(60)) as f32,
            planes: pick(|m| &m.mean),
            low: pick(|m| &m.low),
            high: pick(|m| &m.high),
            variation: pyramids.iter().map(|p| (below > 0).then(|| p[below - 1].variation.as_slice())).collect(),
        };
        let table = Table::new(d, side);
        let weights = &self.planes.weights;
        let spans: Vec<f32> = self.ranges.iter().map(|(low, high)| high - low).collect();
        let splines: Vec<Vec<f32>> =
            cells.planes.iter().map(|plane| overlapping(d, plane, cells.shape, shape, side)).collect();
        let scratch_len = 9 * side + 3 * side * side;
        let count = counts(d, self.shape, level);
        // Which points blend.
        let constant = |node: usize| pyramids.iter().all(|p| p[own].low[node] == p[own].high[node]);
        let soft: Vec<bool> = for_each_place(shape, |at| {
            let node = index(shape, at);
            if constant(node) {
                return false;
            }
            let (mut x, mut u, mut scratch) = (vec![0.0; table.cells], vec![0.0; table.cells], vec![0.0; scratch_len]);
            let mut less = 0.0;
            for (p, plane) in cells.planes.iter().enumerate() {
                cells.node(at, plane, &mut x);
                blended(d, side, shape, at, &splines[p], &mut scratch, &mut u);
                let mean = pyramids[p][own].mean[node];
                let (mut crisp, mut blend) = (0.0, 0.0);
                for (x, u) in x.iter().zip(&u) {
                    crisp += (x - mean) * (x - mean);
                    blend += (x - u) * (x - u);
                }
                less += weights[p] * (crisp - blend);
            }
            less > 0.0
        });
        let large: Vec<Vec<f32>> = splines
            .into_iter()
            .zip(pyramids)
            .map(|(spline, p)| {
                let means = &p[own].mean;
                (0..spline.len()).into_par_iter().map(|i| if soft[i] { spline[i] } else { means[i] }).collect()
            })
            .collect();
        let find = |at: Shape| -> Found {
            let node = index(shape, at);
            let mut found = Found { set_error: f32::INFINITY, set_max: f32::INFINITY, ..Found::default() };
            if constant(node) {
                return found;
            }
            let n = table.cells;
            let number = cells.planes.len();
            let (mut x, mut u, mut scratch) = (vec![0.0; n * number], vec![0.0; n], vec![0.0; scratch_len]);
            // What blended points leave.
            let mut rest = vec![0.0; n * number];
            let (mut variation, mut uneven) = (0.0, 0.0);
            for p in 0..number {
                let (x, rest) = (&mut x[p * n..(p + 1) * n], &mut rest[p * n..(p + 1) * n]);
                cells.node(at, cells.planes[p], x);
                blended(d, side, shape, at, &large[p], &mut scratch, &mut u);
                rest.iter_mut().zip(&*x).zip(&u).for_each(|((rest, x), u)| *rest = x - u);
                if !soft[node] {
                    u.fill(large[p][node]);
                }
                let (error, most) = self.difference(&cells, at, p, x, &u);
                found.large_error += error;
                found.large_max = found.large_max.max(most);
                centred(x);
                centred(rest);
                variation += weights[p] * dot(x, x);
                uneven += weights[p] * dot(rest, rest);
            }
            let share = count(at) as f32 / (cells.samples * n as f32);
            found.large_error *= share;
            let worth: f32 = (0..number).map(|p| weights[p] * spans[p] * spans[p]).sum::<f32>() * 1e-8 * n as f32;
            if options.types == Types::Round || found.large_error <= 0.0 || variation <= worth {
                return found;
            }
            let children: usize = super::grid::children(d, shapes[level - 1], at).count();
            for laid in [false, true] {
                let (of, left) = if laid { (&rest, uneven) } else { (&x, variation) };
                let Some(entry) = choose(&table, of, weights, left, children) else { continue };
                let chosen = &table.entries[entry];
                let (mut set_error, mut set_max) = (0.0, 0.0_f32);
                let mut own = vec![0.0; n];
                for p in 0..number {
                    cells.node(at, cells.planes[p], &mut own);
                    let values = self.values(chosen, p, laid, if laid { &rest[p * n..(p + 1) * n] } else { &own });
                    if laid {
                        blended(d, side, shape, at, &large[p], &mut scratch, &mut u);
                    } else {
                        u.fill(0.0);
                    }
                    for (k, shares) in chosen.shares.iter().enumerate() {
                        u.iter_mut().zip(shares).for_each(|(u, share)| *u += share * values[k]);
                    }
                    let (error, most) = self.difference(&cells, at, p, &own, &u);
                    set_error += error;
                    set_max = set_max.max(most);
                }
                set_error *= share;
                if set_error < found.large_error.min(found.set_error) {
                    (found.laid, found.set, found.entry) = (laid, chosen.code, entry as u32);
                    (found.set_error, found.set_max) = (set_error, set_max);
                }
            }
            found
        };
        let found = for_each_place(shape, find);
        let points: Vec<Vec<[f32; MOST]>> = (0..cells.planes.len())
            .map(|p| {
                for_each_place(shape, |at| {
                    let found = &found[index(shape, at)];
                    if found.set == NONE {
                        return [0.0; MOST];
                    }
                    let mut x = vec![0.0; table.cells];
                    cells.node(at, cells.planes[p], &mut x);
                    if found.laid {
                        let (mut u, mut scratch) = (vec![0.0; table.cells], vec![0.0; scratch_len]);
                        blended(d, side, shape, at, &large[p], &mut scratch, &mut u);
                        x.iter_mut().zip(&u).for_each(|(x, u)| *x -= u);
                        centred(&mut x);
                    }
                    self.values(&table.entries[found.entry as usize], p, found.laid, &x)
                })
            })
            .collect();
        let column = |of: fn(&Found) -> f32| found.par_iter().map(of).collect::<Vec<f32>>();
        let nodes = volume(shape);
        Level {
            shape,
            large,
            soft,
            laid: found.par_iter().map(|f| f.laid).collect(),
            set: found.par_iter().map(|f| f.set).collect(),
            points,
            large_error: column(|f| f.large_error),
            set_error: column(|f| f.set_error),
            large_max: column(|f| f.large_max),
            set_max: column(|f| f.set_max),
            samples: self.numbers(level, shape),
            refine: vec![0.0; nodes],
            direct: vec![0.0; nodes],
        }
    }

    /// Samples of each node that are numbers.
    fn numbers(&self, level: usize, shape: Shape) -> Vec<u32> {
        let count = counts(self.dimensions, self.shape, level);
        if self.planes.holes.is_empty() {
            return for_each_place(shape, |at| count(at) as u32);
        }
        let by = factors(self.dimensions);
        let side: Shape = std::array::from_fn(|k| if by[k] == 2 { 1 << level } else { 1 });
        for_each_place(shape, |at| {
            let end: Shape = std::array::from_fn(|k| ((at[k] + 1) * side[k]).min(self.shape[k]));
            let mut number = 0;
            for z in at[2] * side[2]..end[2] {
                for y in at[1] * side[1]..end[1] {
                    let row = index(self.shape, [0, y, z]);
                    number +=
                        self.planes.holes[row + at[0] * side[0]..row + end[0]].iter().filter(|&&hole| !hole).count()
                            as u32;
                }
            }
            number
        })
    }

    /// A set's values of least squares, kept within the plane's range; those that are laid on others within its span.
    fn values(&self, entry: &super::tables::Entry, plane: usize, laid: bool, x: &[f32]) -> [f32; MOST] {
        let (low, high) = self.ranges[plane];
        let (low, high) = if laid { (low - high, high - low) } else { (low, high) };
        std::array::from_fn(|k| entry.solve.get(k).map_or(0.0, |solve| dot(solve, x).clamp(low, high)))
    }

    /// The sum of squared differences over whole cells, weighted, and the largest difference.
    fn difference(&self, cells: &Cells, at: Shape, plane: usize, x: &[f32], u: &[f32]) -> (f32, f32) {
        let squares: f32 = x.iter().zip(u).map(|(x, u)| (x - u) * (x - u)).sum();
        let error = self.planes.weights[plane] * (cells.samples * squares + cells.within(at, plane));
        let most = if cells.variation[plane].is_none() {
            x.iter().zip(u).map(|(x, u)| (x - u).abs()).fold(0.0, f32::max)
        } else {
            let (mut low, mut high) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            cells.node(at, cells.low[plane], &mut low);
            cells.node(at, cells.high[plane], &mut high);
            (0..x.len()).map(|c| (u[c] - low[c]).max(high[c] - u[c])).fold(0.0, f32::max)
        };
        (error, most)
    }
}

/// Takes the mean away.
fn centred(values: &mut [f32]) {
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    values.iter_mut().for_each(|v| *v -= mean);
}

/// The entry of the set that explains most of cells without their mean, for its points; `variation` is the weighted sum of their squares.
fn choose(table: &Table, x: &[f32], weights: &[f32], variation: f32, children: usize) -> Option<usize> {
    let n = table.cells;
    let gain = |entry: usize| -> f32 {
        let basis = &table.entries[entry].basis;
        weights
            .iter()
            .enumerate()
            .map(|(p, w)| {
                let x = &x[p * n..(p + 1) * n];
                w * basis.iter().map(|b| dot(b, x)).map(|along| along * along).sum::<f32>()
            })
            .sum()
    };
    // The best directions by their wide sets, where there are many.
    let mut ranked: Vec<(usize, f32)> =
        table.wide.iter().enumerate().filter_map(|(n, wide)| wide.map(|wide| (n, gain(wide)))).collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut best: [Option<(usize, f32)>; 2] = [None, None];
    for &(direction, _) in ranked.iter().take(3) {
        for entry in table.of_direction[direction].clone() {
            let points = table.entries[entry].set.points;
            if points >= children {
                continue;
            }
            let gain = gain(entry);
            let best = &mut best[points - 2];
            if best.is_none_or(|(_, most)| gain > most) {
                *best = Some((entry, gain));
            }
        }
    }
    match best {
        [Some((two, less)), Some((three, more))] => {
            // The third point must spare as much as those that the children have more.
            let left = (variation - more).max(0.0) / (children as f32 - 3.0).max(1.0);
            Some(if more - less >= left.min(less) { three } else { two })
        }
        [two, three] => two.or(three).map(|(entry, _)| entry),
    }
}
