//! The panel's part about the dataset: its facts and its families.

use super::theme;
use crate::app::scene::{Scene, Settings};
use bevy_egui::egui::{self, Align, Layout, RichText, Ui};

/// Draws the facts, and a toggle for each family.
pub fn show(ui: &mut Ui, scene: &Scene, settings: &mut Settings) {
    theme::section(ui, "Dataset");
    let name = scene.path.file_name().map_or_else(|| scene.path.to_string_lossy(), |name| name.to_string_lossy());
    ui.add(egui::Label::new(RichText::new(name).color(theme::TEXT).size(14.0)).truncate())
        .on_hover_text(scene.path.display().to_string());
    for (label, value) in &scene.facts.rows {
        theme::fact(ui, label, value.as_str());
    }
    if !scene.facts.notes.is_empty() {
        let title = match scene.facts.notes.len() {
            1 => "1 note".to_owned(),
            n => format!("{n} notes"),
        };
        egui::CollapsingHeader::new(RichText::new(title).color(theme::LABEL)).id_salt("notes").show(ui, |ui| {
            for note in &scene.facts.notes {
                ui.label(RichText::new(note).size(12.0).color(theme::LABEL));
            }
        });
    }
    theme::section(ui, "Families");
    for (family, visible) in scene.facts.families.iter().zip(&mut settings.families) {
        let color = if *visible { theme::TEXT } else { theme::LABEL };
        ui.allocate_ui_with_layout(
            egui::vec2(ui.available_width(), theme::ROW),
            Layout::left_to_right(Align::Center),
            |ui| {
                ui.checkbox(visible, RichText::new(&family.name).color(color));
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    ui.label(RichText::new(&family.count).color(color));
                });
            },
        )
        .response
        .on_hover_text(&family.details);
    }
}
