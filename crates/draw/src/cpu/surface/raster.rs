//! The rasteriser: which triangle or point is seen at each pixel's centre.
//!
//! Corners are rounded to 1/65536 of a pixel, after which all decisions are whole numbers and exact: with the top-left rule a pixel's centre on
//! an edge that two triangles share belongs to one of them, and one in a closed set of triangles to some, so that there are no cracks. A corner
//! that several triangles or chunks share is rounded to the same place, as it comes from the same operations. An edge is cut at the eye's plane
//! from its end in front of it, and so at the same place for both of its triangles.
//!
//! Points: if no edge of a projected triangle is longer than a pixel, each pixel centre in it shares its pixel with one of its corners. For if
//! all three are outside the pixel's square, they cannot be on opposite sides of it, so they lie beyond one of its diagonals, and the centre is
//! not between them; a segment of length 1 with both ends outside passes the centre at no less than 0.2 pixels, so that rounding does not matter.
//! The same holds of edges of any number of pixels and squares about the centre as wide: those centres that the square of a corner covers are the
//! ones in whose square the corner is. So points of any whole number of pixels leave no gap where no edge is longer.
//!
//! What is nearest is kept, among equals the least number, by an atomic minimum: the picture is the same for any number of threads.

mod line;
mod lone;
mod numbers;
mod visibility;

pub use lone::draw_lone;
pub use numbers::NO_NUMBER;
pub(super) use visibility::behind;
pub use visibility::{BEFORE_POINTS, BEFORE_POLES, BEFORE_SEAM, BEHIND, POLE, Shown, Visibility};

use super::placed::Vantage;
use super::select::Primitive;
use super::stitch::{Mesh, Scene};
use crate::model::Bounds;
use crate::view::{Extent, Projection, View};
use glam::DVec3;
use line::{Across, Line, part};
use rayon::prelude::*;
use std::ops::Range;

/// Bits of a pixel's part.
const FRACTION: u32 = 16;
/// A pixel.
const ONE: i64 = 1 << FRACTION;
/// Furthest place of a corner, in parts of pixels; no field and camera that make sense come near.
const FURTHEST: f64 = (1_i64 << 60) as f64;
/// Rows of cells that one task draws.
const BAND: usize = 32;
/// Columns of cells of which it is looked whether any is in the picture.
const BLOCK: usize = 32;
/// Pixels beside the picture within which what is drawn may reach into it, but for wide points: half of a point, and what is rounded.
const PADDING: u32 = 8;

/// A corner in the picture.
#[derive(Clone, Copy)]
struct Corner {
    /// From the eye: right, up, forward.
    camera: DVec3,
    /// Makes sense before the near plane only.
    spot: Spot,
}

/// Where a corner is in the picture.
#[derive(Clone, Copy)]
struct Spot {
    /// Parts of pixels.
    place: [i64; 2],
    /// What is interpolated to its depth.
    linear: f64,
}

/// A flat picture that is drawn.
struct Raster<'a> {
    view: &'a View,
    vantage: Vantage,
    /// What is drawn of chunks that are cut at the picture's border.
    padded: View,
    near: f64,
    /// Pixels of a length of 1 at a depth of 1, in pictures without perspective at any.
    focal: f64,
    middle: [f64; 2],
    is_perspective: bool,
    clips: bool,
    /// Pixels of a point's side, and of that of a sample in no triangle.
    sides: [u32; 2],
    picture: &'a Visibility,
}

/// Draws all chunks of a scene into a flat picture. Points of chunks are `sides[0]` pixels of it wide, samples in no triangle `sides[1]`. Also says
/// how many samples, points and triangles that were.
pub fn draw(scene: &Scene, view: &View, picture: &Visibility, sides: [u32; 2]) -> [u64; 3] {
    let padded = view.padded(PADDING.max(sides[0]));
    let raster = Raster { sides, padded, ..Raster::new(scene, view, picture) };
    let bands: Vec<(usize, usize)> = scene
        .meshes
        .iter()
        .enumerate()
        .flat_map(|(number, mesh)| (0..mesh.samples.rows - 1).step_by(BAND).map(move |row| (number, row)))
        .collect();
    draw_poles(scene, view, picture);
    let band =
        |lines: &mut Lines, (number, row): &(usize, usize)| raster.band(&scene.meshes[*number], *number, *row, lines);
    let counts = bands.par_iter().map_init(Lines::default, band);
    counts.reduce(|| [0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]))
}

/// What a task draws with: two rows of samples.
#[derive(Default)]
struct Lines {
    across: Across,
    above: Line,
    below: Line,
}

/// Draws the triangles that close a globe's poles.
pub fn draw_poles(scene: &Scene, view: &View, picture: &Visibility) {
    if scene.poles == [None; 2] {
        return;
    }
    let raster = Raster::new(scene, view, picture);
    scene.meshes.par_iter().enumerate().for_each(|(number, mesh)| {
        for end in 0..2 {
            let Some(pole) = scene.pole_beside(mesh, end) else { continue };
            let row = if end == 0 { 0 } else { mesh.samples.rows - 1 };
            let relative = scene.placed.pole(pole.latitude, pole.height) - view.eye;
            let top = raster.seen(relative);
            let corner = |column: usize| {
                let height = mesh.height(row * mesh.samples.columns + column);
                (!height.is_nan()).then(|| raster.corner(mesh.rows[row], mesh.columns[column], height))
            };
            for column in 0..mesh.samples.columns - 1 {
                if let (Some(a), Some(b)) = (corner(column), corner(column + 1)) {
                    let shown = Shown { node: number, at: [0, column], slot: Some(POLE + end) };
                    raster.triangle([top, a, b], shown.pack());
                }
            }
        }
    });
}

impl<'a> Raster<'a> {
    fn new(scene: &Scene, view: &'a View, picture: &'a Visibility) -> Raster<'a> {
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let [x, y] = scene.placed.spacing();
        // A thousandth of a sample before the eye.
        let near = if is_perspective { 1e-3 * x.min(y) } else { 0.0 };
        let vantage = Vantage::new(&scene.placed, view.eye);
        let (focal, middle, clips) = (view.focal_pixels(), view.middle(), view.cut.clips());
        let padded = view.padded(PADDING);
        Raster { view, vantage, padded, near, focal, middle, is_perspective, clips, sides: [1; 2], picture }
    }

    fn corner(&self, row: u64, column: u64, height: f64) -> Corner {
        self.seen(self.vantage.relative(row, column, height))
    }

    /// The picture's directions: right, up, forward.
    fn ways(&self) -> [DVec3; 3] {
        [self.view.right, self.view.up, self.view.forward]
    }

    /// A place that is so far from the eye.
    fn seen(&self, relative: DVec3) -> Corner {
        self.placed(DVec3::from_array(self.ways().map(|way| relative.dot(way))))
    }

    fn placed(&self, camera: DVec3) -> Corner {
        if camera.z < self.near || camera.z.is_nan() {
            return Corner { camera, spot: Spot { place: [0; 2], linear: 0.0 } };
        }
        let scale = if self.is_perspective { self.focal / camera.z } else { self.focal };
        let place = [part(self.middle[0] + camera.x * scale), part(self.middle[1] - camera.y * scale)];
        let linear = if self.is_perspective { 1.0 / camera.z } else { camera.z };
        Corner { camera, spot: Spot { place, linear } }
    }

    /// The columns of a band's samples that may be in the picture.
    fn columns(&self, mesh: &Mesh, rows: [usize; 2]) -> Range<usize> {
        let last = mesh.samples.columns - 1;
        let facts = &mesh.node.facts;
        // A membrane may be higher than what was measured.
        let is_known = self.vantage.is_flat() && mesh.fill.is_none() && facts.min <= facts.max;
        if !is_known {
            return 0..last + 1;
        }
        let heights = [facts.min - mesh.node.added, facts.max + mesh.node.added];
        let is_seen = |first: &usize| {
            let ends = [*first, (first + BLOCK).min(last)];
            let corners = [0, 1]
                .map(|end| self.vantage.world(mesh.rows[rows[end]], mesh.columns[ends[end]], heights[end]).to_array());
            self.padded.sees(&Extent { bounds: Bounds::of(corners), margin: 0.0 })
        };
        let first = (0..last).step_by(BLOCK).find(is_seen);
        let end = (0..last).step_by(BLOCK).rev().find(is_seen);
        match (first, end) {
            (Some(first), Some(end)) => first..(end + BLOCK).min(last) + 1,
            _ => 0..0,
        }
    }

    fn band(&self, mesh: &Mesh, number: usize, first: usize, lines: &mut Lines) -> [u64; 3] {
        let (rows, last) = (mesh.samples.rows, (first + BAND).min(mesh.samples.rows - 1));
        let columns = self.columns(mesh, [first, last]);
        if columns.is_empty() {
            return [0; 3];
        }
        let Lines { across, above, below } = lines;
        if self.vantage.is_flat() {
            across.fill(self, &mesh.columns[columns.clone()]);
        }
        above.fill(self, mesh, first, &columns, across);
        let [mut samples, mut points, mut triangles] = [0; 3];
        for row in first..=last {
            // The last row belongs to the next band, but for the chunk's last.
            if row < last || row + 1 == rows {
                samples += columns.len() as u64;
                points += self.points(mesh, number, row, &columns, above);
            }
            if row == last {
                break;
            }
            below.fill(self, mesh, row + 1, &columns, across);
            triangles += self.cells(mesh, number, row, &columns, [above, below]);
            std::mem::swap(above, below);
        }
        [samples, points, triangles]
    }

    /// Draws the points of a row, and says how many there are.
    fn points(&self, mesh: &Mesh, number: usize, row: usize, columns: &Range<usize>, line: &Line) -> u64 {
        let (rows, all) = (mesh.samples.rows, mesh.samples.columns);
        let number_of = |column: usize| Shown { node: number, at: [row, column], slot: None }.pack();
        let mut count = 0;
        let is_laid = mesh.is_laid[0] && row == 0 || mesh.is_laid[1] && row + 1 == rows;
        if mesh.node.primitive == Primitive::Points && !is_laid {
            let from = columns.start.max(usize::from(mesh.is_laid[2]));
            let to = columns.end.min(all - usize::from(mesh.is_laid[3]));
            let first = number_of(0);
            for column in from..to {
                let (index, is_membrane) = (column - columns.start, mesh.fill.is_some());
                if line.depths()[index].is_nan() || is_membrane && mesh.height(row * all + column).is_nan() {
                    continue;
                }
                count += 1;
                self.point(line, index, first + column as u32, self.sides[0]);
            }
        }
        if !mesh.samples.coverage.is_empty() {
            for column in columns.clone().filter(|column| mesh.is_lone(row, *column)) {
                let is_drawn = mesh.node.primitive == Primitive::Points && !mesh.is_on_laid(row, column);
                count += u64::from(!is_drawn);
                self.point(line, column - columns.start, number_of(column), self.sides[1]);
            }
        }
        count
    }

    /// Draws the cells between two rows of samples, and says how many triangles there are.
    fn cells(&self, mesh: &Mesh, number: usize, row: usize, columns: &Range<usize>, lines: [&Line; 2]) -> u64 {
        let last = [mesh.samples.rows - 2, mesh.samples.columns - 2];
        let cells = columns.start..columns.end - 1;
        let is_points = mesh.node.primitive == Primitive::Points;
        let is_strip = mesh.is_laid[0] && row == 0 || mesh.is_laid[1] && row == last[0];
        if is_points && mesh.fill.is_none() && !is_strip {
            let ends = [0, last[1]].into_iter().take(if last[1] == 0 { 1 } else { 2 });
            let ends = ends.filter(|column| cells.contains(column) && mesh.is_strip(row, *column));
            return ends.map(|column| self.cell(mesh, number, [row, column], columns.start, lines)).sum();
        }
        let has = |side: usize| !mesh.extras[side].is_empty();
        let is_plain = !is_points && mesh.fill.is_none() && !(has(0) && row == 0 || has(1) && row == last[0]);
        let first = Shown { node: number, at: [row, 0], slot: Some(0) }.pack();
        let mut triangles = 0;
        for column in cells {
            let index = column - columns.start;
            let is_fan = has(2) && column == 0 || has(3) && column == last[1];
            let is_ahead = lines.iter().all(|line| {
                let depths = &line.depths()[index..index + 2];
                depths[0] >= self.near && depths[1] >= self.near
            });
            triangles += match is_plain && is_ahead && !is_fan {
                true => {
                    self.whole_cell(lines, index, first + 2 * column as u32);
                    2
                }
                false => self.cell(mesh, number, [row, column], columns.start, lines),
            };
        }
        triangles
    }

    /// A cell with four corners before the eye.
    #[inline(always)]
    fn whole_cell(&self, [above, below]: [&Line; 2], index: usize, number: u32) {
        let places =
            [above.place_of(index), above.place_of(index + 1), below.place_of(index), below.place_of(index + 1)];
        // Most small cells have no pixel's centre in them.
        if self.pixels(&places).is_none() {
            return;
        }
        let [a, b] = [above.spot(index), above.spot(index + 1)];
        let [d, e] = [below.spot(index), below.spot(index + 1)];
        self.fill([a, b, e], number);
        self.fill([a, d, e], number + 1);
    }

    /// Any cell of a mesh; lines begin at column `start`.
    fn cell(&self, mesh: &Mesh, number: usize, at: [usize; 2], start: usize, [above, below]: [&Line; 2]) -> u64 {
        let [row, column] = at;
        let is_points = mesh.node.primitive == Primitive::Points;
        let is_dotted = is_points && !mesh.is_strip(row, column);
        let shown = |slot: usize| Shown { node: number, at, slot: Some(slot) }.pack();
        let has_extras = mesh.extras.iter().any(|side| !side.is_empty());
        let is_fan = has_extras && !is_dotted && (0..4).any(|side| mesh.is_along(side, row, column));
        if is_fan {
            mesh.fan(at, |slot, corners| {
                let corners = corners.map(|(row, column, height)| self.corner(row, column, height));
                self.triangle(corners, shown(slot));
            });
        }
        let index = column - start;
        let corner = |corner: usize| [above, below][corner / 2].corner(index + corner % 2);
        let mut triangles = 0;
        for (slot, (triangle, is_membrane)) in mesh.triangles(row, column).enumerate() {
            if is_dotted && !is_membrane {
                continue;
            }
            triangles += u64::from(!is_membrane);
            if is_membrane || !is_fan {
                self.triangle(triangle.corners.map(corner), shown(slot));
            }
        }
        triangles
    }

    #[inline(always)]
    fn point(&self, line: &Line, index: usize, number: u32, side: u32) {
        let depth = line.depths()[index];
        // Not a number where there is no sample.
        if depth < self.near || depth.is_nan() {
            return;
        }
        if self.clips {
            let View { right, up, forward, eye, .. } = *self.view;
            let camera = line.corner(index).camera;
            let world = eye + camera.x * right + camera.y * up + camera.z * forward;
            if !self.view.cut.keeps(world) {
                return;
            }
        }
        self.picture.put_square(line.place_of(index), side, depth, number);
    }

    fn triangle(&self, corners: [Corner; 3], number: u32) {
        let is_ahead = |k: usize| corners[k].camera.z >= self.near;
        let is_ahead = [is_ahead(0), is_ahead(1), is_ahead(2)];
        match is_ahead {
            [true, true, true] => self.fill([corners[0].spot, corners[1].spot, corners[2].spot], number),
            [false, false, false] => {}
            _ => {
                let mut kept: Vec<Spot> = Vec::with_capacity(4);
                for k in 0..3 {
                    let (a, b) = (k, (k + 1) % 3);
                    if is_ahead[a] {
                        kept.push(corners[a].spot);
                    }
                    if is_ahead[a] != is_ahead[b] {
                        let (ahead, behind) = if is_ahead[a] { (a, b) } else { (b, a) };
                        let (ahead, behind) = (corners[ahead].camera, corners[behind].camera);
                        let share = (self.near - ahead.z) / (behind.z - ahead.z);
                        let mut camera = ahead + share * (behind - ahead);
                        camera.z = self.near;
                        kept.push(self.placed(camera).spot);
                    }
                }
                for pair in kept[1..].windows(2) {
                    self.fill([kept[0], pair[0], pair[1]], number);
                }
            }
        }
    }

    /// Pixels of the picture whose centres lie between places along both axes: left, right, top, bottom; `None` where there are none.
    #[inline(always)]
    fn pixels<const COUNT: usize>(&self, places: &[[i64; 2]; COUNT]) -> Option<[i64; 4]> {
        let ([mut left, mut top], [mut right, mut bottom]) = (places[0], places[0]);
        for place in &places[1..] {
            (left, right) = (left.min(place[0]), right.max(place[0]));
            (top, bottom) = (top.min(place[1]), bottom.max(place[1]));
        }
        let first = |place: i64| ((place - ONE / 2 + ONE - 1) >> FRACTION).max(0);
        let last = |place: i64, size: usize| ((place - ONE / 2) >> FRACTION).min(size as i64 - 1);
        let (left, right) = (first(left), last(right, self.picture.width));
        let (top, bottom) = (first(top), last(bottom, self.picture.height));
        (left <= right && top <= bottom).then_some([left, right, top, bottom])
    }

    fn fill(&self, corners: [Spot; 3], number: u32) {
        let places = [corners[0].place, corners[1].place, corners[2].place];
        let Some([left, right, top, bottom]) = self.pixels(&places) else { return };
        // Products of differences stay within 63 bits where corners are within 30.
        let bits = places.iter().fold(0_i64, |bits, place| bits | place[0].abs() | place[1].abs());
        if bits < 1 << 30 {
            self.fill_small(corners, [left, right, top, bottom], number);
        } else {
            self.fill_large(corners, [left, right, top, bottom], number);
        }
    }

    #[inline]
    fn show(&self, [x, y]: [i64; 2], linear: f64, number: u32) {
        let depth = if self.is_perspective { 1.0 / linear } else { linear };
        if self.clips && !self.view.cut.keeps(self.view.at_depth([x as f64 + 0.5, y as f64 + 0.5], depth)) {
            return;
        }
        self.picture.put(y as usize * self.picture.width + x as usize, depth, number);
    }
}

macro_rules! filled {
    ($name:ident, $whole:ty, $help:literal) => {
        impl Raster<'_> {
            #[doc = $help]
            fn $name(&self, corners: [Spot; 3], [left, last, top, bottom]: [i64; 4], number: u32) {
                let [a, mut b, mut c] = corners;
                let place = |corner: &Spot| (<$whole>::from(corner.place[0]), <$whole>::from(corner.place[1]));
                let ((ax, ay), mut second, mut third) = (place(&a), place(&b), place(&c));
                let mut area = (second.0 - ax) * (third.1 - ay) - (second.1 - ay) * (third.0 - ax);
                if area == 0 {
                    return;
                }
                if area < 0 {
                    std::mem::swap(&mut b, &mut c);
                    std::mem::swap(&mut second, &mut third);
                    area = -area;
                }
                let ((bx, by), (cx, cy)) = (second, third);
                // Of the edges opposite to the corners.
                let (right, up) = ([cx - bx, ax - cx, bx - ax], [cy - by, ay - cy, by - ay]);
                // A centre on a top or a left edge is inside, on another one not.
                let least = |k: usize| <$whole>::from(!(up[k] < 0 || up[k] == 0 && right[k] > 0));
                let least = [least(0), least(1), least(2)];
                let centre = |pixel: i64| <$whole>::from(pixel) * <$whole>::from(ONE) + <$whole>::from(ONE / 2);
                let (x, y) = (centre(left), centre(top));
                let mut row = [
                    right[0] * (y - by) - up[0] * (x - bx),
                    right[1] * (y - cy) - up[1] * (x - cx),
                    right[2] * (y - ay) - up[2] * (x - ax),
                ];
                let is_in = |at: &[$whole; 3]| at[0] >= least[0] && at[1] >= least[1] && at[2] >= least[2];
                let is_single = left == last && top == bottom;
                if is_single && !is_in(&row) {
                    return;
                }
                let share = 1.0 / area as f64;
                let linear = [a.linear * share, b.linear * share, c.linear * share];
                let value =
                    |at: &[$whole; 3]| at[0] as f64 * linear[0] + at[1] as f64 * linear[1] + at[2] as f64 * linear[2];
                if is_single {
                    return self.show([left, top], value(&row), number);
                }
                let one = <$whole>::from(ONE);
                for y in top..=bottom {
                    let mut at = row;
                    for x in left..=last {
                        if is_in(&at) {
                            self.show([x, y], value(&at), number);
                        }
                        (0..3).for_each(|k| at[k] -= up[k] * one);
                    }
                    (0..3).for_each(|k| row[k] += right[k] * one);
                }
            }
        }
    };
}

filled!(fill_small, i64, "Pixels of a triangle whose products fit into 64 bits.");
filled!(fill_large, i128, "Pixels of any triangle.");
