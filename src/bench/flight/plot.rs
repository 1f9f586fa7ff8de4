//! Plots as SVG: the series of a flight over its time, and the frame rate over the size of the picture. A line and some
//! ticks need no plotting library, which would bring more crates than all of the bench has.

use super::series::{Frame, series};
use std::fmt::Write;

/// Width of a plot, height of a panel, and the space for labels at the left and below, pixels.
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 150.0;
const LEFT: f64 = 64.0;
const BELOW: f64 = 22.0;
const ABOVE: f64 = 24.0;
const RIGHT: f64 = 16.0;
/// Points of a line at most.
const MOST_POINTS: usize = 2000;
const INK: &str = "#1f5fa8";

/// A panel's place and ranges.
struct Panel {
    top: f64,
    height: f64,
    x: [f64; 2],
    y: [f64; 2],
}

impl Panel {
    fn x(&self, value: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (value - self.x[0]) / (self.x[1] - self.x[0])
    }

    fn y(&self, value: f64) -> f64 {
        let room = self.height - ABOVE - BELOW;
        self.top + ABOVE + room * (1.0 - (value - self.y[0]) / (self.y[1] - self.y[0]))
    }

    /// Title, frame, grid and numbers.
    fn axes(&self, out: &mut String, title: &str) {
        let (left, right) = (self.x(self.x[0]), self.x(self.x[1]));
        let (bottom, top) = (self.y(self.y[0]), self.y(self.y[1]));
        let mut add = |text: String| out.push_str(&text);
        add(format!(r##"<text x="{left}" y="{:.1}" font-weight="bold">{title}</text>"##, top - 7.0));
        for value in ticks(self.y, 4) {
            let y = self.y(value);
            add(format!(r##"<line x1="{left}" y1="{y:.1}" x2="{right}" y2="{y:.1}" stroke="#ddd"/>"##));
            add(format!(r##"<text x="{}" y="{:.1}" text-anchor="end">{}</text>"##, left - 6.0, y + 4.0, number(value)));
        }
        for value in ticks(self.x, 10) {
            let x = self.x(value);
            add(format!(r##"<line x1="{x:.1}" y1="{bottom}" x2="{x:.1}" y2="{:.1}" stroke="#888"/>"##, bottom + 4.0));
            let y = bottom + 16.0;
            add(format!(r##"<text x="{x:.1}" y="{y:.1}" text-anchor="middle">{}</text>"##, number(value)));
        }
        let (width, height) = (right - left, bottom - top);
        add(format!(r##"<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#888"/>"##));
        out.push('\n');
    }

    /// A line through points.
    fn line(&self, out: &mut String, points: impl Iterator<Item = (f64, f64)>) {
        out.push_str(r##"<polyline fill="none" stroke-width="1.2" stroke=""##);
        out.push_str(INK);
        out.push_str(r##"" points=""##);
        for (x, y) in points {
            // Writing to a string cannot fail.
            let _ = write!(out, "{:.1},{:.1} ", self.x(x), self.y(y));
        }
        out.push_str("\"/>\n");
    }
}

/// Round values within a range, about so many.
fn ticks([low, high]: [f64; 2], about: u32) -> Vec<f64> {
    let raw = (high - low) / f64::from(about);
    let power = 10_f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|&step| step >= raw);
    let step = step.unwrap_or(raw);
    let first = (low / step).ceil() as i64;
    (first..=(high / step + 1e-9).floor() as i64).map(|i| i as f64 * step).collect()
}

/// A number without digits that say nothing.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short.is_empty() || short == "-0" { "0".into() } else { short.into() }
}

fn document(height: f64, body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} \
         {height}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" \
         fill=\"white\"/>\n{body}</svg>\n"
    )
}

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
        panel.line(&mut body, points.step_by(stride));
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
    panel.line(&mut body, points.iter().map(|&(size, rate, _)| (pixels(size), rate)));
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

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks([0.0, 10.0], 4), [0.0, 5.0, 10.0]);
        assert_eq!(ticks([0.0, 0.9], 4).map_to_text(), "0 0.5");
        assert_eq!(number(1500.0), "1500");
        assert_eq!(number(-0.0), "0");
    }

    trait Text {
        fn map_to_text(&self) -> String;
    }

    impl Text for Vec<f64> {
        fn map_to_text(&self) -> String {
            self.iter().map(|&value| number(value)).collect::<Vec<_>>().join(" ")
        }
    }
}
