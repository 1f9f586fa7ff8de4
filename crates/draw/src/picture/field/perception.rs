//! How much errors of each level of points count to the eye, by the cycles a degree at which it sees them.
//!
//! The contrast sensitivity of Mannos and Sakrison (IEEE Trans. Inf. Theory 20, 1974), without its fall towards coarse patterns: those of
//! high contrast are seen there.

use crate::model::Bounds;
use crate::view::{Projection, View};

/// Pixels of a degree in pictures without perspective: those of a usual screen at arm's length.
const PIXELS_A_DEGREE: f64 = 60.0;
/// Cycles a sample in the middle of the octave of nodes of two samples.
const FINEST: f64 = 0.375;
/// Cycles a degree that are seen best.
const BEST: f64 = 7.89;
/// Data around the eye is seen from so much of its diameter.
const NEAREST: f64 = 0.1;

/// How well a pattern of so many cycles a degree is seen, of the one that is seen best.
fn sensitivity(cycles: f64) -> f64 {
    let curve = |cycles: f64| {
        let f = 0.114 * cycles;
        (0.0192 + f) * (-f.powf(1.1)).exp()
    };
    if cycles <= BEST { 1.0 } else { curve(cycles) / curve(BEST) }
}

/// How many samples, so far apart, a degree of a view of them has in their middle.
pub(super) fn samples_a_degree(view: &View, bounds: Bounds, spacing: f64) -> f64 {
    match view.projection {
        Projection::Perspective { .. } => {
            let distance = (bounds.center() - view.eye).length().max(NEAREST * bounds.size().length());
            1f64.to_radians().tan() * distance / spacing
        }
        Projection::Orthographic { .. } => PIXELS_A_DEGREE / (view.focal_pixels() * spacing),
    }
}

/// The weights of errors of `levels` levels, the finest first, where a degree has so many samples.
pub(super) fn weights(levels: usize, samples_a_degree: f64) -> Vec<f32> {
    (0..levels).map(|level| sensitivity(samples_a_degree * FINEST * 0.5_f64.powi(level as i32)) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn fine_patterns_are_seen_less_and_coarse_ones_alike() {
        assert_eq!((sensitivity(0.1), sensitivity(BEST)), (1.0, 1.0));
        // The published curve over its maximum.
        for (cycles, share) in [(15.0, 0.754), (20.0, 0.512), (30.0, 0.191), (60.0, 0.0046)] {
            assert!((sensitivity(cycles) / share - 1.0).abs() < 0.02, "{cycles}: {}", sensitivity(cycles));
        }
        let weights = weights(6, 160.0);
        let rises = weights.windows(2).all(|pair| pair[0] <= pair[1]);
        assert!(rises && weights[0] < 0.01 && weights[5] == 1.0, "{weights:?}");
    }

    #[test]
    fn samples_of_a_degree_are_those_that_a_view_shows() {
        let bounds = Bounds::of([[0.0; 3], [100.0; 3]]);
        let look =
            |projection| View::look_at(DVec3::new(50.0, 50.0, 450.0), bounds.center(), DVec3::Y, projection, 64, 64);
        let view = look(Projection::Perspective { fov_y: 0.5 }).unwrap();
        assert!((samples_a_degree(&view, bounds, 0.5) - 400.0 * 0.017455 / 0.5).abs() < 1e-3);
        // A sample a pixel.
        let flat = look(Projection::Orthographic { height: 32.0 }).unwrap();
        assert!((samples_a_degree(&flat, bounds, 0.5) - PIXELS_A_DEGREE).abs() < 1e-9);
    }
}
