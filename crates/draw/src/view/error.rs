//! The screen-space error of a node, and the distance from which it may be drawn (F12 4.7.2).
//!
//! F12 gives `d_min = delta res_y / (2 tan(fov_y / 2)) * tau` for a particle displaced by `delta`, a bound on the
//! picture's middle; as printed, `tau` multiplies where the text's meaning (a larger tolerance lets coarser nodes
//! come nearer) needs it to divide. Here the bound holds for every pixel: with `p = (X, z)` the true and
//! `p' = (X', z')` the drawn position in camera space, `|p - p'| <= delta`,
//!
//! `f |X/z - X'/z'| = f |X e_z - e_X z| / (z z') <= f delta |p| / (z z') <= f delta sec(theta) / z_min`,
//!
//! by Cauchy and Schwarz, where `e = p' - p`, `f` is the focal length in pixels, `theta` the angle of `p` off the
//! middle line of sight and `z_min` the smallest depth in the node.

use super::frustum::Extent;
use super::{Projection, View};

impl View {
    /// Largest displacement on screen, in pixels, of any particle of the extent that is drawn at most `delta` (world
    /// units) from its place and lies in the picture. Infinite if the extent reaches the eye's plane; zero if `delta`
    /// is zero.
    pub fn error_pixels(&self, extent: &Extent, delta: f64) -> f64 {
        if delta <= 0.0 {
            return 0.0;
        }
        match self.projection {
            Projection::Orthographic { .. } => self.focal_pixels() * delta,
            Projection::Perspective { .. } => {
                let nearest = self.nearest_depth(extent);
                if nearest <= 0.0 {
                    return f64::INFINITY;
                }
                self.focal_pixels() * delta * self.largest_secant(extent) / nearest
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use glam::DVec3;
    use proptest::prelude::*;

    fn view(width: u32, height: u32, fov: f64) -> View {
        let projection = Projection::Perspective { fov_y: fov };
        View::look_at(DVec3::new(0.3, -0.2, 5.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
    }

    fn cube(min: DVec3, size: f64) -> Extent {
        Extent { bounds: Bounds { min, max: min + size }, margin: 0.0 }
    }

    /// Displacement in pixels between two world positions, if the first is in the picture.
    fn displacement(view: &View, a: DVec3, b: DVec3) -> Option<f64> {
        let [ax, ay] = view.to_pixels(view.to_camera(a))?;
        let [bx, by] = view.to_pixels(view.to_camera(b))?;
        let inside = (0.0..=f64::from(view.width)).contains(&ax) && (0.0..=f64::from(view.height)).contains(&ay);
        inside.then(|| (ax - bx).hypot(ay - by))
    }

    proptest! {
        /// The bound holds wherever the node, the particle in it and the displacement lie.
        #[test]
        fn no_particle_moves_further_than_the_bound(
            min in prop::array::uniform3(-6.0..6.0f64),
            size in 0.01..3.0f64,
            inside in prop::array::uniform3(0.0..1.0f64),
            step in prop::array::uniform3(-1.0..1.0f64),
            delta in 1e-4..0.1f64,
            fov in 0.1..2.6f64,
        ) {
            let view = view(640, 360, fov);
            let min = DVec3::from(min);
            let extent = cube(min, size);
            let source = min + size * DVec3::from(inside);
            let step = DVec3::from(step).normalize_or_zero() * delta;
            // Drawn positions stay in the box, as bin centres and centroids do.
            let drawn = (source + step).clamp(min, min + size);
            let bound = view.error_pixels(&extent, delta);
            if let Some(moved) = displacement(&view, source, drawn) {
                prop_assert!(moved <= bound * (1.0 + 1e-12), "moved {moved} px, bound {bound} px");
            }
        }

        /// An extent that holds a particle reaching into the picture is never culled.
        #[test]
        fn no_visible_cell_is_culled(
            min in prop::array::uniform3(-6.0..6.0f64),
            size in 0.01..3.0f64,
            inside in prop::array::uniform3(0.0..1.0f64),
            ortho in any::<bool>(),
        ) {
            let projection = if ortho {
                Projection::Orthographic { height: 3.0 }
            } else {
                Projection::Perspective { fov_y: 0.9 }
            };
            let view = View::look_at(DVec3::new(1.0, 2.0, 5.0), DVec3::ZERO, DVec3::Y, projection, 300, 200).unwrap();
            let min = DVec3::from(min);
            let extent = cube(min, size);
            let point = view.to_camera(min + size * DVec3::from(inside));
            if let Some([x, y]) = view.to_pixels(point)
                && point.z > 0.0 && (0.0..300.0).contains(&x) && (0.0..200.0).contains(&y)
            {
                prop_assert!(view.sees(&extent));
            }
        }
    }

    /// The bound is attained to a percent: a thin node across the middle line of sight, a particle displaced sideways.
    #[test]
    fn the_bound_is_tight_in_the_middle_of_the_picture() {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(DVec3::new(0.0, 0.0, 100.0), DVec3::ZERO, DVec3::Y, projection, 800, 800).unwrap();
        let extent = cube(DVec3::splat(-0.05), 0.1);
        let delta = 0.01;
        let source = DVec3::new(0.0, 0.0, 0.05);
        let moved = displacement(&view, source, source + DVec3::X * delta).unwrap();
        let bound = view.error_pixels(&extent, delta);
        assert!(moved > 0.99 * bound && moved <= bound, "moved {moved} px, bound {bound} px");
    }
}
