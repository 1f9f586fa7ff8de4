//! Folders of files that can be had again, which hold so many bytes: those that were used longest ago make room. Several programs may have
//! one folder, and not all clocks are right.

use std::fs::Metadata;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How far the clocks of machines that have one folder may be apart.
const APART: Duration = Duration::from_secs(24 * 3600);

/// A file of such a folder.
#[derive(Clone, Debug)]
pub struct CachedFile {
    /// Where it is.
    pub path: PathBuf,
    /// When it was used, as whoever did so has marked it.
    pub used: SystemTime,
    /// Its length.
    pub bytes: u64,
}

impl CachedFile {
    /// A file, and what the system says of it.
    pub fn new(path: PathBuf, about: &Metadata) -> CachedFile {
        CachedFile { path, used: about.modified().unwrap_or(UNIX_EPOCH), bytes: about.len() }
    }
}

/// Removes those of these files that were used longest ago, until the others hold at most `budget` bytes. How many it has removed, and their
/// bytes.
pub fn make_room(mut files: Vec<CachedFile>, budget: u64) -> (usize, u64) {
    let latest = SystemTime::now() + APART;
    // What a clock has marked that was wrong would stay until all others have come so far, and nothing new beside it.
    files.iter_mut().filter(|file| file.used > latest).for_each(|file| file.used = UNIX_EPOCH);
    files.sort_by(|a, b| a.used.cmp(&b.used).then_with(|| a.path.cmp(&b.path)));
    let mut held: u64 = files.iter().map(|file| file.bytes).sum();
    let mut removed = (0, 0);
    for file in files {
        if held <= budget {
            break;
        }
        match std::fs::remove_file(&file.path) {
            Ok(()) => removed = (removed.0 + 1, removed.1 + file.bytes),
            // Another program makes room at the same time: were its part not counted, each would remove as much.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(_) => continue,
        }
        held -= file.bytes;
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// A file of 10 bytes, used so many seconds ago.
    fn file(folder: &Path, name: &str, ago: i64) -> CachedFile {
        let path = folder.join(name);
        std::fs::write(&path, [0; 10]).unwrap();
        let (now, by) = (SystemTime::now(), Duration::from_secs(ago.unsigned_abs()));
        let used = if ago < 0 { now + by } else { now - by };
        std::fs::File::options().write(true).open(&path).unwrap().set_modified(used).unwrap();
        CachedFile::new(path.clone(), &std::fs::metadata(path).unwrap())
    }

    fn there(files: &[CachedFile]) -> Vec<bool> {
        files.iter().map(|file| file.path.exists()).collect()
    }

    #[test]
    fn what_another_program_has_removed_counts_as_gone() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<_> = (0_i64..6).map(|number| file(folder.path(), &number.to_string(), 1000 - number)).collect();
        for gone in &files[..2] {
            std::fs::remove_file(&gone.path).unwrap();
        }
        assert_eq!(make_room(files.clone(), 35), (1, 10));
        assert_eq!(there(&files), [false, false, false, true, true, true]);
        assert_eq!(make_room(files[3..].to_vec(), 30), (0, 0));
    }

    #[test]
    fn what_a_wrong_clock_has_marked_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let of = |name, ago| file(folder.path(), name, ago);
        let files = [of("old", 1000), of("ahead", -400 * 86_400), of("new", 1), of("hour ahead", -3600)];
        assert_eq!(make_room(files.to_vec(), 30), (1, 10));
        assert_eq!(there(&files), [true, false, true, true]);
        assert_eq!(make_room([&files[..1], &files[2..]].concat(), 20), (1, 10));
        assert_eq!(there(&files), [false, false, true, true]);
    }
}
