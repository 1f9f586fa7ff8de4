//! The quadtree of a field in memory: what a page file holds, worked out at once. For tests, small sources, and as what page files are held
//! against.

use super::samples::{MeanNormal, SampleHeights, SampleNormals};
use super::source::{NodeFacts, NodeSamples, SurfaceNodes};
use crate::color::colors::to_linear;
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use deepfield_heights::model::{Cell, HeightError, HeightGrid, Heights, Window};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A field's levels and the facts of its chunks.
pub struct MemorySurface {
    lattice: Lattice,
    levels: Vec<Level>,
    facts: BTreeMap<ChunkKey, NodeFacts>,
}

/// The samples of a level, row by row.
#[derive(Default)]
struct Level {
    rows: usize,
    columns: usize,
    heights: Vec<f64>,
    coverage: Vec<u8>,
    stands: Vec<Stands>,
    planes: Vec<Vec<f32>>,
}

/// What a sample stands for.
#[derive(Clone, Copy, Default)]
struct Stands {
    /// Valid area and all area, in cells of full resolution.
    area: f32,
    total: f32,
    normal: [f32; 3],
    range: [f32; 2],
    /// Whether any sample was measured.
    any: bool,
}

/// Which of a triangle's corners, of those of a cell, has the right angle.
fn right_angle(corners: [usize; 3]) -> usize {
    match corners {
        [0, 1, 3] => 1,
        [0, 2, 3] => 2,
        [1, 2, 3] => 3,
        _ => 0,
    }
}

impl MemorySurface {
    /// The quadtree of a field. `slope` turns a unit of height over a column's or a row's step into a slope: the ratio of their units.
    ///
    /// # Errors
    /// Where the field cannot be read.
    pub fn new(field: &dyn Heights, ratio: f64) -> Result<MemorySurface, HeightError> {
        let grid = field.grid().clone();
        let lattice = Lattice::new(grid.rows, grid.columns);
        let mut heights = vec![0.0; grid.samples() as usize];
        field.heights(Window::all(&grid), &mut heights)?;
        let mut planes = Vec::new();
        for plane in 0..grid.planes.len() {
            let mut bytes = vec![0; heights.len()];
            field.plane(plane, Window::all(&grid), &mut bytes)?;
            planes.push(bytes.iter().map(|byte| to_linear(f32::from(*byte) / 255.0)).collect());
        }
        let mut levels = vec![Level::finest(&grid, heights, planes, ratio)];
        for level in 1..=lattice.top() {
            let next = levels[usize::from(level) - 1].coarser(&levels[0], &lattice, level);
            levels.push(next);
        }
        let mut surface = MemorySurface { lattice, levels, facts: BTreeMap::new() };
        for level in 0..=lattice.top() {
            let keys: Vec<ChunkKey> = lattice.keys().filter(|key| key.level == level).collect();
            let found: Vec<NodeFacts> = keys.par_iter().map(|key| surface.work_out(*key)).collect();
            surface.facts.extend(keys.into_iter().zip(found));
        }
        Ok(surface)
    }

    fn work_out(&self, key: ChunkKey) -> NodeFacts {
        let (level, finest) = (&self.levels[usize::from(key.level)], &self.levels[0]);
        let [(row, rows), (column, columns)] = [0, 1].map(|axis| self.lattice.span(key, axis));
        let (row, column) = (row as usize, column as usize);
        let at = |r: usize, c: usize| level.heights[(row + r) * level.columns + column + c];
        let mut facts = NodeFacts {
            delta: 0.0,
            step: 0.0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            coverage: [u8::MAX, 0],
            deviation: 0.0,
            change: 0.0,
        };
        for (r, c) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
            let coverage = level.coverage[(row + r) * level.columns + column + c];
            facts.coverage = [facts.coverage[0].min(coverage), facts.coverage[1].max(coverage)];
            let height = at(r, c);
            if height.is_nan() {
                continue;
            }
            (facts.min, facts.max) = (facts.min.min(height), facts.max.max(height));
            let steps = [(0, 1, c + 1 < columns), (1, 0, r + 1 < rows), (1, 1, r + 1 < rows && c + 1 < columns)];
            for (down, right, _) in steps.into_iter().filter(|step| step.2) {
                facts.step = facts.step.max((at(r + down, c + right) - height).abs());
            }
            if r + 1 < rows && c > 0 {
                facts.step = facts.step.max((at(r + 1, c - 1) - height).abs());
            }
        }
        let [row_places, column_places] = [0, 1].map(|axis| self.lattice.places(key, axis));
        let [last_row, last_column] = [&row_places, &column_places].map(|places| places[places.len() - 1] as usize);
        for (r, c) in (row_places[0] as usize..=last_row)
            .flat_map(|r| (column_places[0] as usize..=last_column).map(move |c| (r, c)))
        {
            let height = finest.heights[r * finest.columns + c];
            if !height.is_nan() {
                (facts.min, facts.max) = (facts.min.min(height), facts.max.max(height));
            }
        }
        if key.level == 0 {
            return facts;
        }
        let whole = 1_u64 << key.level;
        for (r, c) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
            let cell = Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]);
            let [top, bottom] = [row_places[r], row_places[r + 1]];
            let [left, right] = [column_places[c], column_places[c + 1]];
            // Where diagonals do not meet, or samples are missing, edges cross each other off the samples: what is next to a triangle
            // counts there, too.
            let exact = bottom - top == whole && right - left == whole && facts.coverage[0] == u8::MAX;
            let slack = if exact { 0.0 } else { 1.0 / (bottom - top) as f64 + 1.0 / (right - left) as f64 };
            for triangle in cell.triangles() {
                let ([p, q, s], [k, m, n]) = (triangle.at, triangle.edge);
                for place in top..=bottom {
                    let v = (place - top) as f64 / (bottom - top) as f64;
                    let line = &finest.heights[place as usize * finest.columns..];
                    for across in left..=right {
                        let u = (across - left) as f64 / (right - left) as f64;
                        let height = line[across as usize];
                        if k + m * u + n * v >= -slack && !height.is_nan() {
                            facts.delta = facts.delta.max((p + q * u + s * v - height).abs());
                        }
                    }
                }
            }
        }
        let finer = &self.levels[usize::from(key.level) - 1];
        for child in self.lattice.children(key) {
            facts.deviation = facts.deviation.max(self.facts.get(&child).map_or(0.0, |facts| facts.deviation));
            let [(row, rows), (column, columns)] = [0, 1].map(|axis| self.lattice.span(child, axis));
            for r in row as usize..row as usize + rows {
                for c in column as usize..column as usize + columns {
                    facts.deviation = facts.deviation.max(finer.deviation(level, r, c));
                }
            }
        }
        facts
    }
}

impl Level {
    fn finest(grid: &HeightGrid, heights: Vec<f64>, planes: Vec<Vec<f32>>, ratio: f64) -> Level {
        let (rows, columns) = (grid.rows as usize, grid.columns as usize);
        let slope = [ratio / grid.step[0], ratio / grid.step[1]];
        let sample = |index: usize| {
            let (r, c) = (index / columns, index % columns);
            let mut stands = Stands { normal: [0.0, 0.0, 1.0], any: !heights[index].is_nan(), ..Stands::default() };
            stands.range = [heights[index] as f32; 2];
            let mut normal = [0.0_f64; 3];
            for (up, left) in [(1, 1), (1, 0), (0, 1), (0, 0)] {
                if r < up || c < left || r - up + 1 >= rows || c - left + 1 >= columns {
                    continue;
                }
                let first = (r - up) * columns + c - left;
                let cell = Cell([first, first + 1, first + columns, first + columns + 1].map(|at| heights[at]));
                let own = 2 * up + left;
                stands.total += 0.25;
                for triangle in cell.triangles().filter(|triangle| triangle.corners.contains(&own)) {
                    let share = if right_angle(triangle.corners) == own { 0.25 } else { 0.125 };
                    stands.area += share;
                    let [x, y] = [triangle.at[1] * slope[0], triangle.at[2] * slope[1]];
                    let length = (x * x + y * y + 1.0).sqrt();
                    let unit = [-x / length, -y / length, 1.0 / length];
                    (0..3).for_each(|k| normal[k] += f64::from(share) * unit[k]);
                }
            }
            if stands.area > 0.0 {
                stands.normal = normal.map(|sum| (sum / f64::from(stands.area)) as f32);
            }
            stands
        };
        let stands: Vec<Stands> = (0..heights.len()).into_par_iter().map(sample).collect();
        let coverage = stands.iter().map(Stands::coverage).collect();
        Level { rows, columns, heights, coverage, stands, planes }
    }

    /// The next coarser level, number `level` of the field.
    fn coarser(&self, finest: &Level, lattice: &Lattice, level: u8) -> Level {
        let [rows, columns] = lattice.samples_of(level.into()).map(|samples| samples as usize);
        let [row_parts, column_parts] = [(self.rows, rows), (self.columns, columns)]
            .map(|(fine, coarse)| (0..coarse).map(|index| parts(index, fine, coarse)).collect::<Vec<_>>());
        let each = |index: usize| {
            let (r, c) = (index / columns, index % columns);
            let mut stands = Stands { range: [f32::INFINITY, f32::NEG_INFINITY], ..Stands::default() };
            let (mut normal, mut fitted, mut weight) = ([0.0_f64; 3], 0.0_f64, 0.0_f64);
            let mut planes = vec![0.0_f64; self.planes.len()];
            for (fine_row, row_weight) in row_parts[r].iter().flatten() {
                for (fine_column, column_weight) in column_parts[c].iter().flatten() {
                    let at = fine_row * self.columns + fine_column;
                    let (part, share) = (&self.stands[at], row_weight * column_weight);
                    stands.total += share * part.total;
                    if !part.any {
                        continue;
                    }
                    stands.any = true;
                    stands.area += share * part.area;
                    stands.range = [stands.range[0].min(part.range[0]), stands.range[1].max(part.range[1])];
                    // What has no area still stands for something where there is nothing else.
                    let share = f64::from(share * part.area.max(1e-6));
                    weight += share;
                    fitted += share * self.heights[at];
                    (0..3).for_each(|k| normal[k] += share * f64::from(part.normal[k]));
                    planes.iter_mut().zip(&self.planes).for_each(|(sum, plane)| *sum += share * f64::from(plane[at]));
                }
            }
            let place = [(0, r), (1, c)].map(|(axis, index)| lattice.place(axis, level.into(), index as u64) as usize);
            let own = finest.heights[place[0] * finest.columns + place[1]];
            let height = match (own.is_nan(), weight > 0.0) {
                (false, _) => own,
                (true, true) => fitted / weight,
                (true, false) => f64::NAN,
            };
            if weight > 0.0 {
                stands.normal = normal.map(|sum| (sum / weight) as f32);
                planes.iter_mut().for_each(|sum| *sum /= weight);
            }
            (height, stands, planes)
        };
        let all: Vec<(f64, Stands, Vec<f64>)> = (0..rows * columns).into_par_iter().map(each).collect();
        Level {
            rows,
            columns,
            heights: all.iter().map(|sample| sample.0).collect(),
            coverage: all.iter().map(|sample| sample.1.coverage()).collect(),
            stands: all.iter().map(|sample| sample.1).collect(),
            planes: (0..self.planes.len()).map(|k| all.iter().map(|sample| sample.2[k] as f32).collect()).collect(),
        }
    }

    /// How far what a sample looks like is from what the next coarser level has in its place.
    fn deviation(&self, coarse: &Level, row: usize, column: usize) -> f32 {
        let at = row * self.columns + column;
        if !self.stands[at].any {
            return 0.0;
        }
        let near = |index: usize, fine: usize, count: usize| match index {
            _ if index.is_multiple_of(2) => [index / 2; 2],
            _ if index + 1 == fine => [count - 1; 2],
            _ => [index / 2, index / 2 + 1],
        };
        let (rows, columns) = (near(row, self.rows, coarse.rows), near(column, self.columns, coarse.columns));
        let mut sum = [0.0_f32; 3];
        let mut planes = vec![0.0_f32; self.planes.len()];
        let corners = rows.into_iter().flat_map(|r| columns.map(|c| r * coarse.columns + c));
        for corner in corners {
            let normal = if coarse.stands[corner].any { coarse.stands[corner].normal } else { self.stands[at].normal };
            (0..3).for_each(|k| sum[k] += 0.25 * normal[k]);
            planes.iter_mut().zip(&coarse.planes).for_each(|(sum, plane)| *sum += 0.25 * plane[corner]);
        }
        let turned = (0..3).map(|k| (sum[k] - self.stands[at].normal[k]).powi(2)).sum::<f32>().sqrt();
        let faded = planes.iter().zip(&self.planes).map(|(mean, plane)| (mean - plane[at]).abs()).fold(0.0, f32::max);
        turned.max(faded)
    }
}

/// Which of `fine` samples of a level stand for sample `index` of `coarse` ones of the next level along an axis, and with which share: a sample
/// between two counts half for each.
fn parts(index: usize, fine: usize, coarse: usize) -> [Option<(usize, f32)>; 3] {
    let middle = (2 * index).min(fine - 1);
    let before = (index > 0 && middle == 2 * index).then(|| (middle - 1, 0.5));
    let after = (index + 1 < coarse && middle + 2 < fine).then_some((middle + 1, 0.5));
    // The last of an even number of samples is a coarse sample itself, though its number is odd.
    let is_shared = |part: &(usize, f32)| part.0 % 2 == 1 && part.0 + 1 != fine;
    [before.filter(is_shared), Some((middle, 1.0)), after.filter(is_shared)]
}

impl Stands {
    fn coverage(&self) -> u8 {
        match self {
            Stands { any: false, .. } => 0,
            Stands { area, total, .. } if area >= total => u8::MAX,
            Stands { area, total, .. } => (255.0 * area / total).round().clamp(1.0, 254.0) as u8,
        }
    }
}

impl SurfaceNodes for MemorySurface {
    fn lattice(&self) -> Lattice {
        self.lattice
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        self.facts.get(&key).copied()
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let level = self.levels.get(usize::from(key.level)).filter(|_| self.lattice.has(key))?;
        let [(row, rows), (column, columns)] = [0, 1].map(|axis| self.lattice.span(key, axis));
        let indices = (row as usize..row as usize + rows)
            .flat_map(|r| (column as usize..column as usize + columns).map(move |c| r * level.columns + c));
        let coverage: Vec<u8> = indices.clone().map(|at| level.coverage[at]).collect();
        Some(Arc::new(NodeSamples {
            rows,
            columns,
            heights: SampleHeights::of(indices.clone().map(|at| level.heights[at]).collect()),
            coverage: if coverage.iter().all(|share| *share == u8::MAX) { Vec::new() } else { coverage },
            normals: SampleNormals::Parts(indices.clone().map(|at| MeanNormal::new(level.stands[at].normal)).collect()),
            ranges: match key.level {
                0 => Vec::new(),
                _ => indices.clone().map(|at| level.stands[at].range).collect(),
            },
            planes: level.planes.iter().map(|plane| indices.clone().map(|at| plane[at]).collect()).collect(),
            changes: Vec::new(),
        }))
    }
}
