//! The techniques of F12 5.9 and 5.10 beside each other: the same view of the same particles with every one, how long it takes, what
//! memory it holds, and how far its colours are from a volume and an isosurface that are sampled much more finely.

use super::compare_orbit::{self, Orbit};
use super::splat::Failure;
use super::{Arguments, Times};
use crate::bench::sheet::{Entry, sheet};
use crate::color::composite::{Image, color_error, composite};
use crate::color::output;
use crate::color::transfer::{Hue, Range, TransferFunction, UnitLength};
use crate::command_line::arguments::{PictureSize, family_name, positive, vector};
use crate::command_line::progress_bar::Terminal;
use crate::cpu::volume::VolumeLevels;
use crate::cpu::volume::particles::SMALLEST;
use crate::look::{Attribute, Backend, CameraConfig, LookPatch, Member, Shot};
use crate::mode::{Depiction, LightPicture, Mode, Plan, Raw, SettingValue, Settings};
use crate::model::FamilyName;
use crate::modes::{cartesian, column_density, grid, isosurface, layered, sorted_splats, spheres, volume};
use crate::picture::adapter::{draw_on, passes};
use crate::picture::source::{Wanted, framed, particles};
use crate::picture::{Adapter, AdapterFrame, AdapterJob, Subject};
use crate::store::{InMemory, Metadata, Tree};
use crate::stream::{SceneNode, first_nodes};
use crate::synth::{dataset, merger::Merger};
use crate::view::View;
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// What is compared, and how.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "compare")]
pub struct Options {
    /// The family that `bench compare` draws; all without it.
    #[arg(long, value_name = "NAME", value_parser = family_name)]
    pub family: Option<FamilyName>,
    /// The attribute that colours the pictures of `bench compare`; their density without it.
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// Camera position of `bench compare`, world units [default: all of the data in view].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,
    /// The point that `bench compare` looks at [default: the middle of the data].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// Vertical field of view of `bench compare`, degrees [default: 45].
    #[arg(long, value_name = "DEG", value_parser = positive)]
    pub fov: Option<f64>,
    /// Layers of layered splatting.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub layers: u32,
    /// Cells along the longest side of the Cartesian grid.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(2..=4096))]
    pub cells: u32,
    /// Density of the surfaces, in the data's units [default: chosen from the data].
    #[arg(long, value_name = "DENSITY", value_parser = positive)]
    pub isovalue: Option<f64>,
    /// Cells per pixel of the volume and the isosurface that errors are measured against, 1 to 2.
    #[arg(long, value_name = "N", default_value_t = 2.0, value_parser = finer)]
    pub reference: f64,
    /// Pictures that are drawn while the camera turns by half a degree from each to the next, by the perspective grid and from an
    /// octree of bricks that are kept; fewer than 2: none.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub frames: u16,
    /// What draws the pictures of `bench compare`, where it draws the mode; the processor draws the others and the references.
    #[arg(long, value_name = "NAME", value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
}

/// Cells per pixel of a reference.
fn finer(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value| (1.0..=2.0).contains(value)).ok_or_else(|| "expected a number from 1 to 2".into())
}

/// One technique's picture.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// What it is called: the mode, and what was set.
    pub name: String,
    /// Visualization mode.
    pub mode: &'static str,
    /// What drew it: `cpu` where no passes of the backend that is asked for draw the mode.
    pub backend: String,
    /// Projecting, sorting, splatting or resampling by the processor, seconds.
    pub resampling: Option<Times>,
    /// From that to colours by the processor, seconds.
    pub rendering: Option<Times>,
    /// All of it, seconds; by an adapter, of a frame of particles that it holds.
    pub total: Total,
    /// Median of each pass of an adapter, milliseconds.
    pub passes: BTreeMap<String, f64>,
    /// Particles that reach into the picture.
    pub particles: u64,
    /// Most memory held at once by particles, fields and pictures, bytes, where it is counted.
    pub memory: Option<u64>,
    /// Mean colour error against the finer volume, of 255.
    pub error_volume: f64,
    /// Mean colour error against the finer isosurface, of 255.
    pub error_surface: f64,
}

/// The times of whole pictures, seconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Total {
    /// The middle one.
    pub median: f64,
    /// The fastest; adapters say only the middle one.
    pub fastest: Option<f64>,
}

/// What the suite finds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What was drawn.
    pub source: String,
    /// Number of particles.
    pub particles: usize,
    /// Name and driver of the adapter, where one drew.
    pub adapter: Option<String>,
    /// Pixels.
    pub size: [u32; 2],
    /// The range of densities, the surfaces' density, and the length that opacities are meant for.
    pub density: [f64; 2],
    /// The surfaces' density.
    pub isovalue: f64,
    /// The length that opacities are meant for.
    pub unit_length: f64,
    /// The techniques.
    pub outcomes: Vec<Outcome>,
    /// Pictures from a camera that turns.
    pub orbits: Vec<Orbit>,
}

/// Draws with every technique, writes the pictures, a contact sheet and a table, and prints the table to standard error.
///
/// # Errors
/// When the data cannot be read, a setting does not fit it, or a file cannot be written.
pub fn measure(arguments: &Arguments) -> Result<Report, Failure> {
    let options = &arguments.compare;
    let folder = arguments.flight.output.as_deref().unwrap_or(Path::new("compare"));
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let PictureSize { width, height } = arguments.flight.size.unwrap_or(PictureSize { width: 600, height: 400 });
    let [eye, target] = [options.eye, options.target].map(|place| place.map(|place| place.to_array()));
    let shot = Shot {
        look: LookPatch { attribute: options.attribute.clone().map(Attribute::Named), ..LookPatch::default() },
        camera: CameraConfig { eye, target, fov: options.fov, ..CameraConfig::default() },
        size: Some((width, height)),
        ..Shot::default()
    };
    let (source, dataset) = match &arguments.path {
        Some(path) => (path.display().to_string(), {
            let wanted = Wanted::of([&shot.look], options.family);
            particles(&[Member::new(path)], &wanted, &Terminal)?.1
        }),
        None => {
            let particles = arguments.sizes.first().copied().unwrap_or(200_000);
            (format!("synth merger -n {particles}"), dataset(&Merger::new(arguments.seed, particles)))
        }
    };
    let framed = framed(&dataset);
    let view = shot.view(framed, dataset.periodic_box())?;
    let tree = InMemory::new(dataset);
    let mut bench = Bench::new(&tree, view, framed.size().length(), options, arguments.repeat)?;
    let outcomes = bench.run(options)?;
    let orbits = compare_orbit::measure(&bench, options.target.unwrap_or(framed.center()), options)?;
    let report = Report {
        source,
        particles: tree.metadata().particles() as usize,
        adapter: bench.adapter_name.clone(),
        size: [view.width, view.height],
        density: bench.levels.density,
        isovalue: bench.isovalue,
        unit_length: bench.levels.unit_length,
        outcomes,
        orbits,
    };
    bench.write(folder, &report)?;
    Ok(report)
}

/// What all pictures share.
pub(super) struct Bench<'a> {
    pub(super) metadata: &'a Metadata,
    pub(super) nodes: Vec<SceneNode>,
    pub(super) view: View,
    diameter: f64,
    pub(super) attribute: Option<&'a str>,
    repeat: u32,
    pub(super) levels: VolumeLevels,
    pub(super) transfer: TransferFunction,
    isovalue: f64,
    /// The finer volume and isosurface.
    references: [Image; 2],
    images: Vec<Image>,
    backend: Backend,
    adapter: Option<Box<dyn Adapter>>,
    /// What the adapter calls itself, once it has drawn.
    adapter_name: Option<String>,
}

/// The adapter of a backend.
///
/// # Errors
/// When there is none in this program.
fn adapter(backend: Backend) -> Result<Option<Box<dyn Adapter>>, Failure> {
    if backend == Backend::Cpu {
        return Ok(None);
    }
    #[cfg(feature = "viewer")]
    {
        Ok(Some(Box::new(crate::gpu::Offscreen::default())))
    }
    #[cfg(not(feature = "viewer"))]
    {
        Err("this deepfield was built without the feature `viewer`, so only --backend cpu draws".into())
    }
}

/// How long a picture took.
enum Spent {
    /// The processor: resampling and rendering of each repetition.
    Processor([Vec<Duration>; 2]),
    /// An adapter: its passes' name, and their medians with that of a frame, milliseconds.
    Adapter(&'static str, BTreeMap<String, f64>),
}

/// A name and a value.
pub(super) type Set = (&'static str, SettingValue);

/// Settings by name.
pub(super) fn settings(values: impl IntoIterator<Item = Set>) -> Settings {
    Settings(values.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
}

/// One opaque surface.
fn surface(isovalue: f64) -> [Set; 2] {
    let list = |value: f64| SettingValue::Numbers(vec![value]);
    [(grid::ISOVALUES.name, list(isovalue)), (grid::ISO_OPACITIES.name, list(1.0))]
}

pub(super) fn number(name: &'static str, value: f64) -> Set {
    (name, SettingValue::Number(value))
}

impl<'a> Bench<'a> {
    /// Draws the references, whose ranges all others then have.
    fn new(
        tree: &'a InMemory,
        view: View,
        diameter: f64,
        options: &'a Options,
        repeat: u32,
    ) -> Result<Bench<'a>, Failure> {
        // That the program has no adapters is said before anything is drawn.
        let adapter = adapter(options.backend)?;
        let attribute = options.attribute.as_deref();
        let mut bench = Bench {
            metadata: tree.metadata(),
            nodes: first_nodes(tree, &view)?,
            view,
            diameter,
            attribute,
            repeat,
            levels: VolumeLevels { density: [0.0, 1.0], attribute: [0.0, 1.0], unit_length: 1.0 },
            transfer: TransferFunction::of_volumes(attribute.is_some()),
            isovalue: 0.0,
            references: [const { Image { width: 0, height: 0, rgba: Vec::new() } }; 2],
            images: Vec::new(),
            backend: options.backend,
            adapter,
            adapter_name: None,
        };
        // Particles stay as large as they are in the other pictures, in more cells.
        let finely = [
            number(grid::RESOLUTION.name, options.reference),
            number(grid::SMALLEST_CELLS.name, SMALLEST * options.reference),
            number(grid::TERMINATION.name, 1.0),
        ];
        let finest = bench.paint(&volume::MODE, settings(finely.clone()), &view)?;
        bench.levels = finest.levels;
        let fixed = |[min, max]: [f64; 2]| Range::Fixed(min, max);
        bench.transfer.range = fixed(finest.levels.density);
        bench.transfer.unit_length = UnitLength::Fixed(finest.levels.unit_length);
        bench.transfer.hue = bench.transfer.hue.take().map(|hue| Hue { range: fixed(finest.levels.attribute), ..hue });
        let [min, max] = finest.levels.density;
        bench.isovalue = options.isovalue.unwrap_or(min * (max / min).powf(f64::from(spheres::PLACE)));
        let surfaces = settings(finely.into_iter().chain(surface(bench.isovalue)));
        let surfaces = bench.paint(&isosurface::MODE, surfaces, &view)?;
        bench.references = [finest.colors.image(), surfaces.colors.image()];
        Ok(bench)
    }

    pub(super) fn paint(&self, mode: &'static Mode, settings: Settings, view: &View) -> Result<LightPicture, Failure> {
        settings.check(mode)?;
        let depiction = Depiction::new(mode, settings, self.attribute, self.metadata)?;
        let subject = Subject::new(self.metadata, &depiction, &self.transfer, self.diameter);
        Ok(subject.draw_nodes(view, &self.nodes, &Plan::default())?.light(mode)?)
    }

    fn run(&mut self, options: &Options) -> Result<Vec<Outcome>, Failure> {
        let (layers, cells) = (f64::from(options.layers), f64::from(options.cells));
        let [iso, opaque] = surface(self.isovalue);
        let of_grid = |content: &str| (cartesian::CONTENT.name, SettingValue::Name(content.into()));
        let cases: [(String, &'static Mode, Vec<Set>); 8] = [
            ("volume".into(), &volume::MODE, vec![]),
            ("volume, half as many cells".into(), &volume::MODE, vec![number(grid::RESOLUTION.name, 0.5)]),
            (format!("layered, {layers} layers"), &layered::MODE, vec![number(layered::LAYERS.name, layers)]),
            ("sorted-splats".into(), &sorted_splats::MODE, vec![]),
            (format!("cartesian, {cells} cells"), &cartesian::MODE, vec![number(cartesian::CELLS.name, cells)]),
            ("isosurface".into(), &isosurface::MODE, vec![iso.clone(), opaque.clone()]),
            (
                format!("cartesian, {cells} cells, isosurface"),
                &cartesian::MODE,
                vec![number(cartesian::CELLS.name, cells), of_grid("isosurface"), iso, opaque],
            ),
            ("spheres".into(), &spheres::MODE, vec![number(spheres::THRESHOLD.name, self.isovalue)]),
        ];
        print_head();
        let mut outcomes = vec![self.columns()?];
        print_row(&outcomes[0]);
        for (name, mode, set) in cases {
            let outcome = self.measure(name, mode, settings(set))?;
            print_row(&outcome);
            outcomes.push(outcome);
        }
        Ok(outcomes)
    }

    /// Draws with the passes of the backend that is asked for; `None` where they do not draw the mode.
    fn on_adapter(
        &mut self,
        depiction: &Depiction,
        transfer: &TransferFunction,
    ) -> Result<Option<(Raw, AdapterFrame)>, Failure> {
        let Some(adapter) = self.adapter.as_deref_mut() else { return Ok(None) };
        // An error says only that other backends draw the mode.
        let Ok(Some(passes)) = passes(depiction, Some(self.backend), Some(&mut *adapter)) else {
            return Ok(None);
        };
        let subject = Subject::new(self.metadata, depiction, transfer, self.diameter);
        let job = AdapterJob {
            view: &self.view,
            depiction,
            metadata: self.metadata,
            nodes: &self.nodes,
            plan: &Plan::default(),
            passes,
            light: None,
            // The first of several is not counted: it compiles the shaders.
            repeat: self.repeat.max(2),
        };
        let drawn = draw_on(adapter, &subject, job)?;
        self.adapter_name = Some(drawn.1.adapter.clone());
        Ok(Some(drawn))
    }

    /// The order-independent splats (F12 chapter 4).
    fn columns(&mut self) -> Result<Outcome, Failure> {
        let mode = &column_density::MODE;
        let depiction = Depiction::new(mode, Settings::default(), self.attribute, self.metadata)?;
        let preset = mode.transfer[usize::from(self.attribute.is_some())];
        let transfer = TransferFunction::preset(preset).unwrap_or_default();
        let particles = self.metadata.particles();
        if let Some((values, frame)) = self.on_adapter(&depiction, &transfer)? {
            let image = composite(&values.sums(mode)?.0, &transfer);
            let spent = Spent::Adapter(frame.backend, frame.milliseconds);
            return Ok(self.outcome("column-density".into(), mode, image, spent, (particles, None)));
        }
        let (mut splatting, mut coloring, mut image, mut bytes) = (Vec::new(), Vec::new(), None, 0);
        for _ in 0..self.repeat {
            let start = Instant::now();
            let subject = Subject::new(self.metadata, &depiction, &transfer, self.diameter);
            let (picture, _) = subject.draw_nodes(&self.view, &self.nodes, &Plan::default())?.sums(mode)?;
            splatting.push(start.elapsed());
            let start = Instant::now();
            image = Some(composite(&picture, &transfer));
            coloring.push(start.elapsed());
            bytes = 4 * (picture.p.len() + picture.ps.len()) as u64;
        }
        let image = image.ok_or("nothing was drawn")?;
        let spent = Spent::Processor([splatting, coloring]);
        Ok(self.outcome("column-density".into(), mode, image, spent, (particles, Some(bytes))))
    }

    fn measure(&mut self, name: String, mode: &'static Mode, settings: Settings) -> Result<Outcome, Failure> {
        settings.check(mode)?;
        let depiction = Depiction::new(mode, settings.clone(), self.attribute, self.metadata)?;
        let transfer = self.transfer.clone();
        if let Some((values, frame)) = self.on_adapter(&depiction, &transfer)? {
            let LightPicture { colors, report, .. } = values.light(mode)?;
            let spent = Spent::Adapter(frame.backend, frame.milliseconds);
            return Ok(self.outcome(name, mode, colors.image(), spent, (report.particles, report.memory)));
        }
        let (mut resampling, mut rendering, mut painted) = (Vec::new(), Vec::new(), None);
        for _ in 0..self.repeat {
            let now = self.paint(mode, settings.clone(), &self.view)?;
            resampling.push(now.report.resampling);
            rendering.push(now.report.rendering);
            painted = Some(now);
        }
        let LightPicture { colors, report, .. } = painted.ok_or("nothing was drawn")?;
        let spent = Spent::Processor([resampling, rendering]);
        Ok(self.outcome(name, mode, colors.image(), spent, (report.particles, report.memory)))
    }

    fn outcome(
        &mut self,
        name: String,
        mode: &'static Mode,
        image: Image,
        spent: Spent,
        (particles, memory): (u64, Option<u64>),
    ) -> Outcome {
        let [error_volume, error_surface] = [0, 1].map(|k| color_error(&image, &self.references[k]).0);
        self.images.push(image);
        let (backend, [resampling, rendering], total, passes) = match spent {
            Spent::Processor([resampling, rendering]) => {
                let total = resampling.iter().zip(&rendering).map(|(a, b)| *a + *b).collect();
                let parts = [resampling, rendering].map(|times| Some(Times::of(times)));
                let Times { median, fastest } = Times::of(total);
                ("cpu", parts, Total { median, fastest: Some(fastest) }, BTreeMap::new())
            }
            Spent::Adapter(backend, mut passes) => {
                let frame = passes.remove("frame").unwrap_or_default() / 1e3;
                (backend, [None; 2], Total { median: frame, fastest: None }, passes)
            }
        };
        Outcome {
            name,
            mode: mode.name,
            backend: backend.to_owned(),
            resampling,
            rendering,
            total,
            passes,
            particles,
            memory,
            error_volume,
            error_surface,
        }
    }

    /// Writes each picture, all of them on one sheet, and the table.
    fn write(&self, folder: &Path, report: &Report) -> Result<(), Failure> {
        let [finest, surface] = &self.references;
        let mut entries = vec![
            Entry { image: finest, caption: vec!["reference: volume".into(), "sampled more finely".into()] },
            Entry { image: surface, caption: vec!["reference: isosurface".into(), "sampled more finely".into()] },
        ];
        for (outcome, image) in report.outcomes.iter().zip(&self.images) {
            let surface = [isosurface::MODE.name, spheres::MODE.name].contains(&outcome.mode)
                || outcome.name.ends_with("isosurface");
            let error = if surface { outcome.error_surface } else { outcome.error_volume };
            let numbers = format!("{:.2} s, error {error:.2}", outcome.total.median);
            entries.push(Entry { image, caption: vec![outcome.name.clone(), numbers] });
            let file = outcome.name.replace(", ", "-").replace(' ', "-");
            output::write_png(&folder.join(format!("{file}.png")), image)?;
        }
        output::write_png(&folder.join("reference-volume.png"), finest)?;
        output::write_png(&folder.join("reference-isosurface.png"), surface)?;
        output::write_png(&folder.join("compare.png"), &sheet(&entries, 3))?;
        let path = folder.join("compare.csv");
        let named = |error: csv::Error| format!("{}: {error}", path.display());
        let mut writer = csv::Writer::from_writer(Vec::new());
        let header =
            "name,mode,backend,resampling_s,rendering_s,total_s,particles,memory_bytes,error_volume,error_surface";
        writer.write_record(header.split(',')).map_err(named)?;
        for o in &report.outcomes {
            let median = |times: Option<Times>| times.map_or(String::new(), |times| times.median.to_string());
            let times = [median(o.resampling), median(o.rendering), o.total.median.to_string()];
            let counts = [Some(o.particles), o.memory];
            let counts = counts.map(|count| count.map_or(String::new(), |count| count.to_string()));
            let errors = [o.error_volume, o.error_surface].map(|error| error.to_string());
            let names = [o.name.clone(), o.mode.to_owned(), o.backend.clone()];
            writer.write_record(names.iter().chain(&times).chain(&counts).chain(&errors)).map_err(named)?;
        }
        let bytes = writer.into_inner().map_err(|error| format!("{}: {error}", path.display()))?;
        output::write_atomically(&path, &bytes)?;
        let mut text = "name,first_s,resampling_s,rendering_s,total_s,bricks,resampled,memory_bytes,error\n".to_owned();
        for o in &report.orbits {
            let name = o.name.replace(", ", ": ");
            let times = [o.first, o.resampling.median, o.rendering.median, o.total.median].map(|time| time.to_string());
            text += &format!("{name},{},{},{},{},{}\n", times.join(","), o.bricks, o.resampled, o.memory, o.error);
        }
        Ok(output::write_atomically(&folder.join("orbit.csv"), text.as_bytes())?)
    }
}

fn print_head() {
    eprintln!(
        "{:34} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "technique", "drawn by", "resample s", "render s", "total s", "MiB", "to volume", "to surface"
    );
}

fn print_row(outcome: &Outcome) {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".into());
    let seconds = |times: Option<Times>| or_dash(times.map(|times| format!("{:.3}", times.median)));
    eprintln!(
        "{:34} {:>10} {:>10} {:>10} {:>10.3} {:>10} {:>10.2} {:>10.2}",
        outcome.name,
        outcome.backend,
        seconds(outcome.resampling),
        seconds(outcome.rendering),
        outcome.total.median,
        or_dash(outcome.memory.map(|bytes| format!("{:.1}", bytes as f64 / f64::from(1 << 20)))),
        outcome.error_volume,
        outcome.error_surface
    );
    let passes: Vec<String> = outcome.passes.iter().map(|(pass, time)| format!("{pass} {time:.1}")).collect();
    if !passes.is_empty() {
        eprintln!("    milliseconds: {}", passes.join(", "));
    }
}
