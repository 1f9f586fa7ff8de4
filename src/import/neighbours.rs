//! Smoothing lengths and densities of particles that come without them, from their nearest neighbours.

use crate::model::{Bounds, Kernel, Progress};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZeroUsize;

/// Particles whose neighbours are looked up by one task.
const BLOCK: usize = 1 << 12;

/// Most neighbours that a density sum over a given smoothing length takes; a particle with more of them inside `h` gets the
/// mean density of the sphere that holds this many.
const MOST_NEIGHBOURS: usize = 512;

/// A k-d tree over positions that are shifted and scaled to a unit box, so that no squared distance overflows.
pub(super) struct Neighbours {
    tree: ImmutableKdTree<f64, 3>,
    positions: Vec<[f64; 3]>,
    /// Particles in the order of the tree's leaves: neighbours in it are neighbours in space.
    order: Vec<u32>,
    /// Length of the scaled unit.
    scale: f64,
}

/// What the neighbours of one particle tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Estimate {
    /// Distance to the K-th nearest neighbour; 0 where so many particles share the place.
    pub smoothing_length: f64,
    /// `sum_j m_j W(r_ij, h_i)` over the particle itself and those neighbours.
    pub density: f64,
}

impl Neighbours {
    /// Builds the tree over finite positions. `None` for none at all, or more than 2^32.
    pub(super) fn of(positions: &[[f64; 3]]) -> Option<Neighbours> {
        let bounds = Bounds::of(positions.iter().copied());
        // Halves first: the difference of two huge coordinates may overflow, that of their halves cannot.
        let extent = (0.5 * bounds.max - 0.5 * bounds.min).max_element() * 2.0;
        let scale = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
        let center = 0.5 * bounds.min + 0.5 * bounds.max;
        let place = |at: &[f64; 3]| std::array::from_fn(|axis| (at[axis] - center[axis]) / scale);
        let positions: Vec<[f64; 3]> = positions.par_iter().map(place).collect();
        let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&positions).ok()?;
        let order = tree.iter().map(|(item, _)| item).collect();
        Some(Neighbours { tree, positions, order, scale })
    }

    /// For every particle the distance to its `k`-th nearest neighbour and the density that follows (the particle counts as
    /// its own neighbour in the density, not in `k`). `mass` has one entry per particle.
    pub(super) fn estimate(&self, k: usize, mass: &[f32], progress: &dyn Progress) -> Vec<Estimate> {
        let wanted = NonZeroUsize::MIN.saturating_add(k.min(self.positions.len().saturating_sub(1)));
        self.for_each(progress, |index| {
            let near = self.tree.query(&self.positions[index]).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
            let h = near.last().map_or(0.0, |last| last.distance.sqrt());
            let sum: f64 = near.iter().map(|n| mass[n.item as usize] as f64 * weight(n.distance, h)).sum();
            let smoothing_length = h * self.scale;
            Estimate { smoothing_length, density: sum / smoothing_length.powi(3) }
        })
    }

    /// For every particle `sum_j m_j W(r_ij, h_i)` with its given `h`.
    pub(super) fn density(&self, h: &[f32], mass: &[f32], progress: &dyn Progress) -> Vec<f64> {
        let most = NonZeroUsize::MIN.saturating_add(MOST_NEIGHBOURS - 1);
        self.for_each(progress, |index| {
            let support = h[index] as f64;
            let scaled = support / self.scale;
            let query = self.tree.query(&self.positions[index]).nearest_n::<SquaredEuclidean<f64>>(most);
            let near = query.within(scaled * scaled).execute();
            if near.len() == MOST_NEIGHBOURS {
                let radius = near.last().map_or(0.0, |last| last.distance.sqrt()) * self.scale;
                let inside: f64 = near.iter().map(|n| mass[n.item as usize] as f64).sum();
                return inside / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
            }
            let sum: f64 = near.iter().map(|n| mass[n.item as usize] as f64 * weight(n.distance, scaled)).sum();
            sum / support.powi(3)
        })
    }

    /// Calls `work` for every particle, neighbours in space after each other, and returns the results by particle.
    fn for_each<T: Send + Copy + Default>(&self, progress: &dyn Progress, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
        let blocks: Vec<Vec<T>> = self
            .order
            .par_chunks(BLOCK)
            .map(|block| {
                let results = block.iter().map(|&index| work(index as usize)).collect();
                progress.advance(block.len() as u64);
                results
            })
            .collect();
        let mut results = vec![T::default(); self.order.len()];
        for (&index, result) in self.order.iter().zip(blocks.into_iter().flatten()) {
            results[index as usize] = result;
        }
        results
    }
}

/// `h^3 W` of the cubic spline at a squared distance.
fn weight(squared: f64, h: f64) -> f64 {
    Kernel::CubicSpline.value(if h > 0.0 { squared.sqrt() / h } else { 0.0 })
}
