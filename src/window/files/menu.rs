//! The menu of files, in the header of the panels.

use super::recent::Known;
use super::{Ask, Files, Purpose, name_of};
use crate::window::theme;
use bevy_egui::egui::{Button, RichText, Ui};

/// Draws the menu's button, and the menu where it is open; `saves`: whether there is a scene to save.
pub fn show(ui: &mut Ui, files: &mut Files, saves: bool) {
    let now = ui.input(|input| input.time);
    let menu = ui.menu_button(RichText::new("File").size(12.0), |ui| {
        ui.set_min_width(220.0);
        files.recent.keep_fresh(now);
        let mut asked = None;
        let mut entry = |ui: &mut Ui, name: &str, text: &str, keys: &str, enabled: bool, ask: Ask| {
            let button = ui.add_enabled(enabled, Button::new(text).shortcut_text(keys).frame(false));
            theme::register(ui, name, button.rect);
            if button.clicked() {
                asked = Some(ask);
                ui.close();
            }
        };
        entry(ui, "file:open", "Open...", "Ctrl+O", true, Ask::Choose(Purpose::Open));
        entry(ui, "file:open-folder", "Open folder...", "Ctrl+Shift+O", true, Ask::ChooseFolder);
        entry(ui, "file:type", "Type a path...", "", true, Ask::Type(Purpose::Open));
        if files.has_demo() {
            entry(ui, "file:demo", "Open the demo", "", true, Ask::Demo);
        }
        ui.separator();
        entry(ui, "file:save", "Save the scene", "Ctrl+S", saves, Ask::Save);
        entry(ui, "file:save-as", "Save the scene as...", "Ctrl+Shift+S", saves, Ask::Choose(Purpose::SaveAs));
        if !files.recent.files().is_empty() {
            ui.separator();
            ui.label(RichText::new("RECENT").size(theme::SMALL).color(theme::LABEL).strong());
            if let Some(path) = recent(ui, "file:recent", files.recent.files()) {
                asked = Some(path);
                ui.close();
            }
            ui.separator();
            let forget = ui.add(Button::new("Forget these").frame(false));
            if forget.clicked() {
                asked = Some(Ask::Forget);
                ui.close();
            }
        }
        asked
    });
    theme::register(ui, "file", menu.response.rect);
    if let Some(asked) = menu.inner.flatten() {
        files.asked = Some(asked);
    }
}

/// Draws files that were opened before below each other, missing ones faint; the one that is clicked. Their controls are called `NAME:0` and so on.
pub(super) fn recent(ui: &mut Ui, name: &str, files: &[Known]) -> Option<Ask> {
    let mut clicked = None;
    for (index, known) in files.iter().enumerate() {
        let folder = known.path.parent().map(|folder| folder.display().to_string()).unwrap_or_default();
        let (state, color) = match known.is_missing {
            true => ("   (not there)", theme::LABEL.gamma_multiply(0.7)),
            false => ("", theme::TEXT),
        };
        let text = RichText::new(format!("{}   {folder}{state}", name_of(&known.path))).color(color);
        let button = ui.add(Button::new(text).frame(false).truncate());
        theme::register(ui, &format!("{name}:{index}"), button.rect);
        if button.on_hover_text(known.path.display().to_string()).clicked() {
            clicked = Some(Ask::Use(Purpose::Open, known.path.clone()));
        }
    }
    clicked
}
