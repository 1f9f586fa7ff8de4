//! LAZ: the points of LAS in chunks, each compressed alone (LASzip; Isenburg 2013), also with chunks of different numbers of points as in
//! COPC. Chunks are unpacked where points are read, and the last ones are kept.

use super::super::ImportError;
use super::super::bytes::{Order, RangeFile};
use super::super::grid::scratch::Pieces;
use super::super::guarded::guarded;
use super::super::unpacked::Unpacked;
use super::{Header, record};
use laz::laszip::ChunkTable;
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItem, LazItemType, LazVlr};
use std::io::Cursor;
use std::path::Path;

/// The most bytes of a chunk's points.
const LARGEST_CHUNK: u64 = 256 << 20;
/// Bytes of the places that a chunk begins with, at least.
const LEAST_CHUNK: u64 = 20;

/// How the points of a file are packed (the first number of LASzip's record).
const ONE_CHUNK: u32 = 1;
const CHUNKS: u32 = 2;
const LAYERED_CHUNKS: u32 = 3;

/// The points of a file, as those of LAS would be from byte 0 on.
pub(super) struct PackedPoints {
    file: RangeFile,
    items: Vec<LazItem>,
    /// Bytes of a point.
    stride: u64,
    /// Without empty ones.
    chunks: Vec<Chunk>,
    /// Chunks by their number.
    unpacked: Unpacked<usize>,
}

/// A chunk of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Chunk {
    /// The number of its first point, and how many it has.
    first: u64,
    count: u64,
    /// Where it begins in the file, and its bytes there.
    start: u64,
    bytes: u64,
}

impl PackedPoints {
    /// Finds the chunks of a file.
    ///
    /// # Errors
    /// When what says how it is packed is damaged, or asks for more memory than is sensible.
    pub(super) fn open(file: RangeFile, header: &Header, head: &[u8]) -> Result<PackedPoints, ImportError> {
        let path = &file.path;
        let wrong = |field: &str, found: String, expected: String| ImportError::malformed(path, field, found, expected);
        let record = record(&file, header, head, LazVlr::USER_ID, LazVlr::RECORD_ID)?;
        let missing = || ImportError::missing(path, "LASzip record", "one before the points of a compressed file");
        let record = record.ok_or_else(missing)?;
        let damaged = || wrong("LASzip record", "another".into(), "compressor, items and chunks".into());
        let packing = u32::from(*record.first().ok_or_else(damaged)?);
        let vlr = guarded(|| LazVlr::from_buffer(&record)).and_then(Result::ok).ok_or_else(damaged)?;
        let items = vlr.items().clone();
        let size: u64 = items.iter().map(|item| u64::from(item.size())).sum();
        if items.is_empty() || size != header.stride {
            let expected = format!("{}, the length of a point", header.stride);
            return Err(wrong("bytes of LASzip's items", size.to_string(), expected));
        }
        let chunks = match packing {
            ONE_CHUNK => {
                let bytes = file.length.saturating_sub(header.start);
                vec![Chunk { first: 0, count: header.count, start: header.start, bytes }]
            }
            CHUNKS | LAYERED_CHUNKS => chunks(&file, header, &vlr)?,
            other => return Err(wrong("LASzip's compressor", other.to_string(), "1, 2 or 3".into())),
        };
        let largest = chunks.iter().map(|chunk| chunk.count).max().unwrap_or(0).saturating_mul(size);
        if largest > LARGEST_CHUNK {
            let expected = format!("at most {} MiB; laszip -i FILE.laz -o FILE.las unpacks them", LARGEST_CHUNK >> 20);
            return Err(wrong("chunk of points", format!("one of {largest} bytes"), expected));
        }
        Ok(PackedPoints { items, stride: size, chunks, unpacked: Unpacked::default(), file })
    }

    /// The points of a chunk.
    fn unpack(&self, number: usize) -> Result<Vec<u8>, ImportError> {
        let chunk = self.chunks[number];
        let mut packed = vec![0; chunk.bytes as usize];
        self.file.read(chunk.start, &mut packed, "points")?;
        let mut points = vec![0; (chunk.count * self.stride) as usize];
        let is_layered = self.items[0].version() > 2;
        let is_sensible = !is_layered || self.layers(&packed) <= packed.len() as u64;
        let unpacked = is_sensible.then(|| {
            let bytes = Cursor::new(packed.as_slice());
            match is_layered {
                true => guarded(|| self.fill(LayeredPointRecordDecompressor::new(bytes), &mut points)),
                false => guarded(|| self.fill(SequentialPointRecordDecompressor::new(bytes), &mut points)),
            }
        });
        match unpacked {
            Some(Some(Ok(()))) => Ok(points),
            _ => {
                let found = format!("another chunk from byte {} on", chunk.start);
                let expected = format!("{} points as LASzip packs them", chunk.count);
                Err(ImportError::malformed(&self.file.path, "points", found, expected))
            }
        }
    }

    fn fill<R>(&self, mut packed: impl RecordDecompressor<R>, points: &mut [u8]) -> laz::Result<()> {
        packed.set_fields_from(&self.items)?;
        packed.set_selection(DecompressionSelection::all());
        for point in points.chunks_exact_mut(self.stride as usize) {
            packed.decompress_next(point)?;
        }
        Ok(())
    }

    /// Bytes that the layers of a chunk say they have, with what is before them: its first point, its number of points, and a size for each layer.
    fn layers(&self, packed: &[u8]) -> u64 {
        let layers: u64 = self.items.iter().map(|item| layers_of(item.item_type())).sum();
        let sizes = packed.get(self.stride as usize + 4..).unwrap_or_default();
        let stated = sizes.chunks_exact(4).take(layers as usize).map(|size| u64::from(Order::Little.u32(size, 0)));
        self.stride + 4 + 4 * layers + stated.sum::<u64>()
    }
}

impl Pieces for PackedPoints {
    fn read(&self, path: &Path, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        let mut filled = 0;
        while filled < out.len() {
            let at = offset + filled as u64;
            let number = self.chunks.partition_point(|chunk| chunk.first * self.stride <= at);
            let found = number.checked_sub(1).map(|number| (number, self.chunks[number]));
            let within = found.filter(|(_, chunk)| at < (chunk.first + chunk.count) * self.stride);
            let Some((number, chunk)) = within else {
                let expected = format!("{} bytes from byte {offset} on", out.len());
                return Err(ImportError::malformed(path, "points", "their end", expected));
            };
            let points = self.unpacked.get(number, || self.unpack(number))?;
            let from = &points[(at - chunk.first * self.stride) as usize..];
            let count = from.len().min(out.len() - filled);
            out[filled..filled + count].copy_from_slice(&from[..count]);
            filled += count;
        }
        Ok(())
    }
}

/// Layers that a part of a point is packed in.
fn layers_of(part: LazItemType) -> u64 {
    match part {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => u64::from(count),
        _ => 1,
    }
}

/// Where the chunks are, by the table behind them.
fn chunks(file: &RangeFile, header: &Header, vlr: &LazVlr) -> Result<Vec<Chunk>, ImportError> {
    let path = &file.path;
    let wrong = |field: &str, found: String, expected: &str| ImportError::malformed(path, field, found, expected);
    let number_at = |at: u64| -> Result<u64, ImportError> {
        let mut bytes = [0; 8];
        file.read(at, &mut bytes, "place of the table of chunks")?;
        Ok(u64::from_le_bytes(bytes))
    };
    let first = header.start + 8;
    let is_behind = |table: &u64| *table >= first && table.checked_add(8).is_some_and(|end| end <= file.length);
    // Whoever writes to a pipe cannot go back, and says at the end where the table is.
    let table = Some(number_at(header.start)?).filter(is_behind);
    let table = match table {
        Some(table) => table,
        None => Some(number_at(file.length.saturating_sub(8))?).filter(is_behind).ok_or_else(|| {
            wrong("table of chunks", "none".into(), "one behind the points: was the file written to its end?")
        })?,
    };
    let mut about = [0; 8];
    file.read(table, &mut about, "table of chunks")?;
    let number = u64::from(Order::Little.u32(&about, 4));
    // Behind the last point some writers end with an empty chunk.
    if number.saturating_sub(1) > header.count || number > file.length / LEAST_CHUNK {
        return Err(wrong(
            "number of chunks",
            number.to_string(),
            "no more than points, and than the file has room for",
        ));
    }
    // Two numbers of at most 32 bits each, coded.
    let mut coded = vec![0; (file.length - table).min(64 + 16 * number) as usize];
    file.read(table, &mut coded, "table of chunks")?;
    let varies = vlr.uses_variable_size_chunks();
    let entries = guarded(|| ChunkTable::read(&mut Cursor::new(coded.as_slice()), varies)).and_then(Result::ok);
    let entries = entries.ok_or_else(|| wrong("table of chunks", "another".into(), "sizes as LASzip packs them"))?;
    let (mut chunks, mut points, mut start) = (Vec::new(), 0_u64, first);
    for entry in entries.as_ref() {
        let count = if varies { entry.point_count } else { u64::from(vlr.chunk_size()).min(header.count - points) };
        let end = start.checked_add(entry.byte_count).filter(|end| *end <= table);
        let (Some(end), Some(_)) = (end, points.checked_add(count).filter(|points| *points <= header.count)) else {
            return Err(wrong("table of chunks", "more than there is".into(), "chunks of points within the file"));
        };
        if count > 0 {
            chunks.push(Chunk { first: points, count, start, bytes: entry.byte_count });
        }
        (points, start) = (points + count, end);
    }
    if points != header.count {
        let found = format!("chunks of {points} points");
        return Err(wrong("table of chunks", found, &format!("{}, as the header says", header.count)));
    }
    Ok(chunks)
}
