//! How fast the camera moves and pages come, and how far ahead of the camera to read because of that.

use super::ahead::LookAhead;
use glam::DVec3;
use std::time::Duration;

/// Share of the past that each new measurement of the disk leaves. No setting: it counts reads and not time, so that after some
/// twenty pages a slow disk is known as well as a fast one. How far ahead is read for what is known is [`LookAhead::loads`].
const KEEP: f64 = 0.95;
/// Time over which the camera's speed is smoothed, seconds. No setting: a steady camera's way ahead does not depend on it, that of
/// one whose speed has changed is within 5 % after three times as long, and nothing but what is read ahead depends on that way.
const SPEED_SECS: f64 = 0.4;

/// Running estimates of the disk's latency and rate, and of the camera's speed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    /// Weighted sums of `1, x, y, x x, x y` over the reads: bytes `x` and seconds `y`.
    sums: [f64; 5],
    speed: f64,
    eye: Option<(DVec3, Duration)>,
}

impl Pace {
    /// A page of so many bytes has come, so long after it was asked for.
    pub fn loaded(&mut self, bytes: u64, took: Duration) {
        let (x, y) = (bytes as f64, took.as_secs_f64());
        for (sum, term) in self.sums.iter_mut().zip([1.0, x, y, x * x, x * y]) {
            *sum = KEEP * *sum + term;
        }
    }

    /// Seconds that a page of so many bytes takes to come: the line through the past reads with the least squared
    /// error, neither of whose parts may be negative. 0 before the first read.
    pub fn load_secs(&self, bytes: u64) -> f64 {
        let (latency, per_byte) = self.disk();
        latency + per_byte * bytes as f64
    }

    /// Latency in seconds, and seconds per byte.
    fn disk(&self) -> (f64, f64) {
        let [n, x, y, xx, xy] = self.sums;
        if n == 0.0 {
            return (0.0, 0.0);
        }
        let (mean_x, mean_y) = (x / n, y / n);
        let (variance, covariance) = (xx / n - mean_x * mean_x, xy / n - mean_x * mean_y);
        // Pages of one size do not tell latency from rate; then all of it counts as latency.
        let per_byte = if variance > 1e-6 * mean_x * mean_x { covariance / variance } else { 0.0 };
        let per_byte = per_byte.clamp(0.0, mean_y / mean_x.max(1.0));
        (mean_y - per_byte * mean_x, per_byte)
    }

    /// The camera's place at a time (since any fixed one).
    pub fn moved(&mut self, eye: DVec3, now: Duration) {
        if let Some((last, then)) = self.eye {
            let seconds = now.saturating_sub(then).as_secs_f64();
            if seconds <= 0.0 {
                return;
            }
            let keep = (-seconds / SPEED_SECS).exp();
            self.speed = keep * self.speed + (1.0 - keep) * eye.distance(last) / seconds;
        }
        self.eye = Some((eye, now));
    }

    /// The camera's speed, world units per second, smoothed.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// `d_prefetch` (F12 4.8.2): the way that the camera goes while a page of `largest` bytes comes, with some to spare.
    pub fn prefetch_distance(&self, largest: u64, ahead: &LookAhead) -> f64 {
        self.speed * (ahead.loads * self.load_secs(largest)).min(ahead.most_secs).max(ahead.least_secs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latency_and_rate_are_told_apart() {
        let mut pace = Pace::default();
        assert_eq!(pace.load_secs(1 << 20), 0.0);
        for i in 0..200_u32 {
            let bytes = 500_000 + u64::from(i % 7) * 400_000;
            // 50 ms and 100 MB/s, with some noise.
            let noise = 1.0 + 0.02 * f64::from(i % 3) - 0.02;
            pace.loaded(bytes, Duration::from_secs_f64(noise * (0.05 + bytes as f64 / 1e8)));
        }
        assert!((pace.load_secs(0) - 0.05).abs() < 5e-3, "{}", pace.load_secs(0));
        assert!((pace.load_secs(3_000_000) - 0.08).abs() < 5e-3);
        // Another disk is noticed within some dozens of reads.
        (0..100).for_each(|_| pace.loaded(3_000_000, Duration::from_millis(3)));
        assert!((pace.load_secs(3_000_000) - 0.003).abs() < 1e-3, "{}", pace.load_secs(3_000_000));
    }

    #[test]
    fn the_sphere_follows_the_speed() {
        let mut pace = Pace::default();
        (0..10).for_each(|_| pace.loaded(3_000_000, Duration::from_millis(500)));
        for i in 0..300 {
            let now = Duration::from_millis(20 * i);
            pace.moved(DVec3::X * 7.0 * now.as_secs_f64(), now);
        }
        assert!((pace.speed() - 7.0).abs() < 0.01);
        let ahead = LookAhead::default();
        assert!((pace.prefetch_distance(3_000_000, &ahead) - 7.0 * ahead.loads * 0.5).abs() < 0.05);
        let far = LookAhead { loads: 6.0, ..ahead };
        assert!((pace.prefetch_distance(3_000_000, &far) - 7.0 * 6.0 * 0.5).abs() < 0.1);
        let near = LookAhead { most_secs: 0.4, ..ahead };
        assert!((pace.prefetch_distance(3_000_000, &near) - 7.0 * 0.4).abs() < 0.05);
        let long = LookAhead { least_secs: 2.0, ..ahead };
        assert!((pace.prefetch_distance(3_000_000, &long) - 7.0 * 2.0).abs() < 0.05);
        for i in 300..500 {
            pace.moved(DVec3::X * 42.0, Duration::from_millis(20 * i));
        }
        assert!(pace.prefetch_distance(3_000_000, &ahead) < 0.05, "a camera at rest needs nothing ahead but turns");
    }
}
