//! The time that paths are drawn for: parts of the intervals around the present.

use crate::cpu::paths::Part;
use crate::mode::{PathSettings, Span};
use crate::model::Moment;

/// The parts of intervals from the end of the tail to that of the lead. The present is at the end of one of them, which has the heads.
/// `clock` has the run's time at each step.
pub fn parts(settings: &PathSettings, moment: Moment, clock: &[f64]) -> Vec<Part> {
    let Some(last) = clock.len().checked_sub(2) else { return Vec::new() };
    // At a stored step heads are where tracks end that came there.
    let (head, u) = match (moment.step, moment.u) {
        (step, _) if step > last => (last, 1.0),
        (step, u) if u > 0.0 => (step, u.min(1.0)),
        (0, _) => (0, 0.0),
        (step, _) => (step - 1, 1.0),
    };
    let at = |place: f64| {
        let interval = (place.floor().max(0.0) as usize).min(last);
        clock[interval] + (place - interval as f64) * (clock[interval + 1] - clock[interval])
    };
    let place_of = |time: f64| {
        let interval = clock.partition_point(|begin| *begin <= time).saturating_sub(1).min(last);
        interval as f64 + (time - clock[interval]) / (clock[interval + 1] - clock[interval])
    };
    let now = head as f64 + u;
    let away = |span: Span, sign: f64| match span {
        Span::Steps(steps) => now + sign * steps,
        Span::Clock(time) => place_of(at(now) + sign * time),
    };
    let ends = [away(settings.tail, -1.0), away(settings.lead, 1.0)];
    // How near a place is to the present, from 0 at the end of the tail or lead to 1.
    let near = |place: f64| {
        let span = if place <= now { settings.tail } else { settings.lead };
        let away = match span {
            Span::Steps(_) => (place - now).abs(),
            Span::Clock(_) => (at(place) - at(now)).abs(),
        };
        if span.number() > 0.0 { (1.0 - away / span.number()).clamp(0.0, 1.0) as f32 } else { 1.0 }
    };
    let whole = (ends[1] - ends[0]).max(1e-12);
    let part = |interval: usize, from: f64, to: f64, is_head: bool| {
        let places = [from, to].map(|u| interval as f64 + u);
        Part {
            u: [from as f32, to as f32],
            fade: places.map(near),
            head: is_head,
            place: places.map(|place| ((place - ends[0]) / whole) as f32),
            interval,
            intervals: 1,
        }
    };
    let mut parts = Vec::new();
    for interval in 0..=last {
        let own = interval as f64;
        if interval <= head {
            let (from, to) = ((ends[0] - own).clamp(0.0, 1.0), if interval == head { u } else { 1.0 });
            if interval == head || from < to {
                parts.push(part(interval, from.min(to), to, interval == head));
            }
        }
        if interval >= head {
            let (from, to) = (if interval == head { u } else { 0.0 }, (ends[1] - own).clamp(0.0, 1.0));
            if from < to {
                parts.push(part(interval, from, to, false));
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(tail: Span, lead: Span, step: usize, u: f64) -> Vec<(usize, [f32; 2], [f32; 2], bool)> {
        let settings = PathSettings { tail, lead, ..PathSettings::default() };
        let parts = parts(&settings, Moment { step, u }, &[0.0, 1.0, 3.0, 4.0]);
        parts.into_iter().map(|part| (part.interval, part.u, part.fade, part.head)).collect()
    }

    #[test]
    fn intervals_are_cut_where_the_tail_and_the_lead_end() {
        let steps = Span::Steps;
        assert_eq!(
            of(steps(2.0), steps(0.0), 2, 0.5),
            [
                (0, [0.5, 1.0], [0.0, 0.25], false),
                (1, [0.0, 1.0], [0.25, 0.75], false),
                (2, [0.0, 0.5], [0.75, 1.0], true),
            ]
        );
        // At a step, heads are where tracks end; at the first one, where they begin.
        assert_eq!(
            of(steps(1.0), steps(1.0), 1, 0.0),
            [(0, [0.0, 1.0], [0.0, 1.0], true), (1, [0.0, 1.0], [1.0, 0.0], false),]
        );
        assert_eq!(of(steps(2.0), steps(0.0), 0, 0.0), [(0, [0.0, 0.0], [1.0, 1.0], true)]);
        assert_eq!(of(steps(0.0), steps(0.0), 3, 0.0), [(2, [1.0, 1.0], [1.0, 1.0], true)]);
        // By the clock: the interval in the middle is twice as long.
        assert_eq!(of(Span::Clock(1.0), steps(0.0), 2, 0.0), [(1, [0.5, 1.0], [0.0, 1.0], true)]);
        assert_eq!(of(Span::Clock(2.5), steps(0.0), 2, 0.0)[0], (0, [0.5, 1.0], [0.0, 0.2], false));
    }
}
