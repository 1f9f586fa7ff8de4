//! Where the source lies that a file was built from: built files have its name as it was given, and are read from other folders, and moved.

use super::file_of_step;
use std::path::{Path, PathBuf};

/// The source `named`, of `bytes`, of which the file at `built` was made: under that name, from here or, where it is relative, from the folder
/// of `built` or one above it, where builds are begun; or the file of its own name beside `built`. The first that has that size, else the first of
/// that name but for the one beside. `None` where there is none of these.
pub fn find_source(named: &Path, built: &Path, bytes: u64) -> Option<PathBuf> {
    let is_there = |path: &Path| {
        let file = file_of_step(path);
        file.is_file() || file.is_dir()
    };
    let Some(name) = named.file_name() else { return Some(named.to_owned()).filter(|named| is_there(named)) };
    let built = std::path::absolute(built).ok()?;
    let folder = built.parent()?;
    let above = folder.ancestors().filter(|_| named.is_relative()).map(|folder| folder.join(named));
    let all: Vec<PathBuf> = std::iter::once(named.to_owned()).chain(above).collect();
    // Of another folder: many runs call their files alike.
    let has_size = |path: &PathBuf| {
        let about = file_of_step(path).metadata();
        about.is_ok_and(|about| about.is_file() && about.len() == bytes)
    };
    let beside = || Some(folder.join(name)).filter(has_size);
    // Of a source in several files none has the size of all.
    let other = || all.iter().find(|path| is_there(path)).cloned();
    all.iter().find(|path| has_size(path)).cloned().or_else(beside).or_else(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_found_from_any_folder_and_beside_what_was_made_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["in/deep", "out", "elsewhere"] {
            std::fs::create_dir_all(at(name)).unwrap();
        }
        std::fs::write(at("in/deep/snap.csv"), "12345").unwrap();
        let whole = at("in/deep/snap.csv");
        assert_eq!(find_source(&whole, &at("out/a.df"), 5), Some(whole.clone()));
        // Built in the folder above both, as `build in/deep/snap.csv -o out/a.df`, or beside the source.
        assert_eq!(find_source(Path::new("in/deep/snap.csv"), &at("out/a.df"), 5), Some(whole.clone()));
        assert_eq!(find_source(Path::new("snap.csv"), &at("in/deep/a.df"), 5), Some(whole.clone()));
        // Both were moved to one folder; a file of another size is another one.
        std::fs::rename(&whole, at("elsewhere/snap.csv")).unwrap();
        let moved = at("elsewhere/a.df");
        assert_eq!(find_source(&whole, &moved, 5), Some(at("elsewhere/snap.csv")));
        assert_eq!(find_source(&whole, &moved, 6), None);
        assert_eq!(find_source(Path::new("in/deep/snap.csv"), &at("out/a.df"), 5), None);
        assert_eq!(find_source(Path::new(""), &moved, 5), None);
        // One of its size goes before another of its name.
        std::fs::write(&whole, "another").unwrap();
        std::fs::write(at("out/snap.csv"), "12345").unwrap();
        let [named, built] = [Path::new("in/deep/snap.csv"), &at("out/a.df")];
        assert_eq!(find_source(named, built, 5), Some(at("out/snap.csv")));
        assert_eq!(find_source(named, built, 6), Some(whole));
    }
}
