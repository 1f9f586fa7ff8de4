//! The page file of a height field: chunks of all levels in pages, children before parents, and a footer that says what there is.

pub mod about;
pub mod chunk;
pub mod node;
pub mod normals;
pub mod photo;
pub mod place;
pub mod tile;
pub mod verify;
pub mod writer;

pub use about::{HeightAbout, LevelAbout, Rounded};
pub use chunk::Chunk;
pub use photo::{PhotoOfFile, StoredPhoto};
pub use tile::Tile;
pub use verify::{VerifiedHeights, verify_heights};
pub use writer::HeightFileWriter;

use crate::hierarchy::chunks::{ChunkKey, ChunkNode, Lattice, Part};
use crate::model::{HeightError, HeightGrid, Heights, Window};
use deepfield_data::model::url::shown;
use deepfield_data::model::{ReadMethod, Unit};
use deepfield_data::store::container::{Container, FileKind, RawPage};
use deepfield_data::store::error::Damage;
use deepfield_data::store::{Change, Disk, PageId, StoreError, open_disk};
use node::NodeRecord;
use place::Place;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// First bytes of a file of heights.
pub const HEIGHTS_MAGIC: [u8; 8] = *b"\x89DFH\r\n\x1a\n";
/// The version of files of heights.
pub const VERSION: u32 = 4;
/// The version of those with a photo.
pub const WITH_PHOTO: u32 = 5;
/// The version of those with rounded samples, with or without a photo.
pub const ROUNDED: u32 = 6;
const KIND: FileKind = FileKind { name: "file of heights", magic: HEIGHTS_MAGIC, versions: [VERSION, ROUNDED] };
/// Family of pages of chunks.
const CHUNKS: u32 = 0;
/// Family of pages of a photo's tiles.
const TILES: u32 = 1;
/// First bytes of every page.
pub const PAGE_MAGIC: [u8; 4] = *b"DFhe";
/// Bytes before what a page holds: magic, number, and zeros.
pub const PAGE_HEAD: usize = 32;

/// An open file of heights. It holds the footer (64 bytes a chunk), never pages.
#[derive(Debug)]
pub struct HeightFile {
    container: Container,
    about: HeightAbout,
    lattice: Lattice,
    nodes: Vec<NodeRecord>,
}

impl HeightFile {
    /// Opens a file, here or behind a URL, and checks its header, footer and table of pages. Pages are checked as they are read.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read, is no such file or is damaged.
    pub fn open(path: &Path, method: ReadMethod) -> Result<HeightFile, StoreError> {
        HeightFile::open_on(&shown(path), open_disk(path, method, KIND.name)?)
    }

    /// The same for bytes that lie anywhere.
    ///
    /// # Errors
    /// As [`HeightFile::open`].
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<HeightFile, StoreError> {
        let (container, footer) = Container::open_on(path, disk, KIND)?;
        let (about, lattice, nodes) =
            about::decode(&footer, container.version()).map_err(|damage| damage.in_file(path))?;
        let file = HeightFile { container, about, lattice, nodes };
        file.check_places().map_err(|damage| damage.in_file(path))?;
        Ok(file)
    }

    /// The same with x and y that count as degrees; `note` says so in the place of `asked`, if that is among its notes. Samples, and what the
    /// file says of chunks, stay as they are.
    #[must_use]
    pub fn in_degrees(mut self, asked: Option<&str>, note: String) -> HeightFile {
        self.about.grid.xy_unit = Unit::new("deg");
        self.about.notes.retain(|own| asked != Some(own.as_str()));
        self.about.notes.push(note);
        self
    }

    /// Whether `bytes`, the first ones of a file, say that it is such a file.
    pub fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(&HEIGHTS_MAGIC)
    }

    /// What the footer says.
    pub fn about(&self) -> &HeightAbout {
        &self.about
    }

    /// Its levels and chunks.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Its path, as it was opened.
    pub fn path(&self) -> &Path {
        self.container.path()
    }

    /// Its length, bytes.
    pub fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// Number of its pages.
    pub fn pages(&self) -> u32 {
        self.container.table().len() as u32
    }

    /// What is known of a chunk without reading it; `None` where there is no such chunk.
    pub fn node(&self, key: ChunkKey) -> Option<&ChunkNode> {
        self.record(key).map(|record| &record.node)
    }

    /// The page that a chunk is in; `None` where there is no such chunk, or nothing in it.
    pub fn page_of(&self, key: ChunkKey) -> Option<PageId> {
        self.record(key).filter(|record| record.place.is_written()).map(|record| record.place.id())
    }

    /// Bytes of a page in the file, and about how many its chunks take in memory.
    pub fn page_bytes(&self, page: PageId) -> Option<(u64, u64)> {
        self.container.table().get(page.0 as usize).map(|entry| (entry.len.into(), entry.memory.into()))
    }

    /// Reads and decodes a chunk; `None` where there is nothing in it.
    ///
    /// # Errors
    /// [`StoreError`] where the page cannot be read or is damaged, or there is no such chunk.
    pub fn chunk(&self, key: ChunkKey) -> Result<Option<Chunk>, StoreError> {
        match self.page_of(key) {
            Some(page) => self.chunk_in(key, &self.read_page(page)?).map(Some),
            None if self.lattice.has(key) => Ok(None),
            None => Err(Damage::new("chunk", format!("one of {} levels, found {key:?}", self.lattice.levels()))
                .in_file(self.path())),
        }
    }

    /// What has become of the file since it was opened; asks the disk, so it may wait.
    pub fn change(&self) -> Option<Change> {
        self.container.change()
    }

    /// How many pages at a time are best read, where that is up to the disk ([`Disk::reads_at_once`]).
    pub fn reads_at_once(&self) -> Option<usize> {
        self.container.reads_at_once()
    }

    /// Reads a page's bytes and nothing more.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read.
    pub fn fetch(&self, page: PageId) -> Result<RawPage, StoreError> {
        self.container.fetch_page(page)
    }

    /// Reads a page and checks it.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read or is damaged; [`StoreError::Changed`] where that is why.
    pub fn read_page(&self, page: PageId) -> Result<RawPage, StoreError> {
        let raw = self.fetch(page)?;
        self.check(&raw)?;
        Ok(raw)
    }

    /// Decodes a chunk that is in a page, which was checked.
    ///
    /// # Errors
    /// [`StoreError`] where the chunk is not in it, or is damaged.
    pub fn chunk_in(&self, key: ChunkKey, page: &RawPage) -> Result<Chunk, StoreError> {
        let damaged = |expected: &str| {
            let place = format!("page {}, chunk {} of level {}", page.page.0, self.lattice.number(key), key.level);
            Damage::new(place, expected).in_file(self.path())
        };
        let record = self.record(key).filter(|record| self.page_of(key) == Some(page.page) && record.place.len > 0);
        let record = record.ok_or_else(|| damaged("to be in this page"))?;
        let bytes = record.place.of(&page.bytes).ok_or_else(|| damaged("bytes in its page"))?;
        let code = chunk::Code { lattice: &self.lattice, values: self.about.values(), slopes: self.about.slopes };
        chunk::decode(bytes, key, &code, self.about.grid.planes.len()).ok_or_else(|| damaged("samples of a chunk"))
    }

    /// Checks a page's checksum and head.
    fn check(&self, raw: &RawPage) -> Result<(), StoreError> {
        self.container.check_page(raw)?;
        let is_right = raw.bytes.get(..PAGE_HEAD).is_some_and(|head| {
            head[..4] == PAGE_MAGIC && head[4..8] == raw.page.0.to_le_bytes() && head[8..].iter().all(|byte| *byte == 0)
        });
        match is_right {
            true => Ok(()),
            false => Err(Damage::new(format!("page {}", raw.page.0), "its head").in_file(self.path())),
        }
    }

    fn record(&self, key: ChunkKey) -> Option<&NodeRecord> {
        self.lattice.has(key).then(|| self.nodes.get(self.lattice.number(key))).flatten()
    }

    /// Chunks, and tiles of a photo, must fill the pages one after another, without gaps of more than what aligns a page; children come before
    /// their parents.
    fn check_places(&self) -> Result<(), Damage> {
        let children_of = |keys: &mut dyn Iterator<Item = ChunkKey>, place: &dyn Fn(ChunkKey) -> Option<Place>| {
            let mut keys = keys.map(place);
            std::array::from_fn::<_, 4, _>(|_| keys.next().flatten())
        };
        let mut used = vec![0_u64; self.container.table().len()];
        let mut check = |place: Place, family: u32, name: &dyn Fn() -> String, children: &[Option<Place>]| {
            let wrong = |expected: &str| Damage::new(format!("footer, {}", name()), expected);
            let page = self.container.table().get(place.page as usize).filter(|page| page.family == family);
            let page = page.ok_or_else(|| wrong("a page"))?;
            let end = u64::from(place.offset) + u64::from(place.len);
            if (place.offset as usize) < PAGE_HEAD || place.len == 0 || end > u64::from(page.len) {
                return Err(wrong("a place in its page"));
            }
            used[place.page as usize] += u64::from(place.len);
            match children.iter().flatten().all(|child| !child.is_written() || child.is_before(&place)) {
                true => Ok(()),
                false => Err(wrong("children before their parent")),
            }
        };
        for (key, record) in self.lattice.keys().zip(&self.nodes).filter(|(_, record)| record.place.is_written()) {
            let name = || format!("chunk {} of level {}", self.lattice.number(key), key.level);
            let child = |key: ChunkKey| self.record(key).map(|record| record.place);
            check(record.place, CHUNKS, &name, &children_of(&mut self.lattice.children(key), &child))?;
        }
        if let Some(photo) = &self.about.photo {
            for (key, place) in photo.lattice.keys().zip(&photo.tiles) {
                let name = || format!("tile {} of level {}", photo.lattice.number(key), key.level);
                let children = children_of(&mut photo.lattice.children(key), &|child| photo.place(child));
                check(*place, TILES, &name, &children)?;
            }
        }
        for (number, (used, page)) in used.iter().zip(self.container.table().iter()).enumerate() {
            if (PAGE_HEAD as u64 + used).next_multiple_of(8) != u64::from(page.len) {
                return Err(Damage::new(format!("page {number}"), "chunks that fill it"));
            }
        }
        Ok(())
    }

    /// The leaves that samples of a window are read from, with the part of the window that is read from each.
    fn leaves(&self, window: Window) -> Vec<(ChunkKey, Window)> {
        let ranges = |axis: usize, first: u64, count: u64| -> Vec<(u32, u64, u64)> {
            // A border row is read from the leaf after it, where there is one.
            let last = u64::from(self.lattice.chunks_of(0)[axis]) - 1;
            let of = |sample: u64| (sample >> self.lattice.side_bits).min(last);
            let end = first + count;
            (of(first)..=of(end - 1))
                .map(|leaf| {
                    let start = first.max(leaf << self.lattice.side_bits);
                    let stop = if leaf == last { end } else { end.min((leaf + 1) << self.lattice.side_bits) };
                    (leaf as u32, start, stop - start)
                })
                .collect()
        };
        let columns = ranges(1, window.column, window.columns);
        ranges(0, window.row, window.rows)
            .into_iter()
            .flat_map(|(leaf_row, row, rows)| {
                columns.iter().map(move |&(leaf_column, column, columns)| {
                    (ChunkKey { level: 0, row: leaf_row, column: leaf_column }, Window { row, column, rows, columns })
                })
            })
            .collect()
    }

    /// Reads leaves and copies what `take` gives of each (its part and values of this part, row by row) into `out`.
    fn gather<T: Copy + Send>(
        &self,
        window: Window,
        out: &mut [T],
        nothing: T,
        take: impl Fn(Chunk) -> (Part, Vec<T>) + Sync,
    ) -> Result<(), HeightError> {
        if !window.is_in(&self.about.grid) || window.samples() != out.len() as u64 {
            return Err(Damage::new("window", format!("a part of {}", self.about.grid.described()))
                .in_file(self.path())
                .into());
        }
        out.fill(nothing);
        // So many leaves at a time that what is decoded stays small.
        for some in self.leaves(window).chunks(2 * rayon::current_num_threads().max(1)) {
            let read: Result<Vec<_>, StoreError> =
                some.par_iter().map(|(key, own)| Ok(self.chunk(*key)?.map(|chunk| (*own, take(chunk))))).collect();
            for (own, (part, values)) in read?.into_iter().flatten() {
                for row in own.row..own.row + own.rows {
                    let from = (row - part.row) as usize * part.columns + (own.column - part.column) as usize;
                    let to = ((row - window.row) * window.columns + own.column - window.column) as usize;
                    out[to..to + own.columns as usize].copy_from_slice(&values[from..from + own.columns as usize]);
                }
            }
        }
        Ok(())
    }
}

impl Heights for HeightFile {
    fn grid(&self) -> &HeightGrid {
        &self.about.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.gather(window, out, f64::NAN, |chunk| (chunk.held, chunk.stored))
    }

    fn rows_together(&self) -> u64 {
        self.lattice.side()
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        if plane >= self.about.grid.planes.len() {
            let expected = format!("one of {} planes, found number {plane}", self.about.grid.planes.len());
            return Err(Damage::new("colour plane", expected).in_file(self.path()).into());
        }
        self.gather(window, out, 0, |mut chunk| (chunk.part, chunk.planes.swap_remove(plane)))
    }
}
