//! Snapshots of ChaNGa in the format nchilada: a folder in which every family has a folder, `gas`, `dark` and `star`, with a file for each
//! field (`FieldHeader` of `tree_xdr.h`).
//!
//! Numbers are big-endian: a magic number, the time, the number of particles, numbers for each, their type, the least and the
//! greatest of them, and all of them; where the least is the greatest, they need not be there.

use super::bytes::{Order, RangeFile};
use super::grid::scratch::Storage;
use super::typed_columns::{Column, Component, FieldList, Meaning, Run, TypedColumns};
use super::{Description, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, SampleType};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The nchilada format.
pub(super) struct Nchilada;

/// What a file of a field begins with.
const MAGIC: [u8; 4] = 1_062_053_u32.to_be_bytes();
/// Bytes before the least and the greatest numbers.
const HEADER: u64 = 28;
/// The most files of a family, and numbers of a particle in one.
const MOST_FIELDS: usize = 256;
const MOST_COMPONENTS: u32 = 64;

/// The folders of a snapshot.
const FOLDERS: [(&str, FamilyName); 3] =
    [("gas", FamilyName::Gas), ("dark", FamilyName::Dark), ("star", FamilyName::Stars)];

/// What files of positions are called.
const POSITIONS: [&str; 2] = ["pos", "position"];

impl Format for Nchilada {
    fn name(&self) -> &'static str {
        "nchilada snapshot"
    }

    fn recognise(&self, head: &[u8], length: u64) -> bool {
        head.starts_with(&MAGIC) && length >= HEADER
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let folder = folder_of(path)?;
        let mut about = Description::unitless(path, "nchilada", 0);
        let (mut storages, mut families) = (Vec::new(), Vec::new());
        let (mut files, mut is_doubled) = (0, false);
        for (name, family) in FOLDERS {
            let (mut fields, mut count) = (FieldList::default(), None);
            for file in fields_of(&folder.join(name))? {
                let Some(field) = FieldFile::open(&file, method)? else { continue };
                let expected = *count.get_or_insert(field.count);
                if field.count != expected {
                    let expected = format!("{expected}, as other files of {name}");
                    return Err(ImportError::malformed(&file, "number of particles", field.count, expected));
                }
                files += 1;
                about.bytes += field.file.length;
                // Tools that add a field, such as ids, may leave its time at 0.
                if POSITIONS.contains(&&*field.name.to_lowercase()) {
                    about.time = about.time.or(Some(field.time)).filter(|time| time.is_finite());
                }
                if expected > 0 {
                    is_doubled |= field.push(&mut fields, storages.len());
                    storages.push(Storage::File(field.file));
                }
            }
            let Some(count) = count.filter(|count| *count > 0) else { continue };
            if !fields.has_positions() {
                return Err(ImportError::missing(
                    path,
                    format!("positions of {family}"),
                    "a file pos of three numbers each",
                ));
            }
            families.push(fields.family(family, count, vec![Run::WHOLE]));
        }
        if families.is_empty() {
            return Err(ImportError::NoParticles { path: path.into(), field: "gas, dark and star".into() });
        }
        about.notes.extend(is_doubled.then(|| "smoothing lengths are doubled to give the support radius".to_owned()));
        about.notes.push(format!("{files} files of the snapshot are read"));
        Ok(Box::new(TypedColumns::new(about, storages, families)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let folder = folder_of(path)?;
        let families = FOLDERS.iter().map(|(name, _)| fields_of(&folder.join(name)));
        Ok(families.collect::<Result<Vec<_>, ImportError>>()?.concat())
    }
}

/// The folder of the snapshot that the file of a field belongs to.
fn folder_of(path: &Path) -> Result<PathBuf, ImportError> {
    let whole = path.canonicalize().map_err(|error| ImportError::io(path, "file", error))?;
    let own = whole.parent().unwrap_or(Path::new(""));
    let name = super::folder::name_of(own);
    match own.parent().filter(|_| FOLDERS.iter().any(|(family, _)| *family == name)) {
        Some(folder) => Ok(folder.to_owned()),
        None => Err(ImportError::malformed(path, "folder", name, "gas, dark or star, with a file for each field")),
    }
}

/// A file of positions in a folder, where that is a snapshot.
pub(super) fn field_in(folder: &Path) -> Option<PathBuf> {
    let is_field = |path: &PathBuf| {
        let mut magic = [0; MAGIC.len()];
        path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok() && magic == MAGIC
    };
    let mut names = FOLDERS.iter().flat_map(|(family, _)| POSITIONS.map(|name| folder.join(family).join(name)));
    names.find(is_field)
}

/// The files of a family in the order of their names; none where it has no folder.
fn fields_of(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let io = |error| ImportError::io(folder, "folder", error);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    if files.len() > MOST_FIELDS {
        return Err(ImportError::malformed(folder, "files", files.len(), format!("at most {MOST_FIELDS}")));
    }
    files.sort();
    Ok(files)
}

/// A file of a field.
struct FieldFile {
    file: RangeFile,
    /// What it is called.
    name: String,
    time: f64,
    count: u64,
    components: u64,
    number: SampleType,
    /// Its numbers where they are the same for all particles and not there one by one.
    same: Option<Vec<f64>>,
}

impl FieldFile {
    /// Reads the header of a file; `None` where it is no field.
    fn open(path: &Path, method: ReadMethod) -> Result<Option<FieldFile>, ImportError> {
        let file = RangeFile::open(path, method)?;
        let mut magic = [0; MAGIC.len()];
        if file.length < MAGIC.len() as u64 {
            return Ok(None);
        }
        file.read(0, &mut magic, "header")?;
        if magic != MAGIC {
            return Ok(None);
        }
        let mut head = [0; HEADER as usize];
        file.read(0, &mut head, "header")?;
        let (time, count) = (Order::Big.f64(&head, 4), Order::Big.f64(&head, 12).to_bits());
        let (components, code) = (Order::Big.u32(&head, 20), Order::Big.u32(&head, 24));
        if !(1..=MOST_COMPONENTS).contains(&components) {
            let expected = format!("1 to {MOST_COMPONENTS}");
            return Err(ImportError::malformed(path, "numbers of a particle", components, expected));
        }
        // Those of one and two bytes have other sizes in files than in memory.
        let number = match code {
            5 => SampleType::I32,
            6 => SampleType::U32,
            7 => SampleType::I64,
            8 => SampleType::U64,
            9 => SampleType::F32,
            10 => SampleType::F64,
            _ => {
                let expected = "5 to 10: whole numbers and floats of 4 and 8 bytes";
                return Err(ImportError::malformed(path, "type", code, expected));
            }
        };
        let components = u64::from(components);
        let record = components * number.size() as u64;
        let mut limits = vec![0; 2 * record as usize];
        file.read(HEADER, &mut limits, "least and greatest")?;
        let is_stored = count.checked_add(2).and_then(|all| all.checked_mul(record)?.checked_add(HEADER));
        let is_stored = is_stored.is_some_and(|end| end <= file.length);
        let (least, greatest) = limits.split_at(record as usize);
        if !is_stored && least != greatest {
            let expected = format!("{count} times {record} bytes behind the header");
            return Err(ImportError::malformed(path, "data", format!("{} bytes in all", file.length), expected));
        }
        let value = |word: &[u8]| {
            let mut word = word.to_vec();
            if Order::NATIVE == Order::Little {
                word.reverse();
            }
            let mut values = Vec::with_capacity(1);
            number.decode(&word, 1, &mut values);
            values.first().copied().unwrap_or(f64::NAN)
        };
        let same = (!is_stored).then(|| least.chunks(number.size()).map(value).collect());
        Ok(Some(FieldFile { name: super::folder::name_of(path), file, time, count, components, number, same }))
    }

    /// Adds it to the fields of a family, as the one in this storage; whether it is one of smoothing lengths, which are doubled.
    fn push(&self, fields: &mut FieldList, storage: usize) -> bool {
        let size = self.number.size() as u64;
        let stride = self.components * size;
        let component = |index: u64| match self.same.as_ref().and_then(|same| same.get(index as usize)) {
            Some(value) => Component::Constant(*value),
            None => Component::plain(Column {
                storage,
                offset: HEADER + 2 * stride + index * size,
                stride,
                number: self.number,
                order: Order::Big,
            }),
        };
        let mut components: Vec<Component> = (0..self.components).map(component).collect();
        let name = &*self.name;
        match (&*name.to_lowercase(), self.components) {
            // As many as the file says that there are need memory: all of these have to be in it.
            ("pos" | "position", 3) if self.same.is_none() => {
                fields.push("position", name, FieldKind::Position, components);
            }
            ("vel" | "velocity", 3) => fields.push("velocity", name, FieldKind::Velocity, components),
            ("gasdensity" | "den", 1) => fields.push("density", name, FieldKind::Density, components),
            ("iord" | "iorder", 1) if !self.number.is_float() && self.same.is_none() => {
                fields.push("id", name, FieldKind::Id, components);
            }
            ("smoothlength", 1) => {
                for component in &mut components {
                    *component = match *component {
                        Component::Stored(column, _) => {
                            Component::Stored(column, Meaning::Linear { factor: 2.0, first: 0.0 })
                        }
                        Component::Constant(value) => Component::Constant(2.0 * value),
                        unstored => unstored,
                    };
                }
                fields.push("smoothing-length", name, FieldKind::SmoothingLength, components);
                return true;
            }
            (_, 1) => components.into_iter().for_each(|component| fields.push_scalar(name, component)),
            _ => fields.push(name, name, FieldKind::Other, components),
        }
        false
    }
}
