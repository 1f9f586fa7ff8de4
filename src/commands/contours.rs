//! `deepfield contours`: the lines of equal height of a surface, as vectors.

use super::heights::{self, StatedOptions};
use super::{CommandResult, arguments::positive};
use std::path::PathBuf;

/// Writes the lines along which a surface has heights BASE, BASE + INTERVAL, ...: exact, closed or ending at a border or at a hole.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield contours dem.df --interval 10 -o lines.geojson
  deepfield contours surface.sur --interval 0.0001 --base 0.009 -o lines.svg
  deepfield contours heights.npy --spacing 0.5,0.5 --xy-unit um --interval 0.1 -o lines.csv")]
pub struct Arguments {
    /// The heights: a source or a page file.
    pub path: PathBuf,
    /// From a line to the next, in the unit of heights.
    #[arg(long, value_name = "HEIGHT", value_parser = positive, allow_hyphen_values = true)]
    pub interval: f64,
    /// A height that has a line.
    #[arg(long, value_name = "HEIGHT", default_value_t = 0.0, allow_hyphen_values = true)]
    pub base: f64,
    /// The lines: .geojson, .csv or .svg.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// What is said of heights.
    #[command(flatten)]
    pub heights: StatedOptions,
}

/// Finds and writes the lines.
///
/// # Errors
/// When the heights cannot be read, or the file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    heights::contours::run(arguments)
}
