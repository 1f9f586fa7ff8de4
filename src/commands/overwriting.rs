//! No command writes over what it reads: what it makes of a snapshot, a catalogue or a list of ids holds less than they do.

use crate::heights::import::PhotoChoice;
use crate::import::{file_of_step, files_of, sources_of};
use crate::look::{DataKind, Member};
use clap::ArgMatches;
use std::path::{Path, PathBuf};

/// Names, in all commands, of the arguments that are a file and what is named in it, such as `groups.hdf5#0`.
const PARTS_OF_FILES: [&str; 2] = ["at", "selection"];

/// The files and folders that a command is to read: those that are named but for the arguments called `written`.
pub(super) fn named_to_read(matches: &ArgMatches, written: &[&str]) -> Vec<PathBuf> {
    let ids = matches.ids().map(clap::Id::as_str).filter(|id| !written.contains(id));
    ids.flat_map(|id| {
        let mut files: Vec<PathBuf> = of_type::<PathBuf>(matches, id).cloned().collect();
        files.extend(of_type::<Member>(matches, id).map(|member| member.path.clone()));
        files.extend(of_type::<PhotoChoice>(matches, id).map(|photo| photo.path.clone()));
        if PARTS_OF_FILES.contains(&id) {
            let named = of_type::<String>(matches, id).filter_map(|named| named.rsplit_once('#'));
            files.extend(named.map(|(file, _)| PathBuf::from(file)));
        }
        files
    })
    .collect()
}

/// The values of an argument, none where it is of another type.
fn of_type<'a, T: Clone + Send + Sync + 'static>(matches: &'a ArgMatches, id: &str) -> impl Iterator<Item = &'a T> {
    matches.try_get_many::<T>(id).ok().flatten().into_iter().flatten()
}

/// Whether `written` is there already and is one of the files that the names `read` stand for.
pub(super) fn is_one_of(written: &Path, read: &[PathBuf]) -> bool {
    // What is not there cannot be lost, `-` is standard output, and from a pipe or a terminal nothing is read here.
    let place = written.canonicalize().ok().filter(|place| place.is_file() && written != Path::new("-"));
    let Some(place) = place else { return false };
    let is_it = |file: &Path| file.canonicalize().is_ok_and(|file| file == place);
    if read.iter().any(|path| is_it(file_of_step(path))) {
        return true;
    }
    // Files of a folder, a pattern or a list, and the others of a snapshot in several. Built files are none of these, and are replaced by what
    // is built again.
    if !matches!(DataKind::of(&place), Ok(DataKind::Source)) {
        return false;
    }
    let sources = read.iter().flat_map(|path| sources_of(std::slice::from_ref(path)).unwrap_or_default());
    sources
        .filter(|source| is_near(source, &place))
        .any(|source| is_it(&source) || files_of(&source).unwrap_or_default().iter().any(|file| is_it(file)))
}

/// Whether `place` is where the files of a source are: in its folder, or below.
fn is_near(source: &Path, place: &Path) -> bool {
    let source = source.canonicalize().unwrap_or_default();
    let folder = if source.is_dir() { Some(&*source) } else { source.parent() };
    folder.is_some_and(|folder| place.starts_with(folder))
}
