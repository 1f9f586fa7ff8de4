//! A row of samples of a level above full resolution: heights, how much of T is there, mean normals and colours.

use super::compact::Compact;
use super::lattice::Lattice;
use super::sums::{UNIT, WideSum};
use crate::codec::values::Values;
use crate::model::light;

/// Samples of a row of a level from 1 on.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Heights as they are stored; NaN where nothing is covered. A sample that was measured keeps its own at every level; others have a height
    /// that fits to those around.
    pub stored: Compact,
    /// Share of T in what the sample stands for: 0 where nothing is, 255 where all is, else from 1 to 254.
    pub coverage: Vec<u8>,
    /// Means of unit normals ([`normal_of`]).
    pub normals: Vec<[u8; 3]>,
    /// How far normals and colours are from their mean, in 255ths, rounded up.
    pub deviation: Vec<[u8; 2]>,
    /// Colours of each plane.
    pub planes: Vec<Vec<u8>>,
}

/// A mean normal from its bytes: x and y as 128 + 127 n, z as 255 n.
#[inline]
pub fn normal_of(bytes: [u8; 3]) -> [f32; 3] {
    [(f32::from(bytes[0]) - 128.0) / 127.0, (f32::from(bytes[1]) - 128.0) / 127.0, f32::from(bytes[2]) / 255.0]
}

/// The bytes of a normal that points up, which also stand where there is no surface.
pub const UP: [u8; 3] = [128, 128, 255];

/// What a row is made of.
#[derive(Clone, Copy, Debug)]
pub struct Below<'a> {
    /// The lattice.
    pub lattice: Lattice,
    /// The level, from 1 on.
    pub level: u32,
    /// The row among the level's.
    pub row: u64,
    /// Which values samples have.
    pub values: Values,
    /// Rows of the level below: the one before the sample's own, its own, the one after it.
    pub heights: [Option<&'a Compact>; 3],
}

/// The sample that says what a sample stands for: itself, or the one before it where that is nothing.
pub fn stand_in(lattice: &Lattice, axis: usize, level: u32, index: u64) -> u64 {
    let [first, end] = lattice.stands_for(axis, level, index);
    if first == end { index.saturating_sub(1) } else { index }
}

/// Makes a row. `sum` and `light` give, by the column, sums over what a sample of row [`stand_in`] stands for.
pub fn row(
    below: &Below<'_>,
    planes: usize,
    sum: impl Fn(usize) -> WideSum,
    light: impl Fn(usize, usize) -> [f64; 2],
) -> Row {
    let Below { lattice, level, row, values, heights } = *below;
    let columns = lattice.samples_of(level)[1] as usize;
    let mut stored = Vec::with_capacity(columns);
    let mut out = Row {
        stored: Compact::new(values.sample_type(), &[]),
        coverage: Vec::with_capacity(columns),
        normals: Vec::with_capacity(columns),
        deviation: Vec::with_capacity(columns),
        planes: vec![Vec::with_capacity(columns); planes],
    };
    let row_for = stand_in(&lattice, 0, level, row);
    let cells_of = |axis: usize, index: u64| {
        let [first, end] = lattice.stands_for(axis, level, index);
        end - first
    };
    let (tall, last) = (cells_of(0, row_for), columns.saturating_sub(1));
    let mut carried = 0.0;
    for column in 0..columns {
        let own = if column < last { column as u64 } else { stand_in(&lattice, 1, level, column as u64) };
        let sum_here = sum(own as usize);
        let cells = tall * cells_of(1, own);
        let is_counted = row_for == row && own == column as u64;
        let mut coverage = coverage(&sum_here, cells, is_counted, &mut carried);
        let at = lattice.below(1, level, column as u64) as usize;
        let mut height = heights[1].map_or(f64::NAN, |heights| heights.get(at));
        if height.is_nan() && coverage > 0 {
            height = values.nearest(fitted(heights, at));
        }
        if height.is_nan() {
            coverage = 0;
        } else if coverage == 0 && is_counted {
            // The level below had a height here for what stands in for it there.
            height = f64::NAN;
        } else {
            coverage = coverage.max(1);
        }
        stored.push(height);
        out.coverage.push(coverage);
        let (normal, spread) = mean_normal(&sum_here);
        out.normals.push(normal);
        let weight = sum_here.weight().max(1) as f64;
        let mut colour_spread: u8 = 0;
        for (plane, values) in out.planes.iter_mut().enumerate() {
            let [mean, square] = light(own as usize, plane).map(|sum| sum / weight);
            values.push(light::value(mean));
            colour_spread = colour_spread.max(spread_of((square - mean * mean) / f64::from(light::FULL).powi(2)));
        }
        out.deviation.push([spread, colour_spread]);
    }
    out.stored = Compact::new(values.sample_type(), &stored);
    out
}

/// The share of T in so many cells, in 255ths; what rounding adds or leaves out is carried along the row, at most one 255th of a sample.
fn coverage(sum: &WideSum, cells: u64, is_counted: bool, carried: &mut f64) -> u8 {
    if sum.area == 0 {
        return u8::from(sum.lone > 0);
    }
    if sum.area >= 2 * cells {
        return 255;
    }
    let cells = cells as f64;
    let used = if is_counted { carried.clamp(-cells, cells) } else { 0.0 };
    let wanted = 127.5 * sum.area as f64 + used;
    let coverage = (wanted / cells + 0.5).floor().clamp(1.0, 254.0);
    if is_counted {
        *carried = *carried - used + (wanted - coverage * cells).clamp(-cells, cells);
    }
    coverage as u8
}

/// A height where none was measured, from those around it in the level below: the mean of the middles of opposite ones, so that planes go on,
/// else the mean of those that are there.
fn fitted(heights: [Option<&Compact>; 3], column: usize) -> f64 {
    let at = |row: usize, shift: usize| {
        let column = (column + shift).checked_sub(1)?;
        heights[row].map(|heights| heights.get(column)).filter(|height| !height.is_nan())
    };
    let around = [[0, 0], [0, 1], [0, 2], [1, 2], [2, 2], [2, 1], [2, 0], [1, 0]].map(|[row, shift]| at(row, shift));
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value / 8.0, count + 1.0));
        sum / count * 8.0
    };
    let middles = mean(&mut (0..4).filter_map(|pair| Some(around[pair]? / 2.0 + around[pair + 4]? / 2.0)));
    if middles.is_nan() { mean(&mut around.into_iter().flatten()) } else { middles }
}

/// The mean normal's bytes, and how far unit normals are from it.
fn mean_normal(sum: &WideSum) -> ([u8; 3], u8) {
    if sum.area == 0 {
        return (UP, 0);
    }
    let share = 1.0 / (sum.area as f64 * f64::from(UNIT));
    let mean = [sum.normal[0] as f64 * share, sum.normal[1] as f64 * share, sum.normal[2] as f64 * share];
    let length: f64 = mean.iter().map(|part| part * part).sum();
    let byte = |value: f64| (value + 0.5) as u8;
    let bytes = [byte(128.0 + 127.0 * mean[0]), byte(128.0 + 127.0 * mean[1]), byte(255.0 * mean[2])];
    // Rounding of the sums' normals alone makes up to 2 / UNIT.
    (bytes, spread_of(1.0 - length - 2.0 / f64::from(UNIT)))
}

/// The root of a mean square in 255ths, rounded up.
fn spread_of(square: f64) -> u8 {
    // A little rounding is no spread.
    let spread = 255.0 * (square - 1e-9).max(0.0).sqrt();
    let whole = spread as u8;
    whole.saturating_add(u8::from(f64::from(whole) < spread))
}
