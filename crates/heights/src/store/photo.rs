//! What a file says of its photo: a description in the footer, a record of each tile, and its tiles.

use super::HeightFile;
use super::place::Place;
use super::tile::{self, Tile};
use crate::hierarchy::photo::{PhotoLattice, TileKey};
use crate::model::photo::{PhotoAbout, PhotoPlace, PhotoRows};
use crate::model::{HeightError, Window};
use deepfield_data::store::container::RawPage;
use deepfield_data::store::error::Damage;
use deepfield_data::store::wire::{Decoder, Encoder};
use deepfield_data::store::{PageId, StoreError};
use rayon::prelude::*;

/// Bytes of a tile's record.
const RECORD_LEN: u64 = 12;
/// The most pixels along a photo's side.
const MOST_SIDE: u64 = 1 << 31;

/// A photo of a file, and where its tiles are.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredPhoto {
    /// What is known of it.
    pub about: PhotoAbout,
    /// Its levels and tiles.
    pub lattice: PhotoLattice,
    /// Where each tile is.
    pub(super) tiles: Vec<Place>,
}

impl StoredPhoto {
    /// Of which no tile is written yet.
    pub(super) fn new(about: PhotoAbout) -> StoredPhoto {
        let lattice = PhotoLattice::new(about.size);
        StoredPhoto { about, lattice, tiles: vec![Place::default(); lattice.tiles() as usize] }
    }

    /// Where a tile is; `None` where there is none.
    pub(super) fn place(&self, key: TileKey) -> Option<Place> {
        self.lattice.has(key).then(|| self.tiles.get(self.lattice.number(key)).copied()).flatten()
    }

    /// Appends the description and the records.
    pub(super) fn encode(&self, out: &mut Encoder) {
        let PhotoAbout { path, format, bytes, size, place, .. } = &self.about;
        out.text(&path.to_string_lossy());
        out.text(format);
        out.u64(*bytes);
        size.iter().for_each(|count| out.u64(*count));
        out.u8(self.about.planes() as u8);
        place.rows.iter().chain(&place.columns).for_each(|edge| out.f64(*edge));
        self.tiles.iter().for_each(|place| place.encode(out));
    }

    /// Reads what [`StoredPhoto::encode`] has written; `most` is how many bytes there are at most.
    pub(super) fn decode(input: &mut Decoder<'_>, most: u64) -> Result<StoredPhoto, Damage> {
        let wrong = |expected: String| Damage::new("footer", expected);
        let path = input.text("the photo's path")?.into();
        let format = input.text("the photo's format")?;
        let bytes = input.u64("the photo's bytes")?;
        let size = [input.u64("the photo's rows")?, input.u64("the photo's columns")?];
        let planes = input.u8("the photo's planes")?;
        let mut edges = [0.0; 4];
        for edge in &mut edges {
            *edge = input.f64("the photo's edges")?;
        }
        let [top, bottom, left, right] = edges;
        let place = PhotoPlace { rows: [top, bottom], columns: [left, right] };
        if !size.iter().all(|count| (1..=MOST_SIDE).contains(count)) || !matches!(planes, 1 | 3) || !place.is_sound() {
            return Err(wrong(format!(
                "a photo with pixels, 1 or 3 planes and a place, found {size:?}, {planes}, {edges:?}"
            )));
        }
        let lattice = PhotoLattice::new(size);
        // Before anything of that size is allocated.
        if lattice.tiles().checked_mul(RECORD_LEN).is_none_or(|len| len > most) {
            return Err(wrong(format!("room for {} tiles", lattice.tiles())));
        }
        let tiles = (0..lattice.tiles()).map(|_| Place::decode(input, "a tile's place")).collect::<Result<_, _>>()?;
        let about = PhotoAbout { path, format, bytes, size, is_grey: planes == 1, place };
        Ok(StoredPhoto { about, lattice, tiles })
    }
}

impl HeightFile {
    /// The photo that lies over the field, if there is one.
    pub fn photo(&self) -> Option<&StoredPhoto> {
        self.about().photo.as_ref()
    }

    /// Reads and decodes a tile of the photo.
    ///
    /// # Errors
    /// [`StoreError`] where the page cannot be read or is damaged, or there is no such tile.
    pub fn tile(&self, key: TileKey) -> Result<Tile, StoreError> {
        self.tile_in(key, &self.read_page(self.page_of_tile(key)?)?)
    }

    /// The page that a tile of the photo is in.
    ///
    /// # Errors
    /// [`StoreError`] where there is no such tile.
    pub fn page_of_tile(&self, key: TileKey) -> Result<PageId, StoreError> {
        Ok(self.tile_place(key)?.1.id())
    }

    /// Decodes a tile that is in a page, which was checked.
    ///
    /// # Errors
    /// [`StoreError`] where the tile is not in it, or is damaged.
    pub fn tile_in(&self, key: TileKey, page: &RawPage) -> Result<Tile, StoreError> {
        let (photo, place) = self.tile_place(key)?;
        let bytes = place.of(&page.bytes).filter(|_| place.id() == page.page);
        let tile = bytes.and_then(|bytes| tile::decode(bytes, key, &photo.lattice, photo.about.planes()));
        tile.ok_or_else(|| {
            let where_it_is =
                format!("page {}, tile {} of level {}", page.page.0, photo.lattice.number(key), key.level);
            Damage::new(where_it_is, "texels of a tile").in_file(self.path())
        })
    }

    fn tile_place(&self, key: TileKey) -> Result<(&StoredPhoto, Place), StoreError> {
        let found = self.photo().and_then(|photo| Some((photo, photo.place(key)?)));
        found.ok_or_else(|| Damage::new("tile", format!("one of a photo, found {key:?}")).in_file(self.path()))
    }
}

/// The photo of a file, read as it was before it was built.
#[derive(Clone, Copy, Debug)]
pub struct PhotoOfFile<'a> {
    file: &'a HeightFile,
    photo: &'a StoredPhoto,
}

impl<'a> PhotoOfFile<'a> {
    /// Of a file that has one.
    pub fn of(file: &'a HeightFile) -> Option<PhotoOfFile<'a>> {
        file.photo().map(|photo| PhotoOfFile { file, photo })
    }
}

impl PhotoRows for PhotoOfFile<'_> {
    fn about(&self) -> &PhotoAbout {
        &self.photo.about
    }

    fn memory_bytes(&self) -> u64 {
        0
    }

    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError> {
        let StoredPhoto { about, lattice, .. } = self.photo;
        let ([rows, columns], planes) = (about.size, about.planes());
        let asked = Window { row: first, column: 0, rows: count, columns };
        if first.checked_add(count).is_none_or(|end| end > rows) || asked.samples() * planes as u64 != out.len() as u64
        {
            let expected = format!("a part of {rows} rows, found {asked:?}");
            return Err(Damage::new("photo", expected).in_file(self.file.path()).into());
        }
        let side = crate::hierarchy::photo::TILE;
        for row in first / side..(first + count).div_ceil(side) {
            let keys = (0..lattice.tiles_of(0)[1]).map(|column| TileKey { level: 0, row: row as u32, column });
            let keys: Vec<TileKey> = keys.collect();
            for some in keys.chunks(4 * rayon::current_num_threads().max(1)) {
                let read: Result<Vec<Tile>, StoreError> = some.par_iter().map(|key| self.file.tile(*key)).collect();
                for Tile { part, texels, .. } in read? {
                    for line in first.max(row * side)..(first + count).min((row + 1) * side) {
                        let own = &texels[(line - part.row) as usize * part.columns..][..part.columns];
                        let start = ((line - first) * columns + part.column) as usize * planes;
                        let out = out[start..].chunks_exact_mut(planes);
                        own.iter().zip(out).for_each(|(texel, out)| out.copy_from_slice(&texel[..planes]));
                    }
                }
            }
        }
        Ok(())
    }
}
