//! Checks every byte and every promise of a run file: its directory, each still as a page file, and the zeros between them.

use super::layout::{HEADER_LEN, Step};
use super::{RunFile, in_step};
use crate::model::{Progress, ReadMethod};
use crate::store::error::StoreError;
use crate::store::layout::ALIGNMENT;
use crate::store::page_file::PageFile;
use crate::store::verify::{Verified, verify_file};
use std::path::Path;

/// What was verified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VerifiedRun {
    /// Length of the file.
    pub bytes: u64,
    /// Steps.
    pub steps: usize,
    /// Pages, nodes and particles of all stills.
    pub stills: Verified,
}

/// Verifies a run file.
///
/// # Errors
/// The first thing that is wrong with it, and in which step.
pub fn verify_run(path: &Path, progress: &dyn Progress) -> Result<VerifiedRun, StoreError> {
    let run = RunFile::open(path, ReadMethod::default())?;
    check_zeros(&run, HEADER_LEN as u64, ALIGNMENT)?;
    let steps = &run.directory.steps;
    let mut all = VerifiedRun { bytes: run.bytes(), steps: steps.len(), stills: Verified::default() };
    for (number, step) in steps.iter().enumerate() {
        let still = run.still(number)?;
        agrees(&still, step).map_err(|expected| StoreError::Damaged {
            path: path.to_path_buf(),
            place: format!("directory, step {number}"),
            expected: expected.into(),
        })?;
        let done = verify_file(&still, progress).map_err(|error| in_step(error, number))?;
        all.stills.bytes += done.bytes;
        all.stills.pages += done.pages;
        all.stills.nodes += done.nodes;
        all.stills.particles += done.particles;
        let next = steps.get(number + 1).map_or(run.header.directory.offset, |next| next.still.offset);
        check_zeros(&run, step.still.offset + step.still.len, next)?;
    }
    Ok(all)
}

/// Whether the directory says of a step what its still says.
fn agrees(still: &PageFile, step: &Step) -> Result<(), &'static str> {
    let metadata = still.metadata();
    if metadata.particles() != step.particles {
        return Err("as many particles as its still has");
    }
    if metadata.provenance.path.to_string_lossy() != step.source.to_string_lossy() {
        return Err("the source that its still was built from");
    }
    Ok(())
}

fn check_zeros(run: &RunFile, start: u64, end: u64) -> Result<(), StoreError> {
    if run.raw(start, end)?.iter().any(|&byte| byte != 0) {
        return Err(StoreError::Damaged {
            path: run.path.clone(),
            place: format!("bytes {start} to {end}"),
            expected: "zeros".into(),
        });
    }
    Ok(())
}
