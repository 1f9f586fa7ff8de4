//! Containers of Blosc 1 (c-blosc, `README_CHUNK_FORMAT.rst`): bytes in blocks, each of which is unpacked alone.
//!
//! A header of 16 bytes says how; behind it is where each block begins, counted from the container's first byte. A block is one stream,
//! or one for each byte of an element, with its length before it. A stream as long as what is in it is not compressed.

mod codecs;
mod shuffle;
#[cfg(test)]
mod tests;

use super::super::ImportError;
use super::super::bytes::Order;
use super::super::grid::scratch::Storage;
use codecs::Codec;
use std::path::Path;

/// The format's version in all releases of Blosc 1.
const VERSION: u8 = 2;
/// Bytes of the header, and of each number behind it.
const HEADER: u64 = 16;
const NUMBER: u64 = 4;
/// Flags: what was done with elements before they were compressed, that nothing was compressed, what has no meaning, and that blocks are one
/// stream each. The codec's number is above them.
const BYTES_SHUFFLED: u8 = 1;
const COPIED: u8 = 2;
const BITS_SHUFFLED: u8 = 4;
const RESERVED: u8 = 8;
const NOT_SPLIT: u8 = 16;
const CODEC: u32 = 5;
/// The most streams of a block, and the least elements of one that has several; older releases have no flag for that.
const MOST_STREAMS: usize = 16;
const LEAST_ELEMENTS: usize = 128;
/// The largest block, bytes. Blosc itself makes none of more than 4 MiB.
const LARGEST_BLOCK: u64 = 64 << 20;
/// What is not compressed is read in pieces of so many bytes, whatever the blocks are.
const PIECE: u64 = 1 << 20;

/// Where a container is.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub storage: &'a Storage,
    /// The storage's name, and what the container holds.
    pub path: &'a Path,
    pub field: &'a str,
    /// The container's first byte in the storage, and how many there are for it.
    pub start: u64,
    pub space: u64,
}

impl Place<'_> {
    fn wrong(&self, found: String, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(self.path, format!("{} in BLOSC's container", self.field), found, expected)
    }

    /// Fills `out` from byte `at` of the container on.
    fn read(&self, at: u64, out: &mut [u8]) -> Result<(), ImportError> {
        if at.checked_add(out.len() as u64).is_none_or(|end| end > self.space) {
            let expected = format!("{} bytes from byte {at} on", out.len());
            return Err(self.wrong(format!("an end at byte {}", self.space), expected));
        }
        self.storage.read(self.path, self.start + at, out)
    }

    /// The number at byte `at` of the container.
    fn number(&self, at: u64) -> Result<u64, ImportError> {
        let mut bytes = [0; NUMBER as usize];
        self.read(at, &mut bytes)?;
        Ok(u32::from_le_bytes(bytes).into())
    }
}

/// What the header of a container says.
#[derive(Clone, Copy)]
pub(super) struct Container {
    /// Bytes of a block; the last may have fewer.
    pub block: u64,
    /// Bytes of all blocks, and of the container.
    length: u64,
    packed: u64,
    /// Bytes of an element.
    element: usize,
    codec: Codec,
    flags: u8,
}

impl Container {
    /// Reads the header of a container of `length` bytes, 1 or more.
    ///
    /// # Errors
    /// When the header is another's, or is not that of so many bytes.
    pub(super) fn open(place: Place, length: u64) -> Result<Container, ImportError> {
        let mut head = [0; HEADER as usize];
        place.read(0, &mut head)?;
        let [version, _, flags, element, ..] = head;
        let [stated, block, packed] = [4, 8, 12].map(|at| u64::from(Order::Little.u32(&head, at)));
        if version != VERSION {
            return Err(place.wrong(format!("version {version}"), format!("{VERSION}, that of Blosc 1")));
        }
        let Some(codec) = Codec::of(flags >> CODEC).filter(|_| flags & RESERVED == 0) else {
            return Err(place.wrong(format!("flags {flags:#04x}"), "those of Blosc 1"));
        };
        if stated != length {
            return Err(place.wrong(format!("{stated} bytes"), format!("{length}")));
        }
        let is_copied = flags & COPIED != 0;
        let block = if is_copied { PIECE } else { block };
        if !(1..=LARGEST_BLOCK).contains(&block) || element == 0 {
            let found = format!("blocks of {block} bytes with elements of {element}");
            return Err(place.wrong(found, format!("blocks of 1 byte to {} MiB", LARGEST_BLOCK >> 20)));
        }
        let least = HEADER + if is_copied { length } else { NUMBER * length.div_ceil(block) };
        if !(least..=place.space).contains(&packed) {
            let found = format!("a container of {packed} bytes");
            return Err(place.wrong(found, format!("{least} to {}", place.space)));
        }
        Ok(Container { block, length, packed, element: element.into(), codec, flags })
    }

    /// Unpacks a block. No more is held than twice its bytes and the longest of its streams.
    ///
    /// # Errors
    /// When the block is damaged.
    pub(super) fn unpack(&self, place: Place, number: u64) -> Result<Vec<u8>, ImportError> {
        let place = Place { space: self.packed, ..place };
        let first = number * self.block;
        let mut block = vec![0; self.length.saturating_sub(first).min(self.block) as usize];
        if self.flags & COPIED != 0 {
            place.read(HEADER + first, &mut block)?;
            return Ok(block);
        }
        let mut at = place.number(HEADER + NUMBER * number)?;
        let streams = self.streams(block.len());
        let part = (block.len() / streams).max(1);
        if part * streams != block.len() {
            return Err(place.wrong(format!("a block of {} bytes", block.len()), format!("{streams} equal streams")));
        }
        // That is how much longer Snappy may make what it cannot compress.
        let longest = (part + part / 6 + 32) as u64;
        let mut packed = Vec::new();
        for stream in block.chunks_exact_mut(part) {
            let length = place.number(at)?;
            at += NUMBER;
            if length == part as u64 {
                place.read(at, stream)?;
            } else {
                if length > longest {
                    let found = format!("{length} bytes of a stream at byte {at}");
                    return Err(place.wrong(found, format!("at most {longest}")));
                }
                packed.resize(length as usize, 0);
                place.read(at, &mut packed)?;
                if self.codec.unpack(&packed, stream).is_none() {
                    let found = format!("another stream at byte {at}");
                    return Err(place.wrong(found, format!("{part} bytes as {} packs them", self.codec.name())));
                }
            }
            at += length;
        }
        Ok(match self.flags & (BYTES_SHUFFLED | BITS_SHUFFLED) {
            0 => block,
            BITS_SHUFFLED => shuffle::bits_in_order(&block, self.element),
            _ => shuffle::bytes_in_order(&block, self.element),
        })
    }

    /// Streams of a block of `length` bytes.
    fn streams(&self, length: usize) -> usize {
        let is_split = self.flags & NOT_SPLIT == 0
            && self.element <= MOST_STREAMS
            && length / self.element >= LEAST_ELEMENTS
            && length as u64 == self.block;
        if is_split { self.element } else { 1 }
    }
}
