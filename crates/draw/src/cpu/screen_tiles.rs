//! Particles by the tiles of the picture that they reach, in their order: each tile is drawn by one task, so that pictures that
//! depend on the order need no locks and are the same for any number of threads.

use super::footprint::{Footprint, Lens};
use crate::view::View;
use std::ops::Range;

/// Pixels along a tile's side.
pub const TILE: usize = 32;

/// First and last column of tiles, first and last row.
pub type Reach = [u16; 4];

/// The tiles of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Tiles {
    /// Pixels.
    size: [usize; 2],
    /// Tiles in a row and in a column.
    tiles: [usize; 2],
}

/// Particles of each tile, ascending.
pub struct Bins {
    starts: Vec<u32>,
    indices: Vec<u32>,
}

impl Tiles {
    /// The tiles of a view.
    pub fn new(view: &View) -> Tiles {
        let size = [view.width, view.height].map(|pixels| pixels as usize);
        Tiles { size, tiles: size.map(|pixels| pixels.div_ceil(TILE)) }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.tiles[0] * self.tiles[1]
    }

    /// Pixel columns and rows of a tile.
    pub fn pixels(&self, tile: usize) -> [Range<usize>; 2] {
        let at = [tile % self.tiles[0], tile / self.tiles[0]];
        std::array::from_fn(|axis| at[axis] * TILE..((at[axis] + 1) * TILE).min(self.size[axis]))
    }

    /// The tiles that a footprint reaches; `None` outside the picture.
    pub fn reach(&self, lens: &Lens, footprint: &Footprint) -> Option<Reach> {
        if !lens.sees(footprint, 0.0) {
            return None;
        }
        let tile = |pixel: f64, axis: usize| ((pixel.max(0.0) as usize) / TILE).min(self.tiles[axis] - 1) as u16;
        let [first, last] = [footprint.min, footprint.max];
        Some([tile(first[0], 0), tile(last[0], 0), tile(first[1], 1), tile(last[1], 1)])
    }

    /// All of them.
    pub fn all(&self) -> Reach {
        let [last_column, last_row] = self.tiles.map(|tiles| (tiles - 1) as u16);
        [0, last_column, 0, last_row]
    }

    /// Sorts `particles`, as many as make at most `most` pairs (but one at least), by the tiles that they reach and that are
    /// `open`; where the next ones begin.
    pub fn bin(
        &self,
        reaches: &[Reach],
        particles: Range<usize>,
        most: usize,
        open: impl Fn(usize) -> bool,
    ) -> (Bins, usize) {
        let open: Vec<bool> = (0..self.count()).map(open).collect();
        let mut starts = vec![0u32; self.count() + 1];
        let (mut pairs, mut end) = (0, particles.start);
        while end < particles.end {
            let reach = &reaches[end];
            let more = span(reach[0], reach[1]).len() * span(reach[2], reach[3]).len();
            if end > particles.start && pairs + more > most {
                break;
            }
            pairs += more;
            self.each(reach).filter(|tile| open[*tile]).for_each(|tile| starts[tile] += 1);
            end += 1;
        }
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        let mut cursor = starts.clone();
        let mut indices = vec![0; next as usize];
        for (index, reach) in reaches.iter().enumerate().take(end).skip(particles.start) {
            for tile in self.each(reach).filter(|tile| open[*tile]) {
                let slot = &mut cursor[tile];
                indices[*slot as usize] = index as u32;
                *slot += 1;
            }
        }
        (Bins { starts, indices }, end)
    }

    fn each(&self, reach: &Reach) -> impl Iterator<Item = usize> + use<> {
        let [left, right, top, bottom] = *reach;
        let columns = self.tiles[0];
        span(top, bottom).flat_map(move |row| span(left, right).map(move |column| row * columns + column))
    }
}

fn span(first: u16, last: u16) -> Range<usize> {
    usize::from(first)..usize::from(last) + 1
}

impl Bins {
    /// Pairs of a tile and a particle.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether no particle reaches an open tile.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// The particles of a tile.
    pub fn of(&self, tile: usize) -> &[u32] {
        &self.indices[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}
