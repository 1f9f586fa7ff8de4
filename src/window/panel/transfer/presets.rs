//! Presets: chosen by name, and written back to their files.

use crate::window::scene::Settings;
use crate::window::theme;
use crate::window::transfer_presets::TransferPresets;
use bevy_egui::egui::{ComboBox, TextEdit, Ui};

/// The row of presets.
pub fn show(ui: &mut Ui, presets: &mut TransferPresets, settings: &mut Settings) {
    let id = ui.id().with("preset name");
    let mut naming = ui.data(|data| data.get_temp::<String>(id));
    let changed = presets.chosen().is_some_and(|(_, transfer)| *transfer != settings.transfer);
    let text = match presets.chosen() {
        Some((name, _)) if changed => format!("{name} *"),
        Some((name, _)) => name.to_owned(),
        None => "none".to_owned(),
    };
    let mut pick = None;
    theme::row(ui, "Preset", |ui| {
        let save_as =
            ui.small_button("save as").on_hover_text("write these colours to a preset's file of another name");
        theme::register(ui, "preset:save-as", save_as.rect);
        if save_as.clicked() {
            naming = Some(presets.chosen().map_or_else(String::new, |(name, _)| format!("{name}-2")));
        }
        let save = ui.add_enabled(changed, bevy_egui::egui::Button::new("save").small());
        if save.on_hover_text("write these colours to the preset's file").clicked()
            && let Some((name, _)) = presets.chosen()
        {
            let name = name.to_owned();
            presets.ask_to_save(name, settings.transfer.clone());
        }
        let combo = ComboBox::from_id_salt("preset").width(ui.available_width()).truncate().selected_text(text);
        let combo = combo.show_ui(ui, |ui| {
            for name in presets.names() {
                let chosen = presets.chosen().is_some_and(|(chosen, _)| chosen == name);
                if ui.selectable_label(chosen && !changed, name).clicked() {
                    pick = Some(name.to_owned());
                }
            }
        });
        theme::call(&combo.response, "Preset of colours");
    });
    if let Some(name) = pick
        && let Some(transfer) = presets.choose(&name)
    {
        settings.transfer = transfer;
    }
    if let Some(mut name) = naming.clone() {
        theme::row(ui, "Name", |ui| {
            let cancel = ui.small_button("cancel").clicked();
            let save = ui.small_button("save");
            theme::register(ui, "preset:name:save", save.rect);
            let save = save.clicked();
            let field = ui.add(TextEdit::singleline(&mut name).desired_width(ui.available_width()));
            theme::call(&field, "Name of the preset");
            theme::register(ui, "preset:name", field.rect);
            if save && !name.trim().is_empty() {
                presets.ask_to_save(name.trim().to_owned(), settings.transfer.clone());
            }
            naming = (!save && !cancel).then(|| name.clone());
        });
    }
    ui.data_mut(|data| match naming {
        Some(name) => {
            data.insert_temp(id, name);
        }
        None => data.remove::<String>(id),
    });
}
