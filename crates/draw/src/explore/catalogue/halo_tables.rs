//! Catalogues of halo finders in HDF5 that are no snapshots: VELOCIraptor's `.properties`, whose columns are data sets of the root, in one file
//! or several.

use super::finder::VELOCIRAPTOR;
use super::halo_records::FILES_OF_RECORDS;
use super::properties::Kept;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::{Hdf5Tables, names_of_parts};
use crate::model::{ReadMethod, Unit};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Names as the file has them.
const POSITION: [&str; 3] = ["Xc", "Yc", "Zc"];
const MASS: [&str; 4] = ["Mvir", "Mass_200crit", "Mass_200mean", "Mass_tot"];
const RADIUS: [&str; 4] = ["Rvir", "R_200crit", "R_200mean", "R_size"];
const ID: &str = "ID";

/// In how many files a catalogue is, where each says it.
const FILES: &str = "Num_of_files";
/// The most files of a catalogue.
const MOST_FILES: f64 = 10_000.0;

/// The files of a catalogue of which `path` is one, by the number in the data set `name`; itself where it says none.
///
/// # Errors
/// When the number makes no sense, or one is not there.
pub(super) fn files(path: &Path, tables: &Hdf5Tables, name: &str) -> Result<Vec<PathBuf>, ExploreError> {
    let stated = tables.column("", name, 64)?.and_then(|column| column.values.first().copied()).unwrap_or(1.0);
    if !(1.0..=MOST_FILES).contains(&stated) {
        return Err(ExploreError::malformed(path, name, stated, format!("from 1 to {MOST_FILES}")));
    }
    Ok(names_of_parts(path, stated as u64)?)
}

/// The files that say how many they are of the catalogue that a file belongs to, VELOCIraptor's or HBT+'s; itself of any other.
///
/// # Errors
/// As [`files`].
pub(super) fn files_of_finder(path: &Path) -> Result<Vec<PathBuf>, ExploreError> {
    if !Hdf5Tables::are_in(path)? {
        return Ok(vec![path.into()]);
    }
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    let of_records = files(path, &tables, FILES_OF_RECORDS)?;
    if of_records.len() > 1 { Ok(of_records) } else { files(path, &tables, FILES) }
}

/// Reads a catalogue; `None` of what is none of these.
pub(super) fn read(path: &Path, kept: &mut Kept) -> Result<Option<Catalogue>, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    let mut objects = Vec::new();
    if !push(path, &tables, &mut objects, kept)? {
        return Ok(None);
    }
    let parts = files(path, &tables, FILES)?;
    if parts.len() > 1 {
        objects.clear();
        kept.clear();
        for part in parts {
            if !push(&part, &Hdf5Tables::open(&part, ReadMethod::default())?, &mut objects, kept)? {
                return Err(ExploreError::missing(&part, POSITION[0], "columns of haloes as in other files"));
            }
        }
    }
    // Units of comoving output have powers of `h`, too, which depend on how it was configured.
    let is_physical = tables.number("UnitInfo", "Comoving_or_Physical")? == Some(0.0);
    let unit = |name: &str, known: [(f64, &str); 3]| -> Result<Unit, ExploreError> {
        let size = tables.number("UnitInfo", name)?.filter(|_| is_physical);
        let named = size.and_then(|size| known.into_iter().find(|(other, _)| (size / other - 1.0).abs() < 1e-3));
        Ok(Unit::new(named.map_or("", |(_, name)| name)))
    };
    Ok(Some(Catalogue {
        path: path.into(),
        format: VELOCIRAPTOR.format,
        length_unit: unit("Length_unit_to_kpc", [(1e-3, "pc"), (1.0, "kpc"), (1e3, "Mpc")])?,
        mass_unit: unit("Mass_unit_to_solarmass", [(1.0, "Msun"), (1e5, "1e5 Msun"), (1e10, "1e10 Msun")])?,
        box_size: None,
        left_out: 0,
        properties: kept.finished(objects.len()),
        objects,
        is_in_plane: false,
        tree: None,
    }))
}

/// Adds the haloes of a file; false where it has no places of any.
fn push(path: &Path, tables: &Hdf5Tables, objects: &mut Vec<Object>, kept: &mut Kept) -> Result<bool, ExploreError> {
    let column = |name: &str| -> Result<Option<Vec<f64>>, ExploreError> {
        let column = tables.column("", name, MOST_OBJECTS)?;
        Ok(column.filter(|column| column.components == 1).map(|column| column.values))
    };
    let first = |names: &[&'static str]| -> Result<Option<(&'static str, Vec<f64>)>, ExploreError> {
        for name in names {
            if let Some(values) = column(name)? {
                return Ok(Some((*name, values)));
            }
        }
        Ok(None)
    };
    let [x, y, z] = POSITION.map(column);
    let (Some(x), Some(y), Some(z)) = (x?, y?, z?) else { return Ok(false) };
    let (mass, radius, id) = (first(&MASS)?, first(&RADIUS)?, first(&[ID])?);
    let (before, rows) = (objects.len(), x.len());
    let others = [mass.as_ref(), radius.as_ref(), id.as_ref()].map(|column| column.map(|(_, values)| values));
    if let Some(other) = [Some(&y), Some(&z)].into_iter().chain(others).flatten().find(|other| other.len() != rows) {
        let expected = format!("{rows} rows as Xc has");
        return Err(ExploreError::malformed(path, "columns", format!("{} rows", other.len()), expected));
    }
    if (before + rows) as u64 > MOST_OBJECTS {
        return Err(ExploreError::malformed(path, "haloes", before + rows, format!("at most {MOST_OBJECTS}")));
    }
    if !kept.is_nothing() {
        let own = [mass.as_ref(), radius.as_ref(), id.as_ref()].map(|column| column.map(|(name, _)| *name));
        let is_own = |name: &str| POSITION.contains(&name) || own.contains(&Some(name));
        for (name, _) in tables.columns_of_root()?.iter().filter(|(name, own)| *own == rows as u64 && !is_own(name)) {
            let Some(place) = kept.place(name, &Unit::default()) else { continue };
            kept.check_room(path, before + rows)?;
            kept.put(place, before, column(name)?.unwrap_or_default());
        }
    }
    let of = |column: &Option<(&str, Vec<f64>)>, row: usize| column.as_ref().map(|(_, values)| values[row]);
    objects.extend((0..rows).map(|row| Object {
        // Numbers of haloes of the step; those of the whole run are above what a double holds, and are not used.
        name: format!("Halo {}", of(&id, row).unwrap_or((before + row) as f64)),
        position: DVec3::new(x[row], y[row], z[row]),
        radius: of(&radius, row),
        mass: of(&mass, row),
    }));
    Ok(true)
}
