//! Long tracks in the place of the chains that they stand for: what is drawn over 2, 4, 8, ... intervals as one curve.
//!
//! The tracks of single intervals are chosen first ([`super::levels`]); then those whose whole chain was chosen give way to a long track,
//! the longest that is near enough to them in the picture. So a long track is drawn where its parts would have been, and nobody twice.

use super::kept::Held;
use super::levels::{Chooser, Level, bounds_of};
use super::{Chosen, PathLayer, PathRequest};
use crate::cpu::paths::{Curves, Part};
use crate::hierarchy::spacetime::{HermiteSpline, LongTrack, Stretch, recorded_error};
use crate::mode::{PathColor, PathSettings};
use crate::picture::PictureError;
use glam::{DVec3, Vec3};
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
    /// Which tracks are drawn, or may be.
    live: Vec<bool>,
}

/// Whether long tracks show what is asked for. Attributes have values at each step, and highlights a place in each interval.
pub(super) fn are_wanted(settings: &PathSettings) -> bool {
    settings.run == 0.0 && !matches!(settings.colored_by(), PathColor::Attribute(_))
}

impl PathLayer {
    /// Puts long tracks in the place of chains of tracks of a family that were chosen.
    pub(super) fn lengthen(
        &mut self,
        request: &PathRequest<'_>,
        chooser: &Chooser<'_>,
        family: u32,
        chosen: &mut Vec<Chosen>,
    ) -> Result<(), PictureError> {
        if !are_wanted(request.settings) {
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
            self.lengthen_level(chooser, [family, level], &whole, chosen)?;
        }
        Ok(())
    }

    /// The same of one level; `whole`: the places of intervals in `chosen`.
    fn lengthen_level(
        &mut self,
        chooser: &Chooser<'_>,
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
            shown.insert(Stretch::interval(interval), Shown { chosen: Some(place), long: None, live });
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
                    goes_on && chooser.takes_long(bounds_of(&long.curves, i), error, recorded_error(error, own.error))
                };
                let live: Vec<bool> = long.tracks.iter().enumerate().map(is_live).collect();
                if live.contains(&true) {
                    next.push(stretch);
                    shown.insert(stretch, Shown { chosen: None, long: Some(long), live });
                }
            }
            scales.push(next.clone());
            last = next;
        }
        // From the longest ones down: what is drawn takes its parts away.
        for stretch in scales.into_iter().rev().flatten() {
            let (Some(own), Some(halves)) = (shown.get(&stretch), stretch.halves()) else { continue };
            let (Some(long), drawn) = (own.long.clone(), numbers(&own.live)) else { continue };
            for (half, end) in halves.into_iter().zip(0..) {
                let Some(own) = shown.get_mut(&half) else { continue };
                drawn.iter().for_each(|i| own.live[long.tracks[*i as usize].halves[end] as usize] = false);
            }
            if let (false, Some(part)) = (drawn.is_empty(), self.part(stretch, whole, chosen)?) {
                let place = [part.interval as u32, family, level, 0];
                chosen.push(Chosen { place, curves: Arc::clone(&long.curves), which: Some(drawn), part });
            }
        }
        for own in shown.into_values() {
            if let Some(place) = own.chosen {
                chosen[place].which = Some(numbers(&own.live));
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

/// The numbers of those that are set.
fn numbers(set: &[bool]) -> Vec<u32> {
    (0..).zip(set).filter(|(_, own)| **own).map(|(i, _)| i).collect()
}
