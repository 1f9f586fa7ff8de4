//! The section about the region that is looked at: its sums over the whole data, its profile, and what can be done with it.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::probe::{FieldStatistics, Profile};
use crate::explore::{Members, Probe, Region, SelectionSet, Shape};
use crate::window::state::answer::Answer;
use bevy::math::DVec3;
use bevy_egui::egui::{self, Align2, DragValue, FontId, Rect, RichText, Sense, Stroke, Ui, pos2, vec2};

/// The section.
pub static SECTION: Section = Section {
    name: "probe",
    title: "Probe",
    dock: Dock::Right,
    applies: |state| state.scene.is_some() && state.looking.prober.members.is_some(),
    show,
};

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let (Some(scene), Some(members)) = (&state.scene, state.looking.prober.members.clone()) else { return };
    let (unit, source) = (scene.length_unit.clone(), scene.source());
    // In a run, particles are kept that are there now.
    let now = scene.following.as_ref().and_then(|_| scene.when());
    let mut edited = members.clone();
    if let Members::Region(region) = &mut edited {
        shape(ui, region, &unit);
    }
    if edited != members && matches!(&edited, Members::Region(region) if region.check().is_ok()) {
        state.looking.prober.start(scene, edited, false);
    }
    let exact = match &state.looking.prober.sums {
        Answer::Nothing => false,
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
            false
        }
        Answer::Coming(coming) => {
            let (_, share) = coming.progress.state();
            theme::fact(ui, "Summing up", share.map_or_else(String::new, |share| format!("{:.0} %", 100.0 * share)));
            super::progress(ui, &coming.progress);
            false
        }
        Answer::Here(probe) => {
            sums(ui, probe, &unit);
            probe.exact
        }
    };
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        let keep = match (&members, now) {
            (Members::Region(region), Some(at)) => {
                let help = "Keep the particles that are in it now as a selection, wherever they go";
                let tracked = Members::Tracked { at, region: region.clone() };
                let particles = theme::button(ui, "keep-particles", "Keep particles", true, help).then_some(tracked);
                let help = "Keep the region as a selection: who is in it at any time";
                particles.or_else(|| theme::button(ui, "keep", "Keep", true, help).then(|| members.clone()))
            }
            _ => theme::button(ui, "keep", "Keep", true, "Keep it as a selection").then(|| members.clone()),
        };
        if let Some(members) = keep {
            let number = state.settings.selections.len();
            let new = SelectionSet::new(format!("Selection {}", number + 1), Region::whole(), number);
            state.settings.selections.push(SelectionSet { members, ..new });
        }
        let help = "Ask the source: exact values, velocities too; takes a pass over the whole file";
        if theme::button(ui, "exact", "Exact", source.is_some() && !exact, help) {
            state.looking.prober.start(scene, members.clone(), true);
        }
        if theme::button(ui, "clear-probe", "Clear", true, "Forget the region") {
            *state.looking.prober = crate::window::looking::prober::Prober::default();
        }
    });
}

/// Numbers of the first shape, to be typed.
fn shape(ui: &mut Ui, region: &mut Region, unit: &str) {
    let row = |ui: &mut Ui, label: &str, values: &mut [f64]| {
        theme::row(ui, label, |ui| {
            ui.spacing_mut().item_spacing.x = 3.0;
            // Laid out from the right.
            let several = values.len() > 1;
            for (value, axis) in values.iter_mut().zip(["x", "y", "z"]).rev() {
                let speed = 0.002 * value.abs().max(1e-9);
                let field = ui.add(DragValue::new(value).speed(speed).max_decimals(6).min_decimals(0));
                theme::call(&field, &if several { format!("{label}, {axis}") } else { label.to_owned() });
            }
        });
    };
    match region.shapes.first_mut() {
        Some(Shape::Sphere { center, radius }) => {
            let mut at = center.to_array();
            row(ui, "At", &mut at);
            *center = DVec3::from(at);
            let mut wide = [*radius];
            row(ui, &format!("Radius  {unit}"), &mut wide);
            *radius = wide[0];
        }
        Some(Shape::Box { min, max }) => {
            let (mut low, mut high) = (min.to_array(), max.to_array());
            row(ui, "From", &mut low);
            row(ui, "To", &mut high);
            (*min, *max) = (DVec3::from(low), DVec3::from(high));
        }
        Some(Shape::Lasso(lasso)) => {
            theme::fact(ui, "Lasso", format!("{} corners", lasso.polygon.len()));
        }
        None => {}
    }
}

/// What is in the region.
fn sums(ui: &mut Ui, probe: &Probe, unit: &str) {
    theme::fact(ui, "Particles", number::count(probe.count));
    theme::fact(ui, "Mass", format!("{} {}", number::quantity(probe.mass), probe.mass_unit.0));
    let uncertain: u64 = probe.families.iter().filter_map(|family| Some(family.uncertain?.count)).sum();
    let precision = match (probe.exact, uncertain) {
        (true, _) => "exact, from the source".to_owned(),
        (false, 0) => "all certain".to_owned(),
        (false, count) => format!("± {}", number::count(count)),
    };
    theme::fact(ui, "Precision", precision)
        .on_hover_text("Particles so near to the region's surface that the page file's rounding decides about them.");
    for family in &probe.families {
        if probe.families.len() > 1 {
            theme::fact(ui, family.name.as_str(), number::count(family.count));
        }
        if let Some(velocity) = &family.velocity {
            let mean = DVec3::from(velocity.mean).length();
            theme::fact(ui, "Bulk velocity", number::quantity(mean));
            theme::fact(ui, "Velocity dispersion", number::quantity(velocity.dispersion_1d))
                .on_hover_text("Along a line of sight, weighted with mass, the mean over all directions.");
        }
        family.fields.iter().for_each(|field| statistics(ui, field));
    }
    if let Some(profile) = &probe.profile {
        plot(ui, profile, unit);
    }
}

fn statistics(ui: &mut Ui, field: &FieldStatistics) {
    let (Some(mean), Some(dispersion)) = (field.mean, field.dispersion) else { return };
    let text = format!("{}  ±  {}  {}", number::quantity(mean), number::quantity(dispersion), field.unit.0);
    let end = |value: Option<f64>| value.map_or_else(String::new, number::quantity);
    let weighted = field.mass_weighted_mean.map_or_else(String::new, number::quantity);
    theme::fact(ui, &field.name.replace('-', " "), text.trim()).on_hover_text(format!(
        "Mean and dispersion of {} values, from {} to {}; weighted with mass the mean is {weighted}.",
        number::count(field.count),
        end(field.min),
        end(field.max),
    ));
}

/// Density over radius, both logarithmic.
fn plot(ui: &mut Ui, profile: &Profile, unit: &str) {
    let points: Vec<[f64; 2]> = profile
        .shells
        .iter()
        .filter(|shell| shell.density > 0.0 && shell.to > 0.0)
        .map(|shell| [(shell.from.max(0.5 * shell.to) * shell.to).sqrt().log10(), shell.density.log10()])
        .collect();
    if points.len() < 2 {
        return;
    }
    let ends = |axis: usize| {
        let values = points.iter().map(|point| point[axis]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        (low, high.max(low + 1e-6))
    };
    let [(left, right), (bottom, top)] = [ends(0), ends(1)];
    ui.add_space(3.0);
    theme::fact(ui, "Density profile", "");
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 84.0), Sense::hover());
    let well = Rect::from_min_max(rect.min, pos2(rect.right(), rect.bottom() - 14.0));
    let painter = ui.painter();
    painter.rect_filled(well, 3.0, theme::WELL);
    let at = |[x, y]: [f64; 2]| {
        pos2(
            egui::remap(x as f32, left as f32..=right as f32, well.left() + 6.0..=well.right() - 6.0),
            egui::remap(y as f32, bottom as f32..=top as f32, well.bottom() - 6.0..=well.top() + 6.0),
        )
    };
    painter.add(egui::Shape::line(points.iter().map(|point| at(*point)).collect(), Stroke::new(1.5, theme::ACCENT)));
    let font = FontId::proportional(theme::SMALL);
    let label = |value: f64| format!("{} {unit}", number::quantity(10f64.powf(value)));
    painter.text(rect.left_bottom(), Align2::LEFT_BOTTOM, label(left), font.clone(), theme::LABEL);
    painter.text(rect.right_bottom(), Align2::RIGHT_BOTTOM, label(right), font.clone(), theme::LABEL);
    let high = number::quantity(10f64.powf(top));
    painter.text(well.right_top() + vec2(-5.0, 3.0), Align2::RIGHT_TOP, high, font.clone(), theme::LABEL);
    let low = number::quantity(10f64.powf(bottom));
    painter.text(well.left_bottom() + vec2(5.0, -3.0), Align2::LEFT_BOTTOM, low, font, theme::LABEL);
    response.on_hover_text("Mass over volume of shells, against their radius; both axes are logarithmic.");
}
