//! The panel's part about the picture: mode, attribute, colour map, ranges, error bound.

use super::histogram::{RangeEdit, range_editor, range_labels};
use super::theme;
use crate::app::exposure::{Channel, Exposure};
use crate::app::palette::Palette;
use crate::app::scene::{Scene, Settings};
use bevy::prelude::Resource;
use bevy_egui::egui::{self, ComboBox, RichText, Slider, Ui, vec2};

/// A mode that can be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeChoice {
    /// Its name.
    pub name: String,
    /// What it shows, one sentence.
    pub help: String,
}

/// What the combo boxes offer.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Choices {
    /// Modes that this program can draw.
    pub modes: Vec<ModeChoice>,
    /// Attributes of the open dataset, each once.
    pub attributes: Vec<String>,
    /// Colour maps.
    pub color_maps: Vec<String>,
}

/// Draws the controls and writes what the user chose into `settings`.
pub fn show(ui: &mut Ui, _scene: &Scene, exposure: &Exposure, choices: &Choices, settings: &mut Settings) {
    theme::section(ui, "Display");
    combo(ui, "Mode", &settings.mode.clone(), |ui| {
        for mode in &choices.modes {
            ui.selectable_value(&mut settings.mode, mode.name.clone(), &mode.name).on_hover_text(&mode.help);
        }
    });
    let attribute = settings.attribute.clone().unwrap_or_else(|| "automatic".to_owned());
    combo(ui, "Attribute", &attribute, |ui| {
        ui.selectable_value(&mut settings.attribute, None, "automatic");
        for name in &choices.attributes {
            ui.selectable_value(&mut settings.attribute, Some(name.clone()), name);
        }
    });
    combo(ui, "Colour map", &settings.color_map.clone(), |ui| {
        for name in &choices.color_maps {
            color_map_choice(ui, name, &mut settings.color_map);
        }
    });
    let palette = Palette::named(&settings.color_map);
    range(ui, "brightness", exposure.brightness.as_ref(), &mut settings.brightness, |t| palette.brightness(t));
    range(ui, "hue", exposure.hue.as_ref(), &mut settings.hue, |t| palette.hue(t));
    theme::row(ui, "Error bound", |ui| {
        ui.label(RichText::new(format!("{:.2} px", settings.error_px)).color(theme::TEXT));
        ui.spacing_mut().slider_width = ui.available_width() - 8.0;
        ui.add(Slider::new(&mut settings.error_px, 0.1..=16.0).logarithmic(true).show_value(false))
            .on_hover_text("No drawn particle is farther than this from where it belongs on the screen.");
    });
}

/// A labelled combo box that fills the right part of the row.
fn combo(ui: &mut Ui, label: &str, selected: &str, add: impl FnOnce(&mut Ui)) {
    theme::row(ui, label, |ui| {
        ComboBox::from_id_salt(label).width(176.0).truncate().selected_text(selected).show_ui(ui, add);
    });
}

/// An entry of the colour map list: a swatch and the name.
fn color_map_choice(ui: &mut Ui, name: &str, chosen: &mut String) {
    ui.horizontal(|ui| {
        let (rect, response) = ui.allocate_exact_size(vec2(52.0, 12.0), egui::Sense::click());
        let palette = Palette::named(name);
        theme::gradient(ui.painter(), rect, false, |t| palette.swatch(t));
        if ui.selectable_label(*chosen == name, name).clicked() || response.clicked() {
            name.clone_into(chosen);
        }
    });
}

/// A range with its histogram and labels.
fn range(
    ui: &mut Ui,
    id: &str,
    channel: Option<&Channel>,
    chosen: &mut Option<[f64; 2]>,
    color: impl Fn(f32) -> egui::Color32,
) {
    let Some(channel) = channel else { return };
    ui.add_space(2.0);
    theme::row(ui, &channel.title, |ui| {
        if chosen.is_some() {
            if ui.small_button("automatic").clicked() {
                *chosen = None;
            }
        } else {
            ui.label(RichText::new("automatic").size(theme::SMALL).color(theme::LABEL));
        }
    });
    let shown = chosen.unwrap_or(channel.automatic);
    match range_editor(ui, id, &channel.histogram, shown, color) {
        Some(RangeEdit::Set(range)) => *chosen = Some(range),
        Some(RangeEdit::Automatic) => *chosen = None,
        None => {}
    }
    range_labels(ui, shown, &channel.unit);
}
