//! Plots as charts.

use super::{Plot, density_unit, named};
use crate::annotate::{Chart, ChartAxis, Marks, roomy};
use crate::explore::bins::edges;
use std::path::Path;

/// How the axes of a chart count where what was found leaves that open, and which of its means a profile shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChartScales {
    /// Whether axes of the fields of a scatter plot, and of radii, are logarithmic; as the values ask for where it is `None`.
    pub fields: Option<bool>,
    /// The same of weights, of their colours, and upwards in a profile.
    pub weights: Option<bool>,
    /// Whether each particle counts once in the means of a profile; otherwise its mass.
    pub by_count: bool,
}

impl Plot {
    /// Hands over the chart of what is in the file `path`, with [`Plot::notes`] below it.
    pub fn chart<T>(&self, path: &Path, notes: &[String], scales: ChartScales, write: impl FnOnce(&Chart) -> T) -> T {
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        let title = format!("{file}: {}", self.title());
        let note = notes.join("; ");
        match self {
            Plot::Binned(found) => {
                let weight = named(&format!("{} per bin", found.weight), &found.weight_unit);
                let all: Vec<Vec<f64>> = found.axes.iter().map(edges).collect();
                let titles: Vec<String> = found.axes.iter().map(|axis| named(&axis.field, &axis.unit)).collect();
                let place = |number: usize| ChartAxis {
                    title: &titles[number],
                    range: [found.axes[number].min, found.axes[number].max],
                    logarithmic: found.axes[number].logarithmic,
                };
                let is_phase = found.axes.len() > 1;
                let scale = scales.weights.unwrap_or(is_phase);
                let weights = weight_axis(&weight, &found.weights, scale, is_phase);
                let (up, marks) = if is_phase {
                    let edges = [all[0].as_slice(), all[1].as_slice()];
                    (place(1), Marks::Cells { edges, values: &found.weights, colors: weights })
                } else {
                    (weights, Marks::Bars { edges: &all[0], values: &found.weights })
                };
                write(&Chart { title: &title, note: &note, across: place(0), up, marks })
            }
            Plot::Scatter { fields, x, y, .. } => {
                let titles = fields.each_ref().map(|axis| named(&axis.field, &axis.unit));
                let axis = |number: usize, values: &[f64]| {
                    let ends = |[low, high]: [f64; 2], value: &f64| [low.min(*value), high.max(*value)];
                    let [low, high] = values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends);
                    let logarithmic = scales.fields.unwrap_or(low > 0.0 && high > 10.0 * low);
                    let range = roomy(values.iter().copied(), logarithmic).unwrap_or([1.0, 10.0]);
                    ChartAxis { title: &titles[number], range, logarithmic }
                };
                let marks = Marks::Points { x, y };
                write(&Chart { title: &title, note: &note, across: axis(0, x), up: axis(1, y), marks })
            }
            Plot::Radial(found) => {
                let is_logarithmic = scales.fields != Some(false);
                let across = named("radius", &found.length_unit);
                let mut points = Vec::with_capacity(found.shells.len());
                let mut spreads = Vec::new();
                let errors = found.estimate.as_ref().map(|estimate| &estimate.of_masses.errors);
                for (index, shell) in found.shells.iter().enumerate().filter(|(_, shell)| shell.count > 0) {
                    // The innermost shell has no middle in the logarithm.
                    let middle = match is_logarithmic && shell.from > 0.0 {
                        true => (shell.from * shell.to).sqrt(),
                        false => 0.5 * (shell.from + shell.to),
                    };
                    let (mean, dispersion) = match scales.by_count {
                        true => (shell.mean, shell.dispersion),
                        false => (shell.mass_weighted_mean, shell.mass_weighted_dispersion),
                    };
                    match (&found.field, mean) {
                        (None, _) => {
                            points.push([middle, shell.density]);
                            let error = errors.and_then(|errors| errors.get(index)).map(|error| error / shell.volume());
                            spreads
                                .extend(error.map(|error| [(shell.density - error).max(0.0), shell.density + error]));
                        }
                        (Some(_), None) => {}
                        (Some(_), Some(mean)) => {
                            let dispersion = dispersion.unwrap_or_default();
                            points.push([middle, mean]);
                            spreads.push([mean - dispersion, mean + dispersion]);
                        }
                    }
                }
                let values = || points.iter().map(|point| point[1]).chain(spreads.iter().flatten().copied());
                // That a density may be off does not say how densities are spread.
                let told = values().take(if found.field.is_some() { usize::MAX } else { points.len() });
                let (low, high) = told
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
                let up_logarithmic = scales.weights.unwrap_or(low > 0.0 && high > 10.0 * low);
                let up = match &found.field {
                    Some(field) => named(field, &found.field_unit),
                    None => named("density", &density_unit(&found.mass_unit, &found.length_unit)),
                };
                let radii = points.iter().map(|point| point[0]);
                let outermost = found.shells.last().map_or(1.0, |shell| shell.to);
                let across_range = match is_logarithmic {
                    true => {
                        roomy(radii, true).map_or([0.1, 1.0], |[low, high]| [low, high.min(outermost).max(1.1 * low)])
                    }
                    false => [0.0, outermost],
                };
                write(&Chart {
                    title: &title,
                    note: &note,
                    across: ChartAxis { title: &across, range: across_range, logarithmic: is_logarithmic },
                    up: ChartAxis {
                        title: &up,
                        range: roomy(values(), up_logarithmic).unwrap_or([1.0, 10.0]),
                        logarithmic: up_logarithmic,
                    },
                    marks: Marks::Line { points: &points, spreads: &spreads },
                })
            }
        }
    }
}

/// The axis of weights: from zero where bars stand on it, else over the weights.
fn weight_axis<'a>(title: &'a str, weights: &[f64], logarithmic: bool, is_phase: bool) -> ChartAxis<'a> {
    let placed = weights.iter().copied();
    let range = match logarithmic {
        true if is_phase => {
            let range = placed.filter(|weight| *weight > 0.0 && weight.is_finite());
            let ends = |[low, high]: [f64; 2], weight: f64| [low.min(weight), high.max(weight)];
            let [low, high] = range.fold([f64::INFINITY, f64::NEG_INFINITY], ends);
            if high > low { [low, high] } else { [0.5 * low.min(1e300), 2.0 * low.min(1e300)] }
        }
        true => roomy(placed, true).unwrap_or([1.0, 10.0]),
        false => {
            let (low, high) =
                placed.fold((0.0_f64, 0.0_f64), |(low, high), weight| (low.min(weight), high.max(weight)));
            let room = if is_phase { 1.0 } else { 1.05 };
            [if is_phase { 0.0 } else { room * low }, if high > 0.0 { room * high } else { 1.0 }]
        }
    };
    ChartAxis { title, range, logarithmic }
}
