//! What a build of a grid keeps of nodes until their bricks are built: in memory, or in a temporary file.

use super::BuildError;
use crate::hierarchy::wavelet::{InMemory, Shelf};
use crate::model::positioned::{read_exact_at, write_all_at};
use crate::store::temporary::{Temporary, folder_of, free_bytes};
use std::io;
use std::path::{Path, PathBuf};

/// Why a shelf cannot be written or read.
#[derive(Debug)]
pub(super) struct ShelfError {
    folder: PathBuf,
    source: io::Error,
}

impl From<ShelfError> for BuildError {
    fn from(error: ShelfError) -> BuildError {
        BuildError::Temporary { folder: error.folder, source: error.source }
    }
}

/// A shelf in memory or in a file.
pub(super) struct GridShelf {
    folder: PathBuf,
    place: Place,
}

enum Place {
    Memory(InMemory),
    File(Temporary),
}

impl GridShelf {
    /// One of so many numbers.
    ///
    /// # Errors
    /// Where the folder takes no files, or its disk has too little room.
    pub fn new(output: &Path, folder: Option<&Path>, count: u64, in_memory: bool) -> Result<GridShelf, BuildError> {
        let folder = folder.unwrap_or_else(|| folder_of(output));
        let place = if in_memory {
            Place::Memory(InMemory::new(count))
        } else {
            if let Some(free) = free_bytes(folder).filter(|free| 4 * count > *free) {
                return Err(BuildError::Space {
                    path: output.into(),
                    folder: folder.into(),
                    needed: (4 * count).div_ceil(1 << 20),
                    free: free >> 20,
                });
            }
            Place::File(
                Temporary::create(output, Some(folder))
                    .map_err(|source| ShelfError { folder: folder.into(), source })?,
            )
        };
        Ok(GridShelf { folder: folder.into(), place })
    }
}

impl Shelf for GridShelf {
    type Error = ShelfError;

    fn read(&self, at: u64, out: &mut [f32]) -> Result<(), ShelfError> {
        match &self.place {
            Place::Memory(shelf) => match shelf.read(at, out) {
                Ok(()) => Ok(()),
                Err(never) => match never {},
            },
            Place::File(file) => read_exact_at(file.file(), bytemuck::cast_slice_mut(out), 4 * at)
                .map_err(|source| ShelfError { folder: self.folder.clone(), source }),
        }
    }

    fn write(&self, at: u64, values: &[f32]) -> Result<(), ShelfError> {
        match &self.place {
            Place::Memory(shelf) => match shelf.write(at, values) {
                Ok(()) => Ok(()),
                Err(never) => match never {},
            },
            Place::File(file) => write_all_at(file.file(), bytemuck::cast_slice(values), 4 * at)
                .map_err(|source| ShelfError { folder: self.folder.clone(), source }),
        }
    }
}
