//! Gaussian S- and L-filters of surfaces (ISO 16610-61): a mean weighted by `exp(-pi (r / (alpha cut-off))^2)` over measured samples.

use super::fourier::Transform;
use crate::model::{HeightError, HeightGrid, Heights, Lengths, Window};
use deepfield_data::model::{SampleType, Scale};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::{LN_2, PI};

/// What a filter keeps. At the cut-off half of a wave's height passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// The S-filter keeps waves longer than the cut-off.
    Short(f64),
    /// The L-filter keeps waves shorter than the cut-off.
    Long(f64),
}

impl Filter {
    /// The cut-off wavelength, in the unit of x and y; of places in degrees in metres.
    pub fn cutoff(self) -> f64 {
        let (Filter::Short(cutoff) | Filter::Long(cutoff)) = self;
        cutoff
    }
}

/// Filtered windows of up to so many samples are kept in memory: 256 MiB. Larger ones are filtered anew whenever they are read.
const KEPT: u64 = 1 << 25;

/// Weights of more samples to either side are applied by Fourier transforms.
const DIRECT: usize = 48;

/// Rows that are read at once are about so many samples.
const AT_ONCE: u64 = 1 << 18;

/// A window of a field, filtered; what was not measured stays so. Samples beside the window count where they are near, of a field that goes round
/// a globe also those beyond its first and its last column.
pub struct Filtered<'a> {
    heights: &'a dyn Heights,
    filter: Filter,
    window: Window,
    grid: HeightGrid,
    /// Weights of samples 0, 1, 2, ... above and below.
    down: Vec<f64>,
    /// The same to either side, of rows that are as wide as these; only on a sphere there are several.
    across: BTreeMap<i32, Vec<f64>>,
    lengths: Lengths,
    /// Of a field that goes round a globe: after so many columns the first one comes again.
    around: Option<u64>,
    kept: Option<Vec<f64>>,
}

impl<'a> Filtered<'a> {
    /// Filters a window, of at least 2 x 2 samples. A cut-off that is not above 0 keeps, or takes away, everything. Degrees are the Earth's.
    ///
    /// # Errors
    /// Where the field cannot be read.
    pub fn new(heights: &'a dyn Heights, filter: Filter, window: Window) -> Result<Filtered<'a>, HeightError> {
        let lengths = Lengths::of(heights.grid());
        Filtered::on(heights, lengths, filter, window)
    }

    /// The same where the grid has these lengths, in which the cut-off is.
    ///
    /// # Errors
    /// As [`Filtered::new`].
    pub fn on(
        heights: &'a dyn Heights,
        lengths: Lengths,
        filter: Filter,
        window: Window,
    ) -> Result<Filtered<'a>, HeightError> {
        let whole = heights.grid();
        let origin = whole.place(window.row as f64, window.column as f64);
        let (rows, columns) = (window.rows, window.columns);
        let grid =
            HeightGrid { rows, columns, origin, sample_type: SampleType::F64, scale: Scale::NONE, ..whole.clone() };
        let cutoff = filter.cutoff();
        let down = weights(cutoff / lengths.steps(0.0)[1].abs(), whole.rows);
        let widest = lengths.steps(middle(whole))[0].abs();
        let around = whole.around();
        let mut across = BTreeMap::new();
        for row in 0..whole.rows {
            let width = class(&lengths, whole, row);
            across.entry(width).or_insert_with(|| {
                let cutoff = cutoff / (widest * share(width));
                around
                    .map_or_else(|| weights(cutoff, whole.columns), |columns| weights_around(cutoff, columns as usize))
            });
        }
        let mut filtered = Filtered { heights, filter, window, grid, down, across, lengths, around, kept: None };
        if window.samples() <= KEPT {
            let mut kept = vec![0.0; window.samples() as usize];
            // Enough rows at once that those read beside them count little.
            let together = (4 * filtered.down.len()).max(64);
            for (number, part) in kept.chunks_mut(together * columns as usize).enumerate() {
                let row = (number * together) as u64;
                filtered.compute(Window { row, column: 0, rows: part.len() as u64 / columns, columns }, part)?;
            }
            filtered.kept = Some(kept);
        }
        Ok(filtered)
    }

    /// Filters a part of the window.
    fn compute(&self, part: Window, out: &mut [f64]) -> Result<(), HeightError> {
        let whole = self.heights.grid();
        let (row, column) = (self.window.row + part.row, self.window.column + part.column);
        let near = |first: u64, count: u64, reach: usize, all: u64| {
            let from = first.saturating_sub(reach as u64 - 1);
            (from, (first + count + reach as u64 - 1).min(all) - from)
        };
        let (first, rows) = near(row, part.rows, self.down.len(), whole.rows);
        let widths: Vec<i32> = (first..first + rows).map(|row| class(&self.lengths, whole, row)).collect();
        let weights = |width: &i32| self.across.get(width).map_or(&[][..], Vec::as_slice);
        let reach = widths.iter().map(|width| weights(width).len()).max().unwrap_or(1);
        // Columns around a globe are counted on beyond its seam.
        let (before, columns) = match self.around {
            None => {
                let (left, columns) = near(column, part.columns, reach, whole.columns);
                (column - left, columns)
            }
            Some(_) => (reach as u64 - 1, part.columns + 2 * (reach as u64 - 1)),
        };
        let mut lines = BTreeMap::new();
        for width in &widths {
            let new = || Lines::new(weights(width), columns as usize, before as usize, part.columns as usize);
            lines.entry(*width).or_insert_with(new);
        }
        let room = lines.values().map(|lines| lines.size).max().unwrap_or(0);
        let (width, wide) = (part.columns as usize, columns as usize);
        // Of every sample the weighted heights and the weights, summed up.
        let mut sums = vec![[0.0; 2]; out.len()];
        let together = (AT_ONCE / columns).max(1);
        let (mut values, mut across) = (Vec::new(), Vec::new());
        let mut at = first;
        while at < first + rows {
            let count = together.min(first + rows - at);
            values.resize((count * columns) as usize, 0.0);
            self.read([at, count], [column, before], &mut values)?;
            across.resize(count as usize * width, [0.0; 2]);
            let own = &widths[(at - first) as usize..];
            across.par_chunks_mut(width).zip(values.par_chunks(wide)).zip(own.par_iter()).for_each_init(
                || vec![[0.0; 2]; room],
                |scratch, ((across, values), width)| {
                    let Some(lines) = lines.get(width) else { return };
                    lines.apply(values, across, &mut scratch[..lines.size]);
                    // Samples of a narrow row stand for less.
                    let area = share(*width);
                    if area != 1.0 {
                        across.iter_mut().for_each(|sum| *sum = sum.map(|part| area * part));
                    }
                },
            );
            sums.par_chunks_mut(width).enumerate().for_each(|(number, sums)| {
                let here = row + number as u64;
                for (other, across) in across.chunks_exact(width).enumerate() {
                    let apart = (at + other as u64).abs_diff(here) as usize;
                    if let Some(weight) = self.down.get(apart) {
                        for (sum, across) in sums.iter_mut().zip(across) {
                            *sum = [sum[0] + weight * across[0], sum[1] + weight * across[1]];
                        }
                    }
                }
            });
            at += count;
        }
        self.heights.heights(Window { row, column, rows: part.rows, columns: part.columns }, out)?;
        for (height, sum) in out.iter_mut().zip(&sums).filter(|(height, _)| !height.is_nan()) {
            let mean = sum[0] / sum[1];
            *height = if matches!(self.filter, Filter::Short(_)) { mean } else { *height - mean };
        }
        Ok(())
    }

    /// Heights of some rows, from so many columns before one on.
    fn read(&self, [row, rows]: [u64; 2], [column, before]: [u64; 2], values: &mut [f64]) -> Result<(), HeightError> {
        let columns = values.len() as u64 / rows;
        let Some(all) = self.around else {
            return self.heights.heights(Window { row, column: column - before, rows, columns }, values);
        };
        let (mut done, mut piece) = (0, Vec::new());
        while done < columns {
            let column = (column + done + before.div_ceil(all) * all - before) % all;
            let count = (all - column).min(columns - done);
            piece.resize((rows * count) as usize, 0.0);
            self.heights.heights(Window { row, column, rows, columns: count }, &mut piece)?;
            let own = done as usize..(done + count) as usize;
            for (to, from) in values.chunks_exact_mut(columns as usize).zip(piece.chunks_exact(count as usize)) {
                to[own.clone()].copy_from_slice(from);
            }
            done += count;
        }
        Ok(())
    }
}

/// Rows of a sphere whose widths differ by less than this share have the same weights.
const ALIKE: f64 = 0.01;

/// A row's width among those of a grid: 0 of the middle row, and of all rows where places are no degrees.
fn class(lengths: &Lengths, grid: &HeightGrid, row: u64) -> i32 {
    let [own, middle] = [row as f64, middle(grid)].map(|row| lengths.steps(row)[0].abs());
    (libm::log(own / middle) / ALIKE).round() as i32
}

/// How wide rows are to the middle one.
fn share(width: i32) -> f64 {
    libm::exp(ALIKE * f64::from(width))
}

fn middle(grid: &HeightGrid) -> f64 {
    0.5 * (grid.rows - 1) as f64
}

/// Weights of samples 0, 1, 2, ... away up to the cut-off, in samples; beyond it they are below a millionth.
fn weights(cutoff: f64, count: u64) -> Vec<f64> {
    let reach = if cutoff > 0.0 { cutoff.min(count as f64) as usize } else { 0 };
    let alpha = (LN_2 / PI).sqrt();
    (0..=reach)
        .map(|apart| if apart == 0 { 1.0 } else { libm::exp(-PI * (apart as f64 / (alpha * cutoff)).powi(2)) })
        .collect()
}

/// Cut-offs of more rounds than this see all of a row alike, to the last digits.
const ROUNDS: f64 = 6.0;

/// The same of a row that closes after so many samples, each of which counts as often as it is met on the way round and round. Samples are those
/// up to half a row away to either side: the one on the other side of an even number is met on both ways and has half its weight on each.
fn weights_around(cutoff: f64, samples: usize) -> Vec<f64> {
    let half = samples / 2;
    let mut around = if cutoff > ROUNDS * samples as f64 {
        vec![1.0; half + 1]
    } else {
        let line = weights(cutoff, u64::MAX);
        let mut around = vec![0.0; (line.len() - 1).min(half) + 1];
        for (apart, weight) in line.iter().enumerate() {
            let (one, other) = (apart % samples, (samples - apart % samples) % samples);
            let ways = if apart == 0 { &[one][..] } else { &[one, other] };
            for way in ways {
                if let Some(sum) = around.get_mut(*way) {
                    *sum += weight;
                }
            }
        }
        around
    };
    if samples.is_multiple_of(2)
        && let Some(opposite) = around.get_mut(half)
    {
        *opposite *= 0.5;
    }
    around
}

/// Weighted sums along rows.
struct Lines<'a> {
    weights: &'a [f64],
    /// The first column that is wanted, and how many.
    first: usize,
    count: usize,
    /// The transform and the weights' own, which is real.
    fast: Option<(Transform, Vec<f64>)>,
    size: usize,
}

impl<'a> Lines<'a> {
    fn new(weights: &'a [f64], columns: usize, first: usize, count: usize) -> Lines<'a> {
        if weights.len() <= DIRECT {
            return Lines { weights, first, count, fast: None, size: 0 };
        }
        let size = (columns + weights.len()).next_power_of_two();
        let transform = Transform::new(size);
        let mut line = vec![[0.0; 2]; size];
        for (apart, weight) in weights.iter().enumerate().take(size / 2) {
            line[apart][0] = *weight;
            line[(size - apart) % size][0] = *weight;
        }
        transform.apply(&mut line, false);
        let own = line.iter().map(|[re, _]| re / size as f64).collect();
        Lines { weights, first, count, fast: Some((transform, own)), size }
    }

    fn apply(&self, values: &[f64], out: &mut [[f64; 2]], scratch: &mut [[f64; 2]]) {
        let Some((transform, own)) = &self.fast else {
            for (number, sum) in out.iter_mut().enumerate() {
                let middle = self.first + number;
                let from = middle.saturating_sub(self.weights.len() - 1);
                let near = values.iter().enumerate().skip(from).take(middle + self.weights.len() - from);
                *sum = [0.0; 2];
                for (column, height) in near.filter(|(_, height)| !height.is_nan()) {
                    let weight = self.weights[column.abs_diff(middle)];
                    *sum = [sum[0] + weight * height, sum[1] + weight];
                }
            }
            return;
        };
        // About a height of the row, so that an offset takes no digits; one transform is of heights and of what is measured.
        let about = values.iter().copied().find(|height| !height.is_nan()).unwrap_or(0.0);
        scratch.fill([0.0; 2]);
        for (to, height) in scratch.iter_mut().zip(values).filter(|(_, height)| !height.is_nan()) {
            *to = [height - about, 1.0];
        }
        transform.apply(scratch, false);
        scratch.iter_mut().zip(own).for_each(|(value, own)| *value = value.map(|part| part * own));
        transform.apply(scratch, true);
        for (to, from) in out.iter_mut().zip(&scratch[self.first..self.first + self.count]) {
            *to = [from[0] + about * from[1], from[1]];
        }
    }
}

impl Heights for Filtered<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        let Some(kept) = &self.kept else { return self.compute(window, out) };
        let (all, width) = (self.window.columns as usize, window.columns as usize);
        for (number, row) in out.chunks_exact_mut(width).enumerate() {
            let first = (window.row as usize + number) * all + window.column as usize;
            row.copy_from_slice(&kept[first..first + width]);
        }
        Ok(())
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        let (row, column) = (self.window.row + window.row, self.window.column + window.column);
        self.heights.plane(plane, Window { row, column, ..window }, out)
    }
}
