//! `deepfield probe --pixel`: what is under pixels of a picture.

use super::info::within;
use super::probe::{HeightsProbe, after, answer};
use crate::commands::CommandResult;
use crate::commands::probe::short;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::heights::OpenHeights;
use crate::heights::measure::{Pick, Ray, pick_all};
use crate::heights::model::Heights;
use crate::look::{CameraConfig, PictureConfig, Shot};
use crate::mode::SettingValue;
use crate::picture::surface::SurfaceSession;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// A sample under a pixel.
#[derive(Serialize)]
struct SampleUnder {
    row: u64,
    column: u64,
    height: f64,
}

/// What is under a pixel.
#[derive(Serialize)]
struct Under {
    valid: bool,
    row: f64,
    column: f64,
    x: f64,
    y: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    height: Option<f64>,
    samples: Vec<SampleUnder>,
}

impl Under {
    fn of(pick: Pick) -> Option<Under> {
        match pick {
            Pick::Beside => None,
            Pick::NotMeasured { row, column, x, y } => {
                Some(Under { valid: false, row, column, x, y, height: None, samples: Vec::new() })
            }
            Pick::Hit(hit) => Some(Under {
                valid: true,
                row: hit.row,
                column: hit.column,
                x: hit.x,
                y: hit.y,
                height: Some(hit.height),
                samples: hit.samples.map(|(row, column, height)| SampleUnder { row, column, height }).into(),
            }),
        }
    }
}

/// What `--pixels --json` writes.
#[derive(Serialize)]
struct PixelsAnswer {
    picks: Vec<Option<Under>>,
    /// How far heights are from the source's at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    height_error: Option<f64>,
}

/// Tells what is under pixels.
///
/// # Errors
/// When the field cannot be read, the camera sees nothing, or a pixel is not in the picture.
pub fn run(path: &Path, open: &OpenHeights, asked: &HeightsProbe, json: Option<&Path>) -> CommandResult {
    let mut pixels = asked.pixel.clone();
    if let Some(list) = &asked.pixels {
        pixels.extend(read_pixels(list)?);
    }
    let (sight, placed) = seen(open, asked)?;
    let [width, height] = sight.size();
    if let Some([x, y]) = pixels.iter().find(|[x, y]| *x >= width || *y >= height) {
        return Err(format!("--pixel: found {x},{y}, expected one of {width} x {height}").into());
    }
    let through = |[x, y]: [u32; 2]| sight.ray([x, y].map(|at| f64::from(at) + 0.5));
    let rays: Vec<Option<Ray>> = pixels
        .iter()
        .map(|pixel| {
            let (origin, direction) = through(*pixel)?;
            let (origin, direction) = placed.in_file(origin, direction);
            Some(Ray::new(origin.to_array(), direction.to_array()))
        })
        .collect();
    let there: Vec<Ray> = rays.iter().flatten().copied().collect();
    let file = match open {
        OpenHeights::Pages(file) => Some(&**file),
        OpenHeights::Source(_) => None,
    };
    let mut found = pick_all(path, open, file, &placed.stands(), &there)?.into_iter();
    // Beside a dome's circle nothing is seen.
    let picks = rays.iter().map(|ray| ray.and_then(|_| found.next()).and_then(Under::of)).collect();
    answer(json, &PixelsAnswer { picks, height_error: open.height_error() }, |text, told| {
        let (places, heights) = (after(&open.grid().xy_unit), after(&open.grid().height_unit));
        for ([x, y], under) in pixels.iter().zip(&told.picks) {
            match under {
                None => writeln!(text, "pixel {x},{y}: beside the field")?,
                Some(under) => {
                    let at = format!("{}, {}{places}", short(under.x), short(under.y));
                    match under.height {
                        Some(height) => writeln!(text, "pixel {x},{y}: {height}{heights} at {at}")?,
                        None => writeln!(text, "pixel {x},{y}: not measured, at {at}")?,
                    }
                    for sample in &under.samples {
                        let SampleUnder { row, column, height } = sample;
                        writeln!(text, "  row {row}, column {column}: {height}{heights}")?;
                    }
                }
            }
        }
        within(open).iter().try_for_each(|within| writeln!(text, "{within}"))
    })
}

/// From where the pixels are seen, and where the field stands.
fn seen(open: &OpenHeights, asked: &HeightsProbe) -> Result<(Sight, Placed), Box<dyn std::error::Error + Send + Sync>> {
    let config = asked.config.as_deref().map(PictureConfig::read).transpose()?.unwrap_or_default();
    let [eye, target, up] = [asked.eye, asked.target, asked.up].map(|at| at.map(|at| at.to_array()));
    let mut shot = Shot {
        camera: config.camera.then(CameraConfig { eye, target, up, fov: asked.fov, ortho: asked.ortho }),
        size: asked.size.map(|size| (size.width, size.height)).or(config.size),
        surround: config.projection.unwrap_or_default(),
        ..Shot::default()
    };
    (shot.surround, shot.stereo) = asked.projection.over(shot.surround, None)?;
    shot.look = config.look;
    if let Some(map) = &asked.map {
        shot.look.settings.0.insert("map".into(), SettingValue::Name(map.clone()));
    }
    let summary = open.summary()?;
    Ok(SurfaceSession::sight(open, [summary.min, summary.max], &shot)?)
}

/// Pixels of a CSV file with the columns x and y.
fn read_pixels(list: &Path) -> Result<Vec<[u32; 2]>, String> {
    let wrong = |why: String| format!("{}: {why}", list.display());
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(list).map_err(|error| wrong(error.to_string()))?;
    let heads = reader.headers().map_err(|error| wrong(error.to_string()))?.clone();
    let column = |name: &str| {
        let found = heads.iter().position(|head| head == name);
        found.ok_or_else(|| wrong(format!("column {name}: missing, expected x and y")))
    };
    let [x, y] = [column("x")?, column("y")?];
    let mut pixels = Vec::new();
    for (number, row) in reader.records().enumerate() {
        let row = row.map_err(|error| wrong(error.to_string()))?;
        let part = |at: usize| {
            let text = row.get(at).unwrap_or_default();
            let found =
                text.parse().map_err(|_| wrong(format!("row {}: found {text:?}, expected a whole number", number + 1)));
            found as Result<u32, String>
        };
        pixels.push([part(x)?, part(y)?]);
    }
    Ok(pixels)
}
