//! The levels of HE03: representatives of the particles, representatives of these, and so on.

use crate::hierarchy::pca::members::DiameterRule;
use crate::hierarchy::pca::{Members, SplitRule, split};
use crate::model::Dataset;

/// The points of a level. Lengths in world units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Level {
    /// Centroids.
    pub places: Vec<[f64; 3]>,
    /// Masses: what equation 1 calls the flux, which is drawn as a splat's weight.
    pub mass: Vec<f64>,
    /// Diameters by equation 2; of particles the width of the kernel's support.
    pub diameters: Vec<f64>,
    /// How far from its centroid a particle of each is at most.
    pub reach: Vec<f64>,
    /// Where the points of each begin in the next finer level, and the end; empty for particles.
    pub starts: Vec<u32>,
}

impl Level {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    fn of(members: Members) -> Level {
        let Members { places, mass, diameters, reach, .. } = members;
        Level { places, mass, diameters, reach, starts: Vec::new() }
    }

    /// The same points in another order.
    fn ordered(self, order: &[u32]) -> Level {
        // Column by column, so that no more than one of them is there twice.
        Level {
            places: ordered(self.places, order),
            mass: ordered(self.mass, order),
            diameters: ordered(self.diameters, order),
            reach: ordered(self.reach, order),
            starts: self.starts,
        }
    }
}

fn ordered<T: Copy>(values: Vec<T>, order: &[u32]) -> Vec<T> {
    order.iter().map(|&i| values[i as usize]).collect()
}

/// How levels are made.
#[derive(Clone, Copy, Debug)]
pub struct LevelOptions {
    /// Mean number of points that a cluster has in the next finer level.
    pub cluster_size: f64,
    /// Levels at most, the particles' own among them.
    pub most: usize,
    /// How equation 2 is read.
    pub rule: DiameterRule,
}

impl Default for LevelOptions {
    /// 5 points in each and 6 levels, as the paper has of 16.8 million particles.
    fn default() -> LevelOptions {
        LevelOptions { cluster_size: 5.0, most: 6, rule: DiameterRule::default() }
    }
}

/// The particles of all families as members.
pub fn members(dataset: &Dataset) -> Members {
    let variance = dataset.kernel.variance();
    let mut members = Members::default();
    for family in &dataset.families {
        for (i, place) in family.positions.iter().enumerate() {
            let h = f64::from(family.smoothing_length[i]);
            members.push_particle(*place, f64::from(family.mass[i]), 1.0, (h, variance * h * h));
        }
    }
    members
}

/// The levels over particles, the coarsest first. Every level has its points by cluster, clusters of a common ancestor together, so that
/// the points of all descendants of a cluster lie in one run of each finer level.
pub fn levels(particles: Members, options: &LevelOptions) -> Vec<Level> {
    let mut finer = particles;
    let mut below = Vec::new();
    while below.len() + 1 < options.most && finer.len() as f64 > options.cluster_size * options.cluster_size {
        let most = (finer.len() as f64 / options.cluster_size).ceil() as usize;
        let splitting = split(&finer, SplitRule::Distortion, most);
        if splitting.len() == finer.len() {
            break;
        }
        let mut coarser = finer.merged(&splitting, &[]);
        if options.rule != DiameterRule::default() {
            coarser.diameters = finer.published_diameters(&splitting, &coarser, options.rule);
        }
        below.push((Level::of(finer), splitting));
        finer = coarser;
    }
    let mut order: Vec<u32> = (0..finer.len() as u32).collect();
    let mut levels = vec![Level::of(finer)];
    for (level, splitting) in below.into_iter().rev() {
        let groups: Vec<&[u32]> = splitting.groups().collect();
        let mut starts = Vec::with_capacity(order.len() + 1);
        let mut members = Vec::with_capacity(level.len());
        for &cluster in &order {
            starts.push(members.len() as u32);
            members.extend_from_slice(groups[cluster as usize]);
        }
        starts.push(members.len() as u32);
        if let Some(coarser) = levels.last_mut() {
            coarser.starts = starts;
        }
        levels.push(level.ordered(&members));
        order = members;
    }
    levels
}
