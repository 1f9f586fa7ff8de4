//! A tour resolved: what is shown at a time.

use super::around::{DataMoment, Surroundings, center};
use super::file::{Easing, Keyframe, Move, TimeEasing, TourError, TourFile};
use super::highlights;
use super::path::{Knot, Path, Pose};
use super::spline::turn;
use super::zoom_pan::ZoomPan;
use crate::annotate::overlay::Picture;
use crate::explore::Members;
use crate::look::{Camera, LookPatch, OpenData, mix, mix_time};
use glam::DVec3;
use std::collections::BTreeMap;

/// A keyframe's place in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Stop {
    /// A name to go to.
    pub label: Option<String>,
    /// When it is reached, seconds.
    pub arrive: f64,
    /// When it is left.
    pub leave: f64,
    /// Whether a presenter says when it goes on.
    pub hold: bool,
    /// How the camera comes here.
    pub motion: Move,
    /// By how much the way here was stretched for comfort, seconds.
    pub stretched: f64,
    /// Seconds in which the picture blends from what was.
    pub fade: f64,
    pub(super) easing: Easing,
    time_easing: TimeEasing,
    pub(super) look: LookPatch,
    pub(super) caption: String,
    images: Vec<Picture>,
}

/// What is shown at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Seconds from the beginning.
    pub time: f64,
    /// The number of the last keyframe that was reached, from 0.
    pub keyframe: usize,
    /// Where the camera stands.
    pub camera: Camera,
    /// Everything else of the picture.
    pub look: LookPatch,
    /// The picture that this one is blended with.
    pub blend: Option<Blend>,
    /// Words at the foot.
    pub caption: Caption,
    /// Pictures that are laid over it, as much of them as is seen.
    pub images: Vec<Picture>,
}

/// The picture that another takes the place of.
#[derive(Clone, Debug, PartialEq)]
pub struct Blend {
    /// Its camera.
    pub camera: Camera,
    /// Everything else of it.
    pub look: LookPatch,
    /// How much of the other is seen, from 0 to 1.
    pub share: f64,
}

/// Words at the foot of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Caption {
    /// The words.
    pub text: String,
    /// How much of them is seen, from 0 to 1.
    pub opacity: f32,
}

/// The way around a selection that the camera follows: as seen from its centre.
#[derive(Clone, Debug)]
struct Followed {
    members: Members,
    path: Path,
    /// Its centre at each keyframe.
    centers: Vec<DVec3>,
}

/// A tour for the data that it is shown with.
#[derive(Clone, Debug)]
pub struct Timeline {
    path: Path,
    followed: Vec<Followed>,
    /// By keyframe: which of them the camera follows from there on.
    follows: Vec<Option<usize>>,
    data: Option<OpenData>,
    stops: Vec<Stop>,
    /// How far highlights of paths have come when each keyframe is reached.
    highlights: Vec<f64>,
    keys: BTreeMap<char, String>,
    repeats: bool,
    up: DVec3,
}

/// Seconds in which words come and go.
const WORDS: f64 = 0.6;
/// Seconds that a way takes unless it is said.
const USUAL_WAY: f64 = 4.0;
/// Lengths of a flight (see [`ZoomPan::length`]) per second, unless a time is said.
const FLIGHT_SPEED: f64 = 0.9;
/// The highest speed of a way from rest to rest, in units of its mean speed.
const PEAK: f64 = 1.5;

impl Timeline {
    /// Resolves a tour for its surroundings.
    ///
    /// # Errors
    /// [`TourError`] where a keyframe looks at something that is not there.
    pub fn new(tour: &TourFile, surroundings: &Surroundings) -> Result<Timeline, TourError> {
        let up = tour.upward().normalize_or(DVec3::Y);
        let mut stops: Vec<Stop> = Vec::with_capacity(tour.keyframes.len());
        let mut knots: Vec<Knot> = Vec::with_capacity(tour.keyframes.len());
        for (index, keyframe) in tour.keyframes.iter().enumerate() {
            let before = stops.last();
            let mut look = before.map_or_else(LookPatch::beginning, |stop| stop.look.clone()).then(&keyframe.look);
            look.time = surroundings.time(index, keyframe.look.time, before.and_then(|stop| stop.look.time))?;
            let pose = pose(index, keyframe, knots.last().map(|knot| &knot.pose), &look, surroundings, up)?;
            let (arrive, stretched) = match knots.last() {
                None => (keyframe.at.or(keyframe.after).unwrap_or(0.0), 0.0),
                Some(last) => arrival(tour, keyframe, last, &pose),
            };
            let leave = arrive + keyframe.pause;
            stops.push(Stop {
                label: keyframe.label.clone(),
                arrive,
                leave,
                hold: keyframe.hold,
                motion: keyframe.motion,
                stretched,
                fade: keyframe.fade,
                easing: keyframe.easing,
                time_easing: keyframe.time_easing,
                caption: keyframe.caption.clone().or(before.map(|stop| stop.caption.clone())).unwrap_or_default(),
                images: keyframe.images.clone().or(before.map(|stop| stop.images.clone())).unwrap_or_default(),
                look,
            });
            // The camera must stand still where a presenter is waited for.
            let rest = keyframe.rest || keyframe.hold;
            knots.push(Knot { arrive, leave, pose, motion: keyframe.motion, rest });
        }
        let (mut followed, mut follows): (Vec<Followed>, _) = (Vec::new(), Vec::new());
        for (index, stop) in stops.iter().enumerate() {
            let mut sets = stop.look.selections.iter().flatten();
            // Data that does not change has nobody to follow.
            let set = sets.find(|set| set.follow).filter(|_| surroundings.data.is_some());
            let Some(set) = set else {
                follows.push(None);
                continue;
            };
            let known = followed.iter().position(|known| known.members == set.members);
            follows.push(match known {
                Some(known) => Some(known),
                None => {
                    let way = around_selection(index, &set.members, &stops, &knots, surroundings, tour)?;
                    followed.extend(way);
                    followed.iter().position(|known| known.members == set.members)
                }
            });
        }
        let path = Path::new(knots, up, tour.repeats);
        let (keys, data) = (tour.keys.clone(), surroundings.data.clone());
        let highlights = highlights::at_arrivals(&stops);
        Ok(Timeline { path, followed, follows, data, stops, highlights, keys, repeats: tour.repeats, up })
    }

    /// The camera at a time: along its way, or along that as seen from the centre of what it follows.
    pub fn camera(&self, time: f64) -> Camera {
        let index = self.path.index(time);
        let followed = self.follows.get(index).copied().flatten().and_then(|number| self.followed.get(number));
        let Some(Followed { members, path, centers }) = followed else { return self.path.camera(time) };
        let (here, share) = (&self.stops[index], self.share(index, time));
        let Some(share) = share else { return self.path.camera(time) };
        let next = &self.stops[index + 1];
        let at = DataMoment {
            time: mix_time(here.look.time, next.look.time, next.time_easing.at(share)),
            ..DataMoment::of(&here.look)
        };
        // Where the data cannot be read, the way between the keyframes' centres is as good as any.
        let between = || centers[index].lerp(centers[index + 1], share);
        let center = center(self.data.as_ref(), members, at).ok().flatten().unwrap_or_else(between);
        path.pose(time).moved(center).camera
    }

    /// The share of the way from a keyframe to the next that is gone at a time; `None` at the keyframe, and where there is no way.
    fn share(&self, keyframe: usize, time: f64) -> Option<f64> {
        let (stop, next) = (&self.stops[keyframe], self.stops.get(keyframe + 1)?);
        let way = next.arrive - stop.leave;
        (time > stop.leave && way > 0.0).then(|| ((time - stop.leave) / way).clamp(0.0, 1.0))
    }

    /// How long it is, seconds.
    pub fn duration(&self) -> f64 {
        self.path.end()
    }

    /// Whether it begins again at its end.
    pub fn repeats(&self) -> bool {
        self.repeats
    }

    /// The keyframes in time.
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }

    /// The direction that is up.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// The camera's way.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A time within the tour: it stays at the end, or begins again.
    pub fn within(&self, time: f64) -> f64 {
        let duration = self.duration();
        let time = if time.is_nan() { 0.0 } else { time.clamp(0.0, 1e15) };
        if self.repeats && duration > 0.0 { time % duration } else { time.min(duration) }
    }

    /// What is shown at a time.
    pub fn state(&self, time: f64) -> State {
        let time = self.within(time);
        let keyframe = self.path.index(time);
        let camera = self.camera(time);
        State {
            time,
            keyframe,
            camera,
            look: self.look(keyframe, time),
            blend: self.blend(keyframe, time, camera),
            caption: self.caption(keyframe, time),
            images: self.images(keyframe, time),
        }
    }

    /// The look after a keyframe, on the way to the next.
    pub fn look(&self, keyframe: usize, time: f64) -> LookPatch {
        let stop = &self.stops[keyframe];
        let mut look = match self.stops.get(keyframe + 1).zip(self.share(keyframe, time)) {
            None => stop.look.clone(),
            Some((next, share)) => {
                let mut look = mix(&stop.look, &next.look, next.easing.at(share));
                look.time = mix_time(stop.look.time, next.look.time, next.time_easing.at(share));
                look
            }
        };
        self.move_highlights(&mut look, keyframe, time);
        look
    }

    /// Moves the highlights of paths to where they are at a time after a keyframe.
    fn move_highlights(&self, look: &mut LookPatch, keyframe: usize, time: f64) {
        if let Some(paths) = look.paths.as_mut() {
            let before = self.highlights.get(keyframe).copied().unwrap_or(0.0);
            paths.phase += before + highlights::since(&self.stops[keyframe], self.stops.get(keyframe + 1), time);
        }
    }

    /// The picture before a keyframe that fades into the one after it.
    fn blend(&self, keyframe: usize, time: f64, camera: Camera) -> Option<Blend> {
        let stop = &self.stops[keyframe];
        let share = (time - stop.arrive) / stop.fade;
        let before = keyframe.checked_sub(1)?;
        if !(0.0..1.0).contains(&share) {
            return None;
        }
        let camera = if stop.motion == Move::Cut { self.camera(self.stops[before].leave) } else { camera };
        // Where the way here ended: numbers have come all the way, unless they waited for the keyframe.
        let (last, numbers) = (&self.stops[before].look, if stop.easing == Easing::Hold { 0.0 } else { 1.0 });
        let mut look = mix(last, &stop.look, numbers);
        self.move_highlights(&mut look, keyframe, time);
        let changes = camera != self.camera(time) || look != self.look(keyframe, time);
        changes.then_some(Blend { camera, look, share: Easing::Smooth.at(share) })
    }

    /// From when to when something is as it is at a keyframe.
    fn span<T: PartialEq>(&self, keyframe: usize, value: impl Fn(&Stop) -> &T) -> (f64, Option<f64>) {
        let here = value(&self.stops[keyframe]);
        let first = (0..=keyframe).rev().take_while(|&i| value(&self.stops[i]) == here).last().unwrap_or(keyframe);
        let next = self.stops[keyframe + 1..].iter().find(|stop| value(stop) != here);
        (self.stops[first].arrive, next.map(|stop| stop.arrive))
    }

    /// How much of what lasts so long is seen at a time.
    fn seen(time: f64, (from, to): (f64, Option<f64>)) -> f32 {
        let coming = if from > 0.0 { (time - from) / WORDS } else { 1.0 };
        let going = to.map_or(1.0, |to| (to - time) / WORDS);
        Easing::Smooth.at(coming.min(going).clamp(0.0, 1.0)) as f32
    }

    fn caption(&self, keyframe: usize, time: f64) -> Caption {
        let text = self.stops[keyframe].caption.trim().to_owned();
        let opacity =
            if text.is_empty() { 0.0 } else { Timeline::seen(time, self.span(keyframe, |stop| &stop.caption)) };
        Caption { text, opacity }
    }

    fn images(&self, keyframe: usize, time: f64) -> Vec<Picture> {
        let seen = Timeline::seen(time, self.span(keyframe, |stop| &stop.images));
        let images = self.stops[keyframe].images.iter();
        images.map(|image| Picture { opacity: image.opacity * seen, ..image.clone() }).collect()
    }

    /// When a label is reached.
    pub fn named(&self, label: &str) -> Option<f64> {
        self.stops.iter().find(|stop| stop.label.as_deref() == Some(label)).map(|stop| stop.arrive)
    }

    /// Where a presenter's key leads.
    pub fn key(&self, key: char) -> Option<f64> {
        self.keys.get(&key).and_then(|label| self.named(label))
    }

    /// Where "next" leads: the next keyframe with a label or a hold, else the end.
    pub fn next(&self, time: f64) -> f64 {
        let is_stop = |stop: &&Stop| stop.arrive > time && (stop.label.is_some() || stop.hold);
        self.stops.iter().find(is_stop).map_or(self.duration(), |stop| stop.arrive)
    }

    /// Where "back" leads: the last keyframe with a label or a hold that was left, else the beginning.
    pub fn back(&self, time: f64) -> f64 {
        let is_stop = |stop: &&Stop| stop.arrive < time && (stop.label.is_some() || stop.hold);
        self.stops.iter().rev().find(is_stop).map_or(0.0, |stop| stop.arrive)
    }
}

/// The way around a selection, as it is seen from its centre; `None` where it has no centre at some keyframe, as without a particle.
fn around_selection(
    index: usize,
    members: &Members,
    stops: &[Stop],
    knots: &[Knot],
    surroundings: &Surroundings,
    tour: &TourFile,
) -> Result<Option<Followed>, TourError> {
    let mut centers = Vec::with_capacity(stops.len());
    for stop in stops {
        let center = surroundings.center(members, DataMoment::of(&stop.look));
        match center.map_err(|error| surroundings.failed(index, error))? {
            Some(center) => centers.push(center),
            None => return Ok(None),
        }
    }
    let seen = knots.iter().zip(&centers).map(|(knot, center)| Knot { pose: knot.pose.moved(-*center), ..*knot });
    let up = tour.upward().normalize_or(DVec3::Y);
    let path = Path::new(seen.collect(), up, tour.repeats);
    Ok(Some(Followed { members: members.clone(), path, centers }))
}

/// The camera of a keyframe.
fn pose(
    index: usize,
    keyframe: &Keyframe,
    before: Option<&Pose>,
    look: &LookPatch,
    surroundings: &Surroundings,
    up: DVec3,
) -> Result<Pose, TourError> {
    let camera = match &keyframe.around {
        Some(around) => Some(surroundings.camera(index, around, look, up)?),
        None => keyframe.camera,
    };
    let orbit = keyframe.orbit.to_radians();
    Ok(match (camera, before) {
        (Some(camera), before) => Pose::new(camera, up, before.map_or(0.0, |pose| pose.yaw) + orbit),
        (None, Some(pose)) if orbit == 0.0 => *pose,
        (None, Some(pose)) => pose.orbited(up, orbit),
        (None, None) => Pose::new(surroundings.usual_camera(index, look, up)?, up, 0.0).orbited(up, orbit),
    })
}

/// When a keyframe is reached from the one before, and by how much that is later than it says.
fn arrival(tour: &TourFile, keyframe: &Keyframe, last: &Knot, pose: &Pose) -> (f64, f64) {
    if let Some(at) = keyframe.at {
        return (at.max(last.leave), 0.0);
    }
    let up = tour.upward();
    let angle = turn(last.pose.orientation(up), pose.orientation(up)).length().max((pose.yaw - last.pose.yaw).abs());
    let comfortable = PEAK * angle.to_degrees() / tour.comfort.turn;
    let flight = match keyframe.motion {
        Move::Flight => {
            ZoomPan::new(last.pose.focus().distance(pose.focus()), [last.pose.width(), pose.width()]).length()
        }
        _ => 0.0,
    };
    let usual = match keyframe.motion {
        Move::Glide => USUAL_WAY.max(comfortable),
        Move::Flight => (flight / FLIGHT_SPEED).max(comfortable).max(2.0),
        Move::Cut => 0.0,
    };
    let said = keyframe.after.unwrap_or(usual);
    let stretched =
        if tour.comfort.stretch && keyframe.motion != Move::Cut { (comfortable - said).max(0.0) } else { 0.0 };
    (last.leave + said + stretched, stretched)
}

#[cfg(test)]
mod tests;
