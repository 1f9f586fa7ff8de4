//! A plot of places from 0 to 1 in both directions: where it is in the window, what is under the pointer.

use crate::window::theme::{self, Asked, Handle};
use bevy_egui::egui::{
    self, Color32, Id, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, WidgetInfo, WidgetType, pos2, vec2,
};

/// A place: to the right, up.
pub type At = (f32, f32);
/// A handle: of which point or region, and which one of those there.
pub type Part = (usize, usize);

/// How near the pointer must be to a handle, logical pixels.
const REACH_PX: f32 = 9.0;
/// Width and height of a handle that has the keyboard, logical pixels.
const HANDLE_PX: f32 = 10.0;

/// A plot that was laid out.
pub struct Plot {
    /// Where it is.
    pub rect: Rect,
    /// What the pointer does in it.
    pub response: Response,
    /// Draws in it.
    pub painter: egui::Painter,
}

/// What is asked of a plot as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gesture {
    /// The button went down.
    Press(At),
    /// The pointer moved with the button down.
    Drag(At),
    /// The button went up.
    Release,
    /// A double click.
    Double(At),
    /// A click with the other button.
    Secondary(At),
    /// Space or Enter while the plot has the keyboard, or a press by a screen reader.
    Add,
}

impl Plot {
    /// Lays out a plot as wide as there is room, and draws its well; `adds` is what [`Gesture::Add`] adds to it.
    pub fn new(ui: &mut Ui, id: &str, adds: &str, height: f32) -> Plot {
        let (outer, _) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::hover());
        let response = ui.interact(outer, ui.id().with(("plot", id)), Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, format!("{id}: {adds}")));
        theme::register(ui, &format!("plot:{id}"), outer.shrink2(vec2(7.0, 6.0)));
        let painter = ui.painter().with_clip_rect(outer.expand(6.0));
        painter.rect_filled(outer, 4.0, theme::WELL);
        Plot { rect: outer.shrink2(vec2(7.0, 6.0)), response, painter }
    }

    /// Where a place is in the window.
    pub fn point(&self, (x, y): At) -> Pos2 {
        pos2(egui::lerp(self.rect.x_range(), x), egui::lerp(self.rect.bottom()..=self.rect.top(), y))
    }

    /// The place of a point of the window.
    pub fn place(&self, point: Pos2) -> At {
        ((point.x - self.rect.left()) / self.rect.width(), (self.rect.bottom() - point.y) / self.rect.height())
    }

    /// How near the pointer must be, in places.
    pub fn reach(&self) -> At {
        (REACH_PX / self.rect.width(), REACH_PX / self.rect.height())
    }

    /// What is asked for in this frame.
    pub fn gesture(&self, ui: &Ui) -> Option<Gesture> {
        let at = self.response.interact_pointer_pos().map(|point| self.place(point));
        if self.response.double_clicked() {
            return at.map(Gesture::Double);
        }
        if self.response.secondary_clicked() {
            return at.map(Gesture::Secondary);
        }
        if self.response.drag_stopped() {
            return Some(Gesture::Release);
        }
        if self.response.drag_started() {
            // Where the button went down, not where the pointer was when that became a drag.
            return ui.input(|input| input.pointer.press_origin()).map(|point| Gesture::Press(self.place(point)));
        }
        if self.response.dragged() {
            return at.map(Gesture::Drag);
        }
        // A click without a drag chooses what is there. One without a pointer is of the keyboard.
        self.response.clicked().then(|| at.map_or(Gesture::Add, Gesture::Press))
    }

    /// Lets the keyboard and screen readers reach the handle at a place: whether it has the keyboard, and what is asked of it.
    pub fn reach_by_keys(&self, ui: &Ui, part: Part, at: At, handle: &Handle<'_>) -> (bool, Option<Asked>) {
        let rect = Rect::from_center_size(self.point(at), Vec2::splat(HANDLE_PX));
        let response = ui.interact(rect, self.id(part), Sense::focusable_noninteractive());
        (response.has_focus(), handle.asked(ui, &response))
    }

    /// Gives the keyboard to a handle.
    pub fn give_keyboard(&self, ui: &Ui, part: Part) {
        let id = self.id(part);
        ui.memory_mut(|memory| memory.request_focus(id));
    }

    fn id(&self, part: Part) -> Id {
        self.response.id.with(part)
    }

    /// Says below the plot what the pointer does in it.
    pub fn hint(ui: &mut Ui, text: &str) {
        ui.label(egui::RichText::new(text).size(theme::SMALL).color(theme::LABEL));
    }

    /// Draws a handle.
    pub fn handle(&self, at: At, radius: f32, chosen: bool) {
        let color = if chosen { theme::ACCENT } else { theme::TEXT };
        self.painter.circle(self.point(at), radius, color, Stroke::new(1.5, theme::WELL));
    }

    /// Draws a line through places.
    pub fn line(&self, places: &[At], width: f32, color: Color32) {
        let points = places.iter().map(|&at| self.point(at)).collect();
        self.painter.add(egui::Shape::line(points, Stroke::new(width, color)));
    }

    /// Draws a grid of thin lines at quarters.
    pub fn grid(&self) {
        for share in [0.25, 0.5, 0.75] {
            let stroke = Stroke::new(1.0, theme::LINE.gamma_multiply(0.7));
            self.painter.hline(self.rect.x_range(), self.point((0.0, share)).y, stroke);
            self.painter.vline(self.point((share, 0.0)).x, self.rect.y_range(), stroke);
        }
    }

    /// Draws an ellipse around a place.
    pub fn ellipse(&self, at: At, radius: At, stroke: Stroke, fill: Color32) {
        let radius = Vec2::new(radius.0 * self.rect.width(), radius.1 * self.rect.height());
        let painter = self.painter.with_clip_rect(self.rect);
        painter.add(egui::epaint::EllipseShape { center: self.point(at), radius, fill, stroke, angle: 0.0 });
    }
}
