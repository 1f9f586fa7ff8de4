//! What a picture's command tells about it: the statistics that all pictures have, and the times of its passes.

use super::CommandResult;
use crate::color::output;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// What the statistics of every picture begin with.
#[derive(Debug, Serialize)]
pub(super) struct Shown<'a> {
    /// Whether everything that the view needs at its error bound was drawn.
    pub converged: bool,
    /// Largest displacement of a drawn particle, pixels.
    pub error_px: f64,
    /// Particles of the selection.
    pub particles_drawn: u64,
    /// Nodes of the selection.
    pub nodes_drawn: usize,
    /// What drew.
    pub backend: &'a str,
    /// Its name and driver.
    pub adapter: &'a str,
    /// Visualization mode.
    pub mode: &'static str,
    /// The attribute that colours the picture.
    pub attribute: Option<&'a str>,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
}

/// Writes statistics of any kind to a file, or to standard output for `-`.
pub(super) fn write_json(path: &Path, statistics: &impl Serialize) -> CommandResult {
    let text = serde_json::to_string_pretty(statistics)? + "\n";
    if path == Path::new("-") {
        print!("{text}");
    } else {
        output::write_atomically(path, text.as_bytes())?;
    }
    Ok(())
}

/// Wall-clock times of passes, over several repetitions.
#[derive(Clone, Default)]
pub(super) struct Times {
    samples: BTreeMap<String, Vec<f64>>,
}

impl Times {
    /// Runs and times one pass.
    pub(super) fn measure<T>(&mut self, pass: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.samples.entry(pass.to_owned()).or_default().push(1e3 * start.elapsed().as_secs_f64());
        result
    }

    /// Takes in a time that was measured elsewhere.
    pub(super) fn note(&mut self, pass: &str, time: Duration) {
        self.samples.entry(pass.to_owned()).or_default().push(1e3 * time.as_secs_f64());
    }

    /// Runs and times a frame that consists of passes.
    pub(super) fn frame<T>(&mut self, work: impl FnOnce(&mut Times) -> T) -> T {
        let start = Instant::now();
        let result = work(self);
        self.samples.entry("frame".to_owned()).or_default().push(1e3 * start.elapsed().as_secs_f64());
        result
    }

    /// The median of each pass, milliseconds.
    pub(super) fn medians(self) -> BTreeMap<String, f64> {
        let median = |mut samples: Vec<f64>| {
            samples.sort_by(f64::total_cmp);
            samples[samples.len() / 2]
        };
        self.samples.into_iter().map(|(pass, samples)| (pass, median(samples))).collect()
    }
}
