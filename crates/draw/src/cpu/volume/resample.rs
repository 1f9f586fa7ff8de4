//! Resampling (F12 5.5): particles are binned to the bricks of a slab, and each brick gathers its own ([`super::gather`]).
//!
//! Every cell holds `sum m W(|r - r_j|, h_j)` at its centre, and `sum m A W` where there is an attribute; what wide particles add is
//! interpolated from coarser grids ([`coarse`]). A brick is filled by one task in the order of the particles, so the field is the
//! same to the last bit for any number of threads.

use super::bricks::{self, BRICK, Brick, BrickGrid, Layer, Slab, SpareCells};
use super::coarse::{self, Interpolate, Peaks, Scratch};
use super::gather::Gather;
use super::particles::Projected;
use super::stretched::Body;
use super::supply::{Part, Portions};
use super::{Fill, Prepared};
use crate::model::Kernel;
use pulp::Arch;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// What a slab's resampling took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Pairs of a brick and a particle that reaches it.
    pub pairs: u64,
    /// Bricks that hold something.
    pub bricks: u64,
}

/// Resamples a grid from front to back. Coarser layers that more than one slab reads, and the memory of bricks, are kept.
pub struct Resampler<'a> {
    prepared: &'a Prepared,
    kernel: Kernel,
    /// Depths between which the particles of each chunk reach.
    reach: Vec<[f32; 2]>,
    /// Layers of each coarser level, for those before it.
    held: Vec<Slab>,
    spare: SpareCells,
    /// Densities up to this show nothing.
    least: f32,
    /// The layer that was resampled last, and for each of its bricks whether it may show.
    last: Option<(usize, Vec<bool>)>,
    /// Particles that are not all there at once, and come before those that are.
    portions: Option<Mutex<Portions<'a>>>,
}

impl<'a> Resampler<'a> {
    /// Nothing is resampled yet.
    pub fn new(prepared: &'a Prepared, kernel: Kernel) -> Resampler<'a> {
        let held = vec![Slab::default(); prepared.levels.len()];
        let (reach, spare) = (reaches(&prepared.particles), SpareCells::default());
        Resampler { prepared, kernel, reach, held, spare, least: 0.0, last: None, portions: None }
    }

    /// The same with particles that come a portion at a time.
    #[must_use]
    pub fn supplied_by(self, portions: Portions<'a>) -> Resampler<'a> {
        Resampler { portions: Some(Mutex::new(portions)), ..self }
    }

    /// What has come a portion at a time.
    pub fn into_portions(self) -> Option<Portions<'a>> {
        self.portions.map(|portions| portions.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// The same for a picture in which densities up to `least` show nothing: bricks are left out where nothing in them or next
    /// to them is denser.
    #[must_use]
    pub fn showing_above(self, least: f32) -> Resampler<'a> {
        Resampler { least, ..self }
    }

    /// Resamples `layers` of the grid, fastest if they follow those of the last call. Bricks of columns that are `hidden` (one
    /// flag for each, row by row; none for an empty slice) are left out; they have to stay hidden.
    pub fn resample(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work) {
        let mut work = Work::default();
        let layers = self.advance(0, layers, hidden, &mut work);
        work.bricks = layers.iter().flatten().flatten().count() as u64;
        (layers, work)
    }

    /// Takes the memory of layers that are not needed any more.
    pub fn recycle(&mut self, layers: impl IntoIterator<Item = Layer>) {
        self.spare.keep(layers);
    }

    /// Resamples layers of a level, after what they need of the next.
    fn advance(&mut self, level: usize, layers: Range<usize>, hidden: &[bool], work: &mut Work) -> Vec<Layer> {
        let levels = &self.prepared.levels;
        if let Some(coarser) = levels.get(level + 1) {
            let wanted = coarse::layers_read_by(&layers);
            let Slab { first, layers: mut held } = std::mem::take(&mut self.held[level + 1]);
            // What lies before is not read any more, and what is read lies in the order of the slabs.
            let done = wanted.start.checked_sub(first).map_or(held.len(), |before| before.min(held.len()));
            self.recycle(held.drain(..done));
            let missing = wanted.start + held.len()..wanted.end;
            if !missing.is_empty() {
                let hidden = coarse::hidden_by(hidden, &levels[level], coarser);
                held.extend(self.advance(level + 1, missing, &hidden, work));
            }
            self.held[level + 1] = Slab { first: wanted.start, layers: held };
        }
        self.fill(level, layers, hidden, work)
    }

    /// The bricks of some layers of a level: its own particles, and the field of the coarser levels.
    fn fill(&mut self, level: usize, layers: Range<usize>, hidden: &[bool], work: &mut Work) -> Vec<Layer> {
        let Prepared { levels, particles, .. } = self.prepared;
        let brick_grid = &levels[level];
        let count = layers.len() * brick_grid.of_layer();
        let part = Part { level, layers: &layers, hidden };
        let mut begun: Vec<Option<Brick>> = vec![None; count];
        if let Some(mut portions) = self.portions.take() {
            let own = portions.get_mut().unwrap_or_else(PoisonError::into_inner);
            own.visit(self.prepared, &part, &mut |portion: &Projected| {
                let bins = self.bins(portion, &reaches(portion), &part);
                work.pairs += bins.particles.len() as u64;
                self.begin(&part, portion, &bins, &mut begun);
            });
            self.portions = Some(portions);
        }
        let bins = self.bins(particles, &self.reach, &part);
        work.pairs += bins.particles.len() as u64;
        let wanted = match level {
            0 => {
                let is_reached = |index: usize| begun[index].is_some() || !bins.of(index).is_empty();
                let reached: Vec<bool> = (0..count).map(is_reached).collect();
                self.shown(&layers, hidden, &reached)
            }
            _ => vec![true; count],
        };
        let coarser = levels.get(level + 1).map(|coarser| (coarser, &self.held[level + 1]));
        let arch = Arch::new();
        let gather = |scratch: &mut Scratch, (index, begun): (usize, Option<Brick>)| {
            let place = index % brick_grid.of_layer();
            if !wanted[index] || hidden.get(place) == Some(&true) {
                return None;
            }
            let at = part.brick_at(brick_grid, index);
            let smooth = coarser.map(|(brick_grid, slab)| {
                move |[column, row, layer]: [usize; 3]| slab.brick(column, row, layer, brick_grid)
            });
            let under = smooth.filter(|brick| coarse::around(at).any(|at| brick(at).is_some()));
            if under.is_none() && begun.is_none() && bins.of(index).is_empty() {
                return None;
            }
            let mut brick = begun.unwrap_or_else(|| self.blank());
            let (corner, kernel) = (at.map(|brick| brick * BRICK), self.kernel);
            arch.dispatch(Gather { brick_grid, corner, kernel, particles, pairs: bins.of(index), brick: &mut brick });
            if let Some(under) = under {
                let density = |at| under(at).map(|brick: &Brick| &brick.density[..]);
                arch.dispatch(Interpolate { brick: at, cells_of: density, scratch, out: &mut brick.density });
                if particles.attribute {
                    let weighted = |at| under(at).map(|brick: &Brick| &brick.weighted[..]);
                    arch.dispatch(Interpolate { brick: at, cells_of: weighted, scratch, out: &mut brick.weighted });
                }
                if level == 0 {
                    // Cubics overshoot by a little where the field ends; a density is not negative.
                    brick.density.iter_mut().for_each(|density| *density = density.max(0.0));
                }
            }
            brick.densest = brick.density.iter().fold(0.0, |densest, density| densest.max(density.abs()));
            (brick.densest > 0.0).then_some(brick)
        };
        let filled = begun.into_par_iter().enumerate().map_init(Scratch::default, gather);
        bricks::layers(filled.collect(), brick_grid.of_layer())
    }

    /// Those of some particles that belong to a part of a level, by its bricks; `reach` as in [`reaches`].
    fn bins(&self, particles: &Projected, reach: &[[f32; 2]], part: &Part<'_>) -> Bins {
        let levels = &self.prepared.levels;
        let Part { level, layers, hidden } = *part;
        let brick_grid = &levels[level];
        let own = |body: &Body<'_>| levels.len() == 1 || self.prepared.level_of(body) == level;
        let [nearest, farthest] = ends(brick_grid, layers);
        let of_chunk = |(chunk, [from, to]): (usize, &[f32; 2])| match *from > farthest || *to < nearest {
            true => Vec::new(),
            false => pairs(brick_grid, particles.bodies(chunk), own, layers.clone(), hidden),
        };
        let of_chunks: Vec<_> = reach.par_iter().enumerate().map(of_chunk).collect();
        Bins::new(layers.len() * brick_grid.of_layer(), &of_chunks)
    }

    /// Adds a portion to the bricks of a part that it reaches, after the portions before.
    fn begin(&self, part: &Part<'_>, portion: &Projected, bins: &Bins, begun: &mut [Option<Brick>]) {
        let brick_grid = &self.prepared.levels[part.level];
        let arch = Arch::new();
        let reached = begun.par_iter_mut().enumerate().filter(|(index, _)| !bins.of(*index).is_empty());
        reached.for_each(|(index, begun)| {
            let brick = begun.get_or_insert_with(|| self.blank());
            let (corner, kernel) = (part.brick_at(brick_grid, index).map(|brick| brick * BRICK), self.kernel);
            let pairs = bins.of(index);
            arch.dispatch(Gather { brick_grid, corner, kernel, particles: portion, pairs, brick });
        });
    }

    /// A brick of which nothing is known.
    fn blank(&self) -> Brick {
        let weighted = if self.prepared.particles.attribute { self.spare.take() } else { Box::default() };
        let [surface, opacity] = [Box::default(), Box::default()];
        Brick { density: self.spare.take(), weighted, surface, opacity, densest: 0.0 }
    }

    /// For each brick of layers of the grid, whether it or one next to it may show something; `reached` are those that particles reach.
    fn shown(&mut self, layers: &Range<usize>, hidden: &[bool], reached: &[bool]) -> Vec<bool> {
        let levels = &self.prepared.levels;
        let (brick_grid, of_layer) = (&levels[0], levels[0].of_layer());
        let smooth = levels.get(1).map(|coarser| Peaks::new(coarser, &self.held[1], self.least));
        let may_show = |index: usize| {
            let (layer, place) = (layers.start + index / of_layer, index % of_layer);
            let at = [place % brick_grid.bricks[0], place / brick_grid.bricks[0], layer];
            let is_hidden = hidden.get(place) == Some(&true);
            !is_hidden && (reached[index] || smooth.as_ref().is_some_and(|peaks| peaks.show(at)))
        };
        let dense: Vec<bool> = (0..layers.len() * of_layer).into_par_iter().map(may_show).collect();
        let last = dense[dense.len() - of_layer..].to_vec();
        let before = self.last.replace((layers.end - 1, last)).filter(|(layer, _)| layer + 1 == layers.start);
        let columns = brick_grid.bricks[0];
        let near = |index: usize, count: usize| index.saturating_sub(1)..(index + 2).min(count);
        let any = |layer: &[bool], place: usize| {
            let rows = near(place / columns, brick_grid.bricks[1]);
            rows.flat_map(|row| near(place % columns, columns).map(move |column| row * columns + column))
                .any(|place| layer[place])
        };
        let shown = |index: usize| {
            let (layer, place) = (index / of_layer, index % of_layer);
            // What is not known may show.
            let first = layer == 0 && layers.start > 0 && before.as_ref().is_none_or(|(_, dense)| any(dense, place));
            let last = layer + 1 == layers.len() && layers.end < brick_grid.bricks[2];
            let known = near(layer, layers.len());
            first || last || known.into_iter().any(|layer| any(&dense[layer * of_layer..(layer + 1) * of_layer], place))
        };
        (0..dense.len()).into_par_iter().map(shown).collect()
    }
}

impl Fill for Resampler<'_> {
    fn fill(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work) {
        self.resample(layers, hidden)
    }

    fn recycle(&mut self, layers: Vec<Layer>) {
        Resampler::recycle(self, layers);
    }

    fn has_attribute(&self) -> bool {
        self.prepared.particles.attribute
    }

    fn bytes(&self) -> u64 {
        self.prepared.particles.bytes()
    }
}

/// Depths between which the particles of each chunk reach.
fn reaches(particles: &Projected) -> Vec<[f32; 2]> {
    let nothing = [f32::INFINITY, f32::NEG_INFINITY];
    let with = |[from, to]: [f32; 2], body: Body<'_>| [from.min(body.depths()[0]), to.max(body.depths()[1])];
    let chunks = (0..particles.chunks.len()).into_par_iter();
    chunks.map(|chunk| particles.bodies(chunk).fold(nothing, with)).collect()
}

/// Pairs of a brick in `layers` and a particle of a chunk that reaches it: their numbers, in the order of the particles.
fn pairs<'a>(
    brick_grid: &BrickGrid,
    chunk: impl Iterator<Item = Body<'a>>,
    own: impl Fn(&Body<'a>) -> bool,
    layers: Range<usize>,
    hidden: &[bool],
) -> Vec<[u32; 2]> {
    let [nearest, farthest] = ends(brick_grid, &layers);
    let mut pairs = Vec::new();
    for (index, body) in chunk.enumerate() {
        let [front, back] = body.depths();
        if front > farthest || back < nearest || !own(&body) {
            continue;
        }
        for layer in layers.clone() {
            let Some([columns, rows]) = brick_grid.reached(&body, layer) else { continue };
            for row in rows[0]..=rows[1] {
                for column in columns[0]..=columns[1] {
                    let place = row * brick_grid.bricks[0] + column;
                    if hidden.get(place) != Some(&true) {
                        let brick = (layer - layers.start) * brick_grid.of_layer() + place;
                        pairs.push([brick as u32, index as u32]);
                    }
                }
            }
        }
    }
    pairs
}

/// Depths of the first and the last slice of layers.
pub(super) fn ends(brick_grid: &BrickGrid, layers: &Range<usize>) -> [f32; 2] {
    [brick_grid.depth[layers.start * BRICK], brick_grid.depth[layers.end * BRICK - 1]]
}

/// Particles by the bricks that they reach.
struct Bins {
    /// Where each brick's particles start, and the end.
    starts: Vec<u32>,
    /// Chunk, and number in it.
    particles: Vec<[u32; 2]>,
}

impl Bins {
    /// Sorts the pairs of all chunks by their bricks, of which there are `count`.
    fn new(count: usize, chunks: &[Vec<[u32; 2]>]) -> Bins {
        let mut starts = vec![0u32; count + 1];
        chunks.iter().flatten().for_each(|[brick, _]| starts[*brick as usize] += 1);
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        let mut cursor = starts.clone();
        let mut particles = vec![[0; 2]; next as usize];
        for (chunk, pairs) in chunks.iter().enumerate() {
            for [brick, particle] in pairs {
                let slot = &mut cursor[*brick as usize];
                particles[*slot as usize] = [chunk as u32, *particle];
                *slot += 1;
            }
        }
        Bins { starts, particles }
    }

    /// The particles of a brick.
    fn of(&self, brick: usize) -> &[[u32; 2]] {
        &self.particles[self.starts[brick] as usize..self.starts[brick + 1] as usize]
    }
}
