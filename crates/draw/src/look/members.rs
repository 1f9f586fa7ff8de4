//! The datasets of a scene, opened as one.

use crate::import::{ImportError, file_in};
use crate::model::{FamilyName, Placement, ReadMethod, Unit};
use crate::store::{PageFile, StoreError};
use glam::DVec3;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A dataset to be shown, alone or with others.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Member {
    /// The source or page file.
    pub path: PathBuf,
    /// Where its origin lies in the scene.
    pub offset: DVec3,
    /// Scene lengths for one of its own; what the units say, where they say it, and else 1, where it is `None`.
    pub scale: Option<f64>,
    /// The families that are drawn; all where it is `None`.
    pub families: Option<Vec<FamilyName>>,
}

impl Member {
    /// A whole dataset where it is.
    pub fn new(path: impl Into<PathBuf>) -> Member {
        Member { path: path.into(), ..Member::default() }
    }

    /// Where it lies: its own unit of lengths and of masses are given, and those of the scene.
    pub fn placement(&self, (length, mass): (&Unit, &Unit), scene: (&Unit, &Unit)) -> Placement {
        let scale = self.scale.or_else(|| length.ratio(scene.0)).unwrap_or(1.0);
        let mass = mass.ratio(scene.1).unwrap_or(1.0);
        // A ratio of units that are the same may differ from 1 by rounding.
        let exact = |factor: f64| if (factor - 1.0).abs() < 1e-12 { 1.0 } else { factor };
        Placement { offset: self.offset, scale: exact(scale), mass: exact(mass) }
    }

    /// The same with the file that is meant in place of a folder.
    ///
    /// # Errors
    /// As [`data_file`].
    pub fn resolved(&self) -> Result<Member, ImportError> {
        Ok(Member { path: data_file(&self.path)?, ..self.clone() })
    }
}

/// The source, page file or other file that a user means who names `path`: of a folder, the one source or page file in it.
///
/// # Errors
/// [`ImportError`] with a list of what is there, where a folder holds none or several. Whether `path` exists is not asked.
pub fn data_file(path: &Path) -> Result<PathBuf, ImportError> {
    file_in(path, &[("page file", PageFile::recognises)])
}

/// Whether the file at `path` is a page file, by its first bytes.
///
/// # Errors
/// When the file cannot be read; the message names it.
pub fn is_page_file(path: &Path) -> Result<bool, std::io::Error> {
    let name = |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let mut head = Vec::with_capacity(16);
    std::fs::File::open(path).map_err(name)?.take(16).read_to_end(&mut head).map_err(name)?;
    Ok(PageFile::recognises(&head))
}

/// `FILE`, `FILE@X,Y,Z` or `FILE@X,Y,Z*SCALE`, as the command line has it.
impl FromStr for Member {
    type Err = String;

    fn from_str(text: &str) -> Result<Member, String> {
        let Some((path, place)) = text.rsplit_once('@') else { return Ok(Member::new(text)) };
        let (offset, scale) = place.split_once('*').map_or((place, None), |(offset, scale)| (offset, Some(scale)));
        let numbers: Option<Vec<f64>> = offset.split(',').map(|number| number.trim().parse().ok()).collect();
        match (numbers.as_deref(), scale.map(|scale| scale.trim().parse::<f64>())) {
            (Some(&[x, y, z]), scale @ (None | Some(Ok(_)))) => {
                let (offset, scale) = (DVec3::new(x, y, z), scale.and_then(Result::ok));
                if !offset.is_finite() || scale.is_some_and(|scale| !(scale > 0.0 && scale.is_finite())) {
                    return Err(format!("{place}: expected finite coordinates and a positive scale"));
                }
                Ok(Member { offset, scale, ..Member::new(path) })
            }
            // A name may well contain the sign.
            _ if Path::new(text).exists() => Ok(Member::new(text)),
            _ => Err(format!("{place}: expected FILE@X,Y,Z or FILE@X,Y,Z*SCALE")),
        }
    }
}

/// Opens the datasets as one scene in the units of the first; `page_file` turns what a user names into a page file,
/// which is read in the way `read`. Also says what does not fit together, a sentence each.
///
/// # Errors
/// [`StoreError`] and the errors of `page_file`.
pub fn open_members<E: From<StoreError>>(
    members: &[Member],
    read: ReadMethod,
    mut page_file: impl FnMut(&Path) -> Result<PathBuf, E>,
) -> Result<(PageFile, Vec<String>), E> {
    let mut files: Vec<PageFile> = Vec::with_capacity(members.len());
    for member in members {
        files.push(PageFile::open_with(&page_file(&member.path)?, read)?);
    }
    let units = |file: &PageFile| (file.metadata().length_unit.clone(), file.metadata().mass_unit.clone());
    let scene = files.first().map(units).unwrap_or_default();
    let placed = files.into_iter().zip(members).map(|(file, member)| {
        let (length, mass) = units(&file);
        (file, member.placement((&length, &mass), (&scene.0, &scene.1)))
    });
    Ok(PageFile::join(placed.collect())?)
}

/// Whether each family of the scene is drawn, as its members say; and what they name that is not there.
pub fn shown_families(file: &PageFile, members: &[Member]) -> (Vec<bool>, Vec<FamilyName>) {
    let families = &file.metadata().families;
    let mut shown = vec![true; families.len()];
    let mut missing = Vec::new();
    for (part, member) in file.parts().zip(members) {
        let Some(names) = &member.families else { continue };
        let own = &families[part.families.clone()];
        for (shown, family) in shown[part.families.clone()].iter_mut().zip(own) {
            *shown = names.contains(&family.name);
        }
        missing.extend(names.iter().filter(|name| own.iter().all(|family| family.name != **name)));
    }
    (shown, missing)
}
