//! Steady exposure: ranges that a still picture finds from itself would flicker from frame to frame. Along a tour they are found at
//! moments a second and a half apart, and follow curves between those: the same ones in a recording and in the window.

use super::spline::{cubic, velocity_of_number};
use super::{Move, Timeline};
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::look::LookPatch;
use crate::picture::ranges::Measured;
use std::collections::HashMap;

/// Seconds between two moments at which ranges are found, at most.
const STEP: f64 = 1.5;

/// Keyframes one after the other that are exposed together: the camera moves without a cut and the same quantity is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    from: f64,
    to: f64,
    first: usize,
    /// The last keyframe in it.
    last: usize,
}

/// A moment at which ranges are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Moment {
    run: usize,
    step: u32,
}

/// The ranges along a tour, as far as they are known.
#[derive(Clone, Debug, Default)]
pub struct Exposure {
    runs: Vec<Run>,
    found: HashMap<Moment, Measured>,
}

impl Run {
    /// How many steps it has, and how long each is, seconds.
    fn steps(&self) -> (u32, f64) {
        let steps = ((self.to - self.from) / STEP).ceil().max(1.0);
        (steps as u32, (self.to - self.from) / steps)
    }
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

    /// When a moment is, seconds. The last one of a run lies before whatever begins at its end.
    pub fn time(&self, moment: Moment) -> f64 {
        let Some(run) = self.runs.get(moment.run) else { return 0.0 };
        (run.from + run.steps().1 * f64::from(moment.step)).min((run.to - 1e-6).max(run.from))
    }

    /// The moments on whose ranges those of a time after a keyframe depend, and how far it is from the second to the third.
    pub fn around(&self, keyframe: usize, time: f64) -> Option<([Moment; 4], f64)> {
        let run = self.runs.iter().position(|run| (run.first..=run.last).contains(&keyframe)).unwrap_or(0);
        let (steps, width) = self.runs.get(run)?.steps();
        let at = if width > 0.0 { ((time - self.runs[run].from) / width).clamp(0.0, f64::from(steps)) } else { 0.0 };
        let left = (at.floor() as u32).min(steps - 1);
        let around = [left.saturating_sub(1), left, left + 1, (left + 2).min(steps)];
        Some((around.map(|step| Moment { run, step }), at - f64::from(left)))
    }

    /// All moments at which the tour's looks leave ranges to be found, in order of time.
    pub fn moments(&self, timeline: &Timeline) -> Vec<Moment> {
        let all = self.runs.iter().enumerate().flat_map(|(run, own)| (0..=own.steps().0).map(move |step| (run, step)));
        let all = all.map(|(run, step)| Moment { run, step });
        let searched = |moment: &Moment| {
            let run = self.runs[moment.run];
            let mut looks =
                (run.first..=run.last).map(|keyframe| timeline.look(keyframe, timeline.stops()[keyframe].arrive));
            looks.any(|look| is_searched(&look))
        };
        all.filter(searched).collect()
    }

    /// Whether a moment's ranges are known.
    pub fn knows(&self, moment: Moment) -> bool {
        self.found.contains_key(&moment)
    }

    /// Takes what was found at a moment.
    pub fn take(&mut self, moment: Moment, measured: Measured) {
        self.found.insert(moment, measured);
    }

    /// Forgets what nobody needs who is at a moment and goes on.
    pub fn forget_before(&mut self, now: Moment) {
        self.found.retain(|at, _| at.run + 1 >= now.run && (at.run != now.run || at.step + 8 > now.step));
    }

    /// Takes over what another tour's exposure knows of the same times, where `same` says that the same is shown then.
    pub fn keep(&mut self, before: &Exposure, timeline: &Timeline, same: impl Fn(f64) -> bool) {
        let known: Vec<(f64, &Measured)> = before.found.iter().map(|(at, found)| (before.time(*at), found)).collect();
        for moment in self.moments(timeline) {
            let time = self.time(moment);
            let found = known.iter().find(|(at, _)| (at - time).abs() < 1e-9);
            if let Some((_, found)) = found.filter(|_| same(time)) {
                self.found.insert(moment, Measured::clone(found));
            }
        }
    }

    /// What was measured at the moment before a time after a keyframe, where all is known that ranges then depend on.
    pub fn measured(&self, keyframe: usize, time: f64) -> Option<&Measured> {
        let (around, _) = self.around(keyframe, time)?;
        let known = around.iter().all(|moment| self.knows(*moment));
        self.found.get(&around[1]).filter(|_| known)
    }

    /// A look after a keyframe as it is at a time, with numbers for ranges that are found from pictures; `None` before they are
    /// known.
    pub fn exposed(&self, keyframe: usize, time: f64, look: &LookPatch) -> Option<LookPatch> {
        if !is_searched(look) {
            return Some(look.clone());
        }
        let Some((around, share)) = self.around(keyframe, time) else { return Some(look.clone()) };
        let [a, b, c, d] = around.map(|moment| self.found.get(&moment));
        Some(fixed(look, [a?, b?, c?, d?], share))
    }
}

/// Whether a look leaves ranges to be found from its pictures.
pub fn is_searched(look: &LookPatch) -> bool {
    let is_auto = |transfer: &TransferFunction| {
        transfer.range == Range::Auto || transfer.hue.as_ref().is_some_and(|hue| hue.range == Range::Auto)
    };
    look.transfer.as_ref().is_none_or(is_auto)
}

/// The look with numbers in place of automatic ranges: between `found[1]` and `found[2]` at a share of the way.
fn fixed(look: &LookPatch, found: [&Measured; 4], share: f64) -> LookPatch {
    let between = |scale: Scale, value: &dyn Fn(&Measured) -> f64| {
        let log = scale == Scale::Log && found.iter().all(|each| value(each) > 0.0);
        let at = |i: usize| if log { value(found[i]).ln() } else { value(found[i]) };
        let slope = |i: usize| at(i + 1) - at(i);
        let speeds = [[0, 1], [1, 2]].map(|[i, j]| velocity_of_number(slope(i), slope(j), [1.0, 1.0]));
        let mixed = cubic([at(1), at(2)], speeds, 1.0, share);
        if log { mixed.exp() } else { mixed }
    };
    // The transfer function as it is now, or the usual one.
    let mut transfer = look.transfer.clone().unwrap_or_else(|| found[1].transfer.clone());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::Levels;
    use crate::model::Bounds;
    use crate::modes;
    use crate::tour::{Keyframe, Surroundings, TourFile};
    use glam::DVec3;

    /// Two runs: the second begins with another mode at 10 s.
    fn timeline(label: Option<&str>) -> Timeline {
        let keyframe = |at, orbit| Keyframe { at: Some(at), orbit, ..Keyframe::default() };
        let tour = TourFile::new(vec![
            Keyframe { label: label.map(str::to_owned), ..keyframe(0.0, 0.0) },
            keyframe(6.0, 40.0),
            Keyframe {
                look: LookPatch { mode: crate::modes::find("points"), ..LookPatch::default() },
                ..keyframe(10.0, 20.0)
            },
            keyframe(12.0, 20.0),
        ]);
        let framed = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        let surroundings = Surroundings {
            file: "test".into(),
            text: String::new(),
            folder: "".into(),
            framed,
            aspect: 1.5,
            times: None,
            data: None,
        };
        Timeline::new(&tour, &surroundings).unwrap()
    }

    fn measured(high: f64) -> Measured {
        let levels = Levels { p: [1.0, high], s: [0.0, 1.0] };
        Measured { mode: modes::first(), attribute: None, transfer: TransferFunction::default(), levels }
    }

    fn high(look: &LookPatch) -> f64 {
        match look.transfer.as_ref().unwrap().range {
            Range::Fixed(_, high) => high,
            Range::Auto => panic!("no numbers"),
        }
    }

    #[test]
    fn ranges_follow_a_curve_through_what_was_found() {
        let timeline = timeline(None);
        let mut exposure = Exposure::new(&timeline);
        let moments = exposure.moments(&timeline);
        let times: Vec<f64> = moments.iter().map(|moment| exposure.time(*moment)).collect();
        assert!(times.is_sorted() && times[0] == 0.0 && times.len() == 8 + 3, "{times:?}");
        assert!(times.iter().filter(|time| (9.9..10.0).contains(*time)).count() == 1, "the end of the first run");
        let state = timeline.state(4.0);
        assert!(exposure.exposed(state.keyframe, 4.0, &state.look).is_none(), "nothing is known");
        // Only what is needed.
        let (around, _) = exposure.around(state.keyframe, 4.0).unwrap();
        around.iter().for_each(|moment| exposure.take(*moment, measured(100.0 * 2f64.powf(exposure.time(*moment)))));
        let found = high(&exposure.exposed(state.keyframe, 4.0, &state.look).unwrap());
        assert!((found / (100.0 * 16.0) - 1.0).abs() < 1e-3, "{found}");
        assert!(exposure.exposed(state.keyframe, 0.5, &state.look).is_none());
        // At a moment, it is what was found there.
        let time = exposure.time(around[1]);
        let found = high(&exposure.exposed(state.keyframe, time, &state.look).unwrap());
        assert!((found / (100.0 * 2f64.powf(time)) - 1.0).abs() < 1e-9);
        // Numbers stay what they are.
        let transfer = TransferFunction { range: Range::Fixed(3.0, 5.0), ..TransferFunction::default() };
        let set = LookPatch { transfer: Some(transfer), ..state.look };
        assert_eq!(exposure.exposed(3, 11.0, &set).as_ref(), Some(&set));
        // A picture that blends from the run before has the ranges of that run's end.
        moments.iter().for_each(|moment| exposure.take(*moment, measured(10.0 + exposure.time(*moment))));
        let before = timeline.look(1, 10.0);
        assert!((high(&exposure.exposed(1, 11.5, &before).unwrap()) - 20.0).abs() < 1e-4);
        let (last, _) = exposure.around(3, 12.0).unwrap();
        exposure.forget_before(last[1]);
        assert!(exposure.exposed(3, 12.0, &timeline.look(3, 12.0)).is_some());
    }

    #[test]
    fn an_edit_that_changes_no_picture_forgets_nothing() {
        let (old, new) = (timeline(None), timeline(Some("begin")));
        let mut exposure = Exposure::new(&old);
        exposure.moments(&old).iter().for_each(|moment| exposure.take(*moment, measured(9.0)));
        let mut kept = Exposure::new(&new);
        let same = |time: f64| old.state(time).camera == new.state(time).camera && time < 7.0;
        kept.keep(&exposure, &new, same);
        let known = kept.moments(&new).into_iter().filter(|moment| kept.knows(*moment)).count();
        assert_eq!(known, kept.moments(&new).iter().filter(|moment| kept.time(**moment) < 7.0).count());
    }
}
