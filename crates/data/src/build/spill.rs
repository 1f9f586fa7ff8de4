//! Where a build keeps what it will need again: in memory while there is room, in a temporary file beyond.
//!
//! Which of the two does not change what is read back, so the output does not depend on the memory that a build may take. A task of a job
//! keeps everything in the file that it hands on instead ([`Parts`]).

use super::cluster::{PartPlace, Parts};
use crate::model::portable::Portable;
use crate::model::positioned::{read_exact_at, write_all_at};
use crate::model::{ReadFile, ReadMethod};
use crate::store::temporary::Temporary;
use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A place for many blobs of bytes, written and read by several threads.
#[derive(Debug)]
pub struct Spill {
    output: PathBuf,
    folder: PathBuf,
    room: AtomicU64,
    /// Held while the file is created.
    creation: Mutex<()>,
    read: ReadMethod,
    /// The file once it was mapped; dropped before the file, which Windows does not remove while it is mapped.
    mapped: Mutex<Option<Arc<ReadFile>>>,
    file: OnceLock<Temporary>,
    end: AtomicU64,
    /// The files of a job's tasks, where blobs are put away there.
    parts: Option<Arc<Parts>>,
    /// The lane of a task's file where blobs are put away there, and what is in it.
    lane: Option<(u32, Mutex<Vec<u8>>)>,
}

/// What works on one of many things at a time puts its blobs away here; nothing of it is seen before it is closed.
pub enum Lane<'a> {
    /// Where everything is.
    Shared(&'a Spill),
    /// Bytes of its own.
    Own(Box<Spill>),
}

impl std::ops::Deref for Lane<'_> {
    type Target = Spill;

    fn deref(&self) -> &Spill {
        match self {
            Lane::Shared(spill) => spill,
            Lane::Own(spill) => spill,
        }
    }
}

impl Lane<'_> {
    /// Puts the lane where the others are.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn close(self) -> io::Result<()> {
        let Lane::Own(own) = self else { return Ok(()) };
        let Spill { parts, lane, .. } = *own;
        match parts.zip(lane) {
            Some((parts, (number, bytes))) => {
                parts.put_lane(number, &bytes.into_inner().unwrap_or_else(PoisonError::into_inner))
            }
            None => Ok(()),
        }
    }
}

/// What [`Spill::put`] has put away.
#[derive(Debug)]
pub struct Blob {
    len: u64,
    place: Place,
}

#[derive(Debug)]
enum Place {
    Memory(Vec<u64>),
    Disk(u64),
    Part(PartPlace),
}

impl Blob {
    /// Bytes by which others are told where a blob is.
    pub const TOLD: u64 = 29;

    /// Number of bytes.
    pub fn len(&self) -> usize {
        self.len as usize
    }

    /// The number of the task in whose file it is, if it is in one.
    pub fn part(&self) -> Option<u32> {
        match self.place {
            Place::Part(place) => Some(place.part()),
            Place::Memory(_) | Place::Disk(_) => None,
        }
    }
}

/// Only blobs in the files of tasks are known to other processes.
impl Portable for Blob {
    fn put(&self, to: &mut Vec<u8>) {
        match self.place {
            Place::Part(place) => (self.len, Some(place)).put(to),
            Place::Memory(_) | Place::Disk(_) => (self.len, None::<PartPlace>).put(to),
        }
    }

    fn take(from: &mut &[u8]) -> Option<Blob> {
        let (len, place): (u64, Option<PartPlace>) = Portable::take(from)?;
        Some(Blob { len, place: Place::Part(place?) })
    }
}

/// Bytes that were put away; aligned for any number.
pub struct Bytes<'a> {
    len: usize,
    words: Cow<'a, [u64]>,
}

impl std::ops::Deref for Bytes<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }
}

impl Spill {
    /// Keeps up to `room` bytes in memory, and the rest in a temporary file in `folder` that helps to write `output`
    /// and is read in the way `read`.
    pub fn new(output: &Path, folder: &Path, room: u64, read: ReadMethod) -> Spill {
        Spill {
            output: output.to_owned(),
            folder: folder.to_owned(),
            room: AtomicU64::new(room),
            creation: Mutex::new(()),
            read,
            mapped: Mutex::default(),
            file: OnceLock::new(),
            end: AtomicU64::new(0),
            parts: None,
            lane: None,
        }
    }

    /// Keeps everything in the file of the task at hand, and reads what is in those of other tasks.
    pub fn of_parts(parts: Arc<Parts>) -> Spill {
        let folder = parts.folder().to_owned();
        Spill { parts: Some(parts), ..Spill::new(&folder, &folder, 0, ReadMethod::default()) }
    }

    /// Where one thing of many is put away, so that it does not matter when the others are: in the file of a task a lane with this number.
    pub fn lane(&self, number: usize) -> Lane<'_> {
        match &self.parts {
            Some(parts) => {
                let lane = Some((number as u32, Mutex::default()));
                Lane::Own(Box::new(Spill { lane, ..Spill::of_parts(Arc::clone(parts)) }))
            }
            None => Lane::Shared(self),
        }
    }

    /// Folder of the temporary file.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.end.load(Ordering::Relaxed)
    }

    /// Puts the parts away, one after the other.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn put(&self, parts: &[&[u8]]) -> io::Result<Blob> {
        let len: usize = parts.iter().map(|part| part.len()).sum();
        if let Some(files) = &self.parts {
            let place = match &self.lane {
                Some((number, bytes)) => {
                    // Bytes that were appended are whole before the lock is given back.
                    let mut bytes = bytes.lock().unwrap_or_else(PoisonError::into_inner);
                    files.put_in_lane(*number, &mut bytes, parts)?
                }
                None => files.put(parts, len)?,
            };
            return Ok(Blob { len: len as u64, place: Place::Part(place) });
        }
        let bytes = len.next_multiple_of(8) as u64;
        let mut words = vec![0_u64; len.div_ceil(8)];
        let mut at = 0;
        for part in parts {
            bytemuck::cast_slice_mut(&mut words)[at..at + part.len()].copy_from_slice(part);
            at += part.len();
        }
        let take = |room: u64| room.checked_sub(bytes);
        if self.room.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_ok() {
            return Ok(Blob { len: len as u64, place: Place::Memory(words) });
        }
        let offset = self.end.fetch_add(bytes, Ordering::Relaxed);
        write_all_at(self.file()?, bytemuck::cast_slice(&words), offset)?;
        Ok(Blob { len: len as u64, place: Place::Disk(offset) })
    }

    /// Keeps room for so many bytes in the file of the task at hand, for [`Spill::put_at`]: where it begins.
    ///
    /// # Errors
    /// Where no such file is being written.
    pub fn reserve(&self, len: u64) -> io::Result<u64> {
        self.files()?.reserve(len)
    }

    /// Puts bytes where room was kept for them.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn put_at(&self, offset: u64, parts: &[&[u8]]) -> io::Result<Blob> {
        let place = self.files()?.put_at(offset, parts)?;
        let len: usize = parts.iter().map(|part| part.len()).sum();
        Ok(Blob { len: len as u64, place: Place::Part(place) })
    }

    /// A blob of those in the file of a task whose index is a list of them. Nothing else of that list is read.
    ///
    /// # Errors
    /// Where the task is not done, or its file damaged.
    pub fn listed(&self, part: u32, number: u32) -> io::Result<Blob> {
        let files = self.files()?;
        // Behind the length of the list.
        let at = size_of::<u64>() as u64 + Blob::TOLD * u64::from(number);
        let blob: Blob = files.index_at(part, at, Blob::TOLD)?;
        match blob.part() == Some(part) {
            true => Ok(blob),
            false => Err(files.damaged(part, "index: found a place in another file, expected one in the same")),
        }
    }

    /// The files of a job's tasks.
    fn files(&self) -> io::Result<&Arc<Parts>> {
        self.parts.as_ref().ok_or_else(|| io::Error::other("no files of tasks"))
    }

    /// Gives a blob of this spill back.
    ///
    /// # Errors
    /// When the disk does not.
    pub fn get<'a>(&self, blob: &'a Blob) -> io::Result<Bytes<'a>> {
        let words = match &blob.place {
            Place::Memory(words) => Cow::Borrowed(&words[..]),
            Place::Part(place) => Cow::Owned(self.files()?.get(*place, blob.len)?),
            Place::Disk(offset) => {
                let mut words = vec![0_u64; blob.len().div_ceil(8)];
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
                match self.read {
                    ReadMethod::Positioned => read_exact_at(self.file()?, bytes, *offset)?,
                    ReadMethod::Mapped => self.mapped(offset + bytes.len() as u64)?.read_exact_at(bytes, *offset)?,
                }
                Cow::Owned(words)
            }
        };
        Ok(Bytes { len: blob.len(), words })
    }

    /// An error about what is in a blob, which names the task's file that has it, if one has; that is removed, so that its task is done again.
    pub fn damaged(&self, blob: &Blob, what: &str) -> io::Error {
        match (&blob.place, &self.parts) {
            (Place::Part(place), Some(parts)) => parts.damaged(place.part(), what),
            _ => io::Error::other(what.to_owned()),
        }
    }

    /// Forgets a blob; its memory is free for others.
    pub fn forget(&self, blob: Blob) {
        if let Place::Memory(words) = blob.place {
            self.room.fetch_add(8 * words.len() as u64, Ordering::Relaxed);
        }
    }

    /// The file, mapped; anew where the byte `end` lies beyond what is mapped and the file has grown by half, so that this is rare.
    fn mapped(&self, end: u64) -> io::Result<Arc<ReadFile>> {
        // What is there is complete, so a poisoned lock does not matter.
        let mut known = self.mapped.lock().unwrap_or_else(PoisonError::into_inner);
        let serves = |file: &&Arc<ReadFile>| {
            let mapped = file.mapped_len();
            end <= mapped || self.on_disk() < mapped + mapped / 2
        };
        if let Some(file) = known.as_ref().filter(serves) {
            return Ok(Arc::clone(file));
        }
        let file = ReadFile::new(self.file()?.try_clone()?, ReadMethod::Mapped);
        Ok(Arc::clone(known.insert(Arc::new(file))))
    }

    fn file(&self) -> io::Result<&File> {
        if self.file.get().is_none() {
            // A poisoned lock protects nothing here.
            let _creating = self.creation.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            if self.file.get().is_none() {
                let _ = self.file.set(Temporary::create(&self.output, Some(&self.folder))?);
            }
        }
        self.file.get().map(Temporary::file).ok_or_else(|| io::Error::other("no temporary file"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn what_is_put_away_comes_back_from_memory_and_disk() {
        comes_back(ReadMethod::Positioned);
        comes_back(ReadMethod::Mapped);
    }

    fn comes_back(read: ReadMethod) {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::new(&folder.path().join("out"), folder.path(), 1000, read);
        let content = |i: usize| (0..i).map(|k| (k * i) as u8).collect::<Vec<u8>>();
        let blobs: Vec<Blob> = (0..200_usize)
            .into_par_iter()
            .map(|i| {
                let bytes = content(i);
                let (a, b) = bytes.split_at(i / 3);
                let blob = spill.put(&[a, b]).unwrap();
                // Read while the file grows.
                assert_eq!(*spill.get(&blob).unwrap(), bytes);
                blob
            })
            .collect();
        assert!(spill.on_disk() > 10_000);
        for (i, blob) in blobs.iter().enumerate() {
            assert_eq!(*spill.get(blob).unwrap(), content(i));
        }
        // Where files need no names there is none to be seen.
        assert!(std::fs::read_dir(folder.path()).unwrap().count() <= 1);
        let room = spill.room.load(Ordering::Relaxed);
        blobs.into_iter().for_each(|blob| spill.forget(blob));
        assert!(room < 200 && spill.room.load(Ordering::Relaxed) == 1000);
        drop(spill);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
