//! Plots of many values in a frame with ticks, linear or logarithmic: histograms, tables of two axes with a bar of their colours, points,
//! and lines with spreads. Laid out once, as a picture and as SVG.

use super::display_list::{Anchor, Area, At, DisplayList, Rgba, Shape};
use super::paint::{Paper, paint};
use super::svg::svg;
use super::ticks::ticks;
use super::{QUIET, TEXT};
use crate::color::Image;
use crate::color::colormap::ColorMap;

/// Size that letters are made for, logical pixels; larger and smaller pictures have larger and smaller ones.
const USUAL: [f32; 2] = [900.0, 600.0];
/// Room beside the frame: left, top, right and bottom, logical pixels.
const ROOM: [f32; 4] = [92.0, 62.0, 28.0, 78.0];
/// Further room at the right for a bar of colours.
const BAR_ROOM: f32 = 92.0;
/// Width of that bar, and its distance from the frame.
const BAR: f32 = 16.0;
const BAR_GAP: f32 = 18.0;
/// Colours of a table.
const CLASSES: usize = 64;
/// Pixels per em of numbers, and of titles.
const SMALL: f32 = 12.0;
const TITLE: f32 = 14.0;
/// Lines at numbers, bars, points and lines, and spreads, as they are on white.
const GRID: Rgba = [225, 225, 225, 255];
const FILL: Rgba = [0x56, 0x9c, 0xcc, 255];
const INK: Rgba = [0x00, 0x72, 0xb2, 255];
const SPREAD: Rgba = [0x9c, 0xc4, 0xde, 255];
/// Edge of a point.
const POINT: f32 = 2.0;

/// An axis of a plot, or what colours mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartAxis<'a> {
    /// What it is, with its unit.
    pub title: &'a str,
    /// From where to where it goes; ascending, and positive where it is logarithmic.
    pub range: [f64; 2],
    /// Whether it is logarithmic.
    pub logarithmic: bool,
}

impl ChartAxis<'_> {
    /// Where a value is: 0 at the beginning, 1 at the end, and not beyond them. What a logarithm has no place for is at the beginning.
    pub fn share(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        let share = match self.logarithmic {
            true if value <= 0.0 => 0.0,
            true => (value / low).ln() / (high / low).ln(),
            false => (value - low) / (high - low),
        };
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }

    /// The value at a share of the way, and that of an end beyond it: what [`ChartAxis::share`] came from.
    pub fn value(&self, share: f64) -> f64 {
        let [low, high] = self.range;
        // The ends as they are, not as the logarithm rounds them.
        let value = match share {
            share if share <= 0.0 => low,
            share if share >= 1.0 => high,
            share if self.logarithmic => low * (high / low).powf(share),
            share => low + (high - low) * share,
        };
        value.max(low).min(high)
    }
}

/// The range of finite values (positive ones alone of a logarithmic axis) with some room at both ends; `None` of none.
pub fn roomy(values: impl Iterator<Item = f64>, logarithmic: bool) -> Option<[f64; 2]> {
    let is_placed = |value: &f64| value.is_finite() && (!logarithmic || *value > 0.0);
    let place = |value: f64| if logarithmic { value.ln() } else { value };
    let ends = |[low, high]: [f64; 2], value: f64| [low.min(value), high.max(value)];
    let [low, high] = values.filter(is_placed).map(place).fold([f64::INFINITY, f64::NEG_INFINITY], ends);
    if low > high {
        return None;
    }
    let size = low.abs().max(high.abs());
    let least = if logarithmic {
        3_f64.ln()
    } else if low < high {
        1e-6 * size.max(1e-300)
    } else if size > 0.0 {
        // About one value alone there is room for round numbers.
        0.2 * size
    } else {
        2.0
    };
    let margin = (0.04 * (high - low)).max(0.5 * (least - (high - low)));
    let range = [low - margin, high + margin];
    Some(if logarithmic { range.map(f64::exp) } else { range })
}

/// What is in the frame.
#[derive(Clone, Copy, Debug)]
pub enum Marks<'a> {
    /// A bar for each bin, from zero to its value; a logarithmic axis begins at its lower end.
    Bars {
        /// Edges of the bins: one more than there are values.
        edges: &'a [f64],
        /// How high each is.
        values: &'a [f64],
    },
    /// A cell for each pair of bins. Cells whose value is not positive are left empty.
    Cells {
        /// Edges of the bins to the right and upwards.
        edges: [&'a [f64]; 2],
        /// Row by row from the lowest, the first axis along a row.
        values: &'a [f64],
        /// What the colours mean.
        colors: ChartAxis<'a>,
    },
    /// Points; those that logarithmic axes have no place for are left out.
    Points {
        /// To the right.
        x: &'a [f64],
        /// Upwards, as many.
        y: &'a [f64],
    },
    /// A line through points.
    Line {
        /// Points in order of the first.
        points: &'a [[f64; 2]],
        /// From where to where each of them spreads upwards; none, or as many as there are points.
        spreads: &'a [[f64; 2]],
    },
}

/// A plot.
#[derive(Clone, Copy, Debug)]
pub struct Chart<'a> {
    /// What it is of.
    pub title: &'a str,
    /// What is to be said of it, below.
    pub note: &'a str,
    /// To the right.
    pub across: ChartAxis<'a>,
    /// Upwards.
    pub up: ChartAxis<'a>,
    /// What is shown.
    pub marks: Marks<'a>,
}

impl Chart<'_> {
    /// The plot as a picture, dark on white.
    pub fn picture(&self, [width, height]: [u32; 2]) -> Image {
        let scale = scale([width, height]);
        let mut image = Image::black(width, height);
        image.rgba.fill([255; 4]);
        paint(&mut image, &self.list([width, height]), scale, Paper::Light);
        image
    }

    /// The plot as SVG, of that many pixels at its own size.
    pub fn svg(&self, [width, height]: [u32; 2]) -> String {
        let text = svg(&self.list([width, height]), Paper::Light);
        let [own_width, own_height] = [width, height].map(|side| side as f32 / scale([width, height]));
        let size = format!(r#"width="{own_width}" height="{own_height}" viewBox"#);
        text.replacen(&size, &format!(r#"width="{width}" height="{height}" viewBox"#), 1)
    }

    /// The plot in logical pixels.
    fn list(&self, [width, height]: [u32; 2]) -> DisplayList {
        let scale = scale([width, height]);
        let mut list = DisplayList::new([width, height].map(|side| side as f32 / scale));
        self.layout(&mut list);
        list
    }

    /// Adds the plot, as large as the list, for light paper; nothing where that leaves no room for a frame.
    pub fn layout(&self, list: &mut DisplayList) {
        let [left, top, right, bottom] = ROOM;
        let right = if matches!(self.marks, Marks::Cells { .. }) { right + BAR_ROOM } else { right };
        let frame = Area { min: [left, top], max: [list.size[0] - right, list.size[1] - bottom] };
        if frame.max[0] - frame.min[0] < 20.0 || frame.max[1] - frame.min[1] < 20.0 {
            return;
        }
        list.text([0.5 * list.size[0], 10.0], Anchor::TOP, self.title, TITLE, TEXT);
        list.text([frame.min[0], top - 8.0], Anchor([0.0, 1.0]), self.up.title, TITLE, TEXT);
        let middle = 0.5 * (frame.min[0] + frame.max[0]);
        list.text([middle, frame.max[1] + 26.0], Anchor::TOP, self.across.title, TITLE, TEXT);
        list.text([left, list.size[1] - 8.0], Anchor([0.0, 1.0]), self.note, SMALL, QUIET);
        self.numbers(list, frame);
        let ink = |color: Rgba| Paper::Light.ink(color);
        match self.marks {
            Marks::Bars { edges, values } => {
                let zero = self.at(frame, [0.0, 0.0])[1];
                for (ends, &value) in edges.windows(2).zip(values) {
                    let [from, to] = [ends[0], ends[1]].map(|edge| self.at(frame, [edge, value]));
                    if from[1] != zero && value.is_finite() {
                        let area = Area { min: [from[0], from[1].min(zero)], max: [to[0], from[1].max(zero)] };
                        list.shapes.push(Shape::Rect { area, color: ink(FILL) });
                    }
                }
            }
            Marks::Cells { edges, values, colors } => self.cells(list, frame, edges, values, &colors),
            Marks::Points { x, y } => {
                let is_placed = |point: &[f64; 2]| {
                    let mut axes = point.iter().zip([&self.across, &self.up]);
                    axes.all(|(value, axis)| value.is_finite() && (!axis.logarithmic || *value > 0.0))
                };
                let points = x.iter().zip(y).map(|(&x, &y)| [x, y]).filter(is_placed);
                for center in points.map(|point| self.at(frame, point)) {
                    let area = Area { min: center, max: center }.grown(0.5 * POINT);
                    list.shapes.push(Shape::Rect { area, color: ink(INK) });
                }
            }
            Marks::Line { points, spreads } => {
                for (&[x, _], &[low, high]) in points.iter().zip(spreads) {
                    if low.is_finite() && high.is_finite() {
                        list.line(self.at(frame, [x, low]), self.at(frame, [x, high]), 3.0, ink(SPREAD));
                    }
                }
                for ends in points.windows(2) {
                    list.line(self.at(frame, ends[0]), self.at(frame, ends[1]), 1.5, ink(INK));
                }
                for &point in points {
                    let center = self.at(frame, point);
                    // A line as wide as the point, with nothing left in the middle.
                    list.shapes.push(Shape::Circle { center, radius: 1.5, width: 3.0, color: ink(INK) });
                }
            }
        }
        edge(list, frame);
    }

    /// A place in the frame.
    fn at(&self, frame: Area, [x, y]: [f64; 2]) -> At {
        let [width, height] = [0, 1].map(|k| frame.max[k] - frame.min[k]);
        [frame.min[0] + self.across.share(x) as f32 * width, frame.max[1] - self.up.share(y) as f32 * height]
    }

    /// Lines at round values and the values beside them, and short marks between.
    fn numbers(&self, list: &mut DisplayList, frame: Area) {
        let Area { min: [left, top], max: [right, bottom] } = frame;
        let grid = Paper::Light.ink(GRID);
        let is_open = !matches!(self.marks, Marks::Cells { .. });
        for tick in ticks(self.up.range, self.up.logarithmic) {
            let y = bottom - tick.place as f32 * (bottom - top);
            list.line([left - 4.0, y], [left, y], 1.0, QUIET);
            if let Some(label) = tick.label {
                if is_open {
                    list.line([left, y], [right, y], 1.0, grid);
                }
                list.text_if_free([left - 8.0, y], Anchor::RIGHT, &label, SMALL, QUIET);
            }
        }
        for tick in ticks(self.across.range, self.across.logarithmic) {
            let x = left + tick.place as f32 * (right - left);
            list.line([x, bottom], [x, bottom + 4.0], 1.0, QUIET);
            if let Some(label) = tick.label {
                if is_open {
                    list.line([x, top], [x, bottom], 1.0, grid);
                }
                list.text_if_free([x, bottom + 6.0], Anchor::TOP, &label, SMALL, QUIET);
            }
        }
    }

    /// The cells by their colours, and the bar that says what those mean.
    fn cells(&self, list: &mut DisplayList, frame: Area, edges: [&[f64]; 2], values: &[f64], colors: &ChartAxis) {
        let inks = class_colors();
        let class = |value: f64| ((colors.share(value) * CLASSES as f64) as usize).min(CLASSES - 1);
        let [across, up] = edges;
        let columns = across.len().saturating_sub(1).max(1);
        let mut cells: Vec<(usize, Area)> = Vec::new();
        for (row, values) in values.chunks(columns).enumerate().take(up.len().saturating_sub(1)) {
            let mut column = 0;
            while column < values.len() {
                let first = column;
                column += 1;
                if !(values[first] > 0.0 && values[first].is_finite()) {
                    continue;
                }
                // Neighbours of one colour in a row are one.
                let own = class(values[first]);
                while column < values.len() && values[column] > 0.0 && class(values[column]) == own {
                    column += 1;
                }
                let [left, bottom] = self.at(frame, [across[first], up[row]]);
                let [right, top] = self.at(frame, [across[column], up[row + 1]]);
                cells.push((own, Area { min: [left, top], max: [right, bottom] }));
            }
        }
        cells.sort_by_key(|(class, _)| *class);
        list.shapes.extend(cells.into_iter().map(|(class, area)| Shape::Rect { area, color: inks[class] }));

        let left = frame.max[0] + BAR_GAP;
        let bar = Area { min: [left, frame.min[1]], max: [left + BAR, frame.max[1]] };
        let height = bar.max[1] - bar.min[1];
        let at = |share: f32| bar.max[1] - share * height;
        for (class, &color) in inks.iter().enumerate() {
            let [low, high] = [class, class + 1].map(|class| at(class as f32 / CLASSES as f32));
            list.shapes.push(Shape::Rect { area: Area { min: [bar.min[0], high], max: [bar.max[0], low] }, color });
        }
        edge(list, bar);
        for tick in ticks(colors.range, colors.logarithmic) {
            let y = at(tick.place as f32);
            list.line([bar.max[0], y], [bar.max[0] + 4.0, y], 1.0, QUIET);
            if let Some(label) = tick.label {
                list.text_if_free([bar.max[0] + 8.0, y], Anchor::LEFT, &label, SMALL, QUIET);
            }
        }
        let right = list.size[0] - 8.0;
        list.text([right, frame.min[1] - 8.0], Anchor::RIGHT_BOTTOM, colors.title, TITLE, TEXT);
    }
}

/// Pixels to a logical one.
fn scale([width, height]: [u32; 2]) -> f32 {
    (width as f32 / USUAL[0]).min(height as f32 / USUAL[1]).clamp(0.5, 16.0)
}

/// The colours of the classes from low to high, for light paper.
fn class_colors() -> Vec<Rgba> {
    let colors = ColorMap::named("viridis").unwrap_or_default().sample(CLASSES);
    let byte = |component: f32| (255.0 * component).round() as u8;
    colors.into_iter().map(|[r, g, b]| Paper::Light.ink([byte(r), byte(g), byte(b), 255])).collect()
}

/// The four sides of an area.
fn edge(list: &mut DisplayList, Area { min: [left, top], max: [right, bottom] }: Area) {
    for y in [top, bottom] {
        list.line([left, y], [right, y], 1.0, QUIET);
    }
    for x in [left, right] {
        list.line([x, top], [x, bottom], 1.0, QUIET);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ACROSS: ChartAxis = ChartAxis { title: "density [g/cm^3]", range: [1.0, 1e4], logarithmic: true };
    const UP: ChartAxis = ChartAxis { title: "temperature [K]", range: [0.0, 8.0], logarithmic: false };

    fn chart(marks: Marks<'_>) -> Chart<'_> {
        Chart { title: "a.df", note: "every particle", across: ACROSS, up: UP, marks }
    }

    fn pixels(image: &Image, color: Rgba) -> usize {
        image.rgba.iter().filter(|pixel| **pixel == color).count()
    }

    proptest! {
        #[test]
        fn values_and_shares_are_inverse(
            low in 1e-6..1e6f64, span in 1e-3..1e9f64, share in 0.0..=1.0f64, logarithmic: bool
        ) {
            let axis = ChartAxis { title: "", range: [low, low + span], logarithmic };
            let value = axis.value(share);
            prop_assert!((low..=low + span).contains(&value));
            prop_assert!((axis.share(value) - share).abs() < 1e-5, "{value}");
            prop_assert_eq!([-0.5, 0.0, 1.0, 7.0].map(|end| axis.value(end)), [low, low, low + span, low + span]);
        }
    }

    #[test]
    fn bars_cover_as_much_as_their_values_say() {
        let (edges, values) = ([1.0, 10.0, 100.0, 1e3, 1e4], [8.0, 0.0, 4.0, f64::NAN]);
        let image = chart(Marks::Bars { edges: &edges, values: &values }).picture([900, 600]);
        let [left, top, right, bottom] = ROOM;
        let area = (900.0 - left - right) * (600.0 - top - bottom);
        let share = pixels(&image, FILL) as f32 / area;
        assert!((share - 0.375).abs() < 0.01, "{share}");
        // Negative ones hang from zero, and nothing is below those that are zero.
        let up = ChartAxis { range: [-4.0, 4.0], ..UP };
        let marks = Marks::Bars { edges: &edges, values: &[2.0, 0.0, -4.0, 0.0] };
        let image = Chart { up, ..chart(marks) }.picture([900, 600]);
        let share = pixels(&image, FILL) as f32 / area;
        assert!((share - 0.1875).abs() < 0.01, "{share}");
    }

    #[test]
    fn cells_have_the_colours_of_the_bar_and_empty_ones_none() {
        let colors = ChartAxis { title: "mass", range: [1.0, 100.0], logarithmic: true };
        let (across, up) = ([1.0, 100.0, 1e4], [0.0, 4.0, 8.0]);
        let values = [1.0, 100.0, 0.0, f64::NAN];
        let plot = chart(Marks::Cells { edges: [&across, &up], values: &values, colors });
        let image = plot.picture([900, 600]);
        let [left, top, right, bottom] = ROOM;
        let area = (900.0 - left - right - BAR_ROOM) * (600.0 - top - bottom);
        let inks = class_colors();
        for ink in [inks[0], inks[CLASSES - 1]] {
            let share = pixels(&image, Paper::Light.ink(ink)) as f32 / area;
            assert!((share - 0.25).abs() < 0.01, "{share}");
        }
        let text = plot.svg([900, 600]);
        assert!(text.contains(">temperature [K]</text>") && text.contains(">mass</text>") && text.contains(">1000<"));
        assert!(plot.svg([1800, 1200]).contains(r#"width="1800" height="1200" viewBox="0 0 900 600""#));
    }

    #[test]
    fn nothing_that_is_odd_is_harmful() {
        let odd = [f64::NAN, -1.0, 0.0, f64::INFINITY, 1e308];
        let points = odd.map(|value| [value, value]);
        for marks in [
            Marks::Bars { edges: &odd, values: &odd },
            Marks::Cells { edges: [&odd, &odd], values: &odd, colors: ACROSS },
            Marks::Cells { edges: [&[], &[]], values: &odd, colors: ACROSS },
            Marks::Points { x: &odd, y: &odd },
            Marks::Line { points: &points, spreads: &points },
        ] {
            for size in [[1, 1], [300, 200], [900, 600]] {
                assert_eq!(chart(marks).picture(size).rgba.len(), (size[0] * size[1]) as usize);
                assert!(!chart(marks).svg(size).contains("NaN"));
            }
        }
        assert_eq!(roomy(odd.into_iter().take(3), true), None);
        assert_eq!(roomy(std::iter::empty(), false), None);
        let [low, high] = roomy([5.0, 5.0].into_iter(), false).unwrap();
        assert!(low < 5.0 && high > 5.0);
        // The axis of one value has numbers that fit beside it.
        for value in [0.0, 0.286_978_617_860_480_9, -3e7] {
            let up = ChartAxis { range: roomy([value].into_iter(), false).unwrap(), ..UP };
            let points = [[10.0, value]];
            let text = Chart { up, ..chart(Marks::Line { points: &points, spreads: &[] }) }.svg([900, 600]);
            let labels = text.matches(r#"text-anchor="end""#).count();
            assert!(labels > 1, "{value}: {text}");
        }
    }
}
