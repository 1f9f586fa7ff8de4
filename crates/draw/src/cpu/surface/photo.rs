//! A photo that lies over a surface: its light at a place, from the level whose texels are as large as pixels there.
//!
//! Which tiles a picture needs follows from what its pixels show, so they are asked for while it is shaded: as many texels as pixels, whatever the
//! photo's size and the levels that heights are drawn from.

use super::placed::Placed;
use super::shade::FINER;
use crate::color::colors::to_linear;
use deepfield_heights::hierarchy::chunks::light::NO_PHOTO;
use deepfield_heights::hierarchy::photo::means::{self, Texel};
use deepfield_heights::hierarchy::photo::{PhotoLattice, TILE, TileKey};
use deepfield_heights::model::PhotoPlace;
use deepfield_heights::store::Tile;
use std::sync::{Arc, OnceLock};

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
    /// How tall and wide that is, in the larger one of the distances of samples from row to row and from column to column.
    texel: [f64; 2],
    /// The level of the field whose samples are as far apart as the larger one of both.
    own_level: f64,
    /// The field's last row and column.
    last: [f64; 2],
    light: [f32; 256],
}

impl<'a> PhotoLook<'a> {
    /// Of a photo over a field; `None` where there is none.
    pub fn new(tiles: &'a dyn PhotoTiles, placed: &Placed) -> Option<PhotoLook<'a>> {
        let laid = tiles.laid()?;
        let Laid { lattice, place, .. } = laid;
        let part = |[from, to]: [f64; 2], count: u64| (to - from) / count as f64;
        let [rows, columns] = lattice.size();
        let size = [part(place.rows, rows), part(place.columns, columns)];
        let [across, along] = placed.spacing();
        let largest = across.max(along);
        let texel = [size[0] * along / largest, size[1] * across / largest];
        let found: Vec<OnceLock<Option<Arc<Tile>>>> = (0..lattice.tiles()).map(|_| OnceLock::new()).collect();
        let level = |level: u32| {
            let first = TileKey { level: level as u8, row: 0, column: 0 };
            (lattice.number(first), lattice.tiles_of(level)[1] as usize)
        };
        let mut look = PhotoLook {
            tiles,
            laid,
            found,
            levels: (0..lattice.levels()).map(level).collect(),
            above: Vec::new(),
            size,
            texel,
            own_level: texel[0].max(texel[1]).log2(),
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

    /// The light at a row and column of the field, where samples of its level `level`, which may be below 0, are as far apart as pixels.
    pub fn at(&self, [row, column]: [f64; 2], level: f64) -> [f32; 3] {
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
        let (mut share, mut at) = (1.0, [0.0; 2]);
        for axis in 0..2 {
            let texels = |sample: f64| (sample - first[axis]) / self.size[axis];
            at[axis] = texels([row, column][axis]);
            // What of a pixel's size lies in the field is in the photo or beside it.
            let half = 0.5 * level.exp2() / self.texel[axis];
            let (from, to) = ((at[axis] - half).max(texels(0.0)), (at[axis] + half).min(texels(self.last[axis])));
            if axis == 0 || !is_endless {
                share *= match from < to {
                    true => ((to.min(pixels[axis]) - from.max(0.0)) / (to - from)).max(0.0),
                    false => f64::from(u8::from((0.0..=pixels[axis]).contains(&at[axis]))),
                };
            }
            at[axis] = at[axis].clamp(0.0, pixels[axis]);
        }
        let none = nothing();
        if share <= 0.0 {
            return none;
        }
        let own = self.between(at, level - self.own_level - FINER).unwrap_or(none);
        std::array::from_fn(|k| none[k] + share as f32 * (own[k] - none[k]))
    }

    /// The light at a place in pixels of the photo, between two levels.
    fn between(&self, at: [f64; 2], level: f64) -> Option<[f32; 3]> {
        let most = self.laid.lattice.levels() as usize - 1 + self.above.len();
        let level = level.clamp(0.0, most as f64);
        let (mut first, share) = (level as usize, level.fract() as f32);
        // Where tiles cannot be read coarser ones stand in.
        let fine = loop {
            match self.of_level(at, first) {
                Some(light) => break light,
                None if first < most => first += 1,
                None => return None,
            }
        };
        let coarse =
            Some(first + 1).filter(|next| share > 0.0 && *next <= most).and_then(|next| self.of_level(at, next));
        Some(coarse.map_or(fine, |coarse| std::array::from_fn(|k| fine[k] + share * (coarse[k] - fine[k]))))
    }

    /// The light of a level: between four texels, of which only those count that lie on the surface; all where none does.
    fn of_level(&self, at: [f64; 2], level: usize) -> Option<[f32; 3]> {
        let lattice = &self.laid.lattice;
        let size = lattice.size_of(level as u32);
        let axis = |axis: usize| {
            let middle = |index: u64| {
                let [from, to] = lattice.pixels(axis, level as u32, index);
                0.5 * (from + to) as f64
            };
            let last = size[axis] - 1;
            let index = ((at[axis] / (1_u64 << level) as f64 - 0.5).max(0.0) as u64).min(last);
            let [from, to] = [middle(index), middle((index + 1).min(last))];
            let share = if index < last { ((at[axis] - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
            (index, share as f32)
        };
        let ((row, down), (column, right)) = (axis(0), axis(1));
        let kept = lattice.levels() as usize;
        let (first, columns, texels) = match level.checked_sub(kept) {
            None => {
                let [own_row, own_column] = [row, column].map(|index| (index / TILE) as u32);
                let tile = self.tile(TileKey { level: level as u8, row: own_row, column: own_column })?;
                let held = tile.held;
                ((row - held.row) as usize * held.columns + (column - held.column) as usize, held.columns, &tile.texels)
            }
            Some(above) => {
                let ([_, columns], texels) = self.above.get(above)?;
                (row as usize * columns + column as usize, *columns, texels)
            }
        };
        let below = if row + 1 < size[0] { columns } else { 0 };
        let beside = usize::from(column + 1 < size[1]);
        let corners = [
            (first, (1.0 - down) * (1.0 - right)),
            (first + beside, (1.0 - down) * right),
            (first + below, down * (1.0 - right)),
            (first + below + beside, down * right),
        ];
        let (mut on, mut all, mut weight) = ([0.0_f32; 3], [0.0_f32; 3], 0.0_f32);
        for (index, own) in corners {
            let [red, green, blue, share] = *texels.get(index)?;
            let counts = own * f32::from(share) / 255.0;
            weight += counts;
            for (k, value) in [red, green, blue].into_iter().enumerate() {
                let light = self.light[usize::from(value)];
                on[k] += counts * light;
                all[k] += own * light;
            }
        }
        Some(if weight > 0.0 { on.map(|sum| sum / weight) } else { all })
    }
}

#[cfg(test)]
mod tests;
