//! The section about named objects: the most important of a catalogue, to fly to and to probe.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::Members;
use crate::window::looking::Visit;
use crate::window::objects::{Objects, extent, usual_radius};
use crate::window::state::answer::Answer;
use bevy_egui::egui::{self, Align, Layout, RichText, TextEdit, Ui, vec2};

/// Rows of the list.
const ROWS: usize = 8;

/// The section.
pub static SECTION: Section = Section {
    name: "objects",
    title: "Objects",
    dock: Dock::Right,
    applies: |state| state.scene.is_some() && !matches!(state.looking.objects.catalogue, Answer::Nothing),
    show,
};

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let Some(scene) = &state.scene else { return };
    match &state.looking.objects.catalogue {
        Answer::Coming(_) => drop(theme::fact(ui, "Reading the catalogue", "")),
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Nothing | Answer::Here(_) => {}
    }
    if state.looking.objects.catalogue.here().is_none() {
        return;
    }
    let field = TextEdit::singleline(&mut state.looking.objects.search).hint_text("search").char_limit(60);
    let field = ui.add(field.desired_width(f32::INFINITY));
    theme::call(&field, "Search for an object");
    theme::register(ui, "objects:search", field.rect);
    let (found, count) = state.looking.objects.found(ROWS);
    let usual = usual_radius(scene.bounds);
    let (mut visit, mut probe) = (None, None);
    for (row, object) in found.iter().enumerate() {
        let (region, bounds) = extent(object, usual);
        let size = vec2(ui.available_width(), theme::ROW);
        ui.allocate_ui_with_layout(size, Layout::right_to_left(Align::Center), |ui| {
            ui.set_min_height(theme::ROW);
            ui.spacing_mut().item_spacing.x = 3.0;
            if theme::button(ui, &format!("object:{row}:probe"), "Probe", true, "Sum up what is within its radius") {
                probe = Some(region);
            }
            if theme::button(ui, &format!("object:{row}:fly"), "Fly to", true, "Fly to it and turn around it") {
                visit = Some(bounds);
            }
            // What room is left is the name's.
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let mass = object.mass.map_or_else(String::new, number::quantity);
                let name = egui::Label::new(RichText::new(&object.name).color(theme::TEXT)).truncate();
                ui.add(name).on_hover_text(format!("mass {mass}"));
            });
        });
    }
    if count > found.len() {
        let more = format!("and {} more", number::count((count - found.len()) as u64));
        ui.label(RichText::new(more).size(12.0).color(theme::LABEL));
    }
    if visit.is_some() {
        *state.looking.visit = Visit(visit);
    }
    if let Some(region) = probe {
        state.looking.prober.start(scene, Members::Region(region), false);
    }
    if theme::button(ui, "objects:close", "Close", true, "Forget the catalogue") {
        *state.looking.objects = Objects::default();
    }
}
