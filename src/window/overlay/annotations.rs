//! Paints annotations with the window's user interface.

use crate::annotate::{DisplayList, Rgba, Shape};
use crate::window::theme;
use bevy_egui::egui::{self, Align, Align2, Color32, Rect, Stroke, pos2};

/// Paints everything into the picture at `rect`.
pub fn paint(painter: &egui::Painter, rect: Rect, list: &DisplayList) {
    let place = |[x, y]: [f32; 2]| pos2(rect.left() + x, rect.top() + y);
    for shape in &list.shapes {
        match shape {
            Shape::Line { from, to, width, color } => {
                painter.line_segment([place(*from), place(*to)], Stroke::new(*width, color32(*color)));
            }
            Shape::Rect { area, color } => {
                painter.rect_filled(Rect::from_min_max(place(area.min), place(area.max)), 2.0, color32(*color));
            }
            Shape::Circle { center, radius, width, color } => {
                painter.circle_stroke(place(*center), *radius, Stroke::new(*width, color32(*color)));
            }
            Shape::Mesh { area, columns, colors } => {
                painter.add(mesh(Rect::from_min_max(place(area.min), place(area.max)), *columns, colors));
            }
            Shape::Text { at, anchor, text, size, color } => {
                let [x, y] = anchor.0;
                let side = |share: f32| match share {
                    share if share < 0.25 => Align::Min,
                    share if share > 0.75 => Align::Max,
                    _ => Align::Center,
                };
                // Anchors between these, of coordinates along oblique edges, are moved to the nearest.
                let align = Align2([side(x), side(y)]);
                let area = shape.area();
                let at = match (x, y) {
                    (x, y) if [x, y].iter().all(|share| [0.0, 0.5, 1.0].contains(share)) => *at,
                    _ => [0, 1].map(|k| {
                        let share = [0.0, 0.5, 1.0][align.0[k] as usize];
                        area.min[k] + share * (area.max[k] - area.min[k])
                    }),
                };
                theme::halo_text(painter, place(at), align, text, *size, color32(*color));
            }
        }
    }
}

/// A colour as egui has it.
fn color32([r, g, b, a]: Rgba) -> Color32 {
    Color32::from_rgba_unmultiplied(r, g, b, a)
}

/// A grid of colours as triangles.
fn mesh(area: Rect, columns: usize, colors: &[Rgba]) -> egui::Mesh {
    let mut mesh = egui::Mesh::default();
    let rows = colors.len() / columns.max(1);
    if columns < 2 || rows < 2 {
        return mesh;
    }
    for (index, color) in colors.iter().enumerate() {
        let share = [(index % columns) as f32 / (columns - 1) as f32, (index / columns) as f32 / (rows - 1) as f32];
        mesh.colored_vertex(area.lerp_inside(egui::vec2(share[0], share[1])), color32(*color));
    }
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let [a, b] = [row * columns + column, (row + 1) * columns + column].map(|index| index as u32);
            mesh.add_triangle(a, a + 1, b);
            mesh.add_triangle(a + 1, b, b + 1);
        }
    }
    mesh
}
