//! The section about the mode: which one, its settings as it describes them itself, the attribute, and the error bound.

use super::{Dock, PanelState, Section, reach, theme};
use crate::look::Attribute;
use crate::mode::blend::ORDER;
use crate::mode::levels::{LEVELS, REPRESENTATIVE, is_of_levels, is_of_pictures};
use crate::mode::{Mode, Setting, SettingKind, SettingValue};
use crate::modes::slice_overlay::vectors_among;
use crate::modes::{self, grid, samples, volume_fields};
use crate::window::scene::Settings;
use bevy_egui::egui::{ComboBox, TextEdit, Ui};

/// The section.
pub static SECTION: Section = Section {
    name: "mode",
    title: "Mode",
    dock: Dock::Left,
    applies: |state| state.look.is_some(),
    show: |ui, state| {
        let mut edited = state.settings.clone();
        show(ui, state, &mut edited);
        bevy::prelude::DetectChangesMut::set_if_neq(&mut state.settings, edited);
    },
};

/// Settings of modes of particles and of fields alike that say something of particles alone.
const OF_PARTICLES: [&Setting; 9] = [
    &grid::DETAIL,
    &grid::KERNEL,
    &grid::SMALLEST_CELLS,
    &grid::FIELD,
    &volume_fields::SURFACE_FIELD,
    &volume_fields::FIELD_SUM,
    &volume_fields::FIELD_OPACITY,
    &LEVELS,
    &REPRESENTATIVE,
];
/// Settings of such modes that say something of fields alone.
const OF_FIELDS: [&Setting; 2] = [&samples::ERROR_VALUE, &samples::TRANSFER_SENSITIVITY];

fn show(ui: &mut Ui, state: &PanelState<'_, '_>, settings: &mut Settings) {
    let has_paths = state.scene.as_ref().is_some_and(|scene| scene.following.is_some());
    let shown = |mode: &&'static Mode| {
        let is_drawn = state.scene.as_ref().map_or_else(|| mode.takes_particles(), |scene| scene.takes(mode));
        is_drawn && (has_paths || !mode.is_of_paths())
    };
    mode_combo(ui, modes::all().into_iter().filter(shown), settings);
    attribute_combo(ui, state, settings);
    let takes_clusters = state.look.as_ref().is_some_and(|look| look.depiction.takes_clusters());
    let has_levels = takes_clusters && state.scene.as_ref().is_some_and(|scene| scene.metadata().has_clusters());
    let is_field = state.scene.as_ref().is_some_and(|scene| scene.field_for(settings.mode).is_some());
    let lies_over = settings.budget.blend_order().is_some();
    let applies = |name: &str| match is_field {
        true => !is_of_pictures(name) && OF_PARTICLES.iter().all(|setting| setting.name != name),
        false => {
            !is_of_pictures(name)
                && (has_levels || !is_of_levels(name))
                && OF_FIELDS.iter().all(|setting| setting.name != name)
                && (lies_over || name != ORDER.name)
        }
    };
    let surface = state.scene.as_ref().and_then(|scene| scene.surface_for(settings.mode));
    for setting in settings.mode.all_settings().filter(|setting| applies(setting.name)) {
        let reach = surface.as_ref().and_then(|opened| reach::of(setting, opened, &settings.look.settings));
        mode_setting(ui, setting, reach, &state.choices.attributes, settings.values(setting));
    }
    if is_field && surface.is_none() {
        return;
    }
    let error = theme::NumberRow {
        label: "Error bound",
        unit: "px",
        range: 0.1..=16.0,
        log: true,
        default: Some(state.preset.drawing.error_px),
    };
    error
        .show(ui, &mut settings.error_px)
        .on_hover_text("Nothing that is drawn is farther than this from where it belongs on the screen, in pixels.");
}

/// Which mode is shown, of those that draw the data; those of paths alone are for runs.
fn mode_combo(ui: &mut Ui, shown: impl Iterator<Item = &'static Mode>, settings: &mut Settings) {
    theme::combo(ui, "Mode", settings.mode.name, |ui| {
        for mode in shown {
            let chosen = std::ptr::eq(settings.mode, mode);
            let label = ui.selectable_label(chosen, mode.name).on_hover_text(mode.help);
            theme::register(ui, &format!("mode:{}", mode.name), label.rect);
            if label.clicked() {
                settings.choose_mode(mode);
            }
        }
    });
}

/// Which attribute gives the hue.
fn attribute_combo(ui: &mut Ui, state: &PanelState<'_, '_>, settings: &mut Settings) {
    let coloring = state.look.as_ref().and_then(|look| look.depiction.attribute.as_ref());
    let surface = state.scene.as_ref().and_then(|scene| scene.surface_for(settings.mode));
    let usual = surface.map_or("none", |opened| opened.usual_attribute());
    let in_use = coloring.map_or(usual, |coloring| coloring.name.as_str());
    let selected = match &settings.attribute {
        Attribute::Automatic => format!("auto:  {in_use}"),
        Attribute::None => "none".to_owned(),
        Attribute::Named(name) => name.clone(),
    };
    theme::combo(ui, "Attribute", &selected, |ui| {
        let names = state.choices.attributes.iter().map(|name| Attribute::Named(name.clone()));
        for choice in [Attribute::Automatic, Attribute::None].into_iter().chain(names) {
            let text = match &choice {
                Attribute::Automatic => "automatic",
                Attribute::None => "none",
                Attribute::Named(name) => name,
            };
            let text = text.to_owned();
            let label = ui.selectable_value(&mut settings.attribute, choice, text.as_str());
            theme::register(ui, &format!("attribute:{text}"), label.rect);
        }
    });
}

/// A setting's name as a label.
pub(super) fn label_of(setting: &Setting) -> String {
    let mut label = setting.name.to_owned();
    label[..1].make_ascii_uppercase();
    label
}

/// A control for a setting of the mode, of data with these columns; a number's slider may have ends of its own.
fn mode_setting(
    ui: &mut Ui,
    setting: &Setting,
    reach: Option<theme::Reach>,
    columns: &[String],
    values: &mut crate::mode::Settings,
) {
    let label = label_of(setting);
    let response = match setting.kind {
        SettingKind::Number { min, max, default } => {
            let mut value = values.number(setting);
            // Many decades have their small values on the slider too.
            let log = max > 1000.0;
            let row =
                theme::NumberRow { label: &label, unit: setting.unit, range: min..=max, log, default: Some(default) };
            let response = match reach {
                Some(reach) => row.show_within(ui, &mut value, reach),
                None => row.show(ui, &mut value),
            };
            if response.changed() {
                values.set(setting, SettingValue::Number(value.clamp(min, max)));
            }
            response
        }
        SettingKind::Flag { default } => {
            let mut value = values.flag(setting);
            let response = theme::row(ui, &label, |ui| {
                ui.spacing_mut().item_spacing.x = 6.0;
                theme::reset_mark(ui, &label, value != default, || value = default);
                let switch = bevy_egui::egui::Checkbox::without_text(&mut value);
                theme::call(&ui.add_sized([18.0, theme::ROW], switch), &label);
            });
            if value != values.flag(setting) {
                values.set(setting, SettingValue::Flag(value));
            }
            response
        }
        SettingKind::Choice { options } => {
            theme::row(ui, &label, |ui| name_setting(ui, setting, options.iter().copied(), values))
        }
        SettingKind::Column { .. } => {
            theme::row(ui, &label, |ui| name_setting(ui, setting, columns.iter().map(String::as_str), values))
        }
        SettingKind::Vector { .. } => {
            let vectors = vectors_among(columns);
            theme::row(ui, &label, |ui| name_setting(ui, setting, vectors.iter().map(String::as_str), values))
        }
        SettingKind::Numbers { .. } | SettingKind::Colors { .. } => {
            theme::row(ui, &label, |ui| list_setting(ui, setting, values))
        }
    };
    let unit = if setting.unit.is_empty() { String::new() } else { format!(", {}", setting.unit) };
    let default = match setting.default() {
        SettingValue::Numbers(_) => "automatic".to_owned(),
        value => value.to_string(),
    };
    response.on_hover_text(format!("{}\n{}{unit}; default {default}", setting.help, setting.range()));
}

/// A name, one of `options`.
fn name_setting<'a>(
    ui: &mut Ui,
    setting: &Setting,
    options: impl Iterator<Item = &'a str>,
    values: &mut crate::mode::Settings,
) {
    let current = values.name(setting);
    ui.add_space(theme::MARK_ROOM);
    // Long names have their room, too.
    let width = theme::VALUE.min(ui.available_width() - theme::MARK_ROOM);
    let shown = ComboBox::from_id_salt(setting.name).width(width).selected_text(&current).show_ui(ui, |ui| {
        for option in options {
            let chosen = ui.selectable_label(current == option, option);
            theme::register(ui, &format!("{}:{option}", setting.name), chosen.rect);
            if chosen.clicked() {
                values.set(setting, SettingValue::Name(option.to_owned()));
            }
        }
    });
    theme::call(&shown.response, setting.name);
}

/// A list as text with commas; taken over when the field is left and the list is right.
fn list_setting(ui: &mut Ui, setting: &Setting, values: &mut crate::mode::Settings) {
    ui.add_space(theme::MARK_ROOM);
    let id = ui.id().with(setting.name);
    let set = values.0.get(setting.name).map(|value| value.to_string().trim_matches(['[', ']']).to_owned());
    let typed = ui.data(|data| data.get_temp::<String>(id));
    let mut text = typed.or(set).unwrap_or_default();
    let response = ui.add(TextEdit::singleline(&mut text).hint_text("automatic").desired_width(theme::VALUE - 8.0));
    theme::call(&response, setting.name);
    if response.lost_focus() {
        if let Some(value) = parse_list(setting, &text) {
            values.set(setting, value);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modes::grid::{ISO_COLORS, ISOVALUES};
    use crate::window::preset::Preset;
    use bevy_egui::egui::{Context, Event, Modifiers, MouseWheelUnit, PointerButton, Pos2, RawInput, TouchPhase, vec2};

    #[test]
    fn a_mode_of_another_crate_is_chosen_from_the_list() {
        static MODE: Mode = Mode { name: "mode-of-another-crate", ..modes::grid::MODE };
        modes::register(&MODE).unwrap();
        let mut settings = Settings::new(&Preset::default(), None);
        let ctx = Context::default();
        let mut frame = |events: Vec<Event>| {
            let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                ui.set_max_width(300.0);
                mode_combo(ui, modes::all().into_iter(), &mut settings);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            theme::take_controls(&ctx)
        };
        let click = |pos: Pos2| {
            let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
            let [down, up] = [true, false].map(|pressed| Event::PointerButton { pos, button, pressed, modifiers });
            vec![Event::PointerMoved(pos), down, up]
        };
        let (combo, _) = frame(Vec::new())["mode"];
        frame(click(combo.center()));
        // A list is laid out in one frame and shown in the next; it is longer than what is in sight.
        frame(Vec::new());
        let mut at = |events| frame(events)[&format!("mode:{}", MODE.name)];
        let (mut entry, mut in_sight) = at(vec![Event::PointerMoved(combo.center_bottom() + vec2(0.0, 20.0))]);
        for _ in 0..100 {
            let (unit, delta, phase) = (MouseWheelUnit::Point, vec2(0.0, -20.0), TouchPhase::Move);
            let wheel = Event::MouseWheel { unit, delta, phase, modifiers: Modifiers::NONE };
            (entry, in_sight) = at(if in_sight { Vec::new() } else { vec![wheel] });
        }
        assert!(in_sight);
        frame(click(entry.center()));
        assert!(settings.mode_chosen && std::ptr::eq(settings.mode, &MODE));
    }

    #[test]
    fn lists_are_read_from_text() {
        assert_eq!(parse_list(&ISOVALUES, " 0.5, 3e2 ,"), Some(SettingValue::Numbers(vec![0.5, 300.0])));
        assert_eq!(parse_list(&ISOVALUES, ""), Some(SettingValue::Numbers(Vec::new())));
        assert_eq!(parse_list(&ISOVALUES, "1, x"), None);
        assert_eq!(parse_list(&ISOVALUES, "1e39"), None);
        assert_eq!(parse_list(&ISO_COLORS, "#ff0000"), Some(SettingValue::Names(vec!["#ff0000".into()])));
        assert_eq!(parse_list(&ISO_COLORS, "red"), None);
    }
}
