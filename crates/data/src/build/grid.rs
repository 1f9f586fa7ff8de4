//! From an image or a volume to a file of it: its samples without loss, and the hierarchy of oriented points over them.
//!
//! Brick by brick: memory decides how many are built at once, and whether what all of them need is kept in memory or in a temporary file,
//! and the file is the same.

use super::grid_shelf::{GridShelf, ShelfError};
use super::memory::default_memory;
use super::{BuildError, pool};
use crate::hierarchy::wavelet::{Bricks, Fault, Feed, LevelKinds, Options, Part, Shape, Survey, shelf_len};
use crate::import::grid::{ChannelSummary, GridSummary};
use crate::import::{GridSource, ImportError, summarize_grid};
use crate::model::Region;
use crate::model::progress::Progress;
use crate::store::grid::{
    BrickCode, ChannelStatistics, GridAbout, GridFileWriter, LevelTypes, WaveletLevel, planes_of, rounded,
};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Bytes that a build of a brick takes for each sample of it and around it, beside the sample as it is stored, and for each channel.
const SAMPLE: u64 = 12;
const CHANNEL: u64 = 24;
/// Samples around a brick on each side that are read with it.
const AROUND: u64 = 20;
/// Memory of the program itself, bytes: code, and buffers of the threads.
const BASE: u64 = 24 << 20;
/// Bricks that are built at once for each thread, at most: so that none waits for the last.
const EACH_THREAD: u64 = 4;

/// How a file of a grid is built.
#[derive(Clone, Debug, Default)]
pub struct GridBuildOptions {
    /// How points are chosen.
    pub points: Options,
    /// Memory that the build may take, bytes; half of what is free where nothing is said.
    pub memory: Option<u64>,
    /// Threads; all where nothing is said. The file is the same for any number.
    pub threads: Option<usize>,
    /// Folder of temporary files; that of the output where nothing is said.
    pub temporary: Option<PathBuf>,
}

/// Builds the file of a grid.
///
/// # Errors
/// [`BuildError`] where the source cannot be read, the file not be written, or memory does not suffice for a single brick; nothing is left
/// behind then.
pub fn build_grid(
    source: &GridSource,
    options: &GridBuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<GridAbout, BuildError> {
    match options.threads {
        None => build_here(source, options, output, progress),
        Some(threads) => pool(threads)?.install(|| build_here(source, options, output, progress)),
    }
}

/// A source as a build reads it, asking before each part whether to go on.
struct Source<'a> {
    source: &'a GridSource,
    progress: &'a dyn Progress,
}

impl Source<'_> {
    fn bytes(&self, part: &Part) -> Result<Vec<u8>, ImportError> {
        self.progress.go_on();
        let grid = self.source.grid();
        let region = Region { min: part.min.map(|at| at as u64), max: part.end().map(|at| at as u64) };
        let mut bytes = vec![0; part.len() * grid.sample_bytes() as usize];
        self.source.read(&region, &mut bytes)?;
        Ok(bytes)
    }
}

impl Feed for Source<'_> {
    type Error = ImportError;

    fn dimensions(&self) -> usize {
        self.source.grid().dimensions
    }

    fn shape(&self) -> Shape {
        self.source.grid().shape.map(|side| side as usize)
    }

    fn channels(&self) -> usize {
        self.source.grid().channels.len()
    }

    fn may_have_holes(&self) -> bool {
        self.source.grid().sample_type.is_float()
    }

    fn read(&self, part: &Part) -> Result<Vec<Vec<f32>>, ImportError> {
        let grid = self.source.grid();
        Ok(planes_of(grid.sample_type, grid.channels.len(), &self.bytes(part)?))
    }
}

/// How much of what a build may take.
struct Plan {
    /// Whether what is known of nodes stays in memory.
    in_memory: bool,
    /// Bricks that are built at once.
    at_once: usize,
}

impl Plan {
    /// For a shelf of so many numbers.
    fn new(source: &GridSource, bricks: Bricks, numbers: u64, allowed: u64, output: &Path) -> Result<Plan, BuildError> {
        let grid = source.grid();
        let channels = grid.channels.len() as u64;
        let shelf = 4 * numbers;
        let around: u64 = bricks
            .part(0, 0)
            .shape
            .iter()
            .zip(grid.shape)
            .map(|(&side, whole)| (side as u64 + 2 * AROUND).min(whole))
            .product();
        let brick = around * (grid.sample_bytes() + SAMPLE + CHANNEL * channels);
        if BASE.min(allowed / 4) + brick > allowed {
            return Err(BuildError::Memory {
                path: output.into(),
                what: format!("a brick of {}", grid.described()),
                needed: (BASE + brick).div_ceil(1 << 20),
                allowed,
            });
        }
        let left = allowed - BASE.min(allowed / 4);
        let in_memory = shelf <= left / 3;
        // A fifth is left to the allocator's gaps.
        let room = (left - if in_memory { shelf } else { 0 }) / 5 * 4;
        let most = EACH_THREAD * rayon::current_num_threads() as u64;
        Ok(Plan { in_memory, at_once: (room / brick).clamp(1, most) as usize })
    }
}

fn fault(fault: Fault<ImportError, ShelfError>) -> BuildError {
    match fault {
        Fault::Feed(error) => error.into(),
        Fault::Shelf(error) => error.into(),
    }
}

fn build_here(
    source: &GridSource,
    options: &GridBuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<GridAbout, BuildError> {
    let about = source.description();
    let grid = &about.grid;
    let feed = Source { source, progress };
    let bricks = Bricks { dimensions: feed.dimensions(), shape: feed.shape() };
    let numbers = shelf_len(bricks, grid.channels.len(), &options.points);
    let plan = Plan::new(source, bricks, numbers, options.memory.unwrap_or_else(default_memory), output)?;
    let mut writer = GridFileWriter::create(output, grid)?;
    progress.begin("reading", 2);
    let summary = summarize_grid(source)?;
    progress.advance(1);
    let shelf = GridShelf::new(output, options.temporary.as_deref(), numbers, plan.in_memory)?;
    let survey = Survey::new(&feed, &shelf, &options.points, plan.at_once).map_err(fault)?;
    progress.advance(1);
    let code = BrickCode::new(grid, survey.ranges(), survey.has_holes());
    let all: Vec<usize> = (0..bricks.len()).collect();
    let mut roots = Vec::with_capacity(all.len());
    let mut levels = vec![LevelKinds::default(); bricks.all_levels()];
    progress.begin("building", all.len() as u64);
    for some in all.chunks(plan.at_once) {
        let build = |&brick: &usize| {
            let (mut nodes, root) = survey.brick(brick).map_err(fault)?;
            rounded(&mut nodes, grid.sample_type);
            let coded = code.brick(brick, &nodes, &feed.bytes(&bricks.part(brick, 0))?);
            progress.advance(1);
            Ok((nodes.kinds(), coded, root))
        };
        let made: Result<Vec<_>, BuildError> = some.par_iter().map(build).collect();
        for (kinds, coded, root) in made? {
            levels.iter_mut().zip(&kinds).for_each(|(level, kinds)| *level += kinds);
            writer.brick(coded)?;
            roots.push(root);
        }
    }
    let mut top = survey.top(roots).map_err(fault)?;
    rounded(&mut top.nodes, grid.sample_type);
    levels.iter_mut().skip(bricks.levels()).zip(&top.nodes.kinds()).for_each(|(level, kinds)| *level += kinds);
    let mut notes = about.notes.clone();
    // Where nothing is below it, the file is the one without.
    let ignore_below = options.points.ignore_below.filter(|_| survey.has_holes());
    if let (Some(below), Some(channel)) = (ignore_below, grid.channels.first()) {
        let below = channel.scale.value(f64::from(below)) as f32;
        notes.push(format!("values below {below} count as air: no points stand for them"));
    }
    if top.is_noise {
        notes.push("nearly all points are leaves: samples that change like noise have no shorter form".into());
    }
    let built = GridAbout {
        source: about.path.clone(),
        format: about.format.clone(),
        source_bytes: about.bytes,
        notes,
        grid: grid.clone(),
        statistics: statistics(&summary),
        options: Options { ignore_below, ..options.points },
        ranges: survey.ranges().to_vec(),
        has_holes: survey.has_holes(),
        levels: levels.into_iter().enumerate().map(told).collect(),
    };
    progress.begin("writing", 1);
    writer.complete(built.clone(), code.top(&top.nodes))?.persist()?;
    progress.advance(1);
    Ok(built)
}

fn statistics(summary: &GridSummary) -> Vec<ChannelStatistics> {
    let samples: u64 = summary.shape.iter().product();
    let of = |channel: &ChannelSummary| {
        let ChannelSummary { min, max, sum, nan, infinite, no_data, ref histogram, .. } = *channel;
        let (min, max) = (min.unwrap_or(f64::NAN), max.unwrap_or(f64::NAN));
        let finite = samples.saturating_sub(nan + infinite + no_data);
        ChannelStatistics { min, max, sum, finite, nan, infinite, no_data, histogram: histogram.clone() }
    };
    summary.channels.iter().map(of).collect()
}

/// A level as the footer tells it.
fn told((at, kinds): (usize, LevelKinds)) -> WaveletLevel {
    let LevelKinds { nodes, points, large, samples, directed } = kinds;
    let types = LevelTypes {
        large: large as u64,
        samples: samples as u64,
        directed: directed.into_iter().map(|count| count as u64).collect(),
    };
    WaveletLevel { level: at as u32 + 1, nodes: nodes as u64, points: points as u64, bytes: 0, types }
}
