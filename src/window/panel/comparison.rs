//! The section about the comparison of two hierarchies.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::mode::levels::SPLATS;
use crate::window::comparison::{WAYS, applies};
use bevy_egui::egui::Ui;

/// The section, where something can be compared.
pub static SECTION: Section = Section {
    name: "comparison",
    title: "Comparison",
    dock: Dock::Left,
    applies: |state| state.look.as_ref().zip(state.scene.as_ref()).is_some_and(|(look, scene)| applies(look, scene)),
    show,
};

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let seconds = state.time.elapsed_secs_f64();
    let comparison = &mut *state.comparison;
    theme::switch(ui, "Compare", &mut comparison.is_on).on_hover_text(
        "The view at rest through two hierarchies of the file, at both sides of a divider that can be dragged.",
    );
    if !comparison.is_on {
        return;
    }
    for (label, way) in ["Left", "Right"].into_iter().zip(&mut comparison.compared.ways) {
        theme::combo(ui, label, way.name, |ui| {
            for choice in &WAYS {
                let text = ui.selectable_label(*way == choice, choice.name).on_hover_text(choice.about);
                theme::register(ui, &format!("{}:{}", label.to_lowercase(), choice.name), text.rect);
                if text.clicked() {
                    *way = choice;
                }
            }
        })
        .on_hover_text(way.about);
    }
    let budget = theme::NumberRow { label: "Splats each", unit: "", range: 0.0..=1e8, log: true, default: None };
    budget.show(ui, &mut comparison.compared.splats).on_hover_text(SPLATS.help);
    theme::switch(ui, "Difference", &mut comparison.shows_difference)
        .on_hover_text("Four times the difference of the two pictures.");
    match comparison.found() {
        Some(found) => {
            let [left, right] = found.splats.map(number::count);
            theme::fact(ui, "Drawn", format!("{left}  |  {right}"));
            theme::fact(ui, "Colours differ by", format!("{:.2} of 255", found.color_error))
                .on_hover_text("Mean distance of the colours of a pixel.");
        }
        None if comparison.is_drawing() => theme::busy_bar(ui, seconds),
        None => {}
    }
}
