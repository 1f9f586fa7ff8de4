//! The surface that a cut is: chunks of several levels as one surface without cracks.
//!
//! Where chunks of different levels meet, the height at a place of the border is a function of the place and the cut alone
//! ([`Scene::border`]): of the chunks that hold it the coarsest decides, whose border is straight between its own samples; where one of these
//! lies on the border of a still coarser chunk, that one decides first. So all chunks that meet at a place have the same height there, across
//! any number of levels, and the finer border lies on the coarser one's edges.
//!
//! A sample of a finer border within an edge of a coarser one is a corner on the finer side only, and rounding may move its picture off the
//! picture of the edge: so the coarser triangle has it as a corner, too, and is drawn as a fan ([`Mesh::extras`]). Then every edge of a
//! drawn triangle is an edge of exactly two, or lies at a rim, and its ends come from the same operations on both sides.

use super::placed::Placed;
use super::select::{CutNode, SurfaceCut, beside};
use super::source::{NodeSamples, SurfaceNodes};
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use deepfield_heights::model::{Cell, Triangle};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// The sides of a chunk: first row, last row, first column, last column.
pub const SIDES: [(usize, bool); 4] = [(0, false), (0, true), (1, false), (1, true)];

/// A corner that a finer neighbour adds to an edge: row, column, height.
pub type Extra = (u64, u64, f64);

/// A chunk as it is drawn.
pub struct Mesh {
    /// What was chosen.
    pub node: CutNode,
    /// Its samples.
    pub samples: Arc<NodeSamples>,
    /// Where its rows are.
    pub rows: Vec<u64>,
    /// Where its columns are.
    pub columns: Vec<u64>,
    /// Heights along its [`SIDES`] where coarser chunks' borders changed some.
    border: Option<[Vec<f64>; 4]>,
    /// Corners that finer neighbours add to the cells along each of its [`SIDES`], ascending; no cells where there are none.
    pub extras: [Vec<Vec<Extra>>; 4],
    /// Which of its [`SIDES`] lie on a coarser chunk's.
    pub is_laid: [bool; 4],
    /// Heights of a membrane where nothing was measured, NaN elsewhere; `None` where there is no membrane.
    pub(super) fill: Option<Vec<f64>>,
}

impl Mesh {
    /// The height of a sample; NaN where nothing was measured.
    #[inline]
    pub fn height(&self, index: usize) -> f64 {
        match &self.border {
            None => self.samples.heights.at(index),
            Some(border) => {
                let (rows, columns) = (self.samples.rows, self.samples.columns);
                match (index / columns, index % columns) {
                    (0, column) => border[0][column],
                    (row, column) if row + 1 == rows => border[1][column],
                    (row, 0) => border[2][row],
                    (row, column) if column + 1 == columns => border[3][row],
                    _ => self.samples.heights.at(index),
                }
            }
        }
    }

    /// The heights of some columns of a row that were measured, or of the membrane.
    pub fn surface_line(&self, row: usize, columns: &Range<usize>, out: &mut [f64]) {
        let first = row * self.samples.columns;
        let own = first + columns.start..first + columns.end;
        self.samples.heights.copy(own.clone(), out);
        if let Some(border) = &self.border {
            let side = if row == 0 { Some(0) } else { (row + 1 == self.samples.rows).then_some(1) };
            match side {
                Some(side) => out.copy_from_slice(&border[side][columns.clone()]),
                None => {
                    let ends = [(2, 0), (3, self.samples.columns - 1)];
                    for (side, column) in ends.into_iter().filter(|(_, column)| columns.contains(column)) {
                        out[column - columns.start] = border[side][row];
                    }
                }
            }
        }
        if let Some(fill) = &self.fill {
            let open = out.iter_mut().zip(&fill[own]).filter(|(height, _)| height.is_nan());
            open.for_each(|(height, fill)| *height = *fill);
        }
    }

    /// Heights of a membrane where nothing was measured, NaN elsewhere; `None` where there is no membrane.
    pub fn membrane(&self) -> Option<&[f64]> {
        self.fill.as_deref()
    }

    /// Whether all heights are its samples' own.
    pub fn is_unchanged(&self) -> bool {
        self.border.is_none()
    }

    /// The heights at a cell's corners.
    #[inline]
    pub fn cell(&self, row: usize, column: usize) -> Cell {
        let first = row * self.samples.columns + column;
        let next = first + self.samples.columns;
        match self.border.is_some() && (0..4).any(|side| self.is_along(side, row, column)) {
            true => Cell([first, first + 1, next, next + 1].map(|index| self.height(index))),
            false => Cell(self.samples.heights.corners(first, next)),
        }
    }

    /// The height of a sample that was measured, or of the membrane.
    #[inline]
    pub fn surface_height(&self, index: usize) -> f64 {
        let own = self.height(index);
        self.fill.as_ref().filter(|_| own.is_nan()).map_or(own, |fill| fill[index])
    }

    /// The heights at a cell's corners, those of the membrane included.
    #[inline]
    pub fn surface_cell(&self, row: usize, column: usize) -> Cell {
        let first = row * self.samples.columns + column;
        let next = first + self.samples.columns;
        Cell([first, first + 1, next, next + 1].map(|index| self.surface_height(index)))
    }

    /// The triangles of a cell: those of what was measured, then the membrane's, of which `true` tells.
    #[inline]
    pub fn triangles(&self, row: usize, column: usize) -> impl Iterator<Item = (Triangle, bool)> + use<> {
        let cell = self.cell(row, column);
        let rest = (self.fill.is_some() && cell.measured() < 4).then(|| {
            let mut rest = self.surface_cell(row, column);
            // Opposite to the corner that was not measured is the triangle of those that were.
            if cell.measured() == 3
                && let Some(open) = cell.0.iter().position(|height| height.is_nan())
            {
                rest.0[3 - open] = f64::NAN;
            }
            rest
        });
        let own = if rest.is_some() { cell.triangles().count() } else { 2 };
        (0..2_usize).map_while(move |slot| match (slot.checked_sub(own), &rest) {
            (Some(slot), Some(rest)) => rest.triangle(slot).map(|triangle| (triangle, true)),
            _ => cell.triangle(slot).map(|triangle| (triangle, false)),
        })
    }

    /// One of these triangles.
    #[inline]
    pub fn triangle(&self, row: usize, column: usize, slot: usize) -> Option<(Triangle, bool)> {
        match self.fill {
            None => self.cell(row, column).triangle(slot).map(|triangle| (triangle, false)),
            Some(_) => self.triangles(row, column).nth(slot),
        }
    }

    /// The row and the column of its cell that holds a cell of full resolution.
    pub fn cell_at(&self, cell: [u64; 2]) -> [usize; 2] {
        [0, 1].map(|axis| {
            let places = if axis == 0 { &self.rows } else { &self.columns };
            places.partition_point(|place| *place <= cell[axis]).clamp(1, places.len() - 1) - 1
        })
    }

    /// The triangles of a cell with the corners that finer neighbours add to its edges: of each the triangle of the cell that it is a part of,
    /// and its corners.
    pub fn fan(&self, [row, column]: [usize; 2], mut each: impl FnMut(usize, [Extra; 3])) {
        let cell = self.cell(row, column);
        let own = |corner: usize| (self.rows[row + corner / 2], self.columns[column + corner % 2], cell.0[corner]);
        for (slot, triangle) in cell.triangles().enumerate() {
            let corners = triangle.corners;
            let mut outline: Vec<Extra> = Vec::new();
            // Where the outline has each of the cell's corners, and which of these is not on the first edge that has more.
            let (mut starts, mut apex) = ([0; 3], 0);
            let mut is_plain = true;
            for k in 0..3 {
                let (from, to) = (corners[k], corners[(k + 1) % 3]);
                starts[k] = outline.len();
                outline.push(own(from));
                let side = match (from.min(to), from.max(to)) {
                    (0, 1) => 0,
                    (2, 3) => 1,
                    (0, 2) => 2,
                    (1, 3) => 3,
                    _ => continue,
                };
                let along = if side < 2 { column } else { row };
                let extras = self.extras[side].get(along).filter(|_| self.is_along(side, row, column));
                let Some(extras) = extras.filter(|extras| !extras.is_empty()) else { continue };
                if std::mem::take(&mut is_plain) {
                    // That corner sees all parts of the edge.
                    apex = (k + 2) % 3;
                }
                match from < to {
                    true => outline.extend(extras),
                    false => outline.extend(extras.iter().rev()),
                }
            }
            outline.rotate_left(starts[apex]);
            for pair in outline[1..].windows(2) {
                each(slot, [outline[0], pair[0], pair[1]]);
            }
        }
    }

    /// Whether a cell lies along a side.
    #[inline]
    pub fn is_along(&self, side: usize, row: usize, column: usize) -> bool {
        match side {
            0 => row == 0,
            1 => row + 2 == self.samples.rows,
            2 => column == 0,
            _ => column + 2 == self.samples.columns,
        }
    }

    /// Whether a cell of a chunk of points is drawn as triangles: along sides that lie on a coarser chunk's, where its edges may have become
    /// longer than a pixel.
    pub fn is_strip(&self, row: usize, column: usize) -> bool {
        (0..4).any(|side| self.is_laid[side] && self.is_along(side, row, column))
    }

    /// Whether a sample is a corner of a coarser chunk's edge or lies on it.
    pub fn is_on_laid(&self, row: usize, column: usize) -> bool {
        let last = [self.samples.rows - 1, self.samples.columns - 1];
        let on = [row == 0, row == last[0], column == 0, column == last[1]];
        (0..4).any(|side| self.is_laid[side] && on[side])
    }

    /// Whether a measured sample is in none of T's triangles, and stands for no other place: of a coarse level in none of its own, with the least
    /// coverage.
    #[inline]
    pub fn is_lone(&self, row: usize, column: usize) -> bool {
        let index = row * self.samples.columns + column;
        if self.samples.coverage.is_empty() || self.height(index).is_nan() {
            return false;
        }
        if self.node.key.level == 0 || self.samples.coverage[index] != 1 {
            return self.samples.coverage[index] == 1;
        }
        let last = [self.samples.rows - 1, self.samples.columns - 1];
        ![(1, 1), (1, 0), (0, 1), (0, 0)].into_iter().any(|(up, left)| {
            row >= up
                && column >= left
                && row - up < last[0]
                && column - left < last[1]
                && self.cell(row - up, column - left).triangles().any(|found| found.corners.contains(&(2 * up + left)))
        })
    }

    /// The share of a sample that is covered, as it is drawn as a point.
    pub fn opacity(&self, row: usize, column: usize) -> f32 {
        match self.samples.coverage_at(row * self.samples.columns + column) {
            // A measured sample without a triangle is a whole point near by.
            1 if self.node.key.level == 0 => 1.0,
            share => f32::from(share) / 255.0,
        }
    }
}

/// All that is drawn.
pub struct Scene {
    /// The field in the world.
    pub placed: Placed,
    /// Where its samples are.
    pub lattice: Lattice,
    /// What was chosen.
    pub cut: SurfaceCut,
    /// The chosen chunks, in the cut's order.
    pub meshes: Vec<Mesh>,
    /// The chunks that these lie in, which say what they look like from afar.
    pub ancestors: BTreeMap<ChunkKey, Arc<NodeSamples>>,
    /// Heights of a globe's poles beyond the first and the last row, where they are closed.
    pub poles: [Option<Pole>; 2],
}

/// A pole of a globe that is beyond the field by no more than a spacing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pole {
    /// 90 or -90 degrees.
    pub latitude: f64,
    /// The mean height of the field's row next to it.
    pub height: f64,
}

impl Scene {
    /// Reads the chosen chunks and joins them. Chunks whose samples are not there are left out, and the cut is not converged.
    pub fn new(source: &dyn SurfaceNodes, placed: &Placed, mut cut: SurfaceCut) -> Scene {
        let lattice = source.lattice();
        cut = cut.of(&lattice);
        let read: Vec<Option<Arc<NodeSamples>>> = cut.nodes.par_iter().map(|node| source.samples(node.key)).collect();
        if read.iter().any(Option::is_none) {
            let missing = cut.nodes.iter().zip(&read).filter(|(_, samples)| samples.is_none());
            let missing: Vec<(ChunkKey, f64)> = missing.map(|(node, _)| (node.key, f64::INFINITY)).collect();
            cut = cut.without(|key| missing.iter().any(|(missing, _)| missing == key));
            cut.missing.extend(missing);
            (cut.is_converged, cut.is_coarser) = (false, false);
        }
        let read: Vec<Arc<NodeSamples>> = read.into_iter().flatten().collect();
        let mut above: Vec<ChunkKey> = cut
            .nodes
            .iter()
            .flat_map(|node| (node.key.level + 1..=lattice.top()).map(|level| node.key.ancestor(level)))
            .collect();
        above.sort();
        above.dedup();
        let ancestors = above.into_par_iter().filter_map(|key| source.samples(key).map(|samples| (key, samples)));
        let ancestors = ancestors.collect::<Vec<_>>().into_iter().collect();
        let meshes = cut.nodes.iter().zip(read).map(|(node, samples)| Mesh {
            node: *node,
            samples,
            rows: lattice.places(node.key, 0),
            columns: lattice.places(node.key, 1),
            border: None,
            extras: Default::default(),
            is_laid: [false; 4],
            fill: None,
        });
        let meshes = meshes.collect();
        let mut scene = Scene { placed: *placed, lattice, cut, meshes, ancestors, poles: [None; 2] };
        scene.join();
        scene
    }

    /// Closes the poles of a globe that the field goes round: with triangles from its first or last row to the mean of that row.
    pub fn close_poles(&mut self) {
        let Some(root) = self.samples(self.lattice.root()) else { return };
        let rows = [0, root.rows - 1].map(|row| row * root.columns..(row + 1) * root.columns);
        let pole = |end: usize| {
            let latitude = self.placed.poles[end]?;
            let measured = || rows[end].clone().map(|at| root.heights.at(at)).filter(|height| !height.is_nan());
            (measured().count() > 0)
                .then(|| Pole { latitude, height: measured().sum::<f64>() / measured().count() as f64 })
        };
        self.poles = [pole(0), pole(1)];
    }

    /// The pole beyond a chunk's first (0) or last (1) row, if it is closed there.
    pub fn pole_beside(&self, mesh: &Mesh, end: usize) -> Option<Pole> {
        let is_last = mesh.rows.last().copied() == Some(self.lattice.samples[0] - 1);
        self.poles[end].filter(|_| if end == 0 { mesh.rows[0] == 0 } else { is_last })
    }

    /// The samples of a chunk that is drawn or that a drawn one lies in.
    pub fn samples(&self, key: ChunkKey) -> Option<&NodeSamples> {
        match self.ancestors.get(&key) {
            Some(samples) => Some(samples),
            None => self.cut.number(key).map(|number| &*self.meshes[number].samples),
        }
    }

    /// Lays finer borders upon coarser ones.
    fn join(&mut self) {
        // Both sides of a seam may say different heights.
        let is_uniform =
            self.seam().is_none() && self.cut.nodes.windows(2).all(|pair| pair[0].key.level == pair[1].key.level);
        if is_uniform {
            return;
        }
        type Joined = (Option<[Vec<f64>; 4]>, [Vec<Vec<Extra>>; 4], [bool; 4]);
        let joined: Vec<Joined> = self.meshes.par_iter().map(|mesh| self.joined(mesh)).collect();
        for (mesh, (border, extras, is_laid)) in self.meshes.iter_mut().zip(joined) {
            (mesh.border, mesh.extras, mesh.is_laid) = (border, extras, is_laid);
        }
    }

    fn joined(&self, mesh: &Mesh) -> (Option<[Vec<f64>; 4]>, [Vec<Vec<Extra>>; 4], [bool; 4]) {
        if mesh.node.facts.is_empty() {
            return Default::default();
        }
        let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
        let mut is_changed = false;
        let mut found = |row: usize, column: usize| {
            let own = mesh.samples.heights.at(row * columns + column);
            if own.is_nan() {
                return own;
            }
            let found = self.border(mesh.rows[row], mesh.columns[column]);
            let is_other = !found.is_nan() && found.to_bits() != own.to_bits();
            is_changed |= is_other;
            if is_other { found } else { own }
        };
        let border = SIDES.map(|(axis, is_last)| match (axis, is_last) {
            (0, false) => (0..columns).map(|column| found(0, column)).collect(),
            (0, true) => (0..columns).map(|column| found(rows - 1, column)).collect(),
            (_, false) => (0..rows).map(|row| found(row, 0)).collect(),
            (_, true) => (0..rows).map(|row| found(row, columns - 1)).collect::<Vec<f64>>(),
        });
        let border = is_changed.then_some(border);
        let (mut extras, mut is_laid) = (<[Vec<Vec<Extra>>; 4]>::default(), [false; 4]);
        for (side, (axis, is_last)) in SIDES.into_iter().enumerate() {
            let lines = [&mesh.rows, &mesh.columns];
            let line = if is_last { lines[axis][lines[axis].len() - 1] } else { lines[axis][0] };
            let Some(beyond) = beside(&self.lattice, self.placed.around, axis, line, is_last) else { continue };
            let along = lines[1 - axis];
            let neighbour = |place: u64| {
                let cell = if axis == 0 { [beyond, place] } else { [place, beyond] };
                self.measured_at(cell[0], cell[1]).map(|number| self.cut.nodes[number].key.level)
            };
            if let Some(level) = neighbour(along[0])
                && level >= mesh.node.key.level
            {
                is_laid[side] = level > mesh.node.key.level;
                continue;
            }
            let cells: Vec<Vec<Extra>> =
                along.windows(2).map(|ends| self.extras(axis, line, [ends[0], ends[1]], neighbour)).collect();
            if cells.iter().any(|cell| !cell.is_empty()) {
                extras[side] = cells;
            }
        }
        (border, extras, is_laid)
    }

    /// The corners of finer chunks within an edge on a line of constant row (axis 0) or column (axis 1).
    fn extras(
        &self,
        axis: usize,
        line: u64,
        [from, to]: [u64; 2],
        neighbour: impl Fn(u64) -> Option<u8>,
    ) -> Vec<Extra> {
        let mut found = Vec::new();
        let mut place = from;
        while place < to {
            // Where nothing is drawn beside it, the smallest chunk is passed.
            let level = neighbour(place);
            let (step, size) = level.map_or((u64::MAX, 256), |level| (1_u64 << level, 256_u64 << level));
            let end = ((place / size + 1) * size).min(to);
            if level.is_some() {
                let first = (place / step + 1) * step;
                for at in (first..=end).step_by(step as usize).filter(|at| *at < to) {
                    let (row, column) = if axis == 0 { (line, at) } else { (at, line) };
                    found.push((row, column, self.border(row, column)));
                }
            }
            // Where something is drawn again behind a gap there is a corner, as chunks begin with one.
            if level.is_none() && end < to && neighbour(end).is_some() {
                let (row, column) = if axis == 0 { (line, end) } else { (end, line) };
                found.push((row, column, self.border(row, column)));
            }
            place = end;
        }
        found
    }

    /// The chunk that holds a cell of full resolution, unless nothing was measured in it.
    fn measured_at(&self, row: u64, column: u64) -> Option<usize> {
        self.cut.at(row, column).filter(|number| !self.cut.nodes[*number].facts.is_empty())
    }

    /// The column that is the first one again, of a field that goes round.
    fn seam(&self) -> Option<u64> {
        self.placed.around.filter(|around| around + 1 == self.lattice.samples[1])
    }

    /// The height of a border at a sample of full resolution: of the coarsest chunk there that has one; NaN where none has. On a seam the chunks of
    /// both sides are there, whichever of its two columns is asked for.
    pub fn border(&self, row: u64, column: u64) -> f64 {
        let seam = self.seam().filter(|seam| column == 0 || column == *seam);
        let mut around = [(usize::MAX, 0); 4];
        let cells = [(1, 1), (1, 0), (0, 1), (0, 0)];
        for (slot, (up, left)) in around.iter_mut().zip(cells) {
            let column = seam.map_or(column, |seam| if left == 1 { seam } else { 0 });
            if row < up
                || column < left
                || row - up + 1 >= self.lattice.samples[0]
                || column - left + 1 >= self.lattice.samples[1]
            {
                continue;
            }
            *slot = (self.measured_at(row - up, column - left).unwrap_or(usize::MAX), column);
        }
        // Chunks are sorted by their level.
        around.sort_unstable_by(|a, b| b.cmp(a));
        for (position, &(number, column)) in around.iter().enumerate() {
            if number == usize::MAX || position > 0 && around[position - 1] == (number, column) {
                continue;
            }
            let height = self.border_of(&self.meshes[number], [row, column]);
            if !height.is_nan() {
                return height;
            }
        }
        f64::NAN
    }

    /// The height of a chunk's border at a place.
    fn border_of(&self, mesh: &Mesh, place: [u64; 2]) -> f64 {
        let (key, lattice) = (mesh.node.key, &self.lattice);
        let level = u32::from(key.level);
        let index = [0, 1].map(|axis| lattice.sample_at(axis, level, place[axis]));
        match index {
            [Some(row), Some(column)] => {
                let ((first_row, _), (first_column, _)) = (lattice.span(key, 0), lattice.span(key, 1));
                let (row, column) = ((row - first_row) as usize, (column - first_column) as usize);
                mesh.samples.heights.at(row * mesh.samples.columns + column)
            }
            [None, None] => f64::NAN,
            [on_row, _] => {
                let axis = usize::from(on_row.is_some());
                let cell = lattice.cell_at(axis, level, place[axis] as f64);
                let [before, after] = [cell, cell + 1].map(|index| lattice.place(axis, level, index));
                let end = |at: u64| match axis {
                    1 => self.border(place[0], at),
                    _ => self.border(at, place[1]),
                };
                let share = (place[axis] - before) as f64 / (after - before) as f64;
                let (from, to) = (end(before), end(after));
                share.mul_add(to - from, from)
            }
        }
    }
}
