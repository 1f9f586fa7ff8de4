//! Line integrals of a field's values along each pixel's ray.

use super::{Field, FieldLevel};
use crate::color::Accumulation;
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// Samples of the field's own distance that a step is.
pub const STEP: f64 = 0.5;

/// A pixel's line of sight in indices of samples: `start + depth * step`.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Where its depth is 0.
    pub start: DVec3,
    /// What a unit of depth adds.
    pub step: DVec3,
    /// World length of a unit of depth.
    pub length: f64,
}

impl Line {
    /// The line through a point of the picture, pixels.
    pub fn of(view: &View, field: &Field, pixel: [f64; 2]) -> Line {
        let (start, end) = (view.at_depth(pixel, 0.0), view.at_depth(pixel, 1.0));
        let to_index = |world: DVec3| field.to_index.transform_point3(world);
        Line {
            start: to_index(start),
            step: field.to_index.transform_vector3(end - start),
            length: (end - start).length(),
        }
    }

    /// The depths at which it enters and leaves a field, and a box of the world; `None` where it misses them.
    pub fn within(&self, view: &View, field: &Field) -> Option<[f64; 2]> {
        let shape = field.shape().map(|side| side as f64);
        let mut ends = match view.projection {
            Projection::Perspective { .. } => [0.0, f64::INFINITY],
            Projection::Orthographic { .. } => [f64::NEG_INFINITY, f64::INFINITY],
        };
        let mut clip = |start: f64, step: f64, low: f64, high: f64| {
            if step == 0.0 {
                if start < low || start > high {
                    ends[1] = f64::NEG_INFINITY;
                }
                return;
            }
            let (a, b) = ((low - start) / step, (high - start) / step);
            ends = [ends[0].max(a.min(b)), ends[1].min(a.max(b))];
        };
        for (axis, side) in shape.iter().enumerate().take(field.dimensions) {
            clip(self.start[axis], self.step[axis], -0.5, side - 0.5);
        }
        if view.cut.clips() {
            let start = field.to_world.transform_point3(self.start);
            let step = field.to_world.transform_vector3(self.step);
            for axis in 0..3 {
                clip(start[axis], step[axis], view.cut.bounds.min[axis], view.cut.bounds.max[axis]);
            }
        }
        (ends[0] < ends[1] && ends.iter().all(|end| end.is_finite())).then_some(ends)
    }

    /// Indices at a depth.
    pub fn at(&self, depth: f64) -> DVec3 {
        self.start + depth * self.step
    }
}

/// The integral of a channel's values along every pixel's ray, over world lengths; holes count nothing.
pub fn draw(view: &View, field: &Field, channel: usize) -> Accumulation {
    let mut picture = Accumulation::new(view.width, view.height, false);
    let levels = &field.channels[channel].levels;
    let is_deep = matches!(view.projection, Projection::Perspective { .. });
    let width = view.width as usize;
    picture.p.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let line = Line::of(view, field, [x as f64 + 0.5, y as f64 + 0.5]);
            let Some([near, far]) = line.within(view, field) else { continue };
            // As coarse as pixels are apart in the middle of the way.
            let depth = if is_deep { 0.5 * (near + far) } else { 1.0 };
            let number = field.level_for(depth / view.focal_pixels());
            let level = &levels[number];
            let scale = f64::from(1u32 << number);
            let samples = (far - near) * line.step.length() / scale;
            let steps = (samples / STEP).ceil().max(1.0);
            let part = (far - near) / steps;
            let (first, next) = (line.at(near + 0.5 * part), part * line.step);
            let mut sum = 0.0f64;
            for step in 0..steps as u64 {
                let at = (first + step as f64 * next).as_vec3().to_array();
                let value = level.at(FieldLevel::indices(number, at));
                if !value.is_nan() {
                    sum += f64::from(value);
                }
            }
            *out = (sum * part * line.length) as f32;
        }
    });
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, Grid, SampleType, Unit};
    use glam::{DAffine3, DQuat};

    /// A Gaussian's integral along any line is known, and that of all of it is.
    #[test]
    fn line_integrals_are_those_of_a_gaussian() {
        let (side, sigma) = (64u64, 7.0f64);
        let mut grid = Grid::volume([side; 3], SampleType::F32, Channel::numbered(1));
        let spacing = 0.25;
        grid.to_world = DAffine3::from_scale_rotation_translation(
            DVec3::splat(spacing),
            DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(0.3),
            DVec3::new(5.0, -3.0, 2.0),
        );
        let middle = DVec3::splat(31.5);
        let n = side as usize;
        let value = |i: usize| {
            let at = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / (n * n)) as f64) - middle;
            (-at.length_squared() / (2.0 * sigma * sigma)).exp() as f32
        };
        let values = (0..n * n * n).map(value).collect();
        let field = Field::new(&grid, vec![("value".into(), Unit::default(), values)], None);
        let center = grid.to_world.transform_point3(middle);
        let radius = sigma * spacing;
        // Interpolation is a convolution with a triangle along each axis, which adds its variance of a sixth of a square sample.
        let wide = (radius * radius + spacing * spacing / 6.0).sqrt();
        let peak = radius.powi(3) / wide.powi(2) * (2.0 * std::f64::consts::PI).sqrt();
        for projection in [Projection::Orthographic { height: 14.0 }, Projection::Perspective { fov_y: 0.6 }] {
            let view = View::look_at(center + DVec3::Z * 25.0, center, DVec3::Y, projection, 96, 80).unwrap();
            let picture = draw(&view, &field, 0);
            for (x, y) in [(48, 40), (30, 52), (61, 33)] {
                let line = [
                    view.at_depth([x as f64 + 0.5, y as f64 + 0.5], 10.0),
                    view.at_depth([x as f64 + 0.5, y as f64 + 0.5], 11.0),
                ];
                let along = (line[1] - line[0]).normalize();
                let away = (center - line[0]).reject_from(along).length_squared();
                let expected = peak * (-away / (2.0 * wide * wide)).exp();
                let found = f64::from(picture.p[y * 96 + x]);
                assert!((found - expected).abs() < 3e-4 * peak, "{x} {y}: {found} {expected}");
            }
            if let Projection::Orthographic { height } = projection {
                let total = picture.sum() * (height / 80.0f64).powi(2);
                let expected = (2.0 * std::f64::consts::PI).powf(1.5) * radius.powi(3);
                assert!((total / expected - 1.0).abs() < 1e-3, "{total} {expected}");
            }
        }
    }
}
