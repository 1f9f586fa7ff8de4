//! Units as the source names them. Values keep the source's unit; nothing is converted silently.

use serde::{Deserialize, Serialize};

/// The unit of a field, as text in the source's own terms (`kpc/h`, `1e10 Msun/h`, `K`); empty when unknown.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Unit(pub String);

impl Unit {
    /// A unit by its name.
    pub fn new(name: impl Into<String>) -> Unit {
        Unit(name.into())
    }

    /// Whether the source says nothing about the unit.
    pub fn is_unknown(&self) -> bool {
        self.0.is_empty()
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.is_unknown() { "code units" } else { &self.0 })
    }
}
