//! Joining the parts of a surface that were found brick by brick: vertices on the faces between bricks are one, whoever
//! found them first. What is remembered is the front between bricks that are done and bricks that are not.

use super::{MeshReport, Vertex};
use glam::DVec3;
use std::collections::{HashMap, HashSet};

/// The part of a surface in one brick. Its numbers of vertices are its own.
#[derive(Debug, Default)]
pub(super) struct BrickMesh {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<[u32; 3]>,
    /// Triangles that close the surface at the lattice's faces; they follow the others when it is finished.
    pub caps: Vec<[u32; 3]>,
    /// Vertices that other bricks have, too.
    pub shared: Vec<Shared>,
    /// Edges of a single triangle, in its direction.
    open: Vec<[u32; 2]>,
    /// Edges of more than two triangles, or of two in the same direction.
    irregular: u64,
    /// Parts that hang together within the brick.
    components: u32,
    volume: f64,
    area: f64,
    cap_area: f64,
    cap_count: usize,
}

/// A vertex on a face between bricks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shared {
    pub vertex: u32,
    /// Number of its lattice edge.
    pub key: u64,
    /// How many bricks have it.
    pub uses: u8,
    /// The component that it is in.
    pub component: u32,
}

impl BrickMesh {
    /// Counts a triangle in a face of the lattice, relative to its centre, that closes the surface and is not of it.
    pub fn cut_off(&mut self, [a, b, c]: [DVec3; 3]) {
        self.volume += a.dot(b.cross(c)) / 6.0;
        self.cap_area += 0.5 * (b - a).cross(c - a).length();
    }

    /// Finds components, open edges, area, and the volume of the cones between the triangles and `center`.
    pub fn finish(&mut self, center: DVec3) {
        let mut sets = DisjointSets::default();
        sets.add(self.vertices.len() as u32);
        let of_surface = self.triangles.len();
        self.cap_count = self.caps.len();
        self.triangles.append(&mut self.caps);
        let mut edges = Vec::with_capacity(3 * self.triangles.len());
        for (place, &[a, b, c]) in self.triangles.iter().enumerate() {
            sets.join(a, b);
            sets.join(b, c);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.push((from.min(to), from.max(to), from < to));
            }
            let [a, b, c] = [a, b, c].map(|vertex| self.vertices[vertex as usize].position - center);
            self.volume += a.dot(b.cross(c)) / 6.0;
            let area = if place < of_surface { &mut self.area } else { &mut self.cap_area };
            *area += 0.5 * (b - a).cross(c - a).length();
        }
        edges.sort_unstable();
        for of_edge in edges.chunk_by(|(a, b, _), (c, d, _)| a == c && b == d) {
            match of_edge {
                [(_, _, false), (_, _, true)] => {}
                [(low, high, is_upward)] => self.open.push(if *is_upward { [*low, *high] } else { [*high, *low] }),
                _ => self.irregular += 1,
            }
        }
        let mut numbers: HashMap<u32, u32> = HashMap::new();
        let mut number_of = |vertex: u32| {
            let next = numbers.len() as u32;
            *numbers.entry(sets.root(vertex)).or_insert(next)
        };
        for shared in &mut self.shared {
            shared.component = number_of(shared.vertex);
        }
        for vertex in 0..self.vertices.len() as u32 {
            number_of(vertex);
        }
        self.components = numbers.len() as u32;
    }
}

/// The part of a surface in one brick, with numbers that its vertices have in the whole.
#[derive(Debug)]
pub struct Piece {
    /// Its vertices.
    pub vertices: Vec<Vertex>,
    /// The number of each in the whole surface.
    pub numbers: Vec<u64>,
    /// Which of them no piece had before, by their place among its vertices: their numbers in the whole follow each
    /// other.
    pub fresh: Vec<u32>,
    /// Triangles of its vertices, by their place, counter-clockwise as seen from where the field is low.
    pub triangles: Vec<[u32; 3]>,
    /// How many of them, the last ones, are caps in the lattice's faces.
    pub caps: usize,
}

/// A vertex that bricks to come have, too.
#[derive(Clone, Copy, Debug)]
struct Seen {
    number: u64,
    component: u32,
    /// How many bricks have not come yet.
    left: u8,
}

/// The surface as far as it is joined.
#[derive(Debug, Default)]
pub(super) struct Weld {
    seen: HashMap<u64, Seen>,
    open: HashSet<[u64; 2]>,
    sets: DisjointSets,
    report: MeshReport,
}

impl Weld {
    /// Takes the next brick.
    pub fn join(&mut self, mesh: BrickMesh) -> Piece {
        let BrickMesh { volume, area, cap_area, cap_count, .. } = mesh;
        let BrickMesh { vertices, triangles, shared, open, irregular, components, .. } = mesh;
        let base = self.sets.add(components);
        let mut numbers = vec![u64::MAX; vertices.len()];
        self.report.components += u64::from(components);
        for Shared { vertex, key, component, .. } in &shared {
            let Some(seen) = self.seen.get_mut(key) else { continue };
            numbers[*vertex as usize] = seen.number;
            self.report.components -= u64::from(self.sets.join(seen.component, base + component));
            seen.left -= 1;
            if seen.left == 0 {
                self.seen.remove(key);
            }
        }
        let first = self.report.vertices;
        let mut fresh = Vec::with_capacity(vertices.len());
        for (place, number) in numbers.iter_mut().enumerate().filter(|(_, number)| **number == u64::MAX) {
            *number = first + fresh.len() as u64;
            fresh.push(place as u32);
        }
        for Shared { vertex, key, uses, component } in shared {
            let number = numbers[vertex as usize];
            if number >= first {
                self.seen.insert(key, Seen { number, component: base + component, left: uses - 1 });
            }
        }
        for edge in open {
            let [from, to] = edge.map(|vertex| numbers[vertex as usize]);
            // The triangle on the other side goes along it the other way.
            if !self.open.remove(&[to, from]) && !self.open.insert([from, to]) {
                self.report.boundary_edges += 1;
            }
        }
        self.report.boundary_edges += irregular;
        self.report.vertices += fresh.len() as u64;
        self.report.triangles += triangles.len() as u64;
        self.report.volume += volume;
        self.report.area += area;
        self.report.cap_area += cap_area;
        Piece { vertices, numbers, fresh, triangles, caps: cap_count }
    }

    /// What the whole surface is.
    pub fn finish(self) -> MeshReport {
        MeshReport { boundary_edges: self.report.boundary_edges + self.open.len() as u64, ..self.report }
    }
}

/// Sets that are joined and never parted.
#[derive(Debug, Default)]
struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    /// Adds sets of one member each; the number of the first.
    fn add(&mut self, count: u32) -> u32 {
        let first = self.parents.len() as u32;
        self.parents.extend(first..first + count);
        first
    }

    fn root(&mut self, member: u32) -> u32 {
        let mut at = member;
        while self.parents[at as usize] != at {
            let above = self.parents[self.parents[at as usize] as usize];
            self.parents[at as usize] = above;
            at = above;
        }
        at
    }

    /// Whether they were two sets before.
    fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        // The smaller number stays, so that nothing depends on the order.
        self.parents[a.max(b) as usize] = a.min(b);
        a != b
    }
}
