//! Periodic boxes.

use super::Bounds;
use glam::DVec3;

/// A periodic box and what it holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodicBox {
    /// Its edge, world units; positive.
    pub edge: f64,
    /// The box around the particles.
    pub bounds: Bounds,
}

impl PeriodicBox {
    /// The periodic box of data that states an edge, if its particles lie within that box: codes write one for isolated systems
    /// too, which lie around the origin.
    pub fn of(stated: Option<f64>, bounds: Bounds) -> Option<PeriodicBox> {
        let edge = stated.filter(|edge| *edge > 0.0 && edge.is_finite())?;
        let slack = 0.01 * edge;
        let fits = bounds.min.cmpge(DVec3::splat(-slack)).all() && bounds.max.cmple(DVec3::splat(edge + slack)).all();
        (fits && !bounds.is_empty()).then_some(PeriodicBox { edge, bounds })
    }
}

/// By how much the images of a place that may be within half a periodic box of places in it lie beside it, itself first; only itself
/// where there is no box.
pub fn images(edge: Option<f64>) -> Vec<DVec3> {
    let Some(edge) = edge else { return vec![DVec3::ZERO] };
    let sides = [0.0, edge, -edge];
    let plane = sides.into_iter().flat_map(|x| sides.map(|y| [x, y]));
    plane.flat_map(|[x, y]| sides.map(|z| DVec3::new(x, y, z))).collect()
}
