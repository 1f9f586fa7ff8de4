//! A folder in the place of a file: which file of it is meant.

use super::format::{Head, files_of_opened, format_of, open_file};
use super::grid::is_stack;
use super::table::{catalogue_in, same_columns};
use super::{Description, ImportError};
use crate::model::ReadMethod;
use crate::model::url::{is_url, refused, shown};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// A kind of file that may be meant beside the sources: its name in messages, and whether a file that begins with these bytes is
/// one.
pub type OtherKind = (&'static str, fn(&[u8]) -> bool);

/// How many entries of a folder a message lists.
const LISTED: usize = 12;

/// Files that tell of Parquet files beside them.
const ABOUT_PARTS: [&str; 2] = ["_metadata", "_common_metadata"];

/// How many files are opened to find that out.
const TRIED: usize = 64;

/// The file that is meant by `path`: itself unless it is a folder, or where the folder is one of slices or of the parts of one table; else a
/// file of the one source in the folder, which may be a snapshot in several files, or the one file of another kind. Links are followed; hidden files and the folders inside are not
/// looked into, and files that belong to nothing that can be opened do not count.
///
/// # Errors
/// [`ImportError`] with a list of what is there, where it is no or more than one source; where nothing in it can be opened that
/// claims to be a source, what is wrong with the first such file; of a URL, that sources are not read from there. Whether `path` exists is not asked.
pub fn file_in(path: &Path, others: &[OtherKind]) -> Result<PathBuf, ImportError> {
    if is_url(path) {
        return Err(ImportError::io(&shown(path), "open", refused("a file or folder")));
    }
    if !path.is_dir() {
        return Ok(path.into());
    }
    if let Some(file) = whole(path) {
        return Ok(file);
    }
    let (mut claimants, names) = look_into(path, others)?;
    if are_slices(path, &claimants)? || are_parts(&claimants) {
        return Ok(path.into());
    }
    if claimants.len() <= 1 {
        let unlike = || ImportError::malformed(path, "folder", listed(&names, names.len()), "one source in it");
        return claimants.pop().map(|claimant| claimant.path).ok_or_else(unlike);
    }
    let mut found: Vec<(PathBuf, String)> = Vec::new();
    let (mut first_error, mut tried) = (None, 0);
    while found.len() < LISTED && tried < TRIED && !claimants.is_empty() {
        tried += 1;
        let claimant = claimants.remove(0);
        if let Some(kind) = claimant.other {
            let text = format!("{} ({kind})", name_of(&claimant.path));
            found.push((claimant.path, text));
            continue;
        }
        match open_file(&claimant.path, ReadMethod::Positioned) {
            Ok(source) => {
                let about = source.description();
                let files = files_of_opened(about)?;
                claimants.retain(|other| !files.contains(&other.path));
                // A file without particles of its own stands for others, which may have been found before.
                if !found.iter().any(|(path, _)| files.contains(path)) {
                    found.push((claimant.path, described(about)));
                }
            }
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    match (found.as_slice(), first_error) {
        ([(path, _)], _) if claimants.is_empty() => Ok(path.clone()),
        ([], Some(error)) => Err(error),
        _ => {
            let texts: Vec<String> = found.into_iter().map(|(_, text)| text).collect();
            let expected = "one source in it; name one of these files, or build a run of them";
            Err(ImportError::malformed(path, "folder", listed(&texts, texts.len() + claimants.len()), expected))
        }
    }
}

/// A file of the source that a folder is as a whole, as some codes write them, whatever else lies in it; the folder itself where it is one of
/// partitions, and of several catalogues the primary one.
pub(super) fn whole(folder: &Path) -> Option<PathBuf> {
    let file = super::ramses::info_in(folder).or_else(|| super::nchilada::field_in(folder));
    file.or_else(|| catalogue_in(folder))
}

/// Whether a folder is one of slices of a volume: of pictures, beside which lies nothing that can be opened. Pictures of a snapshot beside it are
/// none.
///
/// # Errors
/// When the folder cannot be read.
pub(super) fn is_of_slices(folder: &Path) -> Result<bool, ImportError> {
    are_slices(folder, &look_into(folder, &[])?.0)
}

fn are_slices(folder: &Path, claimants: &[Claimant]) -> Result<bool, ImportError> {
    let is_data =
        |claimant: &Claimant| claimant.other.is_some() || open_file(&claimant.path, ReadMethod::Positioned).is_ok();
    Ok(is_stack(folder)? && !claimants.iter().take(TRIED).any(is_data))
}

/// Whether a path is a folder of which all that can be opened are parts of one table.
///
/// # Errors
/// When the folder cannot be read.
pub fn is_one_table(path: &Path) -> Result<bool, ImportError> {
    Ok(path.is_dir() && whole(path).is_none() && are_parts(&look_into(path, &[])?.0))
}

fn are_parts(claimants: &[Claimant]) -> bool {
    let files: Vec<PathBuf> = claimants.iter().map(|claimant| claimant.path.clone()).collect();
    claimants.iter().all(|claimant| claimant.other.is_none()) && same_columns(&files)
}

/// A file that claims to be a source, or the kind of file that it is instead.
struct Claimant {
    path: PathBuf,
    other: Option<&'static str>,
}

/// The files of a folder that claim to be sources, by their first bytes.
///
/// # Errors
/// When the folder cannot be read.
pub(super) fn claimants(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    Ok(look_into(folder, &[])?.0.into_iter().map(|claimant| claimant.path).collect())
}

/// The files of a folder that claim to be sources or of the other kinds, in the order of their names; and the names of all that
/// is there.
fn look_into(folder: &Path, others: &[OtherKind]) -> Result<(Vec<Claimant>, Vec<String>), ImportError> {
    let io = |source| ImportError::io(folder, "folder", source);
    let mut entries: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        entries.push(entry.map_err(io)?.path());
    }
    // What is said of Parquet files beside them holds no rows.
    let is_beside =
        |name: &OsStr| name.as_encoded_bytes().starts_with(b".") || ABOUT_PARTS.iter().any(|about| name == *about);
    entries.retain(|path| !path.file_name().is_some_and(is_beside));
    entries.sort();
    let mut claimants = Vec::new();
    let mut names = Vec::with_capacity(entries.len());
    for path in entries {
        // Pipes and devices are not opened: nobody may be at their other end.
        let is_file = path.is_file();
        names.push(name_of(&path) + if path.is_dir() { "/" } else { "" });
        let Some(head) = is_file.then(|| Head::read(&path).ok()).flatten() else { continue };
        let other = others.iter().find(|(_, recognises)| recognises(&head.bytes)).map(|(name, _)| *name);
        if other.is_some() || format_of(&head).is_some() {
            claimants.push(Claimant { path, other });
        }
    }
    Ok((claimants, names))
}

/// A source in the list of a message.
fn described(about: &Description) -> String {
    let files = if about.files > 1 { format!(" in {} files", about.files) } else { String::new() };
    let time = about.time.map(|time| format!(", time {}", time as f32)).unwrap_or_default();
    format!("{}{files} ({} particles{time})", name_of(&about.path), about.particles())
}

/// A file's name as it stands in a message of one line.
pub(super) fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.chars().map(|letter| if letter.is_control() { '?' } else { letter }).collect()
}

/// The first of `texts`, which are some of `total`.
pub(super) fn listed(texts: &[String], total: usize) -> String {
    let shown = texts.len().min(LISTED);
    let more = if total > shown { format!(" and {} more", total - shown) } else { String::new() };
    if shown == 0 { "nothing".into() } else { texts[..shown].join(", ") + &more }
}
