//! Snapshots as files: one, or `FILE.0`, `FILE.1`, ... where one cannot hold all particles. Written under other names
//! first, so that no half snapshot ever has the final one.

use super::Generator;
use super::gadget::{MOST, Part, bytes, write_part};
use crate::model::new_file;
use crate::model::progress::Progress;
use crate::store::temporary::free_bytes;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Most files of a snapshot.
const MOST_FILES: u64 = 10_000;

/// Why a snapshot was not written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}", path = path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// The cause.
    pub source: std::io::Error,
}

/// The files that `count` particles go to, at most `per_file` in each: their names and what they hold.
pub fn parts(path: &Path, count: u64, per_file: u64) -> Vec<(PathBuf, Part)> {
    let files = count.div_ceil(per_file.clamp(1, MOST)).max(1);
    let name = |number: u64| match (path.file_name(), files) {
        (Some(name), 2..) => {
            let mut name = name.to_owned();
            name.push(format!(".{number}"));
            path.with_file_name(name)
        }
        _ => path.to_owned(),
    };
    // Files of equal size, but for one particle.
    let start = |number: u64| (u128::from(count) * u128::from(number) / u128::from(files)) as u64;
    let part = |number: u64| Part { particles: start(number)..start(number + 1), files: files as u32 };
    (0..files).map(|number| (name(number), part(number))).collect()
}

/// Writes a snapshot, at most `per_file` particles in a file; the names of its files. Nothing is left behind on failure.
///
/// # Errors
/// [`WriteError`] names the file and the cause; before anything is written where the disk has too little room.
pub fn write(
    generator: &dyn Generator,
    path: &Path,
    per_file: u64,
    progress: &dyn Progress,
) -> Result<Vec<PathBuf>, WriteError> {
    let fail = |path: &Path, source: std::io::Error| WriteError { path: path.to_owned(), source };
    let files = generator.len().div_ceil(per_file.clamp(1, MOST));
    if files > MOST_FILES {
        let message = format!("{files} files, expected at most {MOST_FILES}");
        return Err(fail(path, std::io::Error::new(ErrorKind::InvalidInput, message)));
    }
    let parts = parts(path, generator.len(), per_file);
    if parts.len() > 1 && path.extension().is_some_and(|end| end.to_string_lossy().bytes().all(|b| b.is_ascii_digit()))
    {
        let message = "a snapshot in several files is named FILE.0, FILE.1, ..., so that FILE must not end in a number";
        return Err(fail(path, std::io::Error::new(ErrorKind::InvalidInput, message)));
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let needed = bytes(generator, generator.len());
    if let Some(free) = free_bytes(folder)
        && needed > free
    {
        let message =
            format!("takes {} MiB, and the disk has {} MiB left; fewer particles fit (-n)", needed >> 20, free >> 20);
        return Err(fail(path, std::io::Error::new(ErrorKind::StorageFull, message)));
    }
    progress.begin("writing particles", generator.len());
    let mut written: Vec<(NamedTempFile, PathBuf)> = Vec::with_capacity(parts.len());
    for (name, part) in parts {
        let mut file = new_file::builder().tempfile_in(folder).map_err(|error| fail(&name, error))?;
        write_part(generator, &part, file.as_file_mut(), progress).map_err(|error| fail(&name, error))?;
        written.push((file, name));
    }
    let mut names = Vec::with_capacity(written.len());
    for (file, name) in written {
        file.persist(&name).map_err(|error| fail(&name, error.error))?;
        names.push(name);
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_snapshot_that_does_not_fit_is_not_begun() {
        let folder = tempfile::tempdir().unwrap();
        if free_bytes(folder.path()).is_none() {
            return;
        }
        let generator = crate::synth::clusters::Clusters::new(1, 1_000_000_000_000);
        let error = write(&generator, &folder.path().join("huge"), MOST, &()).unwrap_err().to_string();
        assert!(error.contains("huge: takes 4") && error.contains("MiB left"), "{error}");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
    }

    #[test]
    fn parts_cover_all_particles() {
        let path = Path::new("folder/box.gadget2");
        assert_eq!(parts(path, 100, MOST), [(path.to_owned(), Part { particles: 0..100, files: 1 })]);
        let split = parts(path, 100, 40);
        let names: Vec<_> = split.iter().map(|(name, _)| name.to_string_lossy().into_owned()).collect();
        assert_eq!(names, ["folder/box.gadget2.0", "folder/box.gadget2.1", "folder/box.gadget2.2"]);
        let ranges: Vec<_> = split.iter().map(|(_, part)| part.particles.clone()).collect();
        assert_eq!(ranges, [0..33, 33..66, 66..100]);
        let many = parts(path, 10_000_000_000, MOST);
        assert!(many.iter().all(|(_, part)| part.particles.end - part.particles.start <= MOST));
        assert_eq!(many.last().map(|(_, part)| part.particles.end), Some(10_000_000_000));
    }
}
