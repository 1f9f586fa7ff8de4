//! Smoothing of a mesh that is in memory as a whole, by Taubin's filter ("A signal processing approach to fair surface
//! design", 1995, section 4): each vertex goes part of the way to the mean of its neighbours, then a little more back, so
//! that what is shorter than some edges is smoothed and the rest neither shrinks nor grows. What volume is lost in spite
//! of that is given back along the normals.

use super::{MeshReport, Piece, Vertex};
use crate::model::mixing::{GOLDEN, mix_bits};
use glam::DVec3;
use rayon::prelude::*;

/// How far a vertex goes to the mean of its neighbours, of the way (lambda).
const FORTH: f64 = 0.5;

/// Waves below this one are kept, as a share of the mean's distance (the pass-band frequency, Taubin's equation 9).
const PASS_BAND: f64 = 0.02;

/// How far it goes back, of the way (mu, which is negative).
const BACK: f64 = 1.0 / (PASS_BAND - 1.0 / FORTH);

/// How often the volume is brought nearer to what it was; each time the rest is of second order.
const CORRECTIONS: usize = 2;

/// Bytes for a vertex: itself, its place before and behind, its vector area, its part of the graph.
const VERTEX_BYTES: u64 = 144;

/// Bytes for a triangle: itself, and a neighbour of each corner.
const TRIANGLE_BYTES: u64 = 24;

/// A mesh in memory.
#[derive(Clone, Debug, Default)]
pub struct WholeMesh {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
    caps: Vec<[u32; 3]>,
}

impl WholeMesh {
    /// Takes the next piece. False where there are more vertices than it has numbers for.
    pub fn take(&mut self, piece: &Piece) -> bool {
        if u32::try_from(self.vertices.len() + piece.fresh.len()).is_err() {
            return false;
        }
        self.vertices.extend(piece.fresh.iter().map(|&place| piece.vertices[place as usize]));
        let (surface, caps) = piece.triangles.split_at(piece.triangles.len() - piece.caps);
        let whole = |triangle: &[u32; 3]| triangle.map(|place| piece.numbers[place as usize] as u32);
        self.triangles.extend(surface.iter().map(whole));
        self.caps.extend(caps.iter().map(whole));
        true
    }

    /// Bytes that it takes while it is smoothed.
    pub fn memory(&self) -> u64 {
        let triangles = self.triangles.len() + self.caps.len();
        VERTEX_BYTES * self.vertices.len() as u64 + TRIANGLE_BYTES * triangles as u64
    }

    /// Smoothes it in so many steps; `report` is what it was, and what it is is returned. Caps, their rims and open
    /// edges stay where they are, so that what matches there still does. `go_on` is called after each step.
    ///
    /// # Errors
    /// Where `go_on` fails; the mesh stays as it was.
    pub fn smooth<E>(
        &mut self,
        steps: u32,
        report: MeshReport,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<MeshReport, E> {
        let graph = Graph::of(self);
        let mut places: Vec<DVec3> = self.vertices.iter().map(|vertex| vertex.position).collect();
        let mut moved = places.clone();
        let (volume, area) = self.measures(&places);
        for _ in 0..steps {
            for share in [FORTH, BACK] {
                graph.step(&places, share, &mut moved);
                std::mem::swap(&mut places, &mut moved);
            }
            go_on()?;
        }
        for _ in 0..CORRECTIONS {
            let areas = self.vector_areas(&places);
            let free = || areas.iter().zip(&graph.is_fixed).filter(|(_, is_fixed)| !**is_fixed);
            let whole: f64 = free().map(|(area, _)| area.length()).sum();
            let offset = (volume - self.measures(&places).0) / whole;
            // Where nothing is free nothing has moved.
            if offset.is_finite() {
                for ((place, area), is_fixed) in places.iter_mut().zip(&areas).zip(&graph.is_fixed) {
                    if !is_fixed {
                        *place += offset * area.normalize_or_zero();
                    }
                }
            }
        }
        let areas = self.vector_areas(&places);
        for (index, vertex) in self.vertices.iter_mut().enumerate() {
            vertex.position = places[index];
            if !graph.is_fixed[index] {
                vertex.normal = areas[index].try_normalize().map_or(vertex.normal, |normal| normal.as_vec3());
            }
        }
        let (after, area_after) = self.measures(&places);
        Ok(MeshReport { volume: report.volume + after - volume, area: report.area + area_after - area, ..report })
    }

    /// Volume of the cones from a vertex to all triangles but the caps, and these triangles' area.
    fn measures(&self, places: &[DVec3]) -> (f64, f64) {
        let center = places.first().copied().unwrap_or_default();
        let (mut volume, mut area) = (0.0, 0.0);
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| places[vertex as usize] - center);
            volume += a.dot(b.cross(c)) / 6.0;
            area += 0.5 * (b - a).cross(c - a).length();
        }
        (volume, area)
    }

    /// Of each vertex a third of its triangles' vector areas: how fast the volume grows as it moves.
    fn vector_areas(&self, places: &[DVec3]) -> Vec<DVec3> {
        let mut areas = vec![DVec3::ZERO; places.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| places[vertex as usize]);
            let share = (b - a).cross(c - a) / 6.0;
            for &vertex in triangle {
                areas[vertex as usize] += share;
            }
        }
        areas
    }

    /// All of it.
    pub fn into_piece(self) -> Piece {
        let WholeMesh { vertices, mut triangles, caps: mut of_caps } = self;
        let caps = of_caps.len();
        triangles.append(&mut of_caps);
        let count = vertices.len() as u32;
        Piece { vertices, numbers: (0..u64::from(count)).collect(), fresh: (0..count).collect(), triangles, caps }
    }
}

/// Which vertices are joined by an edge.
struct Graph {
    /// Where the neighbours of each vertex begin, and where the last one's end.
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    /// Vertices that stay where they are.
    is_fixed: Vec<bool>,
}

impl Graph {
    fn of(mesh: &WholeMesh) -> Graph {
        let count = mesh.vertices.len();
        let mut starts = vec![0_usize; count + 1];
        for &vertex in mesh.triangles.as_flattened() {
            starts[vertex as usize + 1] += 1;
        }
        for vertex in 0..count {
            starts[vertex + 1] += starts[vertex];
        }
        let mut ends = starts.clone();
        let mut neighbours = vec![0; 3 * mesh.triangles.len()];
        // Around a vertex that no open edge has, each neighbour follows once and is followed once: the sums of their
        // hashes agree.
        let mut balance = vec![0_u64; count];
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let end = &mut ends[from as usize];
                neighbours[*end] = to;
                *end += 1;
                let (out, into) = (from as usize, to as usize);
                balance[out] = balance[out].wrapping_add(hash(to));
                balance[into] = balance[into].wrapping_sub(hash(from));
            }
        }
        let mut is_fixed: Vec<bool> = balance.into_iter().map(|difference| difference != 0).collect();
        for &vertex in mesh.caps.as_flattened() {
            is_fixed[vertex as usize] = true;
        }
        Graph { starts, neighbours, is_fixed }
    }

    /// Moves every vertex that is not fixed by a share of the way to the mean of its neighbours.
    fn step(&self, places: &[DVec3], share: f64, moved: &mut [DVec3]) {
        moved.par_iter_mut().enumerate().for_each(|(vertex, to)| {
            let at = places[vertex];
            let around = &self.neighbours[self.starts[vertex]..self.starts[vertex + 1]];
            *to = if self.is_fixed[vertex] || around.is_empty() {
                at
            } else {
                let sum: DVec3 = around.iter().map(|&neighbour| places[neighbour as usize]).sum();
                at + share * (sum / around.len() as f64 - at)
            };
        });
    }
}

/// A vertex's number, scattered.
fn hash(vertex: u32) -> u64 {
    mix_bits((u64::from(vertex) + 1).wrapping_mul(GOLDEN))
}
