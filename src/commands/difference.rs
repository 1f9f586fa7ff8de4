//! `deepfield difference`: how a surface has changed.

use super::CommandResult;
use super::heights::{self, StatedOptions};
use std::path::PathBuf;

/// Subtracts an earlier surface from a later one on the earlier one's grid, and says what volumes were added and taken away.
///
/// Where grids coincide samples are subtracted from samples; else the later surface is taken at the earlier one's places. What was not
/// measured in either is not known.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield difference before.tif after.tif -o change.df
  deepfield difference before.df after.df --json -")]
pub struct Arguments {
    /// The earlier heights.
    pub before: PathBuf,
    /// The later heights.
    pub after: PathBuf,
    /// The difference: a page file .df, or .npy, .tif, .asc, .x3p or .csv.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write the numbers as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
    /// What is said of both.
    #[command(flatten)]
    pub heights: StatedOptions,
    /// On which body degrees are lengths: globe:BODY such as globe:moon [default: the Earth].
    #[arg(long, value_name = "MAP")]
    pub map: Option<String>,
}

/// Subtracts, writes and tells.
///
/// # Errors
/// When the heights cannot be read or do not fit together, or the file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    heights::difference::run(arguments)
}
