//! Wall-clock times of the passes that a picture takes, over several repetitions.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Times by pass.
#[derive(Clone, Default)]
pub(crate) struct Times {
    samples: BTreeMap<String, Vec<f64>>,
}

impl Times {
    /// Runs and times one pass.
    pub(crate) fn measure<T>(&mut self, pass: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.samples.entry(pass.to_owned()).or_default().push(1e3 * start.elapsed().as_secs_f64());
        result
    }

    /// Takes in a time that was measured elsewhere.
    pub(crate) fn note(&mut self, pass: &str, time: Duration) {
        self.samples.entry(pass.to_owned()).or_default().push(1e3 * time.as_secs_f64());
    }

    /// Takes in times of passes that were measured elsewhere, milliseconds.
    pub(crate) fn extend(&mut self, milliseconds: impl IntoIterator<Item = (String, f64)>) {
        milliseconds.into_iter().for_each(|(pass, time)| self.samples.entry(pass).or_default().push(time));
    }

    /// Runs and times a frame that consists of passes.
    pub(crate) fn frame<T>(&mut self, work: impl FnOnce(&mut Times) -> T) -> T {
        let start = Instant::now();
        let result = work(self);
        self.samples.entry("frame".to_owned()).or_default().push(1e3 * start.elapsed().as_secs_f64());
        result
    }

    /// The median of each pass, milliseconds.
    pub(crate) fn medians(self) -> BTreeMap<String, f64> {
        let median = |mut samples: Vec<f64>| {
            samples.sort_by(f64::total_cmp);
            samples[samples.len() / 2]
        };
        self.samples.into_iter().map(|(pass, samples)| (pass, median(samples))).collect()
    }
}
