//! Particles that a velocity field carries along, at even times: pathlines of an unsteady field, streamlines of a steady one.

use super::field::{FieldOptions, VectorField};
use super::frames::{Common, FrameWriter};
use super::interval::Interval;
use super::particle::{End, State};
use super::seeds::{Seeded, Seeds};
use crate::import::ImportError;
use crate::import::run::{Run, RunStep};
use crate::model::{ClockVariable, Progress, ReadMethod};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Particles that are traced.
pub const DEFAULT_SEEDS: u64 = 20_000;
/// Times at which they are kept.
pub const DEFAULT_STEPS: usize = 61;
/// The error of a step, cells.
pub const DEFAULT_TOLERANCE: f64 = 1e-8;
/// Longest sides of a steady field that particles of mean speed go.
const SIDES: f64 = 2.0;
/// The support of a particle's kernel, mean distances: that of about 32 neighbours is 1.97, and wide enough that evenly spread ones add up
/// to an even density.
const SUPPORT: f64 = 2.2;

/// What is traced.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceOptions {
    /// How the field is read.
    pub field: FieldOptions,
    /// Where particles begin.
    pub seeds: Seeds,
    /// At how many times they are kept, the first and the last among them; at least 2.
    pub steps: usize,
    /// When they begin; `None`: with the field, in a steady one at 0.
    pub start: Option<f64>,
    /// How long they go; `None`: as long as the field is; in a steady one as long as a particle of mean speed takes for twice its longest
    /// side.
    pub duration: Option<f64>,
    /// Takes the field for a steady one, as it is at that time.
    pub instant: Option<f64>,
    /// The error of a step, cells; positive.
    pub tolerance: f64,
}

impl Default for TraceOptions {
    fn default() -> TraceOptions {
        TraceOptions {
            field: FieldOptions::default(),
            seeds: Seeds::Spread { count: DEFAULT_SEEDS, within: None, random: 0 },
            steps: DEFAULT_STEPS,
            start: None,
            duration: None,
            instant: None,
            tolerance: DEFAULT_TOLERANCE,
        }
    }
}

/// Traces particles through the field in `files` (one, or one for each of its times), as a run whose steps are the times at which they are
/// kept. Particles that leave the field, or come to where it has no velocity, are in no later step. The run is the same for any number of
/// threads; steps beyond some MiB lie in a temporary file until it is dropped.
///
/// # Errors
/// [`ImportError`] where the field cannot be read, has no such times, or no particle is in two steps.
pub fn trace(
    files: &[PathBuf],
    options: &TraceOptions,
    method: ReadMethod,
    progress: &dyn Progress,
) -> Result<Run, ImportError> {
    let field = VectorField::open(files, &options.field, method)?;
    let wrong =
        |what: &str, found: String, expected: &str| Err(ImportError::malformed(field.path(), what, found, expected));
    if options.steps < 2 {
        return wrong("--steps", options.steps.to_string(), "2 at least");
    }
    let still = match options.instant {
        Some(time) => {
            let slab = field.interval(time)?.at(time);
            Some(Interval::steady(field.axes(), Arc::new(slab)))
        }
        None if field.times().len() == 1 => Some(field.interval(0.0)?),
        None => None,
    };
    let times = times(&field, still.as_ref(), options)?;
    let begin = times.first().copied().unwrap_or(0.0);
    let mut interval = match &still {
        Some(still) => still.clone(),
        None => field.interval(begin)?,
    };
    let Seeded { mut particles, volume, spacing, asked } = options.seeds.begin(&field, &interval)?;
    let mut notes = field.notes().to_vec();
    let count = particles.len() as u64;
    notes.push(format!("{count} particles traced through {}", field.described()));
    if count < asked {
        notes.push(format!("{} seeds are where the field has no velocity", asked - count));
    }
    let edge = field.periodic_edge();
    let corner = if edge.is_some() { field.bounds().min.to_array() } else { [0.0; 3] };
    if corner != [0.0; 3] {
        notes.push(format!(
            "the corner of the periodic box, at {}, {}, {}, is the origin",
            corner[0], corner[1], corner[2]
        ));
    }
    if edge.is_none() && options.field.periodic.contains(&true) {
        notes.push("the periodic box is no cube: particles go on beyond its faces".into());
    }
    let mut writer = FrameWriter::new(Common {
        path: field.path().to_owned(),
        bytes: field.bytes(),
        length_unit: field.length_unit().clone(),
        velocity_unit: field.velocity_unit(),
        box_size: edge,
        mass: volume,
        smoothing_length: SUPPORT * spacing,
        density: volume / spacing.powi(3),
    });
    progress.begin(&format!("tracing {count} particles"), times.len() as u64);
    let mut now = begin;
    let mut kept = 0;
    for &time in &times {
        while now < time {
            if still.is_none() && now >= interval.times()[1] {
                interval = field.interval(now)?;
            }
            let until = time.min(interval.times()[1]);
            let here = &interval;
            particles.par_iter_mut().for_each(|particle| particle.advance(here, now, until, options.tolerance));
            now = until;
        }
        let states: Vec<State> = particles.par_iter().filter_map(|particle| particle.state(&interval, time)).collect();
        if states.is_empty() {
            break;
        }
        writer.add(time, &states, corner)?;
        kept += 1;
        progress.advance(1);
    }
    if kept < 2 {
        return wrong("--duration", "no particle at the second step".into(), "less of it, or more --steps");
    }
    if kept < times.len() {
        notes.push(format!("no particle is left after step {}", kept - 1));
    }
    for (end, what) in [
        (End::Left, "leave the field's box"),
        (End::Void, "come to where it has no velocity"),
        (End::Lost, "are given up, as they go through too many cells within a step"),
    ] {
        let ended = particles.par_iter().filter(|particle| particle.end == Some(end)).count();
        if ended > 0 {
            notes.push(format!("{ended} particles {what}"));
        }
    }
    let step = |frame: super::Frame| {
        let about = frame.description();
        let time = about.time.unwrap_or_default();
        RunStep { about, time, clock: time, length: 1.0, mass: 1.0, frame: Some(frame) }
    };
    let steps = writer.finish()?.into_iter().map(step).collect();
    Ok(Run { steps, left_out: Vec::new(), clock: ClockVariable::Time, is_timed_by_headers: true, notes })
}

/// The times at which particles are kept.
fn times(field: &VectorField, still: Option<&Interval>, options: &TraceOptions) -> Result<Vec<f64>, ImportError> {
    let own = field.times();
    let wrong =
        |what: &str, found: f64, expected: String| Err(ImportError::malformed(field.path(), what, found, expected));
    let (start, end) = match (still, own) {
        (None, [first, .., last]) => {
            let start = options.start.unwrap_or(*first);
            if !(*first..*last).contains(&start) {
                return wrong("--start", start, format!("a time from {first} to before {last}, as the field has"));
            }
            let end = options.duration.map_or(*last, |duration| start + duration);
            // The end of the field may be a rounding away.
            let slack = 1e-9 * (last - first);
            if end > *last + slack {
                let expected = format!("{} at most, as the field ends at {last}", last - start);
                return wrong("--duration", end - start, expected);
            }
            (start, end.min(*last))
        }
        (still, _) => {
            let start = options.start.unwrap_or(0.0);
            let usual = || still.map_or(Ok(1.0), |still| crossing(field, still));
            (start, start + options.duration.map_or_else(usual, Ok)?)
        }
    };
    let last = options.steps - 1;
    let at = |step: usize| if step == last { end } else { start + (end - start) * (step as f64 / last as f64) };
    let times: Vec<f64> = (0..=last).map(at).collect();
    if !(start.is_finite() && end.is_finite() && times.windows(2).all(|pair| pair[0] < pair[1])) {
        return wrong("--duration", end - start, format!("enough for {} times from {start} on", options.steps));
    }
    Ok(times)
}

/// How long a particle of mean speed takes for the longest sides of a steady field.
fn crossing(field: &VectorField, still: &Interval) -> Result<f64, ImportError> {
    let speeds = still
        .at(0.0)
        .into_iter()
        .map(|velocity| velocity.map(|part| f64::from(part).powi(2)).iter().sum::<f64>().sqrt());
    let (sum, count) =
        speeds.filter(|speed| speed.is_finite()).fold((0.0, 0_u64), |(sum, count), speed| (sum + speed, count + 1));
    let time = SIDES * field.bounds().size().max_element() * count as f64 / sum;
    if !(time > 0.0 && time.is_finite()) {
        let expected = "some that differ from 0, or --duration";
        return Err(ImportError::malformed(field.path(), "velocities", "none that moves", expected));
    }
    Ok(time)
}
