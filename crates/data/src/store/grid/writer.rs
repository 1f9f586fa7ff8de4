//! Writing a file of a grid.

use super::super::error::StoreError;
use super::super::layout::GRID_MAGIC;
use super::super::writer::{CompletePageFile, PageFileWriter};
use super::about::{self, GridAbout};
use super::bricks::Bricks;
use super::columns::value_code;
use super::{PAGE_HEAD, PAGE_MAGIC, VERSION, columns_of, lows, parts, words};
use crate::codec::samples;
use crate::hierarchy::wavelet::Hierarchy;
use crate::hierarchy::wavelet::sets::MOST;
use crate::model::SampleType;
use rayon::prelude::*;
use std::path::Path;

/// A file that is being written. Dropping it without [`GridFileWriter::complete`] leaves nothing behind.
#[derive(Debug)]
pub struct GridFileWriter {
    pages: PageFileWriter,
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

impl GridFileWriter {
    /// Starts a file that will appear at `path` when it is finished.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(path: &Path) -> Result<GridFileWriter, StoreError> {
        Ok(GridFileWriter { pages: PageFileWriter::create(path)? })
    }

    /// Writes the pages of a hierarchy and its samples, which are all of the grid, channels side by side in this machine's byte order;
    /// then the footer, with what the levels take.
    ///
    /// # Errors
    /// When the disk cannot be written.
    pub fn complete(
        mut self,
        mut about: GridAbout,
        hierarchy: &Hierarchy,
        samples: &[u8],
    ) -> Result<CompletePageFile, StoreError> {
        let shape = about.grid.shape.map(|side| side as usize);
        let bricks = Bricks { dimensions: about.grid.dimensions, shape };
        if !bricks.fits(hierarchy) {
            return Err(self.pages.unwritable("its hierarchy is of another grid"));
        }
        let low = lows(&about);
        let columns = columns_of(&about, &low);
        let nodes = |brick: Option<usize>| -> (Vec<u8>, Vec<(usize, u64)>) {
            let (mut bytes, mut of_levels) = (Vec::new(), Vec::new());
            for (level, part) in parts(bricks, brick) {
                let own = &hierarchy.levels[level - 1];
                let before = bytes.len();
                columns.encode(own, &part.indices(own.shape), part.shape, &mut bytes);
                of_levels.push((level, (bytes.len() - before) as u64));
            }
            (bytes, of_levels)
        };
        let grid = &about.grid;
        let (kind, channels, size) = (words(grid.sample_type), grid.channels.len(), grid.sample_type.size());
        let brick = |brick: usize| {
            let part = bricks.part(brick, 0);
            let indices = part.indices(shape);
            let channel = |number: usize| -> Vec<u64> {
                indices.iter().map(|index| word(&samples[(index * channels + number) * size..][..size])).collect()
            };
            let all: Vec<Vec<u64>> = (0..channels).map(channel).collect();
            let mut bytes = Vec::new();
            samples::encode(kind, part.shape, &all, &mut bytes);
            (nodes(Some(brick)), bytes)
        };
        let mut bytes_of = vec![0; bricks.all_levels() + 1];
        let all: Vec<usize> = (0..bricks.len()).collect();
        for some in all.chunks(8 * rayon::current_num_threads().max(1)) {
            let made: Vec<_> = some.par_iter().map(|number| brick(*number)).collect();
            for ((nodes, of_levels), samples) in made {
                of_levels.into_iter().for_each(|(level, bytes)| bytes_of[level] += bytes);
                bytes_of[0] += samples.len() as u64;
                self.append(0, nodes)?;
                self.append(1, samples)?;
            }
        }
        if bricks.all_levels() > bricks.levels() {
            let (nodes, of_levels) = nodes(None);
            of_levels.into_iter().for_each(|(level, bytes)| bytes_of[level] += bytes);
            self.append(2, nodes)?;
        }
        for (level, bytes) in about.levels.iter_mut().zip(&bytes_of[1..]) {
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
