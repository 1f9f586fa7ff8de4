//! How the fast path divides its work: layers, their tiles, and particles sorted by tile.
//!
//! A layer is one level of the pyramid, or the picture itself for splats that are too small to be sampled. Each layer is
//! cut into square tiles. A splat belongs to the tile of its centre; the tile's buffer has a margin that holds what
//! reaches over, so that tiles are drawn independently and splats are drawn once.

use super::ellipse::Ellipse;
use super::ellipse_rows::TileEllipse;
use super::footprint::{Footprint, Lens, Shape};
use super::lanes::{Circle, SLACK, WIDEST};
use super::profile::Profiles;
use super::pyramid::{self, LevelImage, PADDING, SMALLEST_RADIUS};
use super::{Counts, SplatOptions, Splats, small};
use crate::view::View;
use rayon::prelude::*;
use std::ops::Range;

/// Cells along a tile's side.
pub const TILE: usize = 128;
/// Cells around a tile: more than the largest radius of a splat that is drawn in one tile.
pub const MARGIN: usize = 14;
/// Cells along the side of a tile's buffer.
pub const SIDE: usize = TILE + 2 * MARGIN;
/// Values in a row of a tile's buffer.
pub const STRIDE: usize = SIDE + SLACK;

const _: () = assert!(MARGIN as f32 > WIDEST + 1.0 && WIDEST as f64 >= 2.0 * SMALLEST_RADIUS);

/// A splat in the tile where it belongs.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    /// Circle: x, y and radius in the cells of the tile's buffer, and 0. Sphere: position in camera space, and `h`. Ellipse: x,
    /// y, half the width and half the height in cells, the latter negative, and the shear; the former is negative where the
    /// tile's own cells alone are drawn, without the margin, since other tiles draw the others.
    pub place: [f32; 5],
    /// `P` amplitude.
    pub amplitude: f32,
    /// `P S` amplitude.
    pub amplitude_s: f32,
}

impl Record {
    /// The record as a circle.
    #[inline(always)]
    pub fn circle(&self) -> Circle {
        let [x, y, radius, ..] = self.place;
        Circle { x, y, radius, amplitude: self.amplitude, amplitude_s: self.amplitude_s }
    }

    /// The record as an ellipse; None when it is another.
    #[inline(always)]
    pub fn ellipse(&self) -> Option<TileEllipse> {
        let [x, y, across, down, shear] = self.place;
        let clip = if across < 0.0 { [MARGIN, MARGIN + TILE] } else { [0, SIDE] };
        (down < 0.0).then_some(TileEllipse {
            center: [x, y],
            shear,
            half: [across.abs(), -down],
            amplitude: self.amplitude,
            amplitude_s: self.amplitude_s,
            clip: [clip; 2],
        })
    }

    /// Whether it is a sphere.
    #[inline(always)]
    pub fn is_sphere(&self) -> bool {
        self.place[3] > 0.0
    }
}

/// One layer of the picture.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// Width of a cell, pixels: a power of two.
    pub cell: f64,
    /// Cells along a pixel.
    per_pixel: f64,
    /// Cells around the picture.
    pub padding: usize,
    /// Cells in a row and in a column, padding included.
    pub size: [usize; 2],
    /// Tiles in a row and in a column.
    pub tiles: [usize; 2],
    /// Number of the first tile among those of all layers.
    pub first: usize,
}

impl Layer {
    /// The tile that holds a point (pixels), or the nearest one, and the pixel coordinates of its buffer's corner.
    #[inline]
    fn tile_at(&self, point: [f64; 2]) -> (usize, [f64; 2]) {
        let tile = [self.tile_of(point[0], 0), self.tile_of(point[1], 1)];
        (self.first + tile[1] * self.tiles[0] + tile[0], self.corner(tile))
    }

    /// The column (axis 0) or row (axis 1) of tiles that holds a coordinate (pixels), or the nearest one.
    #[inline]
    fn tile_of(&self, coordinate: f64, axis: usize) -> usize {
        let cell = coordinate * self.per_pixel + self.padding as f64;
        // The cast saturates.
        (cell as usize / TILE).min(self.tiles[axis] - 1)
    }

    /// Pixel coordinates of the corner of a tile's buffer.
    fn corner(&self, tile: [usize; 2]) -> [f64; 2] {
        tile.map(|t| ((t * TILE) as f64 - (self.padding + MARGIN) as f64) * self.cell)
    }

    /// Pixel coordinates of the corner of the buffer of the tile with this number.
    pub fn corner_of(&self, tile: usize) -> [f64; 2] {
        let index = tile - self.first;
        self.corner([index % self.tiles[0], index / self.tiles[0]])
    }

    /// Adds up the tiles' buffers to the layer's picture, padding included. `channel` gives a tile's buffer, empty when
    /// nothing was drawn into it.
    pub fn gather<'a>(&self, channel: impl Fn(usize) -> &'a [f32] + Sync) -> LevelImage {
        let stride = self.size[0];
        let mut samples = vec![0.0f32; stride * self.size[1]];
        samples.par_chunks_mut(stride).enumerate().for_each(|(y, out)| {
            let first = (y + 1).saturating_sub(TILE + MARGIN).div_ceil(TILE);
            for ty in first..=((y + MARGIN) / TILE).min(self.tiles[1] - 1) {
                let row = y + MARGIN - ty * TILE;
                for tx in 0..self.tiles[0] {
                    let buffer = channel(self.first + ty * self.tiles[0] + tx);
                    if buffer.is_empty() {
                        continue;
                    }
                    let skipped = MARGIN.saturating_sub(tx * TILE);
                    let start = tx * TILE + skipped - MARGIN;
                    let values = &buffer[row * STRIDE + skipped..row * STRIDE + SIDE];
                    for (out, value) in out[start..].iter_mut().zip(values) {
                        *out += value;
                    }
                }
            }
        });
        LevelImage { stride, samples }
    }
}

/// All layers of a picture: first the small splats' one, then the pyramid's levels from fine to coarse.
pub fn layers(view: &View) -> Vec<Layer> {
    let mut first = 0;
    let mut layer = |level: usize, padding: usize| {
        let size = [view.width, view.height].map(|pixels| pyramid::cells_of(pixels, level) + 2 * padding);
        let tiles = size.map(|cells| cells.div_ceil(TILE));
        let cell = f64::from(1u32 << level);
        let layer = Layer { cell, per_pixel: 1.0 / cell, padding, size, tiles, first };
        first += tiles[0] * tiles[1];
        layer
    };
    let mut layers = vec![layer(0, 0)];
    layers.extend((0..=pyramid::coarsest_level(view.width, view.height)).map(|level| layer(level, PADDING)));
    layers
}

/// Particles of a chunk, sorted by tile and in their order within each.
pub struct Sorted {
    records: Vec<Record>,
    /// Where each tile's records start, and the end.
    starts: Vec<u32>,
    /// Splats that reach beyond a tile's buffer, with their layer.
    pub wide: Vec<(usize, Footprint)>,
    /// Ellipsoids nearby that fit into a tile's buffer, by tile and in their order within each.
    near: Vec<(usize, Footprint)>,
    /// Splats outside the picture with the number of the nearest tile; none when they are culled.
    pub outside: Vec<(usize, Record)>,
    /// What became of the particles.
    pub counts: Counts,
}

impl Sorted {
    /// The records of a tile.
    pub fn of(&self, tile: usize) -> &[Record] {
        &self.records[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    /// The ellipsoids nearby of a tile.
    pub fn near(&self, tile: usize) -> impl Iterator<Item = &Footprint> {
        let first = self.near.partition_point(|(of, _)| *of < tile);
        self.near[first..].iter().take_while(move |(of, _)| *of == tile).map(|(_, footprint)| footprint)
    }
}

/// Some consecutive particles of a batch.
pub type Piece<'a> = (&'a Splats<'a>, Range<usize>);

/// Splats on their way to their tiles.
#[derive(Default)]
pub struct Sorting {
    /// How many records each tile has.
    starts: Vec<u32>,
    placed: Vec<(u32, Record)>,
    wide: Vec<(usize, Footprint)>,
    near: Vec<(usize, Footprint)>,
    outside: Vec<(usize, Record)>,
    counts: Counts,
}

impl Sorting {
    /// None yet, of a picture with these layers.
    pub fn new(layers: &[Layer]) -> Sorting {
        let tiles = layers.last().map_or(0, |layer| layer.first + layer.tiles[0] * layer.tiles[1]);
        Sorting { starts: vec![0; tiles + 1], ..Sorting::default() }
    }

    /// With the particles of some pieces, projected.
    #[must_use]
    pub fn with(
        mut self,
        lens: &Lens,
        profiles: &Profiles,
        layers: &[Layer],
        pieces: &[Piece<'_>],
        options: &SplatOptions,
    ) -> Sorting {
        self.placed.reserve(pieces.iter().map(|piece| piece.1.len()).sum());
        project(&mut self, lens, profiles, layers, pieces, options);
        self
    }

    fn count(&mut self, seen: bool) {
        self.counts.drawn += u64::from(seen);
        self.counts.outside += u64::from(!seen);
    }

    /// Gives a footprint to its tile in a layer.
    fn put(&mut self, layers: &[Layer], layer: usize, footprint: &Footprint, seen: bool) {
        match place(&layers[layer], footprint) {
            // It has been through everything that a splat goes through; none of its tile's cells is in its reach.
            Some(placed) if !seen => self.outside.push(placed),
            None if !seen => {}
            Some((tile, record)) => {
                self.starts[tile] += 1;
                self.placed.push((tile as u32, record));
            }
            None => self.wide.push((layer, *footprint)),
        }
    }

    /// Sorted by tile, in their order within each.
    pub fn sorted(self) -> Sorted {
        let Sorting { mut starts, placed, wide, mut near, outside, counts } = self;
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        let blank = Record { place: [0.0; 5], amplitude: 0.0, amplitude_s: 0.0 };
        let mut records = vec![blank; placed.len()];
        let mut cursor = starts.clone();
        for (tile, record) in placed {
            let slot = &mut cursor[tile as usize];
            records[*slot as usize] = record;
            *slot += 1;
        }
        near.sort_by_key(|(tile, _)| *tile);
        Sorted { records, starts, wide, near, outside, counts }
    }
}

/// Projects the particles of some pieces.
fn project(
    sorting: &mut Sorting,
    lens: &Lens,
    profiles: &Profiles,
    layers: &[Layer],
    pieces: &[Piece<'_>],
    options: &SplatOptions,
) {
    for (splats, range) in pieces {
        for index in range.clone() {
            // How much of one that is faint shows depends on what exactly it covers.
            let ball = if options.faintest > 0.0 { None } else { lens.ball_ahead(splats, index) };
            let circles = ball.map_or([None; 2], |(camera, h, weights)| {
                let per_area = 1.0 / (h * h);
                small::circles_of(lens, profiles, (camera, h), weights.map(|weight| weight * per_area))
            });
            if circles[0].is_some() {
                let seen = circles.iter().flatten().any(|circle| lens.sees(circle, 1.0));
                sorting.count(seen);
                if seen || !options.culling {
                    circles.iter().flatten().for_each(|circle| sorting.put(layers, 0, circle, seen));
                }
                continue;
            }
            let Some(footprint) = lens.footprint(splats, index, options.kernel) else { continue };
            let footprint = lens.seen_from_far(footprint, options.kernel, FAR);
            // A level's padding is at most twice the radius of the splats on it.
            let small = footprint.radius < SMALLEST_RADIUS;
            let seen = lens.sees(&footprint, if small { 1.0 } else { 2.0 * footprint.radius });
            if seen && options.faintest > 0.0 && lens.presence(&footprint, options.kernel) < f64::from(options.faintest)
            {
                sorting.counts.faint += 1;
                continue;
            }
            sorting.count(seen);
            if !seen && options.culling {
                continue;
            }
            let layer = if small { 0 } else { 1 + pyramid::level_of(footprint.radius, layers.len() - 2) };
            if let Shape::Ellipse(ellipse) = footprint.shape {
                let drawn = place_ellipse(&layers[layer], &footprint, &ellipse, |tile, record| {
                    sorting.starts[tile] += 1;
                    sorting.placed.push((tile as u32, record));
                });
                if !drawn {
                    sorting.wide.push((layer, footprint));
                }
                continue;
            }
            if let (Shape::Ellipsoid(_), false) = (footprint.shape, small) {
                match fitting(&layers[layer], &footprint) {
                    Some(tile) => sorting.near.push((tile, footprint)),
                    None => sorting.wide.push((layer, footprint)),
                }
                continue;
            }
            match if small { small::circles(lens, profiles, &footprint) } else { [None; 2] } {
                [None, _] => sorting.put(layers, layer, &footprint, seen),
                circles => circles.iter().flatten().for_each(|circle| sorting.put(layers, layer, circle, seen)),
            }
        }
    }
}

/// Gives the records of an ellipse to `put`: one in the tile of its centre where it fits into the buffer, else one in each tile
/// that it reaches. False when it is too long for either.
#[inline]
fn place_ellipse(layer: &Layer, footprint: &Footprint, ellipse: &Ellipse, mut put: impl FnMut(usize, Record)) -> bool {
    let half = ellipse.half.map(|half| (half * layer.per_pixel) as f32);
    let (center, extent) = (ellipse.center, ellipse.extent().map(|half| half * layer.per_pixel));
    let longest = extent[0].max(extent[1]);
    if longest > LONGEST || half.iter().any(|half| !half.is_normal()) {
        return false;
    }
    let record = |corner: [f64; 2], sign: f32| {
        let [x, y] = [0, 1].map(|k| ((center[k] - corner[k]) * layer.per_pixel) as f32);
        Record {
            place: [x, y, sign * half[0], -half[1], ellipse.shear as f32],
            amplitude: footprint.amplitude as f32,
            amplitude_s: footprint.amplitude_s as f32,
        }
    };
    if longest < MARGIN as f64 - 1.0 {
        let (tile, corner) = layer.tile_at(center);
        put(tile, record(corner, 1.0));
        return true;
    }
    let [first, last] = [footprint.min[1], footprint.max[1]].map(|y| layer.tile_of(y, 1));
    for row in first..=last {
        let top = layer.corner([0, row])[1] + MARGIN as f64 * layer.cell;
        let [left, right] = ellipse.between([top, top + TILE as f64 * layer.cell]);
        if left > right {
            continue;
        }
        for column in layer.tile_of(left, 0)..=layer.tile_of(right, 0) {
            put(layer.first + row * layer.tiles[0] + column, record(layer.corner([column, row]), -1.0));
        }
    }
    true
}

/// Longest half of an ellipse that is drawn tile by tile, cells: its records are singles.
const LONGEST: f64 = 4096.0;

/// Ellipsoids whose image differs from an ellipse by less than this ([`super::ellipsoid::FarImage::depth`]) are drawn as one. What the ellipse
/// leaves out is of third order, a few parts in ten thousand of a picture of clusters; what is nearer is drawn exactly, which takes ten times
/// as long where it is thin.
const FAR: f64 = 0.06;

/// The tile of a footprint and its record; `None` when it does not fit into the tile's buffer.
#[inline]
fn place(layer: &Layer, footprint: &Footprint) -> Option<(usize, Record)> {
    let (amplitude, amplitude_s) = (footprint.amplitude as f32, footprint.amplitude_s as f32);
    match footprint.shape {
        Shape::Circle { center } => {
            let radius = footprint.radius * layer.per_pixel;
            if radius > 2.0 * SMALLEST_RADIUS {
                return None;
            }
            let (tile, corner) = layer.tile_at(center);
            let local = |k: usize| ((center[k] - corner[k]) * layer.per_pixel) as f32;
            Some((tile, Record { place: [local(0), local(1), radius as f32, 0.0, 0.0], amplitude, amplitude_s }))
        }
        Shape::Sphere { camera, h } => {
            let tile = fitting(layer, footprint)?;
            let [x, y, z] = camera.to_array().map(|c| c as f32);
            Some((tile, Record { place: [x, y, z, h as f32, 0.0], amplitude, amplitude_s }))
        }
        Shape::Ellipse(_) | Shape::Ellipsoid(_) => None,
    }
}

/// The tile of the middle of a footprint's box, when the box fits into its buffer.
fn fitting(layer: &Layer, footprint: &Footprint) -> Option<usize> {
    let middle = [0, 1].map(|k| 0.5 * (footprint.min[k] + footprint.max[k]));
    if !(middle[0].is_finite() && middle[1].is_finite()) {
        return None;
    }
    let (tile, corner) = layer.tile_at(middle);
    // Those that are small in one direction and very long in the other fit nowhere.
    if (0..2).any(|k| footprint.max[k] - footprint.min[k] > 16.0 * footprint.radius) {
        return None;
    }
    let side = SIDE as f64 * layer.cell;
    let pad = layer.padding as f64 * layer.cell;
    let fits = (0..2).all(|k| {
        // What lies beyond the layer is not drawn anyway.
        let end = layer.size[k] as f64 * layer.cell - pad;
        footprint.min[k].max(-pad) >= corner[k] && footprint.max[k].min(end) <= corner[k] + side
    });
    fits.then_some(tile)
}
