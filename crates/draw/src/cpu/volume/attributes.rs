//! Fields of the particles' columns, several in one picture (F12 3.2.1).
//!
//! Particles weigh their volumes `V = m / rho` here. What a grid holds of a column `A` is then `sum V W`, the share of space that is filled with
//! particles, and `sum V A W`, which is F12's equation 3.2. Within the gas the former is about 1; where the gas ends both fall to 0, so that the
//! mean `sum V A W / sum V W` keeps its value up to there. Of densities 3.2 is `sum m W`, as it is drawn without attributes.
//!
//! Each column is resampled by itself, and what a picture shows of them put together brick by brick: numbers for the volume, numbers of their
//! own for surfaces where these are of another column, the attribute that colours both, and what densities make of the volume's opacity. A
//! particle without a value of a column is not there for its field. Particles that are not all there at once ([`super::supply`]) are asked for
//! once for each column.

use super::bricks::{Brick, CELLS, Layer};
use super::particles::{Projected, RatioCounts, Taken, density_scale, project, ratios_of_volumes};
use super::range::Histogram;
use super::resample::{Resampler, Work};
use super::supply::{Portions, shared};
use super::{Fill, Prepared, Scenery, Supply, VolumeError, VolumeOptions, VolumeReport, cast, cast_in_parts, extents};
use crate::color::Colors;
use crate::color::transfer::{Curve, Scale};
use crate::cpu::Splats;
use crate::cpu::field::ValueAxis;
use crate::cpu::paths::PathFragments;
use crate::view::View;
use crate::view::perspective_grid::{GridError, PerspectiveGrid};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A mean is known where at least this share of space is filled: with less, what interpolation of wide kernels errs by counts.
pub const LEAST_FILLED: f32 = 0.01;
/// One of so many parts of the memory for a slab's cells is theirs: the rest is for the sums of a column that cells are made of, and for the coarser
/// grids of each.
const SLAB_SHARE: u64 = 3;

/// A column of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// What colours the picture.
    Attribute,
    /// One of [`Splats::fields`].
    Field(usize),
}

impl Column {
    /// The batches that have it, as their attribute.
    pub(super) fn of<'a>(self, batches: &[Splats<'a>]) -> Vec<Splats<'a>> {
        let with = |batch: &Splats<'a>| match self {
            Column::Attribute => batch.attribute().map(|_| *batch),
            Column::Field(index) => batch.of_field(index),
        };
        batches.iter().filter_map(with).collect()
    }
}

/// How the field of a column is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// The density: `sum V rho W = sum m W`, as it is.
    Density,
    /// `sum V A W` (F12 3.2) on an axis.
    Sum(ValueAxis),
    /// `sum V A W / sum V W` on an axis; nothing where less than [`LEAST_FILLED`] is filled.
    Mean(ValueAxis),
}

impl Reading {
    /// The axis of values that are placed on one.
    pub fn axis(&self) -> Option<&ValueAxis> {
        match self {
            Reading::Density => None,
            Reading::Sum(axis) | Reading::Mean(axis) => Some(axis),
        }
    }

    /// The numbers of a brick that holds `sum V W` and `sum V A W`; `filling` is what the former is multiplied by to be a share of space.
    fn read(&self, brick: &mut Brick, filling: f32) {
        let number = |share: f32, sum: f32| match self {
            Reading::Density => sum.max(0.0),
            Reading::Sum(axis) if share > 0.0 => axis.place(sum * filling),
            Reading::Mean(axis) if share * filling >= LEAST_FILLED => axis.place(sum / share),
            Reading::Sum(_) | Reading::Mean(_) => 0.0,
        };
        brick.density.iter_mut().zip(&brick.weighted).for_each(|(cell, sum)| *cell = number(*cell, *sum));
        brick.densest = brick.density.iter().copied().fold(0.0, f32::max);
        brick.weighted = Box::default();
    }
}

/// What densities make of the opacity of a volume of something else: it is multiplied by [`ByDensity::curve`] at the density's place in a
/// logarithmic range, so that thin gas hides nothing, whatever its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ByDensity {
    /// The densities between which it rises; ascending and positive.
    pub range: [f64; 2],
}

impl ByDensity {
    /// How opaque volumes of densities usually are, relative to the densest.
    pub fn curve() -> Curve {
        let usual = Curve::usual_opacity();
        let most = usual.at(1.0);
        let points = usual.points().iter().map(|(place, opacity)| (*place, opacity / most)).collect();
        Curve::new(points).unwrap_or(usual)
    }

    /// What a volume's extinction is multiplied by where a density is, with that curve.
    fn factor(&self, density: f32, curve: &Curve) -> f32 {
        if density > 0.0 { curve.at(Scale::Log.place(density, self.range)) } else { 0.0 }
    }
}

/// What is shown of columns, in the order in which they are prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// The first one: the volume, and surfaces where these have no column of their own.
    pub volume: Reading,
    /// The second one, where surfaces are of it.
    pub surface: Option<Reading>,
    /// What the densities make of the volume's opacity, which are the column behind these, or the surfaces' own.
    pub opacity: Option<ByDensity>,
    /// Whether the last one colours them.
    pub has_hue: bool,
}

impl Shown {
    /// The column of densities that a volume's opacity goes by, where it does.
    pub fn opacity_column(&self) -> usize {
        1 + usize::from(self.surface.is_some_and(|reading| reading != Reading::Density))
    }

    /// Whether surfaces are of the densities that the volume's opacity goes by.
    fn shares_densities(&self) -> bool {
        self.surface == Some(Reading::Density)
    }
}

/// What an adapter draws of columns in place of [`Columns::draw`].
#[derive(Clone, Debug)]
pub struct ColumnMarch {
    /// The columns, in the order of what is shown of them.
    pub columns: Vec<Column>,
    /// What is shown of them.
    pub shown: Shown,
    /// What is drawn of that.
    pub scenery: Scenery,
    /// How it is sampled.
    pub options: VolumeOptions,
    /// See [`Columns::filling`].
    pub filling: f32,
}

/// The particles of a view, once for each of some columns; or no particles yet, where they are not all there at once.
pub struct Columns {
    /// The columns.
    pub wanted: Vec<Column>,
    /// Of each column.
    prepared: Vec<Prepared>,
    /// What `sum V W` is multiplied by to be a share of space: files may have densities in another unit than their masses.
    pub filling: f32,
    /// What is taken of batches.
    taken: Taken,
    /// How long it took.
    took: Duration,
}

/// How much of what is in view has which values of a column: volume, or of densities mass.
#[derive(Default)]
struct Found {
    histogram: Histogram,
    particles: u64,
}

impl Found {
    fn add(&mut self, projected: &Projected, is_density: bool, filling: f32) {
        self.particles += projected.len();
        for particle in projected.chunks.iter().flatten() {
            let value = particle.weighted / particle.mass;
            match is_density {
                true => self.histogram.add(value / filling, f64::from(particle.weighted)),
                false => self.histogram.add(value, f64::from(particle.mass)),
            }
        }
    }
}

/// What is to be known of columns before anything is drawn, from particles that are not all there at once.
fn look_at(
    supply: &mut dyn Supply,
    view: &View,
    (columns, densities): (&[Column], &[bool]),
    taken: &Taken,
    filling: f32,
) -> (RatioCounts, Vec<Found>) {
    let mut ratios = RatioCounts::default();
    let mut found: Vec<Found> = columns.iter().map(|_| Found::default()).collect();
    supply.supply(&|_| true, &mut |batches: &[Splats<'_>]| {
        batches.iter().flat_map(ratios_of_volumes).for_each(|ratio| ratios.add(ratio));
        for ((column, is_density), found) in columns.iter().zip(densities).zip(&mut found) {
            found.add(&project(view, &column.of(batches), taken), *is_density, filling);
        }
    });
    (ratios, found)
}

fn taken(grid: &PerspectiveGrid, options: &VolumeOptions) -> Taken {
    Taken { sigma: grid.sigma, smallest: options.smallest, stride: 1, kernel: options.kernel }
}

impl Columns {
    /// Projects batches whose weights are volumes, and lays the grid around what is in view.
    ///
    /// # Errors
    /// [`VolumeError::Grid`] when nothing with values is in view or the grid makes no sense.
    pub fn prepare(
        view: &View,
        batches: &[Splats<'_>],
        columns: &[Column],
        options: &VolumeOptions,
    ) -> Result<Columns, VolumeError> {
        let start = Instant::now();
        let (grid, widest) = extents::planes_and_widest(view, extents::of(batches), options)?;
        let taken = taken(&grid, options);
        let prepared = |column: &Column| {
            let particles = project(view, &column.of(batches), &taken).unless_empty()?;
            Ok::<_, VolumeError>(Prepared::new(grid, widest, particles))
        };
        let prepared = columns.iter().map(prepared).collect::<Result<Vec<_>, _>>()?;
        if prepared.is_empty() {
            return Err(GridError::NothingInView.into());
        }
        let filling = 1.0 / density_scale(batches.iter().flat_map(ratios_of_volumes));
        Ok(Columns { wanted: columns.to_vec(), prepared, filling, taken, took: start.elapsed() })
    }

    /// The same of particles that are not all there at once, to be drawn by [`Columns::draw_supplied`]; and how much of what is in view has
    /// which values of each column, as [`Columns::histogram`] says of those that are. `densities` says which columns are of densities.
    ///
    /// # Errors
    /// As [`Columns::prepare`].
    pub fn prepare_supplied(
        view: &View,
        supply: &mut dyn Supply,
        columns: &[Column],
        densities: &[bool],
        options: &VolumeOptions,
    ) -> Result<(Columns, Vec<Histogram>), VolumeError> {
        let start = Instant::now();
        let (grid, widest) = extents::planes_and_widest(view, supply.extents(), options)?;
        let taken = taken(&grid, options);
        let (ratios, mut found) = look_at(supply, view, (columns, densities), &taken, 1.0);
        let filling = 1.0
            / ratios.scale(|each| {
                supply.supply(&|_| true, &mut |batches: &[Splats<'_>]| {
                    batches.iter().flat_map(ratios_of_volumes).for_each(&mut *each);
                });
            });
        if filling != 1.0 {
            (_, found) = look_at(supply, view, (columns, densities), &taken, filling);
        }
        if found.is_empty() || found.iter().any(|found| found.particles == 0) {
            return Err(GridError::NothingInView.into());
        }
        let nothing = || Projected { attribute: true, ..Projected::default() };
        let prepared = columns.iter().map(|_| Prepared::new(grid, widest, nothing())).collect();
        let columns = Columns { wanted: columns.to_vec(), prepared, filling, taken, took: start.elapsed() };
        Ok((columns, found.into_iter().map(|found| found.histogram).collect()))
    }

    /// How much of what is in view has which values of a column: volume, or of densities mass.
    pub fn histogram(&self, column: usize, is_density: bool) -> Histogram {
        let mut found = Found::default();
        found.add(&self.prepared[column].particles, is_density, self.filling);
        found.histogram
    }

    /// Between which values most of it lies: 3 % of the volume below and above; of densities 3 % of the mass below and 0.5 % above, two decades
    /// apart at least.
    ///
    /// # Errors
    /// [`GridError::NothingInView`] where nothing has values.
    pub fn range(histogram: &Histogram, is_density: bool) -> Result<[f64; 2], VolumeError> {
        let found = histogram.percentiles([0.03, if is_density { 0.995 } else { 0.97 }]);
        let [low, high] = found.ok_or(GridError::NothingInView)?;
        Ok([if is_density { low.min(1e-2 * high) } else { low }, high])
    }

    /// Draws what `scenery` says of what is shown.
    pub fn draw(
        &self,
        view: &View,
        shown: &Shown,
        scenery: &Scenery,
        options: &VolumeOptions,
        paths: Option<&PathFragments>,
    ) -> (Colors, VolumeReport) {
        let options = &for_cells(options);
        let first = &self.prepared[0];
        let mut report = first.report(self.took);
        let grids = (&first.grid, first.brick_grid());
        let colors = cast(view, grids, &mut self.fields(shown), scenery, options, paths, &mut report);
        (colors, report)
    }

    /// The same of particles that are not all there at once, [`Columns::prepare_supplied`]; of those that nobody sees the report counts some
    /// alone.
    pub fn draw_supplied(
        &self,
        view: &View,
        supply: &mut dyn Supply,
        shown: &Shown,
        scenery: &Scenery,
        options: &VolumeOptions,
    ) -> (Colors, VolumeReport) {
        let options = &for_cells(&VolumeOptions { memory: options.memory.min(supply.slab_bytes()), ..*options });
        let supply = shared(supply);
        let first = &self.prepared[0];
        let mut report = first.report(self.took);
        let mut fields = self.fields_of(shown, |index| {
            let portions = Portions::new(Arc::clone(&supply), Some(self.wanted[index]), view, self.taken);
            self.resampler(index).supplied_by(portions)
        });
        let grids = (&first.grid, first.brick_grid());
        let colors = cast(view, grids, &mut fields, scenery, options, None, &mut report);
        let portions = fields.volume.0.into_portions();
        let [particles, raised] = portions.map_or([0; 2], |portions| portions.counts());
        (colors, VolumeReport { particles, raised, ..report })
    }

    /// The same in parts, each with its depth: what something else is drawn among.
    pub fn draw_in_parts(
        &self,
        view: &View,
        shown: &Shown,
        scenery: &Scenery,
        options: &VolumeOptions,
    ) -> (PathFragments, VolumeReport) {
        let options = &for_cells(options);
        let first = &self.prepared[0];
        let mut report = first.report(self.took);
        let grids = (&first.grid, first.brick_grid());
        let parts = cast_in_parts(view, grids, &mut self.fields(shown), scenery, options, &mut report);
        (parts, report)
    }

    /// What fills bricks with what is shown.
    pub fn fields(&self, shown: &Shown) -> Fields<'_> {
        self.fields_of(shown, |index| self.resampler(index))
    }

    fn resampler(&self, index: usize) -> Resampler<'_> {
        Resampler::new(&self.prepared[index], self.taken.kernel)
    }

    fn fields_of<'a>(&self, shown: &Shown, resampler: impl Fn(usize) -> Resampler<'a>) -> Fields<'a> {
        Fields {
            filling: self.filling,
            volume: (resampler(0), shown.volume),
            surface: shown.surface.map(|reading| (resampler(1), reading)),
            opacity: shown.opacity.map(|by_density| Dimming {
                resampler: (!shown.shares_densities()).then(|| resampler(shown.opacity_column())),
                by_density,
                curve: ByDensity::curve(),
            }),
            hue: shown.has_hue.then(|| resampler(self.prepared.len() - 1)),
        }
    }
}

/// The same with the part of the memory that cells have.
fn for_cells(options: &VolumeOptions) -> VolumeOptions {
    VolumeOptions { memory: options.memory / SLAB_SHARE, ..*options }
}

/// Fills bricks with fields of columns.
pub struct Fields<'a> {
    filling: f32,
    volume: (Resampler<'a>, Reading),
    surface: Option<(Resampler<'a>, Reading)>,
    opacity: Option<Dimming<'a>>,
    hue: Option<Resampler<'a>>,
}

/// Has the opacity of bricks go by densities.
struct Dimming<'a> {
    /// What finds the densities; none where they are the surfaces' numbers.
    resampler: Option<Resampler<'a>>,
    by_density: ByDensity,
    curve: Curve,
}

impl Dimming<'_> {
    /// Says in bricks how opaque they are by their densities.
    fn dim(&mut self, filled: &mut [Layer], layers: Range<usize>, hidden: &[bool], work: &mut Work) {
        let Dimming { resampler, by_density, curve } = self;
        let (by_density, curve) = (*by_density, &*curve);
        let factor = |density: &f32| by_density.factor(*density, curve);
        let opacity = |densities: &[f32]| densities.iter().map(factor).collect::<Box<[f32]>>();
        let Some(resampler) = resampler else {
            let bricks = filled.par_iter_mut().flatten().flatten();
            bricks.for_each(|brick| brick.opacity = opacity(&brick.surface));
            return;
        };
        let (found, more) = resampler.resample(layers, hidden);
        work.pairs += more.pairs;
        let pairs = filled.iter_mut().flatten().zip(found.iter().flatten());
        let pairs: Vec<_> = pairs.filter_map(|(brick, found)| Some((brick.as_mut()?, found.as_ref()?))).collect();
        pairs.into_par_iter().for_each(|(brick, found)| brick.opacity = opacity(&found.weighted));
        resampler.recycle(found);
    }
}

/// Layers of one column's numbers.
fn numbers(
    (resampler, reading): &mut (Resampler<'_>, Reading),
    layers: Range<usize>,
    hidden: &[bool],
    filling: f32,
) -> (Vec<Layer>, Work) {
    let (mut filled, work) = resampler.resample(layers, hidden);
    let bricks = filled.par_iter_mut().flatten().flatten();
    bricks.for_each(|brick| reading.read(brick, filling));
    (filled, work)
}

/// A brick with the numbers that surfaces are of.
fn with_surface(brick: Option<Brick>, surface: Option<Brick>) -> Option<Brick> {
    let Some(Brick { density: surface, densest, .. }) = surface else { return brick };
    let nothing = || Brick {
        density: vec![0.0; CELLS].into_boxed_slice(),
        weighted: Box::default(),
        surface: Box::default(),
        opacity: Box::default(),
        densest: 0.0,
    };
    let brick = brick.unwrap_or_else(nothing);
    Some(Brick { densest: brick.densest.max(densest), surface, ..brick })
}

/// Has a brick be coloured by the mean of an attribute, of which `found` holds `sum V W` and `sum V A W`.
fn tint(brick: &mut Brick, found: &Brick) {
    let mean = |(sum, share): (&f32, &f32)| if *share > 0.0 { sum / share } else { 0.0 };
    let means = found.weighted.iter().zip(&found.density).map(mean);
    brick.weighted = brick.density.iter().zip(means).map(|(number, mean)| number * mean).collect();
}

impl Fill for Fields<'_> {
    fn fill(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work) {
        let (mut filled, mut work) = numbers(&mut self.volume, layers.clone(), hidden, self.filling);
        if let Some(surface) = &mut self.surface {
            let (found, more) = numbers(surface, layers.clone(), hidden, self.filling);
            work.pairs += more.pairs;
            for (bricks, found) in filled.iter_mut().zip(found) {
                *bricks = std::mem::take(bricks).into_iter().zip(found).map(|(a, b)| with_surface(a, b)).collect();
            }
        }
        if let Some(opacity) = &mut self.opacity {
            opacity.dim(&mut filled, layers.clone(), hidden, &mut work);
        }
        if let Some(hue) = &mut self.hue {
            let (found, more) = hue.resample(layers, hidden);
            work.pairs += more.pairs;
            let pairs = filled.iter_mut().flatten().zip(found.iter().flatten());
            let pairs: Vec<_> = pairs.filter_map(|(brick, found)| Some((brick.as_mut()?, found.as_ref()?))).collect();
            pairs.into_par_iter().for_each(|(brick, found)| tint(brick, found));
            hue.recycle(found);
        }
        work.bricks = filled.iter().flatten().flatten().count() as u64;
        (filled, work)
    }

    fn recycle(&mut self, layers: Vec<Layer>) {
        self.volume.0.recycle(layers);
    }

    fn has_attribute(&self) -> bool {
        self.hue.is_some()
    }

    fn has_surface_field(&self) -> bool {
        self.surface.is_some()
    }

    fn has_opacity(&self) -> bool {
        self.opacity.is_some()
    }

    fn has_holes(&self) -> [bool; 2] {
        let surface = self.surface.as_ref().unwrap_or(&self.volume);
        [&self.volume, surface].map(|(_, reading)| matches!(reading, Reading::Mean(_)))
    }

    fn bytes(&self) -> u64 {
        let surface = self.surface.as_ref().map(|(resampler, _)| resampler);
        let opacity = self.opacity.as_ref().and_then(|dimming| dimming.resampler.as_ref());
        let others = surface.into_iter().chain(opacity).chain(&self.hue).map(Fill::bytes).sum::<u64>();
        self.volume.0.bytes() + others
    }
}

#[cfg(test)]
mod tests;
