//! Temporary files: without a name where the system has such files, so that nothing stays of a run that is killed; elsewhere beside what
//! they help to write, locked while their run lives, so that the next run can tell and remove those that a killed one has left.

mod unnamed;

use crate::model::new_file;
use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Seek};
use std::path::{Path, PathBuf};

/// In the names of all temporary files, after the name of the output.
pub const MARK: &str = ".tmp";

/// A temporary file that is gone when it is dropped.
#[derive(Debug)]
pub struct Temporary {
    file: File,
    /// Its name, where it has one.
    path: Option<PathBuf>,
}

impl Temporary {
    /// Creates a file in the folder of `output`, or in `folder`; where it needs a name, named after `output`.
    ///
    /// # Errors
    /// When the folder takes no files.
    pub fn create(output: &Path, folder: Option<&Path>) -> io::Result<Temporary> {
        let folder = folder.unwrap_or_else(|| folder_of(output));
        match unnamed::create(folder) {
            Some(file) => Ok(Temporary::locked(file, None)),
            None => Temporary::create_named(output, folder),
        }
    }

    fn create_named(output: &Path, folder: &Path) -> io::Result<Temporary> {
        loop {
            let made = new_file::builder().prefix(&prefix(output)).suffix("").tempfile_in(folder);
            let (file, path) = made.map_err(|error| new_file::without_name(&error))?.keep()?;
            let own = Temporary::locked(file, Some(path.clone()));
            // Who cleans up may have locked it first, and removes it before the lock is given back.
            if path.try_exists()? {
                return Ok(own);
            }
        }
    }

    fn locked(file: File, path: Option<PathBuf>) -> Temporary {
        // Where files cannot be locked, nobody will remove this one by mistake either: the next run cannot lock it.
        let _ = file.lock();
        Temporary { file, path }
    }

    /// The file.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Moves the file to `path`, replacing what is there in one step.
    ///
    /// # Errors
    /// When the system refuses; the file is gone then.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        match &self.path {
            // It has no name of its own any more that dropping could remove; closing it unlocks it.
            Some(own) => std::fs::rename(own, path),
            None => match self.give_name(path) {
                Err(error) if !matches!(error.kind(), ErrorKind::IsADirectory | ErrorKind::PermissionDenied) => {
                    // Some file systems have files without names, but do not let them have one later.
                    self.copy(path).map_err(|_| error)
                }
                given => given,
            },
        }
    }

    /// Gives a file that has none its name. Where another has it, the file takes another name first and then its place: there is no single
    /// step for that.
    fn give_name(&self, path: &Path) -> io::Result<()> {
        match unnamed::link(&self.file, path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            given => return given,
        }
        let beside = new_file::builder()
            .prefix(&prefix(path))
            .suffix("")
            .make_in(folder_of(path), |name| unnamed::link(&self.file, name))?;
        beside.into_temp_path().persist(path).map_err(|error| error.error)
    }

    /// Writes what is in the file to `path`, under another name first.
    fn copy(&self, path: &Path) -> io::Result<()> {
        let copy = Temporary::create_named(path, folder_of(path))?;
        let mut from = &self.file;
        from.rewind()?;
        io::copy(&mut from, &mut copy.file())?;
        copy.file().sync_all()?;
        copy.persist(path)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // Nothing can be done about a file that cannot be removed; the next run tries again.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// How the names of temporary files of an output begin.
fn prefix(output: &Path) -> OsString {
    let mut prefix = output.file_name().unwrap_or_default().to_os_string();
    prefix.push(MARK);
    prefix
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
mod tests;
