//! Hierarchies of images and volumes side by side: the same samples in the same views, within the same numbers of points.
//!
//! Volumes are compared by the line integrals of their values, images by the values themselves.

use super::check_mode;
use super::pictures::{Shown, color_errors, sum_errors, views};
use super::report::{Outcome, Report, conclude, milliseconds, print_head, print_row};
use super::ways::{Data, Way};
use crate::bench::process_memory::peak_memory;
use crate::bench::splat::Failure;
use crate::bench::{Arguments, Times};
use crate::build::grid::{GridBuildOptions, build_grid};
use crate::color::Accumulation;
use crate::color::composite::composite_at;
use crate::color::transfer::TransferFunction;
use crate::command_line::arguments::PictureSize;
use crate::cpu::field::{Field, FieldLevel, xray};
use crate::hierarchy::wavelet::{Options, Types, Weighting};
use crate::import::{GridOptions, open_grid};
use crate::model::{Grid, ReadMethod};
use crate::modes::{image, xray as xray_mode};
use crate::picture::field::{OpenField, Wanted};
use crate::view::View;
use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A hierarchy over the samples.
struct Built {
    way: Way,
    /// Its file, open; `None` of means, which have none.
    open: Option<OpenField>,
    bytes: Option<u64>,
    built: Option<(f64, Option<u64>)>,
}

/// Compares hierarchies of an image or a volume, and writes pictures, differences and curves.
///
/// # Errors
/// When the data cannot be read or built, another mode than its own is asked for, or a file cannot be written.
pub fn compare(
    path: &Path,
    named: String,
    ways: &[Way],
    arguments: &Arguments,
    folder: &Path,
) -> Result<Report, Failure> {
    let options = &arguments.hierarchies;
    let PictureSize { width, height } = arguments.flight.size.unwrap_or(PictureSize { width: 512, height: 512 });
    let temporary = tempfile::tempdir()?;
    let source = OpenField::open(path, ReadMethod::default(), None)?;
    let grid = source.grid().clone();
    let own_mode = if grid.dimensions == 2 { &image::MODE } else { &xray_mode::MODE };
    check_mode(&named, arguments.flight.mode, own_mode)?;
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let samples: u64 = grid.shape.iter().product();
    let exact = source.shown(None, &[0], false)?.field;
    let mut built = Vec::new();
    for way in ways {
        built.push(Built::new(*way, path, temporary.path(), arguments)?);
    }
    // An image has one side.
    let count = if grid.dimensions == 2 { 1 } else { options.views.into() };
    let all_views = views(grid.bounds(), count, (width, height))?;
    let transfer = TransferFunction::preset(xray_mode::MODE.transfer[0]).unwrap_or_default();
    let (mut outcomes, mut shown) = (Vec::new(), Vec::new());
    print_head(&named);
    for (number, (view, _)) in all_views.iter().enumerate() {
        let sums = picture(view, &exact);
        let levels = transfer.levels(&sums);
        let truth = composite_at(&sums, &transfer, &levels);
        for own in &built {
            for budget in options.budgets.iter().map(|budget| budget.of(samples)) {
                let start = Instant::now();
                let (field, splats, nodes) = own.field(&exact, &grid, budget)?;
                let selected = start.elapsed();
                let (mut times, mut drawn) = (Vec::new(), Accumulation::default());
                for _ in 0..arguments.repeat {
                    let start = Instant::now();
                    drawn = picture(view, &field);
                    times.push(selected + start.elapsed());
                }
                let image = composite_at(&drawn, &transfer, &levels);
                let [error_l1, error_l2, psnr] = sum_errors(&drawn, &sums);
                let outcome = Outcome {
                    hierarchy: own.way,
                    budget,
                    view: number,
                    splats,
                    nodes,
                    bytes_read: own.bytes,
                    bytes_file: own.bytes,
                    build_s: own.built.map(|(seconds, _)| seconds),
                    build_peak_memory: own.built.and_then(|(_, memory)| memory),
                    select_ms: Some(1e3 * selected.as_secs_f64()),
                    frame_ms: milliseconds(Times::of(times)),
                    error_l1,
                    error_l2,
                    error_color: color_errors(&image, &truth),
                    psnr,
                    error_bound: None,
                };
                print_row(&outcome);
                if number == 0 {
                    shown.push(Shown { outcome: outcome.clone(), image });
                }
                outcomes.push(outcome);
            }
        }
        if number == 0 {
            Shown::write(folder, options.budgets.len() as u32, &truth, &shown)?;
        }
    }
    let best = conclude(folder, &outcomes)?;
    Ok(Report {
        source: named,
        particles: samples,
        size: [width, height],
        views: all_views.iter().map(|(_, camera)| *camera).collect(),
        outcomes,
        best,
    })
}

impl Built {
    fn new(way: Way, path: &Path, folder: &Path, arguments: &Arguments) -> Result<Built, Failure> {
        let data = Data::of(path)?;
        let types = match way {
            Way::Mip => return Ok(Built { way, open: None, bytes: None, built: None }),
            Way::Wavelet => Types::Measured,
            Way::WaveletRound => Types::Round,
            _ => return Err(data.refusal(way, &path.display().to_string())),
        };
        let (file, built): (PathBuf, _) = match data {
            Data::BuiltSamples => (path.to_owned(), None),
            Data::Samples | Data::Particles => {
                let source = open_grid(path, &GridOptions::default())?;
                let points = Options { types, colours: source.grid().has_colors(), ..Options::default() };
                let options = GridBuildOptions { points, memory: arguments.memory, ..GridBuildOptions::default() };
                let out = folder.join(format!("{way}.df"));
                let start = Instant::now();
                build_grid(&source, &options, &out, &())?;
                (out, Some((start.elapsed().as_secs_f64(), peak_memory("self"))))
            }
        };
        let bytes = std::fs::metadata(&file)?.len();
        Ok(Built { way, open: Some(OpenField::open(&file, ReadMethod::default(), None)?), bytes: Some(bytes), built })
    }

    /// The first channel from so many points at most; with the number of points, and of the nodes that they stand for.
    fn field(&self, exact: &Field, grid: &Grid, budget: u64) -> Result<(Arc<Field>, u64, usize), Failure> {
        match &self.open {
            Some(open) => {
                let shown = open.shown(
                    Some(&Wanted::Points(usize::try_from(budget)?, Weighting::Rms)),
                    &[0],
                    grid.dimensions == 3,
                )?;
                Ok((shown.field, shown.report.points, shown.report.nodes as usize))
            }
            None => {
                let (shape, values) = means(&exact.channels[0].levels[0], grid.dimensions, budget as usize);
                let samples = shape.iter().product::<usize>();
                let channel = (exact.channels[0].name.clone(), exact.channels[0].unit.clone(), values);
                let field = Field::new(&coarser(grid, shape), vec![channel], None);
                Ok((Arc::new(field), samples as u64, samples))
            }
        }
    }
}

/// Line integrals of a volume's values, or the values of an image where pixels are.
fn picture(view: &View, field: &Field) -> Accumulation {
    if field.dimensions == 3 {
        return xray::draw(view, field, 0);
    }
    let mut picture = Accumulation::new(view.width, view.height, false);
    let level = field.level_for(1.0 / view.focal_pixels());
    for (index, out) in picture.p.iter_mut().enumerate() {
        let pixel = [index % view.width as usize, index / view.width as usize].map(|at| at as f64 + 0.5);
        let at = field.to_index.transform_point3(view.at_depth(pixel, 0.0)).as_vec3();
        let at = [at.x, at.y, 0.0];
        let value = field.channels[0].levels[level].at(FieldLevel::indices(level, at));
        *out = if field.holds(at) && !value.is_nan() { value } else { 0.0 };
    }
    picture
}

/// At most `most` box means of samples, evenly along all axes.
fn means(level: &FieldLevel, dimensions: usize, most: usize) -> ([usize; 3], Vec<f32>) {
    let samples: usize = level.shape.iter().product();
    let share = (most as f64 / samples as f64).min(1.0).powf(1.0 / dimensions as f64);
    let side = |axis: usize| ((level.shape[axis] as f64 * share).round() as usize).max(1);
    let mut shape: [usize; 3] = std::array::from_fn(|axis| if axis < dimensions { side(axis) } else { 1 });
    while shape.iter().product::<usize>() > most.max(1) {
        let longest = (0..dimensions).max_by_key(|axis| shape[*axis]).unwrap_or(0);
        shape[longest] -= 1;
    }
    let (mut own, mut values) = (level.shape, level.values.clone());
    for axis in 0..dimensions {
        let mut next = own;
        next[axis] = shape[axis];
        values = along(axis, own, next, &values);
        own = next;
    }
    (shape, values)
}

/// Means along one axis, samples that two of them share counted by their parts; holes count nothing.
fn along(axis: usize, from: [usize; 3], to: [usize; 3], values: &[f32]) -> Vec<f32> {
    let width = from[axis] as f64 / to[axis] as f64;
    let stride = from[..axis].iter().product::<usize>();
    let mean = |index: usize| {
        let at = [index % to[0], index / to[0] % to[1], index / (to[0] * to[1])];
        let mut first = at;
        first[axis] = 0;
        let start = (first[2] * from[1] + first[1]) * from[0] + first[0];
        let (low, high) = (at[axis] as f64 * width, (at[axis] + 1) as f64 * width);
        let (mut sum, mut weights) = (0.0, 0.0);
        for place in low as usize..(high.ceil() as usize).min(from[axis]) {
            let weight = high.min(place as f64 + 1.0) - low.max(place as f64);
            let value = f64::from(values[start + place * stride]);
            if weight > 0.0 && !value.is_nan() {
                (sum, weights) = (sum + weight * value, weights + weight);
            }
        }
        (sum / weights) as f32
    };
    (0..to.iter().product()).map(mean).collect()
}

/// The grid of fewer samples in the same box.
fn coarser(grid: &Grid, shape: [usize; 3]) -> Grid {
    let growth: [f64; 3] = std::array::from_fn(|axis| grid.shape[axis] as f64 / shape[axis] as f64);
    let mut coarser = Grid { shape: shape.map(|side| side as u64), ..grid.clone() };
    let half = |axis: usize| if axis < grid.dimensions { 0.5 * growth[axis] - 0.5 } else { 0.0 };
    coarser.to_world.translation = grid.to_world.transform_point3(DVec3::new(half(0), half(1), half(2)));
    coarser.to_world.matrix3 = grid.to_world.matrix3 * DMat3::from_diagonal(DVec3::from_array(growth));
    coarser
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Channel, SampleType, Unit};

    #[test]
    fn means_keep_the_sum_and_the_box() {
        let grid = Grid::volume([10, 7, 9], SampleType::F32, Channel::numbered(1));
        let values: Vec<f32> = (0..630).map(|i| (i * i % 101) as f32).collect();
        let mean = values.iter().sum::<f32>() / 630.0;
        let field = Field::new(&grid, vec![("value".into(), Unit::default(), values)], None);
        let (shape, coarse) = means(&field.channels[0].levels[0], 3, 100);
        let count: usize = shape.iter().product();
        assert!(count <= 100 && count > 60, "{shape:?}");
        assert!((coarse.iter().sum::<f32>() / count as f32 - mean).abs() < 1e-3);
        let bounds = coarser(&grid, shape).bounds();
        assert!((bounds.min - grid.bounds().min).length() < 1e-9 && (bounds.max - grid.bounds().max).length() < 1e-9);
    }
}
