//! The fast path: splats sorted by tile, drawn in SIMD lanes into the levels of the image pyramid.
//!
//! The division of work depends on the particles alone and sums are added in a fixed order, so the picture is the same
//! for any number of threads, and however many of the batches are given at a time.

use super::exact::{self, AREA_FILTER, Fineness};
use super::footprint::{Footprint, Lens};
use super::lanes::{self, Canvas};
use super::profile::{Profile, Profiles};
use super::pyramid::{self, LevelImage, PADDING};
use super::table::LineTable;
use super::tiles::{self, Layer, Piece, Record, SIDE, STRIDE, Sorted, Sorting};
use super::{Counts, Extent, SplatOptions, Splats};
use super::{ellipse_rows, small, sphere};
use crate::color::accumulation::Accumulation;
use crate::model::Kernel;
use crate::view::{Projection, View};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Particles sorted at a time by one task.
const CHUNK: usize = 1 << 13;
/// Particles between two rounds of drawing; bounds the memory for sorted particles.
const ROUND: usize = 1 << 21;
/// Bytes of the particles of a round, sorted: most are one circle, and none more than two.
pub(super) const SORTED_BYTES: u64 = (ROUND * 2 * size_of::<Record>()) as u64;
/// Splats of a tile drawn by one task; more are divided among several.
const JOB: usize = 1 << 15;

/// The two channels of a tile, empty until something is drawn into it.
#[derive(Clone, Debug, Default)]
struct Tile {
    p: Vec<f32>,
    ps: Vec<f32>,
}

impl Tile {
    /// Makes sure that the buffers are there.
    fn prepare(&mut self, attribute: bool) {
        if self.p.is_empty() {
            self.p = vec![0.0; SIDE * STRIDE];
        }
        if attribute && self.ps.is_empty() {
            self.ps = vec![0.0; SIDE * STRIDE];
        }
    }
}

/// A picture that batches are added to.
pub struct Drawing {
    view: View,
    options: SplatOptions,
    lens: Lens,
    layers: Vec<Layer>,
    profiles: &'static Profiles,
    attribute: bool,
    counts: Counts,
    tiles: Vec<Tile>,
    wide: Vec<(usize, Footprint)>,
    round: Round,
}

/// What has been sorted since tiles were drawn into last.
struct Round {
    /// What the splats look like; `None` before the first.
    shapes: Option<Shapes>,
    /// By tasks that are complete.
    sorted: Vec<Sorted>,
    /// The task that is not.
    open: Option<Sorting>,
    /// Particles of the last task, and of all.
    in_task: usize,
    particles: usize,
}

impl Round {
    /// Without a task.
    fn new(shapes: Option<Shapes>) -> Round {
        Round { shapes, sorted: Vec::new(), open: None, in_task: CHUNK, particles: 0 }
    }
}

impl Drawing {
    /// Nothing is in it yet.
    pub fn new(view: &View, options: &SplatOptions) -> Drawing {
        let layers = tiles::layers(view);
        let count = layers.last().map_or(0, |layer| layer.first + layer.tiles[0] * layer.tiles[1]);
        Drawing {
            view: *view,
            options: *options,
            lens: Lens::new(view),
            layers,
            profiles: Profiles::of(options.kernel),
            attribute: false,
            counts: Counts::default(),
            tiles: vec![Tile::default(); count],
            wide: Vec::new(),
            round: Round::new(None),
        }
    }

    /// Adds batches. They are cut into tasks of [`CHUNK`] particles and those into rounds of [`ROUND`], whatever batches are added
    /// together. Small batches share a task: a page file's view may have thousands of nodes, of which a sample keeps a few particles each.
    pub fn add(&mut self, batches: &[Splats<'_>]) {
        self.attribute |= batches.iter().any(|batch| batch.attribute().is_some());
        let mut tasks: Vec<(Sorting, Vec<Piece<'_>>)> = Vec::new();
        tasks.extend(self.round.open.take().map(|open| (open, Vec::new())));
        for batch in batches {
            let shapes = self.shapes_of(batch);
            let mut start = 0;
            while start < batch.len() {
                if self.round.particles >= ROUND || self.round.shapes != Some(shapes) {
                    self.sort(std::mem::take(&mut tasks));
                    self.end_round();
                    self.round = Round::new(Some(shapes));
                }
                if self.round.in_task >= CHUNK {
                    tasks.push((Sorting::new(&self.layers), Vec::new()));
                    self.round.in_task = 0;
                }
                let taken = (batch.len() - start).min(CHUNK - self.round.in_task);
                if let Some((_, task)) = tasks.last_mut() {
                    task.push((batch, start..start + taken));
                }
                start += taken;
                self.round.in_task += taken;
                self.round.particles += taken;
            }
        }
        self.sort(tasks);
    }

    fn shapes_of(&self, batch: &Splats<'_>) -> Shapes {
        match (batch.extent(), self.view.projection) {
            (Extent::Ellipsoids(_), _) => Shapes::Ellipses,
            (Extent::World(_), Projection::Perspective { .. }) => Shapes::Spheres,
            _ => Shapes::Circles,
        }
    }

    /// Does tasks; the last one stays open unless it has all the particles that a task may have.
    fn sort(&mut self, mut tasks: Vec<(Sorting, Vec<Piece<'_>>)>) {
        let last = if self.round.in_task < CHUNK { tasks.pop() } else { None };
        let (lens, layers, options) = (&self.lens, &self.layers[..], &self.options);
        let profiles = self.profiles;
        let with = |sorting: Sorting, pieces: &[Piece<'_>]| sorting.with(lens, profiles, layers, pieces, options);
        let complete = || -> Vec<Sorted> {
            tasks.into_par_iter().map(|(sorting, pieces)| with(sorting, &pieces).sorted()).collect()
        };
        let (complete, open) = rayon::join(complete, || last.map(|(sorting, pieces)| with(sorting, &pieces)));
        self.round.sorted.extend(complete);
        self.round.open = open;
    }

    /// Draws what has been sorted into its tiles.
    fn end_round(&mut self) {
        let Drawing { options, lens, layers, profiles, attribute, counts, tiles: drawn, wide, round, .. } = self;
        let (profiles, kernel, attribute) = (*profiles, options.kernel, *attribute);
        let Round { shapes: Some(shapes), mut sorted, open, .. } = std::mem::replace(round, Round::new(None)) else {
            return;
        };
        sorted.extend(open.map(Sorting::sorted));
        wide.extend(sorted.iter().flat_map(|chunk| &chunk.wide));
        sorted.iter().for_each(|chunk| *counts += chunk.counts);
        let arch = Arch::new();
        let lens = &*lens;
        layers.iter().enumerate().for_each(|(number, layer)| {
            let tiles = layer.first..layer.first + layer.tiles[0] * layer.tiles[1];
            let paint = |tile: usize, records: &[&[Record]], out: &mut Tile| {
                out.prepare(attribute);
                let small = number == 0;
                arch.dispatch(Job { lens, layer, profiles, kernel, small, shapes, tile, records, out });
            };
            drawn[tiles.clone()].par_iter_mut().zip(tiles.clone()).for_each(|(out, tile)| {
                draw_tile(&sorted, tile, out, |records, out| paint(tile, records, out));
                let splats: Vec<&Footprint> = sorted.iter().flat_map(|chunk| chunk.near(tile)).collect();
                if !splats.is_empty() {
                    out.prepare(attribute);
                    arch.dispatch(Near { lens, layer, profile: &profiles.sampled, tile, splats: &splats, out });
                }
            });
            if !options.culling {
                sorted.par_iter().for_each(|chunk| {
                    let mut nowhere = Tile::default();
                    let outside = chunk.outside.iter().filter(|(tile, _)| tiles.contains(tile));
                    outside.for_each(|(tile, record)| paint(*tile, &[std::slice::from_ref(record)], &mut nowhere));
                });
            }
        });
    }

    /// The picture.
    pub fn finish(mut self) -> (Accumulation, Counts) {
        self.end_round();
        let Drawing { view, options, lens, layers, attribute, counts, tiles, wide, .. } = self;
        (finish(&view, &lens, options.kernel, &layers, &tiles, &wide, attribute), counts)
    }
}

/// What the splats of a batch look like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shapes {
    /// Circles alone.
    Circles,
    /// Projected spheres, and circles where they are small.
    Spheres,
    /// Ellipses, and what those are that are round.
    Ellipses,
}

/// Draws a tile's records, in several tasks when there are many.
fn draw_tile(sorted: &[Sorted], tile: usize, out: &mut Tile, paint: impl Fn(&[&[Record]], &mut Tile) + Sync) {
    let mut jobs: Vec<Vec<&[Record]>> = Vec::new();
    let mut held = JOB;
    for records in sorted.iter().map(|chunk| chunk.of(tile)).filter(|records| !records.is_empty()) {
        if held >= JOB {
            jobs.push(Vec::new());
            held = 0;
        }
        held += records.len();
        if let Some(job) = jobs.last_mut() {
            job.push(records);
        }
    }
    let Some((first, others)) = jobs.split_first() else { return };
    let parts = || {
        let parts = others.par_iter().map(|job| {
            let mut part = Tile::default();
            paint(job, &mut part);
            part
        });
        parts.collect::<Vec<Tile>>()
    };
    let ((), parts) = rayon::join(|| paint(first, out), parts);
    for part in parts {
        for (sum, value) in out.p.iter_mut().zip(part.p).chain(out.ps.iter_mut().zip(part.ps)) {
            *sum += value;
        }
    }
}

/// The records of one tile on their way into its buffers.
struct Job<'a> {
    lens: &'a Lens,
    layer: &'a Layer,
    profiles: &'a Profiles,
    kernel: Kernel,
    small: bool,
    shapes: Shapes,
    tile: usize,
    records: &'a [&'a [Record]],
    out: &'a mut Tile,
}

impl WithSimd for Job<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Job { lens, layer, profiles, kernel, small, shapes, tile, records, out } = self;
        let mut canvas = Canvas { stride: STRIDE, columns: SIDE, rows: SIDE, p: &mut out.p, ps: &mut out.ps };
        let records = records.iter().copied().flatten();
        let corner = layer.corner_of(tile);
        if small {
            let (table, strips) = (small::CornerTable::of(kernel), ellipse_rows::StripKernel::of(kernel));
            for record in records {
                match record.ellipse() {
                    Some(ellipse) => ellipse_rows::add(simd, &mut canvas, strips, &ellipse),
                    None => small::draw(simd, &mut canvas, lens, profiles, table, corner, record),
                }
            }
            return;
        }
        match shapes {
            Shapes::Circles => {
                lanes::uniform_circles(simd, &mut canvas, &profiles.sampled, records.map(Record::circle))
            }
            Shapes::Spheres => {
                for record in records {
                    sphere::sampled(simd, &mut canvas, lens, corner, layer.cell, &profiles.sampled, record);
                }
            }
            Shapes::Ellipses => {
                for record in records {
                    let profile = &profiles.sampled;
                    if let Some(ellipse) = record.ellipse() {
                        lanes::sampled_ellipse(simd, &mut canvas, profile, &ellipse);
                    } else if record.is_sphere() {
                        sphere::sampled(simd, &mut canvas, lens, corner, layer.cell, profile, record);
                    } else {
                        lanes::uniform_circles(simd, &mut canvas, profile, std::iter::once(record.circle()));
                    }
                }
            }
        }
    }
}

/// The ellipsoids nearby of one tile on their way into its buffers.
struct Near<'a> {
    lens: &'a Lens,
    layer: &'a Layer,
    profile: &'a Profile,
    tile: usize,
    splats: &'a [&'a Footprint],
    out: &'a mut Tile,
}

impl WithSimd for Near<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Near { lens, layer, profile, tile, splats, out } = self;
        let mut canvas = Canvas { stride: STRIDE, columns: SIDE, rows: SIDE, p: &mut out.p, ps: &mut out.ps };
        let corner = layer.corner_of(tile);
        for splat in splats {
            let amplitudes = [splat.amplitude as f32, splat.amplitude_s as f32];
            sphere::sampled_footprint(simd, &mut canvas, lens, corner, layer.cell, profile, splat, amplitudes);
        }
    }
}

/// Adds up tiles, wide splats and levels to the picture.
fn finish(
    view: &View,
    lens: &Lens,
    kernel: Kernel,
    layers: &[Layer],
    drawn: &[Tile],
    wide: &[(usize, Footprint)],
    attribute: bool,
) -> Accumulation {
    let width = view.width as usize;
    let mut picture = Accumulation::new(view.width, view.height, false);
    picture.p = channel(layers, wide, lens, kernel, |footprint| footprint.amplitude, |tile| &drawn[tile].p);
    if attribute {
        picture.ps = channel(layers, wide, lens, kernel, |footprint| footprint.amplitude_s, |tile| &drawn[tile].ps);
    }
    // Small in one direction, but long in the other: spheres at steep angles, and ellipsoids nearby.
    let long: Vec<&Footprint> = wide.iter().filter(|(layer, _)| *layer == 0).map(|(_, footprint)| footprint).collect();
    if !long.is_empty() {
        let mut canvas = exact::Canvas::new(width, view.height as usize, attribute);
        canvas.bands(|mut band| {
            long.iter().for_each(|footprint| exact::area_means(lens, kernel, footprint, Fineness::FAST, &mut band))
        });
        for (sum, value) in picture.p.iter_mut().zip(canvas.p).chain(picture.ps.iter_mut().zip(canvas.ps)) {
            *sum += value as f32;
        }
    }
    picture
}

/// One channel of the picture.
fn channel<'a>(
    layers: &[Layer],
    wide: &[(usize, Footprint)],
    lens: &Lens,
    kernel: Kernel,
    amplitude: impl Fn(&Footprint) -> f64 + Sync,
    tile: impl Fn(usize) -> &'a [f32] + Sync,
) -> Vec<f32> {
    let mut sum: Option<LevelImage> = None;
    for (number, layer) in layers.iter().enumerate().skip(1).rev() {
        let mut image = layer.gather(&tile);
        add_wide(&mut image, layer, wide.iter().filter(|(of, _)| *of == number), lens, kernel, &amplitude);
        if let Some(coarser) = sum {
            pyramid::add_upsampled(&coarser, &mut image);
        }
        sum = Some(image);
    }
    let small = layers[0].gather(&tile);
    match sum {
        Some(samples) => add_area_means(small, &samples),
        None => small.samples,
    }
}

/// Samples splats that reach beyond a tile, in double precision, row by row.
fn add_wide<'a>(
    image: &mut LevelImage,
    layer: &Layer,
    wide: impl Iterator<Item = &'a (usize, Footprint)>,
    lens: &Lens,
    kernel: Kernel,
    amplitude: impl Fn(&Footprint) -> f64 + Sync,
) {
    let wide: Vec<&Footprint> = wide.map(|(_, footprint)| footprint).collect();
    if wide.is_empty() {
        return;
    }
    let line = LineTable::of(kernel);
    let pixel = |cell: usize| (cell as f64 + 0.5 - layer.padding as f64) * layer.cell;
    image.samples.par_chunks_mut(image.stride).enumerate().for_each(|(j, out)| {
        let y = pixel(j);
        for footprint in wide.iter().filter(|footprint| footprint.min[1] <= y && y <= footprint.max[1]) {
            let row = lens.row(footprint, y);
            let amplitude = amplitude(footprint);
            // Casts saturate; pixels beyond the section are zero.
            let cell = |x: f64| (x / layer.cell + layer.padding as f64).clamp(0.0, out.len() as f64) as usize;
            let [first, last] = row.section().map(cell);
            for i in first..(last + 1).min(out.len()) {
                out[i] += (amplitude * lens.line(line, &row, pixel(i))) as f32;
            }
        }
    });
}

/// Turns the samples of level 0 into area means and adds them to the small splats' means.
fn add_area_means(small: LevelImage, samples: &LevelImage) -> Vec<f32> {
    let [center, near, far] = AREA_FILTER.map(|tap| tap as f32);
    let stride = samples.stride;
    let width = small.stride;
    let mut out = small.samples;
    out.par_chunks_mut(width).enumerate().for_each_init(
        || vec![0.0f32; width + 4],
        |column, (y, out)| {
            let row = |dy: usize| {
                let start = (y + PADDING + dy - 2) * stride + PADDING - 2;
                &samples.samples[start..start + width + 4]
            };
            let rows: [&[f32]; 5] = std::array::from_fn(row);
            for (i, column) in column.iter_mut().enumerate() {
                *column = center * rows[2][i] + near * (rows[1][i] + rows[3][i]) + far * (rows[0][i] + rows[4][i]);
            }
            for (out, w) in out.iter_mut().zip(column.windows(5)) {
                *out += center * w[2] + near * (w[1] + w[3]) + far * (w[0] + w[4]);
            }
        },
    );
    out
}
