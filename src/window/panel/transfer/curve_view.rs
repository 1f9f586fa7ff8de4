//! A curve over a histogram: points are dragged, added by a double click, removed by the right button or by dragging them
//! out, and typed.

use super::curve_edit::{self, CurveEdit};
use super::plot::{Gesture, Plot};
use crate::color::transfer::{Curve, Scale};
use crate::window::theme;
use bevy_egui::egui::{self, Color32, DragValue, Rect, RichText, Ui};

/// What a curve is drawn over.
pub struct Backdrop<'a> {
    /// How often values occur, in bins of equal width over the range; empty where that is not known.
    pub counts: &'a [f64],
    /// The values at the ends of the range.
    pub range: [f64; 2],
    /// How values are placed between them.
    pub scale: Scale,
    /// The colour at a place.
    pub color: &'a dyn Fn(f32) -> Color32,
}

/// Height of the plot, logical pixels.
const HEIGHT_PX: f32 = 104.0;

/// Draws the plot, and gives the curve where it was edited.
pub fn show(ui: &mut Ui, id: &str, curve: &Curve, backdrop: &Backdrop<'_>) -> Option<Curve> {
    let plot = Plot::new(ui, id, HEIGHT_PX);
    let memory = plot.response.id;
    let (mut edit, mut chosen) = ui.data(|data| {
        (data.get_temp::<CurveEdit>(memory).unwrap_or_default(), data.get_temp::<Option<usize>>(memory).flatten())
    });
    let mut edited = None;
    match plot.gesture(ui) {
        Some(Gesture::Press(at)) => {
            chosen = curve_edit::nearest(curve, at, plot.reach());
            if let Some(index) = chosen.filter(|_| plot.response.dragged()) {
                edit.grab(curve, index);
            }
        }
        Some(Gesture::Drag(at)) => edited = edit.drag(at),
        Some(Gesture::Release) => edit.release(),
        Some(Gesture::Double(at)) => {
            edited = curve_edit::add(curve, at);
            chosen = edited.as_ref().and_then(|curve| curve_edit::nearest(curve, at, plot.reach()));
        }
        Some(Gesture::Secondary(at)) => {
            let under = curve_edit::nearest(curve, at, plot.reach());
            edited = under.and_then(|index| curve_edit::remove(curve, index));
            chosen = None;
        }
        None => {}
    }
    let shown = edited.as_ref().unwrap_or(curve);
    chosen = chosen.filter(|index| *index < shown.points().len());
    draw(&plot, shown, chosen, backdrop);
    if plot.response.hovered() || edit.held().is_some() {
        ui.ctx().set_cursor_icon(egui::CursorIcon::Crosshair);
    }
    Plot::hint(ui, "double click: another point; right click: remove");
    if let Some(index) = chosen {
        edited = fields(ui, shown, index, backdrop).or(edited);
    }
    ui.data_mut(|data| {
        data.insert_temp(memory, edit);
        data.insert_temp(memory, chosen);
    });
    edited
}

fn draw(plot: &Plot, curve: &Curve, chosen: Option<usize>, backdrop: &Backdrop<'_>) {
    let most = backdrop.counts.iter().copied().fold(0.0, f64::max).ln_1p().max(1e-9);
    let bins = backdrop.counts.len().max(1) as f32;
    for (index, count) in backdrop.counts.iter().enumerate() {
        let height = (count.ln_1p() / most) as f32;
        if height > 0.0 {
            let (left, right) = (index as f32 / bins, (index as f32 + 1.0) / bins);
            let color = (backdrop.color)(0.5 * (left + right)).gamma_multiply(0.75);
            let floor = |channel: u8| channel.max(46);
            let color = Color32::from_rgb(floor(color.r()), floor(color.g()), floor(color.b()));
            let bar = Rect::from_two_pos(plot.point((left, 0.0)), plot.point((right, height)));
            plot.painter.rect_filled(bar, 0.0, color);
        }
    }
    plot.grid();
    let (first, last) = (curve.points().first(), curve.points().last());
    // The curve is constant beyond its ends.
    let before = first.map(|&(_, value)| (0.0, value));
    let after = last.map(|&(_, value)| (1.0, value));
    let places: Vec<_> = before.into_iter().chain(curve.points().iter().copied()).chain(after).collect();
    plot.line(&places, 4.0, Color32::from_black_alpha(150));
    plot.line(&places, 1.8, theme::TEXT);
    for (index, &point) in curve.points().iter().enumerate() {
        plot.handle(point, if chosen == Some(index) { 5.0 } else { 4.0 }, chosen == Some(index));
    }
}

/// The chosen point's numbers, to type.
fn fields(ui: &mut Ui, curve: &Curve, index: usize, backdrop: &Backdrop<'_>) -> Option<Curve> {
    let &(place, value) = curve.points().get(index)?;
    let mut at = backdrop.scale.value(place, backdrop.range);
    let mut level = value;
    let mut gone = false;
    theme::row(ui, "Point", |ui| {
        gone = ui.small_button("remove").clicked();
        let step = 0.005;
        let height = ui.add(DragValue::new(&mut level).range(0.0..=1.0).speed(step).max_decimals(4));
        theme::call(&height.on_hover_text("its height"), "Height of the point");
        ui.label(RichText::new("at").color(theme::LABEL));
        let speed = 0.003 * (backdrop.range[1] - backdrop.range[0]).abs().max(f64::MIN_POSITIVE) * 0.2;
        let field = DragValue::new(&mut at)
            .speed(speed)
            .custom_formatter(|value, _| theme::brief(value))
            .update_while_editing(false);
        let field = ui.add(field.custom_parser(|text| text.trim().parse().ok()));
        theme::call(&field.on_hover_text("the value that it belongs to"), "Value of the point");
    });
    if gone {
        return curve_edit::remove(curve, index);
    }
    let moved = backdrop.scale.value(place, backdrop.range);
    let place = if at == moved { place } else { backdrop.scale.place(at as f32, backdrop.range) };
    ((place, level) != curve.points()[index]).then(|| curve_edit::set(curve, index, (place, level))).flatten()
}

/// The counts of a histogram over an axis, in bins of equal width over a range of it.
pub fn counts_over(counts: &[f64], position: impl Fn(f64) -> f64, range: [f64; 2]) -> Vec<f64> {
    const BINS: usize = 64;
    let [low, high] = range.map(position);
    let bins = counts.len() as f64;
    let of = |index: usize| {
        let share = |edge: usize| (low + (high - low) * edge as f64 / BINS as f64) * bins;
        let (from, to) = (share(index).clamp(0.0, bins), share(index + 1).clamp(0.0, bins));
        // What each bin of the axis has in common with this one.
        (from as usize..(to.ceil() as usize).min(counts.len()))
            .map(|bin| counts[bin] * (to.min(bin as f64 + 1.0) - from.max(bin as f64)).max(0.0))
            .sum()
    };
    if high > low && high.is_finite() && low.is_finite() { (0..BINS).map(of).collect() } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_a_part_of_the_axis_add_up() {
        let counts = vec![4.0; 10];
        let whole = counts_over(&counts, |value| value, [0.0, 1.0]);
        assert!((whole.iter().sum::<f64>() - 40.0).abs() < 1e-9);
        let half = counts_over(&counts, |value| value, [0.25, 0.75]);
        assert!((half.iter().sum::<f64>() - 20.0).abs() < 1e-9);
        // Beyond the axis there is nothing.
        assert!((counts_over(&counts, |value| value, [-1.0, 2.0]).iter().sum::<f64>() - 40.0).abs() < 1e-9);
        assert!(counts_over(&counts, |value| value, [1.0, 1.0]).is_empty());
    }
}
