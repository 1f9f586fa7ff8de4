//! The tiles of a page file's photo, read and decoded as they are asked for.

use super::super::photo::{Laid, PhotoTiles};
use super::{PagedSurface, cached};
use deepfield_heights::hierarchy::photo::TileKey;
use deepfield_heights::store::Tile;
use std::sync::Arc;

impl PhotoTiles for PagedSurface {
    fn laid(&self) -> Option<Laid> {
        let photo = self.file.photo()?;
        let place = photo.about.place;
        Some(Laid { lattice: photo.lattice, place, period: place.period(&self.file.about().grid) })
    }

    fn tile(&self, key: TileKey) -> Option<Arc<Tile>> {
        let read = || match self.file.page_of_tile(key) {
            Ok(page) => self.pages.read_patiently(page, |raw| self.file.tile_in(key, raw)).map(Arc::new),
            Err(error) => {
                self.pages.note(&error);
                None
            }
        };
        cached(&self.tiles, key, self.tile_budget_bytes, |tile| size_of_val(tile.texels.as_slice()) as u64, read)
    }
}
