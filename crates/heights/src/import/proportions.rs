//! Heights that are so much farther apart than x and y that the unit of these is missing.

use crate::model::HeightGrid;

/// How many times as far as the field is wide or long heights are apart where units are asked for: no instrument measures such needles.
const NEEDLE: f64 = 100.0;

/// A sentence where x and y have no unit but may be degrees, and heights between these would be a needle that pictures do not show.
pub fn note(grid: &HeightGrid, [min, max]: [f64; 2]) -> Option<String> {
    let ends = [0.0, 1.0].map(|end| grid.place(end * (grid.rows - 1) as f64, end * (grid.columns - 1) as f64));
    let are_degrees = ends.iter().all(|[x, y]| x.abs() <= 360.0 && y.abs() <= 90.0);
    let [across, along] = [0, 1].map(|axis| (ends[1][axis] - ends[0][axis]).abs());
    let is_needle = max - min > NEEDLE * across.max(along);
    (grid.xy_unit.0.is_empty() && are_degrees && is_needle && grid.step.iter().all(|step| step.abs() < 1.0)).then(
        || {
            format!(
                "x and y, without a unit, are {} and {} wide, heights {} apart: --xy-unit deg if these are degrees",
                shown(across),
                shown(along),
                shown(max - min)
            )
        },
    )
}

/// A length to four places.
fn shown(length: f64) -> String {
    let digits = (3.0 - length.abs().max(1e-12).log10().floor()).max(0.0);
    format!("{length:.*}", digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::HeightField;
    use deepfield_data::model::Unit;

    #[test]
    fn degrees_without_a_unit_are_asked_for() {
        let mut grid = HeightField::of(403, 344, vec![0.0; 403 * 344]).grid;
        // Samples a unit apart are a field without lengths.
        assert_eq!(note(&grid, [236.0, 107_600.0]), None);
        grid.step = [1.0 / 1200.0, -1.0 / 1200.0];
        assert_eq!(
            note(&grid, [236.0, 1076.0]).as_deref(),
            Some(
                "x and y, without a unit, are 0.3350 and 0.2858 wide, heights 840.0 apart: --xy-unit deg if these are degrees"
            )
        );
        assert_eq!(note(&grid, [0.0, 33.0]), None);
        grid.xy_unit = Unit("deg".into());
        assert_eq!(note(&grid, [236.0, 1076.0]), None);
    }
}
