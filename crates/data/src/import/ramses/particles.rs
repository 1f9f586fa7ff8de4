//! Particles of RAMSES: files `part_NNNNN.outPPPPP`, one for each process, with one record for each quantity (`output_part.f90`).
//!
//! Which quantities those are, a description says since 2017, the header's list in some versions before; else they stand in the order in
//! which RAMSES has always written them, and those behind the levels follow from their sizes and their number.

use super::info::{self, Described};
use super::records::{Array, Walk};
use super::rows::{Rows, component};
use super::{Found, Output};
use crate::import::check::chunks;
use crate::import::typed_columns::{Component, FieldList, Run, Vector};
use crate::import::{FieldKind, ImportError};
use crate::model::FamilyName;
use std::collections::BTreeMap;

/// The first quantities of every version.
const FIRST: [&str; 9] =
    ["position_x", "position_y", "position_z", "velocity_x", "velocity_y", "velocity_z", "mass", "identity", "levelp"];

/// Those that are whole numbers where no description says so.
const WHOLE: [&str; 5] = ["identity", "levelp", "family", "tag", "partp"];

/// Vectors of particles and of cells.
pub(super) const VECTORS: [Vector; 2] = [
    ("position", ["position_x", "position_y", "position_z"], FieldKind::Position),
    ("velocity", ["velocity_x", "velocity_y", "velocity_z"], FieldKind::Velocity),
];

/// What a record behind the header is.
struct Quantity {
    name: String,
    is_whole: bool,
}

/// Which quantities tell families apart.
struct Kinds {
    family: Option<usize>,
    birth: Option<usize>,
    identity: Option<usize>,
}

/// The names of quantities as the output says them.
struct Names {
    names: Vec<Described>,
    /// Whether they are those of these files for certain: a header's list may be of a version that writes something else.
    is_certain: bool,
}

/// Adds the particles of an output to what was found.
///
/// # Errors
/// When a file is missing, damaged or unlike the others.
pub(super) fn read(output: &Output, found: &mut Found) -> Result<(), ImportError> {
    let names = names(output)?;
    let mut quantities: Vec<Quantity> = Vec::new();
    let mut families: BTreeMap<FamilyName, Rows> = BTreeMap::new();
    for cpu in 1..=output.info.cpus {
        let path = output.file("part", cpu);
        let mut walk = Walk::open(&path, output.method)?;
        found.file(&walk);
        let count = head(&mut walk)?;
        if count == 0 {
            continue;
        }
        let mut arrays = Vec::new();
        while !walk.is_at_end() {
            arrays.push(walk.array(&format!("record {} of particles", arrays.len() + 1), count)?);
        }
        let own = quantities_of(&walk, names.as_ref(), &arrays)?;
        if quantities.is_empty() {
            quantities = own;
        } else if own.len() != quantities.len() {
            let expected = format!("{}, as in the files before", quantities.len());
            return Err(walk.wrong("records of particles", own.len(), expected));
        }
        let is_unlike = |(array, quantity): (&Array, &Quantity)| array.is_of_bytes() && !quantity.is_whole;
        if arrays.iter().zip(&quantities).any(is_unlike) {
            return Err(walk.wrong("records of particles", "single bytes", "floats, as in the files before"));
        }
        let taken = arrays.iter().zip(&quantities).map(|(array, quantity)| array.taken_as(quantity.is_whole));
        let arrays: Vec<Array> = taken.collect();
        read_file(output, &walk, &arrays, count, &quantities, &mut families)?;
    }
    for (name, rows) in families {
        let number = found.storages.len();
        let count = rows.count;
        found.storages.push(rows.into_storage()?);
        let fields = fields(output, &quantities, number);
        if !fields.has_positions() {
            return Err(ImportError::missing(&output.path, format!("positions of {name}"), "position_x, _y and _z"));
        }
        found.families.push(fields.family(name, count, vec![Run::WHOLE]));
    }
    Ok(())
}

/// Passes over a file's header and gives its number of particles.
fn head(walk: &mut Walk) -> Result<u64, ImportError> {
    walk.whole("ncpu", u32::MAX)?;
    let dimensions = walk.whole("ndim", 3)?;
    if dimensions != 3 {
        return Err(walk.wrong("ndim", dimensions, "3"));
    }
    let count = walk.whole("npart", i32::MAX as u32)?;
    // Seeds of random numbers, and numbers and masses of stars and sink particles, whose sizes differ between versions.
    walk.skip("header", 5)?;
    Ok(count.into())
}

/// The names of quantities, where a text of the output says them.
fn names(output: &Output) -> Result<Option<Names>, ImportError> {
    if let Some(text) = info::text(&output.folder.join("part_file_descriptor.txt"))? {
        let names = info::described(&text);
        return Ok((!names.is_empty()).then_some(Names { names, is_certain: true }));
    }
    let header = info::text(&output.folder.join(format!("header_{}.txt", output.number)))?;
    let listed = header.and_then(|text| info::listed(&text));
    Ok(listed.map(|names| Names { names, is_certain: false }))
}

/// What the records of a file are.
fn quantities_of(walk: &Walk, names: Option<&Names>, arrays: &[Array]) -> Result<Vec<Quantity>, ImportError> {
    let guessed;
    let names = match names {
        Some(names) if names.names.len() <= arrays.len() => &names.names,
        Some(names) if names.is_certain => {
            let expected = format!("{} or more, as many as are described", names.names.len());
            return Err(walk.wrong("records of particles", arrays.len(), expected));
        }
        _ => {
            guessed = in_order(walk, arrays)?;
            &guessed
        }
    };
    let quantity = |(index, array): (usize, &Array)| {
        let (name, is_whole) = match names.get(index) {
            Some((name, Some(kind))) => (name.clone(), "bhilq".contains(*kind)),
            Some((name, None)) => (name.clone(), WHOLE.contains(&&**name)),
            None => (format!("field-{}", index + 1), false),
        };
        Quantity { name, is_whole: is_whole || array.is_of_bytes() }
    };
    Ok(arrays.iter().enumerate().map(quantity).collect())
}

/// The names of so many records in the order in which RAMSES writes them.
fn in_order(walk: &Walk, arrays: &[Array]) -> Result<Vec<Described>, ImportError> {
    if arrays.len() < FIRST.len() {
        let expected = format!("{} or more: {}", FIRST.len(), FIRST.join(", "));
        return Err(walk.wrong("records of particles", arrays.len(), expected));
    }
    let mut names = FIRST.to_vec();
    let bytes = arrays.iter().skip(FIRST.len()).take_while(|array| array.is_of_bytes()).count();
    if bytes == 2 {
        names.extend(["family", "tag"]);
    }
    // Where more follow, nothing says what they are.
    if arrays.len() <= names.len() + 2 {
        names.extend(["birth_time", "metallicity"]);
    }
    Ok(names.into_iter().map(|name| (name.to_owned(), None)).collect())
}

/// Puts the particles of a file to their families.
fn read_file(
    output: &Output,
    walk: &Walk,
    arrays: &[Array],
    count: u64,
    quantities: &[Quantity],
    families: &mut BTreeMap<FamilyName, Rows>,
) -> Result<(), ImportError> {
    let place = |name: &str| quantities.iter().position(|quantity| quantity.name == name);
    let whole = |place: &usize| quantities[*place].is_whole;
    let kinds = Kinds {
        family: place("family").filter(whole),
        birth: place("birth_time").filter(|place| !whole(place)),
        identity: place("identity").filter(whole),
    };
    let mut columns: Vec<Vec<[u8; 8]>> = vec![Vec::new(); arrays.len()];
    let mut raw = Vec::new();
    for range in chunks(count) {
        for (array, column) in arrays.iter().zip(&mut columns) {
            walk.words(*array, &range, &mut raw, column)?;
        }
        for row in 0..(range.end - range.start) as usize {
            let rows = families.entry(kinds.family_of(&columns, row)).or_insert_with(|| Rows::new(&output.path));
            rows.push(columns.iter().map(|column| column[row]))?;
        }
    }
    Ok(())
}

impl Kinds {
    /// The family of a particle: since 2018 by its number (`pm_commons.f90`: 1 dark matter, 2 stars, 3 the clouds of sinks, 4 dust, 0 and
    /// below tracers); before by its birth, which dark matter has at 0, and its id, which is negative in clouds.
    fn family_of(&self, columns: &[Vec<[u8; 8]>], row: usize) -> FamilyName {
        let other = |name: &str| FamilyName::parse(name).unwrap_or(FamilyName::Type2);
        let whole = |place: Option<usize>| place.map(|place| i64::from_ne_bytes(columns[place][row]));
        let birth = self.birth.map(|place| f64::from_ne_bytes(columns[place][row]));
        match (whole(self.family), birth, whole(self.identity)) {
            (Some(1), ..) => FamilyName::Dark,
            (Some(2), ..) => FamilyName::Stars,
            (Some(3), ..) => other("sink-clouds"),
            (Some(4), ..) => other("dust"),
            (Some(..=0), ..) => other("tracers"),
            (Some(_), ..) => other("other"),
            (None, Some(birth), _) if birth != 0.0 => FamilyName::Stars,
            (None, _, Some(..=-1)) => other("sink-clouds"),
            (None, ..) => FamilyName::Dark,
        }
    }
}

/// The quantities as fields.
fn fields(output: &Output, quantities: &[Quantity], storage: usize) -> FieldList {
    let mut fields = FieldList::default();
    let mut scalars: Vec<(String, Component)> = Vec::new();
    let factor = output.info.velocity_factor().unwrap_or(1.0);
    for (slot, quantity) in quantities.iter().enumerate() {
        let is_velocity = VECTORS[1].1.contains(&&*quantity.name) && !quantity.is_whole;
        let factor = if is_velocity { factor } else { 1.0 };
        let component = component(storage, slot, quantities.len(), quantity.is_whole, factor);
        match &*quantity.name {
            "identity" if quantity.is_whole => fields.push("id", "identity", FieldKind::Id, vec![component]),
            name => scalars.push((name.to_owned(), component)),
        }
    }
    fields.push_named(scalars, &VECTORS);
    output.name_units(&mut fields);
    fields
}
