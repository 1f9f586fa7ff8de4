//! The legend at the lower right: an upright bar of colours with ticks and a unit, or a field of brightness and hue.

use super::display_list::{Anchor, Area, At, DisplayList, Rgba, Shape};
use super::legend::{Legend, LegendAxis};
use super::{QUIET, TEXT, font};

/// Width of the bar without hue, logical pixels.
const BAR: f32 = 14.0;
/// Width of the bar with a curve of the opacity over it.
const CURVED: f32 = 32.0;
/// Width of the field with hue.
const FIELD: f32 = 84.0;
/// Pixels per em of ticks' labels and units.
const SMALL: f32 = 12.0;
/// Pixels per em of titles.
const TITLE: f32 = 13.0;
/// Lines around colours.
const FRAME: Rgba = [0x2a, 0x2f, 0x38, 255];
/// Behind colours, so that dark ones have an edge.
const BACK: Rgba = [0, 0, 0, 140];

/// Adds the legend; nothing where the picture is too small for it.
pub fn layout(list: &mut DisplayList, legend: &Legend) {
    let [picture_width, picture_height] = list.size;
    let width = match (&legend.s, legend.opacity.is_empty()) {
        (Some(_), _) => FIELD,
        (None, false) => CURVED,
        (None, true) => BAR,
    };
    let below = if legend.s.is_some() { 78.0 } else { 26.0 };
    let above = 44.0;
    let height = (0.36 * picture_height).clamp(90.0, 280.0).min(picture_height - below - above);
    if height < 40.0 || picture_width < width + 120.0 {
        return;
    }
    let [right, bottom] = [picture_width - 22.0, picture_height - below];
    let bar = Area { min: [right - width, bottom - height], max: [right, bottom] };
    list.shapes.push(Shape::Rect { area: bar.grown(2.0), color: BACK });
    colors(list, bar, legend);
    opacity(list, bar, &legend.opacity);
    upright_ticks(list, bar, &legend.p);
    title(list, [right, bar.min[1] - 9.0], Anchor::RIGHT_BOTTOM, &legend.p);
    if let Some(axis) = &legend.s {
        level_ticks(list, bar, axis);
        title(list, [right, bottom + 25.0], Anchor::RIGHT_TOP, axis);
    }
    list.keep_free(Area { min: [bar.min[0] - 60.0, bar.min[1] - above], max: list.size });
}

/// The colours: brightness upwards, hue to the right.
fn colors(list: &mut DisplayList, bar: Area, legend: &Legend) {
    let (columns, rows) = if legend.s.is_some() { (29, 65) } else { (2, 97) };
    let place = |index: usize, count: usize| index as f32 / (count - 1) as f32;
    let color = |index: usize| {
        let hue = if legend.s.is_some() { place(index % columns, columns) } else { 0.5 };
        legend.color(1.0 - place(index / columns, rows), hue)
    };
    list.shapes.push(Shape::Mesh { area: bar, columns, colors: (0..columns * rows).map(color).collect() });
    let Area { min: [left, top], max: [right, bottom] } = bar.grown(0.5);
    for (from, to) in [
        ([left, top], [right, top]),
        ([left, bottom], [right, bottom]),
        ([left, top], [left, bottom]),
        ([right, top], [right, bottom]),
    ] {
        list.line(from, to, 1.0, FRAME);
    }
}

/// The opacity as a curve over the colours: invisible at the left side, opaque at the right one.
fn opacity(list: &mut DisplayList, bar: Area, opacity: &[f32]) {
    let steps = opacity.len().saturating_sub(1).max(1) as f32;
    let point = |(index, &opacity): (usize, &f32)| {
        let x = bar.min[0] + opacity.clamp(0.0, 1.0) * (bar.max[0] - bar.min[0]);
        [x, bar.max[1] - index as f32 / steps * (bar.max[1] - bar.min[1])]
    };
    let points: Vec<At> = opacity.iter().enumerate().map(point).collect();
    for (width, color) in [(3.0, [0, 0, 0, 150]), (1.2, [255, 255, 255, 230])] {
        for pair in points.windows(2) {
            list.line(pair[0], pair[1], width, color);
        }
    }
}

/// Ticks and labels at the left of the bar.
fn upright_ticks(list: &mut DisplayList, bar: Area, axis: &LegendAxis) {
    for tick in axis.ticks() {
        let y = bar.max[1] + (bar.min[1] - bar.max[1]) * tick.place as f32;
        let length = if tick.label.is_some() { 6.0 } else { 3.0 };
        list.line([bar.min[0] - length, y], [bar.min[0], y], 1.0, TEXT);
        if let Some(label) = tick.label {
            list.text_if_free([bar.min[0] - 9.0, y], Anchor::RIGHT, &label, SMALL, TEXT);
        }
    }
}

/// Ticks and labels under the field; labels that would run into each other are left out.
fn level_ticks(list: &mut DisplayList, bar: Area, axis: &LegendAxis) {
    for tick in axis.ticks() {
        let x = bar.min[0] + (bar.max[0] - bar.min[0]) * tick.place as f32;
        let length = if tick.label.is_some() { 6.0 } else { 3.0 };
        list.line([x, bar.max[1]], [x, bar.max[1] + length], 1.0, TEXT);
        if let Some(label) = tick.label {
            list.text_if_free([x, bar.max[1] + 7.0], Anchor::TOP, &label, SMALL, TEXT);
        }
    }
}

/// A title, and below it its unit in a quieter colour.
fn title(list: &mut DisplayList, at: At, anchor: Anchor, axis: &LegendAxis) {
    let line = font::extent("", TITLE)[1];
    let below = if axis.unit.is_empty() { 0.0 } else { line };
    let [first, second] = if anchor == Anchor::RIGHT_BOTTOM { [-below, 0.0] } else { [0.0, line] };
    list.text([at[0], at[1] + first], anchor, &axis.title, TITLE, TEXT);
    if !axis.unit.is_empty() {
        list.text([at[0], at[1] + second], anchor, &axis.unit, SMALL, QUIET);
    }
}
