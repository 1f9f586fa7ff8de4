//! Groups of HDF5 files that are no particles, as columns by name: merger trees and what belongs to group catalogues.

use super::file::H5;
use super::header::Header;
use super::records::Values;
use super::{is_hdf5, names};
use crate::import::format::Head;
use crate::import::{ImportError, multifile};
use crate::model::{FamilyName, ReadMethod, Unit};
use std::path::{Path, PathBuf};

/// An HDF5 file, or several that are parts of one.
pub struct Hdf5Tables {
    files: Vec<(H5, Vec<String>)>,
    header: Header,
}

/// A column of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct Hdf5Column {
    /// Numbers of a row.
    pub components: usize,
    /// Row by row.
    pub values: Vec<f64>,
    /// What they are in, where that is known.
    pub unit: Unit,
}

impl Hdf5Tables {
    /// Whether a file is HDF5, unpacked where it is compressed as a whole.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read.
    pub fn are_in(path: &Path) -> Result<bool, ImportError> {
        Ok(is_hdf5(&Head::read(path)?.bytes))
    }

    /// Opens the file, with all others where its header says that it is one of several.
    ///
    /// # Errors
    /// [`ImportError`] when one cannot be read, is damaged or not there.
    pub fn open(path: &Path, method: ReadMethod) -> Result<Hdf5Tables, ImportError> {
        let open = |path: &Path| -> Result<(H5, Vec<String>), ImportError> {
            let file = H5::open(path, method)?;
            let groups = file.root()?.members()?.0;
            Ok((file, groups))
        };
        let first = open(path)?;
        let header = Header::read(&first.0.root()?, &first.1)?;
        let files = match multifile::names(path, header.files)?.as_slice() {
            [_] => vec![first],
            names => names.iter().map(|name| open(name)).collect::<Result<_, _>>()?,
        };
        Ok(Hdf5Tables { files, header })
    }

    /// The file that is named in messages: the first one.
    pub fn path(&self) -> &PathBuf {
        &self.files[0].0.path
    }

    /// Whether there is a group of that name.
    pub fn has(&self, group: &str) -> bool {
        self.files.iter().any(|(_, groups)| groups.iter().any(|other| other == group))
    }

    /// Edge of the periodic box, where the header says it.
    pub fn box_size(&self) -> Option<f64> {
        self.header.box_size
    }

    /// The columns of the root of the first file that have a number a row: their names, and how many rows they have.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read.
    pub fn columns_of_root(&self) -> Result<Vec<(String, u64)>, ImportError> {
        let root = self.files[0].0.root()?;
        let mut found = Vec::new();
        for name in root.members()?.1 {
            if let Some(column) = root.column(&name)?.filter(|column| column.components == 1) {
                found.push((name, column.rows));
            }
        }
        Ok(found)
    }

    /// The names of the members of numbers of the records of a data set of the root, of one file; none where there is no such data set.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read.
    pub fn names_of_members(&self, name: &str) -> Result<Vec<String>, ImportError> {
        let root = self.files[0].0.root()?;
        let is_there = root.members()?.1.iter().any(|other| other == name);
        if is_there { root.names_of_members(name) } else { Ok(Vec::new()) }
    }

    /// Members of the records of a data set of the root, of one file, in the order of `members`: `None` for one that it does not have, or that
    /// is no number; `None` altogether where there is no such data set. Units are not known.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read, or has more than `most` records.
    pub fn members(
        &self,
        name: &str,
        members: &[&str],
        most: u64,
    ) -> Result<Option<Vec<Option<Hdf5Column>>>, ImportError> {
        let root = self.files[0].0.root()?;
        if !root.members()?.1.iter().any(|other| other == name) {
            return Ok(None);
        }
        let found = root.members_of_records(name, members, most)?;
        let column = |(components, values): Values| Hdf5Column { components, values, unit: Unit::default() };
        Ok(found.map(|found| found.into_iter().map(|member| member.map(column)).collect()))
    }

    /// The number that an attribute of a group of the first file holds, as a number or as text.
    ///
    /// # Errors
    /// [`ImportError`] when the group cannot be read.
    pub fn number(&self, group: &str, name: &str) -> Result<Option<f64>, ImportError> {
        let (file, groups) = &self.files[0];
        if !groups.iter().any(|other| other == group) {
            return Ok(None);
        }
        let attributes = file.root()?.group(group)?.attributes()?;
        Ok(attributes.number(name).or_else(|| attributes.text(name)?.trim().parse().ok()))
    }

    /// The time and the redshift of the header.
    pub fn epoch(&self) -> (Option<f64>, Option<f64>) {
        (self.header.time, self.header.redshift)
    }

    /// A column of a group, of all files one after the other; `None` where no file has it. A group without a name is the root.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read, is no column of numbers, or has more than `most` rows.
    pub fn column(&self, group: &str, name: &str, most: u64) -> Result<Option<Hdf5Column>, ImportError> {
        let mut parts = Vec::new();
        for (file, groups) in &self.files {
            if !group.is_empty() && !groups.iter().any(|other| other == group) {
                continue;
            }
            let root = file.root()?;
            let own = if group.is_empty() { root } else { root.group(group)? };
            if own.members()?.1.iter().any(|other| other == name) {
                let missing = || ImportError::missing(&file.path, format!("{group}/{name}"), "a column of numbers");
                parts.push(own.column(name)?.ok_or_else(missing)?);
            }
        }
        let Some(first) = parts.first() else { return Ok(None) };
        let rows = parts.iter().fold(0u64, |rows, part| rows.saturating_add(part.rows));
        let components = first.components;
        if rows > most || parts.iter().any(|part| part.components != components) {
            let expected = format!("at most {most} rows of as many numbers in each file");
            return Err(ImportError::malformed(self.path(), &*first.label, format!("{rows} rows"), expected));
        }
        let quantity = names::quantity(name, FamilyName::Dark).map(|(quantity, _)| quantity);
        let unit = self.header.units.unit_of(&first.attributes()?, quantity);
        let mut values = vec![0.0; rows as usize * components];
        let mut rest = &mut values[..];
        for part in parts {
            let (own, others) = rest.split_at_mut(part.rows as usize * components);
            part.read(0..part.rows, own)?;
            rest = others;
        }
        Ok(Some(Hdf5Column { components, values, unit }))
    }
}
