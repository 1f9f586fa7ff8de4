//! What the panel says about a dataset, put into words once when it is opened.

use crate::annotate::number;
use crate::look::Member;
use crate::picture::field::OpenField;
use crate::picture::mixed::{FieldAmong, HeightsField, OpenMixed};
use crate::picture::surface::OpenSurface;
use crate::store::{Metadata, PageFile, PartInfo};
use crate::window::sampled::Sampled;
use bevy::math::DVec3;
use std::path::Path;

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

/// A dataset of several, as a heading.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetFact {
    /// The file's name.
    pub name: String,
    /// Path, format and place; shown on hovering.
    pub details: String,
    /// Index of its first family.
    pub first_family: usize,
    /// Which of the datasets it is.
    pub index: usize,
}

/// A dataset in words.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// Labels and values.
    pub rows: Vec<(&'static str, String)>,
    /// The datasets, where there are several.
    pub datasets: Vec<DatasetFact>,
    /// What is among other data and no particles, and what it is called.
    pub sampled: Vec<(&'static str, DatasetFact)>,
    /// The families.
    pub families: Vec<FamilyFact>,
    /// What the import assumed or left out, one sentence each.
    pub notes: Vec<String>,
}

impl Facts {
    /// The facts of a page file, or of several as one, by the names that the user gave.
    pub fn of(file: &PageFile, members: &[Member]) -> Facts {
        let metadata = file.metadata();
        let mut rows = match file.is_joined() {
            true => vec![("Datasets", file.parts().len().to_string())],
            false => vec![("Format", metadata.provenance.format.clone())],
        };
        rows.push(("Particles", number::count(metadata.particles())));
        if let Some(box_size) = metadata.provenance.box_size {
            rows.push(("Box", format!("{} {}", number::quantity(box_size), metadata.length_unit)));
        } else {
            rows.push(("Length unit", metadata.length_unit.to_string()));
        }
        rows.push(("Mass unit", metadata.mass_unit.to_string()));
        let bytes = file.parts().map(|part| part.metadata.provenance.bytes).sum::<u64>();
        if !file.is_joined() {
            rows.extend(epoch(metadata));
        }
        if bytes > 0 {
            rows.push(("Source", number::bytes(bytes)));
        }
        let skipped = metadata
            .skipped
            .iter()
            .map(|skipped| format!("{} particles left out: {}", number::count(skipped.count), skipped.reason));
        let told = file.parts().flat_map(|part| part.metadata.provenance.notes.clone());
        let parts = file.parts().zip(members).enumerate().filter(|_| file.is_joined());
        let datasets = parts.map(|(index, (part, member))| DatasetFact {
            name: name_of(&member.path),
            details: part_details(&part, &member.path),
            first_family: part.families.start,
            index,
        });
        let (sampled, families) = (Vec::new(), Facts::families_of(metadata));
        Facts { rows, datasets: datasets.collect(), sampled, families, notes: told.chain(skipped).collect() }
    }

    /// The same of what the particles are samples of.
    #[must_use]
    pub fn with_samples(self, opened: &Sampled) -> Facts {
        match opened {
            Sampled::Field(opened) => self.with_field(opened),
            Sampled::Heights(opened) => self.with_heights(opened),
            Sampled::Mixed(opened) => self.among(opened),
        }
    }

    /// Of particles, where there are some, and what else there is among them.
    fn among(mut self, opened: &OpenMixed) -> Facts {
        let has_particles = opened.particles().is_some();
        let own: Vec<usize> = (0..).filter(|index| opened.is_of_particles(*index)).take(self.datasets.len()).collect();
        self.datasets.iter_mut().zip(own).for_each(|(dataset, index)| dataset.index = index);
        self.sampled = opened.heights().iter().map(|field| ("Heights", heights_among(field))).collect();
        self.sampled.extend(opened.fields().iter().map(field_among));
        self.sampled.sort_by_key(|(_, dataset)| dataset.index);
        if !has_particles {
            (self.rows, self.families) = (Vec::new(), Vec::new());
        }
        let all = self.sampled.len() + if has_particles { self.datasets.len().max(1) } else { 0 };
        self.rows.retain(|(label, _)| *label != "Datasets");
        self.rows.insert(0, ("Datasets", all.to_string()));
        let notes = |field: &HeightsField| {
            let (name, notes) = (name_of(&field.member.path), field.opened.file().about().notes.clone());
            notes.into_iter().map(move |note| format!("{name}: {note}"))
        };
        self.notes.extend(opened.heights().iter().flat_map(notes));
        self
    }

    /// Of measured heights.
    fn with_heights(mut self, opened: &OpenSurface) -> Facts {
        let about = opened.file().about();
        let (grid, facts) = (&about.grid, &about.facts);
        let spacing = grid.step.map(|step| number::quantity(step.abs())).join(" x ");
        let [low, high, mean] = [facts.min, facts.max, facts.mean].map(number::quantity);
        let share = 100.0 * facts.valid as f64 / grid.samples().max(1) as f64;
        let measured = match grid.samples() - facts.valid {
            0 => "all samples".to_owned(),
            open => format!("{share:.2} %, {} samples were not", number::count(open)),
        };
        let mut rows = vec![
            ("Heights", grid.described()),
            ("Format", about.format.clone()),
            ("Spacing", format!("{spacing} {}", grid.xy_unit).trim_end().to_owned()),
            ("Range", format!("{low} to {high} {}", grid.height_unit).trim_end().to_owned()),
            ("Mean", format!("{mean} {}", grid.height_unit).trim_end().to_owned()),
            ("Measured", measured),
        ];
        rows.extend(grid.crs.clone().map(|crs| ("Reference", crs)));
        self.rows = rows;
        self.families.clear();
        self.notes.extend(about.notes.iter().cloned());
        self
    }

    /// Of an image or a volume.
    fn with_field(mut self, opened: &OpenField) -> Facts {
        let grid = opened.grid();
        let kind = if grid.dimensions == 2 { "Image" } else { "Volume" };
        let spacing = grid.spacing();
        let spacing: Vec<String> = spacing[..grid.dimensions].iter().map(|side| number::quantity(*side)).collect();
        let [low, high] = opened.statistics().range().map(number::quantity);
        let (channel, values) = (&grid.channels[0], format!("{low} to {high}"));
        let own = [
            (kind, grid.described()),
            ("Spacing", format!("{} {}", spacing.join(" x "), grid.length_unit)),
            ("Values", if channel.unit.is_unknown() { values } else { format!("{values} {}", channel.unit) }),
        ];
        self.rows.retain(|(label, _)| *label != "Format");
        self.rows.splice(0..0, own);
        self
    }

    /// What is said of the families.
    pub fn families_of(metadata: &Metadata) -> Vec<FamilyFact> {
        let families = metadata.families.iter().map(|family| {
            let mut details = format!("mass {} {}", number::quantity(family.mass), metadata.mass_unit);
            for attribute in &family.attributes {
                let [min, max] = [attribute.min, attribute.max].map(number::quantity);
                details += &format!("\n{}  {min} to {max} {}", attribute.name, attribute.unit);
            }
            FamilyFact { name: family.name.to_string(), count: number::count(family.count), details }
        });
        families.collect()
    }
}

/// What a file is called.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// What is said of heights among other things.
fn heights_among(field: &HeightsField) -> DatasetFact {
    let HeightsField { index, member, opened } = field;
    let about = opened.file().about();
    let (grid, facts) = (&about.grid, &about.facts);
    let [low, high] = [facts.min, facts.max].map(number::quantity);
    let range = format!("heights {low} to {high} {}", grid.height_unit);
    let mut lines = vec![member.path.display().to_string(), grid.described(), range.trim_end().to_owned()];
    if facts.valid < grid.samples() {
        lines.push(format!("{} samples were not measured", number::count(grid.samples() - facts.valid)));
    }
    fact_of(member, lines, *index)
}

/// What is said of an image or a volume among other data.
fn field_among(field: &FieldAmong) -> (&'static str, DatasetFact) {
    let FieldAmong { index, member, opened } = field;
    let (grid, [low, high]) = (opened.grid(), opened.statistics().range().map(number::quantity));
    let values = format!("values {low} to {high} {}", grid.channels[0].unit);
    let kind = if grid.dimensions == 2 { "Image" } else { "Volume" };
    let lines = vec![member.path.display().to_string(), grid.described(), values.trim_end().to_owned()];
    (kind, fact_of(member, lines, *index))
}

/// The fact of these lines, and of where a dataset lies.
fn fact_of(member: &Member, mut lines: Vec<String>, index: usize) -> DatasetFact {
    if member.offset != DVec3::ZERO {
        let [x, y, z] = member.offset.to_array().map(number::quantity);
        lines.push(format!("its origin at {x}, {y}, {z}"));
    }
    if let Some(scale) = member.scale {
        lines.push(format!("lengths times {}", number::quantity(scale)));
    }
    DatasetFact { name: name_of(&member.path), details: lines.join("\n"), first_family: 0, index }
}

/// When in the history of its universe or its run a snapshot was taken.
fn epoch(metadata: &Metadata) -> Option<(&'static str, String)> {
    match (metadata.provenance.redshift, metadata.provenance.time) {
        // Snapshots of today often say -2e-16.
        (Some(z), _) => Some(("Redshift", number::quantity(if z.abs() < 1e-9 { 0.0 } else { z }))),
        (None, Some(time)) => Some(("Time", number::quantity(time))),
        (None, None) => None,
    }
}

/// What is said of one dataset of several.
fn part_details(part: &PartInfo<'_>, path: &Path) -> String {
    let mut lines = vec![path.display().to_string(), part.metadata.provenance.format.clone()];
    lines.extend(epoch(part.metadata).map(|(label, value)| format!("{} {value}", label.to_lowercase())));
    let placement = part.placement;
    if placement.offset != DVec3::ZERO {
        let [x, y, z] = placement.offset.to_array().map(number::quantity);
        lines.push(format!("its origin at {x}, {y}, {z}"));
    }
    if placement.scale != 1.0 {
        lines.push(format!("lengths times {}", number::quantity(placement.scale)));
    }
    if placement.mass != 1.0 {
        lines.push(format!("masses times {}", number::quantity(placement.mass)));
    }
    lines.join("\n")
}
