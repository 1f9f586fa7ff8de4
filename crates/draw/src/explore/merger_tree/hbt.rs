//! Tracks of HBT+ (Han et al. 2018) from step to step: `SubSnap_NNN.hdf5` or `SubSnap_NNN.0.hdf5`, ..., in one folder or in folders `NNN`. A subhalo has
//! the same `TrackId` at every step; where it has sunk into another (`SinkTrackId`), it is that one from then on.

use super::series::{Places, beside};
use super::{Read, whole};
use crate::explore::ExploreError;
use crate::explore::catalogue::halo_records::tracks;
use crate::import::Hdf5Tables;
use crate::model::ReadMethod;
use std::collections::HashMap;
use std::path::Path;

const CATALOGUE: &str = "SubSnap_";
/// Most tracks of which each has sunk into the next at one step.
const MOST_SUNK: usize = 64;

/// The number in the name of a catalogue, and what stands behind it.
fn number_of(path: &Path) -> Option<(u64, &str)> {
    let name = path.file_name()?.to_str()?.strip_prefix(CATALOGUE)?;
    let (number, rest) = name.split_at(name.find('.')?);
    Some((number.parse().ok()?, rest))
}

/// The catalogues of which the file is one; `None` where there is no other.
pub(super) fn series(path: &Path) -> Result<Option<Read>, ExploreError> {
    let Some((own, _)) = number_of(path) else { return Ok(None) };
    let number_of_first = |file: &Path| {
        let (number, rest) = number_of(file)?;
        matches!(rest, ".hdf5" | ".0.hdf5").then_some(number)
    };
    let mut files = beside(path, number_of_first, |name| name.bytes().all(|digit| digit.is_ascii_digit()));
    files.dedup_by_key(|(number, _)| *number);
    if files.len() < 2 {
        return Ok(None);
    }
    let mut read = Read { own: Some(own), ..Read::new(path, "hbt") };
    let mut before = 0..0;
    for (number, file) in files {
        let found = tracks(&file)?;
        let (catalogue, sinks) =
            found.ok_or_else(|| ExploreError::missing(&file, "Subhalos", "records of subhaloes"))?;
        (read.length_unit, read.mass_unit) = (catalogue.length_unit, catalogue.mass_unit);
        let mut sunk: HashMap<u64, u64> = HashMap::new();
        let mut objects = Vec::with_capacity(sinks.len());
        for (object, sink) in catalogue.objects.into_iter().zip(sinks) {
            let wrong = |sink: f64| {
                ExploreError::malformed(&file, format!("SinkTrackId of {}", object.name), sink, "-1, or a whole number")
            };
            let track: Option<u64> = object.name.strip_prefix("Track ").and_then(|track| track.parse().ok());
            match (whole(sink).map_err(wrong)?, track) {
                (Some(sink), Some(track)) => _ = sunk.insert(track, sink),
                _ => objects.push(object),
            }
        }
        let haloes = read.push(&file, (number, scale_factor(&file)?), "Track", objects)?;
        let places = Places::of(&file, &read.haloes, haloes.clone())?;
        for halo in &mut read.haloes[before] {
            let into = std::iter::successors(Some(halo.id), |track| sunk.get(track).copied());
            halo.descendant = into.take(MOST_SUNK).find_map(|track| places.find(track));
        }
        before = haloes;
    }
    Ok(Some(read))
}

/// The scale factor of a catalogue; of older versions in the root.
fn scale_factor(path: &Path) -> Result<f64, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    for group in ["Cosmology", ""] {
        let column = tables.column(group, "ScaleFactor", 64)?;
        let value = column.and_then(|column| column.values.first().copied());
        if let Some(value) = value.filter(|value| *value > 0.0 && value.is_finite()) {
            return Ok(value);
        }
    }
    Err(ExploreError::missing(path, "Cosmology/ScaleFactor", "a number above 0"))
}
