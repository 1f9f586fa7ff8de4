//! Steady exposure: ranges that a still picture finds from itself would flicker from frame to frame. Along a tour they are found at
//! moments a second and a half apart, and follow curves between those.

use crate::commands::drawing::Coloration;
use crate::raster::transfer::{Range, Scale, TransferFunction};
use crate::tour::spline::{cubic, velocity_of_number};
use crate::tour::{Look, Move, Timeline};
use std::collections::HashMap;

/// Seconds between two moments at which ranges are found, at most.
const STEP: f64 = 1.5;

/// Keyframes one after the other that are exposed together: the camera moves without a cut and the same quantity is shown.
#[derive(Clone, Debug, PartialEq)]
struct Run {
    from: f64,
    to: f64,
    /// The last keyframe in it.
    last: usize,
    first: usize,
}

/// The ranges along a tour, found where they are needed.
#[derive(Default)]
pub(super) struct Exposure {
    runs: Vec<Run>,
    found: HashMap<(usize, u32), Coloration>,
}

impl Exposure {
    /// Nothing is found yet.
    pub fn new(timeline: &Timeline) -> Exposure {
        let stops = timeline.stops();
        let mut runs: Vec<Run> = Vec::new();
        for (index, stop) in stops.iter().enumerate() {
            let to = stops.get(index + 1).map_or(stop.leave, |next| next.arrive);
            let look = |index: usize| timeline.look(index, stops[index].arrive);
            match runs.last_mut() {
                Some(run) if stop.motion != Move::Cut && look(run.last).is_measured_like(&look(index)) => {
                    (run.to, run.last) = (to, index);
                }
                _ => runs.push(Run { from: stop.arrive, to, first: index, last: index }),
            }
        }
        Exposure { runs, found: HashMap::new() }
    }

    /// A look after a keyframe as it is at a time, with numbers for ranges that are found from pictures. `measure` draws
    /// the picture at a time, and says what it found.
    ///
    /// # Errors
    /// Those of `measure`.
    pub fn exposed<E>(
        &mut self,
        keyframe: usize,
        time: f64,
        look: &Look,
        mut measure: impl FnMut(f64) -> Result<Coloration, E>,
    ) -> Result<Look, E> {
        let is_auto = |transfer: &TransferFunction| {
            transfer.range == Range::Auto || transfer.hue.as_ref().is_some_and(|hue| hue.range == Range::Auto)
        };
        if look.transfer.as_ref().is_some_and(|transfer| !is_auto(transfer)) {
            return Ok(look.clone());
        }
        let index = self.runs.iter().position(|run| (run.first..=run.last).contains(&keyframe)).unwrap_or(0);
        let Some(run) = self.runs.get(index).cloned() else { return Ok(look.clone()) };
        let steps = ((run.to - run.from) / STEP).ceil().max(1.0);
        let width = (run.to - run.from) / steps;
        // The last moment lies before whatever begins at the end.
        let moment = |step: u32| (run.from + width * f64::from(step)).min((run.to - 1e-6).max(run.from));
        let at = if width > 0.0 { ((time - run.from) / width).clamp(0.0, steps) } else { 0.0 };
        let left = (at.floor() as u32).min(steps as u32 - 1);
        let around = [left.saturating_sub(1), left, left + 1, (left + 2).min(steps as u32)];
        let mut found: Vec<Coloration> = Vec::with_capacity(around.len());
        for step in around {
            let known = match self.found.get(&(index, step)) {
                Some(known) => known.clone(),
                None => {
                    let measured = measure(moment(step))?;
                    self.found.insert((index, step), measured.clone());
                    measured
                }
            };
            found.push(known);
        }
        // Moments long past are not needed again by one who goes on.
        self.found.retain(|(run, step), _| *run + 1 >= index && (*run != index || step + 8 > left));
        Ok(fixed(look, &found, at - f64::from(left)))
    }
}

/// The look with numbers in place of automatic ranges: between `found[1]` and `found[2]` at a share of the way.
fn fixed(look: &Look, found: &[Coloration], share: f64) -> Look {
    let between = |scale: Scale, value: &dyn Fn(&Coloration) -> f64| {
        let log = scale == Scale::Log && found.iter().all(|each| value(each) > 0.0);
        let at = |i: usize| if log { value(&found[i]).ln() } else { value(&found[i]) };
        let slope = |i: usize| at(i + 1) - at(i);
        let speeds = [[0, 1], [1, 2]].map(|[i, j]| velocity_of_number(slope(i), slope(j), [1.0, 1.0]));
        let mixed = cubic([at(1), at(2)], speeds, 1.0, share);
        if log { mixed.exp() } else { mixed }
    };
    let own = &found[1];
    // The transfer function as it is now, or the usual one.
    let mut transfer = look.transfer.clone().unwrap_or_else(|| own.transfer.clone());
    if transfer.range == Range::Auto {
        let [low, high] = [0, 1].map(|k| between(transfer.scale, &|each| each.levels.p[k]));
        if low < high {
            transfer.range = Range::Fixed(low, high);
        }
    }
    if let Some(hue) = &mut transfer.hue
        && hue.range == Range::Auto
    {
        let [low, high] = [0, 1].map(|k| between(hue.scale, &|each| each.levels.s[k]));
        if low < high {
            hue.range = Range::Fixed(low, high);
        }
    }
    let mut look = look.clone();
    look.transfer = Some(transfer);
    look
}
