//! Plots in words: what they show, of how many particles, who was left out, and how exact they are.

use super::Plot;
use crate::annotate::number::short;
use crate::explore::Estimate;
use crate::explore::binned::{Binned, Weight};
use crate::explore::radial::Radial;
use std::fmt::Write as _;

impl Plot {
    /// What it shows, without units.
    pub fn title(&self) -> String {
        match self {
            Plot::Binned(Binned { axes, weight, .. }) => {
                let names: Vec<&str> = axes.iter().rev().map(|axis| axis.field.as_str()).collect();
                format!("{weight} by {}", names.join(" over "))
            }
            Plot::Scatter { fields: [x, y], .. } => format!("{} over {}", y.field, x.field),
            Plot::Radial(Radial { field, .. }) => format!("{} over radius", field.as_deref().unwrap_or("density")),
        }
    }

    /// What is to be said of it: of how many particles it is, who was left out, and how exact it is.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let from = |exact: bool| if exact { "every particle of the source" } else { "leaves of the page file" };
        match self {
            Plot::Binned(found) => {
                let what = if found.weight == Weight::Count { "particles" } else { "weight" };
                let mut about = format!("{} particles, {}", found.count, from(found.exact));
                if let Some(error) = &found.error {
                    let _ = write!(
                        about,
                        "; {what} that may be in other bins: {}",
                        by_errors(error.other_bins_by_mean, error.other_bins)
                    );
                    if error.weights > 0.0 {
                        let _ = write!(about, ", off in weight: {}", by_errors(error.weights_by_mean, error.weights));
                    }
                    match error.region {
                        Some(0.0) => {}
                        Some(share) => {
                            let _ = write!(about, ", in or out of the region: {}", percent(share));
                        }
                        None => about.push_str(", some may be in or out of the region"),
                    }
                }
                notes.push(about);
                notes.extend(self.estimate_in_words());
                if found.not_positive > 0 {
                    let axes = found.axes.iter().filter(|axis| axis.logarithmic).map(|axis| axis.field.as_str());
                    let names = axes.collect::<Vec<_>>().join(" or ");
                    notes.push(format!("{} particles left out: {names} is not positive", found.not_positive));
                }
                if found.outside > 0 {
                    notes.push(format!("{} particles left out: beyond the range", found.outside));
                }
                if found.missing > 0 {
                    notes.push(format!("{} particles left out: without a value", found.missing));
                }
                let below = found.weights.iter().filter(|weight| **weight < 0.0).count();
                if found.axes.len() > 1 && below > 0 {
                    notes.push(format!("{below} cells are empty in pictures: their {} is negative", found.weight));
                }
                let missing = found.error.map_or(0, |error| error.missing_values);
                notes.extend(stand_ins(missing));
            }
            Plot::Scatter { x, of, exact, .. } => {
                notes.push(format!("{} of {of} particles, {}", x.len(), from(*exact)));
                notes.extend(self.estimate_in_words());
            }
            Plot::Radial(found) => {
                let mut about = format!("{} particles, {}", found.count, from(found.exact));
                if let Some(error) = &found.error {
                    let _ = write!(about, "; mass that may be in other shells: {}", percent(error.other_shells));
                    if error.region > 0.0 {
                        let _ = write!(about, ", in or out of the sphere: {}", percent(error.region));
                    }
                    if error.masses > 0.0 {
                        let _ = write!(about, ", off in mass: {}", by_errors(error.masses_by_mean, error.masses));
                    }
                    if let (Some(mean), Some(most)) = (error.values_by_mean, error.values)
                        && most > 0.0
                    {
                        let [mean, most] = [mean, most].map(short);
                        let _ = write!(about, ", values off by {mean} by mean errors, {most} by the largest");
                    }
                }
                notes.push(about);
                notes.extend(self.estimate_in_words());
                notes.extend(stand_ins(found.error.map_or(0, |error| error.missing_values)));
            }
        }
        notes
    }

    /// How much of a page file was read, and how far off what is shown may be for it; `None` where all of it was.
    pub(super) fn estimate_in_words(&self) -> Option<String> {
        let Estimate { allowed, least_share, largest, pages_read, pages, parts_read, parts, .. } = self.estimate()?;
        let [place, of, means] = match self {
            Plot::Binned(_) => ["bin", "weight", ""],
            Plot::Scatter { .. } => ["cell of 16 by 16", "points", ""],
            Plot::Radial(Radial { field: None, .. }) => ["shell", "mass", ""],
            Plot::Radial(_) => ["shell", "mass", ", means by as much of the root mean square of their values"],
        };
        let allowed = allowed.map_or_else(String::new, |allowed| format!("; {} allowed", error_percent(allowed)));
        let (least, largest) = (percent(*least_share), error_percent(*largest));
        Some(format!(
            "an estimate from {pages_read} of {pages} pages, {parts_read} of {parts} parts drawn at random: each {place} with {least} of the \
             {of} or more is off by up to {largest} of its {of}{means} (three standard errors{allowed}), others by as much as a {place} with so much"
        ))
    }
}

/// An error in words, which may be larger than what it is relative to.
fn error_percent(error: f64) -> String {
    if error > 1.0 && error.is_finite() { format!("{:.0} %", 100.0 * error) } else { percent(error) }
}

/// A share in words.
fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "none".into(),
        share if share.is_nan() || share >= 100.0 => "all".into(),
        share if share < 0.01 => "less than 0.01 %".into(),
        share => format!("{share:.2} %"),
    }
}

/// A share by the mean errors of codebooks, and by the largest ones, which none exceeds.
fn by_errors(mean: f64, most: f64) -> String {
    match percent(most).as_str() {
        "none" => "none".into(),
        most => format!("{} by mean errors, {most} by the largest", percent(mean)),
    }
}

/// A note about values that a source does not have.
fn stand_ins(missing: u64) -> Option<String> {
    (missing > 0).then(|| format!("{missing} values that the source lacks count as the mean of their family"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::Axis;
    use crate::model::Unit;

    #[test]
    fn cells_that_no_colour_stands_for_are_told() {
        let axis = |field: &str| Axis {
            field: field.into(),
            unit: Unit::default(),
            logarithmic: false,
            min: 0.0,
            max: 1.0,
            bins: 2,
        };
        let found = Binned {
            axes: vec![axis("density"), axis("charge")],
            weight: Weight::Field("charge".into()),
            weight_unit: Unit::default(),
            weights: vec![-3.0, 0.0, 2.0, -1.0],
            counts: vec![3, 0, 2, 1],
            total: -2.0,
            count: 6,
            not_positive: 0,
            outside: 0,
            missing: 0,
            exact: true,
            error: None,
            estimate: None,
        };
        let notes = Plot::Binned(found.clone()).notes();
        assert_eq!(notes[1..], ["2 cells are empty in pictures: their charge is negative"]);
        let histogram = Binned { axes: vec![axis("density")], ..found };
        assert_eq!(Plot::Binned(histogram).notes().len(), 1);
    }

    #[test]
    fn shares_are_told() {
        let told = [0.0, 1e-6, 0.0123, 1.0, f64::INFINITY].map(percent);
        assert_eq!(told, ["none", "less than 0.01 %", "1.23 %", "all", "all"]);
        assert_eq!(by_errors(0.0, 0.0), "none");
        assert_eq!(by_errors(0.25, 2.0), "25.00 % by mean errors, all by the largest");
    }
}
