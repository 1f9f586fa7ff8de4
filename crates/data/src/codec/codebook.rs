//! What a codebook index decodes to (F12 4.7.4: "it is sufficient to exponentiate the codebook entries").

use crate::model::portable::{Portable, expect, expect_within, portable};

/// Which particles a codebook was trained on and codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CodebookScope {
    /// The particles of leaves of the family, of all of them or of those that name the codebook: the source's own particles.
    Leaves,
    /// The drawn (merged) particles of the grid nodes at this depth.
    Depth(u8),
    /// The same for the levels that are made for volumes.
    VolumeDepth(u8),
    /// Clusters, whose masses and sizes are told otherwise: density and attributes count.
    Clusters,
}

impl Portable for CodebookScope {
    fn put(&self, to: &mut Vec<u8>) {
        match *self {
            CodebookScope::Leaves => to.push(0),
            CodebookScope::Depth(depth) => to.extend([1, depth]),
            CodebookScope::VolumeDepth(depth) => to.extend([2, depth]),
            CodebookScope::Clusters => to.push(3),
        }
    }

    fn take(from: &mut &[u8]) -> Option<CodebookScope> {
        match u8::take(from)? {
            0 => Some(CodebookScope::Leaves),
            1 => u8::take(from).map(CodebookScope::Depth),
            2 => u8::take(from).map(CodebookScope::VolumeDepth),
            3 => Some(CodebookScope::Clusters),
            _ => None,
        }
    }
}

portable!(QuantityError { mean, max });

/// Measured error of one quantity over all particles that a codebook codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QuantityError {
    /// Mean of `|decoded - value| / scale`, where `scale` is `|value|` for positive quantities and the quantity's range
    /// over the family for those that have zero or negative values.
    pub mean: f64,
    /// Maximum of the same.
    pub max: f64,
}

/// One codebook: entry `i` of each column is what code `i` decodes to. All columns have the same length, at most
/// `2^bits`. Over the particles that the codebook codes, the entries conserve `sum m` and `sum m rho` (up to rounding):
/// `mass[i]` is the mean mass of the particles with code `i` and `density[i]` their mass-weighted mean density.
#[derive(Clone, Debug, PartialEq)]
pub struct Codebook {
    /// What it was trained on.
    pub scope: CodebookScope,
    /// How many particles it codes.
    pub particles: u64,
    /// Mass `m`, the family's mass unit.
    pub mass: Vec<f32>,
    /// Density `rho`.
    pub density: Vec<f32>,
    /// Smoothing length `h` (support radius).
    pub smoothing_length: Vec<f32>,
    /// One column for each attribute of the family, in the order of the attribute table.
    pub attributes: Vec<Vec<f32>>,
    /// Error of mass, density, smoothing length, then of each attribute.
    pub errors: Vec<QuantityError>,
}

portable!(Codebook { scope, particles, mass, density, smoothing_length, attributes, errors });

impl Codebook {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether all columns have an item for each entry, of which there are at most `most`; else what was found and expected.
    pub fn check(&self, attributes: usize, most: usize) -> Result<(), String> {
        expect_within("entries of a codebook", self.len() as u64, 0..=most as u64)?;
        expect("attributes of a codebook", self.attributes.len(), attributes)?;
        let columns = [&self.density, &self.smoothing_length].into_iter().chain(&self.attributes);
        columns.map(Vec::len).try_for_each(|found| expect("column of a codebook", found, self.len()))
    }

    /// Whether the codebook has no entry.
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }
}
