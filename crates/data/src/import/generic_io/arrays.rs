//! Arrays of a file of which some are compressed, one behind the other as if none were. Blocks are unpacked where they are read.

use super::super::ImportError;
use super::super::bytes::RangeFile;
use super::super::grid::scratch::{Pieces, Storage};
use super::super::unpacked::Unpacked;
use super::CHECKSUM;
use super::blosc::{Container, Place};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Unpacked blocks of all files of a snapshot, by their file, their array and their number in it.
pub(super) type Blocks = Unpacked<(usize, usize, u64)>;

/// Where an array is.
#[derive(Clone, Copy)]
pub(super) struct Array {
    /// Its first byte in the file, where it is not compressed, else that of the checksum before its container.
    pub start: u64,
    /// Bytes of its numbers.
    pub length: u64,
    /// Bytes of container and checksum, where it is compressed.
    pub packed: Option<u64>,
}

impl Array {
    /// Bytes that it takes in the file.
    pub(super) fn stored(&self) -> u64 {
        self.packed.unwrap_or(self.length)
    }
}

/// The arrays of a file.
pub(super) struct Arrays {
    path: PathBuf,
    file: Storage,
    /// Names of the variables, whose arrays follow each other over and over.
    names: Vec<String>,
    arrays: Vec<Numbered>,
    /// What is kept of all files, and this file's number among them.
    blocks: Arc<Blocks>,
    number: usize,
}

struct Numbered {
    /// Bytes of all arrays before it.
    first: u64,
    array: Array,
    /// What is known of its container since it was first read.
    container: OnceLock<Container>,
}

impl Arrays {
    /// The arrays of a file of variables, in their order. `kept` are unpacked blocks of all files, and the file's number.
    pub(super) fn new(
        file: RangeFile,
        names: Vec<String>,
        arrays: impl Iterator<Item = Array>,
        (blocks, number): (&Arc<Blocks>, usize),
    ) -> Arrays {
        let mut next = 0_u64;
        let numbered = |array: Array| {
            let first = next;
            next = next.saturating_add(array.length);
            Numbered { first, array, container: OnceLock::new() }
        };
        let arrays = arrays.map(numbered).collect();
        let (path, blocks) = (file.path.clone(), Arc::clone(blocks));
        Arrays { path, file: Storage::File(file), names, arrays, blocks, number }
    }

    /// Fills the beginning of `out` from byte `at` of an array on, and says how many bytes of it.
    fn fill(&self, number: usize, at: u64, out: &mut [u8]) -> Result<usize, ImportError> {
        let Numbered { array, container, .. } = &self.arrays[number];
        let Some(packed) = array.packed else {
            self.file.read(&self.path, array.start + at, out)?;
            return Ok(out.len());
        };
        let place = Place {
            storage: &self.file,
            path: &self.path,
            field: &self.names[number % self.names.len()],
            start: array.start + CHECKSUM,
            space: packed - CHECKSUM,
        };
        let container = match container.get() {
            Some(known) => *known,
            None => {
                let opened = Container::open(place, array.length)?;
                *container.get_or_init(|| opened)
            }
        };
        let block = at / container.block;
        let bytes = self.blocks.get((self.number, number, block), || container.unpack(place, block))?;
        let bytes = &bytes[(at % container.block) as usize..];
        let count = bytes.len().min(out.len());
        out[..count].copy_from_slice(&bytes[..count]);
        Ok(count)
    }
}

impl Pieces for Arrays {
    fn read(&self, _: &Path, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        let mut filled = 0;
        while filled < out.len() {
            let at = offset.saturating_add(filled as u64);
            let number = self.arrays.partition_point(|array| array.first <= at).saturating_sub(1);
            let left = self.arrays.get(number).and_then(|array| {
                let skipped = at - array.first;
                Some((skipped, array.array.length.checked_sub(skipped).filter(|left| *left > 0)?))
            });
            let Some((skipped, left)) = left else {
                let expected = format!("{} bytes from byte {offset} of the arrays on", out.len());
                return Err(ImportError::malformed(&self.path, "arrays", "their end", expected));
            };
            let end = filled + left.min((out.len() - filled) as u64) as usize;
            filled += self.fill(number, skipped, &mut out[filled..end])?;
        }
        Ok(())
    }
}
