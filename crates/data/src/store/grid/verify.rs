//! Checks every byte of a file of a grid: header, footer and pages have checksums, the bytes between them are zeros, and pages hold what they
//! promise.

use super::super::error::StoreError;
use super::super::page::PageId;
use super::GridFile;
use crate::model::ReadMethod;
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::path::Path;

/// What was verified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VerifiedGrid {
    /// Length of the file.
    pub bytes: u64,
    /// Pages read.
    pub pages: u32,
    /// Nodes.
    pub nodes: u64,
    /// Samples.
    pub samples: u64,
}

/// Verifies a file of a grid.
///
/// # Errors
/// [`StoreError`] for the first thing that is wrong.
pub fn verify_grid(path: &Path, progress: &dyn Progress) -> Result<VerifiedGrid, StoreError> {
    let file = GridFile::open(path, ReadMethod::default())?;
    let pages = file.container.table().len() as u32;
    progress.begin("verifying", u64::from(pages));
    file.container.check_zeros(None)?;
    for page in 0..pages {
        file.page(PageId(page))?;
        file.container.check_zeros(Some(PageId(page)))?;
        progress.advance(1);
    }
    // Brick by brick: a file may hold more than memory does.
    let bricks: Vec<usize> = (0..file.pages_of_nodes()).collect();
    let of_brick = |&number: &usize| -> Result<u64, StoreError> {
        if number < file.bricks.len() {
            file.samples(number, &file.bricks.part(number, 0))?;
        }
        Ok(file.nodes(number)?.iter().map(|nodes| nodes.part.len() as u64).sum())
    };
    let nodes: Vec<u64> = bricks.par_iter().map(of_brick).collect::<Result<_, _>>()?;
    Ok(VerifiedGrid {
        bytes: file.bytes(),
        pages,
        nodes: nodes.iter().sum(),
        samples: file.about.grid.shape.iter().product(),
    })
}
