//! What stands where samples are no numbers, or count as air, while points are fitted: the mean of the smallest node around a hole that has
//! samples.

use super::bricks::{Bricks, Part};
use super::feed::Feed;
use super::grid::{Shape, children_in, for_each_place};
use rayon::prelude::*;

/// Levels below this one are found anew for each box that is filled; the others are kept.
const KEPT: usize = 4;
/// Boxes that are filled begin at multiples of this and end at such or at the grid's end: with them the levels that are found anew are whole.
const ALIGNED: usize = 1 << (KEPT - 1);

/// A sum of samples and their number.
type Sum = (f64, f64);

/// The sums of every channel over the nodes from level [`KEPT`] on.
#[derive(Clone, Debug)]
pub(super) struct Filling {
    dimensions: usize,
    shape: Shape,
    /// What is below this counts as air.
    below: Option<f32>,
    /// Of each channel and level from [`KEPT`] on; of the last level one node.
    kept: Vec<Vec<(Shape, Vec<Sum>)>>,
}

/// Where a place of any channel is a hole, or of all channels is below what counts as more than air.
fn holes(channels: &[Vec<f32>], below: Option<f32>) -> Vec<bool> {
    let count = channels.first().map_or(0, Vec::len);
    let is_air = |i: usize| below.is_some_and(|below| channels.iter().all(|channel| channel[i] < below));
    let is_hole = |i: usize| channels.iter().any(|channel| !channel[i].is_finite()) || is_air(i);
    (0..count).into_par_iter().map(is_hole).collect()
}

/// The sums over the nodes of a level in a box from those below.
fn coarser(dimensions: usize, finer: Shape, (below, below_part): (&[Sum], &Part), part: &Part) -> Vec<Sum> {
    for_each_place(part.shape, |at| {
        let at: Shape = std::array::from_fn(|k| part.min[k] + at[k]);
        children_in(dimensions, finer, at).fold((0.0, 0.0), |(sum, number), child| {
            let (s, n) = below[below_part.index(child)];
            (sum + s, number + n)
        })
    })
}

/// The sums over the nodes of levels 1 to `last` under which a box of samples lies that has all of theirs.
fn sums(
    dimensions: usize,
    of: &dyn Fn(usize) -> Shape,
    (values, holes): (&[f32], &[bool]),
    part: &Part,
    last: usize,
) -> Vec<(Part, Vec<Sum>)> {
    let own = values.iter().zip(holes);
    let mut levels =
        vec![(*part, own.map(|(&v, &hole)| if hole { (0.0, 0.0) } else { (f64::from(v), 1.0) }).collect::<Vec<Sum>>())];
    for level in 1..=last {
        let up = part.above(level, dimensions);
        let (below_part, below) = &levels[level - 1];
        let sums = coarser(dimensions, of(level - 1), (below, below_part), &up);
        levels.push((up, sums));
    }
    levels
}

impl Filling {
    /// Reads all samples; `None` where all are numbers and none counts as air.
    pub fn survey<F: Feed>(
        feed: &F,
        bricks: Bricks,
        below: Option<f32>,
        at_once: usize,
    ) -> Result<Option<Filling>, F::Error> {
        let d = bricks.dimensions;
        let of = |level: usize| bricks.level_shape(level);
        let kept_shape = of(KEPT);
        let mut kept = vec![vec![(0.0, 0.0); kept_shape.iter().product()]; feed.channels()];
        let mut any = false;
        let all: Vec<usize> = (0..bricks.len()).collect();
        for some in all.chunks(at_once.max(1)) {
            let of_brick = |&brick: &usize| -> Result<_, F::Error> {
                let part = bricks.part(brick, 0);
                let channels = feed.read(&part)?;
                let holes = holes(&channels, below);
                let last = |channel: &Vec<f32>| sums(d, &of, (channel, &holes), &part, KEPT).pop();
                Ok((holes.contains(&true), channels.iter().map(last).collect::<Vec<_>>()))
            };
            let found: Vec<_> = some.par_iter().map(of_brick).collect::<Result<_, F::Error>>()?;
            for (has, channels) in found {
                any |= has;
                for (kept, (part, sums)) in kept.iter_mut().zip(channels.into_iter().flatten()) {
                    (0..sums.len()).for_each(|i| kept[super::grid::index(kept_shape, part.place(i))] = sums[i]);
                }
            }
        }
        if !any {
            return Ok(None);
        }
        let up = |lowest: Vec<Sum>| {
            let mut levels = vec![(kept_shape, lowest)];
            for level in KEPT + 1..=bricks.all_levels() {
                let Some((finer, below)) = levels.last() else { break };
                let shape = of(level);
                let sums = coarser(d, *finer, (below, &Part::whole(*finer)), &Part::whole(shape));
                levels.push((shape, sums));
            }
            levels
        };
        Ok(Some(Filling { dimensions: d, shape: bricks.shape, below, kept: kept.into_iter().map(up).collect() }))
    }

    /// Where the places of a box are holes.
    pub fn holes(&self, channels: &[Vec<f32>]) -> Vec<bool> {
        holes(channels, self.below)
    }

    /// The smallest box around one that can be filled.
    pub fn aligned(&self, part: &Part) -> Part {
        let end = part.end();
        let min: Shape = std::array::from_fn(|k| if k < self.dimensions { part.min[k] / ALIGNED * ALIGNED } else { 0 });
        let end: Shape = std::array::from_fn(|k| {
            if k < self.dimensions { end[k].next_multiple_of(ALIGNED).min(self.shape[k]) } else { self.shape[k] }
        });
        Part { min, shape: std::array::from_fn(|k| end[k] - min[k]) }
    }

    /// Fills the holes of all channels in an aligned box.
    pub fn fill(&self, part: &Part, channels: &mut [Vec<f32>], holes: &[bool]) {
        let bricks = Bricks { dimensions: self.dimensions, shape: self.shape };
        let of = |level: usize| bricks.level_shape(level);
        let shift = |at: Shape, by: usize| -> Shape {
            std::array::from_fn(|k| if k < self.dimensions { at[k] >> by } else { at[k] })
        };
        for (channel, kept) in channels.iter_mut().zip(&self.kept) {
            let near = sums(self.dimensions, &of, (channel, holes), part, KEPT - 1);
            channel.par_iter_mut().enumerate().filter(|(i, _)| holes[*i]).for_each(|(i, value)| {
                let at = part.place(i);
                let near = near.iter().enumerate().skip(1).map(|(level, (part, s))| s[part.index(shift(at, level))]);
                let far =
                    kept.iter().enumerate().map(|(k, (shape, s))| s[super::grid::index(*shape, shift(at, KEPT + k))]);
                let found = near.chain(far).find(|(_, number)| *number > 0.0);
                *value = found.map_or(0.0, |(sum, number)| (sum / number) as f32);
            });
        }
    }
}
