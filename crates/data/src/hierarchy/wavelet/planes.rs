//! What is measured: channels without holes, colours as lightness and two differences.

use super::bricks::{Bricks, Part};
use super::error::Options;
use super::feed::Feed;
use super::grid::Samples;
use super::holes::Filling;
use rayon::prelude::*;
use std::convert::Infallible;

/// How much a difference of colour counts against one of lightness, squared.
const COLOUR: f32 = 0.15;
/// Lightness and two differences from red, green, blue (ITU-R BT.601); the hierarchy's values are these.
const FROM_RGB: [[f32; 3]; 3] = [[0.299, 0.587, 0.114], [-0.168_736, -0.331_264, 0.5], [0.5, -0.418_688, -0.081_312]];
const TO_RGB: [[f32; 3]; 3] = [[1.0, 0.0, 1.402], [1.0, -0.344_136, -0.714_136], [1.0, 1.772, 0.0]];

/// Planes of values that the hierarchy is built of.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    /// Values, without holes.
    pub values: Vec<Vec<f32>>,
    /// How much the square of a difference counts.
    pub weights: Vec<f32>,
    /// Whether the first three are lightness and differences of colour.
    pub colours: bool,
    /// Where samples are holes, in any channel, or count as air; empty where none do.
    pub holes: Vec<bool>,
}

/// What turns channels into planes.
#[derive(Clone, Debug)]
pub(super) struct Rules {
    /// Whether the first three channels are red, green and blue.
    pub colours: bool,
    /// What stands in holes, where there are any.
    pub filling: Option<Filling>,
}

impl Rules {
    /// The rules for channels of which the first may be colours. Reads all samples where some may be holes.
    pub fn new<F: Feed>(feed: &F, bricks: Bricks, options: &Options, at_once: usize) -> Result<Rules, F::Error> {
        let (count, below) = (feed.channels(), options.ignore_below);
        let filling = match feed.may_have_holes() || below.is_some() {
            true => Filling::survey(feed, bricks, below, at_once)?,
            false => None,
        };
        Ok(Rules { colours: options.colours && (count == 3 || count == 4), filling })
    }

    /// The planes' values in a box, and where holes are; no mask where the grid has none.
    pub fn read<F: Feed>(&self, feed: &F, part: &Part) -> Result<(Vec<Vec<f32>>, Vec<bool>), F::Error> {
        let Some(filling) = &self.filling else {
            let mut channels = feed.read(part)?;
            self.turn(&mut channels);
            return Ok((channels, Vec::new()));
        };
        let aligned = filling.aligned(part);
        let mut channels = feed.read(&aligned)?;
        let holes = filling.holes(&channels);
        filling.fill(&aligned, &mut channels, &holes);
        self.turn(&mut channels);
        let values = channels.iter().map(|channel| within(channel, &aligned, part)).collect();
        Ok((values, within(&holes, &aligned, part)))
    }

    /// Channels as planes.
    fn turn(&self, values: &mut [Vec<f32>]) {
        if let (true, [red, green, blue, ..]) = (self.colours, values) {
            red.par_iter_mut().zip(green).zip(blue).for_each(|((a, b), c)| {
                let rgb = [*a, *b, *c];
                [*a, *b, *c] = FROM_RGB.map(|row| (0..3).map(|k| row[k] * rgb[k]).sum());
            });
        }
    }

    /// How much the square of a difference counts in planes with these ranges.
    pub fn weights(&self, ranges: &[(f32, f32)]) -> Vec<f32> {
        let by_range = |(low, high): &(f32, f32)| {
            let span = high - low;
            if span > 0.0 && span.is_finite() { 1.0 / (span * span) } else { 0.0 }
        };
        match ranges.len() {
            count if self.colours => (0..count).map(|k| if k == 1 || k == 2 { COLOUR } else { 1.0 }).collect(),
            // Channels of any units: each counts by its range.
            2.. => ranges.iter().map(by_range).collect(),
            _ => vec![1.0; ranges.len()],
        }
    }
}

/// What a box has in a box within it.
fn within<T: Copy>(values: &[T], from: &Part, part: &Part) -> Vec<T> {
    let mut out = Vec::with_capacity(part.len());
    let end = part.end();
    for z in part.min[2]..end[2] {
        for y in part.min[1]..end[1] {
            let row = from.index([part.min[0], y, z]);
            out.extend_from_slice(&values[row..row + part.shape[0]]);
        }
    }
    out
}

impl Planes {
    /// The planes of samples of which a hierarchy is built so.
    pub fn new(samples: &Samples, options: &Options) -> Planes {
        let bricks = Bricks { dimensions: samples.dimensions, shape: samples.shape };
        let all = Part::whole(samples.shape);
        let read = || -> Result<(Rules, (Vec<Vec<f32>>, Vec<bool>)), Infallible> {
            let rules = Rules::new(samples, bricks, options, bricks.len())?;
            let read = rules.read(samples, &all)?;
            Ok((rules, read))
        };
        let (rules, (values, holes)) = match read() {
            Ok(read) => read,
            Err(never) => match never {},
        };
        let ranges: Vec<(f32, f32)> = values.iter().map(|plane| range(plane)).collect();
        Planes { weights: rules.weights(&ranges), values, colours: rules.colours, holes }
    }

    /// A place's channels from its planes, in place.
    #[inline]
    pub fn back(&self, values: &mut [f32]) {
        if let (true, [a, b, c, ..]) = (self.colours, &mut *values) {
            let planes = [*a, *b, *c];
            [*a, *b, *c] = TO_RGB.map(|row| row[0] * planes[0] + row[1] * planes[1] + row[2] * planes[2]);
        }
    }
}

/// Smallest and largest of values.
pub(super) fn range(values: &[f32]) -> (f32, f32) {
    values
        .par_iter()
        .fold(|| (f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
        .reduce(|| (f32::INFINITY, f32::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)))
}
