//! What shaders are told of a surface's chunks: each chunk, and lists of numbers, heights and triangles.

use super::cast;
use super::constants::{CAST, CHUNK, FAN, FANNED, LAID, LEAF, MARGIN, MIXED, NONE, POINTS, SMALL, UNMEASURED};
use super::globe::{Anchor, Tables, longest};
use super::layout::Draw;
use super::photo::PhotoList;
use super::pool::Held;
use super::squares;
use crate::cpu::surface::holes::Holes;
use crate::cpu::surface::raster::{POLE, Shown};
use crate::cpu::surface::rims;
use crate::cpu::surface::select::Primitive;
use crate::cpu::surface::stitch::{Mesh, Scene};
use crate::heights::hierarchy::chunks::ChunkKey;
use crate::picture::adapter::AdapterSurface;
use bevy::math::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// What is drawn of a scene.
pub struct DrawList {
    /// The chunks, in the order of their numbers.
    pub draws: Vec<Draw>,
    /// Numbers, heights of borders, chains, squares and triangles.
    pub lists: Vec<u32>,
    /// Chunks of which all triangles are small: where their numbers are listed, and how many.
    pub far: (u32, u32),
    /// Others.
    pub near: (u32, u32),
    /// Triangles whose corners are listed.
    pub fans: (u32, u32),
    /// Chunks that rays are cast through, each with squares of the picture (`cast::squares`).
    pub rays: (u32, u32),
    /// The tree that finds chunks.
    pub tree: u32,
    /// Where the rows of a globe's poles are listed.
    pub poles: [u32; 2],
    /// Where what finds a photo's texels is.
    pub photo: PhotoList,
}

/// A height as shaders have it.
pub fn counted(height: f64, reference: f64) -> f32 {
    if height.is_nan() { UNMEASURED } else { (height - reference) as f32 }
}

impl DrawList {
    /// Of a scene whose samples, and whose photo, are where `held` and `photo` say.
    pub fn new(job: &AdapterSurface, held: &Held, photo: Option<&Held>) -> DrawList {
        let scene = &job.scene;
        // How steep a membrane is nothing says.
        let is_far = |mesh: &Mesh| mesh.membrane().is_none() && largest(job, mesh) < f64::from(SMALL) - 1.0;
        let is_cast = job.casts_rays();
        let numbers = 0..scene.meshes.len();
        let (far, near): (Vec<usize>, Vec<usize>) = match is_cast {
            // Beside what rays meet there are points where something was not measured.
            true => (numbers.filter(|number| !scene.meshes[*number].samples.coverage.is_empty()).collect(), Vec::new()),
            false => numbers.partition(|number| is_far(&scene.meshes[*number])),
        };
        let mut lists: Vec<u32> = far.iter().chain(&near).map(|number| *number as u32).collect();
        let (far, near) = (far.len() as u32, near.len() as u32);
        let mut chains: BTreeMap<ChunkKey, u32> = BTreeMap::new();
        let mut tables = Anchor::of(scene, job.view.eye, job.reference).map(Tables::new);
        let outlined = match job.holes {
            Holes::Outlined(_) => rims::squares(scene),
            Holes::Open | Holes::Filled(_) => Vec::new(),
        };
        let mut draws = Vec::with_capacity(scene.meshes.len());
        for (number, mesh) in scene.meshes.iter().enumerate() {
            let key = mesh.node.key;
            let border = border_of(mesh, job.reference);
            let [low, high] = ends_of(mesh).map(|end| (end - job.reference) as f32);
            let mut draw = Draw {
                start: held.first_word(&mesh.samples).unwrap_or(NONE),
                rows: mesh.samples.rows as u32,
                columns: mesh.samples.columns as u32,
                level: u32::from(key.level),
                key_row: key.row,
                key_column: key.column,
                flags: flags_of(job, mesh),
                low,
                high,
                border: if border.is_empty() { NONE } else { lists.len() as u32 },
                fans: NONE,
                ..Draw::default()
            };
            lists.extend(border);
            draw.rims = outlined.get(number).map_or(NONE, |squares| squares::of_rims(squares, &mut lists));
            draw.fill = squares::of_membrane(mesh, job.reference, &mut lists);
            if let Some(tables) = &mut tables {
                [draw.rows_at, draw.columns_at] = tables.of_chunk(mesh, &mut lists);
                let [_, per_row] = longest(&scene.placed, ends_of(mesh));
                draw.row_length = (per_row * (1_u64 << key.level) as f64) as f32;
            }
            let top = scene.lattice.top();
            draw.chain_length = u32::from(top - key.level) + 1;
            draw.chain = *chains.entry(key).or_insert_with(|| {
                let first = lists.len() as u32;
                for level in key.level..=top {
                    let (samples, own) = match level == key.level {
                        true => (Some(&mesh.samples), key),
                        false => (scene.ancestors.get(&key.ancestor(level)), key.ancestor(level)),
                    };
                    let size = [0, 1].map(|axis| scene.lattice.span(own, axis).1 as u32);
                    let word = samples.and_then(|samples| held.first_word(samples)).unwrap_or(NONE);
                    lists.extend([word, size[0], size[1]]);
                }
                first
            });
            draws.push(draw);
        }
        // Rays through flat fields have edges a little wider in their place.
        let is_listed = !is_cast || job.is_globe();
        let has_fans = |mesh: &Mesh| {
            is_listed && (mesh.extras.iter().any(|side| !side.is_empty()) || is_seam(mesh, CHUNK as usize))
        };
        let fans: Vec<Vec<u32>> = scene
            .meshes
            .par_iter()
            .enumerate()
            .filter(|(_, mesh)| has_fans(mesh))
            .map(|(number, mesh)| fans_of(mesh, number, job.reference))
            .collect();
        let mut fans = fans.concat();
        let mut poles = [0; 2];
        if let Some(tables) = &mut tables {
            for corner in fans.chunks_exact_mut(FAN as usize).flat_map(|fan| fan[1..].chunks_exact_mut(3)) {
                let at = tables.of_corner([corner[0].into(), corner[1].into()], &mut lists);
                corner[..2].copy_from_slice(&at);
            }
            for (end, pole) in scene.poles.iter().enumerate() {
                let Some(pole) = pole else { continue };
                poles[end] = tables.of_pole(pole.latitude, &mut lists);
                fans.extend(pole_of(job, (end, poles[end]), tables, &mut lists));
            }
        }
        let first = lists.len() as u32;
        lists.extend(&fans);
        let fans = match is_cast {
            true => {
                let corners = (first..).step_by(FAN as usize);
                corners
                    .zip(fans.chunks_exact(FAN as usize))
                    .for_each(|(at, fan)| find(fan[0], at, &mut draws, &mut lists));
                (first, 0)
            }
            false => (first, fans.len() as u32 / FAN),
        };
        let squares = if is_cast { cast::squares(job) } else { Vec::new() };
        let rays = (lists.len() as u32, squares.len() as u32 / 2);
        lists.extend(squares);
        let tree = Tree::of(scene).branch(scene.lattice.root(), &mut lists);
        let photo = job.photo.as_ref().zip(photo);
        let photo = photo.map(|(cut, held)| PhotoList::new(cut, held, &mut lists)).unwrap_or_default();
        DrawList { draws, lists, far: (0, far), near: (far, near), fans, rays, tree, poles, photo }
    }
}

/// Between which heights a chunk's triangles are, and a little more.
pub fn ends_of(mesh: &Mesh) -> [f64; 2] {
    let (facts, added) = (&mesh.node.facts, mesh.node.added);
    let measured = if facts.is_empty() { [f64::INFINITY, f64::NEG_INFINITY] } else { [facts.min, facts.max] };
    let membrane = mesh.membrane().into_iter().flatten().filter(|height| !height.is_nan());
    let [low, high] = membrane.fold(measured, |[low, high], height| [low.min(*height), high.max(*height)]);
    if low > high {
        return [0.0; 2];
    }
    // Coarse samples are where fine ones are, or fitted, and those of borders as far from them as is reckoned with.
    let hair = facts.delta + added + 1e-5 * (high - low) + 1e-6 * high.abs().max(low.abs());
    [low - hair, high + hair]
}

/// The chunks that drawn ones lie in.
struct Tree<'a> {
    scene: &'a Scene,
    inner: HashSet<ChunkKey>,
}

impl Tree<'_> {
    fn of(scene: &Scene) -> Tree<'_> {
        let above = |mesh: &Mesh| {
            let key = mesh.node.key;
            (key.level + 1..=scene.lattice.top()).map(move |level| key.ancestor(level))
        };
        Tree { scene, inner: scene.meshes.iter().flat_map(above).collect() }
    }

    /// What stands for a branch, with what is below it in the lists.
    fn branch(&self, key: ChunkKey, lists: &mut Vec<u32>) -> u32 {
        if let Some(number) = self.scene.cut.number(key) {
            return LEAF + number as u32;
        }
        if !self.inner.contains(&key) {
            return NONE;
        }
        let first = lists.len();
        lists.extend([NONE; 4]);
        for part in 0..4 {
            let [row, column] = [2 * key.row + part / 2, 2 * key.column + part % 2];
            lists[first + part as usize] = self.branch(ChunkKey { level: key.level - 1, row, column }, lists);
        }
        first as u32
    }
}

/// The longest edge of a chunk's triangles that there may be in the picture, in its samples.
fn largest(job: &AdapterSurface, mesh: &Mesh) -> f64 {
    let (node, placed) = (&mesh.node, &job.scene.placed);
    let [x, y] = placed.spacing().map(|step| step * (1_u64 << node.key.level) as f64);
    let apart = x.hypot(y).hypot((node.facts.step + 2.0 * node.added) * placed.lift);
    let up = if placed.is_flat() { DVec3::Z } else { DVec3::ONE };
    let added = up * (node.added * placed.lift).abs();
    let mut extent = node.extent;
    (extent.bounds.min, extent.bounds.max) = (extent.bounds.min - added, extent.bounds.max + added);
    job.view.error_pixels(&extent, apart)
}

fn flags_of(job: &AdapterSurface, mesh: &Mesh) -> u32 {
    let mut flags = match mesh.node.primitive {
        _ if job.casts_rays() => CAST,
        Primitive::Points => POINTS,
        Primitive::Triangles => 0,
    };
    flags |= if mesh.samples.coverage.is_empty() { 0 } else { MIXED };
    flags |= mesh.margin_side(&job.scene, |length| job.view.error_pixels(&mesh.node.extent, length)) << MARGIN;
    for side in 0..4 {
        flags |= u32::from(mesh.is_laid[side]) << (LAID + side as u32);
        flags |= u32::from(!mesh.extras[side].is_empty()) << (FANNED + side as u32);
    }
    flags
}

/// The heights along a chunk's first and last row and its first and last column, where they are not its samples' own.
fn border_of(mesh: &Mesh, reference: f64) -> Vec<u32> {
    if mesh.is_unchanged() {
        return Vec::new();
    }
    let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
    let along = [0, rows - 1].into_iter().flat_map(|row| (0..columns).map(move |column| row * columns + column));
    let down = [0, columns - 1].into_iter().flat_map(|column| (0..rows).map(move |row| row * columns + column));
    along.chain(down).map(|index| counted(mesh.height(index), reference).to_bits()).collect()
}

/// Whether a column of cells is that which closes a globe, and behind all others of its chunk: these are listed one by one.
fn is_seam(mesh: &Mesh, column: usize) -> bool {
    column == CHUNK as usize && column + 2 == mesh.samples.columns
}

/// Has rays find a triangle whose corners are listed, behind others of its cell or its pole: of each of these lists say where the first one is, and how
/// many there are.
fn find(number: u32, at: u32, draws: &mut [Draw], lists: &mut Vec<u32>) {
    let shown = Shown::unpack(number);
    let draw = &mut draws[shown.node];
    let cells = [draw.rows, draw.columns].map(|samples| samples as usize - 1);
    if draw.fans == NONE {
        draw.fans = lists.len() as u32;
        lists.resize(lists.len() + 2 * (2 + 2 * (cells[0] + cells[1])), 0);
    }
    let entry = draw.fans as usize + 2 * entry_of(shown, cells);
    if lists[entry + 1] == 0 {
        lists[entry] = at;
    }
    lists[entry + 1] += 1;
}

/// The number of a pole, or of a cell along a side, among those of a chunk of so many rows and columns of cells: poles come first, then the first and
/// the last row, then the first and the last column.
fn entry_of(Shown { at: [row, column], slot, .. }: Shown, [rows, columns]: [usize; 2]) -> usize {
    match slot {
        Some(slot) if slot >= POLE => slot - POLE,
        _ if row == 0 => 2 + column,
        _ if row + 1 == rows => 2 + columns + column,
        _ if column == 0 => 2 + 2 * columns + row,
        _ => 2 + 2 * columns + rows + row,
    }
}

/// The triangles of the cells along sides of a chunk that finer ones add corners to, and of those that close a globe.
fn fans_of(mesh: &Mesh, number: usize, reference: f64) -> Vec<u32> {
    let mut words = Vec::new();
    let [rows, columns] = [mesh.samples.rows - 1, mesh.samples.columns - 1];
    let is_fanned =
        |side: usize, row: usize, column: usize| !mesh.extras[side].is_empty() && mesh.is_along(side, row, column);
    let is_points = mesh.node.primitive == Primitive::Points;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let is_drawn = !is_points || mesh.is_strip(row, column);
        if is_seam(mesh, column) || is_drawn && (0..4).any(|side| is_fanned(side, row, column)) {
            mesh.fan([row, column], |slot, corners| {
                words.push(Shown { node: number, at: [row, column], slot: Some(slot) }.pack());
                for (row, column, height) in corners {
                    words.extend([row as u32, column as u32, counted(height, reference).to_bits()]);
                }
            });
        }
        if is_seam(mesh, column) && mesh.membrane().is_some() {
            let heights = mesh.surface_cell(row, column).0;
            let triangles = mesh.triangles(row, column).enumerate();
            for (slot, (triangle, _)) in triangles.filter(|(_, (_, is_membrane))| *is_membrane) {
                words.push(Shown { node: number, at: [row, column], slot: Some(slot) }.pack());
                for corner in triangle.corners {
                    let place = [mesh.rows[row + corner / 2], mesh.columns[column + corner % 2]];
                    words.extend(place.map(|at| at as u32));
                    words.push(counted(heights[corner], reference).to_bits());
                }
            }
        }
    }
    words
}

/// The triangles between a globe's first (0) or last (1) row and the pole beyond it, whose row is listed.
fn pole_of(job: &AdapterSurface, (end, at): (usize, u32), tables: &mut Tables<'_>, lists: &mut Vec<u32>) -> Vec<u32> {
    let mut words = Vec::new();
    for (number, mesh) in job.scene.meshes.iter().enumerate() {
        let Some(pole) = job.scene.pole_beside(mesh, end) else { continue };
        let row = if end == 0 { 0 } else { mesh.samples.rows - 1 };
        let height = |column: usize| mesh.height(row * mesh.samples.columns + column);
        for column in 0..mesh.samples.columns - 1 {
            if height(column).is_nan() || height(column + 1).is_nan() {
                continue;
            }
            let corners = [column, column + 1].map(|column| {
                let [row, at] = tables.of_corner([mesh.rows[row], mesh.columns[column]], lists);
                [row, at, counted(height(column), job.reference).to_bits()]
            });
            words.push(Shown { node: number, at: [0, column], slot: Some(POLE + end) }.pack());
            words.extend([at, corners[0][1], counted(pole.height, job.reference).to_bits()]);
            words.extend(corners.as_flattened());
        }
    }
    words
}
