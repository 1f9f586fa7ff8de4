//! Writing a run file: still by still under a temporary name, renamed when everything is on the disk.

use super::layout::{Directory, HEADER_LEN, Header, Section, VERSION};
use super::tracks::TrackIndex;
use crate::model::Progress;
use crate::store::error::StoreError;
use crate::store::layout::{ALIGNMENT, align_up};
use crate::store::temporary::Temporary;
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Bytes of a page file that are copied at a time.
const PIECE: u64 = 1 << 22;

/// A run file that is being written. Dropping it without [`RunFileWriter::finish`] leaves nothing behind.
#[derive(Debug)]
pub struct RunFileWriter {
    path: PathBuf,
    file: Temporary,
    end: u64,
}

impl RunFileWriter {
    /// Starts a file that will appear at `path` when it is finished.
    ///
    /// # Errors
    /// When the folder takes no files.
    pub fn create(path: &Path) -> Result<RunFileWriter, StoreError> {
        if path.file_name().is_none() {
            return Err(StoreError::Unwritable { path: path.to_path_buf(), reason: "it names no file".into() });
        }
        let file = Temporary::create(path, None);
        let file = file.map_err(|source| StoreError::Io { path: path.to_path_buf(), action: "create", source })?;
        let mut writer = RunFileWriter { path: path.to_path_buf(), file, end: 0 };
        writer.pad(ALIGNMENT)?;
        Ok(writer)
    }

    /// Appends a page file, from its first byte on.
    ///
    /// # Errors
    /// When it cannot be read or the run not be written.
    pub fn append(&mut self, mut still: &File, progress: &dyn Progress) -> Result<Section, StoreError> {
        let mut section = self.begin();
        let len = still.metadata().map_err(self.io("read a still of"))?.len();
        progress.begin("copying its page file", len);
        still.rewind().map_err(self.io("read a still of"))?;
        while section.len < len {
            let copied = std::io::copy(&mut still.take(PIECE), &mut self.file.file()).map_err(self.io("write"))?;
            if copied == 0 {
                // It has become shorter meanwhile.
                break;
            }
            section.len += copied;
            progress.advance(copied);
        }
        self.end += section.len;
        self.close()?;
        Ok(section)
    }

    /// Begins a section that is appended to piece by piece.
    pub fn begin(&self) -> Section {
        Section { offset: self.end, len: 0 }
    }

    /// Appends to a section that [`RunFileWriter::begin`] has begun, and which is the last one.
    ///
    /// # Errors
    /// When the run cannot be written.
    pub fn extend(&mut self, section: &mut Section, bytes: &[u8]) -> Result<(), StoreError> {
        self.file.file().write_all(bytes).map_err(self.io("write"))?;
        self.end += bytes.len() as u64;
        section.len += bytes.len() as u64;
        Ok(())
    }

    /// Appends an index of tracks; returns where it is, and its CRC-32C.
    ///
    /// # Errors
    /// When the run cannot be written.
    pub fn append_index(&mut self, index: &TrackIndex) -> Result<(Section, u32), StoreError> {
        let bytes = index.encode();
        let mut section = self.begin();
        self.extend(&mut section, &bytes)?;
        self.close()?;
        Ok((section, crc32c::crc32c(&bytes)))
    }

    /// Ends the last section: the next one begins at a place of its own.
    ///
    /// # Errors
    /// When the run cannot be written.
    pub fn close(&mut self) -> Result<(), StoreError> {
        self.pad(align_up(self.end, ALIGNMENT).unwrap_or(self.end))
    }

    /// Writes directory and header, waits until the disk has them, and moves the file to its name. Returns its length.
    ///
    /// # Errors
    /// When the file cannot be written, or the directory does not say where the stills are that were appended.
    pub fn finish(self, directory: &Directory) -> Result<u64, StoreError> {
        let bytes = directory.encode();
        Directory::decode(&bytes, self.end).map_err(|damage| damage.in_file(&self.path))?;
        let header = Header {
            version: VERSION,
            file_len: self.end + bytes.len() as u64,
            directory: Section { offset: self.end, len: bytes.len() as u64 },
            directory_crc: crc32c::crc32c(&bytes),
        };
        let mut file = self.file.file();
        let written = file
            .write_all(&bytes)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(&header.encode()))
            .and_then(|()| file.sync_all());
        written.map_err(self.io("write"))?;
        let renaming = self.io("rename the finished file to");
        self.file.persist(&self.path).map_err(renaming)?;
        Ok(header.file_len)
    }

    /// Zeros up to `end`.
    fn pad(&mut self, end: u64) -> Result<(), StoreError> {
        const { assert!(HEADER_LEN as u64 <= ALIGNMENT) };
        let zeros = &[0; ALIGNMENT as usize][..(end - self.end) as usize];
        self.file.file().write_all(zeros).map_err(self.io("write"))?;
        self.end = end;
        Ok(())
    }

    fn io(&self, action: &'static str) -> impl FnOnce(std::io::Error) -> StoreError + use<> {
        let path = self.path.clone();
        move |source| StoreError::Io { path, action, source }
    }
}
