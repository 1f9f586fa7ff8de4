//! A synthetic surface as a field whose windows are made when they are read.

use super::fbm::{Fbm, Scratch};
use super::holes::Holes;
use super::noise::Noise;
use super::shape::SurfaceShape;
use crate::export::ExportError;
use crate::model::{HeightError, HeightGrid, Heights, Window};
use deepfield_data::model::{SampleType, Unit};
use rayon::prelude::*;
use std::path::Path;

/// What is made.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// The shape.
    pub shape: SurfaceShape,
    /// Samples of a row; at least 2.
    pub columns: u64,
    /// Rows; at least 2.
    pub rows: u64,
    /// From a column and a row to the next. Formats that state no distances leave it out.
    pub spacing: [f64; 2],
    /// Unit of places and heights; empty for none.
    pub unit: Unit,
    /// How a sample is stored. Heights that whole numbers cannot hold are scaled down.
    pub sample_type: SampleType,
    /// The same seed gives the same bytes.
    pub seed: u64,
    /// The share of samples that were not measured, at random, from 0 to 1.
    pub invalid: f64,
    /// Standard deviation of noise that is added to each sample.
    pub noise: f64,
    /// The Hurst exponent of [`SurfaceShape::Fbm`] and [`SurfaceShape::Holes`], above 0 and below 1.
    pub hurst: f64,
}

impl SurfaceOptions {
    /// A shape of so many samples, of `f32` and 1 apart, all measured, with a Hurst exponent of 0.8.
    pub fn new(shape: SurfaceShape, columns: u64, rows: u64) -> SurfaceOptions {
        SurfaceOptions {
            shape,
            columns,
            rows,
            spacing: [1.0; 2],
            unit: Unit::default(),
            sample_type: SampleType::F32,
            seed: 0,
            invalid: 0.0,
            noise: 0.0,
            hurst: 0.8,
        }
    }
}

/// Columns and rows of a part that one thread makes at a time: what it needs stays in its cache.
const PART: [usize; 2] = [512, 64];

/// The most samples of a side.
const MOST_SIDE: u64 = 1 << 40;

/// The wavelength of [`SurfaceShape::Sines`], samples.
const WAVE: usize = 256;

/// Its amplitude.
const AMPLITUDE: f64 = 20.0;

/// How heights depend on places.
#[derive(Clone, Debug)]
enum Relief {
    /// Heights of a wave along one axis, over one wavelength; those of both axes are multiplied.
    Sines { along: Box<[f64; WAVE]> },
    /// A cap's middle, the square of its sphere's radius, and the depth of the sphere's middle below 0.
    Cap { middle: [f64; 2], square: f64, below: f64 },
    /// 0 before a column, and this height from there on.
    Step { column: i64, height: f64 },
    /// Slopes along columns and rows.
    Plane { slope: [f64; 2] },
    /// Fractional Brownian motion.
    Fbm(Fbm),
}

/// A surface that was made up.
#[derive(Clone, Debug)]
pub struct SyntheticSurface {
    grid: HeightGrid,
    relief: Relief,
    holes: Holes,
    /// Deviation of the noise of samples.
    noise: Option<(f64, Noise)>,
    /// From heights to what is stored: factor and summand.
    fit: [f64; 2],
    /// Least and largest stored value.
    limits: [f64; 2],
}

impl SyntheticSurface {
    /// The surface that the options describe; `output` is named in messages.
    ///
    /// # Errors
    /// [`ExportError::Refused`] where they cannot be.
    pub fn new(options: &SurfaceOptions, output: &Path) -> Result<SyntheticSurface, ExportError> {
        let refused =
            |field: &str, found: String, expected: &str| Err(ExportError::refused(output, field, found, expected));
        let SurfaceOptions { columns, rows, invalid, noise, hurst, spacing, seed, sample_type, .. } = *options;
        let fits =
            columns.checked_mul(rows).and_then(|samples| samples.checked_mul(8)).is_some_and(|bytes| bytes >> 62 == 0);
        if columns < 2 || rows < 2 || columns > MOST_SIDE || rows > MOST_SIDE || !fits {
            return refused("size", format!("{columns} x {rows}"), "at least 2 x 2 samples, and fewer than 2^59");
        }
        if !(0.0..1.0).contains(&invalid) {
            return refused("invalid", invalid.to_string(), "a share from 0 to below 1");
        }
        if !(noise >= 0.0 && noise.is_finite()) {
            return refused("noise", noise.to_string(), "a number from 0 on");
        }
        if !(0.01..=0.99).contains(&hurst) {
            return refused("hurst", hurst.to_string(), "a number from 0.01 to 0.99");
        }
        if !spacing.iter().all(|step| step.is_finite() && *step > 0.0) {
            return refused("spacing", format!("{},{}", spacing[0], spacing[1]), "two numbers above 0");
        }
        let mut grid = HeightGrid::new(columns, rows, sample_type);
        (grid.step, grid.xy_unit, grid.height_unit) = (spacing, options.unit.clone(), options.unit.clone());
        let (relief, [low, high]) = relief(options);
        let holes = Holes::new(seed, invalid, options.shape == SurfaceShape::Holes);
        let limits = limits(sample_type);
        let is_unsigned = limits[0] == 0.0;
        // The least value of whole numbers stands for what was not measured.
        let lowest = if sample_type.is_float() || holes.is_none() { limits[0] } else { limits[0] + 1.0 };
        // Half of the range for heights of both signs, nine tenths of it at most.
        let summand = if is_unsigned && low < 0.0 { (limits[1] + 1.0) / 2.0 } else { 0.0 };
        let room = 0.9 * if summand > 0.0 { summand } else { limits[1] };
        let factor = (room / high.max(-low).max(f64::MIN_POSITIVE)).min(1.0);
        Ok(SyntheticSurface {
            grid,
            relief,
            holes,
            noise: (noise > 0.0).then(|| (noise, Noise::new(seed, 0x1000))),
            fit: [factor, summand],
            limits: [lowest, limits[1]],
        })
    }

    /// Whether some samples are not measured.
    pub fn has_holes(&self) -> bool {
        !self.holes.is_none()
    }

    /// The least value of the stored type, which stands for samples that were not measured where these are whole
    /// numbers.
    pub fn least(&self) -> f64 {
        match self.grid.sample_type {
            SampleType::I64 => i64::MIN as f64,
            other => limits(other)[0],
        }
    }

    /// Makes a part of a window.
    fn part(
        &self,
        [row, column]: [i64; 2],
        [rows, columns]: [usize; 2],
        out: &mut [f64],
        stride: usize,
        scratch: &mut Scratch,
    ) {
        if let Relief::Fbm(fbm) = &self.relief {
            fbm.window([row, column], [rows, columns], out, stride, scratch);
        }
        for (row, line) in (row..).zip(out.chunks_mut(stride).take(rows)) {
            let line = &mut line[..columns];
            let places = (column..).map(|column| column as f64);
            match &self.relief {
                Relief::Sines { along } => {
                    let here = AMPLITUDE * along[row as usize % WAVE];
                    for (height, column) in line.iter_mut().zip(column as usize..) {
                        *height = here * along[column % WAVE];
                    }
                }
                Relief::Cap { middle, square, below } => {
                    let y = row as f64 - middle[1];
                    for (height, x) in line.iter_mut().zip(places) {
                        let x = x - middle[0];
                        *height = ((square - (x * x + y * y)).max(0.0).sqrt() - below).max(0.0);
                    }
                }
                Relief::Step { column: at, height: top } => {
                    for (height, column) in line.iter_mut().zip(column..) {
                        *height = if column < *at { 0.0 } else { *top };
                    }
                }
                Relief::Plane { slope } => {
                    for (height, x) in line.iter_mut().zip(places) {
                        *height = slope[0] * x + slope[1] * row as f64;
                    }
                }
                Relief::Fbm(_) => {}
            }
            if let Some((deviation, noise)) = &self.noise {
                let noise = noise.row(row);
                for (height, column) in line.iter_mut().zip(column..) {
                    *height += deviation * noise.normal(column);
                }
            }
            self.store(line);
            self.holes.open(row, column, line);
        }
    }

    /// From heights to what is stored.
    fn store(&self, line: &mut [f64]) {
        let ([factor, summand], [low, high]) = (self.fit, self.limits);
        match self.grid.sample_type {
            SampleType::F64 => {}
            SampleType::F32 => line.iter_mut().for_each(|height| *height = f64::from(*height as f32)),
            _ => line
                .iter_mut()
                .for_each(|height| *height = (*height * factor + summand).round_ties_even().clamp(low, high)),
        }
    }
}

impl Heights for SyntheticSurface {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        let width = window.columns as usize;
        out.par_chunks_mut((width * PART[1]).max(1)).enumerate().for_each_init(
            Scratch::default,
            |scratch, (number, out)| {
                let row = (window.row as usize + number * PART[1]) as i64;
                let rows = out.len() / width.max(1);
                for first in (0..width).step_by(PART[0]) {
                    let columns = PART[0].min(width - first);
                    let column = window.column as i64 + first as i64;
                    self.part([row, column], [rows, columns], &mut out[first..], width, scratch);
                }
            },
        );
        Ok(())
    }

    fn plane(&self, _plane: usize, _window: Window, _out: &mut [u8]) -> Result<(), HeightError> {
        Ok(())
    }
}

/// A shape's heights, and the least and the largest that are to be expected.
fn relief(options: &SurfaceOptions) -> (Relief, [f64; 2]) {
    let SurfaceOptions { shape, columns, rows, seed, hurst, sample_type, .. } = *options;
    let (width, height) = ((columns - 1) as f64, (rows - 1) as f64);
    match shape {
        SurfaceShape::SphereCap => {
            let base = 0.45 * width.min(height);
            let top = 0.4 * base;
            let radius = (base * base + top * top) / (2.0 * top);
            let middle = [width / 2.0, height / 2.0];
            (Relief::Cap { middle, square: radius * radius, below: radius - top }, [0.0, top])
        }
        SurfaceShape::Sines => {
            let wave = 2.0 * std::f64::consts::PI / WAVE as f64;
            let along = Box::new(std::array::from_fn(|place| libm::sin(wave * place as f64)));
            (Relief::Sines { along }, [-AMPLITUDE, AMPLITUDE])
        }
        SurfaceShape::Step => (Relief::Step { column: columns.div_ceil(2) as i64, height: 1000.0 }, [0.0, 1000.0]),
        SurfaceShape::Plane => {
            let slope = [0.1, 0.2];
            (Relief::Plane { slope }, [0.0, slope[0] * width + slope[1] * height])
        }
        SurfaceShape::Fbm | SurfaceShape::Holes => {
            let reach = columns.max(rows);
            // A sixth of the side from bottom to top; whole numbers use the better part of their range.
            let span =
                if sample_type.is_float() { reach as f64 / 6.0 } else { (0.7 * limits(sample_type)[1]).min(1e7) };
            let of_type = if limits(sample_type)[0] < 0.0 && !sample_type.is_float() { 2.0 * span } else { span };
            (Relief::Fbm(Fbm::new(seed, hurst, reach / 2, of_type / 8.5)), [-of_type / 2.0, of_type / 2.0])
        }
    }
}

/// The least and the largest value of a type; of 64 bits what floats hold exactly.
fn limits(sample_type: SampleType) -> [f64; 2] {
    const EXACT: f64 = 9_007_199_254_740_992.0;
    match sample_type {
        SampleType::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
        SampleType::U8 => [0.0, f64::from(u8::MAX)],
        SampleType::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
        SampleType::U16 => [0.0, f64::from(u16::MAX)],
        SampleType::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
        SampleType::U32 => [0.0, f64::from(u32::MAX)],
        SampleType::I64 => [-EXACT, EXACT],
        SampleType::U64 => [0.0, EXACT],
        SampleType::F32 | SampleType::F64 => [f64::NEG_INFINITY, f64::INFINITY],
    }
}
