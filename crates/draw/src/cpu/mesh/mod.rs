//! Isosurfaces as meshes of triangles: closed where the field falls below the isovalue within the lattice, and of any
//! size, since only a few bricks of the lattice and the front between them are in memory.
//!
//! A [`Field`] is sampled at the points of a [`Lattice`], brick by brick. Cells are cut into tetrahedra
//! (`tetrahedra`), whose vertices lie on edges of the lattice and are joined by these across bricks (`weld`). What
//! reaches the lattice's outer faces is open there or closed by flat caps (`tetrahedra::caps`). A mesh that fits in
//! memory can be smoothed (`smooth`).
//! Triangles are counter-clockwise as seen from where the field is low; normals point there.

pub mod lattice;

mod smooth;
mod tetrahedra;
mod weld;

pub use lattice::{BEFORE, BLOCK, Faces, Lattice, LatticePlacement, MOST_CELLS, Samples};
pub use smooth::WholeMesh;
pub use weld::Piece;

use crate::model::Progress;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use tetrahedra::Space;
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

    /// Where the field ends, which closes the surface: where [`Samples::filled`], which is filled then, too, falls below
    /// this. `None` where it is known everywhere.
    fn least_filled(&self) -> Option<f64> {
        None
    }

    /// What becomes of the surface at the lattice's outer faces.
    fn faces(&self) -> Faces {
        Faces::Open
    }

    /// Where the lattice is in the world; `None` where its coordinates are the world's.
    fn placement(&self) -> Option<LatticePlacement> {
        None
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
    /// Down the field's gradient, or out of where it ends; of length 1.
    pub normal: Vec3,
    /// The attribute's mean; 0 where none is wanted.
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
    /// Its area without caps, squared length units.
    pub area: f64,
    /// Area of what the lattice's faces cut off, squared length units.
    pub cap_area: f64,
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
    let (faces, placement, least_filled) = (field.faces(), field.placement(), field.least_filled());
    let space = Space { lattice, faces, placement, isovalue, least_filled };
    for wave in bricks.chunks(AHEAD * rayon::current_num_threads()) {
        let found: Vec<Result<BrickMesh, F::Error>> = wave
            .par_iter()
            .map_init(
                || Samples::new(side, least_filled.is_some(), field.has_attribute()),
                |samples, &corner| {
                    samples.clear();
                    field.sample(corner, samples)?;
                    progress.advance(1);
                    Ok(tetrahedra::march(space, corner, samples))
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
    use glam::{DAffine3, DMat3};
    use proptest::prelude::*;
    use std::collections::HashMap;
    use std::convert::Infallible;
    use std::f64::consts::PI;

    /// A function of the place.
    struct Analytic<F> {
        lattice: Lattice,
        function: F,
        faces: Faces,
        placement: Option<LatticePlacement>,
    }

    impl<F: Fn(DVec3) -> f64 + Sync> Field for Analytic<F> {
        type Error = Infallible;

        fn faces(&self) -> Faces {
            self.faces
        }

        fn placement(&self) -> Option<LatticePlacement> {
            self.placement
        }

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
        mesh: WholeMesh,
    }

    fn whole(lattice: Lattice, side: usize, function: impl Fn(DVec3) -> f64 + Sync, isovalue: f64) -> Whole {
        placed(lattice, side, function, isovalue, (Faces::Open, None))
    }

    fn placed(
        lattice: Lattice,
        side: usize,
        function: impl Fn(DVec3) -> f64 + Sync,
        isovalue: f64,
        (faces, placement): (Faces, Option<LatticePlacement>),
    ) -> Whole {
        let field = Analytic { lattice, function, faces, placement };
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let mut mesh = WholeMesh::default();
        let bricks = lattice.bricks(side);
        let Ok(report) = extract(&lattice, (side, &bricks), isovalue, &field, &(), |piece| {
            vertices.extend(piece.fresh.iter().map(|&place| piece.vertices[place as usize]));
            let global = |triangle: &[u32; 3]| triangle.map(|place| piece.numbers[place as usize]);
            triangles.extend(piece.triangles.iter().map(global));
            assert!(mesh.take(piece));
            // Whoever has a vertex has it at the same place.
            for (vertex, &number) in piece.vertices.iter().zip(&piece.numbers) {
                assert_eq!(vertices[number as usize], *vertex);
            }
            Ok(())
        });
        Whole { report, vertices, triangles, mesh }
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

    #[test]
    fn what_the_lattice_cuts_off_is_closed_by_caps_or_counted() {
        let lattice = Lattice { origin: DVec3::new(1.0, -2.0, 0.5), spacing: 0.25, cells: [18, 21, 17] };
        let size = DVec3::from_array(lattice.cells.map(f64::from)) * lattice.spacing;
        let corner = lattice.origin;
        // A wall across y and its exact volume, area and caps: slopes are the same everywhere.
        let (at_x, slope) = (2.13719, 0.3);
        let wall = |at: DVec3| at_x - (at.x - corner.x) - slope * (at.y - corner.y);
        let volume = size.z * size.y * (at_x - 0.5 * slope * size.y);
        let area = size.z * size.y * (1.0 + slope * slope).sqrt();
        let sides = size.z * (size.y + 2.0 * at_x - slope * size.y) - size.z * size.y;
        let caps = size.z * size.y + sides + 2.0 * volume / size.z;
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
        for side in [8, 64] {
            let capped = placed(lattice, side, wall, 0.0, (Faces::Capped, None));
            assert_closed(&capped);
            let report = capped.report;
            assert!(close(report.volume, volume) && close(report.area, area), "{report:?} {volume} {area}");
            assert!(close(report.cap_area, caps), "{report:?} {caps}");
            assert_eq!((report.components, 2 * report.vertices), (1, report.triangles + 4));
            let cut = placed(lattice, side, wall, 0.0, (Faces::Cut, None)).report;
            assert!(close(cut.volume, volume) && close(cut.area, area) && close(cut.cap_area, caps), "{cut:?}");
            assert!(cut.boundary_edges > 0 && cut.triangles < report.triangles);
            // All of the lattice is within.
            let full = placed(lattice, side, |_| 1.0, 0.0, (Faces::Capped, None));
            assert_closed(&full);
            assert!(close(full.report.volume, size.element_product()) && full.report.area == 0.0, "{:?}", full.report);
        }
        // Elsewhere, stretched and mirrored.
        let matrix = DMat3::from_rotation_x(0.4) * DMat3::from_diagonal(DVec3::new(-1.0, 2.0, 3.0));
        let to_world = DAffine3::from_mat3_translation(matrix, DVec3::new(5.0, -7.0, 100.0));
        let placement = LatticePlacement::new(to_world);
        let away = placed(lattice, 8, wall, 0.0, (Faces::Capped, Some(placement)));
        assert_closed(&away);
        assert!(close(away.report.volume, 6.0 * volume), "{:?} {volume}", away.report);
        // Normals of the wall are across it there, too, and point out of it.
        let across = (matrix.inverse().transpose() * DVec3::new(1.0, slope, 0.0)).normalize();
        let on_wall = |vertex: &&Vertex| wall(to_world.inverse().transform_point3(vertex.position)).abs() < 1e-9;
        for vertex in away.vertices.iter().filter(on_wall) {
            assert!(vertex.normal.as_dvec3().distance(across) < 1e-6, "{vertex:?} {across}");
        }
    }

    #[test]
    fn a_surface_is_closed_around_what_has_no_value() {
        let center = CELLS.center();
        let ball = |at: DVec3| 1.2 - at.distance(center);
        let holes = whole(CELLS, 32, |at| if at.distance(center) < 0.5 { f64::NAN } else { ball(at) }, 0.0);
        assert_closed(&holes);
        assert_eq!(holes.report.components, 2);
        // Half a spacing of the hole's surface is not known.
        let volume = 4.0 / 3.0 * PI * (1.2_f64.powi(3) - 0.5_f64.powi(3));
        assert!((holes.report.volume / volume - 1.0).abs() < 0.02, "{} of {volume}", holes.report.volume);
        let is_out = |vertex: &&Vertex| vertex.position.distance(center) > 0.8;
        for vertex in holes.vertices.iter().filter(is_out) {
            assert!((vertex.position.distance(center) - 1.2).abs() < 2e-3, "{vertex:?}");
        }
    }

    #[test]
    fn smoothing_keeps_volumes_and_takes_away_noise() {
        let lattice = Lattice { origin: DVec3::ZERO, spacing: 1.0, cells: [24, 24, 24] };
        let (center, radius) = (DVec3::new(12.1, 11.9, 12.05), 9.0);
        // The same number for the same point in every brick.
        let noise = |at: DVec3| {
            let seed = at.dot(DVec3::new(1.0, 37.0, 1369.0)) * 0.618_033_988_749_894_9;
            let wild = (seed.sin() * 43758.5453).rem_euclid(1.0);
            2.0 * wild - 1.0
        };
        // How far triangles are from lying across the way from the centre: the mean of 1 - cos over the area.
        let roughness = |vertices: &[Vertex], triangles: &[[u32; 3]]| {
            let (mut along, mut area) = (0.0, 0.0);
            for triangle in triangles {
                let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize].position - center);
                let across = (b - a).cross(c - a);
                along += across.dot((a + b + c).normalize());
                area += across.length();
            }
            1.0 - along / area
        };
        let ball = move |at: DVec3| radius - at.distance(center);
        for strength in [0.0, 0.3] {
            let Whole { report, mut mesh, .. } = whole(lattice, 64, |at| ball(at) + strength * noise(at), 0.0);
            let before = mesh.clone().into_piece();
            let Ok(smooth) = mesh.smooth(20, report, || Ok::<(), Infallible>(()));
            let after = mesh.into_piece();
            assert!((smooth.volume / report.volume - 1.0).abs() < 1e-4, "{smooth:?} {report:?}");
            assert_eq!((smooth.triangles, smooth.boundary_edges), (report.triangles, 0));
            let rough = [&before, &after].map(|piece| roughness(&piece.vertices, &piece.triangles));
            if strength > 0.0 {
                assert!(rough[1] < 0.3 * rough[0] && smooth.area < 0.98 * report.area, "{rough:?} {smooth:?}");
            } else {
                let volume = 4.0 / 3.0 * PI * radius.powi(3);
                assert!((smooth.volume / volume - 1.0).abs() < 4e-3 && rough[1] < 1e-2, "{smooth:?} {rough:?}");
            }
            for vertex in &after.vertices {
                let out = (vertex.position - center).normalize();
                assert!(vertex.normal.as_dvec3().dot(out) > 0.3, "{vertex:?}");
            }
        }
        // What meets the lattice's faces stays there.
        let halved = Lattice { cells: [12, 24, 24], ..lattice };
        let Whole { report, mut mesh, .. } =
            placed(halved, 64, |at| ball(at) + 0.3 * noise(at), 0.0, (Faces::Capped, None));
        let before = mesh.clone().into_piece();
        // Whoever stops it finds it as it was.
        let mut left = 3;
        let stopped = mesh.smooth(10, report, || {
            left -= 1;
            if left > 0 { Ok(()) } else { Err("stopped") }
        });
        assert_eq!((stopped, left), (Err("stopped"), 0));
        assert_eq!(mesh.clone().into_piece().vertices, before.vertices);
        let Ok(smooth) = mesh.smooth(10, report, || Ok::<(), Infallible>(()));
        let after = mesh.into_piece();
        assert!((smooth.volume / report.volume - 1.0).abs() < 1e-4, "{smooth:?} {report:?}");
        let mut kept = 0;
        for (old, new) in before.vertices.iter().zip(&after.vertices) {
            if old.position.x == 12.0 {
                assert_eq!(old, new);
                kept += 1;
            } else {
                assert!(old.position.x < 12.0);
            }
        }
        assert!(kept > 200 && after.caps > 0, "{kept}");
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
