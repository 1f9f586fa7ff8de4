//! `deepfield verify`: every checksum and structural promise of a page file.

use super::CommandResult;
use super::progress_bar::TerminalProgress;
use crate::store::verify::verify;
use std::path::PathBuf;

/// Checks every byte and every structural promise of a page file.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield verify galaxy.df")]
pub struct Arguments {
    /// The page file.
    pub path: PathBuf,
}

/// Verifies the file and says what was checked.
///
/// # Errors
/// [`crate::store::StoreError`] with the first damage found.
pub fn run(arguments: &Arguments) -> CommandResult {
    let verified = verify(&arguments.path, &TerminalProgress::new())?;
    println!(
        "{}: sound, {} pages, {} nodes, {} particles, {} bytes",
        arguments.path.display(),
        verified.pages,
        verified.nodes,
        verified.particles,
        verified.bytes
    );
    Ok(())
}
