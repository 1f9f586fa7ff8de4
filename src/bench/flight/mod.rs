//! `deepfield bench flight`: the straight flight of F12 4.10.3 through a page file, streamed as the window streams, with
//! the series of figure 4.9, the viewport sweep of figure 4.11, what each saving saves, and the check that a picture that
//! has streamed in is the one that was waited for.

pub mod canvas;
pub mod check;
pub mod engine;
pub mod fields;
pub mod light_canvas;
pub mod path;
pub mod plot;
pub mod series;

use super::splat::Failure;
use crate::build::{BuildOptions, build_source};
use crate::color::output;
use crate::command_line::arguments::{PictureSize, bytes, mode_name, not_negative, positive};
use crate::command_line::cache;
use crate::command_line::progress_bar::TerminalProgress;
use crate::import::LoadOptions;
use crate::mode::{Depiction, Levels, LodBudget, Mode, Plan, Settings};
use crate::modes::{column_density, density_squared};
use crate::picture::drawing_cost::DrawingCost;
use crate::picture::splat_budget::SplatBudget;
use crate::picture::stand_in::StandIn;
use crate::store::{PageFile, Tree};
use crate::stream::{CopyOptions, StreamOptions, first_frame};
use crate::synth::cosmology::{Cosmology, DEFAULT_EDGE};
use crate::synth::files;
use crate::synth::gadget::MOST;
use crate::view::View;
use canvas::{Canvas, CpuCanvas};
use check::{Check, check};
use engine::Engine;
use light_canvas::LightCanvas;
use path::Flight;
use serde::Serialize;
use series::Summary;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the flight is like.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Options of `bench flight`")]
pub struct Options {
    /// How long to fly, seconds; the middle of the flight is the middle of the data.
    #[arg(long, value_name = "SECS", default_value_t = 175.0, value_parser = positive)]
    pub duration: f64,
    /// Longest sides of the data's box that are flown in a second: 12.76 of 2230 million light years in F12.
    #[arg(long, value_name = "SIDES", default_value_t = 12.76 / 2230.0, value_parser = positive)]
    pub velocity: f64,
    /// Picture size in pixels [default: 1200x800 for `bench flight`, 1280x720 for `bench remote`, 600x400 for `bench compare`, 512x512 for `bench hierarchies`].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// Largest displacement of a particle on screen, pixels.
    #[arg(long, value_name = "TAU", default_value_t = 0.8, value_parser = positive)]
    pub error_px: f64,
    /// Visualization mode. Those that draw light (`volume`, `spheres`) are drawn from main memory, and their ranges are the first
    /// picture's [default: density-squared, or with `--levels clusters` column-density: clusters suit it]. `bench hierarchies` compares
    /// particles by `column-density`, volumes by `xray` and images by `image`, and takes no other.
    #[arg(long, value_name = "NAME", value_parser = mode_name)]
    pub mode: Option<&'static Mode>,
    /// Pages in main memory at most.
    #[arg(long, value_name = "BYTES", default_value = "2GiB", value_parser = bytes)]
    pub main_memory: u64,
    /// Copies of pages in the adapter's memory at most.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = bytes)]
    pub gpu_memory: u64,
    /// Copied to the adapter in a frame at most.
    #[arg(long, value_name = "BYTES", default_value = "24MiB", value_parser = bytes)]
    pub upload: u64,
    /// Pages that are read at a time.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub requests: u16,
    /// Particles fainter than 1/n of the darkest colour are dropped as they are drawn; 0: none.
    #[arg(long, value_name = "N", default_value_t = 100.0, value_parser = not_negative)]
    pub presence: f64,
    /// Mean colour error, of 255, that drawing a weighted sample of the particles may cause; 0: all are drawn.
    #[arg(long, value_name = "E", default_value_t = 1.0, value_parser = not_negative)]
    pub sampling: f64,
    /// Milliseconds that a frame may take to draw: the sample becomes as small as that needs; 0: no limit.
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = not_negative)]
    pub frame_ms: f64,
    /// What is drawn while the time of a frame is limited: clusters of files that have them (auto, clusters), or a sample of the
    /// splats.
    #[arg(long, value_name = "LEVELS", value_enum, default_value_t)]
    pub levels: Levels,
    /// Also fly without each of what saves work: particles that are merged or left out of coarse levels (where the data is
    /// generated), presence acceleration, culling of single particles, samples, prefetching. `bench heights` draws pictures without each of
    /// what makes them right: triangles, points, coverage, mean normals, corners that chunks share.
    #[arg(long)]
    pub ablations: bool,
    /// Also fly with pictures of other sizes.
    #[arg(long)]
    pub sweep: bool,
    /// Compare pictures that streamed in with pictures that were waited for, at so many places of the way.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub check: u16,
    /// Folder for the numbers, plots and pictures of `bench flight`, `bench compare` and `bench hierarchies` (there pictures.png,
    /// differences.png, exact.png, curves.png and curves.svg; of generated data in a folder each) [default: flight, compare, hierarchies].
    #[arg(long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
}

impl Options {
    /// What draws a tree as they say.
    pub(super) fn engine<'a>(
        &self,
        tree: Arc<dyn Tree>,
        depiction: Depiction,
        size: (u32, u32),
        canvas: &'a mut dyn Canvas,
    ) -> Engine<'a> {
        Engine {
            tree,
            depiction,
            tau: self.error_px,
            size,
            options: StreamOptions {
                budget: self.main_memory,
                in_flight: usize::from(self.requests),
                stall: Duration::from_secs(5),
                ..StreamOptions::default()
            },
            canvas,
            lod_budget: LodBudget { culling: true, presence: self.presence, thinning: self.sampling },
            plan: Plan::default(),
            frame_ms: (self.frame_ms > 0.0).then_some(self.frame_ms),
            drawing_cost: DrawingCost::default(),
            splat_budget: SplatBudget::default(),
            stand_in: StandIn::default(),
            selecting_ms: 0.0,
            messages: Vec::new(),
        }
    }

    /// The mode.
    pub fn mode(&self) -> &'static Mode {
        let usual = || match self.levels {
            Levels::Clusters => &column_density::MODE,
            _ => &density_squared::MODE,
        };
        self.mode.unwrap_or_else(usual)
    }

    /// The picture's size.
    pub(super) fn picture_size(&self) -> PictureSize {
        self.size.unwrap_or(PictureSize { width: 1200, height: 800 })
    }

    /// The folder that a flight writes to.
    fn folder(&self) -> &Path {
        self.output.as_deref().unwrap_or(Path::new("flight"))
    }
}

/// Sizes of the viewport sweep.
const SWEEP: [(u32, u32); 5] = [(600, 400), (900, 600), (1200, 800), (1500, 1000), (1920, 1280)];

/// One backend's flight.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// What was flown through.
    pub path: PathBuf,
    /// Number of source particles.
    pub particles: u64,
    /// Bytes of the page file.
    pub bytes: u64,
    /// What draws.
    pub backend: String,
    /// Adapter or threads.
    pub adapter: String,
    /// Seconds from opening the file until the first picture, and until that picture has converged, if it has.
    pub first_picture_s: f64,
    /// See `first_picture_s`.
    pub converged_s: Option<f64>,
    /// World units per second.
    pub speed: f64,
    /// The flight itself.
    pub flight: Summary,
    /// Flights without something: its name, and what the flight came to.
    pub ablations: Vec<(String, Summary)>,
    /// Flights with other pictures: width, height and what the flight came to.
    pub sweep: Vec<(u32, u32, Summary)>,
    /// Places at which a picture that streamed in was compared with one that was waited for, and the largest difference
    /// of a pixel, relative to the brightest one.
    pub checks: Vec<Check>,
    /// What was told about pages that cannot be read.
    pub messages: Vec<String>,
}

/// Flies with all backends and writes what came of it.
///
/// # Errors
/// When a file cannot be built, read or written, or a backend fails.
pub fn measure(arguments: &super::Arguments) -> Result<Vec<Outcome>, Failure> {
    let options = &arguments.flight;
    let folder = options.folder();
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let sizes = if arguments.path.is_some() { &arguments.sizes[..1] } else { &arguments.sizes[..] };
    let mut outcomes = Vec::new();
    for &particles in sizes {
        let path = match &arguments.path {
            Some(path) => cache::page_file_of(path, &TerminalProgress::new())?,
            None => generated(arguments.seed, particles, true)?,
        };
        for backend in &arguments.backends {
            let outcome = with_canvas(backend, &path, options, |engine, opened| {
                let mut outcome = fly(engine, options, opened, backend)?;
                if options.ablations {
                    ablate(engine, options, &mut outcome.ablations)?;
                }
                Ok(outcome)
            });
            let mut outcome = match outcome {
                Ok(outcome) => outcome,
                // All backends are asked for unless the user names some; not every machine has an adapter.
                Err(error) if arguments.backends.len() > 1 && outcomes.iter().any(|_: &Outcome| true) => {
                    eprintln!("deepfield: {backend}: {error}");
                    continue;
                }
                Err(error) => return Err(error),
            };
            if options.ablations && arguments.path.is_none() {
                let path = generated(arguments.seed, particles, false)?;
                let summary = with_canvas(backend, &path, options, |engine, _| once(engine, options))?;
                outcome.ablations.push(("without thinning".into(), summary));
            }
            print(&outcome);
            outcomes.push(outcome);
        }
    }
    Ok(outcomes)
}

/// The page file of a generated cosmology, made once. Its snapshot lies beside it only as long as it is built from.
pub(super) fn generated(seed: u64, particles: u64, thinning: bool) -> Result<PathBuf, Failure> {
    let folder = cache::folder("bench")?;
    let version = crate::store::layout::VERSION;
    let kind = if thinning { "" } else { "-unthinned" };
    let path = folder.join(format!("cosmology-{particles}-{seed}{kind}-v{version}.df"));
    if PageFile::open(&path).is_err() {
        let mut options = BuildOptions::default();
        if !thinning {
            options.octree.thinning_budget = 0.0;
        }
        eprintln!("building {}", path.display());
        let snapshots = tempfile::tempdir_in(&folder)?;
        let snapshot = snapshots.path().join("cosmology.gadget2");
        let progress = TerminalProgress::new();
        let universe = Cosmology::new(seed, particles, DEFAULT_EDGE, &progress);
        let files = files::write(&universe, &snapshot, MOST, &progress)?;
        let first = files.first().ok_or("no snapshot was written")?;
        build_source(first, &LoadOptions::default(), &options, &path, &progress)?;
    }
    Ok(path)
}

/// When a file was opened, and where its first picture is.
pub(super) struct Opened {
    pub at: Instant,
    pub bytes: u64,
    pub view: View,
    pub flight: Flight,
}

/// Opens file and backend, and does something with them.
pub(super) fn with_canvas<T>(
    backend: &str,
    path: &Path,
    options: &Options,
    work: impl FnOnce(&mut Engine, &Opened) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let at = Instant::now();
    let file = Arc::new(PageFile::open(path)?);
    let metadata = file.metadata();
    let families: Vec<u32> = (0..metadata.families.len() as u32).collect();
    let frame = first_frame(&file, &families, 0.0);
    let PictureSize { width, height } = options.picture_size();
    let fov_y = 45_f64.to_radians();
    let view = View::around(frame, fov_y, width, height)?;
    let flight = Flight::through(frame, options.velocity, options.duration, fov_y);
    let mut depiction = Depiction::new(options.mode(), Settings::default(), None, metadata)?;
    depiction.choice.levels = options.levels;
    let opening = at.elapsed();
    let (bytes, file) = (file.bytes(), file as Arc<dyn Tree>);
    let mut canvas = options.canvas(backend, &file, &depiction, &view)?;
    let mut engine = options.engine(file, depiction, (width, height), &mut *canvas);
    // A program that runs has opened its adapter before it opens a file.
    let opened = Opened { at: Instant::now().checked_sub(opening).unwrap_or(at), bytes, view, flight };
    work(&mut engine, &opened)
}

impl Options {
    /// What draws with a backend.
    pub(super) fn canvas(
        &self,
        backend: &str,
        tree: &Arc<dyn Tree>,
        depiction: &Depiction,
        view: &View,
    ) -> Result<Box<dyn Canvas>, Failure> {
        let copies = CopyOptions { budget: self.gpu_memory, on_their_way: 2 * self.upload };
        Ok(match backend {
            "cpu" if self.mode().is_light() => Box::new(LightCanvas::new(Arc::clone(tree), depiction.clone(), None)),
            "cpu" => Box::new(CpuCanvas::new(Arc::clone(tree), depiction.clone())),
            _ => on_gpu(backend, tree, depiction, view, copies)?,
        })
    }
}

#[cfg(feature = "viewer")]
fn on_gpu(
    backend: &str,
    file: &Arc<dyn Tree>,
    depiction: &Depiction,
    view: &View,
    copies: CopyOptions,
) -> Result<Box<dyn Canvas>, Failure> {
    use crate::gpu::{Backend, Offscreen};
    let backend = if backend == "raster" { Backend::Raster } else { Backend::Compute };
    if depiction.mode.is_light() {
        if backend == Backend::Raster {
            return Err(format!("raster: only compute and cpu draw the mode {}", depiction.mode.name).into());
        }
        return Ok(Box::new(LightCanvas::new(
            Arc::clone(file),
            depiction.clone(),
            Some(Box::new(Offscreen::default())),
        )));
    }
    Ok(Box::new(canvas::GpuCanvas::open(Arc::clone(file), depiction.clone(), backend, view, copies)?))
}

#[cfg(not(feature = "viewer"))]
fn on_gpu(
    backend: &str,
    _file: &Arc<dyn Tree>,
    _depiction: &Depiction,
    _view: &View,
    _copies: CopyOptions,
) -> Result<Box<dyn Canvas>, Failure> {
    Err(format!("this deepfield was built without the feature `viewer`, so {backend} does not draw").into())
}

/// The first picture, the flight, the checks and the sweep.
fn fly(engine: &mut Engine, options: &Options, opened: &Opened, backend: &str) -> Result<Outcome, Failure> {
    let until_now = opened.at.elapsed().as_secs_f64();
    let first = {
        let mut streamer = engine.streamer();
        engine.converge(&mut streamer, &opened.view)?
    };
    let flight = opened.flight;
    let write = |name: &str, text: &[u8]| {
        let path = options.folder().join(name);
        output::write_atomically(&path, text).map_err(|error| -> Failure { error.to_string().into() })
    };
    let mut streamer = engine.streamer();
    engine.prepare(&mut streamer, &flight.view(0.0, engine.size.0, engine.size.1)?)?;
    let frames = engine.fly(&mut streamer, &flight, 0.0, flight.seconds)?;
    write(&format!("flight-{backend}.csv"), series::csv(&frames).as_bytes())?;
    write(&format!("flight-{backend}.svg"), plot::flight(&frames).as_bytes())?;
    drop(streamer);
    let mut checks = Vec::new();
    for station in 0..options.check {
        let seconds = flight.seconds * (f64::from(station) + 0.5) / f64::from(options.check);
        checks.push(check(engine, options, &flight, seconds, backend)?);
    }
    let mut sweep = Vec::new();
    if options.sweep {
        let usual = engine.size;
        for size in SWEEP {
            engine.size = size;
            sweep.push((size.0, size.1, once(engine, options)?));
        }
        engine.size = usual;
        let points: Vec<_> =
            sweep.iter().map(|(w, h, s)| ((*w, *h), s.frames_per_second, s.frames_per_second_deviation)).collect();
        write(&format!("sweep-{backend}.svg"), plot::sweep(&points).as_bytes())?;
    }
    let (name, adapter) = engine.canvas.name();
    Ok(Outcome {
        path: engine.tree.path().to_path_buf(),
        particles: engine.tree.metadata().particles(),
        bytes: opened.bytes,
        backend: name,
        adapter,
        first_picture_s: until_now + first.first_picture,
        converged_s: first.converged.map(|seconds| until_now + seconds),
        speed: flight.speed(),
        flight: Summary { color_error: mean_color_error(&checks), ..Summary::of(&frames) },
        ablations: Vec::new(),
        sweep,
        checks,
        messages: std::mem::take(&mut engine.messages),
    })
}

/// Flies without each saving in turn.
fn ablate(engine: &mut Engine, options: &Options, flights: &mut Vec<(String, Summary)>) -> Result<(), Failure> {
    let usual = engine.lod_budget;
    let without = [
        ("without presence acceleration", LodBudget { presence: 0.0, ..usual }),
        ("without culling of particles", LodBudget { culling: false, ..usual }),
        ("without samples", LodBudget { thinning: 0.0, ..usual }),
        ("without any of these", LodBudget { culling: false, presence: 0.0, thinning: 0.0 }),
    ];
    for (name, lod_budget) in without {
        engine.lod_budget = lod_budget;
        flights.push((name.into(), once(engine, options)?));
    }
    engine.lod_budget = usual;
    let streaming = std::mem::replace(&mut engine.options.prefetch, false);
    flights.push(("without prefetching".into(), once(engine, options)?));
    engine.options.prefetch = streaming;
    Ok(())
}

/// One more flight, from a converged first picture.
fn once(engine: &mut Engine, options: &Options) -> Result<Summary, Failure> {
    let tree = Arc::clone(&engine.tree);
    let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
    let frame = first_frame(&tree, &families, 0.0);
    let flight = Flight::through(frame, options.velocity, options.duration, 45_f64.to_radians());
    let mut streamer = engine.streamer();
    engine.prepare(&mut streamer, &flight.view(0.0, engine.size.0, engine.size.1)?)?;
    Ok(Summary::of(&engine.fly(&mut streamer, &flight, 0.0, flight.seconds)?))
}

/// The mean colour error of the places that were looked at; `None` without any.
fn mean_color_error(checks: &[Check]) -> Option<f64> {
    let sum: f64 = checks.iter().map(|check| check.color_error).sum();
    (!checks.is_empty()).then(|| sum / checks.len() as f64)
}

/// Prints what came of a flight to standard error.
fn print(outcome: &Outcome) {
    let Outcome { particles, backend, adapter, flight, .. } = outcome;
    let gigabytes = outcome.bytes as f64 / 1e9;
    eprintln!("{particles} particles, {gigabytes:.3} GB, {backend} on {adapter}");
    let converged = outcome.converged_s.map_or("never".into(), |seconds| format!("{seconds:.2} s"));
    eprintln!("  first picture {:.2} s, converged {converged}", outcome.first_picture_s);
    line("flight", flight);
    outcome.ablations.iter().for_each(|(name, summary)| line(name, summary));
    outcome.sweep.iter().for_each(|(width, height, summary)| line(&format!("{width}x{height}"), summary));
    for check in &outcome.checks {
        let state = if check.converged { "" } else { " (not converged)" };
        let over = check.overdraw.map_or_else(String::new, |[sample, all]| {
            format!(", with {:.1} splats over a pixel instead of {:.1}", sample.0, all.0)
        });
        eprintln!(
            "  at {:.1} s streamed and waited differ by {:.1e}{state}; in motion {} splats, colour error {:.2} of 255{over}",
            check.seconds, check.difference, check.drawn, check.color_error
        );
    }
    outcome.messages.iter().for_each(|message| eprintln!("  {message}"));
}

fn line(name: &str, summary: &Summary) {
    eprintln!(
        "  {name}: {:.1} frames/s, frame {:.1} ms (50 %) {:.1} ms (99 %), {:.1} M particles/frame (samples of {:.0} %), {:.0} M/s, memory {:.0} \
         MiB, disk {:.1} MB/s, GPU {:.0} MiB, upload {:.1} MB/s, not converged {:.1} % (worst {:.2} px)",
        summary.frames_per_second,
        summary.frame_ms_p50,
        summary.frame_ms_p99,
        summary.million_particles,
        100.0 * summary.sampled,
        summary.million_particles_per_second,
        summary.main_mib,
        summary.disk_mb_per_s,
        summary.gpu_mib,
        summary.upload_mb_per_s,
        100.0 * summary.not_converged,
        summary.worst_error_px
    );
}
