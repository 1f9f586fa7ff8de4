//! Sal and Str: how far heights stay alike, and whether in all directions.
//!
//! The correlation at a lag is the mean of the products of heights (about their mean) over the pairs of measured samples that are so far
//! apart, divided by that of lag 0. One transform of `heights + i measured` gives the products and the number of pairs at once.

use super::bands::band_rows;
use super::fourier::{Complex, Transform};
use crate::model::{HeightError, Heights, Window};
use rayon::prelude::*;

/// Fields of more columns or rows are not looked at.
pub const LARGEST: u64 = 4096;

/// The correlation down to which lags are measured (`s` of ISO 25178-3).
const FALL: f64 = 0.2;

/// Directions in which is looked, over half a turn.
const DIRECTIONS: usize = 720;

/// Heights' correlation at lags of up to half of the field.
pub struct Correlation {
    /// Lags along columns go from minus this to this.
    columns: usize,
    /// Lags along rows go from 0 to this.
    rows: usize,
    values: Vec<f32>,
}

/// The shortest lag of the fall, and its relation to the longest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// The shortest lag, in any direction, at which the correlation falls to 0.2; in the unit of x and y.
    pub sal: f64,
    /// That lag divided by the longest; where the correlation does not fall so far within half of the field, the longest lag is that half's.
    pub str: f64,
}

/// The correlation of heights about `mean`, in parts of `unit`; `None` for fields of more than [`LARGEST`] columns or rows.
///
/// # Errors
/// Where the field cannot be read.
pub fn correlation(heights: &dyn Heights, mean: f64, unit: f64) -> Result<Option<Correlation>, HeightError> {
    let grid = heights.grid();
    if grid.columns.max(grid.rows) > LARGEST {
        return Ok(None);
    }
    let (columns, rows) = (grid.columns as usize, grid.rows as usize);
    let (far_columns, far_rows) = (columns / 2, rows / 2);
    // Half as much again keeps what is carried around at the ends away from the lags that are wanted.
    let width = (columns + far_columns + 1).next_power_of_two();
    let height = (rows + far_rows + 1).next_power_of_two();
    let (along, down) = (Transform::new(width), Transform::new(height));
    let mut spectrum = vec![[0.0_f32; 2]; width * rows];
    let together = band_rows(grid.columns) as usize;
    spectrum.par_chunks_mut(width * together).enumerate().try_for_each_init(
        || (Vec::new(), vec![[0.0; 2]; width]),
        |(values, line), (band, out)| {
            let (first, count) = ((band * together) as u64, out.len() / width);
            values.resize(count * columns, 0.0);
            heights.heights(Window::rows(grid, first, count as u64), values)?;
            for (values, out) in values.chunks_exact(columns).zip(out.chunks_exact_mut(width)) {
                line.fill([0.0; 2]);
                for (to, height) in line.iter_mut().zip(values).filter(|(_, height)| !height.is_nan()) {
                    *to = [(height - mean) / unit, 1.0];
                }
                along.apply(line, false);
                out.iter_mut().zip(&*line).for_each(|(to, from)| *to = from.map(|part| part as f32));
            }
            Ok::<(), HeightError>(())
        },
    )?;
    // Columns k and -k belong together: heights and what is measured come apart there.
    let lags = far_rows + 1;
    let mut products = vec![[0.0_f32; 2]; (width / 2 + 1) * 2 * lags];
    products.par_chunks_mut(2 * lags).enumerate().for_each_init(
        || (vec![[0.0; 2]; height], vec![[0.0; 2]; height]),
        |(one, other), (number, out)| {
            let mirrored = (width - number) % width;
            for (line, column) in [(&mut *one, number), (&mut *other, mirrored)] {
                line.fill([0.0; 2]);
                for (row, to) in line.iter_mut().take(rows).enumerate() {
                    *to = spectrum[row * width + column].map(f64::from);
                }
                down.apply(line, false);
            }
            apart(one, other);
            for (line, out) in [&mut *one, &mut *other].into_iter().zip(out.chunks_exact_mut(lags)) {
                down.apply(line, true);
                out.iter_mut().zip(&*line).for_each(|(to, from)| *to = from.map(|part| part as f32));
            }
        },
    );
    drop(spectrum);
    let across = 2 * far_columns + 1;
    let mut values = vec![0.0_f32; across * lags];
    let cells = (width * height) as f64;
    let mean_of = |sums: Complex| if sums[1] / cells < 0.5 { 0.0 } else { sums[0] / sums[1] };
    let first = |line: &mut Vec<Complex>, row: usize| {
        for number in 0..=width / 2 {
            let pair = &products[number * 2 * lags..];
            line[number] = pair[row].map(f64::from);
            line[(width - number) % width] = pair[lags + row].map(f64::from);
        }
        along.apply(line, true);
    };
    let mut line = vec![[0.0; 2]; width];
    first(&mut line, 0);
    let variance = mean_of(line[0]);
    values.par_chunks_mut(across).enumerate().for_each_init(
        || vec![[0.0; 2]; width],
        |line, (row, out)| {
            first(line, row);
            for (number, to) in out.iter_mut().enumerate() {
                *to = (mean_of(line[(number + width - far_columns) % width]) / variance) as f32;
            }
        },
    );
    Ok(Some(Correlation { columns: far_columns, rows: far_rows, values }))
}

/// Of two columns of the spectrum of `z + i m`, at k and -k, makes `|Z|^2 + i |M|^2` of both.
fn apart(one: &mut [Complex], other: &mut [Complex]) {
    let size = one.len();
    for (row, here) in one.iter_mut().enumerate() {
        let opposite = &mut other[(size - row) % size];
        let power = powers(*here, *opposite);
        (*here, *opposite) = (power, power);
    }
}

/// The powers of both parts where the spectrum has `f` and, at the opposite place, `g`.
fn powers(f: Complex, g: Complex) -> Complex {
    let z = [0.5 * (f[0] + g[0]), 0.5 * (f[1] - g[1])];
    let m = [0.5 * (f[1] + g[1]), 0.5 * (g[0] - f[0])];
    [z[0] * z[0] + z[1] * z[1], m[0] * m[0] + m[1] * m[1]]
}

impl Correlation {
    /// The correlation at a lag in columns and rows, between those of whole numbers; `None` beyond half of the field.
    pub fn at(&self, columns: f64, rows: f64) -> Option<f64> {
        // The same at both ends of a lag.
        let (columns, rows) = if rows < 0.0 { (-columns, -rows) } else { (columns, rows) };
        let column = columns + self.columns as f64;
        let (left, top) = (column.floor(), rows.floor());
        if left < 0.0 || column > 2.0 * self.columns as f64 || rows > self.rows as f64 {
            return None;
        }
        let across = 2 * self.columns + 1;
        let value = |down: usize, right: usize| {
            let (row, column) = ((top as usize + down).min(self.rows), (left as usize + right).min(across - 1));
            f64::from(self.values[row * across + column])
        };
        let (u, v) = (column - left, rows - top);
        let upper = value(0, 0) + u * (value(0, 1) - value(0, 0));
        let lower = value(1, 0) + u * (value(1, 1) - value(1, 0));
        Some(upper + v * (lower - upper))
    }

    /// Sal and Str, for steps from sample to sample; `None` where the correlation falls in no direction.
    pub fn texture(&self, step: [f64; 2]) -> Option<Texture> {
        let step = step.map(f64::abs);
        let reach = step[0].min(step[1]) * 0.5;
        let falls = (0..DIRECTIONS).map(|direction| {
            let (sin, cos) = libm::sincos(std::f64::consts::PI * direction as f64 / DIRECTIONS as f64);
            let (mut before, mut lag) = (1.0, 0.0);
            loop {
                let next = lag + reach;
                let Some(here) = self.at(next * cos / step[0], next * sin / step[1]) else { return (lag, false) };
                if here <= FALL {
                    return (lag + reach * (before - FALL) / (before - here), true);
                }
                (before, lag) = (here, next);
            }
        });
        let (mut shortest, mut longest, mut is_found) = (f64::INFINITY, 0.0_f64, false);
        for (lag, falls) in falls {
            if falls {
                (shortest, is_found) = (shortest.min(lag), true);
            }
            longest = longest.max(lag);
        }
        // Beyond half of the field in one direction may be nearer than a fall in another.
        is_found.then(|| Texture { sal: shortest, str: (shortest / longest).min(1.0) })
    }
}
