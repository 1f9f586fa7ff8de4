//! `deepfield build`: the arguments of [`crate::build`].

use super::CommandResult;
use super::arguments::bytes;
use super::derive_options::{DerivedQuantities, derived};
use super::heights::{self, HeightsOptions, TextureOptions};
use super::hierarchy_options::HierarchyOptions;
use super::job_options::JobOptions;
use super::progress_bar::TerminalProgress;
use super::raw_options::RawOptions;
use super::trace_options::TraceOptions;
use super::wavelet_options::WaveletOptions;
use crate::build::grid::{GridBuildOptions, build_grid};
use crate::build::{BuildOptions, FEW_PARTICLES, FlowOptions, Matching, RunBuild, TrackOptions, build_source};
use crate::codec::VqBits;
use crate::hierarchy::Matter;
use crate::hierarchy::kind::WAVELET;
use crate::import::{
    AttributeChoice, GridOptions, LoadOptions, RunOptions, Smoothing, Times, UnpackedOnce, grid_format, is_one_table,
    open_grid, open_run, sources_of, steps_in,
};
use crate::look::DataKind;
use crate::model::{ClockVariable, FamilyName, ReadMethod, Skipped, is_url};
use crate::store::run::{MOST_FLOW_LEVELS, Tangents};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Builds a page file: the error-bounded hierarchy that deepfield draws; of several snapshots a run, which holds one for each; of an image or
/// a volume a file of its samples and of oriented points over them; of heights a file of chunks of all levels; of a velocity field, with --trace, a run of particles that it carries along.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield build snapshot_099.hdf5 -o galaxy.df
  deepfield build snap_099.0 -o gas.df --family gas --attributes temperature,metallicity --vq-bits 16
  deepfield build positions.hdf5 -o halo.df --smoothing knn:64
  deepfield build merger.hdf5 -o merger.df --volume-levels
  deepfield build snapshot_099.hdf5 -o gas.df --family gas --derive velocity-dispersion,vorticity
                                                             with attributes from velocities of neighbours
  deepfield build snapshot_099.hdf5 -o slow-disk.df --page-size 8MiB --thinning-budget 0
  deepfield build huge.0.hdf5 -o /data/huge.df --memory 2GiB --temporary /scratch
  deepfield build huge.0.hdf5 -o huge.df --plan huge.job     as tasks, for many machines: docs/cluster.md
  deepfield build snapshot_*.hdf5 -o run.df --plan run.job   the same of a run: a task for each step, then one for tracks
  deepfield build --status huge.job                          how far that is
  deepfield build snapshot_*.hdf5 -o run.df                  a run: the snapshots in the order of their times
  deepfield build gaia/ -o gaia.df                           one table in many files, which are all of a folder
  deepfield build output/ -o run.df --every 5 --skip-damaged
  deepfield build @steps.txt -o run.df --times 0:0.2         files named in a list, which have no times of their own
  deepfield build movie.xyz -o run.df                        a file of many steps: extended XYZ, LAMMPS, GSD
  deepfield build head.nrrd -o head.df                       a volume, as oriented points over its samples
  deepfield build engine.nii.gz -o engine.df --ignore-below 5
                                                             without points for air
  deepfield build dem.tif -o dem.df                          measured heights, as chunks of samples with exact errors
  deepfield build scan.npy -o scan.df --spacing 0.5,0.5 --xy-unit um --height-unit nm
  deepfield build dem.tif -o dem.df --height-error 0.05      smaller: heights are within 0.05 of the source's, in its unit
  deepfield build dem.tif -o dem.df --texture photo.jpg      with a photo over it; photo.jpg@X0,Y0,X1,Y1 covers a rectangle
  deepfield build run.h5#fields/density -o density.df        a data set of several
  deepfield build gyre.npy --trace --times 0:0.5 --box 0,0,2,1 -o flow.df
                                                             a velocity field, as the paths of particles in it
  deepfield build abc.npy --trace --periodic --box 0,0,0,6.283185307,6.283185307,6.283185307 --seeds 100000 -o flow.df
  deepfield build ocean.npz --trace --instant 86400 --duration 864000 -o currents.df
  deepfield build wind_*.vti --trace --times 0:60 -o wind.df  a field with a file for each time")]
pub struct Arguments {
    /// The source; any file of a snapshot in several files. Several of them, a folder or a quoted pattern of them, or @LIST with one in
    /// each line make a run; a folder of tables with the same columns is one table without --times and --every.
    #[arg(required_unless_present_any = ["status", "cancel"])]
    pub sources: Vec<PathBuf>,
    /// Times of the steps of a run in place of those in the headers: a list such as 0,0.5,2, FROM:STEP, or steps for their numbers.
    #[arg(long, value_name = "TIMES", allow_hyphen_values = true)]
    pub times: Option<Times>,
    /// Keep only every N-th step of a run, from the first one on.
    #[arg(long, value_name = "N")]
    pub every: Option<NonZeroUsize>,
    /// Leave steps out whose files are damaged.
    #[arg(long)]
    pub skip_damaged: bool,
    /// What the time of a run is counted in [default: the scale factor of comoving data, else time]. Particles move evenly in it between
    /// steps whose velocities are the same.
    #[arg(long, value_name = "CLOCK", value_parser = clock)]
    pub clock: Option<ClockVariable>,
    /// How particles of one step are found at the next: auto (ids; without ids the order, where velocities bear that out), ids, order or
    /// none.
    #[arg(long, value_name = "HOW", default_value = "auto")]
    pub r#match: Matching,
    /// Where the directions of tracks come from at steps: velocity, differences (of positions at neighbouring steps) or none (straight
    /// lines) [default: velocities, where displacements bear them out].
    #[arg(long, value_name = "HOW")]
    pub tangents: Option<Tangents>,
    /// Levels of flow above the particles' tracks, for paths: clusters that stay together within an error in space and time; 0: none
    /// [default: as many as keep the finest one small beside the particles].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=MOST_FLOW_LEVELS as i64))]
    pub flow_levels: Option<u32>,
    /// The error of the coarsest flow level, in the run's length unit; each finer one has half of it [default: half of how far the
    /// middle 80 % of the particles reach].
    #[arg(long, value_name = "LENGTH", value_parser = super::arguments::positive)]
    pub flow_error: Option<f64>,
    /// Keep stored steps only, and nothing of how particles move between them.
    #[arg(long, conflicts_with = "no_stills")]
    pub stills_only: bool,
    /// Keep tracks only: less space, and pictures of steps are drawn from tracks, too, within their rounding.
    #[arg(long)]
    pub no_stills: bool,
    /// The page file to write.
    #[arg(short, long, value_name = "FILE.df", required_unless_present_any = ["status", "cancel"], default_value = "-", hide_default_value = true)]
    pub output: PathBuf,
    /// What the source is taken for: particles turns a volume's voxels into particles, for the hierarchies of particles.
    #[arg(long = "as", value_enum, value_name = "WHAT", default_value_t)]
    pub as_what: As,
    /// Keep only this family (gas, dark, type2, type3, stars, black-holes); may be repeated.
    #[arg(long, value_name = "NAME", value_parser = super::arguments::family_name)]
    pub family: Vec<FamilyName>,
    /// Attributes to keep, by name [default: the most telling ones, at most four].
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    pub attributes: Option<Vec<String>>,
    /// Where smoothing lengths come from: auto, field:NAME or knn:K (distance to the K-th neighbour).
    #[arg(long, value_name = "HOW", default_value = "auto")]
    pub smoothing: Smoothing,
    /// Attributes to derive from velocities, beside those that are kept: velocity-dispersion, divergence, vorticity, mach-number, or all:
    /// all of them that can be had, with a note of what cannot. Each takes one of the five places for attributes.
    #[arg(long, value_name = "A,B,...", value_parser = derived)]
    pub derive: Option<DerivedQuantities>,
    /// Bits of a codebook index: 8, 12 or 16. More bits are more exact and take more space [default: 8; 16 of a source of less than
    /// 65536 particles, each of which then has its own values].
    #[arg(long, value_name = "BITS")]
    pub vq_bits: Option<VqBits>,
    /// Leave out the four bits more that codes of leaves have, which tell smoothing lengths more finely: pictures of column density differ
    /// several times as much from the source's, and older versions read the file. 16 bits have none left over. Of either kind of file `info`
    /// does not tell how far column densities are off.
    #[arg(long)]
    pub plain_codes: bool,
    /// Keep positions to 21 bits of a leaf's edge instead of rounding them to 1/512 of the smoothing length; takes more space.
    #[arg(long)]
    pub exact_positions: bool,
    /// Add levels of detail for the modes volume, isosurface and volume-isosurface to those for splats; takes more space.
    #[arg(long)]
    pub volume_levels: bool,
    /// Memory that the build may take, such as 2GiB [default: half of what is free]; temporary files hold the rest.
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Folder for temporary files [default: that of the output].
    #[arg(long, value_name = "FOLDER")]
    pub temporary: Option<PathBuf>,
    /// Threads [default: all]. The file is the same for any number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// How the source and temporary files are read. The file is the same for both.
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub read: ReadMethod,
    /// A build by many processes.
    #[command(flatten)]
    pub job: JobOptions,
    /// How the hierarchy is built.
    #[command(flatten)]
    pub hierarchy: HierarchyOptions,
    /// How points of images and volumes are chosen.
    #[command(flatten)]
    pub wavelet: WaveletOptions,
    /// What a file without a header holds.
    #[command(flatten)]
    pub raw: RawOptions,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: HeightsOptions,
    /// A photo over them.
    #[command(flatten)]
    pub texture: TextureOptions,
    /// How far heights of the file may be from the source's, in the unit of heights: a larger error makes a smaller file [default: they are
    /// the source's own].
    #[arg(long, value_name = "HEIGHT", allow_hyphen_values = true, help_heading = "Height fields")]
    pub height_error: Option<f64>,
    /// How particles are traced through a velocity field.
    #[command(flatten)]
    pub tracing: TraceOptions,
}

/// What a source is taken for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum As {
    /// What it is: particles, an image or a volume.
    #[default]
    Itself,
    /// Particles; of a volume its voxels.
    Particles,
}

fn clock(text: &str) -> Result<ClockVariable, String> {
    let found = ClockVariable::ALL.into_iter().find(|clock| clock.name() == text);
    found.ok_or_else(|| "expected time, scale-factor or log-scale-factor".into())
}

/// Only particles have velocities to derive from, and are built by many processes.
fn refuse_other(arguments: &Arguments, path: &Path, found: &str) -> Result<(), String> {
    let path = path.display();
    match (&arguments.derive, &arguments.job.plan) {
        (Some(_), _) => Err(format!("{path}: --derive: found {found}, expected particles with velocities")),
        (None, Some(_)) => Err(format!("{path}: --plan: found {found}, expected snapshots of particles")),
        (None, None) => Ok(()),
    }
}

/// Builds and writes the page file or the run.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    if let Some(done) = arguments.job.of_job() {
        return done;
    }
    // What it is, and of how many steps, is asked before it is opened.
    let _held = if let [only] = &arguments.sources[..] { Some(UnpackedOnce::of(only)) } else { None };
    let raw = arguments.raw.grid()?;
    let trace = arguments.tracing.trace(arguments.times.as_ref());
    if let [only] = &arguments.sources[..]
        && arguments.as_what == As::Itself
        && trace.is_none()
        && raw.is_none()
        && arguments.heights.takes(only)
    {
        arguments.wavelet.refuse(only, "heights")?;
        refuse_other(arguments, only, "heights")?;
        return heights::build::run(arguments, only);
    }
    arguments.texture.refuse()?;
    heights::refuse_without(&arguments.sources[0], &arguments.heights.given())?;
    if arguments.height_error.is_some() {
        let named = arguments.sources[0].display();
        return Err(format!("{named}: --height-error: found no heights, expected some").into());
    }
    for path in &arguments.sources {
        match DataKind::of(path) {
            Ok(DataKind::Source) => {}
            Ok(kind) => {
                let (path, found) = (path.display(), kind.described());
                return Err(format!("{path}: content: found {found}, expected a source to build it of").into());
            }
            // Nothing behind a URL is a source.
            Err(error) if is_url(path) => return Err(error.into()),
            // Patterns, lists and folders of sources are no files.
            Err(_) => {}
        }
    }
    if let [only] = &arguments.sources[..]
        && arguments.as_what == As::Itself
        && trace.is_none()
        && (raw.is_some() || grid_format(only)?.is_some())
    {
        refuse_other(arguments, only, "an image or a volume")?;
        return grid(arguments, only, GridOptions { raw, read: arguments.read });
    }
    let found = if trace.is_some() { "velocities to trace" } else { "particles" };
    arguments.wavelet.refuse(&arguments.sources[0], found)?;
    if let Some(kinds) = arguments.hierarchy.of(Matter::Grids) {
        let named = arguments.sources[0].display();
        return Err(format!("{named}: hierarchy {kinds}: found particles, expected an image or a volume").into());
    }
    let mut options = BuildOptions {
        attributes: arguments.attributes.clone(),
        memory: arguments.memory,
        temporary: arguments.temporary.clone(),
        threads: arguments.threads.map(usize::from),
        read: arguments.read,
        exact_below: if arguments.vq_bits.is_none() { FEW_PARTICLES } else { 0 },
        ..BuildOptions::with_vq_bits(arguments.vq_bits.unwrap_or_default())
    };
    arguments.hierarchy.apply(&mut options);
    options.octree.exact_positions = arguments.exact_positions;
    options.octree.refined = !arguments.plain_codes;
    options.octree.volume_levels = arguments.volume_levels;
    let derive = arguments.derive.as_ref().map(|derived| derived.0.clone()).unwrap_or_default();
    let load_options = LoadOptions {
        families: arguments.family.clone(),
        attributes: arguments.attributes.clone().map_or(AttributeChoice::Usual, AttributeChoice::Named),
        smoothing: arguments.smoothing.clone(),
        derive: derive.clone(),
        ..LoadOptions::default()
    };
    let progress = TerminalProgress::new();
    let is_one = arguments.times.is_none() && arguments.every.is_none();
    let sources = match &arguments.sources[..] {
        // Parts of a table are told apart by numbers, as steps are.
        [only] if is_one && trace.is_none() && is_one_table(only)? => vec![only.clone()],
        names => sources_of(names)?,
    };
    let flow = FlowOptions { levels: arguments.flow_levels.map(|levels| levels as usize), error: arguments.flow_error };
    let tracks = TrackOptions {
        matching: arguments.r#match,
        tangents: arguments.tangents,
        flow,
        no_stills: arguments.no_stills,
    };
    let tracks = (!arguments.stills_only).then_some(&tracks);
    let skip_damaged = arguments.skip_damaged;
    let build = RunBuild { load: &load_options, options: &options, tracks, skip_damaged, still_of: None };
    let one = |source: &Path| match &arguments.job.plan {
        Some(folder) => arguments.job.plan(folder, source, &load_options, &options, &arguments.output, &progress),
        None => build_one(source, &load_options, &options, &arguments.output, &progress),
    };
    if let Some(trace) = trace {
        if arguments.job.plan.is_some() {
            let named = arguments.sources[0].display();
            return Err(format!("{named}: --plan: found velocities to trace, expected snapshots of particles").into());
        }
        return build.build_traced(&sources, &trace, &arguments.output, &progress).map(drop).map_err(Into::into);
    }
    if let (true, [source]) = (is_one, &sources[..])
        && steps_in(source)? == 1
    {
        return one(source);
    }
    let run_options = RunOptions {
        times: arguments.times.clone(),
        every: arguments.every,
        skip_damaged: arguments.skip_damaged,
        attributes: arguments.attributes.clone().map(|mut names| {
            names.retain(|name| !derive.iter().any(|quantity| quantity.name() == name));
            names
        }),
        clock: arguments.clock,
    };
    let run = open_run(&sources, &run_options, options.read)?;
    match &run.steps[..] {
        // Files of one snapshot.
        [only] if is_one && !arguments.skip_damaged => one(&only.about.path),
        _ => match &arguments.job.plan {
            Some(folder) => arguments.job.plan_run(folder, &run, &build, &arguments.output, &progress),
            None => build.build(run, &arguments.output, &progress).map(drop).map_err(Into::into),
        },
    }
}

/// Builds the file of an image or a volume.
fn grid(arguments: &Arguments, path: &Path, options: GridOptions) -> CommandResult {
    let source = open_grid(path, &options)?;
    let grid = source.grid();
    if let Some(kinds) = arguments.hierarchy.of(Matter::Particles) {
        let (a, many) = if grid.dimensions == 2 { ("an image", "images") } else { ("a volume", "volumes") };
        let voxels = if grid.dimensions == 3 { "; --as particles takes their voxels" } else { "" };
        let path = path.display();
        let own = WAVELET.name;
        return Err(format!(
            "{path}: hierarchy {kinds}: found {a}, expected particles ({many} are built as {own}{voxels})"
        )
        .into());
    }
    let options = GridBuildOptions {
        points: arguments.wavelet.options(path, grid)?,
        memory: arguments.memory,
        threads: arguments.threads.map(usize::from),
        temporary: arguments.temporary.clone(),
    };
    let built = build_grid(&source, &options, &arguments.output, &TerminalProgress::new())?;
    built.notes.iter().for_each(|note| eprintln!("note: {note}"));
    Ok(())
}

/// Builds the page file of one source.
fn build_one(
    source: &Path,
    load_options: &LoadOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &TerminalProgress,
) -> CommandResult {
    let built = build_source(source, load_options, options, output, progress)?;
    for Skipped { reason, count } in &built.metadata.skipped {
        eprintln!("left out {count} particles: {reason}");
    }
    Ok(())
}
