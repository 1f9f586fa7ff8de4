//! How the points of images and volumes are chosen, on the command line.

use crate::hierarchy::wavelet::{Metric, Options, Types};
use crate::model::{Grid, Scale};
use std::path::Path;

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
    /// Values below this count as air, as `info` tells values: no points stand for them, and what they are is no error.
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = finite)]
    pub ignore_below: Option<f64>,
}

fn finite(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| "expected a number".to_owned())
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
    /// What they say of a grid at a path.
    ///
    /// # Errors
    /// Where what is below a value is not below one of stored values.
    pub fn options(&self, path: &Path, grid: &Grid) -> Result<Options, String> {
        let scale = grid.channels.first().map_or(Scale::NONE, |channel| channel.scale);
        if self.ignore_below.is_some() && scale.slope <= 0.0 {
            let (path, slope) = (path.display(), scale.slope);
            return Err(format!("{path}: --ignore-below: found samples scaled by {slope}, expected a positive scale"));
        }
        Ok(Options {
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
            ignore_below: self.ignore_below.map(|value| ((value - scale.intercept) / scale.slope) as f32),
        })
    }

    /// Refuses what they say of grids alone where something else is at a path.
    ///
    /// # Errors
    /// Where something counts as air.
    pub fn refuse(&self, path: &Path, found: &str) -> Result<(), String> {
        match self.ignore_below {
            None => Ok(()),
            Some(_) => {
                let path = path.display();
                Err(format!("{path}: --ignore-below: found {found}, expected an image or a volume"))
            }
        }
    }
}
