//! Particles batch by batch, from wherever they are kept, and what becomes of them.

use crate::model::portable::portable;

/// Quantities of a run of particles. All slices have the same length.
#[derive(Clone, Debug)]
pub struct Quantities<'a> {
    /// Masses.
    pub mass: &'a [f32],
    /// Densities.
    pub density: &'a [f32],
    /// Smoothing lengths.
    pub smoothing_length: &'a [f32],
    /// Attributes, in the family's order.
    pub attributes: Vec<&'a [f32]>,
}

impl Quantities<'_> {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }
}

/// What is known of a batch of particles without reading it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BatchInfo {
    /// Number of particles.
    pub particles: usize,
    /// Sum of their masses.
    pub mass: f64,
    /// Sum of their `m rho`.
    pub mass_density: f64,
}

portable!(BatchInfo { particles, mass, mass_density });

impl BatchInfo {
    /// Looks through a batch.
    pub fn of(quantities: &Quantities) -> BatchInfo {
        let mut info = BatchInfo { particles: quantities.len(), ..BatchInfo::default() };
        for (&mass, &density) in quantities.mass.iter().zip(quantities.density) {
            info.mass += f64::from(mass);
            info.mass_density += f64::from(mass) * f64::from(density);
        }
        info
    }
}

/// Particles that are read batch by batch, more often than once, from wherever they are kept; and a place to keep their codes.
pub trait Batches: Sync {
    /// Why something could not be read or kept.
    type Error: Send;
    /// Codes that were put somewhere.
    type Kept: Send + Sync;

    /// Number of batches.
    fn len(&self) -> usize;

    /// Whether there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What is known of a batch.
    fn info(&self, batch: usize) -> BatchInfo;

    /// The group of a batch; batches come in the order of groups. Sums are taken for each group by itself, and then added up.
    fn group(&self, batch: usize) -> u32;

    /// Reads a batch.
    ///
    /// # Errors
    /// When it cannot be read.
    fn with<R>(&self, batch: usize, read: impl FnOnce(&Quantities) -> R) -> Result<R, Self::Error>;

    /// Keeps a batch's codes.
    ///
    /// # Errors
    /// When they cannot be kept.
    fn keep(&self, codes: Vec<u16>) -> Result<Self::Kept, Self::Error>;

    /// Gives the kept codes of a batch back: one for each of its particles, all of them below `end`.
    ///
    /// # Errors
    /// When they cannot be read, or are others.
    fn codes(&self, kept: &Self::Kept, batch: usize, end: usize) -> Result<Vec<u16>, Self::Error>;

    /// Gives the room of kept codes back.
    fn forget(&self, kept: Self::Kept);

    /// Called now and then in work that is long; may unwind.
    fn go_on(&self) {}
}

/// A coded batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Coded<Kept> {
    /// Its codes, still to be renumbered by [`super::Quantized::numbers`].
    pub codes: Kept,
    /// Sum of the decoded masses.
    pub mass: f64,
    /// Sum of the decoded `m rho`.
    pub mass_density: f64,
    /// Largest decoded smoothing length.
    pub smoothing_length_max: f32,
}

portable!(Coded<Kept> where Kept { codes, mass, mass_density, smoothing_length_max });
