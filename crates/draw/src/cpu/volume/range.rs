//! Automatic ranges of a volume: percentiles of the field as a sketch shows it, resampled with few cells and, where there are
//! many, a part of the particles.

use super::bricks::{BORDER, BRICK};
use super::particles::{Projected, Taken, growth, project};
use super::resample::Resampler;
use super::{Prepared, Supply, VolumeError, VolumeOptions, extents};
use crate::cpu::Splats;
use crate::view::perspective_grid::{GridError, GridOptions};
use crate::view::{Extent, PerspectiveGrid, View};

/// Longest side of the sketch, cells.
const SIDE: u32 = 96;
/// Particles that the sketch takes, about.
const PARTICLES: usize = 1 << 18;

/// Percentiles of a field, weighted by mass unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldRange {
    /// Density at the lower and upper end of what is to be seen; ascending and positive.
    pub density: [f64; 2],
    /// Attribute below which 3 % and 97 % of the mass in view lie.
    pub attribute: [f64; 2],
}

/// What ranges are found from: fewer cells than the picture has and, where there are many, a part of the particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sketch {
    /// The camera.
    pub view: View,
    /// How it is sampled.
    pub options: VolumeOptions,
    /// One of so many particles is taken.
    pub stride: usize,
}

impl Sketch {
    /// For a picture of so many particles that is sampled like this.
    pub fn of(view: &View, particles: usize, options: &VolumeOptions) -> Sketch {
        let shrink = (f64::from(SIDE) / f64::from(view.width.max(view.height))).min(1.0);
        let side = |pixels: u32| ((f64::from(pixels) * shrink).round() as u32).max(1);
        let VolumeOptions { near, far, kernel, .. } = *options;
        let grid = GridOptions { resolution: 1.0, lambda: false };
        Sketch {
            view: view.resized(side(view.width), side(view.height)),
            options: VolumeOptions { grid, near, far, kernel, ..VolumeOptions::default() },
            stride: particles.div_ceil(PARTICLES).max(1),
        }
    }

    /// Its grid around extents, and an upper bound of smoothing lengths in cells.
    ///
    /// # Errors
    /// [`VolumeError`] when nothing is in view.
    pub fn grid(&self, extents: impl IntoIterator<Item = Extent>) -> Result<(PerspectiveGrid, f32), VolumeError> {
        let grown = |extent: Extent| Extent { margin: extent.margin * growth(self.stride), ..extent };
        extents::planes_and_widest(&self.view, extents.into_iter().map(grown), &self.options)
    }
}

/// Finds the ranges of what `view` sees between the planes that are set.
///
/// # Errors
/// [`VolumeError`] when nothing is in view.
pub fn measure(view: &View, batches: &[Splats<'_>], options: &VolumeOptions) -> Result<FieldRange, VolumeError> {
    let sketch = Sketch::of(view, batches.iter().map(Splats::len).sum(), options);
    let (grid, widest) = sketch.grid(extents::of(batches))?;
    let taken =
        Taken { sigma: grid.sigma, smallest: sketch.options.smallest, stride: sketch.stride, kernel: options.kernel };
    measure_sketch(&Prepared::new(grid, widest, project(&sketch.view, batches, &taken).unless_empty()?), options)
}

/// The same of particles that are not all there at once.
///
/// # Errors
/// As [`measure`].
pub fn measure_supplied(
    view: &View,
    supply: &mut dyn Supply,
    options: &VolumeOptions,
) -> Result<FieldRange, VolumeError> {
    let sketch = Sketch::of(view, supply.particles() as usize, options);
    let (grid, widest) = sketch.grid(supply.extents())?;
    let taken =
        Taken { sigma: grid.sigma, smallest: sketch.options.smallest, stride: sketch.stride, kernel: options.kernel };
    let mut particles = Projected { attribute: supply.has_attribute(), ..Projected::default() };
    supply.supply(&|_| true, &mut |batches: &[Splats<'_>]| particles.append(project(&sketch.view, batches, &taken)));
    measure_sketch(&Prepared::new(grid, widest, particles.unless_empty()?), options)
}

/// Finds the ranges of what a sketch shows.
fn measure_sketch(prepared: &Prepared, options: &VolumeOptions) -> Result<FieldRange, VolumeError> {
    let grid = &prepared.grid;
    let own = |column: usize, axis: usize| (BORDER..BORDER + grid.size[axis] as usize).contains(&column);
    let brick_grid = prepared.brick_grid();
    let (mut densities, mut attributes) = (Histogram::default(), Histogram::default());
    let mut resampler = Resampler::new(prepared, options.kernel);
    // A few layers at a time: the depth of an outlier may be great.
    for first in (0..brick_grid.bricks[2]).step_by(8) {
        let layers = first..(first + 8).min(brick_grid.bricks[2]);
        let (layers, _) = resampler.resample(layers, &[]);
        for (layer, bricks) in layers.iter().enumerate() {
            for (place, brick) in bricks.iter().enumerate().filter_map(|(place, brick)| Some((place, brick.as_ref()?)))
            {
                let corner = [place % brick_grid.bricks[0], place / brick_grid.bricks[0]].map(|brick| brick * BRICK);
                for (index, &density) in brick.density.iter().enumerate().filter(|(_, density)| **density > 0.0) {
                    let slice = (first + layer) * BRICK + index / (BRICK * BRICK);
                    // The picture's own cells.
                    if slice >= brick_grid.slices
                        || !own(corner[0] + index % BRICK, 0)
                        || !own(corner[1] + index / BRICK % BRICK, 1)
                    {
                        continue;
                    }
                    let width = f64::from(brick_grid.spacing[slice]);
                    let mass = f64::from(density) * width.powi(3);
                    densities.add(density, mass);
                    if let Some(weighted) = brick.weighted.get(index) {
                        attributes.add(weighted / density, mass);
                    }
                }
            }
        }
        resampler.recycle(layers);
    }
    FieldRange::of(&densities, &attributes)
}

impl FieldRange {
    /// The ranges of a field with so much mass at each density and at each value of the attribute.
    ///
    /// # Errors
    /// [`GridError::NothingInView`] without any mass.
    pub fn of(densities: &Histogram, attributes: &Histogram) -> Result<FieldRange, VolumeError> {
        let [low, high] = densities.percentiles([0.03, 0.995]).ok_or(GridError::NothingInView)?;
        let [cold, hot] = attributes.percentiles([0.03, 0.97]).unwrap_or([0.0, 1.0]);
        // Two decades at least: a field that is nearly constant has no structure to spread colours over.
        Ok(FieldRange { density: [low.min(1e-2 * high), high], attribute: [cold, hot] })
    }
}

/// Mass by the leading bits of a value: 64 classes an octave, ascending.
pub struct Histogram(pub Vec<f64>);

/// Bits of a float that a histogram does not see.
pub const HIDDEN_BITS: u32 = 17;
/// Classes of a histogram.
pub const CLASSES: usize = 1 << (32 - HIDDEN_BITS);

impl Default for Histogram {
    fn default() -> Histogram {
        Histogram(vec![0.0; CLASSES])
    }
}

impl Histogram {
    pub(super) fn add(&mut self, value: f32, mass: f64) {
        if value.is_finite() && mass.is_finite() {
            // Floats in the order of their bits: negative ones turned round, before the others.
            let bits = value.to_bits();
            let ordered = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
            self.0[(ordered >> HIDDEN_BITS) as usize] += mass;
        }
    }

    /// Adds the mass of another one.
    pub fn add_all(&mut self, other: &Histogram) {
        self.0.iter_mut().zip(&other.0).for_each(|(mass, more)| *mass += more);
    }

    /// The values below which these shares of the mass lie; `None` without mass.
    pub(super) fn percentiles<const N: usize>(&self, shares: [f64; N]) -> Option<[f64; N]> {
        let total: f64 = self.0.iter().sum();
        (total > 0.0).then(|| {
            shares.map(|share| {
                let mut sum = 0.0;
                let class = self.0.iter().position(|mass| {
                    sum += mass;
                    sum >= share * total
                });
                let ordered = (class.unwrap_or(self.0.len() - 1) as u32) << HIDDEN_BITS;
                let bits = if ordered >> 31 == 1 { ordered & !(1 << 31) } else { !ordered };
                f64::from(f32::from_bits(bits))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_any_sign() {
        let mut histogram = Histogram::default();
        for value in [-8.0, -1.0, 0.0, 2.0, 64.0] {
            histogram.add(value, 1.0);
        }
        histogram.add(f32::NAN, 1.0);
        let [first, middle, last] = histogram.percentiles([0.1, 0.5, 1.0]).unwrap();
        assert!((first + 8.0).abs() < 0.2 && middle == 0.0 && last == 64.0, "{first} {middle} {last}");
        assert!(Histogram::default().percentiles([0.5]).is_none());
    }
}
