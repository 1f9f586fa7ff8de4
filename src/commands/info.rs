//! `deepfield info`: what a source holds, as a table for people or as JSON for programs.

use super::heights::{self, HeightsOptions};
use super::raw_options::RawOptions;
use super::{CommandResult, grid_info, page_file_info, run_info, text_of};
use crate::import::vector_field::velocities_in;
use crate::import::{
    FamilySummary, Field, GridOptions, Statistic, Summary, UnpackedOnce, grid_format, open_grid, summarize,
    summarize_grid,
};
use crate::look::{DataKind, data_file};
use crate::model::ReadMethod;
use crate::store::{GridFile, PageFile, RunFile};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

/// Prints what a source, page file or run holds: counts, fields, units, ranges; for a page file its levels and bytes too, for a run its
/// steps, for an image or a volume its shape, place and histogram, for heights how many were measured, where, and in which units.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield info snapshot_099.hdf5
  deepfield info head.nrrd
  deepfield info slices/
  deepfield info run.h5#fields/density
  deepfield info surface.sur
  deepfield info grey.png --kind heights --spacing 0.5,0.5 --height-unit um
  deepfield info scan.raw --shape 512,512,300 --type u16 --spacing 0.5,0.5,1
  deepfield info galaxy.df --json
  deepfield info https://data.example.org/galaxy.df")]
pub struct Arguments {
    /// The source, page file or run, or the URL of a built file.
    pub path: PathBuf,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// What a file without a header holds.
    #[command(flatten)]
    pub raw: RawOptions,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: HeightsOptions,
}

/// Prints what the file holds to standard output; of a source, every field is read in bounded chunks.
///
/// # Errors
/// [`crate::import::ImportError`] or [`crate::store::StoreError`] when the file cannot be read, or the standard output's
/// error.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, json, raw, heights: said } = arguments;
    let path = &data_file(path)?;
    // What it is is asked before it is opened.
    let _held = UnpackedOnce::of(path);
    let options = GridOptions { raw: raw.grid()?, ..GridOptions::default() };
    if options.raw.is_none() && said.takes(path) {
        let open = said.open(path, &raw.spacing, ReadMethod::default())?;
        let text = match json {
            true => serde_json::to_string_pretty(&heights::info::as_json(&open)?)? + "\n",
            false => heights::info::table(&open)?,
        };
        return Ok(std::io::stdout().write_all(text.as_bytes())?);
    }
    heights::refuse_without(path, &said.given())?;
    let pretty = |value: &serde_json::Value| serde_json::to_string_pretty(value).map(|text| text + "\n");
    // What cannot be read is left to the importer's message.
    let text = match DataKind::of(path).unwrap_or(DataKind::Source) {
        DataKind::Pages => {
            let file = PageFile::open(path)?;
            if *json { pretty(&page_file_info::json(&file))? } else { page_file_info::table(&file) }
        }
        DataKind::Run => {
            let run = RunFile::open(path, ReadMethod::default())?;
            if *json { pretty(&run_info::json(&run))? } else { run_info::table(&run) }
        }
        // What asks for something else by --kind.
        DataKind::Heights => return Err(format!("{}: --kind: a file of heights", path.display()).into()),
        DataKind::Grid => {
            let file = GridFile::open(path, ReadMethod::default())?;
            if *json { pretty(&grid_info::file_json(&file)?)? } else { grid_info::file_table(&file) }
        }
        DataKind::Source if options.raw.is_some() || grid_format(path)?.is_some() => {
            let mut summary = summarize_grid(&open_grid(path, &options)?)?;
            if summary.kind == "image" && summary.channels.len() == 1 {
                summary.notes.push("an image: --kind heights takes its values for heights".into());
            }
            if options.raw.is_none() {
                summary.notes.extend(velocities_in(path));
            }
            if *json { serde_json::to_string_pretty(&summary)? + "\n" } else { grid_info::table(&summary) }
        }
        DataKind::Source => {
            let summary = summarize(path)?;
            if *json {
                serde_json::to_string_pretty(&summary)? + "\n"
            } else {
                text_of(|text| write_table(text, &summary))
            }
        }
    };
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(())
}

/// The human table.
fn write_table(text: &mut String, summary: &Summary) -> std::fmt::Result {
    let about = &summary.about;
    let files = if about.files == 1 { String::new() } else { format!(" in {} files", about.files) };
    writeln!(text, "{}, {} bytes{files}: {} particles", about.format, about.bytes, summary.particles)?;
    writeln!(text, "length unit: {}, mass unit: {}", about.length_unit, about.mass_unit)?;
    for (name, value) in [("time", about.time), ("redshift", shown_redshift(about.redshift)), ("box", about.box_size)] {
        if let Some(value) = value {
            writeln!(text, "{name}: {}", short(value))?;
        }
    }
    for family in &summary.families {
        write_family(text, family)?;
    }
    for skipped in &summary.skipped {
        writeln!(text, "left out: {} particles, {}", skipped.count, skipped.reason)?;
    }
    about.notes.iter().try_for_each(|note| writeln!(text, "note: {note}"))
}

fn write_family(text: &mut String, family: &FamilySummary) -> std::fmt::Result {
    writeln!(text, "\n{}: {} particles, mass {}", family.name, family.count, family.mass)?;
    writeln!(text, "  {:<28} {:<24} {:>14} {:>14} {:>14}", "field", "unit", "min", "max", "mean")?;
    for field in &family.fields {
        let values = |statistic: &Statistic| match statistic {
            Statistic::Scalar(value) => vec![*value],
            Statistic::Vector(values) => values.clone(),
        };
        let rows = values(&field.min).into_iter().zip(values(&field.max)).zip(values(&field.mean));
        for (component, ((min, max), mean)) in rows.enumerate() {
            let letter = ["-x", "-y", "-z"].get(component).map_or(format!("-{component}"), |letter| letter.to_string());
            let Field { name, components, .. } = &field.about;
            let name = if *components == 1 { name.clone() } else { format!("{name}{letter}") };
            let unit = field.about.unit.to_string();
            let [min, max, mean] = statistics([min, max, mean]);
            writeln!(text, "  {name:<28} {unit:<24} {min:>14} {max:>14} {mean:>14}")?;
        }
    }
    Ok(())
}

/// Minimum, maximum and mean as they are told; a field without a value has none.
fn statistics([min, max, mean]: [f64; 3]) -> [String; 3] {
    if min <= max { [min, max, mean].map(short) } else { ["none"; 3].map(String::from) }
}

/// A redshift as it is told: what rounding leaves of `1 / a - 1` today is none.
pub(super) fn shown_redshift(redshift: Option<f64>) -> Option<f64> {
    redshift.map(|redshift| if redshift.abs() < 1e-12 { 0.0 } else { redshift })
}

/// Seven digits, as exponent where that is shorter.
pub(super) fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        1e-4..1e7 => format!("{value:.6}"),
        _ => format!("{value:.6e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_rounding_leaves_of_a_redshift_is_none() {
        let told = |redshift: f64| shown_redshift(Some(redshift)).map(short);
        assert_eq!(told(-f64::EPSILON).as_deref(), Some("0"));
        assert_eq!(told(0.5).as_deref(), Some("0.500000"));
        assert_eq!(told(1e-9).as_deref(), Some("1.000000e-9"));
        assert_eq!(shown_redshift(None), None);
    }

    #[test]
    fn a_field_without_a_value_has_no_statistics() {
        assert_eq!(statistics([f64::INFINITY, f64::NEG_INFINITY, f64::NAN]), ["none"; 3]);
        assert_eq!(statistics([1.0, 1.0, 1.0]), ["1.000000"; 3]);
    }
}
