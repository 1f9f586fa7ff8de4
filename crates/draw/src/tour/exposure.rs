//! Steady exposure: ranges that a still picture finds from itself would flicker from frame to frame. Along a tour they are found at
//! moments a second and a half apart, and follow curves between those: the same ones in a recording and in the window.
//!
//! An eye that adapts ([`ExposureMode::Adaptive`]) follows what is found at moments half a second apart, along straight lines. Its state at a time is
//! reckoned anew from a moment that lies eight time constants before, or from the last moment at which something else was shown: so it depends on
//! nothing but the tour's time, whichever frames are drawn, in whatever order.

use super::adaptation::Eye;
use super::spline::{cubic, velocity_of_number};
use super::{Move, Timeline};
use crate::color::ExposureMode;
use crate::color::transfer::{Levels, Range, Scale, TransferFunction};
use crate::look::LookPatch;
use crate::picture::ranges::Measured;
use std::collections::HashMap;

/// Seconds between two moments at which ranges are found, at most.
const STEP: f64 = 1.5;

/// The same for an eye that adapts.
const EYE_STEP: f64 = 0.5;

/// Keyframes one after the other that are exposed together: the camera moves without a cut and the same quantity is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    from: f64,
    to: f64,
    first: usize,
    /// The last keyframe in it.
    last: usize,
    mode: ExposureMode,
    /// Whether the same quantity is shown as in the run before, to an eye that is still adapted to that.
    goes_on: bool,
}

/// A part of a run along which an eye adapts.
struct Passage {
    run: usize,
    /// The moments that it begins with and that it ends behind.
    steps: [u32; 2],
    /// When it ends, seconds.
    until: f64,
}

/// One of the two ranges.
type RangeOf = fn(&Levels) -> [f64; 2];

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
        let step = if self.eye().is_some() { EYE_STEP } else { STEP };
        let steps = ((self.to - self.from) / step).ceil().max(1.0);
        (steps as u32, (self.to - self.from) / steps)
    }

    /// The moment at or before a time, and how far it is from there to the next.
    fn place(&self, time: f64) -> (u32, f64) {
        let (steps, width) = self.steps();
        let at = if width > 0.0 { ((time - self.from) / width).clamp(0.0, f64::from(steps)) } else { 0.0 };
        let left = (at.floor() as u32).min(steps - 1);
        (left, at - f64::from(left))
    }

    /// The eye that adapts, where one does.
    fn eye(&self) -> Option<Eye> {
        match self.mode {
            ExposureMode::Adaptive { bright, dark } => Some(Eye { bright, dark }),
            ExposureMode::Steady | ExposureMode::Fixed | ExposureMode::Auto => None,
        }
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
            let mode = look(index).exposure.unwrap_or_default();
            let is_same = |run: &Run| run.mode == mode && look(run.last).is_measured_like(&look(index));
            match runs.last_mut() {
                Some(run) if stop.motion != Move::Cut && is_same(run) => (run.to, run.last) = (to, index),
                last => {
                    let goes_on = last.is_some_and(|run| run.eye().is_some() && is_same(run));
                    runs.push(Run { from: stop.arrive, to, first: index, last: index, mode, goes_on });
                }
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
        let (run, own) = self.run_of(keyframe)?;
        let (left, share) = own.place(time);
        let around = [left.saturating_sub(1), left, left + 1, (left + 2).min(own.steps().0)];
        Some((around.map(|step| Moment { run, step }), share))
    }

    /// The run that a keyframe is in, and its index.
    fn run_of(&self, keyframe: usize) -> Option<(usize, &Run)> {
        let run = self.runs.iter().position(|run| (run.first..=run.last).contains(&keyframe)).unwrap_or(0);
        Some((run, self.runs.get(run)?))
    }

    /// The moments on whose ranges those of a time after a keyframe depend, in order of time.
    pub fn needed(&self, keyframe: usize, time: f64) -> Vec<Moment> {
        let Some((run, own)) = self.run_of(keyframe) else { return Vec::new() };
        match (own.mode, own.eye()) {
            (_, Some(eye)) => {
                let moments = |Passage { run, steps: [first, last], .. }: Passage| {
                    (first..=last).map(move |step| Moment { run, step })
                };
                self.passages(run, time, eye).into_iter().flat_map(moments).collect()
            }
            (ExposureMode::Fixed, _) => vec![Moment { run, step: 0 }],
            _ => self.around(keyframe, time).map_or_else(Vec::new, |(around, _)| around.to_vec()),
        }
    }

    /// The way along which an eye has adapted at a time in a run. It begins at a moment, so that it is the same for all times up to the next.
    fn passages(&self, run: usize, time: f64, eye: Eye) -> Vec<Passage> {
        let mut passages = Vec::new();
        let mut seconds = eye.memory();
        let (mut run, mut until) = (run, time);
        while let Some(own) = self.runs.get(run) {
            let (left, width) = (own.place(until).0, own.steps().1);
            let back = if width > 0.0 { (seconds.max(0.0) / width).ceil() as u32 } else { left };
            let first = left.saturating_sub(back);
            passages.push(Passage { run, steps: [first, left + 1], until: until.min(own.to) });
            seconds -= f64::from(left + 1 - first) * width;
            if first > 0 || seconds <= 0.0 || !own.goes_on || run == 0 {
                break;
            }
            run -= 1;
            until = self.runs[run].to;
        }
        passages.reverse();
        passages
    }

    /// The range that an eye is adapted to at the end of these passages; `None` where something on the way is not known.
    fn adapted(&self, passages: &[Passage], eye: Eye, scale: Scale, of: RangeOf) -> Option<[f64; 2]> {
        let found = |run: usize, step: u32| self.found.get(&Moment { run, step }).map(|found| of(&found.levels));
        let mut log = scale == Scale::Log;
        for Passage { run, steps: [first, last], .. } in passages {
            for step in *first..=*last {
                log &= found(*run, step)?[0] > 0.0;
            }
        }
        let forth = |range: [f64; 2]| if log { range.map(f64::ln) } else { range };
        let mut state: Option<[f64; 2]> = None;
        for Passage { run, steps: [first, last], until } in passages {
            let own = self.runs.get(*run)?;
            let width = own.steps().1;
            for step in *first..*last {
                let [from, to] = [forth(found(*run, step)?), forth(found(*run, step + 1)?)];
                let seconds = (until - own.from - width * f64::from(step)).clamp(0.0, width.max(0.0));
                state = Some(eye.follow(state.unwrap_or(from), from, to, (width, seconds)));
            }
        }
        let state = state?;
        Some(if log { state.map(f64::exp) } else { state })
    }

    /// All moments at which the tour's looks leave ranges to be found, in order of time.
    pub fn moments(&self, timeline: &Timeline) -> Vec<Moment> {
        let last = |run: &Run| if run.mode == ExposureMode::Fixed { 0 } else { run.steps().0 };
        let all = self.runs.iter().enumerate().flat_map(|(run, own)| (0..=last(own)).map(move |step| (run, step)));
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

    /// Forgets what nobody needs who needs nothing before a moment and goes on.
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

    /// What was measured near a time after a keyframe, where all is known that ranges then depend on.
    pub fn measured(&self, keyframe: usize, time: f64) -> Option<&Measured> {
        let needed = self.needed(keyframe, time);
        let known = needed.iter().all(|moment| self.knows(*moment));
        self.found.get(needed.last()?).filter(|_| known)
    }

    /// A look after a keyframe as it is at a time, with numbers for ranges that are found from pictures; `None` before they are
    /// known.
    pub fn exposed(&self, keyframe: usize, time: f64, look: &LookPatch) -> Option<LookPatch> {
        if !is_searched(look) {
            return Some(look.clone());
        }
        let Some((run, own)) = self.run_of(keyframe) else { return Some(look.clone()) };
        let usual = &self.measured(keyframe, time)?.transfer;
        if let Some(eye) = own.eye() {
            let passages = self.passages(run, time, eye);
            // All is known that is asked for here.
            let range = |scale, of: RangeOf| self.adapted(&passages, eye, scale, of).unwrap_or_default();
            return Some(numbered(look, usual, range));
        }
        if own.mode == ExposureMode::Fixed {
            let first = self.found.get(&Moment { run, step: 0 })?;
            return Some(numbered(look, usual, |_, of| of(&first.levels)));
        }
        let (around, share) = self.around(keyframe, time)?;
        let [a, b, c, d] = around.map(|moment| self.found.get(&moment));
        let found = [a?, b?, c?, d?];
        Some(numbered(look, usual, |scale, of| between(found.map(|found| of(&found.levels)), scale, share)))
    }
}

/// Whether a look leaves ranges to be found from other pictures than its own.
pub fn is_searched(look: &LookPatch) -> bool {
    if look.exposure == Some(ExposureMode::Auto) {
        return false;
    }
    let is_auto = |transfer: &TransferFunction| {
        transfer.range == Range::Auto || transfer.hue.as_ref().is_some_and(|hue| hue.range == Range::Auto)
    };
    look.transfer.as_ref().is_none_or(is_auto)
}

/// A range on the curve through four: between the second and the third at a share of the way.
fn between(found: [[f64; 2]; 4], scale: Scale, share: f64) -> [f64; 2] {
    [0, 1].map(|k| {
        let log = scale == Scale::Log && found.iter().all(|range| range[k] > 0.0);
        let at = |i: usize| if log { found[i][k].ln() } else { found[i][k] };
        let slope = |i: usize| at(i + 1) - at(i);
        let speeds = [[0, 1], [1, 2]].map(|[i, j]| velocity_of_number(slope(i), slope(j), [1.0, 1.0]));
        let mixed = cubic([at(1), at(2)], speeds, 1.0, share);
        if log { mixed.exp() } else { mixed }
    })
}

/// The look with numbers in place of automatic ranges, of its transfer function or the usual one.
fn numbered(look: &LookPatch, usual: &TransferFunction, range: impl Fn(Scale, RangeOf) -> [f64; 2]) -> LookPatch {
    let mut transfer = look.transfer.clone().unwrap_or_else(|| usual.clone());
    if transfer.range == Range::Auto {
        let [low, high] = range(transfer.scale, |levels| levels.p);
        if low < high {
            transfer.range = Range::Fixed(low, high);
        }
    }
    if let Some(hue) = &mut transfer.hue
        && hue.range == Range::Auto
    {
        let [low, high] = range(hue.scale, |levels| levels.s);
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
    use crate::model::Bounds;
    use crate::modes;
    use crate::tour::{Keyframe, Surroundings, TourFile};
    use glam::DVec3;

    /// Two runs: the second begins with another mode at 10 s.
    fn timeline(label: Option<&str>) -> Timeline {
        timeline_of(label, None)
    }

    /// The same with another exposure.
    fn timeline_of(label: Option<&str>, exposure: Option<ExposureMode>) -> Timeline {
        let keyframe = |at, orbit| Keyframe { at: Some(at), orbit, ..Keyframe::default() };
        let tour = TourFile::new(vec![
            Keyframe {
                label: label.map(str::to_owned),
                look: LookPatch { exposure, ..LookPatch::default() },
                ..keyframe(0.0, 0.0)
            },
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

    /// Knows that the upper end is 100 before a time and `after` from then on.
    fn stepped(timeline: &Timeline, moments: &[Moment], (at, after): (f64, f64)) -> Exposure {
        let mut exposure = Exposure::new(timeline);
        for moment in moments {
            let high = if exposure.time(*moment) < at { 100.0 } else { after };
            exposure.take(*moment, measured(high));
        }
        exposure
    }

    #[test]
    fn an_eye_adapts_by_its_time_constants_whatever_frames_are_drawn() {
        let (bright, dark) = (0.3, 0.6);
        let timeline = timeline_of(None, Some(ExposureMode::Adaptive { bright, dark }));
        let moments = Exposure::new(&timeline).moments(&timeline);
        for (after, tau) in [(1e4, bright), (10.0, dark)] {
            let mut exposure = stepped(&timeline, &moments, (2.0, after));
            let at = |exposure: &Exposure, time: f64| {
                let state = timeline.state(time);
                exposure.exposed(state.keyframe, time, &state.look).map(|look| high(&look))
            };
            let whole: Vec<f64> = (0..=290).map(|frame| at(&exposure, f64::from(frame) / 30.0).unwrap()).collect();
            assert!((whole[30] / 100.0 - 1.0).abs() < 1e-9, "before anything changes it is what is found");
            // From when the new light is there on it is an exponential, on the scale's logarithm.
            let left = |time: f64| (at(&exposure, time).unwrap() / after).ln();
            for time in [2.4, 3.0, 4.1] {
                let expected = left(2.2) * f64::exp(-(time - 2.2) / tau);
                assert!((left(time) - expected).abs() < 1e-6, "{time}: {} {expected}", left(time));
            }
            // In the end it is what each picture finds itself.
            assert!((whole[285] / after - 1.0).abs() < 0.01, "{}", whole[285]);
            // Frames of a part, from the moments alone that they need, and going on forgets none of these.
            let mut part = Exposure::new(&timeline);
            for frame in 200..=290u32 {
                let time = f64::from(frame) / 30.0;
                let needed = part.needed(timeline.state(time).keyframe, time);
                for moment in &needed {
                    if !part.knows(*moment) {
                        part.take(*moment, exposure.found[moment].clone());
                    }
                }
                assert_eq!(at(&part, time).unwrap().to_bits(), whole[frame as usize].to_bits(), "{frame}");
                part.forget_before(needed[0]);
            }
            exposure.forget_before(Moment { run: 0, step: 19 });
            assert_eq!(at(&exposure, 0.1), None);
        }
    }

    #[test]
    fn what_is_fixed_stays_and_what_is_automatic_is_left_to_each_picture() {
        let fixed = timeline_of(None, Some(ExposureMode::Fixed));
        let moments = Exposure::new(&fixed).moments(&fixed);
        let exposure = stepped(&fixed, &moments, (0.5, 1e4));
        for time in [0.0, 3.0, 9.9] {
            let state = fixed.state(time);
            assert_eq!(high(&exposure.exposed(state.keyframe, time, &state.look).unwrap()), 100.0);
            assert_eq!(exposure.needed(state.keyframe, time).len(), 1);
        }
        let auto = timeline_of(None, Some(ExposureMode::Auto));
        let exposure = Exposure::new(&auto);
        assert!(exposure.moments(&auto).is_empty());
        let state = auto.state(3.0);
        assert_eq!(exposure.exposed(state.keyframe, 3.0, &state.look), Some(state.look));
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
