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
//!
//! What is nearest is kept, among equals the least number, by an atomic minimum: the picture is the same for any number of threads.

use super::placed::Vantage;
use super::select::Primitive;
use super::sight::Sight;
use super::stitch::{Mesh, Scene};
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bits of a pixel's part.
const FRACTION: u32 = 16;
/// A pixel.
const ONE: i64 = 1 << FRACTION;
/// Furthest place of a corner, in parts of pixels; no field and camera that make sense come near.
const FURTHEST: f64 = (1_i64 << 60) as f64;
/// Pixels beyond which a place is not in any picture.
const FAR: f64 = 1e9;
/// Rows of cells that one task draws.
const BAND: usize = 32;

/// Which triangle or point a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shown {
    /// Number of the chunk in the cut.
    pub node: usize,
    /// Row and column of the cell or the sample in it.
    pub at: [usize; 2],
    /// Which of the cell's triangles; `None` for a point. [`POLE`] and the next one: the triangle between a column of cells and the pole beyond
    /// the chunk's first or last row; `at` then has no row.
    pub slot: Option<usize>,
}

/// The first slot of triangles to poles.
pub const POLE: usize = 2;
/// Numbers before those of points: of triangles, two in each of 256 x 256 cells.
const BEFORE_POINTS: u32 = 1 << 17;
/// Numbers before those of triangles to poles.
const BEFORE_POLES: u32 = BEFORE_POINTS + 257 * 257;
/// Numbers before those of the triangles, and then of the points, of the one column more that a chunk has which closes a globe.
const BEFORE_SEAM: u32 = BEFORE_POLES + 2 * 257;
const BEFORE_LAST: u32 = BEFORE_SEAM + 2 * 256;

impl Shown {
    /// As a number of 14 bits for the chunk and 18 for what is in it; shaders have the same.
    pub fn pack(self) -> u32 {
        let [row, column] = self.at.map(|at| at as u32);
        let within = match self.slot {
            Some(slot) if slot >= POLE => BEFORE_POLES + 257 * (slot - POLE) as u32 + column,
            Some(slot) if column == 256 => BEFORE_SEAM + 2 * row + slot as u32,
            Some(slot) => 2 * (row * 256 + column) + slot as u32,
            None if column == 257 => BEFORE_LAST + row,
            None => BEFORE_POINTS + row * 257 + column,
        };
        (self.node as u32) << 18 | within
    }

    /// From its number.
    pub fn unpack(number: u32) -> Shown {
        let (node, within) = ((number >> 18) as usize, number & ((1 << 18) - 1));
        let split = |number: u32, by: u32| [(number / by) as usize, (number % by) as usize];
        if within < BEFORE_POINTS {
            let [cell, slot] = split(within, 2);
            return Shown { node, at: [cell / 256, cell % 256], slot: Some(slot) };
        }
        if within < BEFORE_POLES {
            return Shown { node, at: split(within - BEFORE_POINTS, 257), slot: None };
        }
        if within < BEFORE_SEAM {
            let [end, column] = split(within - BEFORE_POLES, 257);
            return Shown { node, at: [0, column], slot: Some(POLE + end) };
        }
        if within < BEFORE_LAST {
            let [row, slot] = split(within - BEFORE_SEAM, 2);
            return Shown { node, at: [row, 256], slot: Some(slot) };
        }
        Shown { node, at: [(within - BEFORE_LAST) as usize, 257], slot: None }
    }
}

/// What is nearest in each pixel.
pub struct Visibility {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    cells: Vec<AtomicU64>,
}

impl Visibility {
    /// A picture of nothing.
    pub fn new([width, height]: [u32; 2]) -> Visibility {
        let (width, height) = (width as usize, height as usize);
        Visibility { width, height, cells: (0..width * height).map(|_| AtomicU64::new(u64::MAX)).collect() }
    }

    /// What a pixel shows.
    pub fn at(&self, index: usize) -> Option<Shown> {
        let value = self.cells[index].load(Ordering::Relaxed);
        (value != u64::MAX).then(|| Shown::unpack(value as u32))
    }

    /// Keeps the nearer of what is there and this; `depth` is not negative.
    pub fn put(&self, index: usize, depth: f64, number: u32) {
        // Positive floats sort as their bits do.
        let value = u64::from((depth.max(0.0) as f32).to_bits()) << 32 | u64::from(number);
        let cell = &self.cells[index];
        if value < cell.load(Ordering::Relaxed) {
            cell.fetch_min(value, Ordering::Relaxed);
        }
    }
}

impl Visibility {
    /// Keeps the nearer of what is there and a point, in a square of pixels about its place in parts of pixels.
    fn put_square(&self, place: [i64; 2], side: u32, depth: f64, number: u32) {
        let side = i64::from(side);
        let [left, top] = place.map(|place| (place - (side - 1) * ONE / 2) >> FRACTION);
        for y in top.max(0)..(top + side).min(self.height as i64) {
            for x in left.max(0)..(left + side).min(self.width as i64) {
                self.put(y as usize * self.width + x as usize, depth, number);
            }
        }
    }
}

/// A corner in the picture.
#[derive(Clone, Copy)]
struct Corner {
    /// From the eye: right, up, forward.
    camera: DVec3,
    /// Parts of pixels, and what is interpolated to its depth; makes sense before the near plane only.
    place: [i64; 2],
    linear: f64,
}

/// A flat picture that is drawn.
struct Raster<'a> {
    view: &'a View,
    vantage: Vantage,
    near: f64,
    is_perspective: bool,
    clips: bool,
    /// Pixels of a point's side, and of that of a sample in no triangle.
    sides: [u32; 2],
    picture: &'a Visibility,
}

/// Draws all chunks of a scene into a flat picture. Points of chunks are `sides[0]` pixels of it wide, samples in no triangle `sides[1]`. Also says
/// how many samples, points and triangles that were.
pub fn draw(scene: &Scene, view: &View, picture: &Visibility, sides: [u32; 2]) -> [u64; 3] {
    let raster = Raster { sides, ..Raster::new(scene, view, picture) };
    let bands: Vec<(usize, usize)> = scene
        .meshes
        .iter()
        .enumerate()
        .flat_map(|(number, mesh)| (0..mesh.samples.rows - 1).step_by(BAND).map(move |row| (number, row)))
        .collect();
    draw_poles(scene, view, picture);
    let counts = bands.par_iter().map(|(number, row)| raster.band(&scene.meshes[*number], *number, *row));
    counts.reduce(|| [0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]))
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
                let height = mesh.heights()[row * mesh.samples.columns + column];
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

/// Draws the measured samples that are in no triangle as points of `side` pixels, into any picture: rays miss them.
pub fn draw_lone(scene: &Scene, sight: &Sight, picture: &Visibility, side: u32) -> u64 {
    let vantage = Vantage::new(&scene.placed, sight.eye());
    let count = |(number, mesh): (usize, &Mesh)| {
        let mut count = 0;
        for row in 0..mesh.samples.rows {
            for column in 0..mesh.samples.columns {
                if !mesh.is_lone(row, column) {
                    continue;
                }
                count += 1;
                let height = mesh.heights()[row * mesh.samples.columns + column];
                let relative = vantage.relative(mesh.rows[row], mesh.columns[column], height);
                if let Some((place, depth)) = sight.project(relative)
                    && sight.cut().keeps(relative + sight.eye())
                {
                    let shown = Shown { node: number, at: [row, column], slot: None };
                    let place = place.map(|pixels| (pixels.clamp(-FAR, FAR) * ONE as f64) as i64);
                    picture.put_square(place, side, depth, shown.pack());
                }
            }
        }
        count
    };
    scene.meshes.par_iter().enumerate().filter(|(_, mesh)| !mesh.samples.coverage.is_empty()).map(count).sum()
}

impl<'a> Raster<'a> {
    fn new(scene: &Scene, view: &'a View, picture: &'a Visibility) -> Raster<'a> {
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let [x, y] = scene.placed.spacing();
        // A thousandth of a sample before the eye.
        let near = if is_perspective { 1e-3 * x.min(y) } else { 0.0 };
        let vantage = Vantage::new(&scene.placed, view.eye);
        Raster { view, vantage, near, is_perspective, clips: view.cut.clips(), sides: [1; 2], picture }
    }

    fn corner(&self, row: u64, column: u64, height: f64) -> Corner {
        self.seen(self.vantage.relative(row, column, height))
    }

    /// A place that is so far from the eye.
    fn seen(&self, relative: DVec3) -> Corner {
        let View { right, up, forward, .. } = self.view;
        self.placed(DVec3::new(relative.dot(*right), relative.dot(*up), relative.dot(*forward)))
    }

    fn placed(&self, camera: DVec3) -> Corner {
        if camera.z < self.near || camera.z.is_nan() {
            return Corner { camera, place: [0; 2], linear: 0.0 };
        }
        let [x, y] = self.view.to_pixels(camera).unwrap_or_default();
        let part = |pixels: f64| (pixels * ONE as f64).round().clamp(-FURTHEST, FURTHEST) as i64;
        let linear = if self.is_perspective { 1.0 / camera.z } else { camera.z };
        Corner { camera, place: [part(x), part(y)], linear }
    }

    fn band(&self, mesh: &Mesh, number: usize, first: usize) -> [u64; 3] {
        let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
        let last = (first + BAND).min(rows - 1);
        let heights = mesh.heights();
        let line = |row: usize| -> Vec<Corner> {
            let each = |column: usize| {
                self.corner(mesh.rows[row], mesh.columns[column], mesh.surface_height(row * columns + column))
            };
            (0..columns).map(each).collect()
        };
        let is_points = mesh.node.primitive == Primitive::Points;
        let (mut points, mut triangles, mut samples) = (0, 0, 0);
        let has_lone = !mesh.samples.coverage.is_empty();
        let has_extras = mesh.extras.iter().any(|side| !side.is_empty());
        let mut above = line(first);
        for row in first..=last {
            // The last row belongs to the next band, but for the chunk's last.
            if row < last || row + 1 == rows {
                samples += columns as u64;
                for (column, corner) in above.iter().enumerate() {
                    let is_lone = has_lone && mesh.is_lone(row, column);
                    let is_point =
                        is_points && !mesh.is_on_laid(row, column) && !heights[row * columns + column].is_nan();
                    if is_point || is_lone {
                        points += 1;
                        let side = self.sides[usize::from(is_lone)];
                        self.point(corner, Shown { node: number, at: [row, column], slot: None }, side);
                    }
                }
            }
            if row == last {
                break;
            }
            let below = line(row + 1);
            for column in 0..columns - 1 {
                let is_dotted = is_points && !mesh.is_strip(row, column);
                if is_dotted && mesh.fill.is_none() {
                    continue;
                }
                let at = [row, column];
                let shown = |slot: usize| Shown { node: number, at, slot: Some(slot) }.pack();
                let is_fan = has_extras && !is_dotted && (0..4).any(|side| mesh.is_along(side, row, column));
                if is_fan {
                    mesh.fan(at, |slot, corners| {
                        let corners = corners.map(|(row, column, height)| self.corner(row, column, height));
                        self.triangle(corners, shown(slot));
                    });
                }
                let corners = [above[column], above[column + 1], below[column], below[column + 1]];
                for (slot, (triangle, is_membrane)) in mesh.triangles(row, column).enumerate() {
                    if is_dotted && !is_membrane {
                        continue;
                    }
                    triangles += u64::from(!is_membrane);
                    if is_membrane || !is_fan {
                        self.triangle(triangle.corners.map(|corner| corners[corner]), shown(slot));
                    }
                }
            }
            above = below;
        }
        [samples, points, triangles]
    }

    fn point(&self, corner: &Corner, shown: Shown, side: u32) {
        if corner.camera.z < self.near || corner.camera.z.is_nan() {
            return;
        }
        let View { right, up, forward, eye, .. } = *self.view;
        if self.clips {
            let world = eye + corner.camera.x * right + corner.camera.y * up + corner.camera.z * forward;
            if !self.view.cut.keeps(world) {
                return;
            }
        }
        self.picture.put_square(corner.place, side, corner.camera.z, shown.pack());
    }

    fn triangle(&self, corners: [Corner; 3], number: u32) {
        let is_ahead = corners.map(|corner| corner.camera.z >= self.near);
        match is_ahead {
            [true, true, true] => self.fill(corners, number),
            [false, false, false] => {}
            _ => {
                let mut kept: Vec<Corner> = Vec::with_capacity(4);
                for k in 0..3 {
                    let (a, b) = (k, (k + 1) % 3);
                    if is_ahead[a] {
                        kept.push(corners[a]);
                    }
                    if is_ahead[a] != is_ahead[b] {
                        let (ahead, behind) = if is_ahead[a] { (a, b) } else { (b, a) };
                        let (ahead, behind) = (corners[ahead].camera, corners[behind].camera);
                        let share = (self.near - ahead.z) / (behind.z - ahead.z);
                        let mut camera = ahead + share * (behind - ahead);
                        camera.z = self.near;
                        kept.push(self.placed(camera));
                    }
                }
                for pair in kept[1..].windows(2) {
                    self.fill([kept[0], pair[0], pair[1]], number);
                }
            }
        }
    }

    fn fill(&self, corners: [Corner; 3], number: u32) {
        let places = corners.map(|corner| corner.place);
        let range = |axis: usize, size: usize| {
            let least = places[0][axis].min(places[1][axis]).min(places[2][axis]);
            let most = places[0][axis].max(places[1][axis]).max(places[2][axis]);
            // Pixels whose centres lie between.
            let first = (least - ONE / 2 + ONE - 1) >> FRACTION;
            let last = (most - ONE / 2) >> FRACTION;
            (first.max(0), last.min(size as i64 - 1))
        };
        let (left, right) = range(0, self.picture.width);
        if left > right {
            return;
        }
        let (top, bottom) = range(1, self.picture.height);
        if top > bottom {
            return;
        }
        // Products of differences stay within 63 bits where corners are within 30.
        if places.iter().flatten().all(|place| place.abs() < 1 << 30) {
            self.fill_small(corners, [left, right, top, bottom], number);
        } else {
            self.fill_large(corners, [left, right, top, bottom], number);
        }
    }

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
            fn $name(&self, corners: [Corner; 3], [left, right, top, bottom]: [i64; 4], number: u32) {
                let [a, mut b, mut c] = corners;
                let cross = |a: &Corner, b: &Corner, [x, y]: [$whole; 2]| {
                    let [ax, ay] = a.place.map(<$whole>::from);
                    let [bx, by] = b.place.map(<$whole>::from);
                    (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                };
                let mut area = cross(&a, &b, c.place.map(<$whole>::from));
                if area == 0 {
                    return;
                }
                if area < 0 {
                    std::mem::swap(&mut b, &mut c);
                    area = -area;
                }
                let edges = [(b, c), (c, a), (a, b)];
                // A centre on a top or a left edge is inside, on another one not.
                let least = edges.map(|(from, to)| {
                    let [x, y] = [0, 1].map(|k| to.place[k] - from.place[k]);
                    <$whole>::from(!(y < 0 || y == 0 && x > 0))
                });
                let [step, down] = [0, 1].map(|axis: usize| {
                    edges.map(|(from, to)| {
                        let [x, y] = [0, 1].map(|k| <$whole>::from(to.place[k]) - <$whole>::from(from.place[k]));
                        (if axis == 0 { -y } else { x }) * <$whole>::from(ONE)
                    })
                });
                let start =
                    [left, top].map(|pixel| <$whole>::from(pixel) * <$whole>::from(ONE) + <$whole>::from(ONE / 2));
                let mut row = edges.map(|(from, to)| cross(&from, &to, start));
                let share = 1.0 / area as f64;
                let linear = [a.linear, b.linear, c.linear].map(|linear| linear * share);
                for y in top..=bottom {
                    let mut at = row;
                    for x in left..=right {
                        if (0..3).all(|k| at[k] >= least[k]) {
                            let value = (0..3).map(|k| at[k] as f64 * linear[k]).sum::<f64>();
                            self.show([x, y], value, number);
                        }
                        (0..3).for_each(|k| at[k] += step[k]);
                    }
                    (0..3).for_each(|k| row[k] += down[k]);
                }
            }
        }
    };
}

filled!(fill_small, i64, "Pixels of a triangle whose products fit into 64 bits.");
filled!(fill_large, i128, "Pixels of any triangle.");
