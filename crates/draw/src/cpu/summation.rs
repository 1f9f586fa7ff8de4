//! A picture of sums of which the batches are not all there at once.

use super::{Counts, Method, SplatOptions, Splats, Sprite, exact, fast, sprites};
use crate::color::Accumulation;
use crate::view::View;

/// A picture that batches are added to, some at a time: it has the same bits whichever are added together, as long as their order is the same.
pub struct Summation(Way);

/// By what it is drawn.
enum Way {
    Exact(Box<exact::Drawing>),
    Fast(Box<fast::Drawing>),
    Sprites(Box<sprites::Drawing>),
}

impl Summation {
    /// Bytes that are taken at most by particles that wait to be drawn.
    pub const SORTED_BYTES: u64 = fast::SORTED_BYTES;

    /// Nothing is in it yet.
    pub fn new(view: &View, options: &SplatOptions) -> Summation {
        Summation(match options.method {
            _ if options.sprite != Sprite::Kernel => Way::Sprites(Box::new(sprites::Drawing::new(view, options))),
            Method::Exact => Way::Exact(Box::new(exact::Drawing::new(view, options))),
            Method::Pyramid => Way::Fast(Box::new(fast::Drawing::new(view, options))),
        })
    }

    /// Adds batches, on the threads of the current rayon pool.
    pub fn add(&mut self, batches: &[Splats<'_>]) {
        match &mut self.0 {
            Way::Exact(drawing) => drawing.add(batches),
            Way::Fast(drawing) => drawing.add(batches),
            Way::Sprites(drawing) => drawing.add(batches),
        }
    }

    /// The picture, and what became of the particles.
    pub fn finish(self) -> (Accumulation, Counts) {
        match self.0 {
            Way::Exact(drawing) => drawing.finish(),
            Way::Fast(drawing) => drawing.finish(),
            Way::Sprites(drawing) => drawing.finish(),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::cpu::{Extent, Positions, draw_counted};
    use crate::synth::random::Random;
    use crate::view::Projection;
    use glam::DVec3;
    use proptest::prelude::*;

    /// Particles in a cube of edge 1 around the origin, most of them small.
    struct Particles {
        offsets: Vec<[f32; 3]>,
        smoothing_length: Vec<f32>,
        weight: Vec<f32>,
        attribute: Vec<f32>,
    }

    impl Particles {
        fn new(count: usize, seed: u64) -> Particles {
            let mut random = Random::new(seed, 1);
            let mut column =
                |of: &dyn Fn(f64) -> f64| -> Vec<f32> { (0..count).map(|_| of(random.uniform()) as f32).collect() };
            let places = [column(&|u| u - 0.5), column(&|u| u - 0.5), column(&|u| u - 0.5)];
            Particles {
                offsets: (0..count).map(|i| [0, 1, 2].map(|k: usize| places[k][i])).collect(),
                smoothing_length: column(&|u| 0.002 + 0.3 * u.powi(12)),
                weight: column(&|u| u),
                attribute: column(&|u| u - 0.3),
            }
        }

        /// Batches of so many particles, in turn with smoothing lengths and of a fixed size.
        fn batches(&self, size: usize, has_attribute: bool) -> Vec<Splats<'_>> {
            let batch = |number: usize| {
                let own = number * size..self.weight.len().min((number + 1) * size);
                let (origin, scale) = (DVec3::ZERO, 1.0);
                let positions = Positions::Relative { origin, scale, offsets: &self.offsets[own.clone()] };
                let extent = match number % 5 {
                    3 => Extent::Pixels(2.5),
                    _ => Extent::World(&self.smoothing_length[own.clone()]),
                };
                let attribute = has_attribute.then(|| &self.attribute[own.clone()]);
                Splats::new(positions, extent, &self.weight[own], attribute).unwrap()
            };
            (0..self.weight.len().div_ceil(size)).map(batch).collect()
        }
    }

    fn bits((picture, counts): (Accumulation, Counts)) -> (Vec<u32>, Vec<u32>, Counts) {
        let of = |channel: Vec<f32>| channel.into_iter().map(f32::to_bits).collect();
        (of(picture.p), of(picture.ps), counts)
    }

    /// What is added a few batches at a time.
    fn in_parts(
        view: &View,
        batches: &[Splats<'_>],
        options: &SplatOptions,
        mut part: impl FnMut() -> usize,
    ) -> Summation {
        let mut sums = Summation::new(view, options);
        let mut rest = batches;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(part().min(rest.len()));
            sums.add(now);
            rest = later;
        }
        sums
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn the_bits_do_not_depend_on_what_is_added_together(
            (count, size, parts) in (1_usize..40_000, 50_usize..9_000, prop::collection::vec(0_usize..7, 1..20)),
            (seed, has_attribute, way, is_flat) in (any::<u64>(), any::<bool>(), 0..3, any::<bool>()),
            culling in any::<bool>(),
        ) {
            let count = if way == 1 { count / 20 + 1 } else { count };
            let particles = Particles::new(count, seed);
            let batches = particles.batches(size, has_attribute);
            let projection = match is_flat {
                true => Projection::Orthographic { height: 0.9 },
                false => Projection::Perspective { fov_y: 0.8 },
            };
            let view = View::look_at(DVec3::new(0.2, 0.1, 1.1), DVec3::ZERO, DVec3::Y, projection, 170, 140).unwrap();
            let method = if way == 1 { Method::Exact } else { Method::Pyramid };
            let sprite = if way == 2 { Sprite::Gaussian } else { Sprite::Kernel };
            let options = SplatOptions { method, sprite, culling, ..SplatOptions::default() };
            let mut turns = parts.iter().chain([&1]).cycle().copied();
            let sums = in_parts(&view, &batches, &options, || turns.next().unwrap());
            prop_assert!(bits(sums.finish()) == bits(draw_counted(&view, &batches, &options)));
        }
    }

    /// More than are sorted before tiles are drawn into.
    #[test]
    fn many_particles_have_the_same_bits_too() {
        let particles = Particles::new((1 << 21) + 20_000, 5);
        let batches = particles.batches(10_007, true);
        let projection = Projection::Orthographic { height: 1.0 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 64, 64).unwrap();
        let options = SplatOptions::default();
        let sums = in_parts(&view, &batches, &options, || 31);
        assert!(bits(sums.finish()) == bits(draw_counted(&view, &batches, &options)));
    }
}
