//! The docks at both sides of the picture, and the sections in them. A section is a file with a [`Section`] that is registered in
//! [`Sections`]; one from outside of the window brings what it shows as [`SectionData`].

use super::{PanelState, theme};
use crate::window::state::panels::Dock;
use bevy::prelude::Resource;
use bevy_egui::egui::{self, Align, CursorIcon, Layout, RichText, ScrollArea, Sense, Stroke, Ui, pos2, vec2};
use std::any::{Any, TypeId};
use std::collections::HashMap;

/// A titled part of a dock, which can be closed.
pub struct Section {
    /// Its name in presets and scenes.
    pub name: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// Where it is.
    pub dock: Dock,
    /// Whether it has something to show.
    pub applies: fn(&PanelState<'_, '_>) -> bool,
    /// Draws what is below the heading.
    pub show: fn(&mut Ui, &mut PanelState<'_, '_>),
}

/// Every section, from the top of each dock.
#[derive(Resource, Clone)]
pub struct Sections(Vec<&'static Section>);

impl Sections {
    /// These, in this order.
    pub fn new(sections: &[&'static Section]) -> Sections {
        Sections(sections.to_vec())
    }

    /// Adds a section above the one that is called `next`; at the bottom where there is none of that name.
    pub fn add_above(&mut self, next: &str, section: &'static Section) {
        let at = self.0.iter().position(|known| known.name == next).unwrap_or(self.0.len());
        self.0.insert(at, section);
    }

    /// Their names.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|section| section.name)
    }
}

/// What sections from outside of the window show, one value of each type: a system of theirs puts it here in each frame, and
/// takes from it what the user asked for.
#[derive(Resource, Default)]
pub struct SectionData(HashMap<TypeId, Box<dyn Any + Send + Sync>>);

impl SectionData {
    /// Puts a value in the place of the one of its type, which it returns.
    pub fn put<T: Any + Send + Sync>(&mut self, value: T) -> Option<T> {
        let before = self.0.insert(TypeId::of::<T>(), Box::new(value));
        before.and_then(|before| before.downcast().ok()).map(|before| *before)
    }

    /// The value of a type.
    pub fn get<T: Any>(&self) -> Option<&T> {
        self.0.get(&TypeId::of::<T>())?.downcast_ref()
    }

    /// The value of a type, to note in it what the user asks for.
    pub fn get_mut<T: Any>(&mut self) -> Option<&mut T> {
        self.0.get_mut(&TypeId::of::<T>())?.downcast_mut()
    }
}

/// Draws the sections of a dock below each other.
pub fn show_dock(ui: &mut Ui, dock: Dock, state: &mut PanelState<'_, '_>) {
    ScrollArea::vertical().id_salt(("dock", dock)).auto_shrink([false, false]).show(ui, |ui| {
        let width = ui.available_width() - theme::SCROLL_ROOM;
        for section in state.sections.0.clone().into_iter().filter(|section| section.dock == dock) {
            if !(section.applies)(state) {
                continue;
            }
            of_width(ui, width, section.name, |ui| {
                let open = !state.closed.0.contains(section.name);
                if heading(ui, section, open) {
                    state.closed.toggle(section.name);
                }
                if open {
                    (section.show)(ui, state);
                    ui.add_space(5.0);
                }
            });
        }
        follow_focus(ui);
    });
}

/// Scrolls to the control of these that has got the keyboard.
fn follow_focus(ui: &Ui) {
    let focused = ui.memory(|memory| memory.focused()).and_then(|id| ui.ctx().read_response(id));
    if let Some(control) = focused
        && control.gained_focus()
        && control.layer_id == ui.layer_id()
        && ui.max_rect().x_range().contains(control.rect.center().x)
    {
        ui.scroll_to_rect(control.rect, None);
    }
}

/// Draws below what is there, in this width whatever the contents want: a row that is too wide must not push those of other
/// sections under the scroll bar.
fn of_width(ui: &mut Ui, width: f32, name: &str, show: impl FnOnce(&mut Ui)) {
    let at = ui.cursor().min;
    let room = egui::Rect::from_min_size(at, vec2(width, ui.available_height()));
    let mut child = ui.new_child(egui::UiBuilder::new().id_salt(name).max_rect(room));
    show(&mut child);
    ui.advance_cursor_after_rect(egui::Rect::from_min_size(at, vec2(width, child.min_rect().height())));
}

/// The heading with a mark that says whether the section is open; whether it was clicked.
fn heading(ui: &mut Ui, section: &Section, open: bool) -> bool {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 22.0), Sense::click());
    let info = || egui::WidgetInfo::selected(egui::WidgetType::CollapsingHeader, true, open, section.title);
    response.widget_info(info);
    let hot = response.hovered();
    let color = if hot { theme::TEXT } else { theme::LABEL };
    let painter = ui.painter();
    painter.hline(rect.x_range(), rect.top(), Stroke::new(1.0, theme::LINE));
    let middle = pos2(rect.left() + 4.0, rect.center().y + 1.0);
    let corners = match open {
        true => [vec2(-3.5, -2.0), vec2(3.5, -2.0), vec2(0.0, 2.5)],
        false => [vec2(-2.0, -3.5), vec2(2.5, 0.0), vec2(-2.0, 3.5)],
    };
    let triangle = corners.map(|corner| middle + corner).to_vec();
    painter.add(egui::Shape::convex_polygon(triangle, color, Stroke::NONE));
    let inner = egui::Rect::from_min_max(pos2(rect.left() + 14.0, rect.top() + 1.0), rect.max);
    ui.scope_builder(egui::UiBuilder::new().max_rect(inner).layout(Layout::left_to_right(Align::Center)), |ui| {
        let title = RichText::new(section.title.to_uppercase()).size(theme::SMALL).color(color).strong();
        ui.add(egui::Label::new(title.extra_letter_spacing(1.2)).selectable(false));
    });
    theme::register(ui, &format!("section:{}", section.name), rect);
    if hot {
        ui.ctx().set_cursor_icon(CursorIcon::PointingHand);
    }
    response.clicked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_is_too_wide_leaves_those_below_their_width() {
        let ctx = egui::Context::default();
        let mut below = None;
        let mut output = ctx.run_ui(egui::RawInput::default(), |ui| {
            let left = ui.cursor().min.x;
            of_width(ui, 100.0, "wide", |ui| {
                ui.allocate_exact_size(vec2(150.0, 20.0), Sense::hover());
            });
            of_width(ui, 100.0, "below", |ui| {
                let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 20.0), Sense::hover());
                below = Some((rect.left() - left, rect.width(), rect.top()));
            });
        });
        // Nobody draws them.
        output.textures_delta.clear();
        let (left, width, top) = below.unwrap();
        assert_eq!((left, width), (0.0, 100.0));
        assert!(top >= 20.0, "it is below: {top}");
    }
}
