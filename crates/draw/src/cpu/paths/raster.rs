//! Strokes become fragments, tile by tile.
//!
//! The strokes of a tile are drawn in the order of their nearest points. Once what a pixel has gathered lets less than [`HIDDEN`]
//! through, strokes that begin behind all of that are left out: they would not be seen, whatever the order within. Of very many curves
//! some come first, and those of the others that are behind what these close ([`super::hidden`]) never become strokes.

use super::chords::{Chopper, Drawn};
use super::fragments::{PathFragment, PathFragments, TileFragments, over};
use super::hidden::{Hidden, closed_blocks};
use super::palette::light;
use super::stroke::{Sampler, Stroke, reach_along};
use super::style::Style;
use crate::color::Colors;
use crate::view::{Projection, View};
use rayon::prelude::*;
use std::ops::Range;

/// Pixels along a tile's side.
pub const SIDE: usize = 64;
/// Light that is let through and not seen.
pub const HIDDEN: f32 = 1.0 / 4096.0;
/// Curves that one task chops.
const CHUNK: usize = 4096;
/// So many curves are chopped in several waves: of fewer it takes longer to find out what is hidden than to draw it.
const MANY: usize = 1 << 21;
/// Strokes of a tile, the nearest ones, that are sorted first: where they close it, the others need not be in order.
const NEAREST: usize = 1 << 11;

/// Every `step`-th curve, without every `without`-th, a multiple of it; with these, too, where it is 0.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wave {
    step: usize,
    without: usize,
}

/// All curves at once.
pub(super) const AT_ONCE: [Wave; 1] = [Wave { step: 1, without: 0 }];
/// A few, which lie everywhere, then more of them, and then those that these do not hide.
pub(super) const IN_WAVES: [Wave; 3] =
    [Wave { step: 16, without: 0 }, Wave { step: 4, without: 16 }, Wave { step: 1, without: 4 }];

impl Wave {
    /// How many of `count` curves.
    fn len(self, count: usize) -> usize {
        count.div_ceil(self.step) - if self.without > 0 { count.div_ceil(self.without) } else { 0 }
    }

    /// The places of some of the wave's curves among all of them.
    fn places(self, range: Range<usize>) -> impl Iterator<Item = usize> + Clone {
        let Wave { step, without } = self;
        // One is left out before each so many of them.
        let (between, first) = if without > 0 { (without / step - 1, 1) } else { (usize::MAX, 0) };
        range.map(move |i| (i + i / between + first) * step)
    }
}

/// The strokes of some curves, and which tiles they reach.
#[derive(Default)]
struct Chunk {
    strokes: Vec<Stroke>,
    /// The first of each tile in `indices`, and one more at the end.
    starts: Vec<u32>,
    indices: Vec<u32>,
    /// The nearest points of these strokes, as [`ordered`] has them.
    nearest: Vec<u32>,
    wave: Wave,
    /// Which of the drawn its curves are of, by their numbers in the wave.
    of: Vec<(usize, Range<usize>)>,
    /// Which of its curves are in view.
    seen: Vec<bool>,
}

/// What is drawn on; keeps its memory from picture to picture.
#[derive(Default)]
pub struct Canvas {
    chunks: Vec<Chunk>,
    used: usize,
    size: [usize; 2],
    perspective: bool,
}

/// A fragment that is not sorted yet.
#[derive(Clone, Copy, Default)]
struct Raw {
    pixel: u32,
    depth: f32,
    alpha: f32,
    shade: f32,
    color: [u8; 3],
}

/// What a task needs for a tile.
#[derive(Default)]
struct Scratch {
    order: Vec<(u32, u32, u32)>,
    raw: Vec<Raw>,
    sorted: Vec<Raw>,
    through: Vec<f32>,
    behind: Vec<f32>,
    starts: Vec<u32>,
    pixel: Vec<PathFragment>,
}

impl Canvas {
    /// Projects what is drawn.
    pub fn gather(&mut self, view: &View, drawn: &[Drawn<'_>], style: &Style) {
        let count = drawn.iter().map(Drawn::len).sum::<usize>();
        let hides = count >= MANY && Chopper::new(view, style).hides();
        self.gather_in(if hides { &IN_WAVES } else { &AT_ONCE }, view, drawn, style);
    }

    /// The same in waves, which have each curve in one of them.
    pub(super) fn gather_in(&mut self, waves: &[Wave], view: &View, drawn: &[Drawn<'_>], style: &Style) {
        self.size = [view.width as usize, view.height as usize];
        self.perspective = matches!(view.projection, Projection::Perspective { .. });
        self.used = 0;
        let chopper = Chopper::new(view, style);
        let mut hidden: Option<Hidden> = None;
        for (number, wave) in waves.iter().enumerate() {
            self.chop(&chopper, *wave, drawn, hidden.as_ref());
            if number + 1 < waves.len() {
                hidden = Some(self.hidden());
            }
        }
    }

    /// Projects a wave of what is drawn, as far as it is not hidden.
    fn chop(&mut self, chopper: &Chopper<'_>, wave: Wave, drawn: &[Drawn<'_>], hidden: Option<&Hidden>) {
        // Tasks of about as many curves each: parts of large places, or several small ones.
        let mut tasks: Vec<Vec<(usize, Range<usize>)>> = Vec::new();
        let mut room = 0;
        for (number, own) in drawn.iter().enumerate() {
            let (mut first, len) = (0, wave.len(own.len()));
            while first < len {
                if room == 0 {
                    tasks.push(Vec::new());
                    room = CHUNK;
                }
                let end = len.min(first + room);
                if let Some(task) = tasks.last_mut() {
                    task.push((number, first..end));
                }
                room -= end - first;
                first = end;
            }
        }
        let before = self.used;
        self.used += tasks.len();
        if self.chunks.len() < self.used {
            self.chunks.resize_with(self.used, Chunk::default);
        }
        let size = self.size;
        self.chunks[before..self.used].par_iter_mut().zip(&tasks).for_each(|(chunk, task)| {
            chunk.strokes.clear();
            chunk.seen.clear();
            chunk.of.clone_from(task);
            chunk.wave = wave;
            for (number, range) in task {
                let first = chunk.seen.len();
                chunk.seen.resize(first + range.len(), false);
                let places = wave.places(range.clone());
                chopper.chop(&drawn[*number], places, hidden, &mut chunk.seen[first..], &mut chunk.strokes);
            }
            chunk.bin(size);
        });
    }

    /// What the strokes that were gathered hide.
    fn hidden(&self) -> Hidden {
        let [across, down] = self.tiles();
        let tile = |scratch: &mut Scratch, tile: usize| {
            let width = SIDE.min(self.size[0] - tile % across * SIDE);
            match self.draw(tile, scratch) {
                0 => Vec::new(),
                _ => closed_blocks(width, &scratch.through, &scratch.behind),
            }
        };
        let tiles: Vec<Vec<f32>> = (0..across * down).into_par_iter().map_init(Scratch::default, tile).collect();
        let mut hidden = Hidden::nothing(self.size);
        for (tile, depths) in tiles.iter().enumerate() {
            let corner = [tile % across, tile / across].map(|tile| tile * SIDE);
            hidden.close(corner, SIDE.min(self.size[0] - corner[0]), depths);
        }
        hidden
    }

    /// Calls `each` for every curve in view: the number of what it is drawn of, and its place in that.
    pub fn each_seen(&self, mut each: impl FnMut(usize, usize)) {
        for chunk in &self.chunks[..self.used] {
            let places = |range: &Range<usize>| chunk.wave.places(range.clone());
            let curves = chunk.of.iter().flat_map(|(number, range)| places(range).map(|place| (*number, place)));
            for ((number, place), seen) in curves.zip(&chunk.seen) {
                if *seen {
                    each(number, place);
                }
            }
        }
    }

    /// Takes strokes as they are.
    pub fn take(&mut self, view: &View, strokes: Vec<Stroke>) {
        self.size = [view.width as usize, view.height as usize];
        self.perspective = matches!(view.projection, Projection::Perspective { .. });
        let mut chunk = Chunk { strokes, ..Chunk::default() };
        chunk.bin(self.size);
        (self.chunks, self.used) = (vec![chunk], 1);
    }

    /// The strokes that were gathered.
    pub fn strokes(&self) -> impl Iterator<Item = &Stroke> {
        self.chunks[..self.used].iter().flat_map(|chunk| &chunk.strokes)
    }

    fn tiles(&self) -> [usize; 2] {
        self.size.map(|pixels| pixels.div_ceil(SIDE))
    }

    /// The fragments of each pixel.
    pub fn fragments(&self) -> PathFragments {
        let [across, down] = self.tiles();
        let tile = |scratch: &mut Scratch, tile: usize| {
            let mut out = TileFragments::default();
            if self.draw(tile, scratch) == 0 {
                return out;
            }
            out.starts.push(0);
            scratch.each_pixel(|pixel, fragments| {
                out.starts.resize(pixel + 1, out.fragments.len() as u32);
                out.fragments.extend_from_slice(fragments);
            });
            let count = scratch.through.len();
            out.starts.resize(count + 1, out.fragments.len() as u32);
            out
        };
        let tiles = (0..across * down).into_par_iter().map_init(Scratch::default, tile).collect();
        PathFragments { size: self.size, side: SIDE, tiles, is_hazy: false }
    }

    /// The fragments of each pixel over one another.
    pub fn colors(&self) -> Colors {
        let [width, height] = self.size;
        let [across, _] = self.tiles();
        let mut rgba = vec![[0.0; 4]; width * height];
        // A row of tiles at a time, whose pixels lie together.
        rgba.par_chunks_mut(width * SIDE).enumerate().for_each(|(row, pixels)| {
            let tile = |scratch: &mut Scratch, column: usize| {
                let mut out = Vec::new();
                if self.draw(row * across + column, scratch) > 0 {
                    out.resize(scratch.through.len(), [0.0; 4]);
                    scratch.each_pixel(|pixel, fragments| out[pixel] = over(fragments));
                }
                out
            };
            let tiles: Vec<Vec<[f32; 4]>> = (0..across).into_par_iter().map_init(Scratch::default, tile).collect();
            for (column, tile) in tiles.iter().enumerate() {
                let left = column * SIDE;
                let own = SIDE.min(width - left);
                for (line, out) in tile.chunks(own).zip(pixels.chunks_mut(width)) {
                    out[left..left + own].copy_from_slice(line);
                }
            }
        });
        Colors { width: width as u32, height: height as u32, rgba }
    }

    /// Draws a tile; how many fragments it has.
    fn draw(&self, tile: usize, scratch: &mut Scratch) -> usize {
        let [across, _] = self.tiles();
        let [left, top] = [tile % across * SIDE, tile / across * SIDE];
        let [right, bottom] = [(left + SIDE).min(self.size[0]), (top + SIDE).min(self.size[1])];
        let width = right - left;
        let Scratch { order, raw, through, behind, .. } = scratch;
        order.clear();
        raw.clear();
        for (number, chunk) in self.chunks[..self.used].iter().enumerate() {
            let own = chunk.starts[tile] as usize..chunk.starts[tile + 1] as usize;
            let strokes = chunk.nearest[own.clone()].iter().zip(&chunk.indices[own]);
            order.extend(strokes.map(|(nearest, index)| (*nearest, number as u32, *index)));
        }
        through.clear();
        through.resize(width * (bottom - top), 1.0);
        if order.is_empty() {
            return 0;
        }
        behind.clear();
        behind.resize(through.len(), f32::INFINITY);
        let mut open = through.len();
        let mut last = f32::INFINITY;
        for &(_, chunk, index) in nearest_first(order) {
            let stroke = &self.chunks[chunk as usize].strokes[index as usize];
            let nearest = stroke.depth[0].min(stroke.depth[1]);
            if open == 0 {
                if last == f32::INFINITY {
                    last = behind.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                }
                if nearest > last {
                    break;
                }
            }
            let sampler = Sampler::new(stroke);
            let is_level = stroke.depth[0] == stroke.depth[1];
            let inverse = stroke.depth.map(|depth| 1.0 / depth);
            let [first_row, end_row] = sampler.rows([top, bottom]);
            for y in first_row..end_row {
                let [first, end] = sampler.columns(y, [left, right]);
                let start = (y - top) * width;
                for x in first..end {
                    let pixel = start + x - left;
                    let is_closed = through[pixel] < HIDDEN;
                    if is_closed && nearest > behind[pixel] {
                        continue;
                    }
                    let Some(sample) = sampler.sample(x as f32 + 0.5, y as f32 + 0.5) else { continue };
                    if sample.alpha <= 0.0 {
                        continue;
                    }
                    let depth = match (is_level, self.perspective) {
                        (true, _) => nearest,
                        (_, true) => 1.0 / (inverse[0] + (inverse[1] - inverse[0]) * sample.along),
                        _ => stroke.depth[0] + (stroke.depth[1] - stroke.depth[0]) * sample.along,
                    };
                    raw.push(Raw {
                        pixel: pixel as u32,
                        depth,
                        alpha: sample.alpha.min(1.0),
                        shade: sample.shade,
                        color: stroke.color,
                    });
                    if !is_closed {
                        // Until it is closed: the farthest that it has gathered.
                        let farthest = if behind[pixel] == f32::INFINITY { depth } else { behind[pixel].max(depth) };
                        behind[pixel] = farthest;
                        through[pixel] *= 1.0 - sample.alpha.min(1.0);
                        if through[pixel] < HIDDEN {
                            open -= 1;
                        }
                    }
                }
            }
        }
        raw.len()
    }
}

impl Chunk {
    /// Finds which tiles the strokes reach.
    fn bin(&mut self, size: [usize; 2]) {
        let tiles = size.map(|pixels| pixels.div_ceil(SIDE));
        let ranges = |stroke: &Stroke| {
            let range = |axis: usize| {
                let [low, high] = reach_along(stroke, axis);
                if !(high > 0.0 && low < size[axis] as f32) {
                    return 0..0;
                }
                let tile = |pixel: f32| ((pixel.max(0.0) as usize) / SIDE).min(tiles[axis] - 1);
                tile(low)..tile(high) + 1
            };
            [range(0), range(1)]
        };
        self.starts.clear();
        self.starts.resize(tiles[0] * tiles[1] + 1, 0);
        for stroke in &self.strokes {
            let [columns, rows] = ranges(stroke);
            for row in rows {
                self.starts[row * tiles[0] + columns.start + 1..row * tiles[0] + columns.end + 1]
                    .iter_mut()
                    .for_each(|count| *count += 1);
            }
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.indices.clear();
        self.indices.resize(sum as usize, 0);
        self.nearest.clear();
        self.nearest.resize(sum as usize, 0);
        // From the last on, so that starts end up where they belong.
        for (index, stroke) in self.strokes.iter().enumerate().rev() {
            let [columns, rows] = ranges(stroke);
            let nearest = ordered(stroke.depth[0].min(stroke.depth[1]));
            for row in rows {
                for column in columns.clone() {
                    let end = &mut self.starts[row * tiles[0] + column + 1];
                    *end -= 1;
                    self.indices[*end as usize] = index as u32;
                    self.nearest[*end as usize] = nearest;
                }
            }
        }
        // Each start has moved to the one before it.
        self.starts.rotate_left(1);
        if let Some(last) = self.starts.last_mut() {
            *last = sum;
        }
    }
}

impl Scratch {
    /// Hands the fragments of each pixel that has some to `take`, from front to back, as far as they are seen.
    fn each_pixel(&mut self, mut take: impl FnMut(usize, &[PathFragment])) {
        let Scratch { raw, sorted, starts, through, pixel: own, .. } = self;
        starts.clear();
        starts.resize(through.len() + 1, 0);
        raw.iter().for_each(|raw| starts[raw.pixel as usize + 1] += 1);
        for pixel in 0..through.len() {
            starts[pixel + 1] += starts[pixel];
        }
        sorted.clear();
        sorted.resize(raw.len(), Raw::default());
        let mut next = std::mem::take(starts);
        for raw in raw.iter() {
            let at = &mut next[raw.pixel as usize];
            sorted[*at as usize] = *raw;
            *at += 1;
        }
        let mut first = 0;
        for (pixel, end) in next.iter().take(through.len()).enumerate() {
            let end = *end as usize;
            let of_pixel = &mut sorted[first..end];
            first = end;
            if of_pixel.is_empty() {
                continue;
            }
            // Nearly sorted already; what is equally deep is in an order that does not depend on that of tracks.
            let key = |raw: &Raw| (ordered(raw.depth), raw.color, ordered(raw.alpha), ordered(raw.shade));
            of_pixel.sort_by(|a, b| a.depth.total_cmp(&b.depth).then_with(|| key(a).cmp(&key(b))));
            own.clear();
            let mut through = 1.0f32;
            for raw in &*of_pixel {
                let color = light(raw.color, raw.shade.clamp(0.0, 1.0));
                own.push(PathFragment { depth: raw.depth, color, alpha: raw.alpha });
                through *= 1.0 - raw.alpha;
                if through < HIDDEN {
                    break;
                }
            }
            take(pixel, own);
        }
        *starts = next;
    }
}

/// Strokes in their order, part by part, each sorted only when it is asked for.
fn nearest_first(strokes: &mut [(u32, u32, u32)]) -> impl Iterator<Item = &(u32, u32, u32)> {
    let (mut rest, mut part) = (strokes, NEAREST);
    std::iter::from_fn(move || {
        let all = std::mem::take(&mut rest);
        let len = if all.len() > 2 * part { part } else { all.len() };
        if len < all.len() {
            all.select_nth_unstable(len);
        }
        let (now, after) = all.split_at_mut(len);
        (rest, part) = (after, 4 * part);
        now.sort_unstable();
        (!now.is_empty()).then_some(&*now)
    })
    .flatten()
}

/// A number whose order is that of floats.
#[inline]
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}
