//! An octree of bricks in world space, kept from picture to picture: the field is resampled where a view needs it and as finely as it
//! needs it, once.
//!
//! The perspective grid moves with the camera, so that every picture resamples everything. Here a node of the octree has a brick
//! of [`CELLS`] cells along each side, with one cell more around it for interpolation, and a view takes the coarsest nodes whose
//! cells are no wider than the grid's would be there. When the camera moves a little, nearly all of these have been
//! resampled already. Densities are the exact SPH sums at the cells' centres; particles narrower than the node's cells are enlarged
//! to them as in the other grids.

use super::march::{Field, Room};
use crate::cpu::Splats;
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::bricks::{BRICK, Brick, BrickGrid};
use crate::cpu::volume::gather::lone_brick;
use crate::cpu::volume::particles::{Particle, Taken, project};
use crate::model::{Bounds, Kernel};
use crate::view::perspective_grid::GridError;
use crate::view::{Cut, Extent, Images, PerspectiveGrid, Projection, View};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Cells along a node's side.
const CELLS: usize = BRICK - 2;
/// Deepest level.
const DEEPEST: u32 = 14;

/// A cube of space.
struct Node {
    /// Corner in the octree's frame, in units of the root's side.
    min: DVec3,
    level: u32,
    /// Particles that reach its cells.
    particles: Vec<u32>,
    children: Option<[usize; 8]>,
    /// `None` before it is resampled; `Some(None)` where nothing is.
    brick: Option<Option<Brick>>,
    /// The last picture that it is a leaf of.
    leaf_of: u64,
}

/// The tree, and what has been resampled of it.
pub struct Octree {
    /// World position of the origin of the octree's frame (x to the right, y downwards, z away, looking along -z), and the
    /// root's side.
    corner: DVec3,
    side: f64,
    /// As the parallel view along -z of the root has them.
    particles: Vec<Particle>,
    attribute: bool,
    nodes: Vec<Node>,
    picture: u64,
    kernel: Kernel,
    smallest: f64,
}

/// What one picture needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Need {
    /// Leaves that hold something.
    pub bricks: usize,
    /// Of those, how many had to be resampled.
    pub resampled: usize,
}

impl Octree {
    /// The octree of batches within a box, with nothing resampled.
    ///
    /// # Errors
    /// [`VolumeError::Grid`] when there are no particles.
    pub fn new(batches: &[Splats<'_>], bounds: Bounds, kernel: Kernel, smallest: f64) -> Result<Octree, VolumeError> {
        let side = (bounds.max - bounds.min).max_element();
        if !(side > 0.0 && side.is_finite()) {
            return Err(GridError::NothingInView.into());
        }
        let center = bounds.center();
        let corner = center + DVec3::new(-0.5, 0.5, 0.5) * side;
        let projection = Projection::Orthographic { height: side };
        let (right, up, forward) = (DVec3::X, DVec3::Y, DVec3::NEG_Z);
        let eye = center + 0.5 * side * DVec3::Z;
        let view = View {
            eye,
            right,
            up,
            forward,
            projection,
            width: 64,
            height: 64,
            shift: [0.0; 2],
            cut: Cut::NONE,
            images: Images::ONE,
            time: 0.0,
        };
        let taken = Taken { sigma: side / 64.0, smallest: 0.0, stride: 1, kernel };
        let projected = project(&view, batches, &taken);
        let particles: Vec<Particle> = projected.chunks.into_iter().flatten().collect();
        let root = Node {
            min: DVec3::ZERO,
            level: 0,
            particles: (0..particles.len() as u32).collect(),
            children: None,
            brick: None,
            leaf_of: 0,
        };
        let (attribute, nodes) = (projected.attribute, vec![root]);
        Ok(Octree { corner, side, particles, attribute, nodes, picture: 0, kernel, smallest })
    }

    /// Sees to it that everything a view needs has been resampled: cells no wider than `width` times those of the perspective grid
    /// of full resolution at a node's nearest depth, beyond `near`.
    pub fn prepare(&mut self, view: &View, width: f64, near: f64) -> Need {
        self.picture += 1;
        let sigma = width * PerspectiveGrid::sigma_of(view, 1.0);
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let (mut open, mut wanted, mut need) = (vec![0usize], Vec::new(), Need::default());
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            let extent = self.extent(node);
            if node.particles.is_empty() || !view.sees(&extent) {
                continue;
            }
            let depth = if perspective { view.nearest_depth(&extent).max(near) } else { 1.0 };
            if self.cell(node.level) * self.side <= sigma * depth || node.level >= DEEPEST {
                self.nodes[index].leaf_of = self.picture;
                need.bricks += 1;
                if self.nodes[index].brick.is_none() {
                    wanted.push(index);
                }
            } else {
                open.extend(self.children(index));
            }
        }
        need.resampled = wanted.len();
        let bricks: Vec<Option<Brick>> = wanted.par_iter().map(|&index| self.resampled(&self.nodes[index])).collect();
        for (index, brick) in wanted.into_iter().zip(bricks) {
            self.nodes[index].brick = Some(brick);
        }
        need
    }

    /// Memory that particles, lists and bricks take.
    pub fn bytes(&self) -> u64 {
        let of_brick = |brick: &Brick| 4 * (brick.density.len() + brick.weighted.len());
        let of_node = |node: &Node| {
            size_of::<Node>() + 4 * node.particles.len() + node.brick.iter().flatten().map(of_brick).sum::<usize>()
        };
        (self.particles.len() * size_of::<Particle>()) as u64 + self.nodes.iter().map(of_node).sum::<usize>() as u64
    }

    /// Width of a level's cells, in units of the root's side.
    fn cell(&self, level: u32) -> f64 {
        1.0 / (f64::from(1u32 << level) * CELLS as f64)
    }

    /// Where a node's cells are, in world space.
    fn extent(&self, node: &Node) -> Extent {
        let size = self.side / f64::from(1u32 << node.level);
        let low = self.corner + self.side * node.min * DVec3::new(1.0, -1.0, -1.0);
        let high = low + DVec3::new(size, -size, -size);
        Extent { bounds: Bounds { min: low.min(high), max: low.max(high) }, margin: 0.0 }
    }

    /// A particle's place in the frame and its reach at a level, in units of the root's side.
    fn reach(&self, particle: &Particle, level: u32) -> (DVec3, f64) {
        let [x, y, z, h] = particle.place.map(f64::from);
        let place = DVec3::new(x / self.side + 0.5, 0.5 - y / self.side, z / self.side);
        let cell = self.cell(level);
        (place, (h / self.side).max(self.smallest * cell) + cell)
    }

    /// The children of a node, made if it has none.
    fn children(&mut self, index: usize) -> [usize; 8] {
        if let Some(children) = self.nodes[index].children {
            return children;
        }
        let (min, level) = (self.nodes[index].min, self.nodes[index].level + 1);
        let size = 1.0 / f64::from(1u32 << level);
        let first = self.nodes.len();
        let child = |octant: usize| {
            let offset = DVec3::new((octant & 1) as f64, (octant >> 1 & 1) as f64, (octant >> 2) as f64);
            let min = min + size * offset;
            let reaches = |&&particle: &&u32| {
                let (place, reach) = self.reach(&self.particles[particle as usize], level);
                let away = place - place.clamp(min, min + size);
                away.length_squared() < reach * reach
            };
            let particles: Vec<u32> = self.nodes[index].particles.iter().filter(reaches).copied().collect();
            Node { min, level, particles, children: None, brick: None, leaf_of: 0 }
        };
        let children: Vec<Node> = (0..8).into_par_iter().map(child).collect();
        self.nodes.extend(children);
        let children = std::array::from_fn(|octant| first + octant);
        self.nodes[index].children = Some(children);
        children
    }

    fn resampled(&self, node: &Node) -> Option<Brick> {
        let cell = self.cell(node.level) * self.side;
        let least = (self.smallest * cell) as f32;
        let particles = node.particles.iter().map(|&index| {
            let Particle { place: [x, y, z, h], .. } = self.particles[index as usize];
            Particle { place: [x, y, z, h.max(least)], ..self.particles[index as usize] }
        });
        // Camera coordinates of the first stored cell's corner.
        let low = (node.min - 0.5 * DVec3::new(1.0, 1.0, 0.0)) * self.side - cell;
        let slices = BRICK as u32;
        let grid = PerspectiveGrid {
            size: [slices; 3],
            near: low.z,
            far: low.z + f64::from(slices) * cell,
            sigma: cell,
            cell: 1.0,
            middle: [-low.x / cell, -low.y / cell],
            perspective: false,
        };
        let middle = grid.middle.map(|middle| middle as f32);
        let brick_grid = BrickGrid::with(&grid, [1; 3], middle, 1.0, |slice| slice);
        lone_brick(&brick_grid, particles, self.attribute, self.kernel)
    }

    /// The leaf of the present picture that a place is in; the smallest node there is if it is in none.
    fn leaf(&self, place: Vec3) -> (usize, Vec3, f32) {
        let (mut index, mut min, mut size) = (0, Vec3::ZERO, 1.0f32);
        loop {
            let node = &self.nodes[index];
            let Some(children) = node.children.filter(|_| node.leaf_of != self.picture) else {
                return (index, min, size);
            };
            size *= 0.5;
            let beyond = [0, 1, 2].map(|k| place[k] >= min[k] + size);
            let octant = beyond.iter().enumerate().map(|(k, &beyond)| usize::from(beyond) << k).sum::<usize>();
            min += size * Vec3::from_array(beyond.map(|beyond| f32::from(u8::from(beyond))));
            index = children[octant];
        }
    }
}

impl Field for Octree {
    const REACH: f32 = 0.5;

    fn place(&self, world: DVec3) -> DVec3 {
        (world - self.corner) * DVec3::new(1.0, -1.0, -1.0) / self.side
    }

    fn unit(&self) -> f64 {
        self.side
    }

    fn bounds(&self) -> [DVec3; 2] {
        [DVec3::ZERO, DVec3::ONE]
    }

    fn room(&self, place: Vec3, least: f32) -> Room {
        let (index, min, size) = self.leaf(place);
        let node = &self.nodes[index];
        let brick = node.brick.as_ref().and_then(Option::as_ref).filter(|_| node.leaf_of == self.picture);
        let empty = brick.is_none_or(|brick| brick.densest <= least);
        Room { min, max: min + size, cell: size / CELLS as f32, empty, index }
    }

    #[inline]
    fn at(&self, room: &Room, place: Vec3) -> [f32; 2] {
        let Some(Some(brick)) = &self.nodes[room.index].brick else { return [0.0; 2] };
        // In stored cells, the first of which lies before the node.
        let at = ((place - room.min) / room.cell + 0.5).clamp(Vec3::ZERO, Vec3::splat((BRICK - 1) as f32));
        let low = at.floor().min(Vec3::splat((BRICK - 2) as f32));
        let share = at - low;
        let start = (low.z as usize * BRICK + low.y as usize) * BRICK + low.x as usize;
        let mix = |cells: &[f32]| {
            let line = |offset: usize| {
                let [a, b] = [cells[start + offset], cells[start + offset + 1]];
                a + share.x * (b - a)
            };
            let plane = |offset: usize| {
                let [a, b] = [line(offset), line(offset + BRICK)];
                a + share.y * (b - a)
            };
            let [a, b] = [plane(0), plane(BRICK * BRICK)];
            a + share.z * (b - a)
        };
        [mix(&brick.density), if brick.weighted.is_empty() { 0.0 } else { mix(&brick.weighted) }]
    }
}
