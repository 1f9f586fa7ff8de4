//! The 256 bytes of a Gadget header.

use crate::import::bytes::{Order, RangeFile};
use crate::import::expansion::{self, Stated};
use crate::import::{Description, ImportError};
use crate::model::Motion;

/// Number of particle types.
pub(super) const TYPES: usize = 6;

/// What a file says about itself and the whole snapshot.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    /// Particles in this file by type.
    pub counts: [u64; TYPES],
    /// Particles in all files by type; some writers leave it 0.
    pub totals: [u64; TYPES],
    /// Mass of every particle by type; 0 where there is a block of masses.
    pub masses: [f64; TYPES],
    pub time: f64,
    pub redshift: f64,
    pub box_size: f64,
    pub files: u64,
    pub cooling: bool,
    /// Density of matter, 0 where nothing expands.
    pub omega_matter: f64,
    pub omega_lambda: f64,
}

impl Header {
    /// Reads the header's record.
    pub(super) fn read(file: &RangeFile, order: Order, offset: u64) -> Result<Header, ImportError> {
        let mut bytes = [0u8; super::records::HEADER as usize];
        file.read(offset, &mut bytes, "header")?;
        let counts = |at: usize| std::array::from_fn(|kind| order.u32(&bytes, at + 4 * kind) as u64);
        let (low, high): ([u64; TYPES], [u64; TYPES]) = (counts(96), counts(168));
        let header = Header {
            counts: counts(0),
            totals: std::array::from_fn(|kind| low[kind] | high[kind] << 32),
            masses: std::array::from_fn(|kind| order.f64(&bytes, 24 + 8 * kind)),
            time: order.f64(&bytes, 72),
            redshift: order.f64(&bytes, 80),
            cooling: order.u32(&bytes, 120) == 1,
            files: (order.u32(&bytes, 124) as u64).max(1),
            box_size: order.f64(&bytes, 128),
            omega_matter: order.f64(&bytes, 136),
            omega_lambda: order.f64(&bytes, 144),
        };
        if let Some(mass) = header.masses.iter().find(|mass| !(mass.is_finite() && **mass >= 0.0)) {
            return Err(ImportError::malformed(&file.path, "header mass table", mass, "masses, or 0 for a mass block"));
        }
        Ok(header)
    }

    /// Adds to the description whether and how space expands. It does where there is matter and the time is the scale factor of the
    /// redshift. Nothing says the units: Mpc/h and km/s are assumed, as most have them.
    pub(super) fn describe_expansion(&self, description: &mut Description) {
        if !expansion::is_scale_factor(self.time, self.redshift) || self.omega_matter == 0.0 {
            description.motion = Motion::Coordinate;
            return;
        }
        let stated = |name, value| Some(Stated { name, value });
        let (matter, lambda) =
            (stated("header Omega0", self.omega_matter), stated("header OmegaLambda", self.omega_lambda));
        description.cosmology = expansion::cosmology(matter, lambda, expansion::HUBBLE, true, &mut description.notes);
        // With a density that is none, nobody knows.
        if self.omega_matter > 0.0 {
            (description.scale_factor, description.motion) = (Some(self.time), Motion::Gadget);
        }
    }

    /// Particles of the types in the set.
    pub(super) fn particles(&self, types: Types) -> u64 {
        (0..TYPES).filter(|kind| types.has(*kind)).map(|kind| self.counts[kind]).sum()
    }

    /// The types whose masses stand in a block.
    pub(super) fn with_mass_block(&self) -> Types {
        let types = (0..TYPES).filter(|kind| self.masses[*kind] == 0.0);
        types.fold(Types(0), |set, kind| Types(set.0 | 1 << kind))
    }
}

/// A set of particle types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Types(pub u8);

impl Types {
    /// All of them.
    pub(super) const ALL: Types = Types(0b11_1111);
    /// Type 0.
    pub(super) const GAS: Types = Types(1);
    /// Type 4.
    pub(super) const STARS: Types = Types(1 << 4);
    /// Types 0 and 4.
    pub(super) const GAS_AND_STARS: Types = Types(1 | 1 << 4);
    /// Types 1 to 3.
    pub(super) const DARK: Types = Types(0b1110);
    /// Type 5.
    pub(super) const BLACK_HOLES: Types = Types(1 << 5);

    /// Whether the type is in it.
    pub(super) fn has(self, kind: usize) -> bool {
        self.0 >> kind & 1 == 1
    }
}
