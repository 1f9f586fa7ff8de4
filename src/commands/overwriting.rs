//! No command writes over what it reads: what it makes of a snapshot, a catalogue or a list of ids holds less than they do.

use crate::heights::import::PhotoChoice;
use crate::heights::store::HeightFile;
use crate::import::{file_of_step, files_of, find_source, sources_of};
use crate::look::{DataKind, Member, SceneFile, is_scene_file};
use crate::model::{ReadMethod, is_url};
use crate::store::{GridFile, PageFile, RunFile, StoreError};
use crate::tour::TourFile;
use clap::ArgMatches;
use std::path::{Path, PathBuf};

/// Names, in all commands, of the arguments that are a file and what is named in it, such as `groups.hdf5#0`.
const PARTS_OF_FILES: [&str; 2] = ["at", "selection"];

/// The files and folders that a command is to read: those that are named but for the arguments called `written`, and those that scenes and
/// tours among them name.
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
        // Reading a pipe would take from it.
        let texts = files.iter().filter(|file| (id == "tour" || is_scene_file(file)) && file.is_file());
        let within: Vec<PathBuf> = texts.flat_map(|file| named_within(file)).collect();
        files.extend(within);
        files
    })
    .collect()
}

/// The files that a scene or a tour names; none where it is neither or cannot be read, which is told where it is opened.
fn named_within(path: &Path) -> Vec<PathBuf> {
    let of_scene = SceneFile::read(path).map(|scene| scene.files(path));
    of_scene.or_else(|_| TourFile::read(path).map(|tour| tour.files(path))).unwrap_or_default()
}

/// The values of an argument, none where it is of another type.
fn of_type<'a, T: Clone + Send + Sync + 'static>(matches: &'a ArgMatches, id: &str) -> impl Iterator<Item = &'a T> {
    matches.try_get_many::<T>(id).ok().flatten().into_iter().flatten()
}

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
    let named = read.iter().flat_map(|path| sources_of(std::slice::from_ref(path)).unwrap_or_default());
    // To ask what belongs to a compressed file is to unpack it, which nobody else does to whom its name says enough.
    let is_packed = |source: &Path| source.extension().is_some_and(|ending| ending == "gz" || ending == "zst");
    let built = read.iter().flat_map(|path| made_of(path).unwrap_or_default());
    let of_built = built.map(|source| (!is_packed(file_of_step(&source)), source));
    let sources = named.map(|source| (true, source)).chain(of_built);
    sources.filter(|(_, source)| is_near(file_of_step(source), &place)).any(|(asks, source)| {
        is_it(file_of_step(&source)) || asks && files_of(&source).unwrap_or_default().iter().any(|file| is_it(file))
    })
}

/// Whether `place` is where the files of a source are: in its folder, or below.
fn is_near(source: &Path, place: &Path) -> bool {
    let source = source.canonicalize().unwrap_or_default();
    let folder = if source.is_dir() { Some(&*source) } else { source.parent() };
    folder.is_some_and(|folder| place.starts_with(folder))
}
