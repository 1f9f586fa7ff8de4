//! Which tiles of a photo a picture needs, for whoever has to know before it is shaded.
//!
//! A tile is needed where a sample of the picture may be a mean of its level's texels or of finer ones: that follows from how near the surface is
//! there and how steep it may be. Where something is missing all the same coarser tiles stand in, as for those that cannot be read.

use super::super::select::extent_of;
use super::super::sight::Sight;
use super::super::stitch::{Mesh, Scene};
use super::{Laid, PhotoTiles, level_of};
use crate::view::View;
use deepfield_heights::hierarchy::chunks::Part;
use deepfield_heights::hierarchy::photo::{TileKey, means};
use deepfield_heights::store::Tile;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Most tiles that are read for a picture: 1 GiB.
const MOST_TILES: usize = 1 << 12;
/// Rows and columns of larger photos are not counted in 32 bits.
const LARGEST: u64 = 1 << 30;
/// Samples that show texels of a tile are beside it by no more of them: a box is nine wide at most, and its middle as much as a box away.
const BESIDE: f64 = 10.0;
/// Directions of a slope that are tried, from along columns to along rows.
const WAYS: u32 = 4;

/// What a picture needs of a photo.
pub struct PhotoCut {
    /// Where it lies.
    pub laid: Laid,
    /// Coarse ones first. None: the processor had better draw it.
    pub tiles: Vec<Arc<Tile>>,
    /// The texels of the levels above the last one that is in tiles, one level after the other.
    pub above: Arc<Tile>,
}

impl PhotoCut {
    /// Of a scene and a view whose pixels are the picture's samples; `None` where there is no photo. Where very many tiles are needed the finest
    /// levels are left out.
    pub fn new(source: &dyn PhotoTiles, scene: &Scene, view: &View) -> Option<PhotoCut> {
        let laid = source.laid()?;
        let lattice = laid.lattice;
        let top = (lattice.levels() - 1) as u8;
        let mut keys = Vec::new();
        if lattice.size().into_iter().all(|side| side <= LARGEST) {
            let needs = Needs::new(laid, scene, view);
            let all: Vec<usize> = (0..needs.grounds.len()).collect();
            needs.visit(TileKey { level: top, row: 0, column: 0 }, &all, &mut keys);
        }
        keys.sort_by_key(|key| (Reverse(key.level), *key));
        keys.truncate(whole_levels(&keys, MOST_TILES));
        let tiles: Vec<Arc<Tile>> = keys.into_par_iter().filter_map(|key| source.tile(key)).collect();
        let highest = tiles.first().filter(|tile| tile.key.level == top);
        let levels = highest.map_or_else(Vec::new, |tile| means::above(&lattice, top.into(), &tile.texels));
        let texels: Vec<_> = levels.into_iter().flat_map(|(_, texels)| texels).collect();
        let part = Part { row: 0, column: 0, rows: texels.len(), columns: 1 };
        let above = Arc::new(Tile { key: TileKey { level: top + 1, row: 0, column: 0 }, part, texels });
        Some(PhotoCut { laid, tiles, above })
    }

    /// Number of levels that there are texels of.
    pub fn levels(&self) -> u32 {
        let lattice = &self.laid.lattice;
        let kept = lattice.levels();
        match self.above.texels.is_empty() {
            true => kept,
            false => (kept..).find(|level| lattice.size_of(*level) == [1, 1]).map_or(kept, |last| last + 1),
        }
    }

    /// As many tiles as there is room for, without the finest levels where there is less.
    pub fn within(&self, most: usize) -> &[Arc<Tile>] {
        let keys: Vec<TileKey> = self.tiles.iter().map(|tile| tile.key).collect();
        &self.tiles[..whole_levels(&keys, most)]
    }
}

/// How many of these, coarse ones first, are whole levels and no more than `most`.
fn whole_levels(keys: &[TileKey], most: usize) -> usize {
    let cut = keys.get(most).map(|key| key.level);
    cut.and_then(|level| keys.iter().position(|key| key.level == level)).unwrap_or(keys.len())
}

/// What tiles are needed for.
struct Needs<'a> {
    laid: Laid,
    scene: &'a Scene,
    sight: Sight,
    view: &'a View,
    grounds: Vec<Ground>,
    /// By how many columns the photo's copies over the field are further.
    copies: Vec<f64>,
    /// Rows and columns of samples that a pixel of the photo covers.
    size: [f64; 2],
}

/// A drawn chunk.
struct Ground {
    /// Its first and last row, and its first and last column.
    ends: [[f64; 2]; 2],
    heights: [f64; 2],
    /// Rows and columns between its samples.
    whole: f64,
    /// The least share of a length on it that is left from above.
    level: f64,
}

impl Ground {
    fn new(mesh: &Mesh, scene: &Scene) -> Option<Ground> {
        let ends = |places: &[u64]| Some([*places.first()? as f64, *places.last()? as f64]);
        let (facts, added) = (&mesh.node.facts, mesh.node.added);
        let whole = (1_u64 << mesh.node.key.level) as f64;
        let [across, along] = scene.placed.spacing();
        let level = match scene.placed.is_flat() {
            true => 1.0 / (facts.step * scene.placed.lift / (whole * across.min(along))).hypot(1.0),
            // What samples of the picture reach over is that seen from above.
            false => 1.0,
        };
        let heights = [facts.min - added, facts.max + added];
        Some(Ground { ends: [ends(&mesh.rows)?, ends(&mesh.columns)?], heights, whole, level })
    }

    /// What of it lies between rows and between columns.
    fn within(&self, ends: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
        let both = [0, 1].map(|axis| [self.ends[axis][0].max(ends[axis][0]), self.ends[axis][1].min(ends[axis][1])]);
        both.iter().all(|[from, to]| from <= to).then_some(both)
    }
}

impl<'a> Needs<'a> {
    fn new(laid: Laid, scene: &'a Scene, view: &'a View) -> Needs<'a> {
        let Laid { lattice, place, period } = laid;
        let [rows, columns] = lattice.size();
        let part = |[from, to]: [f64; 2], count: u64| (to - from) / count as f64;
        let last = (scene.placed.samples[0] - 1) as f64;
        let copies = period.map_or_else(
            || vec![0.0],
            |period| {
                let first = (-place.columns[1] / period).ceil();
                let all = (0..).map(|number| (first + f64::from(number)) * period);
                all.take_while(|ahead| place.columns[0] + ahead <= last).collect()
            },
        );
        Needs {
            laid,
            scene,
            sight: Sight::Flat(*view),
            view,
            grounds: scene.meshes.iter().filter_map(|mesh| Ground::new(mesh, scene)).collect(),
            copies,
            size: [part(place.rows, rows), part(place.columns, columns)],
        }
    }

    /// Finds a tile and those within it, if they are needed for some of these chunks. The topmost one always is.
    fn visit(&self, key: TileKey, grounds: &[usize], found: &mut Vec<TileKey>) {
        let Laid { lattice, place, .. } = &self.laid;
        let (part, texel, own) = (lattice.part(key), (1_u64 << key.level) as f64, usize::from(key.level));
        let ends = |axis: usize, from: f64, first: u64, count: usize| {
            [first as f64 - BESIDE, (first + count as u64) as f64 + BESIDE]
                .map(|edge| (edge * texel).mul_add(self.size[axis], from))
        };
        let rows = ends(0, place.rows[0], part.row, part.rows);
        let columns = ends(1, place.columns[0], part.column, part.columns);
        let (mut under, mut finest) = (Vec::new(), usize::MAX);
        for &number in grounds {
            let ground = &self.grounds[number];
            let copies = self.copies.iter().map(|ahead| columns.map(|column| column + ahead));
            let shared: Vec<_> = copies.filter_map(|columns| ground.within([rows, columns])).collect();
            if shared.is_empty() {
                continue;
            }
            under.push(number);
            for ends in shared {
                // Finer than this is as good as any.
                if finest >= own {
                    finest = finest.min(self.finest(ground, ends).unwrap_or(usize::MAX));
                }
            }
        }
        if finest > own && u32::from(key.level) + 1 < lattice.levels() {
            return;
        }
        found.push(key);
        if finest < own {
            lattice.children(key).for_each(|child| self.visit(child, &under, found));
        }
    }

    /// The finest level that samples of the picture show of a part of a chunk; `None` where it is not seen.
    fn finest(&self, ground: &Ground, ends: [[f64; 2]; 2]) -> Option<usize> {
        let placed = &self.scene.placed;
        let extent = extent_of(placed, ends, ground.heights, ground.whole);
        if !self.view.sees(&extent) {
            return None;
        }
        let depth = self.view.nearest_depth(&extent).max(f64::MIN_POSITIVE);
        let sample = 1.0 / self.sight.pixels_at(depth);
        let [across, along] = placed.spacing();
        let most = self.laid.lattice.levels() as usize - 1;
        // On a slope what is as wide as a sample is narrower from above along one direction.
        let level = |way: u32| {
            let (sine, cosine) = (f64::from(way) / f64::from(WAYS) * FRAC_PI_2).sin_cos();
            let wide = [sine.hypot(ground.level * cosine) / along, cosine.hypot(ground.level * sine) / across];
            level_of([0, 1].map(|axis| 0.5 * sample * wide[axis] / self.size[axis]), most)
        };
        (0..=WAYS).map(level).min()
    }
}
