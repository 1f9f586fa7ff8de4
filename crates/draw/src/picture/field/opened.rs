//! An image or a volume, open: its samples, and the points that stand for them.

use super::report::{ErrorValue, PointsReport};
use crate::cpu::field::{Field, FieldPoints, gradient};
use crate::cpu::volume::Variability;
use crate::hierarchy::wavelet::{Cut, Drawn, Hierarchy, Ranges, Samples, Weighting, errors};
use crate::import::{GridOptions, GridSource, open_grid};
use crate::look::DataKind;
use crate::mode::ValueStatistics;
use crate::model::{Channel, Grid, ReadMethod, Region, SampleType, Scale, Unit};
use crate::picture::PictureError;
use crate::store::GridFile;
use crate::store::grid::{beyond_single, planes_of};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Bytes that a sample takes: as it is stored, as a value, and in the means of boxes.
const BYTES: f64 = 9.2;
/// Bytes that are read at a time where not all samples are taken.
const BAND: u64 = 64 << 20;
/// Slices that are read together of files in bricks.
const BRICK: u64 = 32;

/// Where samples come from.
enum Data {
    /// A file with points.
    File(GridFile),
    /// A file of samples alone.
    Source(GridSource),
}

/// An image or a volume, open. Its samples are in memory: all of them, or as many as there is room for.
pub struct OpenField {
    path: PathBuf,
    data: Data,
    /// What is drawn: all of its samples, or every so many-th along each axis.
    grid: Grid,
    every: u64,
    /// Stored samples, a plane a channel.
    stored: Vec<Vec<f32>>,
    points: OnceLock<Points>,
    /// What the values of the first channel are.
    statistics: ValueStatistics,
}

/// The points that stand for the samples, as they are in the file.
struct Points {
    hierarchy: Hierarchy,
    /// Prices at which its cuts change.
    curve: Vec<(f32, usize)>,
}

/// Which points are wanted of a field.
#[derive(Clone, Debug, PartialEq)]
pub enum Wanted {
    /// The best so many points, and what they keep small.
    Points(usize, Weighting),
    /// As few points as leave values, or else what a transfer function shows of them, nearly as they are.
    Near {
        /// How far a value may be off; as said of [`crate::modes::samples::ERROR_VALUE`] where nothing is.
        error: Option<f64>,
        /// What a transfer function tells apart, and how much of it may be lost, of 255.
        seen: Option<(Variability, f32)>,
    },
}

/// What is drawn, and how near it is.
pub struct Shown {
    /// The values.
    pub field: Arc<Field>,
    /// The points that show them, where these are wanted.
    pub points: Option<Arc<FieldPoints>>,
    /// How they came about.
    pub report: PointsReport,
    /// How long reading the points, choosing some of them, and drawing these to a grid took.
    pub times: [Duration; 3],
}

impl OpenField {
    /// Opens a file of an image or a volume, built or not, and reads its samples: all of them, or every second, third, ... along each axis where
    /// pictures of all would take more than so many bytes of `memory`.
    ///
    /// # Errors
    /// When it cannot be read, or is too large for this machine.
    pub fn open(path: &Path, read: ReadMethod, memory: Option<u64>) -> Result<OpenField, PictureError> {
        let kind = DataKind::of(path).map_err(|error| PictureError::Asked(error.to_string()))?;
        let data = match kind {
            DataKind::Grid => Data::File(GridFile::open(path, read)?),
            _ => Data::Source(open_grid(path, &GridOptions { read, ..GridOptions::default() })?),
        };
        let every = memory.map_or(1, |memory| thinning(data.grid(), memory));
        let grid = data.grid().thinned(every);
        let too_large = || PictureError::of(path, format!("{}: too large for this machine", data.grid().described()));
        let stored = match every {
            1 => data.samples(too_large)?,
            _ => data.thinned_samples(every, too_large)?,
        };
        let statistics = ValueStatistics::default();
        let mut open = OpenField { path: path.into(), data, grid, every, stored, points: OnceLock::new(), statistics };
        open.statistics = open.statistics_of(0);
        Ok(open)
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The grid that is drawn.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Samples in the file.
    pub fn samples(&self) -> u64 {
        self.data.grid().shape.iter().fold(1, |samples, &side| samples.saturating_mul(side))
    }

    /// What pictures do not show, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        [self.left_out(), beyond_single(self.grid.sample_type, &self.stored)].into_iter().flatten().collect()
    }

    /// What is left out for want of memory, in a sentence.
    fn left_out(&self) -> Option<String> {
        let whole = self.data.grid().described();
        let why = "since all of them would take more memory than they may (--memory)";
        (self.every > 1).then(|| format!("{whole}: one of {} samples along each axis is drawn, {why}", self.every))
    }

    /// Whether points stand for its samples: whether it was built, and all of it is there.
    pub fn has_points(&self) -> bool {
        matches!(self.data, Data::File(_)) && self.every == 1
    }

    /// The stored samples of the first channel's values, in the grid's order; NaN where there are none.
    pub(super) fn shown_values(&self) -> Vec<f32> {
        self.values(&self.stored, 0)
    }

    /// What the values of the first channel are.
    pub fn statistics(&self) -> &ValueStatistics {
        &self.statistics
    }

    /// What the values of one of [`OpenField::attributes`] are.
    pub fn statistics_of(&self, attribute: usize) -> ValueStatistics {
        ValueStatistics::of(&self.values(&self.stored, attribute))
    }

    /// The values of an attribute where the stored samples are such.
    fn values(&self, planes: &[Vec<f32>], attribute: usize) -> Vec<f32> {
        let grid = self.grid();
        match grid.channels.get(attribute) {
            Some(channel) => values_of(channel, &planes[attribute], &self.stored[attribute]),
            None => gradient::magnitudes(grid, &values_of(&grid.channels[0], &planes[0], &self.stored[0])),
        }
    }

    /// The values of some of [`OpenField::attributes`]: the samples' own, or as near as wanted. For pictures of sums the first one's are brought to the sum of the
    /// samples where a number of points was asked for, so that it does not depend on that.
    ///
    /// # Errors
    /// When the points cannot be read, or there are none.
    pub fn shown(&self, wanted: Option<&Wanted>, channels: &[usize], is_sum: bool) -> Result<Shown, PictureError> {
        let Some(wanted) = wanted else { return Ok(self.of_samples(channels)) };
        let (points, loaded) = self.points()?;
        let (mut shown, _) = self.of_points(points, wanted, channels, is_sum);
        shown.times[0] = loaded;
        Ok(shown)
    }

    /// The same with the points themselves, which are the samples where nothing else is wanted.
    ///
    /// # Errors
    /// As [`OpenField::shown`].
    pub fn shown_as_points(&self, wanted: Option<&Wanted>, channels: &[usize]) -> Result<Shown, PictureError> {
        let (points, loaded) = self.points()?;
        let (mut shown, cut) = match wanted {
            Some(wanted) => self.of_points(points, wanted, channels, false),
            None => (self.of_samples(channels), points.hierarchy.cut(|_, _| Drawn::Refined)),
        };
        let start = Instant::now();
        let samples = self.values(&self.stored, channels[0]);
        shown.points = Some(Arc::new(FieldPoints::new(&points.hierarchy, &cut, &shown.field, &samples)));
        shown.times[0] = loaded;
        shown.times[2] += start.elapsed();
        Ok(shown)
    }

    /// The samples themselves.
    fn of_samples(&self, channels: &[usize]) -> Shown {
        let report = PointsReport::exact(self.grid().shape.iter().product());
        Shown { field: self.field(&self.stored, channels), points: None, report, times: Default::default() }
    }

    /// The points, and how long it took to read them.
    fn points(&self) -> Result<(&Points, Duration), PictureError> {
        let start = Instant::now();
        let points = match self.points.get() {
            Some(points) => points,
            None => {
                let read = self.read_points()?;
                self.points.get_or_init(|| read)
            }
        };
        Ok((points, start.elapsed()))
    }

    fn read_points(&self) -> Result<Points, PictureError> {
        let file = match &self.data {
            Data::File(file) if self.every == 1 => file,
            Data::File(_) => return Err(PictureError::of(&self.path, self.left_out().unwrap_or_default())),
            Data::Source(_) => {
                let why = "no points stand for its samples: build a file of it first (deepfield build)";
                return Err(PictureError::of(&self.path, why));
            }
        };
        let hierarchy = file.hierarchy(&self.stored)?;
        Ok(Points { curve: hierarchy.curve(), hierarchy })
    }

    /// What some of the points show, and which these are.
    fn of_points(&self, points: &Points, wanted: &Wanted, channels: &[usize], is_sum: bool) -> (Shown, Cut) {
        let (Points { hierarchy, curve }, grid) = (points, self.grid());
        let start = Instant::now();
        let samples = Samples {
            dimensions: grid.dimensions,
            shape: grid.shape.map(|side| side as usize),
            channels: self.stored.iter().map(Vec::as_slice).collect(),
        };
        // Values that must be found among others of the same look, and by how much that may be.
        let (cut, alike) = match wanted {
            Wanted::Points(most, weighting) => (hierarchy.cut_weighted(curve, *most, weighting), None),
            Wanted::Near { error, seen: Some(seen) } => {
                let (cut, alike) = self.cut_alike(hierarchy, *error, seen);
                (cut, Some(alike))
            }
            Wanted::Near { error, seen: None } => (hierarchy.cut_within(&samples, self.most(*error)).0, None),
        };
        let chosen = start.elapsed();
        let start = Instant::now();
        let mut planes = hierarchy.reconstruct(&samples, &cut);
        let error_color = alike.map(|alike| alike.hold(self, hierarchy, &cut, &mut planes[0]));
        // What is to be near everywhere stays so.
        if is_sum && matches!(wanted, Wanted::Points(..)) {
            keep_sum(&mut planes[0], &self.stored[0]);
        }
        let off = errors(&samples, &planes);
        let error_value = ErrorValue { max: off.max, rms: off.rms, bound: off.max };
        let weighting = match wanted {
            Wanted::Points(_, Weighting::Rms) => Some("rms"),
            Wanted::Points(_, Weighting::Max) => Some("max"),
            Wanted::Points(_, Weighting::Levels(_)) => Some("perceptual"),
            Wanted::Near { .. } => None,
        };
        let report = PointsReport { error_value, error_color, weighting, ..PointsReport::of(&cut) };
        let field = self.field(&planes, channels);
        (Shown { field, points: None, report, times: [Duration::ZERO, chosen, start.elapsed()] }, cut)
    }

    /// How far a stored value may be off.
    fn most(&self, error: Option<f64>) -> f32 {
        let slope = self.grid().channels[0].scale.slope.abs();
        error.map_or_else(|| self.usual_error(), |error| (error / slope) as f32)
    }

    /// As few points as are near, or else look alike.
    fn cut_alike<'a>(
        &self,
        hierarchy: &Hierarchy,
        error: Option<f64>,
        (variability, sensitivity): &'a (Variability, f32),
    ) -> (Cut, Alike<'a>) {
        let most = self.most(error);
        let scale = self.grid().channels[0].scale;
        let alike =
            Alike { ranges: Ranges::new(hierarchy, &self.stored[0]), variability, sensitivity: *sensitivity, scale };
        let cut = hierarchy.cut(|level, node| {
            let nodes = &hierarchy.levels[level];
            if alike.is_so(level, node) || nodes.large_max[node] <= most {
                Drawn::Large
            } else if nodes.set_max[node] <= most {
                Drawn::Directed
            } else {
                Drawn::Refined
            }
        });
        (cut, alike)
    }

    /// Half a step of whole numbers, a 512th of the range of others.
    fn usual_error(&self) -> f32 {
        let [low, high] = self.statistics.range();
        match self.grid().sample_type {
            SampleType::F32 | SampleType::F64 => {
                ((high - low) / (512.0 * self.grid().channels[0].scale.slope.abs())) as f32
            }
            _ => 0.5,
        }
    }

    /// Planes of stored samples as a field of some attributes' values.
    fn field(&self, planes: &[Vec<f32>], channels: &[usize]) -> Arc<Field> {
        let grid = self.grid();
        let of = |&attribute: &usize| -> (String, Unit, Vec<f32>) {
            let (name, unit) = self.about(attribute);
            (name, unit, self.values(planes, attribute))
        };
        let is_colored = channels.len() >= 3 && channels == colors_of(grid);
        let full_light = is_colored.then_some(match grid.sample_type {
            SampleType::U8 | SampleType::I8 => 255.0,
            SampleType::U16 | SampleType::I16 => 65535.0,
            SampleType::F32 | SampleType::F64 => 1.0,
            _ => u32::MAX as f32,
        });
        Arc::new(Field::new(grid, channels.iter().map(of).collect(), full_light))
    }
}

/// What a transfer function shows of the values below nodes.
struct Alike<'a> {
    ranges: Ranges,
    variability: &'a Variability,
    sensitivity: f32,
    scale: Scale,
}

impl Alike<'_> {
    /// By how much what is seen of stored values of a range differs.
    fn varies(&self, [low, high]: [f32; 2]) -> f32 {
        let [a, b] = [low, high].map(|stored| self.scale.value(f64::from(stored)) as f32);
        self.variability.over([a.min(b), a.max(b)])
    }

    /// Whether all values below a node look alike.
    fn is_so(&self, level: usize, node: usize) -> bool {
        let range = self.ranges.of(level, node);
        range[0] > range[1] || self.varies(range) <= self.sensitivity
    }

    /// Brings values that blend with their neighbours' back to where they look alike; by how much any looks different from its sample.
    fn hold(&self, open: &OpenField, hierarchy: &Hierarchy, cut: &Cut, values: &mut [f32]) -> f32 {
        self.ranges.hold(hierarchy, cut, values, |level, node| self.is_so(level, node));
        let apart = |(sample, value): (&f32, &f32)| match sample.is_nan() {
            true => 0.0,
            false => self.varies([sample.min(*value), sample.max(*value)]),
        };
        open.stored[0].par_iter().zip(&*values).map(apart).reduce(|| 0.0, f32::max)
    }
}

impl Data {
    fn grid(&self) -> &Grid {
        match self {
            Data::File(file) => &file.about().grid,
            Data::Source(source) => source.grid(),
        }
    }

    fn read(&self, region: &Region, samples: &mut [u8]) -> Result<(), PictureError> {
        match self {
            Data::File(file) => Ok(file.read(region, samples)?),
            Data::Source(source) => Ok(source.read(region, samples)?),
        }
    }

    /// All samples, a plane a channel.
    fn samples(&self, too_large: impl Fn() -> PictureError) -> Result<Vec<Vec<f32>>, PictureError> {
        let grid = self.grid();
        let bytes = grid.bytes().and_then(|bytes| usize::try_from(bytes).ok()).ok_or_else(&too_large)?;
        let mut samples = Vec::new();
        samples.try_reserve_exact(bytes).map_err(|_| too_large())?;
        samples.resize(bytes, 0);
        self.read(&grid.region(), &mut samples)?;
        Ok(planes_of(grid.sample_type, grid.channels.len(), &samples))
    }

    /// Every `every`-th sample along each axis, a plane a channel; read in parts of [`BAND`] bytes.
    fn thinned_samples(&self, every: u64, too_large: impl Fn() -> PictureError) -> Result<Vec<Vec<f32>>, PictureError> {
        let grid = self.grid();
        let ([width, height, depth], kept) = (grid.shape, grid.thinned(every).shape);
        let count = kept.iter().try_fold(1u64, |count, &side| count.checked_mul(side));
        let count = count.and_then(|count| usize::try_from(count).ok()).ok_or_else(&too_large)?;
        let mut planes = vec![Vec::new(); grid.channels.len()];
        for plane in &mut planes {
            plane.try_reserve_exact(count).map_err(|_| too_large())?;
            plane.resize(count, f32::NAN);
        }
        // Bricks are read whole; of other files single slices.
        let slices = if matches!(self, Data::File(_)) { BRICK.min(depth) } else { 1 };
        let row = width.saturating_mul(grid.sample_bytes()).saturating_mul(slices).max(1);
        let rows = (BAND / row).clamp(1, height);
        let mut samples = Vec::new();
        for front in (0..depth).step_by(slices as usize) {
            let back = (front + slices).min(depth);
            if (front..back).all(|z| z % every != 0) {
                continue;
            }
            for top in (0..height).step_by(rows as usize) {
                let region = grid.region().with(1, top..(top + rows).min(height)).with(2, front..back);
                let bytes = (back - front) * (region.max[1] - top) * width * grid.sample_bytes();
                samples.resize(usize::try_from(bytes).map_err(|_| too_large())?, 0);
                self.read(&region, &mut samples)?;
                for (plane, part) in planes.iter_mut().zip(planes_of(grid.sample_type, grid.channels.len(), &samples)) {
                    let lines = (front..back).flat_map(|z| (top..region.max[1]).map(move |y| (y, z)));
                    for ((y, z), line) in lines.zip(part.chunks(width as usize)) {
                        if y % every == 0 && z % every == 0 {
                            let start = ((z / every * kept[1] + y / every) * kept[0]) as usize;
                            let out = &mut plane[start..start + kept[0] as usize];
                            out.iter_mut().zip(line.iter().step_by(every as usize)).for_each(|(out, own)| *out = *own);
                        }
                    }
                }
            }
        }
        Ok(planes)
    }
}

/// Of how many samples along each axis one is taken so that pictures of them take no more than so many bytes.
fn thinning(grid: &Grid, memory: u64) -> u64 {
    let takes = |every: u64| {
        let samples: f64 = grid.thinned(every).shape.iter().map(|&side| side as f64).product();
        samples * grid.channels.len() as f64 * BYTES
    };
    (1..u64::from(u32::MAX)).find(|&every| takes(every) <= memory as f64 || takes(every) <= 8.0 * BYTES).unwrap_or(1)
}

/// The channels of a picture in colours, red first; none where a grid has no colours.
pub(super) fn colors_of(grid: &Grid) -> Vec<usize> {
    let find = |name: &&str| grid.channels.iter().position(|channel| channel.name == **name);
    let colors: Vec<usize> = ["red", "green", "blue", "alpha"].iter().filter_map(find).collect();
    if grid.dimensions == 2 && colors.len() >= 3 && colors.len() == grid.channels.len() { colors } else { Vec::new() }
}

/// How far the sum of what points show may be from that of the samples, of it, and be brought back: more is another grid's.
const SUM_OFF: f64 = 0.1;

/// Scales values to the sum of the samples that they stand for.
fn keep_sum(values: &mut [f32], samples: &[f32]) {
    let total = |of: &[f32]| -> f64 {
        let pairs = of.iter().zip(samples).filter(|(_, sample)| sample.is_finite());
        pairs.map(|(value, _)| f64::from(*value)).sum()
    };
    let factor = total(samples) / total(values);
    if (factor - 1.0).abs() < SUM_OFF {
        values.par_iter_mut().for_each(|value| *value = (f64::from(*value) * factor) as f32);
    }
}

/// The values of stored samples, NaN where those of the file, `samples`, stand for none.
fn values_of(channel: &Channel, stored: &[f32], samples: &[f32]) -> Vec<f32> {
    let is_none = |sample: f32| {
        !sample.is_finite() || channel.no_data.is_some_and(|none| f64::from(sample) == f64::from(none as f32))
    };
    let value = |(stored, sample): (&f32, &f32)| match is_none(*sample) {
        true => f32::NAN,
        false => channel.scale.value(f64::from(*stored)) as f32,
    };
    stored.par_iter().zip(samples).map(value).collect()
}
