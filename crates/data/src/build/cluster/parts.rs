//! The files by which the tasks of a job hand results to one another, one for each task: a header, blobs, and an index of values that names
//! the blobs by place and checksum.
//!
//! | bytes | what |
//! |---|---|
//! | 0 to 8 | [`MAGIC`] |
//! | 8 to 12 | [`VERSION`] |
//! | 12 to 16 | number of the task in its job |
//! | 16 to 24 | the job |
//! | 24 to 40 | offset and length of the index, which ends the file |
//! | 40 to 48 | length of the table of lanes, which ends where the index begins |
//! | 48 to 56 | bytes that the task has read, of the source about, and of other tasks' files |
//! | 56 to 64 | bytes that it has written elsewhere |
//! | 64 to 72 | CRC-32C of the index and of the table |
//! | 72 to 76 | zeros |
//! | 76 to 80 | CRC-32C of the header before |
//!
//! Whatever several threads write at a time goes where room was kept for it, if its length is known before; else to lanes, one for each bucket or
//! the like, which come to the file as they are ready: a blob is named by its lane and its place there. So what was named of a file is found in
//! the one that replaces it, too.
//!
//! A file gets its name when it is complete, in one step; so whoever makes one again, at the same time or later, does no harm. What turns
//! out to be damaged is removed, so that its task is not done any more.

mod opened;

use super::super::BuildError;
use super::{job_error, settings};
use crate::model::portable::{Portable, portable};
use crate::model::positioned::{read_exact_at, write_all_at};
use crate::store::StoreError;
use crate::store::temporary::Temporary;
use opened::{OpenFiles, Opened};
use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// First bytes of a task's file.
const MAGIC: [u8; 8] = *b"\x89DFT\r\n\x1a\n";
/// What is written and read; processes of a job are of one version of the program.
const VERSION: u32 = 5;
/// Bytes of a header.
const HEADER: usize = 80;
/// What is wrong with an index that is of something else.
const OTHER_INDEX: &str = "index: found other values, expected those of this stage";
/// In place of a lane's number: the blob's place is that in the file.
const NO_LANE: u32 = u32::MAX;

/// Where a blob is in the file of a task.
#[derive(Clone, Copy, Debug)]
pub(in crate::build) struct PartPlace {
    /// The task's number in its job.
    part: u32,
    lane: u32,
    /// From the beginning of the lane.
    offset: u64,
    crc: u32,
}

portable!(PartPlace { part, lane, offset, crc });

impl PartPlace {
    /// The number of the task whose file it is in.
    pub fn part(&self) -> u32 {
        self.part
    }
}

/// What can be read of a task's file at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    index_offset: u64,
    index_len: u64,
    lanes_len: u64,
    index_crc: u32,
    lanes_crc: u32,
    /// Bytes that the task has read, of the source about, and of other tasks' files.
    pub read: u64,
    /// Bytes that it has written elsewhere.
    pub written: u64,
}

portable!(Header { index_offset, index_len, lanes_len, read, written, index_crc, lanes_crc });

impl Header {
    /// Length of the file.
    pub fn bytes(&self) -> u64 {
        self.index_offset + self.index_len
    }

    /// Length of the index.
    pub fn index_bytes(&self) -> u64 {
        self.index_len
    }

    fn encode(&self, job: u64, number: u32) -> [u8; HEADER] {
        let mut bytes = Vec::with_capacity(HEADER);
        (MAGIC, (VERSION, (number, job))).put(&mut bytes);
        self.put(&mut bytes);
        0_u32.put(&mut bytes);
        crc32c::crc32c(&bytes).put(&mut bytes);
        let mut header = [0; HEADER];
        header.iter_mut().zip(bytes).for_each(|(to, byte)| *to = byte);
        header
    }

    /// The header of task `number` of a job, in a file of so many bytes; what was found and expected where it is none.
    fn decode(bytes: &[u8; HEADER], job: u64, number: u32, len: u64) -> Result<Header, String> {
        let header = Header::take(&mut &bytes[24..]).ok_or("header: found no room for it, expected 80 bytes")?;
        if header.encode(job, number) != *bytes {
            return Err("header: found another one, expected that of this task and job, with its checksum".into());
        }
        match header.index_offset.checked_add(header.index_len) {
            Some(end) if end == len && header.lanes_len <= header.index_offset => Ok(header),
            Some(end) => Err(format!("length: found {len} bytes, expected {end}")),
            None => Err("header: found an index beyond all files, expected one that ends the file".into()),
        }
    }
}

/// What is wrong with a task's file, on its way through what knows of system errors only.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {what}")]
pub(in crate::build) struct PartError {
    pub path: PathBuf,
    pub what: String,
}

/// Which files a job has.
#[derive(Clone, Debug)]
pub(super) struct Names {
    pub folder: PathBuf,
    /// The job.
    pub job: u64,
    /// Name and number of tasks of each stage, in order.
    pub stages: Vec<(String, u32)>,
}

impl Names {
    /// Number of all tasks.
    pub fn tasks(&self) -> u32 {
        self.stages.iter().map(|(_, tasks)| tasks).sum()
    }

    /// The number in the job of a task of a stage.
    pub fn number(&self, stage: usize, task: u32) -> u32 {
        self.stages[..stage].iter().map(|(_, tasks)| tasks).sum::<u32>() + task
    }

    /// Stage and task of a number; `None` beyond the last one.
    fn task(&self, number: u32) -> Option<(&str, u32)> {
        let mut rest = number;
        for (stage, tasks) in &self.stages {
            if rest < *tasks {
                return Some((stage, rest));
            }
            rest -= tasks;
        }
        None
    }

    /// The file of a task.
    pub fn path(&self, number: u32) -> PathBuf {
        let (stage, task) = self.task(number).unwrap_or(("task", number));
        self.folder.join(format!("{stage}.{task}"))
    }

    /// An error about a task's file, which ends with what to do.
    fn error(&self, number: u32, what: &str) -> PartError {
        let (stage, task) = self.task(number).unwrap_or(("task", number));
        PartError { path: self.path(number), what: format!("{what}; run stage {stage}, task {task}") }
    }

    /// An error about a task's file that the system does not read now: it may be as it should.
    fn unreadable(&self, number: u32, error: &io::Error) -> io::Error {
        io::Error::other(PartError { path: self.path(number), what: error.to_string() })
    }

    /// Opens a task's file; `None` where there is none.
    fn open(&self, number: u32) -> io::Result<Option<(File, Header)>> {
        let file = match File::open(self.path(number)) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(self.unreadable(number, &error)),
        };
        let len = file.metadata()?.len();
        let mut bytes = [0; HEADER];
        let header = match read_exact_at(&file, &mut bytes, 0) {
            Ok(()) => Header::decode(&bytes, self.job, number, len),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                Err(format!("length: found {len} bytes, expected a header of {HEADER}"))
            }
            Err(error) => return Err(self.unreadable(number, &error)),
        };
        match header {
            Ok(header) => Ok(Some((file, header))),
            Err(what) => Err(self.damaged(number, &what)),
        }
    }

    /// Removes a file that is not what it should be: its task is to be run again.
    fn damaged(&self, number: u32, what: &str) -> io::Error {
        self.forget(number);
        io::Error::other(self.error(number, what))
    }

    /// Removes the file of a task, which is not done any more.
    pub fn forget(&self, number: u32) {
        // What looks damaged to a task whose job was removed may be a sound result of the next one.
        if !settings::is_of_other(&self.folder, self.job) {
            // What cannot be removed is found to be damaged again.
            let _ = std::fs::remove_file(self.path(number));
        }
    }

    /// Whether the file of a task is there and one of this job, whatever job the folder has by now.
    pub fn is_own(&self, number: u32) -> bool {
        let Ok(file) = File::open(self.path(number)) else { return false };
        let len = file.metadata().map_or(0, |about| about.len());
        let mut bytes = [0; HEADER];
        read_exact_at(&file, &mut bytes, 0).is_ok() && Header::decode(&bytes, self.job, number, len).is_ok()
    }

    /// The header of a task that is done; `None` where it is not. Only its file's beginning and length are looked at.
    pub fn done(&self, number: u32) -> Option<Header> {
        self.open(number).ok().flatten().map(|(_, header)| header)
    }
}

/// The file that is being written.
#[derive(Debug)]
struct Own {
    number: u32,
    file: Temporary,
    end: AtomicU64,
    /// Where lanes begin.
    lanes: Mutex<Vec<(u32, u64)>>,
}

/// The files of a job as one task knows them: its own, which it writes, and those of others, which it reads.
#[derive(Debug)]
pub(in crate::build) struct Parts {
    names: Names,
    own: Option<Own>,
    open: Mutex<OpenFiles>,
    /// Bytes that were read of them.
    read: AtomicU64,
}

impl Parts {
    /// For reading only.
    pub(super) fn reader(names: Names) -> Parts {
        Parts { names, own: None, open: Mutex::new(OpenFiles::new()), read: AtomicU64::new(0) }
    }

    /// For the only task of a job in a folder.
    #[cfg(test)]
    pub fn of_one(folder: &std::path::Path) -> Result<Parts, BuildError> {
        Parts::of_task(Names { folder: folder.to_owned(), job: 1, stages: vec![("survey".into(), 1)] }, 0)
    }

    /// For task `number`, whose file is begun.
    ///
    /// # Errors
    /// When the folder takes no files.
    pub(super) fn of_task(names: Names, number: u32) -> Result<Parts, BuildError> {
        let path = names.path(number);
        let file =
            Temporary::create(&path, None).map_err(|source| StoreError::Io { path, action: "create", source })?;
        let own = Own { number, file, end: AtomicU64::new(HEADER as u64), lanes: Mutex::default() };
        Ok(Parts { own: Some(own), ..Parts::reader(names) })
    }

    /// The job's folder.
    pub fn folder(&self) -> &Path {
        &self.names.folder
    }

    fn own(&self) -> io::Result<&Own> {
        self.own.as_ref().ok_or_else(|| io::Error::other("no file of a task is being written"))
    }

    /// Appends a blob of `len` bytes, its parts one after the other, to the task's own file.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn put(&self, parts: &[&[u8]], len: usize) -> io::Result<PartPlace> {
        self.put_at(self.reserve(len as u64)?, parts)
    }

    /// Keeps room for so many bytes in the task's own file: where it begins.
    ///
    /// # Errors
    /// When no file is being written.
    pub fn reserve(&self, len: u64) -> io::Result<u64> {
        Ok(self.own()?.end.fetch_add(len, Ordering::Relaxed))
    }

    /// Writes a blob, its parts one after the other, where room was kept for it in the task's own file.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn put_at(&self, offset: u64, parts: &[&[u8]]) -> io::Result<PartPlace> {
        let own = self.own()?;
        let (mut crc, mut at) = (0, offset);
        for part in parts {
            crc = crc32c::crc32c_append(crc, part);
            write_all_at(own.file.file(), part, at)?;
            at += part.len() as u64;
        }
        Ok(PartPlace { part: own.number, lane: NO_LANE, offset, crc })
    }

    /// Appends a blob to the bytes of a lane of the task's own file.
    ///
    /// # Errors
    /// When no file is being written.
    pub fn put_in_lane(&self, lane: u32, bytes: &mut Vec<u8>, parts: &[&[u8]]) -> io::Result<PartPlace> {
        let offset = bytes.len();
        parts.iter().for_each(|part| bytes.extend_from_slice(part));
        let crc = crc32c::crc32c(&bytes[offset..]);
        Ok(PartPlace { part: self.own()?.number, lane, offset: offset as u64, crc })
    }

    /// Appends a lane to the task's own file.
    ///
    /// # Errors
    /// When the disk takes no more.
    pub fn put_lane(&self, lane: u32, bytes: &[u8]) -> io::Result<()> {
        let own = self.own()?;
        let PartPlace { offset, .. } = self.put(&[bytes], bytes.len())?;
        // A list is whole before its lock is given back.
        own.lanes.lock().unwrap_or_else(PoisonError::into_inner).push((lane, offset));
        Ok(())
    }

    /// A blob of that length, in words that begin with its bytes.
    ///
    /// # Errors
    /// [`PartError`] where its file is missing or damaged, which is removed then; whatever else the system answers.
    pub fn get(&self, place: PartPlace, len: u64) -> io::Result<Vec<u64>> {
        let PartPlace { part, lane, offset, crc } = place;
        if let Some(own) = self.own.as_ref().filter(|own| own.number == part && lane == NO_LANE) {
            return words_at(own.file.file(), own.end.load(Ordering::Relaxed), offset, len);
        }
        let opened = self.file(part)?;
        let start = if lane == NO_LANE { Some(&0) } else { opened.lanes.get(&lane) };
        let at = start.and_then(|start| start.checked_add(offset));
        let read = match at {
            Some(at) => words_at(&opened.file, opened.header.bytes(), at, len),
            None => Err(io::ErrorKind::UnexpectedEof.into()),
        };
        let is_sound = |words: &[u64]| crc32c::crc32c(&bytemuck::cast_slice(words)[..len as usize]) == crc;
        let words = match read {
            Ok(words) if is_sound(&words) => words,
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                return Err(self.names.unreadable(part, &error));
            }
            _ if !opened.is_first => {
                let what = "found another file, expected the one whose index was read; run the same task again";
                return Err(io::Error::other(PartError { path: self.names.path(part), what: what.into() }));
            }
            _ => return Err(self.names.damaged(part, "blob: found other bytes than its checksum is of, or none")),
        };
        self.read.fetch_add(len, Ordering::Relaxed);
        Ok(words)
    }

    /// Says what is wrong with the file of a task, which is removed, so that its task is done again.
    pub fn damaged(&self, number: u32, what: &str) -> io::Error {
        self.names.damaged(number, what)
    }

    /// The file of a task that is done.
    fn file(&self, number: u32) -> io::Result<Arc<Opened>> {
        // A map is whole before its lock is given back.
        let open = || self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let known = open().get(number);
        if let Some(opened) = known {
            return Ok(opened);
        }
        // Others open theirs meanwhile.
        let Some((file, header)) = self.names.open(number)? else {
            return Err(io::Error::other(self.names.error(number, "found no file, expected the result of a task")));
        };
        let known = open().lanes(number, &header);
        let lanes = match known {
            Some(lanes) => lanes,
            None => Arc::new(self.read_lanes(number, &file, &header)?),
        };
        Ok(open().keep(number, file, header, lanes))
    }

    /// Where the lanes of a task's file begin.
    fn read_lanes(&self, number: u32, file: &File, header: &Header) -> io::Result<HashMap<u32, u64>> {
        // The file has room for it.
        let mut lanes = vec![0; header.lanes_len as usize];
        let read = read_exact_at(file, &mut lanes, header.index_offset - header.lanes_len);
        read.map_err(|error| self.names.unreadable(number, &error))?;
        if crc32c::crc32c(&lanes) != header.lanes_crc {
            return Err(self.names.damaged(number, "lanes: found another checksum than the header says"));
        }
        match Vec::<(u32, u64)>::of_bytes(&lanes) {
            Some(table) => Ok(table.into_iter().collect()),
            None => Err(self.names.damaged(number, "lanes: found other values, expected numbers and places")),
        }
    }

    /// The index of a task that is done.
    ///
    /// # Errors
    /// Where the task is not done, or its file damaged.
    pub fn index<T: Portable>(&self, number: u32) -> Result<T, BuildError> {
        self.read_index(number).map_err(|error| BuildError::of_part(self.folder(), error))
    }

    fn read_index<T: Portable>(&self, number: u32) -> io::Result<T> {
        let opened = self.file(number)?;
        let Opened { file, header, .. } = &*opened;
        // The file has room for it.
        let mut bytes = vec![0; header.index_len as usize];
        read_exact_at(file, &mut bytes, header.index_offset).map_err(|error| self.names.unreadable(number, &error))?;
        self.read.fetch_add(header.index_len, Ordering::Relaxed);
        if crc32c::crc32c(&bytes) != header.index_crc {
            return Err(self.names.damaged(number, "index: found another checksum than the header says"));
        }
        T::of_bytes(&bytes).ok_or_else(|| self.names.damaged(number, OTHER_INDEX))
    }

    /// A value in some bytes of the index of a task. The others are not read, so that no checksum says that these are right: they are to name
    /// what has one.
    ///
    /// # Errors
    /// Where the task is not done, or its file damaged.
    pub fn index_at<T: Portable>(&self, number: u32, at: u64, len: u64) -> io::Result<T> {
        let opened = self.file(number)?;
        let Opened { file, header, .. } = &*opened;
        if at.checked_add(len).is_none_or(|end| end > header.index_len) {
            let what = format!("index: found {} bytes, expected {len} more behind {at}", header.index_len);
            return Err(self.names.damaged(number, &what));
        }
        // The file has room for it.
        let mut bytes = vec![0; len as usize];
        let read = read_exact_at(file, &mut bytes, header.index_offset + at);
        read.map_err(|error| self.names.unreadable(number, &error))?;
        self.read.fetch_add(len, Ordering::Relaxed);
        T::of_bytes(&bytes).ok_or_else(|| self.names.damaged(number, OTHER_INDEX))
    }

    /// Looks whether the folder has another job by now, whose files are to stay.
    ///
    /// # Errors
    /// Where it has.
    pub(super) fn check_folder(&self) -> Result<(), BuildError> {
        match settings::is_of_other(&self.names.folder, self.names.job) {
            true => Err(job_error(&self.names.folder, "found another job, expected that of this task")),
            false => Ok(()),
        }
    }

    /// Ends the task's own file with an index and gives it its name. The task has read about so many bytes of the source, and written some
    /// elsewhere.
    ///
    /// # Errors
    /// When the disk takes no more, or the folder has another job by now.
    pub fn finish(self, index: &impl Portable, source_bytes: u64, written: u64) -> Result<(), BuildError> {
        self.check_folder()?;
        let read = source_bytes + self.read.load(Ordering::Relaxed);
        let Some(Own { number, file, end, lanes }) = self.own else { return Ok(()) };
        let mut lanes = lanes.into_inner().unwrap_or_else(PoisonError::into_inner);
        lanes.sort_unstable();
        let (mut bytes, start) = (lanes.bytes(), end.into_inner());
        let (lanes_len, lanes_crc) = (bytes.len() as u64, crc32c::crc32c(&bytes));
        let index = index.bytes();
        bytes.extend_from_slice(&index);
        let index_offset = start + lanes_len;
        let index_crc = crc32c::crc32c(&index);
        let index_len = index.len() as u64;
        let header = Header { index_offset, index_len, lanes_len, read, written, index_crc, lanes_crc };
        let path = self.names.path(number);
        let written = write_all_at(file.file(), &bytes, start)
            .and_then(|()| write_all_at(file.file(), &header.encode(self.names.job, number), 0))
            .and_then(|()| file.persist(&path));
        written.map_err(|source| StoreError::Io { path, action: "write", source }.into())
    }
}

/// So many bytes at a place of a file that has `end` of them, in words; no room is made for what is not there.
fn words_at(file: &File, end: u64, at: u64, len: u64) -> io::Result<Vec<u64>> {
    if at.checked_add(len).is_none_or(|last| last > end) {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    let mut words = vec![0_u64; len.div_ceil(8) as usize];
    read_exact_at(file, &mut bytemuck::cast_slice_mut(&mut words)[..len as usize], at)?;
    Ok(words)
}
