//! The section about colours: colour map and ranges.

use super::histogram::{Histogram, RangeEdit, range_editor, range_labels};
use super::{Dock, Section, theme};
use crate::app::exposure::Exposure;
use crate::app::legend::Legend;
use crate::app::look::Look;
use crate::app::scene::Settings;
use crate::raster::colormap::ColorMap;
use crate::raster::transfer::Range;
use crate::store::Metadata;
use bevy::prelude::{DetectChangesMut, Resource};
use bevy_egui::egui::{self, Color32, RichText, Ui, vec2};

/// What the combo boxes offer beyond the modes.
#[derive(Resource, Clone, Debug, Default)]
pub struct Choices {
    /// Attributes of the open dataset, each once.
    pub attributes: Vec<String>,
    /// Colour maps with a few of their colours.
    color_maps: Vec<(ColorMap, Vec<Color32>)>,
}

impl Choices {
    /// What does not depend on a dataset.
    pub fn of_program() -> Choices {
        let color = |[r, g, b]: [f32; 3]| {
            let byte = |component: f32| (255.0 * component).round() as u8;
            Color32::from_rgb(byte(r), byte(g), byte(b))
        };
        let sampled = |map: ColorMap| (map, map.sample(24).into_iter().map(color).collect());
        Choices { attributes: Vec::new(), color_maps: ColorMap::all().map(sampled).collect() }
    }
}

/// The section.
pub static SECTION: Section = Section {
    name: "transfer",
    title: "Colours",
    dock: Dock::Left,
    applies: |state| state.look.is_some(),
    show: |ui, state| {
        let (Some(scene), Some(look)) = (&state.scene, &state.look) else { return };
        let mut edited = state.settings.clone();
        show(ui, scene.file.metadata(), look, &state.exposure, &state.choices, &mut edited);
        state.settings.set_if_neq(edited);
    },
};

/// Draws the controls and writes what the user chose into `settings`.
pub fn show(
    ui: &mut Ui,
    metadata: &Metadata,
    look: &Look,
    exposure: &Exposure,
    choices: &Choices,
    settings: &mut Settings,
) {
    color_map_combo(ui, choices, settings);
    let legend = Legend::of(look, metadata);
    let hue_middle = 0.5;
    let p_range = &mut settings.transfer.range;
    let brightness = |t: f32| look.color(t, hue_middle);
    range(
        ui,
        "brightness",
        &legend.p.title,
        &legend.p.unit,
        exposure.brightness.as_ref(),
        look.levels.p,
        p_range,
        brightness,
    );
    if let (Some(hue), Some(axis)) = (&mut settings.transfer.hue, &legend.s) {
        let color = |t: f32| look.color(0.66, t);
        range(ui, "hue", &axis.title, &axis.unit, exposure.hue.as_ref(), look.levels.s, &mut hue.range, color);
    }
}

/// The colour map: of the hue where there is one, else of the brightness.
fn color_map_combo(ui: &mut Ui, choices: &Choices, settings: &mut Settings) {
    let transfer = &mut settings.transfer;
    let (map, reverse) = match &mut transfer.hue {
        Some(hue) => (&mut hue.color_map, &mut hue.reverse),
        None => (&mut transfer.color_map, &mut transfer.reverse),
    };
    theme::combo(ui, "Colour map", map.name(), |ui| {
        for (choice, colors) in &choices.color_maps {
            ui.horizontal(|ui| {
                let (rect, swatch) = ui.allocate_exact_size(vec2(52.0, 12.0), egui::Sense::click());
                let last = colors.len().saturating_sub(1);
                theme::gradient(ui.painter(), rect, false, |t| colors[(t * last as f32).round() as usize]);
                let label = ui.selectable_label(*map == *choice, choice.name()).on_hover_text(choice.help());
                theme::register(ui, &format!("colour-map:{}", choice.name()), label.rect);
                if label.clicked() || swatch.clicked() {
                    *map = *choice;
                }
            });
        }
        ui.separator();
        ui.checkbox(reverse, "reversed");
    });
}

/// A range with its histogram and labels.
fn range(
    ui: &mut Ui,
    id: &str,
    title: &str,
    unit: &str,
    histogram: Option<&Histogram>,
    in_use: [f64; 2],
    chosen: &mut Range,
    color: impl Fn(f32) -> Color32,
) {
    let Some(histogram) = histogram else { return };
    ui.add_space(4.0);
    theme::row(ui, title, |ui| {
        ui.spacing_mut().button_padding = vec2(5.0, 0.0);
        if *chosen == Range::Auto {
            ui.label(RichText::new("automatic").size(theme::SMALL).color(theme::LABEL));
        } else if ui.small_button("reset").on_hover_text("back to the automatic range").clicked() {
            *chosen = Range::Auto;
        }
    });
    let shown = match *chosen {
        Range::Auto => in_use,
        Range::Fixed(low, high) => [low, high],
    };
    // A range that reaches out of the data widens the axis, so that both ends can be taken hold of.
    let [low, high] = histogram.span;
    let wide = Histogram { span: [low.min(shown[0]), high.max(shown[1])], ..histogram.clone() };
    let axis = if wide.span == histogram.span { histogram.clone() } else { wide.spread_from(histogram) };
    match range_editor(ui, id, &axis, shown, color) {
        Some(RangeEdit::Set([low, high])) if low < high => *chosen = Range::Fixed(low, high),
        Some(RangeEdit::Automatic) => *chosen = Range::Auto,
        Some(RangeEdit::Set(_)) | None => {}
    }
    range_labels(ui, shown, unit);
}
