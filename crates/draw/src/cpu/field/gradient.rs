//! How steep a field is.

use crate::model::Grid;
use glam::DVec3;
use rayon::prelude::*;

/// Magnitudes of the gradient of a grid's values, per world unit: by central differences, where a neighbour is missing by one-sided ones;
/// NaN where the value is.
pub fn magnitudes(grid: &Grid, values: &[f32]) -> Vec<f32> {
    let shape = grid.shape.map(|side| side as usize);
    let steps = [1, shape[0], shape[0] * shape[1]];
    // A gradient is turned by the inverse of what turns places, transposed.
    let to_world = grid.to_world.matrix3.inverse().transpose();
    let steepness = |(index, own): (usize, &f32)| {
        if own.is_nan() {
            return f32::NAN;
        }
        let slope = |axis: usize| {
            let (at, step) = (index / steps[axis] % shape[axis], steps[axis]);
            let below = (at > 0).then(|| values[index - step]).filter(|value| value.is_finite());
            let above = (at + 1 < shape[axis]).then(|| values[index + step]).filter(|value| value.is_finite());
            f64::from(match (below, above) {
                (Some(below), Some(above)) => 0.5 * (above - below),
                (Some(below), None) => own - below,
                (None, Some(above)) => above - own,
                (None, None) => 0.0,
            })
        };
        let along =
            DVec3::from_array(std::array::from_fn(|axis| if axis < grid.dimensions { slope(axis) } else { 0.0 }));
        (to_world * along).length() as f32
    };
    values.par_iter().enumerate().map(steepness).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, SampleType};
    use glam::{DAffine3, DMat3};

    #[test]
    fn a_plane_is_as_steep_in_any_axes() {
        let mut grid = Grid::volume([7, 6, 5], SampleType::F32, Channel::numbered(1));
        let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        grid.to_world = DAffine3::from_mat3_translation(
            turned * DMat3::from_diagonal(DVec3::new(0.5, 2.0, 1.5)),
            DVec3::new(4.0, -3.0, 9.0),
        );
        let slope = DVec3::new(3.0, -1.0, 2.0);
        let place =
            |i: usize| grid.to_world.transform_point3(DVec3::new((i % 7) as f64, (i / 7 % 6) as f64, (i / 42) as f64));
        let mut values: Vec<f32> = (0..210).map(|i| slope.dot(place(i)) as f32).collect();
        values[100] = f32::NAN;
        let found = magnitudes(&grid, &values);
        for (index, steepness) in found.iter().enumerate() {
            let is_right = (f64::from(*steepness) - slope.length()).abs() < 1e-4;
            assert!(is_right || (index == 100 && steepness.is_nan()), "{index}: {steepness}");
        }
    }
}
