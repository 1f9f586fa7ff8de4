//! Heights that are so much farther apart than x and y that the unit of these is missing.

use crate::model::{HeightGrid, units};

/// How many times as far as the field is wide or long heights are apart where units are asked for: no instrument measures such needles.
const NEEDLE: f64 = 100.0;

/// A sentence where x and y have no unit but may be degrees, and heights between these would be a needle that pictures do not show.
pub fn note(grid: &HeightGrid, [min, max]: [f64; 2]) -> Option<String> {
    is_needle(grid, [min, max]).then(|| format!("{}: --xy-unit deg if these are degrees", told(grid, [min, max])))
}

/// Whether pictures may take x and y of such a field for degrees, which the range of its heights decides ([`taken`]): heights are metres or have no unit,
/// and the field is not about (0, 0), from which scans count.
pub fn may_be_taken(grid: &HeightGrid) -> bool {
    let ends = ends(grid);
    let is_at_zero = (0..2).all(|axis| {
        let (low, high) = (ends[0][axis].min(ends[1][axis]), ends[0][axis].max(ends[1][axis]));
        let step = grid.step[axis].abs();
        low <= step && high >= -step
    });
    let are_metres = grid.height_unit.is_unknown() || units::metres(&grid.height_unit) == Some(1.0);
    may_be_degrees(grid) && are_metres && !is_at_zero
}

/// A sentence where pictures take x and y for degrees.
pub fn taken(grid: &HeightGrid, [min, max]: [f64; 2]) -> Option<String> {
    (may_be_taken(grid) && is_needle(grid, [min, max])).then(|| {
        format!("{}, and count as degrees in pictures: --xy-unit m if they are metres", told(grid, [min, max]))
    })
}

/// The places of the first and of the last sample.
fn ends(grid: &HeightGrid) -> [[f64; 2]; 2] {
    [0.0, 1.0].map(|end| grid.place(end * (grid.rows - 1) as f64, end * (grid.columns - 1) as f64))
}

/// How wide and how long a field is.
fn extents(grid: &HeightGrid) -> [f64; 2] {
    let ends = ends(grid);
    [0, 1].map(|axis| (ends[1][axis] - ends[0][axis]).abs())
}

fn may_be_degrees(grid: &HeightGrid) -> bool {
    let are_degrees = ends(grid).iter().all(|[x, y]| x.abs() <= 360.0 && y.abs() <= 90.0);
    grid.xy_unit.is_unknown() && are_degrees && grid.step.iter().all(|step| step.abs() < 1.0)
}

fn is_needle(grid: &HeightGrid, [min, max]: [f64; 2]) -> bool {
    let [across, along] = extents(grid);
    may_be_degrees(grid) && max - min > NEEDLE * across.max(along)
}

fn told(grid: &HeightGrid, [min, max]: [f64; 2]) -> String {
    let [across, along] = extents(grid).map(shown);
    format!("x and y, without a unit, are {across} and {along} wide, heights {} apart", shown(max - min))
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
    #[test]
    fn pictures_take_what_is_no_scan_for_degrees() {
        let mut grid = HeightField::of(403, 344, vec![0.0; 403 * 344]).grid;
        (grid.step, grid.origin) = ([1.0 / 1200.0, -1.0 / 1200.0], [-84.41, 36.73]);
        let found = taken(&grid, [236.0, 1076.0]).expect("a needle");
        assert!(found.contains("0.3350 and 0.2858 wide, heights 840.0 apart") && found.contains(": --xy-unit m if"));
        assert_eq!(taken(&grid, [0.0, 33.0]), None);
        assert_eq!(taken(&grid, [f64::NAN; 2]), None);
        for unit in ["um", "mm", "km"] {
            grid.height_unit = Unit::new(unit);
            assert_eq!(taken(&grid, [236.0, 1076.0]), None, "{unit}");
        }
        grid.height_unit = Unit::new("m");
        assert!(taken(&grid, [236.0, 1076.0]).is_some());
        for origin in [[0.0, 0.0], [0.0005, -0.0005], [-0.2, 0.1]] {
            grid.origin = origin;
            assert_eq!(taken(&grid, [236.0, 1076.0]), None, "{origin:?}");
            assert!(note(&grid, [236.0, 1076.0]).is_some());
        }
        (grid.origin, grid.xy_unit) = ([-84.41, 36.73], Unit::new("mm"));
        assert!(!may_be_taken(&grid));
    }
}
