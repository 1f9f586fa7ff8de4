//! The first page, of a window that shows nothing yet: what can be opened, and how.

use super::{Ask, Files, Purpose, menu};
use crate::heights::import::height_names;
use crate::import;
use crate::window::theme;
use bevy_egui::egui::{self, Align2, FontId, RichText, ScrollArea, Sense, Stroke, StrokeKind, Ui, vec2};

/// Width of the page at most, logical pixels.
const WIDTH: f32 = 640.0;

/// What can be opened: the kind, what it is, and its formats.
fn kinds() -> [(&'static str, &'static str, String); 5] {
    [
        (
            "Particles",
            "Snapshots of simulations, star catalogues and point clouds of any size, which are built into a cache first.",
            import::names(),
        ),
        (
            "Runs",
            "A run of snapshots as one file, or a file of many steps: time is played, and particles move between steps.",
            String::new(),
        ),
        (
            "Images and volumes",
            "Grids of samples in two or three dimensions, as points, clouds or surfaces.",
            import::grid::grid_names(),
        ),
        ("Heights", "Measured surfaces and terrain, to turn, to measure and to compare.", height_names()),
        (
            "Page files, scenes and tours",
            "What deepfield has built and saved: .df opens at once, .scene.ron brings back a view, a tour plays.",
            String::new(),
        ),
    ]
}

/// Draws the page into a part of the window.
pub fn show(ui: &mut Ui, rect: egui::Rect, files: &mut Files) {
    files.recent.keep_fresh(ui.input(|input| input.time));
    let hovered = ui.input(|input| !input.raw.hovered_files.is_empty());
    let width = WIDTH.min(rect.width() - 48.0).max(120.0);
    let room = egui::Rect::from_center_size(rect.center(), vec2(width, (rect.height() - 32.0).max(60.0)));
    ui.scope_builder(egui::UiBuilder::new().id_salt("first page").max_rect(room), |ui| {
        ScrollArea::vertical().id_salt("first page").auto_shrink([false, false]).show(ui, |ui| {
            ui.set_max_width(width - theme::SCROLL_ROOM);
            contents(ui, hovered, files);
        });
    });
}

fn contents(ui: &mut Ui, hovered: bool, files: &mut Files) {
    ui.add_space(12.0);
    ui.label(RichText::new("Open something to look at").size(20.0).color(theme::TEXT));
    ui.add_space(10.0);
    let mut asked = None;
    ui.horizontal(|ui| {
        if theme::button(ui, "page:open", "Open...", true, "Chooses a file (Ctrl+O)") {
            asked = Some(Ask::Choose(Purpose::Open));
        }
        let help = "Chooses a folder: of a simulation, a catalogue, slices or the parts of a table (Ctrl+Shift+O)";
        if theme::button(ui, "page:open-folder", "Open folder...", true, help) {
            asked = Some(Ask::ChooseFolder);
        }
        if theme::button(ui, "page:type", "Type a path...", true, "Opens a file by its path") {
            asked = Some(Ask::Type(Purpose::Open));
        }
        let help = "A small part of a simulated universe, which is part of the program";
        if files.has_demo() && theme::button(ui, "page:demo", "Demo", true, help) {
            asked = Some(Ask::Demo);
        }
    });
    ui.add_space(10.0);
    let (place, _) = ui.allocate_exact_size(vec2(ui.available_width(), 56.0), Sense::hover());
    let color = if hovered { theme::ACCENT } else { theme::LABEL };
    ui.painter().rect(place, 6.0, theme::WELL, Stroke::new(1.0, color), StrokeKind::Inside);
    let font = FontId::proportional(theme::BODY);
    ui.painter().text(place.center(), Align2::CENTER_CENTER, "or drop a file or a folder here", font, color);
    if !files.recent.files().is_empty() {
        theme::section(ui, "Recent");
        asked = menu::recent(ui, "page:recent", files.recent.files()).or(asked);
    }
    theme::section(ui, "What can be opened");
    for (kind, what, formats) in kinds() {
        ui.add_space(4.0);
        ui.label(RichText::new(kind).color(theme::TEXT));
        ui.label(RichText::new(what).color(theme::LABEL));
        if !formats.is_empty() {
            ui.label(RichText::new(formats).size(theme::SMALL).color(theme::LABEL));
        }
    }
    if asked.is_some() {
        files.asked = asked;
    }
}
