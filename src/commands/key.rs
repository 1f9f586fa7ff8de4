//! `deepfield key`: a new key for a show on several machines.

use super::{CommandResult, print_line};
use crate::show::protocol::ShowKey;
use std::path::PathBuf;

/// Makes the key of a show: whoever has it may lead and follow, nobody else (docs/shows.md).
///
/// The file is made of the system's randomness, readable by its owner only, and never overwritten. Copy it to every machine of the
/// show.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield key show.key
  deepfield view snapshot_099.hdf5 --lead --show-key show.key
  deepfield view snapshot_099.hdf5 --follow 192.168.0.10 --show-key show.key     on another machine")]
pub struct Arguments {
    /// The file to make.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}

/// Makes the file.
///
/// # Errors
/// Where it is there already or cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    ShowKey::random().write(&arguments.file)?;
    print_line(format_args!("the show's key is in {}", arguments.file.display()))?;
    Ok(())
}
