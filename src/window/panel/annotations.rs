//! The section about what is written into the picture.

use super::{Dock, Section, theme};
use crate::annotate::Annotations;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{TextEdit, Ui};

/// The section.
pub static SECTION: Section = Section {
    name: "annotations",
    title: "Annotations",
    dock: Dock::Left,
    applies: |state| state.scene.is_some(),
    show: |ui, state| {
        let mut edited = state.settings.clone();
        show(ui, &mut edited.annotations);
        state.settings.set_if_neq(edited);
    },
};

fn show(ui: &mut Ui, annotations: &mut Annotations) {
    theme::switch(ui, "Legend", &mut annotations.legend);
    theme::switch(ui, "Scale bar", &mut annotations.scale_bar);
    theme::switch(ui, "Clock", &mut annotations.clock);
    theme::switch(ui, "Axes", &mut annotations.axes);
    theme::switch(ui, "Directions", &mut annotations.triad);
    let mut names = annotations.labels > 0;
    theme::switch(ui, "Names", &mut names);
    if names != (annotations.labels > 0) {
        annotations.labels = if names { Annotations::default().labels } else { 0 };
    }
    theme::row(ui, "Caption", |ui| {
        ui.add_space(theme::MARK_ROOM);
        let width = theme::VALUE - 8.0;
        let field = TextEdit::singleline(&mut annotations.caption).hint_text("none").desired_width(width);
        theme::call(&ui.add(field), "Caption");
    });
}
