//! Numbers of ISO 25178-2: heights as means over measured samples, slopes and areas over T.

use super::autocorrelation::correlation;
use super::bands::{Band, map_bands};
use super::material::Curve;
use crate::model::{Cell, HeightError, Heights, Lengths};
use serde::Serialize;

/// Numbers of a surface. Heights are in the unit of heights, lengths as [`Lengths`] has them. What has no value (a level surface's Ssk, Sal of a
/// field of more than 4096 columns or rows) is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "PascalCase")]
pub struct Iso {
    /// Mean distance from the mean height.
    pub sa: Option<f64>,
    /// Root of the mean square distance from the mean height.
    pub sq: Option<f64>,
    /// Skewness.
    pub ssk: Option<f64>,
    /// Kurtosis; 3 of a normal distribution.
    pub sku: Option<f64>,
    /// Largest height above the mean.
    pub sp: Option<f64>,
    /// Largest depth below the mean.
    pub sv: Option<f64>,
    /// Sp + Sv.
    pub sz: Option<f64>,
    /// Root of the mean square slope.
    pub sdq: Option<f64>,
    /// What T's area is above its area in plan, percent.
    pub sdr: Option<f64>,
    /// Height of the core of the material ratio curve.
    pub sk: Option<f64>,
    /// Reduced height of peaks.
    pub spk: Option<f64>,
    /// Reduced depth of valleys.
    pub svk: Option<f64>,
    /// Share of the samples above the core, percent.
    pub smr1: Option<f64>,
    /// Share of the samples above the valleys, percent.
    pub smr2: Option<f64>,
    /// Shortest lag at which the autocorrelation falls to 0.2.
    pub sal: Option<f64>,
    /// That lag divided by the longest.
    pub str: Option<f64>,
}

/// Numbers of a region and how much of it was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Roughness {
    /// Samples.
    pub samples: u64,
    /// Measured samples.
    pub valid: u64,
    /// Their share.
    pub valid_share: f64,
    /// The mean height; none without a measured sample.
    pub mean: Option<f64>,
    /// T's area in plan, in the square of the unit of lengths.
    pub area: f64,
    /// The numbers.
    pub iso: Iso,
}

/// Sums of one band that need no mean.
#[derive(Clone, Copy)]
struct First {
    valid: u64,
    sum: f64,
    range: [f64; 2],
    /// T's area in plan.
    area: f64,
    /// Squares of slopes, and what T's area has more than its plan by its plan, both times the plan.
    slopes: f64,
    areas: f64,
}

/// Numbers of a whole field, whose degrees are those of the Earth.
///
/// # Errors
/// As [`roughness_on`].
pub fn roughness(heights: &dyn Heights) -> Result<Roughness, HeightError> {
    roughness_on(heights, &Lengths::of(heights.grid()))
}

/// Numbers of a whole field. A part of one is a field of its own: [`super::Part`]; a form or waves are taken off before:
/// [`super::Residual`], [`super::Filtered`].
///
/// # Errors
/// Where the field cannot be read.
pub fn roughness_on(heights: &dyn Heights, lengths: &Lengths) -> Result<Roughness, HeightError> {
    let grid = heights.grid();
    let first = map_bands(heights, 1, |band| first_sums(band, lengths))?;
    let range = [f64::INFINITY, f64::NEG_INFINITY];
    let none = First { valid: 0, sum: 0.0, range, area: 0.0, slopes: 0.0, areas: 0.0 };
    let all = first.into_iter().fold(none, |all, band| First {
        valid: all.valid + band.valid,
        sum: all.sum + band.sum,
        range: [all.range[0].min(band.range[0]), all.range[1].max(band.range[1])],
        area: all.area + band.area,
        slopes: all.slopes + band.slopes,
        areas: all.areas + band.areas,
    });
    let samples = grid.samples();
    let area = all.area;
    let valid_share = all.valid as f64 / samples as f64;
    let mut found = Roughness { samples, valid: all.valid, valid_share, mean: None, area, iso: Iso::default() };
    if all.valid == 0 {
        return Ok(found);
    }
    let iso = &mut found.iso;
    if area > 0.0 {
        (iso.sdq, iso.sdr) = (Some((all.slopes / area).sqrt()), Some(100.0 * all.areas / area));
    }
    let span = all.range[1] - all.range[0];
    let rough = (all.sum / all.valid as f64).clamp(all.range[0], all.range[1]);
    // In parts of the range, so that the fourth power stays in the range of numbers.
    let unit = if span > 0.0 { span } else { 1.0 };
    let count = all.valid as f64;
    let second = map_bands(heights, 0, |band| second_sums(band, rough, unit))?;
    let sums = second.into_iter().fold([0.0; 5], |all, band| std::array::from_fn(|k| all[k] + band[k]));
    let [shift, absolute, m2, m3, m4] = sums.map(|sum| sum / count);
    // Moments about the mean of moments about a number next to it.
    let (v2, v3) = (m2 - shift * shift, m3 - 3.0 * shift * m2 + 2.0 * shift.powi(3));
    let v4 = m4 - 4.0 * shift * m3 + 6.0 * shift * shift * m2 - 3.0 * shift.powi(4);
    let mean = rough + unit * shift;
    found.mean = Some(mean);
    let sq = v2.max(0.0).sqrt();
    (iso.sa, iso.sq) = (Some(unit * absolute), Some(unit * sq));
    (iso.sp, iso.sv, iso.sz) = (Some(all.range[1] - mean), Some(mean - all.range[0]), Some(span));
    if span == 0.0 || sq == 0.0 {
        return Ok(found);
    }
    (iso.ssk, iso.sku) = (Some(v3 / sq.powi(3)), Some(v4 / sq.powi(4)));
    if let Some(material) = Curve::read(heights, all.range, all.valid)?.material() {
        (iso.sk, iso.spk, iso.svk) = (Some(material.sk), Some(material.spk), Some(material.svk));
        (iso.smr1, iso.smr2) = (Some(material.smr1), Some(material.smr2));
    }
    let steps = lengths.steps(0.5 * (grid.rows - 1) as f64);
    if let Some(texture) = correlation(heights, mean, unit)?.and_then(|correlation| correlation.texture(steps)) {
        (iso.sal, iso.str) = (Some(texture.sal), Some(texture.str));
    }
    Ok(found)
}

fn first_sums(band: &Band<'_>, lengths: &Lengths) -> First {
    let (mut valid, mut sum, mut range) = (0, 0.0, [f64::INFINITY, f64::NEG_INFINITY]);
    for (_, row) in band.rows() {
        let mut line = 0.0;
        for height in row.iter().filter(|height| !height.is_nan()) {
            valid += 1;
            line += height;
            range = [range[0].min(*height), range[1].max(*height)];
        }
        sum += line;
    }
    let (mut area, mut slopes, mut areas) = (0.0, 0.0, 0.0);
    for (number, upper, lower) in band.pairs() {
        let ([across, along], half) = (lengths.slopes(number), 0.5 * lengths.cell(number));
        let (mut triangles, mut line_slopes, mut line_areas) = (0_u64, 0.0, 0.0);
        for (upper, lower) in upper.windows(2).zip(lower.windows(2)) {
            for triangle in Cell([upper[0], upper[1], lower[0], lower[1]]).triangles() {
                let (p, q) = (across * triangle.at[1], along * triangle.at[2]);
                let square = p * p + q * q;
                triangles += 1;
                line_slopes += square;
                // sqrt(1 + s) - 1 without cancellation.
                line_areas += square / ((1.0 + square).sqrt() + 1.0);
            }
        }
        area += half * triangles as f64;
        slopes += half * line_slopes;
        areas += half * line_areas;
    }
    First { valid, sum, range, area, slopes, areas }
}

fn second_sums(band: &Band<'_>, mean: f64, unit: f64) -> [f64; 5] {
    let mut sums = [0.0; 5];
    for (_, row) in band.rows() {
        let mut line = [0.0; 5];
        for height in row.iter().filter(|height| !height.is_nan()) {
            let off = (height - mean) / unit;
            let square = off * off;
            for (sum, part) in line.iter_mut().zip([off, off.abs(), square, square * off, square * square]) {
                *sum += part;
            }
        }
        sums.iter_mut().zip(line).for_each(|(sum, part)| *sum += part);
    }
    sums
}
