//! Smoothing lengths and densities of particles that come without them, from their nearest neighbours.

use crate::model::{Bounds, Kernel, Progress};
use glam::{DMat3, DVec3, EulerRot};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZeroUsize;

/// Particles whose neighbours are looked up by one task.
const BLOCK: usize = 1 << 12;

/// Most neighbours that a density sum over a given smoothing length takes; a particle with more of them inside `h` gets the
/// mean density of the sphere that holds this many.
const MOST_NEIGHBOURS: usize = 512;

/// A k-d tree over the distinct places of particles, shifted, turned and scaled to a unit box, so that no squared
/// distance overflows. Particles that share a place are one entry: a k-d tree cannot divide them.
pub(super) struct Neighbours {
    tree: ImmutableKdTree<f64, 3>,
    places: Vec<[f64; 3]>,
    /// Particle numbers, those of one place after each other.
    particles: Vec<u32>,
    /// Where in `particles` the particles of each place begin, and one more entry for the end.
    starts: Vec<u32>,
    /// Places in the order of the tree's leaves: neighbours in it are neighbours in space.
    order: Vec<u32>,
    /// Length of the scaled unit.
    scale: f64,
}

/// What the neighbours of one particle tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Estimate {
    /// Distance to the K-th nearest neighbour, or to the nearest one elsewhere where K share the particle's own place; 1
    /// where all particles of the family share one place. Positive.
    pub smoothing_length: f64,
    /// `sum_j m_j W(r_ij, h_i)` over the particle itself and those neighbours.
    pub density: f64,
}

impl Neighbours {
    /// Builds the tree over finite positions. `None` for none at all, or 2^32 and more.
    pub(super) fn of(positions: &[[f64; 3]]) -> Option<Neighbours> {
        let count = u32::try_from(positions.len()).ok().filter(|count| *count > 0)?;
        let bounds = Bounds::of(positions.iter().copied());
        // Halves first: the difference of two huge coordinates may overflow, that of their halves cannot.
        let extent = (0.5 * bounds.max - 0.5 * bounds.min).max_element() * 2.0;
        let scale = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
        let center = 0.5 * bounds.min + 0.5 * bounds.max;
        // Turned, so that lines, planes and lattices along the axes are along none of them: the tree divides one axis after
        // the other, and cannot where all coordinates are the same. Adding 0 makes -0 and 0 one place.
        let turn = DMat3::from_euler(EulerRot::XYZ, 0.7, 1.1, 0.4);
        let place = |at: &[f64; 3]| (turn * ((DVec3::from_array(*at) - center) / scale) + DVec3::ZERO).to_array();
        let scaled: Vec<[f64; 3]> = positions.par_iter().map(place).collect();
        let mut particles: Vec<u32> = (0..count).collect();
        let at = |particle: &u32| scaled[*particle as usize].map(f64::to_bits);
        particles.par_sort_unstable_by_key(|particle| (at(particle), *particle));
        let mut places = Vec::with_capacity(positions.len());
        let mut starts = Vec::with_capacity(positions.len() + 1);
        for (index, particle) in particles.iter().enumerate() {
            if index == 0 || at(particle) != at(&particles[index - 1]) {
                places.push(scaled[*particle as usize]);
                starts.push(index as u32);
            }
        }
        starts.push(count);
        let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&places).ok()?;
        let order = tree.iter().map(|(item, _)| item).collect();
        Some(Neighbours { tree, places, particles, starts, order, scale })
    }

    /// The particles at a place.
    fn at(&self, place: u32) -> &[u32] {
        &self.particles[self.starts[place as usize] as usize..self.starts[place as usize + 1] as usize]
    }

    /// Mass of the particles at each place.
    fn masses(&self, mass: &[f32]) -> Vec<f64> {
        let places = (0..self.places.len() as u32).into_par_iter();
        places.map(|place| self.at(place).iter().map(|particle| mass[*particle as usize] as f64).sum()).collect()
    }

    /// For every particle the distance to its `k`-th nearest neighbour and the density that follows (the particle counts as
    /// its own neighbour in the density, not in `k`). `mass` has one entry per particle.
    pub(super) fn estimate(&self, k: usize, mass: &[f32], progress: &dyn Progress) -> Vec<Estimate> {
        let masses = self.masses(mass);
        let wanted = NonZeroUsize::MIN.saturating_add(k.clamp(1, self.places.len().max(2) - 1));
        self.for_each_place(progress, |place, out: &mut Vec<Estimate>| {
            let near =
                self.tree.query(&self.places[place as usize]).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
            // All particles of a place have the same neighbours: themselves, and then place after place.
            let mut counted = 0;
            let last = near.iter().find(|other| {
                counted += self.at(other.item).len();
                counted > k && other.item != place
            });
            let h = last.or(near.last()).map_or(0.0, |last| last.distance.sqrt());
            let h = if h > 0.0 { h } else { 1.0 / self.scale };
            let sum: f64 = near.iter().map(|other| masses[other.item as usize] * weight(other.distance, h)).sum();
            let smoothing_length = h * self.scale;
            let estimate = Estimate { smoothing_length, density: sum / smoothing_length.powi(3) };
            out.extend(self.at(place).iter().map(|_| estimate));
        })
    }

    /// For every particle `sum_j m_j W(r_ij, h_i)` with its given `h`.
    pub(super) fn density(&self, h: &[f32], mass: &[f32], progress: &dyn Progress) -> Vec<f64> {
        let masses = self.masses(mass);
        let most = NonZeroUsize::MIN.saturating_add(MOST_NEIGHBOURS - 1);
        let density = |place: u32, support: f64| {
            let scaled = support / self.scale;
            let query = self.tree.query(&self.places[place as usize]).nearest_n::<SquaredEuclidean<f64>>(most);
            let near = query.within(scaled * scaled).execute();
            if near.len() == MOST_NEIGHBOURS {
                let radius = near.last().map_or(0.0, |last| last.distance.sqrt()) * self.scale;
                let inside: f64 = near.iter().map(|other| masses[other.item as usize]).sum();
                return inside / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
            }
            let sum: f64 = near.iter().map(|other| masses[other.item as usize] * weight(other.distance, scaled)).sum();
            sum / support.powi(3)
        };
        self.for_each_place(progress, |place, out: &mut Vec<f64>| {
            let mut known = (f64::NAN, 0.0);
            for particle in self.at(place) {
                let support = h[*particle as usize] as f64;
                if support != known.0 {
                    known = (support, density(place, support));
                }
                out.push(known.1);
            }
        })
    }

    /// Calls `work` for every place, neighbours in space after each other; it appends a result for each particle of the place.
    /// Returns the results by particle.
    fn for_each_place<T: Send + Copy + Default>(
        &self,
        progress: &dyn Progress,
        work: impl Fn(u32, &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        let blocks: Vec<Vec<T>> = self
            .order
            .par_chunks(BLOCK)
            .map(|block| {
                let mut results = Vec::with_capacity(block.len());
                block.iter().for_each(|place| work(*place, &mut results));
                progress.advance(results.len() as u64);
                results
            })
            .collect();
        let mut all = vec![T::default(); self.particles.len()];
        let particles = self.order.iter().flat_map(|place| self.at(*place));
        for (particle, result) in particles.zip(blocks.into_iter().flatten()) {
            all[*particle as usize] = result;
        }
        all
    }
}

/// `h^3 W` of the cubic spline at a squared distance.
fn weight(squared: f64, h: f64) -> f64 {
    Kernel::CubicSpline.value(squared.sqrt() / h)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{LoadOptions, load};
    use proptest::prelude::*;
    use std::path::Path;

    fn brute_force(positions: &[[f64; 3]], index: usize, k: usize) -> f64 {
        let square = |at: &[f64; 3]| (0..3).map(|axis| (at[axis] - positions[index][axis]).powi(2)).sum::<f64>();
        let mut distances: Vec<f64> = positions.iter().map(|at| square(at).sqrt()).collect();
        distances.sort_by(f64::total_cmp);
        distances[k.min(positions.len() - 1)..].iter().copied().find(|distance| *distance > 0.0).unwrap_or(1.0)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Random places, some of which many particles share, near the origin or far away, small or large.
        #[test]
        fn estimates_agree_with_a_search_of_all_pairs(
            grid in prop::collection::vec(prop::array::uniform3(0..9i32), 1..200), k in 1..40usize,
            offset in -1e6..1e6f64, scale in prop_oneof![Just(1e-9), Just(1.0), Just(1e9)],
        ) {
            let place = |at: &[i32; 3]| at.map(|x| (x as f64 + offset) * scale);
            let positions: Vec<[f64; 3]> = grid.iter().map(place).collect();
            let mass: Vec<f32> = (0..positions.len()).map(|index| 1.0 + (index % 3) as f32).collect();
            let tree = Neighbours::of(&positions).unwrap();
            let estimates = tree.estimate(k, &mass, &());
            for (index, estimate) in estimates.iter().enumerate() {
                let h = brute_force(&positions, index, k);
                prop_assert!((estimate.smoothing_length - h).abs() <= 1e-9 * scale, "{} {}", estimate.smoothing_length, h);
            }
            let lengths: Vec<f32> = estimates.iter().map(|estimate| estimate.smoothing_length as f32).collect();
            prop_assume!(positions.len() < MOST_NEIGHBOURS);
            for (index, density) in tree.density(&lengths, &mass, &()).iter().enumerate() {
                let h = lengths[index] as f64;
                prop_assume!(h > 0.0);
                let sum: f64 = positions.iter().zip(&mass).map(|(at, mass)| {
                    let r = (0..3).map(|axis| (at[axis] - positions[index][axis]).powi(2)).sum::<f64>().sqrt();
                    *mass as f64 * Kernel::CubicSpline.value(r / h)
                }).sum();
                prop_assert!((density * h.powi(3) / sum - 1.0).abs() < 1e-4, "{} {}", density, sum / h.powi(3));
            }
        }
    }

    /// Gadget writes `sum_j m_j W(r_ij, h_i)` itself.
    #[test]
    fn densities_agree_with_those_of_the_simulation() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gas_sphere_collapse_025.hdf5");
        let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
        let gas = &loaded.families[0];
        let tree = Neighbours::of(&gas.positions).unwrap();
        let density = tree.density(&gas.smoothing_length, &gas.mass, &());
        for (own, written) in density.iter().zip(&gas.density) {
            assert!((own / *written as f64 - 1.0).abs() < 2e-6, "{own} {written}");
        }
    }

    #[test]
    fn particles_in_one_place_reach_to_the_next_place() {
        let mut positions = vec![[1.0, 2.0, 3.0]; 5000];
        positions.extend([[1.0, 2.0, 4.0], [1.0, 2.0, 6.0]]);
        let tree = Neighbours::of(&positions).unwrap();
        let estimates = tree.estimate(32, &vec![1.0; positions.len()], &());
        let lengths: Vec<f64> = [0, 4999, 5000, 5001].map(|index: usize| estimates[index].smoothing_length).to_vec();
        assert_eq!(lengths, [1.0, 1.0, 1.0, 3.0]);
        let center = Kernel::CubicSpline.value(0.0) * 5000.0;
        assert!((estimates[0].density / center - 1.0).abs() < 1e-12);
        let tree = Neighbours::of(&positions[..5000]).unwrap();
        assert_eq!(tree.estimate(32, &vec![1.0; 5000], &())[7].smoothing_length, 1.0);
        assert!(Neighbours::of(&[]).is_none());
    }
}
