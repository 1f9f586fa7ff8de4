//! How the points of images and volumes are chosen, on the command line.

use crate::hierarchy::wavelet::{Metric, Options, Types};
use crate::model::Grid;

/// How points stand for nodes.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Images and volumes")]
pub struct WaveletOptions {
    /// By what a node's points are chosen.
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub types: TypesName,
    /// What counts as a node's error.
    #[arg(long, value_name = "WHICH", value_enum, default_value_t)]
    pub error_metric: MetricName,
}

/// By what a node's points are chosen.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub enum TypesName {
    /// The error that each choice is measured to have.
    #[default]
    Measured,
    /// No directions: one point, or samples.
    Round,
    /// The coefficients of directed filters, as published.
    Gabor,
}

/// What counts as a node's error.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub enum MetricName {
    /// The difference of samples and points.
    #[default]
    Residual,
    /// The variation of the samples.
    Rms,
    /// The largest coefficient of directed filters of what is not drawn, as published.
    Gabor,
}

impl WaveletOptions {
    /// What they say of a grid.
    pub fn options(&self, grid: &Grid) -> Options {
        Options {
            types: match self.types {
                TypesName::Measured => Types::Measured,
                TypesName::Round => Types::Round,
                TypesName::Gabor => Types::Gabor,
            },
            metric: match self.error_metric {
                MetricName::Residual => Metric::Residual,
                MetricName::Rms => Metric::Rms,
                MetricName::Gabor => Metric::Gabor,
            },
            colours: grid.has_colors(),
        }
    }
}
