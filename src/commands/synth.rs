//! `deepfield synth`: seeded synthetic snapshots.

use super::CommandResult;
use super::arguments::{count, positive};
use super::progress_bar::TerminalProgress;
use crate::synth::cosmology::{Cosmology, DEFAULT_EDGE};
use crate::synth::merger::Merger;
use crate::synth::moving::{self, Births, Halo, Moving, Orbits, Pancake};
use crate::synth::{Generator, cloud::Cloud, clusters::Clusters, filaments::Filaments, files, gadget};
use std::path::PathBuf;

/// What can be made.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Dark matter of a Lambda-CDM universe today: a web, and in it haloes with nearly half of the particles
    Cosmology,
    /// Gas of two merging white dwarfs in a wide, thin envelope; smoothing lengths differ 1400-fold. With --steps a run
    Merger,
    /// Gas in haloes, filaments and a thin background, quickly made
    Clusters,
    /// Gas in 60 thin, straight filaments in any direction
    Filaments,
    /// A flat Gaussian cloud of gas, turned
    Cloud,
    /// A run: gas on closed orbits, half of them Kepler's
    Orbits,
    /// A run: waves that collapse in a periodic box of a universe that expands
    Pancake,
    /// A run: a halo at rest, whose particles move in its field
    Halo,
    /// A run: particles that are born, vanish and change from gas to stars
    Births,
}

impl Kind {
    /// Moving particles; `None` for the kinds of one snapshot.
    fn moving(self, seed: u64, particles: u64, steps: usize) -> Option<Box<dyn Moving>> {
        Some(match self {
            Kind::Orbits => Box::new(Orbits::new(seed, particles)),
            Kind::Pancake => Box::new(Pancake::new(seed, particles)),
            Kind::Halo => Box::new(Halo::new(seed, particles)),
            Kind::Births => Box::new(Births::new(seed, particles, steps)),
            Kind::Merger => Box::new(moving::Merger::new(seed, particles)),
            Kind::Cosmology | Kind::Clusters | Kind::Filaments | Kind::Cloud => return None,
        })
    }
}

/// Writes a seeded synthetic snapshot, of any size and the same on any machine, as Gadget binary files (format 2).
///
/// Above 357 million particles the snapshot is in several files, FILE.0, FILE.1, ...; open any one of them. Particles
/// are written as they are made, so that memory does not grow with their number (below 700 MB for cosmology). A run is FILE_000,
/// FILE_001, ...: where its particles are at any time, docs/series.md says.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield synth cosmology -n 1e9 -o universe.gadget2         40 GB
  deepfield synth cosmology -n 1e7 --box 50 --seed 7 -o small.gadget2
  deepfield synth merger -n 2e6 -o merger.gadget2
  deepfield synth orbits -n 1e5 --steps 32 -o orbits/run       a run of 32 snapshots
  deepfield synth merger -n 2e6 --steps 84 -o merger/run
  deepfield synth pancake -n 1e5 --steps 9 --irregular 3 -o pancake/run")]
pub struct Arguments {
    /// What to make.
    pub kind: Kind,
    /// Number of particles, such as 1000000 or 1e9.
    #[arg(short = 'n', long = "particles", value_name = "N", value_parser = count)]
    pub particles: u64,
    /// The file to write: Gadget binary, format 2, whatever its name.
    #[arg(short, long, value_name = "FILE", value_parser = output)]
    pub output: PathBuf,
    /// Another seed makes another universe.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Edge of the box of a cosmology, Mpc/h [default: 100].
    #[arg(long = "box", value_name = "MPC", value_parser = edge)]
    pub edge: Option<f64>,
    /// Steps of a run [default: 16].
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    pub steps: Option<u16>,
    /// How many times as long as the shortest interval of a run the longest one may be [default: 1].
    #[arg(long, value_name = "R", value_parser = irregular)]
    pub irregular: Option<f64>,
    /// Most particles in one file.
    #[arg(long, value_name = "N", value_parser = count, default_value_t = gadget::MOST)]
    pub per_file: u64,
}

/// A path that does not promise another format.
fn output(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let extension = path.extension().map(|end| end.to_string_lossy().to_lowercase()).unwrap_or_default();
    if ["hdf5", "h5", "hdf"].contains(&extension.as_str()) {
        return Err("only Gadget's binary format is written, not HDF5; expected a name such as FILE.gadget2".into());
    }
    Ok(path)
}

/// An edge whose lengths and densities stay within single precision.
fn edge(text: &str) -> Result<f64, String> {
    positive(text)
        .ok()
        .filter(|edge| (1.0..=10_000.0).contains(edge))
        .ok_or_else(|| "expected an edge from 1 to 10000 Mpc/h".into())
}

/// A ratio of lengths that leaves intervals apart.
fn irregular(text: &str) -> Result<f64, String> {
    let ratio = text.parse().ok().filter(|ratio: &f64| (1.0..=1000.0).contains(ratio));
    ratio.ok_or_else(|| "expected a ratio from 1 to 1000".into())
}

/// Writes the snapshot, or those of a run; nothing is left behind on failure.
///
/// # Errors
/// When a file cannot be written; the message names it.
pub fn run(arguments: &Arguments) -> CommandResult {
    let (seed, particles) = (arguments.seed, arguments.particles);
    if arguments.edge.is_some() && arguments.kind != Kind::Cosmology {
        let message = "--box: only a cosmology has a box to choose\n";
        clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, message).exit();
    }
    let progress = TerminalProgress::new();
    let steps = usize::from(arguments.steps.unwrap_or(16));
    let is_one = arguments.kind == Kind::Merger && arguments.steps.is_none();
    if let Some(moving) = arguments.kind.moving(seed, particles, steps).filter(|_| !is_one) {
        let times = moving::times(&*moving, steps, arguments.irregular.unwrap_or(1.0), seed);
        moving::write(&*moving, &times, seed, &arguments.output, &progress)?;
        return Ok(());
    }
    if arguments.irregular.is_some() && is_one {
        let message = "--irregular: a merger is a run with --steps\n";
        clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, message).exit();
    }
    if arguments.steps.is_some() || arguments.irregular.is_some() {
        let message = "--steps, --irregular: only merger, orbits, pancake, halo and births are runs\n";
        clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, message).exit();
    }
    let generator: Box<dyn Generator> = match arguments.kind {
        Kind::Cosmology => Box::new(Cosmology::new(seed, particles, arguments.edge.unwrap_or(DEFAULT_EDGE), &progress)),
        Kind::Merger => Box::new(Merger::new(seed, particles)),
        Kind::Filaments => Box::new(Filaments::new(seed, particles)),
        Kind::Cloud => Box::new(Cloud::new(seed, particles)),
        _ => Box::new(Clusters::new(seed, particles)),
    };
    files::write(generator.as_ref(), &arguments.output, arguments.per_file, &progress)?;
    Ok(())
}
