//! A plane through a field: the picture of what lies on it.

use super::xray::Line;
use super::{Field, FieldLevel};
use crate::color::Colors;
use crate::cpu::paths::fragments::TileFragments;
use crate::cpu::paths::{PathFragment, PathFragments};
use crate::view::{Projection, View};
use glam::DVec3;
use rayon::prelude::*;

/// From so many pixels a sample on, samples are seen as they are, with borders between them.
const AS_THEY_ARE: f64 = 3.0;

/// A plane in indices of samples: where `normal . index = distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Its normal, of any length but 0.
    pub normal: DVec3,
    /// Its place along that.
    pub distance: f64,
}

/// The colours of the values where each pixel's ray meets a plane; transparent where it meets nothing of the field. `color` is given the
/// values of all channels and says light and opacity.
pub fn draw(view: &View, field: &Field, plane: &Plane, color: impl Fn(&[f32]) -> [f32; 4] + Sync) -> Colors {
    let of = |_: f64, [r, g, b, a]: [f32; 4]| [r * a, g * a, b * a, a];
    Colors { width: view.width, height: view.height, rgba: pixels(view, field, plane, color, of) }
}

/// The same as parts of pixels, each with the depth at which its ray meets the plane.
pub fn fragments(
    view: &View,
    field: &Field,
    plane: &Plane,
    color: impl Fn(&[f32]) -> [f32; 4] + Sync,
) -> PathFragments {
    let of = |depth: f64, [r, g, b, alpha]: [f32; 4]| PathFragment { depth: depth as f32, color: [r, g, b], alpha };
    let parts = pixels(view, field, plane, color, of);
    let (mut starts, mut fragments) = (vec![0], Vec::new());
    for part in parts {
        fragments.extend(Some(part).filter(|part| part.alpha > 0.0));
        starts.push(fragments.len() as u32);
    }
    let size = [view.width, view.height].map(|pixels| pixels as usize);
    let tiles = vec![TileFragments { starts, fragments }];
    PathFragments { size, side: size[0].max(size[1]), tiles, is_hazy: false }
}

/// What each pixel comes to whose ray meets a plane in the field, of its depth and colour; the type's own nothing elsewhere.
fn pixels<T: Clone + Default + Send>(
    view: &View,
    field: &Field,
    plane: &Plane,
    color: impl Fn(&[f32]) -> [f32; 4] + Sync,
    of: impl Fn(f64, [f32; 4]) -> T + Sync,
) -> Vec<T> {
    let width = view.width as usize;
    let mut all = vec![T::default(); width * view.height as usize];
    let is_deep = matches!(view.projection, Projection::Perspective { .. });
    all.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        let mut values = vec![0.0; field.channels.len()];
        for (x, out) in row.iter_mut().enumerate() {
            let line = Line::of(view, field, [x as f64 + 0.5, y as f64 + 0.5]);
            let depth = (plane.distance - plane.normal.dot(line.start)) / plane.normal.dot(line.step);
            if !depth.is_finite() || is_deep && depth <= 0.0 {
                continue;
            }
            let index = line.at(depth);
            let is_cut = view.cut.clips() && !view.cut.keeps(field.to_world.transform_point3(index));
            let mut at = index.as_vec3().to_array();
            if !field.holds(at) || is_cut {
                continue;
            }
            let pixel = if is_deep { depth / view.focal_pixels() } else { 1.0 / view.focal_pixels() };
            let number = field.level_for(pixel);
            if field.spacing() >= AS_THEY_ARE * pixel {
                at = at.map(f32::round);
            }
            let at = FieldLevel::indices(number, at);
            for (value, channel) in values.iter_mut().zip(&field.channels) {
                *value = channel.levels[number].at(at);
            }
            *out = of(depth, color(&values));
        }
    });
    all
}
