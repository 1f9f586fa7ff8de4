//! `deepfield catalogue`: the named objects of a catalogue, the most important first, and what became of them.

use super::CommandResult;
use super::heights;
use super::probe::short;
use super::statistics::write_json;
use crate::color::output::write_atomically;
use crate::explore::{Catalogue, MergerTree, merger_tree};
use crate::import::file_in;
use crate::model::When;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

/// Lists the objects of a catalogue: a table (CSV), RON, a group catalogue of Gadget-4, AREPO or SUBFIND, haloes of Rockstar, AHF,
/// VELOCIraptor or HBT+, or merger trees of Gadget-4 or consistent-trees.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield catalogue groups.hdf5
  deepfield catalogue clusters.csv --most 5
  deepfield catalogue rockstar/out_99.list
  deepfield catalogue groups.hdf5 --json objects.json
  deepfield catalogue trees.hdf5 --time z:2                             the haloes at a moment
  deepfield catalogue trees.hdf5 --history \"Subhalo 12\" -o halo.csv     what it was at each step
  deepfield catalogue fof_subhalo_tab_040.hdf5 --history \"Subhalo 12\"   with the links beside it, subhalo_desc_NNN.hdf5
  deepfield catalogue snap_040.z0.000.AHF_halos --history \"Halo 12\"     with those of all lists, snap_NNN.zZ.AHF_mtree")]
pub struct Arguments {
    /// The catalogue: a file or folder of this machine, not a URL.
    pub path: PathBuf,
    /// Objects that the table lists at most; 0: all.
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub most: usize,
    /// When, of catalogues of several steps: a time, step:12, z:1.5, a:0.4 or last [default: the file's own step, of a file of all steps the
    /// last].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// The history of the halo that has this name at the step of that time: a row for each step, back along the heaviest progenitors
    /// and on along descendants, with the haloes that merge into it.
    #[arg(long, value_name = "NAME", conflicts_with = "most")]
    pub history: Option<String>,
    /// Write the history to a file.
    #[arg(short, long, value_name = "FILE.csv", requires = "history", conflicts_with = "json")]
    pub out: Option<PathBuf>,
    /// Write JSON, with all objects, to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
}

/// Reads and prints.
///
/// # Errors
/// When the catalogue cannot be read.
pub fn run(arguments: &Arguments) -> CommandResult {
    let path = file_in(&arguments.path, &[])?;
    heights::refuse(&path, "a catalogue of objects")?;
    let of_run = arguments.time.is_some() || arguments.history.is_some();
    let tree = if of_run { MergerTree::of_series(&path)? } else { None };
    let Some(tree) = tree else {
        if of_run {
            let expected =
                "expected trees, a table with ids, steps and descendants, or catalogues with links beside them";
            return Err(format!("{}: one step, without links: {expected}", path.display()).into());
        }
        return arguments.list(&Catalogue::read(&path)?);
    };
    let times = tree.times();
    let refused = |reason: String| format!("{}: --time: {reason}", path.display());
    let moment = arguments.time.map(|when| times.moment(when).map_err(refused)).transpose()?;
    let Some(name) = &arguments.history else {
        let time = moment.map(|moment| times.time(moment));
        return arguments.list(&Catalogue::of_tree(Arc::new(tree), time)?);
    };
    let step = moment.map_or(tree.own_step, |moment| moment.step);
    let history = tree.history(tree.named(step, name)?);
    if let Some(out) = &arguments.json {
        return write_json(out, &history);
    }
    let text = merger_tree::csv(&tree, &history);
    match &arguments.out {
        Some(out) => Ok(write_atomically(out, text.as_bytes())?),
        None => Ok(std::io::stdout().write_all(text.as_bytes())?),
    }
}

impl Arguments {
    /// Lists objects.
    fn list(&self, catalogue: &Catalogue) -> CommandResult {
        match &self.json {
            Some(out) => write_json(out, catalogue),
            None => Ok(std::io::stdout().write_all(table(catalogue, self.most).as_bytes())?),
        }
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
