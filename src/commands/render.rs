//! `deepfield render`: a picture of a source or page file, without a window.

use super::CommandResult;
use super::annotate::{AnnotateOptions, Stage};
use super::arguments::{PictureSize, not_negative, positive, transfer_named, vector};
use super::drawing::Drawing;
pub(super) use super::exact_source::load_exact;
use super::exact_source::names;
use super::picture_config::PictureConfig;
use super::picture_statistics::LeftOut;
use super::projected;
use super::projection_options::{ProjectionName, ProjectionOptions};
use super::statistics::Times;
use super::studio::{Studio, look_ahead};
use crate::annotate::{Annotations, Units};
use crate::explore::SelectionSet;
use crate::hierarchy::Levels;
use crate::model::{Bounds, Family, FamilyName, PeriodicBox};
use crate::modes::{self, Depiction, Economy, Mode, Plan, SettingKind, SettingValue, Settings, cpu, economy, pilot};
use crate::raster::composite::Background;
use crate::raster::transfer::TransferFunction;
use crate::raster::{Accumulation, Image, Method, output};
use crate::scene_file::{Film, Member, shown_families};
use crate::store::PageFile;
use crate::view::{CubeLayout, CutSettings, Periodic, Projection, Side, Stereo, Surround, View, frame};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Renders a picture of a snapshot, catalogue or page file.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield render snapshot_099.hdf5 -o box.png
  deepfield render galaxy.df -o disk.png --mode density-squared --attribute temperature --size 1920x1080
  deepfield render galaxy.df -o disk.exr --raw column.npy --mode column-density --eye 0,0,50 --target 0,0,0 --ortho 40
  deepfield render galaxy.df -o disk.png --backend cpu --error-px 0.5 --json -
  deepfield render galaxy.df -o figure.png --size 3840x2160 --annotate=legend,scale-bar,axes --caption \"Snapshot 99\"
  deepfield render merger.hdf5 -o stars.png --family gas --mode volume-isosurface --exact
  deepfield render box.df -o dome.png --eye 25,25,25 --target 25,25,0 --projection dome --tilt 20 --size 4096x4096
  deepfield render box.df -o pair.png --stereo off-axis --eye-separation 0.2 --zero-parallax 6
  deepfield render galaxy.scene.ron -o disk.png              what the window has saved with Ctrl+S")]
pub struct Arguments {
    /// The source or page file, or a scene file.
    pub path: PathBuf,
    /// Another source or page file in the same picture, in the first one's units; @X,Y,Z says where its origin lies there and *SCALE
    /// how many of the first one's lengths one of its own is. Can be given several times.
    #[arg(long, value_name = "FILE[@X,Y,Z[*SCALE]]")]
    pub with: Vec<Member>,
    /// Where the picture goes: .png (colours) or .exr (the raw channels P and S).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also save the raw accumulation P as a float32 NumPy array, row 0 at the top; for volumes premultiplied linear RGBA.
    #[arg(long, value_name = "FILE.npy")]
    pub raw: Option<PathBuf>,
    /// Picture size in pixels [default: 1200x800].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// What draws: compute or raster (a Vulkan, Metal or DX12 adapter), or cpu [default: the best there is].
    #[arg(long)]
    pub backend: Option<Backend>,
    /// Visualization mode; `deepfield modes` lists them [default: points for data with magnitudes, else column-density].
    #[arg(long, value_name = "NAME", value_parser = mode_name)]
    pub mode: Option<&'static Mode>,
    /// The family to draw: gas, dark, type2, type3, stars or black-holes; all without it.
    #[arg(long, value_name = "NAME", value_parser = family_name)]
    pub family: Option<FamilyName>,
    /// The attribute that colours the picture.
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// Settings in RON (see configs/picture.ron); options on the command line override them.
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    /// A scene file whose settings and camera are used for the data, whatever data it names itself.
    #[arg(long, value_name = "FILE.scene.ron")]
    pub scene: Option<PathBuf>,
    /// How a periodic box is drawn: once, wrapped (what one looks at is in the middle), or as many times along each axis as
    /// 3x3x1 says [default: once].
    #[arg(long, value_name = "HOW")]
    pub periodic: Option<Periodic>,
    /// Camera position in world units.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// The point looked at [default: the middle of the data, outliers left out].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// The direction that points up in the picture [default: 0,1,0].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// Vertical field of view of a perspective camera, degrees [default: 45].
    #[arg(long, value_name = "DEG", value_parser = positive)]
    pub fov: Option<f64>,
    /// An orthographic camera whose picture is this high, in world units.
    #[arg(long, value_name = "HEIGHT", value_parser = positive, conflicts_with = "fov")]
    pub ortho: Option<f64>,
    /// How directions become a picture, and for which eyes.
    #[command(flatten)]
    pub projection: ProjectionOptions,
    /// How directions become a picture where the options say nothing.
    #[arg(skip)]
    pub surround: Surround,
    /// A picture for two eyes where the options say nothing.
    #[arg(skip)]
    pub stereo_pair: Option<Stereo>,
    /// Largest displacement of a particle on screen, pixels [default: 0.8].
    #[arg(long, value_name = "TAU", value_parser = positive)]
    pub error_px: Option<f64>,
    /// Draw every source particle at full precision: no level of detail, no quantisation.
    #[arg(long, conflicts_with = "error_px")]
    pub exact: bool,
    /// Drop particles fainter than 1/N of the darkest colour's P, with their light; 0: none [default: 0].
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub presence: Option<f64>,
    /// Draw a weighted sample of the particles whose mean colour error stays below E of 255; 0: all of them [default: 0].
    #[arg(long, value_name = "E", value_parser = not_negative)]
    pub thinning: Option<f64>,
    /// Also save a picture of how many splats lie over each pixel: 0 black, 500 magenta, 3000 red.
    #[arg(long, value_name = "FILE.png", conflicts_with = "exact")]
    pub overdraw: Option<PathBuf>,
    /// Do not drop particles outside the view one by one: to measure what that saves.
    #[arg(long)]
    pub no_culling: bool,
    /// Draw so many times and report median times.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Threads of the CPU's part [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write statistics as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "STATS.json")]
    pub json: Option<PathBuf>,
    /// What is written into the picture.
    #[command(flatten)]
    pub annotate: AnnotateOptions,
    /// What is written into the picture where the options say nothing.
    #[arg(skip)]
    pub annotations: Option<Annotations>,
    /// Settings of the mode.
    #[arg(skip)]
    pub settings: Settings,
    /// The catalogue of a scene.
    #[arg(skip)]
    pub labels: Option<PathBuf>,
    /// A scene's selections.
    #[arg(skip)]
    pub selections: Vec<SelectionSet>,
    /// What a tour's picture has beyond a scene; its images' paths are complete.
    #[arg(skip)]
    pub film: Option<Film>,
    /// Where the first dataset of a scene lies, and which of its families are shown; its path is `path`.
    #[arg(skip)]
    pub first: Member,
    /// No attribute colours the picture, even if the mode has a usual one.
    #[arg(skip)]
    pub plain: bool,
    /// What is left out of the data and faded.
    #[arg(skip)]
    pub cut: CutSettings,
    /// What colours mean: a preset (density, density-hue, stars, volume, volume-hue) or a RON file like those in
    /// assets/transfer [default: the mode's].
    #[arg(long, value_name = "NAME|FILE.ron", value_parser = transfer_named)]
    pub transfer: Option<TransferFunction>,
    /// What volumes emit and absorb; the mode's own where it is `None`.
    #[arg(skip)]
    pub volume: Option<TransferFunction>,
    /// What is behind the picture: black, transparent (an alpha channel) or a colour #rrggbb [default: black].
    #[arg(long, value_name = "COLOUR")]
    pub background: Option<Background>,
}

impl Arguments {
    /// A picture of `path` in `output` with everything else as it is by default.
    pub fn new(path: PathBuf, output: PathBuf) -> Arguments {
        Arguments {
            path,
            output,
            raw: None,
            size: None,
            backend: None,
            mode: None,
            family: None,
            attribute: None,
            config: None,
            scene: None,
            periodic: None,
            eye: None,
            target: None,
            up: None,
            fov: None,
            ortho: None,
            projection: ProjectionOptions::default(),
            surround: Surround::Flat,
            stereo_pair: None,
            error_px: None,
            exact: false,
            presence: None,
            thinning: None,
            overdraw: None,
            no_culling: false,
            repeat: 1,
            threads: None,
            json: None,
            annotate: AnnotateOptions::default(),
            annotations: None,
            settings: Settings::default(),
            first: Member::default(),
            with: Vec::new(),
            labels: None,
            selections: Vec::new(),
            film: None,
            plain: false,
            cut: CutSettings::default(),
            transfer: None,
            volume: None,
            background: None,
        }
    }

    /// The datasets that are drawn.
    pub fn members(&self) -> Vec<Member> {
        let first = Member { path: self.path.clone(), ..self.first.clone() };
        std::iter::once(first).chain(self.with.iter().cloned()).collect()
    }

    /// The same, with the options about what may be left out among the settings.
    pub(super) fn with_economy(mut self) -> Arguments {
        self.cut.periodic = self.periodic.unwrap_or(self.cut.periodic);
        for (setting, value) in [(&economy::PRESENCE, self.presence), (&economy::THINNING, self.thinning)] {
            if let SettingKind::Number { min, max, .. } = setting.kind
                && let Some(value) = value
            {
                self.settings.set(setting, SettingValue::Number(value.clamp(min, max)));
            }
        }
        if self.no_culling {
            self.settings.set(&economy::CULLING, SettingValue::Flag(false));
        }
        self
    }
}

/// What draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// Compute passes.
    Compute,
    /// Blended triangles: not implemented, a window says so and uses compute passes.
    Raster,
    /// The processor.
    Cpu,
}

/// Why an adapter does not draw in a program without the viewer.
pub(super) const ONLY_CPU: &str = "this deepfield was built without the feature `viewer`, so only --backend cpu draws";

/// The mode of that name.
///
/// # Errors
/// The names that there are.
pub fn mode_name(text: &str) -> Result<&'static Mode, String> {
    modes::find(text).ok_or_else(|| format!("expected one of {}", modes::names()))
}

/// The family of that name.
///
/// # Errors
/// The names that there are.
pub fn family_name(text: &str) -> Result<FamilyName, String> {
    FamilyName::parse(text)
        .ok_or_else(|| format!("expected one of {}", FamilyName::ALL.map(FamilyName::as_str).join(", ")))
}

/// What was drawn, and how.
#[derive(Clone)]
pub(super) struct Picture {
    pub accumulation: Accumulation,
    pub stage: Stage,
    pub mode: &'static Mode,
    pub attribute: Option<String>,
    pub converged: bool,
    pub error_pixels: f64,
    pub particles: u64,
    pub nodes: usize,
    pub backend: &'static str,
    pub adapter: String,
    pub economy: LeftOut,
    pub milliseconds: BTreeMap<String, f64>,
}

/// Renders the picture and writes it.
///
/// # Errors
/// When the source cannot be read, a setting does not fit the data, no adapter draws, or a file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let arguments = match &arguments.config {
        Some(path) => PictureConfig::read(path)?.complete(arguments),
        // One named on the command line is for whatever is drawn.
        None => Arguments { volume: arguments.transfer.clone(), ..arguments.clone() },
    };
    let arguments = super::scene_arguments::complete(arguments)?.with_economy();
    let arguments = &arguments;
    match arguments.threads {
        Some(threads) => {
            rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?.install(|| render(arguments))
        }
        None => render(arguments),
    }
}

fn render(arguments: &Arguments) -> CommandResult {
    let is_exr = match arguments.output.extension().and_then(|extension| extension.to_str()) {
        Some("png") => false,
        Some("exr") => true,
        _ => return Err(format!("{}: expected a name that ends in .png or .exr", arguments.output.display()).into()),
    };
    let annotations = annotations(arguments, is_exr)?;
    let mut studio = None;
    let drawing = Drawing::new(arguments, &mut studio)?;
    match is_exr {
        _ if projected::asked(arguments)?.0 == (Surround::Cube { layout: CubeLayout::Files }) => {
            if is_exr {
                return Err("--layout files: writes .png; a strip can be .exr".into());
            }
            for (side, face) in
                Side::ALL.iter().zip(faces(&drawing.finished(arguments, annotations.as_ref(), &mut studio)?))
            {
                output::write_png(&arguments.output.with_extension(format!("{}.png", side.as_str())), &face)?;
            }
        }
        true => drawing.write_exr(&arguments.output)?,
        false => {
            let image = drawing.finished(arguments, annotations.as_ref(), &mut studio)?;
            output::write_png(&arguments.output, &image)?;
        }
    }
    if let Some(raw) = &arguments.raw {
        drawing.write_npy(raw)?;
    }
    if let Some(json) = &arguments.json {
        drawing.write_statistics(json)?;
    }
    Ok(())
}

/// The six faces of a strip.
fn faces(strip: &Image) -> Vec<Image> {
    let edge = strip.height;
    let face = |index: usize| {
        let rows = strip.rgba.chunks(strip.width as usize);
        let start = index * edge as usize;
        let rgba = rows.flat_map(|row| row[start..start + edge as usize].iter().copied()).collect();
        Image { width: edge, height: edge, rgba }
    };
    (0..6).map(face).collect()
}

/// Draws a picture that is made of splats: of an open page file, or where there is none, of source particles.
///
/// # Errors
/// As [`run`].
pub(super) fn draw(
    arguments: &Arguments,
    studio: Option<&mut Studio>,
) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    if cfg!(not(feature = "viewer")) && matches!(arguments.backend, Some(Backend::Compute | Backend::Raster)) {
        return Err(ONLY_CPU.into());
    }
    if projected::is_projected(arguments)? {
        return projected::draw(arguments, studio);
    }
    match studio {
        Some(studio) => draw_pages(arguments, studio),
        None => draw_exact(arguments),
    }
}

/// What is written into the picture.
pub(super) fn annotations(arguments: &Arguments, is_exr: bool) -> Result<Option<Annotations>, String> {
    let asked = arguments.annotate.over(arguments.annotations.clone());
    match asked {
        Some(_) if is_exr && arguments.annotate.is_given() => Err(format!(
            "{}: an EXR picture holds numbers, only PNG pictures are annotated",
            arguments.output.display()
        )),
        annotations => Ok(annotations.filter(|_| !is_exr)),
    }
}

/// The transfer function that colours a picture.
pub(super) fn transfer(arguments: &Arguments, depiction: &Depiction) -> TransferFunction {
    let name = depiction.mode.transfer[usize::from(depiction.attribute.is_some())];
    let usual = || TransferFunction::preset(name).map(|preset| depiction.suited(preset));
    arguments.transfer.clone().or_else(usual).unwrap_or_default()
}

/// Draws the selected nodes of a page file.
fn draw_pages(arguments: &Arguments, studio: &mut Studio) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    let framed = studio.choose(arguments)?;
    let Studio { file, scene, ahead, .. } = studio;
    let metadata = file.metadata();
    let fields = metadata.families.iter().flat_map(|family| &family.attributes).map(|field| field.name.as_str());
    let mode = arguments.mode.unwrap_or_else(|| modes::usual(fields));
    let mut depiction = Depiction::of_pages(mode, arguments.settings.clone(), arguments.attribute.as_deref(), metadata)
        .map_err(|why| format!("{}: {why}", arguments.path.display()))?;
    depiction.attribute = depiction.attribute.filter(|_| !arguments.plain);
    scene.levels = Levels::Splats;
    let view = view(arguments, framed, metadata.periodic_box())?;
    let seen = depiction.selection_view(&view);
    let tau = arguments.error_px.unwrap_or(0.8);
    let mut times = Times::default();
    let mut tell = |message| eprintln!("deepfield: {message}");
    let selection = times.measure("load", || scene.converge(&seen, tau, &mut tell))?;
    look_ahead(scene, ahead.take(), tau);
    let economy = arguments.settings.file_economy();
    let transfer = transfer(arguments, &depiction);
    let plan = times
        .measure("plan", || pilot::plan(&view, &depiction, metadata, &selection.nodes, &economy, &transfer, None))?;
    let mut left_out = LeftOut::new(&economy, &plan);
    if let Some(path) = &arguments.overdraw {
        let nodes = cpu::decode_planned(&view, &depiction, metadata, &selection.nodes, &plan);
        let overdraw = cpu::overdraw_of(&view, &depiction, metadata, &nodes, &plan)?;
        output::write_png(path, &overdraw.image())?;
        left_out.overdraw = Some((overdraw.mean(), overdraw.max()));
    }
    let picture = Picture {
        accumulation: Accumulation::default(),
        stage: Stage::new(arguments, view, framed, Units::of_pages(metadata, &depiction), &depiction)?
            .with_selections(&arguments.selections, file, &selection.nodes)?,
        mode,
        attribute: depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
        economy: left_out.clone(),
        converged: selection.converged,
        error_pixels: selection.error_pixels,
        particles: selection.particles,
        nodes: selection.nodes.len(),
        backend: "cpu",
        adapter: "cpu".into(),
        milliseconds: BTreeMap::new(),
    };
    #[cfg(feature = "viewer")]
    if let Some(backend) = gpu_backend(arguments.backend) {
        let request = || modes::gpu::request_nodes(&view, &depiction, metadata, &selection.nodes, &plan, backend);
        if let Some(picture) = draw_on_gpu(arguments, request, picture.clone(), &times)? {
            return Ok(picture);
        }
    }
    let mut accumulation = Accumulation::default();
    for _ in 0..arguments.repeat {
        times.frame(|times| {
            let selection = times.measure("select", || scene.select(&seen, tau));
            let nodes =
                times.measure("decode", || cpu::decode_planned(&view, &depiction, metadata, &selection.nodes, &plan));
            let method = Method::Pyramid;
            let (drawn, counts) =
                times.measure("draw", || cpu::draw_planned(&view, &depiction, metadata, &nodes, method, &plan))?;
            let kept: u64 = nodes.iter().map(|node| node.len() as u64).sum();
            left_out.thinned = Some(selection.particles - kept);
            (left_out.faint, left_out.outside) = (Some(counts.faint), Some(counts.outside));
            left_out.splats = Some(counts.drawn);
            accumulation = drawn;
            Ok::<_, crate::raster::RasterError>(())
        })?;
    }
    Ok(Picture { accumulation, economy: left_out, milliseconds: times.medians(), ..picture })
}

/// The techniques that draw, unless the CPU is asked for, or does the same faster.
#[cfg(feature = "viewer")]
fn gpu_backend(backend: Option<Backend>) -> Option<crate::gpu::Backend> {
    match backend {
        Some(Backend::Cpu) => None,
        Some(Backend::Compute) => Some(crate::gpu::Backend::Compute),
        Some(Backend::Raster) => Some(crate::gpu::Backend::Raster),
        // A driver without a graphics card draws on the processor too, and slower than our own renderer.
        None => has_graphics_card().then_some(crate::gpu::Backend::Auto),
    }
}

/// Whether there is an adapter that is not the processor.
#[cfg(feature = "viewer")]
pub(super) fn has_graphics_card() -> bool {
    !matches!(crate::gpu::device::probe(), Ok(wgpu::DeviceType::Cpu) | Err(_))
}

/// Draws with an adapter. `None` where there is none and the user did not ask for one, so that the CPU draws.
#[cfg(feature = "viewer")]
fn draw_on_gpu(
    arguments: &Arguments,
    request: impl FnOnce() -> crate::gpu::HeadlessRequest,
    picture: Picture,
    times: &Times,
) -> Result<Option<Picture>, crate::gpu::GpuError> {
    let request = crate::gpu::HeadlessRequest { repeat: arguments.repeat, ..request() };
    match crate::gpu::render_headless(request) {
        Ok(frame) => {
            let mut milliseconds = times.clone().medians();
            milliseconds.extend(frame.stats.passes.medians().map(|(pass, time)| (pass.to_owned(), time)));
            milliseconds.insert("frame".to_owned(), frame.stats.frame);
            let (backend, adapter) = (frame.stats.backend, frame.stats.adapter);
            let economy = LeftOut { splats: frame.stats.splats, ..picture.economy.clone() };
            Ok(Some(Picture { accumulation: frame.accumulation, economy, backend, adapter, milliseconds, ..picture }))
        }
        Err(error) if arguments.backend.is_none() => {
            eprintln!("deepfield: {error}; drawing with the CPU instead");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Draws every particle of the source; for a page file, of the source that it was built from.
fn draw_exact(arguments: &Arguments) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>> {
    let mut times = Times::default();
    let (source, dataset) = times.measure("load", || load_exact(arguments))?;
    let fields = dataset.families.iter().flat_map(|family| &family.attributes).map(|field| field.name.as_str());
    let mode = arguments.mode.unwrap_or_else(|| modes::usual(fields));
    let mut depiction =
        Depiction::of_dataset(mode, arguments.settings.clone(), arguments.attribute.as_deref(), &dataset)
            .map_err(|why| format!("{}: {why}", source.display()))?;
    depiction.attribute = depiction.attribute.filter(|_| !arguments.plain);
    let families: Vec<&Family> = dataset.families.iter().collect();
    let positions = families.iter().flat_map(|family| &family.positions);
    let samples: Vec<(DVec3, f64)> = positions.map(|&position| (DVec3::from_array(position), 1.0)).collect();
    let framed = frame::frame(dataset.bounds(), &samples);
    let view = view(arguments, framed, dataset.periodic_box())?;
    drop(samples);
    let picture = Picture {
        accumulation: Accumulation::default(),
        stage: Stage::new(arguments, view, framed, Units::of_dataset(&dataset, &depiction), &depiction)?
            .with_exact_selections(arguments, &source, &names(&dataset))?,
        mode,
        attribute: depiction.attribute.as_ref().map(|coloring| coloring.name.clone()),
        economy: LeftOut::new(&Economy::NONE, &Plan::default()),
        converged: true,
        error_pixels: 0.0,
        particles: dataset.len() as u64,
        nodes: 0,
        backend: "cpu",
        adapter: "cpu".into(),
        milliseconds: BTreeMap::new(),
    };
    #[cfg(feature = "viewer")]
    if let Some(backend) = gpu_backend(arguments.backend) {
        let request = || modes::gpu::request_particles(&view, &depiction, &dataset, &families, backend);
        if let Some(picture) = draw_on_gpu(arguments, request, picture.clone(), &times)? {
            return Ok(picture);
        }
    }
    let mut accumulation = Accumulation::default();
    for _ in 0..arguments.repeat {
        times.frame(|times| {
            let drawn =
                times.measure("draw", || cpu::draw_particles(&view, &depiction, &dataset, &families, Method::Exact));
            drawn.map(|drawn| accumulation = drawn)
        })?;
    }
    Ok(Picture { accumulation, milliseconds: times.medians(), ..picture })
}

/// Indices of the families of a page file that are drawn.
///
/// # Errors
/// Where the family that the user names is not there, or none of those that a scene shows.
pub(super) fn families(arguments: &Arguments, file: &PageFile) -> Result<Vec<u32>, String> {
    let families = &file.metadata().families;
    let all = |shown: &dyn Fn(usize) -> bool| -> Vec<u32> {
        (0..families.len()).filter(|&i| shown(i)).map(|i| i as u32).collect()
    };
    let missing = |name: FamilyName| format!("{}: no particles of family {name}", arguments.path.display());
    let (found, absent) = match arguments.family {
        Some(name) => (all(&|i| families[i].name == name), vec![name]),
        None => {
            let (shown, missing) = shown_families(file, &arguments.members());
            (all(&|i| shown[i]), missing)
        }
    };
    match (found.is_empty(), absent.first()) {
        (false, _) => Ok(found),
        (true, Some(&name)) => Err(missing(name)),
        (true, None) => Err(format!("{}: the scene shows no family", arguments.path.display())),
    }
}

/// The camera that the arguments describe; around `bounds` where they say nothing.
pub(super) fn view(
    arguments: &Arguments,
    bounds: Bounds,
    periodic: Option<PeriodicBox>,
) -> Result<View, crate::view::ViewError> {
    let named = arguments.projection.named(arguments.surround);
    let PictureSize { width, height } = arguments.size.unwrap_or(projected::usual_size(named));
    let fov_y = arguments.fov.unwrap_or(45.0).to_radians();
    let around = View::around(bounds, fov_y, width, height)?;
    let target = arguments.target.unwrap_or(bounds.center());
    let eye = arguments.eye.unwrap_or(around.eye + (target - bounds.center()));
    if named != ProjectionName::Flat {
        // From the middle of the data, unless told otherwise: what there is to see is all around.
        let eye = arguments.eye.unwrap_or(bounds.center());
        let ahead = if eye == bounds.center() { eye - DVec3::Z * bounds.size().length().max(1e-30) } else { target };
        let (target, up) = (arguments.target.unwrap_or(ahead), arguments.up.unwrap_or(DVec3::Y));
        let view = View::look_at(eye, target, up, Projection::Perspective { fov_y }, width, height)?;
        return Ok(arguments.cut.applied(&view, eye, periodic));
    }
    let projection = match arguments.ortho {
        Some(height) => Projection::Orthographic { height },
        None => Projection::Perspective { fov_y },
    };
    let view = View::look_at(eye, target, arguments.up.unwrap_or(DVec3::Y), projection, width, height)?;
    Ok(arguments.cut.applied(&view, target, periodic))
}
