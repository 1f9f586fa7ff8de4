//! Dumps of the smoothed particle hydrodynamics code PHANTOM with tags, full and small ones (Price et al. 2018, PASA 35, e031;
//! `utils_dumpfiles.f90`).
//!
//! Behind a line of text follow the header's numbers and then, for particles, sink particles and others of as many as one of these, arrays
//! with their names. All particles of a kind have one mass, and their densities follow from it:
//! `rho = m (hfact / h)^3` (eq. 3 there). Smoothing lengths are half the support radius of the cubic spline.

mod records;

use super::bytes::{Order, RangeFile};
use super::grid::scratch::Storage;
use super::hdf5::{length_name, mass_name};
use super::typed_columns::{
    Column, Component, FieldList, Meaning, Run, TypedColumns, TypedFamily, VECTORS, Vector, all_positive, each_number,
};
use super::{Description, FamilyInfo, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, SampleType, Unit};
use records::{KINDS, Layout, Walk};
use std::collections::BTreeMap;
use std::path::Path;

/// The PHANTOM format.
pub(super) struct Phantom;

/// The most numbers of a kind in the header, and arrays: far more than PHANTOM's `maxphead`.
const MOST: u32 = 4096;
/// The most blocks of arrays.
const MOST_BLOCKS: u32 = 64;

/// The most letters of the line of text, of which the first is F for a full and S for a small dump, the second T for tags. Versions differ in
/// how many they write, 100 or a few more.
const IDENTIFIER: u64 = 1024;

impl Format for Phantom {
    fn name(&self) -> &'static str {
        "PHANTOM dump"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        Layout::of(head).is_some()
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut head = vec![0; file.length.min(32) as usize];
        file.read(0, &mut head, "header")?;
        let Some(layout) = Layout::of(&head) else {
            let expected = "the numbers that a dump begins with, whole numbers of 4 bytes";
            return Err(ImportError::malformed(path, "header", "others", expected));
        };
        let dump = Dump::read(&file, layout)?;
        let mut about = Description::unitless(path, "phantom", file.length);
        dump.describe(&mut about);
        let storage = vec![Storage::File(file)];
        let families = dump.families(path, &storage, &mut about.notes)?;
        if families.is_empty() {
            return Err(ImportError::NoParticles { path: path.into(), field: "particles".into() });
        }
        Ok(Box::new(TypedColumns::new(about, storage, families)))
    }
}

/// Arrays of as many numbers as there are particles.
#[derive(Default)]
struct Block {
    count: u64,
    arrays: Vec<(String, Column)>,
}

impl Block {
    fn named(&self, name: &str) -> Option<Column> {
        self.arrays.iter().find(|(tag, _)| tag == name).map(|(_, column)| *column)
    }
}

/// What is in a dump.
struct Dump {
    /// The header's numbers.
    header: Vec<(String, f64)>,
    /// The mass of particles of each type.
    masses: Vec<f64>,
    particles: Block,
    sinks: Block,
}

impl Dump {
    fn read(file: &RangeFile, layout: Layout) -> Result<Dump, ImportError> {
        let mut walk = Walk { file, layout, at: 0 };
        walk.record("header", if layout.kinds()[5].size() == 8 { 24 } else { 20 })?;
        let text = walk.text("identifier", IDENTIFIER)?;
        if text.get(1) != Some(&b'T') {
            let found = String::from_utf8_lossy(&text[..2]).replace(char::is_control, "?");
            return Err(ImportError::malformed(&file.path, "identifier", found, "FT or ST: a dump with tags"));
        }
        let mut header = Vec::new();
        for kind in layout.kinds() {
            let count = walk.count("header", MOST)?;
            if count == 0 {
                continue;
            }
            let tags = walk.tags("header: tags", count)?;
            let bytes = walk.bytes("header: values", u64::from(count) * kind.size() as u64)?;
            for (number, tag) in tags.into_iter().enumerate() {
                header.push((tag, value(layout, kind, bytes.get(number * kind.size()..).unwrap_or_default())));
            }
        }
        let several = header.iter().find(|(tag, value)| tag == "nblocks" && *value > 1.0);
        if let Some((_, value)) = several {
            return Err(ImportError::malformed(&file.path, "nblocks", value, "1: a dump of one process"));
        }
        let blocks = walk.count("blocks of arrays", MOST_BLOCKS)?;
        let mut heads = Vec::new();
        for number in 1..=blocks {
            let field = format!("block {number}");
            let bytes = walk.bytes(&field, 8 + 4 * KINDS as u64)?;
            let count = layout.order.f64(&bytes, 0).to_bits();
            let mut arrays = [0; KINDS];
            for (kind, arrays) in arrays.iter_mut().enumerate() {
                *arrays = walk.checked(&field, layout.order.u32(&bytes, 8 + 4 * kind), MOST)?;
            }
            heads.push((field, count, arrays));
        }
        let all: u32 = heads.iter().map(|(_, _, arrays)| arrays.iter().sum::<u32>()).sum();
        walk.checked("arrays", all, MOST)?;
        let (mut particles, mut sinks) = (Block::default(), Block::default());
        for (number, (field, count, arrays)) in heads.into_iter().enumerate() {
            // The first block is that of particles, the second that of sinks; others have more about the former.
            let block = if number == 1 { &mut sinks } else { &mut particles };
            if number < 2 {
                block.count = count;
            }
            let is_known = block.count == count;
            for (kind, many) in layout.kinds().into_iter().zip(arrays) {
                for _ in 0..many {
                    let tag = walk.tags(&format!("{field}: tag"), 1)?.pop().unwrap_or_default();
                    let Some(bytes) = count.checked_mul(kind.size() as u64) else {
                        let expected = format!("as many as the file of {} bytes has", file.length);
                        return Err(ImportError::malformed(&file.path, field, format!("{count} numbers"), expected));
                    };
                    let offset = walk.record(&format!("{field}: {tag}"), bytes)?;
                    if !is_known {
                        continue;
                    }
                    let (stride, order) = (kind.size() as u64, layout.order);
                    let column = Column { storage: 0, offset, stride, number: kind, order };
                    let same = block.arrays.iter().filter(|(other, _)| is_numbered(other, &tag)).count();
                    let name = if same == 0 { tag } else { format!("{tag}-{}", same + 1) };
                    block.arrays.push((name, column));
                }
            }
        }
        let masses = header.iter().filter(|(tag, _)| tag == "massoftype").map(|(_, mass)| *mass).collect();
        Ok(Dump { header, masses, particles, sinks })
    }

    fn number(&self, name: &str) -> Option<f64> {
        self.header.iter().find(|(tag, _)| tag == name).map(|(_, value)| *value)
    }

    /// Time and units.
    fn describe(&self, about: &mut Description) {
        about.time = self.number("time").filter(|time| time.is_finite());
        (about.length_unit, about.mass_unit) = self.units();
    }

    /// Those of lengths and masses, where the dump says them in cgs. Units of 1 are none.
    fn units(&self) -> (Unit, Unit) {
        let unit = |name: &str| self.number(name).filter(|unit| *unit > 0.0 && unit.is_finite() && *unit != 1.0);
        let length = unit("udist").map(|cm| Unit::new(length_name(cm)));
        let mass = unit("umass").map(|gram| Unit::new(mass_name(gram)));
        (length.unwrap_or_default(), mass.unwrap_or_default())
    }

    /// Gives positions, lengths and masses their units.
    fn name_units(&self, fields: &mut FieldList) {
        let (length, mass) = self.units();
        fields.set_unit(FieldKind::Position, &length);
        fields.set_unit(FieldKind::SmoothingLength, &length);
        fields.set_unit(FieldKind::Mass, &mass);
    }

    /// The mass of particles of type `kind`, from 1.
    fn mass(&self, kind: u64) -> f64 {
        let index = kind.checked_sub(1).and_then(|index| usize::try_from(index).ok());
        index.and_then(|index| self.masses.get(index)).copied().unwrap_or(f64::NAN)
    }

    fn families(
        &self,
        path: &Path,
        storage: &[Storage],
        notes: &mut Vec<String>,
    ) -> Result<Vec<(FamilyInfo, TypedFamily)>, ImportError> {
        let mut families = Vec::new();
        let hfact = self.number("hfact").filter(|hfact| *hfact > 0.0 && hfact.is_finite());
        let has_masses = !self.masses.is_empty();
        for (name, (count, runs)) in self.kinds(path, storage, notes)? {
            let mut fields = FieldList::default();
            if has_masses {
                fields.push("mass", "massoftype", FieldKind::Mass, vec![Component::MassOfRun]);
            }
            if let Some(h) = self.particles.named("h") {
                let twice = Component::Stored(h, Meaning::Linear { factor: 2.0, first: 0.0 });
                fields.push("smoothing-length", "h", FieldKind::SmoothingLength, vec![twice]);
                if let Some(factor) = hfact.filter(|_| has_masses) {
                    let density = Component::Stored(h, Meaning::MassOverCube { factor });
                    fields.push("density", "massoftype (hfact/h)^3", FieldKind::Density, vec![density]);
                }
            }
            // Numbers that particles keep, whatever the order they are in (`part.F90`).
            if let Some(original) = self.particles.named("iorig").filter(|column| !column.number.is_float()) {
                fields.push("id", "iorig", FieldKind::Id, vec![Component::plain(original)]);
            }
            push_arrays(&mut fields, &self.particles, &["h", "itype", "iorig"]);
            if !fields.has_positions() {
                return Err(ImportError::missing(path, format!("positions of {name}"), "arrays x, y and z"));
            }
            self.name_units(&mut fields);
            families.push(fields.family(name, count, runs));
        }
        if !families.is_empty() && self.particles.named("h").is_some() {
            notes.push("smoothing lengths are doubled to give the support radius of the cubic spline".into());
            if hfact.is_some() && has_masses {
                notes.push("densities are the mass by (h/hfact)^3, as PHANTOM has them".into());
            }
        }
        if self.sinks.count > 0 {
            let name = FamilyName::parse("sinks").unwrap_or(FamilyName::BlackHoles);
            let mut fields = FieldList::default();
            let radius = self.sinks.named("h");
            if let Some(h) = radius {
                let all = all_positive(path, storage, h, self.sinks.count)?;
                let kind = if all { FieldKind::SmoothingLength } else { FieldKind::Other };
                let name = if all { "smoothing-length" } else { "accretion-radius" };
                fields.push(name, "h", kind, vec![Component::plain(h)]);
                notes.extend(all.then(|| "sinks: as large as their accretion radius".to_owned()));
            }
            push_arrays(&mut fields, &self.sinks, &["h"]);
            if !fields.has_positions() {
                return Err(ImportError::missing(path, "positions of sinks", "arrays x, y and z"));
            }
            self.name_units(&mut fields);
            families.push(fields.family(name, self.sinks.count, vec![Run::WHOLE]));
        }
        Ok(families)
    }

    /// The rows of particles by their family. Dead ones, whose type is negative, are none's.
    fn kinds(
        &self,
        path: &Path,
        storage: &[Storage],
        notes: &mut Vec<String>,
    ) -> Result<BTreeMap<FamilyName, (u64, Vec<Run>)>, ImportError> {
        let count = self.particles.count;
        let mut found: BTreeMap<FamilyName, (u64, Vec<Run>)> = BTreeMap::new();
        if count == 0 {
            return Ok(found);
        }
        let Some(types) = self.particles.named("itype") else {
            found.insert(FamilyName::Gas, (count, vec![Run { mass: self.mass(1), ..Run::WHOLE }]));
            return Ok(found);
        };
        let (mut last, mut dead) = (None, 0_u64);
        each_number(path, storage, types, count, |row, kind| {
            let kind = if kind >= 1.0 { kind as u64 } else { 0 };
            if kind == 0 {
                dead += 1;
            } else {
                let (particles, runs) = found.entry(family_of(kind)).or_default();
                if last != Some(kind) {
                    runs.push(Run { particle: *particles, row, mass: self.mass(kind), ..Run::WHOLE });
                }
                *particles += 1;
            }
            last = Some(kind);
        })?;
        notes.extend((dead > 0).then(|| format!("{dead} dead particles are left out")));
        Ok(found)
    }
}

/// Whether `other` is the name that an array with the tag `tag` has, the first or another.
fn is_numbered(other: &str, tag: &str) -> bool {
    let number = other.strip_prefix(tag).and_then(|rest| rest.strip_prefix('-'));
    other == tag || number.is_some_and(|number| number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// PHANTOM's types 1 to 6 (`part.F90`: gas, particles that were split, boundary, stars, dark matter, bulge); from 7 on they are dust.
fn family_of(kind: u64) -> FamilyName {
    let other = |name: &str| FamilyName::parse(name).unwrap_or(FamilyName::Type2);
    match kind {
        1 | 2 => FamilyName::Gas,
        3 => other("boundary"),
        4 => FamilyName::Stars,
        5 => FamilyName::Dark,
        6 => other("bulge"),
        _ => other("dust"),
    }
}

/// Adds all arrays of a block but those of these names.
fn push_arrays(fields: &mut FieldList, block: &Block, without: &[&str]) {
    const MAGNETIC_FIELD: [Vector; 1] = [("magnetic-field", ["bx", "by", "bz"], FieldKind::Other)];
    let arrays = block.arrays.iter().filter(|(tag, _)| !without.contains(&&**tag));
    let scalars = arrays.map(|(tag, column)| (tag.clone(), Component::plain(*column))).collect();
    fields.push_named(scalars, &[&VECTORS[..2], &MAGNETIC_FIELD[..]].concat());
}

/// The first number in the bytes.
fn value(layout: Layout, kind: SampleType, bytes: &[u8]) -> f64 {
    let mut word: Vec<u8> = bytes.iter().take(kind.size()).copied().collect();
    if layout.order != Order::NATIVE {
        word.reverse();
    }
    let mut values = Vec::with_capacity(1);
    kind.decode(&word, 1, &mut values);
    values.first().copied().unwrap_or(f64::NAN)
}
