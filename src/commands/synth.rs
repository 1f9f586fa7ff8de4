//! `deepfield synth`: seeded synthetic snapshots, images and volumes.

use super::CommandResult;
use super::arguments::{count, positive};
use super::heights::synth::{self, SurfaceArguments};
use super::progress_bar::TerminalProgress;
use crate::hierarchy::wavelet::sets::directions;
use crate::synth::cosmology::{Cosmology, DEFAULT_EDGE};
use crate::synth::grids::{self, SyntheticGrid};
use crate::synth::merger::Merger;
use crate::synth::moving::{self, Births, Halo, Moving, Orbits, Pancake};
use crate::synth::{Generator, cloud::Cloud, clusters::Clusters, filaments::Filaments, files, gadget, grid_files};
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
    /// An image or volume: a plane wave whose frequency is in the middle of the octave of --level
    Wave,
    /// An image or volume: a soft edge along --angle
    Edge,
    /// An image or volume: a Gaussian, 16 samples wide
    Blob,
    /// An image or volume: many Gaussians, in bytes
    Blobs,
    /// An image or volume: two noisy plateaus, in bytes
    Plateaus,
    /// Measured heights of a --shape
    Surface,
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
            _ => return None,
        })
    }

    /// What an image or volume shows; `None` for particles.
    fn grid(self, arguments: &Arguments) -> Option<grids::Kind> {
        let angle = arguments.angle.unwrap_or(0.0);
        Some(match self {
            Kind::Wave => grids::Kind::Wave {
                level: u32::from(arguments.level.unwrap_or(2)),
                direction: usize::from(arguments.direction.unwrap_or(0)),
                angle,
            },
            Kind::Edge => grids::Kind::Edge { angle },
            Kind::Blob => grids::Kind::Blob,
            Kind::Blobs => grids::Kind::Blobs,
            Kind::Plateaus => grids::Kind::Plateaus,
            _ => return None,
        })
    }
}

/// Writes a seeded synthetic snapshot, of any size and the same on any machine, as Gadget binary files (format 2); or an image or volume, or
/// measured heights.
///
/// Above 357 million particles the snapshot is in several files, FILE.0, FILE.1, ...; open any one of them. Particles
/// are written as they are made, so that memory does not grow with their number (below 700 MB for cosmology). A run is FILE_000,
/// FILE_001, ...: where its particles are at any time, docs/series.md says. Images and volumes are NRRD, or NumPy where FILE ends in .npy; heights
/// are .npy, .tif, .asc or .x3p.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield synth cosmology -n 1e9 -o universe.gadget2         40 GB
  deepfield synth cosmology -n 1e7 --box 50 --seed 7 -o small.gadget2
  deepfield synth merger -n 2e6 -o merger.gadget2
  deepfield synth orbits -n 1e5 --steps 32 -o orbits           a run of 32 snapshots, orbits_000 to orbits_031
  deepfield synth merger -n 2e6 --steps 84 -o merger
  deepfield synth pancake -n 1e5 --steps 9 --irregular 3 -o pancake
  deepfield synth blobs --size 1024,1024,1024 -o blobs.nrrd    1 GiB of bytes
  deepfield synth surface --shape fbm --size 4000x3000 --type i16 -o hills.npy
  deepfield synth wave --size 128,128 --level 3 --direction 1 -o wave.npy")]
pub struct Arguments {
    /// What to make.
    pub kind: Kind,
    /// Number of particles, such as 1000000 or 1e9.
    #[arg(short = 'n', long = "particles", value_name = "N", value_parser = count)]
    pub particles: Option<u64>,
    /// Samples of an image, a volume or heights along x, y and z.
    #[arg(long, value_name = "W,H[,D]", value_parser = size, conflicts_with = "particles")]
    pub size: Option<Size>,
    /// Level of the nodes that a wave needs: it has 0.75 / 2^M cycles a sample [default: 2].
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(u8).range(1..=30))]
    pub level: Option<u8>,
    /// Direction of a wave, one of the 4 of images or the 13 of volumes as `info` lists them, from 0 on [default: 0].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=12))]
    pub direction: Option<u8>,
    /// Direction of an edge, or by what a wave is turned from its direction, degrees from x to y [default: 0].
    #[arg(long, value_name = "DEGREES", value_parser = angle, allow_negative_numbers = true)]
    pub angle: Option<f64>,
    /// The file to write: Gadget binary, format 2, whatever its name; of images and volumes NRRD, or NumPy (.npy); of
    /// heights .npy, .tif, .asc or .x3p.
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
    /// What is said of heights.
    #[command(flatten)]
    pub surface: SurfaceArguments,
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

/// The samples of an image or a volume along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    dimensions: usize,
    shape: [u64; 3],
}

/// Two or three numbers of samples.
fn size(text: &str) -> Result<Size, String> {
    let wrong = || "expected two or three numbers of samples from 1 on, such as 512,512 or 256,256,256".to_owned();
    let sides: Vec<u64> = text.split([',', 'x']).map(count).collect::<Result<_, _>>().map_err(|_| wrong())?;
    match sides[..] {
        [width, height] => Ok(Size { dimensions: 2, shape: [width, height, 1] }),
        [width, height, depth] => Ok(Size { dimensions: 3, shape: [width, height, depth] }),
        _ => Err(wrong()),
    }
}

/// Degrees.
fn angle(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees: &f64| degrees.is_finite());
    degrees.ok_or_else(|| "expected degrees".into())
}

/// Ends the program with a message about options that do not go together.
fn conflict(message: &str) -> ! {
    clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, format!("{message}\n")).exit()
}

/// A ratio of lengths that leaves intervals apart.
fn irregular(text: &str) -> Result<f64, String> {
    let ratio = text.parse().ok().filter(|ratio: &f64| (1.0..=1000.0).contains(ratio));
    ratio.ok_or_else(|| "expected a ratio from 1 to 1000".into())
}

/// Writes the snapshot, those of a run, or the image or volume; nothing is left behind on failure.
///
/// # Errors
/// When a file cannot be written; the message names it.
pub fn run(arguments: &Arguments) -> CommandResult {
    let seed = arguments.seed;
    if arguments.edge.is_some() && arguments.kind != Kind::Cosmology {
        conflict("--box: only a cosmology has a box to choose");
    }
    if (arguments.level.is_some() || arguments.direction.is_some()) && arguments.kind != Kind::Wave {
        conflict("--level, --direction: only a wave has them");
    }
    if arguments.angle.is_some() && !matches!(arguments.kind, Kind::Wave | Kind::Edge) {
        conflict("--angle: only a wave and an edge have one");
    }
    if arguments.kind == Kind::Surface {
        let Some(Size { dimensions: 2, shape: [columns, rows, _] }) = arguments.size else {
            conflict("--size: expected two numbers of samples, columns and rows")
        };
        return synth::run(&arguments.surface, [columns, rows], seed, &arguments.output);
    }
    if arguments.surface.is_given() {
        conflict("--shape, --type, --invalid, --noise, --hurst, --spacing, --unit: only a surface has them");
    }
    let particles = match (arguments.kind.grid(arguments), arguments.size, arguments.particles) {
        (Some(kind), Some(size), _) => return grid(arguments, kind, size),
        (Some(_), None, _) => conflict("--size: missing, an image or a volume has one"),
        (None, None, Some(particles)) => particles,
        (None, Some(_), _) => {
            conflict("--size: only an image or a volume has one; a snapshot has a number of particles (-n)")
        }
        (None, None, None) => conflict("--particles: missing, a snapshot has a number of particles (-n)"),
    };
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

/// Writes an image or a volume.
fn grid(arguments: &Arguments, kind: grids::Kind, Size { dimensions, shape }: Size) -> CommandResult {
    if arguments.steps.is_some() || arguments.irregular.is_some() {
        conflict("--steps, --irregular: only merger, orbits, pancake, halo and births are runs");
    }
    if arguments.direction.is_some_and(|n| usize::from(n) >= directions(dimensions)) {
        conflict("--direction: an image has directions 0 to 3");
    }
    let grid = SyntheticGrid::new(kind, dimensions, shape, arguments.seed);
    grid_files::write(&grid, &arguments.output, &TerminalProgress::new())?;
    Ok(())
}
