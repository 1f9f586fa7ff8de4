//! A curve over a histogram: points are dragged, added by a double click, removed by the right button or by dragging them
//! out, and typed; Space adds one in the widest gap, arrow keys move it, Delete removes it.

use super::curve_edit::{self, CurveEdit};
use super::plot::{Gesture, Plot};
use crate::color::transfer::{Curve, Scale};
use crate::window::theme::{self, Asked, Handle, Ways};
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
    let plot = Plot::new(ui, id, "another point", HEIGHT_PX);
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
        Some(Gesture::Add) => {
            if let Some((next, index)) = curve_edit::add_in_gap(curve) {
                plot.give_keyboard(ui, (index, 0));
                (edited, chosen) = (Some(next), Some(index));
            }
        }
        None => {}
    }
    let (under_keys, next) = by_keys(ui, &plot, id, curve, backdrop);
    (edited, chosen) = (next.or(edited), under_keys.or(chosen));
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

/// The point that has the keyboard or is moved by a screen reader, and the curve where that was edited.
fn by_keys(ui: &Ui, plot: &Plot, name: &str, curve: &Curve, backdrop: &Backdrop<'_>) -> (Option<usize>, Option<Curve>) {
    let count = curve.points().len();
    let (mut chosen, mut edited) = (None, None);
    for (index, &(place, height)) in curve.points().iter().enumerate() {
        let name = format!("{name}: point {} of {count}", index + 1);
        let value = theme::brief(backdrop.scale.value(place, backdrop.range));
        let words = format!("{} at {value}", theme::brief(f64::from(height)));
        let (number, range) = (f64::from(height), [0.0, 1.0]);
        let handle = Handle { name: &name, place: &words, number, range, ways: Ways::Both };
        let (has_keyboard, asked) = plot.reach_by_keys(ui, (index, 0), (place, height), &handle);
        let next = match asked {
            Some(Asked::Move((right, up))) => curve_edit::set(curve, index, (place + right, height + up)),
            Some(Asked::Number(height)) => curve_edit::set(curve, index, (place, height as f32)),
            Some(Asked::Remove) => curve_edit::remove(curve, index),
            None => None,
        };
        if has_keyboard || next.is_some() {
            let left = next.as_ref().map_or(count, |next| next.points().len());
            // The keyboard stays in the plot where its point has gone.
            let index = index.min(left - 1);
            if left < count {
                plot.give_keyboard(ui, (index, 0));
            }
            chosen = Some(index);
            edited = next.filter(|next| next != curve).or(edited);
        }
    }
    (chosen, edited)
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
    use bevy_egui::egui::{Context, Event, Key, Modifiers, RawInput};

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

    #[test]
    fn points_are_added_moved_and_removed_by_keys() {
        let ctx = Context::default();
        let mut curve = Curve::identity();
        let mut press = |key: Key, modifiers: Modifiers| {
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            // Arrow keys are a control's from the second frame on that it has the keyboard.
            for events in [vec![Event::ModifiersChanged(modifiers), event], Vec::new(), Vec::new()] {
                let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                    ui.set_max_width(300.0);
                    let (range, scale) = ([0.0, 10.0], Scale::Linear);
                    let backdrop = Backdrop { counts: &[], range, scale, color: &|_| Color32::WHITE };
                    if let Some(edited) = show(ui, "brightness", &curve, &backdrop) {
                        curve = edited;
                    }
                });
                // Nobody draws them.
                output.textures_delta.clear();
            }
            curve.points().to_vec()
        };
        let is = |points: Vec<(f32, f32)>, expected: &[(f32, f32)]| {
            let near = |(a, b): (&(f32, f32), &(f32, f32))| (a.0 - b.0).hypot(a.1 - b.1) < 1e-5;
            points.len() == expected.len() && points.iter().zip(expected).all(near)
        };
        let ends = [(0.0, 0.0), (1.0, 1.0)];
        assert!(is(press(Key::Tab, Modifiers::NONE), &ends));
        assert!(is(press(Key::Space, Modifiers::NONE), &[ends[0], (0.5, 0.5), ends[1]]));
        assert!(is(press(Key::ArrowUp, Modifiers::NONE), &[ends[0], (0.5, 0.51), ends[1]]));
        assert!(is(press(Key::ArrowLeft, Modifiers::SHIFT), &[ends[0], (0.499, 0.51), ends[1]]));
        // The one before it is at the edge of the plot already.
        press(Key::Tab, Modifiers::SHIFT);
        assert!(is(press(Key::ArrowDown, Modifiers::NONE), &[ends[0], (0.499, 0.51), ends[1]]));
        press(Key::Tab, Modifiers::NONE);
        assert!(is(press(Key::Delete, Modifiers::NONE), &ends));
        assert!(is(press(Key::Backspace, Modifiers::NONE), &ends[..1]), "the next one has the keyboard");
        assert!(is(press(Key::Delete, Modifiers::NONE), &ends[..1]), "the last point stays");
    }
}
