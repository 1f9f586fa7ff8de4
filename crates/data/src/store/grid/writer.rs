//! Writing a file of a grid, brick by brick.

use super::super::error::StoreError;
use super::super::layout::GRID_MAGIC;
use super::super::writer::{CompletePageFile, PageFileWriter};
use super::about::{self, GridAbout};
use super::columns::{Columns, value_code};
use super::{PAGE_HEAD, PAGE_MAGIC, VERSION, words};
use crate::codec::samples;
use crate::hierarchy::wavelet::sets::MOST;
use crate::hierarchy::wavelet::{Bricks, Hierarchy};
use crate::model::{Grid, SampleType};
use rayon::prelude::*;
use std::path::Path;

/// A file that is being written. Dropping it without [`GridFileWriter::complete`] leaves nothing behind.
#[derive(Debug)]
pub struct GridFileWriter {
    pages: PageFileWriter,
    /// Bytes of samples, and of the nodes of each level.
    bytes_of: Vec<u64>,
    bricks: Bricks,
}

/// How the bricks of a grid are written.
#[derive(Clone, Debug)]
pub struct BrickCode {
    bricks: Bricks,
    sample_type: SampleType,
    channels: usize,
    low: Vec<f32>,
    has_holes: bool,
}

/// The nodes and the samples of a brick, or the nodes above all bricks, as bytes.
#[derive(Clone, Debug, Default)]
pub struct CodedBrick {
    nodes: Vec<u8>,
    samples: Vec<u8>,
    /// Bytes of each level of the nodes.
    of_levels: Vec<(usize, u64)>,
}

/// Rounds the values of a hierarchy's points to what a file of samples of this type keeps of them.
pub fn rounded(hierarchy: &mut Hierarchy, sample_type: SampleType) {
    let code = value_code(sample_type.size(), sample_type.is_float());
    let ranges = &hierarchy.ranges;
    hierarchy.levels.par_iter_mut().for_each(|level| {
        for ((large, points), (low, _)) in level.large.iter_mut().zip(&mut level.points).zip(ranges) {
            large.iter_mut().for_each(|value| *value = code.rounded(*value, *low));
            points.iter_mut().for_each(|points: &mut [f32; MOST]| {
                points.iter_mut().for_each(|value| *value = code.rounded(*value, *low));
            });
        }
    });
}

impl BrickCode {
    /// For a grid whose planes have these ranges.
    pub fn new(grid: &Grid, ranges: &[(f32, f32)], has_holes: bool) -> BrickCode {
        BrickCode {
            bricks: bricks_of(grid),
            sample_type: grid.sample_type,
            channels: grid.channels.len(),
            low: ranges.iter().map(|(low, _)| *low).collect(),
            has_holes,
        }
    }

    /// A brick's nodes and its samples, which are all of it, channels side by side in this machine's byte order.
    pub fn brick(&self, brick: usize, nodes: &Hierarchy, samples: &[u8]) -> CodedBrick {
        let mut coded = self.nodes(nodes, 0);
        let (channels, size) = (self.channels, self.sample_type.size());
        let channel = |number: usize| -> Vec<u64> {
            samples.chunks_exact(channels * size).map(|sample| word(&sample[number * size..][..size])).collect()
        };
        let all: Vec<Vec<u64>> = (0..channels).map(channel).collect();
        samples::encode(words(self.sample_type), self.bricks.part(brick, 0).shape, &all, &mut coded.samples);
        coded
    }

    /// The nodes above all bricks.
    pub fn top(&self, nodes: &Hierarchy) -> CodedBrick {
        self.nodes(nodes, self.bricks.levels())
    }

    /// Nodes of which the finest level comes after `first` others.
    fn nodes(&self, nodes: &Hierarchy, first: usize) -> CodedBrick {
        let columns = Columns {
            dimensions: self.bricks.dimensions,
            values: value_code(self.sample_type.size(), self.sample_type.is_float()),
            low: &self.low,
            has_holes: self.has_holes,
        };
        let mut coded = CodedBrick::default();
        for (at, level) in nodes.levels.iter().enumerate().rev() {
            let before = coded.nodes.len();
            let all: Vec<usize> = (0..level.set.len()).collect();
            columns.encode(level, &all, level.shape, &mut coded.nodes);
            coded.of_levels.push((first + at + 1, (coded.nodes.len() - before) as u64));
        }
        coded
    }
}

/// How a grid is cut into bricks.
pub(super) fn bricks_of(grid: &Grid) -> Bricks {
    Bricks { dimensions: grid.dimensions, shape: grid.shape.map(|side| side as usize) }
}

impl GridFileWriter {
    /// Starts a file of a grid that will appear at `path` when it is finished.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(path: &Path, grid: &Grid) -> Result<GridFileWriter, StoreError> {
        let bricks = bricks_of(grid);
        Ok(GridFileWriter { pages: PageFileWriter::create(path)?, bytes_of: vec![0; bricks.all_levels() + 1], bricks })
    }

    /// Writes the pages of the next brick; bricks come in order.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn brick(&mut self, coded: CodedBrick) -> Result<(), StoreError> {
        self.count(&coded);
        self.append(0, coded.nodes)?;
        self.append(1, coded.samples)
    }

    fn count(&mut self, coded: &CodedBrick) {
        coded.of_levels.iter().for_each(|(level, bytes)| self.bytes_of[*level] += bytes);
        self.bytes_of[0] += coded.samples.len() as u64;
    }

    /// Writes the nodes above all bricks, where there are any, and the footer, with what the levels take.
    ///
    /// # Errors
    /// When the disk cannot be written, or bricks are missing.
    pub fn complete(mut self, mut about: GridAbout, top: CodedBrick) -> Result<CompletePageFile, StoreError> {
        if self.pages.page_count() as usize != 2 * self.bricks.len() {
            return Err(self.pages.unwritable("bricks are missing"));
        }
        if self.bricks.all_levels() > self.bricks.levels() {
            self.count(&top);
            self.append(2, top.nodes)?;
        }
        for (level, bytes) in about.levels.iter_mut().zip(&self.bytes_of[1..]) {
            level.bytes = *bytes;
        }
        self.pages.complete_as(GRID_MAGIC, VERSION, &about::encode(&about))
    }

    /// Appends a page: of a brick's nodes, of its samples, or of the nodes above all bricks.
    fn append(&mut self, kind: u32, content: Vec<u8>) -> Result<(), StoreError> {
        let mut page = PAGE_MAGIC.to_vec();
        page.extend_from_slice(&self.pages.page_count().to_le_bytes());
        page.resize(PAGE_HEAD, 0);
        page.extend(content);
        page.resize(page.len().next_multiple_of(8), 0);
        self.pages.append(kind, 1, 0, &page)?;
        Ok(())
    }
}

/// A sample's bits.
fn word(bytes: &[u8]) -> u64 {
    let mut word = [0; 8];
    word[..bytes.len()].copy_from_slice(bytes);
    if cfg!(target_endian = "big") {
        word[..bytes.len()].reverse();
    }
    u64::from_le_bytes(word)
}
