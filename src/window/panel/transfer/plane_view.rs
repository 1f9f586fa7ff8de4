//! Regions over the joint histogram of brightness (or density) and the attribute.

use super::plane_edit::{self, PlaneEdit};
use super::plot::{Gesture, Plot};
use crate::color::colormap::HexColor;
use crate::color::transfer::{MOST_FACTOR, Plane, Region};
use crate::window::exposure::Joint;
use crate::window::theme;
use bevy_egui::egui::{self, Color32, DragValue, RichText, Stroke, Ui};

/// Height of the plot, logical pixels.
const HEIGHT_PX: f32 = 150.0;

/// Draws the plot and the chosen region's fields, and gives the plane where it was edited.
pub fn show(ui: &mut Ui, plane: &Plane, joint: Option<&Joint>, color: &dyn Fn(f32, f32) -> Color32) -> Option<Plane> {
    let plot = Plot::new(ui, "plane", HEIGHT_PX);
    let memory = plot.response.id;
    let (mut edit, mut chosen) = ui.data(|data| {
        (data.get_temp::<PlaneEdit>(memory).unwrap_or_default(), data.get_temp::<Option<usize>>(memory).flatten())
    });
    let mut edited = None;
    match plot.gesture(ui) {
        Some(Gesture::Press(at)) => {
            let under = plane_edit::nearest(plane, at, plot.reach());
            chosen = under.map(|(index, _)| index);
            if let Some(part) = under.filter(|_| plot.response.dragged()) {
                edit.grab(plane, part);
            }
        }
        Some(Gesture::Drag(at)) => edited = edit.drag(at),
        Some(Gesture::Release) => edit.release(),
        Some(Gesture::Double(at)) => {
            if let Some((next, index)) = plane_edit::add(plane, at) {
                (edited, chosen) = (Some(next), Some(index));
            }
        }
        Some(Gesture::Secondary(at)) => {
            let under = plane_edit::nearest(plane, at, plot.reach());
            edited = under.and_then(|(index, _)| plane_edit::remove(plane, index));
            chosen = None;
        }
        None => {}
    }
    let mut shown = edited.clone().unwrap_or_else(|| plane.clone());
    chosen = chosen.filter(|index| *index < shown.regions.len());
    if let Some(joint) = joint {
        draw_joint(&plot, joint, color);
    }
    plot.grid();
    for (index, region) in shown.regions.iter().enumerate() {
        draw_region(&plot, region, chosen == Some(index));
    }
    Plot::hint(ui, "attribute over brightness; double click: another region");
    let before = shown.clone();
    if !shown.regions.is_empty() {
        factors(ui, "Elsewhere", &mut shown.brightness, &mut shown.opacity);
    }
    if let Some(index) = chosen
        && fields(ui, &mut shown.regions[index])
    {
        shown.regions.remove(index);
        chosen = None;
    }
    // Without regions there is nothing that is elsewhere.
    if shown.regions.is_empty() && !before.regions.is_empty() {
        shown = Plane::default();
    }
    ui.data_mut(|data| {
        data.insert_temp(memory, edit);
        data.insert_temp(memory, chosen);
    });
    (shown != *plane).then_some(shown)
}

/// How often pairs of places occur, in the colours that they have; rare ones darker.
fn draw_joint(plot: &Plot, joint: &Joint, color: &dyn Fn(f32, f32) -> Color32) {
    let most = joint.counts.iter().copied().fold(0.0, f32::max).ln_1p().max(1e-9);
    let cell = |index: usize| {
        let (column, row) = (index % joint.columns, index / joint.columns);
        (column as f32 / joint.columns as f32, row as f32 / joint.rows() as f32)
    };
    let size = (1.0 / joint.columns as f32, 1.0 / joint.rows() as f32);
    for (index, count) in joint.counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        let (left, low) = cell(index);
        let lift = |channel: u8| channel.max(40);
        let tone = color(left + 0.5 * size.0, low + 0.5 * size.1);
        let share = 0.25 + 0.75 * count.ln_1p() / most;
        let fill = Color32::from_rgb(lift(tone.r()), lift(tone.g()), lift(tone.b())).gamma_multiply(share);
        let rect = egui::Rect::from_two_pos(plot.point((left, low)), plot.point((left + size.0, low + size.1)));
        plot.painter.rect_filled(rect, 0.0, fill);
    }
}

fn draw_region(plot: &Plot, region: &Region, chosen: bool) {
    let own = region.color.map(|HexColor([r, g, b])| Color32::from_rgb(r, g, b));
    let line = own.unwrap_or(theme::TEXT);
    let width = if chosen { 2.0 } else { 1.2 };
    let inner = 1.0 - region.soft;
    let (wide, high) = region.radius;
    plot.ellipse(region.at, region.radius, Stroke::new(width, line), line.gamma_multiply(0.06));
    plot.ellipse(
        region.at,
        (wide * inner, high * inner),
        Stroke::new(1.0, line.gamma_multiply(0.5)),
        Color32::TRANSPARENT,
    );
    for (part, at) in plane_edit::handles(region) {
        plot.handle(at, if part == plane_edit::RegionPart::Middle { 4.5 } else { 3.0 }, chosen);
    }
}

/// Factors on brightness and opacity.
fn factors(ui: &mut Ui, label: &str, brightness: &mut f32, opacity: &mut f32) {
    theme::row(ui, label, |ui| {
        let factor = |ui: &mut Ui, value: &mut f32, name: &str| {
            let field = ui.add(DragValue::new(value).range(0.0..=MOST_FACTOR).speed(0.01).max_decimals(3));
            theme::call(&field, &format!("{label}: {name}"));
            ui.label(RichText::new(name).color(theme::LABEL));
        };
        factor(ui, opacity, "opacity ×");
        factor(ui, brightness, "light ×");
    });
}

/// The chosen region's numbers; says whether it is to go.
fn fields(ui: &mut Ui, region: &mut Region) -> bool {
    let mut gone = false;
    factors(ui, "Region", &mut region.brightness, &mut region.opacity);
    theme::row(ui, "At", |ui| {
        let number = |ui: &mut Ui, name: &str, value: &mut f32, most: f32, least: f32| {
            let field = ui.add(DragValue::new(value).range(least..=most).speed(0.005).max_decimals(3));
            theme::call(&field, name);
        };
        number(ui, "Radius of the region upwards", &mut region.radius.1, 4.0, 0.001);
        number(ui, "Radius of the region across", &mut region.radius.0, 4.0, 0.001);
        ui.label(RichText::new("±").color(theme::LABEL));
        number(ui, "Middle of the region upwards", &mut region.at.1, 1.0, 0.0);
        number(ui, "Middle of the region across", &mut region.at.0, 1.0, 0.0);
    });
    theme::row(ui, "Rim, hue", |ui| {
        gone = ui.small_button("remove").clicked();
        let mut own = region.color.is_some();
        if let Some(HexColor(color)) = &mut region.color {
            theme::call(&ui.color_edit_button_srgb(color), "Hue of the region");
        }
        if ui.checkbox(&mut own, "own hue").changed() {
            region.color = own.then_some(HexColor([255, 150, 40]));
        }
        let rim = ui.add(DragValue::new(&mut region.soft).range(0.0..=1.0).speed(0.005).max_decimals(3));
        theme::call(&rim.on_hover_text("the share of the radius over which it fades"), "Rim of the region");
    });
    gone
}
