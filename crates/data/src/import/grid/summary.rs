//! What a grid holds, with statistics of every channel: the content of `info --json`.

use super::super::ImportError;
use super::{GridDescription, GridSource};
use crate::model::{Bounds, Channel, Grid, Region, SampleType, Unit};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// How many equal parts of the range from the smallest to the largest value a histogram counts.
pub const HISTOGRAM: usize = 64;

/// How much is read at once, bytes. Sums depend on it, and on nothing else.
const CHUNK: u64 = 4 << 20;

/// Statistics of one channel over all its finite values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelSummary {
    /// The channel's name.
    pub name: String,
    /// Unit of its values; empty when unknown.
    pub unit: Unit,
    /// How samples are stored.
    #[serde(rename = "type")]
    pub sample_type: SampleType,
    /// Smallest value; `None` where none is finite.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Mean of the finite values.
    pub mean: Option<f64>,
    /// Their sum.
    pub sum: f64,
    /// Samples that are no number.
    pub nan: u64,
    /// Samples that are infinite.
    pub infinite: u64,
    /// Samples that stand for no value.
    pub no_data: u64,
    /// How many finite values there are in each of [`HISTOGRAM`] equal parts of the range from `min` to `max`; all are in the first where
    /// these are the same.
    pub histogram: Vec<u64>,
}

/// Everything that `info --json` says about a grid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GridSummary {
    /// `image` or `volume`.
    pub kind: &'static str,
    /// The format's name.
    pub format: String,
    /// Number of files.
    pub files: usize,
    /// Size of all files, bytes.
    pub bytes: u64,
    /// Samples along each axis, the fastest first.
    pub shape: Vec<u64>,
    /// Distance of neighbouring samples along each axis.
    pub spacing: Vec<f64>,
    /// Directions of the axes, unit vectors; two of an image, three of a volume.
    pub axes: Vec<DVec3>,
    /// Centre of the first sample.
    pub origin: DVec3,
    /// Unit of lengths; empty when unknown.
    pub length_unit: Unit,
    /// The box around all samples.
    pub bounds: Bounds,
    /// Size of all samples in memory, bytes.
    pub memory_bytes: u64,
    /// What every sample holds.
    pub channels: Vec<ChannelSummary>,
    /// What the import assumed or left out, a sentence each.
    pub notes: Vec<String>,
}

/// Reads all samples once, those of more than 16 bits twice, in bounded chunks.
///
/// # Errors
/// [`ImportError`] when the source cannot be read.
pub fn summarize_grid(source: &GridSource) -> Result<GridSummary, ImportError> {
    let GridDescription { format, files, bytes, grid, notes, .. } = source.description().clone();
    let channels = match grid.sample_type {
        SampleType::U8 | SampleType::I8 => by_count(source)?,
        SampleType::U16 | SampleType::I16 if grid.channels.len() <= 8 => by_count(source)?,
        _ => by_value(source)?,
    };
    Ok(GridSummary {
        kind: grid.kind(),
        format,
        files,
        bytes,
        shape: grid.shape[..grid.dimensions].to_vec(),
        spacing: grid.spacing(),
        axes: grid.axes(),
        origin: grid.to_world.translation,
        length_unit: grid.length_unit.clone(),
        bounds: grid.bounds(),
        memory_bytes: grid.bytes().unwrap_or(u64::MAX),
        channels,
        notes,
    })
}

/// The chunk's samples.
fn read(source: &GridSource, region: &Region, buffer: &mut Vec<u8>) -> Result<(), ImportError> {
    let samples: u64 = region.shape().iter().product();
    buffer.resize((samples * source.grid().sample_bytes()) as usize, 0);
    source.read(region, buffer)
}

/// Statistics from how often each stored value occurs: exact, for types of few values.
fn by_count(source: &GridSource) -> Result<Vec<ChannelSummary>, ImportError> {
    let grid = source.grid();
    let size = grid.sample_type.size();
    let (channels, values) = (grid.channels.len(), 1_usize << (8 * size));
    let nothing = || (vec![0_u64; channels * values], Vec::new());
    let count = |(mut counts, mut buffer): (Vec<u64>, Vec<u8>), region: Region| {
        read(source, &region, &mut buffer)?;
        for sample in buffer.chunks_exact(size * channels) {
            for (channel, bytes) in sample.chunks_exact(size).enumerate() {
                let value = match *bytes {
                    [a, b] => usize::from(u16::from_ne_bytes([a, b])),
                    [a] => usize::from(a),
                    _ => 0,
                };
                counts[channel * values + value] += 1;
            }
        }
        Ok((counts, buffer))
    };
    let add = |(mut all, buffer): (Vec<u64>, Vec<u8>), (counts, _): (Vec<u64>, Vec<u8>)| {
        all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
        Ok((all, buffer))
    };
    let (counts, _) = source.chunks(CHUNK).into_par_iter().try_fold(nothing, count).try_reduce(nothing, add)?;
    // The bit patterns of all values, in their order.
    let patterns: Vec<u8> = match size {
        1 => (0..=u8::MAX).collect(),
        _ => (0..=u16::MAX).flat_map(u16::to_ne_bytes).collect(),
    };
    let mut stored = Vec::with_capacity(values);
    grid.sample_type.decode(&patterns, 1, &mut stored);
    Ok(grid
        .channels
        .iter()
        .zip(counts.chunks_exact(values))
        .map(|(channel, counts)| {
            let mut summary = empty(grid, channel);
            let mut running = Running::NOTHING;
            for (&stored, &count) in stored.iter().zip(counts).filter(|(_, count)| **count > 0) {
                running.add(channel, stored, count);
            }
            running.finish(&mut summary);
            for (&stored, &count) in stored.iter().zip(counts).filter(|(_, count)| **count > 0) {
                if let Some(at) = bin(channel, &summary, stored) {
                    summary.histogram[at] += count;
                }
            }
            summary
        })
        .collect())
}

/// Statistics from all values, and then their histogram.
fn by_value(source: &GridSource) -> Result<Vec<ChannelSummary>, ImportError> {
    let grid = source.grid();
    let chunks = source.chunks(CHUNK);
    let channels = grid.channels.len();
    let decoded = |region: &Region, (buffer, values): &mut (Vec<u8>, Vec<f64>)| {
        read(source, region, buffer)?;
        values.clear();
        grid.sample_type.decode(buffer, 1, values);
        Ok::<(), ImportError>(())
    };
    let running: Result<Vec<Vec<Running>>, ImportError> = chunks
        .par_iter()
        .map_init(Default::default, |buffers, region| {
            decoded(region, buffers)?;
            let mut running = vec![Running::NOTHING; channels];
            for sample in buffers.1.chunks_exact(channels) {
                for ((running, channel), stored) in running.iter_mut().zip(&grid.channels).zip(sample) {
                    running.add(channel, *stored, 1);
                }
            }
            Ok(running)
        })
        .collect();
    let mut all = vec![Running::NOTHING; channels];
    for chunk in running? {
        all.iter_mut().zip(chunk).for_each(|(all, chunk)| all.and(chunk));
    }
    let mut summaries: Vec<ChannelSummary> = grid.channels.iter().map(|channel| empty(grid, channel)).collect();
    summaries.iter_mut().zip(all).for_each(|(summary, running)| running.finish(summary));
    let nothing = || (vec![0_u64; channels * HISTOGRAM], Default::default());
    let (counts, _) = chunks
        .into_par_iter()
        .try_fold(nothing, |(mut counts, mut buffers), region| {
            decoded(&region, &mut buffers)?;
            for sample in buffers.1.chunks_exact(channels) {
                for (index, stored) in sample.iter().enumerate() {
                    if let Some(at) = bin(&grid.channels[index], &summaries[index], *stored) {
                        counts[index * HISTOGRAM + at] += 1;
                    }
                }
            }
            Ok::<_, ImportError>((counts, buffers))
        })
        .try_reduce(nothing, |(mut all, buffers), (counts, _)| {
            all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
            Ok((all, buffers))
        })?;
    for (summary, counts) in summaries.iter_mut().zip(counts.chunks_exact(HISTOGRAM)) {
        summary.histogram.copy_from_slice(counts);
    }
    Ok(summaries)
}

/// A channel of which nothing is known yet.
fn empty(grid: &Grid, channel: &Channel) -> ChannelSummary {
    ChannelSummary {
        name: channel.name.clone(),
        unit: channel.unit.clone(),
        sample_type: grid.sample_type,
        min: None,
        max: None,
        mean: None,
        sum: 0.0,
        nan: 0,
        infinite: 0,
        no_data: 0,
        histogram: vec![0; HISTOGRAM],
    }
}

/// Running statistics of a channel.
#[derive(Clone, Copy)]
struct Running {
    min: f64,
    max: f64,
    sum: f64,
    count: u64,
    nan: u64,
    infinite: u64,
    no_data: u64,
}

impl Running {
    const NOTHING: Running =
        Running { min: f64::INFINITY, max: f64::NEG_INFINITY, sum: 0.0, count: 0, nan: 0, infinite: 0, no_data: 0 };

    fn add(&mut self, channel: &Channel, stored: f64, count: u64) {
        let value = channel.scale.value(stored);
        if channel.no_data == Some(stored) {
            self.no_data += count;
        } else if value.is_nan() {
            self.nan += count;
        } else if value.is_infinite() {
            self.infinite += count;
        } else {
            self.min = self.min.min(value);
            self.max = self.max.max(value);
            self.sum += value * count as f64;
            self.count += count;
        }
    }

    fn and(&mut self, other: Running) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.sum += other.sum;
        self.count += other.count;
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.no_data += other.no_data;
    }

    fn finish(self, summary: &mut ChannelSummary) {
        (summary.nan, summary.infinite, summary.no_data) = (self.nan, self.infinite, self.no_data);
        if self.count > 0 {
            summary.min = Some(self.min);
            summary.max = Some(self.max);
            summary.mean = Some(self.sum / self.count as f64).filter(|mean| mean.is_finite());
            summary.sum = self.sum;
        }
    }
}

/// The part of the histogram that a stored sample belongs to.
fn bin(channel: &Channel, summary: &ChannelSummary, stored: f64) -> Option<usize> {
    let (min, max) = (summary.min?, summary.max?);
    let value = channel.scale.value(stored);
    if !value.is_finite() || channel.no_data == Some(stored) {
        return None;
    }
    // Halves, as the difference of the largest numbers is none.
    let share = (0.5 * value - 0.5 * min) / (0.5 * max - 0.5 * min);
    Some(if max > min { ((share * HISTOGRAM as f64) as usize).min(HISTOGRAM - 1) } else { 0 })
}
