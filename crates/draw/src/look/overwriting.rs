//! Nothing is written over what it is made of: what is made of a snapshot, a catalogue or a list of ids holds less than they do.

use super::DataKind;
use crate::heights::store::HeightFile;
use crate::import::{file_of_step, files_of, find_source, sources_of};
use crate::model::{ReadMethod, is_url};
use crate::store::{GridFile, PageFile, RunFile, StoreError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The sources that a built file was made of, as far as they are still there: commands read them for what the file does not hold, such as ids.
///
/// # Errors
/// [`StoreError`] where the file cannot be read.
fn made_of(built: &Path) -> Result<Vec<PathBuf>, StoreError> {
    // Reading a pipe would take from it.
    if is_url(built) || !built.is_file() {
        return Ok(Vec::new());
    }
    let method = ReadMethod::default();
    let named = match DataKind::of(built) {
        Ok(DataKind::Pages) => {
            let file = PageFile::open(built)?;
            let source = &file.metadata().provenance;
            vec![(source.path.clone(), source.bytes)]
        }
        Ok(DataKind::Run) => {
            let run = RunFile::open(built, method)?;
            run.directory().steps.iter().map(|step| (step.source.clone(), step.source_bytes)).collect()
        }
        Ok(DataKind::Grid) => {
            let file = GridFile::open(built, method)?;
            vec![(file.about().source.clone(), file.about().source_bytes)]
        }
        Ok(DataKind::Heights) => {
            let file = HeightFile::open(built, method)?;
            vec![(file.about().source.clone(), file.about().source_bytes)]
        }
        Ok(DataKind::Source) | Err(_) => Vec::new(),
    };
    Ok(named.into_iter().filter_map(|(named, bytes)| find_source(&named, built, bytes)).collect())
}

/// Whether `written` is there already and is one of the files that the names `read` stand for, or of those that these were built from.
pub fn is_file_of(written: &Path, read: &[PathBuf]) -> bool {
    file_among([written], read).is_some()
}

/// The first of the files `written` of which [`is_file_of`] holds, in the order of what is read.
pub fn file_among<'a>(written: impl IntoIterator<Item = &'a Path>, read: &[PathBuf]) -> Option<&'a Path> {
    // What is not there cannot be lost, `-` is standard output, and from a pipe or a terminal nothing is read here.
    let names = written.into_iter().filter(|name| *name != Path::new("-"));
    let mut places: BTreeMap<PathBuf, &'a Path> =
        names.filter_map(|name| Some((name.canonicalize().ok().filter(|place| place.is_file())?, name))).collect();
    if places.is_empty() {
        return None;
    }
    let named = read.iter().find_map(|path| found_in(&places, file_of_step(path)));
    if named.is_some() {
        return named;
    }
    // Files of a folder, a pattern or a list, and the others of a snapshot in several. Built files are none of these, and are replaced by what
    // is built again.
    places.retain(|place, _| matches!(DataKind::of(place), Ok(DataKind::Source)));
    let folders: BTreeSet<PathBuf> = places.keys().filter_map(|place| place.parent()).map(Path::to_owned).collect();
    if folders.is_empty() {
        return None;
    }
    let named = read.iter().flat_map(|path| sources_of(std::slice::from_ref(path)).unwrap_or_default());
    // To ask what belongs to a compressed file is to unpack it, which nobody else does to whom its name says enough.
    let is_packed = |source: &Path| source.extension().is_some_and(|ending| ending == "gz" || ending == "zst");
    let built = read.iter().flat_map(|path| made_of(path).unwrap_or_default());
    let of_built = built.map(|source| (!is_packed(file_of_step(&source)), source));
    let sources = named.map(|source| (true, source)).chain(of_built);
    let mut near = sources.filter(|(_, source)| is_near(file_of_step(source), &folders));
    near.find_map(|(asks, source)| {
        let others = || if asks { files_of(&source).unwrap_or_default() } else { Vec::new() };
        found_in(&places, file_of_step(&source)).or_else(|| others().iter().find_map(|file| found_in(&places, file)))
    })
}

/// The name of a file among those of `places`.
fn found_in<'a>(places: &BTreeMap<PathBuf, &'a Path>, file: &Path) -> Option<&'a Path> {
    places.get(&file.canonicalize().ok()?).copied()
}

/// Whether one of `folders` is where the files of a source are: its folder, or one below.
fn is_near(source: &Path, folders: &BTreeSet<PathBuf>) -> bool {
    let source = source.canonicalize().unwrap_or_default();
    let own = if source.is_dir() { Some(&*source) } else { source.parent() };
    own.is_some_and(|own| folders.iter().any(|folder| folder.starts_with(own)))
}
