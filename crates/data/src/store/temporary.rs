//! Temporary files: beside what they help to write, locked while their run lives, so that the next run can tell and remove those
//! that a killed one has left.

use crate::model::new_file;
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

/// In the names of all temporary files, after the name of the output.
pub const MARK: &str = ".tmp";

/// A temporary file that is removed when it is dropped.
#[derive(Debug)]
pub struct Temporary {
    path: PathBuf,
    file: File,
}

impl Temporary {
    /// Creates a file named after `output` in the folder of `output`, or in `folder`.
    ///
    /// # Errors
    /// When the folder takes no files.
    pub fn create(output: &Path, folder: Option<&Path>) -> io::Result<Temporary> {
        let folder = folder.unwrap_or_else(|| folder_of(output));
        let mut prefix = output.file_name().unwrap_or_default().to_os_string();
        prefix.push(MARK);
        let (file, path) = new_file::builder().prefix(&prefix).suffix("").tempfile_in(folder)?.keep()?;
        let temporary = Temporary { path, file };
        // Where files cannot be locked, nobody will remove this one by mistake either: the next run cannot lock it.
        let _ = temporary.file.try_lock();
        Ok(temporary)
    }

    /// The file.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Moves the file to `path`, replacing what is there.
    ///
    /// # Errors
    /// When the system refuses; the file is removed then.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        std::fs::rename(&self.path, path)?;
        // It has no name of its own any more that dropping could remove; closing it unlocks it.
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // Nothing can be done about a file that cannot be removed; the next run tries again.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The folder of a file.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Removes the temporary files of `output` in `folder` that no living run holds; returns how many bytes they took.
pub fn clean(output: &Path, folder: &Path) -> u64 {
    let Some(name) = output.file_name().and_then(|name| name.to_str()) else { return 0 };
    let prefix = format!("{name}{MARK}");
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let is_ours = |entry: &std::fs::DirEntry| entry.file_name().to_str().is_some_and(|name| name.starts_with(&prefix));
    let mut freed = 0;
    for entry in entries.flatten().filter(is_ours) {
        let Ok(file) = OpenOptions::new().read(true).write(true).open(entry.path()) else { continue };
        if file.try_lock().is_ok() {
            let bytes = file.metadata().map_or(0, |about| about.len());
            freed += if std::fs::remove_file(entry.path()).is_ok() { bytes } else { 0 };
        }
    }
    freed
}

/// What the disk of a folder has left for this user, bytes, where the system says so.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    #[cfg(unix)]
    return rustix::fs::statvfs(folder).ok().map(|about| about.f_bavail.saturating_mul(about.f_frsize));
    #[cfg(not(unix))]
    {
        let _ = folder;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_of_dead_runs_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out.df");
        let living = Temporary::create(&output, None).unwrap();
        std::fs::write(folder.path().join("out.df.tmpDead"), [7; 100]).unwrap();
        std::fs::write(folder.path().join("other.df.tmpDead"), [7; 100]).unwrap();
        assert_eq!(clean(&output, folder.path()), 100);
        let mut names: Vec<_> =
            std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names.len(), 2);
        assert_eq!(names[0], "other.df.tmpDead");
        living.persist(&output).unwrap();
        assert!(output.exists());
        drop(Temporary::create(&output, None).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
