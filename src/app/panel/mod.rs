//! The panels in two docks: what the data is and how it is drawn at the left, what one learns of it at the right.

pub mod histogram;
pub mod section;
pub mod theme;
pub mod transfer;

mod annotations;
mod bookmarks;
mod closer;
mod dataset;
mod display;
mod messages;
mod mode;
mod objects;
mod probe;
mod selections;
mod show;
mod statistics;
mod tour;
mod view;

pub use display::Choices;
pub use section::{Closed, Dock, Section};

use super::camera::Viewpoint;
use super::exposure::Exposure;
use super::history::{History, Step};
use super::look::Look;
use super::looking::LookingState;
use super::messages::Messages;
use super::network::Leading;
use super::open::Openings;
use super::picture::DataCamera;
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::scene_io::SceneFiles;
use super::statistics::{Converged, FrameClock, Statistics};
use super::touring::Player;
use super::transfer_presets::TransferPresets;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use bevy_egui::egui::{self, RichText, Ui};

/// Every section, from the top of each dock.
pub static SECTIONS: [&Section; 14] = [
    &dataset::SECTION,
    &mode::SECTION,
    &display::SECTION,
    &view::SECTION,
    &annotations::SECTION,
    &closer::SECTION,
    &probe::SECTION,
    &objects::SECTION,
    &selections::SECTION,
    &bookmarks::SECTION,
    &tour::SECTION,
    &show::SECTION,
    &statistics::SECTION,
    &messages::SECTION,
];

/// All that the panels show and edit.
#[derive(SystemParam)]
pub struct PanelState<'w, 's> {
    /// The open dataset.
    pub scene: Option<Res<'w, Scene>>,
    /// What is shown of the settings in the picture.
    pub look: Option<Res<'w, Look>>,
    /// The latest messages.
    pub messages: ResMut<'w, Messages>,
    /// What the user has chosen.
    pub settings: ResMut<'w, Settings>,
    /// Which sections are closed.
    pub closed: ResMut<'w, Closed>,
    /// The tour.
    pub player: ResMut<'w, Player>,
    /// What looks closer.
    pub looking: LookingState<'w>,
    /// The show that this window leads.
    leading: Option<ResMut<'w, Leading>>,
    history: ResMut<'w, History>,
    files: ResMut<'w, SceneFiles>,
    preset: Res<'w, Preset>,
    exposure: Res<'w, Exposure>,
    choices: Res<'w, Choices>,
    presets: ResMut<'w, TransferPresets>,
    statistics: Res<'w, Statistics>,
    converged: Res<'w, Converged>,
    clock: Res<'w, FrameClock>,
    openings: ResMut<'w, Openings>,
    time: Res<'w, Time<Real>>,
    camera: Query<'w, 's, &'static Viewpoint, With<DataCamera>>,
}

impl PanelState<'_, '_> {
    /// Draws a dock's contents.
    pub fn show(&mut self, ui: &mut Ui, dock: Dock) {
        if dock == Dock::Left {
            ui.scope(|ui| {
                ui.set_max_width(ui.available_width() - theme::SCROLL_ROOM);
                self.header(ui);
                self.opening(ui);
                if self.scene.is_none() && self.openings.progress().is_none() {
                    ui.add_space(12.0);
                    let hint = "Nothing is open. Drop a snapshot, a catalogue, a page file or a scene here.";
                    ui.label(RichText::new(hint).color(theme::LABEL));
                    ui.add_space(12.0);
                }
            });
        }
        section::show_dock(ui, dock, self);
    }

    /// The program's name, and what one can do at any time.
    fn header(&mut self, ui: &mut Ui) {
        let [past, future] = self.history.steps();
        ui.horizontal(|ui| {
            ui.label(RichText::new("deepfield").size(17.0).color(theme::TEXT).strong());
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                let mut button =
                    |text: &str, name: &str, enabled: bool, help: &str| theme::button(ui, name, text, enabled, help);
                button("F1", "help", true, "Keys and gestures: press F1");
                if button("Save", "save", self.scene.is_some(), "Save the scene (Ctrl+S)") {
                    self.files.asked = true;
                }
                if button("Redo", "redo", future > 0, "Redo what was undone (Ctrl+Shift+Z, Ctrl+Y)") {
                    self.history.asked = Some(Step::Redo);
                }
                if button("Undo", "undo", past > 0, "Undo the last change of a setting (Ctrl+Z)") {
                    self.history.asked = Some(Step::Undo);
                }
            });
        });
        ui.add_space(6.0);
    }

    /// What is being opened, with a bar.
    fn opening(&self, ui: &mut Ui) {
        let Some((path, stage, share)) = self.openings.progress() else { return };
        theme::section(ui, "Opening");
        let name = path.file_name().map_or_else(|| path.to_string_lossy(), |name| name.to_string_lossy());
        ui.add(egui::Label::new(RichText::new(name).color(theme::TEXT)).truncate());
        match share {
            Some(share) => {
                theme::fact(ui, &stage, format!("{:.0} %", 100.0 * share));
                theme::bar(ui, share, theme::ACCENT);
            }
            None => {
                theme::fact(ui, &stage, "");
                theme::busy_bar(ui, self.time.elapsed_secs_f64());
            }
        }
        ui.add_space(4.0);
        ui.ctx().request_repaint();
    }
}
