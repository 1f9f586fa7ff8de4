//! The section about selections: their colours, how they are shown, tables of them and plots over time.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::export::Format;
use crate::explore::selection::COLORS;
use crate::explore::{Members, Region, SelectionSet, Show};
use crate::window::looking::drawing::swatch;
use crate::window::state::answer::Answer;
use bevy_egui::egui::{self, ComboBox, RichText, TextEdit, Ui, vec2};

/// The section.
pub static SECTION: Section = Section {
    name: "selections",
    title: "Selections",
    dock: Dock::Right,
    applies: |state| state.scene.as_ref().is_some_and(|scene| !scene.is_about_heights(state.settings.mode)),
    show,
};

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let mut sets = state.settings.selections.clone();
    let (mut removed, mut followed) = (None, None);
    for (index, set) in sets.iter_mut().enumerate() {
        ui.push_id(index, |ui| {
            if row(ui, index, set) {
                removed = Some(index);
            }
            if actions(ui, index, set, state) {
                followed = Some(index);
            }
            by_ids(ui, set, state);
        });
    }
    // One at a time.
    if let Some(index) = followed {
        let follow = !sets[index].follow;
        sets.iter_mut().for_each(|set| set.follow = false);
        sets[index].follow = follow;
        state.looking.following.approach = follow;
    }
    if let Some(index) = removed {
        sets.remove(index);
    }
    if sets.is_empty() {
        let text = "Draw a sphere, a box or a lasso and keep it, or select by the values of a field:";
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)).wrap());
    }
    by_value(ui, state, &mut sets);
    if state.settings.selections != sets {
        state.settings.selections = sets;
    }
    if let Answer::Coming(coming) = &state.looking.keeping.export {
        theme::fact(ui, "Writing the table", "");
        super::progress(ui, &coming.progress);
    }
    super::over_time::show(ui, state);
}

/// Colour, name, how it is shown; whether it is to be removed.
fn row(ui: &mut Ui, index: usize, set: &mut SelectionSet) -> bool {
    let mut remove = false;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let color = set.rgb().unwrap_or([255; 3]);
        if swatch(ui, color, "Another colour").clicked() {
            let at = COLORS.iter().position(|known| *known == set.color).map_or(0, |at| (at + 1) % COLORS.len());
            set.color = COLORS[at].to_owned();
        }
        let width = (ui.available_width() - 118.0).max(50.0);
        let name = ui.add(TextEdit::singleline(&mut set.name).desired_width(width).char_limit(60));
        theme::call(&name, &format!("Name of selection {}", index + 1));
        theme::register(ui, &format!("selection:{index}:name"), name.rect);
        let title = |show: Show| match show {
            Show::Hidden => "hidden",
            Show::Highlighted => "shown",
            Show::Alone => "alone",
        };
        let shown = ComboBox::from_id_salt("show").width(62.0).selected_text(title(set.show)).show_ui(ui, |ui| {
            for show in [Show::Highlighted, Show::Alone, Show::Hidden] {
                let choice = ui.selectable_value(&mut set.show, show, title(show));
                theme::register(ui, &format!("selection:{index}:show:{}", title(show)), choice.rect);
            }
        });
        theme::call(&shown.response, &format!("How selection {} is shown", index + 1));
        theme::register(ui, &format!("selection:{index}:show"), shown.response.rect);
        remove = theme::button(ui, &format!("selection:{index}:remove"), "×", true, "Remove it");
    });
    remove
}

/// What can be done with one of them; whether it is to be followed, or not any more.
fn actions(ui: &mut Ui, index: usize, set: &SelectionSet, state: &mut PanelState<'_, '_>) -> bool {
    let Some(scene) = &state.scene else { return false };
    let mut toggled = false;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.add_space(17.0);
        if theme::button(ui, &format!("selection:{index}:probe"), "Probe", true, "Sum it up over the whole data") {
            state.looking.prober.start(scene, set.members.clone(), false);
        }
        for (format, title) in [(Format::Csv, "CSV"), (Format::Parquet, "Parquet")] {
            let help = "Write its particles with ids and all fields to a table beside the data";
            let idle = !matches!(state.looking.keeping.export, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:{title}"), title, idle, help) {
                state.looking.keeping.write(scene, &set.name, &set.members, format);
            }
        }
        if scene.following.is_some() {
            let help = "Plot its mass, way, velocities and fields over the steps of the run";
            let idle = !matches!(state.looking.keeping.over_time, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:over-time"), "Over time", idle, help) {
                state.looking.keeping.over_time(scene, &set.members);
            }
        }
    });
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.add_space(17.0);
        let text = RichText::new("Follow").size(12.0);
        let follow = ui.add(egui::Button::new(text).selected(set.follow).min_size(vec2(18.0, 18.0)));
        theme::register(ui, &format!("selection:{index}:follow"), follow.rect);
        let help = "Fly to its centre of mass and stay with it: in other snapshots, and while particles move";
        toggled = follow.on_hover_text(help).clicked();
        if let Members::Region(region) = &set.members {
            let help = "Keep it by the ids of its particles, which find them again in other snapshots of the same run";
            let idle = scene.source().is_some() && !matches!(state.looking.by_ids.answer, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:by-id"), "By id", idle, help) {
                state.looking.by_ids.ask(scene, &set.members);
            }
            let bounds = region.bounds();
            let finite = bounds.min.is_finite() && bounds.max.is_finite();
            if theme::button(ui, &format!("selection:{index}:fly"), "Fly to", finite, "Fly to it and turn around it") {
                *state.looking.visit = crate::window::looking::Visit(Some(bounds));
            }
        }
    });
    toggled
}

/// What is known of a selection's ids: how many are here, or why nobody knows.
fn by_ids(ui: &mut Ui, set: &SelectionSet, state: &PanelState<'_, '_>) {
    let coming = |ui: &mut Ui, what: &str, progress: &crate::window::state::progress::SharedProgress| {
        theme::fact(ui, what, "");
        super::progress(ui, progress);
    };
    if let Some(who) = state.looking.followed.of(&set.members) {
        match who {
            Answer::Here(who) => {
                let count = who.as_ref().map_or(0, |who| who.ids().len());
                let text = format!("{} particles, wherever they go", number::count(count));
                ui.label(RichText::new(text).size(12.0).color(if count == 0 { theme::BAD } else { theme::LABEL }));
            }
            Answer::Coming(lookup) => coming(ui, "Looking for its particles", &lookup.progress),
            Answer::Failed(why) => {
                let text = format!("It cannot be followed: {why}");
                ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::BAD)).wrap());
            }
            Answer::Nothing => {}
        }
        return;
    }
    let Some(ids) = set.members.ids() else {
        if let Answer::Coming(ids) = &state.looking.by_ids.answer
            && state.looking.by_ids.is_asked(&set.members)
        {
            coming(ui, "Reading ids", &ids.progress);
        }
        return;
    };
    match state.looking.looked_up.of(ids) {
        Some(Answer::Here(found)) => {
            let here = match found.count == ids.len() {
                true => format!("{} ids", number::count(ids.len())),
                false => format!("{} of {} ids are here", number::count(found.count), number::count(ids.len())),
            };
            let color = if found.count == 0 { theme::BAD } else { theme::LABEL };
            ui.label(RichText::new(here).size(12.0).color(color));
        }
        Some(Answer::Coming(lookup)) => coming(ui, "Looking for its particles", &lookup.progress),
        Some(Answer::Failed(why)) => {
            let text = format!("It cannot be shown: {why}");
            ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::BAD)).wrap());
        }
        Some(Answer::Nothing) | None => {
            ui.label(RichText::new(format!("{} ids", number::count(ids.len()))).size(12.0).color(theme::LABEL));
        }
    }
}

/// A new selection by the values of a field.
fn by_value(ui: &mut Ui, state: &mut PanelState<'_, '_>, sets: &mut Vec<SelectionSet>) {
    let Some(scene) = &state.scene else { return };
    let metadata = scene.file.metadata();
    let range = &mut *state.looking.range;
    ui.add_space(3.0);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        let infos = || metadata.families.iter().flat_map(|family| family.quantities.iter().chain(&family.attributes));
        // Other data may not have the field that was chosen.
        if !infos().any(|info| info.name == range.field)
            && let Some(first) = infos().next()
        {
            range.field.clone_from(&first.name);
        }
        let fields = ComboBox::from_id_salt("value field").width(74.0).truncate().selected_text(&range.field);
        let fields = fields.show_ui(ui, |ui| {
            for name in names(infos().map(|info| info.name.as_str())) {
                ui.selectable_value(&mut range.field, name.to_owned(), name);
            }
        });
        theme::call(&fields.response, "Field to select by");
        for (text, hint, name) in [(&mut range.min, "from", "range:from"), (&mut range.max, "to", "range:to")] {
            let field = ui.add(TextEdit::singleline(text).desired_width(38.0).hint_text(hint).char_limit(24));
            theme::call(&field, hint);
            theme::register(ui, name, field.rect);
        }
        let number = |text: &str| match text.trim() {
            "" => Some(None),
            text => text.parse::<f64>().ok().filter(|value| value.is_finite()).map(Some),
        };
        let ends = number(&range.min).zip(number(&range.max));
        let sound = ends.is_some_and(|(min, max)| {
            (min.is_some() || max.is_some()) && !matches!((min, max), (Some(min), Some(max)) if min > max)
        });
        if theme::button(ui, "range:add", "Select", sound, "Select the particles with such values")
            && let Some((min, max)) = ends
        {
            let region = Region::whole().with_range(range.field.clone(), min, max);
            sets.push(SelectionSet::new(format!("By {}", range.field), region, sets.len()));
        }
    });
}

/// Names, each once.
fn names<'a>(all: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    all.for_each(|name| {
        if !names.contains(&name) {
            names.push(name);
        }
    });
    names
}
