//! Smoothing lengths and densities of particles that come without them, from their nearest neighbours; and how neighbours move.
//!
//! In a periodic box neighbours are the nearest images of particles: places are searched around the images of a particle's own.

mod group;
mod motion;
mod tree;

use crate::model::periodic::images;
use crate::model::{Bounds, Progress};
use glam::DVec3;
use group::Group;
pub(crate) use motion::{LocalMotion, Moving};
use rayon::prelude::*;
use std::f64::consts::PI;
use tree::{Item, LEAF, Near, Tree, farthest_last, keep_nearest};

/// Leaves whose particles' neighbours are looked up by one task.
const BLOCK: usize = 1 << 8;

/// Most neighbours that a density sum over a given smoothing length takes; a particle with more of them inside `h` gets the
/// mean density of the sphere that holds this many.
const MOST_NEIGHBOURS: usize = 512;

/// Leaves at most whose entries have one place in a periodic box: those at its corners.
const LEAVES_OF_A_PLACE: usize = 8;

/// A k-d tree over the places of particles, in units of about the size of the box around them, so that no squared distance
/// overflows.
pub(crate) struct Neighbours {
    tree: Tree,
    /// Length of the scaled unit.
    scale: f64,
    /// By how much the images of places lie beside them, scaled, themselves first: [`images`].
    images: Vec<DVec3>,
}

/// Memory for the entries near a place.
#[derive(Default)]
struct Around {
    /// Those near one image of it.
    of_image: Vec<Near>,
    all: Vec<Near>,
}

/// What the neighbours of one particle tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Estimate {
    /// Distance to the K-th nearest neighbour, or to the nearest one elsewhere where K share the particle's own place; 1
    /// where all particles of the family share one place. Positive.
    pub smoothing_length: f64,
    /// `sum_j m_j W(r_ij, h_i)` over the particle itself and those neighbours.
    pub density: f64,
}

impl Neighbours {
    /// Builds the tree over finite positions, which lie in a periodic box of that edge, or a little beside, if there is one. `None` for none
    /// at all, or 2^32 and more.
    pub(crate) fn of(positions: &[[f64; 3]], edge: Option<f64>, progress: &dyn Progress) -> Option<Neighbours> {
        u32::try_from(positions.len()).ok().filter(|count| *count > 0)?;
        let bounds = Bounds::of(positions.iter().copied());
        // Halves first: the difference of two huge coordinates may overflow, that of their halves cannot.
        let half = (0.5 * bounds.max - 0.5 * bounds.min).max_element();
        // A power of two, and no shift: no two places become one.
        let scale = if half > 0.0 { half.log2().ceil().clamp(-1022.0, 1023.0).exp2() } else { 1.0 };
        // Adding 0 makes -0 and 0 one place.
        let place = |at: &[f64; 3]| (DVec3::from_array(*at) / scale + DVec3::ZERO).to_array();
        let item = |(particle, at)| Item { at: place(at), particle: particle as u32 };
        let items: Vec<Item> = positions.par_iter().enumerate().map(item).collect();
        Some(Neighbours { tree: Tree::of(items, progress), scale, images: images(edge.map(|edge| edge / scale)) })
    }

    /// Calls `each` with the images of a place that entries may be near, and the `wanted` nearest entries of each, in any order, among those
    /// whose squared distance is at most `most`.
    fn around_images(
        &self,
        at: DVec3,
        wanted: usize,
        most: f64,
        near: &mut Vec<Near>,
        mut each: impl FnMut(DVec3, &[Near]),
    ) {
        // No place is infinitely far away but an image whose coordinates overflow.
        let most = most.min(f64::MAX);
        for place in self.images.iter().map(|image| at + *image) {
            if self.tree.nodes[0].bounds.distance(place) <= most {
                self.tree.nearest(place, wanted, most, near);
                each(place, near);
            }
        }
    }

    /// Brings the `wanted` entries nearest to a place into `around.all`, in any order, each once and by its nearest image, among those whose
    /// squared distance is at most `most`.
    fn nearest(&self, at: DVec3, wanted: usize, most: f64, around: &mut Around) {
        let Around { of_image, all } = around;
        all.clear();
        let mut met = 0;
        self.around_images(at, wanted, most, of_image, |_, near| {
            met += usize::from(!near.is_empty());
            all.extend_from_slice(near);
        });
        if met > 1 {
            all.sort_unstable_by(|a, b| a.entry.cmp(&b.entry).then_with(|| a.squared.total_cmp(&b.squared)));
            all.dedup_by_key(|near| near.entry);
        }
        if all.len() > wanted {
            keep_nearest(all, wanted);
        }
    }

    /// The entries nearest to one by their nearest images, the farthest last, as many as `near`: those that are nearest without images.
    fn by_images<'a>(&self, entry: u32, near: &'a [Near], around: &'a mut Around) -> &'a [Near] {
        let (at, bounds) = (self.tree.at[entry as usize], &self.tree.nodes[0].bounds);
        let most = near.last().map_or(0.0, |last| last.squared);
        if self.images.iter().skip(1).all(|image| bounds.distance(at + *image) > most) {
            return near;
        }
        self.nearest(at, near.len(), most, around);
        farthest_last(&mut around.all);
        &around.all
    }

    /// Mass of the particles of each entry of the tree.
    fn masses(&self, mass: &[f32]) -> Vec<f64> {
        let entries = (0..self.tree.at.len() as u32).into_par_iter();
        let mass = |particle: &u32| mass[*particle as usize] as f64;
        entries.map(|entry| self.tree.particles_of(entry).iter().map(mass).sum()).collect()
    }

    /// For every particle the distance to its `k`-th nearest neighbour and the density that follows (the particle counts as
    /// its own neighbour in the density, not in `k`). `mass` has one entry per particle, and so has `wanted_particles`: where it is false,
    /// the result may be anything.
    pub(crate) fn estimate(
        &self,
        k: usize,
        mass: &[f32],
        wanted_particles: Option<&[bool]>,
        progress: &dyn Progress,
    ) -> Vec<Estimate> {
        let masses = self.masses(mass);
        let entries = self.tree.at.len();
        let wanted = k.clamp(1, entries.max(2) - 1).saturating_add(1).min(entries);
        self.for_each_leaf(wanted_particles, progress, |group, leaf, out: &mut Vec<Estimate>| {
            // The entries of a leaf come in any order.
            let node = self.tree.nodes[self.tree.leaves[leaf as usize] as usize];
            let [first, end] = [node.start, node.end].map(|entry| self.tree.starts[entry as usize] as usize);
            let base = out.len();
            out.resize(base + end - first, Estimate::default());
            let mut around = Around::default();
            group.search(&self.tree, leaf, wanted, |entry, near| {
                let near = self.by_images(entry, near, &mut around);
                let last = near.last().map_or(0.0, |last| last.squared);
                let estimate = if self.are_single(near) && last > 0.0 {
                    self.estimate_from(near, last.sqrt(), &masses)
                } else {
                    self.estimate_among_shared(entry, k, near.to_vec(), &masses)
                };
                let place = base + self.tree.starts[entry as usize] as usize - first;
                out[place..place + self.tree.particles_of(entry).len()].fill(estimate);
            });
        })
    }

    /// Whether each of these entries is one particle.
    fn are_single(&self, near: &[Near]) -> bool {
        self.tree.at.len() == self.tree.particles.len()
            || near.iter().all(|near| self.tree.particles_of(near.entry).len() == 1)
    }

    /// The estimate where several particles share a place: all of a place have the same neighbours, themselves and then
    /// place after place.
    fn estimate_among_shared(&self, entry: u32, k: usize, mut near: Vec<Near>, masses: &[f64]) -> Estimate {
        if near.iter().all(|near| near.squared == 0.0) {
            // A leaf holds all entries of a place, so that one of so many is elsewhere if any is.
            let wanted = near.len() + LEAVES_OF_A_PLACE * LEAF;
            let mut around = Around::default();
            self.nearest(self.tree.at[entry as usize], wanted, f64::INFINITY, &mut around);
            near = around.all;
        }
        near.sort_unstable_by(|a, b| a.squared.total_cmp(&b.squared));
        let mut counted = 0;
        let last = near.iter().find(|other| {
            counted += self.tree.particles_of(other.entry).len();
            counted > k && other.squared > 0.0
        });
        let h = last.or(near.last()).map_or(0.0, |last| last.squared.sqrt());
        self.estimate_from(&near, if h > 0.0 { h } else { 1.0 / self.scale }, masses)
    }

    fn estimate_from(&self, near: &[Near], h: f64, masses: &[f64]) -> Estimate {
        let sum = sum(near, masses, |squared| weight(squared, h));
        let smoothing_length = h * self.scale;
        Estimate { smoothing_length, density: sum / smoothing_length.powi(3) }
    }

    /// For every particle `sum_j m_j W(r_ij, h_i)` with its given `h`; `wanted` as in [`Neighbours::estimate`].
    pub(crate) fn density(
        &self,
        h: &[f32],
        mass: &[f32],
        wanted: Option<&[bool]>,
        progress: &dyn Progress,
    ) -> Vec<f64> {
        let masses = self.masses(mass);
        let density = |entry: u32, support: f64, around: &mut Around| {
            let scaled = support / self.scale;
            self.nearest(self.tree.at[entry as usize], MOST_NEIGHBOURS, scaled * scaled, around);
            let near = &around.all;
            if near.len() == MOST_NEIGHBOURS {
                let radius = near.iter().map(|near| near.squared).fold(0.0, f64::max).sqrt() * self.scale;
                return sum(near, &masses, |_| 1.0) / (4.0 / 3.0 * PI * radius.powi(3));
            }
            sum(near, &masses, |squared| weight(squared, scaled)) / support.powi(3)
        };
        self.for_each_leaf(wanted, progress, |_, leaf, out: &mut Vec<f64>| {
            let mut around = Around::default();
            let node = self.tree.nodes[self.tree.leaves[leaf as usize] as usize];
            for entry in node.start..node.end {
                let mut known = (f64::NAN, 0.0);
                for particle in self.tree.particles_of(entry) {
                    let support = h[*particle as usize] as f64;
                    if support != known.0 {
                        known = (support, density(entry, support, &mut around));
                    }
                    out.push(known.1);
                }
            }
        })
    }

    /// Calls `work` for every leaf, neighbours in space after each other; it appends a result for each particle of the leaf.
    /// Returns the results by particle; leaves without a wanted one are left out.
    fn for_each_leaf<T: Send + Copy + Default>(
        &self,
        wanted: Option<&[bool]>,
        progress: &dyn Progress,
        work: impl Fn(&mut Group, u32, &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        let leaves = self.tree.leaves.len() as u32;
        let starts: Vec<u32> = (0..leaves).step_by(BLOCK).collect();
        let blocks: Vec<Vec<T>> = starts
            .into_par_iter()
            .map_init(Group::default, |group, start| {
                let mut results = Vec::with_capacity(BLOCK * LEAF);
                for leaf in start..leaves.min(start + BLOCK as u32) {
                    let node = self.tree.nodes[self.tree.leaves[leaf as usize] as usize];
                    let [first, end] = [node.start, node.end].map(|entry| self.tree.starts[entry as usize] as usize);
                    let is_wanted = |particle: &u32| wanted.is_none_or(|wanted| wanted[*particle as usize]);
                    if self.tree.particles[first..end].iter().any(is_wanted) {
                        work(group, leaf, &mut results);
                    } else {
                        results.resize(results.len() + end - first, T::default());
                    }
                }
                progress.advance(results.len() as u64);
                results
            })
            .collect();
        let mut all = vec![T::default(); self.tree.particles.len()];
        for (particle, result) in self.tree.particles.iter().zip(blocks.into_iter().flatten()) {
            all[*particle as usize] = result;
        }
        all
    }
}

/// Sum of masses with weights of at most 8, the same to the last bit in whatever order the entries come: it is counted in units
/// of 2^-50 of the largest mass.
#[inline(always)]
fn sum(near: &[Near], masses: &[f64], weight: impl Fn(f64) -> f64) -> f64 {
    const BITS: u64 = 50;
    const BIAS: u64 = 1023;
    let largest = near.iter().map(|other| masses[other.entry as usize]).fold(0.0, f64::max);
    // Masses are sums of singles, so that both powers of two are normal numbers.
    let exponent = largest.to_bits() >> 52;
    if largest <= 0.0 || exponent <= BIAS - 512 || exponent >= BIAS + 512 {
        return 0.0;
    }
    let per_unit = f64::from_bits((2 * BIAS + BITS - exponent) << 52);
    let unit = f64::from_bits((exponent - BITS) << 52);
    let units = |other: &Near| (masses[other.entry as usize] * weight(other.squared) * per_unit) as i64;
    near.iter().map(|other| i128::from(units(other))).sum::<i128>() as f64 * unit
}

/// `h^3 W` of the cubic spline at a squared distance, without a branch.
#[inline(always)]
fn weight(squared: f64, h: f64) -> f64 {
    let q = squared.sqrt() / h;
    let (whole, half) = ((1.0 - q).max(0.0), (0.5 - q).max(0.0));
    16.0 / PI * (whole * whole * whole - 4.0 * half * half * half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{LoadOptions, load};
    use crate::model::Kernel;
    use proptest::prelude::*;
    use std::path::Path;

    /// How far all particles are from one, by their nearest images in a periodic box.
    fn distances(positions: &[[f64; 3]], index: usize, edge: Option<f64>) -> Vec<f64> {
        let distance = |at: &[f64; 3]| {
            let away = DVec3::from_array(*at) - DVec3::from_array(positions[index]);
            edge.map_or(away, |edge| away - edge * (away / edge).round()).length()
        };
        positions.iter().map(distance).collect()
    }

    fn brute_force(positions: &[[f64; 3]], index: usize, k: usize, edge: Option<f64>) -> f64 {
        let mut distances = distances(positions, index, edge);
        distances.sort_by(f64::total_cmp);
        distances[k.min(positions.len() - 1)..].iter().copied().find(|distance| *distance > 0.0).unwrap_or(1.0)
    }

    /// `sum_j m_j W(r_ij, h)`, times `h^3`.
    fn sum_within(positions: &[[f64; 3]], mass: &[f32], index: usize, h: f64, edge: Option<f64>) -> f64 {
        let weight = |(r, mass): (f64, &f32)| f64::from(*mass) * Kernel::CubicSpline.value(r / h);
        distances(positions, index, edge).into_iter().zip(mass).map(weight).sum()
    }

    proptest! {
        #![proptest_config(crate::cases::cases(64))]

        /// Random places, many of them at the faces, edges and corners of a periodic box. It does not matter where its faces are, to the
        /// last bit: places are whole 64ths of its edge. Smoothing lengths of more than half of it are among them.
        #[test]
        fn neighbours_in_a_periodic_box_are_the_nearest_images(
            grid in prop::collection::vec(prop::array::uniform3(prop_oneof![Just(0), Just(64), 0..=64u32]), 1..200),
            k in 1..40usize, shift in prop_oneof![Just([32; 3]), prop::array::uniform3(0..64u32)], support in 0.05..1.2f32,
        ) {
            let edge = Some(1.0);
            let positions: Vec<[f64; 3]> = grid.iter().map(|at| at.map(|x| f64::from(x) / 64.0)).collect();
            let shifted = |at: &[u32; 3]| [0, 1, 2].map(|axis| f64::from((at[axis] + shift[axis]) % 64) / 64.0);
            let moved: Vec<[f64; 3]> = grid.iter().map(shifted).collect();
            let mass: Vec<f32> = (0..positions.len()).map(|index| 1.0 + (index % 3) as f32).collect();
            let tree = Neighbours::of(&positions, edge, &()).unwrap();
            let estimates = tree.estimate(k, &mass, None, &());
            let others = Neighbours::of(&moved, edge, &()).unwrap().estimate(k, &mass, None, &());
            let density = tree.density(&vec![support; positions.len()], &mass, None, &());
            for (index, (own, other)) in estimates.iter().zip(&others).enumerate() {
                let h = brute_force(&positions, index, k, edge);
                prop_assert!((own.smoothing_length / h - 1.0).abs() < 1e-12, "{own:?} {h}");
                prop_assert_eq!(own.smoothing_length, other.smoothing_length);
                for (h, density) in [(h, own.density), (h, other.density), (f64::from(support), density[index])] {
                    let sum = sum_within(&positions, &mass, index, h, edge);
                    prop_assert!((density * h.powi(3) / sum - 1.0).abs() < 1e-6, "{density} {}", sum / h.powi(3));
                }
            }
        }

        /// Random places, some of which many particles share, near the origin or far away, small or large.
        #[test]
        fn estimates_agree_with_a_search_of_all_pairs(
            grid in prop::collection::vec(prop::array::uniform3(0..9i32), 1..200), k in 1..40usize,
            offset in -1e6..1e6f64, scale in prop_oneof![Just(1e-9), Just(1.0), Just(1e9)],
        ) {
            let place = |at: &[i32; 3]| at.map(|x| (x as f64 + offset) * scale);
            let positions: Vec<[f64; 3]> = grid.iter().map(place).collect();
            let mass: Vec<f32> = (0..positions.len()).map(|index| 1.0 + (index % 3) as f32).collect();
            let tree = Neighbours::of(&positions, None, &()).unwrap();
            let estimates = tree.estimate(k, &mass, None, &());
            for (index, estimate) in estimates.iter().enumerate() {
                let h = brute_force(&positions, index, k, None);
                prop_assert!((estimate.smoothing_length - h).abs() <= 1e-9 * scale, "{} {}", estimate.smoothing_length, h);
            }
            let lengths: Vec<f32> = estimates.iter().map(|estimate| estimate.smoothing_length as f32).collect();
            prop_assume!(positions.len() < MOST_NEIGHBOURS);
            for (index, density) in tree.density(&lengths, &mass, None, &()).iter().enumerate() {
                let h = lengths[index] as f64;
                prop_assume!(h > 0.0);
                let sum = sum_within(&positions, &mass, index, h, None);
                prop_assert!((density * h.powi(3) / sum - 1.0).abs() < 1e-4, "{} {}", density, sum / h.powi(3));
            }
        }
    }

    proptest! {
        #![proptest_config(crate::cases::cases(48))]

        /// Clumps of very different sizes, some of them far apart: neither single precision nor the guesses about
        /// neighbouring balls may show.
        #[test]
        fn clumps_of_any_size_agree_with_a_search_of_all_pairs(
            clumps in prop::collection::vec((prop::array::uniform3(-1.0..1.0f64), -16.0..3.0f64, 1..250usize), 1..7),
            seeds in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 1..1200),
            k in prop_oneof![Just(1), Just(32), Just(100)],
        ) {
            let mut seeds = seeds.iter().cycle();
            let clump = |(center, size, count): &([f64; 3], f64, usize)| -> Vec<[f64; 3]> {
                let inside = |axis: usize, at: &[f64; 3]| center[axis] + 10f64.powf(*size) * at[axis].powi(3);
                seeds.by_ref().take(*count).map(|at| [0, 1, 2].map(|axis| inside(axis, at))).collect()
            };
            let positions: Vec<[f64; 3]> = clumps.iter().flat_map(clump).collect();
            let mass: Vec<f32> = (0..positions.len()).map(|index| 1.0 + (index % 3) as f32).collect();
            let estimates = Neighbours::of(&positions, None, &()).unwrap().estimate(k, &mass, None, &());
            for (index, estimate) in estimates.iter().enumerate() {
                let h = brute_force(&positions, index, k, None);
                prop_assert!((estimate.smoothing_length - h).abs() <= 1e-12 * h, "{estimate:?} {h}");
            }
        }
    }

    #[test]
    fn a_lattice_and_a_line_are_searched_like_anything_else() {
        let lattice = (0..4096).map(|i: u32| [i % 16, i / 16 % 16, i / 256].map(f64::from)).collect::<Vec<_>>();
        let line = (0..4096).map(|i: u32| [1e6, -3.0, f64::from(i).powi(2)]).collect::<Vec<_>>();
        for positions in [lattice, line] {
            let estimates =
                Neighbours::of(&positions, None, &()).unwrap().estimate(32, &vec![1.0; positions.len()], None, &());
            for index in (0..positions.len()).step_by(37) {
                let h = brute_force(&positions, index, 32, None);
                assert!((estimates[index].smoothing_length / h - 1.0).abs() < 1e-9);
            }
        }
    }

    /// Gadget writes `sum_j m_j W(r_ij, h_i)` itself.
    #[test]
    fn densities_agree_with_those_of_the_simulation() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/gas_sphere_collapse_025.hdf5");
        let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
        let gas = &loaded.families[0];
        let tree = Neighbours::of(&gas.positions, None, &()).unwrap();
        let density = tree.density(&gas.smoothing_length, &gas.mass, None, &());
        for (own, written) in density.iter().zip(&gas.density) {
            assert!((own / *written as f64 - 1.0).abs() < 2e-6, "{own} {written}");
        }
    }

    #[test]
    fn particles_in_one_place_reach_to_the_next_place() {
        let mut positions = vec![[1.0, 2.0, 3.0]; 5000];
        positions.extend([[1.0, 2.0, 4.0], [1.0, 2.0, 6.0]]);
        let tree = Neighbours::of(&positions, None, &()).unwrap();
        let estimates = tree.estimate(32, &vec![1.0; positions.len()], None, &());
        let lengths: Vec<f64> = [0, 4999, 5000, 5001].map(|index: usize| estimates[index].smoothing_length).to_vec();
        assert_eq!(lengths, [1.0, 1.0, 1.0, 3.0]);
        let center = Kernel::CubicSpline.value(0.0) * 5000.0;
        assert!((estimates[0].density / center - 1.0).abs() < 1e-12);
        let tree = Neighbours::of(&positions[..5000], None, &()).unwrap();
        assert_eq!(tree.estimate(32, &vec![1.0; 5000], None, &())[7].smoothing_length, 1.0);
        assert!(Neighbours::of(&[], None, &()).is_none());
    }
}
