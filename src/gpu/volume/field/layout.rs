//! What the shader that fills bricks from a field reads: structures laid out as in WGSL.

use crate::color::transfer::Scale;
use crate::cpu::field::{Field, ValueAxis};
use crate::model::Bounds;
use crate::view::{PerspectiveGrid, View};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// WGSL `FieldView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FieldUniform {
    /// Samples of the level along each axis.
    pub shape: [u32; 3],
    /// The level's own indices for an index of samples.
    pub scale: f32,
    /// What a unit of length to the right adds to indices of samples.
    pub right: [f32; 4],
    /// What one upwards adds.
    pub up: [f32; 4],
    /// What one to the right adds to places in the world.
    pub world_right: [f32; 4],
    /// What one upwards adds.
    pub world_up: [f32; 4],
    /// Half of the box outside of which nothing is drawn, world units; 1: there is one.
    pub clip: [f32; 4],
    /// The last indices that belong to the field.
    pub ends: [f32; 4],
    /// Blocks of its samples along each axis.
    pub blocks: [u32; 3],
    /// 1: the logarithm of values is placed.
    pub is_log: u32,
    /// The value, or its base-2 logarithm, at place 1.
    pub low: f32,
    /// Places for a unit of it.
    pub per: f32,
    /// Padding.
    pub unused: [u32; 2],
}

/// WGSL `FieldLine`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FieldLine {
    /// Indices of samples on the middle line of sight, in the middle of a slice, and the width of its cells, world units.
    pub start: [f32; 4],
    /// The same place in the world, from the middle of the box outside of which nothing is drawn.
    pub world: [f32; 4],
}

/// WGSL `SlopeView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SlopeUniform {
    /// Samples of the level along each axis.
    pub shape: [u32; 3],
    /// The level's own indices for an index of samples.
    pub scale: f32,
    /// What a unit of length to the right adds to indices of samples.
    pub right: [f32; 4],
    /// What one upwards adds.
    pub up: [f32; 4],
    /// What one of depth adds.
    pub forward: [f32; 4],
    /// Indices on the middle line of sight at a depth, and that depth.
    pub start: [f32; 4],
    /// Slices of the grid that are filled from it.
    pub slices: u32,
    /// 1: the logarithm of values is placed.
    pub is_log: u32,
    /// The value, or its base-2 logarithm, at place 1.
    pub low: f32,
    /// Places for a unit of it.
    pub per: f32,
}

fn vector(vector: DVec3, last: f32) -> [f32; 4] {
    vector.as_vec3().extend(last).to_array()
}

/// The value at place 1, or its base-2 logarithm where that is placed, and the places for a unit of it.
pub fn placing(axis: &ValueAxis) -> [f32; 2] {
    let [low, high] = match axis.scale {
        Scale::Log => axis.range.map(f64::log2),
        Scale::Linear => axis.range,
    };
    [low as f32, (1.0 / (high - low)) as f32]
}

/// The box outside of which a view shows nothing of a field: a little larger than that of the samples where nothing is cut.
fn clip_box(view: &View, field: &Field) -> Bounds {
    let (own, cut) = (field.bounds(), view.cut.bounds);
    let beyond = DVec3::splat(field.diameter());
    Bounds { min: cut.min.max(own.min - beyond), max: cut.max.min(own.max + beyond) }
}

impl FieldUniform {
    /// What a level of a field is in a view.
    pub fn new(view: &View, field: &Field, level: usize, axis: &ValueAxis) -> FieldUniform {
        let own = &field.channels[0].levels[level];
        let clip = clip_box(view, field);
        let [low, per] = placing(axis);
        let to_index = |world: DVec3| vector(field.to_index.transform_vector3(world), 0.0);
        FieldUniform {
            right: to_index(view.right),
            up: to_index(view.up),
            world_right: vector(view.right, 0.0),
            world_up: vector(view.up, 0.0),
            clip: vector(0.5 * (clip.max - clip.min), f32::from(u8::from(view.cut.clips()))),
            ends: vector(DVec3::from_array(field.shape().map(|side| side as f64 - 0.5)), 0.0),
            shape: own.shape.map(|side| side as u32),
            scale: 1.0 / (1u32 << level) as f32,
            blocks: own.blocks().map(|blocks| blocks as u32),
            is_log: u32::from(axis.scale == Scale::Log),
            low,
            per,
            unused: [0; 2],
        }
    }
}

impl SlopeUniform {
    /// What the level of the nearest slices of a grid, so many of them, is in a view.
    pub fn new(
        view: &View,
        grid: &PerspectiveGrid,
        field: &Field,
        axis: &ValueAxis,
        (level, slices): (usize, u32),
    ) -> SlopeUniform {
        // Told from the grid's middle: from an eye that is far away places would be rounded.
        let depth = grid.depth(0.5 * f64::from(grid.size[2])) as f32;
        let start = field.to_index.transform_point3(view.eye + f64::from(depth) * view.forward);
        let [low, per] = placing(axis);
        let to_index = |world: DVec3| vector(field.to_index.transform_vector3(world), 0.0);
        SlopeUniform {
            right: to_index(view.right),
            up: to_index(view.up),
            forward: to_index(view.forward),
            start: vector(start, depth),
            shape: field.channels[0].levels[level].shape.map(|side| side as u32),
            scale: 1.0 / (1u32 << level) as f32,
            slices,
            is_log: u32::from(axis.scale == Scale::Log),
            low,
            per,
        }
    }
}

/// Where the slices of a grid lie in a field, told from the field, so that an eye that is far away costs no digits.
pub fn lines(view: &View, grid: &PerspectiveGrid, field: &Field) -> Vec<FieldLine> {
    let clip = clip_box(view, field);
    let middle = 0.5 * (clip.min + clip.max);
    let line = |slice: u32| {
        let depth = grid.depth(f64::from(slice) + 0.5);
        let place = view.eye + depth * view.forward;
        FieldLine {
            start: vector(field.to_index.transform_point3(place), grid.spacing(depth) as f32),
            world: vector(place - middle, 0.0),
        }
    };
    (0..grid.size[2]).map(line).collect()
}
