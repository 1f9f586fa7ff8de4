//! Splats blended front to back, tile by tile (F12 5.9).
//!
//! Ellipsoids may be long, so that the depths of their centres say little of the order in which a ray meets them: an order by centre
//! changes at once all over two of them when the view turns. In each tile they are sorted by the depth at which the ray through the
//! tile's middle is deepest in each of them, round particles by their centres. As many splats are sorted so as are held at once
//! ([`PAIRS`]); beyond that the order in which they come holds.
//!
//! Surfaces lie among them: in front of a splat at a pixel is what of them is nearer there than its middle.

use super::about_eye::{self, AboutEye};
use super::footprint::{Footprint, Lens};
use super::half_line::HalfLine;
use super::paths::PathFragments;
use super::profile::{Profile, Profiles};
use super::screen_tiles::{Reach, TILE, Tiles};
use super::volume::VolumeReport;
use super::volume::raycast::Ray;
use crate::color::Colors;
use crate::model::Kernel;
use crate::view::View;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Pairs of a tile and a splat that are held at once.
const PAIRS: usize = 1 << 22;

/// The rays of a tile, row by row, and how many of them go on.
struct Tile {
    rays: Vec<Ray>,
    /// The depth of the last splat that each ray meets; infinite for those that go on.
    ends: Vec<f32>,
    open: usize,
}

/// Which pixels a splat covers.
pub(super) enum Cover {
    /// Those of a footprint.
    Footprint(Footprint),
    /// All, it is about the eye.
    All(AboutEye),
}

/// What a splat looks like.
pub(super) struct Seen {
    /// Which pixels it covers.
    pub(super) cover: Cover,
    /// Optical depth where `F`, or what a ray meets of it, is 1.
    pub(super) depth: f32,
    /// Colour, linear light.
    pub(super) color: [f32; 3],
    /// How far away it is.
    pub(super) place: f32,
}

/// Surfaces among splats.
#[derive(Clone, Copy)]
pub(super) struct Among<'a> {
    /// What of them is in each pixel.
    pub(super) fragments: &'a PathFragments,
    /// Whether splats tell how far they are from the eye, not from its plane.
    pub(super) by_distance: bool,
}

/// What rays are followed with.
struct Canvas<'a> {
    view: &'a View,
    lens: Lens,
    kernel: Kernel,
    profile: &'a Profile,
    /// Rays end at this opacity.
    termination: f32,
    surfaces: Option<Among<'a>>,
}

/// At which depth a splat is deepest along a ray, which begins somewhere and goes somewhere.
pub(super) type Deepest<'a, S> = &'a (dyn Fn(&S, DVec3, DVec3) -> f32 + Sync);

/// Blends splats front to back, in their order or in that which they have along each tile's middle, as `look` says that they look; rays
/// end at an opacity of `termination`. The colours, and for each pixel how far away the splat is that its ray ends with; infinite where it
/// goes on.
pub(super) fn blend<S: Send + Sync>(
    view: &View,
    splats: Vec<S>,
    look: impl Fn(&Lens, &S) -> Option<Seen> + Sync,
    deepest: Option<Deepest<'_, S>>,
    (kernel, termination): (Kernel, f32),
    surfaces: Option<Among<'_>>,
    report: &mut VolumeReport,
) -> (Colors, Vec<f32>) {
    let start = Instant::now();
    let (lens, tiles) = (Lens::new(view), Tiles::new(view));
    let reach = |splat: &S| match look(&lens, splat)?.cover {
        Cover::Footprint(footprint) => tiles.reach(&lens, &footprint),
        Cover::All(_) => Some(tiles.all()),
    };
    let (splats, reaches): (Vec<S>, Vec<Reach>) =
        splats.into_par_iter().filter_map(|splat| reach(&splat).map(|reach| (splat, reach))).unzip();
    report.resampling += start.elapsed();
    let profile = &Profiles::of(kernel).sampled;
    let canvas = Canvas { view, lens, kernel, profile, termination, surfaces };
    let mut drawn: Vec<Tile> = (0..tiles.count())
        .map(|tile| {
            let [columns, rows] = tiles.pixels(tile);
            let count = columns.len() * rows.len();
            Tile { rays: vec![Ray::default(); count], ends: vec![f32::INFINITY; count], open: count }
        })
        .collect();
    let pixels = view.width as u64 * u64::from(view.height) * size_of::<Ray>() as u64;
    let held = splats.len() as u64 * (size_of::<S>() + size_of::<Reach>()) as u64 + pixels;
    let mut next = 0;
    while next < splats.len() && drawn.iter().any(|tile| tile.open > 0) {
        let start = Instant::now();
        let (bins, end) = tiles.bin(&reaches, next..splats.len(), PAIRS, |tile| drawn[tile].open > 0);
        next = end;
        report.resampling += start.elapsed();
        let start = Instant::now();
        report.pairs += bins.len() as u64;
        report.slabs += 1;
        report.memory = report.memory.max(Some(held + 4 * bins.len() as u64));
        let blend = |(index, tile): (usize, &mut Tile)| -> u64 {
            let pixels = tiles.pixels(index);
            let mut one = |splat: u32, depth: f32| {
                let splat = &splats[splat as usize];
                tile.blend(&canvas, &pixels, || look(&lens, splat), depth)
            };
            match deepest {
                None => bins.of(index).iter().map(|&splat| one(splat, f32::NEG_INFINITY)).sum(),
                Some(deepest) => {
                    let [x, y] = pixels.clone().map(|pixels| 0.5 * (pixels.start + pixels.end) as f64);
                    let (start, direction) = lens.sight([x, y]);
                    let depth = |&splat: &u32| (deepest(&splats[splat as usize], start, direction), splat);
                    let mut own: Vec<(f32, u32)> = bins.of(index).iter().map(depth).collect();
                    own.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                    own.into_iter().map(|(depth, splat)| one(splat, depth)).sum()
                }
            }
        };
        *report.samples.get_or_insert(0) += drawn.par_iter_mut().enumerate().map(blend).sum::<u64>();
        report.rendering += start.elapsed();
    }
    if let Some(Among { fragments, .. }) = surfaces {
        let behind_all = |(index, tile): (usize, &mut Tile)| {
            let [columns, rows] = tiles.pixels(index);
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
            tile.rays.iter_mut().zip(pixels).for_each(|(ray, (x, y))| ray.meet_rest(fragments.of(x, y), termination));
        };
        drawn.par_iter_mut().enumerate().for_each(behind_all);
    }
    let (width, height) = (view.width as usize, view.height as usize);
    let mut rgba = vec![[0.0; 4]; width * height];
    let mut ends = vec![f32::INFINITY; width * height];
    for (index, tile) in drawn.iter().enumerate() {
        let [columns, rows] = tiles.pixels(index);
        let rays = tile.rays.chunks(columns.len().max(1)).zip(tile.ends.chunks(columns.len().max(1)));
        for (y, (rays, own)) in rows.zip(rays) {
            let row = y * width + columns.start..y * width + columns.end;
            ends[row.clone()].copy_from_slice(own);
            rgba[row]
                .iter_mut()
                .zip(rays)
                .for_each(|(out, ray)| *out = [ray.color[0], ray.color[1], ray.color[2], ray.alpha]);
        }
    }
    (Colors { width: view.width, height: view.height, rgba }, ends)
}

impl Tile {
    /// Blends a splat, which is deepest at `behind` in the tile where that is known, under what is there; the number of rays that it met.
    fn blend(
        &mut self,
        canvas: &Canvas<'_>,
        pixels: &[Range<usize>; 2],
        look: impl FnOnce() -> Option<Seen>,
        behind: f32,
    ) -> u64 {
        if self.open == 0 {
            return 0;
        }
        let Some(seen) = look() else { return 0 };
        // What lies behind this is sorted behind the splat, here and among the centres.
        let end_of_ray = behind.max(seen.place);
        match &seen.cover {
            Cover::Footprint(footprint) => self.blend_footprint(canvas, pixels, footprint, (&seen, end_of_ray)),
            Cover::All(about) => self.blend_all(canvas, pixels, about, (&seen, end_of_ray)),
        }
    }

    fn blend_footprint(
        &mut self,
        canvas: &Canvas<'_>,
        [columns, rows]: &[Range<usize>; 2],
        footprint: &Footprint,
        (seen, end_of_ray): (&Seen, f32),
    ) -> u64 {
        let lens = &canvas.lens;
        // Pixels whose centres it may cover; casts saturate.
        let clip = |from: f64, to: f64, range: &Range<usize>| {
            let first = ((from - 0.5).ceil().max(0.0) as usize).max(range.start);
            first..((to + 0.5).floor().max(0.0) as usize).min(range.end)
        };
        let covered = clip(footprint.min[0], footprint.max[0], columns);
        if covered.is_empty() {
            return 0;
        }
        let mut met = 0;
        let (mut square, mut factors) = ([0.0f32; TILE], [1.0f32; TILE]);
        for row in clip(footprint.min[1], footprint.max[1], rows) {
            let line = lens.row(footprint, row as f64 + 0.5);
            for (out, x) in square.iter_mut().zip(covered.clone()) {
                *out = lens.square(&line, x as f64 + 0.5) as f32;
            }
            if line.ray.is_some() {
                for (out, x) in factors.iter_mut().zip(covered.clone()) {
                    *out = lens.ray_factor(&line, x as f64 + 0.5) as f32;
                }
            }
            let start = (row - rows.start) * columns.len() + covered.start - columns.start;
            let depth = |k: usize| {
                let covered = square[k] < 1.0;
                covered.then(|| seen.depth * factors[k] * evaluate(canvas.profile, square[k]))
            };
            let ends = (covered.start, row);
            self.meet(canvas, start..start + covered.len(), ends, seen.place, |k| square[k] < 1.0);
            met += self.under(start..start + covered.len(), depth, (seen.color, end_of_ray), canvas.termination);
        }
        met
    }

    /// Blends what is about the eye: rays a few pixels apart, with bilinear interpolation between them.
    fn blend_all(
        &mut self,
        canvas: &Canvas<'_>,
        [columns, rows]: &[Range<usize>; 2],
        about: &AboutEye,
        (seen, end_of_ray): (&Seen, f32),
    ) -> u64 {
        const MOST: usize = TILE + 1;
        let table = HalfLine::of(canvas.kernel);
        // No farther apart than a tile is wide.
        let step = about_eye::step(canvas.view).min(TILE as f64);
        // From the middle of the first pixel to that of the last, or beyond.
        let count = |pixels: &Range<usize>| ((pixels.len() as f64 - 1.0) / step).ceil().max(1.0) as usize + 1;
        let (across, down) = (count(columns), count(rows));
        let mut depths = [0.0f32; MOST * MOST];
        let mut any = false;
        for (j, line) in depths.chunks_mut(across).enumerate().take(down) {
            for (i, depth) in line.iter_mut().enumerate() {
                let at = |pixels: &Range<usize>, k: usize| pixels.start as f64 + 0.5 + k as f64 * step;
                let point = [at(columns, i), at(rows, j)];
                *depth = seen.depth * about.met(table, about_eye::ray(canvas.view, point)) as f32;
                any |= *depth > 0.0;
            }
        }
        if !any {
            return 0;
        }
        let locate = |pixel: usize, count: usize| {
            let place = pixel as f64 / step;
            let index = (place as usize).min(count - 2);
            (index, (place - index as f64) as f32)
        };
        let mut met = 0;
        for row in 0..rows.len() {
            let (j, v) = locate(row, down);
            let start = row * columns.len();
            let depth = |column: usize| {
                let (i, u) = locate(column, across);
                let [upper, lower] = [j, j + 1].map(|j| {
                    let at = j * across + i;
                    depths[at] * (1.0 - u) + depths[at + 1] * u
                });
                let depth = upper * (1.0 - v) + lower * v;
                (depth > 0.0).then_some(depth)
            };
            let ends = (columns.start, rows.start + row);
            self.meet(canvas, start..start + columns.len(), ends, seen.place, |_| true);
            met += self.under(start..start + columns.len(), depth, (seen.color, end_of_ray), canvas.termination);
        }
        met
    }

    /// Lets rays of a row, the first of which is that of a pixel, meet what of surfaces is nearer than `place`, where a splat is `covered`.
    fn meet(
        &mut self,
        canvas: &Canvas<'_>,
        row: Range<usize>,
        (first, y): (usize, usize),
        place: f32,
        covered: impl Fn(usize) -> bool,
    ) {
        let Some(Among { fragments, by_distance }) = canvas.surfaces else { return };
        let termination = canvas.termination;
        for (k, (ray, end)) in self.rays[row.clone()].iter_mut().zip(&mut self.ends[row]).enumerate() {
            let own = fragments.of(first + k, y);
            if own.is_empty() || ray.alpha >= termination || !covered(k) {
                continue;
            }
            let depth = match by_distance {
                true => {
                    let [u, v] = canvas.lens.slope([(first + k) as f64 + 0.5, y as f64 + 0.5]);
                    (f64::from(place) / (1.0 + u * u + v * v).sqrt()) as f32
                }
                false => place,
            };
            ray.meet(own, depth);
            if ray.alpha >= termination {
                *end = place;
                self.open -= 1;
            }
        }
    }

    /// Blends a colour under the rays of a row, with the optical depth that each of these has; the number of rays that met any.
    #[inline]
    fn under(
        &mut self,
        row: Range<usize>,
        depth: impl Fn(usize) -> Option<f32>,
        (color, end_of_ray): ([f32; 3], f32),
        termination: f32,
    ) -> u64 {
        let mut met = 0;
        for (k, (ray, end)) in self.rays[row.clone()].iter_mut().zip(&mut self.ends[row]).enumerate() {
            if ray.alpha >= termination {
                continue;
            }
            let Some(depth) = depth(k) else { continue };
            ray.under(color, opacity(depth));
            met += 1;
            if ray.alpha >= termination {
                *end = end_of_ray;
                self.open -= 1;
            }
        }
        met
    }
}

/// A profile at a squared distance below 1.
#[inline]
fn evaluate(profile: &Profile, square: f32) -> f32 {
    let (t, y) = (1.0 - square, 1.0 - 2.0 * square);
    t * t * t * profile.iter().rev().fold(0.0, |sum, &c| sum * y + c)
}

/// `1 - exp(-depth)`.
#[inline]
fn opacity(depth: f32) -> f32 {
    if depth < 0.02 { depth * (1.0 - 0.5 * depth * (1.0 - depth / 3.0)) } else { 1.0 - (-depth).exp() }
}
