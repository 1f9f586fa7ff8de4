//! The section of plots: which one and of whom, the chart, and what is brushed in it.

mod ends;
mod figure;
mod marks;

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::plot::settings::DENSITY;
use crate::explore::{PlotKind, PlotOf, PlotScale, PlotSettings, SelectionSet, Weight};
use crate::window::looking::plotting::{BRUSH, Found, Plotting, brush, brush_of, clear_brush, fields_of, is_meant};
use crate::window::state::answer::Answer;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{self, ComboBox, RichText, Ui};
use ends::Parts;
use figure::{Brushing, Shown};

/// The section.
pub static SECTION: Section = Section {
    name: "plots",
    title: "Plots",
    dock: Dock::Right,
    applies: |state| state.scene.as_ref().is_some_and(|scene| !scene.is_about_heights(state.settings.mode)),
    show,
};

/// Width of a box to choose from, and of one of two beside each other.
const WIDE: f32 = 132.0;
const NARROW: f32 = 62.0;
/// Height of the chart in the dock, logical pixels, and its size over the picture.
const HEIGHT: f32 = 190.0;
const LARGE: [f32; 2] = [560.0, 420.0];
/// Room that is left below a large chart.
const BELOW: f32 = 56.0;

const KINDS: [(PlotKind, &str, &str); 4] = [
    (PlotKind::Histogram, "Histogram", "The weight in each bin of a quantity"),
    (PlotKind::Phase, "Phase", "The weight in each cell of two quantities, as a colour"),
    (PlotKind::Scatter, "Scatter", "Points at the values of two quantities, of particles drawn at random"),
    (
        PlotKind::Radial,
        "Radial",
        "Means in shells: around the centre of the region's sphere, else around what is looked at",
    ),
];
const SCALES: [(PlotScale, &str); 3] =
    [(PlotScale::Auto, "auto"), (PlotScale::Linear, "linear"), (PlotScale::Log, "log")];

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let Some(scene) = &state.scene else { return };
    let fields = fields_of(scene);
    if fields.is_empty() {
        return;
    }
    let mut chosen = state.looking.plot.0.clone();
    chosen.fit(&fields);
    let before = chosen.clone();
    kinds(ui, &mut chosen.kind);
    quantities(ui, &mut chosen, &fields);
    whose(ui, &mut chosen.of, &state.settings.selections);
    if chosen != before {
        state.looking.plot.0 = chosen.clone();
    }

    let plotting = state.looking.plotting.bypass_change_detection();
    plotting.is_shown = true;
    ui.add_space(3.0);
    if !is_meant(&chosen.of, &state.looking.prober) && !plotting.is_wanted {
        plotting.is_wanted = theme::button(ui, "plots:draw", "Plot", true, "Read all particles and plot them");
        return;
    }
    if let Some(why) = &plotting.failed {
        ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
    }
    if let Answer::Coming(coming) = &plotting.coming {
        super::progress(ui, &coming.progress);
    }
    let Some(found) = plotting.found.clone() else { return };
    let set = brush_of(&state.settings.selections);
    let asked = chart(ui, plotting, &found, &chosen, set);
    for note in &found.notes {
        ui.add(egui::Label::new(RichText::new(note).size(theme::SMALL).color(theme::LABEL)).wrap());
    }
    let is_brushed = set.is_some();
    if is_brushed {
        brushed(ui, plotting, &found);
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        let idle = !matches!(plotting.writing, Answer::Coming(_));
        for (extension, title) in [("csv", "CSV"), ("png", "PNG"), ("svg", "SVG")] {
            let help = "Write the plot to a file beside the data";
            if theme::button(ui, &format!("plots:{extension}"), title, idle, help) {
                plotting.write(scene, extension, chosen.chart_scales());
            }
        }
        let (title, help) = match plotting.is_large {
            true => ("Smaller", "Show the plot in the panel"),
            false => ("Larger", "Show the plot over the picture"),
        };
        if theme::button(ui, "plots:size", title, true, help) {
            plotting.is_large = !plotting.is_large;
        }
    });
    match (asked, &found.region) {
        (Some(Brushing::To(part)), Some(region)) => {
            brush(&mut state.settings.selections, found.plot.brushed(region, &part));
        }
        (Some(Brushing::Clear), _) if is_brushed => clear_brush(&mut state.settings.selections),
        _ => {}
    }
}

/// Which plot.
fn kinds(ui: &mut Ui, chosen: &mut PlotKind) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 2.0;
        let widths = KINDS.map(|(_, title, _)| theme::text_size(ui.painter(), title, theme::SMALL).x);
        let gaps = 2.0 * (widths.len() - 1) as f32;
        let spare = (ui.available_width() - gaps - widths.iter().sum::<f32>()) / widths.len() as f32;
        for ((kind, title, help), width) in KINDS.into_iter().zip(widths) {
            let text = RichText::new(title).size(theme::SMALL);
            let button = egui::Button::selectable(*chosen == kind, text);
            let response = ui.add_sized([width + spare.max(4.0), 20.0], button);
            theme::register(ui, &format!("plots:kind:{}", title.to_lowercase()), response.rect);
            if response.on_hover_text(help).clicked() {
                *chosen = kind;
            }
        }
    });
    ui.add_space(3.0);
}

/// Of which quantities, what particles count for, and how axes count.
fn quantities(ui: &mut Ui, chosen: &mut PlotSettings, fields: &[String]) {
    let names: Vec<(String, &str)> = fields.iter().map(|field| (field.clone(), field.as_str())).collect();
    match chosen.kind {
        PlotKind::Histogram => {
            theme::row(ui, "Quantity", |ui| choose(ui, "plots:x", WIDE, &mut chosen.x, &names));
        }
        PlotKind::Phase | PlotKind::Scatter => {
            theme::row(ui, "Upwards", |ui| choose(ui, "plots:y", WIDE, &mut chosen.y, &names));
            theme::row(ui, "To the right", |ui| choose(ui, "plots:x", WIDE, &mut chosen.x, &names));
        }
        PlotKind::Radial => {
            let others = names.into_iter().filter(|(name, _)| name != DENSITY);
            let names: Vec<_> = std::iter::once((DENSITY.to_owned(), "density")).chain(others).collect();
            theme::row(ui, "Mean of", |ui| choose(ui, "plots:y", WIDE, &mut chosen.y, &names));
        }
    }
    let is_weighted = chosen.kind != PlotKind::Scatter;
    if is_weighted {
        let weights = [(Weight::Mass, "mass"), (Weight::Count, "count")];
        theme::row(ui, "Weighted by", |ui| choose(ui, "plots:weight", WIDE, &mut chosen.weight, &weights));
    }
    theme::row(ui, "Scales", |ui| {
        ui.spacing_mut().item_spacing.x = WIDE - 2.0 * NARROW;
        // Laid out from the right.
        if is_weighted {
            choose(ui, "plots:weight-scale", NARROW, &mut chosen.weight_scale, &SCALES);
        }
        choose(ui, "plots:scale", if is_weighted { NARROW } else { WIDE }, &mut chosen.scale, &SCALES);
    })
    .on_hover_text(
        "Of quantities and radii, and of weights, their colours or means. A logarithm leaves out what is not positive.",
    );
}

/// Whose values.
fn whose(ui: &mut Ui, of: &mut PlotOf, selections: &[SelectionSet]) {
    let mut all =
        vec![(PlotOf::Region, "region, or all"), (PlotOf::All, "all particles"), (PlotOf::View, "what is in view")];
    // What is brushed changes with the plot.
    let kept = selections.iter().filter(|set| set.name != BRUSH);
    all.extend(kept.map(|set| (PlotOf::Selection(set.name.clone()), set.name.as_str())));
    theme::row(ui, "Values of", |ui| choose(ui, "plots:of", WIDE, of, &all));
}

/// A box of values to choose from, with their titles.
fn choose<T: Clone + PartialEq>(ui: &mut Ui, name: &str, width: f32, chosen: &mut T, all: &[(T, &str)]) {
    let title = all.iter().find(|(value, _)| *value == *chosen).map_or("", |(_, title)| *title);
    let shown = ComboBox::from_id_salt(name).width(width).truncate().selected_text(title).show_ui(ui, |ui| {
        for (value, title) in all {
            let choice = ui.selectable_value(chosen, value.clone(), *title);
            theme::register(ui, &format!("{name}:{title}"), choice.rect);
        }
    });
    theme::call(&shown.response, name.trim_start_matches("plots:"));
    theme::register(ui, name, shown.response.rect);
}

/// The chart, in the dock or over the picture; what is brushed in it.
fn chart(
    ui: &mut Ui,
    plotting: &mut Plotting,
    found: &Found,
    chosen: &PlotSettings,
    set: Option<&SelectionSet>,
) -> Option<Brushing> {
    let brushed = set.and_then(|set| set.members.region());
    let mut shown = Shown {
        revision: plotting.revision,
        part: brushed.and_then(|region| found.plot.part_of(region)),
        parts: found.region.as_ref().map(|_| Parts::of(&found.plot)),
        height: HEIGHT,
    };
    found.plot.chart(&found.path, &found.notes, chosen.chart_scales(), |chart| {
        if !plotting.is_large {
            return figure::show(ui, chart, &shown);
        }
        let window = egui::Window::new(found.plot.title()).id(egui::Id::new("plot")).open(&mut plotting.is_large);
        let window = window.default_size(LARGE).collapsible(false).frame(theme::card_frame());
        let answer = window.show(ui.ctx(), |ui| {
            shown.height = (ui.available_height() - BELOW).max(HEIGHT);
            figure::show(ui, chart, &shown)
        });
        answer.and_then(|answer| answer.inner).flatten()
    })
}

/// How many particles are brushed.
fn brushed(ui: &mut Ui, plotting: &Plotting, found: &Found) {
    match &plotting.brushed {
        Answer::Nothing => {}
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Coming(coming) => {
            theme::fact(ui, "Brushed", "");
            super::progress(ui, &coming.progress);
        }
        Answer::Here(brushed) => {
            let uncertain = match brushed.uncertain {
                0 => String::new(),
                uncertain => format!(" ± {}", number::count(uncertain)),
            };
            theme::fact(ui, "Brushed", format!("{}{uncertain}", number::count(brushed.count))).on_hover_text(format!(
                "Particles of {} with such values: the selection {BRUSH}. Rename it to keep it.",
                number::count(found.plot.particles())
            ));
        }
    }
}
