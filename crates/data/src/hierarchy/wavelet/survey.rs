//! The first pass of a build: what is known of every node from level 2 on before any point is fitted, brick by brick; and how large values
//! are.

use super::analyse::Coefficients;
use super::bricks::{Bricks, Part};
use super::cells::{SIDE, cell_levels};
use super::error::Options;
use super::feed::Feed;
use super::fields::{Fields, Shelf};
use super::fit::{cells_of_tents, tents};
use super::planes::{Rules, range};
use super::pyramid::{Means, WIDTH, means};
use super::tables::Table;
use rayon::prelude::*;

/// The first level that is kept; level 1 is found anew wherever it is needed, since it has nearly as many numbers as the samples.
pub(super) const FIRST: usize = 2;
/// The last level whose cells the first pass has at hand: those of level 1.
const LAST_TENTS: usize = 1 + SIDE.trailing_zeros() as usize;

/// Why a build ended.
#[derive(Debug)]
pub enum Fault<F, S> {
    /// The samples cannot be read.
    Feed(F),
    /// The shelf cannot be written or read.
    Shelf(S),
}

/// The faults of a build from such a feed with such a shelf.
pub type FaultOf<F, S> = Fault<<F as Feed>::Error, <S as Shelf>::Error>;

/// What is known before any point is fitted.
pub struct Survey<'a, F: Feed, S: Shelf> {
    pub(super) feed: &'a F,
    pub(super) shelf: &'a S,
    pub(super) bricks: Bricks,
    pub(super) options: Options,
    pub(super) rules: Rules,
    pub(super) fields: Fields,
    /// Coefficients of directed filters, where points or errors need them.
    pub(super) coefficients: Option<Coefficients>,
    /// Each plane's range.
    pub(super) ranges: Vec<(f32, f32)>,
    pub(super) weights: Vec<f32>,
    /// All sets in nodes of 2, 4, ... cells along each axis.
    pub(super) tables: Vec<Table>,
}

/// What lies where on the shelf of a build.
fn places(bricks: Bricks, channels: usize, options: &Options) -> (Fields, Option<Coefficients>) {
    let fields = Fields::new(bricks, FIRST, WIDTH * channels, 0);
    let coefficients = options.needs_coefficients().then(|| Coefficients::new(bricks, channels, fields.end));
    (fields, coefficients)
}

/// Numbers that a build of such a grid keeps on its shelf.
pub fn shelf_len(bricks: Bricks, channels: usize, options: &Options) -> u64 {
    let (fields, coefficients) = places(bricks, channels, options);
    coefficients.map_or(fields.end, |coefficients| coefficients.end())
}

/// Samples around a brick that fitting its points needs at most, on each side.
pub(super) const AROUND: usize = 2 * (super::level::MARGIN + 1);

impl<'a, F: Feed, S: Shelf> Survey<'a, F, S> {
    /// Reads all samples, `at_once` bricks at a time.
    ///
    /// # Errors
    /// [`Fault`] where the samples cannot be read, or the shelf not be written.
    pub fn new(feed: &'a F, shelf: &'a S, options: &Options, at_once: usize) -> Result<Self, FaultOf<F, S>> {
        let bricks = Bricks { dimensions: feed.dimensions(), shape: feed.shape() };
        let rules = Rules::new(feed, bricks, options, at_once).map_err(Fault::Feed)?;
        let planes = feed.channels();
        let (fields, coefficients) = places(bricks, planes, options);
        let mut survey = Survey {
            feed,
            shelf,
            bricks,
            options: *options,
            rules,
            fields,
            coefficients,
            ranges: vec![(f32::INFINITY, f32::NEG_INFINITY); planes],
            weights: Vec::new(),
            tables: (1..=cell_levels(usize::MAX)).map(|k| Table::new(bricks.dimensions, 1 << k)).collect(),
        };
        let all: Vec<usize> = (0..bricks.len()).collect();
        for some in all.chunks(at_once.max(1)) {
            let found: Result<Vec<_>, _> = some.par_iter().map(|brick| survey.pyramid(*brick)).collect();
            for ranges in found? {
                let both = |own: &mut (f32, f32), (low, high)| *own = (own.0.min(low), own.1.max(high));
                survey.ranges.iter_mut().zip(ranges).for_each(|(own, other)| both(own, other));
            }
        }
        // Whether a zero has a sign must not depend on the order of bricks.
        survey.ranges.iter_mut().for_each(|(low, high)| (*low, *high) = (*low + 0.0, *high + 0.0));
        survey.weights = survey.rules.weights(&survey.ranges);
        survey.levels_above()?;
        survey.remaining_tents()?;
        if let Some(coefficients) = &survey.coefficients {
            survey.analyse(coefficients, at_once)?;
        }
        Ok(survey)
    }

    /// The levels of a brick; the planes' ranges in it.
    fn pyramid(&self, brick: usize) -> Result<Vec<(f32, f32)>, FaultOf<F, S>> {
        let Bricks { dimensions: d, shape: samples } = self.bricks;
        let of = |level: usize| self.bricks.level_shape(level);
        let own = self.bricks.part(brick, 0);
        let last = self.bricks.levels().min(self.bricks.all_levels());
        // Half a node of the last level whose tents are found here, on each side.
        let around = own.wider(1 << (LAST_TENTS - 1), d, samples);
        let (values, _) = self.rules.read(self.feed, &around).map_err(Fault::Feed)?;
        let inside: Vec<Means> = values.into_iter().map(|mean| Means { mean, ..Means::default() }).collect();
        let ranges = inside.iter().map(|plane| range(&plane.mean)).collect();
        let first_part = around.above(1, d);
        let first: Vec<Means> =
            inside.iter().map(|below| means(d, samples, (0, samples), (below, &around), &first_part)).collect();
        let mut below = (first.clone(), first_part);
        for level in FIRST..=last {
            let part = self.bricks.part(brick, level);
            let mut planes: Vec<Means> = below
                .0
                .iter()
                .map(|means_below| means(d, samples, (level - 1, of(level - 1)), (means_below, &below.1), &part))
                .collect();
            if level <= LAST_TENTS {
                let steps = cell_levels(level);
                let (cells, cells_part) = if steps == level { (&inside, &around) } else { (&first, &first_part) };
                for (plane, cells) in planes.iter_mut().zip(cells) {
                    let cells = (&cells.mean[..], cells_part, of(level - steps));
                    plane.tent = tents(d, cells, (&part, of(level)), 1 << steps);
                }
            }
            self.fields.write(self.shelf, level, &part, &Means::to_rows(&planes)).map_err(Fault::Shelf)?;
            below = (planes, part);
        }
        Ok(ranges)
    }

    /// The levels above the bricks'.
    fn levels_above(&self) -> Result<(), FaultOf<F, S>> {
        let Bricks { dimensions: d, shape: samples } = self.bricks;
        for level in self.bricks.levels() + 1..=self.bricks.all_levels() {
            let (finer, of) = (self.bricks.level_shape(level - 1), self.bricks.level_shape(level));
            let (below_part, part) = (Part::whole(finer), Part::whole(of));
            let below = self.read(level - 1, &below_part)?;
            let planes: Vec<Means> =
                below.iter().map(|below| means(d, samples, (level - 1, finer), (below, &below_part), &part)).collect();
            self.fields.write(self.shelf, level, &part, &Means::to_rows(&planes)).map_err(Fault::Shelf)?;
        }
        Ok(())
    }

    /// What overlapping points of the coarser levels ask for.
    fn remaining_tents(&self) -> Result<(), FaultOf<F, S>> {
        let bricks = self.bricks;
        for level in LAST_TENTS + 1..=bricks.all_levels() {
            if level > bricks.levels() {
                self.tents_of(level, &Part::whole(bricks.level_shape(level)))?;
                continue;
            }
            (0..bricks.len()).into_par_iter().try_for_each(|brick| self.tents_of(level, &bricks.part(brick, level)))?;
        }
        Ok(())
    }

    fn tents_of(&self, level: usize, part: &Part) -> Result<(), FaultOf<F, S>> {
        let d = self.bricks.dimensions;
        let steps = cell_levels(level);
        let (of, cells_of) = (self.bricks.level_shape(level), self.bricks.level_shape(level - steps));
        let cells_part = cells_of_tents(d, part, 1 << steps, cells_of);
        let cells = self.read(level - steps, &cells_part)?;
        let mut own = self.read(level, part)?;
        for (plane, cells) in own.iter_mut().zip(&cells) {
            plane.tent = tents(d, (&cells.mean, &cells_part, cells_of), (part, of), 1 << steps);
        }
        self.fields.write(self.shelf, level, part, &Means::to_rows(&own)).map_err(Fault::Shelf)
    }

    /// What is known of the nodes of a level from [`FIRST`] on in a box, of each plane.
    pub(super) fn read(&self, level: usize, part: &Part) -> Result<Vec<Means>, FaultOf<F, S>> {
        let rows = self.fields.read(self.shelf, level, part).map_err(Fault::Shelf)?;
        let planes = self.feed.channels();
        Ok((0..planes).map(|plane| Means::of_row(&rows, planes, plane)).collect())
    }
}
