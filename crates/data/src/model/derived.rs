//! Quantities that can be derived for particles that have velocities, from those of their neighbours.

use super::Unit;
use serde::{Deserialize, Serialize};

/// A quantity that a source need not have, for it follows from velocities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DerivedQuantity {
    /// How much velocities differ within the smoothing length: the root of the mean square distance, in three dimensions, from the mean
    /// velocity, both weighted with mass and kernel.
    VelocityDispersion,
    /// Divergence of the velocity field.
    Divergence,
    /// Length of the curl of the velocity field.
    Vorticity,
    /// Speed by the speed of sound. It takes no neighbours.
    MachNumber,
}

impl DerivedQuantity {
    /// Every one.
    pub const ALL: [DerivedQuantity; 4] = [
        DerivedQuantity::VelocityDispersion,
        DerivedQuantity::Divergence,
        DerivedQuantity::Vorticity,
        DerivedQuantity::MachNumber,
    ];

    /// Its name, as that of an attribute.
    pub const fn name(self) -> &'static str {
        match self {
            DerivedQuantity::VelocityDispersion => "velocity-dispersion",
            DerivedQuantity::Divergence => "divergence",
            DerivedQuantity::Vorticity => "vorticity",
            DerivedQuantity::MachNumber => "mach-number",
        }
    }

    /// That of a name.
    pub fn of_name(name: &str) -> Option<DerivedQuantity> {
        DerivedQuantity::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// Whether every one is among some: then those are wanted that can be had.
    pub fn are_all(some: &[DerivedQuantity]) -> bool {
        DerivedQuantity::ALL.iter().all(|quantity| some.contains(quantity))
    }

    /// Those of names with commas between them, each once, or of `all`.
    ///
    /// # Errors
    /// A sentence, where one is none.
    pub fn list(text: &str) -> Result<Vec<DerivedQuantity>, String> {
        if text == "all" {
            return Ok(DerivedQuantity::ALL.to_vec());
        }
        let mut found = Vec::new();
        for name in text.split(',') {
            let quantity = DerivedQuantity::of_name(name).ok_or_else(|| {
                let names = DerivedQuantity::ALL.map(DerivedQuantity::name).join(", ");
                format!("expected all, or some of {names}; found {name:?}")
            })?;
            if !found.contains(&quantity) {
                found.push(quantity);
            }
        }
        Ok(found)
    }
}

/// What is derived for the particles of a family.
///
/// It takes columns of its own beside the attributes: the components of the velocity and, for Mach numbers, the internal energy per mass
/// or the temperature.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivation {
    /// The quantities and their units.
    pub quantities: Vec<(DerivedQuantity, Unit)>,
    /// Mach number by the stored speed over the root of the internal energy or temperature; `None` where none is asked for.
    pub mach_factor: Option<f64>,
}

impl Derivation {
    /// Components of a velocity.
    pub const COMPONENTS: usize = 3;

    /// How many columns it takes.
    pub fn inputs(&self) -> usize {
        Derivation::COMPONENTS + usize::from(self.mach_factor.is_some())
    }

    /// Whether a quantity depends on neighbours.
    pub fn needs_neighbours(&self) -> bool {
        self.quantities.iter().any(|(quantity, _)| *quantity != DerivedQuantity::MachNumber)
    }

    /// Name and unit of each quantity, as those of attributes.
    pub fn attributes(&self) -> impl Iterator<Item = (String, Unit)> {
        self.quantities.iter().map(|(quantity, unit)| (quantity.name().to_owned(), unit.clone()))
    }

    /// Whether a quantity is among them.
    pub fn has(&self, quantity: DerivedQuantity) -> bool {
        self.quantities.iter().any(|(own, _)| *own == quantity)
    }
}
