//! Steps of rays through a block: what they pass, and the surfaces and paths that they meet in order.

use super::super::Fill;
use super::super::block::{BEFORE, Block, FRONT, Numbers, Place, SIDE};
use super::super::bricks::{BRICK, BrickGrid};
use super::super::parts::Parts;
use super::super::smoothing::{Face, cosine};
use super::super::surface::{Crossings, gradient};
use super::{Effort, Ray, SURFACE_BRIGHTNESS, Scenery, Tile};
use crate::cpu::paths::{PathFragment, PathFragments};
use crate::view::PerspectiveGrid;

/// Some steps of the rays of a tile, within one block.
pub(super) struct March<'a> {
    pub grid: &'a PerspectiveGrid,
    pub brick_grid: &'a BrickGrid,
    pub block: &'a Block,
    pub layer: usize,
    pub steps: std::ops::Range<usize>,
    pub scenery: &'a Scenery,
    /// Numbers up to this show nothing.
    pub least: f32,
    /// What the grid is filled from.
    pub source: &'a dyn Fill,
    pub places: &'a [Vec<(usize, f32)>; 2],
    pub paths: Option<&'a PathFragments>,
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
    /// Draws them.
    pub fn tile(&self, [column, row]: [usize; 2], tile: &mut Tile, effort: &mut Effort) {
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
