//! A depiction applied to nodes that hold values of their own: what moves, and clusters.

use crate::codec::Codebook;
use crate::mode::{Depiction, SourceColumns};
use crate::store::Metadata;

/// A depiction, and the names of each family's attributes, which are all that it takes of the data.
pub struct ContentLook {
    /// The depiction.
    pub depiction: Depiction,
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
        ContentLook { depiction, names: metadata.families.iter().map(names).collect() }
    }

    /// The names of a family's attributes; `None`: there is no such family.
    pub fn names(&self, family: u32) -> Option<&[String]> {
        self.names.get(family as usize).map(Vec::as_slice)
    }

    /// What the depiction makes of a family's values.
    pub fn columns(&self, family: u32, values: &Codebook) -> Option<SourceColumns> {
        Some(self.depiction.columns_named(self.names(family)?.iter().map(String::as_str), values))
    }
}
