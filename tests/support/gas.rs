//! Data of one family, which tests fill.

use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};

/// Gas that has a temperature, without a particle yet.
pub fn gas() -> Family {
    Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: vec![Attribute { name: "temperature".into(), unit: Unit::new("K"), values: Vec::new() }],
    }
}

/// A dataset of one family.
pub fn dataset_of(family: Family) -> Dataset {
    Dataset {
        families: vec![family],
        length_unit: Unit::new("kpc"),
        mass_unit: Unit::new("Msun"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    }
}
