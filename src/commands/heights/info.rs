//! What `deepfield info` prints of height fields.

use super::probe::after;
use crate::commands::info::short;
use crate::heights::OpenHeights;
use crate::heights::import::HeightSummary;
use crate::heights::import::summary::{PhotoSummary, PlaneSummary};
use crate::heights::model::Heights;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The answer as JSON.
///
/// # Errors
/// When the file cannot be read.
pub fn as_json(open: &OpenHeights) -> Result<Value, Box<dyn std::error::Error + Send + Sync>> {
    let mut told = serde_json::to_value(open.summary()?)?;
    if let OpenHeights::Pages(file) = open {
        let about = file.about();
        let samples = about.grid.samples() as f64;
        told["levels"] = serde_json::to_value(&about.levels)?;
        told["pages"] = json!(file.pages());
        told["bytes_per_sample"] = json!(file.bytes() as f64 / samples);
        told["source"] = json!(about.source);
        told["height_error"] = json!(open.height_error());
    }
    Ok(told)
}

/// The human table.
///
/// # Errors
/// When the file cannot be read.
pub fn table(open: &OpenHeights) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let mut text = String::new();
    write_table(&mut text, &open.summary()?)?;
    if let Some(within) = within(open) {
        writeln!(text, "{within}")?;
    }
    if let OpenHeights::Pages(file) = open {
        let each = file.bytes() as f64 / file.about().grid.samples() as f64;
        writeln!(text, "\n{} pages, {each:.2} bytes a sample", file.pages())?;
        writeln!(text, "{:>5} {:>10} {:>14} {:>14}", "level", "chunks", "samples", "bytes")?;
        for level in &file.about().levels {
            writeln!(text, "{:>5} {:>10} {:>14} {:>14}", level.level, level.chunks, level.samples, level.bytes)?;
        }
    }
    Ok(text)
}

/// How far the heights of a page file are from the source's, in words; nothing where they are the source's own.
pub fn within(open: &OpenHeights) -> Option<String> {
    let unit = after(&open.grid().height_unit);
    open.height_error().map(|error| format!("heights are within {error}{unit} of the source's"))
}

fn write_table(text: &mut String, summary: &HeightSummary) -> std::fmt::Result {
    let HeightSummary { format, bytes, columns, rows, sample_type, .. } = summary;
    writeln!(text, "{format}, {bytes} bytes: heights of {columns} x {rows} samples ({sample_type})")?;
    let (places, heights) = (after(&summary.xy_unit), after(&summary.height_unit));
    let [x, y] = summary.spacing;
    writeln!(text, "spacing: {x}, {y}{places}; first sample at {}, {}{places}", summary.origin[0], summary.origin[1])?;
    if let Some(crs) = &summary.crs {
        writeln!(text, "coordinate reference system: {crs}")?;
    }
    let share = 100.0 * summary.valid_share;
    writeln!(text, "measured: {} of {} samples ({share:.2} %)", summary.valid, summary.samples)?;
    let invalid = &summary.invalid;
    for (count, what) in [(invalid.no_data, "no data"), (invalid.nan, "NaN"), (invalid.infinite, "infinite")] {
        if count > 0 {
            writeln!(text, "  {count} {what}")?;
        }
    }
    if summary.lone > 0 {
        writeln!(text, "  {} measured ones are alone: in no triangle", summary.lone)?;
    }
    let [min, max, mean] =
        [summary.min, summary.max, summary.mean].map(|height| told(height, summary.max - summary.min));
    writeln!(text, "heights: min {min}, max {max}, mean {mean}{heights}")?;
    let is_plane = |plane: &&PlaneSummary| plane.photo.is_none();
    let names: Vec<&str> = summary.planes.iter().filter(is_plane).map(|plane| plane.name.as_str()).collect();
    if !names.is_empty() {
        writeln!(text, "colour planes: {}", names.join(", "))?;
    }
    for PhotoSummary { columns, rows, source, corners } in
        summary.planes.iter().filter_map(|plane| plane.photo.as_ref())
    {
        let [from, to] = corners.map(|[x, y]| format!("{x}, {y}"));
        writeln!(text, "photo (texture): {columns} x {rows} pixels of {source}, from {from} to {to}{places}")?;
    }
    summary.notes.iter().try_for_each(|note| writeln!(text, "note: {note}"))
}

/// A height, with six digits of how far heights are apart where that is more than other numbers have: those of a microscope may count from far below.
fn told(height: f64, range: f64) -> String {
    let text = short(height);
    let decimals = 5.0 - range.log10().floor();
    let digits = height.abs().log10().floor() + decimals;
    match (range > 0.0, text.contains('e')) {
        (true, true) if digits > 6.0 => format!("{height:.*e}", digits.min(15.0) as usize),
        (true, false) if decimals > 6.0 => format!("{height:.*}", decimals.min(15.0) as usize),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_have_the_digits_that_tell_them_apart() {
        for (height, range, text) in [
            (0.076_323_271_2, 3.5e-5, "0.0763232712"),
            (0.076_323_271_2, 0.0, "0.076323"),
            (-9026.625, 15_255.4, "-9026.625000"),
            (2.5e-7, 5e-7, "2.500000e-7"),
            (1_000_000_000.25, 2.0, "1.00000000025000e9"),
            (2e9, 4e9, "2.000000e9"),
        ] {
            assert_eq!(told(height, range), text, "{range}");
        }
    }
}
