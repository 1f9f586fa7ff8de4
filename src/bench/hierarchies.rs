//! Hierarchies side by side: the same particles in the same views, within the same numbers of splats, through each of them.

mod curves;
pub mod ways;

use super::hierarchies_in_memory::{self as in_memory, Splat};
use super::hierarchies_of_fields;
use super::paged::{Drawn, Paged};
use super::process_memory::peak_memory;
use super::sheet::{Entry, sheet};
use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build_source};
use crate::color::composite::{Image, composite_at, enlarged_difference};
use crate::color::transfer::TransferFunction;
use crate::color::{Accumulation, output};
use crate::command_line::arguments::PictureSize;
use crate::command_line::progress_bar::Terminal;
use crate::command_line::usage;
use crate::cpu::{Extent, Method, Positions, SplatOptions, Splats, Sprite, draw};
use crate::hierarchy::{Kinds, Purpose};
use crate::look::{DataKind, LookPatch, Member};
use crate::mode::{LevelChoice, Levels as LevelKind, Mode, Plan};
use crate::model::{Bounds, Covariance, Dataset, Kernel};
use crate::modes::{column_density, xray};
use crate::picture::Subject;
use crate::picture::source::{Wanted, particles};
use crate::store::{InMemory, Representative, Tree};
use crate::stream::first_nodes;
use crate::synth::grids::{self, SyntheticGrid};
use crate::synth::{Generator, clusters::Clusters, filaments::Filaments, gadget, grid_files};
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;
use ways::{Data, Way};

/// What is compared.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "bench-hierarchies")]
pub struct Options {
    /// Hierarchies that `bench hierarchies` compares [default: all that take the data's kind, but pca-gaussian, pca-disc and pca-pixel].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_enum)]
    pub hierarchies: Vec<Way>,
    /// Numbers of splats of `bench hierarchies`, as numbers or shares of the particles.
    #[arg(long, value_name = "N%,...", value_delimiter = ',', value_parser = budget, default_values = ["1%", "4%", "16%"])]
    pub budgets: Vec<Budget>,
    /// Views of `bench hierarchies`: the first is from above.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub views: u16,
}

/// A number of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// So many.
    Splats(u64),
    /// A share of the particles.
    Share(f64),
}

fn budget(text: &str) -> Result<Budget, String> {
    let expected = || "expected a number of splats from 1, or a share of the particles such as 4%".to_owned();
    let number = |text: &str| text.parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
    match text.strip_suffix('%') {
        Some(share) => number(share).map(|share| Budget::Share(0.01 * share)).ok_or_else(expected),
        None => number(text).filter(|n| *n >= 1.0).map(|n| Budget::Splats(n as u64)).ok_or_else(expected),
    }
}

impl Budget {
    pub(super) fn of(self, particles: u64) -> u64 {
        match self {
            Budget::Splats(splats) => splats,
            Budget::Share(share) => ((share * particles as f64) as u64).max(1),
        }
    }
}

/// What one hierarchy comes to in one view with one budget. Errors are of the sums against the exact ones, relative.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Which it is.
    pub hierarchy: Way,
    /// Splats at most.
    pub budget: u64,
    /// Index of the view.
    pub view: usize,
    /// Splats that were drawn.
    pub splats: u64,
    /// Nodes that they are of.
    pub nodes: usize,
    /// Bytes of the pages that these nodes lie in.
    pub bytes_read: Option<u64>,
    /// Bytes of the page file.
    pub bytes_file: Option<u64>,
    /// Seconds from the source to the page file.
    pub build_s: Option<f64>,
    /// Most memory that the program has taken until it was built, bytes.
    pub build_peak_memory: Option<u64>,
    /// Choosing nodes that are in memory, milliseconds.
    pub select_ms: Option<f64>,
    /// Choosing, decoding and drawing, milliseconds.
    pub frame_ms: Times,
    /// Relative L1 error.
    pub error_l1: f64,
    /// Relative L2 error.
    pub error_l2: f64,
    /// Colour error, of 255.
    pub error_color: ColorError,
    /// Peak signal-to-noise ratio of the sums, the brightest pixel being the peak, decibels.
    pub psnr: f64,
    /// What the error in L1 is at most, where something is promised.
    pub error_bound: Option<f64>,
}

/// Distances of colours, of 255.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ColorError {
    /// Mean over the pixels.
    pub mean: f64,
    /// What 99 % of them are below.
    pub p99: f64,
}

/// A camera.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Camera {
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    ortho: f64,
}

/// Who is best within a number of splats.
#[derive(Clone, Debug, Serialize)]
pub struct Best {
    budget: u64,
    hierarchy: Way,
    error_l2: f64,
}

/// What the suite finds for some data.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    pub(super) source: String,
    /// Particles, or samples.
    pub(super) particles: u64,
    pub(super) size: [u32; 2],
    pub(super) views: Vec<Camera>,
    pub(super) outcomes: Vec<Outcome>,
    pub(super) best: Vec<Best>,
}

/// One report where a path is named, else one for each kind of generated data.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Reports {
    /// Of the named data.
    One(Box<Report>),
    /// Of generated data.
    Several(Vec<Report>),
}

/// Data that is made where none is named.
enum Made {
    /// A snapshot.
    Particles(Box<dyn Generator>),
    /// A volume, as `synth` makes it.
    Volume(SyntheticGrid),
}

/// Samples along the sides of volumes that are made: as many samples as particles, where that is quickly built and drawn.
const SIDES: [f64; 2] = [8.0, 64.0];

impl Made {
    /// All that is made, by its names for `synth`.
    fn all(arguments: &Arguments, particles: u64) -> [(&'static str, Made); 4] {
        let side = (particles as f64).cbrt().round().clamp(SIDES[0], SIDES[1]) as u64;
        let volume = |kind| Made::Volume(SyntheticGrid::new(kind, 3, [side; 3], arguments.seed));
        [
            ("filaments", Made::Particles(Box::new(Filaments::new(arguments.seed, particles)))),
            ("clusters", Made::Particles(Box::new(Clusters::new(arguments.seed, particles)))),
            ("wave", volume(grids::Kind::Wave { level: 2, direction: 0, angle: 0.0 })),
            ("blobs", volume(grids::Kind::Blobs)),
        ]
    }

    /// What it is, and the mode by whose sums it is compared.
    fn data(&self) -> (Data, &'static Mode) {
        match self {
            Made::Particles(_) => (Data::Particles, &column_density::MODE),
            Made::Volume(_) => (Data::Samples, &xray::MODE),
        }
    }

    /// Compares it by those of its hierarchies that are asked for.
    fn compare(&self, name: &str, arguments: &Arguments, folder: &Path) -> Result<Report, Failure> {
        let temporary = tempfile::tempdir()?;
        let source = temporary.path().join(name);
        let (data, _) = self.data();
        let asked = &arguments.hierarchies.hierarchies;
        let own: Vec<Way> = asked.iter().copied().filter(|way| way.takes(data)).collect();
        match self {
            Made::Particles(generator) => {
                let mut file = std::io::BufWriter::new(std::fs::File::create(&source)?);
                gadget::write(generator.as_ref(), &mut file, &())?;
                std::io::Write::flush(&mut file)?;
                let named = format!("synth {name} -n {}", generator.len());
                let ways = data.chosen(&own, &named)?;
                Bench::new(&source, named, arguments)?.run(&ways, folder)
            }
            Made::Volume(grid) => {
                grid_files::write(grid, &source, &())?;
                let [x, y, z] = grid.shape();
                let named = format!("synth {name} --size {x},{y},{z}");
                let ways = data.chosen(&own, &named)?;
                hierarchies_of_fields::compare(&source, named, &ways, arguments, folder)
            }
        }
    }
}

/// Compares hierarchies, writes pictures, differences and curves, and prints a table to standard error.
///
/// # Errors
/// When the data cannot be read or built, a hierarchy that is asked for does not take it, or a file cannot be written.
pub fn measure(arguments: &Arguments) -> Result<Reports, Failure> {
    // What is asked for on the command line; the default names all.
    if !arguments.backends.iter().any(|name| name == "cpu") {
        let found = arguments.backends.join(",");
        return Err(usage(format!("--backends: found {found}, expected cpu, which hierarchies are compared on")));
    }
    let folder = arguments.flight.output.as_deref().unwrap_or(Path::new("hierarchies"));
    let asked = &arguments.hierarchies.hierarchies;
    if let Some(path) = &arguments.path {
        let named = path.display().to_string();
        let data = Data::of(path)?;
        let ways = data.chosen(asked, &named)?;
        let report = match data {
            Data::Particles => {
                check_mode(&named, arguments.flight.mode, &column_density::MODE)?;
                Bench::new(path, named, arguments)?.run(&ways, folder)?
            }
            Data::Samples | Data::BuiltSamples => {
                hierarchies_of_fields::compare(path, named, &ways, arguments, folder)?
            }
        };
        write_csv(arguments, std::slice::from_ref(&report))?;
        return Ok(Reports::One(Box::new(report)));
    }
    let particles = arguments.sizes.first().copied().unwrap_or(200_000);
    let mut reports = Vec::new();
    for (name, made) in Made::all(arguments, particles) {
        let (data, mode) = made.data();
        let is_taken = asked.is_empty() || asked.iter().any(|way| way.takes(data));
        if is_taken && arguments.flight.mode.is_none_or(|asked| asked.name == mode.name) {
            reports.push(made.compare(name, arguments, &folder.join(name))?);
        }
    }
    if let (true, Some(mode)) = (reports.is_empty(), arguments.flight.mode) {
        let [particles, volumes] = [column_density::MODE.name, xray::MODE.name];
        return Err(usage(format!(
            "--mode: found {}, expected {particles} with hierarchies of particles, {volumes} with those of volumes",
            mode.name
        )));
    }
    write_csv(arguments, &reports)?;
    Ok(Reports::Several(reports))
}

/// Refuses another mode than the one by whose sums hierarchies of such data are compared; `named` is the data's name.
///
/// # Errors
/// Wrong usage.
pub(super) fn check_mode(named: &str, asked: Option<&'static Mode>, own: &Mode) -> Result<(), Failure> {
    match asked.filter(|asked| asked.name != own.name) {
        Some(asked) => Err(usage(format!("{named}: --mode: found {}, expected {}", asked.name, own.name))),
        None => Ok(()),
    }
}

/// What all pictures share.
struct Bench<'a> {
    arguments: &'a Arguments,
    named: String,
    paged: Paged,
    /// The source's particles; `None` of page files, whose leaves stand for them.
    source: Option<InMemory>,
    /// Particles as splats, with what each is in memory.
    splats: Vec<Splat>,
    kernel: Kernel,
    built: Option<(f64, Option<u64>)>,
    _folder: tempfile::TempDir,
}

impl<'a> Bench<'a> {
    fn new(path: &Path, named: String, arguments: &'a Arguments) -> Result<Bench<'a>, Failure> {
        let temporary = tempfile::tempdir()?;
        let is_source = matches!(DataKind::of(path)?, DataKind::Source);
        let (page_file, built): (PathBuf, _) = match is_source {
            false => (path.to_owned(), None),
            true => {
                let out = temporary.path().join("hierarchies.df");
                let hierarchies = Kinds::of_particles();
                let options = BuildOptions { hierarchies, memory: arguments.memory, ..BuildOptions::default() };
                let start = Instant::now();
                build_source(path, &Default::default(), &options, &out, &())?;
                (out, Some((start.elapsed().as_secs_f64(), peak_memory("self"))))
            }
        };
        let mut paged = Paged::open(&page_file)?;
        let source: Option<Dataset> = match is_source {
            true => Some(particles(&[Member::new(path)], &Wanted::of([&LookPatch::default()], None), &Terminal)?.1),
            false => None,
        };
        let metadata = paged.file.metadata();
        let kernel = metadata.kernel;
        // Any view of all leaves.
        let all = views(metadata.bounds(), 1, (64, 64))?[0].0;
        let leaves = paged.scene.converge_blocking(&all, 0.0)?;
        let splats = in_memory::splats(&leaves.nodes, metadata);
        let source = source.map(InMemory::new);
        Ok(Bench { arguments, named, paged, source, splats, kernel, built, _folder: temporary })
    }

    fn run(mut self, ways: &[Way], folder: &Path) -> Result<Report, Failure> {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let options = &self.arguments.hierarchies;
        let PictureSize { width, height } =
            self.arguments.flight.size.unwrap_or(PictureSize { width: 512, height: 512 });
        let bounds = self.paged.file.metadata().bounds();
        let particles = self.paged.file.metadata().particles();
        let all_views = views(bounds, options.views.into(), (width, height))?;
        let transfer = TransferFunction::preset(column_density::MODE.transfer[0]).unwrap_or_default();
        let (mut outcomes, mut shown): (Vec<Outcome>, Vec<Shown>) = (Vec::new(), Vec::new());
        print_head(&self.named);
        for (number, (view, _)) in all_views.iter().enumerate() {
            let exact = self.exact(view)?;
            let levels = transfer.levels(&exact);
            let truth = composite_at(&exact, &transfer, &levels);
            for way in ways {
                for budget in &options.budgets {
                    let budget = budget.of(particles);
                    let drawn = self.draw(*way, view, budget)?;
                    let image = composite_at(&drawn.sums, &transfer, &levels);
                    let outcome = self.outcome(*way, budget, number, &drawn, (&exact, &truth), &image);
                    print_row(&outcome);
                    if number == 0 {
                        shown.push(Shown { outcome: outcome.clone(), image });
                    }
                    outcomes.push(outcome);
                }
            }
            if number == 0 {
                Shown::write(folder, options.budgets.len() as u32, &truth, &shown)?;
            }
        }
        let best = conclude(folder, &outcomes)?;
        Ok(Report {
            source: self.named,
            particles,
            size: [width, height],
            views: all_views.iter().map(|(_, camera)| *camera).collect(),
            outcomes,
            best,
        })
    }

    /// The picture of the source's particles.
    fn exact(&mut self, view: &View) -> Result<Accumulation, Failure> {
        let depiction = self.paged.depiction(LevelChoice { levels: LevelKind::Splats, ..LevelChoice::default() })?;
        let (nodes, metadata) = match &self.source {
            Some(source) => (first_nodes(source, view)?, source.metadata()),
            None => {
                self.paged.scene.purpose = Purpose::Splats;
                (self.paged.scene.converge_blocking(view, 0.0)?.nodes, self.paged.file.metadata())
            }
        };
        let transfer = TransferFunction::default();
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        Ok(subject.draw_nodes(view, &nodes, &Plan::default())?.sums(depiction.mode)?.0)
    }

    fn draw(&mut self, way: Way, view: &View, budget: u64) -> Result<Drawn, Failure> {
        let choice =
            |levels, representative, splats| LevelChoice { levels, representative, splats, ..LevelChoice::default() };
        let (ellipsoid, round) = (Representative::Ellipsoid, Representative::Round);
        match way {
            Way::Sample => {
                let share = (budget as f64 / self.paged.file.metadata().particles() as f64).min(1.0) as f32;
                self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.0, Plan { share, ..Plan::default() })
            }
            Way::OctreeTau => self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.8, Plan::default()),
            Way::Octree => self.paged(choice(LevelKind::Splats, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            Way::Pca => self.paged(choice(LevelKind::Clusters, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            Way::PcaRound => self.paged(choice(LevelKind::Clusters, round, Some(budget)), view, 0.8, Plan::default()),
            Way::PcaGaussian => self.with_footprint(Sprite::Gaussian, view, budget),
            Way::PcaDisc => self.with_footprint(Sprite::Disc, view, budget),
            Way::PcaPixel => self.with_footprint(Sprite::Pixel, view, budget),
            Way::OctreeVolume => Ok(self.of_splats(&in_memory::in_cells(&self.splats, budget as usize), None, view)?),
            Way::PcaFree => {
                let (splats, covariances) = in_memory::free(&self.splats, budget as usize, self.kernel);
                Ok(self.of_splats(&splats, Some(&covariances), view)?)
            }
            Way::PcaPublished => {
                Ok(self.of_splats(&in_memory::published(&self.splats, budget as usize, self.kernel), None, view)?)
            }
            Way::Wavelet | Way::WaveletRound | Way::Mip => Err(Data::Particles.refusal(way, &self.named)),
        }
    }

    /// Draws clusters with another footprint.
    fn with_footprint(&mut self, sprite: Sprite, view: &View, budget: u64) -> Result<Drawn, Failure> {
        let choice =
            LevelChoice { levels: LevelKind::Clusters, splats: Some(budget), sprite, ..LevelChoice::default() };
        self.paged(choice, view, 0.8, Plan::default())
    }

    /// Draws nodes of the page file.
    fn paged(&mut self, choice: LevelChoice, view: &View, tau: f64, plan: Plan) -> Result<Drawn, Failure> {
        self.paged.draw(choice, view, tau, plan, self.arguments.repeat)
    }

    /// Draws splats that are in memory, ellipsoids where they have second moments.
    fn of_splats(&self, splats: &[Splat], shapes: Option<&[Covariance]>, view: &View) -> Result<Drawn, Failure> {
        let positions: Vec<[f64; 3]> = splats.iter().map(|splat| splat.place).collect();
        let h: Vec<f32> = splats.iter().map(|splat| splat.smoothing_length as f32).collect();
        let weight: Vec<f32> = splats.iter().map(|splat| splat.mass as f32).collect();
        let extent = shapes.map_or(Extent::World(&h), Extent::Ellipsoids);
        let batch = Splats::new(Positions::World(&positions), extent, &weight, None)?;
        let options = SplatOptions { kernel: self.kernel, method: Method::Pyramid, ..SplatOptions::default() };
        let (mut times, mut sums) = (Vec::new(), Accumulation::default());
        for _ in 0..self.arguments.repeat {
            let start = Instant::now();
            sums = draw(view, &[batch], &options);
            times.push(start.elapsed());
        }
        let splats = splats.len() as u64;
        Ok(Drawn { sums, splats, nodes: Vec::new(), select_ms: None, times, error_bound: None })
    }

    fn outcome(
        &self,
        hierarchy: Way,
        budget: u64,
        view: usize,
        drawn: &Drawn,
        (exact, truth): (&Accumulation, &Image),
        image: &Image,
    ) -> Outcome {
        let [error_l1, error_l2, psnr] = sum_errors(&drawn.sums, exact);
        let pages: BTreeSet<_> = drawn.nodes.iter().map(|node| node.node.page).collect();
        let is_paged = drawn.select_ms.is_some();
        Outcome {
            hierarchy,
            budget,
            view,
            splats: drawn.splats,
            nodes: drawn.nodes.len(),
            bytes_read: is_paged.then(|| pages.iter().map(|page| self.paged.file.page_bytes(*page)).sum()),
            bytes_file: is_paged.then(|| self.paged.file.bytes()),
            build_s: self.built.map(|(seconds, _)| seconds),
            build_peak_memory: self.built.and_then(|(_, memory)| memory),
            select_ms: drawn.select_ms,
            frame_ms: milliseconds(Times::of(drawn.times.clone())),
            error_l1,
            error_l2,
            error_color: color_errors(image, truth),
            psnr,
            error_bound: drawn.error_bound,
        }
    }
}

/// Relative L1 and L2 error of sums, and their peak signal-to-noise ratio in decibels, the brightest pixel being the peak.
pub(super) fn sum_errors(sums: &Accumulation, exact: &Accumulation) -> [f64; 3] {
    let pairs = || sums.p.iter().zip(&exact.p).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let total: f64 = pairs().map(|(_, b)| b.abs()).sum();
    let squares: f64 = pairs().map(|(_, b)| b * b).sum();
    let differ: f64 = pairs().map(|(a, b)| (a - b).abs()).sum();
    let square: f64 = pairs().map(|(a, b)| (a - b) * (a - b)).sum();
    let peak = pairs().map(|(_, b)| b).fold(0.0, f64::max);
    let pixels = exact.p.len().max(1) as f64;
    let psnr = 10.0 * (peak * peak * pixels / square.max(f64::MIN_POSITIVE)).log10();
    [differ / total, (square / squares).sqrt(), psnr]
}

impl Shown {
    /// A sheet of the pictures and their differences from the exact one, four times enlarged; a row for each hierarchy.
    pub(super) fn write(folder: &Path, columns: u32, truth: &Image, shown: &[Shown]) -> Result<(), Failure> {
        let caption = |outcome: &Outcome| {
            let Outcome { hierarchy, splats, error_l2, error_color, .. } = outcome;
            vec![
                format!("{hierarchy}, {splats} splats"),
                format!("L2 {error_l2:.3}, colour {:.1} of 255", error_color.mean),
            ]
        };
        let differences: Vec<Image> = shown.iter().map(|shown| enlarged_difference(&shown.image, truth)).collect();
        let pictures: Vec<Entry<'_>> =
            shown.iter().map(|shown| Entry { image: &shown.image, caption: caption(&shown.outcome) }).collect();
        let differing: Vec<Entry<'_>> = shown
            .iter()
            .zip(&differences)
            .map(|(shown, image)| Entry { image, caption: caption(&shown.outcome) })
            .collect();
        output::write_png(&folder.join("exact.png"), truth)?;
        output::write_png(&folder.join("pictures.png"), &sheet(&pictures, columns))?;
        output::write_png(&folder.join("differences.png"), &sheet(&differing, columns))?;
        Ok(())
    }
}

/// A picture for the sheet.
pub(super) struct Shown {
    pub(super) outcome: Outcome,
    pub(super) image: Image,
}

pub(super) fn color_errors(image: &Image, truth: &Image) -> ColorError {
    let distance = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>() / 3.0;
    let mut all: Vec<f64> = image.rgba.iter().zip(&truth.rgba).map(distance).collect();
    all.sort_by(f64::total_cmp);
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    ColorError { mean, p99: all.get(all.len() * 99 / 100).copied().unwrap_or(0.0) }
}

pub(super) fn milliseconds(times: Times) -> Times {
    Times { median: 1e3 * times.median, fastest: 1e3 * times.fastest }
}

/// Parallel views of a box: from above, then from other directions, the same for any data.
pub(super) fn views(bounds: Bounds, count: usize, (width, height): (u32, u32)) -> Result<Vec<(View, Camera)>, Failure> {
    let (middle, size) = (bounds.center(), bounds.size());
    let away = size.length().max(f64::MIN_POSITIVE);
    let view = |number: usize| {
        // Directions that spread evenly over a sphere, beginning at its pole.
        let turn = 2.399963 * number as f64;
        let z = 1.0 - 2.0 * (number as f64 / count.max(1) as f64).min(1.0);
        let across = (1.0 - z * z).max(0.0).sqrt();
        let toward = DVec3::new(across * turn.cos(), across * turn.sin(), z);
        let up = if across < 0.1 { DVec3::Y } else { DVec3::Z };
        let ortho = if number == 0 { size.x.max(size.y) } else { size.max_element() };
        let ortho = if ortho > 0.0 { ortho } else { 1.0 };
        let eye = middle + away * toward;
        let view = View::look_at(eye, middle, up, Projection::Orthographic { height: ortho }, width, height)?;
        let camera = Camera { eye: eye.to_array(), target: middle.to_array(), up: up.to_array(), ortho };
        Ok((view, camera))
    };
    (0..count).map(view).collect()
}

/// Writes the curves of all outcomes, and tells under their table who is best.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn conclude(folder: &Path, outcomes: &[Outcome]) -> Result<Vec<Best>, Failure> {
    let best = best(outcomes);
    for Best { budget, hierarchy, error_l2 } in &best {
        eprintln!("best within {budget} splats: {hierarchy}, L2 {error_l2:.4}");
    }
    curves::write(folder, outcomes)?;
    Ok(best)
}

/// How far a number of splats may be exceeded, as a factor: a sample has its number only in the mean.
const MOST_OVER: f64 = 1.02;

/// For each number of splats the smallest mean L2 error of all views, of those that keep to the number in each.
fn best(outcomes: &[Outcome]) -> Vec<Best> {
    let budgets: BTreeSet<u64> = outcomes.iter().map(|outcome| outcome.budget).collect();
    // What takes as many splats as it likes is not in the race.
    let ways: BTreeSet<Way> = outcomes.iter().map(|own| own.hierarchy).filter(|way| *way != Way::OctreeTau).collect();
    let mean = |budget: u64, way: Way| {
        let own = || outcomes.iter().filter(move |own| own.budget == budget && own.hierarchy == way);
        let keeps = own().all(|own| own.splats as f64 <= MOST_OVER * budget as f64);
        let count = own().count();
        (keeps && count > 0).then(|| own().map(|own| own.error_l2).sum::<f64>() / count as f64)
    };
    let of = |budget: u64| {
        let all = ways.iter().filter_map(|way| Some((mean(budget, *way)?, *way)));
        let (error_l2, hierarchy) = all.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Best { budget, hierarchy, error_l2 })
    };
    budgets.into_iter().filter_map(of).collect()
}

fn write_csv(arguments: &Arguments, reports: &[Report]) -> Result<(), Failure> {
    let Some(path) = &arguments.csv else { return Ok(()) };
    let failed = |error: csv::Error| format!("{}: {error}", path.display());
    let mut writer = csv::Writer::from_path(path).map_err(failed)?;
    let head = [
        "source",
        "hierarchy",
        "budget",
        "view",
        "splats",
        "nodes",
        "bytes_read",
        "bytes_file",
        "build_s",
        "build_peak_memory",
        "select_ms",
        "frame_ms",
        "frame_ms_fastest",
        "error_l1",
        "error_l2",
        "error_color",
        "error_color_p99",
        "psnr",
        "error_bound",
    ];
    writer.write_record(head).map_err(failed)?;
    for report in reports {
        for own in &report.outcomes {
            let whole = |number: Option<u64>| number.map_or(String::new(), |number| number.to_string());
            let real = |number: Option<f64>| number.map_or(String::new(), |number| number.to_string());
            writer
                .write_record([
                    report.source.clone(),
                    own.hierarchy.to_string(),
                    own.budget.to_string(),
                    own.view.to_string(),
                    own.splats.to_string(),
                    own.nodes.to_string(),
                    whole(own.bytes_read),
                    whole(own.bytes_file),
                    real(own.build_s),
                    whole(own.build_peak_memory),
                    real(own.select_ms),
                    own.frame_ms.median.to_string(),
                    own.frame_ms.fastest.to_string(),
                    own.error_l1.to_string(),
                    own.error_l2.to_string(),
                    own.error_color.mean.to_string(),
                    own.error_color.p99.to_string(),
                    own.psnr.to_string(),
                    real(own.error_bound),
                ])
                .map_err(failed)?;
        }
    }
    writer.flush().map_err(|error| format!("{}: {error}", path.display()).into())
}

/// Begins the table of some data.
pub(super) fn print_head(named: &str) {
    eprintln!("{named}");
    eprintln!(
        "{:<14} {:>4} {:>9} {:>9} {:>6} {:>9} {:>9} {:>8} {:>8} {:>8} {:>7}",
        "hierarchy", "view", "budget", "splats", "nodes", "select ms", "frame ms", "L1", "L2", "of 255", "PSNR"
    );
}

pub(super) fn print_row(own: &Outcome) {
    eprintln!(
        "{:<14} {:>4} {:>9} {:>9} {:>6} {:>9.2} {:>9.2} {:>8.4} {:>8.4} {:>8.2} {:>7.1}",
        own.hierarchy,
        own.view,
        own.budget,
        own.splats,
        own.nodes,
        own.select_ms.unwrap_or(0.0),
        own.frame_ms.median,
        own.error_l1,
        own.error_l2,
        own.error_color.mean,
        own.psnr
    );
}

#[cfg(test)]
impl Outcome {
    /// One of the first view, of which nothing else is known.
    fn of_tests(hierarchy: Way, budget: u64, splats: u64, error_l2: f64) -> Outcome {
        Outcome {
            hierarchy,
            budget,
            view: 0,
            splats,
            nodes: 0,
            bytes_read: None,
            bytes_file: None,
            build_s: None,
            build_peak_memory: None,
            select_ms: None,
            frame_ms: Times { median: 1.0, fastest: 1.0 },
            error_l1: error_l2,
            error_l2,
            error_color: ColorError { mean: 0.0, p99: 0.0 },
            psnr: 0.0,
            error_bound: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_keep_to_the_number_of_splats() {
        let of = Outcome::of_tests;
        let outcomes = [
            // All that it has is more than that.
            of(Way::Octree, 10, 71, 0.01),
            of(Way::OctreeTau, 10, 5, 0.001),
            of(Way::Sample, 10, 10, 0.9),
            of(Way::Pca, 10, 9, 0.3),
            // Two views, of which one is beyond the number.
            of(Way::Octree, 100, 100, 0.01),
            of(Way::Octree, 100, 103, 0.01),
            of(Way::Sample, 100, 102, 0.1),
            of(Way::Sample, 100, 98, 0.3),
            of(Way::Pca, 100, 100, 0.1),
            of(Way::Pca, 100, 100, 0.5),
            // Nobody.
            of(Way::Octree, 1, 71, 0.01),
        ];
        let found: Vec<_> = best(&outcomes).iter().map(|best| (best.budget, best.hierarchy, best.error_l2)).collect();
        assert_eq!(found, [(10, Way::Pca, 0.3), (100, Way::Sample, 0.2)]);
    }

    #[test]
    fn other_modes_are_refused() {
        let check = |asked| check_mode("a.hdf5", asked, &column_density::MODE);
        assert!(check(None).is_ok() && check(Some(&column_density::MODE)).is_ok());
        let told = check(Some(&xray::MODE)).map_err(|error| error.to_string());
        assert!(told.is_err_and(|told| told.contains("a.hdf5: --mode: found xray, expected column-density")));
    }
}
