//! Checks every byte and every promise of a run file: its directory, each still as a page file, and the zeros between them.

use super::layout::{HEADER_LEN, Section, Step};
use super::tracks::TrackIndex;
use super::{RunFile, in_step};
use crate::hierarchy::spacetime::{Chains, Links, TrackFlags};
use crate::model::{Bounds, Progress, ReadMethod};
use crate::store::error::{Damage, StoreError};
use crate::store::layout::ALIGNMENT;
use crate::store::page_file::PageFile;
use crate::store::verify::{Verified, verify_file};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;

/// By how much the masses of clusters may differ from those of the particles that they stand for: a float of 13 bits each.
const CLUSTER_MASS: f64 = 1.0 / 8192.0;

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
        let wrong = |expected: &str| Damage::new(format!("directory, step {number}"), expected).in_file(path);
        agrees(&still, step).map_err(wrong)?;
        let outline = || run.damaged(format!("step {number}"), "an outline without pages, or a still");
        if (still.page_count() > 0) != run.directory.has_stills {
            return Err(outline());
        }
        let done = match run.directory.has_stills {
            true => verify_file(&still, progress).map_err(|error| in_step(error, number))?,
            false => Verified { bytes: still.bytes(), particles: step.particles, ..Verified::default() },
        };
        all.stills.bytes += done.bytes;
        all.stills.pages += done.pages;
        all.stills.nodes += done.nodes;
        all.stills.particles += done.particles;
        check_padding(&run, step.still)?;
    }
    let families = run.directory.tracks.as_ref().map_or(0, |tracks| tracks.families.len());
    let mut chains = vec![vec![Chains::default(); run.flow_errors().len()]; families];
    for (number, interval) in run.directory.intervals.iter().enumerate() {
        let total = interval.families.iter().map(|family| family.tracks).sum();
        progress.begin(&format!("interval {number}: tracks"), total);
        for (family, chains) in chains.iter_mut().enumerate() {
            all.tracks += verify_tracks(&run, number, family, chains, progress)?;
        }
    }
    Ok(all)
}

/// Verifies the tracks of a family over an interval; returns how many there are. `chains`: of each flow level the tracks over the intervals
/// before.
fn verify_tracks(
    run: &RunFile,
    interval: usize,
    family: usize,
    chains: &mut [Chains],
    progress: &dyn Progress,
) -> Result<u64, StoreError> {
    let found = run.family_tracks(interval, family)?;
    let index = run.track_index(interval, family)?;
    let space = run.interval(interval)?;
    index.nodes.par_iter().try_for_each(|node| {
        let tracks = run.node_tracks(interval, family, node, node.is_leaf())?;
        let wrong = |expected: &str| {
            run.damaged(format!("interval {interval}, family {family}, tracks at {}", node.offset), expected)
        };
        // Boxes are of the same arithmetic on every machine but for rounding.
        let slack = DVec3::splat(1e-9 * space.lattice.root.size);
        let within = |inner: Bounds| {
            inner.min.cmpge(node.bounds.min - slack).all() && inner.max.cmple(node.bounds.max + slack).all()
        };
        let children = || node.children.iter().map(|child| &index.nodes[*child as usize]);
        if !(within(tracks.bounds(&space)) && children().all(|child| within(child.bounds))) {
            return Err(wrong("tracks within its box"));
        }
        let (mut mass, mut faded, mut flagged) = ([0.0; 2], 0.0, [0; 3]);
        for (i, flags) in tracks.flags.iter().enumerate() {
            if let Some(kind) = flags.kind() {
                flagged[kind] += 1;
            }
            for ((own, weight), sum) in tracks.ends.iter().zip(flags.weights()).zip(&mut mass) {
                *sum += weight * f64::from(own.mass[i]);
            }
            if flags.has(TrackFlags::FADES) {
                faded += f64::from(tracks.ends[0].mass[i]);
            }
        }
        if flagged != node.flagged {
            return Err(wrong("as many tracks that come, go and fade as it has"));
        }
        // Clusters' masses are rounded, as those of particles are.
        let slack = if node.is_leaf() { 1e-9 } else { CLUSTER_MASS };
        let agrees = |told: f64, sum: f64| (told - sum).abs() <= slack * told.abs().max(sum.abs());
        if !(agrees(node.mass[0], mass[0]) && agrees(node.mass[1], mass[1]) && agrees(node.faded_mass, faded)) {
            return Err(wrong("the masses of its tracks"));
        }
        if node.is_leaf() {
            progress.advance(node.sources);
        }
        Ok(())
    })?;
    check_padding(run, found.nodes)?;
    check_padding(run, found.index)?;
    verify_flow(run, interval, family, &index, chains)?;
    Ok(found.tracks)
}

/// Verifies the flow levels of a family over an interval: what they say of particles adds up on each level, and each cluster is one; long
/// tracks are as near to those that they consist of as they say.
fn verify_flow(
    run: &RunFile,
    interval: usize,
    family: usize,
    index: &TrackIndex,
    chains: &mut [Chains],
) -> Result<(), StoreError> {
    let found = run.family_tracks(interval, family)?;
    if found.flow.levels.is_empty() {
        return Ok(());
    }
    let wrong = |level: usize, expected: &str| {
        run.damaged(format!("interval {interval}, family {family}, flow level {level}"), expected)
    };
    // Reading it refuses numbers that its bytes cannot hold.
    let mut finer = vec![0_u32; run.flow_tracks(interval, family, 1)?.len()];
    for leaf in index.leaves() {
        run.leaf_flow(interval, family, leaf)?.into_iter().for_each(|track| finer[track as usize] += 1);
    }
    for level in 1..=found.flow.levels.len() {
        let flow = run.flow_tracks(interval, family, level)?;
        let sums: Vec<u32> = match level {
            1 => finer,
            _ => (0..flow.len()).map(|i| flow.children_of(i).map(|child| finer[child as usize]).sum()).collect(),
        };
        if sums != flow.counts {
            return Err(wrong(level, "as many particles as its finer tracks have"));
        }
        for (end, numbers) in flow.clusters.iter().enumerate() {
            let own = &flow.tracks.ends[end];
            let mut order: Vec<usize> = (0..flow.len()).collect();
            order.sort_by_key(|i| numbers[*i]);
            let differ = |pair: &[usize]| {
                numbers[pair[0]] == numbers[pair[1]] && own.movements[pair[0]] != own.movements[pair[1]]
            };
            if order.windows(2).any(differ) {
                return Err(wrong(level, "one state for each cluster"));
            }
        }
        finer = sums;
        let clock = &run.tracks()?.clock;
        let clock = [clock[interval], clock[interval + 1]];
        let links = Links::of_interval(&flow.tracks, &flow.clusters, run.interval(interval)?, clock);
        let error = run.flow_errors()[level - 1];
        chains[level - 1].push(interval, links, |stretch, first, second| {
            let long = run.long_tracks(stretch, family, level)?;
            let expected = "long tracks of one matter, within their errors of what they consist of";
            first.follow(second, &long, error).ok_or_else(|| wrong(level, expected))
        })?;
    }
    check_padding(run, found.flow.section)
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
        return Err(run.damaged(format!("bytes {start} to {end}"), "zeros"));
    }
    Ok(())
}
