//! Plots of flights: the series over the time, and the frame rate over the size of the picture.

use super::super::plot::{HEIGHT, INK, MOST_POINTS, Panel, document};
use super::series::{Frame, series};

/// The seven series, one panel each, over the seconds of the flight.
pub fn flight(frames: &[Frame]) -> String {
    let first = frames.first().map_or(0.0, |frame| frame.seconds);
    let last = frames.last().map_or(1.0, |frame| frame.seconds).max(first + 1e-3);
    let series = series(frames);
    let mut body = String::new();
    for (i, series) in series.iter().enumerate() {
        let most = series.values.iter().copied().fold(0.0, f64::max);
        let y = [0.0, if most > 0.0 { 1.08 * most } else { 1.0 }];
        let panel = Panel { top: HEIGHT * i as f64, height: HEIGHT, x: [first, last], y };
        panel.axes(&mut body, series.name);
        let stride = frames.len().div_ceil(MOST_POINTS).max(1);
        let points = frames.iter().zip(&series.values).map(|(frame, &value)| (frame.seconds, value));
        panel.line(&mut body, INK, points.step_by(stride));
    }
    document(HEIGHT * series.len() as f64, &body)
}

/// Frame rate (mean and standard deviation) over the number of pixels, as in F12's figure 4.11.
pub fn sweep(points: &[((u32, u32), f64, f64)]) -> String {
    const TALL: f64 = 420.0;
    let pixels = |size: (u32, u32)| f64::from(size.0) * f64::from(size.1) / 1e6;
    let widest = points.iter().map(|point| pixels(point.0)).fold(0.1, f64::max);
    let most = points.iter().map(|point| point.1 + point.2).fold(1e-3, f64::max);
    let panel = Panel { top: 0.0, height: TALL, x: [0.0, 1.1 * widest], y: [0.0, 1.1 * most] };
    let mut body = String::new();
    panel.axes(&mut body, "frames per second over million pixels");
    panel.line(&mut body, INK, points.iter().map(|&(size, rate, _)| (pixels(size), rate)));
    for &((width, height), rate, deviation) in points {
        let x = panel.x(pixels((width, height)));
        let [low, middle, high] = [(rate - deviation).max(0.0), rate, rate + deviation].map(|value| panel.y(value));
        body.push_str(&format!(
            "<line x1=\"{x:.1}\" y1=\"{low:.1}\" x2=\"{x:.1}\" y2=\"{high:.1}\" stroke=\"{INK}\"/><circle cx=\"{x:.1}\" \
             cy=\"{middle:.1}\" r=\"3\" fill=\"{INK}\"/><text x=\"{:.1}\" y=\"{:.1}\">{width}x{height}</text>\n",
            x + 6.0,
            middle - 8.0
        ));
    }
    document(TALL, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_are_svg_with_a_line_for_each_series() {
        let frames: Vec<Frame> = (0..5000)
            .map(|i| Frame { seconds: 0.01 * f64::from(i), frame_ms: 10.0, particles: 7, ..Frame::default() })
            .collect();
        let text = flight(&frames);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert_eq!(text.matches("<polyline").count(), 7);
        assert!(text.len() < 1 << 20 && !text.contains("NaN") && !text.contains("inf"));
        assert!(!flight(&[]).contains("NaN"));
        let text = sweep(&[((600, 400), 60.0, 2.0), ((1200, 800), 30.0, 4.0)]);
        assert!(text.contains("1200x800") && text.matches("<circle").count() == 2);
    }
}
