//! Photos that lie over measured heights, as shaders have them: tiles in slots of their own, and numbers that find them.

use super::constants::NONE;
use super::pool::{Held, Pool};
use crate::color::colors::to_linear;
use crate::cpu::surface::photo::{Laid, PhotoCut};
use crate::cpu::surface::placed::Placed;
use crate::heights::hierarchy::photo::TILE;
use crate::heights::store::Tile;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::sync::Arc;

/// Tiles on the adapter.
#[derive(Debug)]
pub struct PhotoTiles(Pool<Tile>);

impl Default for PhotoTiles {
    fn default() -> PhotoTiles {
        PhotoTiles(Pool::new("deepfield surface photo", TILE * TILE))
    }
}

/// Where `lists` has what finds a photo's texels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotoList {
    /// The light of each value.
    pub light: u32,
    /// Of each level where its tiles are listed, and how many of them are in a row.
    pub table: u32,
    /// Number of levels; 0: there is no photo.
    pub levels: u32,
}

/// A photo about the sample that others are counted from, along rows and along columns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotoPlace {
    /// Rows and columns of pixels.
    pub size: [u32; 2],
    /// The pixel that others are counted from.
    pub anchor: [i32; 2],
    /// Where the anchor of samples is, from that pixel's edge.
    pub at: [f32; 2],
    /// Pixels that a row and a column of samples is long.
    pub per: [f32; 2],
    /// The field's first and last row.
    pub rows: [f32; 2],
    /// Its first and last column.
    pub columns: [f32; 2],
    /// After how many pixels the photo repeats; 0: it does not.
    pub period: f32,
    /// Whether it goes all around.
    pub is_endless: u32,
}

impl PhotoTiles {
    /// Bytes of the buffer.
    pub fn bytes(&self) -> u64 {
        self.0.bytes()
    }

    /// Holds a photo's tiles, without the finest levels where there is less memory; `None` where there is not enough for any.
    pub fn hold(&mut self, cut: &PhotoCut, memory: u64, adapter: (&RenderDevice, &RenderQueue)) -> Option<Held> {
        let most = self.0.most(memory, adapter.0).checked_sub(1)?;
        let tiles = cut.within(most as usize);
        if tiles.is_empty() {
            return None;
        }
        let above = Some(&cut.above).filter(|above| !above.texels.is_empty());
        let wanted: Vec<&Arc<Tile>> = tiles.iter().chain(above).collect();
        let packed =
            |number: usize| -> Vec<u32> { wanted[number].texels.iter().copied().map(u32::from_le_bytes).collect() };
        self.0.hold(&wanted, memory, adapter, packed)
    }
}

impl PhotoList {
    /// Lists what finds the texels of a photo that is held so.
    pub fn new(cut: &PhotoCut, held: &Held, lists: &mut Vec<u32>) -> PhotoList {
        let lattice = &cut.laid.lattice;
        let (kept, levels) = (lattice.levels(), cut.levels());
        let light = lists.len() as u32;
        lists.extend((0..=u8::MAX).map(|value| to_linear(f32::from(value) / 255.0).to_bits()));
        let table = lists.len();
        lists.resize(table + 2 * levels as usize, NONE);
        for level in 0..levels {
            let [rows, columns] = if level < kept { lattice.tiles_of(level) } else { [1, 1] };
            let first = lists.len();
            lists.resize(first + rows as usize * columns as usize, NONE);
            let entry = table + 2 * level as usize;
            lists[entry] = first as u32;
            lists[entry + 1] = columns;
        }
        for tile in &cut.tiles {
            if let Some(word) = held.first_word(tile) {
                let entry = table + 2 * usize::from(tile.key.level);
                let at = lists[entry] + tile.key.row * lists[entry + 1] + tile.key.column;
                lists[at as usize] = word;
            }
        }
        if let Some(mut word) = held.first_word(&cut.above) {
            for level in kept..levels {
                let at = lists[table + 2 * level as usize];
                lists[at as usize] = word;
                word += lattice.size_of(level).into_iter().product::<u64>() as u32;
            }
        }
        PhotoList { light, table: table as u32, levels }
    }
}

impl PhotoPlace {
    /// Of a photo over a field; samples are counted from a column and a row.
    pub fn new(laid: &Laid, placed: &Placed, [column, row]: [u64; 2]) -> PhotoPlace {
        let size = laid.lattice.size();
        let edges = [laid.place.rows, laid.place.columns];
        let per = [0, 1].map(|axis| size[axis] as f64 / (edges[axis][1] - edges[axis][0]));
        // The copy whose middle is nearest.
        let turn = laid.period.map(|period| period * per[1]);
        let column = (column as f64 - edges[1][0]) * per[1];
        let ahead = turn.map_or(0.0, |turn| ((column - 0.5 * size[1] as f64) / turn).round() * turn);
        let at = [(row as f64 - edges[0][0]) * per[0], column - ahead];
        let whole = at.map(|at| at.floor().clamp(f64::from(i32::MIN / 2), f64::from(i32::MAX / 2)));
        let ends = |axis: usize, samples: u64, ahead: f64| {
            let last = (samples - 1) as f64;
            [0.0, last].map(|sample| ((sample - edges[axis][0]) * per[axis] - ahead - whole[axis]) as f32)
        };
        let wide = edges[1][1] - edges[1][0];
        PhotoPlace {
            size: size.map(|side| side as u32),
            anchor: whole.map(|pixel| pixel as i32),
            at: [0, 1].map(|axis| (at[axis] - whole[axis]) as f32),
            per: per.map(|pixels| pixels as f32),
            rows: ends(0, placed.samples[1], 0.0),
            columns: ends(1, placed.samples[0], ahead),
            period: turn.unwrap_or(0.0) as f32,
            is_endless: u32::from(laid.period.is_some_and(|period| wide >= period * (1.0 - 1e-9))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::surface::placed::Map;
    use crate::heights::hierarchy::photo::PhotoLattice;
    use crate::heights::model::{HeightGrid, PhotoPlace as Edges};
    use crate::model::SampleType;

    #[test]
    fn pixels_count_from_the_copy_that_is_nearest() {
        let grid = HeightGrid::new(361, 19, SampleType::F32);
        let placed = Placed::new(&grid, Map::Plate, 1.0, 0.0);
        let place = Edges { rows: [0.0, 18.0], columns: [-200.0, 160.0] };
        let laid = Laid { lattice: PhotoLattice::new([36, 720]), place, period: Some(360.0) };
        let first = PhotoPlace::new(&laid, &placed, [10, 3]);
        assert_eq!((first.anchor, first.at, first.per), ([6, 420], [0.0, 0.0], [2.0, 2.0]));
        assert_eq!((first.rows, first.columns), ([-6.0, 30.0], [-20.0, 700.0]));
        let other = PhotoPlace::new(&laid, &placed, [300, 3]);
        assert_eq!((other.anchor, other.columns), ([6, 280], [-600.0, 120.0]));
        assert_eq!((other.period, other.is_endless), (720.0, 1));
    }
}
