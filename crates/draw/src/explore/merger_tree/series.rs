//! What readers of files of one step each have in common: which lie beside one, their haloes in one list, and where a halo of a number is.

use super::{Halo, MOST_HALOES, Read, TreeStep};
use crate::explore::ExploreError;
use crate::explore::catalogue::Object;
use crate::model::Unit;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// All files beside one that have a number, by number: in its folder, or, where that `is_of_one` step by its name, in the folders beside it.
pub(super) fn beside(
    path: &Path,
    number_of: impl Fn(&Path) -> Option<u64>,
    is_of_one: impl Fn(&str) -> bool,
) -> Vec<(u64, PathBuf)> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let here = |path: &Path| if path.as_os_str().is_empty() { PathBuf::from(".") } else { path.to_owned() };
    let entries = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(here(folder)).into_iter().flatten();
        entries.filter_map(|entry| Some(entry.ok()?.path())).collect()
    };
    let folders = match folder.file_name().and_then(|name| name.to_str()).is_some_and(is_of_one) {
        true => entries(folder.parent().unwrap_or(Path::new(""))),
        false => vec![here(folder)],
    };
    let folders = folders.into_iter().filter(|folder| folder.is_dir());
    let mut files: Vec<(u64, PathBuf)> =
        folders.flat_map(|folder| entries(&folder)).filter_map(|file| Some((number_of(&file)?, file))).collect();
    files.sort();
    files
}

/// Haloes by their numbers, and where they are among all.
#[derive(Default)]
pub(super) struct Places(Vec<(u64, u32)>);

impl Places {
    /// Of the haloes in `own`, which are in a file.
    ///
    /// # Errors
    /// Where two have the same number.
    pub fn of(path: &Path, haloes: &[Halo], own: Range<usize>) -> Result<Places, ExploreError> {
        let mut places: Vec<(u64, u32)> = own.map(|place| (haloes[place].id, place as u32)).collect();
        places.sort_unstable();
        match places.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            Some(pair) => Err(ExploreError::malformed(path, "id", pair[0].0, "a number that no other halo has")),
            None => Ok(Places(places)),
        }
    }

    /// Where the halo of a number is.
    pub fn find(&self, id: u64) -> Option<usize> {
        let at = self.0.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        Some(self.0[at].1 as usize)
    }
}

impl Read {
    /// Nothing so far, of a file or of those of which it is one.
    pub(super) fn new(path: &Path, format: &'static str) -> Read {
        Read {
            path: path.into(),
            format,
            length_unit: Unit::default(),
            mass_unit: Unit::default(),
            box_size: None,
            own: None,
            steps: Vec::new(),
            haloes: Vec::new(),
        }
    }

    /// Adds a step, later than all others, with the objects of a file, each called by `word` and its number; says where among all they are.
    ///
    /// # Errors
    /// Where one has another name, or there are too many.
    pub(super) fn push(
        &mut self,
        file: &Path,
        (number, time): (u64, f64),
        word: &str,
        objects: Vec<Object>,
    ) -> Result<Range<usize>, ExploreError> {
        let first = self.haloes.len();
        if (first + objects.len()) as u64 > MOST_HALOES {
            let expected = format!("at most {MOST_HALOES} haloes at all steps together");
            return Err(ExploreError::malformed(file, "haloes", format!("{} and more", objects.len()), expected));
        }
        for Object { name, position, radius, mass } in objects {
            let id = name.strip_prefix(word).and_then(|number| number.trim_start().parse().ok());
            let id =
                id.ok_or_else(|| ExploreError::malformed(file, "id", &name, format!("{word} and a whole number")))?;
            self.haloes.push(Halo { id, name: None, position, radius, mass, descendant: None });
        }
        let haloes = first..self.haloes.len();
        // Early steps without a halo are none of the tree.
        if !haloes.is_empty() {
            self.steps.push(TreeStep { number, time, redshift: Some(1.0 / time - 1.0), haloes: haloes.clone() });
        }
        Ok(haloes)
    }
}
