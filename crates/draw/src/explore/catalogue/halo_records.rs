//! Subhaloes of HBT+ (Han et al. 2018), `SubSnap_NNN.K.hdf5`: records in the data set `Subhalos`, in one file or several.

use super::halo_tables::files;
use super::properties::Kept;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::{FieldKind, Hdf5Tables};
use crate::model::{ReadMethod, Unit};
use glam::DVec3;
use std::path::Path;

const RECORDS: &str = "Subhalos";

/// Members of the records: number of the track, that of the one into which it has sunk, place, and masses and radii, the preferred first.
const MEMBERS: [&str; 8] = [
    "TrackId",
    "SinkTrackId",
    "ComovingMostBoundPosition",
    "ComovingAveragePosition",
    "Mbound",
    "RHalfComoving",
    "R200CritComoving",
    "RmaxComoving",
];

/// In how many files a catalogue is, where each says it.
pub(super) const FILES_OF_RECORDS: &str = "NumberOfFiles";

/// Those that are kept as what every object has.
const OF_OBJECTS: [&str; 4] = ["TrackId", "ComovingMostBoundPosition", "Mbound", "RHalfComoving"];

/// Reads a catalogue; `None` of what is none.
pub(super) fn read(path: &Path, kept: &mut Kept) -> Result<Option<Catalogue>, ExploreError> {
    Ok(read_with_sinks(path, kept)?.map(|(catalogue, _)| catalogue))
}

/// The subhaloes of a step, in the order of its files, and of each the track into which it has sunk, -1: into none. `None` of what is no catalogue.
///
/// # Errors
/// When it cannot be read or is damaged.
pub(in crate::explore) fn tracks(path: &Path) -> Result<Option<(Catalogue, Vec<f64>)>, ExploreError> {
    read_with_sinks(path, &mut Kept::nothing())
}

fn read_with_sinks(path: &Path, kept: &mut Kept) -> Result<Option<(Catalogue, Vec<f64>)>, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    let mut objects = Vec::new();
    let mut sinks = Vec::new();
    if !push(path, &tables, (&mut objects, &mut sinks), kept)? {
        return Ok(None);
    }
    let first = |group: &str, name: &str| -> Result<Option<f64>, ExploreError> {
        Ok(tables.column(group, name, 64)?.and_then(|column| column.values.first().copied()))
    };
    let parts = files(path, &tables, FILES_OF_RECORDS)?;
    if parts.len() > 1 {
        objects.clear();
        sinks.clear();
        kept.clear();
        for part in parts {
            let tables = Hdf5Tables::open(&part, ReadMethod::default())?;
            if !push(&part, &tables, (&mut objects, &mut sinks), kept)? {
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
    let catalogue = Catalogue {
        path: path.into(),
        format: "hbt",
        length_unit: named(length, [(1.0, "a Mpc/h"), (1e-3, "a kpc/h")]),
        mass_unit: named(mass, [(1e10, "1e10 Msun/h"), (1.0, "Msun/h")]),
        box_size: None,
        left_out: 0,
        properties: kept.finished(objects.len()),
        objects,
        is_in_plane: false,
        tree: None,
    };
    Ok(Some((catalogue, sinks)))
}

/// Adds the subhaloes of a file, and where they have sunk; false where it has no records of any.
fn push(
    path: &Path,
    tables: &Hdf5Tables,
    (objects, sinks): (&mut Vec<Object>, &mut Vec<f64>),
    kept: &mut Kept,
) -> Result<bool, ExploreError> {
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
    let (track, sink, mass) = (member("TrackId", 1), member("SinkTrackId", 1), member("Mbound", 1));
    let radius = ["RHalfComoving", "R200CritComoving", "RmaxComoving"].into_iter().find_map(|name| member(name, 1));
    let before = objects.len();
    let rows = place.len() / 3;
    if (before + rows) as u64 > MOST_OBJECTS {
        return Err(ExploreError::malformed(path, RECORDS, before + rows, format!("at most {MOST_OBJECTS}")));
    }
    if !kept.is_nothing() {
        let others = tables.names_of_members(RECORDS)?.into_iter();
        for name in others.filter(|name| !OF_OBJECTS.contains(&name.as_str())) {
            // Each is read with whole records, which may be long.
            if !kept.may_want(&name) {
                kept.place(&name, &Unit::default());
                continue;
            }
            let found = tables.members(RECORDS, &[name.as_str()], MOST_OBJECTS)?;
            let Some(column) = found.into_iter().flatten().flatten().next() else { continue };
            let places = kept.places((name.as_str(), FieldKind::Other), column.components, &column.unit);
            kept.check_room(path, before + rows)?;
            kept.put_vectors(&places, column.components, before, &column.values);
        }
    }
    let of = |column: Option<&Vec<f64>>, row: usize| column.and_then(|values| values.get(row)).copied();
    sinks.extend((0..rows).map(|row| of(sink, row).unwrap_or(-1.0)));
    objects.extend((0..rows).map(|row| Object {
        name: of(track, row).map_or_else(|| format!("Subhalo {}", before + row), |track| format!("Track {track}")),
        position: DVec3::from_slice(&place[3 * row..3 * row + 3]),
        radius: of(radius, row),
        mass: of(mass, row),
    }));
    Ok(true)
}
