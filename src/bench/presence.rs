//! What leaving particles out costs and saves (F12 4.7.3): pictures with and without presence acceleration for a series of
//! `n`, and with thinning for a series of budgets; the colour error (F12 4.10.2) beside the time, and the largest speed-up
//! whose mean error is below a limit.

use super::splat::Failure;
use super::{Arguments, Times};
use crate::build::{BuildOptions, build};
use crate::codec::VqBits;
use crate::color::Accumulation;
use crate::color::composite::{Image, color_error, composite_at};
use crate::color::transfer::{Levels, TransferFunction};
use crate::command_line::cache;
use crate::command_line::progress_bar::TerminalProgress;
use crate::cpu::Counts;
use crate::mode::{Depiction, LodBudget, Mode, Plan, Settings};
use crate::modes::{column_density, density_squared};
use crate::picture::Subject;
use crate::store::PageFile;
use crate::stream::{Scene, SceneNode, first_frame};
use crate::synth::{clusters::Clusters, dataset};
use crate::view::{Projection, View};
use glam::DVec3;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Largest displacement of a drawn particle, pixels.
const ERROR_PX: f64 = 0.8;
/// The series of `n`.
const SERIES: [f64; 9] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4, 1e6];
/// The series of budgets.
const BUDGETS: [f64; 8] = [0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0];

/// One picture.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Visualization mode.
    pub mode: &'static str,
    /// Where the camera is.
    pub view: &'static str,
    /// `presence` or `thinning`.
    pub by: &'static str,
    /// The `n`, or the budget.
    pub setting: f64,
    /// Particles in the picture's nodes.
    pub particles: u64,
    /// Splats that reach the picture.
    pub drawn: u64,
    /// The same with nothing left out.
    pub drawn_of: u64,
    /// Mean colour error, of 255.
    pub error_mean: f64,
    /// Largest colour error of a pixel.
    pub error_max: f64,
    /// Light of the picture, of that with nothing left out, minus one.
    pub light: f64,
    /// Seconds from nodes in memory to the accumulation: decoding and drawing, and for thinning finding the plan.
    pub seconds: Times,
    /// Seconds with nothing left out.
    pub seconds_of: Times,
}

/// The best setting of one kind, over all views of a mode.
#[derive(Clone, Debug, Serialize)]
pub struct Best {
    /// Visualization mode.
    pub mode: &'static str,
    /// `presence` or `thinning`.
    pub by: &'static str,
    /// The `n`, or the budget; `None` if no setting is within the limit.
    pub setting: Option<f64>,
    /// How many times faster all views together are.
    pub speed_up: f64,
    /// Mean colour error over the views.
    pub error_mean: f64,
}

/// What the suite finds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The limit on the mean colour error.
    pub limit: f64,
    /// All pictures.
    pub outcomes: Vec<Outcome>,
    /// The best settings within the limit.
    pub best: Vec<Best>,
}

/// Measures a file or source, or generated clusters of the first of the sizes, and prints a table to standard error.
///
/// # Errors
/// When a file cannot be built or read.
pub fn measure(arguments: &Arguments) -> Result<Report, Failure> {
    let folder = tempfile::tempdir()?;
    let file = match &arguments.path {
        Some(path) => PageFile::open(&cache::page_file_of(path, &TerminalProgress::new())?)?,
        None => {
            let path = folder.path().join("bench.df");
            let particles = arguments.sizes.first().copied().unwrap_or(1_000_000);
            build(
                dataset(&Clusters::new(arguments.seed, particles)),
                &BuildOptions::with_vq_bits(VqBits::default()),
                &path,
                &(),
            )?;
            PageFile::open(&path)?
        }
    };
    let file = Arc::new(file);
    let mut report = Report { limit: arguments.limit, outcomes: Vec::new(), best: Vec::new() };
    eprintln!(
        "{:16} {:7} {:8} {:>9} {:>10} {:>10} {:>8} {:>8} {:>8} {:>8}",
        "mode", "view", "by", "setting", "drawn", "of", "mean", "max", "seconds", "of"
    );
    for mode in [&column_density::MODE, &density_squared::MODE] {
        for (name, view) in views(&file, arguments.pixels)? {
            DrawnView::new(&file, mode, name, view)?.measure(arguments, &mut report.outcomes)?;
        }
    }
    for mode in [&column_density::MODE, &density_squared::MODE] {
        for by in ["presence", "thinning"] {
            report.best.push(best(&report.outcomes, mode.name, by, arguments.limit));
        }
    }
    for best in &report.best {
        match best.setting {
            Some(setting) => eprintln!(
                "{}: the largest speed-up by {} within {} of 255 is {:.2} times, with {} {setting} (mean error {:.3})",
                best.mode,
                best.by,
                arguments.limit,
                best.speed_up,
                if best.by == "presence" { "n =" } else { "a budget of" },
                best.error_mean
            ),
            None => eprintln!("{}: nothing by {} is faster within {} of 255", best.mode, best.by, arguments.limit),
        }
    }
    if let Some(path) = &arguments.csv {
        write_csv(path, &report.outcomes)?;
    }
    Ok(report)
}

/// All of it, closer, and from inside.
fn views(file: &PageFile, pixels: u32) -> Result<[(&'static str, View); 3], Failure> {
    let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
    let bounds = first_frame(file, &families, 0.0);
    let (center, size) = (bounds.center(), bounds.size().max_element());
    let whole = View::look_at(
        center + size * DVec3::Z,
        center,
        DVec3::Y,
        Projection::Orthographic { height: bounds.size().y },
        pixels,
        pixels,
    )?;
    let perspective = Projection::Perspective { fov_y: 0.8 };
    let look = |distance: f64| {
        let eye = center + size * distance * DVec3::new(0.4, 0.5, 0.77);
        View::look_at(eye, center, DVec3::Y, perspective, pixels, pixels)
    };
    Ok([("whole", whole), ("closer", look(0.8)?), ("inside", look(0.3)?)])
}

/// A picture that is drawn with more and less left out.
struct DrawnView<'a> {
    file: &'a PageFile,
    name: &'static str,
    view: View,
    depiction: Depiction,
    transfer: TransferFunction,
    nodes: Vec<SceneNode>,
}

impl DrawnView<'_> {
    fn new<'a>(
        file: &'a Arc<PageFile>,
        mode: &'static Mode,
        name: &'static str,
        view: View,
    ) -> Result<DrawnView<'a>, Failure> {
        let depiction = Depiction::new(mode, Settings::default(), None, file.metadata())?;
        let preset = mode.transfer[usize::from(depiction.attribute.is_some())];
        let transfer = TransferFunction::preset(preset).unwrap_or_default();
        let nodes = Scene::new(Arc::clone(file), u64::MAX).converge_blocking(&view, ERROR_PX)?.nodes;
        Ok(DrawnView { file, name, view, depiction, transfer, nodes })
    }

    /// Draws with a plan, which is found again each time.
    fn draw(
        &self,
        lod_budget: &LodBudget,
        levels: Option<Levels>,
        repeat: u32,
    ) -> Result<(Accumulation, Counts, Times), Failure> {
        // Sums have no use for a diameter.
        let subject = Subject::new(self.file.metadata(), &self.depiction, &self.transfer, 0.0);
        let (view, nodes) = (&self.view, &self.nodes[..]);
        let mut times = Vec::new();
        let mut drawn = None;
        for repetition in 0..=repeat {
            let start = Instant::now();
            let plan = match levels {
                Some(_) => subject.plan(view, nodes, lod_budget, levels)?,
                None => Plan::default(),
            };
            drawn = Some(subject.draw_nodes(view, nodes, &plan)?.sums(self.depiction.mode)?);
            // The first run pays for tables and pages of memory.
            if repetition > 0 {
                times.push(start.elapsed());
            }
        }
        let (picture, counts) = drawn.unwrap_or_default();
        Ok((picture, counts, Times::of(times)))
    }

    fn measure(&self, arguments: &Arguments, outcomes: &mut Vec<Outcome>) -> Result<(), Failure> {
        let (all, counts, seconds_of) = self.draw(&LodBudget::NONE, None, arguments.repeat)?;
        let levels = self.transfer.levels(&all);
        let colors: Image = composite_at(&all, &self.transfer, &levels);
        let presence = SERIES.map(|n| ("presence", n, LodBudget { presence: n, ..LodBudget::NONE }));
        let thinning = BUDGETS.map(|budget| ("thinning", budget, LodBudget { thinning: budget, ..LodBudget::NONE }));
        for (by, setting, lod_budget) in presence.into_iter().chain(thinning) {
            let (picture, left, seconds) = self.draw(&lod_budget, Some(levels), arguments.repeat)?;
            let (error_mean, error_max) = color_error(&composite_at(&picture, &self.transfer, &levels), &colors);
            let outcome = Outcome {
                mode: self.depiction.mode.name,
                view: self.name,
                by,
                setting,
                particles: self
                    .nodes
                    .iter()
                    .map(|node| u64::from(node.page.nodes[node.node.node as usize].particles))
                    .sum(),
                drawn: left.drawn,
                drawn_of: counts.drawn,
                error_mean,
                error_max,
                light: picture.sum() / all.sum() - 1.0,
                seconds,
                seconds_of,
            };
            eprintln!(
                "{:16} {:7} {:8} {:>9} {:>10} {:>10} {:>8.3} {:>8.1} {:>8.4} {:>8.4}",
                outcome.mode,
                outcome.view,
                outcome.by,
                outcome.setting,
                outcome.drawn,
                outcome.drawn_of,
                outcome.error_mean,
                outcome.error_max,
                outcome.seconds.median,
                outcome.seconds_of.median
            );
            outcomes.push(outcome);
        }
        Ok(())
    }
}

/// The setting with the largest speed-up of all views of a mode together whose mean error is within the limit.
fn best(outcomes: &[Outcome], mode: &'static str, by: &'static str, limit: f64) -> Best {
    let own: Vec<&Outcome> = outcomes.iter().filter(|outcome| outcome.mode == mode && outcome.by == by).collect();
    let mut best = Best { mode, by, setting: None, speed_up: 1.0, error_mean: 0.0 };
    for setting in own.iter().map(|outcome| outcome.setting) {
        let same: Vec<_> = own.iter().filter(|outcome| outcome.setting == setting).collect();
        let error_mean = same.iter().map(|outcome| outcome.error_mean).sum::<f64>() / same.len() as f64;
        let sum = |time: fn(&Outcome) -> f64| same.iter().map(|outcome| time(outcome)).sum::<f64>();
        let speed_up = sum(|outcome| outcome.seconds_of.median) / sum(|outcome| outcome.seconds.median);
        if error_mean <= limit && speed_up > best.speed_up {
            best = Best { setting: Some(setting), speed_up, error_mean, ..best };
        }
    }
    best
}

/// Writes the pictures' numbers, a line each.
fn write_csv(path: &Path, outcomes: &[Outcome]) -> Result<(), Failure> {
    let named = |error: csv::Error| format!("{}: {error}", path.display());
    let mut writer = csv::Writer::from_path(path).map_err(named)?;
    let header = "mode,view,by,setting,particles,drawn,drawn_of,error_mean,error_max,light,seconds,seconds_of";
    writer.write_record(header.split(',')).map_err(named)?;
    for o in outcomes {
        let names = [o.mode.to_owned(), o.view.to_owned(), o.by.to_owned(), o.setting.to_string()];
        let counts = [o.particles, o.drawn, o.drawn_of].map(|count| count.to_string());
        let numbers =
            [o.error_mean, o.error_max, o.light, o.seconds.median, o.seconds_of.median].map(|x| x.to_string());
        let line = names.iter().chain(&counts).chain(&numbers);
        writer.write_record(line).map_err(named)?;
    }
    writer.flush().map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fastest_within_the_limit_is_best() {
        let time = |seconds: f64| Times { median: seconds, fastest: seconds };
        let outcome = |setting, error_mean, seconds| Outcome {
            mode: "points",
            view: "whole",
            by: "presence",
            setting,
            particles: 9,
            drawn: 5,
            drawn_of: 7,
            error_mean,
            error_max: 9.0,
            light: 0.0,
            seconds: time(seconds),
            seconds_of: time(1.0),
        };
        let outcomes = [outcome(1.0, 2.0, 0.1), outcome(10.0, 0.4, 0.5), outcome(100.0, 0.1, 0.8)];
        let found = best(&outcomes, "points", "presence", 0.5);
        assert_eq!((found.setting, found.speed_up), (Some(10.0), 2.0));
        assert_eq!(best(&outcomes, "points", "presence", 0.01).setting, None);
        assert_eq!(best(&outcomes, "points", "thinning", 1.0).setting, None);
    }
}
