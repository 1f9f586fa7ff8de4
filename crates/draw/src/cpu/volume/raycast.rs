//! Ray casting through the slabs, front to back (F12 5.6): emission and absorption with post-classification, isosurfaces, or
//! both.
//!
//! A sample stands for its whole cell along the ray: the opacity of one unit length becomes that of the distance through the
//! cell (F12 3.5.3). A surface that is crossed within a step divides the cells on both sides of it. What a ray has gathered
//! is carried from slab to slab, so that slabs change nothing.

use super::Fill;
use super::block::{BEFORE, Block, FRONT, Numbers, Place, SIDE};
use super::bricks::{BORDER, BRICK, BrickGrid, Slab};
use super::classify::Classifier;
use super::parts::Parts;
use super::smoothing::{Face, cosine};
use super::surface::{Crossings, Light, Surface, gradient};
use crate::cpu::paths::fragments::TileFragments;
use crate::cpu::paths::{PathFragment, PathFragments};
use crate::cpu::shadowing::COVERS;
use crate::view::PerspectiveGrid;
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

/// Some steps of the rays of a tile, within one block.
struct March<'a> {
    grid: &'a PerspectiveGrid,
    brick_grid: &'a BrickGrid,
    block: &'a Block,
    layer: usize,
    steps: std::ops::Range<usize>,
    scenery: &'a Scenery,
    /// Numbers up to this show nothing.
    least: f32,
    /// What the grid is filled from.
    source: &'a dyn Fill,
    places: &'a [Vec<(usize, f32)>; 2],
    paths: Option<&'a PathFragments>,
}

/// Where a ray passes a block.
struct Way<'a> {
    place: &'a Place,
    /// The same in the grid, cells.
    at: [f64; 2],
    /// How much longer it is than the middle one.
    secant: f32,
}

impl March<'_> {
    fn tile(&self, [column, row]: [usize; 2], tile: &mut Tile, effort: &mut Effort) {
        let mut rays = tile.rays.iter_mut().enumerate();
        for y in tile.rows[0]..tile.rows[1] {
            let (cell_y, share_y) = self.places[1][y];
            for x in tile.columns[0]..tile.columns[1] {
                let Some((index, ray)) = rays.next() else { return };
                if ray.alpha >= self.scenery.termination {
                    continue;
                }
                let (cell_x, share_x) = self.places[0][x];
                let place = Place {
                    x: cell_x - column * BRICK + BEFORE,
                    y: cell_y - row * BRICK + BEFORE,
                    shares: [share_x, share_y],
                };
                let grid_place = [(x as f64 + 0.5) / self.grid.cell, (y as f64 + 0.5) / self.grid.cell];
                let fragments = self.paths.map_or(&[][..], |paths| paths.of(x, y));
                let parts = tile.parts.as_mut().map(|parts| (parts, index));
                let way = Way { place: &place, at: grid_place, secant: self.grid.secant(grid_place) as f32 };
                self.ray(ray, &way, (fragments, parts), tile.faces.get_mut(index), effort);
            }
        }
    }

    /// The block's slice for a slice of the grid.
    #[inline]
    fn local(&self, slice: usize) -> usize {
        slice + FRONT - self.layer * BRICK
    }

    #[inline]
    fn ray(
        &self,
        ray: &mut Ray,
        way: &Way<'_>,
        (fragments, mut parts): (&[PathFragment], Option<(&mut Parts, usize)>),
        mut face: Option<&mut Face>,
        effort: &mut Effort,
    ) {
        let slices = self.brick_grid.slices;
        let (place, least) = (way.place, self.least);
        let [is_apart, ends] = [self.source.has_surface_field(), self.source.has_holes()[1]];
        let mut before = match self.steps.start {
            0 => [0.0; 2],
            step => self.block.sample(place, self.local(step - 1)),
        };
        for step in self.steps.clone() {
            let now = if step < slices { self.block.sample(place, self.local(step)) } else { [0.0; 2] };
            let is_empty = step == 0 || (!is_apart && before[0] <= least && now[0] <= least);
            // The way of a step is from half a slice before it to half a slice behind.
            let meets = ray.until < step as f32 + 0.5;
            if is_empty && !meets {
                ray.done = 0.0;
                before = now;
                continue;
            }
            let crossings = if !is_empty && step < slices && !self.scenery.surfaces.is_empty() {
                let z = self.local(step);
                let around = [z - 2, z - 1, z, (z + 1).min(SIDE - 1)];
                let samples = match ends {
                    true => self.known_around(place, around),
                    false => Some(around.map(|z| self.block.number(Numbers::Surfaces, place, z))),
                };
                samples.map(|samples| Crossings::find(samples, &self.scenery.surfaces))
            } else {
                None
            };
            let mut next_done = 0.0;
            let found = crossings.filter(|crossings| !crossings.is_empty());
            if meets || found.is_some() {
                // Surfaces and paths, in the order in which they are met.
                let mut surfaces = found.iter().flat_map(Crossings::iter).peekable();
                loop {
                    let path = (ray.until - (step as f32 - 0.5)).max(0.0);
                    let surface = surfaces.peek().map_or(f32::INFINITY, |crossing| crossing.at);
                    let event = path.min(surface);
                    if event > 1.0 || (path >= 1.0 && surface == f32::INFINITY) {
                        break;
                    }
                    let until = (0.5 + event).min(1.0);
                    if step > 0 && until > ray.done {
                        self.through(ray, way, step - 1, before, until - ray.done, effort);
                    }
                    ray.done = ray.done.max(until);
                    let beyond = (event - 0.5).max(0.0);
                    if beyond > next_done {
                        self.through(ray, way, step, now, beyond - next_done, effort);
                        next_done = beyond;
                    }
                    if path < 1.0 && path <= surface {
                        ray.meet_next(self.grid, fragments);
                    } else if let Some(crossing) = surfaces.next() {
                        effort.crossings += 1;
                        let mut note = |ray: &Ray| {
                            if let Some((parts, index)) = &mut parts {
                                let depth = self.grid.depth(step as f64 - 0.5 + f64::from(crossing.at));
                                parts.note(*index, ray, depth as f32);
                                parts.end(*index, ray);
                            }
                        };
                        note(ray);
                        let face = face.as_deref_mut();
                        self.surface(ray, way, (step, crossing.at), crossing.surface, [before, now], face);
                        note(ray);
                    }
                }
            }
            if step > 0 {
                self.through(ray, way, step - 1, before, 1.0 - ray.done, effort);
            }
            ray.done = next_done;
            if let Some((parts, index)) = &mut parts {
                parts.note(*index, ray, self.grid.depth(step as f64 - 0.5) as f32);
            }
            if ray.alpha >= self.scenery.termination {
                ray.end = step as u32;
                return;
            }
            before = now;
        }
    }

    /// The surfaces' numbers at four slices; `None` where one of those in the middle is nothing, and the nearest that there is in place of one
    /// further away that is.
    fn known_around(&self, place: &Place, slices: [usize; 4]) -> Option<[f32; 4]> {
        let [first, from, to, last] = slices.map(|z| self.block.known(Numbers::Surfaces, place, z));
        let (from, to) = from.zip(to)?;
        Some([first.unwrap_or(from), from, to, last.unwrap_or(to)])
    }

    /// Passes a share of a cell.
    #[inline]
    fn through(
        &self,
        ray: &mut Ray,
        way: &Way<'_>,
        slice: usize,
        [density, weighted]: [f32; 2],
        share: f32,
        effort: &mut Effort,
    ) {
        if !self.scenery.volume || density <= self.scenery.classifier.least() || share <= 0.0 {
            return;
        }
        effort.samples += 1;
        let matter = self.scenery.classifier.matter(density, weighted);
        let extinction = matter.extinction * self.block.opacity(way.place, self.local(slice));
        let distance = self.brick_grid.thickness[slice] * way.secant * share;
        let mut color = matter.color;
        if let Some(light) = self.scenery.volume_light.as_ref().filter(|_| extinction > 0.0) {
            // The slice is where the step behind it begins, or where the last one ends.
            let at = if slice + 1 < self.brick_grid.slices { (slice + 1, 0.0) } else { (slice, 1.0) };
            color = light.shade(color, self.cosine(Numbers::Volume, way, at, density));
        }
        ray.under(color, 1.0 - (-extinction * distance).exp());
    }

    /// The cosine between a ray and the gradient of numbers at a share of a step, where one is `number`; 1 where they are all alike.
    fn cosine(&self, of: Numbers, way: &Way<'_>, at: (usize, f32), number: f32) -> f32 {
        let [slope, line] = self.slope(of, way, at, number);
        cosine(slope, line)
    }

    /// That gradient, and the way of the ray to depth 1, both in camera axes.
    fn slope(&self, of: Numbers, way: &Way<'_>, (step, share): (usize, f32), number: f32) -> [[f32; 3]; 2] {
        let Way { place, at, .. } = *way;
        let middle = [0, 1].map(|axis| (at[axis] - self.grid.middle[axis]) as f32);
        let z = self.local(step);
        // Where a field ends or is cut the cells alone say which way it faces: what is outside is 0. So they do within a volume.
        let is_within =
            of == Numbers::Surfaces && self.block.least(of, place, z - 1).min(self.block.least(of, place, z)) > 0.0;
        let slope = if is_within { self.source.slope(at, step, share, number) } else { None };
        let slope = slope.unwrap_or_else(|| gradient((self.block, of), self.brick_grid, place, middle, step, z, share));
        let line = match self.grid.perspective {
            true => [middle[0] * self.grid.sigma as f32, -middle[1] * self.grid.sigma as f32, 1.0],
            false => [0.0, 0.0, 1.0],
        };
        [slope, line]
    }

    /// Meets a surface.
    fn surface(
        &self,
        ray: &mut Ray,
        way: &Way<'_>,
        (step, share): (usize, f32),
        surface: usize,
        [before, now]: [[f32; 2]; 2],
        face: Option<&mut Face>,
    ) {
        let surface = &self.scenery.surfaces[surface];
        let mut color = surface.color.unwrap_or_else(|| {
            let [density, weighted] = [0, 1].map(|k| before[k] + share * (now[k] - before[k]));
            self.scenery.classifier.tinted(weighted / density, SURFACE_BRIGHTNESS)
        });
        if let Some(light) = &self.scenery.light {
            let [slope, line] = self.slope(Numbers::Surfaces, way, (step, share), surface.value);
            if let Some(face) = face {
                let depth = self.grid.depth(step as f64 - 0.5 + f64::from(share)) as f32;
                face.offer(Face { depth, slope, line, color, share: (1.0 - ray.alpha) * surface.opacity });
            }
            color = light.shade(color, cosine(slope, line));
        }
        ray.under(color, surface.opacity);
    }
}
