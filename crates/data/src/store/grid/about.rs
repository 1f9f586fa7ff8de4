//! What is known of a file of a grid without reading a page: the grid, its channels, how it was built, its levels; as bytes and back.

use super::super::error::Damage;
use super::super::wire::{Decoder, Encoder};
use crate::hierarchy::wavelet::{Metric, Options, Types};
use crate::model::{Channel, Grid, SampleType, Scale, Unit};
use glam::{DAffine3, DMat3};
use serde::Serialize;
use std::path::PathBuf;

/// What the flag for holes is where samples below a value count as air; the value follows.
const AIR: u8 = 2;
/// Parts of a channel's histogram.
const MOST_BINS: usize = 1 << 16;

/// Everything that the footer says.
#[derive(Clone, Debug, PartialEq)]
pub struct GridAbout {
    /// Where it came from.
    pub source: PathBuf,
    /// That file's format.
    pub format: String,
    /// That file's size, bytes.
    pub source_bytes: u64,
    /// What the import assumed and the build found, a sentence each.
    pub notes: Vec<String>,
    /// The grid.
    pub grid: Grid,
    /// Of each channel what its values are.
    pub statistics: Vec<ChannelStatistics>,
    /// How its hierarchy was built.
    pub options: Options,
    /// The smallest and the largest value of each plane.
    pub ranges: Vec<(f32, f32)>,
    /// Whether some samples are no numbers, or count as air.
    pub has_holes: bool,
    /// Its levels, the finest first.
    pub levels: Vec<WaveletLevel>,
}

/// What the values of a channel are.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelStatistics {
    /// Smallest value; NaN where none is finite.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Sum of the finite ones.
    pub sum: f64,
    /// How many are finite.
    pub finite: u64,
    /// Samples that are no number.
    pub nan: u64,
    /// Samples that are infinite.
    pub infinite: u64,
    /// Samples that stand for no value.
    pub no_data: u64,
    /// How many are in equal parts of the range.
    pub histogram: Vec<u64>,
}

/// A level of nodes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WaveletLevel {
    /// 1: nodes of 2^D samples.
    pub level: u32,
    /// Nodes.
    pub nodes: u64,
    /// Points that all of them are drawn as by their own sets.
    pub points: u64,
    /// Bytes that they take.
    pub bytes: u64,
    /// How many have which set.
    pub types: LevelTypes,
}

/// Nodes by their set.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LevelTypes {
    /// One point.
    pub large: u64,
    /// Those of the children, in the end samples.
    pub samples: u64,
    /// Points along a direction: a count for each.
    pub directed: Vec<u64>,
}

/// The bytes.
pub(super) fn encode(about: &GridAbout) -> Vec<u8> {
    let mut out = Encoder::default();
    out.text(&about.source.to_string_lossy());
    out.text(&about.format);
    out.u64(about.source_bytes);
    out.u32(about.notes.len() as u32);
    about.notes.iter().for_each(|note| out.text(note));
    let grid = &about.grid;
    out.u8(grid.dimensions as u8);
    grid.shape.iter().for_each(|side| out.u64(*side));
    grid.to_world.matrix3.to_cols_array().into_iter().for_each(|value| out.f64(value));
    out.vec3(grid.to_world.translation);
    out.text(&grid.length_unit.0);
    out.text(grid.sample_type.name());
    out.u32(grid.channels.len() as u32);
    for (channel, statistics) in grid.channels.iter().zip(&about.statistics) {
        out.text(&channel.name);
        out.text(&channel.unit.0);
        out.f64(channel.scale.slope);
        out.f64(channel.scale.intercept);
        out.option_f64(channel.no_data);
        let ChannelStatistics { min, max, sum, finite, nan, infinite, no_data, histogram } = statistics;
        [min, max, sum].into_iter().for_each(|value| out.f64(*value));
        [finite, nan, infinite, no_data].into_iter().for_each(|count| out.u64(*count));
        out.u32(histogram.len() as u32);
        histogram.iter().for_each(|count| out.u64(*count));
    }
    out.u8(match about.options.types {
        Types::Measured => 0,
        Types::Round => 1,
        Types::Gabor => 2,
    });
    out.u8(match about.options.metric {
        Metric::Residual => 0,
        Metric::Rms => 1,
        Metric::Gabor => 2,
    });
    out.u8(about.options.colours.into());
    out.u32(about.ranges.len() as u32);
    about.ranges.iter().for_each(|(low, high)| out.f32s(&[*low, *high]));
    match (about.has_holes, about.options.ignore_below) {
        (true, Some(below)) => {
            out.u8(AIR);
            out.f32s(&[below]);
        }
        (has_holes, _) => out.u8(has_holes.into()),
    }
    out.u32(about.levels.len() as u32);
    for level in &about.levels {
        out.u32(level.level);
        [level.nodes, level.points, level.bytes, level.types.large, level.types.samples]
            .into_iter()
            .for_each(|count| out.u64(count));
        out.u32(level.types.directed.len() as u32);
        level.types.directed.iter().for_each(|count| out.u64(*count));
    }
    out.bytes
}

fn flag(input: &mut Decoder<'_>, field: &str) -> Result<bool, Damage> {
    match input.u8(field)? {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(Damage::new("footer", format!("{field} of 0 or 1, found {other}"))),
    }
}

fn counts(input: &mut Decoder<'_>, field: &str) -> Result<Vec<u64>, Damage> {
    let count = input.count(8, field)?;
    if count > MOST_BINS {
        return Err(Damage::new("footer", format!("at most {MOST_BINS} {field}, found {count}")));
    }
    (0..count).map(|_| input.u64(field)).collect()
}

/// Reads the bytes.
pub(super) fn decode(bytes: &[u8]) -> Result<GridAbout, Damage> {
    let mut whole = Decoder::new(bytes, "footer");
    let input = &mut whole;
    let wrong = |expected: String| Damage::new("footer", expected);
    let source = input.text("the source's path")?.into();
    let format = input.text("the source's format")?;
    let source_bytes = input.u64("the source's size")?;
    let notes = (0..input.count(4, "notes")?).map(|_| input.text("a note")).collect::<Result<_, _>>()?;
    let dimensions = usize::from(input.u8("the number of axes")?);
    let shape = [input.u64("the shape")?, input.u64("the shape")?, input.u64("the shape")?];
    let mut columns = [0.0; 9];
    for value in &mut columns {
        *value = input.f64("the axes")?;
    }
    let to_world = DAffine3 { matrix3: DMat3::from_cols_array(&columns), translation: input.vec3("the origin")? };
    let length_unit = Unit(input.text("the length unit")?);
    let sample_type: SampleType = input.text("the type of samples")?.parse().map_err(wrong)?;
    let number = input.count(100, "channels")?;
    let (mut channels, mut statistics) = (Vec::with_capacity(number), Vec::with_capacity(number));
    for _ in 0..number {
        channels.push(Channel {
            name: input.text("a channel's name")?,
            unit: Unit(input.text("a channel's unit")?),
            scale: Scale { slope: input.f64("a slope")?, intercept: input.f64("an intercept")? },
            no_data: input.option_f64("what stands for no value")?,
        });
        statistics.push(ChannelStatistics {
            min: input.f64("a range")?,
            max: input.f64("a range")?,
            sum: input.f64("a sum")?,
            finite: input.u64("a count")?,
            nan: input.u64("a count")?,
            infinite: input.u64("a count")?,
            no_data: input.u64("a count")?,
            histogram: counts(input, "parts of a histogram")?,
        });
    }
    let types = match input.u8("how sets are chosen")? {
        0 => Types::Measured,
        1 => Types::Round,
        2 => Types::Gabor,
        other => return Err(wrong(format!("sets chosen as 0, 1 or 2 says, found {other}"))),
    };
    let metric = match input.u8("what errors are")? {
        0 => Metric::Residual,
        1 => Metric::Rms,
        2 => Metric::Gabor,
        other => return Err(wrong(format!("errors as 0, 1 or 2 says, found {other}"))),
    };
    let colours = flag(input, "colours")?;
    let ranges = (0..input.count(8, "ranges")?)
        .map(|_| Ok((input.f32("a range")?, input.f32("a range")?)))
        .collect::<Result<Vec<_>, Damage>>()?;
    let (has_holes, ignore_below) = match input.u8("holes")? {
        0 => (false, None),
        1 => (true, None),
        AIR => (true, Some(input.f32("what counts as air")?)),
        other => return Err(wrong(format!("holes of 0, 1 or {AIR}, found {other}"))),
    };
    let options = Options { types, metric, colours, ignore_below };
    let level = |input: &mut Decoder<'_>| -> Result<WaveletLevel, Damage> {
        let level = input.u32("a level")?;
        let mut next = || input.u64("a level's counts");
        let (nodes, points, bytes, large, samples) = (next()?, next()?, next()?, next()?, next()?);
        let directed = counts(input, "directions")?;
        Ok(WaveletLevel { level, nodes, points, bytes, types: LevelTypes { large, samples, directed } })
    };
    let levels = (0..input.count(48, "levels")?).map(|_| level(input)).collect::<Result<Vec<_>, _>>()?;
    whole.finish()?;
    let grid = Grid { dimensions, shape, to_world, length_unit, sample_type, channels };
    let fits = (2..=3).contains(&dimensions)
        && shape.iter().all(|side| *side > 0)
        && (dimensions == 3 || shape[2] == 1)
        && !grid.channels.is_empty()
        && ranges.len() == grid.channels.len()
        && grid.bytes().is_some_and(|bytes| usize::try_from(bytes).is_ok());
    if !fits || !to_world.is_finite() || to_world.matrix3.determinant() == 0.0 {
        return Err(wrong("an image or a volume with axes that span it and a range for each channel".into()));
    }
    Ok(GridAbout { source, format, source_bytes, notes, grid, statistics, options, ranges, has_holes, levels })
}
