//! `deepfield synth`: seeded synthetic snapshots.

use super::CommandResult;
use super::progress_bar::TerminalProgress;
use crate::synth::{clusters::Clusters, gadget};
use std::io::Write;
use std::path::PathBuf;

/// Writes a seeded synthetic snapshot: the same bytes on any machine.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield synth clusters -n 1000000 -o clusters.gadget2")]
pub struct Arguments {
    /// What to make: `clusters`, gas in haloes, filaments and a thin background, with SPH smoothing lengths.
    #[arg(value_parser = ["clusters"])]
    pub kind: String,
    /// Number of particles.
    #[arg(short = 'n', long = "particles", value_name = "N", value_parser = clap::value_parser!(u64).range(1..=gadget::MOST))]
    pub particles: u64,
    /// The file to write: Gadget binary, format 2.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Another seed makes another universe.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Writes the snapshot; nothing is left behind on failure.
///
/// # Errors
/// When the file cannot be written; the message names it.
pub fn run(arguments: &Arguments) -> CommandResult {
    let name = |error: std::io::Error| format!("{}: {error}", arguments.output.display());
    let folder = match arguments.output.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => std::path::Path::new("."),
    };
    let file = tempfile::NamedTempFile::new_in(folder).map_err(name)?;
    let mut out = std::io::BufWriter::with_capacity(1 << 20, file);
    let generator = Clusters::new(arguments.seed, arguments.particles);
    gadget::write(&generator, &mut out, &TerminalProgress::new()).map_err(name)?;
    out.flush().map_err(name)?;
    let file = out.into_inner().map_err(|error| name(error.into_error()))?;
    file.persist(&arguments.output).map_err(|error| name(error.error))?;
    Ok(())
}
