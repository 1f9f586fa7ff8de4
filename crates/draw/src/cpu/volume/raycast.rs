//! Ray casting through the slabs, front to back (F12 5.6): emission and absorption with post-classification, isosurfaces, or
//! both.
//!
//! A sample stands for its whole cell along the ray: the opacity of one unit length becomes that of the distance through the
//! cell (F12 3.5.3). A surface that is crossed within a step divides the cells on both sides of it. What a ray has gathered
//! is carried from slab to slab, so that slabs change nothing.

mod march;

use super::Fill;
use super::block::Block;
use super::bricks::{BORDER, BRICK, BrickGrid, Slab};
use super::classify::Classifier;
use super::parts::Parts;
use super::smoothing::Face;
use super::surface::{Light, Surface};
use crate::cpu::paths::fragments::TileFragments;
use crate::cpu::paths::{PathFragment, PathFragments};
use crate::cpu::shadowing::COVERS;
use crate::view::PerspectiveGrid;
use march::March;
use rayon::prelude::*;

/// Brightness of a surface whose hue follows an attribute.
pub const SURFACE_BRIGHTNESS: f32 = 0.72;

/// What is drawn of the field.
#[derive(Clone, Debug)]
pub struct Scenery {
    /// Colours of attributes on surfaces; and what the volume emits and absorbs, if `volume`.
    pub classifier: Classifier,
    /// Whether the volume itself is drawn.
    pub volume: bool,
    /// The isosurfaces.
    pub surfaces: Vec<Surface>,
    /// How surfaces are lit; plain colours without.
    pub light: Option<Light>,
    /// How the volume itself is lit, by the gradients of its values; plain colours without.
    pub volume_light: Option<Light>,
    /// Rays that are as opaque end.
    pub termination: f32,
}

impl Scenery {
    /// What of it hides light: of surfaces without a volume those that cover, at the first of which rays end; `None` where there are none. What
    /// only looks is left out.
    pub fn casting(&self) -> Option<Scenery> {
        let mut casting = Scenery { light: None, volume_light: None, ..self.clone() };
        if !self.volume {
            casting.surfaces.retain(|surface| surface.opacity >= COVERS);
            casting.termination = casting.termination.min(COVERS);
        }
        (self.volume || !casting.surfaces.is_empty()).then_some(casting)
    }

    /// Densities up to this show nothing.
    pub fn least(&self) -> f32 {
        let volume = if self.volume { self.classifier.least() } else { f32::INFINITY };
        // A surface lies where its value is reached.
        self.surfaces.iter().map(|surface| surface.value * (1.0 - 1e-6)).fold(volume, f32::min)
    }
}

/// A pixel's ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ray {
    /// Light gathered, linear, premultiplied.
    pub color: [f32; 3],
    /// Opacity gathered.
    pub alpha: f32,
    /// Share of the present cell that has been drawn.
    done: f32,
    /// The step, or the layer, in which it ended.
    pub(in crate::cpu) end: u32,
    /// The next fragment of a path that it meets.
    pub(in crate::cpu) next: u32,
    /// Where in the grid that is, in slices; infinite without.
    until: f32,
}

impl Ray {
    /// What is behind, seen through what is here.
    #[inline]
    pub fn under(&mut self, color: [f32; 3], alpha: f32) {
        let share = (1.0 - self.alpha) * alpha;
        for (sum, color) in self.color.iter_mut().zip(color) {
            *sum += share * color;
        }
        self.alpha += share;
    }

    /// Meets the fragments of paths, of those of its pixel, that are in front of a depth.
    #[inline]
    pub(in crate::cpu) fn meet(&mut self, fragments: &[PathFragment], depth: f32) {
        while let Some(fragment) = fragments.get(self.next as usize).filter(|fragment| fragment.depth < depth) {
            self.under(fragment.color, fragment.alpha);
            self.next += 1;
        }
    }

    /// Meets all fragments that are left.
    pub(in crate::cpu) fn meet_rest(&mut self, fragments: &[PathFragment], termination: f32) {
        if self.alpha < termination && (self.next as usize) < fragments.len() {
            self.meet(fragments, f32::INFINITY);
            // Nothing was hidden from it.
            self.end = u32::MAX - 1;
        }
    }
}

/// The rays through one column of bricks.
#[derive(Clone, Debug)]
pub struct Tile {
    /// First and last-but-one pixel column.
    pub columns: [usize; 2],
    /// First and last-but-one pixel row.
    pub rows: [usize; 2],
    /// The rays, row by row.
    pub rays: Vec<Ray>,
    /// What they have gathered in parts, where that is kept.
    parts: Option<Parts>,
    /// The surface that adds most to each, where that is kept.
    pub(super) faces: Vec<Face>,
}

impl Tile {
    /// The parts that have ended, with the indices of their rays.
    fn ended(&self) -> &[(u32, PathFragment)] {
        self.parts.as_ref().map_or(&[], Parts::ended)
    }

    /// Hands each ray to `with`, with the fragments of paths in its pixel.
    fn each(&mut self, paths: &PathFragments, mut with: impl FnMut(&mut Ray, &[PathFragment])) {
        let width = (self.columns[1] - self.columns[0]).max(1);
        for (y, rays) in (self.rows[0]..self.rows[1]).zip(self.rays.chunks_mut(width)) {
            for (x, ray) in (self.columns[0]..self.columns[1]).zip(rays) {
                with(ray, paths.of(x, y));
            }
        }
    }

    /// Passes steps in which there is nothing but paths.
    fn pass(&mut self, grid: &PerspectiveGrid, paths: &PathFragments, end: usize, termination: f32) {
        let until = end as f32 - 0.5;
        if self.rays.iter().all(|ray| ray.until >= until) {
            return;
        }
        self.each(paths, |ray, fragments| {
            while ray.until < until && ray.alpha < termination {
                ray.meet_next(grid, fragments);
                ray.end = end.saturating_sub(1) as u32;
            }
        });
    }
}

impl Ray {
    /// Meets the next fragment.
    #[inline]
    fn meet_next(&mut self, grid: &PerspectiveGrid, fragments: &[PathFragment]) {
        if let Some(fragment) = fragments.get(self.next as usize) {
            self.under(fragment.color, fragment.alpha);
        }
        self.next += 1;
        self.until = slice_of(grid, fragments.get(self.next as usize));
    }
}

/// Where in the grid a fragment lies, in slices.
fn slice_of(grid: &PerspectiveGrid, fragment: Option<&PathFragment>) -> f32 {
    let Some(fragment) = fragment else { return f32::INFINITY };
    let slice = grid.slice(f64::from(fragment.depth)) as f32;
    // What is in front of every plane comes first.
    if slice.is_nan() { -1.0 } else { slice }
}

/// Work done by rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Samples that were visible.
    pub samples: u64,
    /// Crossings of surfaces.
    pub crossings: u64,
}

/// All rays of a picture.
#[derive(Clone, Debug)]
pub struct Rays {
    /// One tile for each column of bricks, row by row.
    pub tiles: Vec<Tile>,
    width: usize,
    height: usize,
    /// For each pixel column and row the stored cell in front of it, and the share of the way to the next.
    places: [Vec<(usize, f32)>; 2],
}

impl Rays {
    /// The rays of a picture before anything is drawn.
    pub fn new(grid: &PerspectiveGrid, brick_grid: &BrickGrid, width: u32, height: u32) -> Rays {
        let places = [width, height].map(|size| places(grid, size));
        let ranges = |axis: usize| -> Vec<[usize; 2]> {
            let from = |brick: usize| places[axis].partition_point(|(cell, _)| *cell < brick * BRICK);
            (0..brick_grid.bricks[axis]).map(|brick| [from(brick), from(brick + 1)]).collect()
        };
        let (columns, rows) = (ranges(0), ranges(1));
        let tiles = rows.iter().flat_map(|&rows| {
            columns.iter().map(move |&columns| Tile {
                columns,
                rows,
                rays: vec![
                    Ray { until: f32::INFINITY, ..Ray::default() };
                    (columns[1] - columns[0]) * (rows[1] - rows[0])
                ],
                parts: None,
                faces: Vec::new(),
            })
        });
        Rays { tiles: tiles.collect(), width: width as usize, height: height as usize, places }
    }

    /// The same that keep in parts what they gather.
    #[must_use]
    pub fn in_parts(mut self) -> Rays {
        self.tiles.iter_mut().for_each(|tile| tile.parts = Some(Parts::new(tile.rays.len())));
        self
    }

    /// Memory that they take.
    pub fn bytes(&self) -> u64 {
        let faces: usize = self.tiles.iter().map(|tile| tile.faces.len()).sum();
        (self.width * self.height * size_of::<Ray>() + faces * size_of::<Face>()) as u64
    }

    /// Finds the first fragment of a path that each meets.
    pub fn look_for(&mut self, grid: &PerspectiveGrid, paths: &PathFragments) {
        let look = |ray: &mut Ray, fragments: &[PathFragment]| ray.until = slice_of(grid, fragments.first());
        self.tiles.par_iter_mut().for_each(|tile| tile.each(paths, |ray, fragments| look(ray, fragments)));
    }

    /// Meets what there is of paths behind the grid.
    pub fn meet_rest(&mut self, paths: &PathFragments, termination: f32) {
        let meet = |tile: &mut Tile| tile.each(paths, |ray, fragments| ray.meet_rest(fragments, termination));
        self.tiles.par_iter_mut().for_each(meet);
    }

    /// Draws the steps of one slab, and the paths in them.
    pub fn advance(
        &mut self,
        grid: &PerspectiveGrid,
        brick_grid: &BrickGrid,
        slab: &Slab,
        steps: std::ops::Range<u32>,
        scenery: &Scenery,
        source: &dyn Fill,
        paths: Option<&PathFragments>,
    ) -> Effort {
        let Rays { tiles, places, .. } = self;
        let steps = steps.start as usize..steps.end as usize;
        // Numbers of two fields have no bound in common.
        let least = if source.has_surface_field() { 0.0 } else { scenery.least() };
        let work = |(index, tile): (usize, &mut Tile)| {
            let at = [index % brick_grid.bricks[0], index / brick_grid.bricks[0]];
            let mut effort = Effort::default();
            if tile.rays.iter().all(|ray| ray.alpha >= scenery.termination) {
                return effort;
            }
            let mut block = Block::of(source);
            let mut step = steps.start;
            while step < steps.end {
                // The layer of the slice after the step, for a gradient's sake; the last layer's steps go to the end.
                let layer = ((step + 1) / BRICK).min(brick_grid.bricks[2] - 1);
                let end = if layer + 1 == brick_grid.bricks[2] {
                    steps.end
                } else {
                    ((layer + 1) * BRICK - 1).min(steps.end)
                };
                if block.fill(slab, brick_grid, [at[0], at[1], layer], least) {
                    let steps = step..end;
                    let block = &block;
                    let march = March { grid, brick_grid, block, layer, steps, scenery, least, source, places, paths };
                    march.tile(at, tile, &mut effort);
                } else {
                    tile.rays.iter_mut().for_each(|ray| ray.done = 0.0);
                    if let Some(paths) = paths {
                        tile.pass(grid, paths, end, scenery.termination);
                    }
                }
                step = end;
            }
            effort
        };
        let efforts: Vec<Effort> = tiles.par_iter_mut().enumerate().map(work).collect();
        efforts.iter().fold(Effort::default(), |sum, effort| Effort {
            samples: sum.samples + effort.samples,
            crossings: sum.crossings + effort.crossings,
        })
    }

    /// For each pixel, row by row, something of its ray.
    pub fn picture<T: Copy + Default>(&self, of: impl Fn(&Ray) -> T) -> Vec<T> {
        let mut out = vec![T::default(); self.width * self.height];
        for tile in &self.tiles {
            let width = tile.columns[1] - tile.columns[0];
            for (row, rays) in (tile.rows[0]..tile.rows[1]).zip(tile.rays.chunks(width.max(1))) {
                let start = row * self.width + tile.columns[0];
                for (out, ray) in out[start..start + width].iter_mut().zip(rays) {
                    *out = of(ray);
                }
            }
        }
        out
    }

    /// The parts of what each ray has gathered, where they were kept; `is_hazy` as in [`PathFragments`].
    pub fn fragments(mut self, is_hazy: bool) -> PathFragments {
        for tile in &mut self.tiles {
            let Some(parts) = &mut tile.parts else { continue };
            tile.rays.iter().enumerate().for_each(|(index, ray)| parts.end(index, ray));
        }
        let pixel = |tile: &Tile, index: u32| {
            let across = (tile.columns[1] - tile.columns[0]).max(1);
            (tile.rows[0] + index as usize / across) * self.width + tile.columns[0] + index as usize % across
        };
        let ended = || {
            let of_tile = |tile| Tile::ended(tile).iter().map(move |(index, part)| (pixel(tile, *index), *part));
            self.tiles.iter().flat_map(of_tile)
        };
        let mut starts = vec![0u32; self.width * self.height + 1];
        ended().for_each(|(pixel, _)| starts[pixel + 1] += 1);
        (1..starts.len()).for_each(|pixel| starts[pixel] += starts[pixel - 1]);
        let (mut next, most) = (starts.clone(), starts.last().map_or(0, |all| *all as usize));
        let mut fragments = vec![PathFragment::default(); most];
        for (pixel, part) in ended() {
            fragments[next[pixel] as usize] = part;
            next[pixel] += 1;
        }
        let size = [self.width, self.height];
        PathFragments { size, side: size[0].max(size[1]), tiles: vec![TileFragments { starts, fragments }], is_hazy }
    }

    /// For each pixel, row by row, a depth behind which its ray has read nothing and will not; infinite for rays that go on.
    pub fn opaque_depths(&self, grid: &PerspectiveGrid, termination: f32) -> Vec<f32> {
        let depths = depths_behind(grid);
        let of = |ray: &Ray| depths.get(ray.end as usize).copied().filter(|_| ray.alpha >= termination);
        self.picture(|ray| of(ray).unwrap_or(f32::INFINITY))
    }

    /// Pixels, first and last, whose rays read cells of a brick's column (0) or row (1).
    pub fn readers(&self, brick: usize, axis: usize) -> [i64; 2] {
        readers(&self.places[axis], brick * BRICK..(brick + 1) * BRICK)
    }
}

/// For each step a depth behind which rays that end in it have read nothing: the next slice is read for gradients, and cells
/// have half their depth behind their centres.
pub fn depths_behind(grid: &PerspectiveGrid) -> Vec<f32> {
    (0..=grid.size[2]).map(|step| (grid.depth(f64::from(step) + 2.5) as f32).next_up()).collect()
}

/// For each of `pixels` columns or rows the stored cell before its rays, and the share of the way to the next.
pub fn places(grid: &PerspectiveGrid, pixels: u32) -> Vec<(usize, f32)> {
    let place = |pixel: u32| {
        let at = (f64::from(pixel) + 0.5) / grid.cell + BORDER as f64 - 0.5;
        // At full resolution pixels are cells; rounding must not make a thousandth of a cell of that.
        let at = if (at - at.round()).abs() < 1e-6 { at.round() } else { at };
        (at.floor() as usize, (at - at.floor()) as f32)
    };
    (0..pixels).map(place).collect()
}

/// Pixels, first and last, whose rays read stored cells of a range: those around them for interpolation and gradients
/// too.
pub fn readers(places: &[(usize, f32)], cells: std::ops::Range<usize>) -> [i64; 2] {
    let from = places.partition_point(|(cell, _)| cell + 2 < cells.start);
    let to = places.partition_point(|(cell, _)| *cell < cells.end + 1);
    [from as i64, to as i64 - 1]
}
