//! How large pictures are drawn, and of how many particles, while the view moves and when it rests.

use crate::window::preset::MotionPreset;
use bevy::prelude::*;

/// The size of the picture to draw now; `strained`: there is no time for all particles.
pub(crate) fn drawing_size(full: UVec2, strained: bool, fixed_discs: bool, motion: &MotionPreset) -> UVec2 {
    // Discs of a fixed number of pixels would cover another share of a smaller picture.
    let shrink = if strained && !fixed_discs { motion.splat_shrink } else { 1 };
    (full / shrink).max(UVec2::ONE)
}

/// The size of a volume's picture in motion, from the size and milliseconds of the last one: a volume has as many cells as
/// the cube of a side.
pub(crate) fn moving_size(full: UVec2, last: Option<(UVec2, f64)>, budget: f64, motion: &MotionPreset) -> UVec2 {
    let shrink = last.map_or(motion.volume_shrink, |(size, milliseconds)| {
        let sides = f64::from(full.max_element()) / f64::from(size.max_element().max(1));
        (milliseconds / budget).cbrt() * sides
    });
    // In quarters of a step, so that times that differ a little do not make another picture.
    let shrink = ((4.0 * shrink).ceil() / 4.0).min(motion.volume_shrink).max(1.0);
    (full.as_dvec2() / shrink).as_uvec2().max(UVec2::ONE)
}

/// How many particles a volume's picture may take of so many in the view: all at rest.
pub(crate) fn volume_limit(moving: bool, on_adapter: bool, particles: u64, motion: &MotionPreset) -> u64 {
    let most = if on_adapter { motion.volume_particles_gpu } else { motion.volume_particles };
    if moving && particles > most { most } else { u64::MAX }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_in_motion_are_as_large_as_there_is_time_for() {
        let full = UVec2::new(1000, 600);
        let motion = MotionPreset::default();
        let size = |last, motion: &MotionPreset| moving_size(full, last, 50.0, motion);
        assert_eq!(size(None, &motion), full / 4);
        assert_eq!(size(Some((full, 40.0)), &motion), full);
        assert_eq!(size(Some((full, 400.0)), &motion), full / 2);
        assert_eq!(size(Some((full / 2, 50.0)), &motion), full / 2);
        assert_eq!(size(Some((full / 4, 1e6)), &motion), full / 4);
        let sharper = MotionPreset { volume_shrink: 2.0, ..motion };
        assert_eq!(size(None, &sharper), full / 2);
        assert_eq!(size(Some((full / 4, 1e6)), &sharper), full / 2);
    }

    #[test]
    fn volumes_in_motion_take_a_sample_of_many_particles() {
        let motion = MotionPreset::default();
        assert_eq!(volume_limit(true, false, 1_000, &motion), u64::MAX);
        assert_eq!(volume_limit(true, false, 1_000_000, &motion), 200_000);
        assert_eq!(volume_limit(true, true, 1_000_000, &motion), u64::MAX);
        assert_eq!(volume_limit(false, false, 1_000_000_000, &motion), u64::MAX);
        let few = MotionPreset { volume_particles: 300, volume_particles_gpu: 500, ..motion };
        assert_eq!([false, true].map(|on_adapter| volume_limit(true, on_adapter, 1_000, &few)), [300, 500]);
    }

    #[test]
    fn strain_costs_pixels_and_rest_brings_them_back() {
        let full = UVec2::new(1000, 600);
        let motion = MotionPreset::default();
        assert_eq!(drawing_size(full, false, false, &motion), full);
        assert_eq!(drawing_size(full, true, false, &motion), full / 2);
        assert_eq!(drawing_size(full, true, true, &motion), full);
        let sharp = MotionPreset { splat_shrink: 1, ..motion.clone() };
        assert_eq!(drawing_size(full, true, false, &sharp), full);
    }
}
