//! What lies on a plane, pixel by pixel, and what is drawn over its colours: lines of equal value, and a vector field as arrows or as streaks.
//!
//! Whatever fills a slice, a sampled field ([`super::field::plane`]) or particles ([`particles`]), the rest is the same.

pub mod arrows;
pub mod contours;
pub mod convolution;
pub mod particles;

use self::arrows::ArrowKey;
use super::paths::fragments::TileFragments;
use super::paths::{PathFragment, PathFragments};
use super::surface::look::Contours;
use crate::color::Colors;
use crate::view::{Projection, View};
use glam::DVec3;

/// Light lines, over what is dark, linear light.
const LIGHT: [f32; 3] = [0.9, 0.9, 0.88];
/// Dark lines, over what is bright, linear light.
const DARK: [f32; 3] = [0.02, 0.02, 0.03];
/// Luminance from which on lines are dark: halfway between black and white as the eye sees them.
const BRIGHT: f32 = 0.18;

/// What a pixel shows of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlicePixel {
    /// Depth of the place of the plane.
    pub depth: f32,
    /// Its colour, linear light, as if it were opaque.
    pub color: [f32; 3],
    /// Its opacity; 0 where there is nothing.
    pub alpha: f32,
    /// What lines are of; NaN where there is nothing, and where none are wanted.
    pub value: f32,
    /// Direction of the vector within the plane as it is seen, pixels to the right and down, of length 1; 0 where there is none.
    pub along: [f32; 2],
    /// Length of the vector within the plane, in its own unit; NaN where there is none.
    pub speed: f32,
}

impl SlicePixel {
    /// Nothing of the plane.
    pub const NOTHING: SlicePixel =
        SlicePixel { depth: 0.0, color: [0.0; 3], alpha: 0.0, value: f32::NAN, along: [0.0; 2], speed: f32::NAN };

    /// The same with a vector at a place of the world, of which the part within a plane counts, whose unit normal this is.
    #[must_use]
    pub fn with_vector(self, view: &View, normal: DVec3, place: DVec3, vector: DVec3) -> SlicePixel {
        if !vector.is_finite() {
            return self;
        }
        let flat = vector - vector.dot(normal) * normal;
        let (camera, depth) = (view.to_camera(place), flat.dot(view.forward));
        let [mut x, mut y] = [view.right, view.up].map(|axis| flat.dot(axis));
        if matches!(view.projection, Projection::Perspective { .. }) {
            x -= camera.x / camera.z * depth;
            y -= camera.y / camera.z * depth;
        }
        let (speed, seen) = (flat.length(), x.hypot(y));
        // What points to the eye, or is nothing but rounding, has no direction.
        let along =
            if seen > 1e-9 * vector.length() { [x / seen, -y / seen].map(|part| part as f32) } else { [0.0; 2] };
        SlicePixel { along, speed: speed as f32, ..self }
    }

    /// Whether it has a vector with a direction.
    fn has_direction(&self) -> bool {
        self.along != [0.0; 2]
    }
}

/// What a picture shows of a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Row by row.
    pub pixels: Vec<SlicePixel>,
}

/// What is drawn over the colours of a slice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overlay {
    /// Lines of equal value; their colour is that over what is bright.
    pub contours: Option<Contours>,
    /// A vector field.
    pub vectors: Option<Vectors>,
}

/// How a vector field is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vectors {
    /// As arrows.
    Arrows {
        /// From one to the next, pixels.
        spacing: f64,
        /// Length of a vector whose arrow is as long as that; found from those that are drawn where it is `None`.
        scale: Option<f64>,
    },
    /// As streaks: noise that is smeared along the field.
    Streaks {
        /// How long noise is smeared, pixels.
        length: f64,
    },
}

impl Slice {
    /// A picture of nothing.
    pub fn new(view: &View) -> Slice {
        let size = [view.width, view.height].map(|pixels| pixels as usize);
        Slice { size, pixels: vec![SlicePixel::NOTHING; size[0] * size[1]] }
    }

    /// Draws over its colours: streaks under lines, arrows over them. How long these are, where there are any.
    pub fn decorate(&mut self, overlay: &Overlay) -> Option<ArrowKey> {
        // Lines are told from the colours before these are streaked.
        let lines = overlay.contours.map(|contours| contours::lines(self, &contours));
        if let Some(Vectors::Streaks { length }) = overlay.vectors {
            convolution::streak(self, length);
        }
        if let Some(lines) = lines {
            contours::draw(self, &lines);
        }
        let Some(Vectors::Arrows { spacing, scale }) = overlay.vectors else { return None };
        let found = arrows::of(self, spacing, scale);
        arrows::draw(self, &found, spacing);
        (found.scale > 0.0).then_some(ArrowKey { scale: found.scale, spacing })
    }

    /// As a picture of premultiplied light.
    pub fn colors(&self) -> Colors {
        let [width, height] = self.size.map(|side| side as u32);
        let rgba = self
            .pixels
            .iter()
            .map(|SlicePixel { color: [r, g, b], alpha, .. }| [r * alpha, g * alpha, b * alpha, *alpha]);
        Colors { width, height, rgba: rgba.collect() }
    }

    /// As parts of pixels, each at its depth, that something else is drawn among.
    pub fn fragments(&self) -> PathFragments {
        let (mut starts, mut fragments) = (vec![0], Vec::new());
        for &SlicePixel { depth, color, alpha, .. } in &self.pixels {
            fragments.extend((alpha > 0.0).then_some(PathFragment { depth, color, alpha }));
            starts.push(fragments.len() as u32);
        }
        let tiles = vec![TileFragments { starts, fragments }];
        PathFragments { size: self.size, side: self.size[0].max(self.size[1]), tiles, is_hazy: false }
    }
}

/// A colour with a share of another one.
fn mix(color: [f32; 3], other: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|k| color[k] + share * (other[k] - color[k]))
}

/// Whether dark lines are seen on a colour, of linear light, better than light ones.
fn is_bright([r, g, b]: [f32; 3]) -> bool {
    0.2126 * r + 0.7152 * g + 0.0722 * b > BRIGHT
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_4;

    /// In every projection a vector points to where its end is seen, and its length is that within the plane.
    #[test]
    fn vectors_point_to_where_their_ends_are_seen() {
        let normal = DVec3::new(1.0, 0.4, 2.0).normalize();
        for projection in [Projection::Perspective { fov_y: FRAC_PI_4 }, Projection::Orthographic { height: 6.0 }] {
            let eye = DVec3::new(2.0, 1.0, 7.0);
            let view = View::look_at(eye, DVec3::new(0.3, 0.1, 0.0), DVec3::Y, projection, 90, 70).expect("a view");
            for i in 0..20 {
                let turned = f64::from(i) * 0.7;
                let place = DVec3::new(turned.sin(), turned.cos(), 0.1 * turned);
                let vector = DVec3::new((2.0 * turned).cos(), (3.0 * turned).sin(), (5.0 * turned).cos());
                let flat = vector - vector.dot(normal) * normal;
                let [from, to] = [place - 1e-6 * flat, place + 1e-6 * flat]
                    .map(|end| view.to_pixels(view.to_camera(end)).expect("in front of the eye"));
                let (x, y) = (to[0] - from[0], to[1] - from[1]);
                let found = SlicePixel::NOTHING.with_vector(&view, normal, place, vector);
                let [right, down] = found.along.map(f64::from);
                let sine = (right * y - down * x) / x.hypot(y);
                assert!(sine.abs() < 1e-5 && right * x + down * y > 0.0, "{projection:?}: {found:?} for {x} {y}");
                assert!((f64::from(found.speed) / flat.length() - 1.0).abs() < 1e-6);
            }
            let across = SlicePixel::NOTHING.with_vector(&view, normal, DVec3::ZERO, 3.0 * normal);
            assert!(!across.has_direction() && across.speed < 1e-6, "{across:?}");
        }
    }
}
