//! Long tracks in the place of the chains that they stand for: what is drawn over 2, 4, 8, ... intervals as one curve.
//!
//! The tracks of single intervals are chosen first ([`super::levels`]); then those whose whole chain was chosen give way to a long track,
//! the longest that is near enough to them in the picture. So a long track is drawn where its parts would have been, and nobody twice.

use super::kept::Held;
use super::levels::{ENOUGH, Level, bounds_of};
use super::{Choice, Chosen, PathLayer};
use crate::cpu::paths::{Curves, Part};
use crate::hierarchy::spacetime::{HermiteSpline, LongTrack, Stretch, recorded_error};
use crate::mode::{PathColor, PathSettings};
use crate::picture::PictureError;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// How far opacity and place in time, which change evenly along a curve, may be from those of the tracks over single intervals.
const EVEN: f32 = 1.0 / 64.0;

/// The long tracks of a level over a stretch.
pub(super) struct Long {
    tracks: Vec<LongTrack>,
    curves: Arc<Curves>,
    /// The first and the last track of each one's chain.
    ends: Vec<[u32; 2]>,
}

impl Held for Long {
    fn memory(&self) -> u64 {
        self.curves.memory() + (size_of_val(&self.tracks[..]) + size_of_val(&self.ends[..])) as u64
    }
}

/// What a picture shows of a level over a stretch.
struct Shown {
    /// Of one interval, its place among what was chosen.
    chosen: Option<usize>,
    /// Long tracks, of two intervals and more.
    long: Option<Arc<Long>>,
    /// Which tracks may be drawn: all of their chain was chosen.
    live: Vec<bool>,
    /// Which of these are part of longer ones.
    is_part: Vec<bool>,
}

impl Shown {
    fn new(chosen: Option<usize>, long: Option<Arc<Long>>, live: Vec<bool>) -> Shown {
        Shown { chosen, long, is_part: vec![false; live.len()], live }
    }

    /// The numbers of the tracks that are drawn.
    fn drawn(&self) -> Vec<u32> {
        let is_drawn = self.live.iter().zip(&self.is_part).map(|(live, is_part)| *live && !is_part);
        (0..).zip(is_drawn).filter(|(_, is_drawn)| *is_drawn).map(|(i, _)| i).collect()
    }
}

/// Whether long tracks show what is asked for. Attributes have values at each step, and highlights a place in each interval.
pub(super) fn are_wanted(settings: &PathSettings) -> bool {
    settings.run == 0.0 && !matches!(settings.colored_by(), PathColor::Attribute(_))
}

impl PathLayer {
    /// Puts long tracks in the place of chains of tracks of a family that were chosen.
    pub(super) fn lengthen(
        &mut self,
        choice: &Choice<'_>,
        family: u32,
        chosen: &mut Vec<Chosen>,
    ) -> Result<(), PictureError> {
        if !are_wanted(choice.request.settings) {
            return Ok(());
        }
        // Of each level the intervals that are drawn from their beginning to their end.
        let mut levels: BTreeMap<u32, BTreeMap<usize, usize>> = BTreeMap::new();
        for (i, own) in chosen.iter().enumerate() {
            let [_, of, level, _] = own.place;
            if of == family && level > 0 && own.part.u == [0.0, 1.0] {
                levels.entry(level).or_default().insert(own.part.interval, i);
            }
        }
        for (level, whole) in levels {
            self.lengthen_level(choice, [family, level], &whole, chosen)?;
        }
        Ok(())
    }

    /// The same of one level; `whole`: the places of intervals in `chosen`.
    fn lengthen_level(
        &mut self,
        choice: &Choice<'_>,
        [family, level]: [u32; 2],
        whole: &BTreeMap<usize, usize>,
        chosen: &mut Vec<Chosen>,
    ) -> Result<(), PictureError> {
        let error = self.run.flow_errors().get(level as usize - 1).copied().unwrap_or(0.0);
        let mut shown: HashMap<Stretch, Shown> = HashMap::new();
        let mut last: Vec<Stretch> = Vec::new();
        for (&interval, &place) in whole {
            let own = &chosen[place];
            let mut live = vec![false; own.curves.len()];
            own.which.iter().flatten().for_each(|i| live[*i as usize] = true);
            last.push(Stretch::interval(interval));
            shown.insert(Stretch::interval(interval), Shown::new(Some(place), None, live));
        }
        // From pairs of intervals on to longer stretches, as long as both halves have something that goes on.
        let mut scales: Vec<Vec<Stretch>> = Vec::new();
        while last.len() > 1 {
            let mut next = Vec::new();
            for pair in last.windows(2) {
                let stretch = Stretch { scale: 2 * pair[0].scale, number: pair[0].number / 2 };
                let is_whole = stretch.halves().is_some_and(|halves| halves == [pair[0], pair[1]]);
                if !is_whole || self.part(stretch, whole, chosen)?.is_none() {
                    continue;
                }
                let long = self.long(stretch, family, level)?;
                let halves = [pair[0], pair[1]].map(|half| &shown[&half].live);
                let is_live = |(i, own): (usize, &LongTrack)| {
                    let goes_on = (0..2).all(|half| halves[half].get(own.halves[half] as usize) == Some(&true));
                    goes_on && choice.takes_long(bounds_of(&long.curves, i), error, recorded_error(error, own.error))
                };
                let tracks = long.tracks.par_iter().with_min_len(ENOUGH).enumerate();
                let live: Vec<bool> = tracks.map(is_live).collect();
                if live.contains(&true) {
                    next.push(stretch);
                    shown.insert(stretch, Shown::new(None, Some(long), live));
                }
            }
            scales.push(next.clone());
            last = next;
        }
        // From the longest ones down: what may be drawn is part of a longer one, or takes the place of its parts.
        for stretch in scales.into_iter().rev().flatten() {
            let (Some(own), Some(halves)) = (shown.get(&stretch), stretch.halves()) else { continue };
            let Some(long) = own.long.clone() else { continue };
            let (drawn, live) = (own.drawn(), own.live.clone());
            for (half, end) in halves.into_iter().zip(0..) {
                let Some(own) = shown.get_mut(&half) else { continue };
                let parts = long.tracks.iter().zip(&live).filter(|(_, live)| **live);
                parts.for_each(|(track, _)| own.is_part[track.halves[end] as usize] = true);
            }
            if let (false, Some(part)) = (drawn.is_empty(), self.part(stretch, whole, chosen)?) {
                let place = [part.interval as u32, family, level, 0];
                chosen.push(Chosen { place, curves: Arc::clone(&long.curves), which: Some(drawn), shares: None, part });
            }
        }
        for own in shown.into_values() {
            if let Some(place) = own.chosen {
                chosen[place].which = Some(own.drawn());
            }
        }
        Ok(())
    }

    /// The part of time that a stretch is, which is made of those of its intervals; `None` where these do not change evenly.
    fn part(
        &self,
        stretch: Stretch,
        whole: &BTreeMap<usize, usize>,
        chosen: &[Chosen],
    ) -> Result<Option<Part>, PictureError> {
        let clock = &self.run.tracks()?.clock;
        let intervals = stretch.intervals();
        let part = |interval: usize| Some(chosen[*whole.get(&interval)?].part);
        let (Some(first), Some(last)) = (part(intervals.start), part(stretch.last())) else { return Ok(None) };
        let own = Part {
            fade: [first.fade[0], last.fade[1]],
            place: [first.place[0], last.place[1]],
            head: last.head,
            intervals: stretch.scale,
            ..first
        };
        let (begin, end) = (clock[intervals.start], clock[intervals.end]);
        let is_even = |interval: usize| {
            let u = ((clock[interval + 1] - begin) / (end - begin)) as f32;
            let near = |[from, to]: [f32; 2], here: f32| (from + (to - from) * u - here).abs() <= EVEN;
            part(interval)
                .is_some_and(|part| !part.head && near(own.fade, part.fade[1]) && near(own.place, part.place[1]))
        };
        Ok((intervals.start..stretch.last()).all(is_even).then_some(own))
    }

    /// The long tracks of a level over a stretch.
    fn long(&mut self, stretch: Stretch, family: u32, level: u32) -> Result<Arc<Long>, PictureError> {
        let key = [stretch.scale as u32, stretch.number as u32, family, level];
        if let Some(known) = self.flow.long.get(&key) {
            return Ok(known);
        }
        let run = Arc::clone(&self.run);
        let tracks = run.long_tracks(stretch, family as usize, level as usize)?;
        let Some(halves) = stretch.halves() else {
            return Err(PictureError::of(run.path(), "a stretch of one interval has no long tracks"));
        };
        // The chain's first track is that of the first half, and the last one that of the second.
        let mut ends: Vec<[u32; 2]> = tracks.iter().map(|own| own.halves).collect();
        if halves[0].scale > 1 {
            for (end, half) in halves.into_iter().enumerate() {
                let long = self.long(half, family, level)?;
                for own in &mut ends {
                    own[end] = long.ends.get(own[end] as usize).map_or(u32::MAX, |ends| ends[end]);
                }
            }
        }
        let attribute = self.attribute_of(family);
        let of = |interval: usize| [interval, family as usize, level as usize];
        let first = self.flow.level(&run, of(stretch.intervals().start), attribute)?;
        let last = self.flow.level(&run, of(stretch.last()), attribute)?;
        let space = run.stretch(stretch)?;
        let edge = space.box_size.unwrap_or(0.0);
        let at = |level: &Level, i: usize, point: usize| {
            level.curves.origin + Vec3::from_array(level.curves.points[i][point]).as_dvec3()
        };
        let tangent =
            |level: &Level, i: usize, end: usize| Vec3::from_array(level.velocities[end][i]).as_dvec3() * space.length;
        let spline = |(own, long): (&[u32; 2], &LongTrack)| {
            let [begin, end] = own.map(|i| i as usize);
            let image = DVec3::from(long.image.map(|edges| edges as f64)) * edge;
            HermiteSpline {
                positions: [at(&first, begin, 0), at(&last, end, 3) + image],
                tangents: [tangent(&first, begin, 0), tangent(&last, end, 1)],
            }
        };
        let splines: Vec<HermiteSpline> = ends.iter().zip(&tracks).map(spline).collect();
        let mut curves = Curves::of(&splines, space.length);
        let mass =
            |[begin, end]: &[u32; 2]| [first.curves.mass[*begin as usize][0], last.curves.mass[*end as usize][1]];
        curves.mass = ends.iter().map(mass).collect();
        curves.counts = ends.iter().map(|[begin, _]| first.curves.count(*begin as usize)).collect();
        Ok(self.flow.long.put(key, Long { tracks, curves: Arc::new(curves), ends }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, FlowOptions, RunBuild, TrackOptions};
    use crate::color::transfer::TransferFunction;
    use crate::hierarchy::spacetime::Interpolation;
    use crate::import::{LoadOptions, RunOptions, open_run};
    use crate::mode::{Depiction, PathsOf, Settings, Span};
    use crate::model::{FamilyName, Moment, ReadMethod};
    use crate::picture::paths::{PathCounts, PathRequest};
    use crate::store::RunFile;
    use crate::synth::moving::{self, Moving, State};
    use crate::view::{Projection, View};

    const STEPS: usize = 41;
    const CLUMPS: u64 = 24;

    /// Clumps of eight that turn around the middle, the outer ones slower; each third one loses half of its particles halfway.
    struct Turning;

    impl Moving for Turning {
        fn len(&self) -> u64 {
            8 * CLUMPS
        }

        fn times(&self, steps: usize) -> (f64, f64) {
            (0.0, 6.0 / steps as f64)
        }

        fn at(&self, particle: u64, _: usize, time: f64) -> Option<State> {
            let (clump, member) = ((particle / 8) as f64, particle % 8);
            let radius = 1.0 + 0.25 * clump;
            let leaves = member < 4 && (particle / 8).is_multiple_of(3);
            let away = if leaves { (time - 3.1).max(0.0) } else { 0.0 };
            let rate = 1.0 / radius + 0.4 * away;
            // The turn is the integral of the rate.
            let (sin, cos) = (2.4 * clump + time / radius + 0.2 * away * away).sin_cos();
            let off = |bit: u64| 0.004 * (member >> bit & 1) as f64;
            let position = [radius * cos + off(0), radius * sin + off(1), off(2)];
            let velocity = [-radius * rate * sin, radius * rate * cos, 0.0];
            Some(State { family: FamilyName::Gas, position, velocity, density: 1.0, smoothing_length: 0.02 })
        }

        fn mass(&self) -> f64 {
            1.0
        }
    }

    fn run(folder: &std::path::Path) -> Arc<RunFile> {
        let times = moving::times(&Turning, STEPS, 1.5, 7);
        let files = moving::write(&Turning, &times, 7, &folder.join("snap"), &()).unwrap();
        let run = open_run(&files, &RunOptions::default(), ReadMethod::default()).unwrap();
        let flow = FlowOptions { levels: Some(3), error: Some(0.08) };
        let tracks = TrackOptions { flow, ..TrackOptions::default() };
        let (load, options) = (LoadOptions::default(), BuildOptions::default());
        let build =
            RunBuild { load: &load, options: &options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
        build.build(run, &folder.join("run.df"), &()).unwrap();
        Arc::new(RunFile::open(&folder.join("run.df"), ReadMethod::default()).unwrap())
    }

    /// Where a picture has something: within so many pixels of where the other one has.
    fn is_near(own: &[[f32; 4]], other: &[[f32; 4]], width: usize, reach: i64) -> bool {
        let height = (own.len() / width) as i64;
        let width = width as i64;
        let has = |x: i64, y: i64| {
            (0..width).contains(&x) && (0..height).contains(&y) && other[(y * width + x) as usize][3] > 0.0
        };
        (0..height * width).filter(|at| own[*at as usize][3] > 0.5).all(|at| {
            let (x, y) = (at % width, at / width);
            (-reach..=reach).any(|dy| (-reach..=reach).any(|dx| has(x + dx, y + dy)))
        })
    }

    /// Pictures with long tracks are those without but for an eighth of the spacing, of far fewer curves and as many tracks; where nothing is
    /// near enough they are the same.
    #[test]
    fn paths_with_long_tracks_are_where_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let run = run(folder.path());
        let mode = crate::modes::find("paths").unwrap();
        let depiction = Depiction { mode, settings: Settings::default(), attribute: None, choice: Default::default() };
        let transfer = TransferFunction::default();
        let view = |height| {
            let projection = Projection::Orthographic { height };
            View::look_at(DVec3::new(0.5, 0.2, 40.0), DVec3::new(0.5, 0.2, 0.0), DVec3::Y, projection, 480, 360)
                .unwrap()
        };
        let drawn = |view: &View, settings: &PathSettings, step: usize, with_long: bool| {
            let mut layer = PathLayer::new(Arc::clone(&run), 0).unwrap();
            let request = PathRequest {
                view,
                settings,
                of: &PathsOf::All,
                selections: &[],
                moment: Moment { step, u: 0.0 },
                interpolation: Interpolation::Auto,
                families: &[FamilyName::Gas],
                depiction: &depiction,
                transfer: &transfer,
            };
            let counts: PathCounts = layer.gather_chosen(&request, with_long).unwrap();
            (layer.colors().rgba, counts)
        };
        let settings = PathSettings {
            tail: Span::Steps(40.0),
            halo: 0.0,
            width: 2.0,
            color: "#ffffff".into(),
            ..PathSettings::default()
        };
        for (level, height, tail) in
            [(Some(1), 16.0, 40.0), (None, 16.0, 40.0), (None, 4.0, 33.0), (Some(3), 16.0, 7.0)]
        {
            let settings = PathSettings { level, tail: Span::Steps(tail), ..settings.clone() };
            for step in [40, 37] {
                let view = view(height);
                let [(with, long), (without, short)] = [true, false].map(|long| drawn(&view, &settings, step, long));
                // A long track counts in all of its intervals, in view or not.
                let is_same = if height > 10.0 { long.tracks == short.tracks } else { long.tracks >= short.tracks };
                assert!(is_same, "{level:?}: {long:?} {short:?}");
                assert!(long.curves * if tail > 8.0 { 3 } else { 1 } < short.curves, "{level:?}: {long:?} {short:?}");
                // An eighth of 12 pixels, and the edges of both.
                for (own, other) in [(&with, &without), (&without, &with)] {
                    assert!(is_near(own, other, view.width as usize, 3), "{level:?}, {height}");
                }
                let sum = |picture: &[[f32; 4]]| picture.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>();
                let (with, without) = (sum(&with), sum(&without));
                assert!(without > 100.0 && (with - without).abs() < 0.03 * without, "{with} {without}");
            }
        }
        let exact = PathSettings { level: Some(2), spacing: 1e-9, ..settings };
        let view = view(16.0);
        assert!(drawn(&view, &exact, 40, true) == drawn(&view, &exact, 40, false));
    }
}
