//! What the shader of line integrals reads: structures laid out as in WGSL.

use crate::cpu::field::{Field, xray};
use crate::model::Bounds;
use crate::view::{Projection, View};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::ops::RangeInclusive;

/// Stands for infinity, which shaders need not know.
const FAR: f64 = 1e30;

/// WGSL `Rays`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RaysUniform {
    /// Where the middle line of sight is in a plane through the field.
    pub start: [f32; 4],
    /// What a pixel to the right adds.
    pub start_right: [f32; 4],
    /// What a pixel down adds.
    pub start_down: [f32; 4],
    /// What a unit of depth adds on the middle line of sight.
    pub step: [f32; 4],
    /// What a pixel to the right adds to that.
    pub step_right: [f32; 4],
    /// What a pixel down adds to that.
    pub step_down: [f32; 4],
}

/// WGSL `Integrals`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct IntegralUniform {
    /// Samples of the level along each axis.
    pub shape: [u32; 3],
    /// The level's own indices for an index.
    pub scale: f32,
    /// Rays in indices of samples.
    pub samples: RaysUniform,
    /// Rays in the world, from the middle of the box outside of which nothing is drawn.
    pub world: RaysUniform,
    /// Half of that box, world units; 1: there is one.
    pub clip: [f32; 4],
    /// The last indices that belong to the field.
    pub ends: [f32; 4],
    /// Where the middle line of sight meets the picture, pixels.
    pub middle: [f32; 2],
    /// Least and largest depth, from the plane.
    pub planes: [f32; 2],
    /// Pixels.
    pub size: [u32; 2],
    /// The level.
    pub level: u32,
    /// The finest level that is drawn.
    pub least_level: u32,
    /// The coarsest one.
    pub last_level: u32,
    /// 1: the distance of pixels grows with the depth.
    pub perspective: u32,
    /// Depth of the plane, world units.
    pub depth: f32,
    /// Distance of pixels at depth 1 (perspective) or everywhere, in distances of samples.
    pub pixel: f32,
    /// Width of a pixel at depth 1 (perspective), 0 else.
    pub slope: f32,
    /// Samples of the level to a step.
    pub stride: f32,
    /// Padding.
    pub unused: [u32; 2],
}

/// How a view sees a field, whatever the level.
pub struct Sight<'a> {
    view: &'a View,
    field: &'a Field,
    perspective: bool,
    /// Depth of the plane that rays begin in.
    depth: f64,
    /// The box outside of which nothing is drawn.
    clip: Bounds,
}

fn vector(vector: DVec3, last: f32) -> [f32; 4] {
    vector.as_vec3().extend(last).to_array()
}

impl<'a> Sight<'a> {
    /// The sight of a view.
    pub fn new(view: &'a View, field: &'a Field) -> Sight<'a> {
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let (own, cut) = (field.bounds(), view.cut.bounds);
        let beyond = DVec3::splat(field.diameter());
        let clip = Bounds { min: cut.min.max(own.min - beyond), max: cut.max.min(own.max + beyond) };
        let depth = view.to_camera(own.center()).z;
        let depth = if perspective { depth.max(0.0) } else { depth };
        Sight { view, field, perspective, depth, clip }
    }

    /// The levels that rays may read.
    pub fn levels(&self) -> RangeInclusive<usize> {
        let focal = self.view.focal_pixels();
        let Bounds { min, max } = self.field.bounds();
        let corner = |index: usize| {
            let pick = |axis: usize| if index >> axis & 1 == 0 { min[axis] } else { max[axis] };
            self.view.to_camera(DVec3::new(pick(0), pick(1), pick(2))).z.max(0.0)
        };
        let depths = (0..8).map(corner);
        let [near, far] = depths.fold([f64::INFINITY, 0.0], |[near, far], at| [near.min(at), far.max(at)]);
        let level = |depth: f64| self.field.level_for(if self.perspective { depth } else { 1.0 } / focal);
        level(near)..=level(far)
    }

    /// Rays where `place` and `way` tell places and ways of the world otherwise.
    fn rays(&self, place: impl Fn(DVec3) -> DVec3, way: impl Fn(DVec3) -> DVec3) -> RaysUniform {
        let View { eye, right, up, forward, .. } = *self.view;
        let focal = self.view.focal_pixels();
        let (right, down) = (right / focal, -up / focal);
        let (apart, turned) = if self.perspective { (self.depth, 1.0) } else { (1.0, 0.0) };
        RaysUniform {
            start: vector(place(eye + self.depth * forward), 0.0),
            start_right: vector(way(apart * right), 0.0),
            start_down: vector(way(apart * down), 0.0),
            step: vector(way(forward), 0.0),
            step_right: vector(way(turned * right), 0.0),
            step_down: vector(way(turned * down), 0.0),
        }
    }

    /// What rays of a level read, of those within `levels`.
    pub fn uniform(&self, level: usize, levels: &RangeInclusive<usize>) -> IntegralUniform {
        let (view, field) = (self.view, self.field);
        let focal = view.focal_pixels();
        let middle = 0.5 * (self.clip.min + self.clip.max);
        IntegralUniform {
            samples: self
                .rays(|world| field.to_index.transform_point3(world), |world| field.to_index.transform_vector3(world)),
            world: self.rays(|world| world - middle, |world| world),
            clip: vector(0.5 * (self.clip.max - self.clip.min), f32::from(u8::from(view.cut.clips()))),
            ends: vector(DVec3::from_array(field.shape().map(|side| side as f64 - 0.5)), 0.0),
            shape: field.channels[0].levels[level].shape.map(|side| side as u32),
            scale: 1.0 / (1u32 << level) as f32,
            middle: view.middle().map(|pixels| pixels as f32),
            planes: [if self.perspective { -self.depth } else { -FAR }, FAR].map(|depth| depth as f32),
            size: [view.width, view.height],
            level: level as u32,
            least_level: *levels.start() as u32,
            last_level: *levels.end() as u32,
            perspective: self.perspective.into(),
            depth: self.depth as f32,
            pixel: (1.0 / (focal * field.spacing())) as f32,
            slope: if self.perspective { (1.0 / focal) as f32 } else { 0.0 },
            stride: xray::STEP as f32,
            unused: [0; 2],
        }
    }
}
