//! The tables of `bench published`, beside those of the paper.

use super::paper::{PaperLevel, PaperViewport};
use crate::bench::Times;
use crate::bench::splat::Failure;
use serde::Serialize;
use std::path::Path;

/// What was found. Times in milliseconds unless they say so; pairs for `delta_n` 1 and 2.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What was drawn.
    pub source: String,
    /// Its particles.
    pub particles: u64,
    /// Points of a level in a cluster of the next coarser one, on average.
    pub cluster_size: f64,
    /// Mean projected diameter that particles were given, pixels; 0: their own.
    pub point_size: f64,
    /// Pixels that adaptive pictures go by.
    pub threshold: f64,
    /// How equation 2 was read.
    pub diameters: String,
    /// Threads.
    pub threads: usize,
    /// Seconds from particles in memory to both structures.
    pub build_s: f64,
    /// Bytes of each structure for a particle.
    pub bytes_per_particle: [f64; 2],
    /// What the paper has.
    pub bytes_per_particle_paper: f64,
    /// Seconds from particles in memory to a page file with octree and clusters.
    pub ours_build_s: f64,
    /// Bytes of that file for a particle.
    pub ours_bytes_per_particle: f64,
    /// The finest first.
    pub levels: Vec<LevelRow>,
    /// By size of the picture.
    pub viewports: Vec<ViewportRow>,
}

/// A level as the finest that is drawn.
#[derive(Clone, Debug, Serialize)]
pub struct LevelRow {
    /// Its number; 1 is the coarsest.
    pub level: usize,
    /// Its points.
    pub points: u64,
    /// Their mean projected diameter, pixels.
    pub pixels: f64,
    /// All points, added up.
    pub whole: Whole,
    /// Added up within the threshold.
    pub adaptive: [Adaptive; 2],
    /// Sorted and blended.
    pub sorted: Sorted,
    /// As many of our clusters as the level has points.
    pub ours: Ours,
    /// As many of our clusters as the first of the adaptive pictures has points.
    pub ours_adaptive: Ours,
    /// The paper's level that is as far above the particles.
    pub paper: Option<PaperLevel>,
}

/// All points of a level.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Whole {
    /// Choosing, decoding and drawing.
    pub ms: [Times; 2],
    /// The first two of it, with `delta_n` 2.
    pub choose_ms: f64,
    /// Relative L2 error of the sums against those of all particles.
    pub error_l2: f64,
}

/// What one picture took.
#[derive(Clone, Copy, Debug)]
pub struct Chosen {
    /// Choosing, decoding and drawing.
    pub ms: Times,
    /// The first two of it.
    pub choose_ms: f64,
    /// Points.
    pub points: u64,
}

/// An adaptive picture.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Adaptive {
    /// Choosing, decoding and drawing.
    pub ms: Times,
    /// The first two of it.
    pub choose_ms: f64,
    /// Points.
    pub points: u64,
    /// As [`Whole::error_l2`].
    pub error_l2: f64,
}

/// Points that lie over each other: choosing, decoding, sorting and blending.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Sorted {
    /// All points by distance, with `delta_n` 2.
    pub exact: Times,
    /// In fine buckets.
    pub buckets: Times,
    /// In coarse ones.
    pub coarse_buckets: Times,
    /// Adaptive, in coarse buckets.
    pub adaptive: [Times; 2],
}

/// Our clusters: choosing, decoding and drawing.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Ours {
    /// Splats that were drawn.
    pub splats: u64,
    /// Choosing, decoding and drawing.
    pub ms: Times,
    /// As [`Whole::error_l2`].
    pub error_l2: f64,
}

/// An adaptive picture of another size, with `delta_n` 1.
#[derive(Clone, Debug, Serialize)]
pub struct ViewportRow {
    /// Pixels along an edge.
    pub edge: u32,
    /// The picture.
    pub adaptive: Adaptive,
    /// Its points of each level, the coarsest first.
    pub by_level: Vec<u64>,
    /// As many of our clusters.
    pub ours: Ours,
    /// The paper's.
    pub paper: Option<PaperViewport>,
}

/// A number of ours and one of the paper's.
fn beside(own: f64, paper: Option<f64>) -> String {
    let digits = |value: f64| if value < 9.95 { format!("{value:.1}") } else { format!("{value:.0}") };
    format!("{} / {}", digits(own), paper.map_or("-".into(), digits))
}

impl Report {
    /// Prints tables to standard error, with the paper's numbers behind a slash.
    pub fn print(&self) {
        let [one, two] = self.bytes_per_particle;
        eprintln!(
            "{}: {} particles; structures built in {:.1} s, {one:.1} and {two:.1} / {:.1} bytes a particle; our file in {:.1} s, {:.1} bytes",
            self.source,
            self.particles,
            self.build_s,
            self.bytes_per_particle_paper,
            self.ours_build_s,
            self.ours_bytes_per_particle
        );
        eprintln!("\nAdded up, ms (ours / paper)");
        let head = ["points", "mean px", "all d=1", "all d=2", "adaptive d=1", "adaptive d=2"];
        print_row("level", &head.map(str::to_owned));
        for row in &self.levels {
            let paper = row.paper;
            let cells = [
                row.points.to_string(),
                format!("{:.2} / {}", row.pixels, paper.map_or("-".into(), |paper| paper.pixels.to_string())),
                format!("{:.0}", row.whole.ms[0].median),
                beside(row.whole.ms[1].median, paper.map(|paper| paper.software)),
                beside(row.adaptive[0].ms.median, paper.map(|paper| paper.adaptive[0])),
                beside(row.adaptive[1].ms.median, paper.map(|paper| paper.adaptive[1])),
            ];
            print_row(&row.level.to_string(), &cells);
        }
        eprintln!("\nSorted, ms (ours / paper)");
        let head = ["exact", "buckets", "coarse", "adaptive d=1", "adaptive d=2"];
        print_row("level", &head.map(str::to_owned));
        for row in &self.levels {
            let (sorted, paper) = (&row.sorted, row.paper);
            let cells = [
                beside(sorted.exact.median, paper.map(|paper| paper.sorted_exact)),
                beside(sorted.buckets.median, paper.map(|paper| paper.sorted_buckets[0])),
                beside(sorted.coarse_buckets.median, paper.map(|paper| paper.sorted_buckets[1])),
                beside(sorted.adaptive[0].median, paper.map(|paper| paper.sorted_adaptive[0])),
                beside(sorted.adaptive[1].median, paper.map(|paper| paper.sorted_adaptive[1])),
            ];
            print_row(&row.level.to_string(), &cells);
        }
        eprintln!("\nAgainst as many of our clusters: relative L2 error and ms (published, ours)");
        let head = ["all points", "L2", "ms", "adaptive d=1", "L2", "ms"];
        print_row("level", &head.map(str::to_owned));
        for row in &self.levels {
            let near = &row.adaptive[0];
            let cells = [
                row.points.to_string(),
                format!("{:.4}, {:.4}", row.whole.error_l2, row.ours.error_l2),
                format!("{:.0}, {:.0}", row.whole.ms[1].median, row.ours.ms.median),
                near.points.to_string(),
                format!("{:.4}, {:.4}", near.error_l2, row.ours_adaptive.error_l2),
                format!("{:.0}, {:.0}", near.ms.median, row.ours_adaptive.ms.median),
            ];
            print_row(&row.level.to_string(), &cells);
        }
        eprintln!("\nBy size of the picture, adaptive d=1 (ours / paper; published, our clusters)");
        print_row("pixels", &["points", "ms", "L2", "ms of ours", "by level"].map(str::to_owned));
        for row in &self.viewports {
            let (near, ours) = (&row.adaptive, &row.ours);
            let cells = [
                format!("{} / {}", near.points, row.paper.map_or("-".into(), |paper| paper.points.to_string())),
                beside(near.ms.median, row.paper.map(|paper| paper.ms)),
                format!("{:.4}, {:.4}", near.error_l2, ours.error_l2),
                format!("{:.0}", ours.ms.median),
                row.by_level.iter().map(u64::to_string).collect::<Vec<_>>().join(" "),
            ];
            print_row(&row.edge.to_string(), &cells);
        }
    }

    /// Writes both tables, a line for each number: picture, level or size, what it is, ours, the paper's.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), Failure> {
        let failed = |error: csv::Error| format!("{}: {error}", path.display());
        let mut writer = csv::Writer::from_path(path).map_err(failed)?;
        writer.write_record(["table", "row", "quantity", "ours", "paper"]).map_err(failed)?;
        let lines = self.levels.iter().flat_map(LevelRow::lines).map(|(row, line)| ("level", row, line));
        let lines =
            lines.chain(self.viewports.iter().flat_map(ViewportRow::lines).map(|(row, line)| ("viewport", row, line)));
        for (table, row, (quantity, ours, paper)) in lines {
            let paper = paper.map_or(String::new(), |paper| paper.to_string());
            writer.write_record([table, &row, quantity, &ours.to_string(), &paper]).map_err(failed)?;
        }
        writer.flush().map_err(|error| format!("{}: {error}", path.display()).into())
    }
}

/// A quantity, ours, and the paper's.
type Line = (&'static str, f64, Option<f64>);

impl LevelRow {
    fn lines(&self) -> Vec<(String, Line)> {
        let of = |number: fn(&PaperLevel) -> f64| self.paper.as_ref().map(number);
        let (sorted, [near, near_by_two]) = (&self.sorted, &self.adaptive);
        let lines: [Line; 21] = [
            ("points", self.points as f64, of(|paper| paper.points as f64)),
            ("mean_px", self.pixels, of(|paper| paper.pixels)),
            ("all_d1_ms", self.whole.ms[0].median, None),
            ("all_d2_ms", self.whole.ms[1].median, of(|paper| paper.software)),
            ("all_l2", self.whole.error_l2, None),
            ("adaptive_d1_points", near.points as f64, None),
            ("adaptive_d1_ms", near.ms.median, of(|paper| paper.adaptive[0])),
            ("adaptive_d1_l2", near.error_l2, None),
            ("adaptive_d2_points", near_by_two.points as f64, None),
            ("adaptive_d2_ms", near_by_two.ms.median, of(|paper| paper.adaptive[1])),
            ("adaptive_d2_l2", near_by_two.error_l2, None),
            ("sorted_exact_ms", sorted.exact.median, of(|paper| paper.sorted_exact)),
            ("sorted_buckets_ms", sorted.buckets.median, of(|paper| paper.sorted_buckets[0])),
            ("sorted_coarse_buckets_ms", sorted.coarse_buckets.median, of(|paper| paper.sorted_buckets[1])),
            ("sorted_adaptive_d1_ms", sorted.adaptive[0].median, of(|paper| paper.sorted_adaptive[0])),
            ("sorted_adaptive_d2_ms", sorted.adaptive[1].median, of(|paper| paper.sorted_adaptive[1])),
            ("our_clusters", self.ours.splats as f64, None),
            ("our_clusters_ms", self.ours.ms.median, None),
            ("our_clusters_l2", self.ours.error_l2, None),
            ("our_clusters_adaptive_ms", self.ours_adaptive.ms.median, None),
            ("our_clusters_adaptive_l2", self.ours_adaptive.error_l2, None),
        ];
        lines.into_iter().map(|line| (self.level.to_string(), line)).collect()
    }
}

impl ViewportRow {
    fn lines(&self) -> Vec<(String, Line)> {
        let lines: [Line; 5] = [
            ("adaptive_d1_points", self.adaptive.points as f64, self.paper.map(|paper| paper.points as f64)),
            ("adaptive_d1_ms", self.adaptive.ms.median, self.paper.map(|paper| paper.ms)),
            ("adaptive_d1_l2", self.adaptive.error_l2, None),
            ("our_clusters_ms", self.ours.ms.median, None),
            ("our_clusters_l2", self.ours.error_l2, None),
        ];
        lines.into_iter().map(|line| (self.edge.to_string(), line)).collect()
    }
}

fn print_row(first: &str, cells: &[String]) {
    let cells: Vec<String> = cells.iter().map(|cell| format!("{cell:>20}")).collect();
    eprintln!("{first:>6} {}", cells.join(" "));
}
