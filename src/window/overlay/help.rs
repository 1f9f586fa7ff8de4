//! The help page (F1): every key and gesture.

use crate::window::input::HELP;
use crate::window::theme;
use bevy_egui::egui::{self, Align2, RichText, Ui};

/// Draws the page in the middle of the picture.
pub fn draw(ctx: &egui::Context, picture: egui::Rect) {
    egui::Area::new("help".into())
        .order(egui::Order::Foreground)
        .pivot(Align2::CENTER_CENTER)
        .fixed_pos(picture.center())
        .interactable(false)
        .show(ctx, |ui| {
            theme::card_frame().show(ui, |ui| {
                ui.label(RichText::new("Keys and gestures").size(16.0).color(theme::TEXT));
                ui.add_space(6.0);
                ui.horizontal_top(|ui| {
                    ui.spacing_mut().item_spacing.x = 34.0;
                    let (left, right) = HELP.split_at(HELP.len() / 2);
                    for column in [left, right] {
                        ui.vertical(|ui| column.iter().for_each(|(title, rows)| section(ui, title, rows)));
                    }
                });
            });
        });
}

/// A titled table of keys.
fn section(ui: &mut Ui, title: &str, rows: &[(&str, &str)]) {
    ui.spacing_mut().item_spacing.x = 8.0;
    ui.label(RichText::new(title.to_uppercase()).size(theme::SMALL).color(theme::LABEL).strong());
    egui::Grid::new(title).num_columns(2).spacing([16.0, 6.0]).min_col_width(108.0).show(ui, |ui| {
        for (keys, what) in rows {
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                for key in keys.split("  ") {
                    if key == "or" {
                        ui.label("or");
                    } else {
                        theme::key_cap(ui, key.trim());
                    }
                }
            });
            ui.label(RichText::new(*what).color(theme::TEXT));
            ui.end_row();
        }
    });
    ui.add_space(10.0);
}
