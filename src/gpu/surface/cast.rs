//! Where rays are cast: the squares of the picture that each chunk may be seen in.

use super::constants::TILE;
use super::globe;
use super::list::ends_of;
use crate::cpu::surface::stitch::Mesh;
use crate::picture::adapter::AdapterSurface;
use crate::view::View;
use bevy::math::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Samples of the picture around what is seen in double precision, for what single precision moves.
const AROUND: f64 = 1.0;

/// Where a box may be seen.
#[derive(Clone, Debug, PartialEq)]
struct Place {
    /// The least depth of its corners.
    depth: f64,
    /// Columns and rows of squares.
    squares: [Range<u32>; 2],
}

/// The chunks of a picture, near ones first, each with the squares of samples that it may be seen in: for each square the chunk's number and, in 16
/// bits each, the square's column and its row.
pub fn squares(job: &AdapterSurface) -> Vec<u32> {
    let seen = |(number, mesh): (usize, &Mesh)| Some((number as u32, seen_in(&job.view, corners_of(job, mesh)?)?));
    let mut places: Vec<(u32, Place)> = job.scene.meshes.par_iter().enumerate().filter_map(seen).collect();
    places.sort_by(|(_, a), (_, b)| a.depth.total_cmp(&b.depth));
    let mut words = Vec::new();
    for (number, Place { squares: [columns, rows], .. }) in &places {
        for row in rows.clone() {
            words.extend(columns.clone().flat_map(|column| [*number, row << 16 | column]));
        }
    }
    words
}

/// The corners of the box that a chunk's triangles are in; `None` where it has none.
fn corners_of(job: &AdapterSurface, mesh: &Mesh) -> Option<[DVec3; 8]> {
    if mesh.node.facts.is_empty() && mesh.membrane().is_none() {
        return None;
    }
    if job.is_globe() {
        return globe::around(&job.scene, mesh, ends_of(mesh));
    }
    let ends = |places: &[u64]| Some([*places.first()? as f64, *places.last()? as f64]);
    let (rows, columns, heights) = (ends(&mesh.rows)?, ends(&mesh.columns)?, ends_of(mesh));
    let placed = &job.scene.placed;
    Some(std::array::from_fn(|k| placed.world(rows[k >> 2], columns[k >> 1 & 1], heights[k & 1])))
}

/// Where a box with such corners may be seen; `None` where it is behind the eye, or beside the picture.
fn seen_in(view: &View, corners: [DVec3; 8]) -> Option<Place> {
    let camera = corners.map(|corner| view.to_camera(corner));
    let [depth, farthest] = camera
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], corner| [least.min(corner.z), most.max(corner.z)]);
    if farthest < 0.0 {
        return None;
    }
    let size = [view.width, view.height];
    // A box about the eye may be seen anywhere.
    let places: Option<Vec<[f64; 2]>> = camera.iter().map(|corner| view.to_pixels(*corner)).collect();
    let squares = [0, 1].map(|axis| {
        let end = f64::from(size[axis]);
        let [low, high] = places.as_ref().map_or([0.0, end], |places| {
            let along = places.iter().map(|place| place[axis]);
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
        });
        let first = (low - AROUND).clamp(0.0, end) as u32 / TILE;
        first..((high + AROUND).clamp(0.0, end).ceil() as u32).div_ceil(TILE)
    });
    let is_beside = squares.iter().any(Range::is_empty);
    (!is_beside).then_some(Place { depth, squares })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Projection;
    use proptest::prelude::*;

    fn vector(reach: f64) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-reach..reach).prop_map(DVec3::from)
    }

    proptest! {
        #[test]
        fn all_that_is_seen_of_a_box_is_in_its_squares(
            eye in vector(20.0), ahead in vector(1.0), low in vector(10.0), size in prop::array::uniform3(0.0..15.0f64),
            within in prop::collection::vec(prop::array::uniform3(0.0..=1.0f64), 24), is_perspective in any::<bool>(),
            pixels in prop::array::uniform2(1u32..200),
        ) {
            let projection = match is_perspective {
                true => Projection::Perspective { fov_y: 0.9 },
                false => Projection::Orthographic { height: 12.0 },
            };
            let up = DVec3::new(0.3, -0.2, 1.0);
            let Ok(view) = View::look_at(eye, eye + ahead, up, projection, pixels[0], pixels[1]) else { return Ok(()) };
            let size = DVec3::from(size);
            let corner = |k: usize| DVec3::new((k >> 2) as f64, (k >> 1 & 1) as f64, (k & 1) as f64);
            let found = seen_in(&view, std::array::from_fn(|k| low + corner(k) * size));
            for share in within {
                let camera = view.to_camera(low + DVec3::from(share) * size);
                let is_in = |place: &[f64; 2]| (0..2).all(|k| (0.0..f64::from(pixels[k])).contains(&place[k]));
                let Some(place) = view.to_pixels(camera).filter(is_in).filter(|_| camera.z >= 0.0) else { continue };
                let Some(found) = &found else { panic!("{camera} is seen") };
                prop_assert!(found.depth <= camera.z + 1e-9);
                prop_assert!((0..2).all(|k| found.squares[k].contains(&(place[k] as u32 / TILE))), "{found:?} {place:?}");
            }
        }
    }
}
