//! Snapshots in several files: their names, and ranges that run across them.

use super::ImportError;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The names of all files of the snapshot that `path` is one of: `x.0.hdf5`, `x.1.hdf5`, ... or `x.0`, `x.1`, ..., or `x.0.hdf5.gz`, ...
///
/// # Errors
/// [`ImportError`] when a file of several has no number in its name, or one of them is not there.
pub fn names(path: &Path, files: u64) -> Result<Vec<PathBuf>, ImportError> {
    if files <= 1 {
        return Ok(vec![path.into()]);
    }
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let Some((before, after)) = around_number(name) else {
        let expected = format!("NAME.N or NAME.N.EXTENSION, N from 0, for a snapshot in {files} files");
        return Err(ImportError::malformed(path, "file name", name, expected));
    };
    let mut names = Vec::new();
    for number in 0..files {
        let file = path.with_file_name(format!("{before}{number}{after}"));
        if !file.is_file() {
            let expected = format!("this file of a snapshot in {files} files");
            return Err(ImportError::missing(&file, format!("file {number}"), expected));
        }
        names.push(file);
    }
    if !names.iter().any(|file| file == path) {
        let expected = format!("a number below {files}, the number of files");
        return Err(ImportError::malformed(path, "file name", name, expected));
    }
    Ok(names)
}

/// What stands before and after the file's number in a name.
fn around_number(name: &str) -> Option<(String, String)> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let parts: Vec<&str> = name.split('.').collect();
    // The last part but one of NAME.N.EXTENSION, else the last of NAME.N, else of a compressed file the one before both of its endings.
    let place = [2, 1, 3].into_iter().filter_map(|from_end| parts.len().checked_sub(from_end));
    let place = place.into_iter().find(|place| *place > 0 && is_number(parts[*place]))?;
    let before = parts[..place].join(".") + ".";
    let after = parts[place + 1..].iter().map(|part| format!(".{part}")).collect();
    Some((before, after))
}

/// Calls `read(file, rows, at)` for every file that holds a part of `range`: the rows of that file, and where the part
/// begins in the range. `counts` are the files' numbers of rows.
pub(super) fn pieces(
    counts: impl Iterator<Item = u64>,
    range: Range<u64>,
    mut read: impl FnMut(usize, Range<u64>, usize) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let mut start = 0u64;
    for (file, count) in counts.enumerate() {
        let end = start + count;
        let from = range.start.max(start);
        let to = range.end.min(end);
        if from < to {
            read(file, from - start..to - start, (from - range.start) as usize)?;
        }
        start = end;
    }
    Ok(())
}
