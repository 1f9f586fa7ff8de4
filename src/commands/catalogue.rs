//! `deepfield catalogue`: the named objects of a catalogue, the most important first.

use super::CommandResult;
use super::probe::short;
use super::statistics::write_json;
use crate::explore::Catalogue;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

/// Lists the objects of a catalogue: a table (CSV), RON, or a group catalogue of Gadget-4, AREPO or SUBFIND (HDF5).
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield catalogue groups.hdf5
  deepfield catalogue clusters.csv --most 5
  deepfield catalogue groups.hdf5 --json objects.json")]
pub struct Arguments {
    /// The catalogue.
    pub path: PathBuf,
    /// Objects that the table lists at most; 0: all.
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub most: usize,
    /// Write JSON, with all objects, to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
}

/// Reads and prints.
///
/// # Errors
/// When the catalogue cannot be read.
pub fn run(arguments: &Arguments) -> CommandResult {
    let catalogue = Catalogue::read(&arguments.path)?;
    match &arguments.json {
        Some(out) => write_json(out, &catalogue),
        None => Ok(std::io::stdout().write_all(table(&catalogue, arguments.most).as_bytes())?),
    }
}

fn table(catalogue: &Catalogue, most: usize) -> String {
    let mut text = String::new();
    let (length, mass) = (&catalogue.length_unit, &catalogue.mass_unit);
    let count = catalogue.objects.len();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}: {count} objects; lengths in {length}, masses in {mass}", catalogue.path.display());
    if catalogue.left_out > 0 {
        let _ = writeln!(text, "left out: {} without a position", catalogue.left_out);
    }
    let _ = writeln!(
        text,
        "{:>8}  {:<24} {:>14} {:>14} {:>14} {:>14} {:>14}",
        "#", "name", "x", "y", "z", "radius", "mass"
    );
    let shown = if most == 0 { count } else { most };
    for (i, object) in catalogue.objects.iter().take(shown).enumerate() {
        let cell = |value: Option<f64>| value.map_or("-".into(), short);
        let _ = write!(text, "{i:>8}  {:<24}", object.name);
        for value in object.position.to_array().into_iter().map(Some).chain([object.radius, object.mass]) {
            let _ = write!(text, " {:>14}", cell(value));
        }
        text.push('\n');
    }
    if shown < count {
        let _ = writeln!(text, "and {} more: --most 0 lists all", count - shown);
    }
    text
}
