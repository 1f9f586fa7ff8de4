//! A folder of pictures of the same size: the slices of a volume, in the order of their names.

use super::content::{Content, in_one_line};
use super::layout::{INTERLEAVED, Layout, NATIVE};
use super::scratch::Scratch;
use super::source::checked;
use super::{GridDescription, GridFormat, GridOptions, GridSource, exr, open_grid, picture, tiff};
use crate::import::ImportError;
use crate::model::{Grid, ReadMethod};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// The format's name in messages.
pub(super) const NAME: &str = "slices";

/// The formats of slices.
static PICTURES: &[&GridFormat] = &[&picture::PNG, &picture::JPEG, &tiff::TIFF, &exr::EXR];

/// How much of a file shows what it is, bytes.
const GLANCE: u64 = 16;

/// How many names a note or message lists.
const LISTED: usize = 5;

/// What is in a folder, but for hidden files: pictures by their names, and other files.
struct Folder {
    pictures: Vec<PathBuf>,
    others: Vec<PathBuf>,
}

impl Folder {
    fn read(path: &Path) -> Result<Folder, ImportError> {
        let io = |source| ImportError::io(path, "folder", source);
        let mut folder = Folder { pictures: Vec::new(), others: Vec::new() };
        for entry in std::fs::read_dir(path).map_err(io)? {
            let path = entry.map_err(io)?.path();
            let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
            // Pipes are not opened: nobody may be at their other end.
            if is_hidden || !path.is_file() {
                continue;
            }
            let content = Content::glance(&path, ReadMethod::Positioned, GLANCE);
            let is_picture = content.is_ok_and(|content| PICTURES.iter().any(|format| (format.detect)(&content)));
            if is_picture { folder.pictures.push(path) } else { folder.others.push(path) }
        }
        folder.pictures.sort_by(|a, b| by_name(&name_of(a), &name_of(b)));
        folder.others.sort();
        Ok(folder)
    }

    /// Several pictures, and fewer other files.
    fn is_stack(&self) -> bool {
        self.pictures.len() > 1 && self.pictures.len() > self.others.len()
    }
}

/// Whether a folder looks like one of slices: what else is in it is not asked.
///
/// # Errors
/// When it cannot be read.
pub(in crate::import) fn is_stack(path: &Path) -> Result<bool, ImportError> {
    Ok(Folder::read(path)?.is_stack())
}

/// The slices in a folder, in their order.
///
/// # Errors
/// When it cannot be read.
pub(super) fn pictures_in(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    Ok(Folder::read(path)?.pictures)
}

/// Opens the slices in a folder as a volume.
///
/// # Errors
/// Where there are not several, one cannot be read, or is unlike the first.
pub(super) fn open(path: &Path, options: &GridOptions) -> Result<GridSource, ImportError> {
    let folder = Folder::read(path)?;
    if !folder.is_stack() {
        let found = format!("{} pictures and {} other files", folder.pictures.len(), folder.others.len());
        return Err(ImportError::malformed(
            path,
            "folder",
            found,
            "several PNG, JPEG, TIFF or EXR pictures of one size",
        ));
    }
    let options = GridOptions { raw: None, ..options.clone() };
    let mut scratch = Scratch::new(path);
    let mut bytes = 0;
    let mut first: Option<Grid> = None;
    let mut buffer = Vec::new();
    for slice in &folder.pictures {
        let source = open_grid(slice, &options)?;
        let grid = source.grid();
        let like = first.get_or_insert_with(|| grid.clone());
        check(slice, grid, like, &folder.pictures)?;
        buffer.resize(usize::try_from(grid.bytes().unwrap_or(u64::MAX)).unwrap_or(usize::MAX), 0);
        source.read(&grid.region(), &mut buffer)?;
        scratch.write(&buffer)?;
        bytes += source.description().bytes;
    }
    let missing = || ImportError::missing(path, "folder", "pictures");
    let Grid { shape: [width, height, _], sample_type, channels, .. } = first.ok_or_else(missing)?;
    let grid = Grid::volume([width, height, folder.pictures.len() as u64], sample_type, channels);
    checked(path, &grid, "folder", "folder")?;
    let layout = Layout::packed(&grid, INTERLEAVED, 0, NATIVE);
    let mut about = GridDescription::new(path, NAME, bytes, grid);
    about.files = folder.pictures.len();
    let ends = [folder.pictures.first(), folder.pictures.last()]
        .map(|path| path.map(|path| name_of(path)).unwrap_or_default());
    about.notes.push(format!("slices in the order of their names, from {} to {}", ends[0], ends[1]));
    if !folder.others.is_empty() {
        let names: Vec<String> = folder.others.iter().take(LISTED).map(|path| name_of(path)).collect();
        let more = folder.others.len().saturating_sub(LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        about.notes.push(format!("other files are left out: {}{more}", names.join(", ")));
    }
    Ok(GridSource::new(about, scratch.into_storage()?, layout))
}

/// Whether a slice is an image like the first one.
fn check(path: &Path, grid: &Grid, first: &Grid, all: &[PathBuf]) -> Result<(), ImportError> {
    let sizes =
        |grid: &Grid| grid.shape[..grid.dimensions.min(3)].iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
    let unlike = |found: String, expected: String| {
        let first = all.first().map(|path| name_of(path)).unwrap_or_default();
        Err(ImportError::Unlike { path: path.into(), found, expected: format!("{expected} as {first}") })
    };
    let is_same = (grid.sample_type, grid.channels.len()) == (first.sample_type, first.channels.len());
    match () {
        () if first.dimensions != 2 || grid.dimensions != 2 => {
            let found = format!("a volume of {}", sizes(grid));
            Err(ImportError::Unlike { path: path.into(), found, expected: "an image, as slices are".into() })
        }
        () if grid.shape != first.shape => unlike(sizes(grid), sizes(first)),
        () if !is_same => unlike(grid.described(), first.described()),
        () => Ok(()),
    }
}

fn name_of(path: &Path) -> String {
    in_one_line(&path.file_name().unwrap_or_default().to_string_lossy())
}

/// Names as people order them: numbers in them by their value, `slice9` before `slice10`.
fn by_name(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    loop {
        let [digits, others] = [left, right].map(|text| text.iter().take_while(|byte| byte.is_ascii_digit()).count());
        if digits > 0 && others > 0 {
            let (number, other) = (without_zeros(&left[..digits]), without_zeros(&right[..others]));
            let order = number.len().cmp(&other.len()).then_with(|| number.cmp(other));
            if order.is_ne() {
                return order;
            }
            (left, right) = (&left[digits..], &right[others..]);
            continue;
        }
        match (left.split_first(), right.split_first()) {
            (Some((one, rest)), Some((other, others))) if one == other => (left, right) = (rest, others),
            (Some((one, _)), Some((other, _))) => return one.cmp(other),
            // `a01` and `a1` are different files.
            (None, None) => return a.cmp(b),
            (one, _) => return if one.is_none() { Ordering::Less } else { Ordering::Greater },
        }
    }
}

fn without_zeros(digits: &[u8]) -> &[u8] {
    &digits[digits.iter().take_while(|digit| **digit == b'0').count()..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_are_ordered_by_value() {
        let mut names = vec!["s10.png", "s9.png", "s009b.png", "s1.png", "s01.png", "t.png", "s", "S2.png"];
        names.sort_by(|a, b| by_name(a, b));
        assert_eq!(names, ["S2.png", "s", "s01.png", "s1.png", "s9.png", "s009b.png", "s10.png", "t.png"]);
    }
}
