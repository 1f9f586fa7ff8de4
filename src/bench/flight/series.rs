//! What a flight's frames were made of: the seven series of F12's figure 4.9, and what they come to.

use serde::Serialize;
use std::fmt::Write;

/// One frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Frame {
    /// When it began, seconds of the flight.
    pub seconds: f64,
    /// How long it took, milliseconds.
    pub frame_ms: f64,
    /// The part of that which went into streaming and selection.
    pub streaming_ms: f64,
    /// Bytes of pages in main memory.
    pub main_bytes: u64,
    /// Bytes that the disk has brought since the frame before.
    pub disk_bytes: u64,
    /// Bytes of copies in the adapter's memory.
    pub gpu_bytes: u64,
    /// Bytes that were copied there since the frame before.
    pub upload_bytes: u64,
    /// Particles in the drawn nodes.
    pub particles: u64,
    /// Those of them that the sample takes, see [`crate::picture::drawing_cost::within`].
    pub taken: u64,
    /// Drawn nodes.
    pub nodes: u64,
    /// Nodes that the frame lacked.
    pub missing: u64,
    /// Whether it lacked nothing.
    pub converged: bool,
    /// Largest screen-space error, pixels.
    pub error_px: f64,
    /// `d_prefetch`, world units.
    pub prefetch_distance: f64,
}

/// One of the series of figure 4.9.
pub struct Series {
    /// Name with unit.
    pub name: &'static str,
    /// A value for each frame.
    pub values: Vec<f64>,
}

/// Time over which rates are averaged, seconds: single frames bring pages or none.
const SMOOTH_SECS: f64 = 1.0;

/// The seven series.
pub fn series(frames: &[Frame]) -> Vec<Series> {
    let each = |name, value: fn(&Frame) -> f64| Series { name, values: frames.iter().map(value).collect() };
    vec![
        each("main memory [MiB]", |frame| frame.main_bytes as f64 / f64::from(1 << 20)),
        Series { name: "disk [MB/s]", values: rate(frames, |frame| frame.disk_bytes as f64 / 1e6) },
        each("GPU memory [MiB]", |frame| frame.gpu_bytes as f64 / f64::from(1 << 20)),
        Series { name: "upload [MB/s]", values: rate(frames, |frame| frame.upload_bytes as f64 / 1e6) },
        Series { name: "frames per second", values: rate(frames, |_| 1.0) },
        Series { name: "million particles/s", values: rate(frames, |frame| frame.particles as f64 / 1e6) },
        each("million particles/frame", |frame| frame.particles as f64 / 1e6),
    ]
}

/// A quantity's rate per second, averaged over the last [`SMOOTH_SECS`].
fn rate(frames: &[Frame], amount: fn(&Frame) -> f64) -> Vec<f64> {
    let end = |frame: &Frame| frame.seconds + 1e-3 * frame.frame_ms;
    let mut first = 0;
    let mut sum = 0.0;
    frames
        .iter()
        .enumerate()
        .map(|(i, frame)| {
            sum += amount(frame);
            while first < i && end(frame) - frames[first].seconds > SMOOTH_SECS {
                sum -= amount(&frames[first]);
                first += 1;
            }
            sum / (end(frame) - frames[first].seconds).max(1e-9)
        })
        .collect()
}

/// All frames as comma-separated values with a header.
pub fn csv(frames: &[Frame]) -> String {
    let series = series(frames);
    let mut text = String::from(
        "seconds,main_bytes,disk_bytes_per_s,gpu_bytes,upload_bytes_per_s,frames_per_s,particles_per_s,particles,\
         taken,frame_ms,streaming_ms,nodes,missing,converged,error_px,prefetch_distance\n",
    );
    for (i, f) in frames.iter().enumerate() {
        let rate = |index: usize, factor: f64| series[index].values[i] * factor;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:.4},{},{:.0},{},{:.0},{:.3},{:.0},{},{},{:.3},{:.3},{},{},{},{:.4},{:.6e}",
            f.seconds,
            f.main_bytes,
            rate(1, 1e6),
            f.gpu_bytes,
            rate(3, 1e6),
            rate(4, 1.0),
            rate(5, 1e6),
            f.particles,
            f.taken,
            f.frame_ms,
            f.streaming_ms,
            f.nodes,
            f.missing,
            u8::from(f.converged),
            f.error_px,
            f.prefetch_distance
        );
    }
    text
}

/// What a flight comes to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Number of frames.
    pub frames: usize,
    /// Frames divided by the flight's seconds.
    pub frames_per_second: f64,
    /// Standard deviation of the frames' own rates, per second.
    pub frames_per_second_deviation: f64,
    /// Milliseconds of the middle frame.
    pub frame_ms_p50: f64,
    /// Milliseconds of a frame in the mean.
    pub frame_ms_mean: f64,
    /// Milliseconds that 95 of 100 frames do not exceed.
    pub frame_ms_p95: f64,
    /// Milliseconds that 99 of 100 frames do not exceed.
    pub frame_ms_p99: f64,
    /// Milliseconds of streaming and selection that 99 of 100 frames do not exceed.
    pub streaming_ms_p99: f64,
    /// Share of the frames that lacked something.
    pub not_converged: f64,
    /// Worst screen-space error of those, pixels; 0 if there are none.
    pub worst_error_px: f64,
    /// Medians over the frames.
    pub main_mib: f64,
    /// The most that was ever in main memory.
    pub main_mib_most: f64,
    /// Mean over the flight.
    pub disk_mb_per_s: f64,
    /// The most of any second.
    pub disk_mb_per_s_most: f64,
    /// Median over the frames.
    pub gpu_mib: f64,
    /// Mean over the flight.
    pub upload_mb_per_s: f64,
    /// The most of any second.
    pub upload_mb_per_s_most: f64,
    /// Mean over the flight, millions.
    pub million_particles_per_second: f64,
    /// Median over the frames, millions.
    pub million_particles: f64,
    /// Particles that samples took, as a share of those in the drawn nodes: the median over the frames.
    pub sampled: f64,
    /// Mean colour error in motion, of 255, from everything in view, where pictures were compared.
    pub color_error: Option<f64>,
}

/// The value below which a share of the values lies; 0 for none.
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * share).ceil() as usize).copied().unwrap_or(0.0)
}

impl Summary {
    /// Adds up a flight's frames.
    pub fn of(frames: &[Frame]) -> Summary {
        let series = series(frames);
        let median = |index: usize| quantile(series[index].values.iter().copied(), 0.5);
        let most = |index: usize| series[index].values.iter().copied().fold(0.0, f64::max);
        let seconds: f64 = 1e-3 * frames.iter().map(|frame| frame.frame_ms).sum::<f64>();
        let per_second = |amount: fn(&Frame) -> f64| frames.iter().map(amount).sum::<f64>() / seconds.max(1e-9);
        let lacking = frames.iter().filter(|frame| !frame.converged);
        let count = frames.len().max(1) as f64;
        let rates = || frames.iter().map(|frame| 1e3 / frame.frame_ms.max(1e-6));
        let mean_rate = rates().sum::<f64>() / count;
        Summary {
            frames: frames.len(),
            frames_per_second: frames.len() as f64 / seconds.max(1e-9),
            frames_per_second_deviation: (rates().map(|rate| (rate - mean_rate).powi(2)).sum::<f64>() / count).sqrt(),
            frame_ms_p50: quantile(frames.iter().map(|frame| frame.frame_ms), 0.5),
            frame_ms_mean: 1e3 * seconds / count,
            frame_ms_p95: quantile(frames.iter().map(|frame| frame.frame_ms), 0.95),
            frame_ms_p99: quantile(frames.iter().map(|frame| frame.frame_ms), 0.99),
            streaming_ms_p99: quantile(frames.iter().map(|frame| frame.streaming_ms), 0.99),
            not_converged: lacking.clone().count() as f64 / count,
            worst_error_px: lacking.map(|frame| frame.error_px).fold(0.0, f64::max),
            main_mib: median(0),
            main_mib_most: most(0),
            disk_mb_per_s: per_second(|frame| frame.disk_bytes as f64 / 1e6),
            disk_mb_per_s_most: most(1),
            gpu_mib: median(2),
            upload_mb_per_s: per_second(|frame| frame.upload_bytes as f64 / 1e6),
            upload_mb_per_s_most: most(3),
            million_particles_per_second: per_second(|frame| frame.particles as f64 / 1e6),
            million_particles: median(6),
            sampled: quantile(frames.iter().map(|frame| frame.taken as f64 / frame.particles.max(1) as f64), 0.5),
            color_error: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames() -> Vec<Frame> {
        let frame = |i: u32| Frame {
            seconds: 0.1 * f64::from(i),
            frame_ms: if i == 70 { 300.0 } else { 100.0 },
            disk_bytes: 2_000_000,
            particles: 1_000_000,
            converged: !i.is_multiple_of(10),
            error_px: 0.5 + f64::from(i),
            ..Frame::default()
        };
        (0..100).map(frame).collect()
    }

    #[test]
    fn rates_and_quantiles_come_out() {
        let summary = Summary::of(&frames());
        assert_eq!((summary.frames, summary.frame_ms_p50), (100, 100.0));
        assert_eq!((summary.frame_ms_p95, summary.frame_ms_p99, summary.not_converged), (100.0, 300.0, 0.1));
        assert!((summary.frame_ms_mean - 102.0).abs() < 1e-9);
        assert_eq!(summary.worst_error_px, 90.5);
        assert!((summary.frames_per_second - 100.0 / 10.2).abs() < 1e-9);
        assert!((summary.disk_mb_per_s_most - 20.0).abs() < 2.1);
        assert_eq!(Summary::of(&[]).frames, 0);
        assert_eq!(quantile([3.0, 1.0, 2.0], 0.5), 2.0);
    }

    #[test]
    fn every_frame_is_a_line_with_all_columns() {
        let text = csv(&frames());
        let columns = text.lines().next().unwrap().split(',').count();
        assert_eq!(text.lines().count(), 101);
        assert!(text.lines().all(|line| line.split(',').count() == columns));
    }
}
