//! What a surface's picture shows beside its colours.

use crate::cpu::surface::SurfaceReport;
use crate::cpu::surface::labels::ContourLabel;

/// Depth, x, y, height, row, column and coverage at the middle of each pixel, row by row; NaN where nothing is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceChannels {
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The channels.
    pub values: Vec<[f64; 7]>,
}

/// What the channels are called in files.
pub const CHANNELS: [&str; 7] = ["depth", "x", "y", "height", "row", "column", "coverage"];

/// What was drawn of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceShown {
    /// Numbers.
    pub report: SurfaceReport,
    /// The channels, where they were asked for.
    pub channels: Option<SurfaceChannels>,
    /// The heights that are written along lines; `None` where none are asked for.
    pub labels: Option<Vec<ContourLabel>>,
    /// Where the eye was lifted to, where it would have been too near to the ground.
    pub lifted: Option<[f64; 3]>,
}
