//! The panel's part about the picture: mode, attribute, colour map, ranges, error bound.

use super::histogram::{Histogram, RangeEdit, range_editor, range_labels};
use super::theme;
use crate::app::exposure::Exposure;
use crate::app::legend::Legend;
use crate::app::look::Look;
use crate::app::scene::{AttributeChoice, Settings};
use crate::modes::{self, MODES, Setting, SettingKind, SettingValue};
use crate::raster::colormap::ColorMap;
use crate::raster::transfer::Range;
use crate::store::Metadata;
use bevy::prelude::Resource;
use bevy_egui::egui::{self, Color32, ComboBox, RichText, Slider, TextEdit, Ui, vec2};

/// What the combo boxes offer beyond the modes.
#[derive(Resource, Clone, Debug, Default)]
pub struct Choices {
    /// Attributes of the open dataset, each once.
    pub attributes: Vec<String>,
    /// Colour maps with a few of their colours.
    color_maps: Vec<(ColorMap, Vec<Color32>)>,
}

impl Choices {
    /// What does not depend on a dataset.
    pub fn of_program() -> Choices {
        let color = |[r, g, b]: [f32; 3]| {
            let byte = |component: f32| (255.0 * component).round() as u8;
            Color32::from_rgb(byte(r), byte(g), byte(b))
        };
        let sampled = |map: ColorMap| (map, map.sample(24).into_iter().map(color).collect());
        Choices { attributes: Vec::new(), color_maps: ColorMap::all().map(sampled).collect() }
    }
}

/// Draws the controls and writes what the user chose into `settings`.
pub fn show(
    ui: &mut Ui,
    metadata: &Metadata,
    look: &Look,
    exposure: &Exposure,
    choices: &Choices,
    settings: &mut Settings,
) {
    theme::section(ui, "Display");
    combo(ui, "Mode", settings.mode.name, |ui| {
        for mode in MODES {
            let chosen = std::ptr::eq(settings.mode, mode);
            if ui.selectable_label(chosen, mode.name).on_hover_text(mode.help).clicked() {
                settings.choose_mode(mode);
            }
        }
    });
    for setting in settings.mode.all_settings() {
        mode_setting(ui, setting, settings);
    }
    attribute_combo(ui, look, choices, settings);
    color_map_combo(ui, choices, settings);
    let legend = Legend::of(look, metadata);
    let hue_middle = 0.5;
    let p_range = &mut settings.transfer.range;
    let brightness = |t: f32| look.color(t, hue_middle);
    range(
        ui,
        "brightness",
        &legend.p.title,
        &legend.p.unit,
        exposure.brightness.as_ref(),
        look.levels.p,
        p_range,
        brightness,
    );
    if let (Some(hue), Some(axis)) = (&mut settings.transfer.hue, &legend.s) {
        let color = |t: f32| look.color(0.66, t);
        range(ui, "hue", &axis.title, &axis.unit, exposure.hue.as_ref(), look.levels.s, &mut hue.range, color);
    }
    ui.add_space(2.0);
    theme::row(ui, "Error bound", |ui| {
        ui.label(RichText::new(format!("{:.2} px", settings.error_px)).color(theme::TEXT));
        ui.spacing_mut().slider_width = (ui.available_width() - 8.0).max(40.0);
        ui.add(Slider::new(&mut settings.error_px, 0.1..=16.0).logarithmic(true).show_value(false))
            .on_hover_text("No drawn particle is farther than this from where it belongs on the screen.");
    });
}

/// A labelled combo box that fills the right part of the row.
fn combo(ui: &mut Ui, label: &str, selected: &str, add: impl FnOnce(&mut Ui)) {
    theme::row(ui, label, |ui| {
        ComboBox::from_id_salt(label).width(186.0).truncate().selected_text(selected).show_ui(ui, add);
    });
}

/// A control for a setting of the mode.
fn mode_setting(ui: &mut Ui, setting: &Setting, settings: &mut Settings) {
    let mut label = setting.name.to_owned();
    label[..1].make_ascii_uppercase();
    let values = &mut settings.mode_settings;
    let response = theme::row(ui, &label, |ui| match setting.kind {
        SettingKind::Number { min, max, .. } => {
            let mut value = values.number(setting);
            ui.label(RichText::new(format!("{value:.1} {}", setting.unit)).color(theme::TEXT));
            ui.spacing_mut().slider_width = (ui.available_width() - 8.0).max(40.0);
            // Many decades have their small values on the slider too.
            let slider = Slider::new(&mut value, min..=max).logarithmic(max > 1000.0).show_value(false);
            if ui.add(slider).changed() {
                values.0.insert(setting.name.to_owned(), SettingValue::Number(value));
            }
        }
        SettingKind::Flag { .. } => {
            let mut value = values.number(setting) != 0.0;
            if ui.checkbox(&mut value, "").changed() {
                values.0.insert(setting.name.to_owned(), SettingValue::Flag(value));
            }
        }
        SettingKind::Choice { options } => {
            let current = values.name(setting);
            ComboBox::from_id_salt(setting.name).width(186.0).selected_text(&current).show_ui(ui, |ui| {
                for &option in options {
                    if ui.selectable_label(current == option, option).clicked() {
                        values.0.insert(setting.name.to_owned(), SettingValue::Name(option.to_owned()));
                    }
                }
            });
        }
        SettingKind::Numbers { .. } | SettingKind::Colors { .. } => list_setting(ui, setting, values),
    });
    response.on_hover_text(setting.help);
}

/// A list as text with commas; taken over when the field is left and the list is right.
fn list_setting(ui: &mut Ui, setting: &Setting, values: &mut modes::Settings) {
    let id = ui.id().with(setting.name);
    let set = values.0.get(setting.name).map(|value| value.to_string().trim_matches(['[', ']']).to_owned());
    let typed = ui.data(|data| data.get_temp::<String>(id));
    let mut text = typed.or(set).unwrap_or_default();
    let response = ui.add(TextEdit::singleline(&mut text).hint_text("automatic").desired_width(186.0));
    if response.lost_focus() {
        if let Some(value) = parse_list(setting, &text) {
            values.0.insert(setting.name.to_owned(), value);
        }
        ui.data_mut(|data| data.remove::<String>(id));
    } else if response.has_focus() {
        ui.data_mut(|data| data.insert_temp(id, text));
    }
}

/// The list that a text with commas says, if the setting takes it.
fn parse_list(setting: &Setting, text: &str) -> Option<SettingValue> {
    let items: Vec<&str> = text.split(',').map(str::trim).filter(|item| !item.is_empty()).collect();
    let value = match setting.kind {
        SettingKind::Numbers { .. } => {
            SettingValue::Numbers(items.iter().map(|item| item.parse()).collect::<Result<_, _>>().ok()?)
        }
        _ if items.is_empty() => SettingValue::Numbers(Vec::new()),
        _ => SettingValue::Names(items.into_iter().map(str::to_owned).collect()),
    };
    setting.check(&value).is_ok().then_some(value)
}

/// Which attribute gives the hue.
fn attribute_combo(ui: &mut Ui, look: &Look, choices: &Choices, settings: &mut Settings) {
    let in_use = look.depiction.attribute.as_ref().map_or("none", |coloring| coloring.name.as_str());
    let selected = match &settings.attribute {
        AttributeChoice::Automatic => format!("auto:  {in_use}"),
        AttributeChoice::None => "none".to_owned(),
        AttributeChoice::Named(name) => name.clone(),
    };
    combo(ui, "Attribute", &selected, |ui| {
        ui.selectable_value(&mut settings.attribute, AttributeChoice::Automatic, "automatic");
        ui.selectable_value(&mut settings.attribute, AttributeChoice::None, "none");
        for name in &choices.attributes {
            ui.selectable_value(&mut settings.attribute, AttributeChoice::Named(name.clone()), name);
        }
    });
}

/// The colour map: of the hue where there is one, else of the brightness.
fn color_map_combo(ui: &mut Ui, choices: &Choices, settings: &mut Settings) {
    let transfer = &mut settings.transfer;
    let (map, reverse) = match &mut transfer.hue {
        Some(hue) => (&mut hue.color_map, &mut hue.reverse),
        None => (&mut transfer.color_map, &mut transfer.reverse),
    };
    combo(ui, "Colour map", map.name(), |ui| {
        for (choice, colors) in &choices.color_maps {
            ui.horizontal(|ui| {
                let (rect, swatch) = ui.allocate_exact_size(vec2(52.0, 12.0), egui::Sense::click());
                let last = colors.len().saturating_sub(1);
                theme::gradient(ui.painter(), rect, false, |t| colors[(t * last as f32).round() as usize]);
                let label = ui.selectable_label(*map == *choice, choice.name()).on_hover_text(choice.help());
                if label.clicked() || swatch.clicked() {
                    *map = *choice;
                }
            });
        }
        ui.separator();
        ui.checkbox(reverse, "reversed");
    });
}

/// A range with its histogram and labels.
fn range(
    ui: &mut Ui,
    id: &str,
    title: &str,
    unit: &str,
    histogram: Option<&Histogram>,
    in_use: [f64; 2],
    chosen: &mut Range,
    color: impl Fn(f32) -> Color32,
) {
    let Some(histogram) = histogram else { return };
    ui.add_space(4.0);
    theme::row(ui, title, |ui| {
        ui.spacing_mut().button_padding = vec2(5.0, 0.0);
        if *chosen == Range::Auto {
            ui.label(RichText::new("automatic").size(theme::SMALL).color(theme::LABEL));
        } else if ui.small_button("reset").on_hover_text("back to the automatic range").clicked() {
            *chosen = Range::Auto;
        }
    });
    let shown = match *chosen {
        Range::Auto => in_use,
        Range::Fixed(low, high) => [low, high],
    };
    // A range that reaches out of the data widens the axis, so that both ends can be taken hold of.
    let [low, high] = histogram.span;
    let wide = Histogram { span: [low.min(shown[0]), high.max(shown[1])], ..histogram.clone() };
    let axis = if wide.span == histogram.span { histogram.clone() } else { wide.spread_from(histogram) };
    match range_editor(ui, id, &axis, shown, color) {
        Some(RangeEdit::Set([low, high])) if low < high => *chosen = Range::Fixed(low, high),
        Some(RangeEdit::Automatic) => *chosen = Range::Auto,
        Some(RangeEdit::Set(_)) | None => {}
    }
    range_labels(ui, shown, unit);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes::grid::{ISO_COLORS, ISOVALUES};

    #[test]
    fn lists_are_read_from_text() {
        assert_eq!(parse_list(&ISOVALUES, " 0.5, 3e2 ,"), Some(SettingValue::Numbers(vec![0.5, 300.0])));
        assert_eq!(parse_list(&ISOVALUES, ""), Some(SettingValue::Numbers(Vec::new())));
        assert_eq!(parse_list(&ISOVALUES, "1, x"), None);
        assert_eq!(parse_list(&ISOVALUES, "-1"), None);
        assert_eq!(parse_list(&ISO_COLORS, "#ff0000"), Some(SettingValue::Names(vec!["#ff0000".into()])));
        assert_eq!(parse_list(&ISO_COLORS, "red"), None);
    }
}
