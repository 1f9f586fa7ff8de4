//! The flight through a volume within a time for each frame, and the picture at rest after it.

use super::super::hierarchies::color_errors;
use super::super::splat::Failure;
use super::path::Flight;
use crate::bench::Arguments;
use crate::color::Colors;
use crate::command_line::arguments::PictureSize;
use crate::command_line::progress_bar::Terminal;
use crate::cpu::Method;
use crate::look::{LookPatch, Shot};
use crate::mode::Raw;
use crate::modes;
use crate::picture::field::in_time::enlarged;
use crate::picture::field::{FieldSession, InTime, PreparedField};
use crate::picture::{PictureError, SessionOptions};
use crate::view::View;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Pictures of the flight that are compared with exact ones, which take two hundred times as long.
const COMPARED: usize = 4;

/// A flight through a volume.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    path: PathBuf,
    mode: &'static str,
    frame_ms: f64,
    points: u64,
    flight: Summary,
    rest: Rest,
}

/// What its frames came to.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Summary {
    frames: usize,
    frame_ms_mean: f64,
    frame_ms_p95: f64,
    frame_ms_p99: f64,
    /// Mean distance of colours from those of the samples at full size, of 255.
    color_error: f64,
    /// Pixels of a frame, mean.
    pixels: f64,
}

/// The picture where the flight ends, in the steps in which it becomes finer.
#[derive(Clone, Debug, Serialize)]
pub struct Rest {
    /// Colour errors of the steps, of 255.
    errors: Vec<f64>,
    /// Whether the last step is the picture at full size.
    converged: bool,
}

/// Flies through a volume.
///
/// # Errors
/// When it cannot be read, or is none.
pub fn measure(arguments: &Arguments, path: &Path) -> Result<Vec<Outcome>, Failure> {
    let options = &arguments.flight;
    let PictureSize { width, height } = options.picture_size();
    let mode = if options.mode().takes_fields() { options.mode() } else { modes::of_fields(3) };
    let shot = Shot { look: LookPatch { mode: Some(mode), ..LookPatch::default() }, ..Shot::default() };
    let open = |exact: Option<Method>| -> Result<FieldSession, PictureError> {
        FieldSession::open(path, SessionOptions { exact, ..SessionOptions::default() }, Arc::new(Terminal))
    };
    let mut session = open(None)?;
    let grid = session.opened().grid();
    if grid.dimensions != 3 {
        return Err(format!("{}: found an image, expected a volume or particles", path.display()).into());
    }
    let flight = Flight::through(grid.bounds(), options.velocity, options.duration, 45_f64.to_radians());
    let prepared = session.prepare(&shot)?;
    drop(session);
    let frame_ms = if options.frame_ms > 0.0 { options.frame_ms } else { f64::INFINITY };
    let mut in_time = InTime::default();
    // What is not measured: memory that is touched for the first time, and what pictures take at all.
    for _ in 0..8 {
        prepared.draw_within(&flight.view(0.0, width, height)?, frame_ms, &mut in_time)?;
    }
    let (mut times, mut pixels, mut kept) = (Vec::new(), 0.0, Vec::new());
    let start = Instant::now();
    let mut now = 0.0;
    while now < flight.seconds {
        let view = flight.view(now, width, height)?;
        let begun = Instant::now();
        let size = in_time.size((width, height), frame_ms);
        let colors = colors_of(prepared.draw_within(&view, frame_ms, &mut in_time)?)?;
        times.push(1e3 * begun.elapsed().as_secs_f64());
        pixels += f64::from(size.0) * f64::from(size.1);
        if kept.len() as f64 <= now / flight.seconds * COMPARED as f64 {
            kept.push((view, colors));
        }
        now = start.elapsed().as_secs_f64();
    }
    let exact = open(Some(Method::Pyramid))?.prepare(&shot)?;
    let mut color_error = 0.0;
    for (view, colors) in &kept {
        color_error += error(colors, &light(&exact, view)?) / kept.len() as f64;
    }
    let rest = rest(&prepared, &exact, &flight.view(flight.seconds, width, height)?)?;
    times.sort_by(f64::total_cmp);
    let share = |share: f64| times[((share * times.len() as f64).ceil() as usize).clamp(1, times.len()) - 1];
    let summary = Summary {
        frames: times.len(),
        frame_ms_mean: times.iter().sum::<f64>() / times.len() as f64,
        frame_ms_p95: share(0.95),
        frame_ms_p99: share(0.99),
        color_error,
        pixels: pixels / times.len() as f64,
    };
    eprintln!(
        "{}: {} frames, {:.1} ms (mean), {:.1} ms (95 %), {:.1} ms (99 %), colours {:.2} of 255 off",
        path.display(),
        summary.frames,
        summary.frame_ms_mean,
        summary.frame_ms_p95,
        summary.frame_ms_p99,
        summary.color_error
    );
    let points = prepared.report.points;
    Ok(vec![Outcome { path: path.into(), mode: mode.name, frame_ms: options.frame_ms, points, flight: summary, rest }])
}

fn light(prepared: &PreparedField, view: &View) -> Result<Colors, Failure> {
    colors_of(prepared.draw(view)?)
}

fn colors_of(drawn: Raw) -> Result<Colors, Failure> {
    match drawn {
        Raw::Light(light) => Ok(light.colors),
        Raw::Sums(..) => Err("bench flight: found a mode of sums, expected volume, isosurface or slice".into()),
    }
}

fn error(colors: &Colors, exact: &Colors) -> f64 {
    color_errors(&colors.image(), &exact.image()).mean
}

/// The view in steps of twice as many pixels along each side, up to all.
fn rest(prepared: &PreparedField, exact: &PreparedField, view: &View) -> Result<Rest, Failure> {
    let truth = light(exact, view)?;
    let mut errors: Vec<f64> = Vec::new();
    for halvings in (0..4).rev() {
        let size = (view.width.div_ceil(1 << halvings), view.height.div_ceil(1 << halvings));
        let step = enlarged(&light(prepared, &view.resized(size.0, size.1))?, (view.width, view.height));
        errors.push(error(&step, &truth));
    }
    Ok(Rest { errors, converged: true })
}
