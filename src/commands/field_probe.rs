//! `deepfield probe` of an image or a volume: what its samples hold in a region.

use super::probe::{Arguments, short};
use super::statistics::write_json;
use super::{CommandResult, text_of};
use crate::explore::Region;
use crate::explore::field_probe::{ChannelProbe, FieldProbe, probe_field};
use crate::model::Unit;
use crate::picture::field::OpenField;
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// What `--json` writes.
#[derive(Serialize)]
struct Answer<'a> {
    path: &'a Path,
    region: &'a Region,
    length_unit: &'a Unit,
    #[serde(flatten)]
    probe: &'a FieldProbe,
}

/// Asks and prints.
///
/// # Errors
/// When the file cannot be read, or what is asked is of particles alone.
pub fn run(arguments: &Arguments) -> CommandResult {
    let path = &arguments.path;
    let options = &arguments.region;
    let refused = [
        ("--profile", arguments.profile.is_some()),
        ("--over-time", arguments.over_time),
        ("--fields", !arguments.fields.is_empty()),
        ("--histogram", !arguments.histograms.is_empty()),
        ("--family", !options.family.is_empty()),
        ("--region", options.region.is_some()),
        ("--at", options.at.is_some()),
        ("--object", options.object.is_some()),
        ("--ids, --selection, --tracked-at", !arguments.who.is_region()),
    ];
    if let Some((name, _)) = refused.iter().find(|(_, is_given)| *is_given) {
        let expected = "expected particles; images and volumes take --sphere, --box and --where";
        return Err(format!("{}: {name}: found an image or a volume, {expected}", path.display()).into());
    }
    let shapes = options.sphere.iter().chain(&options.cuboid).cloned().collect();
    let region = Region { shapes, ranges: options.ranges.clone(), ..Region::default() };
    let open = OpenField::open(path, arguments.read, None)?;
    let (channels, unit) = (open.grid().channels.len(), open.grid().length_unit.clone());
    let field = open.shown(None, &(0..channels).collect::<Vec<_>>(), false)?.field;
    let probe = probe_field(&field, &region, arguments.bins())?;
    if let Some(out) = &arguments.json {
        return write_json(out, &Answer { path, region: &region, length_unit: &unit, probe: &probe });
    }
    let text = text_of(|text| write_tables(text, path, &unit, field.dimensions, &probe));
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

fn write_tables(
    text: &mut String,
    path: &Path,
    unit: &Unit,
    dimensions: usize,
    probe: &FieldProbe,
) -> std::fmt::Result {
    let (kind, power) = if dimensions == 2 { ("area", 2) } else { ("volume", 3) };
    let unit = if unit.is_unknown() { String::new() } else { format!(" {unit}^{power}") };
    writeln!(text, "{}: {} samples, {kind} {}{unit}", path.display(), probe.samples, short(probe.volume))?;
    let head = ["mean", "dispersion", "min", "max", "sum", "in the middle"];
    write!(text, "  {:<24} {:<12}", "channel", "unit")?;
    head.iter().try_for_each(|name| write!(text, " {name:>14}"))?;
    writeln!(text)?;
    for own in &probe.channels {
        write!(text, "  {:<24} {:<12}", own.name, own.unit.to_string())?;
        let values = [own.mean, own.dispersion, own.min, own.max, Some(own.sum), own.middle];
        values.iter().try_for_each(|value| write!(text, " {:>14}", value.map_or("-".into(), short)))?;
        let holes = probe.samples - own.count;
        if holes > 0 {
            let have = if holes == 1 { "sample has" } else { "samples have" };
            write!(text, "  {holes} {have} no value")?;
        }
        writeln!(text)?;
    }
    probe.channels.iter().try_for_each(|own| write_histogram(text, own))
}

fn write_histogram(text: &mut String, own: &ChannelProbe) -> std::fmt::Result {
    let (Some(min), Some(max)) = (own.min, own.max) else { return Ok(()) };
    let bins = own.histogram.len();
    if bins == 0 || min == max {
        return Ok(());
    }
    writeln!(text, "\nhistogram of {}", own.name)?;
    let most = own.histogram.iter().copied().max().unwrap_or(0).max(1);
    for (bin, count) in own.histogram.iter().enumerate() {
        let edge = |bin: usize| short(min + (max - min) * bin as f64 / bins as f64);
        let bar = "#".repeat((40 * count).div_ceil(most) as usize);
        writeln!(text, " {:>14} {:>14} {count:>14} {bar}", edge(bin), edge(bin + 1))?;
    }
    Ok(())
}
