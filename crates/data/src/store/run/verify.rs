//! Checks every byte and every promise of a run file: its directory, each still as a page file, and the zeros between them.

use super::layout::{HEADER_LEN, Section, Step};
use super::{RunFile, in_step};
use crate::hierarchy::spacetime::TrackFlags;
use crate::model::{Progress, ReadMethod};
use crate::store::error::StoreError;
use crate::store::layout::ALIGNMENT;
use crate::store::page_file::PageFile;
use crate::store::verify::{Verified, verify_file};
use glam::DVec3;
use rayon::prelude::*;
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
    /// Tracks of all intervals.
    pub tracks: u64,
}

/// Verifies a run file.
///
/// # Errors
/// The first thing that is wrong with it, and in which step.
pub fn verify_run(path: &Path, progress: &dyn Progress) -> Result<VerifiedRun, StoreError> {
    let run = RunFile::open(path, ReadMethod::default())?;
    check_zeros(&run, HEADER_LEN as u64, ALIGNMENT)?;
    let steps = &run.directory.steps;
    let mut all = VerifiedRun { bytes: run.bytes(), steps: steps.len(), stills: Verified::default(), tracks: 0 };
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
        check_padding(&run, step.still)?;
    }
    let families = run.directory.tracks.as_ref().map_or(0, |tracks| tracks.families.len());
    for (number, interval) in run.directory.intervals.iter().enumerate() {
        let total = interval.families.iter().map(|family| family.tracks).sum();
        progress.begin(&format!("interval {number}: tracks"), total);
        for family in 0..families {
            all.tracks += verify_tracks(&run, number, family, progress)?;
        }
    }
    Ok(all)
}

/// Verifies the tracks of a family over an interval; returns how many there are.
fn verify_tracks(run: &RunFile, interval: usize, family: usize, progress: &dyn Progress) -> Result<u64, StoreError> {
    let found = run.family_tracks(interval, family)?;
    let index = run.track_index(interval, family)?;
    let space = run.interval(interval)?;
    index.leaves.par_iter().try_for_each(|leaf| {
        let tracks = run.track_leaf(interval, family, leaf, true)?;
        let wrong = |expected: &str| {
            run.damaged(format!("interval {interval}, family {family}, leaf at {}", leaf.offset), expected)
        };
        // Boxes are of the same arithmetic on every machine but for rounding.
        let slack = DVec3::splat(1e-9 * space.lattice.root.size);
        let (mut mass, mut faded, mut flagged) = ([0.0; 2], 0.0, [0; 3]);
        for i in 0..tracks.len() {
            let points = space.spline(&tracks, i).control_points();
            if points
                .iter()
                .any(|point| point.cmplt(leaf.bounds.min - slack).any() || point.cmpgt(leaf.bounds.max + slack).any())
            {
                return Err(wrong("tracks within its box"));
            }
            if let Some(kind) = tracks.flags[i].kind() {
                flagged[kind] += 1;
            }
            let weights = tracks.flags[i].weights();
            for ((own, weight), sum) in tracks.ends.iter().zip(weights).zip(&mut mass) {
                *sum += weight * f64::from(own.mass[i]);
            }
            if tracks.flags[i].has(TrackFlags::FADES) {
                faded += f64::from(tracks.ends[0].mass[i]);
            }
        }
        if flagged != leaf.flagged {
            return Err(wrong("as many tracks that come, go and fade as it has"));
        }
        let agrees = |told: f64, sum: f64| (told - sum).abs() <= 1e-9 * told.abs().max(sum.abs());
        if !(agrees(leaf.mass[0], mass[0]) && agrees(leaf.mass[1], mass[1]) && agrees(leaf.faded_mass, faded)) {
            return Err(wrong("the masses of its tracks"));
        }
        progress.advance(u64::from(leaf.tracks));
        Ok(())
    })?;
    check_padding(run, found.leaves)?;
    check_padding(run, found.index)?;
    Ok(found.tracks)
}

/// Zeros from the end of a section to where the next one begins.
fn check_padding(run: &RunFile, section: Section) -> Result<(), StoreError> {
    let end = section.offset + section.len;
    check_zeros(run, end, section.after().unwrap_or(end))
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
