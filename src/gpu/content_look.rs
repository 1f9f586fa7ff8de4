//! A depiction applied to nodes that hold values of their own: what moves, and clusters.

use crate::codec::Codebook;
use crate::cpu::volume::attributes::Column;
use crate::mode::{CodeTable, Depiction, SourceColumns};
use crate::store::Metadata;

/// A depiction, and the names of each family's attributes, which are all that it takes of the data.
pub struct ContentLook {
    /// The depiction.
    pub depiction: Depiction,
    /// The column that is the attribute.
    column: Column,
    names: Vec<Vec<String>>,
}

impl std::fmt::Debug for ContentLook {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("ContentLook").field(&self.depiction.mode.name).finish()
    }
}

impl ContentLook {
    /// That of a depiction of some data.
    pub fn new(depiction: Depiction, metadata: &Metadata) -> ContentLook {
        let names = |family: &crate::store::FamilyMetadata| {
            family.attributes.iter().map(|attribute| attribute.name.clone()).collect()
        };
        ContentLook { depiction, column: Column::Attribute, names: metadata.families.iter().map(names).collect() }
    }

    /// The same of a column that is resampled by itself.
    #[must_use]
    pub fn of_column(self, column: Column) -> ContentLook {
        ContentLook { column, ..self }
    }

    /// The names of a family's attributes; `None`: there is no such family.
    pub fn names(&self, family: u32) -> Option<&[String]> {
        self.names.get(family as usize).map(Vec::as_slice)
    }

    /// What the depiction makes of a family's values.
    pub fn columns(&self, family: u32, values: &Codebook) -> Option<SourceColumns> {
        let columns = self.depiction.columns_named(self.names(family)?.iter().map(String::as_str), values);
        Some(of_column(columns, self.column))
    }
}

/// Particles' values where one of their columns is resampled by itself, as their attribute; they stay what they are where no fields are drawn.
/// What has no value weighs nothing.
pub fn of_column(mut columns: SourceColumns, column: Column) -> SourceColumns {
    let SourceColumns { weight, attribute, fields, .. } = &mut columns;
    read_as(column, weight, attribute, fields);
    columns
}

/// The same of the entries of a codebook.
pub fn table_of_column(mut table: CodeTable, column: Column) -> CodeTable {
    let CodeTable { weight, attribute, fields, .. } = &mut table;
    read_as(column, weight, attribute, fields);
    table
}

fn read_as(column: Column, weight: &mut [f32], attribute: &mut Option<Vec<f32>>, fields: &mut Vec<Vec<f32>>) {
    if fields.is_empty() {
        return;
    }
    if let Column::Field(index) = column {
        *attribute = (index < fields.len()).then(|| fields.swap_remove(index));
    }
    let values = attribute.iter_mut().flatten();
    for (weight, value) in weight.iter_mut().zip(values).filter(|(weight, value)| !(**weight * **value).is_finite()) {
        (*weight, *value) = (0.0, 0.0);
    }
}
