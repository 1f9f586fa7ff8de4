//! Isosurfaces as meshes of triangles: closed where the field falls below the isovalue within the lattice, and of any
//! size, since only a few bricks of the lattice and the front between them are in memory.
//!
//! A [`Field`] is sampled at the points of a [`Lattice`], brick by brick. Cells are cut into tetrahedra
//! (`tetrahedra`), whose vertices lie on edges of the lattice and are joined by these across bricks (`weld`).
//! Triangles are counter-clockwise as seen from where the field is low; normals point there.

pub mod lattice;

mod tetrahedra;
mod weld;

pub use lattice::{BEFORE, BLOCK, Lattice, MOST_CELLS, Samples};
pub use weld::Piece;

use crate::model::Progress;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use weld::{BrickMesh, Weld};

/// Cells along an edge of a brick.
pub const BRICK: usize = 64;

/// Bricks of a thread that are in memory at once.
const AHEAD: usize = 2;

/// What has an isosurface.
pub trait Field: Sync {
    /// Why it cannot be sampled.
    type Error: Send;

    /// Whether an attribute's mean is wanted at vertices: [`Samples::weighted`] is filled then, too.
    fn has_attribute(&self) -> bool {
        false
    }

    /// Fills the samples of a brick, which are zero before, and tells which blocks are active. A point must have the
    /// same value to the last bit in every brick that has it.
    ///
    /// # Errors
    /// Where it cannot be sampled.
    fn sample(&self, corner: [u32; 3], samples: &mut Samples) -> Result<(), Self::Error>;
}

/// A vertex of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Where it is, world units.
    pub position: DVec3,
    /// Down the field's gradient; of length 1.
    pub normal: Vec3,
    /// The attribute's mean, weighted with mass (F12 equation 3.2); 0 where none is wanted.
    pub value: f32,
}

/// What a surface is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MeshReport {
    /// Number of vertices.
    pub vertices: u64,
    /// Number of triangles.
    pub triangles: u64,
    /// What it encloses (divergence theorem), cubed length units; negative around holes.
    pub volume: f64,
    /// Its area, squared length units.
    pub area: f64,
    /// Parts that do not hang together.
    pub components: u64,
    /// Edges that are not between two triangles of opposite directions; 0 for a closed surface.
    pub boundary_edges: u64,
}

/// Finds the surface where a field is `isovalue` in these bricks of a lattice, each told by its first cell, with `side`
/// cells along each edge, a multiple of [`BLOCK`]. Hands it over brick by brick, in their order. `progress` hears of
/// bricks.
///
/// # Errors
/// Where the field cannot be sampled, or `take` fails.
pub fn extract<F: Field>(
    lattice: &Lattice,
    (side, bricks): (usize, &[[u32; 3]]),
    isovalue: f64,
    field: &F,
    progress: &dyn Progress,
    mut take: impl FnMut(&Piece) -> Result<(), F::Error>,
) -> Result<MeshReport, F::Error> {
    let mut weld = Weld::default();
    for wave in bricks.chunks(AHEAD * rayon::current_num_threads()) {
        let found: Vec<Result<BrickMesh, F::Error>> = wave
            .par_iter()
            .map_init(
                || Samples::new(side, field.has_attribute()),
                |samples, &corner| {
                    samples.clear();
                    field.sample(corner, samples)?;
                    progress.advance(1);
                    Ok(tetrahedra::march(lattice, corner, samples, isovalue))
                },
            )
            .collect();
        for mesh in found {
            take(&weld.join(mesh?))?;
        }
    }
    Ok(weld.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;
    use std::convert::Infallible;
    use std::f64::consts::PI;

    /// A function of the place.
    struct Analytic<F> {
        lattice: Lattice,
        function: F,
    }

    impl<F: Fn(DVec3) -> f64 + Sync> Field for Analytic<F> {
        type Error = Infallible;

        fn sample(&self, corner: [u32; 3], samples: &mut Samples) -> Result<(), Infallible> {
            let row = samples.row();
            for z in 0..row {
                for y in 0..row {
                    for x in 0..row {
                        let point = |axis: usize, local: usize| {
                            self.lattice.coordinate(axis, i64::from(corner[axis]) + local as i64 - BEFORE as i64)
                        };
                        let index = samples.index([x, y, z]);
                        samples.values[index] = (self.function)(DVec3::new(point(0, x), point(1, y), point(2, z)));
                    }
                }
            }
            samples.active.fill(true);
            Ok(())
        }
    }

    struct Whole {
        report: MeshReport,
        vertices: Vec<Vertex>,
        triangles: Vec<[u64; 3]>,
    }

    fn whole(lattice: Lattice, side: usize, function: impl Fn(DVec3) -> f64 + Sync, isovalue: f64) -> Whole {
        let field = Analytic { lattice, function };
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let bricks = lattice.bricks(side);
        let Ok(report) = extract(&lattice, (side, &bricks), isovalue, &field, &(), |piece| {
            vertices.extend(piece.fresh.iter().map(|&place| piece.vertices[place as usize]));
            let global = |triangle: &[u32; 3]| triangle.map(|place| piece.numbers[place as usize]);
            triangles.extend(piece.triangles.iter().map(global));
            // Whoever has a vertex has it at the same place.
            for (vertex, &number) in piece.vertices.iter().zip(&piece.numbers) {
                assert_eq!(vertices[number as usize], *vertex);
            }
            Ok(())
        });
        Whole { report, vertices, triangles }
    }

    fn assert_closed(whole: &Whole) {
        let mut edges: HashMap<(u64, u64), [u32; 2]> = HashMap::new();
        for &[a, b, c] in &whole.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.entry((from.min(to), from.max(to))).or_default()[usize::from(from < to)] += 1;
            }
        }
        assert!(edges.values().all(|directions| *directions == [1, 1]));
        assert_eq!(whole.report.boundary_edges, 0);
        assert_eq!(whole.report.vertices, whole.vertices.len() as u64);
        assert_eq!(whole.report.triangles, whole.triangles.len() as u64);
    }

    const CELLS: Lattice = Lattice { origin: DVec3::new(-1.3, 2.0, 0.4), spacing: 0.05, cells: [70, 71, 72] };

    #[test]
    fn a_ball_has_its_volume_and_is_closed() {
        let (center, radius) = (CELLS.center() + DVec3::new(0.013, -0.017, 0.021), 1.6);
        let ball = whole(CELLS, 64, |at| radius - at.distance(center), 0.0);
        assert_closed(&ball);
        let (volume, area) = (4.0 / 3.0 * PI * radius.powi(3), 4.0 * PI * radius * radius);
        assert!((ball.report.volume / volume - 1.0).abs() < 1e-3, "{} of {volume}", ball.report.volume);
        assert!((ball.report.area / area - 1.0).abs() < 1e-2, "{} of {area}", ball.report.area);
        assert_eq!(ball.report.components, 1);
        // Euler's number of a sphere.
        assert_eq!(2 * ball.report.vertices, ball.report.triangles + 4);
        for vertex in &ball.vertices {
            let out = (vertex.position - center).normalize();
            assert!(vertex.normal.as_dvec3().dot(out) > 0.99, "{vertex:?}");
            assert!((vertex.position.distance(center) - radius).abs() < 2e-2 * CELLS.spacing, "{vertex:?}");
        }
    }

    #[test]
    fn a_shell_has_two_parts_and_what_leaves_the_lattice_is_open() {
        let center = CELLS.center();
        let shell = whole(CELLS, 16, |at| 0.4 - (at.distance(center) - 1.0).abs(), 0.1);
        assert_closed(&shell);
        assert_eq!(shell.report.components, 2);
        let volume = 4.0 / 3.0 * PI * (1.3_f64.powi(3) - 0.7_f64.powi(3));
        assert!((shell.report.volume / volume - 1.0).abs() < 2e-3, "{} of {volume}", shell.report.volume);
        // Each square of the lattice's border is cut in two.
        let plane = whole(CELLS, 32, |at| center.x - at.x, 0.012);
        assert_eq!(plane.report.boundary_edges, 4 * u64::from(CELLS.cells[1] + CELLS.cells[2]));
    }

    #[test]
    fn nothing_where_nothing_crosses() {
        assert_eq!(whole(CELLS, 64, |_| 1.0, 2.0).report, MeshReport::default());
        assert_eq!(whole(CELLS, 64, |_| 1.0, 0.5).report, MeshReport::default());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        /// Bricks of any size give the same surface, of a field that meets the isovalue at lattice points, too.
        #[test]
        fn the_size_of_bricks_changes_nothing(
            balls in prop::collection::vec((prop::array::uniform3(0.4..1.1f64), 0.1..0.3f64), 1..6),
            isovalue in prop_oneof![Just(0.0), -0.05..0.05f64],
            is_rounded: bool,
        ) {
            let lattice = Lattice { origin: DVec3::ZERO, spacing: 0.05, cells: [30, 31, 33] };
            let field = |at: DVec3| {
                let ball = |(center, radius): &([f64; 3], f64)| radius - at.distance(DVec3::from_array(*center));
                let value = balls.iter().map(ball).fold(f64::NEG_INFINITY, f64::max);
                if is_rounded { (value * 20.0).round() / 20.0 } else { value }
            };
            let [small, large] = [8, 64].map(|side| whole(lattice, side, field, isovalue));
            assert_closed(&small);
            assert_closed(&large);
            prop_assert_eq!(small.report.vertices, large.report.vertices);
            prop_assert_eq!(small.report.triangles, large.report.triangles);
            prop_assert_eq!(small.report.components, large.report.components);
            let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1e-6 + a.abs());
            prop_assert!(close(small.report.volume, large.report.volume), "{:?} {:?}", small.report, large.report);
            prop_assert!(close(small.report.area, large.report.area), "{:?} {:?}", small.report, large.report);
        }
    }
}
