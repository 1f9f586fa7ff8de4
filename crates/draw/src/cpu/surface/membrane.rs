//! A membrane over holes: heights where nothing was measured, for the eye alone.
//!
//! A sample that was not measured has the height between the samples of the next coarser level, which may be such themselves; so it depends
//! on its place alone, and chunks agree where they meet. It is part of the membrane where what was measured on both sides of it, along its row
//! or along its column, is near enough: so holes of any form are spanned where they are narrow, and what lies outside of the measured part of
//! a field is no hole. Where levels meet the membrane's finer border lies on the coarser one.

use super::source::{NodeSamples, SurfaceNodes};
use super::stitch::{Mesh, Scene};
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Heights of chunks with holes, these filled.
type Complete = BTreeMap<ChunkKey, Vec<f64>>;

impl Scene {
    /// Spans holes of up to so many cells from row to row, or from column to column.
    pub fn fill(&mut self, source: &dyn SurfaceNodes, spans: [f64; 2]) {
        let complete = self.complete();
        let filled = |mesh: &Mesh| -> Option<Vec<f64>> {
            let heights = complete.get(&mesh.node.key)?;
            let is_spanned = spanned(source, mesh, spans);
            let fill = mesh.samples.heights.iter().zip(heights).zip(is_spanned);
            let fill: Vec<f64> = fill
                .map(|((own, fill), is_spanned)| if own.is_nan() && is_spanned { *fill } else { f64::NAN })
                .collect();
            fill.iter().any(|height| !height.is_nan()).then_some(fill)
        };
        let fills: Vec<Option<Vec<f64>>> = self.meshes.par_iter().map(filled).collect();
        self.meshes.iter_mut().zip(fills).for_each(|(mesh, fill)| mesh.fill = fill);
        let laid: Vec<Vec<(usize, f64)>> = self.meshes.par_iter().map(|mesh| self.laid_fill(mesh, &complete)).collect();
        for (mesh, laid) in self.meshes.iter_mut().zip(laid) {
            let Some(fill) = &mut mesh.fill else { continue };
            laid.into_iter().for_each(|(index, height)| fill[index] = height);
        }
    }

    /// The heights of all chunks with holes, the coarsest first.
    fn complete(&self) -> Complete {
        let mut complete = Complete::new();
        let keys = self.ancestors.keys().copied().chain(self.meshes.iter().map(|mesh| mesh.node.key));
        let mut keys: Vec<ChunkKey> = keys.collect();
        keys.sort_by_key(|key| std::cmp::Reverse(key.level));
        for level in keys.chunk_by(|a, b| a.level == b.level) {
            let found: Vec<(ChunkKey, Vec<f64>)> = level
                .par_iter()
                .filter_map(|key| {
                    let samples = self.samples(*key).filter(|samples| samples.heights.iter().any(f64::is_nan))?;
                    Some((*key, self.completed(*key, samples, &complete)))
                })
                .collect();
            complete.extend(found);
        }
        complete
    }

    fn completed(&self, key: ChunkKey, samples: &NodeSamples, complete: &Complete) -> Vec<f64> {
        let mut heights: Vec<f64> = samples.heights.iter().collect();
        let top = self.lattice.top();
        if key.level >= top {
            fill_grid(&mut heights, samples.columns);
            return heights;
        }
        let parent = key.ancestor(key.level + 1);
        let Some(coarse) = heights_of(complete.get(&parent), self.samples(parent)) else { return heights };
        let [rows, columns] = [0, 1].map(|axis| self.lattice.places(key, axis));
        for (index, height) in heights.iter_mut().enumerate().filter(|(_, height)| height.is_nan()) {
            let at = [rows[index / samples.columns], columns[index % samples.columns]];
            *height = between(&self.lattice, parent, &coarse, at);
        }
        heights
    }

    /// Where a chunk's membrane lies on a coarser chunk's border, and its height there.
    fn laid_fill(&self, mesh: &Mesh, complete: &Complete) -> Vec<(usize, f64)> {
        let Some(fill) = &mesh.fill else { return Vec::new() };
        let (last, wide) = ([mesh.samples.rows - 1, mesh.samples.columns - 1], mesh.samples.columns);
        let sides = (0..=last[1]).flat_map(|c| [(0, c), (last[0], c)]);
        let ends = (1..last[0]).flat_map(|r| [(r, 0), (r, last[1])]);
        let mut laid = Vec::new();
        for (r, c) in sides.chain(ends).filter(|(r, c)| !fill[r * wide + c].is_nan()) {
            let place = [mesh.rows[r], mesh.columns[c]];
            let beside = [(1, 1), (1, 0), (0, 1), (0, 0)].into_iter().filter_map(|(up, left)| {
                let cell = [place[0].checked_sub(up)?, place[1].checked_sub(left)?];
                (0..2).all(|axis| cell[axis] + 1 < self.lattice.samples[axis]).then(|| self.cut.at(cell[0], cell[1]))?
            });
            // Chunks are sorted by their level.
            let Some(coarse) = beside.max().map(|number| &self.meshes[number]) else { continue };
            if coarse.node.key.level > mesh.node.key.level {
                let own = complete.get(&coarse.node.key);
                let Some(heights) = heights_of(own, Some(&coarse.samples)) else { continue };
                laid.push((r * wide + c, between(&self.lattice, coarse.node.key, &heights, place)));
            }
        }
        laid
    }
}

/// The heights of a chunk: filled, or as its samples have them.
fn heights_of<'a>(
    filled: Option<&'a Vec<f64>>,
    samples: Option<&'a NodeSamples>,
) -> Option<Box<dyn Fn(usize) -> f64 + 'a>> {
    match (filled, samples) {
        (Some(filled), _) => Some(Box::new(|index| filled[index])),
        (None, Some(samples)) => Some(Box::new(|index| samples.heights.at(index))),
        (None, None) => None,
    }
}

/// The height of a chunk's surface between its samples.
fn between(lattice: &Lattice, key: ChunkKey, heights: impl Fn(usize) -> f64, place: [u64; 2]) -> f64 {
    let [(row, down), (column, right)] = [0, 1].map(|axis| {
        let (first, count) = lattice.span(key, axis);
        let cell = lattice.cell_at(axis, key.level.into(), place[axis] as f64);
        let index = cell.saturating_sub(first).min(count.saturating_sub(2) as u64);
        let [from, to] = [0, 1].map(|next| lattice.place(axis, key.level.into(), first + index + next));
        (index as usize, (place[axis].saturating_sub(from)) as f64 / (to - from) as f64)
    });
    let columns = lattice.span(key, 1).1;
    // Sums of products, so that on a border only what is on it counts, to the last bit.
    let mixed = |from: f64, to: f64, share: f64| match share {
        0.0 => from,
        1.0 => to,
        _ => (1.0 - share) * from + share * to,
    };
    let first = row * columns + column;
    let line = |first: usize| mixed(heights(first), heights(first + 1), right);
    match down {
        0.0 => line(first),
        1.0 => line(first + columns),
        _ => mixed(line(first), line(first + columns), down),
    }
}

/// Heights where there are none from those of half as many rows and columns, which are means of what they have around them.
fn fill_grid(heights: &mut [f64], columns: usize) {
    let rows = heights.len() / columns;
    if heights.iter().all(|height| !height.is_nan()) {
        return;
    }
    let (half_rows, half_columns) = (rows.div_ceil(2), columns.div_ceil(2));
    let mean = |index: usize| {
        let (row, column) = (2 * (index / half_columns), 2 * (index % half_columns));
        let near = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let (mut sum, mut count) = (0.0, 0.0);
        for height in near(row, rows)
            .flat_map(|r| near(column, columns).map(move |c| (r, c)))
            .map(|(r, c)| heights[r * columns + c])
        {
            if !height.is_nan() {
                (sum, count) = (sum + height, count + 1.0);
            }
        }
        sum / count
    };
    let mut half: Vec<f64> = (0..half_rows * half_columns).map(mean).collect();
    match half.len() {
        // Nothing is anywhere.
        1 if half[0].is_nan() => half[0] = 0.0,
        1 => {}
        _ => fill_grid(&mut half, half_columns),
    }
    for (index, height) in heights.iter_mut().enumerate() {
        if height.is_nan() {
            let at = [index / columns, index % columns];
            let [(row, down), (column, right)] = [(at[0], half_rows), (at[1], half_columns)].map(|(at, count)| {
                let first = (at / 2).min(count.saturating_sub(2));
                (first, (0.5 * at as f64 - first as f64).clamp(0.0, 1.0))
            });
            let value = |r: usize, c: usize| half[r.min(half_rows - 1) * half_columns + c.min(half_columns - 1)];
            let line = |r: usize| (1.0 - right) * value(r, column) + right * value(r, column + 1);
            *height = (1.0 - down) * line(row) + down * line(row + 1);
        }
    }
}

/// Which of a chunk's samples are within holes that are spanned.
fn spanned(source: &dyn SurfaceNodes, mesh: &Mesh, spans: [f64; 2]) -> Vec<bool> {
    let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
    let mut is_spanned = vec![false; rows * columns];
    for (axis, span) in spans.into_iter().enumerate() {
        let (lines, places) = if axis == 0 { (columns, &mesh.rows) } else { (rows, &mesh.columns) };
        let index = |line: usize, at: usize| if axis == 0 { at * columns + line } else { line * columns + at };
        let [before, after] = [false, true].map(|is_after| beyond(source, mesh.node.key, axis, is_after, span));
        for line in 0..lines {
            let measured = |at: usize| !mesh.samples.heights.at(index(line, at)).is_nan();
            let mut last = before[line];
            let mut at = 0;
            while at < places.len() {
                if measured(at) {
                    (last, at) = (Some(places[at]), at + 1);
                    continue;
                }
                let end = (at..places.len()).find(|at| measured(*at)).unwrap_or(places.len());
                let next = places.get(end).copied().or(after[line]);
                if let (Some(last), Some(next)) = (last, next)
                    && (next - last) as f64 <= span
                {
                    (at..end).for_each(|at| is_spanned[index(line, at)] = true);
                }
                at = end;
            }
        }
    }
    is_spanned
}

/// Of each row or column of a chunk the nearest sample beyond it that was measured, before it or after it along an axis, not farther than a
/// span.
fn beyond(source: &dyn SurfaceNodes, key: ChunkKey, axis: usize, is_after: bool, span: f64) -> Vec<Option<u64>> {
    let lattice = source.lattice();
    let lines = lattice.span(key, 1 - axis).1;
    let mut found = vec![None; lines];
    let mut open: Vec<usize> = (0..lines).collect();
    let edge = |key: ChunkKey, is_after: bool| lattice.rectangle(key)[axis][usize::from(is_after)];
    let (own, mut key) = (edge(key, is_after), key);
    while !open.is_empty() {
        let at = if axis == 0 { &mut key.row } else { &mut key.column };
        let Some(next) = (if is_after { at.checked_add(1) } else { at.checked_sub(1) }) else { break };
        *at = next;
        if !lattice.has(key) || edge(key, !is_after).abs_diff(own) as f64 > span {
            break;
        }
        let Some(facts) = source.facts(key) else { break };
        if facts.is_empty() {
            continue;
        }
        let Some(samples) = source.samples(key) else { break };
        let places = lattice.places(key, axis);
        let height = |line: usize, at: usize| {
            let index = if axis == 0 { at * samples.columns + line } else { line * samples.columns + at };
            samples.heights.at(index)
        };
        open.retain(|line| {
            let is_measured = |at: &usize| !height(*line, *at).is_nan();
            let nearest = match is_after {
                true => (0..places.len()).find(is_measured),
                false => (0..places.len()).rev().find(is_measured),
            };
            found[*line] = nearest.map(|at| places[at]);
            nearest.is_none()
        });
    }
    found
}
