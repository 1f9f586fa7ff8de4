//! The bricks of a perspective grid from a sampled field: each cell asks for the value at its centre, so that what is classified, crossed by
//! surfaces and hidden is the field itself, at any level of detail alike.

use super::values::ValueAxis;
use super::{Field, FieldLevel};
use crate::cpu::volume::Fill;
use crate::cpu::volume::bricks::{self, BORDER, BRICK, Brick, BrickGrid, Layer, SpareCells};
use crate::cpu::volume::resample::Work;
use crate::view::{PerspectiveGrid, View};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Cells around a brick that rays through it read.
pub const AROUND: usize = 2;

/// The level of a field that the bricks in a layer of a grid are filled from: means over no more than a cell.
pub fn level_of_layer(field: &Field, grid: &PerspectiveGrid, layer: usize) -> usize {
    let slices = layer * BRICK..((layer + 1) * BRICK).min(grid.size[2] as usize);
    let middle = (slices.start + slices.end) as f64 / 2.0;
    field.level_for(grid.spacing(grid.depth(middle)))
}

/// Fills bricks from a field.
pub struct FieldBricks<'a> {
    /// The field.
    pub field: &'a Field,
    /// Its channel that is drawn.
    pub channel: usize,
    /// The channel that colours it.
    pub hue: Option<usize>,
    /// Its values as numbers.
    pub axis: ValueAxis,
    /// The camera.
    pub view: &'a View,
    /// The grid.
    pub grid: &'a PerspectiveGrid,
    /// Its bricks.
    pub brick_grid: &'a BrickGrid,
    /// Numbers up to this show nothing.
    pub least: f32,
    spare: SpareCells,
}

impl<'a> FieldBricks<'a> {
    /// The bricks of a channel of a field, uncoloured, of which everything shows.
    pub fn new(
        field: &'a Field,
        axis: ValueAxis,
        view: &'a View,
        grid: &'a PerspectiveGrid,
        brick_grid: &'a BrickGrid,
    ) -> FieldBricks<'a> {
        FieldBricks {
            field,
            channel: 0,
            hue: None,
            axis,
            view,
            grid,
            brick_grid,
            least: 0.0,
            spare: SpareCells::default(),
        }
    }

    /// Indices of samples at a place of the grid.
    fn indices(&self, place: [f64; 3]) -> DVec3 {
        let camera = self.grid.to_camera(place);
        let View { eye, right, up, forward, .. } = *self.view;
        self.field.to_index.transform_point3(eye + camera.x * right + camera.y * up + camera.z * forward)
    }

    /// Where a value of a level's samples is placed.
    fn placed(&self, value: f32) -> f32 {
        match self.axis.linear() {
            Some([low, per]) => 1.0 + ((value - low) * per).clamp(0.0, 1.0),
            None => self.axis.place(value),
        }
    }

    fn brick(&self, layer: usize, place: usize) -> Option<Brick> {
        let first = [place % self.brick_grid.bricks[0], place / self.brick_grid.bricks[0]];
        let corner = first.map(|brick| (brick * BRICK) as f64 - BORDER as f64);
        let slices = layer * BRICK..((layer + 1) * BRICK).min(self.brick_grid.slices);
        let ends = |from: f64, to: f64| [from - AROUND as f64, to + AROUND as f64];
        let (x, y) = (ends(corner[0], corner[0] + BRICK as f64), ends(corner[1], corner[1] + BRICK as f64));
        let z = ends(slices.start as f64, slices.end as f64);
        let corners = (0..8).map(|i| self.indices([x[i & 1], y[i >> 1 & 1], z[i >> 2]]));
        let (low, high) =
            corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let number = level_of_layer(self.field, self.grid, layer);
        let level = &self.field.channels[self.channel].levels[number];
        let own = |at: DVec3| FieldLevel::indices(number, at.as_vec3().to_array());
        let [_, most] = level.range_within(own(low), own(high))?;
        if self.axis.place(most) <= self.least {
            return None;
        }
        let hue = self.hue.map(|hue| &self.field.channels[hue].levels[number]);
        let weighted = hue.map_or_else(Box::default, |_| self.spare.take());
        let mut brick = Brick {
            density: self.spare.take(),
            weighted,
            surface: Box::default(),
            opacity: Box::default(),
            densest: 0.0,
        };
        let clips = self.view.cut.clips();
        // Ends of the field in this level's indices, along each axis that it has.
        let shape = self.field.shape().map(|side| side as f64);
        let ends = |axis: usize| FieldLevel::ends(number, shape[axis]);
        let linear = self.axis.linear();
        for (z, slice) in slices.enumerate() {
            for y in 0..BRICK {
                let at = |x: f64| self.indices([corner[0] + x, corner[1] + y as f64 + 0.5, slice as f64 + 0.5]);
                let (first, second) = (at(0.5), at(1.5));
                let start = DVec3::from_array(FieldLevel::fine_indices(number, first.to_array()));
                let step = DVec3::from_array(FieldLevel::fine_indices(number, second.to_array())) - start;
                // The cells of the row whose centres are within the field.
                let (mut from, mut to) = (0.0f64, (BRICK - 1) as f64);
                for axis in 0..self.field.dimensions {
                    let [low, high] = ends(axis);
                    if step[axis] == 0.0 {
                        if start[axis] < low || start[axis] > high {
                            to = -1.0;
                        }
                        continue;
                    }
                    let (a, b) = ((low - start[axis]) / step[axis], (high - start[axis]) / step[axis]);
                    (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
                }
                if from > to {
                    continue;
                }
                let row = (z * BRICK + y) * BRICK;
                let (origin, along) = (start.as_vec3(), step.as_vec3());
                for x in from.ceil() as usize..=to.floor() as usize {
                    if clips {
                        let index = first + x as f64 * (second - first);
                        if !self.view.cut.keeps(self.field.to_world.transform_point3(index)) {
                            continue;
                        }
                    }
                    let at = (origin + x as f32 * along).to_array();
                    let value = level.at(at);
                    let place = match linear {
                        Some([low, per]) if !value.is_nan() => 1.0 + ((value - low) * per).clamp(0.0, 1.0),
                        _ => self.axis.place(value),
                    };
                    brick.density[row + x] = place;
                    brick.densest = brick.densest.max(place);
                    if let Some(hue) = hue {
                        let value = hue.at(at);
                        brick.weighted[row + x] = if value.is_nan() { 0.0 } else { place * value };
                    }
                }
            }
        }
        (brick.densest > 0.0).then_some(brick)
    }
}

impl Fill for FieldBricks<'_> {
    fn fill(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work) {
        let of_layer = self.brick_grid.of_layer();
        let own = &*self;
        let brick = |index: usize| match hidden.get(index % of_layer) {
            Some(true) => None,
            _ => own.brick(layers.start + index / of_layer, index % of_layer),
        };
        let all: Vec<Option<Brick>> = (0..layers.len() * of_layer).into_par_iter().map(brick).collect();
        let bricks = all.iter().flatten().count() as u64;
        (bricks::layers(all, of_layer), Work { pairs: bricks, bricks })
    }

    fn recycle(&mut self, layers: Vec<Layer>) {
        self.spare.keep(layers);
    }

    fn has_attribute(&self) -> bool {
        self.hue.is_some()
    }

    fn slope(&self, [x, y]: [f64; 2], step: usize, share: f32, value: f32) -> Option<[f32; 3]> {
        // Further away cells are about as wide as the means that they are filled from: their differences do.
        let number = level_of_layer(self.field, self.grid, 0);
        if level_of_layer(self.field, self.grid, step / BRICK) != number {
            return None;
        }
        let level = &self.field.channels[self.channel].levels[number];
        let [from, to] = [-0.5, 0.5].map(|away| self.indices([x, y, step as f64 + away]));
        let at = (from + f64::from(share) * (to - from)).as_vec3().to_array();
        // A hole is taken for the surface, so that it turns none.
        let above = |sample: f32| if sample.is_nan() { 0.0 } else { self.placed(sample) - value };
        let slope = DVec3::from_array(level.slope(FieldLevel::indices(number, at), above).map(f64::from));
        let View { right, up, forward, .. } = *self.view;
        // A gradient is turned by the inverse of what turns places, transposed.
        let along = |axis: DVec3| slope.dot(self.field.to_index.transform_vector3(axis)) as f32;
        Some([right, up, forward].map(along))
    }

    fn bytes(&self) -> u64 {
        let bytes = |channel: usize| {
            self.field.channels[channel].levels.iter().map(|level| 4 * level.values.len() as u64).sum::<u64>()
        };
        bytes(self.channel) + self.hue.map_or(0, bytes)
    }
}
