//! Writing a file of heights, chunk by chunk, children before their parents.

use super::about::{self, HeightAbout, LevelAbout};
use super::node::NodeRecord;
use super::photo::StoredPhoto;
use super::place::Place;
use super::{CHUNKS, HEIGHTS_MAGIC, PAGE_HEAD, PAGE_MAGIC, TILES, chunk, tile};
use crate::hierarchy::chunks::{ChunkKey, ChunkNode, Lattice};
use crate::hierarchy::photo::TileKey;
use crate::model::PhotoAbout;
use deepfield_data::store::writer::CompletePageFile;
use deepfield_data::store::{PageFileWriter, StoreError};
use std::path::Path;

/// Chunks share a page until it has so many bytes.
const PAGE_LEN: usize = 1 << 15;

/// A file of heights that is being written. Dropping it without [`HeightFileWriter::complete`] leaves nothing behind.
#[derive(Debug)]
pub struct HeightFileWriter {
    pages: PageFileWriter,
    lattice: Lattice,
    planes: usize,
    nodes: Vec<NodeRecord>,
    photo: Option<StoredPhoto>,
    /// The page that chunks or tiles come into, which of both, how many they are, and what they take in memory.
    page: Vec<u8>,
    family: u32,
    count: u32,
    memory: u64,
}

impl HeightFileWriter {
    /// Starts a file that will appear at `path` when it is finished.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(path: &Path, lattice: Lattice, planes: usize) -> Result<HeightFileWriter, StoreError> {
        let nodes = vec![NodeRecord::default(); lattice.chunks() as usize];
        Ok(HeightFileWriter {
            pages: PageFileWriter::create(path)?,
            lattice,
            planes,
            nodes,
            photo: None,
            page: Vec::new(),
            family: CHUNKS,
            count: 0,
            memory: 0,
        })
    }

    /// What is known of a chunk so far: may be told before and after its samples are written. `None` where there is no such chunk.
    pub fn node(&mut self, key: ChunkKey) -> Option<&mut ChunkNode> {
        let number = self.lattice.has(key).then(|| self.lattice.number(key))?;
        self.nodes.get_mut(number).map(|record| &mut record.node)
    }

    /// Writes a chunk; its children, if any, must have been written.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn chunk(&mut self, key: ChunkKey, bytes: &[u8]) -> Result<(), StoreError> {
        let memory = chunk::memory(&self.lattice.part(key), key.level, self.planes);
        let place = self.append(CHUNKS, bytes, memory)?;
        let number = self.lattice.number(key);
        if let Some(record) = self.nodes.get_mut(number) {
            record.place = place;
        }
        Ok(())
    }

    /// Says that a photo lies over the field, before any of its tiles is written. All of them must be.
    pub fn photo(&mut self, about: PhotoAbout) {
        self.photo = Some(StoredPhoto::new(about));
    }

    /// Writes a tile of the photo; those below it must have been written.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn tile(&mut self, key: TileKey, bytes: &[u8]) -> Result<(), StoreError> {
        let Some(lattice) = self.photo.as_ref().map(|photo| photo.lattice) else { return Ok(()) };
        let place = self.append(TILES, bytes, tile::memory(&lattice.part(key)))?;
        if let Some(own) = self.photo.as_mut().and_then(|photo| photo.tiles.get_mut(lattice.number(key))) {
            *own = place;
        }
        Ok(())
    }

    /// Appends bytes to the page, or to a new one where that is of another family.
    fn append(&mut self, family: u32, bytes: &[u8], memory: u64) -> Result<Place, StoreError> {
        if family != self.family {
            self.flush()?;
            self.family = family;
        }
        if self.page.is_empty() {
            self.page.extend_from_slice(&PAGE_MAGIC);
            self.page.extend_from_slice(&self.pages.page_count().to_le_bytes());
            self.page.resize(PAGE_HEAD, 0);
        }
        // A page is far shorter than 4 GiB, or is refused as it is written.
        let place = Place { page: self.pages.page_count(), offset: self.page.len() as u32, len: bytes.len() as u32 };
        self.page.extend_from_slice(bytes);
        self.count += 1;
        self.memory += memory;
        if self.page.len() >= PAGE_LEN {
            self.flush()?;
        }
        Ok(place)
    }

    fn flush(&mut self) -> Result<(), StoreError> {
        if self.page.is_empty() {
            return Ok(());
        }
        self.page.resize(self.page.len().next_multiple_of(8), 0);
        self.pages.append(self.family, self.count, self.memory, &self.page)?;
        self.page.clear();
        (self.count, self.memory) = (0, 0);
        Ok(())
    }

    /// Writes the footer. Levels are counted here, and the photo is the one whose tiles were written. Nothing has the file's name yet.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(mut self, mut about: HeightAbout) -> Result<(CompletePageFile, HeightAbout), StoreError> {
        self.flush()?;
        let level = |level: u32| {
            let [rows, columns] = self.lattice.samples_of(level);
            LevelAbout { level, samples: rows * columns, ..LevelAbout::default() }
        };
        about.levels = (0..self.lattice.levels()).map(level).collect();
        for (key, record) in self.lattice.keys().zip(&self.nodes) {
            if record.place.is_written() {
                let level = &mut about.levels[usize::from(key.level)];
                level.chunks += 1;
                level.bytes += u64::from(record.place.len);
            }
        }
        about.photo = self.photo;
        let footer = about::encode(&about, &self.lattice, &self.nodes);
        let file = self.pages.complete_as(HEIGHTS_MAGIC, about.version(), &footer)?;
        Ok((file, about))
    }
}
