//! What looking closer has found, for scripts.

use super::heights::OnHeights;
use super::state::LookingState;
use crate::explore::{Identified, Plot, SelectionSet};
use crate::window::state::answer::Answer;
use serde::Serialize;

/// The tool in hand and the answers that are here; lengths in world units.
#[derive(Serialize)]
pub struct Report<'a> {
    tool: &'static str,
    inspected: Option<Inspected<'a>>,
    distance: Option<f64>,
    heights: Option<OnHeightsReport>,
    probe: Option<Probed>,
    table: Option<Table>,
    plot: Option<Plotted>,
    /// Keys, and where one looks from.
    bookmarks: Vec<(u8, [f64; 3])>,
    /// Of each selection: how many of its ids are in the open file, or why nobody knows; `None` for regions.
    found: Vec<Option<Found<'a>>>,
    /// The centre of the selection that the camera follows.
    following: Option<[f64; 3]>,
    /// How many objects the open catalogue has.
    objects: Option<usize>,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Found<'a> {
    Coming,
    Count(u64),
    Failed(&'a str),
}

#[derive(Serialize)]
struct Inspected<'a> {
    position: [f64; 3],
    rounding: f64,
    family: &'static str,
    merged: bool,
    values: std::collections::BTreeMap<String, f64>,
    /// Its row in the source, where that has been asked.
    row: Option<&'a Identified>,
    row_failed: Option<&'a str>,
}

/// What is known of heights.
#[derive(Serialize)]
struct OnHeightsReport {
    /// Row, column, x and y, height and slope of what was clicked.
    found: Option<([f64; 4], Option<f64>, Option<f64>)>,
    /// Row, column and height of the nearest sample where nothing was measured.
    nearest: Option<(u64, u64, f64)>,
    /// Which of the datasets that is of.
    field: Option<usize>,
    /// Distance in space and in plan, difference of heights, angle.
    apart: Option<[f64; 4]>,
    /// Points of the profile, its length and how much of it was measured.
    profile: Option<(usize, [f64; 2])>,
    /// Samples of the region, those that were measured, Sa and Sq.
    region: Option<(u64, u64, Option<f64>, Option<f64>)>,
}

impl OnHeightsReport {
    fn of(heights: &OnHeights) -> Option<OnHeightsReport> {
        let report = OnHeightsReport {
            found: heights.found.here().map(|found| {
                let probe = &found.probe;
                ([probe.row, probe.column, probe.x, probe.y], probe.height, probe.slope)
            }),
            nearest: heights
                .found
                .here()
                .and_then(|found| found.probe.nearest)
                .map(|near| (near.row, near.column, near.height)),
            field: heights.found.here().map(|found| found.field),
            apart: heights.apart().and_then(|apart| Some([apart.space, apart.plan?, apart.rise?, apart.angle?])),
            profile: heights.profile.here().map(|line| (line.points.len(), line.lengths)),
            region: heights.numbers.here().map(|numbers| {
                let found = &numbers.roughness;
                (found.samples, found.valid, found.iso.sa, found.iso.sq)
            }),
        };
        let is_known =
            report.found.is_some() || report.apart.is_some() || report.profile.is_some() || report.region.is_some();
        is_known.then_some(report)
    }
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
    /// Which plot it is, counted since the start.
    revision: u64,
    /// How many particles are brushed.
    brushed: Option<u64>,
}

impl<'a> Report<'a> {
    /// What is known now.
    pub fn of(state: &'a LookingState<'_>, selections: &[SelectionSet]) -> Report<'a> {
        let sphere = match &state.prober.members {
            Some(crate::explore::Members::Region(region)) => region.first_sphere(),
            _ => None,
        };
        Report {
            tool: state.tool.title(),
            inspected: state.inspector.report.here().map(|report| Inspected {
                position: report.position.to_array(),
                rounding: report.rounding,
                family: report.family.as_str(),
                merged: report.merged.is_some(),
                values: report.values.iter().map(|value| (value.name.clone(), value.value)).collect(),
                row: state.inspector.row.here().and_then(Option::as_ref),
                row_failed: match &state.inspector.row {
                    Answer::Failed(why) => Some(why),
                    _ => None,
                },
            }),
            distance: match state.measure.0[..] {
                [from, to] => Some(from.distance(to)),
                _ => None,
            },
            heights: OnHeightsReport::of(&state.heights),
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
            plot: state.plotting.found.as_ref().map(|found| Plotted {
                particles: found.plot.particles(),
                points: match &*found.plot {
                    Plot::Scatter { x, .. } => x.len(),
                    Plot::Binned(_) | Plot::Radial(_) => 0,
                },
                revision: state.plotting.revision,
                brushed: state.plotting.brushed.here().map(|brushed| brushed.count),
            }),
            found: selections.iter().map(|set| found(state, set)).collect(),
            following: state.following.center().map(|center| center.to_array()),
            objects: state.objects.catalogue.here().map(|catalogue| catalogue.objects.len()),
            bookmarks: state.bookmarks.0.iter().map(|bookmark| (bookmark.key, bookmark.camera.eye)).collect(),
        }
    }
}

fn found<'a>(state: &'a LookingState<'_>, set: &SelectionSet) -> Option<Found<'a>> {
    if let Some(who) = state.followed.of(&set.members) {
        return Some(match who {
            Answer::Here(who) => Found::Count(who.as_ref().map_or(0, |who| who.ids().len())),
            Answer::Failed(why) => Found::Failed(why),
            Answer::Coming(_) | Answer::Nothing => Found::Coming,
        });
    }
    Some(match state.looked_up.of(set.members.ids()?) {
        Some(Answer::Here(found)) => Found::Count(found.count),
        Some(Answer::Failed(why)) => Found::Failed(why),
        Some(Answer::Coming(_) | Answer::Nothing) | None => Found::Coming,
    })
}
