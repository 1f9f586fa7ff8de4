//! A curve in a frame with ticks: heights along a line.

use super::display_list::{Anchor, Area, At, DisplayList, Rgba, Shape};
use super::paint::{Paper, paint};
use super::ticks::ticks;
use super::{QUIET, TEXT};
use crate::color::Image;

/// Room beside the frame: left, top, right and bottom, logical pixels.
const ROOM: [f32; 4] = [84.0, 34.0, 24.0, 52.0];
/// Pixels per em of numbers, and of titles.
const SMALL: f32 = 12.0;
const TITLE: f32 = 14.0;
/// Lines of the grid, and where the curve has no values.
const GRID: Rgba = [70, 74, 82, 255];
const GAP: Rgba = [44, 46, 50, 255];
/// The curve.
const INK: Rgba = [0x7f, 0xbd, 0xff, 255];
/// Empty share of the range above and below the curve.
const MARGIN: f64 = 0.06;

/// What is plotted.
#[derive(Clone, Copy, Debug)]
pub struct Curve<'a> {
    /// What it is of.
    pub title: &'a str,
    /// What goes to the right, with its unit.
    pub across: &'a str,
    /// What goes up, with its unit.
    pub up: &'a str,
    /// Points in order of the first; where the second is no number there is a gap between the points around it.
    pub points: &'a [[f64; 2]],
}

impl Curve<'_> {
    /// The plot as a picture, dark on white.
    pub fn picture(&self, [width, height]: [u32; 2]) -> Image {
        let mut image = Image::black(width, height);
        image.rgba.fill([255; 4]);
        let mut list = DisplayList::new([width as f32, height as f32]);
        self.layout(&mut list);
        paint(&mut image, &list, 1.0, Paper::Light);
        image
    }

    /// Adds the plot, as large as the list; nothing where that leaves no room for the curve.
    pub fn layout(&self, list: &mut DisplayList) {
        let [left, top, right, bottom] = ROOM;
        let frame = Area { min: [left, top], max: [list.size[0] - right, list.size[1] - bottom] };
        if frame.max[0] - frame.min[0] < 20.0 || frame.max[1] - frame.min[1] < 20.0 {
            return;
        }
        let Some(ranges) = self.ranges() else {
            list.text([0.5 * list.size[0], 0.5 * list.size[1]], Anchor::CENTER, "nothing was measured", TITLE, TEXT);
            return;
        };
        let at = |point: [f64; 2]| -> At {
            let share = |k: usize| ((point[k] - ranges[k][0]) / (ranges[k][1] - ranges[k][0])) as f32;
            let [width, height] = [0, 1].map(|k| frame.max[k] - frame.min[k]);
            [share(0).mul_add(width, frame.min[0]), frame.max[1] - share(1) * height]
        };
        for [from, to] in self.gaps() {
            let area = Area {
                min: [at([from, 0.0])[0], frame.min[1]],
                max: [at([to, 0.0])[0].max(at([from, 0.0])[0] + 1.0), frame.max[1]],
            };
            list.shapes.push(Shape::Rect { area, color: GAP });
        }
        axes(list, frame, ranges);
        for run in self.points.split(|point| point[1].is_nan()) {
            let line = thinned(run.iter().map(|point| at(*point)));
            if let [alone] = line[..] {
                list.line([alone[0] - 0.5, alone[1]], [alone[0] + 0.5, alone[1]], 1.5, INK);
            }
            for ends in line.windows(2) {
                list.line(ends[0], ends[1], 1.5, INK);
            }
        }
        let middle = 0.5 * (frame.min[0] + frame.max[0]);
        list.text([middle, frame.max[1] + 26.0], Anchor::TOP, self.across, TITLE, TEXT);
        list.text([frame.min[0], frame.min[1] - 8.0], Anchor([0.0, 1.0]), self.up, TITLE, TEXT);
        list.text([frame.max[0], frame.min[1] - 8.0], Anchor::RIGHT_BOTTOM, self.title, TITLE, QUIET);
    }

    /// What the frame holds along both axes; `None` where no point has a value.
    fn ranges(&self) -> Option<[[f64; 2]; 2]> {
        let known = || self.points.iter().filter(|point| point[1].is_finite());
        known().next()?;
        let range = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
        };
        let wide = |[low, high]: [f64; 2], margin: f64| {
            let span = high - low;
            if span > 1e-12 * low.abs().max(high.abs()) && span.is_finite() {
                [low - margin * span, high + margin * span]
            } else {
                let about = 0.5 * low.abs().max(high.abs()).clamp(1e-6, 1e300);
                [low - about, high + about]
            }
        };
        let across = range(&mut self.points.iter().map(|point| point[0]));
        Some([wide(across, 0.0), wide(range(&mut known().map(|point| point[1])), MARGIN)])
    }

    /// From where to where there are no values.
    fn gaps(&self) -> Vec<[f64; 2]> {
        let is_gap = |k: usize| self.points[k][1].is_nan();
        let mut gaps = Vec::new();
        let mut k = 0;
        while k < self.points.len() {
            let first = k;
            while k < self.points.len() && is_gap(k) {
                k += 1;
            }
            if k > first {
                let from = self.points[first.saturating_sub(1)][0];
                gaps.push([from, self.points[k.min(self.points.len() - 1)][0]]);
            }
            k += 1;
        }
        gaps
    }
}

/// The frame, with lines at ticks and numbers beside them.
fn axes(list: &mut DisplayList, frame: Area, [across, up]: [[f64; 2]; 2]) {
    let Area { min: [left, top], max: [right, bottom] } = frame;
    for tick in ticks(up, false) {
        let y = bottom - tick.place as f32 * (bottom - top);
        list.line([left, y], [right, y], 1.0, GRID);
        list.text_if_free([left - 8.0, y], Anchor::RIGHT, &tick.label.unwrap_or_default(), SMALL, QUIET);
    }
    for tick in ticks(across, false) {
        let x = left + tick.place as f32 * (right - left);
        list.line([x, top], [x, bottom], 1.0, GRID);
        list.text_if_free([x, bottom + 6.0], Anchor::TOP, &tick.label.unwrap_or_default(), SMALL, QUIET);
    }
    for (from, to) in [([left, top], [right, top]), ([left, bottom], [right, bottom])] {
        list.line(from, to, 1.0, QUIET);
    }
    for x in [left, right] {
        list.line([x, top], [x, bottom], 1.0, QUIET);
    }
}

/// The same line with at most four places in each half of a pixel: the first, the highest, the lowest and the last.
fn thinned(line: impl Iterator<Item = At>) -> Vec<At> {
    let column = |at: At| (2.0 * at[0]).floor();
    let mut thin: Vec<At> = Vec::new();
    let mut held: Vec<(usize, At)> = Vec::new();
    let flush = |held: &mut Vec<(usize, At)>, thin: &mut Vec<At>| {
        held.sort_by_key(|(number, _)| *number);
        held.dedup_by_key(|(number, _)| *number);
        thin.extend(held.drain(..).map(|(_, at)| at));
    };
    for (number, at) in line.enumerate() {
        match &mut held[..] {
            [first, high, low, last] if column(first.1) == column(at) => {
                *last = (number, at);
                if at[1] < high.1[1] {
                    *high = (number, at);
                }
                if at[1] > low.1[1] {
                    *low = (number, at);
                }
            }
            _ => {
                flush(&mut held, &mut thin);
                held = vec![(number, at); 4];
            }
        }
    }
    flush(&mut held, &mut thin);
    thin
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curve<'a>(points: &'a [[f64; 2]]) -> Curve<'a> {
        Curve { title: "a.tif", across: "distance [m]", up: "height [m]", points }
    }

    /// How many pixels of a column are of the curve's colour.
    fn inked(image: &Image, x: u32) -> Vec<u32> {
        let is_ink = |y: &u32| {
            let [r, g, b, _] = image.rgba[(y * image.width + x) as usize];
            b > r.saturating_add(60) && b >= g
        };
        (0..image.height).filter(is_ink).collect()
    }

    #[test]
    fn the_curve_is_where_its_values_are_and_gaps_are_open() {
        // A slope, a gap from 400 to 600, and another slope.
        let points = [[0.0, 0.0], [400.0, 4.0], [500.0, f64::NAN], [600.0, 6.0], [1000.0, 10.0]];
        let image = curve(&points).picture([1000, 400]);
        let [left, top, right, bottom] = ROOM.map(f64::from);
        for share in [0.1, 0.35, 0.7, 0.9] {
            let x = left + share * (1000.0 - left - right);
            let y = 400.0 - bottom - (share + MARGIN) / (1.0 + 2.0 * MARGIN) * (400.0 - top - bottom);
            let found = inked(&image, x as u32);
            assert!(
                !found.is_empty() && found.iter().all(|found| (f64::from(*found) - y).abs() < 3.0),
                "{found:?} {y}"
            );
        }
        let middle = left + 0.5 * (1000.0 - left - right);
        assert!(inked(&image, middle as u32).is_empty());
        assert_ne!(image.rgba[(200 * 1000 + middle as u32) as usize], [255; 4]);
    }

    #[test]
    fn nothing_that_is_odd_is_harmful() {
        for points in [
            &[][..],
            &[[0.0, f64::NAN]],
            &[[0.0, 5.0]],
            &[[0.0, 5.0], [0.0, 5.0]],
            &[[0.0, -1e308], [1.0, 1e308], [2.0, f64::NAN]],
            &[[1e300, 1.0], [1.5e300, f64::INFINITY]],
        ] {
            for size in [[1, 1], [300, 200]] {
                let image = curve(points).picture(size);
                assert_eq!(image.rgba.len(), (size[0] * size[1]) as usize);
            }
        }
    }

    proptest! {
        #[test]
        fn thinned_lines_keep_their_ends_and_extremes(line in prop::collection::vec((0.0..40.0f32, -9.0..9.0f32), 0..400)) {
            let mut line: Vec<At> = line.into_iter().map(|(x, y)| [x, y]).collect();
            line.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let thin = thinned(line.iter().copied());
            prop_assert!(thin.len() <= 4 * 80 && thin.len() <= line.len());
            prop_assert_eq!((thin.first(), thin.last()), (line.first(), line.last()));
            for column in 0..80 {
                let of = |line: &[At]| {
                    let own = line.iter().filter(|at| (2.0 * at[0]).floor() as i32 == column);
                    own.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], at| [a.min(at[1]), b.max(at[1])])
                };
                prop_assert_eq!(of(&thin), of(&line));
            }
        }
    }
}
