//! How light is exposed and spreads, under the colours.

use super::theme::{self, NumberRow};
use crate::color::bloom::{Bloom, RADII, STRENGTHS, THRESHOLDS};
use crate::color::exposure_mode::{ExposureMode, TIME_CONSTANTS};
use crate::window::scene::Settings;
use bevy_egui::egui::Ui;
use std::ops::RangeInclusive;

/// Draws the controls and writes what the user chose into `settings`.
pub fn show(ui: &mut Ui, settings: &mut Settings) {
    let mut exposure = settings.exposure;
    theme::combo(ui, "Exposure", name(exposure), |ui| {
        for mode in [ExposureMode::Steady, ExposureMode::Fixed, ExposureMode::Auto, ExposureMode::adaptive()] {
            let is_chosen = name(mode) == name(exposure);
            let choice = ui.selectable_label(is_chosen, name(mode)).on_hover_text(hint(mode));
            theme::register(ui, &format!("exposure:{}", name(mode)), choice.rect);
            // The same again keeps its time constants.
            if choice.clicked() && !is_chosen {
                exposure = mode;
            }
        }
    });
    if let ExposureMode::Adaptive { bright, dark } = &mut exposure {
        let seconds = |label| NumberRow { label, unit: "s", range: TIME_CONSTANTS, log: true, default: None };
        seconds("To brighter").show(ui, bright).on_hover_text("the eye covers 63 % of the way to brighter light in it");
        seconds("To darker").show(ui, dark).on_hover_text("the eye covers 63 % of the way to darker light in it");
    }
    let (mut bloom, usual) = (settings.bloom, Bloom::default());
    let share =
        |label, range: RangeInclusive<f64>, log, usual| NumberRow { label, unit: "", range, log, default: Some(usual) };
    share("Bloom", STRENGTHS, false, usual.strength)
        .show(ui, &mut bloom.strength)
        .on_hover_text("share of bright light that spreads around where it comes from");
    if !bloom.is_off() {
        share("Bloom above", THRESHOLDS, false, usual.threshold)
            .show(ui, &mut bloom.threshold)
            .on_hover_text("light that does not spread; 1 is the brightest of a screen");
        share("Bloom radius", RADII, true, usual.radius)
            .show(ui, &mut bloom.radius)
            .on_hover_text("how far light spreads, as a share of the picture's height");
    }
    (settings.exposure, settings.bloom) = (exposure, bloom);
}

fn name(mode: ExposureMode) -> &'static str {
    match mode {
        ExposureMode::Steady => "steady",
        ExposureMode::Fixed => "fixed",
        ExposureMode::Auto => "auto",
        ExposureMode::Adaptive { .. } => "adaptive",
    }
}

fn hint(mode: ExposureMode) -> &'static str {
    match mode {
        ExposureMode::Steady => "ranges follow the view smoothly",
        ExposureMode::Fixed => "ranges stay as they were found first",
        ExposureMode::Auto => "each picture has its own ranges",
        ExposureMode::Adaptive { .. } => "ranges follow as an eye: fast to brighter light, slowly to darker",
    }
}
