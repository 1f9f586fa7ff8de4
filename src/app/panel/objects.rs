//! The section about named objects: the most important of a catalogue, to fly to and to probe.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::app::looking::Visit;
use crate::app::looking::answer::Answer;
use crate::app::objects::{Objects, extent, usual_radius};
use crate::explore::Members;
use bevy_egui::egui::{self, RichText, TextEdit, Ui};

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
    theme::register(ui, "objects:search", field.rect);
    let (found, count) = state.looking.objects.found(ROWS);
    let usual = usual_radius(scene.bounds);
    let (mut visit, mut probe) = (None, None);
    for (row, object) in found.iter().enumerate() {
        let (region, bounds) = extent(object, usual);
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 3.0;
            let mass = object.mass.map_or_else(String::new, number::quantity);
            let width = (ui.available_width() - 90.0).max(50.0);
            let name = egui::Label::new(RichText::new(&object.name).color(theme::TEXT)).truncate();
            ui.add_sized([width, theme::ROW], name).on_hover_text(format!("mass {mass}"));
            if theme::button(ui, &format!("object:{row}:fly"), "Fly to", true, "Fly to it and turn around it") {
                visit = Some(bounds);
            }
            if theme::button(ui, &format!("object:{row}:probe"), "Probe", true, "Sum up what is within its radius") {
                probe = Some(region);
            }
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
        state.looking.prober.start(&scene.file, Members::Region(region), None);
    }
    if theme::button(ui, "objects:close", "Close", true, "Forget the catalogue") {
        *state.looking.objects = Objects::default();
    }
}
