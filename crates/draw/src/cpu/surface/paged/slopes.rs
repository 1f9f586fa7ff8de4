//! What turns differences of heights from a column and from a row to the next into slopes at true height.

use super::super::placed::{Map, Placed};
use deepfield_data::model::Scale;
use deepfield_heights::build::slopes;
use deepfield_heights::model::HeightGrid;

/// Slopes that differ by such a share are the same.
const SAME: f64 = 1e-6;

/// As files are built: degrees are those of the Earth.
pub(super) fn of_file(grid: &HeightGrid) -> [f64; 2] {
    slopes(&HeightGrid { scale: Scale::NONE, ..grid.clone() })
}

/// In a world. Places of a globe are as far apart as in the middle of the field, as they are in the file.
pub(super) fn of_world(grid: &HeightGrid, placed: &Placed) -> [f64; 2] {
    let mut step = placed.step;
    if let Map::Globe(globe) = placed.map {
        let [_, latitude] = grid.place((grid.rows - 1) as f64 / 2.0, 0.0);
        let narrow = latitude.to_radians().cos().abs().max(0.01);
        let radius = (2.0 * globe.equator + globe.pole) / 3.0;
        step = [step[0].to_radians() * radius * narrow, step[1].to_radians() * radius];
    }
    step.map(|step| placed.true_lift / step)
}

/// Whether the same normals are made with both.
pub(super) fn is_same(one: [f64; 2], other: [f64; 2]) -> bool {
    (0..2).all(|axis| (one[axis] / other[axis] - 1.0).abs() <= SAME)
}
