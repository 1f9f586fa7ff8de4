//! The section about the view: projection, field of view, and what is left out of the data or fades.

use super::{Dock, PanelState, Section, projection, theme};
use crate::model::Bounds;
use crate::view::Periodic;
use crate::view::cut::{Axis, ClipBox, Fade, Slab};
use crate::window::scene::Settings;
use bevy::prelude::DetectChangesMut;
use bevy_egui::egui::{DragValue, Ui};

/// The section.
pub static SECTION: Section = Section {
    name: "view",
    title: "View",
    dock: Dock::Left,
    applies: |state| state.scene.is_some(),
    show: |ui, state| {
        let mut edited = state.settings.clone();
        show(ui, state, &mut edited);
        state.settings.set_if_neq(edited);
    },
};

fn show(ui: &mut Ui, state: &PanelState<'_, '_>, settings: &mut Settings) {
    let Some(scene) = &state.scene else { return };
    let bounds = scene.bounds;
    let distance = state.camera.iter().next().map_or(bounds.size().length(), |viewpoint| viewpoint.distance());
    projection::show(ui, distance, settings);
    let field = theme::NumberRow {
        label: "Field of view",
        unit: "°",
        range: 1.0..=150.0,
        log: false,
        default: Some(state.preset.camera.field_of_view_deg),
    };
    if settings.surround.is_flat() {
        field.show(ui, &mut settings.lens.fov_deg).on_hover_text(
            "Vertical angle of view in degrees. An orthographic picture is as high as that is at the target.",
        );
    }
    if scene.periodic.is_some() {
        periodic(ui, settings);
    }
    clip(ui, bounds, settings);
    slab(ui, bounds, settings);
    fade(ui, distance, settings);
}

/// Switches something on with a usual value, or off.
fn optional<T>(ui: &mut Ui, label: &str, help: &str, value: &mut Option<T>, usual: impl FnOnce() -> T) {
    let mut on = value.is_some();
    theme::switch(ui, label, &mut on).on_hover_text(help);
    match (on, value.is_some()) {
        (true, false) => *value = Some(usual()),
        (false, true) => *value = None,
        _ => {}
    }
}

/// How a periodic box is drawn.
fn periodic(ui: &mut Ui, settings: &mut Settings) {
    let choices = [
        ("once", Periodic::Once),
        ("wrapped", Periodic::Wrapped),
        ("2 x 2 x 2", Periodic::Tiled([2; 3])),
        ("3 x 3 x 3", Periodic::Tiled([3; 3])),
    ];
    let chosen = settings.cut.periodic;
    let named = choices.iter().find(|(_, choice)| *choice == chosen).map(|(name, _)| (*name).to_owned());
    let selected = named.unwrap_or_else(|| match chosen {
        Periodic::Tiled([x, y, z]) => format!("{x} x {y} x {z}"),
        Periodic::Once | Periodic::Wrapped => String::new(),
    });
    theme::combo(ui, "Periodic box", &selected, |ui| {
        for (name, choice) in choices {
            let label = ui.selectable_value(&mut settings.cut.periodic, choice, name);
            theme::register(ui, &format!("periodic:{name}"), label.rect);
        }
    })
    .on_hover_text(
        "Wrapped: every particle at its image nearest to the point looked at. Or the box several times side by side.",
    );
}

fn clip(ui: &mut Ui, bounds: Bounds, settings: &mut Settings) {
    let help = "Particles whose centres lie outside the box are not drawn, and finer levels beyond it are not read.";
    let half = || ClipBox { min: bounds.min, max: bounds.max };
    optional(ui, "Clip box", help, &mut settings.cut.clip, half);
    let Some(clip) = &mut settings.cut.clip else { return };
    for axis in Axis::ALL {
        let i = axis.index();
        let (least, most) = (bounds.min[i], bounds.max[i]);
        let speed = 0.002 * (most - least).max(1e-12);
        let (mut min, mut max) = (clip.min[i], clip.max[i]);
        theme::row(ui, &format!("   {}", axis.as_str()), |ui| {
            ui.add_space(theme::MARK_ROOM);
            ui.spacing_mut().item_spacing.x = 6.0;
            let width = 0.5 * (theme::VALUE - 6.0);
            for (name, value) in [("max", &mut max), ("min", &mut min)] {
                let field = DragValue::new(value)
                    .speed(speed)
                    .custom_formatter(|value, _| theme::brief(value))
                    .update_while_editing(false);
                let response = ui.add_sized([width, theme::ROW], field);
                theme::call(&response, &format!("{name} of {}", axis.as_str()));
                theme::register(ui, &format!("clip-{}-{name}", axis.as_str()), response.rect);
            }
        });
        if min.is_finite() && min != clip.min[i] {
            clip.min[i] = min.min(clip.max[i]);
        }
        if max.is_finite() && max != clip.max[i] {
            clip.max[i] = max.max(clip.min[i]);
        }
    }
}

fn slab(ui: &mut Ui, bounds: Bounds, settings: &mut Settings) {
    let help = "Only what lies in a slab across an axis is drawn.";
    let usual =
        || Slab { axis: Axis::Z, middle: bounds.center().z, thickness: (0.1 * bounds.size().z).max(f64::MIN_POSITIVE) };
    optional(ui, "Slice", help, &mut settings.cut.slab, usual);
    let Some(slab) = &mut settings.cut.slab else { return };
    theme::combo(ui, "    Across", slab.axis.as_str(), |ui| {
        for axis in Axis::ALL {
            let label = ui.selectable_label(slab.axis == axis, axis.as_str());
            theme::register(ui, &format!("across:{}", axis.as_str()), label.rect);
            if label.clicked() && slab.axis != axis {
                *slab = Slab { axis, middle: bounds.center()[axis.index()], ..*slab };
            }
        }
    });
    let (least, most) = (bounds.min[slab.axis.index()], bounds.max[slab.axis.index()]);
    let middle = theme::NumberRow { label: "    Middle", unit: "", range: least..=most, log: false, default: None };
    middle.show(ui, &mut slab.middle);
    let size = (most - least).max(f64::MIN_POSITIVE);
    let range = 1e-4 * size..=size;
    let thickness = theme::NumberRow { label: "    Thickness", unit: "", range, log: true, default: None };
    thickness.show(ui, &mut slab.thickness);
}

fn fade(ui: &mut Ui, distance: f64, settings: &mut Settings) {
    let help = "Particles behind a depth lose their weight exponentially, in all modes.";
    optional(ui, "Depth fade", help, &mut settings.cut.fade, || Fade { start: distance, length: 0.25 * distance });
    let Some(fade) = &mut settings.cut.fade else { return };
    let near = 10f64.powf((distance.max(1e-30).log10()).floor() + 1.0);
    let start = theme::NumberRow { label: "    From", unit: "", range: 0.0..=near, log: false, default: None };
    start.show(ui, &mut fade.start).on_hover_text("Depth up to which particles keep their weight.");
    let length =
        theme::NumberRow { label: "    Length", unit: "", range: 1e-4 * near..=near, log: true, default: None };
    length.show(ui, &mut fade.length).on_hover_text("Depth within which the weight falls to 37 %.");
}
