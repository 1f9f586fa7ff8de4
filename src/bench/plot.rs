//! Plots as SVG. A line and some ticks need no plotting library, which would bring more crates than all of the bench has.

use std::fmt::Write;

/// Width of a plot, height of a panel, and the space for labels at the left and below, pixels.
pub(super) const WIDTH: f64 = 900.0;
pub(super) const HEIGHT: f64 = 150.0;
const LEFT: f64 = 64.0;
const BELOW: f64 = 22.0;
const ABOVE: f64 = 24.0;
const RIGHT: f64 = 16.0;
/// Points of a line at most.
pub(super) const MOST_POINTS: usize = 2000;
pub(super) const INK: &str = "#1f5fa8";

/// A panel's place and ranges.
pub(super) struct Panel {
    pub top: f64,
    pub height: f64,
    pub x: [f64; 2],
    pub y: [f64; 2],
}

impl Panel {
    pub fn x(&self, value: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (value - self.x[0]) / (self.x[1] - self.x[0])
    }

    pub fn y(&self, value: f64) -> f64 {
        let room = self.height - ABOVE - BELOW;
        self.top + ABOVE + room * (1.0 - (value - self.y[0]) / (self.y[1] - self.y[0]))
    }

    /// Title, frame, grid and numbers.
    pub fn axes(&self, out: &mut String, title: &str) {
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
    pub fn line(&self, out: &mut String, color: &str, points: impl Iterator<Item = (f64, f64)>) {
        out.push_str(r##"<polyline fill="none" stroke-width="1.2" stroke=""##);
        out.push_str(color);
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

pub(super) fn document(height: f64, body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} \
         {height}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" \
         fill=\"white\"/>\n{body}</svg>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

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
