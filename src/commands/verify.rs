//! `deepfield verify`: every checksum and structural promise of a page file or a run.

use super::page_file_info::hierarchies;
use super::progress_bar::TerminalProgress;
use super::{CommandResult, print_line};
use crate::build::compare_with_sources;
use crate::heights::store::{VerifiedHeights, verify_heights};
use crate::look::DataKind;
use crate::model::ReadMethod;
use crate::store::grid::{VerifiedGrid, verify_grid};
use crate::store::run::{VerifiedRun, verify_run};
use crate::store::verify::{Verified, verify};
use crate::store::{PageFile, RunFile};
use std::path::PathBuf;
use std::sync::Arc;

/// Checks every byte and every structural promise of a page file, a run, or a file of a grid or of heights.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield verify galaxy.df
  deepfield verify run.df --sources            every particle at every step against its snapshot, too")]
pub struct Arguments {
    /// The page file or run, or the URL of one.
    pub path: PathBuf,
    /// Compare the tracks of a run with the snapshots that it was built from, too, which still have to be there.
    #[arg(long)]
    pub sources: bool,
}

/// Verifies the file and says what was checked.
///
/// # Errors
/// [`crate::store::StoreError`] with the first damage found.
pub fn run(arguments: &Arguments) -> CommandResult {
    let path = arguments.path.display();
    // What cannot be looked at is told where it is opened as a page file.
    if let Ok(DataKind::Run) = DataKind::of(&arguments.path) {
        let VerifiedRun { bytes, steps, stills, tracks } = verify_run(&arguments.path, &TerminalProgress::new())?;
        let Verified { pages, nodes, particles, .. } = stills;
        print_line(format_args!(
            "{path}: sound, {steps} steps, {pages} pages, {nodes} nodes, {particles} particles, {tracks} tracks, {bytes} bytes"
        ))?;
        if arguments.sources {
            let run = Arc::new(RunFile::open(&arguments.path, ReadMethod::default())?);
            let compared = compare_with_sources(&run, &TerminalProgress::new())?;
            print_line(format_args!("{path}: {compared} particles are where the snapshots have them"))?;
        }
        return Ok(());
    }
    if arguments.sources && DataKind::of(&arguments.path).is_ok() {
        return Err(format!("{path}: --sources: found no run, expected one").into());
    }
    if let Ok(DataKind::Heights) = DataKind::of(&arguments.path) {
        let VerifiedHeights { bytes, pages, chunks, tiles, valid } =
            verify_heights(&arguments.path, &TerminalProgress::new())?;
        let tiles = if tiles > 0 { format!("{tiles} tiles, ") } else { String::new() };
        print_line(format_args!(
            "{path}: sound, {pages} pages, {chunks} chunks, {tiles}{valid} measured samples, {bytes} bytes"
        ))?;
        return Ok(());
    }
    if let Ok(DataKind::Grid) = DataKind::of(&arguments.path) {
        let VerifiedGrid { bytes, pages, nodes, samples } = verify_grid(&arguments.path, &TerminalProgress::new())?;
        print_line(format_args!("{path}: sound, {pages} pages, {nodes} nodes, {samples} samples, {bytes} bytes"))?;
        return Ok(());
    }
    if let Ok(DataKind::Source) = DataKind::of(&arguments.path) {
        let expected = "a page file, a run, or a file of a grid or of heights";
        return Err(format!("{path}: content: found no file that deepfield has built, expected {expected}").into());
    }
    let verified = verify(&arguments.path, &TerminalProgress::new())?;
    print_line(format_args!(
        "{path}: sound, {} pages, {} nodes of {}, {} particles, {} bytes",
        verified.pages,
        verified.nodes,
        hierarchies(PageFile::open(&arguments.path)?.metadata()).join(" and "),
        verified.particles,
        verified.bytes
    ))?;
    Ok(())
}
