//! What an image or a volume holds in a region: values of its samples, exactly.

use super::error::ExploreError;
use super::region::Region;
use super::shape::Shapes;
use crate::cpu::field::Field;
use crate::model::Unit;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// Statistics of the samples in a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldProbe {
    /// Samples in the region.
    pub samples: u64,
    /// Their volume (of an image: area), world units.
    pub volume: f64,
    /// Of each channel what its values are there.
    pub channels: Vec<ChannelProbe>,
}

/// The values of a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelProbe {
    /// Its name.
    pub name: String,
    /// Its unit; empty when unknown.
    pub unit: Unit,
    /// Samples that have a value.
    pub count: u64,
    /// Smallest value; `None` where there is none.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Mean.
    pub mean: Option<f64>,
    /// Root of the mean squared distance from the mean.
    pub dispersion: Option<f64>,
    /// Sum of the values.
    pub sum: f64,
    /// The value in the middle of the first sphere or box, between samples; `None` outside, in holes, and without either.
    pub middle: Option<f64>,
    /// How many values there are in equal parts of the range from `min` to `max`.
    pub histogram: Vec<u64>,
}

/// Sums of a channel.
#[derive(Clone, Copy)]
struct Sums {
    count: u64,
    sum: f64,
    min: f64,
    max: f64,
}

/// Asks what a field holds in a region: within all of its shapes, with values in its ranges (of channels). Sums are in the order of the
/// samples, so that they are the same for any number of threads.
///
/// # Errors
/// [`ExploreError`] for a region that makes no sense, or a range of something that the field has not.
pub fn probe_field(field: &Field, region: &Region, bins: usize) -> Result<FieldProbe, ExploreError> {
    let shapes = Shapes::new(region, None)?;
    let names = || field.channels.iter().map(|channel| channel.name.clone()).collect::<Vec<_>>().join(", ");
    let mut ranges = Vec::new();
    for range in &region.ranges {
        let channel = field.channels.iter().position(|channel| channel.name == range.field);
        let channel = channel.ok_or_else(|| ExploreError::Value {
            field: "where".into(),
            found: range.field.clone(),
            expected: format!("one of {}", names()),
        })?;
        ranges.push((channel, range.min.unwrap_or(f64::NEG_INFINITY), range.max.unwrap_or(f64::INFINITY)));
    }
    let shape = field.shape();
    let rows = shape[1] * shape[2];
    let channels: Vec<&[f32]> = field.channels.iter().map(|channel| &channel.levels[0].values[..]).collect();
    // The samples of a row that are in the region.
    let inside = |row: usize| {
        let (channels, ranges, shapes) = (&channels, &ranges, &shapes);
        (0..shape[0]).filter_map(move |x| {
            let index = row * shape[0] + x;
            let at = DVec3::new(x as f64, (row % shape[1]) as f64, (row / shape[1]) as f64);
            let is_in = shapes.are_everywhere() || shapes.contains(field.to_world.transform_point3(at));
            let fits = |&(channel, min, max): &(usize, f64, f64)| {
                let value = f64::from(channels[channel][index]);
                value >= min && value <= max
            };
            (is_in && ranges.iter().all(fits)).then_some(index)
        })
    };
    let none = Sums { count: 0, sum: 0.0, min: f64::INFINITY, max: f64::NEG_INFINITY };
    let of_row = |row: usize| {
        let mut sums = vec![none; channels.len()];
        let mut samples = 0;
        for index in inside(row) {
            samples += 1;
            for (sums, values) in sums.iter_mut().zip(&channels) {
                let value = f64::from(values[index]);
                if !value.is_nan() {
                    sums.count += 1;
                    sums.sum += value;
                    (sums.min, sums.max) = (sums.min.min(value), sums.max.max(value));
                }
            }
        }
        (samples, sums)
    };
    let of_rows: Vec<(u64, Vec<Sums>)> = (0..rows).into_par_iter().map(of_row).collect();
    let samples = of_rows.iter().map(|(samples, _)| samples).sum();
    let total = |channel: usize| {
        of_rows.iter().map(|(_, sums)| sums[channel]).fold(none, |a, b| Sums {
            count: a.count + b.count,
            sum: a.sum + b.sum,
            min: a.min.min(b.min),
            max: a.max.max(b.max),
        })
    };
    let middle = (!shapes.are_everywhere()).then(|| field.to_index.transform_point3(shapes.reference()).as_vec3());
    let of_channel = |(number, channel): (usize, &crate::cpu::field::FieldChannel)| {
        let Sums { count, sum, min, max } = total(number);
        let mean = (count > 0).then(|| sum / count as f64);
        let (mut squares, mut histogram) = (0.0, vec![0; bins]);
        let spread = |row: usize| {
            let (mut squares, mut counts) = (0.0, vec![0u64; bins]);
            for index in inside(row) {
                let value = f64::from(channels[number][index]);
                if !value.is_nan() {
                    let away = value - mean.unwrap_or(0.0);
                    squares += away * away;
                    let place = if max > min { (value - min) / (max - min) } else { 0.0 };
                    if let Some(last) = bins.checked_sub(1) {
                        counts[((place * bins as f64) as usize).min(last)] += 1;
                    }
                }
            }
            (squares, counts)
        };
        let of_rows: Vec<(f64, Vec<u64>)> = (0..rows).into_par_iter().map(spread).collect();
        for (own, counts) in of_rows {
            squares += own;
            histogram.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        }
        let value = middle.map(|at| at.to_array()).filter(|at| field.holds(*at)).map(|at| channel.levels[0].at(at));
        ChannelProbe {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
            count,
            min: (count > 0).then_some(min),
            max: (count > 0).then_some(max),
            mean,
            dispersion: (count > 0).then(|| (squares / count as f64).sqrt()),
            sum,
            middle: value.filter(|value| !value.is_nan()).map(f64::from),
            histogram,
        }
    };
    let channels = field.channels.iter().enumerate().map(of_channel).collect();
    let columns = [0, 1, 2].map(|axis| field.to_world.matrix3.col(axis));
    let volume = match field.dimensions {
        2 => columns[0].cross(columns[1]).length(),
        _ => columns[0].cross(columns[1]).dot(columns[2]).abs(),
    };
    Ok(FieldProbe { samples, volume: volume * samples as f64, channels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, Grid, SampleType};
    use glam::DMat3;

    #[test]
    fn a_ball_of_a_linear_field_has_its_middle_as_its_mean() {
        let mut grid = Grid::volume([40, 40, 40], SampleType::F32, Channel::numbered(1));
        grid.to_world.matrix3 = DMat3::from_diagonal(DVec3::splat(0.5));
        let values: Vec<f32> = (0..64_000).map(|i| (i % 40) as f32 + if i == 17 { f32::NAN } else { 0.0 }).collect();
        let field = Field::new(&grid, vec![("value".into(), Unit::default(), values)], None);
        let center = DVec3::new(10.0, 9.5, 9.5);
        let found = probe_field(&field, &Region::sphere(center, 5.0), 8).unwrap();
        let own = &found.channels[0];
        assert!((found.volume / (4.0 / 3.0 * std::f64::consts::PI * 125.0) - 1.0).abs() < 0.02);
        assert_eq!((own.mean, own.middle, own.min, own.max), (Some(20.0), Some(20.0), Some(10.0), Some(30.0)));
        // A ball's spread along an axis is its radius by the root of 5.
        assert!((own.dispersion.unwrap() - 10.0 / 5f64.sqrt()).abs() < 0.05);
        assert_eq!(own.histogram.iter().sum::<u64>(), own.count);
        let all = probe_field(&field, &Region::whole().with_range("value", Some(35.0), None), 4).unwrap();
        assert_eq!((all.samples, all.channels[0].count), (8000, 8000));
        let wrong = probe_field(&field, &Region::whole().with_range("density", None, None), 4).unwrap_err();
        assert!(wrong.to_string().contains("expected one of value"), "{wrong}");
    }
}
