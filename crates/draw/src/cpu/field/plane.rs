//! A plane through a field: the picture of what lies on it.

use super::xray::Line;
use super::{Field, FieldLevel};
use crate::cpu::slice::{Slice, SlicePixel};
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

/// What is wanted of a field on a plane beside its colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Whether the first channel's values are, interpolated however large samples are seen.
    pub values: bool,
    /// The channels of a vector's components along x, y and z of the world; of those that there are none of the vector has nothing.
    pub vector: Option<[Option<usize>; 3]>,
}

/// What each pixel's ray meets of a field on a plane. `color` is given the values of all channels and says light and opacity.
pub fn slice(
    view: &View,
    field: &Field,
    plane: &Plane,
    wanted: Wanted,
    color: impl Fn(&[f32]) -> [f32; 4] + Sync,
) -> Slice {
    let mut slice = Slice::new(view);
    let width = slice.size[0];
    let is_deep = matches!(view.projection, Projection::Perspective { .. });
    // The normal of a plane of indices is a covector.
    let normal = (field.to_index.matrix3.transpose() * plane.normal).normalize_or_zero();
    slice.pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        let mut values = vec![0.0; field.channels.len()];
        for (x, out) in row.iter_mut().enumerate() {
            let line = Line::of(view, field, [x as f64 + 0.5, y as f64 + 0.5]);
            let depth = (plane.distance - plane.normal.dot(line.start)) / plane.normal.dot(line.step);
            if !depth.is_finite() || is_deep && depth <= 0.0 {
                continue;
            }
            let index = line.at(depth);
            let is_cut = view.cut.clips() && !view.cut.keeps(field.to_world.transform_point3(index));
            let exact = index.as_vec3().to_array();
            if !field.holds(exact) || is_cut {
                continue;
            }
            let pixel = if is_deep { depth / view.focal_pixels() } else { 1.0 / view.focal_pixels() };
            let number = field.level_for(pixel);
            let as_they_are = field.spacing() >= AS_THEY_ARE * pixel;
            let at = FieldLevel::indices(number, if as_they_are { exact.map(f32::round) } else { exact });
            for (value, channel) in values.iter_mut().zip(&field.channels) {
                *value = channel.levels[number].at(at);
            }
            let [r, g, b, alpha] = color(&values);
            *out = SlicePixel { depth: depth as f32, color: [r, g, b], alpha, ..SlicePixel::NOTHING };
            let between = FieldLevel::indices(number, exact);
            if wanted.values {
                out.value = field.channels[0].levels[number].at(between);
            }
            if let Some(channels) = wanted.vector {
                let component = |channel: Option<usize>| {
                    channel.map_or(0.0, |channel| f64::from(field.channels[channel].levels[number].at(between)))
                };
                let vector = DVec3::from_array(channels.map(component));
                *out = out.with_vector(view, normal, field.to_world.transform_point3(index), vector);
            }
        }
    });
    slice
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, Grid, SampleType, Unit};
    use glam::{DAffine3, DQuat};

    /// Of a field that is linear in the world, values and vectors on an oblique plane are what the formula says there, through a grid that lies askew.
    #[test]
    fn values_and_vectors_are_those_of_the_places_on_the_plane() {
        let mut grid = Grid::volume([20, 24, 22], SampleType::F32, Channel::numbered(4));
        let turned = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(0.3);
        grid.to_world =
            DAffine3::from_scale_rotation_translation(DVec3::new(0.25, 0.2, 0.3), turned, DVec3::new(5.0, -3.0, 2.0));
        let value = |at: DVec3| 2.0 + at.x - 0.5 * at.y + 0.25 * at.z;
        let vector = |at: DVec3| DVec3::new(at.y + 1.0, at.z - at.x, 0.3 * at.x);
        let plane_of = |of: &dyn Fn(DVec3) -> f64| -> Vec<f32> {
            let index = |i: usize| DVec3::new((i % 20) as f64, (i / 20 % 24) as f64, (i / 480) as f64);
            (0..20 * 24 * 22).map(|i| of(grid.to_world.transform_point3(index(i))) as f32).collect()
        };
        let planes = [
            plane_of(&value),
            plane_of(&|at| vector(at).x),
            plane_of(&|at| vector(at).y),
            plane_of(&|at| vector(at).z),
        ];
        let channels = planes.into_iter().map(|values| ("a".to_owned(), Unit::default(), values)).collect();
        let field = Field::new(&grid, channels, None);
        let plane = Plane { normal: DVec3::new(0.3, 0.2, 1.0), distance: 15.0 };
        let middle = field.bounds().center();
        let projection = Projection::Perspective { fov_y: 0.6 };
        let view =
            View::look_at(middle + DVec3::new(3.0, 4.0, 9.0), middle, DVec3::Y, projection, 120, 90).expect("a view");
        let wanted = Wanted { values: true, vector: Some([Some(1), Some(2), Some(3)]) };
        let found = slice(&view, &field, &plane, wanted, |values| [values[0], 0.0, 0.0, 1.0]);
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| {
            // Three places of the plane.
            let flat = 10.0 * corner - plane.normal * plane.normal.dot(10.0 * corner) / plane.normal.length_squared();
            let index = flat + plane.normal * plane.distance / plane.normal.length_squared();
            field.to_world.transform_point3(index)
        });
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let mut met = 0;
        for (at, pixel) in found.pixels.iter().enumerate().filter(|(_, pixel)| pixel.alpha > 0.0) {
            let place = view.at_depth([(at % 120) as f64 + 0.5, (at / 120) as f64 + 0.5], f64::from(pixel.depth));
            assert!((place - corners[0]).dot(normal).abs() < 1e-4, "{place}");
            let index = field.to_index.transform_point3(place);
            // Beyond the outermost samples values are theirs.
            if index.min_element() < 0.0 || (DVec3::new(19.0, 23.0, 21.0) - index).min_element() < 0.0 {
                continue;
            }
            met += 1;
            assert!((f64::from(pixel.value) - value(place)).abs() < 1e-3, "{place}: {pixel:?}");
            let flat = vector(place) - vector(place).dot(normal) * normal;
            assert!((f64::from(pixel.speed) - flat.length()).abs() < 1e-3, "{place}: {pixel:?} for {flat}");
        }
        assert!(met > 500, "{met}");
        // Without anything wanted colours are the same, and nothing else is there.
        let plain = slice(&view, &field, &plane, Wanted::default(), |values| [values[0], 0.0, 0.0, 1.0]);
        let is_alike = |(plain, whole): (&SlicePixel, &SlicePixel)| plain.color == whole.color && plain.value.is_nan();
        assert!(plain.pixels.iter().zip(&found.pixels).all(is_alike));
    }
}
