//! What is in a compressed file, as a temporary file without a name. Whoever looks into a file before it is opened, as formats do to tell it from
//! others, may hold what is unpacked for those who come next.

use super::ImportError;
use super::packed::{MOST_EXPANSION, Packing};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// Files that are held.
static HELD: Mutex<Vec<Held>> = Mutex::new(Vec::new());

/// A file that is held.
struct Held {
    path: PathBuf,
    holders: usize,
    /// What is in it, once somebody has unpacked it.
    unpacked: Option<(Version, File)>,
}

/// Length of a compressed file, and when it was written: where one of them is another, so is what is in it.
type Version = (u64, Option<SystemTime>);

fn all_held() -> MutexGuard<'static, Vec<Held>> {
    // Each change leaves the list whole.
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Holds a file: as long as this is there it is unpacked once where it is compressed, by whatever thread, however often it is opened and looked into.
/// Files of a snapshot beside it, and those whose readers need a cursor of their own, are unpacked whenever they are opened.
#[derive(Debug)]
pub struct UnpackedOnce {
    path: PathBuf,
}

impl UnpackedOnce {
    /// Of the file at `path`, compressed or not.
    pub fn of(path: &Path) -> UnpackedOnce {
        let path = named(path);
        let mut all = all_held();
        match all.iter().position(|held| held.path == path) {
            Some(at) => all[at].holders += 1,
            None => all.push(Held { path: path.clone(), holders: 1, unpacked: None }),
        }
        UnpackedOnce { path }
    }
}

impl Drop for UnpackedOnce {
    fn drop(&mut self) {
        let mut all = all_held();
        if let Some(at) = all.iter().position(|held| held.path == self.path) {
            all[at].holders -= 1;
            if all[at].holders == 0 {
                all.swap_remove(at);
            }
        }
    }
}

/// The one name of a file that is named in several ways.
fn named(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// The file, or where it is compressed what is in it; whether it is compressed.
pub(super) fn unpacked(path: &Path) -> Result<(File, bool), ImportError> {
    let (file, packing) = begun(path)?;
    match packing {
        None => Ok((file.into_inner(), false)),
        Some(packing) => Ok((unpack(path, file, packing)?, true)),
    }
}

/// The same for who reads by offset alone: where the file is [held](UnpackedOnce), others have the same one, and the same cursor.
pub(super) fn unpacked_once(path: &Path) -> Result<File, ImportError> {
    let (file, packing) = begun(path)?;
    let Some(packing) = packing else { return Ok(file.into_inner()) };
    let io = |source| ImportError::io(path, "unpacking", source);
    let about = file.get_ref().metadata().map_err(io)?;
    let (name, version) = (named(path), (about.len(), about.modified().ok()));
    if let Some(held) = all_held().iter().find(|held| held.path == name)
        && let Some((known, unpacked)) = &held.unpacked
        && *known == version
    {
        return unpacked.try_clone().map_err(io);
    }
    let unpacked = unpack(path, file, packing)?;
    if let Some(held) = all_held().iter_mut().find(|held| held.path == name) {
        // Where there is no room for another open file the next one unpacks its own.
        held.unpacked = unpacked.try_clone().ok().map(|unpacked| (version, unpacked));
    }
    Ok(unpacked)
}

/// A file, and how it is compressed.
fn begun(path: &Path) -> Result<(BufReader<File>, Option<Packing>), ImportError> {
    let io = |source| ImportError::io(path, "file", source);
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    let packing = Packing::of(file.fill_buf().map_err(io)?);
    Ok((file, packing))
}

/// What is in a compressed file.
fn unpack(path: &Path, packed: BufReader<File>, packing: Packing) -> Result<File, ImportError> {
    #[cfg(test)]
    tests::UNPACKED.set(tests::UNPACKED.get() + 1);
    let io = |source| ImportError::io(path, "file", source);
    let most = packed.get_ref().metadata().map_err(io)?.len().saturating_mul(MOST_EXPANSION);
    let unpacking = |source| ImportError::io(path, "unpacking", source);
    let mut unpacked = tempfile::tempfile().map_err(unpacking)?;
    let mut content = packing.unpacked(packed).take(most.saturating_add(1));
    if std::io::copy(&mut content, &mut unpacked).map_err(unpacking)? > most {
        let expected = format!("at most {MOST_EXPANSION} times the file");
        return Err(ImportError::malformed(path, "unpacking", format!("more than {most} bytes"), expected));
    }
    Ok(unpacked)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{GridOptions, files_of, grid_format, open, open_grid, steps_in};
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use std::cell::Cell;
    use std::io::Write;

    thread_local! {
        /// How many files this thread has unpacked.
        pub(super) static UNPACKED: Cell<usize> = const { Cell::new(0) };
    }

    /// How often `work` unpacks a file.
    fn times(work: impl FnOnce()) -> usize {
        let before = UNPACKED.get();
        work();
        UNPACKED.get() - before
    }

    fn pack(path: &Path, bytes: &[u8]) {
        let mut packed = GzEncoder::new(File::create(path).unwrap(), Compression::fast());
        packed.write_all(bytes).unwrap();
        packed.finish().unwrap();
    }

    /// A file of `tests/data`, compressed.
    fn packed(folder: &Path, name: &str) -> PathBuf {
        let plain = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name);
        let path = folder.join(format!("{name}.gz"));
        pack(&path, &std::fs::read(plain).unwrap());
        path
    }

    #[test]
    fn what_is_looked_into_and_then_opened_is_unpacked_once() {
        let folder = tempfile::tempdir().unwrap();
        let snapshot = packed(folder.path(), "gas_sphere_collapse_025.hdf5");
        let image = packed(folder.path(), "one.h5");
        assert_eq!(times(|| drop(open(&snapshot).unwrap())), 1);
        assert_eq!(times(|| drop(open_grid(&image, &GridOptions::default()).unwrap())), 1);
        // What is asked before it is opened, one question after the other.
        let ask = || {
            assert_eq!(grid_format(&snapshot).unwrap(), None);
            assert_eq!(files_of(&snapshot).unwrap(), [snapshot.as_path()]);
            assert_eq!(steps_in(&snapshot).unwrap(), 1);
        };
        let read = || open(&snapshot).unwrap();
        assert_eq!(times(ask), 3);
        let held = UnpackedOnce::of(&snapshot);
        let mut source = None;
        let together = times(|| {
            ask();
            source = Some(read());
        });
        assert_eq!((together, times(|| drop(read()))), (1, 0));
        // Who holds it for a shorter time, by another name, does not let go of it.
        let own = folder.path().file_name().unwrap();
        drop(UnpackedOnce::of(&folder.path().join("..").join(own).join("gas_sphere_collapse_025.hdf5.gz")));
        assert_eq!(times(ask), 0);
        drop(held);
        // It is kept for nobody, and still there for who reads it.
        assert_eq!(times(|| drop(read())), 1);
        let mut out = [0.0; 3];
        source.unwrap().read(0, 0, 0..1, &mut out).unwrap();
        assert_ne!(out, [0.0; 3]);
        assert!(all_held().iter().all(|held| !held.path.starts_with(named(folder.path()))));
    }

    #[test]
    fn what_is_written_anew_is_unpacked_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.gz");
        pack(&path, b"nothing yet");
        let _held = UnpackedOnce::of(&path);
        for bytes in [&b"one"[..], &b"another"[..]] {
            pack(&path, bytes);
            assert_eq!(times(|| drop(unpacked_once(&path).unwrap())), 1);
            assert_eq!(times(|| drop(unpacked_once(&path).unwrap())), 0);
            assert_eq!(unpacked_once(&path).unwrap().metadata().unwrap().len(), bytes.len() as u64);
        }
        // A cursor of one's own takes a file of one's own.
        assert_eq!(times(|| drop(unpacked(&path).unwrap())), 1);
    }
}
