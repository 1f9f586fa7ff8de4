//! A photo that lies over a surface: its mean light over what a sample of the picture shows.
//!
//! That is a parallelogram of the photo, in place of whose quarters boxes are taken, each at least one of its pixels wide, which makes near pictures go
//! evenly from the middle of a pixel to the next. Means are taken over texels of a level of which a box covers a few, each by as much as it is covered. Which tiles a picture needs follows from what its
//! pixels show, so they are asked for while it is shaded: a few texels a sample, whatever the photo's size and the levels that heights are drawn from.

use super::look::{Attribute, Look};
use super::placed::Placed;
use super::source::SurfaceNodes;
use crate::color::colors::to_linear;
use deepfield_heights::hierarchy::photo::means::{self, Texel};
use deepfield_heights::hierarchy::photo::{PhotoLattice, TILE, TileKey};
use deepfield_heights::model::PhotoPlace;
use deepfield_heights::model::light::NO_PHOTO;
use deepfield_heights::store::Tile;
use std::sync::{Arc, OnceLock};

mod needed;

pub use needed::PhotoCut;

/// Most texels that a box has a part of.
pub const MOST_TEXELS: f64 = 20.0;

/// Where a photo lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laid {
    /// Its levels and tiles.
    pub lattice: PhotoLattice,
    /// Where its edges are.
    pub place: PhotoPlace,
    /// After how many columns of samples it repeats, if it does.
    pub period: Option<f64>,
}

/// A photo in tiles. Several threads may ask at once.
pub trait PhotoTiles: Sync {
    /// Where it lies; `None` where there is none.
    fn laid(&self) -> Option<Laid>;

    /// A tile's texels; `None` where they cannot be read.
    fn tile(&self, key: TileKey) -> Option<Arc<Tile>>;
}

/// Light where there is no photo.
pub fn nothing() -> [f32; 3] {
    [to_linear(f32::from(NO_PHOTO) / 255.0); 3]
}

/// The level, of so many beside the finest one, of which a box covers a few texels. It is so wide, in pixels of the photo.
fn level_of(wide: [f64; 2], most: usize) -> usize {
    let count = |level: usize| {
        let texel = (1_u64 << level) as f64;
        wide.iter().map(|wide| (wide / texel).max(1.0) + 1.0).product::<f64>()
    };
    let guess = (0.5 * (wide[0] * wide[1] / MOST_TEXELS).log2()).max(0.0) as usize;
    (guess.min(most)..most).find(|level| count(*level) <= MOST_TEXELS).unwrap_or(most)
}

/// A photo as a picture shows it.
pub struct PhotoLook<'a> {
    tiles: &'a dyn PhotoTiles,
    laid: Laid,
    /// The tiles that this picture has asked for, in the order of their numbers.
    found: Vec<OnceLock<Option<Arc<Tile>>>>,
    /// Of each level that is kept the number of its first tile, and how many are in a row.
    levels: Vec<(usize, usize)>,
    /// The levels above the last one that is kept: rows and columns, and texels.
    above: Vec<([usize; 2], Vec<Texel>)>,
    /// Rows and columns of samples that a pixel of the photo covers.
    size: [f64; 2],
    /// The field's last row and column.
    last: [f64; 2],
    light: [f32; 256],
}

/// Texels of a level that are held together: from which row and column on, how many are in a row, and they.
type Texels<'t> = ([u64; 2], usize, &'t [Texel]);

impl<'a> PhotoLook<'a> {
    /// Of the photo over a field, where a look shows it and there is one.
    pub fn of(source: &'a dyn SurfaceNodes, look: &Look, placed: &Placed) -> Option<PhotoLook<'a>> {
        let shows = look.attribute == Attribute::Photo;
        source.photo().filter(|_| shows).and_then(|tiles| PhotoLook::new(tiles, placed))
    }

    /// Of a photo over a field; `None` where there is none.
    pub fn new(tiles: &'a dyn PhotoTiles, placed: &Placed) -> Option<PhotoLook<'a>> {
        let laid = tiles.laid()?;
        let Laid { lattice, place, .. } = laid;
        let part = |[from, to]: [f64; 2], count: u64| (to - from) / count as f64;
        let [rows, columns] = lattice.size();
        let level = |level: u32| {
            let first = TileKey { level: level as u8, row: 0, column: 0 };
            (lattice.number(first), lattice.tiles_of(level)[1] as usize)
        };
        let mut look = PhotoLook {
            tiles,
            laid,
            found: (0..lattice.tiles()).map(|_| OnceLock::new()).collect(),
            levels: (0..lattice.levels()).map(level).collect(),
            above: Vec::new(),
            size: [part(place.rows, rows), part(place.columns, columns)],
            last: [placed.samples[1], placed.samples[0]].map(|count| (count - 1) as f64),
            light: std::array::from_fn(|value| to_linear(value as f32 / 255.0)),
        };
        let top = lattice.levels() - 1;
        if let Some(tile) = look.tile(TileKey { level: top as u8, row: 0, column: 0 }) {
            let above = means::above(&lattice, top, &tile.texels);
            look.above = above;
        }
        Some(look)
    }

    fn tile(&self, key: TileKey) -> Option<&Tile> {
        let (first, columns) = self.levels.get(usize::from(key.level))?;
        let slot = self.found.get(first + key.row as usize * columns + key.column as usize)?;
        slot.get_or_init(|| self.tiles.tile(key)).as_deref()
    }

    /// The mean light over a parallelogram about a row and column of the field, whose sides reach over so many rows and columns each.
    pub fn at(&self, [row, column]: [f64; 2], sides: [[f64; 2]; 2]) -> [f32; 3] {
        let pixels = self.laid.lattice.size().map(|count| count as f64);
        let Laid { place, period, .. } = self.laid;
        let mut ahead = 0.0;
        if let Some(period) = period {
            // The copy whose middle is nearest.
            ahead = ((column - 0.5 * (place.columns[0] + place.columns[1])) / period).round() * period;
        }
        let first = [place.rows[0], place.columns[0] + ahead];
        // A photo of a whole turn has no edge at its sides.
        let is_endless = period.is_some_and(|period| place.columns[1] - place.columns[0] >= period * (1.0 - 1e-9));
        let sides = sides.map(|side| [side[0] / self.size[0], side[1] / self.size[1]]);
        let wide = [0, 1].map(|axis| sides[0][axis].abs() + sides[1][axis].abs());
        let (mut share, mut at) = (1.0, [0.0; 2]);
        for axis in 0..2 {
            let texels = |sample: f64| (sample - first[axis]) / self.size[axis];
            at[axis] = texels([row, column][axis]);
            // What of it lies in the field is in the photo or beside it.
            let (from, to) = (at[axis] - 0.5 * wide[axis], at[axis] + 0.5 * wide[axis]);
            let (from, to) = (from.max(texels(0.0)), to.min(texels(self.last[axis])));
            if axis == 0 || !is_endless {
                share *= match from < to {
                    true => ((to.min(pixels[axis]) - from.max(0.0)) / (to - from)).max(0.0),
                    false => f64::from(u8::from((0.0..=pixels[axis]).contains(&at[axis]))),
                };
            }
        }
        let none = nothing();
        // What is no number is nowhere.
        if share.is_nan() || share <= 0.0 {
            return none;
        }
        let own = self.mean(at, sides, wide).unwrap_or(none);
        std::array::from_fn(|k| none[k] + share as f32 * (own[k] - none[k]))
    }

    /// The mean light over a parallelogram of such sides, and as wide as that, about a place; all in pixels of the photo.
    fn mean(&self, at: [f64; 2], sides: [[f64; 2]; 2], wide: [f64; 2]) -> Option<[f32; 3]> {
        if wide.iter().all(|wide| *wide <= 1.0) {
            return self.mean_of_box(at, wide);
        }
        let mut mean = [0.0; 3];
        for [right, down] in [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]] {
            let middle = [0, 1].map(|axis| at[axis] + right * sides[0][axis] + down * sides[1][axis]);
            let own = self.mean_of_box(middle, wide.map(|wide| 0.5 * wide))?;
            (0..3).for_each(|k| mean[k] += 0.25 * own[k]);
        }
        Some(mean)
    }

    /// The mean light over a box.
    fn mean_of_box(&self, at: [f64; 2], wide: [f64; 2]) -> Option<[f32; 3]> {
        let most = self.laid.lattice.levels() as usize - 1 + self.above.len();
        // Where tiles cannot be read coarser ones stand in.
        (level_of(wide, most)..=most).find_map(|level| self.of_level(at, wide, level))
    }

    /// The mean over a level's texels, of which only those count that lie on the surface; all where none does.
    fn of_level(&self, at: [f64; 2], wide: [f64; 2], level: usize) -> Option<[f32; 3]> {
        let lattice = &self.laid.lattice;
        let (size, texel) = (lattice.size_of(level as u32), (1_u64 << level) as f64);
        // The box in pixels, as far as it is in the photo, and the texels that it meets.
        let edges: [[f64; 2]; 2] = std::array::from_fn(|axis| {
            let (half, last) = (0.5 * wide[axis].max(texel), lattice.size()[axis] as f64);
            let middle = at[axis].clamp(0.0, last);
            [(middle - half).max(0.0), (middle + half).min(last)]
        });
        let [rows, columns] = [0, 1].map(|axis| {
            let first = ((edges[axis][0] / texel) as u64).min(size[axis] - 1);
            first..((edges[axis][1] / texel).ceil() as u64).clamp(first + 1, size[axis])
        });
        let weight = |axis: usize, index: u64| {
            let [from, to] = lattice.pixels(axis, level as u32, index).map(|edge| edge as f64);
            ((to.min(edges[axis][1]) - from.max(edges[axis][0])) / texel).max(0.0) as f32
        };
        let (mut on, mut all, mut weights) = ([0.0_f32; 3], [0.0_f32; 3], [0.0_f32; 2]);
        let tile_ends = |range: &std::ops::Range<u64>| range.start / TILE..=(range.end - 1) / TILE;
        for (tile_row, tile_column) in
            tile_ends(&rows).flat_map(|row| tile_ends(&columns).map(move |column| (row, column)))
        {
            let ([first_row, first_column], width, texels) = self.texels(level, [tile_row, tile_column])?;
            let within = |range: &std::ops::Range<u64>, tile: u64| {
                range.start.max(tile * TILE)..range.end.min((tile + 1) * TILE)
            };
            for row in within(&rows, tile_row) {
                let tall = weight(0, row);
                for column in within(&columns, tile_column) {
                    let own = tall * weight(1, column);
                    let index = (row - first_row) as usize * width + (column - first_column) as usize;
                    let [red, green, blue, share] = *texels.get(index)?;
                    let counts = own * f32::from(share) / 255.0;
                    weights = [weights[0] + counts, weights[1] + own];
                    for (k, value) in [red, green, blue].into_iter().enumerate() {
                        let light = self.light[usize::from(value)];
                        on[k] += counts * light;
                        all[k] += own * light;
                    }
                }
            }
        }
        match weights {
            [some, _] if some > 0.0 => Some(on.map(|sum| sum / some)),
            [_, some] if some > 0.0 => Some(all.map(|sum| sum / some)),
            _ => None,
        }
    }

    /// The texels of a level that are held together with those of a tile.
    fn texels(&self, level: usize, [row, column]: [u64; 2]) -> Option<Texels<'_>> {
        match level.checked_sub(self.levels.len()) {
            None => {
                let tile = self.tile(TileKey { level: level as u8, row: row as u32, column: column as u32 })?;
                Some(([tile.part.row, tile.part.column], tile.part.columns, &tile.texels))
            }
            Some(above) => self.above.get(above).map(|([_, columns], texels)| ([0, 0], *columns, &texels[..])),
        }
    }
}

#[cfg(test)]
mod tests;
