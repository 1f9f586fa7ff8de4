//! Strips and tiles: which of them hold the samples of a window, and where they are in the file.

use super::coding::Coding;
use super::directory::Directory;
use super::tag;
use crate::import::content::Content;
use crate::import::raw::decode;
use crate::import::source::Samples;
use crate::model::Window;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{ReadFile, SampleType};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Unpacked bytes that are kept for the next window, besides the newest chunk.
const KEPT: usize = 64 << 20;

/// Unpacked bytes that are made at once, besides one chunk a thread.
const AT_ONCE: u64 = 32 << 20;

/// The chunks of an image.
pub(super) struct Chunks {
    path: PathBuf,
    file: Arc<ReadFile>,
    length: u64,
    size: [u64; 2],
    kind: SampleType,
    coding: Coding,
    /// `strip` or `tile`.
    name: &'static str,
    /// Columns and rows of a chunk.
    chunk: [u64; 2],
    /// Chunks of a row of them.
    across: u64,
    offsets: Vec<u64>,
    counts: Vec<u64>,
}

impl Chunks {
    /// What a directory says of an image of this size.
    ///
    /// # Errors
    /// Where there are too few of them, or one cannot hold what it should.
    pub(super) fn read(
        directory: &Directory,
        size: [u64; 2],
        kind: SampleType,
        coding: Coding,
    ) -> Result<Chunks, ImportError> {
        let content = directory.content;
        let is_tiled = directory.has(tag::TILE_WIDTH) || directory.has(tag::TILE_OFFSETS);
        let (name, chunk, offsets, counts) = if is_tiled {
            let side = |tag: u16, name: &str| directory.needed(tag, name);
            let chunk = [side(tag::TILE_WIDTH, "TileWidth")?, side(tag::TILE_LENGTH, "TileLength")?];
            ("tile", chunk, tag::TILE_OFFSETS, tag::TILE_BYTES)
        } else {
            let rows = directory.number(tag::STRIP_ROWS)?.unwrap_or(size[1]).min(size[1]);
            ("strip", [size[0], rows], tag::STRIP_OFFSETS, tag::STRIP_BYTES)
        };
        let bytes = chunk[0].checked_mul(chunk[1]).and_then(|samples| samples.checked_mul(kind.size() as u64));
        if bytes.is_none_or(|bytes| bytes == 0 || bytes > 1 << 40) {
            return Err(content.malformed(
                &format!("size of a {name}"),
                format!("{} x {}", chunk[0], chunk[1]),
                "sides above 0",
            ));
        }
        let [across, down] = [0, 1].map(|axis| size[axis].div_ceil(chunk[axis]));
        let expected = across.saturating_mul(down);
        let list = |tag: u16, what: &str| -> Result<Vec<u64>, ImportError> {
            let found = directory.numbers(tag, expected)?;
            let found = found.ok_or_else(|| {
                content.missing(&format!("{what} of {name}s"), &format!("entry {tag} of the directory"))
            })?;
            if (found.len() as u64) < expected {
                let expected = format!("{expected} ({across} x {down} {name}s)");
                return Err(content.malformed(&format!("{what} of {name}s"), found.len(), expected));
            }
            Ok(found)
        };
        let offsets = list(offsets, "offsets")?;
        // Old files of one strip leave out how long it is.
        let counts = if directory.has(counts) || expected > 1 {
            list(counts, "sizes")?
        } else {
            offsets.iter().map(|offset| content.length.saturating_sub(*offset)).collect()
        };
        let chunks = Chunks {
            path: content.path.clone(),
            file: content.file(),
            length: content.length,
            size,
            kind,
            coding,
            name,
            chunk,
            across,
            offsets,
            counts,
        };
        for index in 0..expected as usize {
            chunks.check(content, index)?;
        }
        Ok(chunks)
    }

    /// Whether a chunk is in the file, and can hold its samples.
    fn check(&self, content: &Content, index: usize) -> Result<(), ImportError> {
        let (offset, count) = (self.offsets[index], self.counts[index]);
        if count == 0 {
            return Ok(());
        }
        let field = format!("{} {index}", self.name);
        if offset.checked_add(count).is_none_or(|end| end > content.length) {
            let found = format!("{} bytes from byte {offset} on", content.length.saturating_sub(offset));
            return Err(content.malformed(&field, found, format!("{count}")));
        }
        let bytes = self.bytes(index as u64);
        if self.coding.expanded(count) < bytes {
            let most = self.coding.expanded(count);
            let expected = format!("{bytes} ({} x {} of {})", self.chunk[0], bytes / self.row_bytes(), self.kind);
            return Err(content.malformed(&field, format!("at most {most} bytes"), expected));
        }
        Ok(())
    }

    fn row_bytes(&self) -> u64 {
        self.chunk[0] * self.kind.size() as u64
    }

    /// Bytes of a chunk's samples: tiles are whole, the last strip ends with the image.
    fn bytes(&self, index: u64) -> u64 {
        let first = index / self.across * self.chunk[1];
        let rows = if self.name == "tile" { self.chunk[1] } else { self.chunk[1].min(self.size[1] - first) };
        rows * self.row_bytes()
    }

    /// Bytes of the samples of all chunks that the file has, and of those that it leaves out.
    pub(super) fn all_bytes(&self) -> [u64; 2] {
        let mut bytes = [0_u64; 2];
        for (index, count) in self.counts.iter().enumerate() {
            let own = &mut bytes[usize::from(*count == 0)];
            *own = own.saturating_add(self.bytes(index as u64));
        }
        bytes
    }

    /// Where all samples lie in the file one behind the other.
    pub(super) fn in_place(&self) -> Option<u64> {
        let is_next = |index: usize| self.offsets[index] == self.offsets[index - 1] + self.bytes(index as u64 - 1);
        let is_whole = |index: usize| self.counts[index] >= self.bytes(index as u64);
        let count = self.offsets.len();
        let are_strips = self.name == "strip" && self.coding.is_plain();
        (are_strips && (0..count).all(is_whole) && (1..count).all(is_next)).then(|| self.offsets[0])
    }

    /// The samples; those of chunks that the file leaves out are `missing`.
    pub(super) fn samples(self, missing: f64) -> ChunkSamples {
        ChunkSamples { chunks: self, missing, kept: Mutex::default() }
    }

    /// Unpacks a chunk; `None` where the file leaves it out.
    fn unpack(&self, index: u64) -> Result<Option<Vec<u8>>, ImportError> {
        let (offset, count) = (self.offsets[index as usize], self.counts[index as usize]);
        if count == 0 {
            return Ok(None);
        }
        let field = format!("{} {index}", self.name);
        let bytes = self.bytes(index);
        // What is not packed may have more room than samples.
        let count = if self.coding.is_plain() { count.min(bytes) } else { count };
        let mut packed = vec![0; count.min(self.length) as usize];
        let read = self.file.read_exact_at(&mut packed, offset);
        read.map_err(|source| ImportError::io(&self.path, &*field, source))?;
        let unpacked = self.coding.unpack(packed, bytes as usize, self.row_bytes() as usize);
        unpacked
            .map(Some)
            .map_err(|found| ImportError::malformed(&self.path, &*field, found, format!("{bytes} bytes of samples")))
    }
}

/// Chunks that were unpacked, each with the time when it was last used.
#[derive(Default)]
struct Kept {
    chunks: HashMap<u64, (u64, Arc<Vec<u8>>)>,
    by_time: BTreeMap<u64, u64>,
    time: u64,
    bytes: usize,
}

impl Kept {
    fn get(&mut self, index: u64) -> Option<Arc<Vec<u8>>> {
        let (time, chunk) = self.chunks.get_mut(&index)?;
        self.by_time.remove(time);
        self.time += 1;
        *time = self.time;
        self.by_time.insert(self.time, index);
        Some(chunk.clone())
    }

    fn put(&mut self, index: u64, chunk: &Arc<Vec<u8>>) {
        if self.chunks.contains_key(&index) {
            return;
        }
        while self.bytes + chunk.len() > KEPT
            && let Some((_, oldest)) = self.by_time.pop_first()
        {
            self.bytes -= self.chunks.remove(&oldest).map_or(0, |(_, chunk)| chunk.len());
        }
        self.time += 1;
        self.bytes += chunk.len();
        self.chunks.insert(index, (self.time, chunk.clone()));
        self.by_time.insert(self.time, index);
    }
}

/// The samples of an image in chunks.
pub(super) struct ChunkSamples {
    chunks: Chunks,
    missing: f64,
    kept: Mutex<Kept>,
}

impl ChunkSamples {
    /// A chunk's samples. Those that a window needs in part are kept: the next one needs the rest.
    fn chunk(&self, index: u64, is_part: bool) -> Result<Option<Arc<Vec<u8>>>, ImportError> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = kept().get(index) {
            return Ok(Some(found));
        }
        let Some(chunk) = self.chunks.unpack(index)?.map(Arc::new) else { return Ok(None) };
        if is_part {
            kept().put(index, &chunk);
        }
        Ok(Some(chunk))
    }

    /// Puts what a window has of a chunk in its place.
    fn place(&self, index: u64, chunk: Option<&[u8]>, window: Window, out: &mut [f64]) {
        let Chunks { chunk: [wide, high], across, kind, size: [columns, rows], .. } = self.chunks;
        let first = [index % across * wide, index / across * high];
        let (left, right) =
            (first[0].max(window.column), (first[0] + wide).min(window.column + window.columns).min(columns));
        let (top, bottom) = (first[1].max(window.row), (first[1] + high).min(window.row + window.rows).min(rows));
        let count = right.saturating_sub(left) as usize;
        for row in top..bottom {
            let to = ((row - window.row) * window.columns + left - window.column) as usize;
            let out = &mut out[to..to + count];
            let Some(chunk) = chunk else {
                out.fill(self.missing);
                continue;
            };
            let from = (((row - first[1]) * wide + left - first[0]) as usize) * kind.size();
            let bytes = &chunk[from..from + count * kind.size()];
            decode(kind, ByteOrder::Little, bytes, kind.size(), out, |value| value);
        }
    }
}

impl Samples for ChunkSamples {
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        let Chunks { chunk: [wide, high], across, .. } = self.chunks;
        let along = |first: u64, count: u64, side: u64| first / side..(first + count).div_ceil(side);
        let columns = along(window.column, window.columns, wide);
        let indices: Vec<u64> = along(window.row, window.rows, high)
            .flat_map(|row| columns.clone().map(move |column| row * across + column))
            .collect();
        let is_part = |index: u64| {
            let first = [index % across * wide, index / across * high];
            let is_in = |first: u64, side: u64, from: u64, count: u64, all: u64| {
                first >= from && (first + side).min(all) <= from + count
            };
            let [all_columns, all_rows] = self.chunks.size;
            !(is_in(first[0], wide, window.column, window.columns, all_columns)
                && is_in(first[1], high, window.row, window.rows, all_rows))
        };
        let group = (AT_ONCE / (wide * high * self.chunks.kind.size() as u64)).max(rayon::current_num_threads() as u64)
            as usize;
        for group in indices.chunks(group) {
            let chunks: Vec<Result<Option<Arc<Vec<u8>>>, ImportError>> =
                group.par_iter().map(|index| self.chunk(*index, is_part(*index))).collect();
            for (index, chunk) in group.iter().zip(chunks) {
                self.place(*index, chunk?.as_deref().map(Vec::as_slice), window, out);
            }
        }
        Ok(())
    }
}
