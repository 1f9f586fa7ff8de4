//! The colour bar: what the brightness (and hue) of the picture mean, with ticks and unit.

use crate::app::legend::Legend;
use crate::app::look::Look;
use crate::app::number;
use crate::app::panel::theme;
use crate::store::Metadata;
use bevy_egui::egui::{self, Align2, Color32, Rect, Stroke, StrokeKind, pos2, vec2};

/// Ticks of an axis: position from 0 to 1 and label; minor ticks have none.
pub fn ticks(range: [f64; 2], log: bool) -> Vec<(f64, Option<String>)> {
    let [low, high] = range;
    if !(high > low && low.is_finite() && high.is_finite()) || (log && low <= 0.0) {
        return Vec::new();
    }
    if log { log_ticks(low, high) } else { linear_ticks(low, high) }
}

/// A tick at each power of ten, labels as dense as is legible, minor ticks at 2 to 9 over a few decades.
fn log_ticks(low: f64, high: f64) -> Vec<(f64, Option<String>)> {
    let (a, b) = (low.log10(), high.log10());
    let decades = b - a;
    if decades < 1.2 {
        // Powers of ten alone would leave an axis of one decade bare.
        return linear_values(low, high)
            .map(|value| ((value.log10() - a) / decades, Some(number::quantity(value))))
            .collect();
    }
    let every = (decades / 6.0).ceil().max(1.0) as i32;
    let mut ticks = Vec::new();
    for exponent in a.floor() as i32..=b.ceil() as i32 {
        let position = (f64::from(exponent) - a) / decades;
        if (-1e-9..=1.0 + 1e-9).contains(&position) {
            ticks.push((position, (exponent.rem_euclid(every) == 0).then(|| number::power_of_ten(exponent))));
        }
        if decades <= 5.0 {
            for factor in 2..10 {
                let position = (f64::from(exponent) + f64::from(factor).log10() - a) / decades;
                if (0.0..=1.0).contains(&position) {
                    // One power of ten alone would not say where the others are.
                    let labelled = decades < 2.2 && (factor == 2 || factor == 5);
                    let value = || number::quantity(f64::from(factor) * 10f64.powi(exponent));
                    ticks.push((position, labelled.then(value)));
                }
            }
        }
    }
    ticks
}

fn linear_ticks(low: f64, high: f64) -> Vec<(f64, Option<String>)> {
    linear_values(low, high).map(|value| ((value - low) / (high - low), Some(number::quantity(value)))).collect()
}

/// Round values between `low` and `high`, about five.
fn linear_values(low: f64, high: f64) -> impl Iterator<Item = f64> {
    let raw = (high - low) / 5.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|f| f * power).into_iter().find(|s| *s >= raw * 0.999).unwrap_or(10.0 * power);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last.min(first + 20)).map(move |i| i as f64 * step)
}

/// Width of the bar without hue, logical pixels.
const BAR: f32 = 14.0;
/// Width of the field with hue.
const FIELD: f32 = 84.0;

/// Draws the legend at the lower right of the picture: an upright bar, or a field of brightness and hue.
pub fn draw(painter: &egui::Painter, picture: Rect, look: &Look, metadata: &Metadata) {
    let legend = Legend::of(look, metadata);
    let height = (0.36 * picture.height()).clamp(90.0, 280.0);
    let width = if legend.s.is_some() { FIELD } else { BAR };
    let below = if legend.s.is_some() { 78.0 } else { 26.0 };
    let right = picture.right() - 22.0;
    let bottom = picture.bottom() - below;
    let bar = Rect::from_min_max(pos2(right - width, bottom - height), pos2(right, bottom));
    painter.rect_filled(bar.expand(2.0), 2.0, Color32::from_black_alpha(140));
    paint_colors(painter, bar, look, legend.s.is_some());
    for (position, label) in ticks(legend.p.range, legend.p.log) {
        let y = egui::lerp(bar.bottom()..=bar.top(), position as f32);
        let length = if label.is_some() { 6.0 } else { 3.0 };
        painter.hline(bar.left() - length..=bar.left(), y, Stroke::new(1.0, theme::TEXT));
        if let Some(label) = label {
            theme::halo_text(painter, pos2(bar.left() - 9.0, y), Align2::RIGHT_CENTER, &label, 12.0, theme::TEXT);
        }
    }
    title(painter, pos2(right, bar.top() - 8.0), Align2::RIGHT_BOTTOM, &legend.p.title, &legend.p.unit);
    if let Some(axis) = &legend.s {
        let mut end = f32::NEG_INFINITY;
        for (position, label) in ticks(axis.range, axis.log) {
            let x = egui::lerp(bar.left()..=bar.right(), position as f32);
            let length = if label.is_some() { 6.0 } else { 3.0 };
            painter.vline(x, bar.bottom()..=bar.bottom() + length, Stroke::new(1.0, theme::TEXT));
            // Labels that would run into each other are left out.
            let Some(label) = label else { continue };
            let half = 0.5 * theme::text_size(painter, &label, 12.0).x;
            if x - half > end + 6.0 {
                theme::halo_text(painter, pos2(x, bar.bottom() + 7.0), Align2::CENTER_TOP, &label, 12.0, theme::TEXT);
                end = x + half;
            }
        }
        title(painter, pos2(right, bar.bottom() + 25.0), Align2::RIGHT_TOP, &axis.title, &axis.unit);
    }
}

/// A title, and below it its unit in a quieter colour.
fn title(painter: &egui::Painter, at: egui::Pos2, anchor: Align2, text: &str, unit: &str) {
    let below = if unit.is_empty() { 0.0 } else { 16.0 };
    let (first, second) = if anchor == Align2::RIGHT_BOTTOM { (-below, 0.0) } else { (0.0, 16.0) };
    theme::halo_text(painter, at + vec2(0.0, first), anchor, text, 13.0, theme::TEXT);
    theme::halo_text(painter, at + vec2(0.0, second), anchor, unit, 12.0, theme::LABEL);
}

/// The colours: brightness upwards, hue to the right.
fn paint_colors(painter: &egui::Painter, bar: Rect, look: &Look, hue: bool) {
    if !hue {
        theme::gradient(painter, bar, true, |t| look.color(t, 0.5));
        return;
    }
    const COLUMNS: usize = 28;
    const ROWS: usize = 64;
    let mut mesh = egui::Mesh::default();
    for row in 0..=ROWS {
        for column in 0..=COLUMNS {
            let (b, h) = (row as f32 / ROWS as f32, column as f32 / COLUMNS as f32);
            let at = pos2(egui::lerp(bar.left()..=bar.right(), h), egui::lerp(bar.bottom()..=bar.top(), b));
            mesh.colored_vertex(at, look.color(b, h));
        }
    }
    let index = |row: usize, column: usize| (row * (COLUMNS + 1) + column) as u32;
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let [a, b] = [index(row, column), index(row + 1, column)];
            mesh.add_triangle(a, a + 1, b);
            mesh.add_triangle(a + 1, b, b + 1);
        }
    }
    painter.add(mesh);
    painter.rect_stroke(bar, 0.0, Stroke::new(1.0, theme::LINE), StrokeKind::Outside);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_ticks_are_labelled_powers_of_ten() {
        let ticks = ticks([1e-5, 1e2], true);
        let labels: Vec<&str> = ticks.iter().filter_map(|(_, label)| label.as_deref()).collect();
        assert!(labels.contains(&"10¯⁴") && labels.contains(&"1"), "{labels:?}");
        assert!((2..=8).contains(&labels.len()));
        assert!(ticks.iter().all(|(position, _)| (-1e-6..=1.0 + 1e-6).contains(position)));
    }

    #[test]
    fn every_range_gets_a_few_labels() {
        for (range, log) in [
            ([0.0, 1.0], false),
            ([-250.0, 1200.0], false),
            ([3.1, 3.2], false),
            ([1.0, 3.0], true),
            ([1e-20, 1e20], true),
            ([0.02, 0.9], true),
        ] {
            let labels = ticks(range, log).into_iter().filter(|(_, label)| label.is_some()).count();
            assert!((2..=9).contains(&labels), "{range:?} {log}: {labels}");
        }
    }

    #[test]
    fn a_senseless_range_has_no_ticks() {
        for range in [[1.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY]] {
            assert!(ticks(range, false).is_empty());
        }
        assert!(ticks([-1.0, 1.0], true).is_empty());
    }
}
