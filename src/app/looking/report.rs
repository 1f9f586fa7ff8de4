//! What looking closer has found, for scripts.

use super::answer::Answer;
use super::keeping::Plot;
use super::state::LookingState;
use serde::Serialize;

/// The tool in hand and the answers that are here; lengths in world units.
#[derive(Serialize)]
pub struct Report {
    tool: &'static str,
    inspected: Option<Inspected>,
    distance: Option<f64>,
    probe: Option<Probed>,
    table: Option<Table>,
    plot: Option<Plotted>,
    /// Keys, and where one looks from.
    bookmarks: Vec<(u8, [f64; 3])>,
}

#[derive(Serialize)]
struct Inspected {
    position: [f64; 3],
    rounding: f64,
    family: &'static str,
    merged: bool,
    values: std::collections::BTreeMap<String, f64>,
}

#[derive(Serialize)]
struct Probed {
    count: u64,
    mass: f64,
    exact: bool,
    sphere: Option<([f64; 3], f64)>,
}

#[derive(Serialize)]
struct Table {
    path: std::path::PathBuf,
    rows: u64,
    exact: bool,
}

#[derive(Serialize)]
struct Plotted {
    particles: u64,
    points: usize,
}

impl Report {
    /// What is known now.
    pub fn of(state: &LookingState<'_>) -> Report {
        let sphere = match &state.prober.members {
            Some(crate::explore::Members::Region(region)) => region.first_sphere(),
            _ => None,
        };
        Report {
            tool: state.tool.title(),
            inspected: state.inspector.0.here().map(|report| Inspected {
                position: report.position.to_array(),
                rounding: report.rounding,
                family: report.family.as_str(),
                merged: report.merged.is_some(),
                values: report.values.iter().map(|value| (value.name.clone(), value.value)).collect(),
            }),
            distance: match state.measure.0[..] {
                [from, to] => Some(from.distance(to)),
                _ => None,
            },
            probe: state.prober.sums.here().map(|probe| Probed {
                count: probe.count,
                mass: probe.mass,
                exact: probe.exact,
                sphere: sphere.map(|(center, radius)| (center.to_array(), radius)),
            }),
            table: match &state.keeping.export {
                Answer::Here((path, written)) => {
                    Some(Table { path: path.clone(), rows: written.rows, exact: written.exact })
                }
                _ => None,
            },
            plot: state.keeping.plot.here().map(|plot| match plot {
                Plot::Histogram(histogram) => Plotted { particles: histogram.counts.iter().sum(), points: 0 },
                Plot::Scatter(scatter) => Plotted { particles: scatter.of, points: scatter.x.len() },
            }),
            bookmarks: state.bookmarks.0.iter().map(|bookmark| (bookmark.key, bookmark.camera.eye)).collect(),
        }
    }
}
