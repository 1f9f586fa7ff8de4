//! How bright and how coloured the data of the present view are: the histograms that the panel shows, and the ranges
//! that are used where the user has chosen none.

use super::panel::histogram::Histogram;
use crate::raster::Accumulation;
use crate::raster::transfer::{Levels, Scale, TransferFunction};
use bevy::prelude::*;

/// What was measured in the present picture.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Exposure {
    /// How often values of `P` occur.
    pub brightness: Option<Histogram>,
    /// How often values of `S` occur, where the picture has it.
    pub hue: Option<Histogram>,
    /// The ranges that the transfer function asks for.
    pub levels: Option<Levels>,
}

impl Exposure {
    /// Measures a picture.
    pub fn of(picture: &Accumulation, transfer: &TransferFunction) -> Exposure {
        let levels = transfer.levels(picture);
        let brightness = histogram(picture.p.iter().copied().filter(|p| *p > 0.0), transfer.scale, 1e-9);
        let hue = transfer.hue.filter(|_| picture.has_attribute()).and_then(|hue| {
            let lit = |(&p, &ps): (&f32, &f32)| (f64::from(p) > levels.p[0]).then(|| ps / p);
            histogram(picture.p.iter().zip(&picture.ps).filter_map(lit), hue.scale, 1e-6)
        });
        Exposure { brightness, hue, levels: Some(levels) }
    }
}

/// Number of bins of the histograms.
const BINS: usize = 96;

/// A histogram over all finite values; on a logarithmic scale over the positive ones that are above `floor` times the
/// largest. `None` without values.
fn histogram(values: impl Iterator<Item = f32>, scale: Scale, floor: f64) -> Option<Histogram> {
    let log = scale == Scale::Log;
    let place = |value: f32| if log { f64::from(value).log10() } else { f64::from(value) };
    let values: Vec<f64> = values.filter(|v| v.is_finite() && (!log || *v > 0.0)).map(place).collect();
    let high = values.iter().copied().reduce(f64::max)?;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let low = if log { low.max(high + floor.log10()) } else { low };
    // A picture of one value still has an axis to show it on.
    let least = if log { 0.2 } else { 1e-3 * high.abs().max(1e-30) };
    let missing = (least - (high - low)).max(0.0);
    let span = [low - 0.5 * missing, high + 0.5 * missing];
    let mut counts = vec![0.0; BINS];
    let bins = BINS as f64 / (span[1] - span[0]);
    for value in values {
        let bin = (value - span[0]) * bins;
        if bin >= 0.0 {
            counts[(bin as usize).min(BINS - 1)] += 1.0;
        }
    }
    let back = |x: f64| if log { 10f64.powf(x) } else { x };
    Some(Histogram { counts, span: span.map(back), log })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_empty_sky_is_not_counted() {
        let p: Vec<f32> = (0..10_000).map(|i| if i % 2 == 0 { 0.0 } else { 10f32.powf(i as f32 / 2000.0) }).collect();
        let picture = Accumulation { width: 100, height: 100, p, ps: Vec::new() };
        let exposure = Exposure::of(&picture, &TransferFunction::default());
        let histogram = exposure.brightness.unwrap();
        assert!(histogram.log && histogram.counts.iter().sum::<f64>() == 5000.0);
        assert!(exposure.hue.is_none() && exposure.levels.unwrap().p[0] > 0.0);
        let black = Accumulation::new(4, 4, true);
        assert!(Exposure::of(&black, &TransferFunction::default()).brightness.is_none());
    }

    #[test]
    fn hues_are_those_of_lit_pixels() {
        let mut picture = Accumulation::new(10, 1, true);
        for i in 0..10 {
            picture.p[i] = if i < 5 { 1.0 } else { 1000.0 };
            picture.ps[i] = picture.p[i] * (i as f32 + 1.0);
        }
        let transfer = TransferFunction::preset("density-hue").unwrap();
        let hue = Exposure::of(&picture, &transfer).hue.unwrap();
        assert!(hue.span[1] <= 10.001 && hue.counts.iter().sum::<f64>() >= 5.0);
    }

    #[test]
    fn a_constant_still_has_an_axis() {
        for scale in [Scale::Log, Scale::Linear] {
            let histogram = histogram([3.0; 9].into_iter(), scale, 1e-9).unwrap();
            assert!(histogram.span[1] > histogram.span[0] && histogram.counts.iter().sum::<f64>() == 9.0);
        }
        assert!(histogram([0.0; 3].into_iter(), Scale::Linear, 1e-9).is_some());
    }
}
