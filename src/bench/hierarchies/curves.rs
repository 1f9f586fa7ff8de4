//! Curves of the error over splats, bytes and milliseconds, a line for each hierarchy: laid out once, as a picture and as SVG.

use super::{Outcome, Way};
use crate::annotate::display_list::{Area, At};
use crate::annotate::svg::svg;
use crate::annotate::ticks::ticks;
use crate::annotate::{Anchor, DisplayList, Paper, QUIET, Rgba, Shape, TEXT, paint, roomy};
use crate::bench::plot::WIDTH;
use crate::bench::splat::Failure;
use crate::color::{Image, output};
use std::path::Path;

/// Height of a panel, pixels.
const TALL: f32 = 320.0;
/// Room beside a panel's frame: left, top, right (for names) and bottom.
const ROOM: [f32; 4] = [72.0, 30.0, 150.0, 34.0];
/// Pixels per em of titles, and of names and numbers.
const TITLE: f32 = 13.0;
const SMALL: f32 = 12.0;
/// How far names are apart.
const STEP: f32 = 18.0;
/// Diameter of a point.
const DOT: f32 = 6.0;
/// Pixels of the picture to one of the layout.
const SCALE: f32 = 2.0;
/// Lines at numbers, as it is on white.
const GRID: Rgba = [221, 221, 221, 255];
/// Lines on white, one for each way: as far as they go, those that Okabe and Ito tell apart.
const COLORS: [Rgba; 14] = [
    [0x00, 0x72, 0xb2, 255],
    [0xd5, 0x5e, 0x00, 255],
    [0x00, 0x9e, 0x73, 255],
    [0xcc, 0x79, 0xa7, 255],
    [0xe6, 0x9f, 0x00, 255],
    [0x56, 0xb4, 0xe9, 255],
    [0x00, 0x00, 0x00, 255],
    [0x7b, 0x2d, 0x8e, 255],
    [0x8c, 0x4a, 0x1f, 255],
    [0x7a, 0x8c, 0x00, 255],
    [0x88, 0x88, 0x88, 255],
    [0xb3, 0x12, 0x3b, 255],
    [0x00, 0xa5, 0xa0, 255],
    [0x3f, 0x3f, 0xbf, 255],
];

/// A quantity of an outcome; `None` where it has none.
type Quantity = fn(&Outcome) -> Option<f64>;

/// What errors are drawn over.
const QUANTITIES: [(&str, Quantity); 3] = [
    ("L2 error over splats", |own| Some(own.splats as f64)),
    ("L2 error over bytes that are read", |own| own.bytes_read.map(|bytes| bytes as f64)),
    ("L2 error over milliseconds of a frame", |own| Some(own.frame_ms.median)),
];

/// Points of a hierarchy: a quantity, and the error.
type Curve = (Way, Vec<[f64; 2]>);

/// Writes the curves of the mean error of all views as `curves.png` and `curves.svg`.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, outcomes: &[Outcome]) -> Result<(), Failure> {
    let list = layout(outcomes);
    output::write_png(&folder.join("curves.png"), &picture(&list))?;
    output::write_atomically(&folder.join("curves.svg"), svg(&list, Paper::Light).as_bytes())?;
    Ok(())
}

/// A colour on white as display lists, which are meant for dark pictures, have it: paper makes it what it was.
fn on_white(color: Rgba) -> Rgba {
    Paper::Light.ink(color)
}

/// A panel for each quantity.
fn layout(outcomes: &[Outcome]) -> DisplayList {
    let mut ways: Vec<Way> = outcomes.iter().map(|own| own.hierarchy).collect();
    ways.sort_unstable();
    ways.dedup();
    let width = WIDTH as f32;
    let mut list = DisplayList::new([width, TALL * QUANTITIES.len() as f32]);
    for (number, (title, quantity)) in QUANTITIES.into_iter().enumerate() {
        let (top, [left, above, right, below]) = (TALL * number as f32, ROOM);
        let frame = Area { min: [left, top + above], max: [width - right, top + TALL - below] };
        list.text([left, top + above - 8.0], Anchor([0.0, 1.0]), title, TITLE, TEXT);
        let curves: Vec<Curve> = ways.iter().map(|way| (*way, curve(outcomes, *way, quantity))).collect();
        panel(&mut list, frame, &curves);
    }
    list
}

/// The means over the views, in order of the budgets. What is exact has no place along a logarithm.
fn curve(outcomes: &[Outcome], way: Way, quantity: Quantity) -> Vec<[f64; 2]> {
    let own = || outcomes.iter().filter(|own| own.hierarchy == way);
    let mut budgets: Vec<u64> = own().map(|own| own.budget).collect();
    budgets.sort_unstable();
    budgets.dedup();
    let point = |budget: &u64| {
        let at: Vec<&Outcome> = own().filter(|own| own.budget == *budget).collect();
        let count = at.len() as f64;
        let along: f64 = at.iter().map(|own| quantity(own)).sum::<Option<f64>>()? / count;
        let error: f64 = at.iter().map(|own| own.error_l2).sum::<f64>() / count;
        let point = [along, error];
        point.iter().all(|value| *value > 0.0 && value.is_finite()).then_some(point)
    };
    budgets.iter().filter_map(point).collect()
}

/// A frame with both axes logarithmic, the curves in it, and their names at its right.
fn panel(list: &mut DisplayList, frame: Area, curves: &[Curve]) {
    let Area { min: [left, top], max: [right, bottom] } = frame;
    for (from, to) in [([left, top], [right, top]), ([left, bottom], [right, bottom])] {
        list.line(from, to, 1.0, QUIET);
    }
    for x in [left, right] {
        list.line([x, top], [x, bottom], 1.0, QUIET);
    }
    let along = |axis: usize| roomy(curves.iter().flat_map(|(_, points)| points).map(|point| point[axis]), true);
    let (Some(across), Some(up)) = (along(0), along(1)) else {
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        list.text(middle, Anchor::CENTER, "nothing was measured", TITLE, QUIET);
        return;
    };
    axes(list, frame, [across, up]);
    let share = |value: f64, [low, high]: [f64; 2]| ((value / low).ln() / (high / low).ln()) as f32;
    let place = |point: &[f64; 2]| -> At {
        [left + share(point[0], across) * (right - left), bottom - share(point[1], up) * (bottom - top)]
    };
    for (row, (way, points)) in curves.iter().filter(|(_, points)| !points.is_empty()).enumerate() {
        let color = on_white(COLORS[*way as usize]);
        let y = top + STEP * (row as f32 + 0.5);
        let places: Vec<At> = points.iter().map(place).collect();
        for ends in places.windows(2) {
            list.line(ends[0], ends[1], 1.5, color);
        }
        list.line([right + 12.0, y], [right + 32.0, y], 1.5, color);
        for center in places.into_iter().chain([[right + 22.0, y]]) {
            // A line as wide as the point, with nothing left in the middle.
            list.shapes.push(Shape::Circle { center, radius: 0.25 * DOT, width: 0.5 * DOT, color });
        }
        list.text([right + 40.0, y], Anchor::LEFT, &way.to_string(), SMALL, TEXT);
    }
}

/// Lines at round values and the values beside them, and short marks between.
fn axes(list: &mut DisplayList, frame: Area, [across, up]: [[f64; 2]; 2]) {
    let Area { min: [left, top], max: [right, bottom] } = frame;
    let grid = on_white(GRID);
    for tick in ticks(up, true) {
        let y = bottom - tick.place as f32 * (bottom - top);
        list.line([left - 4.0, y], [left, y], 1.0, QUIET);
        if let Some(label) = tick.label {
            list.line([left, y], [right, y], 1.0, grid);
            list.text_if_free([left - 8.0, y], Anchor::RIGHT, &label, SMALL, QUIET);
        }
    }
    for tick in ticks(across, true) {
        let x = left + tick.place as f32 * (right - left);
        list.line([x, bottom], [x, bottom + 4.0], 1.0, QUIET);
        if let Some(label) = tick.label {
            list.line([x, top], [x, bottom], 1.0, grid);
            list.text_if_free([x, bottom + 6.0], Anchor::TOP, &label, SMALL, QUIET);
        }
    }
}

/// The curves on white.
fn picture(list: &DisplayList) -> Image {
    let [width, height] = list.size.map(|side| (SCALE * side) as u32);
    let mut image = Image { width, height, rgba: vec![[255; 4]; width as usize * height as usize] };
    paint(&mut image, list, SCALE, Paper::Light);
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;
    use std::collections::BTreeSet;

    #[test]
    fn each_hierarchy_has_its_own_colour() {
        assert_eq!(COLORS.len(), Way::value_variants().len());
        assert_eq!(COLORS.iter().collect::<BTreeSet<_>>().len(), COLORS.len());
        assert!(COLORS.iter().all(|color| on_white(on_white(*color)) == *color));
    }

    #[test]
    fn curves_have_points_and_axes_have_values() {
        let mut outcomes: Vec<Outcome> = [(100, 0.3), (1000, 0.1), (10_000, 0.02)]
            .map(|(splats, error)| Outcome::of_tests(Way::Pca, splats, splats, error))
            .into();
        let list = layout(&outcomes);
        let text = svg(&list, Paper::Light);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert!(text.contains(">1000</text>") && text.contains(">0.1</text>"), "{text}");
        assert!(!text.contains("log10") && !text.contains("NaN") && !text.contains("inf"));
        // Splats and milliseconds, three points and one beside the name; of no bytes there is no curve.
        assert_eq!((text.matches("<circle").count(), text.matches(">pca</text>").count()), (8, 2));
        assert_eq!(text.matches(">nothing was measured</text>").count(), 1);
        let image = picture(&list);
        assert_eq!((image.width, image.height), (1800, 1920));
        assert!(image.rgba.iter().filter(|pixel| **pixel == COLORS[Way::Pca as usize]).count() > 100);

        // A single point shows, and what is exact harms nothing.
        outcomes.truncate(1);
        outcomes.push(Outcome::of_tests(Way::Sample, 100, 100, 0.0));
        let text = svg(&layout(&outcomes), Paper::Light);
        assert_eq!((text.matches("<circle").count(), text.matches(">sample<").count()), (4, 0));
        assert!(!text.contains("NaN") && !text.contains("inf"));
        assert!(!svg(&layout(&[]), Paper::Light).contains("NaN"));
    }
}
