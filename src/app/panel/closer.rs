//! The section about tools and the particle that was clicked.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::app::looking::answer::Answer;
use crate::app::looking::tool::Tool;
use crate::explore::particle::ParticleReport;
use bevy::prelude::*;
use bevy_egui::egui::{self, RichText, Ui};

/// The section.
pub static SECTION: Section =
    Section { name: "closer", title: "Look closer", dock: Dock::Right, applies: |state| state.scene.is_some(), show };

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 2.0;
        let width = (ui.available_width() - 2.0 * (Tool::ALL.len() - 1) as f32) / Tool::ALL.len() as f32;
        for tool in Tool::ALL {
            let chosen = *state.looking.tool == tool;
            let text = RichText::new(tool.title()).size(theme::SMALL);
            let response = ui.add_sized([width, 20.0], egui::Button::selectable(chosen, text));
            theme::register(ui, &format!("tool:{}", tool.title()), response.rect);
            if response.on_hover_text(tool.help()).clicked() {
                state.looking.tool.set_if_neq(tool);
            }
        }
    });
    ui.add_space(3.0);
    let unit = state.scene.as_ref().map_or_else(String::new, |scene| scene.length_unit.clone());
    match *state.looking.tool {
        Tool::Inspect => particle(ui, &state.looking.inspector.0, &unit),
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
fn particle(ui: &mut Ui, answer: &Answer<ParticleReport>, unit: &str) {
    let report = match answer {
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

/// A coordinate with as many digits as it is known to.
fn exact(value: f64, rounding: f64) -> String {
    let digits = if rounding > 0.0 { (1.0 - rounding.log10().floor()).clamp(0.0, 15.0) as usize } else { 9 };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::exact;

    #[test]
    fn coordinates_have_the_digits_that_are_known() {
        assert_eq!(exact(12.345678, 0.01), "12.346");
        assert_eq!(exact(12.345678, 3.0), "12.3");
        assert_eq!(exact(0.5, 1e-300).len(), 17);
        assert_eq!(exact(0.5, 0.0), "0.500000000");
    }
}
