//! Highlights that run along paths while a tour plays: how far they have come at a time. That is the area under their speed, which
//! changes from keyframe to keyframe as all numbers do; so each moment of a tour is the same picture, however one came there.

use super::timeline::Stop;
use crate::look::LookPatch;

/// How far highlights have come when each keyframe is reached, intervals between steps.
pub(super) fn at_arrivals(stops: &[Stop]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut all = vec![sum];
    for pair in stops.windows(2) {
        sum += since(&pair[0], pair.get(1), pair[1].arrive);
        all.push(sum);
    }
    all
}

/// How far they come from a keyframe's arrival to a time before the arrival of the next one.
pub(super) fn since(stop: &Stop, next: Option<&Stop>, time: f64) -> f64 {
    let speed = |look: &LookPatch| look.paths.as_ref().map(|paths| paths.run);
    let own = speed(&stop.look).unwrap_or(0.0);
    let even = own * (time - stop.arrive);
    let Some(next) = next else { return even };
    let way = next.arrive - stop.leave;
    match (speed(&stop.look), speed(&next.look)) {
        (Some(own), Some(last)) if way > 0.0 => {
            let share = ((time - stop.leave) / way).clamp(0.0, 1.0);
            even + (last - own) * way * next.easing.area(share)
        }
        // Without settings at one of them nothing changes on the way.
        _ => even,
    }
}
