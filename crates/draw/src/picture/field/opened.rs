//! An image or a volume, open: its samples, and the points that stand for them.

use super::report::{ErrorValue, PointsReport};
use crate::cpu::field::Field;
use crate::cpu::volume::Variability;
use crate::hierarchy::wavelet::{Cut, Drawn, Hierarchy, Ranges, Samples, errors};
use crate::import::{GridOptions, GridSource, open_grid};
use crate::look::DataKind;
use crate::mode::ValueStatistics;
use crate::model::{Channel, Grid, ReadMethod, SampleType, Unit};
use crate::picture::PictureError;
use crate::store::GridFile;
use crate::store::grid::planes_of;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Where samples come from.
enum Data {
    /// A file with points.
    File(GridFile),
    /// A file of samples alone.
    Source(GridSource),
}

/// An image or a volume, open. All of its samples are in memory.
pub struct OpenField {
    path: PathBuf,
    data: Data,
    /// Stored samples, a plane a channel.
    stored: Vec<Vec<f32>>,
    hierarchy: Option<Hierarchy>,
    /// What the values of the first channel are.
    statistics: ValueStatistics,
}

/// Which points are wanted of a field.
pub enum Wanted {
    /// All samples.
    Samples,
    /// The best so many points.
    Points(usize),
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
    pub field: Field,
    /// How they came about.
    pub report: PointsReport,
}

impl OpenField {
    /// Opens a file of an image or a volume, built or not, and reads all of its samples.
    ///
    /// # Errors
    /// When it cannot be read, or is too large for this machine.
    pub fn open(path: &Path, read: ReadMethod) -> Result<OpenField, PictureError> {
        let kind = DataKind::of(path).map_err(|error| PictureError::Asked(error.to_string()))?;
        let data = match kind {
            DataKind::Grid => Data::File(GridFile::open(path, read)?),
            _ => Data::Source(open_grid(path, &GridOptions { read, ..GridOptions::default() })?),
        };
        let grid = data.grid().clone();
        let too_large = || PictureError::of(path, format!("{}: too large for this machine", grid.described()));
        let bytes = grid.bytes().and_then(|bytes| usize::try_from(bytes).ok()).ok_or_else(too_large)?;
        let mut samples = Vec::new();
        samples.try_reserve_exact(bytes).map_err(|_| too_large())?;
        samples.resize(bytes, 0);
        match &data {
            Data::File(file) => file.read(&grid.region(), &mut samples)?,
            Data::Source(source) => source.read(&grid.region(), &mut samples)?,
        }
        let stored = planes_of(grid.sample_type, grid.channels.len(), &samples);
        drop(samples);
        let mut open =
            OpenField { path: path.into(), data, stored, hierarchy: None, statistics: ValueStatistics::default() };
        open.statistics = open.statistics_of(0);
        Ok(open)
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        self.data.grid()
    }

    /// Whether points stand for its samples: whether it was built.
    pub fn has_points(&self) -> bool {
        matches!(self.data, Data::File(_))
    }

    /// What the values of the first channel are.
    pub fn statistics(&self) -> &ValueStatistics {
        &self.statistics
    }

    /// What the values of a channel are.
    pub fn statistics_of(&self, channel: usize) -> ValueStatistics {
        ValueStatistics::of(&values_of(&self.grid().channels[channel], &self.stored[channel], &self.stored[channel]))
    }

    /// The values of some channels, as near as wanted.
    ///
    /// # Errors
    /// When the points cannot be read, or there are none.
    pub fn shown(&mut self, wanted: &Wanted, channels: &[usize]) -> Result<Shown, PictureError> {
        let count: u64 = self.grid().shape.iter().product();
        if matches!(wanted, Wanted::Samples) {
            return Ok(Shown { field: self.field(&self.stored, channels), report: PointsReport::exact(count) });
        }
        if self.hierarchy.is_none() {
            let Data::File(file) = &self.data else {
                let why = "no points stand for its samples: build a file of it first (deepfield build)";
                return Err(PictureError::of(&self.path, why));
            };
            self.hierarchy = Some(file.hierarchy(&self.stored)?);
        }
        let (Some(hierarchy), grid) = (&self.hierarchy, self.grid()) else {
            return Ok(Shown { field: self.field(&self.stored, channels), report: PointsReport::exact(count) });
        };
        let samples = Samples {
            dimensions: grid.dimensions,
            shape: grid.shape.map(|side| side as usize),
            channels: self.stored.iter().map(Vec::as_slice).collect(),
        };
        let (cut, planes, error_color) = match wanted {
            Wanted::Points(most) => {
                let cut = hierarchy.cut_of_points(*most);
                let planes = hierarchy.reconstruct(&samples, &cut);
                (cut, planes, None)
            }
            Wanted::Near { error, seen } => self.near(hierarchy, &samples, *error, seen.as_ref()),
            Wanted::Samples => (hierarchy.exact(), self.stored.clone(), None),
        };
        let off = errors(&samples, &planes);
        let error_value = ErrorValue { max: off.max, rms: off.rms, bound: off.max };
        let report = PointsReport { error_value, error_color, ..PointsReport::of(&cut) };
        Ok(Shown { field: self.field(&planes, channels), report })
    }

    /// As few points as are near, with what they show.
    fn near(
        &self,
        hierarchy: &Hierarchy,
        samples: &Samples<'_>,
        error: Option<f64>,
        seen: Option<&(Variability, f32)>,
    ) -> (Cut, Vec<Vec<f32>>, Option<f32>) {
        let channel = &self.grid().channels[0];
        let most = error.map_or_else(|| self.usual_error(), |error| (error / channel.scale.slope.abs()) as f32);
        let Some((variability, sensitivity)) = seen else {
            let (cut, planes) = hierarchy.cut_within(samples, most);
            return (cut, planes, None);
        };
        let ranges = Ranges::new(hierarchy, &self.stored[0]);
        let value = |stored: f32| channel.scale.value(f64::from(stored)) as f32;
        let varies = |[low, high]: [f32; 2]| {
            let (a, b) = (value(low), value(high));
            variability.over([a.min(b), a.max(b)])
        };
        let is_alike = |level: usize, node: usize| varies(ranges.of(level, node)) <= *sensitivity;
        let cut = hierarchy.cut(|level, node| {
            let nodes = &hierarchy.levels[level];
            if is_alike(level, node) || nodes.large_max[node] <= most {
                Drawn::Large
            } else if nodes.set_max[node] <= most {
                Drawn::Directed
            } else {
                Drawn::Refined
            }
        });
        let mut planes = hierarchy.reconstruct(samples, &cut);
        // What blends with its neighbours must not leave the range that is seen alike.
        ranges.hold(hierarchy, &cut, &mut planes[0], is_alike);
        let apart = |(stored, drawn): (&f32, &f32)| {
            if stored.is_nan() { 0.0 } else { varies([stored.min(*drawn), stored.max(*drawn)]) }
        };
        let worst = self.stored[0].par_iter().zip(&planes[0]).map(apart).reduce(|| 0.0, f32::max);
        (cut, planes, Some(worst))
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

    /// Planes of stored samples as a field of some channels' values.
    fn field(&self, planes: &[Vec<f32>], channels: &[usize]) -> Field {
        let grid = self.grid();
        let of = |&channel: &usize| -> (String, Unit, Vec<f32>) {
            let about = &grid.channels[channel];
            let values = values_of(about, &planes[channel], &self.stored[channel]);
            (about.name.clone(), about.unit.clone(), values)
        };
        let is_colored = channels.len() >= 3 && channels == colors_of(grid);
        let full_light = is_colored.then_some(match grid.sample_type {
            SampleType::U8 | SampleType::I8 => 255.0,
            SampleType::U16 | SampleType::I16 => 65535.0,
            SampleType::F32 | SampleType::F64 => 1.0,
            _ => u32::MAX as f32,
        });
        Field::new(grid, channels.iter().map(of).collect(), full_light)
    }
}

impl Data {
    fn grid(&self) -> &Grid {
        match self {
            Data::File(file) => &file.about().grid,
            Data::Source(source) => source.grid(),
        }
    }
}

/// The channels of a picture in colours, red first; none where a grid has no colours.
pub(super) fn colors_of(grid: &Grid) -> Vec<usize> {
    let find = |name: &&str| grid.channels.iter().position(|channel| channel.name == **name);
    let colors: Vec<usize> = ["red", "green", "blue", "alpha"].iter().filter_map(find).collect();
    if grid.dimensions == 2 && colors.len() >= 3 && colors.len() == grid.channels.len() { colors } else { Vec::new() }
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
