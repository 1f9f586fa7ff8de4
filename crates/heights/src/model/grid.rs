//! Where the samples of a height field are, and what they mean.

use super::units;
use deepfield_data::model::{SampleType, Scale, Unit};

/// A colour plane beside the heights: one value of 8 bits a sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plane {
    /// Its name: `red`, `green`, `blue`, or the source's own.
    pub name: String,
}

/// A grid of heights. Sample (row `r`, column `c`) is at `x = origin[0] + c step[0]`, `y = origin[1] + r step[1]`; signs are those
/// of the file, rows count as in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightGrid {
    /// Samples of a row; at least 2.
    pub columns: u64,
    /// Rows; at least 2.
    pub rows: u64,
    /// Where sample (0, 0) is, in `xy_unit`.
    pub origin: [f64; 2],
    /// From a column to the next, and from a row to the next; neither is 0.
    pub step: [f64; 2],
    /// Unit of places: `m`, `mm`, `um`, `nm`, `km` or `deg`; empty when unknown.
    pub xy_unit: Unit,
    /// Unit of heights: a length; empty when unknown.
    pub height_unit: Unit,
    /// How the source stores a sample.
    pub sample_type: SampleType,
    /// From stored samples to heights.
    pub scale: Scale,
    /// Colour planes, one value a sample each.
    pub planes: Vec<Plane>,
    /// The coordinate reference system as the source names it: `EPSG:4326`.
    pub crs: Option<String>,
}

impl HeightGrid {
    /// A grid whose samples are 1 apart from (0, 0) on, without units.
    pub fn new(columns: u64, rows: u64, sample_type: SampleType) -> HeightGrid {
        HeightGrid {
            columns,
            rows,
            origin: [0.0; 2],
            step: [1.0; 2],
            xy_unit: Unit::default(),
            height_unit: Unit::default(),
            sample_type,
            scale: Scale::NONE,
            planes: Vec::new(),
            crs: None,
        }
    }

    /// Number of samples.
    pub fn samples(&self) -> u64 {
        self.columns * self.rows
    }

    /// Where a sample, or a place between samples, is: x and y.
    pub fn place(&self, row: f64, column: f64) -> [f64; 2] {
        [self.step[0].mul_add(column, self.origin[0]), self.step[1].mul_add(row, self.origin[1])]
    }

    /// Of a grid in degrees that goes round a globe: the number of the column that is at the place of the first one again. It is the last one
    /// where the first is repeated, and one that there is not where a spacing is left between the last and the first.
    pub fn around(&self) -> Option<u64> {
        // Steps are written with few digits now and then.
        const SAME: f64 = 0.05;
        let step = self.step[0].abs();
        let column = (360.0 / step).round();
        let is_round = units::is_degrees(&self.xy_unit) && (column * step - 360.0).abs() < SAME * step;
        [self.columns - 1, self.columns].into_iter().find(|around| is_round && column == *around as f64)
    }

    /// Where x is degrees: the same longitude some turns further, where the grid has columns there. Else x as it is.
    pub fn in_turn(&self, x: f64) -> f64 {
        let ends = [self.origin[0], self.place(0.0, (self.columns - 1) as f64)[0]];
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let turned = low + (x - low).rem_euclid(360.0);
        let is_elsewhere = units::is_degrees(&self.xy_unit) && !(low..=high).contains(&x);
        if is_elsewhere && turned <= high { turned } else { x }
    }

    /// The row and the column, with fractions, at a place.
    pub fn row_column(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(y - self.origin[1]) / self.step[1], (x - self.origin[0]) / self.step[0]]
    }

    /// Type and shape in words, as messages have them: `563 x 484 of int16`, columns first.
    pub fn described(&self) -> String {
        format!("{} x {} of {}", self.columns, self.rows, self.sample_type)
    }
}
