//! `deepfield view`: a source or page file in a window; without a display, its picture in a file.

use super::arguments::PictureSize;
use super::cached_run::{CachedRun, Grown};
use super::derive_options::DeriveOptions;
use super::heights::{BeforeOptions, HeightsOptions, SpacingOptions, TextureOptions};
use super::light_options::LightOptions;
use super::projection_options::ProjectionOptions;
use super::{CommandResult, print_line, render};
use crate::import::{file_of_step, sources_of, steps_in};
#[cfg(feature = "viewer")]
use crate::look::HeightsSaid;
use crate::look::{DataKind, Member, SceneFile, data_file, is_file_of, is_scene_file};
use crate::model::{When, is_url};
use crate::tour::TourFile;
#[cfg(feature = "viewer")]
use crate::view::{Stereo, Surround};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// What is wrong, in a line.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Opens a snapshot, catalogue, image, volume, height field, page file or run in a window.
///
/// A source is turned into a page file in the cache folder first. Where there is no display, the converged picture is
/// written to a file in the current folder instead. Without a file the window says what can be opened.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield view snapshot_099.hdf5
  deepfield view                                   a page to open files from: by a dialog, by dropping them, or again
  deepfield view snapshot_100.hdf5 --reuse         in the window that is open already
  deepfield view snapdir_099/                      the snapshot in a folder
  deepfield view snapdir_099/snap_099.0.hdf5       any file of a snapshot in several files
  deepfield view hipparcos.csv --mode points
  deepfield view gaia/                             one table in many files, which are all of a folder
  deepfield view snapshot_099.hdf5 --derive velocity-dispersion    an attribute that it lacks, for the hue
  deepfield view before.hdf5 --with after.hdf5@120,0,0   two datasets side by side
  deepfield view 'snapshot_*.hdf5'                  a run of snapshots, built in the cache while its first step is shown
  deepfield view output/ --follow-folder           a run that is still being written
  deepfield view surface.sur                       measured heights: I reads samples, G draws profiles
  deepfield view dem.tif --nodata -32768 --texture photo.jpg       what is said of a source goes into its file in the cache
  deepfield view after.df --before before.tif      what has changed, over the later surface
  deepfield view moon.tif --map globe:moon --with stars.csv        heights among particles: depth decides
  deepfield view movie.xyz                         a file of many steps
  deepfield view https://data.example.org/galaxy.df           a built file where it lies, also s3://BUCKET/KEY: docs/remote.md
  deepfield view run.df --time step:12             a run: T plays it, comma and full stop go from step to step
  deepfield view snapshot_099.scene.ron            what was saved with Ctrl+S
  deepfield view snapshot_099.hdf5 --projection dome --tilt 20 --fullscreen    a fisheye projector: Tab hides the panels
  deepfield view --tour assets/tours/demo.ron --fullscreen    Space plays and stands, arrows lead on and back
  deepfield view snapshot_099.hdf5 --lead --show-key show.key      others follow: docs/shows.md
  deepfield view snapshot_099.hdf5 --follow 192.168.0.10 --show-key show.key --name left
  deepfield view snapshot_099.hdf5 --outputs dome.ron                 a window for each projector of this machine
  deepfield view snapshot_099.hdf5 --simulate --mode volume   particles that move, straight from memory")]
pub struct Arguments {
    /// The source or page file, the URL of a built file, or a scene file; without it the data that the scene of --scene names, or a page to open files from.
    /// Several sources, a folder or a quoted pattern of them, @LIST, or a file of many steps are a run, which is built in the cache while
    /// its first step is shown; a folder of tables with the same columns is one table.
    pub paths: Vec<PathBuf>,
    /// The folder is still being written by a simulation: what it writes becomes steps of the run that is shown.
    #[arg(long, requires = "paths", conflicts_with_all = ["follow", "tour", "simulate", "with"])]
    pub follow_folder: bool,
    /// Has the file opened in the window of this user that was opened last, in the place of what it shows; where none is open, in a new one.
    /// What is said of how it is shown goes with a new one alone.
    #[arg(long, requires = "paths", conflicts_with_all = ["follow_folder", "follow", "lead", "outputs", "tour", "simulate", "with"])]
    pub reuse: bool,
    /// How the window starts.
    #[command(flatten)]
    pub settings: WindowArguments,
}

/// How the window starts.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct WindowArguments {
    /// Another source or page file in the same scene, in the first one's units; @X,Y,Z says where its origin lies there and *SCALE
    /// how many of the first one's lengths one of its own is. Can be given several times.
    #[arg(long, value_name = "FILE[@X,Y,Z[*SCALE]]")]
    pub with: Vec<Member>,
    /// A scene file whose settings and camera are used for the data.
    #[arg(long, value_name = "FILE.scene.ron")]
    pub scene: Option<PathBuf>,
    /// When, of a run: a time, step:12, z:1.5, a:0.4 or last [default: the first step].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true, conflicts_with = "follow")]
    pub time: Option<When>,
    /// Window size in pixels [default: 1280x720].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// What draws [default: the best there is].
    #[arg(long)]
    pub backend: Option<crate::look::Backend>,
    /// Visualization mode; `deepfield modes` lists them.
    #[arg(long, value_name = "NAME", value_parser = super::arguments::mode_name)]
    pub mode: Option<&'static crate::mode::Mode>,
    /// Largest displacement of a particle on screen, pixels; a quarter of it where an attribute colours density-squared
    /// [default: 0.8].
    #[arg(long, value_name = "TAU", value_parser = super::arguments::positive)]
    pub error_px: Option<f64>,
    /// Milliseconds that a picture may take to draw while the view moves: a sample of the particles is drawn then, and all of
    /// them when it rests; 0: always all [default: the preset's].
    #[arg(long, value_name = "MS", value_parser = frame_ms)]
    pub frame_ms: Option<f64>,
    /// Lets the particles move while they are shown: as test particles in the field of their mean density, drawn straight from
    /// memory. A small example of how a simulation that runs is shown (docs/prototyping.md).
    #[arg(long)]
    pub simulate: bool,
    /// Names of objects from a catalogue over the picture (CSV, RON, groups and subhaloes of Gadget-4 and SUBFIND, or
    /// haloes of other finders; docs/regions.md).
    #[arg(long, value_name = "CATALOGUE")]
    pub labels: Option<PathBuf>,
    /// A tour to play (docs/tours.md); without data, over the data that it names.
    #[arg(long, value_name = "FILE.ron")]
    pub tour: Option<PathBuf>,
    /// Leads a show: other windows, on this machine and others, follow this one's time, camera and settings (docs/shows.md). Where it
    /// listens for them [default: port 47800 of every address of this machine].
    #[arg(
        long, value_name = "ADDRESS[:PORT]", num_args = 0..=1, default_missing_value = "0.0.0.0", require_equals = false,
        value_parser = address, requires = "show_key", conflicts_with = "follow"
    )]
    pub lead: Option<SocketAddr>,
    /// Follows a leader: shows its picture and nothing else, with this machine's copy of the data; Esc closes it.
    #[arg(
        long, value_name = "ADDRESS[:PORT]", value_parser = address, requires = "show_key",
        conflicts_with_all = ["scene", "tour", "simulate", "labels", "mode", "error_px"]
    )]
    pub follow: Option<SocketAddr>,
    /// The show's key, the same file on all machines; `deepfield key FILE` makes one.
    #[arg(long, value_name = "FILE")]
    pub show_key: Option<PathBuf>,
    /// What the leader's window calls this follower [default: the machine's name].
    #[arg(long, value_name = "NAME", requires = "follow")]
    pub name: Option<String>,
    /// Opens a window for each output that a file describes, on this machine's monitors: projectors with their frusta, warps and
    /// blends (docs/shows.md); or a rig measured by others, FILE.mpcdi. This window is the presenter's.
    #[arg(long, value_name = "FILE.ron", conflicts_with = "follow")]
    pub outputs: Option<PathBuf>,
    /// For a follower: the output that it displays.
    #[arg(long, value_name = "FILE.ron#NAME", requires = "follow", value_parser = named_output)]
    pub output: Option<(PathBuf, String)>,
    /// What is derived.
    #[command(flatten)]
    pub derive: DeriveOptions,
    /// What the picture is of all directions, or for two eyes.
    #[command(flatten)]
    pub projection: ProjectionOptions,
    /// How light is exposed and spreads.
    #[command(flatten)]
    pub light: LightOptions,
    /// Fills the screen; F11 does so later.
    #[arg(long, conflicts_with = "output")]
    pub fullscreen: bool,
    /// For the windows of a show, which one process keeps open: where it is told what.
    #[arg(long, hide = true, value_name = "FOLDER")]
    pub supervised: Option<PathBuf>,
    /// Preset: desktop, laptop, headless or planetarium (docs/presets.md).
    #[arg(long, value_name = "NAME", default_value = "desktop")]
    pub preset: String,
    /// A file that is rewritten with the window's state as JSON whenever it changes, for scripts.
    #[arg(id = "state", long = "status", value_name = "FILE.json")]
    pub status: Option<PathBuf>,
    /// Where the picture goes when there is no display [default: the source's name with .png, or with .picture.png where an image that is
    /// shown has that name].
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: HeightsOptions,
    /// How far their samples are apart.
    #[command(flatten)]
    pub spacing: SpacingOptions,
    /// A photo over them.
    #[command(flatten)]
    pub texture: TextureOptions,
    /// Earlier heights.
    #[command(flatten)]
    pub before: BeforeOptions,
    /// How degrees of heights become places: plate, local, globe or globe:BODY such as globe:moon [default: globe from 20 degrees on].
    #[arg(long, value_name = "MAP")]
    pub map: Option<String>,
}

#[cfg(feature = "viewer")]
impl WindowArguments {
    /// What is said of data.
    fn said(&self) -> HeightsSaid {
        self.derive.with(self.before.with(self.texture.with(self.heights.said(&self.spacing.spacing))))
    }
}

/// Milliseconds that the preset's field takes, too.
fn frame_ms(text: &str) -> Result<f64, String> {
    let most = 10_000.0;
    let value = super::arguments::not_negative(text)?;
    if value <= most { Ok(value) } else { Err(format!("expected milliseconds from 0 to {most}")) }
}

/// A file of outputs and a name in it.
fn named_output(text: &str) -> Result<(PathBuf, String), String> {
    let parts = text.rsplit_once('#').filter(|(file, name)| !file.is_empty() && !name.is_empty());
    parts.map(|(file, name)| (file.into(), name.to_owned())).ok_or_else(|| "expected FILE.ron#NAME".into())
}

/// A machine of the show.
fn address(text: &str) -> Result<SocketAddr, String> {
    crate::show::protocol::address(text).map_err(|error| error.to_string())
}

/// Opens the window, or renders.
///
/// # Errors
/// When the source cannot be opened or drawing fails.
pub fn run(arguments: &Arguments) -> CommandResult {
    let with = arguments.settings.with.iter().map(Member::resolved).collect::<Result<_, _>>()?;
    let settings = &WindowArguments { with, ..arguments.settings.clone() };
    #[cfg(feature = "viewer")]
    if arguments.reuse && reuse(&arguments.paths)? {
        return Ok(());
    }
    if let Some(run) = run_of(arguments)? {
        return show_run(run, settings);
    }
    let path = match (arguments.paths.first(), &settings.tour, &settings.scene) {
        (Some(path), ..) => data_file(path)?,
        (None, Some(tour), None) => data_of_tour(tour, settings.supervised.is_none())?,
        (None, ..) => PathBuf::new(),
    };
    let leads_or_follows = [settings.lead.is_some(), settings.follow.is_some(), settings.outputs.is_some()];
    if settings.show_key.is_some() && !leads_or_follows.contains(&true) {
        return Err("--show-key goes with --lead, --follow or --outputs".into());
    }
    // Found out here, a missing file is an error on the command line rather than a message in an empty window.
    let is_given = !path.as_os_str().is_empty();
    let needs_file =
        [settings.simulate, settings.lead.is_some(), settings.outputs.is_some(), !settings.with.is_empty()];
    if !is_given && settings.scene.is_none() && settings.follow.is_none() && needs_file.contains(&true) {
        return Err("--with, --simulate, --lead and --outputs go with a file: name one".into());
    }
    if is_given && DataKind::of(&path)? != DataKind::Source && settings.simulate {
        return Err(format!("{}: --simulate takes a snapshot, this is a page file or a run", path.display()).into());
    }
    if settings.follow.is_some() && is_scene_file(&path) {
        return Err(
            format!("{}: --follow takes data, not a scene: the leader says what is shown", path.display()).into()
        );
    }
    let scene = settings.scene.as_deref().or_else(|| is_scene_file(&path).then_some(path.as_path()));
    if let Some(scene) = scene {
        let read = SceneFile::read(scene)?;
        if settings.scene.is_none() || !is_given {
            read.locate(scene)?;
        }
    }
    show(&path, settings)
}

/// Has a file opened in a window that is open; whether one has taken it.
#[cfg(feature = "viewer")]
fn reuse(paths: &[PathBuf]) -> Result<bool, Failure> {
    use crate::window::files::door;
    let [path] = paths else {
        return Err(format!("--reuse: found {} files, expected one", paths.len()).into());
    };
    // A missing file is an error here, too.
    if !is_url(path) && !file_of_step(path).exists() {
        return Err(format!("{}: no file is there", path.display()).into());
    }
    let taken = door::folder_of_user().map_or(Ok(false), |folder| door::hand_over(&folder, path))?;
    if !taken {
        eprintln!("deepfield: no window is open to reuse: a new one opens");
    }
    Ok(taken)
}

/// The run that the command line names by its sources; `None` where it names one source, a page file, a run or a scene.
fn run_of(arguments: &Arguments) -> Result<Option<CachedRun>, Failure> {
    let names = &arguments.paths;
    let run = || Ok(Some(CachedRun::new(names.clone(), arguments.follow_folder)));
    match &names[..] {
        [] => Ok(None),
        _ if arguments.follow_folder => run(),
        [only] if is_url(only) => Ok(None),
        [only] if only.is_dir() => match data_file(only) {
            Ok(_) => Ok(None),
            Err(_) if sources_of(names).is_ok_and(|sources| sources.len() > 1) => run(),
            Err(error) => Err(error.into()),
        },
        [only] if only.exists() => {
            let is_source = matches!(DataKind::of(only), Ok(DataKind::Source)) && !is_scene_file(only);
            // What is wrong with it is told where it is opened.
            if is_source && steps_in(only).is_ok_and(|steps| steps > 1) { run() } else { Ok(None) }
        }
        // A pattern, a list, a step in a file, or what is not there.
        [only] if file_of_step(only) != only => Ok(None),
        [only] if only.to_str().is_some_and(|name| name.starts_with('@') || name.contains(['*', '?', '['])) => run(),
        [_] => Ok(None),
        _ => run(),
    }
}

/// Shows a run that is built in the cache: its first step, or that of `--time`, at once. Without a display the picture is of the run as it
/// is then.
fn show_run(mut run: CachedRun, settings: &WindowArguments) -> CommandResult {
    let with_others =
        [!settings.with.is_empty(), settings.lead.is_some(), settings.outputs.is_some(), settings.tour.is_some()];
    if with_others.contains(&true) || settings.simulate {
        return Err("--with, --tour, --simulate, --lead and --outputs go with one file: build the run first".into());
    }
    if !settings.derive.is_empty() {
        return Err("--derive: found a run, expected one snapshot: build --derive builds the run with it".into());
    }
    let first = run.first(settings.time)?;
    #[cfg(feature = "viewer")]
    if has_display()
        && let Ok(adapter) = crate::gpu::device::probe()
    {
        let first = first.unwrap_or_default();
        let settings = WindowArguments { time: None, ..settings.clone() };
        return window(&first, &settings, adapter.backend.into(), Some(run.in_parts()));
    }
    let progress = super::progress_bar::TerminalProgress::new();
    loop {
        match run.grow(None, &progress)? {
            Grown::Run(path) => return show(&path, settings),
            Grown::Told(what) => eprintln!("deepfield: {what}"),
            Grown::Later => std::thread::sleep(std::time::Duration::from_secs(1)),
            // There is no room for more than one step.
            Grown::Done => {
                return show(&first.unwrap_or_default(), &WindowArguments { time: None, ..settings.clone() });
            }
        }
    }
}

/// The data that a tour names; `tell`: says what is to be known about it.
fn data_of_tour(tour: &Path, tell: bool) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
    let Some(dataset) = TourFile::read(tour)?.dataset else {
        return Err(format!("{}: the tour names no data: name some before --tour", tour.display()).into());
    };
    let located = dataset.locate(tour)?;
    located.notes.iter().filter(|_| tell).for_each(|note| eprintln!("deepfield: {note}"));
    Ok(located.members.into_iter().next().map(|member| member.path).unwrap_or_default())
}

/// Shows `path`, or where it is empty the data of the settings' scene, in a window where there is a display and the program was built with one, else renders it.
///
/// # Errors
/// As [`run`].
pub fn show(path: &Path, settings: &WindowArguments) -> CommandResult {
    #[cfg(feature = "viewer")]
    let reason = if has_display() {
        if settings.supervised.is_none() && super::supervise::is_show(settings) {
            return super::supervise::supervise(path, settings);
        }
        match crate::gpu::device::probe() {
            Ok(adapter) => return window(path, settings, adapter.backend.into(), None),
            Err(error) => format!("No window: {error}"),
        }
    } else {
        "No display".to_owned()
    };
    #[cfg(not(feature = "viewer"))]
    let reason = "Built without the feature `viewer`";
    if settings.lead.is_some() || settings.follow.is_some() || settings.outputs.is_some() {
        return Err(format!("{reason}: a show needs a window").into());
    }
    if settings.tour.is_some() {
        return Err(format!(
            "{reason}: a tour needs a window to play in; deepfield tour makes pictures and videos of it"
        )
        .into());
    }
    let named = settings.scene.as_deref().filter(|_| path.as_os_str().is_empty()).unwrap_or(path);
    if named.as_os_str().is_empty() {
        return Err(format!("{reason}: name a file to draw its picture, as in deepfield view snapshot.hdf5").into());
    }
    let output = settings.picture.clone().unwrap_or_else(|| picture_of(named, settings));
    render::run(&render::Arguments {
        size: settings.size,
        backend: settings.backend,
        mode: settings.mode,
        error_px: settings.error_px,
        scene: settings.scene.clone(),
        time: settings.time,
        with: settings.with.clone(),
        projection: settings.projection.clone(),
        light: settings.light.clone(),
        heights: settings.heights.clone(),
        spacing: settings.spacing.clone(),
        texture: settings.texture.clone(),
        before: settings.before.clone(),
        derive: settings.derive.clone(),
        map: settings.map.clone(),
        annotate: super::annotate::AnnotateOptions { labels: settings.labels.clone(), ..Default::default() },
        path: path.to_owned(),
        output: output.clone(),
        ..Default::default()
    })?;
    print_line(format_args!("{reason}: the picture is in {}", output.display()))?;
    Ok(())
}

/// Where the picture of a file goes unless that is said: an image that is shown, or laid over what is, may have that name itself, and is not
/// replaced.
fn picture_of(named: &Path, settings: &WindowArguments) -> PathBuf {
    let photo = settings.texture.texture.iter().map(|photo| photo.path.clone());
    let others = settings.with.iter().map(|member| member.path.clone()).chain(settings.before.before.clone());
    let read: Vec<PathBuf> = std::iter::once(named.to_owned()).chain(photo).chain(others).collect();
    let name = named.file_stem().unwrap_or_default().to_string_lossy();
    let usual = PathBuf::from(format!("{name}.png"));
    if is_file_of(&usual, &read) { PathBuf::from(format!("{name}.picture.png")) } else { usual }
}

/// Whether a window can be opened: on Unix without macOS, an X server or a Wayland compositor is named.
#[cfg(feature = "viewer")]
fn has_display() -> bool {
    let named = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(any(windows, target_os = "macos")) || named("DISPLAY") || named("WAYLAND_DISPLAY")
}

#[cfg(feature = "viewer")]
fn window(path: &Path, settings: &WindowArguments, drivers: wgpu::Backends, run: Option<CachedRun>) -> CommandResult {
    use crate::show::supervisor::RunFolder;
    use crate::show::window::{ShowOptions, run_show_window};
    use crate::window::files::{door, recent};
    use crate::window::live::orbits::{Orbits, OrbitsPlugin};
    use crate::window::{Backend, OpenRequest, WindowOptions};
    use std::sync::Arc;
    let show = ShowOptions {
        part: part_in_show(path, settings)?,
        output: settings.output.clone(),
        supervised: settings.supervised.as_deref().map(RunFolder::at),
    };
    let projection = projection_of(path, settings)?;
    let opener = Arc::new(|path: &Path, said: &HeightsSaid, progress: &dyn crate::model::Progress| {
        super::cache::page_file_with(path, said, progress).map_err(|error| error.to_string())
    });
    let light = settings.light.look();
    let request = OpenRequest {
        light: light.clone(),
        members: (!path.as_os_str().is_empty())
            .then(|| member_of(path, settings.tour.as_deref()))
            .into_iter()
            .chain(settings.with.iter().cloned())
            .collect(),
        scene: settings.scene.clone(),
        projection: Some(projection),
        time: settings.time,
        interpolation: None,
        said: settings.said(),
        map: settings.map.clone(),
    };
    // A follower opens what the leader says, and a window without a file shows what can be opened.
    let is_named =
        settings.follow.is_none() && (!path.as_os_str().is_empty() || run.is_none() && settings.scene.is_some());
    let mut options = WindowOptions::new(is_named.then_some(request), opener);
    options.grower = run.map(grower);
    options.drivers = drivers;
    options.fullscreen = settings.fullscreen;
    options.size = settings.size.map(|size| (size.width, size.height));
    options.preset = settings.preset.clone();
    options.backend = settings.backend.map(|backend| match backend {
        crate::look::Backend::Compute => Backend::Compute,
        crate::look::Backend::Raster => Backend::Raster,
        crate::look::Backend::Cpu => Backend::Cpu,
    });
    options.error_px = settings.error_px;
    options.frame_ms = settings.frame_ms;
    options.mode = settings.mode.map(|mode| mode.name.to_owned());
    options.projection = projection;
    options.light = light;
    options.status = settings.status.clone();
    options.labels = settings.labels.clone();
    options.tour = settings.tour.clone();
    options.demo = Some(Arc::new(|| super::demo::snapshot().map_err(|error| error.to_string())));
    // Windows of a show are the show's.
    if settings.supervised.is_none() && settings.follow.is_none() {
        options.recent = recent::list_of_user();
        options.reached_in = door::folder_of_user();
    }
    if settings.simulate {
        let progress = super::progress_bar::TerminalProgress::new();
        let dataset = crate::import::load(path, &crate::import::LoadOptions::default(), &progress)?;
        let orbits = Orbits::new(dataset);
        options.extension = Some(Arc::new(move |app: &mut bevy::prelude::App| {
            app.add_plugins(OrbitsPlugin(orbits.clone()));
        }));
    }
    Ok(run_show_window(options, show)?)
}

/// Builds a run again and again, as long as it grows.
#[cfg(feature = "viewer")]
fn grower(run: CachedRun) -> crate::window::Grower {
    use crate::window::More;
    use std::sync::{Arc, Mutex, PoisonError};
    let run = Mutex::new(run);
    Arc::new(move |present: Option<f64>, progress: &dyn crate::model::Progress| {
        let grown = run.lock().unwrap_or_else(PoisonError::into_inner).grow(present, progress);
        grown.map_err(|error| error.to_string()).map(|grown| match grown {
            Grown::Run(path) => More::Run(path),
            Grown::Told(what) => More::Told(what),
            Grown::Later => More::Later,
            Grown::Done => More::Done,
        })
    })
}

/// The data that is opened; where a tour names it, with what that says of it, as recordings have it.
#[cfg(feature = "viewer")]
fn member_of(path: &Path, tour: Option<&Path>) -> Member {
    let named = tour.and_then(|tour| TourFile::read(tour).ok()?.dataset?.locate(tour).ok());
    let named = named.and_then(|located| located.members.into_iter().find(|member| member.path == path));
    Member { said: named.map(|member| member.said).unwrap_or_default(), ..Member::new(path) }
}

/// How directions become a picture to begin with, and for which eyes: as the scene or the tour says that is opened, with what the
/// command line does.
#[cfg(feature = "viewer")]
fn projection_of(
    path: &Path,
    settings: &WindowArguments,
) -> Result<(Surround, Option<Stereo>), Box<dyn std::error::Error + Send + Sync>> {
    let scene = settings.scene.as_deref().or_else(|| is_scene_file(path).then_some(path));
    let (surround, stereo) = match (&settings.tour, scene) {
        // What is wrong with a tour, the window says.
        (Some(tour), _) => TourFile::read(tour).map_or((Surround::Flat, None), |tour| (tour.projection, tour.stereo)),
        (None, Some(scene)) => SceneFile::read(scene).map(|scene| (scene.projection, scene.stereo))?,
        (None, None) => (Surround::Flat, None),
    };
    Ok(settings.projection.over(surround, stereo)?)
}

/// The part that the window has in a show on several machines.
#[cfg(feature = "viewer")]
fn part_in_show(
    path: &Path,
    settings: &WindowArguments,
) -> Result<Option<crate::show::window::Show>, Box<dyn std::error::Error + Send + Sync>> {
    use crate::show::protocol::ShowKey;
    use crate::show::supervisor::RunFolder;
    use crate::show::window::Show;
    let Some(folder) = settings.supervised.as_deref().map(RunFolder::at) else { return Ok(None) };
    let key = || ShowKey::read(&folder.key());
    Ok(match (settings.follow, folder.leads_at()) {
        (None, Some(address)) => Some(Show::Lead { address, key: key()? }),
        (Some(leader), _) => {
            let named = (!path.as_os_str().is_empty()).then(|| path.to_owned());
            let data = named.into_iter().chain(settings.with.iter().map(|member| member.path.clone())).collect();
            let name = settings.name.clone().unwrap_or_else(machine);
            Some(Show::Follow { leader, key: key()?, name, data })
        }
        (None, None) => None,
    })
}

/// What this machine is called.
#[cfg(feature = "viewer")]
fn machine() -> String {
    let variables = ["HOSTNAME", "COMPUTERNAME"].into_iter().filter_map(|name| std::env::var(name).ok());
    let file = std::fs::read_to_string("/etc/hostname").ok();
    variables.chain(file).find(|name| !name.trim().is_empty()).unwrap_or_else(|| "follower".to_owned())
}

#[cfg(all(test, feature = "viewer"))]
mod tests {
    use super::*;

    #[test]
    fn what_a_tour_says_of_its_data_is_said_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let [data, other, tour] = ["field.asc", "other.asc", "show.ron"].map(|name| folder.path().join(name));
        std::fs::write(&data, "data").unwrap();
        let text = "(version: 1, dataset: (path: \"field.asc\", nodata: -1.0), keyframes: [()])";
        std::fs::write(&tour, text).unwrap();
        let member = member_of(&data, Some(&tour));
        assert_eq!((member.said.nodata, member.path), (Some(-1.0), data.clone()));
        assert_eq!(member_of(&other, Some(&tour)), Member::new(&other));
        assert_eq!(member_of(&data, None), Member::new(&data));
    }
}
