//! What a command reads, over which it does not write.

use crate::heights::import::PhotoChoice;
use crate::look::{Member, SceneFile, is_scene_file};
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
