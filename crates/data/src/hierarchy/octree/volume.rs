//! Merging the particles of a grid node's cells for volumes (F12 5.5.1).
//!
//! In each of the 256^3 cells of edge `q`, particles with `h < q` become one; all others are copied. The merged particle has
//! the sum of the masses and of the volumes (`h^3`), and the mean position, density and attributes, weighted by mass. If that
//! is smaller than the cell, it is enlarged to it, and its density is reduced as its volume has grown. So no particle of a node is
//! smaller than `q`, and a grid whose cells are as wide as that can be sampled without missing any.
//!
//! Of SPH particles, whose supports overlap, some dozens lie in a cell of the width of their support, and what they become is
//! again wider than the cells: levels that merge much alternate with some that merge nothing and are relays.

use super::block::{Block, View};
use super::merge::{Merged, Merger, single};
use std::ops::Range;

impl Merger<'_> {
    /// Merges what lies in one cell of edge `q`.
    pub(super) fn merge_volumes(
        &self,
        from: &View,
        cell: Range<usize>,
        q: f64,
        out: &mut Block,
        scratch: &mut Vec<u32>,
    ) {
        scratch.clear();
        for i in cell {
            if f64::from(from.smoothing_length[i]) < q {
                scratch.push(i as u32);
            } else {
                self.push_single(from, i, q, out);
            }
        }
        if !scratch.is_empty() {
            self.push_volume(from, scratch, q, out);
        }
    }

    fn push_volume(&self, from: &View, group: &[u32], q: f64, out: &mut Block) {
        let (mut mass, mut presence, mut volume, mut position) = (0.0, 0.0, 0.0, [0.0; 3]);
        for &i in group {
            let i = i as usize;
            let m = f64::from(from.mass[i]);
            mass += m;
            presence += m * f64::from(from.density[i]);
            volume += f64::from(from.smoothing_length[i]).powi(3);
            position.iter_mut().zip(from.units[i]).for_each(|(sum, x)| *sum += m * x);
        }
        let h = volume.cbrt();
        let small = h < q;
        let thinned = if small { (h / q).powi(3) } else { 1.0 };
        // Both are coded by their logarithm, so neither may vanish.
        let positive = |value: f64| value.max(f64::from(f32::MIN_POSITIVE));
        let merged = Merged {
            mass,
            density: positive(presence / mass * thinned),
            smoothing_length: single(positive(if small { q } else { h })),
            point: small,
        };
        self.push_merged(from, group, position.map(|x| x / mass), &merged, out);
    }
}

#[cfg(test)]
mod tests {
    use super::super::block::Content;
    use super::super::sorted::{Columns, Place, Sorted};
    use super::super::{Context, OctreeOptions, Purpose};
    use super::*;
    use crate::codec::AttributeMerge;
    use crate::hierarchy::{NodeKey, RootCell};
    use glam::DVec3;
    use proptest::prelude::*;

    const ROOT: RootCell = RootCell { min: DVec3::ZERO, size: 256.0 };

    /// Particles in the root cell, whose merging cells have edge 1 at depth 0.
    fn sorted(particles: &[([f64; 3], f32, f32, f32)]) -> Sorted {
        let places = particles.iter().map(|particle| Place::of(particle.0, ROOT)).collect();
        let columns = Columns {
            mass: particles.iter().map(|particle| particle.1).collect(),
            density: particles.iter().map(|particle| particle.1 / particle.2.powi(3)).collect(),
            smoothing_length: particles.iter().map(|particle| particle.2).collect(),
            attributes: vec![particles.iter().map(|particle| particle.3).collect()],
        };
        Sorted::new(places, columns)
    }

    fn sums(columns: &Columns) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for i in 0..columns.len() {
            let m = f64::from(columns.mass[i]);
            sums[0] += m;
            sums[1] += f64::from(columns.smoothing_length[i]).powi(3);
            sums[2] += m * f64::from(columns.attributes[0][i]);
        }
        sums
    }

    proptest! {
        /// From depth to depth: masses and means are kept, volumes where nothing is enlarged, and nothing is smaller than a cell.
        #[test]
        fn what_is_merged_keeps_mass_volume_and_means(
            particles in prop::collection::vec(
                (prop::array::uniform3(prop_oneof![0.0..256.0_f64, 100.0..101.0_f64]), 0.1..5.0_f32, -6.0..4.0_f32, -3.0..9.0_f32),
                1..300,
            ),
            smallest in -6.0..4.0_f32,
        ) {
            let particles: Vec<_> = particles.iter().map(|p| (p.0, p.1, p.2.max(smallest).exp2(), p.3)).collect();
            let sorted = sorted(&particles);
            let options = OctreeOptions::default();
            let context = Context { root: ROOT, options: &options, rules: &[AttributeMerge::Mean] };
            let [mass, mut volume, mean] = sums(&sorted.columns);
            let mut content = Content::Sources(0..particles.len());
            let center = |content: &Content| {
                let view = content.view(&sorted, 0);
                let moments = view.units.iter().zip(view.mass).map(|(u, &m)| f64::from(m) * DVec3::from_array(*u));
                moments.sum::<DVec3>() / mass
            };
            let middle = center(&content);
            for depth in (0..4).rev() {
                let key = NodeKey { depth, x: 0, y: 0, z: 0 };
                // Depths below 0 hold a part of the root cell only: here one node takes all, as joined runs do.
                let block = Merger::new(&context, Purpose::Samples, key).merge(&[content], &sorted);
                let q = 2.0_f64.powi(-i32::from(depth));
                let [now, grown, weighted] = sums(&block.columns);
                prop_assert!((now / mass - 1.0).abs() < 1e-6);
                prop_assert!((weighted - mean).abs() < 1e-5 * 9.0 * mass, "{weighted} {mean}");
                prop_assert!(grown > volume * (1.0 - 1e-5));
                let enlarged = block.words.iter().any(|&word| super::super::merge::is_point(word));
                prop_assert!(enlarged || (grown / volume - 1.0).abs() < 1e-5, "{grown} {volume}");
                let h = &block.columns.smoothing_length;
                prop_assert!(h.iter().all(|&h| f64::from(h) >= q * (1.0 - 1e-6)));
                prop_assert!(block.len() <= particles.len());
                volume = grown;
                content = Content::Block(block);
                prop_assert!((center(&content) - middle).length() < 1e-6);
            }
        }
    }

    #[test]
    fn one_small_particle_is_enlarged_and_a_large_one_copied() {
        let sorted = sorted(&[([10.5, 10.5, 10.5], 2.0, 0.5, 7.0), ([10.25, 10.5, 10.5], 3.0, 1.5, 1.0)]);
        let options = OctreeOptions::default();
        let context = Context { root: ROOT, options: &options, rules: &[AttributeMerge::Mean] };
        let block = Merger::new(&context, Purpose::Samples, NodeKey::ROOT).merge(&[Content::Sources(0..2)], &sorted);
        let mut found: Vec<_> = (0..2)
            .map(|i| [block.columns.mass[i], block.columns.density[i], block.columns.smoothing_length[i]])
            .collect();
        found.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert_eq!(found, [[2.0, 2.0, 1.0], [3.0, 3.0 / 1.5_f32.powi(3), 1.5]]);
    }
}
