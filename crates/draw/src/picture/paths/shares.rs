//! How much of each cluster is selected, where clusters stand for the particles of selections.

use super::members::Whose;
use crate::store::StoreError;
use crate::store::run::{RunFile, TrackNode};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;

/// Shares of the mass of tracks by interval, family and flow level.
#[derive(Default)]
pub(super) struct Shares {
    found: HashMap<[usize; 3], Arc<Vec<f32>>>,
}

/// Levels of intervals whose shares are kept.
const KEPT: usize = 4096;

impl Shares {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.found.clear();
    }

    /// The share of the mass of each track of a flow level that is selected, from 0 to 1. All leaves of the interval are read once, since
    /// members of a cluster may be out of view.
    pub fn of(
        &mut self,
        run: &RunFile,
        whose: &Whose,
        [interval, family, level]: [usize; 3],
    ) -> Result<Arc<Vec<f32>>, StoreError> {
        if let Some(known) = self.found.get(&[interval, family, level]) {
            return Ok(Arc::clone(known));
        }
        if self.found.len() >= KEPT {
            self.found.clear();
        }
        // Selected mass and all of it, of the tracks of level 1, and from there on of what these are parts of.
        let mut masses = finest(run, whose, interval, family)?;
        for own in 1..=run.flow_errors().len() {
            if own > 1 {
                let coarser = run.flow_tracks(interval, family, own)?;
                let sum = |track: usize| {
                    let parts = coarser.children_of(track).filter_map(|part| masses.get(part as usize));
                    parts.fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
                };
                masses = (0..coarser.tracks.len()).map(sum).collect();
            }
            let share = |[selected, all]: &[f64; 2]| if *all > 0.0 { (selected / all) as f32 } else { 0.0 };
            self.found.insert([interval, family, own], Arc::new(masses.iter().map(share).collect()));
        }
        Ok(self.found.get(&[interval, family, level]).cloned().unwrap_or_default())
    }
}

/// Selected mass and all of it, of each track of level 1.
fn finest(run: &RunFile, whose: &Whose, interval: usize, family: usize) -> Result<Vec<[f64; 2]>, StoreError> {
    let index = run.track_index(interval, family)?;
    let leaves: Vec<&TrackNode> = index.leaves().collect();
    let of_leaf = |leaf: &&TrackNode| -> Result<Vec<(u32, f64, bool)>, StoreError> {
        let flow = run.leaf_flow(interval, family, leaf)?;
        let tracks = run.node_tracks(interval, family, leaf, true)?;
        let mass = |i: usize| 0.5 * f64::from(tracks.ends[0].mass[i] + tracks.ends[1].mass[i]);
        let own = tracks.ids.iter().zip(&flow).enumerate();
        Ok(own.map(|(i, (id, flow))| (*flow, mass(i), whose.has(family, *id))).collect())
    };
    let found: Vec<_> = leaves.par_iter().map(of_leaf).collect::<Result<_, StoreError>>()?;
    // One after the other, so that sums do not depend on threads.
    let mut masses: Vec<[f64; 2]> = Vec::new();
    for (track, mass, is_selected) in found.into_iter().flatten() {
        let track = track as usize;
        if masses.len() <= track {
            masses.resize(track + 1, [0.0; 2]);
        }
        masses[track][0] += if is_selected { mass } else { 0.0 };
        masses[track][1] += mass;
    }
    Ok(masses)
}
