//! `deepfield probe --line`: the surface along a line, as a table and as a plot.

use super::options::lengths;
use super::probe::{after, answer};
use crate::annotate::plot::Curve;
use crate::color::Image;
use crate::color::output::{write_atomically, write_png};
use crate::commands::CommandResult;
use crate::commands::arguments::PictureSize;
use crate::commands::probe::short;
use crate::heights::OpenHeights;
use crate::heights::measure::{Profile, profile_on};
use crate::heights::model::{HeightGrid, Heights, Lengths};
use crate::model::Unit;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// Size of a plot unless it is set, pixels.
const SIZE: [u32; 2] = [1200, 480];

/// What `--line --json` writes.
#[derive(Serialize)]
struct LineAnswer {
    length: f64,
    valid_length: f64,
    points: usize,
    min: Option<f64>,
    max: Option<f64>,
}

/// Tells a profile and writes it to `out`: as a table, or as a plot of this size.
///
/// # Errors
/// When the field cannot be read, or the file cannot be written.
pub fn run(
    path: &Path,
    open: &OpenHeights,
    corners: &[[f64; 2]],
    map: Option<&str>,
    (out, size): (Option<&Path>, Option<PictureSize>),
    json: Option<&Path>,
) -> CommandResult {
    let is_plot = out.map(is_plot).transpose()?.unwrap_or_default();
    let grid = open.grid();
    let lengths = lengths(path, map, grid)?;
    let found = profile_on(open, &lengths, corners)?;
    match out {
        Some(out) if is_plot => {
            let points: Vec<[f64; 2]> = found.points.iter().map(|point| [point.distance, point.height]).collect();
            write_png(out, &plot(path, &named("distance", &Lengths::unit(grid)), grid, &points, size))?;
        }
        Some(out) => write_atomically(out, table(grid, &found)?.as_bytes())?,
        None => {}
    }
    let known = || found.points.iter().map(|point| point.height).filter(|height| !height.is_nan());
    let told = LineAnswer {
        length: found.length,
        valid_length: found.valid_length,
        points: found.points.len(),
        min: known().reduce(f64::min),
        max: known().reduce(f64::max),
    };
    answer(json, &told, |text, told| {
        let (places, heights) = (after(&Lengths::unit(grid)), after(&grid.height_unit));
        let (length, valid) = (short(told.length), short(told.valid_length));
        writeln!(text, "{}: a line of {length}{places}, {valid}{places} of it over the surface", path.display())?;
        if let (Some(min), Some(max)) = (told.min, told.max) {
            writeln!(text, "heights: {} to {}{heights} at {} points", short(min), short(max), told.points)?;
        }
        Ok(())
    })
}

/// Whether a file that is asked for is a plot by its name, and no table.
///
/// # Errors
/// Where it is neither.
pub(super) fn is_plot(out: &Path) -> Result<bool, String> {
    match out.extension().map(|extension| extension.to_ascii_lowercase()) {
        Some(extension) if extension == "csv" => Ok(false),
        Some(extension) if extension == "png" => Ok(true),
        _ => Err(format!("{}: expected a name that ends in .csv or .png", out.display())),
    }
}

/// A quantity's name with its unit.
pub(super) fn named(name: &str, unit: &Unit) -> String {
    if unit.is_unknown() { name.to_owned() } else { format!("{name} [{unit}]") }
}

fn table(grid: &HeightGrid, found: &Profile) -> Result<String, std::fmt::Error> {
    let [along, unit] = [&Lengths::unit(grid), &grid.xy_unit];
    let heads = [("distance", along), ("x", unit), ("y", unit)].map(|(name, unit)| named(name, unit));
    let mut text = format!("{},{}\n", heads.join(","), named("height", &grid.height_unit));
    for point in &found.points {
        let height = if point.height.is_nan() { String::new() } else { point.height.to_string() };
        writeln!(text, "{},{},{},{height}", point.distance, point.x, point.y)?;
    }
    Ok(text)
}

/// A plot of heights of the file at `path`, which are of a grid; `across` says what goes to the right.
pub(super) fn plot(
    path: &Path,
    across: &str,
    grid: &HeightGrid,
    points: &[[f64; 2]],
    size: Option<PictureSize>,
) -> Image {
    let title = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let curve = Curve { title: &title, across, up: &named("height", &grid.height_unit), points };
    curve.picture(size.map_or(SIZE, |size| [size.width, size.height]))
}
