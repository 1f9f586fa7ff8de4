//! `deepfield bench`: the numbers of docs/results.md, again, on this machine.

pub mod build;
pub mod cluster;
pub mod compare;
pub mod compare_orbit;
pub mod flight;
pub mod frame;
pub mod heights;
pub mod hierarchies;
mod paged;
pub mod pages;
pub mod play;
mod plot;
pub mod presence;
mod process_memory;
mod processor_time;
pub mod published;
#[cfg(feature = "remote")]
pub mod remote;
pub mod sheet;
pub mod splat;
#[cfg(feature = "viewer")]
pub mod splat_gpu;

use crate::command_line::CommandResult;
use crate::look::is_field;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// Measures drawing or building on generated particles or heights, with the error beside every time.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield bench splat
  deepfield bench presence snapshot.df --repeat 3 --csv presence.csv
  deepfield bench build --sizes 1000000 --json build.json
  deepfield bench cluster --sizes 4000000 --repeat 3 --json cluster.json
  deepfield bench cluster --sizes 4000000 --repeat 3 --memory 500MiB --kills 30 --builds 10
  deepfield bench compare merger.hdf5 --family gas --size 900x600 --repeat 3 --output compare
  deepfield bench flight cosmology.df --backends compute --duration 60 --output flight
  deepfield bench hierarchies snapshot.hdf5 --budgets 1%,4%,16% --size 512x512
  deepfield bench hierarchies head.nrrd --hierarchies wavelet,mip --csv head.csv --output sheets
  deepfield bench published --repeat 3 --json published.json
  deepfield bench play run.df --duration 10 --frame-ms 100
  deepfield bench heights dem.df --duration 20 --json heights.json
  deepfield bench heights --sizes 1000000,64000000 --threads 2 --repeat 3 --duration 20
  deepfield bench heights dem.df --repeat 3 --ablations
  deepfield bench remote cosmology.df --rate 100Mbit --latency 50ms --frame-ms 100 --duration 20
  deepfield bench remote cosmology.df --faults --minutes 60 --frame-ms 100 --main-memory 1GiB
  deepfield bench flight --sizes 1000000 --backends cpu --duration 10 --ablations --sweep")]
pub struct Arguments {
    /// What to measure: splat (drawing of particles as they are), frame (converged level of detail), presence (what
    /// leaving particles out costs and saves), build (from a source to a page file), cluster (the same by several processes, some of which
    /// are killed), pages (reading and decoding),
    /// flight (a flight through a page file that streams in) or play (a run while time goes on), compare (every way to draw a volume or a surface), hierarchies (what becomes of
    /// particles, images and volumes within so many splats), published (the tables of HE03 beside its numbers), heights (building, pictures, a flight, picks and
    /// lines of a height field), or remote (a page file behind a URL over a link, the processor drawing).
    #[arg(value_parser = ["splat", "frame", "presence", "build", "cluster", "pages", "flight", "play", "compare", "hierarchies", "published", "heights", "remote"])]
    pub suite: String,
    /// What `bench presence`, `bench compare` and `bench hierarchies` draw and `bench flight` flies through: a source or page file, for
    /// `bench hierarchies` also an image or a volume [default: generated: clusters of the first of the sizes for `bench presence`, a merger
    /// for `bench compare`, cosmologies of all sizes for `bench flight` and `bench remote`, ground for `bench heights`; for `bench hierarchies` filaments and
    /// clusters of the first of the sizes, and volumes of a wave and of blobs of up to 64 samples along each side].
    pub path: Option<PathBuf>,
    /// Numbers of particles, of `bench heights` of samples.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_values_t = [200_000, 1_000_000, 4_000_000],
          value_parser = clap::value_parser!(u64).range(1..=crate::synth::gadget::MOST))]
    pub sizes: Vec<u64>,
    /// Numbers of threads.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_values_t = [1, 2],
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Vec<u16>,
    /// What draws in `bench splat`, `bench frame` and `bench flight`; `bench hierarchies` draws on the processor alone.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_values = ["cpu", "compute", "raster"],
          value_parser = ["cpu", "compute", "raster"])]
    pub backends: Vec<String>,
    /// Memory that builds may take, in `bench cluster` each process, such as 2GiB [default: half of what is free].
    #[arg(long, value_name = "BYTES", value_parser = crate::command_line::arguments::bytes)]
    pub memory: Option<u64>,
    /// How sources, temporary files and page files are read in `bench build` and `bench pages`.
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub read: crate::model::ReadMethod,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Width and height of the picture, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub pixels: u32,
    /// Budget of thinning in `bench frame`, of 255.
    #[arg(long, value_name = "E", default_value_t = 0.0, value_parser = crate::command_line::arguments::not_negative)]
    pub thinning: f64,
    /// Mean colour error, of 255, below which `bench presence` looks for the largest speed-up.
    #[arg(long, value_name = "E", default_value_t = 0.5, value_parser = crate::command_line::arguments::positive)]
    pub limit: f64,
    /// Also write the pictures' numbers of `bench presence` or `bench hierarchies` as CSV, a line each.
    #[arg(long, value_name = "OUT.csv")]
    pub csv: Option<PathBuf>,
    /// Seed of the generated particles.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Also write the results here; `-` is standard output.
    #[arg(long, value_name = "OUT")]
    pub json: Option<PathBuf>,
    /// What `bench flight` is like.
    #[command(flatten)]
    pub flight: flight::Options,
    /// What `bench compare` draws.
    #[command(flatten)]
    pub compare: compare::Options,
    /// What `bench hierarchies` compares.
    #[command(flatten)]
    pub hierarchies: hierarchies::Options,
    /// What `bench published` measures.
    #[command(flatten)]
    pub published: published::Options,
    /// Which processes `bench cluster` kills.
    #[command(flatten)]
    pub cluster: cluster::Options,
    /// What the link of `bench remote` is like.
    #[cfg(feature = "remote")]
    #[command(flatten)]
    pub remote: remote::Options,
}

/// The times of several repetitions, seconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Times {
    /// The middle one.
    pub median: f64,
    /// The fastest.
    pub fastest: f64,
}

impl Times {
    /// Median and fastest of some times; zeros for none.
    pub fn of(mut times: Vec<Duration>) -> Times {
        times.sort();
        let seconds = |index: usize| times.get(index).map_or(0.0, Duration::as_secs_f64);
        Times { median: seconds(times.len() / 2), fastest: seconds(0) }
    }
}

/// Runs a suite.
///
/// # Errors
/// When a file cannot be written or a backend fails.
pub fn run(arguments: &Arguments) -> CommandResult {
    let text = match arguments.suite.as_str() {
        "frame" => serde_json::to_string_pretty(&frame::measure(arguments)?)?,
        "presence" => serde_json::to_string_pretty(&presence::measure(arguments)?)?,
        "flight" => match arguments.path.as_deref().filter(|path| is_field(path)) {
            Some(path) => serde_json::to_string_pretty(&flight::fields::measure(arguments, path)?)?,
            None => serde_json::to_string_pretty(&flight::measure(arguments)?)?,
        },
        "heights" => serde_json::to_string_pretty(&heights::measure(arguments)?)?,
        "play" => serde_json::to_string_pretty(&play::measure(arguments)?)?,
        "compare" => serde_json::to_string_pretty(&compare::measure(arguments)?)?,
        "hierarchies" => serde_json::to_string_pretty(&hierarchies::measure(arguments)?)?,
        "published" => serde_json::to_string_pretty(&published::measure(arguments)?)?,
        "build" => serde_json::to_string_pretty(&build::measure(arguments)?)?,
        "cluster" => serde_json::to_string_pretty(&cluster::measure(arguments)?)?,
        "pages" => serde_json::to_string_pretty(&pages::measure(arguments)?)?,
        #[cfg(feature = "remote")]
        "remote" => serde_json::to_string_pretty(&remote::measure(arguments)?)?,
        #[cfg(not(feature = "remote"))]
        "remote" => return Err("bench remote: this deepfield was built without the feature `remote`".into()),
        _ => serde_json::to_string_pretty(&splat::measure(arguments)?)?,
    };
    match &arguments.json {
        Some(path) if path.as_os_str() == "-" => writeln!(std::io::stdout(), "{text}")?,
        Some(path) => std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))?,
        None => {}
    }
    Ok(())
}
