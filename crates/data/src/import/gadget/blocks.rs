//! What the blocks of a Gadget file hold: by label in format 2, by order and size in format 1.

use super::header::{Header, Types};
use super::records::Record;
use crate::import::bytes::Number;
use crate::import::{FieldKind, ImportError};
use std::path::Path;

/// What is known of a block by its label.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Known {
    label: &'static str,
    name: &'static str,
    kind: FieldKind,
    components: usize,
    types: Option<Types>,
}

const fn known(
    label: &'static str,
    name: &'static str,
    kind: FieldKind,
    components: usize,
    types: Option<Types>,
) -> Known {
    Known { label, name, kind, components, types }
}

/// Labels of Gadget-2 and -3. A block of masses has the types that the header's mass table leaves out.
const KNOWN: &[Known] = &[
    known("POS", "position", FieldKind::Position, 3, Some(Types::ALL)),
    known("VEL", "velocity", FieldKind::Velocity, 3, Some(Types::ALL)),
    known("ID", "id", FieldKind::Id, 1, Some(Types::ALL)),
    known("MASS", "mass", FieldKind::Mass, 1, None),
    known("U", "internal-energy", FieldKind::Other, 1, Some(Types::GAS)),
    known("RHO", "density", FieldKind::Density, 1, Some(Types::GAS)),
    known("NE", "electron-abundance", FieldKind::Other, 1, Some(Types::GAS)),
    known("NH", "neutral-hydrogen-abundance", FieldKind::Other, 1, Some(Types::GAS)),
    known("HSML", "smoothing-length", FieldKind::SmoothingLength, 1, Some(Types::GAS)),
    known("SFR", "star-formation-rate", FieldKind::Other, 1, Some(Types::GAS)),
    known("AGE", "formation-time", FieldKind::Other, 1, Some(Types::STARS)),
    known("Z", "metallicity", FieldKind::Other, 1, Some(Types::GAS_AND_STARS)),
    known("POT", "potential", FieldKind::Other, 1, Some(Types::ALL)),
    known("ACCE", "acceleration", FieldKind::Other, 3, Some(Types::ALL)),
    known("ENDT", "entropy-rate", FieldKind::Other, 1, Some(Types::GAS)),
    known("TSTP", "time-step", FieldKind::Other, 1, Some(Types::ALL)),
    known("TEMP", "temperature", FieldKind::Other, 1, Some(Types::GAS)),
    known("PRES", "pressure", FieldKind::Other, 1, Some(Types::GAS)),
    known("VELD", "velocity-dispersion", FieldKind::Other, 1, Some(Types::DARK)),
    known("BFLD", "magnetic-field", FieldKind::Other, 3, Some(Types::GAS)),
];

/// Sets of types that a block may have when its label does not tell, tried in this order.
const GUESSES: [Types; 6] =
    [Types::ALL, Types::GAS, Types::STARS, Types::GAS_AND_STARS, Types::DARK, Types::BLACK_HOLES];

/// A block with a meaning.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Block {
    /// Standard name, or the label.
    pub name: String,
    /// The label.
    pub label: String,
    pub kind: FieldKind,
    pub components: usize,
    pub number: Number,
    /// The types it has, one after the other.
    pub types: Types,
    /// First byte.
    pub offset: u64,
}

/// Gives every data record (all but the header) its meaning; notes those that have none.
///
/// # Errors
/// [`ImportError`] when positions, velocities, ids or the masses that the header announces are missing, or one of them
/// has another size than the header's counts make it.
pub(super) fn name(
    path: &Path,
    header: &Header,
    records: &[Record],
    notes: &mut Vec<String>,
) -> Result<Vec<Block>, ImportError> {
    let mut order = conventional(header).into_iter().peekable();
    let counted = |known: Option<Known>| {
        header.particles(known.and_then(|known| known.types).unwrap_or(header.with_mass_block()))
    };
    let mut blocks: Vec<Block> = Vec::new();
    for (index, record) in records.iter().enumerate() {
        let label = match &record.label {
            Some(label) => label.clone(),
            None => {
                // A block of the usual order that does not fit is not in this file, unless every file has it.
                let fits = |label: &&str| {
                    lookup(label).and_then(|known| known.fit(header, record, label)).is_some() || required(label)
                };
                std::iter::from_fn(|| order.next()).find(fits).map_or(format!("BLOCK{}", index + 1), str::to_string)
            }
        };
        if label == "HEAD" || label == "INFO" {
            continue;
        }
        let known = lookup(&label);
        match known.and_then(|known| known.fit(header, record, &label)).or_else(|| guess(header, record, &label, known))
        {
            Some(block) if blocks.iter().any(|other| other.name == block.name) => {
                notes.push(format!("block {label} occurs twice and counts once"));
            }
            Some(block) => blocks.push(block),
            // Of several files one may be empty.
            None if record.length == 0 && (!required(&label) || counted(known) == 0) => {}
            None if required(&label) => {
                let values = counted(known) * known.map_or(1, |known| known.components) as u64;
                let found = format!("{} bytes", record.length);
                let expected = format!("{values} values of 4 or 8 bytes, as the header counts");
                return Err(ImportError::malformed(path, format!("block {label}"), found, expected));
            }
            None => {
                notes.push(format!("block {label} of {} bytes fits no particle type and is left out", record.length))
            }
        }
    }
    for label in ["POS", "VEL", "ID", "MASS"] {
        let particles = counted(lookup(label));
        if particles > 0 && !blocks.iter().any(|block| block.label == label) {
            let expected = format!("a block for {particles} particles");
            return Err(ImportError::missing(path, format!("block {label}"), expected));
        }
    }
    Ok(blocks)
}

/// Whether a file without that block is not complete.
fn required(label: &str) -> bool {
    matches!(label, "POS" | "VEL" | "ID" | "MASS")
}

fn lookup(label: &str) -> Option<Known> {
    KNOWN.iter().find(|known| known.label == label).copied()
}

/// The order in which Gadget-2 writes its blocks.
fn conventional(header: &Header) -> Vec<&'static str> {
    let mut order = vec!["POS", "VEL", "ID"];
    if header.particles(header.with_mass_block()) > 0 {
        order.push("MASS");
    }
    if header.counts[0] > 0 {
        order.extend(["U", "RHO"]);
        order.extend(header.cooling.then_some(["NE", "NH"]).into_iter().flatten());
        order.push("HSML");
        order.extend(header.cooling.then_some("SFR"));
    }
    order.extend(["POT", "ACCE"]);
    order.extend((header.counts[0] > 0).then_some("ENDT"));
    order.push("TSTP");
    order
}

impl Known {
    /// The block that a record is if it has the label's own types and components.
    fn fit(&self, header: &Header, record: &Record, label: &str) -> Option<Block> {
        let types = self.types.unwrap_or(header.with_mass_block());
        let size = width(header, types, self.components, record.length)?;
        Some(self.block(types, size, record, label))
    }

    fn block(&self, types: Types, size: usize, record: &Record, label: &str) -> Block {
        let number = match (size, self.kind) {
            (4, FieldKind::Id) => Number::U32,
            (_, FieldKind::Id) => Number::U64,
            (4, _) => Number::F32,
            _ => Number::F64,
        };
        Block {
            name: self.name.into(),
            label: label.into(),
            kind: self.kind,
            components: self.components,
            number,
            types,
            offset: record.offset,
        }
    }
}

/// A block with other types than its label usually has, or an unknown label: the first set of types that its size fits.
fn guess(header: &Header, record: &Record, label: &str, known: Option<Known>) -> Option<Block> {
    if known.is_some_and(|known| required(known.label)) {
        return None;
    }
    let shapes = match known {
        Some(known) => vec![known.components],
        None => vec![1, 3],
    };
    let fits = GUESSES.into_iter().flat_map(|types| shapes.iter().map(move |components| (types, *components)));
    let (types, components, size) = fits
        .filter_map(|(types, components)| {
            width(header, types, components, record.length).map(|size| (types, components, size))
        })
        // A size of 4 bytes is far more common than one of 8, so that the former goes first.
        .min_by_key(|(_, components, size)| (*size, *components))?;
    let anonymous = Known { label: "", name: "", kind: FieldKind::Other, components, types: None };
    let block = known.unwrap_or(anonymous).block(types, size, record, label);
    Some(if known.is_some() { block } else { Block { name: label.into(), ..block } })
}

/// Bytes per value (4 or 8) of a block of that length.
fn width(header: &Header, types: Types, components: usize, length: u64) -> Option<usize> {
    let values = header.particles(types) * components as u64;
    [4, 8].into_iter().find(|size| values > 0 && values.checked_mul(*size as u64) == Some(length))
}
