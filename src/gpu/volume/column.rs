//! Fields of particles' columns in a perspective grid, as [`crate::cpu::volume::attributes`] reads them.
//!
//! Each column is resampled by itself, by the same passes as densities: its particles weigh their volumes, and its values are their attribute. Then
//! `read_column` takes what cells show of it to those that rays go through.

use super::field::layout::placing;
use crate::color::transfer::Scale;
use crate::cpu::field::ValueAxis;
use crate::cpu::volume::attributes::{ByDensity, ColumnMarch, LEAST_FILLED, Reading};
use bytemuck::{Pod, Zeroable};

/// Values of a cell that rays go through.
pub const VALUES: u32 = 4;

/// What a column is for: the volume's numbers.
pub const OF_VOLUME: u32 = 0;
/// The numbers that surfaces are of.
pub const OF_SURFACES: u32 = 1;
/// The densities that the volume's opacity goes by.
pub const OF_OPACITY: u32 = 2;
/// The attribute that colours it.
pub const OF_HUE: u32 = 3;

/// How it is read: as a density.
pub const READ_DENSITY: u32 = 0;
/// As F12's sum.
pub const READ_SUM: u32 = 1;
/// As the mean.
const READ_MEAN: u32 = 2;

/// How rays read cells: the volume's numbers are places of values.
pub const EVEN_TABLE: u32 = 1;
/// The volume's numbers have holes.
pub const HOLES_OF_VOLUME: u32 = 2;
/// The surfaces' numbers have holes.
pub const HOLES_OF_SURFACES: u32 = 4;
/// The extinction is multiplied.
pub const DIMMED: u32 = 8;

/// Points of the curve that opacity follows, at most.
const POINTS: usize = 8;

/// WGSL `ColumnView`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ColumnUniform {
    /// What it is for.
    pub role: u32,
    /// How it is read.
    pub reading: u32,
    /// 1: the logarithm of values is placed.
    pub is_log: u32,
    /// 1: surfaces are of the volume's numbers.
    pub is_alone: u32,
    /// The value, or its base-2 logarithm, where places begin.
    pub low: f32,
    /// Places for a unit of it.
    pub per: f32,
    /// What `sum V W` is multiplied by to be a share of space.
    pub filling: f32,
    /// The least such share at which the mean is known.
    pub least_filled: f32,
    /// Points in use.
    pub point_count: u32,
    /// Padding.
    pub unused: [u32; 3],
    /// What the extinction is multiplied by: place and factor.
    pub points: [[f32; 4]; POINTS],
}

impl ColumnUniform {
    /// What is read of the columns of a picture, in this order: with the column of each.
    pub fn all(march: &ColumnMarch) -> Vec<(usize, ColumnUniform)> {
        let shown = &march.shown;
        let plain = ColumnUniform {
            is_alone: u32::from(shown.surface.is_none()),
            filling: march.filling,
            least_filled: LEAST_FILLED,
            ..ColumnUniform::zeroed()
        };
        let mut all = vec![(0, ColumnUniform { role: OF_VOLUME, ..plain.read_as(&shown.volume) })];
        if let Some(reading) = &shown.surface {
            all.push((1, ColumnUniform { role: OF_SURFACES, ..plain.read_as(reading) }));
        }
        if let Some(by_density) = &shown.opacity {
            all.push((shown.opacity_column(), ColumnUniform { role: OF_OPACITY, ..plain.dimming(by_density) }));
        }
        if shown.has_hue {
            all.push((march.columns.len().saturating_sub(1), ColumnUniform { role: OF_HUE, ..plain }));
        }
        all
    }

    fn read_as(self, reading: &Reading) -> ColumnUniform {
        let number = match reading {
            Reading::Density => READ_DENSITY,
            Reading::Sum(_) => READ_SUM,
            Reading::Mean(_) => READ_MEAN,
        };
        let read = ColumnUniform { reading: number, ..self };
        reading.axis().map_or(read, |axis| read.on(axis))
    }

    /// With values placed on an axis.
    fn on(self, axis: &ValueAxis) -> ColumnUniform {
        let [low, per] = placing(axis);
        ColumnUniform { is_log: u32::from(axis.scale == Scale::Log), low, per, ..self }
    }

    fn dimming(self, by_density: &ByDensity) -> ColumnUniform {
        let curve = ByDensity::curve();
        let mut points = [[0.0; 4]; POINTS];
        // The curve has five.
        let known = curve.points().iter().take(POINTS);
        let point_count = known.len() as u32;
        points.iter_mut().zip(known).for_each(|(out, (place, factor))| *out = [*place, *factor, 0.0, 0.0]);
        let axis = ValueAxis { scale: Scale::Log, range: by_density.range };
        ColumnUniform { point_count, points, ..self.on(&axis) }
    }
}

/// How rays read the cells of a picture.
pub fn reading_of(march: &ColumnMarch) -> u32 {
    let surface = march.shown.surface.unwrap_or(march.shown.volume);
    let flags = [
        (EVEN_TABLE, march.shown.volume != Reading::Density),
        (HOLES_OF_VOLUME, matches!(march.shown.volume, Reading::Mean(_))),
        (HOLES_OF_SURFACES, matches!(surface, Reading::Mean(_))),
        (DIMMED, march.shown.opacity.is_some()),
    ];
    flags.into_iter().filter(|(_, is_so)| *is_so).map(|(flag, _)| flag).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_of_opacity_has_room() {
        let curve = ByDensity::curve();
        assert!(curve.points().len() <= POINTS && curve.at(1.0) == 1.0 && curve.at(0.0) == 0.0);
    }
}
