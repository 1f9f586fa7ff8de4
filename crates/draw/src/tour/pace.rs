//! What an audience would find too fast, measured along a tour, and words that it could not read.

use super::file::{Comfort, Move};
use super::spline::turn;
use super::timeline::Timeline;
use super::zoom_pan::ZoomPan;
use crate::annotate::font;

/// How fast the camera is on the way to a keyframe, and what is wrong with that.
#[derive(Clone, Debug, PartialEq)]
pub struct Remark {
    /// The keyframe's number, from 0.
    pub keyframe: usize,
    /// The highest angular speed on the way to it, degrees per second.
    pub turn: f64,
    /// The highest factor per second by which what is looked at comes nearer or goes away.
    pub zoom: f64,
    /// What an author should know, a sentence each.
    pub warnings: Vec<String>,
}

/// Speeds are measured so many times a second.
const SAMPLES: f64 = 60.0;
/// Most samples of a way.
const MOST_SAMPLES: f64 = 6000.0;
/// A way that is longer than so many lengths of [`ZoomPan`] is better flown than glided.
const FAR: f64 = 5.0;
/// A factor per second that is too much.
const ZOOM: f64 = 6.0;

/// Speeds and warnings for the way to each keyframe.
pub fn remarks(timeline: &Timeline, comfort: &Comfort) -> Vec<Remark> {
    (0..timeline.stops().len()).map(|index| remark(timeline, comfort, index)).collect()
}

fn remark(timeline: &Timeline, comfort: &Comfort, index: usize) -> Remark {
    let mut remark = Remark { keyframe: index, turn: 0.0, zoom: 1.0, warnings: Vec::new() };
    let stop = &timeline.stops()[index];
    let before = index.checked_sub(1).map(|before| &timeline.stops()[before]);
    let lacking = font::lacking(&stop.caption);
    if !lacking.is_empty() && before.is_none_or(|before| before.caption != stop.caption) {
        remark.warnings.push(format!("the font has no {lacking}: boxes stand for them in the caption"));
    }
    let Some(before) = before else { return remark };
    let (path, up, way) = (timeline.path(), timeline.up(), stop.arrive - before.leave);
    let (from, to) = (path.pose(before.leave), path.pose(stop.arrive));
    if stop.motion == Move::Cut {
        return remark;
    }
    if way <= 0.0 {
        if from.camera != to.camera {
            remark.warnings.push("the camera jumps here: no time for the way, and it is no cut".into());
        }
        return remark;
    }
    let samples = (way * SAMPLES).clamp(2.0, MOST_SAMPLES).round();
    let pose = |i: f64| path.pose(before.leave + way * (i / samples).min(1.0 - 1e-12));
    let mut last = pose(0.0);
    for i in 1..=samples as u32 {
        let here = pose(f64::from(i));
        let seconds = way / samples;
        remark.turn = remark.turn.max(turn(last.orientation(up), here.orientation(up)).length().to_degrees() / seconds);
        remark.zoom = remark.zoom.max(((here.width() / last.width()).ln().abs() / seconds).exp());
        last = here;
    }
    if remark.turn > 1.001 * comfort.turn {
        remark.warnings.push(format!(
            "turns by up to {:.0} degrees a second, more than {:.0}: {:.1} s would be comfortable",
            remark.turn,
            comfort.turn,
            way * remark.turn / comfort.turn
        ));
    }
    if remark.zoom > ZOOM {
        remark.warnings.push(format!(
            "zooms by up to a factor of {:.1} a second: {:.1} s would be comfortable",
            remark.zoom,
            way * remark.zoom.ln() / ZOOM.ln()
        ));
    }
    let far = ZoomPan::new(from.focus().distance(to.focus()), [from.width(), to.width()]).length();
    if stop.motion == Move::Glide && far > FAR {
        remark.warnings.push("goes far for its scales: `move: flight` would keep the way in sight".into());
    }
    if stop.stretched > 0.0 {
        remark.warnings.push(format!("takes {:.1} s longer than it says, for comfort", stop.stretched));
    }
    remark
}
