//! What `deepfield info` prints of images and volumes.

use super::info::short;
use super::text_of;
use crate::hierarchy::kind::WAVELET;
use crate::hierarchy::wavelet::sets::{direction, directions};
use crate::import::grid::{ChannelSummary, GridSummary};
use crate::model::Channel;
use crate::store::GridFile;
use crate::store::grid::{ChannelStatistics, WaveletLevel};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The human table.
pub(super) fn table(summary: &GridSummary) -> String {
    text_of(|text| write_table(text, summary))
}

fn write_table(text: &mut String, summary: &GridSummary) -> std::fmt::Result {
    let GridSummary { kind, format, bytes, files, .. } = summary;
    let files = if *files == 1 { String::new() } else { format!(" in {files} files") };
    let sizes: Vec<String> = summary.shape.iter().map(u64::to_string).collect();
    writeln!(text, "{format}, {bytes} bytes{files}: {kind} of {} samples", sizes.join(" x "))?;
    writeln!(text, "in memory: {} bytes", summary.memory_bytes)?;
    let unit = if summary.length_unit.is_unknown() { String::new() } else { format!(" {}", summary.length_unit) };
    writeln!(text, "spacing: {}{unit}", listed(&summary.spacing))?;
    let axes: Vec<String> = summary.axes.iter().map(|axis| format!("({})", listed(&axis.to_array()))).collect();
    writeln!(text, "axes: {}", axes.join(" "))?;
    let corner = |corner: glam::DVec3| format!("({})", listed(&corner.to_array()));
    writeln!(text, "bounds: {} to {}", corner(summary.bounds.min), corner(summary.bounds.max))?;
    for channel in &summary.channels {
        write_channel(text, channel)?;
    }
    summary.notes.iter().try_for_each(|note| writeln!(text, "note: {note}"))
}

/// The same of a file that was built, and its levels.
pub(super) fn file_table(file: &GridFile) -> String {
    let mut text = table(&summary_of(file));
    // Writing to a string cannot fail.
    let _ = writeln!(text, "\nlevel       nodes      points       bytes    single  directed   samples");
    for WaveletLevel { level, nodes, points, bytes, types } in &file.about().levels {
        let directed: u64 = types.directed.iter().sum();
        let (large, samples) = (types.large, types.samples);
        let _ = writeln!(text, "{level:5} {nodes:11} {points:11} {bytes:11} {large:9} {directed:9} {samples:9}");
    }
    text
}

/// The same as JSON.
pub(super) fn file_json(file: &GridFile) -> Result<Value, serde_json::Error> {
    let mut told = serde_json::to_value(summary_of(file))?;
    let about = file.about();
    let dimensions = about.grid.dimensions;
    let ways: Vec<Vec<f32>> =
        (0..directions(dimensions)).map(|n| direction(dimensions, n)[..dimensions].to_vec()).collect();
    told["hierarchies"] = json!([WAVELET.name]);
    told["directions"] = json!(ways);
    told["wavelet_levels"] = serde_json::to_value(&about.levels)?;
    Ok(told)
}

/// What is known of a file's grid.
fn summary_of(file: &GridFile) -> GridSummary {
    let about = file.about();
    let grid = &about.grid;
    let channel = |(channel, own): (&Channel, &ChannelStatistics)| {
        let number = |value: f64| Some(value).filter(|value| value.is_finite());
        ChannelSummary {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
            sample_type: grid.sample_type,
            min: number(own.min),
            max: number(own.max),
            mean: number(own.sum / own.finite as f64),
            sum: own.sum,
            nan: own.nan,
            infinite: own.infinite,
            no_data: own.no_data,
            histogram: own.histogram.clone(),
        }
    };
    GridSummary {
        kind: grid.kind(),
        format: about.format.clone(),
        files: 1,
        bytes: file.bytes(),
        shape: grid.shape[..grid.dimensions].to_vec(),
        spacing: grid.spacing(),
        axes: grid.axes(),
        origin: grid.to_world.translation,
        length_unit: grid.length_unit.clone(),
        bounds: grid.bounds(),
        memory_bytes: grid.bytes().unwrap_or(u64::MAX),
        channels: grid.channels.iter().zip(&about.statistics).map(channel).collect(),
        notes: about.notes.clone(),
    }
}

fn write_channel(text: &mut String, channel: &ChannelSummary) -> std::fmt::Result {
    let unit = if channel.unit.is_unknown() { String::new() } else { format!(", in {}", channel.unit) };
    writeln!(text, "\n{}: {}{unit}", channel.name, channel.sample_type)?;
    let (Some(min), Some(max)) = (channel.min, channel.max) else {
        return writeln!(text, "  no finite value");
    };
    let mean = channel.mean.map_or_else(|| "unknown".into(), short);
    writeln!(text, "  min {}, max {}, mean {mean}, sum {}", short(min), short(max), short(channel.sum))?;
    for (count, what) in [(channel.nan, "NaN"), (channel.infinite, "infinite"), (channel.no_data, "without a value")] {
        if count > 0 {
            let samples = if count == 1 { "sample" } else { "samples" };
            writeln!(text, "  {count} {samples} {what}")?;
        }
    }
    writeln!(text, "  {} {} {}", short(min), bars(&channel.histogram), short(max))
}

/// A histogram in one line: the height of a bar is the logarithm of its count, so that a rare material shows beside air.
fn bars(counts: &[u64]) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let height = |count: u64| (1.0 + count as f64).ln() / (1.0 + most as f64).ln();
    let block = |count: u64| match count {
        0 => ' ',
        count => BLOCKS[((height(count) * 8.0).ceil() as usize).clamp(1, 8) - 1],
    };
    counts.iter().map(|&count| block(count)).collect()
}

/// Numbers as short as they are.
fn listed(values: &[f64]) -> String {
    let rounded = |value: &f64| format!("{}", (value * 1e6).round() / 1e6 + 0.0);
    values.iter().map(rounded).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_is_a_line_of_bars() {
        assert_eq!(bars(&[0, 1, 1_000_000]), " ▁█");
        assert_eq!(bars(&[0, 0]), "  ");
        assert_eq!(listed(&[1.40625, -0.0, 0.866_025_403_8]), "1.40625, 0, 0.866025");
    }
}
