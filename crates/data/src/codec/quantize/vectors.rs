//! From the quantities of particles to vectors of the quantiser's space.

use super::batches::Quantities;
use crate::codec::scaling::{AttributeMerge, ColumnScaling};
use crate::model::portable::portable;
use std::ops::Range;

/// Particles whose vectors are made together.
pub(super) const RUN: usize = 256;

/// How the columns of a family are scaled and merged; the same for all its codebooks.
#[derive(Clone, Debug)]
pub struct Scaling {
    /// Of mass, density, smoothing length.
    pub quantities: [ColumnScaling; 3],
    /// Of each attribute.
    pub attributes: Vec<(ColumnScaling, AttributeMerge)>,
}

portable!(Scaling { quantities, attributes });

impl Scaling {
    /// The mean coordinate of densities.
    pub fn mean_density(&self, densities: &[f32]) -> f32 {
        let mut mapped = [0.0; RUN];
        let mut sum = 0.0;
        for densities in densities.chunks(RUN) {
            self.quantities[1].map_all(densities, &mut mapped);
            sum = mapped[..densities.len()].iter().fold(sum, |sum, &v| sum + f64::from(v));
        }
        (sum / densities.len().max(1) as f64) as f32
    }

    /// The vectors of a run of at most [`RUN`] particles.
    pub(super) fn vectors<const L: usize>(&self, from: &Quantities, run: Range<usize>, out: &mut [[f32; L]; RUN]) {
        let mut mapped = [0.0; RUN];
        let mut put = |axis: usize, scaling: &ColumnScaling, column: &[f32]| {
            scaling.map_all(&column[run.clone()], &mut mapped);
            out.iter_mut().zip(&mapped).take(run.len()).for_each(|(vector, &v)| vector[axis] = v);
        };
        put(0, &self.quantities[0], from.mass);
        put(1, &self.quantities[1], from.density);
        put(2, &self.quantities[2], from.smoothing_length);
        for (axis, ((scaling, _), column)) in (3..L).zip(self.attributes.iter().zip(&from.attributes)) {
            put(axis, scaling, column);
        }
    }

    /// The vector of a particle.
    pub(super) fn vector<const L: usize>(&self, from: &Quantities, i: usize) -> [f32; L] {
        let mut vector = [0.0; L];
        vector[0] = self.quantities[0].map(from.mass[i]);
        vector[1] = self.quantities[1].map(from.density[i]);
        vector[2] = self.quantities[2].map(from.smoothing_length[i]);
        for ((place, (scaling, _)), column) in vector[3..].iter_mut().zip(&self.attributes).zip(&from.attributes) {
            *place = scaling.map(column[i]);
        }
        vector
    }
}
