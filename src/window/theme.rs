//! Colours, sizes and the few widgets that give the panel and the overlays one look.

mod handle;

use bevy_egui::egui::{
    self, Align, Align2, Color32, CornerRadius, FontFamily, FontId, Layout, Margin, Response, RichText, Sense, Stroke,
    StrokeKind, TextStyle, Ui, Vec2, WidgetInfo, WidgetType, vec2,
};
pub use handle::{Asked, Handle, Ways};

/// Background of the panel.
pub const PANEL: Color32 = Color32::from_rgb(0x14, 0x17, 0x1c);
/// Background of controls and tracks.
pub const WELL: Color32 = Color32::from_rgb(0x0c, 0x0e, 0x12);
/// Controls at rest.
const CONTROL: Color32 = Color32::from_rgb(0x22, 0x27, 0x2f);
/// Controls under the pointer.
const CONTROL_HOT: Color32 = Color32::from_rgb(0x2d, 0x34, 0x3f);
/// Thin lines between sections.
pub const LINE: Color32 = Color32::from_rgb(0x2a, 0x2f, 0x38);
/// Values and headings.
pub const TEXT: Color32 = Color32::from_rgb(0xe4, 0xe7, 0xec);
/// Labels.
pub const LABEL: Color32 = Color32::from_rgb(0x93, 0x9b, 0xa8);
/// What is selected, done or dragged.
pub const ACCENT: Color32 = Color32::from_rgb(0x5b, 0xa8, 0xf5);
/// All is there.
pub const GOOD: Color32 = Color32::from_rgb(0x5f, 0xc9, 0x8b);
/// Something did not work.
pub const BAD: Color32 = Color32::from_rgb(0xf0, 0x7b, 0x6c);

/// Size of body text, logical pixels.
pub const BODY: f32 = 13.0;
/// Size of small text.
pub const SMALL: f32 = 11.0;
/// Height of a row.
pub const ROW: f32 = 16.0;

/// Gives egui the look of this program.
pub fn apply(ctx: &egui::Context) {
    ctx.set_theme(egui::ThemePreference::Dark);
    ctx.all_styles_mut(|style| {
        style.text_styles = [
            (TextStyle::Heading, FontId::new(16.0, FontFamily::Proportional)),
            (TextStyle::Body, FontId::new(BODY, FontFamily::Proportional)),
            (TextStyle::Button, FontId::new(BODY, FontFamily::Proportional)),
            (TextStyle::Small, FontId::new(SMALL, FontFamily::Proportional)),
            (TextStyle::Monospace, FontId::new(12.0, FontFamily::Monospace)),
        ]
        .into();
        style.spacing.item_spacing = vec2(8.0, 1.0);
        style.spacing.interact_size = vec2(28.0, ROW + 2.0);
        style.spacing.button_padding = vec2(8.0, 2.0);
        style.spacing.slider_rail_height = 4.0;
        style.spacing.icon_width = 14.0;
        style.spacing.icon_width_inner = 8.0;
        style.spacing.scroll.bar_width = 6.0;
        let visuals = &mut style.visuals;
        visuals.panel_fill = PANEL;
        visuals.window_fill = PANEL;
        visuals.extreme_bg_color = WELL;
        visuals.faint_bg_color = CONTROL;
        visuals.window_stroke = Stroke::new(1.0, LINE);
        visuals.selection.bg_fill = ACCENT.gamma_multiply(0.35);
        visuals.selection.stroke = Stroke::new(1.0, TEXT);
        visuals.slider_trailing_fill = true;
        visuals.error_fg_color = BAD;
        let widgets = &mut visuals.widgets;
        let radius = CornerRadius::same(4);
        for (widget, fill, text) in [
            (&mut widgets.noninteractive, PANEL, LABEL),
            (&mut widgets.inactive, CONTROL, TEXT),
            (&mut widgets.hovered, CONTROL_HOT, TEXT),
            (&mut widgets.active, CONTROL_HOT, TEXT),
            (&mut widgets.open, CONTROL_HOT, TEXT),
        ] {
            widget.bg_fill = fill;
            widget.weak_bg_fill = fill;
            widget.bg_stroke = Stroke::NONE;
            widget.fg_stroke = Stroke::new(1.0, text);
            widget.corner_radius = radius;
            widget.expansion = 0.0;
        }
        widgets.noninteractive.bg_stroke = Stroke::new(1.0, LINE);
    });
}

/// Room at the right of a dock's contents, where the scroll bar is when there is one.
pub const SCROLL_ROOM: f32 = 12.0;

/// The panel's frame; [`SCROLL_ROOM`] comes on top at the right.
pub fn panel_frame() -> egui::Frame {
    egui::Frame::NONE.fill(PANEL).inner_margin(Margin { left: 14, right: 4, top: 10, bottom: 10 })
}

/// Takes light from what lies in the rectangles, pop-ups included; `brightness` is the share of it that stays.
pub fn dim(ctx: &egui::Context, rects: &[egui::Rect], brightness: f32) {
    if brightness >= 1.0 {
        return;
    }
    let shade = Color32::from_black_alpha((255.0 * (1.0 - brightness)).round() as u8);
    let painter = ctx.layer_painter(egui::LayerId::new(egui::Order::Debug, egui::Id::new("dim")));
    for rect in rects {
        painter.rect_filled(*rect, 0.0, shade);
    }
}

/// The frame of cards that lie over the picture.
pub fn card_frame() -> egui::Frame {
    egui::Frame::NONE
        .fill(PANEL)
        .stroke(Stroke::new(1.0, LINE))
        .corner_radius(CornerRadius::same(8))
        .inner_margin(Margin::symmetric(18, 14))
}

/// A section's heading with the line above it.
pub fn section(ui: &mut Ui, title: &str) {
    ui.add_space(4.0);
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 1.0), Sense::hover());
    ui.painter().hline(rect.x_range(), rect.center().y, Stroke::new(1.0, LINE));
    ui.add_space(3.0);
    ui.label(RichText::new(title.to_uppercase()).size(SMALL).color(LABEL).strong().extra_letter_spacing(1.2));
    ui.add_space(1.0);
}

/// A row: the label at the left, the value at the right edge.
pub fn fact(ui: &mut Ui, label: &str, value: impl Into<String>) -> Response {
    fact_colored(ui, label, value, TEXT)
}

/// As [`fact`], the value in a colour of its own.
pub fn fact_colored(ui: &mut Ui, label: &str, value: impl Into<String>, color: Color32) -> Response {
    row(ui, label, |ui| {
        ui.add(egui::Label::new(RichText::new(value.into()).color(color)).truncate());
    })
}

/// A row: the label at the left, anything at the right edge (laid out from the right). What is there is the control of the label's
/// name.
pub fn row(ui: &mut Ui, label: &str, add_value: impl FnOnce(&mut Ui)) -> Response {
    row_within(ui, label, f32::INFINITY, add_value)
}

/// The same with so much room for the label, which is cut off where it is longer.
fn row_within(ui: &mut Ui, label: &str, room: f32, add_value: impl FnOnce(&mut Ui)) -> Response {
    let size = vec2(ui.available_width(), ROW);
    ui.allocate_ui_with_layout(size, Layout::left_to_right(Align::Center), |ui| {
        ui.set_min_height(ROW);
        let text = RichText::new(label).color(LABEL);
        match room.is_finite() {
            true => {
                let room = vec2(room, ROW);
                ui.allocate_ui_with_layout(room, Layout::left_to_right(Align::Center), |ui| {
                    ui.add(egui::Label::new(text).truncate())
                });
            }
            false => drop(ui.label(text)),
        }
        let value = ui.with_layout(Layout::right_to_left(Align::Center), add_value).response;
        register(ui, &control_name(label), value.rect);
    })
    .response
}

/// The name of the control with this label.
fn control_name(label: &str) -> String {
    label.trim().to_lowercase().replace(' ', "-")
}

/// Where the named controls of a frame are, logical pixels, and whether they are in sight: not scrolled away.
pub type Controls = std::collections::BTreeMap<String, (egui::Rect, bool)>;

/// Notes where a control is, for scripts and tests that look for it in the status file.
pub fn register(ui: &Ui, name: &str, rect: egui::Rect) {
    let control = (rect, ui.clip_rect().contains(rect.center()));
    ui.data_mut(|data| data.get_temp_mut_or_default::<Controls>(controls_id()).insert(name.to_owned(), control));
}

/// Says what a control without a text of its own is called, to those who hear the window instead of seeing it.
pub fn call(response: &Response, name: &str) {
    response.ctx.accesskit_node_builder(response.id, |node| node.set_label(name));
}

/// A small button with a name for scripts; whether it was clicked.
pub fn button(ui: &mut Ui, name: &str, text: &str, enabled: bool, help: &str) -> bool {
    let label = RichText::new(text).size(12.0);
    let response = ui.add_enabled(enabled, egui::Button::new(label).min_size(vec2(18.0, 18.0)));
    // A sign is no name.
    if !text.contains(char::is_alphabetic) {
        call(&response, help);
    }
    register(ui, name, response.rect);
    response.on_hover_text(help).clicked()
}

/// The controls that have been drawn since the last call.
pub fn take_controls(ctx: &egui::Context) -> Controls {
    ctx.data_mut(|data| std::mem::take(data.get_temp_mut_or_default::<Controls>(controls_id())))
}

fn controls_id() -> egui::Id {
    egui::Id::new("deepfield controls")
}

/// A number that is dragged on a slider or typed.
pub struct NumberRow<'a> {
    /// What it is called.
    pub label: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// Ends of the number, and of the slider unless that has its own.
    pub range: std::ops::RangeInclusive<f64>,
    /// Whether the slider is logarithmic.
    pub log: bool,
    /// What a reset makes of it, where it differs.
    pub default: Option<f64>,
}

/// How far a slider goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// The values at its ends.
    pub ends: [f64; 2],
    /// Of a logarithmic one the least value above 0 that it reaches from there.
    pub least: Option<f64>,
}

/// The least value above 0 of logarithmic sliders that begin there and go as far as their numbers.
const LEAST: f64 = 1e-6;
/// Width of the field in which a number is typed.
const FIELD: f32 = 74.0;
/// Room of a reset mark and the gap before it.
pub const MARK_ROOM: f32 = 18.0;
/// Width of the part of a row that sets its value.
pub const VALUE: f32 = 170.0;

impl NumberRow<'_> {
    /// Draws the row; whether the number has changed.
    pub fn show(&self, ui: &mut Ui, value: &mut f64) -> Response {
        let ends = [*self.range.start(), *self.range.end()];
        self.show_within(ui, value, Reach { ends, least: self.log.then_some(LEAST) })
    }

    /// The same with a slider that goes less far than the number, which may be typed.
    pub fn show_within(&self, ui: &mut Ui, value: &mut f64, Reach { ends, least }: Reach) -> Response {
        let before = *value;
        let room = ui.available_width() - VALUE - MARK_ROOM;
        let mut response = row_within(ui, self.label, room, |ui| {
            ui.spacing_mut().item_spacing.x = 6.0;
            reset_mark(ui, self.label, self.default.is_some_and(|default| default != *value), || {
                *value = self.default.unwrap_or(*value);
            });
            let name = control_name(self.label);
            let field = egui::DragValue::new(value)
                .range(self.range.clone())
                .clamp_existing_to_range(false)
                .speed(0.004 * (self.range.end() - self.range.start()).min(before.abs().max(0.01) * 4.0))
                .custom_formatter(|value, _| {
                    if self.unit.is_empty() { brief(value) } else { format!("{} {}", brief(value), self.unit) }
                })
                .custom_parser(|text| text.trim().trim_end_matches(self.unit).trim().parse().ok())
                .update_while_editing(false);
            let typed = ui.add_sized(vec2(FIELD, ROW), field);
            call(&typed, self.label);
            register(ui, &format!("{name}:field"), typed.rect);
            ui.spacing_mut().slider_width = VALUE - FIELD - 6.0;
            let slider = egui::Slider::new(value, ends[0]..=ends[1]).logarithmic(least.is_some()).show_value(false);
            let slider = slider.smallest_positive(least.unwrap_or(LEAST));
            let dragged = ui.add(slider.clamping(egui::SliderClamping::Edits));
            call(&dragged, self.label);
            register(ui, &format!("{name}:slider"), dragged.rect);
        });
        if !self.unit.is_empty() {
            response = response.on_hover_text(format!("in {}", self.unit));
        }
        if *value != before {
            response.mark_changed();
        }
        response
    }
}

/// A small mark that puts a value back to its default; its room is kept where there is nothing to put back.
pub fn reset_mark(ui: &mut Ui, label: &str, differs: bool, reset: impl FnOnce()) {
    let sense = if differs { Sense::click() } else { Sense::hover() };
    let (rect, response) = ui.allocate_exact_size(vec2(12.0, ROW), sense);
    if !differs {
        return;
    }
    let info = || WidgetInfo::labeled(WidgetType::Button, true, format!("{label}: back to the default"));
    response.widget_info(info);
    register(ui, &format!("{}:reset", control_name(label)), rect);
    let color = if response.hovered() { TEXT } else { ACCENT };
    ui.painter().circle_filled(rect.center(), 3.0, color);
    if response.on_hover_text("back to the default").clicked() {
        reset();
    }
}

/// A number as a field shows it: up to five significant figures, never so many that they are cut off.
pub fn brief(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&magnitude) {
        let decimals = (4.0 - magnitude.log10().floor()).clamp(0.0, 7.0) as usize;
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        let text = format!("{value:.3e}");
        match text.split_once('e') {
            Some((mantissa, exponent)) if mantissa.contains('.') => {
                format!("{}e{exponent}", mantissa.trim_end_matches('0').trim_end_matches('.'))
            }
            _ => text,
        }
    }
}

/// A labelled combo box that fills the right part of the row.
pub fn combo(ui: &mut Ui, label: &str, selected: &str, add: impl FnOnce(&mut Ui)) -> Response {
    row(ui, label, |ui| {
        ui.add_space(MARK_ROOM);
        let combo = egui::ComboBox::from_id_salt(label).width(VALUE).truncate().selected_text(selected);
        call(&combo.show_ui(ui, add).response, label);
    })
}

/// A labelled switch.
pub fn switch(ui: &mut Ui, label: &str, on: &mut bool) -> Response {
    row(ui, label, |ui| {
        ui.add_space(MARK_ROOM);
        call(&ui.add_sized(vec2(18.0, ROW), egui::Checkbox::without_text(on)), label);
    })
}

/// Draws a ring around the control that has the keyboard.
pub fn ring(ctx: &egui::Context) {
    let focused = ctx.memory(|memory| memory.focused()).and_then(|id| ctx.read_response(id));
    if let Some(control) = focused {
        let painter = ctx.layer_painter(egui::LayerId::new(egui::Order::Tooltip, egui::Id::new("focus ring")));
        let ring = control.rect.intersect(control.interact_rect).expand(2.0);
        painter.rect_stroke(ring, 4.0, Stroke::new(1.5, ACCENT), StrokeKind::Outside);
    }
}

/// A thin bar that is filled to `share`.
pub fn bar(ui: &mut Ui, share: f32, color: Color32) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 4.0), Sense::hover());
    let painter = ui.painter();
    painter.rect_filled(rect, 2.0, WELL);
    let filled = egui::Rect::from_min_size(rect.min, vec2(rect.width() * share.clamp(0.0, 1.0), rect.height()));
    painter.rect_filled(filled, 2.0, color);
    response
}

/// A bar that shows that something goes on whose end is not known.
pub fn busy_bar(ui: &mut Ui, seconds: f64) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 4.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, WELL);
    let phase = (0.6 * seconds).fract() as f32;
    let left = rect.left() + (1.3 * phase - 0.3) * rect.width();
    let moving = egui::Rect::from_min_size(egui::pos2(left, rect.top()), vec2(0.3 * rect.width(), rect.height()));
    ui.painter().rect_filled(moving.intersect(rect), 2.0, ACCENT);
}

/// Paints a colour map from left to right (or bottom to top) into a rectangle.
pub fn gradient(painter: &egui::Painter, rect: egui::Rect, vertical: bool, color: impl Fn(f32) -> Color32) {
    const STEPS: usize = 96;
    let mut mesh = egui::Mesh::default();
    for step in 0..=STEPS {
        let t = step as f32 / STEPS as f32;
        let (a, b) = if vertical {
            let y = egui::lerp(rect.bottom()..=rect.top(), t);
            (egui::pos2(rect.left(), y), egui::pos2(rect.right(), y))
        } else {
            let x = egui::lerp(rect.left()..=rect.right(), t);
            (egui::pos2(x, rect.top()), egui::pos2(x, rect.bottom()))
        };
        let index = mesh.vertices.len() as u32;
        mesh.colored_vertex(a, color(t));
        mesh.colored_vertex(b, color(t));
        if step > 0 {
            mesh.add_triangle(index - 2, index - 1, index);
            mesh.add_triangle(index - 1, index, index + 1);
        }
    }
    painter.add(mesh);
    painter.rect_stroke(rect, 0.0, Stroke::new(1.0, LINE), StrokeKind::Outside);
}

/// Text with a dark halo, legible over any picture.
pub fn halo_text(painter: &egui::Painter, at: egui::Pos2, anchor: Align2, text: &str, size: f32, color: Color32) {
    let font = FontId::new(size, FontFamily::Proportional);
    let halo = Color32::from_black_alpha(170);
    for offset in [vec2(-1.0, 0.0), vec2(1.0, 0.0), vec2(0.0, -1.0), vec2(0.0, 1.0), vec2(1.0, 1.0), vec2(-1.0, 1.0)] {
        painter.text(at + offset, anchor, text, font.clone(), halo);
    }
    painter.text(at, anchor, text, font, color);
}

/// A key as it is drawn on the help page.
pub fn key_cap(ui: &mut Ui, key: &str) {
    egui::Frame::NONE
        .fill(CONTROL)
        .corner_radius(CornerRadius::same(4))
        .inner_margin(Margin::symmetric(7, 1))
        .show(ui, |ui| ui.label(RichText::new(key).color(TEXT).size(12.0)));
}

/// The size of a text in the body font, logical pixels.
pub fn text_size(painter: &egui::Painter, text: &str, size: f32) -> Vec2 {
    painter.layout_no_wrap(text.to_owned(), FontId::new(size, FontFamily::Proportional), TEXT).size()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_control_that_takes_the_keyboard_has_a_name() {
        let ctx = egui::Context::default();
        ctx.enable_accesskit();
        let (mut number, mut on) = (1.0, false);
        let mut output = ctx.run_ui(egui::RawInput::default(), |ui| {
            button(ui, "remove", "\u{d7}", true, "Removes it");
            button(ui, "save", "Save", true, "Saves it");
            switch(ui, "Axes", &mut on);
            combo(ui, "Mode", "volume", |_| {});
            // A mark that has nothing to put back takes no keyboard.
            for default in [1.0, 2.0] {
                let row = NumberRow { label: "Speed", unit: "", range: 0.0..=9.0, log: false, default: Some(default) };
                row.show(ui, &mut number);
            }
        });
        // Nobody draws them.
        output.textures_delta.clear();
        let nodes = output.platform_output.accesskit_update.unwrap().nodes;
        let controls = nodes.iter().filter(|(_, node)| node.supports_action(egui::accesskit::Action::Focus));
        let mut names: Vec<&str> = controls.map(|(_, node)| node.label().unwrap_or_default()).collect();
        names.sort_unstable();
        let speeds = ["Speed", "Speed", "Speed", "Speed", "Speed: back to the default"];
        assert_eq!(names, [["Axes", "Mode", "Removes it", "Save"].as_slice(), speeds.as_slice()].concat());
    }

    #[test]
    fn numbers_in_fields_are_short_and_right() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (0.8, "0.8"),
            (-0.012_345_6, "-0.012346"),
            (12_345.678, "12346"),
            (45.25, "45.25"),
            (2.5e9, "2.5e9"),
            (1e-7, "1e-7"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(brief(value), text);
            assert!(value == 0.0 || (text.parse::<f64>().unwrap() / value - 1.0).abs() < 1e-4 || value.is_infinite());
        }
    }
}
