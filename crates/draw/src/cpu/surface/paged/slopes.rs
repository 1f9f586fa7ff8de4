//! What turns differences of heights from a column and from a row to the next into slopes at true height.

use super::super::placed::Placed;
use deepfield_data::model::Scale;
use deepfield_heights::build::slopes;
use deepfield_heights::model::HeightGrid;

/// Slopes that differ by such a share are the same.
const SAME: f64 = 1e-6;

/// As files are built: degrees are those of the Earth.
pub(super) fn of_file(grid: &HeightGrid) -> [f64; 2] {
    slopes(&HeightGrid { scale: Scale::NONE, ..grid.clone() })
}

/// In a world.
pub(super) fn of_world(placed: &Placed) -> [f64; 2] {
    placed.lengths().map(|length| placed.true_lift / length)
}

/// Whether the same normals are made with both.
pub(super) fn is_same(one: [f64; 2], other: [f64; 2]) -> bool {
    (0..2).all(|axis| (one[axis] / other[axis] - 1.0).abs() <= SAME)
}
