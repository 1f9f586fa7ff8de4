//! HDF5: snapshots of Gadget-2, -3 and -4, AREPO, GIZMO, EAGLE and SWIFT, particles of openPMD, and bare files with coordinates. Data sets that are images or
//! volumes are opened by [`super::grid`], through [`Array`], those that are tables, or columns of one, by [`super::table`].

mod array;
mod expansion;
mod file;
mod filters;
mod header;
mod names;
mod openpmd;
mod records;
mod snapshot;
mod tables;
mod units;
mod virtual_source;

pub(super) use array::Array;
pub(super) use file::{Attributes, Column, H5};
pub(super) use names::{POSITIONS, VELOCITIES};
pub(super) use records::Records;
pub use tables::{Hdf5Column, Hdf5Tables};
pub(super) use units::{length_name, mass_name};

use super::table::{in_records, in_root};
use super::{FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod};
use std::path::{Path, PathBuf};

/// The HDF5 format.
pub(super) struct Hdf5;

/// What a superblock begins with.
const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";

/// Whether a file begins as HDF5 does. A user block may precede the superblock, which then starts at 512, 1024, 2048, ...
pub(super) fn is_hdf5(head: &[u8]) -> bool {
    [0, 512, 1024, 2048].iter().any(|start| head.get(*start..).is_some_and(|rest| rest.starts_with(SIGNATURE)))
}

/// Whether a file is a snapshot, a catalogue of groups or of their trees, damaged or not.
///
/// # Errors
/// When its root cannot be read.
pub(super) fn is_of_particles(file: &H5) -> Result<bool, ImportError> {
    let root = file.root()?;
    let (groups, datasets) = root.members()?;
    let of_types = |name: &String| name.starts_with("PartType") || ["Group", "Subhalo"].contains(&&**name);
    // A table may be called so.
    let positions =
        |name: &String| snapshot::is_kind(name, FamilyName::Dark, FieldKind::Position) && !root.holds_records(name);
    // Other codes have a group of this name, too.
    let counts = ["NumPart_ThisFile", "NumPart_Total", "Ngroups_ThisFile", "Nhalos_ThisFile", "Ntrees_ThisFile"];
    let header = groups.iter().any(|name| name == "Header").then(|| root.group("Header")?.attributes()).transpose()?;
    let is_header = header.is_some_and(|header| counts.iter().any(|name| header.has(name)));
    let is_snapshot = is_header || groups.iter().any(of_types) || datasets.iter().any(positions);
    Ok(is_snapshot || !openpmd::iterations(file)?.is_empty())
}

impl Format for Hdf5 {
    fn name(&self) -> &'static str {
        "HDF5 snapshot"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["hdf5", "h5", "hdf"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        is_hdf5(head)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        self.opened(path, None, method)
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let file = H5::open(path, ReadMethod::Positioned)?;
        match openpmd::iterations(&file)?.is_empty() {
            true => snapshot::files(file),
            false => Ok(vec![path.to_owned()]),
        }
    }

    fn steps(&self, path: &Path) -> Result<u64, ImportError> {
        let iterations = openpmd::iterations(&H5::open(path, ReadMethod::Positioned)?)?;
        Ok((iterations.len() as u64).max(1))
    }

    fn open_step(&self, path: &Path, step: u64, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        self.opened(path, Some(step), method)
    }
}

impl Hdf5 {
    /// Opens the source, or a step of it.
    fn opened(&self, path: &Path, step: Option<u64>, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let file = H5::open(path, method)?;
        let iterations = openpmd::iterations(&file)?;
        match step {
            _ if !iterations.is_empty() => Ok(Box::new(openpmd::OpenPmd::open(&file, &iterations, step)?)),
            None | Some(0) => {
                let table = if is_of_particles(&file)? {
                    None
                } else {
                    match in_root(&file)? {
                        Some(table) => Some(table),
                        None => in_records(&file)?,
                    }
                };
                Ok(match table {
                    Some(table) => table,
                    None => Box::new(snapshot::Snapshot::open(file, method)?),
                })
            }
            Some(step) => Err(ImportError::malformed(path, "step", step, "0, as the file holds one snapshot")),
        }
    }
}
