//! Where decoded samples go: memory while they are few, else a temporary file without a name.

use super::super::ImportError;
use super::super::bytes::RangeFile;
use crate::model::ReadMethod;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The most that is kept in memory, bytes.
const IN_MEMORY: usize = 64 << 20;

const BUFFER: usize = 1 << 18;

/// The bytes of samples, readable by offset by several threads at once.
pub(in crate::import) enum Storage {
    /// In a file: the source's own, or a temporary one.
    File(RangeFile),
    /// In memory.
    Memory(Vec<u8>),
    /// In pieces that are unpacked where they are read.
    Pieces(Box<dyn Pieces>),
}

/// Bytes that are unpacked piece by piece.
pub(in crate::import) trait Pieces: Send + Sync {
    /// Fills `out` from byte `offset` on.
    ///
    /// # Errors
    /// When there are no such bytes, or a piece is damaged.
    fn read(&self, path: &Path, offset: u64, out: &mut [u8]) -> Result<(), ImportError>;
}

impl Storage {
    /// Fills `out` from byte `offset` on.
    ///
    /// # Errors
    /// When the file cannot be read there.
    pub(in crate::import) fn read(&self, path: &Path, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        match self {
            Storage::File(file) => file.read(offset, out, "data"),
            Storage::Pieces(pieces) => pieces.read(path, offset, out),
            Storage::Memory(bytes) => {
                let from = usize::try_from(offset).ok().and_then(|from| bytes.get(from..)?.get(..out.len()));
                let Some(from) = from else {
                    let expected = format!("{} bytes from byte {offset} on", out.len());
                    return Err(ImportError::malformed(path, "data", bytes.len(), expected));
                };
                out.copy_from_slice(from);
                Ok(())
            }
        }
    }
}

/// Samples on their way to where they are read from.
pub(in crate::import) struct Scratch {
    path: PathBuf,
    memory: Vec<u8>,
    file: Option<BufWriter<File>>,
}

impl Scratch {
    /// For the samples of `path`.
    pub(in crate::import) fn new(path: &Path) -> Scratch {
        Scratch { path: path.into(), memory: Vec::new(), file: None }
    }

    /// Adds bytes at the end.
    ///
    /// # Errors
    /// When the temporary file cannot be made or written.
    pub(in crate::import) fn write(&mut self, bytes: &[u8]) -> Result<(), ImportError> {
        let io = |error| ImportError::io(&self.path, "unpacking", error);
        if self.file.is_none() && self.memory.len() + bytes.len() > IN_MEMORY {
            let mut file = BufWriter::with_capacity(BUFFER, tempfile::tempfile().map_err(io)?);
            file.write_all(&std::mem::take(&mut self.memory)).map_err(io)?;
            self.file = Some(file);
        }
        match &mut self.file {
            Some(file) => file.write_all(bytes).map_err(io)?,
            None => self.memory.extend_from_slice(bytes),
        }
        Ok(())
    }

    /// What was written, to be read.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(in crate::import) fn into_storage(self) -> Result<Storage, ImportError> {
        let Some(file) = self.file else { return Ok(Storage::Memory(self.memory)) };
        let file = file.into_inner().map_err(|error| ImportError::io(&self.path, "unpacking", error.into_error()))?;
        Ok(Storage::File(RangeFile::of(&self.path, file, ReadMethod::Positioned)?))
    }
}
