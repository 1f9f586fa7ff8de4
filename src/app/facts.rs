//! What the panel says about a dataset, put into words once when it is opened.

use crate::annotate::number;
use crate::store::Metadata;

/// A family of particles, as a row.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyFact {
    /// Its name.
    pub name: String,
    /// Number of particles.
    pub count: String,
    /// Mass with unit, and the attributes with their ranges; shown on hovering.
    pub details: String,
}

/// A dataset in words.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// Labels and values.
    pub rows: Vec<(&'static str, String)>,
    /// The families.
    pub families: Vec<FamilyFact>,
    /// What the import assumed or left out, one sentence each.
    pub notes: Vec<String>,
}

impl Facts {
    /// The facts of a page file.
    pub fn of(metadata: &Metadata) -> Facts {
        let provenance = &metadata.provenance;
        let mut rows = vec![("Format", provenance.format.clone()), ("Particles", number::count(metadata.particles()))];
        if let Some(box_size) = provenance.box_size {
            rows.push(("Box", format!("{} {}", number::quantity(box_size), metadata.length_unit)));
        } else {
            rows.push(("Length unit", metadata.length_unit.to_string()));
        }
        rows.push(("Mass unit", metadata.mass_unit.to_string()));
        if let Some(redshift) = provenance.redshift {
            // Snapshots of today often say -2e-16.
            rows.push(("Redshift", number::quantity(if redshift.abs() < 1e-9 { 0.0 } else { redshift })));
        } else if let Some(time) = provenance.time {
            rows.push(("Time", number::quantity(time)));
        }
        if provenance.bytes > 0 {
            rows.push(("Source", number::bytes(provenance.bytes)));
        }
        let families = metadata
            .families
            .iter()
            .map(|family| {
                let mut details = format!("mass {} {}", number::quantity(family.mass), metadata.mass_unit);
                for attribute in &family.attributes {
                    let [min, max] = [attribute.min, attribute.max].map(number::quantity);
                    details += &format!("\n{}  {min} to {max} {}", attribute.name, attribute.unit);
                }
                FamilyFact { name: family.name.to_string(), count: number::count(family.count), details }
            })
            .collect();
        let skipped = metadata
            .skipped
            .iter()
            .map(|skipped| format!("{} particles left out: {}", number::count(skipped.count), skipped.reason));
        let notes = provenance.notes.iter().cloned().chain(skipped).collect();
        Facts { rows, families, notes }
    }
}
