//! The sides of what is drawn of a flat field, from the surface to a base: at the field's border, and where a box cuts it. They are for the eye:
//! no channels know of them.

use super::rays::CellFrame;
use super::resolve::weights;
use super::stitch::Scene;
use crate::model::Bounds;
use glam::DVec3;

/// The walls of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Walls {
    /// World height of their feet, or heads.
    base: f64,
    /// What there is of the field.
    inside: Bounds,
}

/// Where a ray meets a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallHit {
    /// The ray's parameter.
    pub depth: f64,
    /// The wall's normal, towards where the ray comes from.
    pub normal: DVec3,
}

/// Rounding may leave a place so far beside the triangle that it is on, in the triangle's size.
const BESIDE: f64 = 1e-6;

/// What is in a box of a field that is drawn from one corner of the world to the opposite one, but for its heights.
pub(super) fn inside(corners: [DVec3; 2], cut: &Bounds) -> Bounds {
    let (low, high) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
    let (min, max) = (low.max(cut.min), high.min(cut.max));
    Bounds { min: DVec3::new(min.x, min.y, cut.min.z), max: DVec3::new(max.x, max.y, cut.max.z) }
}

impl Walls {
    /// Down or up to a height of the field. `None` for a globe, and where nothing of the field is in the box.
    pub fn new(scene: &Scene, cut: &Bounds, base: f64) -> Option<Walls> {
        let placed = &scene.placed;
        let inside = inside(placed.corners(), cut);
        let is_some = inside.min.x < inside.max.x && inside.min.y < inside.max.y;
        (placed.is_flat() && is_some).then(|| Walls { base: placed.lifted(base), inside })
    }

    /// The first wall that a ray meets before a depth.
    pub fn cast(&self, scene: &Scene, origin: DVec3, direction: DVec3, before: f64) -> Option<WallHit> {
        let mut nearest: Option<WallHit> = None;
        for axis in 0..2 {
            for at in [self.inside.min[axis], self.inside.max[axis]] {
                let depth = (at - origin[axis]) / direction[axis];
                let limit = nearest.map_or(before, |nearest| nearest.depth);
                if !(depth > 0.0 && depth < limit) {
                    continue;
                }
                let mut place = origin + depth * direction;
                place[axis] = at;
                let is_in = (0..3).all(|k| (self.inside.min[k]..=self.inside.max[k]).contains(&place[k]));
                let Some(top) = is_in.then(|| height_at(scene, place)).flatten() else { continue };
                if (top.min(self.base)..=top.max(self.base)).contains(&place.z) {
                    let mut normal = DVec3::ZERO;
                    normal[axis] = -direction[axis].signum();
                    nearest = Some(WallHit { depth, normal });
                }
            }
        }
        nearest
    }
}

/// World height of the drawn surface over a place of a flat field; `None` where nothing is drawn.
fn height_at(scene: &Scene, place: DVec3) -> Option<f64> {
    let placed = &scene.placed;
    let at: [f64; 2] = std::array::from_fn(|axis| {
        let at = (place[1 - axis] - placed.origin[1 - axis]) / placed.step[1 - axis];
        at.clamp(0.0, (scene.lattice.samples[axis] - 1) as f64)
    });
    let cell: [u64; 2] = std::array::from_fn(|axis| (at[axis] as u64).min(scene.lattice.samples[axis] - 2));
    let mesh = &scene.meshes[scene.cut.at(cell[0], cell[1])?];
    let [row, column] = mesh.cell_at(cell);
    let frame = CellFrame::of(mesh, [row, column]);
    let [v, u] = [0, 1].map(|axis| (at[axis] - frame.first[axis]) / frame.size[axis]);
    let is_on = |corners: [usize; 3]| weights(corners, [u, v]).into_iter().all(|weight| weight >= -BESIDE);
    let found = mesh.cell(row, column).triangles().find(|triangle| is_on(triangle.corners))?;
    let [p, q, s] = found.at;
    Some(placed.lifted(p + q * u + s * v))
}
