//! Plots as SVG. A line and some ticks need no plotting library, which would bring more crates than all of the bench has.

use super::hierarchies::Outcome;
use super::splat::Failure;
use std::fmt::Write;
use std::path::Path;

/// Width of a plot, height of a panel, and the space for labels at the left and below, pixels.
const WIDTH: f64 = 900.0;
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

/// Colours of lines that are told apart (Okabe and Ito).
const COLORS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555"];

/// A quantity of an outcome; `None` where it has none.
type Quantity = fn(&Outcome) -> Option<f64>;

/// Writes curves of the mean error over splats, bytes and milliseconds, as `curves.svg`: one line for each hierarchy.
///
/// # Errors
/// When the file cannot be written.
pub(super) fn write_curves(folder: &Path, outcomes: &[Outcome]) -> Result<(), Failure> {
    const TALL: f64 = 320.0;
    let quantities: [(&str, Quantity); 3] = [
        ("log10 of the L2 error over log10 of the splats", |own| Some(own.splats as f64)),
        ("log10 of the L2 error over log10 of the bytes that are read", |own| own.bytes_read.map(|bytes| bytes as f64)),
        ("log10 of the L2 error over log10 of the milliseconds of a frame", |own| Some(own.frame_ms.median)),
    ];
    let mut names: Vec<&str> = Vec::new();
    for own in outcomes {
        if !names.contains(&own.hierarchy.as_str()) {
            names.push(&own.hierarchy);
        }
    }
    let mut body = String::new();
    for (number, (title, quantity)) in quantities.into_iter().enumerate() {
        let curves: Vec<Vec<(f64, f64)>> = names.iter().map(|name| curve(outcomes, name, quantity)).collect();
        let all = || curves.iter().flatten();
        let range = |of: fn(&(f64, f64)) -> f64| {
            let (low, high) = all().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            if low < high { [low - 0.05 * (high - low), high + 0.05 * (high - low)] } else { [-1.0, 1.0] }
        };
        let panel = Panel { top: TALL * number as f64, height: TALL, x: range(|p| p.0), y: range(|p| p.1) };
        panel.axes(&mut body, title);
        for (index, (name, curve)) in names.iter().zip(&curves).enumerate() {
            let color = COLORS[index % COLORS.len()];
            panel.line(&mut body, color, curve.iter().copied());
            let (x, y) = (panel.x(panel.x[1]) - 120.0, panel.y(panel.y[1]) + 16.0 + 15.0 * index as f64);
            let _ = writeln!(body, "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{color}\">{name}</text>");
        }
    }
    let path = folder.join("curves.svg");
    let text = document(TALL * quantities.len() as f64, &body);
    std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()).into())
}

/// The points of a hierarchy, means over the views, as logarithms in order of the budgets.
fn curve(outcomes: &[Outcome], name: &str, quantity: Quantity) -> Vec<(f64, f64)> {
    let own = || outcomes.iter().filter(|own| own.hierarchy == name);
    let mut budgets: Vec<u64> = own().map(|own| own.budget).collect();
    budgets.sort_unstable();
    budgets.dedup();
    let point = |budget: &u64| {
        let at: Vec<&Outcome> = own().filter(|own| own.budget == *budget).collect();
        let count = at.len() as f64;
        let along: f64 = at.iter().map(|own| quantity(own)).sum::<Option<f64>>()? / count;
        let error: f64 = at.iter().map(|own| own.error_l2).sum::<f64>() / count;
        (along > 0.0 && error > 0.0).then(|| (along.log10(), error.log10()))
    };
    budgets.iter().filter_map(point).collect()
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
