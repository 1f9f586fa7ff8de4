//! The section about paths: whose, which flow level, and what they look like, by the settings' own description.

use super::mode::label_of;
use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::selection::{COLORS, Show};
use crate::explore::{Members, SelectionSet};
use crate::mode::paths::{HALO, LEAD, LEAST, OPACITY, RUN, SPACING, TAIL, UNWRAPPED, WIDEST, WIDTH};
use crate::mode::{Focus, PathColor, PathSettings, PathShape, PathsOf, Setting, SettingKind, SettingValue};
use crate::picture::paths::PickedPath;
use crate::window::state::answer::Answer;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{self, Ui};

/// The section.
pub static SECTION: Section = Section {
    name: "paths",
    title: "Paths",
    dock: Dock::Left,
    applies: |state| state.scene.as_ref().is_some_and(|scene| scene.following.is_some()),
    show: |ui, state| {
        let mut edited = state.settings.clone();
        let of = edited.paths.whose(edited.mode);
        let look = &mut edited.look;
        whose(ui, &of, &look.selections, &mut look.paths);
        if of != PathsOf::None {
            show(ui, state, &look.selections, &mut look.paths);
            picked(ui, state, &mut look.selections);
        }
        state.settings.set_if_neq(edited);
    },
};

/// An entry of a list; whether it was clicked.
fn entry(ui: &mut Ui, list: &str, text: &str, is_chosen: bool) -> bool {
    let label = ui.selectable_label(is_chosen, text);
    theme::register(ui, &format!("{list}:{text}"), label.rect);
    label.clicked()
}

fn whose(ui: &mut Ui, of: &PathsOf, selections: &[SelectionSet], paths: &mut PathSettings) {
    let shown = match of {
        PathsOf::None => "none".to_owned(),
        PathsOf::All => "all".to_owned(),
        PathsOf::Selections(names) => names.join(", "),
    };
    theme::combo(ui, "Paths of", &shown, |ui| {
        for (text, choice) in [("none", PathsOf::None), ("all", PathsOf::All)] {
            if entry(ui, "paths-of", text, *of == choice) {
                paths.of = Some(choice);
            }
        }
        for set in selections {
            let mut names = if let PathsOf::Selections(names) = of { names.clone() } else { Vec::new() };
            let is_chosen = names.contains(&set.name);
            if entry(ui, "paths-of", &set.name, is_chosen) {
                match is_chosen {
                    true => names.retain(|name| *name != set.name),
                    false => names.push(set.name.clone()),
                }
                paths.of = Some(if names.is_empty() { PathsOf::None } else { PathsOf::Selections(names) });
            }
        }
    });
}

fn show(ui: &mut Ui, state: &PanelState<'_, '_>, selections: &[SelectionSet], paths: &mut PathSettings) {
    theme::combo(ui, "Shape", paths.shape.name(), |ui| {
        for shape in PathShape::ALL {
            if entry(ui, "shape", shape.name(), paths.shape == shape) {
                paths.shape = shape;
            }
        }
    });
    let levels = state.scene.as_ref().and_then(|scene| Some(scene.following.as_ref()?.run().flow_errors().len()));
    let name = |level: Option<u32>| match level {
        None => "by spacing".to_owned(),
        Some(0) => "particles".to_owned(),
        Some(level) => format!("flow level {level}"),
    };
    theme::combo(ui, "Level", &name(paths.level), |ui| {
        for level in std::iter::once(None).chain((0..=levels.unwrap_or(0) as u32).map(Some)) {
            if entry(ui, "level", &name(level), paths.level == level) {
                paths.level = level;
            }
        }
    });
    if paths.level.is_none() {
        number_row(ui, &SPACING, paths);
    }
    for setting in [&TAIL, &LEAD, &WIDTH, &WIDEST, &LEAST, &OPACITY, &HALO, &RUN] {
        number_row(ui, setting, paths);
    }
    unwrapped(ui, state, paths);
    color(ui, state, paths);
    focus(ui, selections, paths);
}

/// A number of the settings.
fn number_row(ui: &mut Ui, setting: &Setting, paths: &mut PathSettings) {
    let SettingKind::Number { min, max, default } = setting.kind else { return };
    // A time of the run's clock is typed into files.
    let Some(SettingValue::Number(before)) = paths.value(setting) else {
        let text = paths.value(setting).map(|value| value.to_string()).unwrap_or_default();
        theme::fact(ui, &label_of(setting), text);
        return;
    };
    let mut value = before;
    let label = label_of(setting);
    let row = theme::NumberRow {
        label: &label,
        unit: setting.unit,
        range: min..=max,
        log: max > 1000.0 && min > 0.0,
        default: Some(default),
    };
    row.show(ui, &mut value).on_hover_text(setting.help);
    if value != before {
        // What is out of range stays as it was.
        let _ = paths.set(setting, &SettingValue::Number(value.clamp(min, max)));
    }
}

/// Whether paths leave a periodic box, where there is one.
fn unwrapped(ui: &mut Ui, state: &PanelState<'_, '_>, paths: &mut PathSettings) {
    if state.scene.as_ref().is_none_or(|scene| scene.periodic.is_none()) {
        return;
    }
    let row = theme::row(ui, &label_of(&UNWRAPPED), |ui| {
        ui.add_space(theme::MARK_ROOM);
        let switch = egui::Checkbox::without_text(&mut paths.unwrapped);
        theme::call(&ui.add_sized([18.0, theme::ROW], switch), UNWRAPPED.name);
    });
    row.on_hover_text(UNWRAPPED.help);
}

fn color(ui: &mut Ui, state: &PanelState<'_, '_>, paths: &mut PathSettings) {
    let plain = match paths.colored_by() {
        PathColor::Plain(color) => Some(color),
        _ => None,
    };
    let shown = if plain.is_some() { "a colour" } else { paths.color.as_str() }.to_owned();
    theme::combo(ui, "Colour by", &shown, |ui| {
        let quantities = ["speed", "direction", "mass", "time"].into_iter().map(str::to_owned);
        for name in quantities.chain(state.choices.attributes.iter().cloned()) {
            if entry(ui, "colour-by", &name, paths.color == name) {
                paths.color = name;
            }
        }
        if entry(ui, "colour-by", "a colour", plain.is_some()) && plain.is_none() {
            paths.color = "#ffffff".into();
        }
    });
    if let Some(color) = plain {
        theme::row(ui, "Colour", |ui| {
            let mut rgb = color.map(|part| (255.0 * part).round() as u8);
            let button = ui.color_edit_button_srgb(&mut rgb);
            theme::call(&button, "Colour of the paths");
            if button.changed() {
                let [r, g, b] = rgb;
                paths.color = format!("#{r:02x}{g:02x}{b:02x}");
            }
        });
    }
}

fn focus(ui: &mut Ui, selections: &[SelectionSet], paths: &mut PathSettings) {
    let shown = match &paths.focus {
        None => "none".to_owned(),
        Some(Focus::Selection(name)) => name.clone(),
        Some(Focus::Ball { .. }) => "a ball".to_owned(),
    };
    if selections.is_empty() && paths.focus.is_none() {
        return;
    }
    theme::combo(ui, "Focus", &shown, |ui| {
        if entry(ui, "focus", "none", paths.focus.is_none()) {
            paths.focus = None;
        }
        for set in selections {
            let choice = Focus::Selection(set.name.clone());
            if entry(ui, "focus", &set.name, paths.focus.as_ref() == Some(&choice)) {
                paths.focus = Some(choice);
            }
        }
    });
}

/// What was clicked.
fn picked(ui: &mut Ui, state: &mut PanelState<'_, '_>, selections: &mut Vec<SelectionSet>) {
    let wrong = |ui: &mut Ui, why: &str| {
        ui.add(egui::Label::new(egui::RichText::new(why).size(12.0).color(theme::BAD)).wrap());
    };
    let found = match &state.paths.picked {
        Answer::Nothing => {
            theme::fact(ui, "Click a path", "to read it");
            return;
        }
        Answer::Coming(_) => return theme::busy_bar(ui, state.time.elapsed_secs_f64()),
        Answer::Failed(why) => return wrong(ui, why),
        Answer::Here(None) => {
            theme::fact(ui, "Click a path", "there was none");
            return;
        }
        Answer::Here(Some(found)) => found.clone(),
    };
    facts(ui, state, &found);
    match &state.paths.members {
        Answer::Nothing => {
            let text = if found.level == 0 { "Keep the particle" } else { "Keep the particles" };
            if theme::button(ui, "paths:keep", text, true, "Makes a selection of who is in this path") {
                state.paths.ask_members();
            }
        }
        Answer::Coming(_) => theme::busy_bar(ui, state.time.elapsed_secs_f64()),
        Answer::Failed(why) => wrong(ui, why),
        Answer::Here(ids) => {
            let name = (1..)
                .map(|number| format!("path {number}"))
                .find(|name| selections.iter().all(|set| set.name != *name));
            let color = COLORS[selections.len() % COLORS.len()].to_owned();
            let members = Members::Ids(ids.clone());
            selections.push(SelectionSet {
                name: name.unwrap_or_default(),
                color,
                members,
                show: Show::Highlighted,
                follow: false,
            });
            state.paths.members = Answer::Nothing;
        }
    }
}

fn facts(ui: &mut Ui, state: &PanelState<'_, '_>, found: &PickedPath) {
    let Some(scene) = &state.scene else { return };
    let Some(run) = scene.following.as_ref().map(|following| following.run()) else { return };
    let directory = run.directory();
    let with = |value: f64, unit: &str| format!("{} {unit}", number::quantity(value)).trim().to_owned();
    let what = if found.level == 0 { "a particle".to_owned() } else { format!("a cluster of level {}", found.level) };
    theme::fact(ui, "Path of", format!("{what}, {}", found.family));
    if found.level > 0 {
        theme::fact(ui, "Particles", found.count.to_string());
    }
    let (length, mass) = (directory.length_unit.to_string(), directory.mass_unit.to_string());
    theme::fact(ui, "Mass", with(0.5 * (found.mass[0] + found.mass[1]), &mass));
    theme::fact(ui, "Speed", with(found.speed, &format!("{length} by the clock")));
    if let Some((name, [begin, end])) = &found.value {
        theme::fact(ui, name, format!("{} to {}", number::quantity(*begin), number::quantity(*end)));
    }
    for (label, position, step) in
        [("From", found.positions[0], found.interval), ("To", found.positions[1], found.interval + 1)]
    {
        let times = run.times();
        let time = times.times.get(step).map(|time| times.words(*time)).unwrap_or_default();
        let at = position.to_array().map(number::quantity).join(", ");
        theme::fact(ui, label, at).on_hover_text(format!("step {step}, {time}, {length}"));
    }
}
