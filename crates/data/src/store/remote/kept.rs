//! What servers have sent, kept in a folder of this machine: pages are asked for once, and what was seen is there without a network.
//!
//! `FOLDER/HASH OF THE URL/VERSION/OFFSET-CRC` holds a part of a file whose CRC-32C is known, `FOLDER/HASH OF THE URL/ends` how the file
//! begins and ends. The version is the CRC-32C of the file's header, which holds that of the footer, which holds those of all pages: nothing
//! here is ever stale. `OFFSET-LENGTH-STATE` is a part that only knows itself whether it is sound, as headers of the stills of a run do; its
//! state is what the server said of the file's version, and it is read where the server does not answer. Files are written under another
//! name first, and those that were used longest ago make room.

use super::version::Version;
use crate::model::new_file::UNFINISHED;
use crate::store::budget::{CachedFile, make_room};
use std::fs::{File, Metadata};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// How files of ends begin.
const MAGIC: &[u8] = b"DFends1\n";
/// Longest file of ends that is read, bytes.
const LONGEST_ENDS: u64 = 1 << 20;
/// Room is made after so many bytes were written, or a sixteenth of the budget.
const WRITTEN: u64 = 64 << 20;
/// Bytes of a file that tell its version: the header of every kind of file.
const HEADER: usize = 64;

type Find = fn() -> Option<(PathBuf, u64)>;

static FIND: OnceLock<Find> = OnceLock::new();

/// From now on what servers send is kept in the folder that `find` gives, which may hold so many bytes.
pub(in crate::store) fn keep_pages(find: Find) {
    // The first one holds: there is one cache for a process.
    let _ = FIND.set(find);
}

/// What was read of a file to open it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Ends {
    /// Its version.
    pub version: Version,
    /// Its first bytes.
    pub head: Vec<u8>,
    /// Its last bytes; none where the first ones are all.
    pub tail: Vec<u8>,
}

/// What is kept of one file.
#[derive(Debug)]
pub(super) struct Kept {
    /// What tells the file from others of the same name.
    identity: String,
    root: PathBuf,
    folder: PathBuf,
    /// The folder of the version that is open.
    parts: PathBuf,
    /// A checksum of what the server says of that version.
    state: u32,
    budget: u64,
    /// Room is made after so many bytes were written.
    step: u64,
    /// Bytes written since room was made; before that, as if it were time to: programs may come and go that write little.
    written: AtomicU64,
}

impl Kept {
    /// What is kept of the file that is shown as `shown`; `None` where nothing is to be kept. Of all of its URL, which may hold a secret, a
    /// checksum is kept.
    pub fn of(shown: &str, url: &str) -> Option<Kept> {
        let (root, budget) = FIND.get()?()?;
        Some(Kept::within(root, budget, shown, url))
    }

    /// The same in this folder, which may hold so many bytes.
    pub fn within(root: PathBuf, budget: u64, shown: &str, url: &str) -> Kept {
        // What follows the `#` is this process's own.
        let shown = shown.split('#').next().unwrap_or(shown);
        let mut hasher = DefaultHasher::new();
        shown.hash(&mut hasher);
        let folder = root.join(format!("{:016x}", hasher.finish()));
        // A server may tell files apart by what is not shown.
        let identity = format!("{shown} {:08x}", crc32c::crc32c(url.as_bytes()));
        let (parts, step) = (folder.clone(), WRITTEN.min(budget / 16));
        Kept { identity, root, folder, parts, state: 0, budget, step, written: AtomicU64::new(step) }
    }

    /// From now on the version with these ends is read.
    pub fn open(&mut self, ends: &Ends) {
        let header = &ends.head[..ends.head.len().min(HEADER)];
        self.parts = self.folder.join(format!("{:08x}", crc32c::crc32c(header)));
        let Version { size, e_tag, modified_secs } = &ends.version;
        self.state = crc32c::crc32c(format!("{size} {modified_secs} {e_tag:?}").as_bytes());
    }

    /// How the file begins and ends, as it was last seen.
    pub fn ends(&self) -> Option<Ends> {
        let mut bytes = Vec::new();
        let mut file = open(&self.folder.join("ends")).ok()?;
        (&mut file).take(LONGEST_ENDS).read_to_end(&mut bytes).ok()?;
        let ends = decode(&bytes, &self.identity)?;
        // Without them nothing else of the file is of use.
        mark_as_used(&file);
        Some(ends)
    }

    /// Keeps how the file begins and ends.
    pub fn keep_ends(&self, ends: &Ends) {
        if self.ends().as_ref() != Some(ends) {
            self.write(&self.folder.join("ends"), &encode(ends, &self.identity));
        }
    }

    /// Fills `buffer` with the part at `offset` that has this CRC-32C, if it is here and sound.
    pub fn read_part(&self, buffer: &mut [u8], offset: u64, crc: u32) -> bool {
        read(&self.part(offset, crc), buffer, |bytes| crc32c::crc32c(bytes) == crc)
    }

    /// The same with a part that knows itself whether it is sound.
    pub fn read_sealed(&self, buffer: &mut [u8], offset: u64, is_sound: fn(&[u8]) -> bool) -> bool {
        read(&self.sealed(offset, buffer.len()), buffer, is_sound)
    }

    /// Keeps the part at `offset`, which has this CRC-32C.
    pub fn keep_part(&self, bytes: &[u8], offset: u64, crc: u32) {
        self.write(&self.part(offset, crc), bytes);
    }

    /// Keeps the part at `offset`, which knows itself that it is sound.
    pub fn keep_sealed(&self, bytes: &[u8], offset: u64) {
        self.write(&self.sealed(offset, bytes.len()), bytes);
    }

    fn sealed(&self, offset: u64, len: usize) -> PathBuf {
        self.parts.join(format!("{offset}-{len}-{:08x}", self.state))
    }

    fn part(&self, offset: u64, crc: u32) -> PathBuf {
        self.parts.join(format!("{offset}-{crc:08x}"))
    }

    /// What cannot be written is asked for again; nothing else comes of it.
    fn write(&self, path: &Path, bytes: &[u8]) {
        let len = bytes.len() as u64;
        if len > self.budget || write(path, bytes).is_err() {
            return;
        }
        let written = self.written.fetch_add(len, Ordering::Relaxed) + len;
        if written > self.step {
            self.written.store(0, Ordering::Relaxed);
            clean(&self.root, self.budget);
        }
    }
}

/// Fills `buffer` from a file of that length, if it is there and sound; else it goes.
fn read(path: &Path, buffer: &mut [u8], is_sound: impl Fn(&[u8]) -> bool) -> bool {
    let Ok(mut file) = open(path) else { return false };
    let is_whole = file.metadata().is_ok_and(|about| about.len() == buffer.len() as u64);
    let is_sound = is_whole && file.read_exact(buffer).is_ok() && is_sound(buffer);
    match is_sound {
        true => mark_as_used(&file),
        false => drop(std::fs::remove_file(path)),
    }
    is_sound
}

/// Opens a file to be read, and to be marked where that is possible: folders may be for reading alone, as home folders are on some clusters.
fn open(path: &Path) -> io::Result<File> {
    File::options().read(true).write(true).open(path).or_else(|_| File::open(path))
}

/// Nothing depends on whether that works but the order in which files make room.
fn mark_as_used(file: &File) {
    let _ = file.set_modified(SystemTime::now());
}

/// Writes a file whole or not at all, for its owner alone: a server may have asked who reads it.
fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut file = tempfile::Builder::new().prefix(UNFINISHED).tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Removes what was used longest ago until the folder holds at most `budget` bytes, of each file its ends last.
fn clean(root: &Path, budget: u64) {
    let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    let is_ours = |name: &str| name.len() == 16 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    let folders = entries(root).map(|entry| entry.path());
    let folders: Vec<PathBuf> =
        folders.filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(is_ours)).collect();
    let files_of = |folder: &Path| -> Vec<CachedFile> {
        let files = entries(folder).filter_map(|entry| {
            let about = entry.metadata().ok().filter(Metadata::is_file)?;
            Some(CachedFile::new(entry.path(), &about))
        });
        files.collect()
    };
    let (mut files, mut versions) = (Vec::new(), Vec::new());
    for folder in &folders {
        let own: Vec<PathBuf> = entries(folder).map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
        let parts: Vec<CachedFile> = own.iter().flat_map(|version| files_of(version)).collect();
        // Ends are marked when their file is opened, parts from then on, which are of no use without ends where there is no network.
        // A microsecond is a step of every system's clock.
        let last = parts.iter().map(|part| part.used).max().and_then(|used| used.checked_add(Duration::from_micros(1)));
        let mut ends = files_of(folder);
        ends.iter_mut().for_each(|file| file.used = last.map_or(file.used, |last| last.max(file.used)));
        files.extend(ends.into_iter().chain(parts));
        versions.extend(own);
    }
    make_room(files, budget);
    // Only those that are empty go.
    for folder in versions.iter().chain(&folders) {
        let _ = std::fs::remove_dir(folder);
    }
}

/// A file of ends: numbers, then what has a length of its own, then the CRC-32C of all that, little-endian.
fn encode(ends: &Ends, identity: &str) -> Vec<u8> {
    let Ends { version, head, tail } = ends;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(version.size.to_le_bytes());
    bytes.extend(version.modified_secs.to_le_bytes());
    for part in [identity.as_bytes(), version.e_tag.as_deref().unwrap_or_default().as_bytes(), head, tail] {
        bytes.extend((part.len() as u64).to_le_bytes());
        bytes.extend(part);
    }
    bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
    bytes
}

fn decode(bytes: &[u8], identity: &str) -> Option<Ends> {
    let (bytes, crc) = bytes.split_last_chunk::<4>()?;
    if crc32c::crc32c(bytes) != u32::from_le_bytes(*crc) {
        return None;
    }
    let mut rest = bytes.strip_prefix(MAGIC)?;
    let size = u64::from_le_bytes(*chunk(&mut rest)?);
    let modified_secs = i64::from_le_bytes(*chunk(&mut rest)?);
    let mut part = || {
        let len = u64::from_le_bytes(*chunk(&mut rest)?);
        rest.split_off(..usize::try_from(len).ok()?)
    };
    let [own, e_tag, head, tail] = [part()?, part()?, part()?, part()?];
    let e_tag = String::from_utf8(e_tag.to_vec()).ok().filter(|tag| !tag.is_empty());
    let version = Version { size, e_tag, modified_secs };
    let is_whole = head.len() as u64 <= size && tail.len() as u64 <= size;
    // Two files may have one folder.
    (own == identity.as_bytes() && is_whole).then(|| Ends { version, head: head.to_vec(), tail: tail.to_vec() })
}

fn chunk<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8; 8]> {
    let (chunk, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(chunk)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends() -> Ends {
        let version = Version { size: 1000, e_tag: Some("\"a\"".into()), modified_secs: -7 };
        Ends { version, head: (0..100).collect(), tail: vec![9; 50] }
    }

    #[test]
    fn ends_come_back_as_they_were_or_not_at_all() {
        let (ends, url) = (ends(), "https://h/a.df");
        let bytes = encode(&ends, url);
        assert_eq!(decode(&bytes, url).as_ref(), Some(&ends));
        assert_eq!(decode(&bytes, "https://h/b.df"), None);
        for len in 0..bytes.len() {
            assert_eq!(decode(&bytes[..len], url), None);
            let mut damaged = bytes.clone();
            damaged[len] ^= 0x10;
            assert_eq!(decode(&damaged, url), None, "byte {len}");
        }
        let plain = Ends { version: Version { e_tag: None, ..ends.version.clone() }, tail: Vec::new(), ..ends };
        assert_eq!(decode(&encode(&plain, url), url), Some(plain));
    }

    #[test]
    fn ends_are_there_as_long_as_their_file_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let mut kept = Kept::within(folder.path().into(), 10_000, "https://h/a.df", "https://h/a.df");
        kept.open(&ends());
        let path = kept.folder.join("ends");
        let age = |path: &Path, seconds| {
            let file = File::options().write(true).open(path).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
        };
        let (part, crc) = ([5; 1000], crc32c::crc32c(&[5; 1000]));
        kept.keep_ends(&ends());
        // The file is opened again, with an answer of the server and without.
        for has_answer in [true, false] {
            kept.keep_part(&part, 4096, crc);
            age(&kept.part(4096, crc), 1000);
            age(&path, 5000);
            match has_answer {
                true => kept.keep_ends(&ends()),
                false => assert!(kept.ends().is_some()),
            }
            clean(folder.path(), 500);
            assert!(path.exists() && !kept.part(4096, crc).exists(), "{has_answer}");
        }
        // Parts that were used since go first.
        kept.keep_part(&part, 4096, crc);
        age(&path, 5000);
        clean(folder.path(), 500);
        assert!(path.exists() && !kept.part(4096, crc).exists());
        #[cfg(unix)]
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o400)).unwrap();
        assert_eq!(kept.ends(), Some(ends()), "a folder for reading alone");
    }

    #[test]
    fn parts_are_kept_by_version_within_the_budget_and_checked() {
        let folder = tempfile::tempdir().unwrap();
        let of = |url: &str| Kept::within(folder.path().into(), 10_000, "https://h/a.df", url);
        let open = |header: u8| {
            let mut kept = of("https://h/a.df?id=1");
            kept.open(&Ends { head: vec![header; 100], ..ends() });
            kept
        };
        let (kept, bytes) = (open(1), vec![5; 1000]);
        let crc = crc32c::crc32c(&bytes);
        let mut buffer = vec![0; 1000];
        assert!(!kept.read_part(&mut buffer, 4096, crc));
        kept.keep_ends(&ends());
        kept.keep_part(&bytes, 4096, crc);
        assert!(kept.read_part(&mut buffer, 4096, crc) && buffer == bytes);
        assert_eq!(kept.ends(), Some(ends()));
        assert_eq!(of("https://h/a.df?id=2").ends(), None, "another file of the same name");
        assert!(!open(2).read_part(&mut buffer, 4096, crc), "another version");
        // A part that was damaged on the disk is none, and goes.
        std::fs::write(kept.part(4096, crc), vec![6; 1000]).unwrap();
        assert!(!kept.read_part(&mut buffer, 4096, crc) && !kept.part(4096, crc).exists());
        // What only knows itself whether it is sound is of the version that the server named.
        let is_sound: fn(&[u8]) -> bool = |bytes| bytes.iter().all(|byte| *byte == 5);
        kept.keep_sealed(&bytes, 8192);
        assert!(kept.read_sealed(&mut buffer, 8192, is_sound) && buffer == bytes);
        let mut other = of("https://h/a.df?id=1");
        let version = Version { e_tag: Some("\"b\"".into()), ..ends().version };
        other.open(&Ends { version, head: vec![1; 100], ..ends() });
        assert!(!other.read_sealed(&mut buffer, 8192, is_sound), "another version with the same header");
        assert!(!kept.read_sealed(&mut buffer, 8192, |_| false) && !kept.read_sealed(&mut buffer, 8192, is_sound));
        // Twenty parts of 1000 bytes: those that were used last stay.
        for part in 0..20 {
            kept.keep_part(&bytes, part, crc);
            let used = SystemTime::now() - Duration::from_secs(1000 - part);
            let file = File::options().write(true).open(kept.part(part, crc));
            file.map(|file| file.set_modified(used).unwrap()).unwrap_or_default();
        }
        clean(folder.path(), 5_000);
        let there: Vec<u64> = (0..20).filter(|part| kept.part(*part, crc).exists()).collect();
        assert!(there.len() <= 5 && there.contains(&19) && !there.contains(&0), "{there:?}");
        assert!(Kept::within(folder.path().join("absent"), 10, "u", "u").ends().is_none());
        // Whoever writes little makes room too.
        let other = Kept::within(folder.path().into(), 3_000, "https://h/b.df", "https://h/b.df");
        other.keep_part(&[1], 0, crc32c::crc32c(&[1]));
        let there = (0..20).filter(|part| kept.part(*part, crc).exists()).count();
        assert!(there <= 2, "{there}");
    }
}
