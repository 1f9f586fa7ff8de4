//! How fine is fine enough: where a node may be drawn as it is, and how far away from there the camera is.
//!
//! Splats are refined until no particle is drawn further than `tau` pixels from its place (F12 4.7.2, [`super::error`]).
//! Volumes are refined until a node's smallest particles are no larger than the distance of the samples that they are resampled
//! to (F12 5.5.2): a node's merging cells, of edge `q`, are as large as its smallest particles, and samples at depth `z` are
//! `sigma z` apart (equation 5.1), so a node whose nearest depth is `z` is drawn if `q <= sigma z`.

use super::selection::NodeInfo;
use super::{Projection, Scope, View};
use std::f64::consts::SQRT_2;

/// What errors are larger by after so many steps of [`Detail::coarser`], up to the four that double them: the same numbers on every machine.
const STEPS: [f64; 4] = [1.0, 1.189_207_115_002_721, SQRT_2, 1.681_792_830_507_429];
/// Pixels that the row of steps begins with where less is asked for: zero has no multiples.
const FINEST: f64 = 1.0 / 64.0;

/// What decides how far the tree is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// No particle is displaced by more than so many pixels.
    Error {
        /// Pixels.
        tau: f64,
    },
    /// No merged particle is wider than samples are apart.
    Sampling {
        /// Distance of samples: at depth 1 in a perspective view, everywhere in an orthographic one. 0 refines down to the leaves.
        sigma: f64,
        /// Depth of the first sample, world units: what is nearer is sampled as if it were there.
        near: f64,
    },
    /// Whatever is best with so many splats ([`super::budget`]).
    Budget {
        /// Splats.
        splats: u64,
        /// For whom.
        scope: Scope,
    },
}

impl From<f64> for Detail {
    /// An error of so many pixels.
    fn from(tau: f64) -> Detail {
        Detail::Error { tau }
    }
}

impl Detail {
    /// The last of the steps of [`Detail::coarser`], after which most views show no more than the first nodes.
    pub const COARSEST: u32 = 96;

    /// The same so many steps coarser: with each, errors may be larger by a fifth, or there are fewer splats by a sixth.
    #[must_use]
    pub fn coarser(self, view: &View, steps: u32) -> Detail {
        if steps == 0 {
            return self;
        }
        let factor = 2.0_f64.powi((steps / 4) as i32) * STEPS[(steps % 4) as usize];
        match self {
            Detail::Error { tau } => Detail::Error { tau: factor * tau.max(FINEST) },
            Detail::Sampling { sigma, near } => {
                Detail::Sampling { sigma: factor * sigma.max(FINEST / view.focal_pixels()), near }
            }
            Detail::Budget { splats, scope } => {
                Detail::Budget { splats: ((splats as f64 / factor) as u64).max(1), scope }
            }
        }
    }

    /// Whether a node with particles of its own may be drawn as it is; `error_pixels` is its screen-space error.
    pub fn suffices(&self, view: &View, info: &NodeInfo, error_pixels: f64) -> bool {
        match *self {
            Detail::Error { tau } => error_pixels <= tau,
            // Nodes are not looked at one by one.
            Detail::Budget { .. } => true,
            // Nothing replaces the particles of a leaf, and a node without particles replaces nothing.
            _ if info.spacing <= 0.0 || info.delta.is_infinite() => info.spacing <= 0.0,
            Detail::Sampling { sigma, near } => match view.projection {
                Projection::Perspective { .. } => info.spacing <= sigma * view.nearest_depth(&info.extent).max(near),
                Projection::Orthographic { .. } => info.spacing <= sigma,
            },
        }
    }

    /// How far the camera has to move until the node may have to be refined: 0 or less where a turn may suffice, infinite where
    /// no move does. See [`super::travel`].
    pub fn travel(&self, view: &View, info: &NodeInfo) -> f64 {
        match *self {
            Detail::Error { tau } => view.travel(&info.extent, info.delta, tau),
            // What a budget goes to next, nobody knows.
            Detail::Budget { .. } => f64::INFINITY,
            _ if info.delta.is_infinite() => f64::NEG_INFINITY,
            Detail::Sampling { .. } if info.spacing <= 0.0 => f64::INFINITY,
            Detail::Sampling { sigma, near } => match view.projection {
                Projection::Perspective { .. } if info.spacing <= sigma * near => f64::INFINITY,
                Projection::Perspective { .. } => view.travel_to_depth(&info.extent, info.spacing / sigma),
                Projection::Orthographic { .. } if info.spacing <= sigma => f64::INFINITY,
                Projection::Orthographic { .. } => view.distance_to_sight(&info.extent),
            },
        }
    }

    /// Displacement, in pixels, from which on a leaf's particles are looked at one by one to tell its error.
    pub fn tolerance(&self, view: &View) -> f64 {
        match *self {
            Detail::Error { tau } => tau,
            Detail::Budget { .. } => f64::INFINITY,
            Detail::Sampling { sigma, .. } => sigma * view.focal_pixels(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Extent;
    use super::super::travel::tests::moved_views;
    use super::*;
    use crate::model::Bounds;
    use glam::DVec3;
    use proptest::prelude::*;

    fn info(min: DVec3, size: f64, spacing: f64) -> NodeInfo {
        let extent = Extent { bounds: Bounds { min, max: min + size }, margin: 0.0 };
        NodeInfo {
            extent,
            delta: spacing,
            spacing,
            particles: 1,
            source_particles: 1,
            mass: 1.0,
            is_leaf: true,
            stands_for_leaf: false,
            time: [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    proptest! {
        /// Samples anywhere in a node that is drawn are at least as far apart as its cells are wide; and what has to be refined after
        /// a move and a turn was within reach before.
        #[test]
        fn nodes_are_drawn_where_samples_are_sparse(
            min in prop::array::uniform3(-6.0..6.0f64),
            size in 0.001..0.5f64,
            inside in prop::array::uniform3(0.0..1.0f64),
            (before, after) in moved_views(),
            sigma in 1e-3..1e-2f64,
        ) {
            let is_orthographic = matches!(before.projection, Projection::Orthographic { .. });
            let min = DVec3::from(min);
            let node = info(min, size, size / 16.0);
            let detail = Detail::Sampling { sigma, near: 0.1 };
            if detail.suffices(&before, &node, 0.0) {
                let depth = before.to_camera(min + size * DVec3::from(inside)).z;
                let distance = if is_orthographic { sigma } else { sigma * depth.max(0.1) };
                prop_assert!(node.spacing <= distance * (1.0 + 1e-9));
            }
            // The distance is to the box's nearest point, the rule counts its nearest depth: they differ by its diagonal.
            let slack = if is_orthographic { 0.0 } else { 2.0 * 3f64.sqrt() * size };
            if after.sees(&node.extent) && !detail.suffices(&after, &node, 0.0) {
                prop_assert!(detail.travel(&before, &node) <= after.eye.distance(before.eye) + slack + 1e-9);
            }
        }
    }

    #[test]
    fn steps_are_coarser_one_by_one_and_four_are_twice_as_coarse() {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 64, 64).unwrap();
        // The finer, the larger.
        let fineness = |detail: Detail| match detail {
            Detail::Error { tau } => 1.0 / tau,
            Detail::Sampling { sigma, .. } => 1.0 / sigma,
            Detail::Budget { splats, .. } => splats as f64,
        };
        for detail in [
            Detail::Error { tau: 0.8 },
            Detail::Error { tau: 0.0 },
            Detail::Sampling { sigma: 0.0, near: 1.0 },
            Detail::Budget { splats: 1 << 40, scope: Scope::Picture },
        ] {
            assert_eq!(detail.coarser(&view, 0), detail);
            for steps in 0..Detail::COARSEST {
                let [own, next] = [steps, steps + 1].map(|steps| fineness(detail.coarser(&view, steps)));
                assert!(next < own && next > 0.0, "{detail:?}, {steps} steps: {own} {next}");
            }
            let [own, fourth] = [1, 5].map(|steps| fineness(detail.coarser(&view, steps)));
            assert!((own / fourth - 2.0).abs() < 1e-9, "{detail:?}: {own} {fourth}");
        }
    }

    #[test]
    fn leaves_suffice_and_relays_never_do() {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 64, 64).unwrap();
        let detail = Detail::Sampling { sigma: 0.0, near: 0.0 };
        let leaf = info(DVec3::ZERO, 1.0, 0.0);
        assert!(detail.suffices(&view, &leaf, 9.0) && detail.travel(&view, &leaf) == f64::INFINITY);
        let relay = NodeInfo { delta: f64::INFINITY, ..info(DVec3::ZERO, 1e-9, 1e-12) };
        let coarse = Detail::Sampling { sigma: 1.0, near: 9.0 };
        assert!(!coarse.suffices(&view, &relay, 0.0) && coarse.travel(&view, &relay) == f64::NEG_INFINITY);
        assert!(!detail.suffices(&view, &info(DVec3::ZERO, 1.0, 1e-9), 0.0));
        assert_eq!(Detail::from(0.8), Detail::Error { tau: 0.8 });
    }
}
