//! How many requests at a time a link takes: as many as keep it busy for 0.3 s beyond its latency, so that it never idles and
//! the newest wish never waits long behind old ones.

use std::time::{Duration, Instant};

/// Time for which requests wait at the server's end or in the link, beyond the latency, seconds.
const QUEUE_SECS: f64 = 0.3;
/// Requests at a time at least: one is on its way while the next one is asked for.
const FEWEST: f64 = 2.0;
/// Requests at a time at most.
const MOST: f64 = 64.0;
/// Requests at a time before anything is known.
const FIRST: f64 = 4.0;
/// Bytes are counted for so long before they make a rate.
const COUNTED: Duration = Duration::from_millis(250);
/// Requests that a server has refused together halve the window once.
const TOGETHER: Duration = Duration::from_millis(250);

/// What has come of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// So many bytes, the first after so long.
    Came(u64, Duration),
    /// The server wants fewer requests, or may do better with them.
    TooMany,
    /// Nothing, for another reason.
    Failed,
}

/// What is known of a link, by the requests so far.
#[derive(Debug)]
pub(super) struct Traffic {
    in_flight: usize,
    /// Bytes that have come within `busy`.
    bytes: u64,
    /// Time for which something was under way, up to `since`.
    busy: Duration,
    since: Instant,
    /// Bytes per second; 0 before that is known.
    rate: f64,
    /// Shortest time to the first byte, which grows again slowly.
    latency_secs: f64,
    /// Mean length of what is asked for, bytes.
    length: f64,
    window: f64,
    halved: Option<Instant>,
}

impl Traffic {
    /// Nothing is known yet.
    pub fn new(now: Instant) -> Traffic {
        let (rate, latency_secs, length, window) = (0.0, f64::INFINITY, 0.0, FIRST);
        let (bytes, busy, since) = (0, Duration::ZERO, now);
        Traffic { in_flight: 0, bytes, busy, since, rate, latency_secs, length, window, halved: None }
    }

    /// Requests that serve best at a time.
    pub fn at_once(&self) -> usize {
        self.window as usize
    }

    /// A request is sent.
    pub fn begin(&mut self, now: Instant) {
        if self.in_flight == 0 {
            self.since = now;
        }
        self.in_flight += 1;
    }

    /// A request has ended.
    pub fn end(&mut self, outcome: Outcome, now: Instant) {
        let was_full = self.in_flight >= self.at_once();
        self.in_flight = self.in_flight.saturating_sub(1);
        let (bytes, first) = match outcome {
            Outcome::Came(bytes, first) => (bytes, first),
            Outcome::Failed => return,
            Outcome::TooMany => {
                if self.halved.is_none_or(|then| now.duration_since(then) > TOGETHER) {
                    self.window = (0.5 * self.window).max(FEWEST);
                    self.halved = Some(now);
                }
                return;
            }
        };
        self.bytes += bytes;
        self.length = if self.length == 0.0 { bytes as f64 } else { 0.9 * self.length + 0.1 * bytes as f64 };
        self.latency_secs = first.as_secs_f64().min(1.02 * self.latency_secs);
        self.busy += now.duration_since(self.since);
        self.since = now;
        // What has come together at the end of a burst says nothing by itself.
        let is_first = self.rate == 0.0 && self.in_flight == 0 && !self.busy.is_zero();
        if self.busy >= COUNTED || is_first {
            let rate = self.bytes as f64 / self.busy.as_secs_f64();
            self.rate = if self.rate == 0.0 { rate } else { 0.5 * (self.rate + rate) };
            (self.bytes, self.busy) = (0, Duration::ZERO);
        }
        // A link that was asked for less than it takes has not shown what it takes.
        if was_full && self.rate > 0.0 {
            let most = self.rate * (self.latency_secs + QUEUE_SECS) / self.length.max(1.0);
            // One more for each round trip of all.
            self.window = (self.window + 1.0 / self.window).min(most.clamp(FEWEST, MOST));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: u64 = 3 << 20;

    /// Keeps the window full for some seconds on a link of so many bytes per second and so many seconds of latency, which sends one page
    /// after the other; `refuses` more than so many at a time. The windows of the last half.
    fn windows(rate: f64, latency: f64, refuses: usize) -> (usize, usize) {
        let start = Instant::now();
        let at = |secs: f64| start + Duration::from_secs_f64(secs);
        let mut traffic = Traffic::new(start);
        // When each request ends, and whether it is answered.
        let mut under_way: Vec<(f64, bool)> = Vec::new();
        let (mut now, mut link_free, mut seen) = (0.0_f64, 0.0_f64, Vec::new());
        while now < 60.0 {
            while under_way.len() < traffic.at_once() {
                traffic.begin(at(now));
                let is_served = under_way.len() < refuses;
                let end = match is_served {
                    true => {
                        link_free = f64::max(link_free, now + latency) + PAGE as f64 / rate;
                        link_free
                    }
                    false => now + latency,
                };
                under_way.push((end, is_served));
            }
            let next = (0..under_way.len()).min_by(|a, b| under_way[*a].0.total_cmp(&under_way[*b].0)).unwrap();
            let (end, is_served) = under_way.swap_remove(next);
            now = end;
            let first = Duration::from_secs_f64(latency);
            traffic.end(if is_served { Outcome::Came(PAGE, first) } else { Outcome::TooMany }, at(now));
            if now > 30.0 {
                seen.push(traffic.at_once());
            }
        }
        (seen.iter().copied().min().unwrap(), seen.iter().copied().max().unwrap())
    }

    #[test]
    fn the_window_fits_the_link() {
        // Rate in Mbit/s, latency, and what keeps the link busy for 0.3 s more, by a third at either side.
        for (megabits, latency) in [(20.0, 0.03), (100.0, 0.15), (1000.0, 0.03), (1000.0, 0.15), (10_000.0, 0.15)] {
            let rate = megabits * 1e6 / 8.0;
            let fits = (rate * (latency + QUEUE_SECS) / PAGE as f64).clamp(FEWEST, MOST);
            let (least, most) = windows(rate, latency, usize::MAX);
            let name = format!("{megabits} Mbit/s, {latency} s: {least} to {most}, expected {fits}");
            assert!(least as f64 >= (0.6 * fits).floor().max(FEWEST) && most as f64 <= 1.4 * fits + 1.0, "{name}");
        }
    }

    #[test]
    fn bursts_do_not_make_a_link_look_faster() {
        let (mut now, mut traffic) = (Instant::now(), Traffic::new(Instant::now()));
        let (latency, rate, bytes) = (Duration::from_millis(50), 4e6, 1_000_000);
        for _ in 0..200 {
            let count = traffic.at_once() as u32;
            (0..count).for_each(|_| traffic.begin(now));
            let end = now + latency + Duration::from_secs_f64(f64::from(count) * bytes as f64 / rate);
            (0..count).for_each(|i| traffic.end(Outcome::Came(bytes, latency), end + i * Duration::from_millis(1)));
            now = end + Duration::from_millis(500);
            // 4 MB/s for 0.35 s.
            assert!(traffic.at_once() <= 4, "{traffic:?}");
        }
        assert_eq!(traffic.at_once(), 2);
    }

    #[test]
    fn a_server_that_refuses_is_asked_for_less() {
        let (least, most) = windows(1e9, 0.05, 8);
        assert!((2..=8).contains(&least) && most <= 10, "{least} to {most}");
    }
}
