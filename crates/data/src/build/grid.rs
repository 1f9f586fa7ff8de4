//! From an image or a volume to a file of it: its samples without loss, and the hierarchy of oriented points over them.

use super::memory::default_memory;
use super::{BuildError, pool};
use crate::hierarchy::wavelet::{Hierarchy, LevelKinds, Options, Samples};
use crate::import::grid::{ChannelSummary, GridSummary};
use crate::import::{GridSource, summarize_grid};
use crate::model::progress::Progress;
use crate::store::grid::{ChannelStatistics, GridAbout, GridFileWriter, LevelTypes, WaveletLevel, planes_of, rounded};
use std::path::Path;

/// Bytes that a build takes for each sample of a channel, beside the samples themselves.
const WORK: u64 = 40;

/// How a file of a grid is built.
#[derive(Clone, Debug, Default)]
pub struct GridBuildOptions {
    /// How points are chosen.
    pub points: Options,
    /// Memory that the build may take, bytes; half of what is free where nothing is said.
    pub memory: Option<u64>,
    /// Threads; all where nothing is said. The file is the same for any number.
    pub threads: Option<usize>,
}

/// Builds the file of a grid.
///
/// # Errors
/// [`BuildError`] where the source cannot be read, the file not be written, or memory does not suffice; nothing is left behind then.
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

fn build_here(
    source: &GridSource,
    options: &GridBuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<GridAbout, BuildError> {
    let about = source.description();
    let grid = &about.grid;
    let samples: u64 = grid.shape.iter().product();
    let needed = samples.saturating_mul(grid.sample_bytes() + WORK * grid.channels.len() as u64);
    let allowed = options.memory.unwrap_or_else(default_memory);
    if needed > allowed {
        return Err(BuildError::Memory {
            path: output.into(),
            what: format!("the hierarchy of {}", grid.described()),
            needed: needed.div_ceil(1 << 20),
            allowed: allowed >> 20,
        });
    }
    let writer = GridFileWriter::create(output)?;
    progress.begin("reading", 2);
    let summary = summarize_grid(source)?;
    progress.advance(1);
    let mut bytes = vec![0; usize::try_from(grid.bytes().unwrap_or(u64::MAX)).unwrap_or(usize::MAX)];
    source.read(&grid.region(), &mut bytes)?;
    progress.advance(1);
    let planes = planes_of(grid.sample_type, grid.channels.len(), &bytes);
    let points = options.points;
    let shape = grid.shape.map(|side| side as usize);
    let channels = planes.iter().map(Vec::as_slice).collect();
    progress.begin("building", 1);
    let mut hierarchy = Hierarchy::build(&Samples { dimensions: grid.dimensions, shape, channels }, &points);
    rounded(&mut hierarchy, grid.sample_type);
    progress.advance(1);
    let mut notes = about.notes.clone();
    if hierarchy.is_noise() {
        notes.push("nearly all points are leaves: samples that change like noise have no shorter form".into());
    }
    let built = GridAbout {
        source: about.path.clone(),
        format: about.format.clone(),
        source_bytes: about.bytes,
        notes,
        grid: grid.clone(),
        statistics: statistics(&summary),
        options: points,
        ranges: hierarchy.ranges.clone(),
        has_holes: !hierarchy.planes.holes.is_empty(),
        levels: hierarchy.kinds().into_iter().enumerate().map(told).collect(),
    };
    progress.begin("writing", 1);
    writer.complete(built.clone(), &hierarchy, &bytes)?.persist()?;
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
