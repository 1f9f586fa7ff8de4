//! `deepfield bench published`: the method of Hopf and Ertl, Hierarchical Splatting of Scattered Data (HE03), as they published it, and its
//! tables beside theirs.
//!
//! The levels are made by [`crate::hierarchy::pca`]: splits by distortion, centroids, equations 1 and 2 ([`levels`]). Points are kept
//! relative to their clusters ([`relative`]) and chosen by figure 5 ([`traversal`]); the processor adds them up, where equation 3 is what
//! means over a pixel's area are, or sorts and blends them ([`pictures`]).

mod levels;
mod paper;
mod pictures;
mod relative;
mod report;
mod traversal;

use super::Arguments;
use super::paged::Paged;
use super::processor_time::processor_time;
use super::splat::Failure;
use crate::build::{BuildOptions, build};
use crate::color::Accumulation;
use crate::color::splat_colors::SplatColors;
use crate::color::transfer::TransferFunction;
use crate::command_line::arguments::{count, not_negative};
use crate::command_line::progress_bar::Terminal;
use crate::cpu::over::Order;
use crate::cpu::{Extent, Positions, SplatOptions, Splats, draw};
use crate::hierarchy::Kinds;
use crate::hierarchy::pca::members::DiameterRule;
use crate::look::{DataKind, LookPatch, Member};
use crate::mode::{LevelChoice, Levels, Plan};
use crate::model::{Bounds, Dataset, Kernel};
use crate::modes::column_density;
use crate::picture::source::{Wanted, particles};
use crate::synth::cosmology::{Cosmology, DEFAULT_EDGE};
use crate::synth::dataset;
use crate::view::View;
use levels::{Level, LevelOptions, members};
use pictures::{Look, choose};
use rayon::prelude::*;
use relative::Relative;
use report::{Adaptive, LevelRow, Ours, Report, Sorted, Took, ViewportRow, Whole};
use std::path::Path;
use std::time::Instant;
use traversal::Depth;

/// Pixels along an edge of the pictures of levels.
const EDGE: u32 = 500;
/// Sizes of the adaptive pictures.
const VIEWPORTS: [u32; 5] = [160, 400, EDGE, 700, 1000];
/// Vertical field of view, degrees.
const FIELD: f64 = 40.0;

/// What is measured.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "bench-published")]
#[command(next_help_heading = "Options of `bench published`")]
pub struct Options {
    /// Number of particles of the generated cosmology.
    #[arg(short = 'n', long = "particles", value_name = "N", value_parser = count, default_value = "16800000")]
    pub particles: u64,
    /// Mean projected diameter that particles are given in the picture of 500x500, pixels; 0: as the data has them.
    #[arg(long, value_name = "PIXELS", default_value_t = paper::LEVELS[0].pixels, value_parser = not_negative)]
    pub point_size: f64,
    /// A cluster is descended into if one of its points is wider than this, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 2.0, value_parser = not_negative)]
    pub threshold: f64,
    /// How equation 2 is read: over an average of the members, as the text has it, or as it is printed.
    #[arg(long, value_name = "HOW", default_value = "averaged", value_parser = ["averaged", "printed"])]
    pub diameters: String,
}

/// Measures and prints tables to standard error.
///
/// # Errors
/// When data cannot be read or built, or a file cannot be written.
pub fn measure(arguments: &Arguments) -> Result<Report, Failure> {
    let report = Bench::new(arguments)?.run()?;
    if let Some(path) = &arguments.csv {
        report.write_csv(path)?;
    }
    Ok(report)
}

/// What is measured.
struct Bench<'a> {
    arguments: &'a Arguments,
    report: Report,
    bounds: Bounds,
    kernel: Kernel,
    /// Structures for `delta_n` 1 and 2.
    structures: [Relative; 2],
    /// Mean projected diameters of the levels, the coarsest first.
    pixels: Vec<f64>,
    /// All particles as they are, by size of the picture.
    exact: Vec<Accumulation>,
    /// Mean mass of a particle.
    mean_mass: f64,
    ours: Paged,
    _folder: tempfile::TempDir,
}

impl<'a> Bench<'a> {
    fn new(arguments: &'a Arguments) -> Result<Bench<'a>, Failure> {
        let options = &arguments.published;
        let (named, mut dataset) = data(arguments)?;
        let bounds = dataset.families.iter().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds()));
        if bounds.is_empty() {
            return Err(format!("{named}: no particles").into());
        }
        let view = view(bounds, EDGE)?;
        let kernel = dataset.kernel;
        resize(&mut dataset, &view, options.point_size);
        let rule = if options.diameters == "printed" { DiameterRule::Printed } else { DiameterRule::Averaged };
        let start = Instant::now();
        let level_options = LevelOptions { rule, ..LevelOptions::default() };
        let levels = levels::levels(members(&dataset), &level_options);
        let structures = [1, 2].map(|delta| Relative::new(&levels, delta));
        let build_s = start.elapsed().as_secs_f64();
        let finest = levels.last().ok_or("no levels")?;
        let particles = finest.len() as u64;
        let mean_mass = finest.mass.iter().sum::<f64>() / finest.len() as f64;
        let pixels = levels.iter().map(|level| mean_pixels(&view, level)).collect();
        let exact: Result<Vec<Accumulation>, Failure> =
            VIEWPORTS.iter().map(|&edge| all(&self::view(bounds, edge)?, finest, kernel)).collect();
        let exact = exact?;
        drop(levels);
        let folder = tempfile::tempdir()?;
        let start = Instant::now();
        let ours = ours(dataset, arguments, folder.path())?;
        let report = Report {
            source: named,
            particles,
            cluster_size: level_options.cluster_size,
            point_size: options.point_size,
            threshold: options.threshold,
            diameters: options.diameters.clone(),
            threads: rayon::current_num_threads(),
            build_s,
            bytes_per_particle: [0, 1].map(|k| structures[k].bytes() as f64 / particles as f64),
            bytes_per_particle_paper: paper::BYTES_PER_PARTICLE,
            ours_build_s: start.elapsed().as_secs_f64(),
            ours_bytes_per_particle: ours.file.bytes() as f64 / particles as f64,
            levels: Vec::new(),
            viewports: Vec::new(),
        };
        Ok(Bench { arguments, report, bounds, kernel, structures, pixels, exact, mean_mass, ours, _folder: folder })
    }

    fn run(mut self) -> Result<Report, Failure> {
        let finest = self.structures[0].finest();
        let view = view(self.bounds, EDGE)?;
        self.report.print_head();
        // Level 1 is above what a cluster of everything draws with `delta_n` 2.
        for level in (finest.min(2)..=finest).rev() {
            let row = self.level(&view, level)?;
            row.print();
            self.report.levels.push(row);
        }
        for (number, edge) in VIEWPORTS.into_iter().enumerate() {
            let view = self::view(self.bounds, edge)?;
            let depth = Depth { threshold: self.arguments.published.threshold, level: finest };
            let exact = self.exact[number].clone();
            let (adaptive, by_level) = self.added(0, &view, depth, &exact)?;
            let ours = self.ours(&view, adaptive.points, &exact)?;
            let paper = paper::VIEWPORTS.into_iter().find(|paper| paper.edge == edge);
            let row = ViewportRow { edge, adaptive, by_level, ours, paper };
            row.print();
            self.report.viewports.push(row);
        }
        Ok(self.report)
    }

    /// A level as the finest that is drawn.
    fn level(&mut self, view: &View, level: usize) -> Result<LevelRow, Failure> {
        let finest = self.structures[0].finest();
        let threshold = self.arguments.published.threshold;
        let exact = self.exact[VIEWPORTS.iter().position(|edge| *edge == EDGE).unwrap_or(0)].clone();
        let transfer = TransferFunction::preset(column_density::MODE.transfer[0]).unwrap_or_default();
        let colors = SplatColors::new(&transfer, transfer.levels(&exact));
        let whole = Depth { threshold: 0.0, level };
        let near = Depth { threshold, level };
        let (all_by_one, _) = self.added(0, view, whole, &exact)?;
        let (all, _) = self.added(1, view, whole, &exact)?;
        let adaptive = [self.added(0, view, near, &exact)?.0, self.added(1, view, near, &exact)?.0];
        let over = |structure: usize, depth: Depth, order: Order| {
            let look = Look { order, colors: &colors, particle: self.mean_mass };
            self.blended(structure, view, depth, look)
        };
        let sorted = Sorted {
            exact: over(1, whole, Order::Exact)?,
            buckets: over(1, whole, Order::Buckets)?,
            coarse_buckets: over(1, whole, Order::CoarseBuckets)?,
            adaptive: [over(0, near, Order::CoarseBuckets)?, over(1, near, Order::CoarseBuckets)?],
        };
        Ok(LevelRow {
            level,
            points: all.points,
            pixels: self.pixels[level - 1],
            whole: Whole { ms: [all_by_one.ms, all.ms], choose_ms: all.choose_ms, error_l2: all.error_l2 },
            ours: self.ours(view, all.points, &exact)?,
            ours_adaptive: self.ours(view, adaptive[0].points, &exact)?,
            adaptive,
            sorted,
            // Counted from the particles' level, which is the sixth in the paper.
            paper: paper::LEVELS.get(finest - level).copied(),
        })
    }

    /// Chooses, decodes and adds up points, several times; with the points of each level.
    fn added(
        &self,
        structure: usize,
        view: &View,
        depth: Depth,
        exact: &Accumulation,
    ) -> Result<(Adaptive, Vec<u64>), Failure> {
        let (mut choosing, mut last) = (Vec::new(), None);
        let ms = self.timed(|| {
            let start = Instant::now();
            let chosen = choose(&self.structures[structure], view, depth);
            choosing.push(1e3 * start.elapsed().as_secs_f64());
            last = Some((chosen.sums(view, self.kernel)?, chosen.points));
            Ok(())
        })?;
        let (sums, by_level) = last.ok_or("--repeat: nothing was drawn")?;
        let (points, error_l2) = (by_level.iter().sum(), sums.error_against(exact).1);
        Ok((Adaptive { ms, choose_ms: median(choosing), points, error_l2 }, by_level))
    }

    /// Chooses, decodes, sorts and blends points, several times.
    fn blended(&self, structure: usize, view: &View, depth: Depth, look: Look<'_>) -> Result<Took, Failure> {
        self.timed(|| {
            choose(&self.structures[structure], view, depth).over(view, self.kernel, &look)?;
            Ok(())
        })
    }

    fn timed(&self, mut run: impl FnMut() -> Result<(), Failure>) -> Result<Took, Failure> {
        let (mut times, mut processor) = (Vec::new(), Vec::new());
        for _ in 0..self.arguments.repeat {
            let (start, before) = (Instant::now(), processor_time());
            run()?;
            times.push(1e3 * start.elapsed().as_secs_f64());
            let spent = before.zip(processor_time()).map(|(before, after)| after.saturating_sub(before));
            processor.extend(spent.map(|spent| 1e3 * spent.as_secs_f64()));
        }
        let fastest = times.iter().copied().fold(f64::INFINITY, f64::min);
        let processor = (!processor.is_empty()).then(|| median(processor));
        Ok(Took { median: median(times), fastest, processor })
    }

    /// As many of our clusters, drawn once: here it is their error that counts.
    fn ours(&mut self, view: &View, splats: u64, exact: &Accumulation) -> Result<Ours, Failure> {
        let choice = LevelChoice { levels: Levels::Clusters, splats: Some(splats), ..LevelChoice::default() };
        let drawn = self.ours.draw(choice, view, 0.8, Plan::default(), 1)?;
        let ms = median(drawn.times.iter().map(|time| 1e3 * time.as_secs_f64()).collect());
        Ok(Ours { splats: drawn.splats, ms, error_l2: drawn.sums.error_against(exact).1 })
    }
}

/// The middle one; 0 for none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// What is drawn, and what it is called.
fn data(arguments: &Arguments) -> Result<(String, Dataset), Failure> {
    match &arguments.path {
        Some(path) => {
            if !matches!(DataKind::of(path)?, DataKind::Source) {
                return Err(format!("{}: bench published: expected a source of particles", path.display()).into());
            }
            let wanted = Wanted::of([&LookPatch::default()], None);
            Ok((path.display().to_string(), particles(&[Member::new(path)], &wanted, &Terminal)?.1))
        }
        None => {
            let count = arguments.published.particles;
            let universe = Cosmology::new(arguments.seed, count, DEFAULT_EDGE, &());
            Ok((format!("synth cosmology -n {count}"), dataset(&universe)))
        }
    }
}

/// The whole box in perspective.
fn view(bounds: Bounds, edge: u32) -> Result<View, Failure> {
    Ok(View::around(bounds, FIELD.to_radians(), edge, edge)?)
}

/// Gives particles a mean projected diameter in a view, which is all that the paper tells of its sizes; 0 leaves them as they are.
fn resize(dataset: &mut Dataset, view: &View, pixels: f64) {
    if pixels == 0.0 {
        return;
    }
    let (mut sum, mut count) = (0.0, 0);
    for family in &dataset.families {
        let widths = family.positions.par_iter().zip(&family.smoothing_length);
        sum += widths.map(|(place, h)| projected(view, *place, 2.0 * f64::from(*h))).sum::<f64>();
        count += family.len();
    }
    let scale = pixels * count as f64 / sum;
    if scale.is_finite() {
        let lengths = dataset.families.iter_mut().flat_map(|family| &mut family.smoothing_length);
        lengths.for_each(|h| *h = (scale * f64::from(*h)) as f32);
    }
}

/// Mean projected diameter of the points of a level, pixels.
fn mean_pixels(view: &View, level: &Level) -> f64 {
    let widths = level.places.par_iter().zip(&level.diameters);
    widths.map(|(place, diameter)| projected(view, *place, *diameter)).sum::<f64>() / level.len() as f64
}

/// How many pixels a length takes at a place.
fn projected(view: &View, place: [f64; 3], length: f64) -> f64 {
    length * view.focal_pixels() / view.to_camera(place.into()).z
}

/// The picture of all points of a level as they are.
fn all(view: &View, level: &Level, kernel: Kernel) -> Result<Accumulation, Failure> {
    let radii: Vec<f32> = level.diameters.iter().map(|diameter| (0.5 * diameter) as f32).collect();
    let weights: Vec<f32> = level.mass.iter().map(|mass| *mass as f32).collect();
    let batch = Splats::new(Positions::World(&level.places), Extent::World(&radii), &weights, None)?;
    Ok(draw(view, &[batch], &SplatOptions { kernel, ..SplatOptions::default() }))
}

/// A page file of the same particles with our clusters.
fn ours(dataset: Dataset, arguments: &Arguments, folder: &Path) -> Result<Paged, Failure> {
    let out = folder.join("published.df");
    let hierarchies = Kinds::of_particles();
    let options = BuildOptions { hierarchies, memory: arguments.memory, ..BuildOptions::default() };
    build(dataset, &options, &out, &())?;
    Paged::open(&out)
}

#[cfg(test)]
mod tests;
