//! Particles that come some at a time make the picture that all of them make.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::cpu::volume;
use crate::cpu::volume::stretched::tests::{Ellipsoids, rotation};
use crate::cpu::volume::tests::{Cloud, RAMP, look, perspective, scenery};
use crate::cpu::volume::{Surface, range};
use crate::model::Kernel;
use crate::synth::random::Random;
use crate::view::perspective_grid::GridOptions;
use glam::DVec3;
use proptest::prelude::*;

/// Particles in memory that are supplied together.
pub(in crate::cpu::volume) trait Group: Send {
    fn batch(&self) -> Splats<'_>;
}

impl Group for Cloud {
    fn batch(&self) -> Splats<'_> {
        self.batch()
    }
}

impl Group for Ellipsoids {
    fn batch(&self) -> Splats<'_> {
        self.batch()
    }
}

/// Groups in memory, of which so many are handed over together, and how often each was supplied.
pub(in crate::cpu::volume) struct Groups {
    all: Vec<Box<dyn Group>>,
    together: usize,
    slab_bytes: u64,
    supplied: Vec<usize>,
}

impl Groups {
    pub fn of(all: Vec<Box<dyn Group>>, together: usize, slab_bytes: u64) -> Groups {
        let supplied = vec![0; all.len()];
        Groups { all, together, slab_bytes, supplied }
    }

    /// Of very different sizes, here and there.
    fn random(seed: u64, [round, stretched]: [usize; 2], together: usize, slab_bytes: u64) -> Groups {
        let mut random = Random::new(seed, 8);
        let mut somewhere = |count: usize, add: &mut dyn FnMut(&mut Random, DVec3, f64)| {
            let middle = DVec3::from_array([0; 3].map(|_| 2.0 * random.signed()));
            let width = 0.05 + 1.5 * random.uniform().powi(3);
            for _ in 0..count {
                let place = middle + width * DVec3::from_array([0; 3].map(|_| random.signed()));
                let h = width * (0.02 + 1.5 * random.uniform().powi(10));
                add(&mut random, place, h);
            }
        };
        let cloud = |_: usize| -> Box<dyn Group> {
            let mut cloud = Cloud::default();
            somewhere(300, &mut |random, place, h| {
                cloud.push(place.to_array(), h as f32, (0.5 * h * h) as f32, random.signed() as f32);
            });
            Box::new(cloud)
        };
        let mut groups: Vec<_> = (0..round).map(cloud).collect();
        let ellipsoids = |_: usize| -> Box<dyn Group> {
            let mut all = Ellipsoids::default();
            somewhere(40, &mut |random, place, h| {
                let radii = h * DVec3::new(1.0, 0.2 + 0.8 * random.uniform(), 0.2 + 0.8 * random.uniform());
                let axes = rotation(random);
                all.push(place, radii, axes, Kernel::default(), [(0.5 * h * h) as f32, random.signed() as f32]);
            });
            Box::new(all)
        };
        groups.extend((0..stretched).map(ellipsoids));
        Groups::of(groups, together, slab_bytes)
    }

    pub fn batches(&self) -> Vec<Splats<'_>> {
        self.all.iter().map(|group| group.batch()).collect()
    }
}

impl Supply for Groups {
    fn extents(&self) -> Vec<Extent> {
        extents::of(&self.batches())
    }

    fn particles(&self) -> u64 {
        self.batches().iter().map(|batch| batch.len() as u64).sum()
    }

    fn has_attribute(&self) -> bool {
        true
    }

    fn slab_bytes(&self) -> u64 {
        self.slab_bytes
    }

    fn supply(&mut self, is_wanted: &dyn Fn(&Extent) -> bool, each: &mut dyn FnMut(&[Splats<'_>])) {
        let extents = self.extents();
        let wanted: Vec<usize> = (0..extents.len()).filter(|index| is_wanted(&extents[*index])).collect();
        let batches = self.batches();
        for some in wanted.chunks(self.together) {
            each(&some.iter().map(|index| batches[*index]).collect::<Vec<Splats<'_>>>());
        }
        wanted.into_iter().for_each(|index| self.supplied[index] += 1);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_comes_some_at_a_time_has_the_same_bits(
        (seed, round, stretched, together) in (any::<u64>(), 1_usize..30, 0_usize..4, 1_usize..8),
        (memory, half, occlusion, is_flat) in (0_u64..3, any::<bool>(), any::<bool>(), any::<bool>()),
        (distance, termination) in (0.5_f64..8.0, prop::sample::select(vec![0.9_f32, 1.0])),
    ) {
        let memory = [0, 300 << 10, 1 << 30][memory as usize];
        let mut groups = Groups::random(seed, [round, stretched], together, memory);
        let eye = distance * DVec3::new(0.3, 0.2, 0.93);
        let view = match is_flat {
            true => look(eye, Projection::Orthographic { height: 4.0 }, 66, 50),
            false => perspective(eye, 66, 50),
        };
        let surface = Surface { value: 0.7, color: None, opacity: 0.9 };
        let scenery = Scenery { termination, ..scenery(RAMP, [1e-3, 1.0], 0.3, vec![surface]) };
        let grid = GridOptions { resolution: if half { 0.5 } else { 1.0 }, lambda: true };
        let options = VolumeOptions { memory, occlusion, grid, ..VolumeOptions::default() };
        let whole = volume::draw(&view, &groups.batches(), &scenery, &options);
        let range_of_all = range::measure(&view, &groups.batches(), &options);
        let unlimited = VolumeOptions { memory: 1 << 40, ..options };
        let found = draw(&view, &mut groups, &scenery, &unlimited);
        prop_assert_eq!(range_of_all, range::measure_supplied(&view, &mut groups, &options));
        match (whole, found) {
            (Ok((whole, all)), Ok((colors, report))) => {
                prop_assert!(whole == colors, "{all:?} {report:?}");
                let counts = |report: &VolumeReport| {
                    let VolumeReport { grid, slabs, pairs, bricks, samples, crossings, hidden, .. } = *report;
                    (grid, report.planes, [slabs as u64, pairs, bricks, hidden], samples, crossings)
                };
                prop_assert_eq!(counts(&all), counts(&report));
                prop_assert!(all.opaque == report.opaque && report.particles <= all.particles);
            }
            (whole, found) => {
                prop_assert_eq!(whole.err(), found.err());
            }
        }
    }
}

/// An opaque cube fills the picture, and there is more behind it.
#[test]
fn what_is_hidden_is_not_supplied() {
    let behind = |z: f64| {
        let mut cloud = Cloud::default();
        (0..200).for_each(|i| cloud.push([0.005 * f64::from(i) - 0.5, 0.0, z], 0.3, 0.02, 0.1));
        cloud
    };
    let view = look(DVec3::new(0.0, 0.0, 7.0), Projection::Orthographic { height: 1.0 }, 40, 40);
    let surface = Surface { value: 0.7, color: None, opacity: 0.9 };
    let scenery = Scenery { termination: 0.97, ..scenery(RAMP, [1e-3, 1.0], 0.3, vec![surface]) };
    let supplied = |occlusion| {
        let clouds = [Cloud::lattice(16, 2.0), behind(-4.0), behind(-6.0)];
        let mut groups = Groups::of(clouds.map(|cloud| Box::new(cloud) as Box<dyn Group>).into(), 1, 0);
        let options = VolumeOptions { occlusion, ..VolumeOptions::default() };
        let (colors, report) = draw(&view, &mut groups, &scenery, &options).unwrap();
        (colors, report.particles, groups.supplied)
    };
    let ((colors, fewer, culled), (whole, all, each)) = (supplied(true), supplied(false));
    assert!(colors == whole && fewer < all && each.iter().all(|times| *times > 0), "{fewer} {all} {each:?}");
    assert!(culled[0] > 0 && culled[1..] == [0, 0], "{culled:?}");
}
