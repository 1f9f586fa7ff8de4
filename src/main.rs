//! Parses the command line, calls one command, and turns its outcome into an exit code: 0 for success, 2 for wrong
//! usage, 1 for failure with one line on standard error.

use clap::Parser;
use deepfield::commands::Command;
use std::process::ExitCode;

/// Explore huge point data: snapshots, star catalogues and their hierarchies on disk.
///
/// Without a command, deepfield opens its demo dataset in a window, or renders it to a file where there is no display.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  deepfield                                        the demo dataset
  deepfield view snapshot_099.hdf5                 look around in a snapshot
  deepfield render snapshot_099.hdf5 -o halo.png   the same picture without a window
  deepfield info snapshot_099.hdf5                 what the file holds"
)]
struct CommandLine {
    #[command(subcommand)]
    command: Option<Command>,
}

fn main() -> ExitCode {
    #[cfg(feature = "viewer")]
    deepfield::gpu::environment::prepare();
    let outcome = match CommandLine::parse().command {
        Some(command) => command.run(),
        None => deepfield::commands::demo::run(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // One line, whatever a library's message looks like.
            let text: Vec<String> = error.to_string().lines().map(|line| line.trim().to_owned()).collect();
            eprintln!("deepfield: {}", text.join(" "));
            ExitCode::FAILURE
        }
    }
}
