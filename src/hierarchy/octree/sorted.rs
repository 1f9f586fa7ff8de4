//! A family's particles in Morton order.

use super::OctreeError;
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::RootCell;
use crate::model::{Bounds, Family};
use glam::DVec3;
use rayon::prelude::*;

/// Quantities of many particles, one column each.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    pub mass: Vec<f32>,
    pub density: Vec<f32>,
    pub smoothing_length: Vec<f32>,
    pub attributes: Vec<Vec<f32>>,
}

/// The source particles, sorted by Morton key (and input order where keys are equal).
#[derive(Debug)]
pub(super) struct Sorted {
    /// Keys over the root cell.
    pub keys: Vec<u64>,
    /// Positions as fractions of the root cell, each in `[0, 1)`.
    pub units: Vec<[f64; 3]>,
    pub columns: Columns,
}

impl Sorted {
    /// Sorts a family, column by column, freeing each as it goes.
    pub fn new(family: Family, root: RootCell) -> Result<Sorted, OctreeError> {
        let count = family.positions.len();
        if u32::try_from(count).is_err() {
            return Err(OctreeError::new(family.name, "count", "at most 4294967295 particles in one family"));
        }
        let unit = |position: &[f64; 3]| {
            // The largest double below 1 keeps what rounding puts on the far side inside.
            ((DVec3::from_array(*position) - root.min) / root.size)
                .clamp(DVec3::ZERO, DVec3::splat(1.0 - f64::EPSILON / 2.0))
        };
        let mut order: Vec<(u64, u32)> = family
            .positions
            .par_iter()
            .enumerate()
            .map(|(i, position)| {
                let cell = unit(position) * f64::from(1 << MORTON_BITS);
                (morton::encode(cell.to_array().map(|v| v as u32)), i as u32)
            })
            .collect();
        order.par_sort_unstable();
        let keys = order.par_iter().map(|&(key, _)| key).collect();
        let order: Vec<u32> = order.par_iter().map(|&(_, i)| i).collect();
        let units = order.par_iter().map(|&i| unit(&family.positions[i as usize]).to_array()).collect();
        drop(family.positions);
        let gather = |column: Vec<f32>| order.par_iter().map(|&i| column[i as usize]).collect();
        let columns = Columns {
            mass: gather(family.mass),
            density: gather(family.density),
            smoothing_length: gather(family.smoothing_length),
            attributes: family.attributes.into_iter().map(|attribute| gather(attribute.values)).collect(),
        };
        Ok(Sorted { keys, units, columns })
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// The box around the positions of a range, in root fractions.
    pub fn bounds(&self, range: std::ops::Range<usize>) -> Bounds {
        Bounds::of(self.units[range].iter().copied())
    }
}
