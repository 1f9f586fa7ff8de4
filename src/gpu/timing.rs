//! GPU times of the passes, as Bevy's render diagnostics report them.
//!
//! What Bevy hands over of a frame has one time, whatever the pass, so that several spans of one name in one frame are told from
//! those of several frames; they count as one. (It keeps 120 of a name, and measures 128 in a frame.)

use bevy::diagnostic::{Diagnostic, DiagnosticMeasurement, DiagnosticsStore};
use bevy::prelude::{Resource, World};
use std::collections::BTreeMap;
use std::time::Instant;

/// Frames, each of which is waited for, after which a frame's times are there: in the next one they are read from the adapter, and in
/// the one after that they are handed over.
pub const LATE: u32 = 2;

/// Milliseconds of each pass, by its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTimes {
    measured: BTreeMap<String, Vec<f64>>,
    /// When the last frame's were handed over that has been seen.
    seen: Option<Instant>,
}

/// The passes that are timed, by the names of their spans; plugins add theirs.
#[derive(Resource, Clone, Debug)]
pub struct TimedPasses(pub Vec<&'static str>);

impl Default for TimedPasses {
    fn default() -> TimedPasses {
        TimedPasses(vec!["project", "accumulate", "reconstruct", "list", "composite"])
    }
}

impl PassTimes {
    /// Nothing yet, and nothing of what has been handed over so far. Frames before that are still on their way are not told from
    /// those that follow: [`LATE`] frames without passes wait for them.
    pub fn from_now(world: &World) -> PassTimes {
        let mut times = PassTimes::default();
        times.collect(world);
        times.measured.clear();
        times
    }

    /// Takes over what has been measured since the last call.
    pub fn collect(&mut self, world: &World) {
        let Some(store) = world.get_resource::<DiagnosticsStore>() else { return };
        let Some(passes) = world.get_resource::<TimedPasses>() else { return };
        let before = self.seen;
        for &pass in &passes.0 {
            let Some(diagnostic) = diagnostic(store, pass, "elapsed_gpu") else { continue };
            for (time, milliseconds) in frames(diagnostic).filter(|(time, _)| Some(*time) > before) {
                self.measured.entry(pass.to_owned()).or_default().push(milliseconds);
                self.seen = self.seen.max(Some(time));
            }
        }
    }

    /// Median milliseconds of each pass that was measured.
    pub fn medians(&self) -> impl Iterator<Item = (&str, f64)> {
        self.measured.iter().map(|(pass, times)| (pass.as_str(), median(&mut times.clone())))
    }
}

/// A measured pass; `kind` says whose time it is.
fn diagnostic<'a>(store: &'a DiagnosticsStore, pass: &str, kind: &str) -> Option<&'a Diagnostic> {
    let path = format!("render/{pass}/{kind}");
    store.iter().find(|diagnostic| diagnostic.path().as_str() == path)
}

/// The frames of a pass, oldest first: when each was handed over, and the milliseconds of all its spans.
fn frames(diagnostic: &Diagnostic) -> impl Iterator<Item = (Instant, f64)> {
    let mut spans = diagnostic.measurements().peekable();
    std::iter::from_fn(move || {
        let &DiagnosticMeasurement { time, value } = spans.next()?;
        let rest = std::iter::from_fn(|| spans.next_if(|span| span.time == time));
        Some((time, value + rest.map(|span| span.value).sum::<f64>()))
    })
}

/// When the last frame of a pass was handed over, and its milliseconds: the adapter's, or what it took to write its commands where the
/// adapter does not tell.
pub fn last_frame(store: &DiagnosticsStore, pass: &str) -> Option<(Instant, f64)> {
    let last = |kind| diagnostic(store, pass, kind).and_then(|diagnostic| frames(diagnostic).last());
    last("elapsed_gpu").or_else(|| last("elapsed_cpu"))
}

/// The median; 0 of nothing.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::diagnostic::DiagnosticPath;
    use std::time::Duration;

    /// A world where spans of one pass are handed over.
    struct Handed(World, Instant);

    impl Handed {
        /// Hands the spans of one frame over.
        fn frame(&mut self, spans: &[f64]) {
            self.1 += Duration::from_millis(16);
            let path = DiagnosticPath::from_components(["render", "list", "elapsed_gpu"]);
            let mut store = self.0.resource_mut::<DiagnosticsStore>();
            if store.get(&path).is_none() {
                store.add(Diagnostic::new(path.clone()));
            }
            let diagnostic = store.get_mut(&path).unwrap();
            for &value in spans {
                diagnostic.add_measurement(DiagnosticMeasurement { time: self.1, value });
            }
        }
    }

    #[test]
    fn spans_of_a_frame_count_as_one_and_earlier_frames_not_at_all() {
        let mut world = World::new();
        world.init_resource::<DiagnosticsStore>();
        world.init_resource::<TimedPasses>();
        let mut handed = Handed(world, Instant::now());
        handed.frame(&[100.0, 200.0]);
        let mut times = PassTimes::from_now(&handed.0);
        times.collect(&handed.0);
        assert_eq!(times.medians().count(), 0, "of a frame before");
        handed.frame(&[1.0, 2.0]);
        times.collect(&handed.0);
        times.collect(&handed.0);
        // Two frames between two calls.
        handed.frame(&[5.0, 0.5, 0.5]);
        handed.frame(&[4.0]);
        times.collect(&handed.0);
        assert_eq!(times.measured["list"], [3.0, 6.0, 4.0]);
        assert_eq!(times.medians().collect::<Vec<_>>(), [("list", 4.0)]);
        assert_eq!(last_frame(handed.0.resource(), "list").map(|(_, time)| time), Some(4.0));
        assert_eq!(last_frame(handed.0.resource(), "project"), None);
    }
}
