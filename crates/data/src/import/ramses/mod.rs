//! Outputs of the adaptive mesh refinement code RAMSES (Teyssier 2002, A&A 385, 337): a folder `output_NNNNN` with a text of numbers,
//! `info_NNNNN.txt`, and files of particles, grids and what is in their cells, one of each for every process.
//!
//! Files are read once and what is in them put in order of families, in memory or a temporary file without a name: they mix families, and leaves with
//! cells that are divided.

mod cells;
mod info;
mod particles;
mod records;
mod rows;

use super::grid::scratch::Storage;
use super::typed_columns::{FieldList, TypedColumns, TypedFamily};
use super::{Description, FamilyInfo, FieldKind, Format, ImportError, Source};
use crate::model::{ReadMethod, Unit};
use info::Info;
use records::Walk;
use std::path::{Path, PathBuf};

/// The RAMSES format.
pub(super) struct Ramses;

impl Format for Ramses {
    fn name(&self) -> &'static str {
        "RAMSES output"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["txt"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        info::is_info(head)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let output = Output::open(path, method)?;
        let mut found = Found::default();
        let has = |kind: &str| output.file(kind, 1).is_file();
        let has_cells = has("amr") && has("hydro");
        if has_cells {
            cells::read(&output, &mut found)?;
        }
        if has("part") {
            particles::read(&output, &mut found)?;
        }
        if found.families.is_empty() {
            let expected = format!("part_{0}.out00001, or amr_{0}.out00001 and hydro_{0}.out00001", output.number);
            return Err(match found.files {
                0 => ImportError::missing(path, "files beside it", expected),
                _ => ImportError::NoParticles { path: path.into(), field: "particles and cells".into() },
            });
        }
        if !has_cells && has("amr") {
            // Runs without gas have grids, too.
            found.box_size = cells::box_size(&output)?;
        }
        let mut about = Description::unitless(path, "ramses", found.bytes);
        output.info.describe(&mut about);
        about.box_size = found.box_size;
        about.notes.append(&mut found.notes);
        about.notes.push(format!("{} files of the output are read", found.files));
        found.families.sort_by_key(|(family, _)| family.name);
        Ok(Box::new(TypedColumns::new(about, found.storages, found.families)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let output = Output::open(path, ReadMethod::default())?;
        let header = format!("header_{}.txt", output.number);
        let texts = ["part_file_descriptor.txt", "hydro_file_descriptor.txt", header.as_str()];
        let texts = texts.map(|name| output.folder.join(name));
        let of_cpu = |cpu: u32| ["amr", "hydro", "part"].map(|kind| output.file(kind, cpu));
        let mut files = vec![path.to_owned()];
        files.extend(texts.into_iter().chain((1..=output.info.cpus).flat_map(of_cpu)).filter(|file| file.is_file()));
        Ok(files)
    }
}

/// The text of an output's numbers in a folder, where that is one of an output.
pub(super) fn info_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let is_info = |path: &PathBuf| {
        let text = number_of(path).and_then(|_| info::text(path).ok().flatten());
        text.is_some_and(|text| info::is_info(text.as_bytes()))
    };
    let mut found = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_info);
    let one = found.next()?;
    found.next().is_none().then_some(one)
}

/// The digits in the name `info_NNNNN.txt`.
fn number_of(path: &Path) -> Option<&str> {
    let number = path.file_name()?.to_str()?.strip_prefix("info_")?.strip_suffix(".txt")?;
    (!number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())).then_some(number)
}

/// An output: where its files are, and its numbers.
struct Output {
    /// The text of its numbers.
    path: PathBuf,
    folder: PathBuf,
    /// The digits in the names of its files.
    number: String,
    info: Info,
    method: ReadMethod,
}

impl Output {
    fn open(path: &Path, method: ReadMethod) -> Result<Output, ImportError> {
        let Some(number) = number_of(path) else {
            let name = super::folder::name_of(path);
            return Err(ImportError::malformed(path, "file name", name, "info_NNNNN.txt, as RAMSES calls it"));
        };
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(Output { path: path.into(), folder, number: number.into(), info: Info::read(path)?, method })
    }

    /// The file of a kind that a process has written, the first of which is 1.
    fn file(&self, kind: &str, cpu: u32) -> PathBuf {
        self.folder.join(format!("{kind}_{}.out{cpu:05}", self.number))
    }

    /// Gives positions, lengths, masses and velocities their units.
    fn name_units(&self, fields: &mut FieldList) {
        let (length, mass) = self.info.units();
        fields.set_unit(FieldKind::Position, &length);
        fields.set_unit(FieldKind::SmoothingLength, &length);
        fields.set_unit(FieldKind::Mass, &mass);
        if self.info.velocity_factor().is_some() {
            fields.set_unit(FieldKind::Velocity, &Unit::new("km/s"));
        }
    }
}

/// What the files of an output hold.
#[derive(Default)]
struct Found {
    storages: Vec<Storage>,
    families: Vec<(FamilyInfo, TypedFamily)>,
    notes: Vec<String>,
    /// Edge of the box, where it repeats.
    box_size: Option<f64>,
    files: usize,
    /// Size of all of them.
    bytes: u64,
}

impl Found {
    /// Counts a file.
    fn file(&mut self, walk: &Walk) {
        self.files += 1;
        self.bytes += walk.file.length;
    }
}
