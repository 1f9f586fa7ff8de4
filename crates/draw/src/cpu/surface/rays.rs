//! The exact ray caster: the first place where a pixel's ray meets the surface of a cut. The reference for every other technique, and what draws
//! pictures of all directions.
//!
//! From the whole field down to cells, a box of rows, columns and heights is entered only where the ray passes through it, the nearer ones first.
//! Boxes and cells are closed and a hair wider than they are, so that no ray slips between two of them. A box holds those in it also as they are
//! rounded, and so whether the least ones are met does not depend on how those around them are tried.

mod passing;

use super::placed::{GridRay, Placed};
use super::raster::{Shown, Visibility};
use super::sight::{Lens, Sight};
use super::stitch::{Mesh, Scene};
use crate::model::Bounds;
use deepfield_heights::hierarchy::chunks::ChunkKey;
use deepfield_heights::measure::{Course, Spread};
use deepfield_heights::model::Triangle;
use glam::DVec3;
use passing::Passing;
use rayon::prelude::*;

/// How much wider than they are cells and boxes are, in cells.
const HAIR: f64 = 1e-9;

/// A closed range of heights; empty where nothing is.
type Range = [f64; 2];

const EMPTY: Range = [f64::INFINITY, f64::NEG_INFINITY];

fn joined(a: Range, b: Range) -> Range {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// What a hit is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// The ray's parameter: the depth.
    pub t: f64,
    /// What was hit.
    pub shown: Shown,
}

/// Squares of cells from this level on know their range of heights: those of 4 x 4.
const FIRST: usize = 2;

/// Ranges of heights over squares of a chunk's cells: those of 4 x 4, of 8 x 8, and so on.
struct Pyramid {
    levels: Vec<Squares>,
}

struct Squares {
    rows: usize,
    columns: usize,
    ranges: Vec<Range>,
}

impl Pyramid {
    fn new(mesh: &Mesh) -> Pyramid {
        let (all_rows, all_columns) = (mesh.samples.rows - 1, mesh.samples.columns - 1);
        let cell = |row: usize, column: usize| {
            let cell = mesh.surface_cell(row, column);
            // Two corners hold nothing.
            let heights = cell.0.into_iter().filter(|height| !height.is_nan() && cell.measured() > 2);
            heights.fold(EMPTY, |range, height| joined(range, [height; 2]))
        };
        let (rows, columns) = (all_rows.div_ceil(1 << FIRST), all_columns.div_ceil(1 << FIRST));
        let square = |index: usize| {
            let ends = |first: usize, all: usize| first << FIRST..((first + 1) << FIRST).min(all);
            let cells =
                ends(index / columns, all_rows).flat_map(|r| ends(index % columns, all_columns).map(move |c| (r, c)));
            cells.fold(EMPTY, |range, (r, c)| joined(range, cell(r, c)))
        };
        let ranges = match mesh.samples.coverage.is_empty() && mesh.fill.is_none() {
            true => whole_squares(mesh, [rows, columns]),
            false => (0..rows * columns).map(square).collect(),
        };
        let mut levels = vec![Squares { rows, columns, ranges }];
        while let Some(last) = levels.last()
            && (last.rows > 1 || last.columns > 1)
        {
            let (rows, columns) = (last.rows.div_ceil(2), last.columns.div_ceil(2));
            let square = |index: usize| {
                let (row, column) = (2 * (index / columns), 2 * (index % columns));
                let parts = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(down, right)| [row + down, column + right]);
                let parts = parts.into_iter().filter(|[r, c]| *r < last.rows && *c < last.columns);
                parts.fold(EMPTY, |range, [r, c]| joined(range, last.ranges[r * last.columns + c]))
            };
            let next = Squares { rows, columns, ranges: (0..rows * columns).map(square).collect() };
            levels.push(next);
        }
        Pyramid { levels }
    }

    /// The level of the square that is the whole chunk.
    fn top(&self) -> usize {
        self.levels.len() - 1 + FIRST
    }

    fn range(&self) -> Range {
        self.levels.last().and_then(|level| level.ranges.first()).copied().unwrap_or(EMPTY)
    }

    /// The range of a square; `None` where it is not known.
    fn range_of(&self, level: usize, [row, column]: [usize; 2]) -> Option<Range> {
        let squares = self.levels.get(level.checked_sub(FIRST)?)?;
        squares.ranges.get(row * squares.columns + column).copied()
    }
}

/// The ranges of the smallest squares of a chunk that was measured everywhere.
fn whole_squares(mesh: &Mesh, [rows, columns]: [usize; 2]) -> Vec<Range> {
    let all = 0..mesh.samples.columns;
    let mut line = vec![0.0; all.len()];
    let mut ranges = vec![EMPTY; rows * columns];
    for row in 0..mesh.samples.rows {
        mesh.surface_line(row, &all, &mut line);
        // A row between two squares is of both.
        let squares = row.saturating_sub(1) >> FIRST..=(row >> FIRST).min(rows - 1);
        for column in 0..columns {
            let end = ((column + 1) << FIRST).min(all.len() - 1);
            let own = line[column << FIRST..=end].iter();
            let range = own.fold(EMPTY, |[low, high], height| [low.min(*height), high.max(*height)]);
            for square in squares.clone() {
                let known = &mut ranges[square * columns + column];
                *known = joined(*known, range);
            }
        }
    }
    ranges
}

/// A part of the quadtree with something drawn below it.
struct Branch {
    /// Between which rows and columns it is.
    rectangle: [[f64; 2]; 2],
    range: Range,
    below: Below,
}

enum Below {
    Mesh(usize),
    /// By row and column.
    Parts([Option<usize>; 4]),
}

/// A scene that rays are cast through.
pub struct Caster<'a> {
    scene: &'a Scene,
    pyramids: Vec<Pyramid>,
    branches: Vec<Branch>,
    root: Option<usize>,
    /// A globe's field.
    spread: Option<Spread>,
}

impl<'a> Caster<'a> {
    /// Prepares a scene.
    pub fn new(scene: &'a Scene) -> Caster<'a> {
        Caster::of(scene, scene.meshes.par_iter().map(Pyramid::new).collect())
    }

    /// The same by this thread alone. One that waits for others may meanwhile be given a task that waits for what it prepares.
    pub(super) fn alone(scene: &'a Scene) -> Caster<'a> {
        Caster::of(scene, scene.meshes.iter().map(Pyramid::new).collect())
    }

    fn of(scene: &'a Scene, pyramids: Vec<Pyramid>) -> Caster<'a> {
        let spread = scene.placed.spread();
        let mut caster = Caster { scene, pyramids, branches: Vec::new(), root: None, spread };
        let root = scene.lattice.root();
        caster.root =
            caster.branch(root, &scene.meshes.iter().enumerate().map(|(number, _)| number).collect::<Vec<_>>());
        caster
    }

    /// The part of the tree at a chunk; `meshes` are those in it.
    fn branch(&mut self, key: ChunkKey, meshes: &[usize]) -> Option<usize> {
        if meshes.is_empty() {
            return None;
        }
        let rectangle = self.scene.lattice.rectangle(key).map(|ends| ends.map(|end| end as f64));
        let own = meshes.iter().find(|number| self.scene.meshes[**number].node.key == key);
        let (range, below) = match own {
            Some(number) => (self.pyramids[*number].range(), Below::Mesh(*number)),
            None if key.level == 0 => return None,
            None => {
                let parts = key.quarters().map(|child| {
                    let is_in = |number: &&usize| {
                        let own = self.scene.meshes[**number].node.key;
                        own.level <= child.level && own.ancestor(child.level) == child
                    };
                    let inside: Vec<usize> = meshes.iter().filter(is_in).copied().collect();
                    self.branch(child, &inside)
                });
                let range = parts.iter().flatten().fold(EMPTY, |range, part| joined(range, self.branches[*part].range));
                (range, Below::Parts(parts))
            }
        };
        self.branches.push(Branch { rectangle, range, below });
        Some(self.branches.len() - 1)
    }

    /// The first hit of a ray between two parameters.
    pub fn cast(&self, ray: &GridRay, part: [f64; 2]) -> Option<RayHit> {
        let root = self.root?;
        let Branch { rectangle, range, .. } = &self.branches[root];
        let passing = Passing::new(ray, part, *rectangle, *range);
        self.cast_branch(root, &passing, part)
    }

    fn cast_branch(&self, number: usize, passing: &Passing<'_>, span: [f64; 2]) -> Option<RayHit> {
        let branch = &self.branches[number];
        let span = passing.through(branch.rectangle, branch.range, span)?;
        match &branch.below {
            Below::Mesh(mesh) => {
                let (level, at) = self.around(*mesh, passing, span);
                self.cast_square(*mesh, level, at, passing, [span, passing.part])
            }
            Below::Parts(parts) => {
                let mut parts = passing.order.into_iter().filter_map(|[row, column]| parts[2 * row + column]);
                parts.find_map(|part| self.cast_branch(part, passing, span))
            }
        }
    }

    /// The level and the place of the smallest square of a chunk's cells that a stretch of a ray over it does not leave: no other one is met.
    fn around(&self, number: usize, passing: &Passing<'_>, span: [f64; 2]) -> (usize, [usize; 2]) {
        let mesh = &self.scene.meshes[number];
        let whole = (1_u64 << mesh.node.key.level) as f64;
        let cell =
            |place: f64, places: &[u64]| (((place - places[0] as f64) / whole).max(0.0) as usize).min(places.len() - 2);
        let ([first, last], [left, right]) = (passing.ends(1, span), passing.ends(0, span));
        let ends = [cell(first, &mesh.rows), cell(left, &mesh.columns)];
        let differ = (ends[0] ^ cell(last, &mesh.rows)) | (ends[1] ^ cell(right, &mesh.columns));
        let level = FIRST.max((usize::BITS - differ.leading_zeros()) as usize);
        (level, [ends[0] >> level, ends[1] >> level])
    }

    /// The first hit in a square of a chunk's cells. `span` is the stretch in which the ray may be in it, `part` the one in the smallest square around
    /// that was met: those that know their range, and cells.
    fn cast_square(
        &self,
        number: usize,
        level: usize,
        at: [usize; 2],
        passing: &Passing<'_>,
        [mut span, mut part]: [[f64; 2]; 2],
    ) -> Option<RayHit> {
        let (mesh, pyramid) = (&self.scene.meshes[number], &self.pyramids[number]);
        if level == FIRST {
            part = within(passing.ray, square(mesh, level, at), pyramid.range_of(level, at), part)?;
            span = part;
        } else if level == 0 {
            let [from, _] = within(passing.ray, square(mesh, level, at), None, part)?;
            return self.cast_cell(number, at, passing, from);
        }
        let (level, first) = (level - 1, [2 * at[0], 2 * at[1]]);
        let places = [&mesh.rows, &mesh.columns];
        let halves = |axis: usize| {
            let middle = places[axis].get((first[axis] + 1) << level);
            passing.halves(1 - axis, middle.map(|place| *place as f64))
        };
        let (rows, columns) = (halves(0), halves(1));
        passing.order.into_iter().find_map(|[down, right]| {
            let at = [first[0] + down, first[1] + right];
            if (0..2).any(|axis| at[axis] << level >= places[axis].len() - 1) {
                return None;
            }
            let (rows, columns) = (rows[down], columns[right]);
            let span = [span[0].max(rows[0]).max(columns[0]), span[1].min(rows[1]).min(columns[1])];
            let span = match pyramid.range_of(level, at) {
                Some(range) => passing.over(range, span)?,
                None => Some(span).filter(|[from, to]| from <= to)?,
            };
            self.cast_square(number, level, at, passing, [span, part])
        })
    }

    /// The first hit in a cell, from so far on to the end of the stretch that is looked at: part of the cell may be beyond.
    fn cast_cell(&self, number: usize, [row, column]: [usize; 2], passing: &Passing<'_>, from: f64) -> Option<RayHit> {
        let mesh = &self.scene.meshes[number];
        let frame = CellFrame::of(mesh, [row, column]);
        let local = frame.ray(passing.ray);
        let stretch = from - HAIR * from.abs()..=passing.part[1];
        let mut best: Option<RayHit> = None;
        for (slot, (triangle, _)) in mesh.triangles(row, column).enumerate() {
            let Some(t) = local.meets(&triangle) else { continue };
            let [u, v, _] = local.0.at(t);
            let [k, m, n] = triangle.edge;
            let is_in = u.min(v) >= -HAIR && u.max(v) <= 1.0 + HAIR && k + m * u + n * v >= -HAIR;
            if is_in && stretch.contains(&t) && best.is_none_or(|best| t < best.t) {
                best = Some(RayHit { t, shown: Shown { node: number, at: [row, column], slot: Some(slot) } });
            }
        }
        best
    }

    /// The first hit of a picture's ray at a place.
    pub fn cast_pixel(&self, sight: &Sight, lens: &Lens, pixel: [f64; 2]) -> Option<RayHit> {
        let (origin, direction) = sight.ray_through(lens, pixel)?;
        let part = kept(&sight.cut().bounds, origin, direction)?;
        match &self.spread {
            Some(spread) => self.cast_curved(spread, origin, direction, part),
            None => self.cast(&self.scene.placed.ray(origin, direction)?, part),
        }
    }

    /// The first hit of a ray on a globe.
    fn cast_curved(&self, spread: &Spread, origin: DVec3, direction: DVec3, part: [f64; 2]) -> Option<RayHit> {
        let root = self.root?;
        let [_, top] = spread.lifted(self.branches[root].range);
        let courses = spread.courses(origin.to_array(), direction.to_array(), part, top);
        let mut best = None;
        for course in courses.iter() {
            self.curved_branch(root, &Curved { course, spread }, course.span, &mut best);
        }
        best
    }

    fn curved_branch(&self, number: usize, curved: &Curved<'_>, span: [f64; 2], best: &mut Option<RayHit>) {
        let branch = &self.branches[number];
        let [rows, columns] = branch.rectangle;
        let Some(span) = curved.within(rows, columns, branch.range, span, best) else { return };
        match &branch.below {
            Below::Mesh(mesh) => self.curved_square(*mesh, self.pyramids[*mesh].top(), [0, 0], curved, span, best),
            Below::Parts(parts) => {
                parts.iter().flatten().for_each(|part| self.curved_branch(*part, curved, span, best));
            }
        }
    }

    fn curved_square(
        &self,
        number: usize,
        level: usize,
        [row, column]: [usize; 2],
        curved: &Curved<'_>,
        span: [f64; 2],
        best: &mut Option<RayHit>,
    ) {
        let mesh = &self.scene.meshes[number];
        let last = [mesh.rows.len() - 1, mesh.columns.len() - 1];
        if row << level >= last[0] || column << level >= last[1] {
            return;
        }
        let range = self.pyramids[number].range_of(level, [row, column]);
        let range = range.unwrap_or_else(|| match level {
            0 => {
                let heights = mesh.surface_cell(row, column).0.into_iter().filter(|height| !height.is_nan());
                heights.fold(EMPTY, |range, height| joined(range, [height; 2]))
            }
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        });
        let [rows, columns] = square(mesh, level, [row, column]);
        let Some(span) = curved.within(rows, columns, range, span, best) else { return };
        if level > 0 {
            for (r, c) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                self.curved_square(number, level - 1, [2 * row + r, 2 * column + c], curved, span, best);
            }
            return;
        }
        for (slot, (triangle, _)) in mesh.triangles(row, column).enumerate() {
            if let Some((t, _)) = curved_hit(&self.scene.placed, mesh, [row, column], &triangle, curved.course, span)
                && best.is_none_or(|best| t < best.t)
            {
                *best = Some(RayHit { t, shown: Shown { node: number, at: [row, column], slot: Some(slot) } });
            }
        }
    }

    /// Casts a ray for each pixel of a picture.
    pub fn draw(&self, sight: &Sight, picture: &Visibility) {
        let lens = sight.lens();
        (0..picture.height).into_par_iter().for_each(|y| {
            for x in 0..picture.width {
                if let Some(hit) = self.cast_pixel(sight, &lens, [x as f64 + 0.5, y as f64 + 0.5]) {
                    picture.put(y * picture.width + x, hit.t, hit.shown.pack());
                }
            }
        });
    }
}

/// A part of a ray on a globe.
struct Curved<'a> {
    course: &'a Course<'a>,
    spread: &'a Spread,
}

impl Curved<'_> {
    /// The stretch of a span in a box, before what was hit already.
    fn within(
        &self,
        rows: [f64; 2],
        columns: [f64; 2],
        range: Range,
        [from, to]: [f64; 2],
        best: &Option<RayHit>,
    ) -> Option<[f64; 2]> {
        let to = best.map_or(to, |best| to.min(best.t));
        (range[0] <= range[1] && from <= to)
            .then(|| self.course.within(rows, columns, self.spread.lifted(range), [from, to]))?
    }
}

/// Where a stretch of a ray on a globe meets a triangle of a chunk's cell: the parameter, and the place in the cell.
pub fn curved_hit(
    placed: &Placed,
    mesh: &Mesh,
    at: [usize; 2],
    triangle: &Triangle,
    course: &Course<'_>,
    span: [f64; 2],
) -> Option<(f64, [f64; 2])> {
    let frame = CellFrame::of(mesh, at);
    let [p, q, s] = triangle.at;
    let plane = [placed.lifted(p), placed.lift * q, placed.lift * s];
    course.meets(frame.first, frame.size, plane, span).into_iter().flatten().find_map(|found| {
        let [u, v] = [(found.column - frame.first[1]) / frame.size[1], (found.row - frame.first[0]) / frame.size[0]];
        let [k, m, n] = triangle.edge;
        let is_in = u.min(v) >= -HAIR && u.max(v) <= 1.0 + HAIR && k + m * u + n * v >= -HAIR;
        is_in.then_some((found.t, [u, v]))
    })
}

/// A cell's place in its field.
#[derive(Clone, Copy, Debug)]
pub struct CellFrame {
    /// Row and column of its first sample.
    pub first: [f64; 2],
    /// How many rows and columns of full resolution it is.
    pub size: [f64; 2],
}

impl CellFrame {
    /// That of a chunk's cell.
    #[inline]
    pub fn of(mesh: &Mesh, [row, column]: [usize; 2]) -> CellFrame {
        let size = |places: &[u64], at: usize| (places[at + 1] - places[at]) as f64;
        CellFrame {
            first: [mesh.rows[row] as f64, mesh.columns[column] as f64],
            size: [size(&mesh.rows, row), size(&mesh.columns, column)],
        }
    }

    /// The same ray with `u` and `v` from 0 to 1 across the cell.
    #[inline]
    pub fn ray(&self, ray: &GridRay) -> LocalRay {
        let GridRay { origin, direction } = ray;
        LocalRay(GridRay {
            origin: [(origin[0] - self.first[1]) / self.size[1], (origin[1] - self.first[0]) / self.size[0], origin[2]],
            direction: [direction[0] / self.size[1], direction[1] / self.size[0], direction[2]],
        })
    }
}

/// A ray in a cell's coordinates.
#[derive(Clone, Copy, Debug)]
pub struct LocalRay(pub GridRay);

impl LocalRay {
    /// Where it meets the plane of a triangle; `None` where it does not.
    #[inline]
    pub fn meets(&self, triangle: &Triangle) -> Option<f64> {
        let ([p, q, s], GridRay { origin, direction }) = (triangle.at, self.0);
        let t = (p + q * origin[0] + s * origin[1] - origin[2]) / (direction[2] - q * direction[0] - s * direction[1]);
        t.is_finite().then_some(t)
    }
}

/// Between which rows and columns a square of a chunk's cells is.
fn square(mesh: &Mesh, level: usize, [row, column]: [usize; 2]) -> [[f64; 2]; 2] {
    let end = |places: &[u64], index: usize| places[(index << level).min(places.len() - 1)] as f64;
    let ends = |places: &[u64], index: usize| [end(places, index), end(places, index + 1)];
    [ends(&mesh.rows, row), ends(&mesh.columns, column)]
}

/// How much wider boxes are than the rows or columns that end at a place, and along heights than a range.
#[inline]
fn hair_along(end: f64) -> f64 {
    HAIR + 1e-14 * end
}

#[inline]
fn hair_of([low, high]: Range) -> f64 {
    HAIR * (high - low) + 1e-12 * low.abs().max(high.abs())
}

/// The part of a ray over a rectangle, and within a range of heights where there is one; `None` where it passes by.
fn within(
    ray: &GridRay,
    [rows, columns]: [[f64; 2]; 2],
    range: Option<Range>,
    [mut from, mut to]: [f64; 2],
) -> Option<[f64; 2]> {
    let mut cut = |axis: usize, [low, high]: Range, hair: f64| {
        let (low, high) = (low - hair, high + hair);
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        if direction == 0.0 {
            return (low..=high).contains(&origin);
        }
        let (a, b) = ((low - origin) / direction, (high - origin) / direction);
        (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        from <= to
    };
    let is_over = cut(0, columns, hair_along(columns[1])) && cut(1, rows, hair_along(rows[1]));
    let is_in = is_over && range.is_none_or(|range| range[0] <= range[1] && cut(2, range, hair_of(range)));
    is_in.then_some([from, to])
}

/// The part of a ray before the eye, in a box of the world.
fn kept(bounds: &Bounds, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
    let (mut from, mut to) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let (low, high) = (bounds.min[axis], bounds.max[axis]);
        if direction[axis] == 0.0 {
            if origin[axis] < low || origin[axis] > high {
                return None;
            }
            continue;
        }
        let (a, b) = ((low - origin[axis]) / direction[axis], (high - origin[axis]) / direction[axis]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    (from <= to).then_some([from, to])
}

#[cfg(test)]
mod tests;
