//! The tables of `bench published`, beside those of the paper.

use super::paper::{PaperLevel, PaperViewport};
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

/// Milliseconds of several repetitions.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Took {
    /// The middle one.
    pub median: f64,
    /// The fastest.
    pub fastest: f64,
    /// Processor time of all threads, the middle one, where the system tells it.
    pub processor: Option<f64>,
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
    pub ms: [Took; 2],
    /// The first two of it, with `delta_n` 2.
    pub choose_ms: f64,
    /// Relative L2 error of the sums against those of all particles.
    pub error_l2: f64,
}

/// An adaptive picture.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Adaptive {
    /// Choosing, decoding and drawing.
    pub ms: Took,
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
    pub exact: Took,
    /// In fine buckets.
    pub buckets: Took,
    /// In coarse ones.
    pub coarse_buckets: Took,
    /// Adaptive, in coarse buckets.
    pub adaptive: [Took; 2],
}

/// Our clusters: choosing, decoding and drawing.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Ours {
    /// Splats that were drawn.
    pub splats: u64,
    /// Choosing, decoding and drawing, once.
    pub ms: f64,
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

impl Took {
    /// The median, in brackets the processor time of all threads, and behind a slash the paper's.
    fn beside(&self, paper: Option<f64>) -> String {
        let digits = |value: f64| if value < 9.95 { format!("{value:.1}") } else { format!("{value:.0}") };
        let processor = self.processor.map_or(String::new(), |processor| format!(" [{}]", digits(processor)));
        let paper = paper.map_or(String::new(), |paper| format!(" / {}", digits(paper)));
        format!("{}{processor}{paper}", digits(self.median))
    }
}

impl LevelRow {
    /// Prints it to standard error.
    pub fn print(&self) {
        let LevelRow { level, points, pixels, whole, adaptive, sorted, ours, ours_adaptive, paper } = self;
        let of = |number: fn(&PaperLevel) -> f64| paper.as_ref().map(number);
        let pixels_paper = of(|paper| paper.pixels).map_or(String::new(), |pixels| format!(" / {pixels}"));
        eprintln!("level {level}: {points} points of {pixels:.2}{pixels_paper} pixels");
        eprintln!(
            "  added up  all: d=1 {}, d=2 {}; adaptive: d=1 {}, d=2 {}",
            whole.ms[0].beside(None),
            whole.ms[1].beside(of(|paper| paper.software)),
            adaptive[0].ms.beside(of(|paper| paper.adaptive[0])),
            adaptive[1].ms.beside(of(|paper| paper.adaptive[1]))
        );
        eprintln!(
            "  sorted    all: exact {}, buckets {}, coarse {}; adaptive: d=1 {}, d=2 {}",
            sorted.exact.beside(of(|paper| paper.sorted_exact)),
            sorted.buckets.beside(of(|paper| paper.sorted_buckets[0])),
            sorted.coarse_buckets.beside(of(|paper| paper.sorted_buckets[1])),
            sorted.adaptive[0].beside(of(|paper| paper.sorted_adaptive[0])),
            sorted.adaptive[1].beside(of(|paper| paper.sorted_adaptive[1]))
        );
        let [by_one, by_two] = adaptive;
        eprintln!(
            "  L2        all {:.4}, our clusters {:.4}; adaptive: d=1 {:.4} with {} points, our clusters {:.4}, d=2 {:.4} with {} points",
            whole.error_l2,
            ours.error_l2,
            by_one.error_l2,
            by_one.points,
            ours_adaptive.error_l2,
            by_two.error_l2,
            by_two.points
        );
    }
}

impl ViewportRow {
    /// Prints it to standard error.
    pub fn print(&self) {
        let ViewportRow { edge, adaptive, by_level, ours, paper } = self;
        let points = paper.map_or(String::new(), |paper| format!(" / {}", paper.points));
        let by_level: Vec<String> = by_level.iter().map(u64::to_string).collect();
        eprintln!(
            "{edge} x {edge}: adaptive d=1 {} with {}{points} points ({} by level), L2 {:.4}, our clusters {:.4}",
            adaptive.ms.beside(paper.map(|paper| paper.ms)),
            adaptive.points,
            by_level.join(" "),
            adaptive.error_l2,
            ours.error_l2
        );
    }
}

impl Report {
    /// Prints to standard error what was built, and how numbers are told.
    pub fn print_head(&self) {
        let [one, two] = self.bytes_per_particle;
        eprintln!(
            "{}: {} particles, structures in {:.1} s, {one:.1} and {two:.1} / {:.1} bytes a particle; our file in {:.1} s, {:.1} bytes",
            self.source,
            self.particles,
            self.build_s,
            self.bytes_per_particle_paper,
            self.ours_build_s,
            self.ours_bytes_per_particle
        );
        eprintln!("milliseconds [processor time of {} threads] / the paper's", self.threads);
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
            ("our_clusters_ms", self.ours.ms, None),
            ("our_clusters_l2", self.ours.error_l2, None),
            ("our_clusters_adaptive_ms", self.ours_adaptive.ms, None),
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
            ("our_clusters_ms", self.ours.ms, None),
            ("our_clusters_l2", self.ours.error_l2, None),
        ];
        lines.into_iter().map(|line| (self.edge.to_string(), line)).collect()
    }
}
