//! The reference: area means in double precision, without approximation by pyramids.
//!
//! Three ways to the same integral, each where it is accurate to better than 1e-5 of a splat's peak:
//!
//! - circles below [`SAMPLED_RADIUS`] pixels: differences of the cumulative integral at the pixels' corners,
//! - splats from [`SAMPLED_RADIUS`] pixels on: samples at pixel centres; one filter over the finished picture turns
//!   samples into area means (sixth order; see [`AREA_FILTER`]),
//! - ellipses below that short radius: integrals row by row ([`super::ellipse_area`]),
//! - spheres and ellipsoids in perspective below that radius: a grid of samples finer by a power of two, the same filter, and the mean
//!   over each pixel's samples.
//!
//! Work is divided by rows of the picture and particles are taken in their order, so the result does not depend on the
//! number of threads.

use super::ellipse_area;
use super::footprint::{Footprint, Lens, Shape};
use super::table::{CumulativeTable, LineTable};
use super::{Counts, SplatOptions, Splats};
use crate::color::Accumulation;
use crate::model::Kernel;
use crate::view::View;
use rayon::prelude::*;

/// From this radius in samples on, samples and [`AREA_FILTER`] give area means to better than 1e-5 of the peak.
const SAMPLED_RADIUS: f64 = 16.0;

/// Ellipsoids whose extent in depth is a smaller fraction of their distance are drawn as they look from far away.
const FAR: f64 = 1e-5;

/// How finely splats are sampled that are small in one direction at least.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fineness {
    /// Samples along the short radius.
    radius: f64,
    /// Smallest sample spacing, as a power of two of a pixel. Spheres too small for it are drawn with the radius that fits.
    finest: f64,
    /// Most samples along a splat, as a power of two: what is thinner than its length allows to sample grows.
    longest: f64,
    /// Smallest spacing for what has no end in the picture, since the eye is in it or beside it.
    endless: f64,
}

impl Fineness {
    /// That of the reference. At a length of 100 pixels what is thinner than a twentieth of a pixel grows.
    pub(super) const EXACT: Fineness = Fineness { radius: SAMPLED_RADIUS, finest: 12.0, longest: 15.0, endless: 3.0 };
    /// That of the fast method, for the few that are near.
    pub(super) const FAST: Fineness = Fineness { radius: 6.0, finest: 12.0, longest: 11.0, endless: 1.0 };
}

/// Turns samples at cell centres into means over the cells: `1 + d2/24 - 17/5760 d4` with the central differences `d2`
/// and `d4`, symmetric; the error is of sixth order in the cell size.
pub const AREA_FILTER: [f64; 3] =
    [1.0 - 2.0 / 24.0 - 6.0 * 17.0 / 5760.0, 1.0 / 24.0 + 4.0 * 17.0 / 5760.0, -17.0 / 5760.0];

/// Cells beyond the picture's edge that the filter needs.
const HALO: usize = 2;

/// Footprints held at a time.
const BATCH: usize = 1 << 16;

/// Rows of the picture that one task draws.
pub(super) const BAND: usize = 16;

/// One channel pair while it is being drawn: rows of `stride` values.
pub(super) struct Canvas {
    stride: usize,
    pub(super) p: Vec<f64>,
    pub(super) ps: Vec<f64>,
}

impl Canvas {
    pub(super) fn new(stride: usize, rows: usize, attribute: bool) -> Canvas {
        Canvas { stride, p: vec![0.0; stride * rows], ps: vec![0.0; if attribute { stride * rows } else { 0 }] }
    }

    /// The same with the attribute's channel, if it is wanted.
    pub(super) fn prepare(&mut self, attribute: bool) {
        if attribute && self.ps.is_empty() {
            self.ps = vec![0.0; self.p.len()];
        }
    }

    /// Calls `draw` for each band of rows, in parallel.
    pub(super) fn bands(&mut self, draw: impl Fn(Band<'_>) + Sync) {
        let stride = self.stride;
        let size = BAND * stride;
        let band = |number: usize, p, ps| Band { stride, first: number * BAND, p, ps };
        if self.ps.is_empty() {
            self.p.par_chunks_mut(size).enumerate().for_each(|(number, p)| draw(band(number, p, &mut [])));
        } else {
            let bands = self.p.par_chunks_mut(size).zip(self.ps.par_chunks_mut(size));
            bands.enumerate().for_each(|(number, (p, ps))| draw(band(number, p, ps)));
        }
    }
}

/// Some rows of a canvas.
pub(super) struct Band<'a> {
    /// Values in a row.
    pub(super) stride: usize,
    /// The first row's number in the canvas.
    pub(super) first: usize,
    p: &'a mut [f64],
    ps: &'a mut [f64],
}

impl Band<'_> {
    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.p.len() / self.stride
    }

    /// Adds a splat's share of a cell: `f` in units of its amplitudes.
    #[inline(always)]
    pub(super) fn add(&mut self, row: usize, column: usize, splat: &Footprint, f: f64) {
        self.add_amplitudes(row, column, [splat.amplitude, splat.amplitude_s], f);
    }

    /// The same in units of these amplitudes.
    #[inline(always)]
    pub(super) fn add_amplitudes(&mut self, row: usize, column: usize, [p, ps]: [f64; 2], f: f64) {
        let at = row * self.stride + column;
        self.p[at] += p * f;
        if !self.ps.is_empty() {
            self.ps[at] += ps * f;
        }
    }
}

/// A picture that batches are added to.
pub struct Drawing {
    view: View,
    options: SplatOptions,
    attribute: bool,
    counts: Counts,
    area: Canvas,
    samples: Canvas,
}

impl Drawing {
    /// Nothing is in it yet.
    pub fn new(view: &View, options: &SplatOptions) -> Drawing {
        let (width, height) = (view.width as usize, view.height as usize);
        Drawing {
            view: *view,
            options: *options,
            attribute: false,
            counts: Counts::default(),
            area: Canvas::new(width, height, false),
            samples: Canvas::new(width + 2 * HALO, height + 2 * HALO, false),
        }
    }

    /// Adds batches, one after the other.
    pub fn add(&mut self, batches: &[Splats<'_>]) {
        self.attribute |= batches.iter().any(|batch| batch.attribute().is_some());
        self.area.prepare(self.attribute);
        self.samples.prepare(self.attribute);
        let Drawing { view, options, counts, area, samples, .. } = self;
        let (kernel, lens) = (options.kernel, Lens::new(view));
        let line = LineTable::of(kernel);
        for batch in batches {
            for start in (0..batch.len()).step_by(BATCH) {
                let end = batch.len().min(start + BATCH);
                let mut footprints: Vec<Footprint> =
                    (start..end).into_par_iter().filter_map(|index| lens.footprint(batch, index, kernel)).collect();
                let all = footprints.len();
                footprints.retain(|footprint| lens.sees(footprint, HALO as f64));
                let seen = footprints.len();
                if options.faintest > 0.0 {
                    footprints.retain(|footprint| lens.presence(footprint, kernel) >= f64::from(options.faintest));
                }
                let drawn = footprints.len();
                *counts += Counts { drawn: drawn as u64, outside: (all - seen) as u64, faint: (seen - drawn) as u64 };
                let (large, small): (Vec<Footprint>, Vec<Footprint>) =
                    footprints.into_iter().partition(|footprint| footprint.radius >= SAMPLED_RADIUS);
                samples.bands(|mut band| large.iter().for_each(|footprint| sample(&lens, line, footprint, &mut band)));
                area.bands(|mut band| {
                    for footprint in &small {
                        area_means(&lens, kernel, footprint, Fineness::EXACT, &mut band);
                    }
                });
            }
        }
    }

    /// The picture.
    pub fn finish(self) -> (Accumulation, Counts) {
        let Drawing { view, attribute, counts, area, samples, .. } = self;
        let mut picture = Accumulation::new(view.width, view.height, attribute);
        picture.p = finish(&area.p, &samples.p, view.width as usize);
        picture.ps = finish(&area.ps, &samples.ps, view.width as usize);
        (picture, counts)
    }
}

/// Adds the exact integral of a splat that is too small to be sampled over each pixel of a band.
pub(super) fn area_means(lens: &Lens, kernel: Kernel, splat: &Footprint, fineness: Fineness, band: &mut Band<'_>) {
    let table = CumulativeTable::of(kernel);
    match splat.shape {
        Shape::Circle { center } => corners(table, splat, center, band),
        Shape::Ellipse(ellipse) => ellipse_area::add(table, splat, &ellipse, band),
        Shape::Ellipsoid(_) => {
            let far = lens.seen_from_far(*splat, kernel, FAR);
            match far.shape {
                Shape::Ellipse(ellipse) => ellipse_area::add(table, &far, &ellipse, band),
                _ => subsample(lens, LineTable::of(kernel), splat, fineness, band),
            }
        }
        Shape::Sphere { .. } => subsample(lens, LineTable::of(kernel), splat, fineness, band),
    }
}

/// Adds the area means of the samples to the area means that are there. Empty channels stay empty.
fn finish(area: &[f64], samples: &[f64], width: usize) -> Vec<f32> {
    let stride = width + 2 * HALO;
    let [center, near, far] = AREA_FILTER;
    let along_x = |row: &[f64]| -> Vec<f64> {
        row.windows(5).map(|w| center * w[2] + near * (w[1] + w[3]) + far * (w[0] + w[4])).collect()
    };
    area.par_chunks(width)
        .enumerate()
        .flat_map_iter(|(y, row)| {
            let rows: Vec<Vec<f64>> =
                (0..5).map(|j| along_x(&samples[(y + j) * stride..(y + j + 1) * stride])).collect();
            (0..width).map(move |x| {
                let column = |j: usize| rows[j][x];
                let mean = center * column(2) + near * (column(1) + column(3)) + far * (column(0) + column(4));
                (row[x] + mean) as f32
            })
        })
        .collect()
}

/// The cells of `[from, to]` (cell units) among `count` cells from `first` on, relative to `first`.
pub(super) fn cells(from: f64, to: f64, first: i64, count: usize) -> std::ops::Range<usize> {
    // Casts saturate, so that infinite bounds become the whole range.
    let clip = |cell: i64| cell.saturating_sub(first).clamp(0, count as i64) as usize;
    clip(from.floor() as i64)..clip((to.ceil() as i64).max(from.floor() as i64))
}

/// Samples a large footprint at the pixel centres of a band of the canvas with its halo.
fn sample(lens: &Lens, line: &LineTable, splat: &Footprint, band: &mut Band<'_>) {
    let origin = band.first as i64 - HALO as i64;
    for j in cells(splat.min[1], splat.max[1], origin, band.rows()) {
        let row = lens.row(splat, (origin + j as i64) as f64 + 0.5);
        let [left, right] = row.section();
        if left > right {
            continue;
        }
        for i in cells(left, right, -(HALO as i64), band.stride) {
            let f = lens.line(line, &row, i as f64 - HALO as f64 + 0.5);
            band.add(j, i, splat, f);
        }
    }
}

/// Adds the exact integral of a circle over each pixel of a band.
fn corners(table: &CumulativeTable, splat: &Footprint, center: [f64; 2], band: &mut Band<'_>) {
    let first = band.first;
    let columns = cells(splat.min[0], splat.max[0], 0, band.stride);
    let rows = cells(splat.min[1], splat.max[1], first as i64, band.rows());
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    let unit = |cell: usize, axis: usize| (cell as f64 - center[axis]) / splat.radius;
    // The integral over a square of pixels is in units of h^2: radius^2 pixels.
    let area = splat.radius * splat.radius;
    let edge = |y: f64| -> Vec<f64> { (columns.start..=columns.end).map(|i| table.at(unit(i, 0), y)).collect() };
    let mut above = edge(unit(first + rows.start, 1));
    for j in rows {
        let below = edge(unit(first + j + 1, 1));
        for (k, i) in columns.clone().enumerate() {
            let share = area * ((below[k + 1] - below[k]) - (above[k + 1] - above[k]));
            band.add(j, i, splat, share);
        }
        above = below;
    }
}

/// Adds the means of a fine grid of samples over each pixel of a band of a picture.
fn subsample(lens: &Lens, line: &LineTable, splat: &Footprint, fineness: Fineness, band: &mut Band<'_>) {
    let (stride, first) = (band.stride, band.first);
    let mut splat = *splat;
    let long = (0..2).map(|k| splat.max[k] - splat.min[k]).fold(1.0, f64::max);
    let finest = if long.is_finite() { fineness.finest.min(fineness.longest - long.log2()) } else { fineness.endless };
    let power = (fineness.radius / splat.radius).log2().ceil().min(finest).max(1.0) as u32;
    let fine = f64::from(1u32 << power);
    let smallest = fineness.radius / fine;
    splat.grow_to(smallest, lens.focal());
    // What a sample gives to the pixel before its own, its own, and the one after, by its place within the pixel.
    let count = 1usize << power;
    let share = |place: usize| -> [f64; 3] {
        let mut shares = [0.0; 3];
        for (tap, offset) in (-2i64..=2).enumerate() {
            let target = (place as i64 + offset).div_euclid(count as i64) + 1;
            shares[target as usize] += AREA_FILTER[tap.abs_diff(2)] / fine;
        }
        shares
    };
    let rows = band.rows();
    // Samples from the pixel before the band to the pixel after it, since samples give to their neighbours.
    let columns = cells(splat.min[0] * fine, splat.max[0] * fine, -(count as i64), (stride + 2) * count);
    let first_pixel = columns.start / count;
    // Sums over one row of samples for each pixel, from the one before `first_pixel` on.
    let mut sums = vec![0.0; columns.end / count + 3 - first_pixel];
    for j in cells(splat.min[1] * fine, splat.max[1] * fine, (first as i64 - 1) * count as i64, (rows + 2) * count) {
        let row = lens.row(&splat, first as f64 - 1.0 + (j as f64 + 0.5) / fine);
        let [left, right] = row.section();
        if left > right {
            continue;
        }
        let section = cells(left * fine, right * fine, -(count as i64), (stride + 2) * count);
        let columns = section.start.max(columns.start)..section.end.min(columns.end);
        if columns.is_empty() {
            continue;
        }
        // The pixels that they give to, counted as in `sums`.
        let given = columns.start / count - first_pixel..columns.end / count + 3 - first_pixel;
        sums[given.clone()].fill(0.0);
        for i in columns {
            let f = lens.line(line, &row, (i as f64 + 0.5) / fine - 1.0);
            let (pixel, place) = (i / count - first_pixel, i % count);
            if place >= 2 && place + 2 < count {
                sums[pixel + 1] += f / fine;
                continue;
            }
            for (sum, share) in sums[pixel..].iter_mut().zip(share(place)) {
                *sum += share * f;
            }
        }
        for (dy, share) in share(j % count).into_iter().enumerate() {
            let y = (j / count + dy).wrapping_sub(2);
            if share == 0.0 || y >= rows {
                continue;
            }
            for k in given.clone() {
                let x = (first_pixel + k).wrapping_sub(2);
                if x < stride {
                    band.add(y, x, &splat, share * sums[k]);
                }
            }
        }
    }
}
