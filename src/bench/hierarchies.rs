//! Hierarchies side by side: the same particles in the same views, within the same numbers of splats, through each of them.

use super::hierarchies_in_memory::{self as in_memory, Splat};
use super::hierarchies_of_fields;
use super::paged::{Drawn, Paged};
use super::plot;
use super::sheet::{Entry, sheet};
use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build_source};
use crate::color::composite::{Image, composite_at, enlarged_difference};
use crate::color::transfer::TransferFunction;
use crate::color::{Accumulation, output};
use crate::command_line::arguments::PictureSize;
use crate::command_line::progress_bar::Terminal;
use crate::cpu::{Extent, Method, Positions, SplatOptions, Splats, Sprite, draw};
use crate::hierarchy::{Kinds, Purpose};
use crate::look::{DataKind, LookPatch, Member};
use crate::mode::{LevelChoice, Levels as LevelKind, Plan};
use crate::model::{Bounds, Covariance, Dataset, Kernel};
use crate::modes::column_density;
use crate::picture::Subject;
use crate::picture::field::FieldSession;
use crate::picture::source::{Wanted, particles};
use crate::store::{InMemory, Representative, Tree};
use crate::stream::first_nodes;
use crate::synth::{Generator, clusters::Clusters, filaments::Filaments, gadget};
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Ways from hierarchies to pictures, and what each is. Unless asked for, only the first [`USUAL`] are compared.
pub const WAYS: [(&str, &str); 14] = [
    ("sample", "an even sample of the particles"),
    ("octree-tau", "merged particles within 0.8 pixels"),
    ("octree", "merged particles, best first"),
    ("octree-volume", "round splats of equal spread in octree cells"),
    ("pca", "clusters with their second moments"),
    ("pca-round", "the same, drawn round"),
    ("pca-free", "the same of a tree that no octree cuts, uncoded"),
    ("pca-published", "HE03: splits by distortion, sizes by equation 2"),
    ("pca-gaussian", "pca, each cluster a Gaussian"),
    ("pca-disc", "pca, each cluster a disc"),
    ("pca-pixel", "pca, each cluster a pixel"),
    ("wavelet", "of images and volumes: oriented points"),
    ("wavelet-round", "the same without directions"),
    ("mip", "box means of an evenly coarser grid"),
];

/// Those that differ in more than the footprint.
const USUAL: usize = 8;

/// What is compared.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "bench-hierarchies")]
pub struct Options {
    /// Hierarchies that `bench hierarchies` compares: sample, octree-tau, octree, octree-volume, pca, pca-round, pca-free, pca-published; and with other
    /// footprints pca-gaussian, pca-disc, pca-pixel; and of images and volumes wavelet, wavelet-round, mip.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = WAYS.map(|(name, _)| name),
          default_values = WAYS[..USUAL].iter().map(|(name, _)| *name))]
    pub hierarchies: Vec<String>,
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
    /// Its name.
    pub hierarchy: String,
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
    hierarchy: String,
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

/// Compares hierarchies, writes pictures, differences and curves, and prints a table to standard error.
///
/// # Errors
/// When the data cannot be read or built, or a file cannot be written.
pub fn measure(arguments: &Arguments) -> Result<Reports, Failure> {
    // What is asked for on the command line; the default names all.
    if arguments.backends.len() == 1 && arguments.backends[0] != "cpu" {
        return Err(format!("--backends {}: hierarchies are compared on the processor", arguments.backends[0]).into());
    }
    let folder = arguments.flight.output.as_deref().unwrap_or(Path::new("hierarchies"));
    if let Some(path) = &arguments.path {
        let report = match FieldSession::is_field(path) {
            true => hierarchies_of_fields::compare(path, path.display().to_string(), arguments, folder)?,
            false => Bench::new(path, path.display().to_string(), arguments)?.run(folder)?,
        };
        write_csv(arguments, std::slice::from_ref(&report))?;
        return Ok(Reports::One(Box::new(report)));
    }
    let particles = arguments.sizes.first().copied().unwrap_or(200_000);
    let generated: [(&str, Box<dyn Generator>); 2] = [
        ("filaments", Box::new(Filaments::new(arguments.seed, particles))),
        ("clusters", Box::new(Clusters::new(arguments.seed, particles))),
    ];
    let mut reports = Vec::new();
    let sources = tempfile::tempdir()?;
    for (name, generator) in generated {
        let source = sources.path().join(name);
        let mut file = std::io::BufWriter::new(std::fs::File::create(&source)?);
        gadget::write(generator.as_ref(), &mut file, &())?;
        std::io::Write::flush(&mut file)?;
        let named = format!("synth {name} -n {particles}");
        reports.push(Bench::new(&source, named, arguments)?.run(&folder.join(name))?);
    }
    write_csv(arguments, &reports)?;
    Ok(Reports::Several(reports))
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
                (out, Some((start.elapsed().as_secs_f64(), peak_memory())))
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

    fn run(mut self, folder: &Path) -> Result<Report, Failure> {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let options = &self.arguments.hierarchies;
        let PictureSize { width, height } =
            self.arguments.flight.size.unwrap_or(PictureSize { width: 512, height: 512 });
        let bounds = self.paged.file.metadata().bounds();
        let particles = self.paged.file.metadata().particles();
        let all_views = views(bounds, options.views.into(), (width, height))?;
        let transfer = TransferFunction::preset(column_density::MODE.transfer[0]).unwrap_or_default();
        let (mut outcomes, mut shown): (Vec<Outcome>, Vec<Shown>) = (Vec::new(), Vec::new());
        print_head();
        for (number, (view, _)) in all_views.iter().enumerate() {
            let exact = self.exact(view)?;
            let levels = transfer.levels(&exact);
            let truth = composite_at(&exact, &transfer, &levels);
            for kind in &options.hierarchies {
                for budget in &options.budgets {
                    let budget = budget.of(particles);
                    let drawn = self.draw(kind, view, budget)?;
                    let image = composite_at(&drawn.sums, &transfer, &levels);
                    let outcome = self.outcome(kind, budget, number, &drawn, (&exact, &truth), &image);
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
        let best = best(&outcomes);
        plot::write_curves(folder, &outcomes)?;
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

    fn draw(&mut self, kind: &str, view: &View, budget: u64) -> Result<Drawn, Failure> {
        let choice =
            |levels, representative, splats| LevelChoice { levels, representative, splats, ..LevelChoice::default() };
        let (ellipsoid, round) = (Representative::Ellipsoid, Representative::Round);
        match kind {
            "sample" => {
                let share = (budget as f64 / self.paged.file.metadata().particles() as f64).min(1.0) as f32;
                self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.0, Plan { share, ..Plan::default() })
            }
            "octree-tau" => self.paged(choice(LevelKind::Splats, ellipsoid, None), view, 0.8, Plan::default()),
            "octree" => self.paged(choice(LevelKind::Splats, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            "pca" => self.paged(choice(LevelKind::Clusters, ellipsoid, Some(budget)), view, 0.8, Plan::default()),
            "pca-round" => self.paged(choice(LevelKind::Clusters, round, Some(budget)), view, 0.8, Plan::default()),
            "pca-gaussian" => self.with_footprint(Sprite::Gaussian, view, budget),
            "pca-disc" => self.with_footprint(Sprite::Disc, view, budget),
            "pca-pixel" => self.with_footprint(Sprite::Pixel, view, budget),
            "octree-volume" => Ok(self.of_splats(&in_memory::in_cells(&self.splats, budget as usize), None, view)?),
            "pca-free" => {
                let (splats, covariances) = in_memory::free(&self.splats, budget as usize, self.kernel);
                Ok(self.of_splats(&splats, Some(&covariances), view)?)
            }
            _ => Ok(self.of_splats(&in_memory::published(&self.splats, budget as usize, self.kernel), None, view)?),
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
        kind: &str,
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
            hierarchy: kind.to_owned(),
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

/// For each number of splats the smallest mean L2 error of all views.
pub(super) fn best(outcomes: &[Outcome]) -> Vec<Best> {
    let budgets: BTreeSet<u64> = outcomes.iter().map(|outcome| outcome.budget).collect();
    let mean = |budget: u64, hierarchy: &str| {
        let own = outcomes.iter().filter(|own| own.budget == budget && own.hierarchy == hierarchy);
        let (sum, count) = own.fold((0.0, 0), |(sum, count), own| (sum + own.error_l2, count + 1));
        sum / f64::from(count.max(1))
    };
    // What takes as many splats as it likes is not in the race.
    let names: BTreeSet<&str> =
        outcomes.iter().map(|own| own.hierarchy.as_str()).filter(|name| *name != "octree-tau").collect();
    let of = |budget: &u64| {
        let all = names.iter().map(|name| (mean(*budget, name), *name));
        let (error_l2, name) = all.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Best { budget: *budget, hierarchy: name.to_owned(), error_l2 })
    };
    budgets.iter().filter_map(of).collect()
}

/// The most memory that the program has taken, where the system says.
pub(super) fn peak_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes << 10)
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
        "select_ms",
        "frame_ms",
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
                    own.hierarchy.clone(),
                    own.budget.to_string(),
                    own.view.to_string(),
                    own.splats.to_string(),
                    own.nodes.to_string(),
                    whole(own.bytes_read),
                    whole(own.bytes_file),
                    real(own.build_s),
                    real(own.select_ms),
                    own.frame_ms.median.to_string(),
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

pub(super) fn print_head() {
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
