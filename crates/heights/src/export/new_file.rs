//! The file that is being written, under another name until it is whole.

use super::ExportError;
use deepfield_data::model::new_file;
use deepfield_data::store::temporary::{folder_of, free_bytes};
use std::io::{BufWriter, Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file that is gone unless it is finished.
pub(super) struct NewFile {
    path: PathBuf,
    file: BufWriter<NamedTempFile>,
}

impl NewFile {
    /// A file that is to be at `path` and may take up to `bytes`.
    ///
    /// # Errors
    /// When the folder takes no files, or its disk has too little room.
    pub(super) fn create(path: &Path, bytes: u64) -> Result<NewFile, ExportError> {
        let fail = |source| ExportError::io(path, source);
        let folder = folder_of(path);
        if let Some(free) = free_bytes(folder).filter(|free| bytes > *free) {
            let message = format!("takes {} MiB, and the disk has {} MiB left", bytes >> 20, free >> 20);
            return Err(fail(Error::new(ErrorKind::StorageFull, message)));
        }
        let file = new_file::builder().tempfile_in(folder).map_err(fail)?;
        Ok(NewFile { path: path.into(), file: BufWriter::with_capacity(1 << 18, file) })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// When they cannot be written.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), ExportError> {
        self.file.write_all(bytes).map_err(|source| ExportError::io(&self.path, source))
    }

    /// The writer, for those who need to go back, or libraries.
    pub(super) fn inner(&mut self) -> &mut BufWriter<NamedTempFile> {
        &mut self.file
    }

    /// What the system said while it was written.
    pub(super) fn failed(&self, source: Error) -> ExportError {
        ExportError::io(&self.path, source)
    }

    /// Gives the file its name, in place of what has it.
    ///
    /// # Errors
    /// When the system refuses.
    pub(super) fn finish(self) -> Result<(), ExportError> {
        let NewFile { path, file } = self;
        let file = file.into_inner().map_err(|error| ExportError::io(&path, error.into_error()))?;
        file.persist(&path).map_err(|error| ExportError::io(&path, error.error))?;
        Ok(())
    }
}
