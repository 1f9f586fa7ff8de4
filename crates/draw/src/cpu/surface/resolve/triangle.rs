//! The place of a triangle under a pixel's centre: where the ray meets it, on a globe by steps, or the nearest one on its edges.

use super::super::placed::{GridRay, Map};
use super::super::rays::{CellFrame, curved_hit};
use super::super::sight::Sight;
use super::super::stitch::Mesh;
use super::{OUTSIDE, PLANE_STEPS, Resolver, weights};
use crate::view::{Projection, View};
use deepfield_heights::model::{Globe, Triangle};
use glam::DVec3;

impl Resolver<'_> {
    /// On a flat field: where the ray meets the triangle, or the place on its edges that appears nearest.
    pub(super) fn flat(
        &self,
        mesh: &Mesh,
        at: [usize; 2],
        triangle: &Triangle,
        frame: &CellFrame,
        ray: &GridRay,
        pixel: [f64; 2],
    ) -> [f64; 2] {
        let local = frame.ray(ray);
        let found = local.meets(triangle).map(|t| local.0.at(t));
        match found {
            Some([u, v, _]) if weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -OUTSIDE) => [u, v],
            // The centre is within rounding of an edge, or the triangle is seen from its edge: what it shows is on the edge.
            found => self.on_edge(mesh, at, triangle, pixel).unwrap_or_else(|| {
                let [u, v] = found.map_or([0.5, 0.5], |[u, v, _]| [u, v]);
                let weights = weights(triangle.corners, [u, v]).map(|weight| weight.max(0.0));
                let sum: f64 = weights.iter().sum();
                place(triangle.corners, weights.map(|weight| if sum > 0.0 { weight / sum } else { 1.0 / 3.0 }))
            }),
        }
    }

    /// The place on a triangle's edge that appears nearest to a pixel; `None` where a corner is not before the eye.
    fn on_edge(&self, mesh: &Mesh, at: [usize; 2], triangle: &Triangle, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let heights = mesh.surface_cell(at[0], at[1]).0;
        let mut seen = [([0.0; 2], 0.0); 3];
        for (seen, corner) in seen.iter_mut().zip(triangle.corners) {
            let (row, column) = (mesh.rows[at[0] + corner / 2], mesh.columns[at[1] + corner % 2]);
            *seen = self.project(self.vantage.relative(row, column, heights[corner]))?;
        }
        let is_perspective =
            !matches!(self.sight, Sight::Flat(View { projection: Projection::Orthographic { .. }, .. }));
        let mut best = (f64::INFINITY, [0.0; 3]);
        for k in 0..3 {
            let (next, (a, near), (b, far)) = ((k + 1) % 3, seen[k], seen[(k + 1) % 3]);
            let along = [b[0] - a[0], b[1] - a[1]];
            let square = along[0] * along[0] + along[1] * along[1];
            let share = if square > 0.0 { ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square } else { 0.0 };
            let share = share.clamp(0.0, 1.0);
            let away = (a[0] + share * along[0] - x).hypot(a[1] + share * along[1] - y);
            if away < best.0 {
                // Halves of an edge in the picture are not halves of it in space.
                let share = match is_perspective {
                    true if near > 0.0 && far > 0.0 => share / far / ((1.0 - share) / near + share / far),
                    _ => share,
                };
                let mut weights = [0.0; 3];
                (weights[k], weights[next]) = (1.0 - share, share);
                best = (away, weights);
            }
        }
        best.0.is_finite().then(|| place(triangle.corners, best.1))
    }

    /// On a globe: where the ray first meets the curved triangle itself; `None` where it passes by.
    pub(super) fn exact(
        &self,
        mesh: &Mesh,
        at: [usize; 2],
        triangle: &Triangle,
        origin: DVec3,
        direction: DVec3,
    ) -> Option<[f64; 2]> {
        let spread = self.spread.as_ref()?;
        let frame = CellFrame::of(mesh, at);
        let ends = |axis: usize| [frame.first[axis], frame.first[axis] + frame.size[axis]];
        let heights = mesh.surface_cell(at[0], at[1]).0.into_iter().filter(|height| !height.is_nan());
        let range = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(h), high.max(h)]);
        let heights = spread.lifted(range);
        let part = [0.0, f64::INFINITY];
        let courses = spread.courses(origin.to_array(), direction.to_array(), part, heights[1]);
        courses.iter().find_map(|course| {
            let span = course.within(ends(0), ends(1), heights, course.span)?;
            curved_hit(&self.scene.placed, mesh, at, triangle, course, span).map(|(_, place)| place)
        })
    }

    /// On a globe: first where the ray meets the flat triangle, then, by Newton's steps, where heights above the sphere agree.
    pub(super) fn curved(
        &self,
        mesh: &Mesh,
        at: [usize; 2],
        triangle: &Triangle,
        origin: DVec3,
        direction: DVec3,
    ) -> [f64; 2] {
        let (rows, columns) = ([at[0], at[0] + 1].map(|r| mesh.rows[r]), [at[1], at[1] + 1].map(|c| mesh.columns[c]));
        let heights = mesh.surface_cell(at[0], at[1]).0;
        let corners = triangle.corners.map(|corner| {
            self.scene.placed.world(rows[corner / 2] as f64, columns[corner % 2] as f64, heights[corner])
        });
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let mut t = normal.dot(corners[0] - origin) / normal.dot(direction);
        let Map::Globe(globe) = self.scene.placed.map else { return [0.5; 2] };
        let middle = 0.5 * (columns[0] + columns[1]) as f64;
        let local = |t: f64| {
            let [row, column, height] = self.about(&globe, origin + t * direction, middle);
            let u = (column - columns[0] as f64) / (columns[1] - columns[0]) as f64;
            let v = (row - rows[0] as f64) / (rows[1] - rows[0]) as f64;
            ([u, v], height)
        };
        let [p, q, s] = triangle.at;
        let above = |t: f64| {
            let ([u, v], height) = local(t);
            height - self.scene.placed.lifted(p + q * u + s * v)
        };
        let scale = (corners[1] - corners[0]).length() / direction.length();
        let (start, small) = (t, 1e-5 * scale);
        let mut is_found = false;
        for _ in 0..24 {
            let here = above(t);
            let change = small * here / (above(t + small) - here);
            if !change.is_finite() || (t - change - start).abs() > 4.0 * scale {
                break;
            }
            t -= change;
            is_found = change.abs() < 1e-14 * t.abs();
            if is_found {
                break;
            }
        }
        // At the limb the ray is below the surface for a little only, and runs along it there: back to before it, then by halves.
        if !is_found && above(start) < 0.0 {
            let step = 0.125 * scale;
            if let Some(before) = (1..=64).map(|k| start - step * f64::from(k)).find(|t| above(*t) > 0.0) {
                let (mut low, mut high) = (before, before + step);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if above(middle) > 0.0 { low = middle } else { high = middle }
                }
                t = 0.5 * (low + high);
            }
        }
        local(t).0
    }

    /// Row, column and what is above a globe at a place of the world, of all turns of the globe that nearest to a column.
    fn about(&self, globe: &Globe, place: DVec3, near: f64) -> [f64; 3] {
        let (origin, step) = (self.scene.placed.origin, self.scene.placed.step);
        let [longitude, latitude, height] = globe.geodetic(place.to_array());
        let wanted = near.mul_add(step[0], origin[0]);
        let longitude = longitude + 360.0 * ((wanted - longitude) / 360.0).round();
        [(latitude - origin[1]) / step[1], (longitude - origin[0]) / step[0], height]
    }

    /// Where a ray meets what has a height at a row and a column, and to which a column and a row add the two of `slope`; on a globe near there.
    /// Column, row and height; `None` where it does not, or behind its origin.
    pub(in crate::cpu::surface) fn on_plane(
        &self,
        (origin, direction): (DVec3, DVec3),
        own: [f64; 2],
        height: f64,
        slope: [f64; 2],
    ) -> Option<[f64; 3]> {
        let placed = &self.scene.placed;
        let Map::Globe(globe) = placed.map else {
            return placed.ray(origin, direction)?.on_plane(own, height, slope);
        };
        let at = |t: f64| {
            let [row, column, lifted] = self.about(&globe, origin + t * direction, own[1]);
            let height = height + slope[0] * (column - own[1]) + slope[1] * (row - own[0]);
            ([column, row, height], lifted - placed.lifted(height))
        };
        // By Newton's steps from where the ray is nearest to the sample.
        let away = placed.world(own[0], own[1], height) - origin;
        let mut t = away.dot(direction) / direction.length_squared();
        let [across, along] = placed.spacing();
        let small = 1e-5 * across.max(along) / direction.length();
        for _ in 0..PLANE_STEPS {
            let (place, above) = at(t);
            let change = small * above / (at(t + small).1 - above);
            if !change.is_finite() {
                break;
            }
            t -= change;
            if change.abs() < small {
                return (t > 0.0).then_some(place);
            }
        }
        None
    }

    /// The triangle of the cut at a place of a cell that is not in a triangle of it; `None` where it is, and where there is none.
    pub(super) fn beside(
        &self,
        mesh: &Mesh,
        at: [usize; 2],
        triangle: &Triangle,
        [u, v]: [f64; 2],
    ) -> Option<(&Mesh, [usize; 2], Triangle)> {
        if weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -OUTSIDE) {
            return None;
        }
        let frame = CellFrame::of(mesh, at);
        let place = [v.mul_add(frame.size[0], frame.first[0]), u.mul_add(frame.size[1], frame.first[1])];
        let lattice = &self.scene.lattice;
        let cell: [u64; 2] = std::array::from_fn(|axis| (place[axis].max(0.0) as u64).min(lattice.samples[axis] - 2));
        let mesh = self.scene.meshes.get(self.scene.cut.at(cell[0], cell[1])?)?;
        let at = mesh.cell_at(cell);
        let frame = CellFrame::of(mesh, at);
        let [v, u] = [0, 1].map(|axis| (place[axis] - frame.first[axis]) / frame.size[axis]);
        let is_in = |triangle: &Triangle| weights(triangle.corners, [u, v]).into_iter().all(|weight| weight >= -1e-6);
        mesh.triangles(at[0], at[1]).map(|(triangle, _)| triangle).find(is_in).map(|triangle| (mesh, at, triangle))
    }
}

/// The place of a cell where its triangle's corners count so much.
fn place(corners: [usize; 3], weights: [f64; 3]) -> [f64; 2] {
    let sum = |bit: fn(usize) -> usize| (0..3).map(|k| weights[k] * bit(corners[k]) as f64).sum();
    [sum(|corner| corner % 2), sum(|corner| corner / 2)]
}
