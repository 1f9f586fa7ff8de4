//! How bright and how coloured the data of the present view are: the histograms that the panel shows, and the ranges
//! that are used where the user has chosen none.

use super::state::histogram::AxisHistogram;
use crate::codec::CodebookScope;
use crate::color::Accumulation;
use crate::color::transfer::{Levels, Scale, TransferFunction};
use crate::cpu::surface::look::Attribute;
use crate::picture::Subject;
use crate::picture::field::PreparedField;
use crate::picture::surface::OpenSurface;
use bevy::prelude::*;

/// What was measured in the present picture.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Exposure {
    /// How often values of `P` occur.
    pub brightness: Option<AxisHistogram>,
    /// How often values of `S` occur, where the picture has it.
    pub hue: Option<AxisHistogram>,
    /// How often pairs of both occur, over their ranges.
    pub joint: Option<Joint>,
    /// The ranges that the transfer function asks for.
    pub levels: Option<Levels>,
}

/// How often pairs of places occur: of brightness to the right, of the attribute upwards.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Bins from left to right.
    pub columns: usize,
    /// Counts, row by row from below.
    pub counts: Vec<f32>,
}

impl Joint {
    const SIZE: [usize; 2] = [56, 40];

    /// Bins from below to above.
    pub fn rows(&self) -> usize {
        self.counts.len() / self.columns.max(1)
    }

    /// Counts pairs of values with their weights over the ranges in use; what lies outside of them is not counted.
    fn of(pairs: impl Iterator<Item = [f32; 3]>, scales: [Scale; 2], levels: &Levels) -> Option<Joint> {
        let [columns, rows] = Joint::SIZE;
        let mut counts = vec![0.0; columns * rows];
        let mut any = false;
        for [p, s, weight] in pairs {
            let places = [scales[0].place(p, levels.p), scales[1].place(s, levels.s)];
            if places.iter().any(|place| *place <= 0.0 || *place >= 1.0) {
                continue;
            }
            let [column, row] = [0, 1].map(|k| (places[k] * Joint::SIZE[k] as f32) as usize);
            counts[row.min(rows - 1) * columns + column.min(columns - 1)] += weight;
            any = true;
        }
        any.then_some(Joint { columns, counts })
    }
}

impl Exposure {
    /// Measures what light comes from, which is in no picture: densities (or own columns) and attributes of the file's own particles, as
    /// its codebooks have them, weighted by their family's share of the mass.
    pub fn of_codebooks(subject: &Subject<'_>, levels: Levels) -> Exposure {
        let Subject { metadata, depiction, transfer, .. } = *subject;
        let mut triples: Vec<[f32; 3]> = Vec::new();
        let mass: f64 = metadata.families.iter().map(|family| family.mass).sum();
        for family in &metadata.families {
            for codebook in family.codebooks.iter().filter(|codebook| codebook.scope == CodebookScope::Leaves) {
                let table = depiction.table(family, codebook);
                let attribute = |index: usize| table.attribute.as_ref().map_or(0.0, |attribute| attribute[index]);
                let share = (family.mass / mass.max(f64::MIN_POSITIVE)) as f32;
                let values = subject.told_values(&table, codebook);
                let entry = |index: usize| [values[index], attribute(index), share];
                triples.extend((0..codebook.len()).map(entry));
            }
        }
        let brightness = histogram(triples.iter().map(|triple| triple[0]), transfer.scale, 1e-12);
        let hue = transfer.hue.as_ref().filter(|_| depiction.attribute.is_some());
        let joint = hue.and_then(|hue| Joint::of(triples.iter().copied(), [transfer.scale, hue.scale], &levels));
        let hue = hue.and_then(|hue| histogram(triples.iter().map(|triple| triple[1]), hue.scale, 1e-9));
        Exposure { brightness, hue, joint, levels: Some(levels) }
    }

    /// Measures what an image or a volume is made of: an even sample of its values, and of what colours them.
    pub fn of_field(prepared: &PreparedField) -> Exposure {
        let (transfer, levels) = (&prepared.transfer, prepared.levels);
        let levels = Levels { p: levels.density, s: levels.attribute };
        let values = |channel: usize| {
            let values = &prepared.field.channels[channel].levels[0].values;
            // An odd step, so that rows of an even length do not repeat.
            values.iter().copied().step_by((values.len() / FIELD_SAMPLE) | 1)
        };
        let brightness = histogram(values(0), transfer.scale, 1e-9);
        let hue = transfer.hue.as_ref().filter(|_| prepared.has_hue());
        let joint = hue.and_then(|hue| {
            let pairs = values(0).zip(values(1)).filter(|(p, s)| p.is_finite() && s.is_finite());
            Joint::of(pairs.map(|(p, s)| [p, s, 1.0]), [transfer.scale, hue.scale], &levels)
        });
        let hue = hue.and_then(|hue| histogram(values(1), hue.scale, 1e-9));
        Exposure { brightness, hue, joint, levels: Some(levels) }
    }

    /// Measures heights: an even share of their samples, where these are what colours show.
    pub fn of_heights(opened: &OpenSurface, attribute: Attribute, scale: Scale, levels: Levels) -> Exposure {
        let brightness = match attribute {
            Attribute::Height => histogram(opened.coarse_heights().map(|height| height as f32), scale, 1e-9),
            _ => None,
        };
        Exposure { brightness, levels: Some(levels), ..Exposure::default() }
    }

    /// Measures a picture.
    pub fn of(picture: &Accumulation, transfer: &TransferFunction) -> Exposure {
        let levels = transfer.levels(picture);
        let brightness = histogram(picture.p.iter().copied().filter(|p| *p > 0.0), transfer.scale, 1e-9);
        let hue = transfer.hue.as_ref().filter(|_| picture.has_attribute()).and_then(|hue| {
            let lit = |(&p, &ps): (&f32, &f32)| (f64::from(p) > levels.p[0]).then(|| ps / p);
            histogram(picture.p.iter().zip(&picture.ps).filter_map(lit), hue.scale, 1e-6)
        });
        let joint = transfer.hue.as_ref().filter(|_| picture.has_attribute()).and_then(|hue| {
            let pairs = picture.p.iter().zip(&picture.ps).filter(|(p, _)| **p > 0.0).map(|(&p, &ps)| [p, ps / p, 1.0]);
            Joint::of(pairs, [transfer.scale, hue.scale], &levels)
        });
        Exposure { brightness, hue, joint, levels: Some(levels) }
    }
}

/// Values of a field that are counted, about.
const FIELD_SAMPLE: usize = 1 << 16;
/// Number of bins of the histograms.
const BINS: usize = 96;

/// A histogram over all finite values; on a logarithmic scale over the positive ones that are above `floor` times the
/// largest. `None` without values.
fn histogram(values: impl Iterator<Item = f32>, scale: Scale, floor: f64) -> Option<AxisHistogram> {
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
    Some(AxisHistogram { counts, span: span.map(back), log })
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
        let joint = Exposure::of(&picture, &transfer).joint.unwrap();
        assert!(joint.rows() > 9 && joint.counts.iter().sum::<f32>() >= 3.0);
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
