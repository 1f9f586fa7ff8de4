//! The section about the data: its facts, its families, and each field with unit, range and distribution.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::hierarchy::{AttributeInfo, Histogram};
use crate::store::FamilyMetadata;
use crate::window::facts::DatasetFact;
use crate::window::options::OpenRequest;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{self, Align, Layout, Rect, RichText, Sense, Ui, pos2, vec2};

/// The section.
pub static SECTION: Section = Section {
    name: "data",
    title: "Data",
    dock: Dock::Left,
    applies: |state| state.scene.is_some(),
    show: |ui, state| {
        let mut families = state.settings.families.clone();
        let mut adds = state.openings.adds_dropped;
        let removed = show(ui, state, &mut families, &mut adds);
        if state.openings.adds_dropped != adds {
            state.openings.adds_dropped = adds;
        }
        if let (Some(removed), Some(scene)) = (removed, &state.scene) {
            let mut members = scene.members.clone();
            members.remove(removed.min(members.len().saturating_sub(1)));
            state.openings.start(OpenRequest { members, ..OpenRequest::default() });
        }
        if state.settings.families != families {
            let edited = crate::window::scene::Settings { families, ..state.settings.clone() };
            state.settings.set_if_neq(edited);
        }
    },
};

/// Draws the facts, and a toggle for each family with its fields; the dataset that is to be closed, of several.
fn show(ui: &mut Ui, state: &PanelState<'_, '_>, families: &mut [bool], adds: &mut bool) -> Option<usize> {
    let scene = state.scene.as_ref()?;
    // Of several datasets each has its name above its families.
    if !scene.file.is_joined() && scene.facts.sampled.is_empty() {
        let name = scene.path.file_name().map_or_else(|| scene.path.to_string_lossy(), |name| name.to_string_lossy());
        ui.add(egui::Label::new(RichText::new(name).color(theme::TEXT).size(14.0)).truncate())
            .on_hover_text(scene.path.display().to_string());
    }
    for (label, value) in &scene.facts.rows {
        theme::fact(ui, label, value.as_str());
    }
    if !scene.facts.notes.is_empty() {
        let title = match scene.facts.notes.len() {
            1 => "1 note".to_owned(),
            n => format!("{n} notes"),
        };
        egui::CollapsingHeader::new(RichText::new(title).color(theme::LABEL)).id_salt("notes").show(ui, |ui| {
            for note in &scene.facts.notes {
                ui.label(RichText::new(note).size(12.0).color(theme::LABEL));
            }
        });
    }
    ui.add_space(3.0);
    let mut removed = None;
    for (kind, field) in &scene.facts.sampled {
        // The last dataset stays.
        if heading_of(ui, field) && scene.members.len() > 1 {
            removed = Some(field.index);
        }
        theme::fact(ui, kind, field.details.lines().nth(1).unwrap_or_default());
    }
    let described = scene.facts.families.iter().zip(&scene.metadata().families).zip(families);
    for (i, ((fact, family), visible)) in described.enumerate() {
        let heading = scene.facts.datasets.iter().position(|dataset| dataset.first_family == i);
        let number = scene.facts.datasets.iter().take_while(|dataset| dataset.first_family <= i).count();
        // Names of controls tell families of several datasets apart.
        let name = if number > 1 { format!("{}:{number}", fact.name) } else { fact.name.clone() };
        if let Some(dataset) = heading
            && heading_of(ui, &scene.facts.datasets[dataset])
        {
            removed = Some(scene.facts.datasets[dataset].index);
        }
        let color = if *visible { theme::TEXT } else { theme::LABEL };
        ui.allocate_ui_with_layout(
            vec2(ui.available_width(), theme::ROW),
            Layout::left_to_right(Align::Center),
            |ui| {
                let toggle = ui.checkbox(visible, RichText::new(&fact.name).color(color));
                theme::register(ui, &format!("family:{name}"), toggle.rect);
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    ui.label(RichText::new(&fact.count).color(color));
                });
            },
        )
        .response
        .on_hover_text(&fact.details);
        fields(ui, &name, family);
    }
    theme::switch(ui, "add dropped files", adds).on_hover_text(
        "Files that are dropped on the window are shown with what is open, not in its place. Shift does the same.",
    );
    removed
}

/// The name of a dataset of several, and a button; whether it is to be removed.
fn heading_of(ui: &mut Ui, dataset: &DatasetFact) -> bool {
    ui.add_space(4.0);
    let row = vec2(ui.available_width(), theme::ROW);
    let shown = ui.allocate_ui_with_layout(row, Layout::right_to_left(Align::Center), |ui| {
        let name = format!("dataset:{}:remove", dataset.index);
        let remove = theme::button(ui, &name, "\u{d7}", true, "Closes this dataset; the others stay.");
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            ui.add(egui::Label::new(RichText::new(&dataset.name).color(theme::TEXT)).truncate());
        });
        remove
    });
    shown.response.on_hover_text(&dataset.details);
    shown.inner
}

/// The fields of a family, each with its distribution over the source's particles.
fn fields(ui: &mut Ui, name: &str, family: &FamilyMetadata) {
    let columns = || family.quantities.iter().chain(&family.attributes);
    let title = RichText::new(format!("{} fields", columns().count())).size(12.0).color(theme::LABEL);
    let header = egui::CollapsingHeader::new(title).id_salt(("fields", name)).show(ui, |ui| {
        for info in columns() {
            field(ui, info);
        }
    });
    theme::register(ui, &format!("fields:{name}"), header.header_response.rect);
}

fn field(ui: &mut Ui, info: &AttributeInfo) {
    let [min, max, mean] = [info.min, info.max, info.mean].map(number::quantity);
    let unit = if info.unit.is_unknown() { String::new() } else { format!("  {}", info.unit) };
    let response = ui
        .scope(|ui| {
            theme::fact(ui, &info.name.replace('-', " "), format!("{min} to {max}{unit}"));
            distribution(ui, &info.histogram);
        })
        .response;
    let missing = match info.missing {
        0 => String::new(),
        n => format!("\n{} values are missing", number::count(n)),
    };
    let axis = if info.histogram.logarithmic { "logarithmic" } else { "linear" };
    response
        .on_hover_text(format!("mean {mean}{unit}{missing}\nThe axis is {axis}, heights are logarithms of counts."));
}

/// A small histogram, counts on a logarithmic scale.
fn distribution(ui: &mut Ui, histogram: &Histogram) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 22.0), Sense::hover());
    let painter = ui.painter();
    painter.rect_filled(rect, 3.0, theme::WELL);
    let plot = rect.shrink2(vec2(3.0, 2.0));
    let heights: Vec<f32> = histogram.counts.iter().map(|&count| (count as f64).ln_1p() as f32).collect();
    let top = heights.iter().copied().fold(0.0, f32::max);
    if top <= 0.0 {
        return;
    }
    let width = plot.width() / heights.len() as f32;
    for (i, height) in heights.iter().enumerate().filter(|(_, height)| **height > 0.0) {
        let left = plot.left() + i as f32 * width;
        let bar = Rect::from_min_max(
            pos2(left, plot.bottom() - height / top * plot.height()),
            pos2(left + width, plot.bottom()),
        );
        painter.rect_filled(bar, 0.0, theme::ACCENT.gamma_multiply(0.65));
    }
    ui.add_space(2.0);
}
