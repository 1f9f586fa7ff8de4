//! What a comparison comes to: outcomes, which hierarchies are best, and both as tables.

use super::curves;
use super::pictures::{Camera, ColorError};
use super::ways::Way;
use crate::bench::splat::Failure;
use crate::bench::{Arguments, Times};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

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

/// Times in seconds as milliseconds.
pub(super) fn milliseconds(times: Times) -> Times {
    Times { median: 1e3 * times.median, fastest: 1e3 * times.fastest }
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

/// Writes all outcomes as a table to the file that is asked for.
pub(super) fn write_csv(arguments: &Arguments, reports: &[Report]) -> Result<(), Failure> {
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

/// A row of the table.
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
    pub(super) fn of_tests(hierarchy: Way, budget: u64, splats: u64, error_l2: f64) -> Outcome {
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
}
