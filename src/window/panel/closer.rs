//! The section about tools and the particle that was clicked.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::Identified;
use crate::window::looking::Inspector;
use crate::window::state::answer::Answer;
use crate::window::state::tool::Tool;
use bevy::prelude::*;
use bevy_egui::egui::{self, RichText, Ui};

/// The section.
pub static SECTION: Section =
    Section { name: "closer", title: "Look closer", dock: Dock::Right, applies: |state| state.scene.is_some(), show };

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let on_heights = state.scene.as_ref().is_some_and(|scene| scene.is_about_heights(state.settings.mode));
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 2.0;
        let (tools, title, help): (_, fn(Tool) -> &'static str, fn(Tool) -> &'static str) = match on_heights {
            true => (Tool::OF_HEIGHTS, Tool::title_on_heights, Tool::help_on_heights),
            false => (Tool::OF_PARTICLES, Tool::title, Tool::help),
        };
        let widths = tools.map(|tool| theme::text_size(ui.painter(), title(tool), theme::SMALL).x);
        let gaps = 2.0 * (widths.len() - 1) as f32;
        let spare = (ui.available_width() - gaps - widths.iter().sum::<f32>()) / widths.len() as f32;
        for (tool, width) in tools.into_iter().zip(widths) {
            let chosen = *state.looking.tool == tool;
            let text = RichText::new(title(tool)).size(theme::SMALL);
            let response = ui.add_sized([width + spare.max(4.0), 20.0], egui::Button::selectable(chosen, text));
            theme::register(ui, &format!("tool:{}", tool.title()), response.rect);
            if response.on_hover_text(help(tool)).clicked() {
                state.looking.tool.set_if_neq(tool);
            }
        }
    });
    ui.add_space(3.0);
    if state.looking.heights.is_shown(*state.looking.tool, on_heights) {
        super::heights::show(ui, state);
        return;
    }
    let unit = state.scene.as_ref().map_or_else(String::new, |scene| scene.length_unit.clone());
    match *state.looking.tool {
        Tool::Inspect => {
            particle(ui, &state.looking.inspector, &unit);
            let ask = row_of_source(ui, &state.looking.inspector, &unit);
            if let Some(scene) = state.scene.as_ref().filter(|_| ask) {
                state.looking.inspector.ask_source(scene);
            }
        }
        Tool::Measure => match state.looking.measure.0[..] {
            [from, to] => {
                theme::fact(ui, "Distance", format!("{} {unit}", number::quantity(from.distance(to))));
                let apart = to - from;
                let text = [apart.x, apart.y, apart.z].map(number::quantity).join(",  ");
                theme::fact(ui, "Apart", format!("{text} {unit}"));
            }
            _ => hint(ui, *state.looking.tool),
        },
        tool => hint(ui, tool),
    }
}

fn hint(ui: &mut Ui, tool: Tool) {
    ui.add(egui::Label::new(RichText::new(tool.help()).size(12.0).color(theme::LABEL)).wrap());
}

/// The values of a particle, each with what its precision is.
fn particle(ui: &mut Ui, inspector: &Inspector, unit: &str) {
    let report = match &inspector.report {
        Answer::Nothing => return hint(ui, Tool::Inspect),
        Answer::Coming(_) => return drop(theme::fact(ui, "Reading its page", "")),
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
            return;
        }
        Answer::Here(report) => report,
    };
    theme::fact(ui, "Particle of", report.family.as_str());
    if let Some(merged) = &report.merged {
        let text = format!("{} for {}", number::count(merged.particles), number::count(merged.source_particles));
        theme::fact(ui, "Merged", text).on_hover_text(
            "At this distance particles are merged: this one is among so many that stand for so many of the source. Zoom in to see \
             those.",
        );
    }
    for (axis, value) in ["x", "y", "z"].into_iter().zip(report.position.to_array()) {
        theme::fact(ui, axis, format!("{} {unit}", exact(value, report.rounding)));
    }
    theme::fact(ui, "Known to", format!("{} {unit}", number::quantity(report.rounding)))
        .on_hover_text("No coordinate of the source is farther from these than that.");
    for value in &report.values {
        let text = format!("{} {}", number::quantity(value.value), value.unit.0);
        let (low, high) = value.between;
        theme::fact(ui, &value.name.replace('-', " "), text.trim()).on_hover_text(format!(
            "{} as the page file has it; the source's value is between {} and {}.",
            value.value,
            number::quantity(low),
            number::quantity(high)
        ));
    }
}

/// What the source says of the particle, or a button to ask it; whether that was clicked.
fn row_of_source(ui: &mut Ui, inspector: &Inspector, unit: &str) -> bool {
    let Some(report) = inspector.report.here() else { return false };
    if report.merged.is_some() {
        let text =
            "Merged particles have no row in the source. Zoom in until those of the source are drawn, and click again.";
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)).wrap());
        return false;
    }
    match &inspector.row {
        Answer::Coming(coming) => {
            let (_, share) = coming.progress.state();
            theme::fact(
                ui,
                "Asking the source",
                share.map_or_else(String::new, |share| format!("{:.0} %", 100.0 * share)),
            );
            super::progress(ui, &coming.progress);
            return false;
        }
        Answer::Here(Some(row)) => {
            source_values(ui, row, unit);
            return false;
        }
        Answer::Here(None) => {
            let text = "No row of the source is within the rounding of this place: it is not the source that the page file was built from.";
            ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Nothing => {}
    }
    ui.add_space(3.0);
    theme::button(ui, "ask-source", "Ask the source", true, "Look for its row in the source: id and exact values")
}

/// A row of the source, every number exact.
fn source_values(ui: &mut Ui, row: &Identified, unit: &str) {
    theme::section(ui, "In the source");
    theme::fact(ui, "Id", row.id.map_or_else(|| "none in this source".to_owned(), |id| id.to_string()));
    theme::fact(ui, "Row", row.row.to_string()).on_hover_text("Its number in the family, from 0, all files together.");
    if row.candidates > 1 {
        let text = format!("{} rows", number::count(row.candidates));
        theme::fact_colored(ui, "Within reach", text, theme::BAD).on_hover_text(
            "So many particles of the source are as near to the place in the page file as its rounding is wide; this is the nearest.",
        );
    }
    for (axis, value) in ["x", "y", "z"].into_iter().zip(row.position) {
        theme::fact(ui, axis, format!("{} {unit}", digits(value)).trim_end().to_owned());
    }
    for field in row.fields.iter().filter(|field| field.name != "position") {
        let name = field.name.replace('-', " ");
        let components: &[&str] = match field.values.len() {
            1 => &[""],
            3 => &[" x", " y", " z"],
            _ => &[],
        };
        for (at, value) in field.values.iter().enumerate() {
            let label = components.get(at).map_or_else(|| format!("{name} {at}"), |axis| format!("{name}{axis}"));
            let text = format!("{} {}", digits(*value), field.unit.0);
            theme::fact(ui, &label, text.trim_end()).on_hover_text(format!("{} in the source", field.stored_as));
        }
    }
}

/// A number with as many digits as it takes to read the same one back, in single precision where it is one.
fn digits(value: f64) -> String {
    let single = value as f32;
    let large = value != 0.0 && !(1e-4..1e7).contains(&value.abs());
    match (f64::from(single) == value, large) {
        (true, true) => format!("{single:e}"),
        (true, false) => format!("{single}"),
        (false, true) => format!("{value:e}"),
        (false, false) => format!("{value}"),
    }
}

/// A coordinate with as many digits as it is known to.
fn exact(value: f64, rounding: f64) -> String {
    let digits = if rounding > 0.0 { (1.0 - rounding.log10().floor()).clamp(0.0, 15.0) as usize } else { 9 };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::{digits, exact};

    #[test]
    fn coordinates_have_the_digits_that_are_known() {
        assert_eq!(exact(12.345678, 0.01), "12.346");
        assert_eq!(exact(12.345678, 3.0), "12.3");
        assert_eq!(exact(0.5, 1e-300).len(), 17);
        assert_eq!(exact(0.5, 0.0), "0.500000000");
    }

    #[test]
    fn values_of_the_source_come_back_from_what_is_shown() {
        for value in [0.0, -0.1, f64::from(0.1f32), 1.0 / 3.0, 1e300, f64::from(f32::MAX), 5e-324, 12_345_678.0, 1e-5] {
            let text = digits(value);
            let same = text.parse::<f64>().unwrap() == value || f64::from(text.parse::<f32>().unwrap()) == value;
            assert!(same && text.len() < 26, "{value:e} is shown as {text}");
        }
        assert_eq!(digits(f64::from(0.1f32)), "0.1");
        assert_eq!(digits(1e7), "1e7");
    }
}
