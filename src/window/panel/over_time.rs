//! Plots of a selection over the steps of a run: mass, way, velocities and fields against time.

use super::{PanelState, theme};
use crate::annotate::number;
use crate::explore::{AtStep, OverTime};
use crate::window::state::answer::Answer;
use bevy_egui::egui::{self, Align2, FontId, Rect, Sense, Stroke, Ui, pos2, vec2};

/// Fields that are plotted at most.
const MOST_FIELDS: usize = 6;

/// What is known over time, or how far it is.
pub(super) fn show(ui: &mut Ui, state: &PanelState<'_, '_>) {
    let now = state.scene.as_ref().and_then(|scene| scene.time);
    match &state.looking.keeping.over_time {
        Answer::Nothing => {}
        Answer::Coming(coming) => {
            theme::fact(ui, "Over time", "");
            super::progress(ui, &coming.progress);
        }
        Answer::Failed(why) => {
            ui.add(egui::Label::new(egui::RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Here(found) => plots(ui, found, now),
    }
}

fn plots(ui: &mut Ui, found: &OverTime, now: Option<f64>) {
    let line = |value: &dyn Fn(&AtStep) -> Option<f64>| -> Vec<[f64; 2]> {
        found.steps.iter().filter_map(|row| Some([row.time, value(row)?])).collect()
    };
    let (length, mass) = (&found.length_unit.0, &found.mass_unit.0);
    plot(ui, "Particles", "", &line(&|row| Some(row.count as f64)), now);
    plot(ui, "Mass", mass, &line(&|row| Some(row.mass)), now);
    plot(ui, "Way of its centre", length, &line(&|row| row.distance), now);
    plot(ui, "Velocity dispersion", "", &line(&|row| row.dispersion), now);
    for (k, (name, unit)) in found.fields.iter().enumerate().take(MOST_FIELDS) {
        plot(ui, &format!("Mean {}", name.replace('-', " ")), &unit.0, &line(&|row| row.means[k]), now);
    }
}

/// A line over time, with the present as a mark.
fn plot(ui: &mut Ui, title: &str, unit: &str, points: &[[f64; 2]], now: Option<f64>) {
    let (Some([first, _]), Some([last, _])) = (points.first(), points.last()) else { return };
    let values = points.iter().map(|point| point[1]);
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    if !(low.is_finite() && high.is_finite() && last > first) {
        return;
    }
    let text = |value: f64| format!("{} {unit}", number::quantity(value)).trim().to_owned();
    ui.add_space(3.0);
    theme::fact(ui, title, "");
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 44.0), Sense::hover());
    theme::register(ui, &format!("over-time:{title}"), rect);
    let painter = ui.painter();
    painter.rect_filled(rect, 3.0, theme::WELL);
    // What does not change is a line in the middle.
    let (bottom, top) = if high > low { (low, high) } else { (low - 1.0, high + 1.0) };
    let share = |value: f64, from: f64, to: f64| ((value - from) / (to - from)) as f32;
    let inner: Rect = rect.shrink(5.0);
    let at = |[x, y]: [f64; 2]| {
        pos2(
            inner.left() + share(x, *first, *last) * inner.width(),
            inner.bottom() - share(y, bottom, top) * inner.height(),
        )
    };
    if let Some(now) = now.filter(|now| (first..=last).contains(&now)) {
        let x = at([now, bottom]).x;
        painter.line_segment([pos2(x, rect.top()), pos2(x, rect.bottom())], Stroke::new(1.0, theme::LABEL));
    }
    painter.add(egui::Shape::line(points.iter().map(|point| at(*point)).collect(), Stroke::new(1.5, theme::ACCENT)));
    let font = FontId::proportional(theme::SMALL);
    painter.text(rect.right_top() + vec2(-5.0, 2.0), Align2::RIGHT_TOP, text(high), font.clone(), theme::LABEL);
    painter.text(rect.right_bottom() + vec2(-5.0, -2.0), Align2::RIGHT_BOTTOM, text(low), font, theme::LABEL);
    if let Some(pointer) = response.hover_pos() {
        let nearest =
            points.iter().min_by(|a, b| (at(**a).x - pointer.x).abs().total_cmp(&(at(**b).x - pointer.x).abs()));
        if let Some([time, value]) = nearest {
            response.on_hover_text(format!("{} at {}", text(*value), number::quantity(*time)));
        }
    }
}
