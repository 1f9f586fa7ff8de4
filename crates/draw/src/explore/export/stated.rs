//! What is stated of a whole table, for formats that have places for it.

use super::{Data, Frame};
use crate::model::{Cosmology, Epoch, Motion, scale_factor_of};

/// The moment and the space that rows are of.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Stated {
    /// Time in the data's unit: of comoving data the scale factor.
    pub time: Option<f64>,
    /// Redshift.
    pub redshift: Option<f64>,
    /// Edge of the periodic box, in the table's lengths.
    pub box_size: Option<f64>,
    /// Whether the table's lengths are comoving.
    pub is_comoving: bool,
    /// The universe around it.
    pub cosmology: Option<Cosmology>,
    /// What the table's velocities mean.
    pub motion: Motion,
}

impl Stated {
    /// What data says of itself, in a frame.
    pub(super) fn of(data: Data, frame: &Frame) -> Stated {
        let (epoch, redshift, box_size) = match data {
            Data::Source(source) => {
                let about = source.description();
                (about.epoch(), about.redshift, about.box_size)
            }
            Data::Pages(file) => {
                // Velocities of page files are attributes like any other.
                let about = &file.metadata().provenance;
                let is_comoving = file.metadata().length_unit.0.split([' ', '/']).any(|word| word == "a");
                let scale_factor = about.redshift.filter(|_| is_comoving).and_then(scale_factor_of);
                (Epoch { time: about.time, scale_factor, ..Epoch::default() }, about.redshift, about.box_size)
            }
        };
        let stated = Stated {
            time: epoch.scale_factor.or(epoch.time),
            redshift,
            box_size,
            is_comoving: epoch.is_comoving(),
            cosmology: epoch.cosmology,
            motion: epoch.motion,
        };
        match frame {
            Frame::Stored => stated,
            Frame::Physical(factors) => Stated {
                box_size: box_size.map(|edge| edge * factors.length),
                is_comoving: false,
                motion: Motion::Coordinate,
                ..stated
            },
            // Rows are of several moments.
            Frame::PhysicalAt(_) => Stated { cosmology: epoch.cosmology, ..Stated::default() },
        }
    }
}
