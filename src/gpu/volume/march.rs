//! What the rays through a Cartesian grid read, where all of it is held.

use super::constants::ROOM;
use super::view::CartesianPicture;
use crate::cpu::volume::bricks::BORDER;
use crate::view::Projection;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// WGSL `MarchView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MarchUniform {
    /// Rooms along x, y and z.
    pub rooms: [u32; 3],
    /// Densities up to this show nothing.
    pub least: f32,
    /// Where the middle line of sight passes the depth of the box's middle, in stored coordinates of the grid. From there rays are told:
    /// from an eye that is far away they would be rounded.
    pub middle_place: [f32; 4],
    /// How much further to the right a ray passes that depth that is one pixel to the right.
    pub right: [f32; 4],
    /// How much further down one passes it that is one pixel below.
    pub down: [f32; 4],
    /// The way along the middle line of sight for a unit of depth.
    pub along: [f32; 4],
    /// How that changes for a pixel to the right.
    pub along_right: [f32; 4],
    /// How that changes for a pixel down.
    pub along_down: [f32; 4],
    /// The box outside which nothing is sampled.
    pub low: [f32; 4],
    /// Its opposite corner.
    pub high: [f32; 4],
    /// Where the middle line of sight meets the picture, pixels.
    pub middle: [f32; 2],
    /// Depths of the planes, from the depth of the box's middle.
    pub planes: [f32; 2],
    /// Pixels.
    pub size: [u32; 2],
    /// World units to the width of a cell.
    pub cell: f32,
    /// Padding.
    pub unused: u32,
}

impl MarchUniform {
    /// What the shader reads of a picture.
    pub fn new(picture: &CartesianPicture) -> MarchUniform {
        let CartesianPicture { view, planes: [near, far], lattice, scenery } = picture;
        let focal = view.focal_pixels();
        let depth = view.to_camera(lattice.middle()).z.clamp(*near, *far);
        let start = view.eye + depth * view.forward;
        let place = lattice.place(start);
        let way = |world: DVec3| lattice.place(start + world) - place;
        let (right, down) = (way(view.right / focal), way(-view.up / focal));
        let (right, down, along_right, along_down) = match view.projection {
            Projection::Perspective { .. } => (depth * right, depth * down, right, down),
            Projection::Orthographic { .. } => (right, down, DVec3::ZERO, DVec3::ZERO),
        };
        let [low, high] = lattice.bounds();
        let vector = |vector: DVec3| vector.as_vec3().extend(0.0).to_array();
        MarchUniform {
            middle_place: vector(place),
            right: vector(right),
            down: vector(down),
            along: vector(way(view.forward)),
            along_right: vector(along_right),
            along_down: vector(along_down),
            low: vector(low),
            high: vector(high),
            rooms: rooms(picture),
            least: scenery.least().min(f32::MAX),
            middle: view.middle().map(|pixels| pixels as f32),
            // Shaders need not know infinity.
            planes: [near - depth, far - depth].map(|depth| depth.clamp(-1e30, 1e30) as f32),
            size: [view.width, view.height],
            cell: lattice.grid.sigma as f32,
            unused: 0,
        }
    }
}

/// Rooms of a grid along x, y and z.
pub fn rooms(picture: &CartesianPicture) -> [u32; 3] {
    let [k, l, slices] = picture.lattice.grid.size;
    [k + 2 * BORDER as u32, l + 2 * BORDER as u32, slices].map(|cells| cells.div_ceil(ROOM))
}
