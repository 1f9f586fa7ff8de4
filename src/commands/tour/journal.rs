//! Which frames of a folder are finished: a line for each file, written when the file is complete. A line that an interruption has cut
//! off counts for nothing.

use crate::model::new_file;
use std::collections::HashMap;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// The name of the journal in the folder.
pub(super) const NAME: &str = "recording.journal";

/// Length and CRC-32C of a file's content.
type Content = (u64, u32);

/// The journal of a recording.
pub(super) struct Journal {
    path: PathBuf,
    file: std::fs::File,
    known: HashMap<String, Content>,
}

impl Journal {
    /// Opens a folder's journal, or begins one; nobody else may record there meanwhile.
    ///
    /// # Errors
    /// When it cannot be read or written, or somebody else records there.
    pub fn open(folder: &Path) -> Result<Journal, String> {
        let path = folder.join(NAME);
        let fail = |error: std::io::Error| format!("{}: {error}", path.display());
        let options = std::fs::File::options().create(true).read(true).append(true).open(&path);
        let mut file = options.map_err(fail)?;
        if let Err(std::fs::TryLockError::WouldBlock) = file.try_lock() {
            return Err(format!("{}: another deepfield records into this folder", folder.display()));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(fail)?;
        let text = String::from_utf8_lossy(&bytes);
        // What follows the last line break was cut off.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let known = text[..whole].lines().filter_map(parse).collect();
        if whole != bytes.len() {
            // So that the next line does not continue it.
            file.set_len(whole as u64).map_err(fail)?;
        }
        Ok(Journal { path, file, known })
    }

    /// Forgets everything.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn clear(&mut self) -> Result<(), String> {
        self.known.clear();
        self.file.set_len(0).map_err(|error| format!("{}: {error}", self.path.display()))
    }

    /// Removes the files that it knows, and forgets them.
    ///
    /// # Errors
    /// When a file cannot be removed, or the journal not written.
    pub fn remove_files(&mut self) -> Result<(), String> {
        for file in self.known.keys().map(|name| self.path.with_file_name(name)).filter(|file| file.is_file()) {
            std::fs::remove_file(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        }
        self.clear()
    }

    /// Whether a file of the folder is finished, and still what it was then.
    pub fn is_finished(&self, file: &Path) -> bool {
        self.known.get(&name_of(file)).is_some_and(|known| content_of(file).is_ok_and(|found| found == *known))
    }

    /// Notes files that are finished.
    ///
    /// # Errors
    /// When one cannot be read, or the journal not written.
    pub fn note(&mut self, files: &[PathBuf]) -> Result<(), String> {
        let mut lines = String::new();
        for file in files {
            let content = content_of(file).map_err(|error| format!("{}: {error}", file.display()))?;
            let name = name_of(file);
            lines += &format!("{:08x} {} {name}\n", content.1, content.0);
            self.known.insert(name, content);
        }
        self.file.write_all(lines.as_bytes()).map_err(|error| format!("{}: {error}", self.path.display()))
    }

    /// Writes the lines of these files anew, in this order, as if nothing had interrupted.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self, files: &[PathBuf]) -> Result<(), String> {
        let mut all: Vec<(&String, &Content)> = self.known.iter().collect();
        let place: HashMap<String, usize> = files.iter().enumerate().map(|(i, file)| (name_of(file), i)).collect();
        all.sort_by_key(|(name, _)| (place.get(*name).copied().unwrap_or(usize::MAX), (*name).clone()));
        let lines: String = all.iter().map(|(name, (bytes, crc))| format!("{crc:08x} {bytes} {name}\n")).collect();
        new_file::write(&self.path, &lines).map_err(|error| format!("{}: {error}", self.path.display()))
    }
}

/// The name under which a file is noted: that of a scene with its folder.
fn name_of(file: &Path) -> String {
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    if name.ends_with(".scene.ron") { format!("scenes/{name}") } else { name }
}

fn content_of(file: &Path) -> std::io::Result<Content> {
    let bytes = std::fs::read(file)?;
    Ok((bytes.len() as u64, crc32c::crc32c(&bytes)))
}

fn parse(line: &str) -> Option<(String, Content)> {
    let mut parts = line.splitn(3, ' ');
    let crc = u32::from_str_radix(parts.next()?, 16).ok()?;
    let bytes = parts.next()?.parse().ok()?;
    // A name that leads out of the folder is nobody's frame.
    let name = parts.next().filter(|name| name_of(Path::new(name)) == *name)?;
    Some((name.to_owned(), (bytes, crc)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_lines_and_unchanged_files_count() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.png", "b.png"].map(|name| folder.path().join(name));
        std::fs::write(&a, b"one").unwrap();
        std::fs::write(&b, b"two").unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        assert!(Journal::open(folder.path()).err().unwrap().contains("another deepfield"));
        journal.note(std::slice::from_ref(&a)).unwrap();
        assert!(journal.is_finished(&a) && !journal.is_finished(&b));
        drop(journal);
        let path = folder.path().join(NAME);
        let mut text = std::fs::read(&path).unwrap();
        text.extend_from_slice(b"0000 7 b.pn");
        std::fs::write(&path, &text).unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        journal.note(std::slice::from_ref(&b)).unwrap();
        assert!(journal.is_finished(&a) && journal.is_finished(&b));
        journal.finish(&[b.clone(), a.clone()]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().lines().next().unwrap().ends_with("b.png"));
        let mut journal = Journal::open(folder.path()).unwrap();
        assert!(journal.is_finished(&a) && journal.is_finished(&b));
        std::fs::write(&a, b"0ne").unwrap();
        assert!(!journal.is_finished(&a));
        journal.clear().unwrap();
        assert!(!journal.is_finished(&b));
    }

    #[test]
    fn what_it_knows_is_removed_and_nothing_else() {
        let outside = tempfile::tempdir().unwrap();
        let folder = outside.path().join("frames");
        std::fs::create_dir_all(folder.join("scenes")).unwrap();
        let [a, b, scene] = ["a.png", "b.png", "scenes/a.scene.ron"].map(|name| folder.join(name));
        let other = outside.path().join("other.png");
        for file in [&a, &b, &scene, &other] {
            std::fs::write(file, b"one").unwrap();
        }
        Journal::open(&folder).unwrap().note(&[a.clone(), scene.clone()]).unwrap();
        let lines = std::fs::read_to_string(folder.join(NAME)).unwrap();
        std::fs::write(folder.join(NAME), format!("{lines}00000000 3 ../other.png\n")).unwrap();
        let mut journal = Journal::open(&folder).unwrap();
        journal.remove_files().unwrap();
        assert!(!a.exists() && !scene.exists() && b.exists() && other.exists());
        assert!(!journal.is_finished(&a));
        drop(journal);
        assert_eq!(std::fs::read_to_string(folder.join(NAME)).unwrap(), "");
    }
}
