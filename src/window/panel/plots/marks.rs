//! What is in the frame of a chart: bars, cells, points or a line, and what is told of those under the pointer.

use super::figure::{Frame, Shown};
use crate::annotate::number;
use crate::annotate::{ChartAxis, Marks};
use crate::color::colormap::ColorMap;
use crate::explore::plot::Part;
use crate::window::theme;
use bevy_egui::egui::{
    self, Color32, ColorImage, Mesh, Painter, Pos2, Rect, Shape, Stroke, TextureHandle, TextureOptions, Ui, pos2, vec2,
};

/// Colours of cells, from low to high.
const COLORS: usize = 96;
/// Edge of a point, logical pixels.
const POINT: f32 = 1.8;
/// What is not brushed, beside what is: the share of its light.
const DIM: f32 = 0.35;

/// The colours of cells, from low to high.
pub fn colors() -> Vec<Color32> {
    let byte = |component: f32| (255.0 * component).round() as u8;
    let map = ColorMap::named("viridis").unwrap_or_default();
    map.sample(COLORS)
        .into_iter()
        .map(|color| Color32::from_rgb(byte(color[0]), byte(color[1]), byte(color[2])))
        .collect()
}

/// Draws them.
pub fn draw(ui: &Ui, painter: &Painter, frame: &Frame<'_>, marks: &Marks<'_>, shown: &Shown, pointer: Option<Pos2>) {
    match *marks {
        Marks::Bars { edges, values } => {
            let under = pointer.and_then(|at| bin_of(edges, frame.values(at)[0]));
            bars(painter, frame, (edges, values), shown.part.as_ref(), under);
        }
        Marks::Cells { edges, values, colors } => {
            let [columns, rows] = edges.map(|edges| edges.len().saturating_sub(1));
            if let Some(texture) = cells(ui, shown.revision, [columns, rows], values, &colors) {
                let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
                painter.image(texture.id(), frame.rect, whole, Color32::WHITE);
            }
        }
        Marks::Points { x, y } => points(painter, frame, x, y, shown.part.as_ref()),
        Marks::Line { points, spreads } => line(painter, frame, points, spreads),
    }
}

/// What is told of what is under the pointer.
pub fn told(frame: &Frame<'_>, marks: &Marks<'_>, at: Pos2) -> String {
    let [x, y] = frame.values(at);
    let quantity = number::quantity;
    match *marks {
        Marks::Bars { edges, values } => match bin_of(edges, x) {
            Some(bin) => {
                let value = values.get(bin).copied().unwrap_or_default();
                format!("{} to {}:  {}", quantity(edges[bin]), quantity(edges[bin + 1]), quantity(value))
            }
            None => quantity(x),
        },
        Marks::Cells { edges: [across, up], values, .. } => {
            let cell = bin_of(across, x).zip(bin_of(up, y)).map(|(column, row)| row * (across.len() - 1) + column);
            let value = cell.and_then(|cell| values.get(cell)).copied().unwrap_or_default();
            format!("{},  {}:  {}", quantity(x), quantity(y), quantity(value))
        }
        Marks::Points { .. } => format!("{},  {}", quantity(x), quantity(y)),
        Marks::Line { points, spreads } => {
            let away = |(index, point): (usize, &[f64; 2])| ((frame.at(*point).x - at.x).abs(), index);
            let nearest = points.iter().enumerate().map(away).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, index)) = nearest else { return quantity(x) };
            let [radius, value] = points[index];
            let spread = spreads.get(index).map_or_else(String::new, |[low, high]| {
                let half = 0.5 * (high - low);
                if half > 0.0 { format!("  ±  {}", quantity(half)) } else { String::new() }
            });
            format!("{}:  {}{spread}", quantity(radius), quantity(value))
        }
    }
}

/// The bin between whose ascending edges a value is.
fn bin_of(edges: &[f64], value: f64) -> Option<usize> {
    let last = edges.len().checked_sub(2)?;
    Some(edges.partition_point(|edge| *edge <= value).saturating_sub(1).min(last))
}

fn bars(
    painter: &Painter,
    frame: &Frame<'_>,
    (edges, values): (&[f64], &[f64]),
    part: Option<&Part>,
    under: Option<usize>,
) {
    let bottom = frame.rect.bottom();
    let gap = if frame.rect.width() > 4.0 * values.len() as f32 { 1.0 } else { 0.0 };
    let mut mesh = Mesh::default();
    for (bin, (ends, &value)) in edges.windows(2).zip(values).enumerate() {
        let [from, to] = [ends[0], ends[1]].map(|edge| frame.at([edge, value]));
        if !value.is_finite() || from.y >= bottom {
            continue;
        }
        let is_brushed = part.is_none_or(|part| part.across[0] < ends[1] && ends[0] <= part.across[1]);
        let color = match is_brushed {
            _ if under == Some(bin) => theme::TEXT,
            true => theme::ACCENT,
            false => theme::ACCENT.gamma_multiply(DIM),
        };
        mesh.add_colored_rect(Rect::from_min_max(from, pos2((to.x - gap).max(from.x + 0.5), bottom)), color);
    }
    painter.add(mesh);
}

/// The picture of a table of cells, with what it was made of.
#[derive(Clone)]
struct Cells {
    key: (u64, bool),
    texture: TextureHandle,
}

/// The cells as a picture, row by row from the highest; made once for each plot and each scale of its colours.
fn cells(
    ui: &Ui,
    revision: u64,
    [columns, rows]: [usize; 2],
    values: &[f64],
    axis: &ChartAxis<'_>,
) -> Option<TextureHandle> {
    let (id, key) = (egui::Id::new("plot cells"), (revision, axis.logarithmic));
    if let Some(known) = ui.data(|data| data.get_temp::<Cells>(id)).filter(|known| known.key == key) {
        return Some(known.texture);
    }
    let side = ui.input(|input| input.max_texture_side);
    if columns == 0 || rows == 0 || values.len() != columns * rows || columns.max(rows) > side {
        return None;
    }
    let inks = colors();
    let color = |value: f64| match value > 0.0 && value.is_finite() {
        true => inks[((axis.share(value) * COLORS as f64) as usize).min(COLORS - 1)],
        false => Color32::TRANSPARENT,
    };
    let pixels = values.chunks(columns).rev().flatten().map(|value| color(*value)).collect();
    let image = ColorImage::new([columns, rows], pixels);
    let texture = ui.ctx().load_texture("plot cells", image, TextureOptions::NEAREST);
    ui.data_mut(|data| data.insert_temp(id, Cells { key, texture: texture.clone() }));
    Some(texture)
}

fn points(painter: &Painter, frame: &Frame<'_>, x: &[f64], y: &[f64], part: Option<&Part>) {
    let is_placed = |value: f64, axis: &ChartAxis<'_>| value.is_finite() && (!axis.logarithmic || value > 0.0);
    let within = |ends: [f64; 2], value: f64| (ends[0]..=ends[1]).contains(&value);
    let mut mesh = Mesh::default();
    for (&x, &y) in x.iter().zip(y) {
        if !is_placed(x, &frame.across) || !is_placed(y, &frame.up) {
            continue;
        }
        let is_brushed = part.is_none_or(|part| within(part.across, x) && part.up.is_none_or(|up| within(up, y)));
        let color = theme::ACCENT.gamma_multiply(if is_brushed { 0.75 } else { DIM * 0.75 });
        mesh.add_colored_rect(Rect::from_center_size(frame.at([x, y]), vec2(POINT, POINT)), color);
    }
    painter.add(mesh);
}

fn line(painter: &Painter, frame: &Frame<'_>, points: &[[f64; 2]], spreads: &[[f64; 2]]) {
    // From spread to spread a band.
    let mut band = Mesh::default();
    for (&[x, _], &[low, high]) in points.iter().zip(spreads) {
        if !(low.is_finite() && high.is_finite()) {
            continue;
        }
        let next = band.vertices.len() as u32;
        for value in [low, high] {
            band.colored_vertex(frame.at([x, value]), theme::ACCENT.gamma_multiply(0.2));
        }
        if next >= 2 {
            band.add_triangle(next - 2, next - 1, next);
            band.add_triangle(next - 1, next, next + 1);
        }
    }
    painter.add(band);
    let places: Vec<Pos2> =
        points.iter().filter(|point| point.iter().all(|x| x.is_finite())).map(|point| frame.at(*point)).collect();
    for place in &places {
        painter.circle_filled(*place, 1.8, theme::ACCENT);
    }
    painter.add(Shape::line(places, Stroke::new(1.5, theme::ACCENT)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_under_the_pointer_is_told() {
        let rect = Rect::from_min_max(pos2(0.0, 0.0), pos2(100.0, 100.0));
        let linear = |title| ChartAxis { title, range: [0.0, 4.0], logarithmic: false };
        let frame = Frame { rect, across: linear("x"), up: linear("y") };
        let edges = [0.0, 1.0, 2.0, 4.0];
        let bars = Marks::Bars { edges: &edges, values: &[5.0, 7.0, 3.0] };
        assert_eq!(told(&frame, &bars, pos2(30.0, 50.0)), "1 to 2:  7");
        assert_eq!(told(&frame, &bars, pos2(100.0, 50.0)), "2 to 4:  3", "the last bin has both ends");
        let cells = Marks::Cells {
            edges: [&edges, &[0.0, 2.0, 4.0]],
            values: &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            colors: linear("c"),
        };
        assert_eq!(told(&frame, &cells, pos2(75.0, 75.0)), "3,  1:  3");
        assert_eq!(told(&frame, &cells, pos2(12.5, 25.0)), "0.5,  3:  4");
        let profile = Marks::Line { points: &[[1.0, 2.0], [3.0, 4.0]], spreads: &[[1.0, 3.0], [4.0, 4.0]] };
        assert_eq!(told(&frame, &profile, pos2(30.0, 0.0)), "1:  2  ±  1");
        assert_eq!(told(&frame, &profile, pos2(90.0, 0.0)), "3:  4");
        assert_eq!((bin_of(&[], 1.0), bin_of(&[1.0], 1.0), bin_of(&edges, -9.0)), (None, None, Some(0)));
    }
}
