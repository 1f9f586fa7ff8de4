//! How large pictures are drawn, and of how many particles, while the view moves and when it rests.

use crate::window::statistics::ActiveBackend;
use bevy::prelude::*;

/// Time that a volume's picture in motion may take where the preset says none, milliseconds.
pub(crate) const MOVING_MS: f64 = 50.0;
/// Particles that a volume in motion takes at most, drawn by the processor and by an adapter.
const MOVING_PARTICLES: [u64; 2] = [200_000, 4_000_000];
/// Longest side of the picture that is drawn only to measure the exposure, pixels.
const SKETCH: u32 = 320;

/// The size of the picture to draw now; `strained`: there is no time for all particles.
pub(crate) fn drawing_size(full: UVec2, strained: bool, backend: ActiveBackend, fixed_discs: bool) -> UVec2 {
    let shrink = match backend {
        // Discs of a fixed number of pixels would cover another share of a smaller picture.
        _ if fixed_discs => 1,
        ActiveBackend::Cpu if strained => 2,
        ActiveBackend::Cpu => 1,
        ActiveBackend::Gpu => full.max_element().div_ceil(SKETCH).max(1),
    };
    (full / shrink).max(UVec2::ONE)
}

/// The size of a volume's picture in motion, from the size and milliseconds of the last one: a volume has as many cells as
/// the cube of a side. A quarter at least.
pub(crate) fn moving_size(full: UVec2, last: Option<(UVec2, f64)>, budget: f64) -> UVec2 {
    let shrink = last.map_or(4.0, |(size, milliseconds)| {
        let sides = f64::from(full.max_element()) / f64::from(size.max_element().max(1));
        (milliseconds / budget).cbrt() * sides
    });
    // In quarters of a step, so that times that differ a little do not make another picture.
    let shrink = ((4.0 * shrink).ceil() / 4.0).clamp(1.0, 4.0);
    (full.as_dvec2() / shrink).as_uvec2().max(UVec2::ONE)
}

/// How many particles a volume's picture may take of so many in the view: all at rest.
pub(crate) fn volume_limit(moving: bool, on_adapter: bool, particles: u64) -> u64 {
    let most = MOVING_PARTICLES[usize::from(on_adapter)];
    if moving && particles > most { most } else { u64::MAX }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_in_motion_are_as_large_as_there_is_time_for() {
        let full = UVec2::new(1000, 600);
        assert_eq!(moving_size(full, None, 50.0), full / 4);
        assert_eq!(moving_size(full, Some((full, 40.0)), 50.0), full);
        assert_eq!(moving_size(full, Some((full, 400.0)), 50.0), full / 2);
        assert_eq!(moving_size(full, Some((full / 2, 50.0)), 50.0), full / 2);
        assert_eq!(moving_size(full, Some((full / 4, 1e6)), 50.0), full / 4);
    }

    #[test]
    fn volumes_in_motion_take_a_sample_of_many_particles() {
        assert_eq!(volume_limit(true, false, 1_000), u64::MAX);
        assert_eq!(volume_limit(true, false, 1_000_000), MOVING_PARTICLES[0]);
        assert_eq!(volume_limit(true, true, 1_000_000), u64::MAX);
        assert_eq!(volume_limit(false, false, 1_000_000_000), u64::MAX);
    }

    #[test]
    fn strain_costs_pixels_and_rest_brings_them_back() {
        let full = UVec2::new(1000, 600);
        assert_eq!(drawing_size(full, false, ActiveBackend::Cpu, false), full);
        assert_eq!(drawing_size(full, true, ActiveBackend::Cpu, false), full / 2);
        assert_eq!(drawing_size(full, true, ActiveBackend::Cpu, true), full);
        let sketch = drawing_size(full, false, ActiveBackend::Gpu, false);
        assert!(sketch.max_element() <= SKETCH);
    }
}
