//! What is measured: channels without holes, colours as lightness and two differences.

use super::grid::{Samples, Shape, children, for_each_place};
use super::pyramid::shapes;
use rayon::prelude::*;

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
    /// Where samples are holes, in any channel; empty where none are.
    pub holes: Vec<bool>,
}

impl Planes {
    /// The planes of samples.
    pub fn new(samples: &Samples, colours: bool) -> Planes {
        let count = samples.channels.len();
        let colours = colours && (count == 3 || count == 4);
        let holes: Vec<bool> = (0..samples.len())
            .into_par_iter()
            .map(|i| samples.channels.iter().any(|channel| !channel[i].is_finite()))
            .collect();
        let any = holes.par_iter().any(|&hole| hole);
        let mut values: Vec<Vec<f32>> = samples.channels.iter().map(|channel| channel.to_vec()).collect();
        if any {
            values.iter_mut().for_each(|plane| filled(samples, plane, &holes));
        }
        let mut weights = vec![1.0; count];
        if colours {
            let rgb: Vec<[f32; 3]> = (0..samples.len())
                .into_par_iter()
                .map(|i| FROM_RGB.map(|row| (0..3).map(|c| row[c] * values[c][i]).sum()))
                .collect();
            for (c, plane) in values.iter_mut().take(3).enumerate() {
                plane.par_iter_mut().zip(&rgb).for_each(|(v, rgb)| *v = rgb[c]);
            }
            weights[1] = COLOUR;
            weights[2] = COLOUR;
        } else if count > 1 {
            // Channels of any units: each counts by its range.
            for (plane, weight) in values.iter().zip(&mut weights) {
                let (low, high) = range(plane);
                let span = high - low;
                *weight = if span > 0.0 && span.is_finite() { 1.0 / (span * span) } else { 0.0 };
            }
        }
        Planes { values, weights, colours, holes: if any { holes } else { Vec::new() } }
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

/// Fills holes with the mean of the smallest node around them that has samples.
fn filled(samples: &Samples, plane: &mut [f32], holes: &[bool]) {
    let shapes = shapes(samples.dimensions, samples.shape);
    // Sum and number of what there is.
    let mut levels: Vec<Vec<(f64, f64)>> =
        vec![plane.iter().zip(holes).map(|(&v, &hole)| if hole { (0.0, 0.0) } else { (f64::from(v), 1.0) }).collect()];
    for level in 1..shapes.len() {
        let below = &levels[level - 1];
        let sums = for_each_place(shapes[level], |at| {
            children(samples.dimensions, shapes[level - 1], at)
                .fold((0.0, 0.0), |(sum, number), child| (sum + below[child].0, number + below[child].1))
        });
        levels.push(sums);
    }
    let by: Shape = super::grid::factors(samples.dimensions);
    plane.par_iter_mut().enumerate().filter(|(i, _)| holes[*i]).for_each(|(i, v)| {
        let mut at = super::grid::place(samples.shape, i);
        *v = 0.0;
        for level in 1..shapes.len() {
            at = std::array::from_fn(|k| at[k] / by[k]);
            let (sum, number) = levels[level][super::grid::index(shapes[level], at)];
            if number > 0.0 {
                *v = (sum / number) as f32;
                break;
            }
        }
    });
}
