//! Subhaloes of HBT+ (Han et al. 2018), `SubSnap_NNN.K.hdf5`: records in the data set `Subhalos`, in one file or several.

use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::Hdf5Tables;
use crate::model::{ReadMethod, Unit};
use glam::DVec3;
use std::path::Path;

const RECORDS: &str = "Subhalos";

/// Members of the records: number of the track, place, and masses and radii, the preferred first.
const MEMBERS: [&str; 7] = [
    "TrackId",
    "ComovingMostBoundPosition",
    "ComovingAveragePosition",
    "Mbound",
    "RHalfComoving",
    "R200CritComoving",
    "RmaxComoving",
];

/// The most files of a catalogue.
const MOST_FILES: f64 = 10_000.0;

/// Reads a catalogue; `None` of what is none.
pub(super) fn read(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    let mut objects = Vec::new();
    if !push(path, &tables, &mut objects)? {
        return Ok(None);
    }
    let first = |group: &str, name: &str| -> Result<Option<f64>, ExploreError> {
        Ok(tables.column(group, name, 64)?.and_then(|column| column.values.first().copied()))
    };
    let files = first("", "NumberOfFiles")?.unwrap_or(1.0);
    if !(1.0..=MOST_FILES).contains(&files) {
        return Err(ExploreError::malformed(path, "NumberOfFiles", files, format!("from 1 to {MOST_FILES}")));
    }
    if files > 1.0 {
        objects.clear();
        for part in Hdf5Tables::parts(path, files as u64)? {
            if !push(&part, &Hdf5Tables::open(&part, ReadMethod::default())?, &mut objects)? {
                return Err(ExploreError::missing(&part, RECORDS, "records of subhaloes as in other files"));
            }
        }
    }
    let named = |size: Option<f64>, known: [(f64, &str); 2]| {
        let found = known.into_iter().find(|(other, _)| size.is_some_and(|size| (size / other - 1.0).abs() < 1e-3));
        Unit::new(found.map_or("", |(_, name)| name))
    };
    let length = first("Units", "LengthInMpch")?;
    let mass = first("Units", "MassInMsunh")?;
    Ok(Some(Catalogue {
        path: path.into(),
        format: "hbt",
        length_unit: named(length, [(1.0, "a Mpc/h"), (1e-3, "a kpc/h")]),
        mass_unit: named(mass, [(1e10, "1e10 Msun/h"), (1.0, "Msun/h")]),
        box_size: None,
        left_out: 0,
        objects,
        is_in_plane: false,
        tree: None,
    }))
}

/// Adds the subhaloes of a file; false where it has no records of any.
fn push(path: &Path, tables: &Hdf5Tables, objects: &mut Vec<Object>) -> Result<bool, ExploreError> {
    let Some(members) = tables.members(RECORDS, &MEMBERS, MOST_OBJECTS)? else { return Ok(false) };
    let member = |name: &str, components: usize| {
        let place = MEMBERS.iter().position(|other| *other == name)?;
        members[place].as_ref().filter(|column| column.components == components).map(|column| &column.values)
    };
    let place = member("ComovingMostBoundPosition", 3).or_else(|| member("ComovingAveragePosition", 3));
    let Some(place) = place else {
        let expected = "a member ComovingMostBoundPosition or ComovingAveragePosition of 3 numbers";
        return Err(ExploreError::missing(path, RECORDS, expected));
    };
    let (track, mass) = (member("TrackId", 1), member("Mbound", 1));
    let radius = ["RHalfComoving", "R200CritComoving", "RmaxComoving"].into_iter().find_map(|name| member(name, 1));
    let before = objects.len();
    let rows = place.len() / 3;
    if (before + rows) as u64 > MOST_OBJECTS {
        return Err(ExploreError::malformed(path, RECORDS, before + rows, format!("at most {MOST_OBJECTS}")));
    }
    let of = |column: Option<&Vec<f64>>, row: usize| column.and_then(|values| values.get(row)).copied();
    objects.extend((0..rows).map(|row| Object {
        name: of(track, row).map_or_else(|| format!("Subhalo {}", before + row), |track| format!("Track {track}")),
        position: DVec3::from_slice(&place[3 * row..3 * row + 3]),
        radius: of(radius, row),
        mass: of(mass, row),
    }));
    Ok(true)
}
