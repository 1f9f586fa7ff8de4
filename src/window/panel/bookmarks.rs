//! The section about bookmarks: viewpoints on the number keys.

use super::{Dock, PanelState, Section, theme};
use crate::window::bookmarks::BookmarkAction;
use bevy_egui::egui::{self, RichText, TextEdit, Ui};

/// The section.
pub static SECTION: Section =
    Section { name: "bookmarks", title: "Bookmarks", dock: Dock::Right, applies: |state| state.scene.is_some(), show };

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let mut asked = None;
    let mut named = None;
    for bookmark in &state.looking.bookmarks.0 {
        let key = bookmark.key;
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 5.0;
            theme::key_cap(ui, &key.to_string());
            let mut name = bookmark.name.clone();
            let width = (ui.available_width() - 92.0).max(60.0);
            let field = TextEdit::singleline(&mut name).desired_width(width).hint_text("name it").char_limit(60);
            let field = ui.add(field);
            theme::call(&field, &format!("Name of the view on key {key}"));
            if field.changed() {
                named = Some((key, name));
            }
            if theme::button(ui, &format!("bookmark:{key}:fly"), "Fly to", true, "Fly there") {
                asked = Some(BookmarkAction::Visit(key));
            }
            if theme::button(ui, &format!("bookmark:{key}:forget"), "×", true, "Forget it") {
                asked = Some(BookmarkAction::Forget(key));
            }
        });
    }
    if let Some((key, name)) = named {
        state.looking.bookmarks.0.iter_mut().filter(|bookmark| bookmark.key == key).for_each(|bookmark| {
            bookmark.name.clone_from(&name);
        });
    }
    let free = (1..=9).chain([0]).find(|key| state.looking.bookmarks.on(*key).is_none());
    ui.horizontal(|ui| {
        if theme::button(ui, "bookmark:keep", "Keep this view", free.is_some(), "Ctrl and a digit does the same") {
            asked = free.map(BookmarkAction::Keep);
        }
        let text = free.map_or_else(|| "all keys are taken".to_owned(), |key| format!("on key {key}"));
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)));
    });
    if asked.is_some() {
        state.looking.asked_bookmark.0 = asked;
    }
}
