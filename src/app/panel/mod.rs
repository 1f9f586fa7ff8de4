//! The panel at the left: what the data is, how it is drawn, and how the program does.

pub mod histogram;
pub mod theme;

mod dataset;
mod display;
mod status;

pub use display::Choices;

use super::exposure::Exposure;
use super::look::Look;
use super::messages::Messages;
use super::open::Openings;
use super::scene::{Scene, Settings};
use super::statistics::{Converged, FrameClock, Statistics};
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use bevy_egui::egui::{self, RichText, ScrollArea, Ui};

/// All that the panel shows and edits.
#[derive(SystemParam)]
pub struct PanelState<'w> {
    /// The open dataset.
    pub scene: Option<Res<'w, Scene>>,
    /// What is shown of the settings in the picture.
    pub look: Option<Res<'w, Look>>,
    /// The latest messages.
    pub messages: Res<'w, Messages>,
    settings: ResMut<'w, Settings>,
    exposure: Res<'w, Exposure>,
    choices: Res<'w, Choices>,
    statistics: Res<'w, Statistics>,
    converged: Res<'w, Converged>,
    clock: Res<'w, FrameClock>,
    openings: Res<'w, Openings>,
    time: Res<'w, Time<Real>>,
}

impl PanelState<'_> {
    /// Draws the panel's contents.
    pub fn show(&mut self, ui: &mut Ui) {
        header(ui);
        ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
            // Room for the scroll bar, so that values do not jump when it appears.
            ui.set_max_width(ui.available_width() - 4.0);
            self.opening(ui);
            if let Some(scene) = &self.scene {
                let mut edited = self.settings.clone();
                dataset::show(ui, scene, &mut edited);
                if let Some(look) = &self.look {
                    display::show(ui, scene.file.metadata(), look, &self.exposure, &self.choices, &mut edited);
                }
                self.settings.set_if_neq(edited);
            } else if self.openings.progress().is_none() {
                ui.add_space(12.0);
                ui.label(
                    RichText::new("Nothing is open. Drop a snapshot, a catalogue or a page file here.")
                        .color(theme::LABEL),
                );
            }
            status::show(ui, &self.statistics, *self.converged, &self.clock, self.scene.is_some());
            status::messages(ui, &self.messages);
        });
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
        ui.ctx().request_repaint();
    }
}

/// The program's name, and how to get help.
fn header(ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label(RichText::new("deepfield").size(17.0).color(theme::TEXT).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new("help").size(12.0).color(theme::LABEL));
            ui.spacing_mut().item_spacing.x = 4.0;
            theme::key_cap(ui, "F1");
        });
    });
}
