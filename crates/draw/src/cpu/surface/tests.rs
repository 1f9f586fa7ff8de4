//! The bounds that the surface is drawn within, against brute force.

mod adversarial;
mod area;
mod cracks;
mod globes;
mod levels;
mod techniques;

use super::memory::MemorySurface;
use super::placed::{Map, Placed};
use super::select::{CutNode, Primitive, SurfaceCut};
use super::sight::Sight;
use super::source::SurfaceNodes;
use crate::model::Bounds;
use crate::model::mixing::{GOLDEN, mix_bits};
use crate::view::{Extent, Projection, View};
use deepfield_heights::hierarchy::chunks::ChunkKey;
use deepfield_heights::model::{Cell, HeightField};
use glam::DVec3;
use proptest::prelude::*;

/// Random numbers from 0 to 1: a counter, well mixed.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Random {
        Random(seed)
    }

    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        (mix_bits(self.0) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Hills of several sizes; `holes` of the samples were not measured.
pub(super) fn hills(rows: usize, columns: usize, holes: f64, seed: u64) -> HeightField {
    let mut random = Random::new(seed);
    let waves: Vec<[f64; 4]> = (0..9)
        .map(|k| {
            let size = 400.0 / 1.9_f64.powi(k);
            let angle = random.between(0.0, 6.3);
            [angle.cos() / size, angle.sin() / size, random.between(0.0, 6.3), 0.12 * size]
        })
        .collect();
    let heights = (0..rows * columns)
        .map(|index| {
            let (y, x) = ((index / columns) as f64, (index % columns) as f64);
            let height: f64 = waves.iter().map(|[a, b, phase, size]| size * (a * x + b * y + phase).sin()).sum();
            if random.next() < holes { f64::NAN } else { height + 0.3 * random.next() }
        })
        .collect();
    HeightField::of(columns as u64, rows as u64, heights)
}

pub(super) fn placed(field: &HeightField) -> Placed {
    Placed::new(&field.grid, Map::Plate, 1.0, 0.0)
}

/// T's height, brute force; NaN where there is none.
fn t_height(field: &HeightField, row: f64, column: f64) -> f64 {
    let (rows, columns) = (field.grid.rows as usize, field.grid.columns as usize);
    let small = 1e-7;
    for (dr, dc) in [(0.0, 0.0), (small, small), (-small, small), (small, -small), (-small, -small)] {
        let cell = |at: f64, count: usize| (at.floor().max(0.0) as usize).min(count - 2);
        let (r, c) = (cell(row + dr, rows), cell(column + dc, columns));
        let at = |r: usize, c: usize| field.stored[r * columns + c];
        let corners = Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]);
        let (u, v) = (column + dc - c as f64, row + dr - r as f64);
        let inside = |x: f64| (-1e-6..=1.0 + 1e-6).contains(&x);
        if inside(u) && inside(v) {
            let height = corners.height(u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
            if !height.is_nan() {
                return height;
            }
        }
    }
    let (r, c) = (row.round(), column.round());
    if (row - r).hypot(column - c) < 1e-6 { field.stored[r as usize * columns + c as usize] } else { f64::NAN }
}

/// A random set of chunks that covers the field: the same for the same numbers. As points of so many pixels where these leave no gap; 0: none.
fn random_cut(
    source: &dyn SurfaceNodes,
    placed: &Placed,
    sight: &Sight,
    random: &mut Random,
    point: u32,
) -> SurfaceCut {
    cut_where(source, placed, sight, point, |_| random.next() < 0.6)
}

/// The chunks that cover the field when some, above the finest, are refined.
fn cut_where(
    source: &dyn SurfaceNodes,
    placed: &Placed,
    sight: &Sight,
    point: u32,
    mut is_refined: impl FnMut(ChunkKey) -> bool,
) -> SurfaceCut {
    let lattice = source.lattice();
    let (mut waiting, mut nodes) = (vec![lattice.root()], Vec::new());
    while let Some(key) = waiting.pop() {
        if !lattice.has(key) {
            continue;
        }
        if key.level > 0 && is_refined(key) {
            waiting.extend(key.quarters());
            continue;
        }
        nodes.push(cut_node(source, placed, sight, key, point));
    }
    SurfaceCut::new(nodes)
}

fn cut_node(source: &dyn SurfaceNodes, placed: &Placed, sight: &Sight, key: ChunkKey, point: u32) -> CutNode {
    let facts = source.facts(key).unwrap();
    let [rows, columns] = source.lattice().rectangle(key);
    let corner = |k: usize| placed.world(rows[k] as f64, columns[k] as f64, [facts.min, facts.max][k]).to_array();
    let extent = Extent { bounds: Bounds::of([corner(0), corner(1)]), margin: 0.0 };
    let apart = placed.apart(key.level, facts.step);
    let is_points = sight.error_pixels(&extent, apart) <= super::select::POINT_LIMIT * f64::from(point);
    let primitive = if is_points { Primitive::Points } else { Primitive::Triangles };
    CutNode { key, facts, extent, primitive, error_px: 0.0, added: 0.0 }
}

/// A random camera above a field that looks onto it, so that nothing but the field is in the picture.
pub(super) fn camera_over(field: &HeightField, random: &mut Random, size: [u32; 2]) -> View {
    let ground = box_of(field);
    let about = [ground[1].x, ground[1].y].map(|side| [0.3 * side, 0.7 * side]);
    camera_about(about, ground, random, size)
}

/// The corners of the box that holds a field.
fn box_of(field: &HeightField) -> [DVec3; 2] {
    let (columns, rows) = ((field.grid.columns - 1) as f64, (field.grid.rows - 1) as f64);
    let heights = || field.stored.iter().copied();
    let [low, high] = [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)];
    [DVec3::new(0.0, 0.0, low), DVec3::new(columns, rows, high)]
}

/// A random camera that looks at some place between these in x and y, so that nothing but a field in this box is in the picture.
fn camera_about(
    [x, y]: [[f64; 2]; 2],
    [DVec3 { z: low, .. }, DVec3 { x: columns, y: rows, z: high }]: [DVec3; 2],
    random: &mut Random,
    size: [u32; 2],
) -> View {
    loop {
        let target = DVec3::new(random.between(x[0], x[1]), random.between(y[0], y[1]), 0.0);
        let away = 10.0_f64.powf(random.between(0.3, 2.9));
        let lean = random.between(0.0, 1.2);
        let turn = random.between(0.0, 6.3);
        let aside = DVec3::new(turn.cos() * lean.sin(), turn.sin() * lean.sin(), lean.cos());
        let eye = target + DVec3::Z * high + away * aside;
        let projection = match random.next() < 0.7 {
            true => Projection::Perspective { fov_y: random.between(0.2, 0.9) },
            false => Projection::Orthographic { height: random.between(5.0, 900.0) },
        };
        let up = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.3);
        let Ok(view) = View::look_at(eye, target, up, projection, size[0], size[1]) else { continue };
        let sight = Sight::Flat(view);
        let [width, height] = size.map(f64::from);
        let is_on = |corner: [f64; 2]| {
            let Some((origin, direction)) = sight.ray(corner) else { return false };
            // Where the ray is at every height that the field has.
            direction.z < -1e-3
                && [low, high].iter().all(|level| {
                    let t = (level - origin.z) / direction.z;
                    let at = origin + t * direction;
                    t > 0.0 && at.x > 1.0 && at.y > 1.0 && at.x < columns - 1.0 && at.y < rows - 1.0
                })
        };
        if [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].into_iter().all(is_on) {
            return view;
        }
    }
}

proptest! {
    /// No edge longer than a point's side: the square of pixels about some corner holds each pixel centre inside.
    #[test]
    fn points_leave_no_gap(
        middle in prop::array::uniform2(0.0..3.0f64),
        ends in prop::array::uniform4(-1.0..1.0f64),
        side in 1_i32..=16,
    ) {
        let wide = f64::from(side);
        let ends = ends.map(|end| wide * end);
        let (first, second) = ([ends[0], ends[1]], [ends[2], ends[3]]);
        let corners = [middle, [middle[0] + first[0], middle[1] + first[1]], [middle[0] + second[0], middle[1] + second[1]]];
        let length = |k: usize, n: usize| (corners[k][0] - corners[n][0]).hypot(corners[k][1] - corners[n][1]);
        prop_assume!(length(0, 1) <= wide && length(1, 2) <= wide && length(0, 2) <= wide);
        let cross = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let pixels = -side - 1..side + 5;
        for (x, y) in pixels.clone().flat_map(|y| pixels.clone().map(move |x| (x, y))) {
            let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let sides = [0, 1, 2].map(|k| cross(corners[k], corners[(k + 1) % 3], centre));
            let is_in = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
            let first = |place: f64| (place - 0.5 * (wide - 1.0)).floor() as i32;
            let covers = |place: f64, pixel: i32| (0..side).contains(&(pixel - first(place)));
            let shares = corners.iter().any(|corner| covers(corner[0], x) && covers(corner[1], y));
            prop_assert!(!is_in || shares || cross(corners[0], corners[1], corners[2]) == 0.0);
        }
    }
}
