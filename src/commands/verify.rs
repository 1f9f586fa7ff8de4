//! `deepfield verify`: every checksum and structural promise of a page file or a run.

use super::CommandResult;
use super::progress_bar::TerminalProgress;
use crate::look::DataKind;
use crate::store::run::{VerifiedRun, verify_run};
use crate::store::verify::{Verified, verify};
use std::path::PathBuf;

/// Checks every byte and every structural promise of a page file or a run.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield verify galaxy.df")]
pub struct Arguments {
    /// The page file or run.
    pub path: PathBuf,
}

/// Verifies the file and says what was checked.
///
/// # Errors
/// [`crate::store::StoreError`] with the first damage found.
pub fn run(arguments: &Arguments) -> CommandResult {
    let path = arguments.path.display();
    // What cannot be looked at is told where it is opened as a page file.
    if let Ok(DataKind::Run) = DataKind::of(&arguments.path) {
        let VerifiedRun { bytes, steps, stills } = verify_run(&arguments.path, &TerminalProgress::new())?;
        let Verified { pages, nodes, particles, .. } = stills;
        println!("{path}: sound, {steps} steps, {pages} pages, {nodes} nodes, {particles} particles, {bytes} bytes");
        return Ok(());
    }
    let verified = verify(&arguments.path, &TerminalProgress::new())?;
    println!(
        "{}: sound, {} pages, {} nodes, {} particles, {} bytes",
        path, verified.pages, verified.nodes, verified.particles, verified.bytes
    );
    Ok(())
}
