//! `deepfield reconstruct`: an image or a volume back from the points that stand for it.

use super::heights;
use super::raw_options::RawOptions;
use super::render_arguments::splat_count;
use super::statistics::write_json;
use super::wavelet_options::WaveletOptions;
use super::{CommandResult, print_line};
use crate::annotate::number::short;
use crate::explore::export::grid::{GridFormat, write_grid};
use crate::hierarchy::wavelet::{Bricks, Hierarchy, Samples, errors};
use crate::import::{self, GridOptions, GridSource, ImportError, grid_format, open_grid};
use crate::look::DataKind;
use crate::model::{Grid, ReadMethod, Region, SampleType};
use crate::picture::field::{ErrorValue, PointsReport};
use crate::store::GridFile;
use crate::store::grid::{beyond_single, planes_of};
use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};
use std::str::FromStr;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Draws an image or a volume from oriented points back onto its grid, as many as asked for, and writes that as a file.
///
/// Points stand for nodes of a hierarchy: one, two or three for what is smooth or changes in one direction, the samples themselves for what is
/// neither (Welsh and Mueller 2003). A file that `build` wrote has it; of a source it is built in memory.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield reconstruct photo.png -o near.png --points 20000
  deepfield reconstruct head.nrrd -o near.npy --error-value 4 --json errors.json
  deepfield reconstruct head.df -o coarse.nrrd --level 3         as points for 8 x 8 x 8 samples each show it
  deepfield reconstruct bonsai.df -o part.nrrd --exact --region 0:128,0:128,64:65")]
pub struct Arguments {
    /// The image or volume, or a file that was built of it.
    pub path: PathBuf,
    /// The file to write: .npy, .nrrd, or .png of an image or one layer of a volume. What is not exact is float32, in a .png rounded to the image's own type.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Points at most.
    #[arg(long, value_name = "N", value_parser = point_count, group = "budget")]
    pub points: Option<u64>,
    /// As few points as leave no sample further off than this.
    #[arg(long, value_name = "E", value_parser = error_value, group = "budget")]
    pub error_value: Option<f32>,
    /// The samples, bit for bit.
    #[arg(long, group = "budget")]
    pub exact: bool,
    /// The points of one level: 1 has nodes of 2 samples along each axis, 2 of 4, and so on as `info` lists them; 0: the samples.
    #[arg(long, value_name = "M", group = "budget")]
    pub level: Option<usize>,
    /// Part of the grid: samples along each axis, x first, the last not included.
    #[arg(long, value_name = "X0:X1,Y0:Y1[,Z0:Z1]")]
    pub region: Option<Box3>,
    /// Write how many points and how wrong as JSON to a file, or to standard output for `-`.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// How points are chosen, of a source: a file was built so.
    #[command(flatten)]
    pub wavelet: WaveletOptions,
    /// What a file without a header holds.
    #[command(flatten)]
    pub raw: RawOptions,
}

/// A half-open box of samples, of as many axes as were named.
#[derive(Clone, Debug, PartialEq)]
pub struct Box3(Vec<[u64; 2]>);

impl FromStr for Box3 {
    type Err = String;

    fn from_str(text: &str) -> Result<Box3, String> {
        let expected = || format!("{text:?}: expected X0:X1,Y0:Y1 or X0:X1,Y0:Y1,Z0:Z1, each first below its last");
        let axis = |text: &str| -> Option<[u64; 2]> {
            let (from, to) = text.split_once(':')?;
            let ends = [from.parse().ok()?, to.parse().ok()?];
            (ends[0] < ends[1]).then_some(ends)
        };
        let axes: Option<Vec<[u64; 2]>> = text.split(',').map(axis).collect();
        axes.filter(|axes| (2..=3).contains(&axes.len())).map(Box3).ok_or_else(expected)
    }
}

impl Box3 {
    fn within(&self, grid: &Grid) -> Option<Region> {
        let mut region = grid.region();
        if self.0.len() != grid.dimensions {
            return None;
        }
        for (axis, &[from, to]) in self.0.iter().enumerate() {
            if to > grid.shape[axis] {
                return None;
            }
            region = region.with(axis, from..to);
        }
        Some(region)
    }
}

impl Display for Box3 {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let axes: Vec<String> = self.0.iter().map(|[from, to]| format!("{from}:{to}")).collect();
        f.write_str(&axes.join(","))
    }
}

fn point_count(text: &str) -> Result<u64, String> {
    splat_count(text).map(|count| count as u64)
}

fn error_value(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value >= 0.0);
    value.ok_or_else(|| "expected a number from 0".to_owned())
}

/// Where a grid is: a file of it, or a source.
enum Opened {
    File(GridFile),
    Source(GridSource),
}

impl Opened {
    fn grid(&self) -> &Grid {
        match self {
            Opened::File(file) => &file.about().grid,
            Opened::Source(source) => source.grid(),
        }
    }

    fn read(&self, region: &Region, out: &mut [u8]) -> CommandResult {
        match self {
            Opened::File(file) => file.read(region, out)?,
            Opened::Source(source) => source.read(region, out)?,
        }
        Ok(())
    }

    fn bytes_of(&self, grid: &Grid, region: &Region) -> Result<Vec<u8>, Failure> {
        let mut bytes = vec![0; usize::try_from(grid.bytes().ok_or("the grid is too large for this machine")?)?];
        self.read(region, &mut bytes)?;
        Ok(bytes)
    }
}

/// Cuts the hierarchy, draws it, and writes what there is.
///
/// # Errors
/// When the grid cannot be read, the file cannot hold it, or cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, output, .. } = arguments;
    // What cannot be looked at is told by the importer; folders of slices cannot.
    let opened = match DataKind::of(path).unwrap_or(DataKind::Source) {
        DataKind::Grid => Opened::File(GridFile::open(path, ReadMethod::default())?),
        kind @ (DataKind::Pages | DataKind::Run) => return Err(no_grid(path, kind.described())),
        DataKind::Heights | DataKind::Source => {
            let options = GridOptions { raw: arguments.raw.grid()?, ..GridOptions::default() };
            // Heights in a format of images are an image, too.
            if options.raw.is_none() && matches!(grid_format(path), Ok(None)) {
                heights::refuse(path, "an image or a volume")?;
            }
            Opened::Source(match open_grid(path, &options) {
                Err(ImportError::Unrecognised { .. }) if import::open(path).is_ok() => {
                    return Err(no_grid(path, "particles"));
                }
                source => source?,
            })
        }
    };
    let grid = opened.grid();
    if let (Opened::File(_), Some(_)) = (&opened, arguments.wavelet.ignore_below) {
        let (path, found) = (path.display(), DataKind::Grid.described());
        return Err(format!("{path}: --ignore-below: found {found}, which has its own, expected a source").into());
    }
    let format = GridFormat::of(output).ok_or_else(|| format!("{}: expected .npy, .nrrd or .png", output.display()))?;
    let region = match &arguments.region {
        None => grid.region(),
        Some(region) => region.within(grid).ok_or_else(|| {
            format!("{}: --region: found {region}, expected a part of {}", path.display(), grid.described())
        })?,
    };
    if let Some(level) = arguments.level {
        check_level(path, grid, level)?;
    }
    let is_exact = match arguments.level {
        Some(level) => level == 0,
        None => arguments.exact || arguments.points.is_none() && arguments.error_value.is_none(),
    };
    let is_rounded = format == GridFormat::Png && matches!(grid.sample_type, SampleType::U8 | SampleType::U16);
    let sample_type = if is_exact || is_rounded { grid.sample_type } else { SampleType::F32 };
    let part = part_of(grid, &region, sample_type);
    if let Some(reason) = format.lacks(&part) {
        return Err(format!("{}: {reason}", output.display()).into());
    }
    let (samples, told) = match is_exact {
        true => {
            let points = part.shape.iter().product();
            (opened.bytes_of(&part, &region)?, PointsReport::exact(points))
        }
        false => approximate(arguments, &opened, &region, sample_type)?,
    };
    write_grid(output, format, &part, &samples)?;
    let ErrorValue { max, rms, .. } = told.error_value;
    if let Some(json) = &arguments.json {
        write_json(json, &told)?;
        // Standard output is the JSON's alone.
        if json == Path::new("-") {
            return Ok(());
        }
    }
    let points = if told.points == 1 { "1 point".to_owned() } else { format!("{} points", told.points) };
    let [rms, max] = [rms, max].map(|error| short(f64::from(error)));
    print_line(format_args!("{points}, {} of them samples; off by {rms} (rms), {max} at most", told.leaves))?;
    Ok(())
}

/// What is said of data that has no grid.
fn no_grid(path: &Path, found: &str) -> Failure {
    format!("{}: content: found {found}, expected an image or a volume", path.display()).into()
}

/// Refuses a level that a grid's hierarchy does not have.
fn check_level(path: &Path, grid: &Grid, level: usize) -> CommandResult {
    let bricks = Bricks { dimensions: grid.dimensions, shape: grid.shape.map(|side| side as usize) };
    let last = bricks.all_levels();
    if level <= last {
        return Ok(());
    }
    let path = path.display();
    Err(format!("{path}: --level: found {level}, expected 0 (the samples) to {last} (a single node)").into())
}

/// A part of a grid, with samples of another type.
fn part_of(grid: &Grid, region: &Region, sample_type: SampleType) -> Grid {
    let mut part = Grid { shape: region.shape(), sample_type, ..grid.clone() };
    let first = glam::DVec3::from_array(region.min.map(|index| index as f64));
    part.to_world.translation = grid.to_world.transform_point3(first);
    part
}

/// The samples of a region as a cut's points show them.
fn approximate(
    arguments: &Arguments,
    opened: &Opened,
    region: &Region,
    sample_type: SampleType,
) -> Result<(Vec<u8>, PointsReport), Failure> {
    let grid = opened.grid();
    let whole = opened.bytes_of(grid, &grid.region())?;
    let planes = planes_of(grid.sample_type, grid.channels.len(), &whole);
    drop(whole);
    if let Some(note) = beyond_single(grid.sample_type, &planes) {
        eprintln!("deepfield: {}: {note}", arguments.path.display());
    }
    let shape = grid.shape.map(|side| side as usize);
    let channels = planes.iter().map(Vec::as_slice).collect();
    let samples = Samples { dimensions: grid.dimensions, shape, channels };
    let hierarchy = match opened {
        Opened::File(file) => file.hierarchy(&planes)?,
        Opened::Source(_) => Hierarchy::build(&samples, &arguments.wavelet.options(&arguments.path, grid)?),
    };
    let (cut, drawn) = match (arguments.error_value, arguments.level) {
        (Some(error), _) => hierarchy.cut_within(&samples, error),
        (None, level) => {
            let most = arguments.points.map_or(usize::MAX, |points| usize::try_from(points).unwrap_or(usize::MAX));
            let cut = level.map_or_else(|| hierarchy.cut_of_points(most), |level| hierarchy.cut_of_level(level));
            let drawn = hierarchy.reconstruct(&samples, &cut);
            (cut, drawn)
        }
    };
    let off = errors(&samples, &drawn);
    let error_value = ErrorValue { max: off.max, rms: off.rms, bound: off.max };
    let told = PointsReport { error_value, ..PointsReport::of(&cut) };
    let mut bytes = Vec::new();
    for z in region.min[2]..region.max[2] {
        for y in region.min[1]..region.max[1] {
            let row = (z * grid.shape[1] + y) * grid.shape[0];
            for at in (row + region.min[0])..(row + region.max[0]) {
                for plane in &drawn {
                    let value = plane[at as usize];
                    match sample_type {
                        // Casts saturate.
                        SampleType::U8 => bytes.push(value.round() as u8),
                        SampleType::U16 => bytes.extend_from_slice(&(value.round() as u16).to_ne_bytes()),
                        _ => bytes.extend_from_slice(&value.to_ne_bytes()),
                    }
                }
            }
        }
    }
    Ok((bytes, told))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Channel;

    #[test]
    fn regions_are_parts_of_the_grid() {
        let grid = Grid::volume([10, 8, 6], SampleType::U8, Channel::numbered(1));
        let region = |text: &str| text.parse::<Box3>().ok().and_then(|region| region.within(&grid));
        assert_eq!(region("2:5,0:8,5:6"), Some(Region { min: [2, 0, 5], max: [5, 8, 6] }));
        for wrong in ["2:5,0:8", "5:2,0:8,0:6", "2:5,0:9,0:6", "a:5,0:8,0:6", "2-5"] {
            assert_eq!(region(wrong), None, "{wrong}");
        }
        assert_eq!("2:5,0:9,0:6".parse::<Box3>().unwrap().to_string(), "2:5,0:9,0:6");
        assert_eq!(point_count("1e4"), Ok(10_000));
        assert!(point_count("0").is_err() && point_count("few").is_err());
    }
}
