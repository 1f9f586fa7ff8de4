//! What a part of a node's clusters is worth: a table by the number that is drawn.

use super::members::{Members, trace};
use super::split::Splitting;

/// What is known of a node that is drawn with the clusters of its first splits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    /// Clusters that are drawn.
    pub clusters: u32,
    /// Priority of the split that would come next ([`super::SplitRule`]); of all clusters that from which on the children take their place
    /// ([`take_over`]).
    pub priority: f64,
    /// `v + s^2` of the cluster that it splits, squared lengths.
    pub scale: f64,
    /// Sum of the clusters' masses times their misfit ([`super::members::misfit`]).
    pub misfit: f64,
    /// The largest sum of variances along the three axes of any cluster, squared lengths.
    pub largest: f64,
}

/// The steps of a node's clusters: of 1, 2, 4, ... of them, and of all.
pub fn steps(clusters: &Members, splitting: &Splitting) -> Vec<Step> {
    let all = clusters.len() as u32;
    let mut steps = Vec::new();
    let mut count = 1;
    loop {
        let count_now = count.min(all);
        let (mut misfit, mut largest) = (0.0, 0.0_f64);
        for group in parts(&splitting.ranks, count_now) {
            let sum = clusters.sum(group);
            misfit += sum.mass * sum.misfit();
            largest = largest.max(trace(&sum.moments));
        }
        let at = (count_now as usize - 1).min(splitting.priorities.len().saturating_sub(1));
        let (priority, scale) = (splitting.priorities[at], splitting.scales[at]);
        steps.push(Step { clusters: count_now, priority, scale, misfit, largest });
        if count_now == all {
            return steps;
        }
        count *= 2;
    }
}

/// How many clusters are worth as much as a threshold, where `worth` tells what the split after each step is; between steps by powers.
pub fn count_at(steps: &[Step], threshold: f64, worth: impl Fn(&Step) -> f64) -> f64 {
    let Some(first) = steps.first() else { return 0.0 };
    let mut before = (f64::from(first.clusters), worth(first));
    if before.1 < threshold {
        return before.0;
    }
    for step in &steps[1..] {
        let now = (f64::from(step.clusters), worth(step).min(before.1));
        if now.1 < threshold {
            let along = (before.1 - threshold) / (before.1 - now.1);
            return before.0 * (now.0 / before.0).powf(along);
        }
        before = now;
    }
    before.0
}

/// By how much more clusters than a node's own its children may have when they take its place.
const MORE: f64 = 1.25;
/// Steps of a threshold to a factor of 2.
const FINELY: f64 = 4.0;

/// The priority from which on a node's children take its place: the smallest at which they have hardly more clusters than itself, so that
/// the number changes smoothly as priorities fall. Where they always have more, that of its own next split.
pub fn take_over(own: &[Step], children: &[Vec<Step>]) -> f64 {
    let worth = |step: &Step| step.priority.max(f64::MIN_POSITIVE).log2();
    let (Some(first), Some(last)) = (own.first(), own.last()) else { return 0.0 };
    let (high, low) = (worth(first), worth(last));
    let mut threshold = if last.priority > 0.0 { low } else { high - 40.0 };
    while threshold < high {
        let count: f64 = children.iter().map(|steps| count_at(steps, threshold, worth)).sum();
        if count <= MORE * count_at(own, threshold, worth) {
            return threshold.exp2();
        }
        threshold += 1.0 / FINELY;
    }
    last.priority
}

/// The runs of clusters that the first splits leave together, where `count` clusters are drawn: those with ranks of `count` and more are
/// undone.
pub fn parts(ranks: &[u32], count: u32) -> impl Iterator<Item = std::ops::Range<u32>> {
    runs(ranks, move |rank| *rank < count).map(|run| run.start as u32..run.end as u32)
}

/// The runs that are left between those of the splits that are kept; `splits` has one less than there are clusters.
pub fn runs<T>(splits: &[T], keeps: impl Fn(&T) -> bool) -> impl Iterator<Item = std::ops::Range<usize>> {
    let all = splits.len() + 1;
    let begins = (1..all).zip(splits).filter(move |(_, split)| keeps(split)).map(|(at, _)| at);
    let mut from = 0;
    begins.chain([all]).map(move |to| std::mem::replace(&mut from, to)..to)
}
