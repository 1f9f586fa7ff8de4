//! Editing a tour: keyframes of what is shown, moved in time, copied and removed.

use crate::look::{Camera, LookPatch};
use crate::tour::{Keyframe, Timeline, TourFile};

/// Least time between two keyframes, seconds.
const APART_SECS: f64 = 0.05;
/// Seconds from the last keyframe to one that is added behind it.
const USUAL_SECS: f64 = 4.0;

/// The same tour with the time of each keyframe said, so that moving one does not move those after it.
pub fn timed(tour: &TourFile, timeline: &Timeline) -> TourFile {
    let mut timed = tour.clone();
    for (keyframe, stop) in timed.keyframes.iter_mut().zip(timeline.stops()) {
        (keyframe.at, keyframe.after) = (Some(stop.arrive), None);
    }
    timed
}

/// When a keyframe is reached, of a [`timed`] tour.
fn at(keyframe: &Keyframe) -> f64 {
    keyframe.at.unwrap_or(0.0)
}

/// Adds a keyframe with this look from this camera at a time, or behind the last one where that is `None`. Its number.
pub fn keep(
    tour: &mut TourFile,
    timeline: Option<&Timeline>,
    time: Option<f64>,
    camera: Camera,
    look: &LookPatch,
) -> usize {
    if let Some(timeline) = timeline {
        *tour = timed(tour, timeline);
    }
    let end = tour.keyframes.last().map_or(0.0, |last| at(last) + last.pause + USUAL_SECS);
    let time = time.unwrap_or(end).max(0.0);
    let index = tour.keyframes.partition_point(|keyframe| at(keyframe) < time);
    // One that is there already is replaced: it is the same moment.
    let same = tour.keyframes.get(index).is_some_and(|next| at(next) - time < APART_SECS);
    let before =
        tour.keyframes[..index].iter().fold(LookPatch::beginning(), |look, keyframe| look.then(&keyframe.look));
    let keyframe =
        Keyframe { at: Some(time), camera: Some(camera), look: before.patch_to(look), ..Keyframe::default() };
    if same {
        let old = &mut tour.keyframes[index];
        *old = Keyframe {
            at: old.at,
            label: old.label.take(),
            caption: old.caption.take(),
            images: old.images.take(),
            pause: old.pause,
            hold: old.hold,
            fade: old.fade,
            ..keyframe
        };
    } else {
        // A moment in the middle of a pause ends it.
        if let Some(last) = index.checked_sub(1).and_then(|last| tour.keyframes.get_mut(last)) {
            last.pause = last.pause.min((time - at(last) - 1e-9).max(0.0));
        }
        tour.keyframes.insert(index, keyframe);
    }
    index
}

/// Moves a keyframe to another time, between those beside it.
pub fn retime(tour: &mut TourFile, timeline: &Timeline, index: usize, time: f64) {
    *tour = timed(tour, timeline);
    let before = index.checked_sub(1).and_then(|i| tour.keyframes.get(i)).map_or(0.0, |k| at(k) + k.pause + APART_SECS);
    let Some(own) = tour.keyframes.get(index) else { return };
    let after = tour.keyframes.get(index + 1).map_or(f64::MAX, |next| at(next) - own.pause - APART_SECS);
    let time = if time.is_finite() { time.clamp(before, after.max(before)) } else { at(own) };
    tour.keyframes[index].at = Some(time);
}

/// Adds a keyframe that shows what another does, in the middle of the way after it or behind it. Its number.
pub fn copy(tour: &mut TourFile, timeline: &Timeline, index: usize) -> Option<usize> {
    let stop = timeline.stops().get(index)?;
    let time = match timeline.stops().get(index + 1) {
        Some(next) => 0.5 * (stop.leave + next.arrive),
        None => stop.leave + USUAL_SECS,
    };
    let (camera, look) = (timeline.state(stop.arrive).camera, timeline.look(index, stop.arrive));
    Some(keep(tour, Some(timeline), Some(time), camera, &look))
}

/// Removes a keyframe; those after it go on showing what they showed.
pub fn remove(tour: &mut TourFile, timeline: &Timeline, index: usize) {
    if index >= tour.keyframes.len() || timeline.stops().len() != tour.keyframes.len() {
        return;
    }
    *tour = timed(tour, timeline);
    // The next one has to say what it had from the one that goes.
    if let (Some(next), Some(stop)) = (tour.keyframes.get(index + 1).cloned(), timeline.stops().get(index + 1)) {
        let before =
            tour.keyframes[..index].iter().fold(LookPatch::beginning(), |look, keyframe| look.then(&keyframe.look));
        let words = next.caption.clone().or_else(|| tour.keyframes[index].caption.clone());
        let images = next.images.clone().or_else(|| tour.keyframes[index].images.clone());
        tour.keyframes[index + 1] = Keyframe {
            look: before.patch_to(&timeline.look(index + 1, stop.arrive)),
            camera: Some(timeline.state(stop.arrive).camera),
            around: None,
            orbit: 0.0,
            caption: words,
            images,
            ..next
        };
    }
    tour.keyframes.remove(index);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::touring::tests::{surroundings, tour};
    use proptest::prelude::*;

    fn resolved(tour: &TourFile) -> Timeline {
        Timeline::new(tour, &surroundings()).unwrap()
    }

    proptest! {
        #![proptest_config(crate::cases::cases(64))]
        /// Whatever is done to it, a tour stays one that can be shown, written and read, and keyframes stay in order and show what
        /// they showed.
        #[test]
        fn edits_leave_a_tour(edits in prop::collection::vec((0..4u8, 0..8usize, -3.0..20.0f64), 1..14)) {
            let mut draft = tour(false);
            for (what, index, time) in edits {
                let timeline = resolved(&draft);
                let index = index % draft.keyframes.len().max(1);
                let shown = |timeline: &Timeline, i: usize| {
                    let state = timeline.state(timeline.stops()[i].arrive);
                    (state.camera, state.look)
                };
                match what {
                    0 => {
                        let state = timeline.state(time.max(0.0));
                        let kept = keep(&mut draft, Some(&timeline), Some(time), state.camera, &state.look);
                        let now = shown(&resolved(&draft), kept);
                        prop_assert_eq!(now, (state.camera, state.look));
                    }
                    1 => {
                        let before = shown(&timeline, index);
                        retime(&mut draft, &timeline, index, time);
                        prop_assert_eq!(shown(&resolved(&draft), index), before);
                    }
                    2 => {
                        let count = draft.keyframes.len();
                        copy(&mut draft, &timeline, index).unwrap();
                        prop_assert!(draft.keyframes.len() >= count);
                    }
                    _ if draft.keyframes.len() > 1 => {
                        let next = (index + 1 < draft.keyframes.len()).then(|| shown(&timeline, index + 1));
                        remove(&mut draft, &timeline, index);
                        if let Some(next) = next {
                            prop_assert_eq!(shown(&resolved(&draft), index), next);
                        }
                    }
                    _ => {}
                }
                let times: Vec<f64> = resolved(&draft).stops().iter().map(|stop| stop.arrive).collect();
                prop_assert!(times.is_sorted(), "{times:?}");
                let read = TourFile::parse("draft", &draft.to_ron()).unwrap();
                prop_assert_eq!(&read, &draft);
            }
        }
    }

    #[test]
    fn moving_one_keyframe_leaves_the_others() {
        let mut draft = tour(false);
        let timeline = resolved(&draft);
        retime(&mut draft, &timeline, 1, 6.0);
        let times: Vec<f64> = resolved(&draft).stops().iter().map(|stop| stop.arrive).collect();
        assert_eq!(times, [0.0, 6.0, 9.0]);
        retime(&mut draft, &timeline, 1, 100.0);
        let stops = resolved(&draft);
        assert!(stops.stops()[1].leave < 9.0, "it stays before the next, with its pause");
    }
}
