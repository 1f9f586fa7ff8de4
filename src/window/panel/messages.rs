//! The section with all notices, the newest first; their text can be selected and copied.

use super::{Dock, Section, theme};
use crate::window::state::notices::Severity;
use bevy_egui::egui::{self, RichText, ScrollArea};

/// The section.
pub static SECTION: Section = Section {
    name: "messages",
    title: "Notices",
    dock: Dock::Right,
    applies: |state| state.notices.all().next().is_some(),
    show: |ui, state| {
        let count = state.notices.all().count();
        theme::row(ui, &format!("{count} kept"), |ui| {
            let copy = ui.small_button("copy all");
            theme::register(ui, "copy-messages", copy.rect);
            if copy.clicked() {
                let texts: Vec<&str> = state.notices.all().map(|notice| notice.text.as_str()).collect();
                ui.ctx().copy_text(texts.join("\n"));
            }
        });
        ScrollArea::vertical().id_salt("messages").max_height(260.0).auto_shrink([false, true]).show(ui, |ui| {
            for notice in state.notices.all().rev() {
                let color = match notice.severity {
                    Severity::Info => theme::LABEL,
                    Severity::Error => theme::BAD,
                };
                ui.add(egui::Label::new(RichText::new(&notice.text).size(12.0).color(color)).wrap().selectable(true));
                ui.add_space(2.0);
            }
        });
    },
};
