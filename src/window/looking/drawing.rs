//! What looking closer draws over the picture: the inspected particle, measured distances, regions and strokes.

use super::heights::{OnHeights, Spot};
use super::prober::Prober;
use super::{Inspector, LookingState, Measure};
use crate::annotate::number;
use crate::explore::{Lasso, Members, Region, Shape};
use crate::picture::surface::{FieldInScene, Piece};
use crate::view::{Projection, View};
use crate::window::hidden::Hiding;
use crate::window::picture::Picture;
use crate::window::state::tool::{Stroke, Tool};
use crate::window::theme;
use bevy::math::DVec3;
use bevy_egui::egui::{self, Align2, Color32, Stroke as Line, vec2};

/// All that is drawn.
pub struct Looking<'a> {
    inspector: &'a Inspector,
    measure: &'a Measure,
    prober: &'a Prober,
    /// What was found out about heights.
    heights: &'a OnHeights,
    hiding: &'a Hiding,
    stroke: &'a Stroke,
    tool: Tool,
}

/// The share of its colour that a hidden line has.
const FAINT: f32 = 0.35;

/// Where places of a picture are in the window.
struct Frame<'a> {
    painter: &'a egui::Painter,
    view: View,
    corner: egui::Pos2,
    scale: f32,
    hiding: &'a Hiding,
}

impl Frame<'_> {
    fn window(&self, [x, y]: [f64; 2]) -> egui::Pos2 {
        self.corner + vec2(x as f32, y as f32) / self.scale
    }

    fn at(&self, world: DVec3) -> Option<egui::Pos2> {
        let at = self.view.to_pixels(self.view.to_camera(world))?;
        // Farther out than egui can paint, a line would go astray.
        at.iter().all(|x| x.abs() < 1e5).then(|| self.window(at))
    }

    /// A line that is legible on any ground.
    fn line(&self, points: Vec<egui::Pos2>, color: Color32) {
        self.painter.add(egui::Shape::line(points.clone(), Line::new(3.5, Color32::from_black_alpha(140))));
        self.painter.add(egui::Shape::line(points, Line::new(1.4, color)));
    }

    /// Parts of a line, as far as they are in front of the eye: faint where a surface hides them.
    fn pieces(&self, pieces: Vec<Piece>, color: Color32) {
        for Piece { is_hidden, places } in pieces {
            let points: Vec<egui::Pos2> = places.iter().filter_map(|place| self.at(*place)).collect();
            if points.len() < 2 {
                continue;
            }
            if is_hidden {
                self.painter.add(egui::Shape::line(points, Line::new(1.0, color.gamma_multiply(FAINT))));
            } else {
                self.line(points, color);
            }
        }
    }

    /// The edge between two places.
    fn edge(&self, from: DVec3, to: DVec3, color: Color32) {
        self.pieces(self.hiding.straight(from, to), color);
    }

    /// A circle around a place; faint where a surface hides it.
    fn ring(&self, place: DVec3) {
        let Some(at) = self.at(place) else { return };
        if self.hiding.hides(place) {
            self.painter.circle_stroke(at, 8.0, Line::new(1.0, theme::ACCENT.gamma_multiply(FAINT)));
            return;
        }
        self.painter.circle_stroke(at, 8.0, Line::new(3.5, Color32::from_black_alpha(140)));
        self.painter.circle_stroke(at, 8.0, Line::new(1.4, theme::ACCENT));
    }

    /// A dot at a place; faint where a surface hides it.
    fn dot(&self, place: DVec3) {
        let Some(at) = self.at(place) else { return };
        if self.hiding.hides(place) {
            self.painter.circle_filled(at, 3.0, theme::ACCENT.gamma_multiply(FAINT));
            return;
        }
        self.painter.circle_filled(at, 4.5, Color32::from_black_alpha(140));
        self.painter.circle_filled(at, 3.0, theme::ACCENT);
    }
}

impl<'a> Looking<'a> {
    /// What the panel's sections show, and the stroke that is being drawn.
    pub fn of(state: &'a LookingState<'_>, stroke: &'a Stroke) -> Looking<'a> {
        let LookingState { inspector, measure, prober, heights, hiding, tool, .. } = state;
        Looking { inspector, measure, prober, heights, hiding, stroke, tool: **tool }
    }

    /// Draws it over the picture in `rect`: of these fields in the scene, which the picture is about or which are among what it is about; `unit`:
    /// the data's unit of lengths.
    pub fn draw(
        &self,
        painter: &egui::Painter,
        rect: egui::Rect,
        (picture, view): (&Picture, View),
        (fields, is_about_heights): (&[FieldInScene], bool),
        unit: &str,
    ) {
        let frame = Frame { painter, view, corner: rect.min, scale: picture.scale, hiding: self.hiding };
        if self.heights.is_shown(self.tool, is_about_heights) {
            draw_on_heights(&frame, self.heights, fields, self.tool);
            if self.tool.takes_drags()
                && let [first, .., last] = self.stroke.points[..]
            {
                frame.line(vec![frame.window(first), frame.window(last)], theme::ACCENT);
            }
        }
        if is_about_heights {
            return;
        }
        if let Some(Members::Region(region)) = &self.prober.members {
            outline(&frame, region, theme::TEXT);
        }
        match (self.tool, self.stroke.region(self.tool)) {
            (Tool::Lasso, _) if self.stroke.points.len() > 1 => {
                frame.line(self.stroke.points.iter().map(|point| frame.window(*point)).collect(), theme::ACCENT);
            }
            (_, Some(region)) => {
                outline(&frame, &region, theme::ACCENT);
                let size = match region.shapes.first() {
                    Some(Shape::Sphere { radius, .. }) => Some(("radius", *radius)),
                    Some(Shape::Box { min, max }) => Some(("edge", max.x - min.x)),
                    _ => None,
                };
                if let (Some((what, length)), Some(at)) = (size, self.stroke.points.last()) {
                    let text = format!("{what} {} {unit}", number::quantity(length));
                    theme::halo_text(
                        painter,
                        frame.window(*at) + vec2(12.0, -6.0),
                        Align2::LEFT_BOTTOM,
                        &text,
                        13.0,
                        theme::TEXT,
                    );
                }
            }
            _ => {}
        }
        self.draw_measure(&frame, unit);
        if let Some(report) = self.inspector.report.here() {
            frame.ring(report.position);
        }
    }

    fn draw_measure(&self, frame: &Frame<'_>, unit: &str) {
        self.measure.0.iter().for_each(|place| frame.dot(*place));
        let places: Vec<egui::Pos2> = self.measure.0.iter().filter_map(|place| frame.at(*place)).collect();
        if let ([a, b], [from, to]) = (&places[..], &self.measure.0[..]) {
            frame.edge(*from, *to, theme::ACCENT);
            let text = format!("{} {unit}", number::quantity(from.distance(*to)));
            let middle = *a + 0.5 * (*b - *a) + vec2(0.0, -8.0);
            theme::halo_text(frame.painter, middle, Align2::CENTER_BOTTOM, text.trim(), 14.0, theme::TEXT);
        }
    }
}

/// What was found out about heights, where these fields stand now.
fn draw_on_heights(frame: &Frame<'_>, heights: &OnHeights, fields: &[FieldInScene], tool: Tool) {
    let place = |index: usize, spot: Spot| {
        let field = fields.iter().find(|field| field.index == index)?;
        Some(spot.in_scene(field))
    };
    let along = |index: usize, spots: &[Option<Spot>], color: Color32| {
        for piece in spots.split(Option::is_none).filter(|piece| piece.len() > 1) {
            let piece: Vec<DVec3> = piece.iter().flatten().filter_map(|spot| place(index, *spot)).collect();
            frame.pieces(frame.hiding.pieces(&piece), color);
        }
    };
    match tool {
        Tool::Inspect | Tool::Lasso => {
            if let Some(at) = heights.found.here().and_then(|found| place(found.field, found.spot?)) {
                frame.ring(at);
            }
        }
        Tool::Measure => {
            let places: Vec<DVec3> = heights.places.iter().filter_map(|own| place(own.field, own.spot)).collect();
            if let [from, to] = places[..] {
                frame.edge(from, to, theme::ACCENT);
            }
            places.into_iter().for_each(|place| frame.dot(place));
        }
        Tool::Profile => {
            if let Some(line) = heights.profile.here() {
                along(line.field, &line.spots, theme::ACCENT);
            }
        }
        Tool::Sphere | Tool::Cube => {
            if let Some(numbers) = heights.numbers.here() {
                along(numbers.field, &numbers.outline, theme::TEXT);
            }
        }
    }
}

/// The outlines of a region's shapes.
fn outline(frame: &Frame<'_>, region: &Region, color: Color32) {
    for shape in &region.shapes {
        match shape {
            Shape::Sphere { center, radius } => sphere(frame, *center, *radius, color),
            Shape::Box { min, max } => {
                let corner = |index: usize| {
                    let pick = |axis: usize| if index >> axis & 1 == 1 { max[axis] } else { min[axis] };
                    DVec3::new(pick(0), pick(1), pick(2))
                };
                for from in 0..8 {
                    for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
                        frame.edge(corner(from), corner(from | 1 << axis), color);
                    }
                }
            }
            Shape::Lasso(lasso) => polygon(frame, lasso, color),
        }
    }
}

/// A sphere's outline: the circle on it in which lines of sight touch it.
fn sphere(frame: &Frame<'_>, center: DVec3, radius: f64, color: Color32) {
    const STEPS: usize = 96;
    let view = &frame.view;
    let (axis, middle, reach) = match view.projection {
        Projection::Orthographic { .. } => (view.forward, center, radius),
        Projection::Perspective { .. } => {
            let away = center - view.eye;
            let distance = away.length();
            // From inside it has no outline.
            if distance <= radius {
                return;
            }
            let toward = radius * radius / distance;
            let axis = away / distance;
            (axis, center - axis * toward, (radius * radius - toward * toward).sqrt())
        }
    };
    let (u, v) = axis.any_orthonormal_pair();
    let angle = |step: usize| std::f64::consts::TAU * step as f64 / STEPS as f64;
    let around = |step: usize| middle + reach * (angle(step).cos() * u + angle(step).sin() * v);
    let places: Vec<DVec3> = (0..=STEPS).map(around).collect();
    if places.iter().all(|place| frame.at(*place).is_some()) {
        frame.pieces(frame.hiding.pieces(&places), color);
    }
}

/// A lasso's polygon, where it is drawn on the view that is shown.
fn polygon(frame: &Frame<'_>, lasso: &Lasso, color: Color32) {
    let Ok(drawn) = lasso.view() else { return };
    let same = drawn.eye.abs_diff_eq(frame.view.eye, 1e-9 * frame.view.eye.abs().max_element().max(1e-30))
        && drawn.forward.dot(frame.view.forward) > 1.0 - 1e-9
        && (drawn.width, drawn.height) == (frame.view.width, frame.view.height);
    if !same {
        return;
    }
    let mut points: Vec<egui::Pos2> = lasso.polygon.iter().map(|&(x, y)| frame.window([x, y])).collect();
    points.extend(points.first().copied());
    frame.line(points, color);
}

/// The cursor over the picture while a tool that draws is in hand.
pub fn cursor(tool: Tool) -> Option<egui::CursorIcon> {
    match tool {
        Tool::Inspect => None,
        _ => Some(egui::CursorIcon::Crosshair),
    }
}

/// A selection's colour in a list, as a button with a name.
pub fn swatch(ui: &mut egui::Ui, color: [u8; 3], name: &str) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(vec2(12.0, 12.0), egui::Sense::click());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Button, true, name));
    let [r, g, b] = color;
    ui.painter().rect_filled(rect.shrink(1.0), 2.0, Color32::from_rgb(r, g, b));
    response.on_hover_text(name)
}
