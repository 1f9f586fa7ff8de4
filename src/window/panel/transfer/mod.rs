//! The transfer-function editor: preset, colour map, ranges over histograms, curves of brightness and opacity, and regions
//! over the joint histogram. The curves and regions are edited without drawing in [`curve_edit`] and [`plane_edit`].

pub mod curve_edit;
pub mod plane_edit;

mod colors;
mod curve_view;
mod plane_view;
mod plot;
mod presets;

use super::histogram::{RangeEdit, range_editor};
use super::{Choices, theme};
use crate::annotate::LegendAxis;
use crate::color::transfer::{Curve, Range, Scale};
use crate::window::exposure::Exposure;
use crate::window::look::Look;
use crate::window::scene::{Scene, Settings};
use crate::window::state::histogram::AxisHistogram;
use crate::window::transfer_presets::TransferPresets;
use bevy_egui::egui::{self, Color32, DragValue, RichText, Ui, vec2};
use curve_view::Backdrop;

/// What the editor needs to know of the picture.
pub struct Shown<'a> {
    /// What is open.
    pub scene: &'a Scene,
    /// The picture's look.
    pub look: &'a Look,
    /// How often values occur in it.
    pub exposure: &'a Exposure,
    /// Colour maps to choose from.
    pub choices: &'a Choices,
}

/// Which curve is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Tab {
    #[default]
    Brightness,
    Opacity,
    Plane,
}

/// Draws the editor and writes what the user chose into `settings`.
pub fn show(ui: &mut Ui, shown: &Shown<'_>, presets: &mut TransferPresets, settings: &mut Settings) {
    let Shown { scene, look, exposure, choices } = *shown;
    presets::show(ui, presets, settings);
    let transfer = &mut settings.transfer;
    match &mut transfer.hue {
        Some(hue) => colors::show(ui, choices, &mut hue.color_map, &mut hue.reverse),
        None => colors::show(ui, choices, &mut transfer.color_map, &mut transfer.reverse),
    }
    let legend = look.legend(scene);
    let brightness = |t: f32| look.color(t, 0.5);
    let histogram = exposure.brightness.as_ref();
    range(ui, "brightness", &legend.p, &mut transfer.scale, histogram, look.levels.p, &mut transfer.range, brightness);
    if let (Some(hue), Some(axis)) = (&mut transfer.hue, &legend.s) {
        let color = |t: f32| look.color(0.66, t);
        range(ui, "hue", axis, &mut hue.scale, exposure.hue.as_ref(), look.levels.s, &mut hue.range, color);
    }
    let id = ui.id().with("curve");
    let mut tab = ui.data(|data| data.get_temp::<Tab>(id)).unwrap_or_default();
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        let all = [(Tab::Brightness, "brightness"), (Tab::Opacity, "opacity"), (Tab::Plane, "regions")];
        for (choice, name) in all.into_iter().filter(|(choice, _)| *choice != Tab::Plane || look.has_hue()) {
            let label = ui.selectable_value(&mut tab, choice, name);
            theme::register(ui, &format!("tab:{name}"), label.rect);
        }
    });
    if tab == Tab::Plane && !look.has_hue() {
        tab = Tab::Brightness;
    }
    ui.data_mut(|data| data.insert_temp(id, tab));
    if tab == Tab::Plane {
        let color = |p: f32, s: f32| look.color(p, s);
        if let Some(plane) = plane_view::show(ui, &transfer.plane, exposure.joint.as_ref(), &color) {
            transfer.plane = plane;
        }
        return;
    }
    let volume = look.depiction.mode.is_light();
    let range = look.levels.p;
    let counts = exposure
        .brightness
        .as_ref()
        .map(|histogram| curve_view::counts_over(&histogram.counts, |value| histogram.position(value), range));
    let counts = counts.unwrap_or_default();
    let backdrop = Backdrop { counts: &counts, range, scale: transfer.scale, color: &brightness };
    let (name, set, usual) = match tab {
        Tab::Opacity if volume => ("opacity", &mut transfer.opacity, Curve::usual_opacity()),
        Tab::Opacity => ("opacity", &mut transfer.opacity, Curve::constant(1.0)),
        _ if volume => ("brightness", &mut transfer.brightness, Curve::usual_brightness()),
        _ => ("brightness", &mut transfer.brightness, Curve::identity()),
    };
    let curve = set.clone().unwrap_or_else(|| usual.clone());
    if let Some(edited) = curve_view::show(ui, name, &curve, &backdrop) {
        *set = Some(edited);
    }
    let mut reset = false;
    theme::row(ui, "Contrast", |ui| {
        reset = set.is_some() && ui.small_button("reset curve").clicked();
        let mut gamma = transfer.gamma;
        let field = DragValue::new(&mut gamma).range(0.1..=10.0).speed(0.01).max_decimals(3);
        let hint = "exponent on the place in the range: above 1 is more contrast in the bright parts";
        let field = ui.add(field).on_hover_text(hint);
        theme::call(&field, "Contrast");
        if field.changed() {
            transfer.gamma = gamma;
        }
    });
    if reset {
        *set = None;
    }
}

/// A range with its histogram, labels and numbers to type.
fn range(
    ui: &mut Ui,
    id: &str,
    axis: &LegendAxis,
    scale: &mut Scale,
    histogram: Option<&AxisHistogram>,
    in_use: [f64; 2],
    chosen: &mut Range,
    color: impl Fn(f32) -> Color32,
) {
    ui.add_space(4.0);
    let size = vec2(ui.available_width(), theme::ROW);
    ui.allocate_ui_with_layout(size, egui::Layout::right_to_left(egui::Align::Center), |ui| {
        ui.spacing_mut().button_padding = vec2(5.0, 0.0);
        let mut log = *scale == Scale::Log;
        if ui.checkbox(&mut log, "log").on_hover_text("spread the range logarithmically").changed() {
            *scale = if log { Scale::Log } else { Scale::Linear };
        }
        if *chosen == Range::Auto {
            ui.label(RichText::new("auto").size(theme::SMALL).color(theme::LABEL));
        } else {
            let reset = ui.small_button("reset").on_hover_text("back to the automatic range");
            theme::register(ui, &format!("{id}:automatic"), reset.rect);
            if reset.clicked() {
                *chosen = Range::Auto;
            }
        }
        ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
            ui.add(egui::Label::new(RichText::new(&axis.title).color(theme::LABEL)).truncate());
        });
    });
    let shown = match *chosen {
        Range::Auto => in_use,
        Range::Fixed(low, high) => [low, high],
    };
    if let Some(histogram) = histogram {
        // A range that reaches out of the data widens the axis, so that both ends can be taken hold of.
        let [low, high] = histogram.span;
        let wide = AxisHistogram { span: [low.min(shown[0]), high.max(shown[1])], ..histogram.clone() };
        let axis = if wide.span == histogram.span { histogram.clone() } else { wide.spread_from(histogram) };
        match range_editor(ui, id, &axis, shown, color) {
            Some(RangeEdit::Set([low, high])) if low < high => *chosen = Range::Fixed(low, high),
            Some(RangeEdit::Automatic) => *chosen = Range::Auto,
            Some(RangeEdit::Set(_)) | None => {}
        }
    }
    let mut ends = shown;
    ui.horizontal(|ui| {
        ui.spacing_mut().interact_size.y = 14.0;
        let speed = 0.002 * (shown[1] - shown[0]).abs().max(f64::MIN_POSITIVE);
        let field = |ui: &mut Ui, name: &str, end: &mut f64| {
            let field = DragValue::new(end)
                .speed(speed)
                .custom_formatter(|value, _| theme::brief(value))
                .update_while_editing(false);
            let field = field.custom_parser(|text| text.trim().parse().ok().filter(|value: &f64| value.is_finite()));
            let field = ui.add(field).on_hover_text("an end of the range, to type or to drag");
            theme::call(&field, &format!("{}: {name}", axis.title));
            field.changed()
        };
        let low = field(ui, "lower end", &mut ends[0]);
        let right = egui::Layout::right_to_left(egui::Align::Center);
        let high = ui.with_layout(right, |ui| {
            let high = field(ui, "upper end", &mut ends[1]);
            let unit = RichText::new(&axis.unit).size(theme::SMALL).color(theme::LABEL);
            ui.with_layout(egui::Layout::centered_and_justified(egui::Direction::LeftToRight), |ui| {
                ui.add(egui::Label::new(unit).truncate());
            });
            high
        });
        let high = high.inner;
        let positive = *scale == Scale::Linear || ends[0] > 0.0;
        if (low || high) && ends[0] < ends[1] && positive {
            *chosen = Range::Fixed(ends[0], ends[1]);
        }
    });
}
