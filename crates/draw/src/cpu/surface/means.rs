//! A pyramid of means for each chunk, and the rule that chooses its levels by how far samples are apart: those of the paper on hybrid point and
//! polygon rendering, for comparisons. Its flaws are kept: this is no way to draw a surface within a bound.
//!
//! Each leaf of the field is on its own. Four samples of a level become their mean, in their middle; one of which any was not measured is none, so
//! that holes grow. What an odd number of rows or columns has more is left out: within the field it is the neighbour's first, at the field's end
//! it is lost. Levels end where fewer than 2 x 2 samples would be left.
//!
//! Of a level `b` is the diagonal of a cell, `h` the largest step between neighbouring samples, and `d = sqrt(b^2 + h^2)` in the world. A sphere
//! of radius `d` where the chunk is nearest to the eye is projected, and the coarsest level whose `d` is just below a point's side is drawn as
//! points. Where full resolution is too coarse for that its triangles are drawn, which are those of T.
//!
//! Pyramids are made while chunks are drawn, near ones first, a few at a time, and what is hidden is not shaded.

use super::darken::darken;
use super::look::{Attribute, Look};
use super::photo::{Laid, PhotoLook, PhotoTiles};
use super::picture::{SurfaceOptions, SurfacePicture, SurfaceReport, parts};
use super::placed::Placed;
use super::raster::{self, Shown, Visibility};
use super::resolve::{CHANNELS, Hit, NOTHING, Resolver};
use super::samples::{MeanNormal, SampleHeights, SampleNormals};
use super::select::{CutNode, POINT_LIMIT, Primitive, SurfaceCut, Technique, extent_of};
use super::shade::Shader;
use super::sight::Sight;
use super::source::{NodeFacts, NodeSamples, SurfaceNodes};
use super::stitch::Scene;
use crate::color::Colors;
use crate::model::Bounds;
use crate::view::{Extent, View};
use deepfield_heights::hierarchy::chunks::lattice::SIDE_BITS;
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use deepfield_heights::hierarchy::photo::TileKey;
use deepfield_heights::model::PhotoPlace;
use deepfield_heights::store::Tile;
use glam::DVec3;
use rayon::prelude::*;
use std::iter;
use std::ops::Range;
use std::sync::Arc;

/// Levels of a whole chunk's pyramid: from 257 x 257 samples to 2 x 2.
pub(crate) const LEVELS: u32 = SIDE_BITS;
/// So many chunks are drawn at once.
const TOGETHER: usize = 64;
/// Pixels about a chunk's box into which it may reach by rounding.
const BESIDE: f64 = 2.0;

/// The next coarser level of a chunk; `None` where it would have fewer than 2 x 2 samples.
fn halved(fine: &NodeSamples) -> Option<NodeSamples> {
    let (rows, columns) = (fine.rows / 2, fine.columns / 2);
    if rows < 2 || columns < 2 {
        return None;
    }
    let each = || {
        (0..rows * columns).map(|index| {
            let first = 2 * (index / columns * fine.columns + index % columns);
            [first, first + 1, first + fine.columns, first + fine.columns + 1]
        })
    };
    // No number where one of four is none.
    let heights: Vec<f64> =
        each().map(|four| four.map(|at| 0.25 * fine.heights.at(at)).into_iter().sum::<f64>()).collect();
    let is_open = heights.iter().any(|height| height.is_nan());
    let share = |height: &f64| if height.is_nan() { 0 } else { u8::MAX };
    let normal = |four: [usize; 4]| {
        let four = four.map(|at| fine.normals.at(at));
        MeanNormal::new(std::array::from_fn(|k| 0.25 * four.iter().map(|normal| normal[k]).sum::<f32>()))
    };
    let singles = |values: &Vec<f32>| match values.is_empty() {
        true => Vec::new(),
        false => each().map(|four| 0.25 * four.into_iter().map(|at| values[at]).sum::<f32>()).collect(),
    };
    Some(NodeSamples {
        rows,
        columns,
        coverage: if is_open { heights.iter().map(share).collect() } else { Vec::new() },
        normals: match &fine.normals {
            SampleNormals::Up(_) => SampleNormals::Up(heights.len()),
            SampleNormals::Parts(_) => SampleNormals::Parts(each().map(normal).collect()),
        },
        heights: SampleHeights::of(heights),
        ranges: Vec::new(),
        planes: fine.planes.iter().map(singles).collect(),
        changes: singles(&fine.changes),
    })
}

/// The levels of a chunk, from full resolution up; each is made when the one before it is asked for.
fn pyramid(finest: Arc<NodeSamples>) -> impl Iterator<Item = Arc<NodeSamples>> {
    iter::successors(Some(finest), |fine| halved(fine).map(Arc::new))
}

/// The largest step between neighbouring samples, diagonals included.
fn largest_step(samples: &NodeSamples) -> f64 {
    let NodeSamples { rows, columns, heights, .. } = samples;
    let mut largest = 0.0_f64;
    for first in (0..rows - 1).flat_map(|row| (0..columns - 1).map(move |column| row * columns + column)) {
        let cell = [first, first + 1, first + columns, first + columns + 1].map(|at| heights.at(at));
        for (one, other) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            // Steps from and to what was not measured are no numbers, and do not count.
            largest = largest.max((cell[one] - cell[other]).abs());
        }
    }
    largest
}

/// The coarsest level above full resolution whose `d` shows as at most so many pixels; `shows` tells how many a level's is with a largest step.
fn coarsest(finest: &Arc<NodeSamples>, shows: impl Fn(u8, f64) -> f64, most: f64) -> Option<(u8, Arc<NodeSamples>)> {
    // Beyond what the diagonal alone allows no level is made. Steps between means may be smaller than those below.
    let levels = (1..).take_while(|level| shows(*level, 0.0) <= most).zip(pyramid(Arc::clone(finest)).skip(1));
    levels.filter(|(level, samples)| shows(*level, largest_step(samples)) <= most).last()
}

/// Draws a flat picture of a surface from pyramids of means. It does not depend on the number of threads. Of options holes, walls and labels are
/// left out, and there is no error to tell.
pub(super) fn draw(
    source: &dyn SurfaceNodes,
    placed: &Placed,
    view: &View,
    options: &SurfaceOptions,
) -> SurfacePicture {
    let field = Field { source, placed, options };
    let mut picture = SurfacePicture::default();
    if let Some(look) = &options.look {
        let parts = parts(options.samples);
        let fine = view.resized(view.width.saturating_mul(parts), view.height.saturating_mul(parts));
        let colored = |drawn: &Drawn<'_>| drawn.colored(source, options, look, parts);
        let (nearest, report) = field.draw(&fine, parts, [0.0; 4], &colored);
        let (rgba, depth) = nearest.pixels(view, parts);
        let covered = rgba.iter().map(|color| f64::from(color[3])).sum();
        picture.report = SurfaceReport { covered, ..report };
        picture.colors = Colors { width: view.width, height: view.height, rgba };
        darken(&mut picture.colors, &depth, (source, placed, &Sight::Flat(*view)), options);
        picture.depth = depth;
    }
    if options.raw {
        let (nearest, report) = field.draw(view, 1, NOTHING, &|drawn: &Drawn<'_>| drawn.channels());
        picture.add_channels(nearest.values, report);
    }
    picture
}

/// What samples of a picture show, each with its number and depth.
type Values<T> = Vec<(usize, f32, T)>;

/// A field that is drawn.
struct Field<'a> {
    source: &'a dyn SurfaceNodes,
    placed: &'a Placed,
    options: &'a SurfaceOptions,
}

/// A leaf that may be seen.
struct Leaf {
    key: ChunkKey,
    facts: NodeFacts,
    extent: Extent,
}

/// What is nearest in each sample of a picture, row by row.
struct Nearest<T> {
    /// Infinite where nothing is.
    depths: Vec<f32>,
    values: Vec<T>,
}

impl Field<'_> {
    /// Draws a view, whose pixels are the samples of the picture, so many along a pixel's side; `values` tells what samples show of a chunk.
    fn draw<T: Copy + Send + Sync>(
        &self,
        view: &View,
        parts: u32,
        nothing: T,
        values: &(impl Fn(&Drawn<'_>) -> Values<T> + Sync),
    ) -> (Nearest<T>, SurfaceReport) {
        let sides = [self.options.technique.side(self.options.point, parts), parts];
        let count = view.width as usize * view.height as usize;
        let mut nearest = Nearest { depths: vec![f32::INFINITY; count], values: vec![nothing; count] };
        let mut report = NO_BOUND;
        for leaves in self.leaves(view, sides).chunks(TOGETHER) {
            let each = |leaf: &Leaf| self.draw_leaf(leaf, view, sides, &nearest.depths, values);
            let drawn: Vec<(Values<T>, SurfaceReport)> = leaves.par_iter().map(each).collect();
            for (found, own) in drawn {
                report.add(&own);
                for (index, depth, value) in found {
                    if depth < nearest.depths[index] {
                        (nearest.depths[index], nearest.values[index]) = (depth, value);
                    }
                }
            }
        }
        (nearest, report)
    }

    /// The leaves of which something may be seen, the nearest first.
    fn leaves(&self, view: &View, sides: [u32; 2]) -> Vec<Leaf> {
        let lattice = self.source.lattice();
        let padded = view.padded(sides[0].max(sides[1]) + BESIDE as u32);
        let (mut waiting, mut found) = (vec![lattice.root()], Vec::new());
        while let Some(key) = waiting.pop() {
            let Some(facts) = self.source.facts(key).filter(|facts| !facts.is_empty()) else { continue };
            let ends = lattice.rectangle(key).map(|ends| ends.map(|end| end as f64));
            let extent = extent_of(self.placed, ends, [facts.min, facts.max], (1_u64 << key.level) as f64);
            if !padded.sees(&extent) || !view.cut.reaches(&extent.bounds) {
                continue;
            }
            match key.level {
                0 => found.push(Leaf { key, facts, extent }),
                _ => waiting.extend(lattice.children(key)),
            }
        }
        let away = |leaf: &Leaf| {
            let Bounds { min, max } = leaf.extent.bounds;
            (min - view.eye).max(view.eye - max).max(DVec3::ZERO).length_squared()
        };
        found.sort_by(|a, b| away(a).total_cmp(&away(b)).then_with(|| a.key.cmp(&b.key)));
        found
    }

    /// The level of a leaf that is drawn, and as what.
    fn chosen(
        &self,
        leaf: &Leaf,
        view: &View,
        finest: Arc<NodeSamples>,
        side: u32,
    ) -> (u8, Primitive, Arc<NodeSamples>) {
        let most = POINT_LIMIT * f64::from(side);
        let shows = |level: u8, step: f64| view.error_pixels(&leaf.extent, self.placed.apart(level, step));
        let is_dense = shows(0, leaf.facts.step) <= most;
        let primitive = match self.options.technique {
            Technique::Points => Primitive::Points,
            Technique::Hybrid if is_dense => Primitive::Points,
            _ => Primitive::Triangles,
        };
        let may_be_coarse = is_dense && primitive == Primitive::Points;
        let coarse = if may_be_coarse { coarsest(&finest, shows, most) } else { None };
        let (level, samples) = coarse.unwrap_or((0, finest));
        (level, primitive, samples)
    }

    /// What samples of a picture show of a leaf, unless something is nearer there, and what was drawn.
    fn draw_leaf<T>(
        &self,
        leaf: &Leaf,
        view: &View,
        sides: [u32; 2],
        depths: &[f32],
        values: &impl Fn(&Drawn<'_>) -> Values<T>,
    ) -> (Values<T>, SurfaceReport) {
        let [columns, rows] = window_of(view, &leaf.extent, f64::from(sides[0].max(sides[1])) + BESIDE);
        if columns.is_empty() || rows.is_empty() {
            return (Vec::new(), NO_BOUND);
        }
        let Some(finest) = self.source.samples(leaf.key) else {
            return (Vec::new(), SurfaceReport { is_converged: false, ..NO_BOUND });
        };
        let (level, primitive, samples) = self.chosen(leaf, view, finest, sides[0]);
        let lattice = self.source.lattice();
        let whole = (1_u64 << level) as f64;
        // The middle of those that the first sample is the mean of.
        let first = [0, 1].map(|axis| lattice.span(leaf.key, axis).0 as f64 + 0.5 * (whole - 1.0));
        let placed = self.placed.thinned(first, whole, [samples.rows, samples.columns]);
        let alone = Alone { facts: leaf.facts, samples };
        let (key, facts, extent) = (alone.lattice().root(), leaf.facts, leaf.extent);
        let node = CutNode { key, facts, extent, primitive, error_px: f64::INFINITY, added: 0.0 };
        let scene = Scene::new(&alone, &placed, SurfaceCut::new(vec![node]));
        let part = view.part([columns.start as f64, rows.start as f64], columns.len() as u32, rows.len() as u32);
        let seen = Visibility::new([part.width, part.height]);
        let [samples_drawn, points, triangles] = raster::draw(&scene, &part, &seen, sides);
        let corner = [columns.start, rows.start];
        let (sight, width) = (Sight::Flat(part), view.width as usize);
        let drawn = Drawn { placed: self.placed, scene, sight, seen, level, first, whole, corner, width, depths };
        let (nodes_drawn, levels) = (1, [level; 2]);
        (values(&drawn), SurfaceReport { samples_drawn, points, triangles, nodes_drawn, levels, ..NO_BOUND })
    }
}

/// What is told of a picture of nothing: how far what is drawn may be from where it is is not known.
const NO_BOUND: SurfaceReport = SurfaceReport {
    error_px: f64::INFINITY,
    is_converged: true,
    is_coarser: false,
    samples_drawn: 0,
    points: 0,
    triangles: 0,
    nodes_drawn: 0,
    levels: [0; 2],
    covered: 0.0,
};

/// The columns and rows of a picture in which a box may be seen, with so many pixels about it.
fn window_of(view: &View, extent: &Extent, beside: f64) -> [Range<usize>; 2] {
    let size = [view.width, view.height].map(|size| size as usize);
    let Bounds { min, max } = extent.bounds;
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in 0..8_usize {
        let end = |axis: usize| if (corner >> axis) & 1 == 0 { min[axis] } else { max[axis] };
        let camera = view.to_camera(DVec3::new(end(0), end(1), end(2)));
        // What reaches behind the eye may be anywhere.
        let Some(place) = view.to_pixels(camera) else { return size.map(|size| 0..size) };
        low = [0, 1].map(|axis| low[axis].min(place[axis]));
        high = [0, 1].map(|axis| high[axis].max(place[axis]));
    }
    [0, 1].map(|axis| {
        let [first, end] = [(low[axis] - beside).floor(), (high[axis] + beside).ceil()];
        let [first, end] = [first, end].map(|at| (at.max(0.0) as usize).min(size[axis]));
        first..end
    })
}

/// A level of a leaf as a field of its own.
struct Alone {
    facts: NodeFacts,
    samples: Arc<NodeSamples>,
}

impl SurfaceNodes for Alone {
    fn lattice(&self) -> Lattice {
        Lattice::new(self.samples.rows as u64, self.samples.columns as u64)
    }

    fn facts(&self, _: ChunkKey) -> Option<NodeFacts> {
        Some(self.facts)
    }

    fn samples(&self, _: ChunkKey) -> Option<Arc<NodeSamples>> {
        Some(Arc::clone(&self.samples))
    }
}

/// A leaf in the part of a picture in which it may be seen.
struct Drawn<'a> {
    /// The field in the world.
    placed: &'a Placed,
    /// Its level, as a field of its own.
    scene: Scene,
    /// Who looks at that part.
    sight: Sight,
    /// What that part shows of it.
    seen: Visibility,
    /// The level of its pyramid.
    level: u8,
    /// Row and column of the level's first sample in the field, and how many of these it is from one to the next.
    first: [f64; 2],
    whole: f64,
    /// The part's first column and row in the picture, how many samples of the picture are in a row, and how deep what is nearest there is.
    corner: [usize; 2],
    width: usize,
    depths: &'a [f32],
}

impl Drawn<'_> {
    /// What is seen at a place of the picture: of a point its sample, opaque, wherever in its square that is.
    fn hit(&self, resolver: &Resolver<'_>, shown: Shown, place: [f64; 2]) -> Option<Hit> {
        if shown.slot.is_some() {
            return resolver.hit(shown, place);
        }
        let mesh = self.scene.meshes.get(shown.node)?;
        let [row, column] = shown.at;
        let index = row * mesh.samples.columns + column;
        let height = mesh.height(index);
        let (_, depth) = resolver.project(resolver.vantage.relative(mesh.rows[row], mesh.columns[column], height))?;
        // Normals on a globe are as in the middle of the field, and not of the leaf.
        let slope = self.placed.slope(mesh.samples.normals.at(index)).map(|slope| slope * self.whole);
        let (row, column) = (row as f64, column as f64);
        let (coverage, is_membrane, is_pole, under) = (1.0, false, false, [row, column, height]);
        Some(Hit { shown, depth, row, column, height, coverage, is_membrane, is_pole, slope, under })
    }

    /// What samples of the picture show of the leaf, where nothing is nearer.
    fn each<T: Send>(&self, resolver: &Resolver<'_>, value: impl Fn(&Hit, [f64; 2]) -> Option<T> + Sync) -> Values<T> {
        let sample = |x: usize, y: usize| {
            let shown = self.seen.at(y * self.seen.width + x)?;
            let place = [x as f64 + 0.5, y as f64 + 0.5];
            let hit = self.hit(resolver, shown, place)?;
            let (index, depth) = ((self.corner[1] + y) * self.width + self.corner[0] + x, hit.depth as f32);
            if depth < self.depths[index] { Some((index, depth, value(&hit, place)?)) } else { None }
        };
        let row = |y: usize| (0..self.seen.width).filter_map(|x| sample(x, y)).collect::<Values<T>>();
        (0..self.seen.height).into_par_iter().flat_map_iter(row).collect()
    }

    /// Colours in linear light, premultiplied with alpha, of a picture with so many samples along a pixel's side.
    fn colored(
        &self,
        source: &dyn SurfaceNodes,
        options: &SurfaceOptions,
        look: &Look,
        parts: u32,
    ) -> Values<[f32; 4]> {
        let tiles = source.photo().filter(|_| look.attribute == Attribute::Photo);
        let tiles = tiles.map(|tiles| PhotoOver { tiles, first: self.first, whole: self.whole });
        let photo = tiles.as_ref().and_then(|tiles| PhotoLook::new(tiles, &self.scene.placed));
        let shader = Shader::new(&self.scene, &self.sight, look, photo, parts);
        let shader = shader.seeing(&self.seen).without(options.form.as_deref()).coarser_by(self.level);
        self.each(shader.resolver(), |hit, place| shader.sample(Some(hit), place).map(|(color, ..)| color))
    }

    /// Raw channels; rows and columns are the field's.
    fn channels(&self) -> Values<[f64; CHANNELS]> {
        self.each(&Resolver::new(&self.scene, &self.sight), |hit, _| {
            let [depth, x, y, height, row, column, coverage] = hit.raw(&self.scene);
            let [row, column] = [(0, row), (1, column)].map(|(axis, at)| at.mul_add(self.whole, self.first[axis]));
            Some([depth, x, y, height, row, column, coverage])
        })
    }
}

impl Nearest<[f32; 4]> {
    /// Colours of pixels, and their depths, infinite where a sample of one shows nothing.
    fn pixels(&self, view: &View, parts: u32) -> (Vec<[f32; 4]>, Vec<f32>) {
        let (width, side) = (view.width as usize, parts as usize);
        let pixel = |index: usize| {
            let [left, top] = [index % width, index / width].map(|at| at * side);
            let (mut color, mut depth) = ([0.0_f32; 4], 0.0_f32);
            for sample in (top..top + side).flat_map(|y| (left..left + side).map(move |x| y * width * side + x)) {
                (0..4).for_each(|k| color[k] += self.values[sample][k]);
                depth = depth.max(self.depths[sample]);
            }
            (color.map(|sum| sum / (side * side) as f32), depth)
        };
        (0..width * view.height as usize).into_par_iter().map(pixel).unzip()
    }
}

/// A photo over a field, counted in rows and columns of a level of one of its leaves.
struct PhotoOver<'a> {
    tiles: &'a dyn PhotoTiles,
    first: [f64; 2],
    whole: f64,
}

impl PhotoTiles for PhotoOver<'_> {
    fn laid(&self) -> Option<Laid> {
        let Laid { lattice, place, period } = self.tiles.laid()?;
        let ends = |axis: usize, ends: [f64; 2]| ends.map(|end| (end - self.first[axis]) / self.whole);
        let place = PhotoPlace { rows: ends(0, place.rows), columns: ends(1, place.columns) };
        Some(Laid { lattice, place, period: period.map(|period| period / self.whole) })
    }

    fn tile(&self, key: TileKey) -> Option<Arc<Tile>> {
        self.tiles.tile(key)
    }
}

#[cfg(test)]
mod tests;
