//! What the lattice's outer faces cut off of a surface: flat caps, or their share of the volume alone.
//!
//! Tetrahedra cut each square of a face in two along its diagonal from the corner of smallest coordinates. Of each such
//! triangle what is not low belongs to a cap, whose rim lies on the edges that the surface has vertices on.

use super::Marcher;
use crate::cpu::mesh::{BEFORE, Faces, Vertex};
use glam::DVec3;

impl Marcher<'_> {
    /// Cuts off a cell's share at the lattice's outer faces.
    pub(super) fn cut_off(&mut self, cell: [usize; 3], inside: u8) {
        for axis in 0..3 {
            let index = self.corner[axis] as usize + cell[axis];
            if index == 0 {
                self.cap(cell, inside, axis, false);
            }
            if index + 1 == self.space.lattice.cells[axis] as usize {
                self.cap(cell, inside, axis, true);
            }
        }
    }

    /// The share of a cell's face across an axis, at the low or at the high end.
    fn cap(&mut self, cell: [usize; 3], inside: u8, axis: usize, is_high: bool) {
        let (right, up) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let base = usize::from(is_high) << axis;
        // Counter-clockwise as seen from the axis' high end, then the other way round.
        let triangles = [[0, right, right | up], [0, right | up, up]];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| base | corner);
            let is_flipped = is_high == self.is_mirrored();
            self.cap_in(cell, inside, if is_flipped { [a, c, b] } else { [a, b, c] });
        }
    }

    /// The part of a triangle of corners that is not low, counter-clockwise as the triangle is.
    fn cap_in(&mut self, cell: [usize; 3], inside: u8, corners: [usize; 3]) {
        let is_inside = |corner: usize| inside >> corner & 1 == 1;
        // Ends of the edge that each of its corners lies on, twice the same of one at a point.
        let (mut ends, mut count) = ([(0, 0); 4], 0);
        for (place, &corner) in corners.iter().enumerate() {
            let next = corners[(place + 1) % 3];
            if is_inside(corner) {
                ends[count] = (corner, corner);
                count += 1;
            }
            if is_inside(corner) != is_inside(next) {
                ends[count] = (corner, next);
                count += 1;
            }
        }
        for last in 2..count {
            let triangle = [ends[0], ends[last - 1], ends[last]];
            if self.space.faces == Faces::Capped {
                let [a, b, c] = triangle.map(|(from, to)| self.vertex(cell, from, to));
                self.mesh.caps.push([a, b, c]);
            } else {
                let places = triangle.map(|(from, to)| self.place_of(cell, from, to) - self.center);
                self.mesh.cut_off(places);
            }
        }
    }

    /// Where a cap's corner is, without a vertex at points, which are not of the surface.
    fn place_of(&mut self, cell: [usize; 3], from: usize, to: usize) -> DVec3 {
        if from == to {
            let point = [0, 1, 2].map(|axis| cell[axis] + (from >> axis & 1));
            let at = self.coordinates(point);
            return self.space.placement.map_or(at, |placement| placement.point(at));
        }
        let vertex = self.vertex(cell, from, to);
        self.mesh.vertices[vertex as usize].position
    }

    /// The vertex of a cap at a point of the lattice's faces, with a normal out of them.
    pub(super) fn at_point(&self, point: [usize; 3]) -> Vertex {
        let outwards = |axis: usize| {
            let index = self.corner[axis] as usize + point[axis];
            let is_last = index == self.space.lattice.cells[axis] as usize;
            f64::from(is_last) - f64::from(index == 0)
        };
        let normal = DVec3::from_array([0, 1, 2].map(outwards)).normalize_or(DVec3::Z);
        let at = self.samples.index(point.map(|index| index + BEFORE));
        let value = self.samples.weighted.get(at).map_or(0.0, |weighted| weighted / self.samples.weights()[at]);
        self.vertex_at(self.coordinates(point), normal, value)
    }
}
