//! Checks every byte of a file of heights: header, footer and pages have checksums, the bytes between them are zeros, and chunks hold what their
//! records promise.

use super::place::Place;
use super::{Chunk, HeightFile};
use crate::hierarchy::chunks::ChunkKey;
use crate::hierarchy::photo::TileKey;
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
    /// Tiles of a photo.
    pub tiles: u64,
    /// Measured samples at full resolution.
    pub valid: u64,
}

/// What is in a page.
#[derive(Clone, Copy, Debug)]
enum Held {
    Chunk(ChunkKey),
    Tile(TileKey),
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
    // The chunks and tiles of each page, in order.
    let chunks = file.lattice.keys().zip(&file.nodes).map(|(key, record)| (record.place, Held::Chunk(key)));
    let mut keys: Vec<(Place, Held)> = chunks.filter(|(place, _)| place.is_written()).collect();
    let chunks = keys.len() as u64;
    let tiles = file.photo().into_iter().flat_map(|photo| photo.lattice.keys().zip(photo.tiles.iter().copied()));
    keys.extend(tiles.map(|(key, place)| (place, Held::Tile(key))));
    keys.sort_unstable_by_key(|(place, _)| (place.page, place.offset));
    let of_page = |page: u32| -> Result<u64, StoreError> {
        let raw = file.read_page(PageId(page))?;
        let first = keys.partition_point(|(place, _)| place.page < page);
        let mut end = super::PAGE_HEAD as u32;
        let mut valid = 0;
        for (place, held) in keys[first..].iter().take_while(|(place, _)| place.page == page) {
            let wrong =
                |expected: &str| Damage::new(format!("page {page}, byte {}", place.offset), expected).in_file(path);
            if place.offset != end {
                return Err(wrong("a chunk right after the one before"));
            }
            end = place.offset + place.len;
            match held {
                Held::Chunk(key) => {
                    let chunk = file.chunk_in(*key, &raw)?;
                    valid += check_chunk(&file, &chunk).map_err(|expected| wrong(&expected))?;
                }
                Held::Tile(key) => {
                    file.tile_in(*key, &raw)?;
                }
            }
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
    Ok(VerifiedHeights { bytes: file.bytes(), pages, chunks, tiles: keys.len() as u64 - chunks, valid })
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
