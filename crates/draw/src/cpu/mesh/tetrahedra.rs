//! Marching tetrahedra. Each cell is cut into six tetrahedra along its diagonal from the corner of smallest coordinates
//! (Kuhn 1960, Freudenthal 1942). All cells are cut alike, so the faces of neighbours agree and the surface has no
//! cracks; a tetrahedron has no ambiguous case.
//!
//! A corner of a cell is a mask: bit 0 stands for x, bit 1 for y, bit 2 for z. An edge of a tetrahedron leads from a
//! point to one whose mask holds its own; the difference of both is the edge's direction, one of seven.

mod caps;

use super::Vertex;
use super::lattice::{BEFORE, BLOCK, Faces, Lattice, LatticePlacement, Samples};
use super::weld::{BrickMesh, Shared};
use glam::DVec3;

/// Corners of each tetrahedron between corner 0 and corner 7, and whether they make a right-handed system.
const TETRAHEDRA: [([usize; 4], bool); 6] = [
    ([0, 1, 3, 7], true),
    ([0, 2, 6, 7], true),
    ([0, 4, 5, 7], true),
    ([0, 1, 5, 7], false),
    ([0, 2, 3, 7], false),
    ([0, 4, 6, 7], false),
];

/// Directions of edges, and that of no edge: a vertex at the point itself.
const DIRECTIONS: usize = 8;

/// Vertices keep this share of an edge away from its ends, so that no two of them fall together.
const NEAREST: f64 = 1e-4;

/// No vertex on this edge yet.
const NONE: u32 = u32::MAX;

/// Where the surface is looked for, and what it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Space<'a> {
    pub lattice: &'a Lattice,
    pub faces: Faces,
    pub placement: Option<LatticePlacement>,
    pub isovalue: f64,
    /// See [`super::Field::least_filled`].
    pub least_filled: Option<f64>,
}

/// The part of the surface in a brick whose first cell is `corner`. Cells beyond the lattice are left out.
pub(super) fn march(space: Space, corner: [u32; 3], samples: &Samples) -> BrickMesh {
    let Space { lattice, placement, .. } = space;
    let side = samples.side();
    let points = (side + 1) * (side + 1) * DIRECTIONS;
    let cells = [0, 1, 2].map(|axis| side.min(lattice.cells[axis].saturating_sub(corner[axis]) as usize));
    let mut steps = [0; 8];
    for (mask, step) in steps.iter_mut().enumerate() {
        *step = samples.index([mask & 1, mask >> 1 & 1, mask >> 2]);
    }
    let center = placement.map_or(lattice.center(), |placement| placement.point(lattice.center()));
    let mut marcher = Marcher {
        space,
        center,
        corner,
        samples,
        steps,
        layers: [vec![NONE; points], vec![NONE; points]],
        mesh: BrickMesh::default(),
    };
    for z in 0..cells[2] {
        // What the layer before last was is the layer after this one.
        marcher.layers[(z + 1) & 1].fill(NONE);
        marcher.layer(z, cells);
    }
    let mut mesh = marcher.mesh;
    mesh.finish(center);
    mesh
}

struct Marcher<'a> {
    space: Space<'a>,
    /// The lattice's middle, world units.
    center: DVec3,
    corner: [u32; 3],
    samples: &'a Samples,
    /// From a point to each corner of its cell among the samples.
    steps: [usize; 8],
    /// Vertices on edges that begin at the points of even and of odd layers.
    layers: [Vec<u32>; 2],
    mesh: BrickMesh,
}

impl Marcher<'_> {
    /// The active blocks' cells with this z.
    fn layer(&mut self, z: usize, cells: [usize; 3]) {
        let blocks = self.samples.blocks();
        for y in 0..cells[1] {
            for block in 0..blocks {
                if !self.samples.active[((z / BLOCK) * blocks + y / BLOCK) * blocks + block] {
                    continue;
                }
                for x in block * BLOCK..cells[0].min((block + 1) * BLOCK) {
                    self.cell([x, y, z]);
                }
            }
        }
    }

    fn cell(&mut self, cell: [usize; 3]) {
        let at = self.samples.index(cell.map(|index| index + BEFORE));
        let mut inside = 0_u8;
        for (corner, step) in self.steps.iter().enumerate() {
            inside |= u8::from(self.is_inside(at + step)) << corner;
        }
        if inside == 0 {
            return;
        }
        if inside != u8::MAX {
            for (corners, is_right) in TETRAHEDRA {
                self.tetrahedron(cell, corners, is_right, inside);
            }
        }
        if self.space.faces != Faces::Open {
            self.cut_off(cell, inside);
        }
    }

    /// Whether a point is within the surface.
    #[inline]
    fn is_inside(&self, at: usize) -> bool {
        self.samples.values[at] >= self.space.isovalue
            && self.space.least_filled.is_none_or(|least| self.samples.filled[at] >= least)
    }

    /// Adds the triangles of a tetrahedron, each counter-clockwise as seen from where the field is low.
    fn tetrahedron(&mut self, cell: [usize; 3], corners: [usize; 4], is_right: bool, inside: u8) {
        let (mut within, mut without) = ([0; 4], [0; 4]);
        let (mut high, mut low) = (0, 0);
        // Whether putting the corners within first changes their handedness.
        let mut is_odd = false;
        for corner in corners {
            if inside >> corner & 1 == 1 {
                is_odd ^= low & 1 == 1;
                within[high] = corner;
                high += 1;
            } else {
                without[low] = corner;
                low += 1;
            }
        }
        // In a right-handed system (a, b, c, d) the triangle on the edges from a to b, c and d is seen
        // counter-clockwise from their side. Moving the last corner to the front is an odd permutation, and looking
        // from the other side undoes it.
        let is_flipped = is_odd == is_right;
        match high {
            1 => {
                let ends = without.map(|end| (within[0], end));
                self.triangle(cell, [ends[0], ends[1], ends[2]], is_flipped);
            }
            3 => {
                let ends = within.map(|end| (without[0], end));
                self.triangle(cell, [ends[0], ends[1], ends[2]], is_flipped);
            }
            2 => {
                let ([a, b, ..], [c, d, ..]) = (within, without);
                self.triangle(cell, [(a, c), (a, d), (b, d)], is_flipped);
                self.triangle(cell, [(a, c), (b, d), (b, c)], is_flipped);
            }
            _ => {}
        }
    }

    fn triangle(&mut self, cell: [usize; 3], edges: [(usize, usize); 3], is_flipped: bool) {
        let [a, b, c] = edges.map(|(from, to)| self.vertex(cell, from, to));
        let is_flipped = is_flipped != self.is_mirrored();
        self.mesh.triangles.push(if is_flipped { [a, c, b] } else { [a, b, c] });
    }

    /// The number of the vertex between two corners of a cell, which is made where there is none yet.
    fn vertex(&mut self, cell: [usize; 3], a: usize, b: usize) -> u32 {
        let (lower, direction) = (a & b, a ^ b);
        let point = [0, 1, 2].map(|axis| cell[axis] + (lower >> axis & 1));
        let side = self.samples.side();
        let slot = (point[1] * (side + 1) + point[0]) * DIRECTIONS + direction;
        let known = self.layers[point[2] & 1][slot];
        if known != NONE {
            return known;
        }
        let number = self.mesh.vertices.len() as u32;
        self.layers[point[2] & 1][slot] = number;
        let vertex = if direction == 0 { self.at_point(point) } else { self.placed(point, direction) };
        self.mesh.vertices.push(vertex);
        // Along each axis in whose face of the brick the edge lies there is another brick that has it.
        let on_face = |axis: &usize| {
            let first = self.corner[*axis];
            let is_before = point[*axis] == 0 && first > 0;
            let is_behind = point[*axis] == side && first as usize + side < self.space.lattice.cells[*axis] as usize;
            direction >> axis & 1 == 0 && (is_before || is_behind)
        };
        let faces = (0..3).filter(on_face).count();
        if faces > 0 {
            let global = [0, 1, 2].map(|axis| u64::from(self.corner[axis]) + point[axis] as u64);
            let key = ((global[2] << 20 | global[1]) << 20 | global[0]) << 3 | direction as u64;
            self.mesh.shared.push(Shared { vertex: number, key, uses: 1 << faces, component: 0 });
        }
        number
    }

    /// The vertex on an edge. Nothing depends on the brick here, so that neighbours have the same one to the last bit.
    fn placed(&self, point: [usize; 3], direction: usize) -> Vertex {
        let at = self.samples.index(point.map(|index| index + BEFORE));
        let to = at + self.steps[direction];
        let (values, share) = self.crossed(at, self.steps[direction]);
        let mut position = self.coordinates(point);
        for axis in 0..3 {
            if direction >> axis & 1 == 1 {
                position[axis] += self.space.lattice.spacing * share;
            }
        }
        let slope = |at: usize| {
            let axis = |mask: usize| {
                let (low, middle, high) = (values[at - self.steps[mask]], values[at], values[at + self.steps[mask]]);
                let both = high - low;
                if !both.is_nan() {
                    return both;
                }
                // Beside what has no value, the other side tells.
                let one = [high - middle, middle - low].into_iter().find(|rise| !rise.is_nan());
                one.map_or(0.0, |rise| 2.0 * rise)
            };
            DVec3::new(axis(1), axis(2), axis(4))
        };
        // What has no value counts as low.
        let rise = match (values[at].is_nan(), values[to].is_nan()) {
            (true, _) => 1.0,
            (false, true) => -1.0,
            (false, false) => values[to] - values[at],
        };
        let along = DVec3::from_array([0, 1, 2].map(|axis| (direction >> axis & 1) as f64)) * rise;
        let is_known = !values[at].is_nan() && !values[to].is_nan();
        let gradient = if is_known { slope(at).lerp(slope(to), share) } else { along };
        // Where the field is flat on both sides of a peak, the edge itself tells the way down.
        let normal = (-gradient).try_normalize().or_else(|| (-along).try_normalize()).unwrap_or(DVec3::Z);
        let between = |of: &[f64]| of[at] + share * (of[to] - of[at]);
        let value = if self.samples.weighted.is_empty() {
            0.0
        } else {
            between(&self.samples.weighted) / between(self.samples.weights())
        };
        self.vertex_at(position, normal, value)
    }

    /// What ends on an edge from a point to the one `step` behind it, and where, as a share of the edge: the field's values
    /// above the isovalue, or what is known of it, whichever is nearer to the end within.
    fn crossed(&self, at: usize, step: usize) -> (&[f64], f64) {
        let (values, filled) = (self.samples.values.as_slice(), self.samples.filled.as_slice());
        let (to, isovalue) = (at + step, self.space.isovalue);
        let share = |of: &[f64], level: f64| crossing([of[at - step], of[at], of[to], of[to + step]], level);
        let is_crossed = |of: &[f64], level: f64| (of[at] >= level) != (of[to] >= level);
        let Some(least) = self.space.least_filled.filter(|least| is_crossed(filled, *least)) else {
            return (values, share(values, isovalue));
        };
        let end = share(filled, least);
        // Where nothing is the field has no value, and does not tell where it is left.
        if values[at].is_nan() || values[to].is_nan() || !is_crossed(values, isovalue) {
            return (filled, end);
        }
        let own = share(values, isovalue);
        if (own < end) == (filled[at] >= least) { (values, own) } else { (filled, end) }
    }

    /// Where a point is on the lattice, in its own coordinates.
    fn coordinates(&self, point: [usize; 3]) -> DVec3 {
        let coordinate =
            |axis: usize| self.space.lattice.coordinate(axis, i64::from(self.corner[axis]) + point[axis] as i64);
        DVec3::from_array([0, 1, 2].map(coordinate))
    }

    /// A vertex with a place and a normal in the lattice's coordinates.
    fn vertex_at(&self, position: DVec3, normal: DVec3, value: f64) -> Vertex {
        let (position, normal) = match &self.space.placement {
            None => (position, normal),
            Some(placement) => (placement.point(position), placement.normal(normal)),
        };
        Vertex { position, normal: normal.as_vec3(), value: value as f32 }
    }

    /// Whether the world is the lattice's mirror image.
    fn is_mirrored(&self) -> bool {
        self.space.placement.is_some_and(|placement| placement.is_mirrored())
    }
}

/// Where between two neighbours the field is `isovalue`, as a share of the edge: on the cubic through four points in a
/// row, whose slopes are limited so that it rises or falls all the way (Fritsch and Carlson 1980).
///
/// Neighbours without a value (NaN) have none on the line on, and a crossing to one is half-way.
fn crossing([before, from, to, behind]: [f64; 4], isovalue: f64) -> f64 {
    let rise = to - from;
    let before = if before.is_nan() { from - rise } else { before };
    let behind = if behind.is_nan() { to + rise } else { behind };
    let target = (isovalue - from) / rise;
    let slope = |six_times: f64| (six_times / (6.0 * rise)).clamp(0.0, 3.0);
    let start = slope(6.0 * to - 3.0 * from - 2.0 * before - behind);
    let end = slope(before - 6.0 * from + 3.0 * to + 2.0 * behind);
    let (mut low, mut high, mut share) = (0.0, 1.0, target);
    for _ in 0..24 {
        let t: f64 = share;
        let left = t - 1.0;
        let off = t * (left * (left * start + t * end) + t * (3.0 - 2.0 * t)) - target;
        if off.abs() < 1e-12 {
            break;
        }
        if off > 0.0 {
            high = t;
        } else {
            low = t;
        }
        let climb = start * (3.0 * t * t - 4.0 * t + 1.0) + end * (3.0 * t * t - 2.0 * t) + 6.0 * t * (1.0 - t);
        let next = t - off / climb;
        share = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    // Values beyond the largest number leave no share, and what has no value has none.
    let share = if share.is_nan() { 0.5 } else { share };
    share.clamp(NEAREST, 1.0 - NEAREST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tetrahedra_fill_the_cell_and_are_handed_as_said() {
        let corner = |mask: usize| DVec3::from_array([0, 1, 2].map(|axis| (mask >> axis & 1) as f64));
        let mut volume = 0.0;
        for (corners, is_right) in TETRAHEDRA {
            let [a, b, c, d] = corners.map(corner);
            let sixfold = (b - a).dot((c - a).cross(d - a));
            assert_eq!(sixfold > 0.0, is_right, "{corners:?}");
            volume += sixfold.abs() / 6.0;
        }
        assert!((volume - 1.0).abs() < 1e-12);
    }

    #[test]
    fn cubics_are_met_where_they_are() {
        // 1 + t + t^2 / 4 + t^3 / 8 at -1, 0, 1, 2.
        let cubic = |t: f64| 1.0 + t + 0.25 * t * t + 0.125 * t * t * t;
        let around = [-1.0, 0.0, 1.0, 2.0].map(cubic);
        for t in [0.1, 0.25, 0.5, 0.9] {
            assert!((crossing(around, cubic(t)) - t).abs() < 1e-9, "{t}");
            let [a, b, c, d] = around;
            assert!((crossing([d, c, b, a], cubic(t)) - (1.0 - t)).abs() < 1e-9, "{t}");
        }
    }

    proptest! {
        #[test]
        fn a_crossing_is_on_its_edge(around in prop::array::uniform4(0.0..1e6f64), share in 0.0..1.0f64) {
            let isovalue = around[1] + share * (around[2] - around[1]);
            let found = crossing(around, isovalue);
            prop_assert!((NEAREST..=1.0 - NEAREST).contains(&found), "{found}");
        }
    }
}
