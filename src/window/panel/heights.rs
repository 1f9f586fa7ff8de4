//! What the section about tools shows where these are used on measured heights: the samples that were clicked, distances, a profile, and
//! the roughness of a region.

use super::{PanelState, theme};
use crate::annotate::number;
use crate::heights::measure::{FormKind, FormNumbers, Iso};
use crate::heights::model::{HeightGrid, Lengths, units};
use crate::picture::surface::FieldInScene;
use crate::window::looking::heights::{Apart, Found, Line, Numbers, OnHeights, world_unit};
use crate::window::state::answer::Answer;
use crate::window::state::tool::Tool;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{self, Align2, FontId, Rect, RichText, Sense, Stroke, Ui, pos2, vec2};

/// Forms that can be taken off, and what they are called.
const FORMS: [(&str, Option<FormKind>); 5] = [
    ("none", None),
    ("plane", Some(FormKind::Plane)),
    ("quadric", Some(FormKind::Quadric)),
    ("sphere", Some(FormKind::Sphere)),
    ("cylinder", Some(FormKind::Cylinder)),
];

/// What the tool in hand has found, or what it does.
pub(super) fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let Some(scene) = &state.scene else { return };
    let fields = scene.fields(&state.settings);
    let tool = *state.looking.tool;
    let heights = &*state.looking.heights;
    let is_known = match tool {
        Tool::Inspect => waited(ui, &heights.found, |ui, found| {
            on(ui, &fields, found.field, |ui, field| sample(ui, found, grid_of(field)));
        }),
        Tool::Measure => distance(ui, heights, &fields, &scene.length_unit),
        Tool::Profile => waited(ui, &heights.profile, |ui, line| {
            on(ui, &fields, line.field, |ui, field| profile(ui, line, grid_of(field)));
        }),
        Tool::Sphere | Tool::Cube => {
            let known = waited(ui, &heights.numbers, |ui, numbers| {
                on(ui, &fields, numbers.field, |ui, field| roughness(ui, numbers, grid_of(field)));
            });
            let heights = state.looking.heights.bypass_change_detection();
            if known
                && form(ui, heights)
                && let Some((index, area)) = heights.area
                && let Some(field) = fields.iter().find(|field| field.index == index)
            {
                heights.ask(field, &state.settings.look.settings, area);
            }
            known
        }
        Tool::Lasso => false,
    };
    if !is_known {
        ui.add(egui::Label::new(RichText::new(tool.help_on_heights()).size(12.0).color(theme::LABEL)).wrap());
    }
}

/// Shows what is known of a field, with its name where there are several.
fn on(ui: &mut Ui, fields: &[FieldInScene], index: usize, show: impl FnOnce(&mut Ui, &FieldInScene)) {
    let Some(field) = fields.iter().find(|field| field.index == index) else { return };
    if fields.len() > 1 {
        let name = field.opened.path().file_name().map(|name| name.to_string_lossy().into_owned());
        theme::fact(ui, "Field", name.unwrap_or_default());
    }
    show(ui, field);
}

fn grid_of(field: &FieldInScene) -> &HeightGrid {
    &field.opened.file().about().grid
}

/// Shows an answer, or how it stands with it; whether anything was asked.
fn waited<T: Send + 'static>(ui: &mut Ui, answer: &Answer<T>, show: impl FnOnce(&mut Ui, &T)) -> bool {
    match answer {
        Answer::Nothing => return false,
        Answer::Coming(_) => {
            theme::fact(ui, "Reading the samples", "");
            ui.ctx().request_repaint();
        }
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Here(found) => show(ui, found),
    }
    true
}

/// A sample with its unit, every digit of it.
fn exact(value: f64, unit: &str) -> String {
    format!("{value} {unit}").trim_end().to_owned()
}

/// A height between samples with its unit.
fn between(value: f64, unit: &str) -> String {
    // Three digits more than rounded numbers have.
    let digits = (6.0 - value.abs().max(1e-300).log10().floor()).clamp(0.0, 15.0) as usize;
    format!("{value:.digits$} {unit}").trim_end().to_owned()
}

/// A rounded number with its unit.
fn about(value: f64, unit: &str) -> String {
    format!("{} {unit}", number::quantity(value)).trim_end().to_owned()
}

fn sample(ui: &mut Ui, found: &Found, grid: &HeightGrid) {
    let (places, heights) = (grid.xy_unit.0.as_str(), grid.height_unit.0.as_str());
    let probe = &found.probe;
    match probe.height {
        Some(height) => theme::fact(ui, "Height", between(height, heights)),
        None => theme::fact_colored(ui, "Height", "not measured", theme::BAD),
    };
    theme::fact(ui, "Row", number::quantity(probe.row)).on_hover_text("Counted as in the file, from 0.");
    theme::fact(ui, "Column", number::quantity(probe.column));
    let [x, y] = if units::is_degrees(&grid.xy_unit) { ["Longitude", "Latitude"] } else { ["x", "y"] };
    theme::fact(ui, x, about(probe.x, places));
    theme::fact(ui, y, about(probe.y, places));
    if let Some(slope) = probe.slope {
        theme::fact(ui, "Slope", format!("{:.2} degrees", slope.atan().to_degrees()));
    }
    if let Some(aspect) = probe.aspect {
        theme::fact(ui, "Downhill", format!("{aspect:.1} degrees")).on_hover_text("Clockwise from y.");
    }
    if let Some(near) = &probe.nearest {
        theme::fact(ui, "Nearest sample", exact(near.height, heights));
        theme::fact(ui, "Away", about(near.distance, Lengths::unit(grid).0.as_str()));
    }
    for (row, column, height) in &found.samples {
        theme::fact(ui, &format!("Row {row}, column {column}"), exact(*height, heights));
    }
}

/// `scene`: the unit of lengths between two fields.
fn distance(ui: &mut Ui, heights: &OnHeights, fields: &[FieldInScene], scene: &str) -> bool {
    let Some(Apart { space, plan, rise, angle, field }) = heights.apart() else { return false };
    let field = field.and_then(|index| fields.iter().find(|field| field.index == index));
    let unit = field.map_or(scene, |field| world_unit(&field.placed, grid_of(field)));
    theme::fact(ui, "Distance", about(space, unit)).on_hover_text("In space, at true heights.");
    if let Some(plan) = plan {
        theme::fact(ui, if heights.is_on_globe() { "Great circle" } else { "In plan" }, about(plan, unit));
    }
    if let Some(rise) = rise {
        let unit = field.map_or(scene, |field| grid_of(field).height_unit.0.as_str());
        theme::fact(ui, "Height difference", about(rise, unit));
    }
    if let Some(angle) = angle {
        theme::fact(ui, "Angle", format!("{angle:.2} degrees"))
            .on_hover_text("Of the way from the first to the second place.");
    }
    true
}

/// The heights along a line; nothing where nothing was measured.
fn profile(ui: &mut Ui, line: &Line, grid: &HeightGrid) {
    let (along, unit) = (Lengths::unit(grid), grid.height_unit.0.as_str());
    let places = along.0.as_str();
    let [length, measured] = line.lengths;
    theme::fact(ui, "Length", about(length, places));
    if measured < length * (1.0 - 1e-9) {
        theme::fact(ui, "Measured", format!("{:.1} %", 100.0 * measured / length));
    }
    let known = line.points.iter().filter(|point| !point[1].is_nan());
    let ends =
        known.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], point| [low.min(point[1]), high.max(point[1])]);
    if ends[0] > ends[1] {
        return;
    }
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 110.0), Sense::hover());
    theme::register(ui, "heights:profile", rect);
    let painter = ui.painter();
    painter.rect_filled(rect, 3.0, theme::WELL);
    let inner: Rect = rect.shrink(6.0);
    let [bottom, top] = if ends[0] < ends[1] { ends } else { [ends[0] - 1.0, ends[1] + 1.0] };
    let at = |[along, height]: [f64; 2]| {
        let share = ((height - bottom) / (top - bottom)) as f32;
        pos2(inner.left() + (along / length) as f32 * inner.width(), inner.bottom() - share * inner.height())
    };
    for piece in line.points.split(|point| point[1].is_nan()).filter(|piece| piece.len() > 1) {
        let points = piece.iter().map(|point| at(*point)).collect();
        painter.add(egui::Shape::line(points, Stroke::new(1.5, theme::ACCENT)));
    }
    let font = FontId::proportional(theme::SMALL);
    painter.text(
        rect.right_top() + vec2(-5.0, 2.0),
        Align2::RIGHT_TOP,
        about(ends[1], unit),
        font.clone(),
        theme::LABEL,
    );
    painter.text(
        rect.right_bottom() + vec2(-5.0, -2.0),
        Align2::RIGHT_BOTTOM,
        about(ends[0], unit),
        font,
        theme::LABEL,
    );
    if let Some(pointer) = response.hover_pos() {
        let away = |point: &&[f64; 2]| (at(**point).x - pointer.x).abs();
        let nearest = line.points.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        if let Some([along, height]) = nearest {
            let height = if height.is_nan() { "not measured".to_owned() } else { about(*height, unit) };
            response.on_hover_text(format!("{height} at {}", about(*along, places)));
        }
    }
}

/// What is to be taken off; whether another form was chosen.
fn form(ui: &mut Ui, heights: &mut OnHeights) -> bool {
    let before = heights.form;
    let mut chosen = before;
    let name = FORMS.iter().find(|(_, kind)| *kind == before).map_or("none", |(name, _)| name);
    theme::combo(ui, "Form", name, |ui| {
        for (name, kind) in FORMS {
            let label = ui.selectable_value(&mut chosen, kind, name);
            theme::register(ui, &format!("form:{name}"), label.rect);
        }
    })
    .on_hover_text("What is fitted to the region and taken off before its numbers are found.");
    heights.form = chosen;
    chosen != before
}

fn roughness(ui: &mut Ui, numbers: &Numbers, grid: &HeightGrid) {
    let (places, heights) = (grid.xy_unit.0.as_str(), grid.height_unit.0.as_str());
    let found = &numbers.roughness;
    theme::fact(ui, "Samples", number::count(found.samples));
    theme::fact(ui, "Measured", format!("{:.2} %", 100.0 * found.valid_share));
    if let Some(FormNumbers { radius: Some(radius), .. }) = &numbers.form {
        theme::fact(ui, "Radius", about(*radius, places));
    }
    if let Some(mean) = found.mean {
        theme::fact(ui, "Mean height", about(mean, heights));
    }
    for (name, value, unit, help) in numbers_of(&found.iso, heights, &Lengths::unit(grid).0) {
        if let Some(value) = value {
            theme::fact(ui, name, about(value, unit)).on_hover_text(format!("{help} ISO 25178-2."));
        }
    }
}

/// Names, values, units and meanings of the numbers of a region whose heights and lengths have these units.
fn numbers_of<'a>(
    iso: &Iso,
    heights: &'a str,
    lengths: &'a str,
) -> [(&'static str, Option<f64>, &'a str, &'static str); 16] {
    let &Iso { sa, sq, ssk, sku, sp, sv, sz, sdq, sdr, sk, spk, svk, smr1, smr2, sal, str } = iso;
    [
        ("Sa", sa, heights, "Mean distance from the mean height."),
        ("Sq", sq, heights, "Root of the mean square distance from it."),
        ("Sz", sz, heights, "Highest peak and deepest pit together."),
        ("Sp", sp, heights, "Highest peak above the mean height."),
        ("Sv", sv, heights, "Deepest pit below it."),
        ("Ssk", ssk, "", "Skewness."),
        ("Sku", sku, "", "Kurtosis; 3 of a normal distribution."),
        ("Sdq", sdq, "", "Root of the mean square slope."),
        ("Sdr", sdr, "%", "What the surface has more than its plan."),
        ("Sk", sk, heights, "Height of the core of the material ratio curve."),
        ("Spk", spk, heights, "Peaks above the core."),
        ("Svk", svk, heights, "Valleys below it."),
        ("Smr1", smr1, "%", "Share of the samples above the core."),
        ("Smr2", smr2, "%", "Share of the samples above the valleys."),
        ("Sal", sal, lengths, "Shortest length at which the autocorrelation falls to 0.2."),
        ("Str", str, "", "That length over the longest one."),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_number_of_a_region_is_shown() {
        let serde_json::Value::Object(known) = serde_json::to_value(Iso::default()).unwrap() else { panic!("numbers") };
        let iso = Iso { sal: Some(3.0), ..Iso::default() };
        let shown = numbers_of(&iso, "um", "mm");
        let names: BTreeSet<&str> = shown.iter().map(|(name, ..)| *name).collect();
        let expected: BTreeSet<&str> = known.keys().map(String::as_str).collect();
        assert_eq!(names, expected);
        assert!(shown.iter().any(|(name, value, unit, _)| (*name, *value, *unit) == ("Sal", Some(3.0), "mm")));
    }
}
