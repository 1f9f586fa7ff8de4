//! Tables of comoving data in the physical frame.

use super::Layout;
use crate::import::{FieldKind, Source};
use crate::model::PhysicalFactors;

/// The numbers that a table has.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Frame {
    /// Those that the data has.
    #[default]
    Stored,
    /// Lengths, densities and velocities of a moment in the physical frame.
    Physical(PhysicalFactors),
    /// The same of rows of several moments, by their column `tau`, whose values are these; rising.
    PhysicalAt(Vec<(f64, PhysicalFactors)>),
}

impl Frame {
    /// The physical frame of a snapshot; `None` where that does not say enough.
    pub fn physical(source: &dyn Source) -> Option<Frame> {
        PhysicalFactors::of(&source.description().epoch()).map(Frame::Physical)
    }

    /// Brings the columns of rows to the frame.
    pub(super) fn apply(&self, layout: &Layout, columns: &mut [Option<Vec<f64>>]) {
        let tau = layout.columns.iter().position(|column| column.name == "tau");
        let of_row: Vec<PhysicalFactors> = match (self, tau.and_then(|tau| columns[tau].as_ref())) {
            (Frame::PhysicalAt(known), Some(tau)) if !known.is_empty() => {
                let at = |tau: &f64| known[known.partition_point(|(other, _)| other < tau).min(known.len() - 1)].1;
                tau.iter().map(at).collect()
            }
            _ => Vec::new(),
        };
        for (column, values) in layout.columns.iter().zip(columns) {
            let (Some(values), Some(scaled)) = (values, column.scaled) else { continue };
            match self {
                Frame::Stored => {}
                Frame::Physical(factors) => values.iter_mut().for_each(|value| *value *= scaled.factor(*factors)),
                Frame::PhysicalAt(_) => {
                    values.iter_mut().zip(&of_row).for_each(|(value, factors)| *value *= scaled.factor(*factors));
                }
            }
        }
    }
}

/// How a quantity depends on the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scaled {
    /// As this power of a length.
    Length(i32),
    Velocity,
}

impl Scaled {
    pub fn of(name: &str, kind: FieldKind) -> Option<Scaled> {
        match (kind, name) {
            (FieldKind::Position | FieldKind::SmoothingLength, _) => Some(Scaled::Length(1)),
            (FieldKind::Density, _) => Some(Scaled::Length(-3)),
            (FieldKind::Velocity, _) => Some(Scaled::Velocity),
            // Of flow tracks.
            (_, "volume") => Some(Scaled::Length(3)),
            _ => None,
        }
    }

    fn factor(self, factors: PhysicalFactors) -> f64 {
        match self {
            Scaled::Length(power) => factors.length.powi(power),
            Scaled::Velocity => factors.velocity,
        }
    }
}
