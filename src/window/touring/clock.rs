//! The time of a tour that is played: from the program's own time, whatever the frames take.

use crate::tour::Timeline;
use serde::{Deserialize, Serialize};

/// Where a tour is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockState {
    /// Seconds of the tour.
    pub time: f64,
    /// Whether it runs.
    pub running: bool,
    /// The keyframe that waits for the presenter.
    pub waiting: Option<usize>,
}

/// A clock that runs, stands, and stops where a presenter is waited for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clock {
    /// The program's time when it was set, seconds.
    set_at: f64,
    /// What it said then, seconds of the tour; beyond its duration where the tour repeats.
    said: f64,
    running: bool,
    /// The keyframe that waits for the presenter.
    waiting: Option<usize>,
}

impl Clock {
    /// What it says at the program's time `now`, without regard to keyframes that wait.
    pub fn time(&self, now: f64) -> f64 {
        if self.running { self.said + (now - self.set_at).max(0.0) } else { self.said }
    }

    /// Whether it runs.
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// The keyframe that waits for the presenter.
    pub fn waiting(&self) -> Option<usize> {
        self.waiting
    }

    /// Sets it to a time of the tour; it goes on running or standing.
    pub fn set(&mut self, now: f64, time: f64) {
        *self = Clock { set_at: now, said: time.max(0.0), running: self.running, waiting: None };
    }

    /// Sets it to what another clock says, which runs or stands.
    pub fn lead(&mut self, now: f64, time: f64, running: bool) {
        *self = Clock { set_at: now, said: time.max(0.0), running, waiting: None };
    }

    /// Sets it to what the clock of another window said, which ran, stood, or waited at a keyframe.
    pub fn resume(&mut self, now: f64, time: f64, running: bool, waiting: Option<usize>) {
        *self = Clock { set_at: now, said: time.max(0.0), running, waiting };
    }

    /// Lets it run, past a keyframe that waits; from the beginning where the tour is over.
    pub fn run(&mut self, now: f64, timeline: &Timeline) {
        let time = match self.waiting {
            Some(keyframe) => self.said + timeline.stops().get(keyframe).map_or(0.0, |stop| stop.leave - stop.arrive),
            None if !timeline.repeats() && self.time(now) >= timeline.duration() => 0.0,
            None => self.time(now),
        };
        *self = Clock { set_at: now, said: time, running: true, waiting: None };
    }

    /// Lets it stand.
    pub fn stand(&mut self, now: f64) {
        *self = Clock { set_at: now, said: self.time(now), running: false, waiting: self.waiting };
    }

    /// Looks whether it has come to a keyframe that waits, or to the end, and stops there exactly. What it says then.
    pub fn tick(&mut self, now: f64, timeline: &Timeline) -> f64 {
        let time = self.time(now);
        if !self.running {
            return time;
        }
        let duration = timeline.duration();
        let holds = timeline.stops().iter().enumerate().filter(|(_, stop)| stop.hold);
        let reached = holds.filter_map(|(i, stop)| {
            // The last time that it was reached, of a tour that repeats.
            let rounds = match timeline.repeats() && duration > 0.0 {
                true => ((self.said - stop.arrive) / duration).floor() + 1.0,
                false if stop.arrive > self.said => 0.0,
                false => return None,
            };
            let at = stop.arrive + rounds.max(0.0) * duration;
            (at <= time).then_some((at, i))
        });
        if let Some((at, keyframe)) = reached.min_by(|a, b| a.0.total_cmp(&b.0)) {
            *self = Clock { set_at: now, said: at, running: false, waiting: Some(keyframe) };
        } else if !timeline.repeats() && time >= duration {
            *self = Clock { set_at: now, said: duration, running: false, waiting: None };
        }
        self.time(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::touring::tests::timeline;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the frames take, the clock is where the time says, and it waits at the same keyframes.
        #[test]
        fn frames_do_not_matter(steps in prop::collection::vec(1e-4..1.5f64, 1..60)) {
            let timeline = timeline(false);
            let mut clock = Clock::default();
            clock.run(100.0, &timeline);
            let (mut now, mut waited) = (100.0, 0.0);
            for step in steps {
                now += step;
                let said = clock.tick(now, &timeline);
                let expected = (now - 100.0 - waited).min(timeline.duration());
                match clock.waiting() {
                    None => prop_assert!((said - expected).abs() < 1e-9, "{said} {expected}"),
                    Some(keyframe) => {
                        prop_assert_eq!(said, timeline.stops()[keyframe].arrive);
                        prop_assert_eq!(clock.tick(now + 7.0, &timeline), said, "it stands");
                        clock.run(now, &timeline);
                        // The pause is passed over: the presenter was waited for instead.
                        let leave = timeline.stops()[keyframe].leave;
                        prop_assert!((clock.time(now) - leave).abs() < 1e-9);
                        waited = now - 100.0 - leave;
                    }
                }
            }
        }
    }

    #[test]
    fn it_stands_goes_on_and_begins_again() {
        let timeline = timeline(false);
        let mut clock = Clock::default();
        clock.run(0.0, &timeline);
        assert_eq!(clock.tick(1.0, &timeline), 1.0);
        clock.stand(1.5);
        assert_eq!((clock.tick(9.0, &timeline), clock.is_running()), (1.5, false));
        clock.run(10.0, &timeline);
        assert_eq!(clock.tick(10.25, &timeline), 1.75);
        clock.set(11.0, timeline.duration() + 5.0);
        assert_eq!(clock.tick(12.0, &timeline), timeline.duration(), "it ends");
        assert!(!clock.is_running());
        clock.run(13.0, &timeline);
        assert_eq!(clock.tick(13.5, &timeline), 0.5, "from the beginning");
    }

    #[test]
    fn a_tour_that_repeats_waits_in_every_round() {
        let timeline = timeline(true);
        let hold = timeline.stops().iter().position(|stop| stop.hold).unwrap();
        let mut clock = Clock::default();
        clock.run(0.0, &timeline);
        for round in 0..3 {
            let said = clock.tick(1e3 * f64::from(round + 1), &timeline);
            assert_eq!(clock.waiting(), Some(hold));
            let expected = timeline.stops()[hold].arrive + f64::from(round) * timeline.duration();
            assert!((said - expected).abs() < 1e-9, "{said} {expected}");
            clock.run(1e3 * f64::from(round + 1), &timeline);
        }
    }
}
