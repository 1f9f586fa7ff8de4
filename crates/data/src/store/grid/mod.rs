//! Files of grids: samples without loss in bricks, and the hierarchy of points over them, in the pages of a page file.
//!
//! Its specification is `docs/page-file.md`, "Grids".

mod about;
mod columns;
mod nodes;
mod verify;
mod writer;

pub use about::{ChannelStatistics, GridAbout, LevelTypes, WaveletLevel};
pub use verify::{VerifiedGrid, verify_grid};
pub use writer::{BrickCode, CodedBrick, GridFileWriter, rounded};

use super::container::{Container, FileKind};
use super::disk::Disk;
use super::error::{Damage, StoreError};
use super::layout::GRID_MAGIC;
use super::open_disk::open_disk;
use super::page::PageId;
use crate::codec::samples::{self, Words};
use crate::hierarchy::wavelet::{Bricks, Part};
use crate::model::url::shown;
use crate::model::{ReadMethod, Region, SampleType};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// The version of files of grids.
const VERSION: u32 = 4;
const KIND: FileKind = FileKind { name: "file of a grid", magic: GRID_MAGIC, versions: [VERSION, VERSION] };
/// First bytes of every page.
const PAGE_MAGIC: [u8; 4] = *b"DFgn";
/// Bytes before what a page holds: magic, number, and zeros.
const PAGE_HEAD: usize = 32;

/// An open file of a grid.
#[derive(Debug)]
pub struct GridFile {
    container: Container,
    about: GridAbout,
    bricks: Bricks,
}

impl GridFile {
    /// Opens a file, here or behind a URL, and checks its header, footer and table of pages. Pages are checked as they are read.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read, is no such file or is damaged.
    pub fn open(path: &Path, method: ReadMethod) -> Result<GridFile, StoreError> {
        GridFile::open_on(&shown(path), open_disk(path, method, KIND.name)?)
    }

    /// The same for bytes that lie anywhere.
    ///
    /// # Errors
    /// As [`GridFile::open`].
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<GridFile, StoreError> {
        let (container, footer) = Container::open_on(path, disk, KIND)?;
        let about = about::decode(&footer).map_err(|damage| damage.in_file(path))?;
        // The footer's check has seen that all samples can be counted.
        let shape = about.grid.shape.map(|side| side as usize);
        let bricks = Bricks { dimensions: about.grid.dimensions, shape };
        let expected = 2 * bricks.len() + usize::from(bricks.all_levels() > bricks.levels());
        if container.table().len() != expected {
            let found = container.table().len();
            return Err(Damage::new("footer", format!("{expected} pages, found {found}")).in_file(path));
        }
        Ok(GridFile { container, about, bricks })
    }

    /// Whether `bytes`, the first ones of a file, say that it is such a file.
    pub fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(&GRID_MAGIC)
    }

    /// What the footer says.
    pub fn about(&self) -> &GridAbout {
        &self.about
    }

    /// Its path, as it was opened.
    pub fn path(&self) -> &Path {
        self.container.path()
    }

    /// Its length, bytes.
    pub fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// Reads the samples of a box into `out`, as [`crate::import::GridSource::read`] does of the source: the same bytes.
    ///
    /// # Errors
    /// [`StoreError`] where a page is damaged, or the box is not in the grid.
    pub fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), StoreError> {
        let grid = &self.about.grid;
        let is_inside = (0..3).all(|axis| region.min[axis] < region.max[axis] && region.max[axis] <= grid.shape[axis]);
        let bytes = region.shape().iter().try_fold(grid.sample_bytes(), |bytes, &count| bytes.checked_mul(count));
        if !is_inside || bytes != Some(out.len() as u64) {
            return Err(Damage::new("region", format!("a part of {}", grid.described())).in_file(self.path()));
        }
        let (min, shape) = (region.min.map(|index| index as usize), region.shape().map(|side| side as usize));
        let size = grid.sample_type.size();
        let touched = (0..self.bricks.len()).map(|brick| (brick, self.bricks.part(brick, 0))).filter(|(_, part)| {
            (0..3).all(|axis| part.min[axis] < min[axis] + shape[axis] && min[axis] < part.min[axis] + part.shape[axis])
        });
        let touched: Vec<(usize, Part)> = touched.collect();
        // So many bricks at a time that what is decoded stays small.
        for some in touched.chunks(2 * rayon::current_num_threads().max(1)) {
            let decoded: Result<Vec<Vec<Vec<u64>>>, StoreError> =
                some.par_iter().map(|(brick, part)| self.samples(*brick, part)).collect();
            for ((_, part), channels) in some.iter().zip(decoded?) {
                for (number, channel) in channels.iter().enumerate() {
                    scatter(channel, part, (min, shape), (number, channels.len(), size), out);
                }
            }
        }
        Ok(())
    }

    /// The samples of a brick, channel by channel.
    fn samples(&self, brick: usize, part: &Part) -> Result<Vec<Vec<u64>>, StoreError> {
        let page = PageId(2 * brick as u32 + 1);
        let bytes = self.page(page)?;
        let grid = &self.about.grid;
        let decoded = samples::decode(words(grid.sample_type), part.shape, grid.channels.len(), &bytes);
        let (channels, taken) = decoded.ok_or_else(|| self.damaged(page, "samples of a brick"))?;
        self.check_end(page, &bytes, taken)?;
        Ok(channels)
    }

    /// What a page holds.
    fn page(&self, page: PageId) -> Result<Vec<u8>, StoreError> {
        let raw = self.container.fetch_page(page)?;
        self.container.check_page(&raw)?;
        let head = raw.bytes.get(..PAGE_HEAD).filter(|head| {
            head[..4] == PAGE_MAGIC && head[4..8] == page.0.to_le_bytes() && head[8..].iter().all(|byte| *byte == 0)
        });
        match head {
            Some(_) => Ok(raw.bytes[PAGE_HEAD..].to_vec()),
            None => Err(self.damaged(page, "its head")),
        }
    }

    /// Whether nothing but zeros, and few of them, follows what was read of a page.
    fn check_end(&self, page: PageId, bytes: &[u8], taken: usize) -> Result<(), StoreError> {
        let rest = bytes.get(taken..).unwrap_or(&[1; 8]);
        match rest.len() < 8 && rest.iter().all(|byte| *byte == 0) {
            true => Ok(()),
            false => Err(self.damaged(page, "an end after what it holds")),
        }
    }

    fn damaged(&self, page: PageId, expected: &str) -> StoreError {
        Damage::new(format!("page {}", page.0), expected).in_file(self.path())
    }

    /// All samples as singles, a plane a channel.
    ///
    /// # Errors
    /// [`StoreError`] where a page is damaged.
    pub fn planes(&self) -> Result<Vec<Vec<f32>>, StoreError> {
        let grid = &self.about.grid;
        let whole = grid.region();
        let bytes = usize::try_from(grid.bytes().unwrap_or(u64::MAX)).unwrap_or(usize::MAX);
        let mut samples = vec![0; bytes];
        self.read(&whole, &mut samples)?;
        Ok(planes_of(grid.sample_type, grid.channels.len(), &samples))
    }
}

/// What words samples of a type are.
fn words(sample_type: SampleType) -> Words {
    Words { bits: 8 * sample_type.size() as u32, is_float: sample_type.is_float() }
}

/// Puts a channel of a brick into a box: `number` of `channels` side by side, of so many bytes.
fn scatter(
    channel: &[u64],
    part: &Part,
    (min, shape): ([usize; 3], [usize; 3]),
    (number, channels, size): (usize, usize, usize),
    out: &mut [u8],
) {
    let first: [usize; 3] = std::array::from_fn(|axis| part.min[axis].max(min[axis]));
    let end: [usize; 3] = std::array::from_fn(|axis| (part.min[axis] + part.shape[axis]).min(min[axis] + shape[axis]));
    for z in first[2]..end[2] {
        for y in first[1]..end[1] {
            let from = ((z - part.min[2]) * part.shape[1] + y - part.min[1]) * part.shape[0];
            let to = ((z - min[2]) * shape[1] + y - min[1]) * shape[0];
            for x in first[0]..end[0] {
                let word = channel[from + x - part.min[0]].to_le_bytes();
                let at = ((to + x - min[0]) * channels + number) * size;
                let bytes = &mut out[at..at + size];
                bytes.copy_from_slice(&word[..size]);
                if cfg!(target_endian = "big") {
                    bytes.reverse();
                }
            }
        }
    }
}

/// Samples side by side as planes of singles.
pub fn planes_of(sample_type: SampleType, channels: usize, samples: &[u8]) -> Vec<Vec<f32>> {
    let size = sample_type.size();
    (0..channels)
        .into_par_iter()
        .map(|channel| {
            let mut values = Vec::with_capacity(samples.len() / size / channels.max(1));
            let mut part = Vec::new();
            // In parts, so that doubles of all samples are never held.
            for chunk in samples.chunks(channels * size * 4096) {
                part.clear();
                sample_type.decode(&chunk[channel * size..], channels, &mut part);
                values.extend(part.iter().map(|value| *value as f32));
            }
            values
        })
        .collect()
}

/// A sentence where doubles of such planes have become infinite, and so have no value in points and pictures.
pub fn beyond_single(sample_type: SampleType, planes: &[Vec<f32>]) -> Option<String> {
    let is_wide = sample_type == SampleType::F64;
    let infinite = planes.iter().filter(|_| is_wide).flatten().filter(|value| value.is_infinite()).count();
    let all: usize = planes.iter().map(Vec::len).sum();
    (infinite > 0).then(|| {
        format!(
            "{infinite} of {all} values are infinite or beyond single precision ({:.1e}): points and pictures have none there",
            f32::MAX
        )
    })
}
