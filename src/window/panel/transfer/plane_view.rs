//! Regions over the joint histogram of brightness (or density) and the attribute, edited with the pointer or with keys.

use super::plane_edit::{self, PlaneEdit, RADII, RegionPart};
use super::plot::{Gesture, Plot};
use crate::color::colormap::HexColor;
use crate::color::transfer::{MOST_FACTOR, Plane, Region};
use crate::window::exposure::Joint;
use crate::window::theme::{self, Asked, Handle, Ways};
use bevy_egui::egui::{self, Color32, DragValue, RichText, Stroke, Ui};

/// Height of the plot, logical pixels.
const HEIGHT_PX: f32 = 150.0;

/// Draws the plot and the chosen region's fields, and gives the plane where it was edited.
pub fn show(ui: &mut Ui, plane: &Plane, joint: Option<&Joint>, color: &dyn Fn(f32, f32) -> Color32) -> Option<Plane> {
    let plot = Plot::new(ui, "plane", "another region", HEIGHT_PX);
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
        Some(Gesture::Add) => {
            if let Some((next, index)) = plane_edit::add(plane, (0.5, 0.5)) {
                plot.give_keyboard(ui, (index, 0));
                (edited, chosen) = (Some(next), Some(index));
            }
        }
        None => {}
    }
    let (under_keys, next) = by_keys(ui, &plot, plane);
    (edited, chosen) = (next.or(edited), under_keys.or(chosen));
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

/// The region of which a part has the keyboard or is moved by a screen reader, and the plane where that was edited.
fn by_keys(ui: &Ui, plot: &Plot, plane: &Plane) -> (Option<usize>, Option<Plane>) {
    let (mut chosen, mut edited) = (None, None);
    for (index, region) in plane.regions.iter().enumerate() {
        for (which, (part, at)) in plane_edit::handles(region).into_iter().enumerate() {
            let (what, number, range, ways) = match part {
                RegionPart::Middle => ("middle", region.at.1, [0.0, 1.0], Ways::Both),
                RegionPart::Width => ("radius across", region.radius.0, RADII, Ways::Across),
                RegionPart::Height => ("radius upwards", region.radius.1, RADII, Ways::Upwards),
            };
            let name = format!("plane: {what} of region {} of {}", index + 1, plane.regions.len());
            let number = f64::from(number);
            let words = match part {
                RegionPart::Middle => format!("{} at {}", theme::brief(number), theme::brief(f64::from(region.at.0))),
                RegionPart::Width | RegionPart::Height => theme::brief(number),
            };
            let handle = Handle { name: &name, place: &words, number, range: range.map(f64::from), ways };
            let (has_keyboard, asked) = plot.reach_by_keys(ui, (index, which), at, &handle);
            let next = match asked {
                Some(Asked::Move(by)) => plane_edit::shift(plane, (index, part), by),
                Some(Asked::Number(asked)) => {
                    let by = (asked - number) as f32;
                    let by = if ways == Ways::Across { (by, 0.0) } else { (0.0, by) };
                    plane_edit::shift(plane, (index, part), by)
                }
                Some(Asked::Remove) => plane_edit::remove(plane, index),
                None => None,
            };
            if next.as_ref().is_some_and(|next| next.regions.len() < plane.regions.len()) {
                // The keyboard stays with the regions where one has gone, and with the plot where none is left.
                match plane.regions.len().checked_sub(2) {
                    Some(last) => plot.give_keyboard(ui, (index.min(last), 0)),
                    None => plot.response.request_focus(),
                }
            }
            if has_keyboard || next.is_some() {
                chosen = Some(index);
                edited = next.filter(|next| next != plane).or(edited);
            }
        }
    }
    (chosen, edited)
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
        plot.handle(at, if part == RegionPart::Middle { 4.5 } else { 3.0 }, chosen);
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
        let number = |ui: &mut Ui, name: &str, value: &mut f32, [least, most]: [f32; 2]| {
            let field = ui.add(DragValue::new(value).range(least..=most).speed(0.005).max_decimals(3));
            theme::call(&field, name);
        };
        number(ui, "Radius of the region upwards", &mut region.radius.1, RADII);
        number(ui, "Radius of the region across", &mut region.radius.0, RADII);
        ui.label(RichText::new("±").color(theme::LABEL));
        number(ui, "Middle of the region upwards", &mut region.at.1, [0.0, 1.0]);
        number(ui, "Middle of the region across", &mut region.at.0, [0.0, 1.0]);
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
