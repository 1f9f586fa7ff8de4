//! How many points stand for samples, and how far what they show is from the samples.

use crate::hierarchy::wavelet::{Cut, Drawn};
use serde::Serialize;

/// What is told of a picture or a grid that is made of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PointsReport {
    /// Points.
    pub points: u64,
    /// How many of them are samples.
    pub leaves: u64,
    /// Nodes that the others stand for.
    pub nodes: u64,
    /// How far values are from the samples.
    pub error_value: ErrorValue,
    /// How far opacities of a unit length, and light by them, are from the samples' at most, of 255; `None` where no transfer function
    /// was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_color: Option<f32>,
    /// What a number of points keeps small, as [`crate::modes::samples::WEIGHTING`] names it; `None` where none was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weighting: Option<&'static str>,
}

/// Differences from the samples, over all of them and all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorValue {
    /// The largest.
    pub max: f32,
    /// The root of the mean of their squares.
    pub rms: f32,
    /// What none exceeds: what is drawn is compared with every sample.
    pub bound: f32,
}

impl PointsReport {
    /// Of a cut, whose errors are not known yet.
    pub fn of(cut: &Cut) -> PointsReport {
        let is_drawn = |how: &&Drawn| matches!(how, Drawn::Large | Drawn::Directed);
        let nodes = cut.drawn.iter().flatten().filter(is_drawn).count() as u64;
        PointsReport { points: cut.points as u64, leaves: cut.leaves as u64, nodes, ..PointsReport::default() }
    }

    /// Of samples as they are.
    pub fn exact(samples: u64) -> PointsReport {
        PointsReport { points: samples, leaves: samples, ..PointsReport::default() }
    }
}
