//! Checks every byte of a file of heights: header, footer and pages have checksums, the bytes between them are zeros, and chunks hold what their
//! records promise.

use super::{Chunk, HeightFile};
use crate::hierarchy::chunks::ChunkKey;
use deepfield_data::model::ReadMethod;
use deepfield_data::model::progress::Progress;
use deepfield_data::store::error::Damage;
use deepfield_data::store::{PageId, StoreError};
use rayon::prelude::*;
use std::path::Path;

/// What was verified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VerifiedHeights {
    /// Length of the file.
    pub bytes: u64,
    /// Pages read.
    pub pages: u32,
    /// Chunks.
    pub chunks: u64,
    /// Measured samples at full resolution.
    pub valid: u64,
}

/// Verifies a file of heights.
///
/// # Errors
/// [`StoreError`] for the first thing that is wrong.
pub fn verify_heights(path: &Path, progress: &dyn Progress) -> Result<VerifiedHeights, StoreError> {
    let file = HeightFile::open(path, ReadMethod::default())?;
    let pages = file.pages();
    progress.begin("verifying", u64::from(pages));
    file.container.check_zeros(None)?;
    // The chunks of each page, in order.
    let mut keys: Vec<(u32, u32, ChunkKey)> = Vec::new();
    for (key, record) in file.lattice.keys().zip(&file.nodes) {
        if record.is_written() {
            keys.push((record.page, record.offset, key));
        }
    }
    keys.sort_unstable();
    let of_page = |page: u32| -> Result<u64, StoreError> {
        let raw = file.fetch(PageId(page))?;
        file.check(&raw)?;
        let first = keys.partition_point(|(own, ..)| *own < page);
        let mut end = super::PAGE_HEAD as u32;
        let mut valid = 0;
        for (_, offset, key) in keys[first..].iter().take_while(|(own, ..)| *own == page) {
            let chunk = file.decode_checked(*key, &raw)?;
            let wrong = |expected: &str| Damage::new(format!("page {page}, byte {offset}"), expected).in_file(path);
            if *offset != end {
                return Err(wrong("a chunk right after the one before"));
            }
            end = offset + file.record(*key).map_or(0, |record| record.len);
            valid += check_chunk(&file, &chunk).map_err(|expected| wrong(&expected))?;
        }
        // What aligns the page, and the next one.
        if raw.bytes[end as usize..].iter().any(|byte| *byte != 0) {
            return Err(Damage::new(format!("page {page}"), "zeros after its chunks").in_file(path));
        }
        file.container.check_zeros(Some(PageId(page)))?;
        progress.advance(1);
        Ok(valid)
    };
    let valid: u64 = (0..pages).into_par_iter().map(of_page).collect::<Result<Vec<_>, _>>()?.iter().sum();
    if valid != file.about.facts.valid {
        let expected = format!("{} measured samples, found {valid}", file.about.facts.valid);
        return Err(Damage::new("footer", expected).in_file(path));
    }
    Ok(VerifiedHeights { bytes: file.bytes(), pages, chunks: keys.len() as u64, valid })
}

/// Checks a chunk's samples against its record. Returns how many of a leaf were measured, those of borders being the next one's.
fn check_chunk(file: &HeightFile, chunk: &Chunk) -> Result<u64, String> {
    let Some(node) = file.node(chunk.key) else { return Err("a record".into()) };
    let scale = file.about.grid.scale;
    let (mut low, mut high, mut valid) = (f64::INFINITY, f64::NEG_INFINITY, 0);
    let lattice = file.lattice;
    let owns = [(chunk.part.row, chunk.part.rows), (chunk.part.column, chunk.part.columns)];
    let owned: Vec<usize> = owns
        .iter()
        .zip(lattice.samples_of(chunk.key.level.into()))
        .map(|((first, count), all)| count - usize::from(first + (*count as u64) < all))
        .collect();
    for row in 0..chunk.part.rows {
        for column in 0..chunk.part.columns {
            let height = scale.value(chunk.stored_at(row, column));
            (low, high) = (low.min(height), high.max(height));
            valid += u64::from(!height.is_nan() && row < owned[0] && column < owned[1]);
            if chunk.key.level > 0 && height.is_nan() != (chunk.coverage_at(row, column) == 0) {
                return Err("heights where something is covered, and nowhere else".into());
            }
        }
    }
    let fits =
        if chunk.key.level == 0 { low == node.min && high == node.max } else { low >= node.min && high <= node.max };
    if !fits {
        return Err(format!("heights from {} to {}, found {low} to {high}", node.min, node.max));
    }
    Ok(if chunk.key.level == 0 { valid } else { 0 })
}
