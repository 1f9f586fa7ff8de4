//! Binary splits of a set of members, one after the other, in an order in which they can be undone.

use super::members::{Members, trace};
use crate::codec::principal_component;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Which cluster is split next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitRule {
    /// The largest `m (v + s^2 - g) / (v + s^2)`, with mass `m`, the members' spread `s^2`, the mean `v` of their variances and the geometric
    /// mean `g` of those of the source particles' kernels, all summed over the axes: what of the mass is where no particle is, by the same
    /// measure at every level; and of clusters that are alike in this the one that is brightest in a picture, by the power [`BRIGHT`] of
    /// `m / (v + s^2)`. Where members differ more in their variances than in their places, small ones are parted from
    /// large ones. Means are weighted with mass.
    #[default]
    Relative,
    /// The largest distortion, the sum of squared distances from the centroid (HE03 section 4); every member counts the same.
    Distortion,
}

/// How members were split.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splitting {
    /// Members by cluster, clusters of a common ancestor together.
    pub order: Vec<u32>,
    /// Where each cluster begins in it.
    pub starts: Vec<u32>,
    /// For each cluster but the first the number of the split, from 1, that parted it from the one before it.
    pub ranks: Vec<u32>,
    /// Priority of each split, the first one first, and of the one that would have come next; never rising.
    pub priorities: Vec<f64>,
    /// `v + s^2` of the cluster that each of them splits: what its shape is as large as, squared.
    pub scales: Vec<f64>,
}

impl Splitting {
    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// The members of each cluster.
    pub fn groups(&self) -> impl Iterator<Item = &[u32]> {
        let ends = self.starts.iter().skip(1).copied().chain([self.order.len() as u32]);
        self.starts.iter().zip(ends).map(|(&start, end)| &self.order[start as usize..end as usize])
    }
}

/// A cluster that may be split.
#[derive(Clone, Copy, Debug)]
struct Part {
    start: u32,
    end: u32,
    centre: [f64; 3],
    axis: [f64; 3],
    /// The logarithm of variances that parts small kernels from large ones, where these are split.
    between: Option<f64>,
    priority: f64,
    scale: f64,
}

impl PartialEq for Part {
    fn eq(&self, other: &Part) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Part) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    /// By priority; of equals the one that comes first in the order is the larger.
    fn cmp(&self, other: &Part) -> Ordering {
        self.priority.total_cmp(&other.priority).then(other.start.cmp(&self.start))
    }
}

/// The power of the column density that a priority rises with: 0 is best for the mean error of a picture (L1) and 1 for its mean square.
/// A tenth costs nothing of the first and gains much of the second, and what is brightest is where the eye looks.
pub const BRIGHT: f64 = 0.1;

/// What a priority is multiplied with for a mass on an area, of which each may be in any unit.
pub fn bright(mass: f64, area: f64) -> f64 {
    (mass / area).powf(BRIGHT)
}

/// Kernels are alike up to this difference of the logarithms of their means: rounding, and what nobody sees.
const UNLIKE: f64 = 1e-6;
/// How much more unlike kernels count than places apart when it is decided what a cluster is split by: kernels differ along three axes,
/// places mostly along one. Measured on filaments and on simulations (`docs/results.md`).
const KERNELS: f64 = 3.0;

/// Of a member: the sum of its variances along the axes, its logarithm, and the mean logarithm of that of the particles in it.
#[derive(Clone, Copy, Debug)]
struct Own {
    variance: f64,
    log_variance: f64,
    log_kernel: f64,
}

impl Own {
    fn of(members: &Members, i: usize) -> Own {
        let variance = trace(&members.moments[i]);
        // Kernels are round: their determinant is the cube of a third of the sum.
        Own { variance, log_variance: variance.ln(), log_kernel: members.log_volume[i] / 3.0 + 3.0_f64.ln() }
    }
}

/// Sums over members, relative to an origin.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weight: f64,
    along: [f64; 3],
    squares: [f64; 6],
    variance: f64,
    log_variance: f64,
    log_kernel: f64,
}

impl Sums {
    #[inline]
    fn add(&mut self, w: f64, d: [f64; 3], own: Own) {
        self.weight += w;
        self.variance += w * own.variance;
        self.log_variance += w * own.log_variance;
        self.log_kernel += w * own.log_kernel;
        let wd = d.map(|d| w * d);
        (0..3).for_each(|k| self.along[k] += wd[k]);
        self.squares[0] += wd[0] * d[0];
        self.squares[1] += wd[1] * d[1];
        self.squares[2] += wd[2] * d[2];
        self.squares[3] += wd[0] * d[1];
        self.squares[4] += wd[0] * d[2];
        self.squares[5] += wd[1] * d[2];
    }

    /// The members from `start` to `end`, which were summed around `origin`.
    fn part(&self, origin: [f64; 3], start: usize, end: usize, rule: SplitRule) -> Part {
        let mean = self.along.map(|sum| sum / self.weight);
        let squares = self.squares.map(|sum| sum / self.weight);
        let [xx, yy, zz, xy, xz, yz] = squares;
        let [x, y, z] = mean;
        let covariance = [
            [xx - x * x, xy - x * y, xz - x * z],
            [xy - x * y, yy - y * y, yz - y * z],
            [xz - x * z, yz - y * z, zz - z * z],
        ];
        let spread = (0..3).map(|k| covariance[k][k].max(0.0)).sum::<f64>();
        let variance = self.variance / self.weight;
        // What rounding leaves of coincident members is no spread.
        let is_one = end - start < 2 || spread <= 1e-13 * (x * x + y * y + z * z);
        let log_variance = self.log_variance / self.weight;
        // How much larger the mean of the kernels is than their geometric mean, and they are with their spread than without.
        let (unlike, apart) = ((variance.ln() - log_variance).max(0.0), (spread / variance).ln_1p());
        let matters = is_one || KERNELS * unlike > apart;
        let by_kernel = rule == SplitRule::Relative && end - start > 1 && unlike > UNLIKE && matters;
        let priority = match rule {
            SplitRule::Relative if by_kernel || !is_one => {
                let kernel = (self.log_kernel / self.weight - (variance + spread).ln()).min(0.0);
                -self.weight * kernel.exp_m1() * bright(self.weight, variance + spread)
            }
            SplitRule::Distortion if !is_one => self.weight * spread,
            _ => 0.0,
        };
        Part {
            start: start as u32,
            end: end as u32,
            centre: std::array::from_fn(|k| origin[k] + mean[k]),
            axis: principal_component(&covariance, spread).map(f64::from),
            between: by_kernel.then_some(log_variance),
            priority: if priority.is_finite() { priority } else { 0.0 },
            scale: variance + spread,
        }
    }
}

/// Splits members into `most` clusters, or fewer where that leaves only coincident ones together.
pub fn split(members: &Members, rule: SplitRule, most: usize) -> Splitting {
    let count = members.len();
    let mut order: Vec<u32> = (0..count as u32).collect();
    if count == 0 {
        return Splitting::default();
    }
    let weight = |i: usize| match rule {
        SplitRule::Relative => members.mass[i],
        SplitRule::Distortion => 1.0,
    };
    let own: Vec<Own> = (0..count).map(|i| Own::of(members, i)).collect();
    let origin = members.places[0];
    let mut sums = Sums::default();
    let away = |i: usize, from: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| members.places[i][k] - from[k]) };
    (0..count).for_each(|i| sums.add(weight(i), away(i, origin), own[i]));
    // Once more around the centroid, which the first member may be far away from.
    let middle = sums.part(origin, 0, count, rule).centre;
    let mut sums = Sums::default();
    (0..count).for_each(|i| sums.add(weight(i), away(i, middle), own[i]));
    let mut heap = BinaryHeap::from([sums.part(middle, 0, count, rule)]);
    // Number of the split whose second part begins at a place of the order; 0 where none does.
    let mut parted = vec![0_u32; count];
    let (mut priorities, mut scales) = (Vec::new(), Vec::new());
    let mut least = f64::INFINITY;
    let mut aside = Vec::with_capacity(count);
    let mut clusters = 1;
    while let Some(part) = heap.peek().copied() {
        least = least.min(part.priority);
        if clusters >= most || part.priority <= 0.0 {
            break;
        }
        heap.pop();
        let (start, end) = (part.start as usize, part.end as usize);
        let (mut low, mut high) = (Sums::default(), Sums::default());
        aside.clear();
        let mut at = start;
        for k in start..end {
            let member = order[k];
            let i = member as usize;
            let d = away(i, part.centre);
            let side = match part.between {
                Some(log_variance) => own[i].log_variance - log_variance,
                None => d[0] * part.axis[0] + d[1] * part.axis[1] + d[2] * part.axis[2],
            };
            if side >= 0.0 {
                high.add(weight(i), d, own[i]);
                aside.push(member);
            } else {
                low.add(weight(i), d, own[i]);
                order[at] = member;
                at += 1;
            }
        }
        order[at..end].copy_from_slice(&aside);
        if at == start || at == end {
            // All on one side: they coincide along the axis.
            heap.push(Part { priority: 0.0, ..part });
            continue;
        }
        priorities.push(least);
        scales.push(part.scale);
        parted[at] = clusters as u32;
        clusters += 1;
        heap.push(low.part(part.centre, start, at, rule));
        heap.push(high.part(part.centre, at, end, rule));
    }
    let next = heap.peek();
    priorities.push(next.map_or(0.0, |part| part.priority.min(least)));
    scales.push(next.map_or(0.0, |part| part.scale));
    let begins: Vec<usize> = (1..count).filter(|&at| parted[at] > 0).collect();
    Splitting {
        order,
        starts: std::iter::once(0).chain(begins.iter().map(|&at| at as u32)).collect(),
        ranks: begins.iter().map(|&at| parted[at]).collect(),
        priorities,
        scales,
    }
}
