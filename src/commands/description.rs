//! The whole command line as a value: what parsing, help, shell completions and manual pages are made of.

use super::Command;
use crate::heights::import::height_names;
use crate::import;
use crate::model::url::shown_argument;
use crate::modes;
use clap::{CommandFactory, FromArgMatches, Parser};
use std::ffi::OsString;

/// Explore huge point data, sampled grids and measured heights: snapshots, star catalogues, images, volumes, surfaces, and their
/// hierarchies on disk.
///
/// Without a command, deepfield opens its demo dataset in a window, or renders it to a file where there is no display.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  deepfield                                        the demo dataset
  deepfield view snapshot_099.hdf5                 look around in a snapshot
  deepfield render snapshot_099.hdf5 -o halo.png   the same picture without a window
  deepfield info snapshot_099.hdf5                 what the file holds
  deepfield build head.nrrd -o head.df             an image or a volume, as oriented points over its samples
  deepfield view surface.sur                       measured heights: turn them, read samples, draw profiles"
)]
struct CommandLine {
    #[command(subcommand)]
    command: Option<Command>,
}

/// The command line, with the modes and formats that are registered in its help.
pub fn command_line() -> clap::Command {
    let command = CommandLine::command();
    let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let [modes, particles] = [modes::names(), import::names()];
    let [grids, heights] = [import::grid::grid_names(), height_names()];
    command.after_help(format!(
        "{examples}\n\nModes: {modes}\nFormats of particles: {particles}\nFormats of images and volumes: {grids}\n\
         Formats of heights: {heights}"
    ))
}

/// The command that is asked for; leaves the program where there is a mistake, or help was asked for.
pub fn parse() -> Option<Command> {
    // Only what is shown of a URL goes further.
    let shown =
        |argument: OsString| argument.into_string().map_or_else(|other| other, |text| shown_argument(&text).into());
    let matches = command_line().get_matches_from(std::env::args_os().map(shown));
    CommandLine::from_arg_matches(&matches).unwrap_or_else(|error| error.exit()).command
}
