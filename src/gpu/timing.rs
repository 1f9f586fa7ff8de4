//! GPU times of the passes, as Bevy's render diagnostics report them.

use bevy::diagnostic::DiagnosticsStore;
use bevy::prelude::{Resource, World};
use std::collections::BTreeMap;

/// Milliseconds of each pass, by its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PassTimes {
    measured: BTreeMap<String, Vec<f64>>,
    last: BTreeMap<String, std::time::Instant>,
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
    /// Takes over what has been measured since the last call.
    pub fn collect(&mut self, world: &World) {
        let Some(store) = world.get_resource::<DiagnosticsStore>() else { return };
        let Some(passes) = world.get_resource::<TimedPasses>() else { return };
        for &pass in &passes.0 {
            let path = format!("render/{pass}/elapsed_gpu");
            let Some(diagnostic) = store.iter().find(|diagnostic| diagnostic.path().as_str() == path) else { continue };
            let Some(measurement) = diagnostic.measurement() else { continue };
            if self.last.insert(pass.to_owned(), measurement.time) != Some(measurement.time) {
                self.measured.entry(pass.to_owned()).or_default().push(measurement.value);
            }
        }
    }

    /// Median milliseconds of each pass that was measured.
    pub fn medians(&self) -> impl Iterator<Item = (&str, f64)> {
        self.measured.iter().map(|(pass, times)| (pass.as_str(), median(&mut times.clone())))
    }
}

/// The median; 0 of nothing.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
    }
}
