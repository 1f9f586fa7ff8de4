//! Paints a display list into a picture, with anti-aliased lines and text.

use super::display_list::{Area, At, DisplayList, Rgba, Shape};
use super::font;
use crate::color::Image;
use crate::color::colormap::HexColor;
use crate::color::composite::Background;

/// Around letters.
const HALO: Rgba = [0, 0, 0, 170];

/// What annotations lie on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paper {
    /// A dark picture: light letters.
    #[default]
    Dark,
    /// A light picture: dark letters.
    Light,
}

impl Paper {
    /// The paper that a background is.
    pub fn of(background: Background) -> Paper {
        match background {
            Background::Color(HexColor([r, g, b])) => {
                let light = 0.21 * f32::from(r) + 0.72 * f32::from(g) + 0.07 * f32::from(b);
                if light > 127.0 { Paper::Light } else { Paper::Dark }
            }
            Background::Black | Background::Transparent => Paper::Dark,
        }
    }

    /// A colour that is meant for dark pictures, on this paper: what was light is dark, of the same hue. Twice it is what it was.
    pub fn ink(self, color: Rgba) -> Rgba {
        let [r, g, b, a] = color;
        let (most, least) = (r.max(g).max(b), r.min(g).min(b));
        let turn = |channel: u8| (255 - most).saturating_add(channel - least);
        match self {
            Paper::Dark => color,
            Paper::Light => [turn(r), turn(g), turn(b), a],
        }
    }
}

/// Paints everything into the picture, whose pixels are `scale` to a logical one.
pub fn paint(image: &mut Image, list: &DisplayList, scale: f32, paper: Paper) {
    if image.rgba.len() != image.width as usize * image.height as usize || !(scale > 0.0 && scale.is_finite()) {
        return;
    }
    for shape in &list.shapes {
        match shape {
            Shape::Line { from, to, width, color } => {
                line(image, from.map(|x| x * scale), to.map(|x| x * scale), width * scale, paper.ink(*color));
            }
            Shape::Rect { area, color } => rect(image, scaled(area, scale), |_| paper.ink(*color)),
            Shape::Circle { center, radius, width, color } => {
                circle(image, center.map(|x| x * scale), radius * scale, width * scale, paper.ink(*color));
            }
            Shape::Mesh { area, columns, colors } => {
                rect(image, scaled(area, scale), |place| mesh_color(place, *columns, colors));
            }
            Shape::Text { text, size, color, .. } => {
                let corner = shape.area().min.map(|x| (x * scale).round());
                write(image, text, size * scale, corner, scale, (paper.ink(*color), paper.ink(HALO)));
            }
        }
    }
}

fn scaled(area: &Area, scale: f32) -> Area {
    Area { min: area.min.map(|x| x * scale), max: area.max.map(|x| x * scale) }
}

/// Lays a colour over a pixel; `coverage` from 0 to 1. Colours are mixed as they are encoded, as the window does.
fn over(image: &mut Image, x: i64, y: i64, color: Rgba, coverage: f32) {
    let (width, height) = (i64::from(image.width), i64::from(image.height));
    if !(0..width).contains(&x) || !(0..height).contains(&y) {
        return;
    }
    let pixel = &mut image.rgba[(y * width + x) as usize];
    let above = f32::from(color[3]) / 255.0 * coverage.clamp(0.0, 1.0);
    let below = f32::from(pixel[3]) / 255.0 * (1.0 - above);
    let alpha = above + below;
    if alpha <= 0.0 {
        return;
    }
    for k in 0..3 {
        let mixed = (f32::from(color[k]) * above + f32::from(pixel[k]) * below) / alpha;
        pixel[k] = mixed.round().clamp(0.0, 255.0) as u8;
    }
    pixel[3] = (255.0 * alpha).round().min(255.0) as u8;
}

/// The pixels of an area that are in the picture: columns and rows.
fn pixels(image: &Image, area: Area) -> [std::ops::Range<i64>; 2] {
    let limits = [image.width, image.height].map(|side| side as f32);
    [0, 1].map(|k| {
        let end = |x: f32| x.clamp(0.0, limits[k]) as i64;
        end(area.min[k].floor())..end(area.max[k].ceil())
    })
}

/// Fills a rectangle with the colours at places from 0 to 1 in it; edges are moved to pixels' edges.
fn rect(image: &mut Image, area: Area, color: impl Fn([f32; 2]) -> Rgba) {
    let area = Area { min: area.min.map(f32::round), max: area.max.map(f32::round) };
    let [columns, rows] = pixels(image, area);
    let size = [0, 1].map(|k| (area.max[k] - area.min[k]).max(1.0));
    for y in rows {
        for x in columns.clone() {
            let place = [(x as f32 + 0.5 - area.min[0]) / size[0], (y as f32 + 0.5 - area.min[1]) / size[1]];
            over(image, x, y, color(place), 1.0);
        }
    }
}

/// The colour of a mesh at a place from 0 to 1 in it.
fn mesh_color([x, y]: [f32; 2], columns: usize, colors: &[Rgba]) -> Rgba {
    let rows = colors.len() / columns.max(1);
    if columns < 2 || rows < 2 {
        return colors.first().copied().unwrap_or([0; 4]);
    }
    let locate = |place: f32, count: usize| {
        let position = place.clamp(0.0, 1.0) * (count - 1) as f32;
        let index = (position as usize).min(count - 2);
        (index, position - index as f32)
    };
    let ((column, u), (row, v)) = (locate(x, columns), locate(y, rows));
    let corner = |dx: usize, dy: usize| colors[(row + dy) * columns + column + dx].map(f32::from);
    let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
    std::array::from_fn(|k| {
        let [a, b, c, d] = corners.map(|color| color[k]);
        ((a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v).round() as u8
    })
}

/// Draws a line with round ends; upright and level ones lie on whole pixels.
fn line(image: &mut Image, mut from: At, mut to: At, width: f32, color: Rgba) {
    let mut width = width.max(1.0);
    for k in 0..2 {
        if from[k] == to[k] && from[1 - k] != to[1 - k] {
            width = width.round();
            from[k] = (from[k] - 0.5 * width).round() + 0.5 * width;
            to[k] = from[k];
        }
    }
    let along = [to[0] - from[0], to[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let reach = 0.5 * width + 1.0;
    let area = Area { min: [0, 1].map(|k| from[k].min(to[k])), max: [0, 1].map(|k| from[k].max(to[k])) }.grown(reach);
    let [columns, rows] = pixels(image, area);
    for y in rows {
        for x in columns.clone() {
            let offset = [x as f32 + 0.5 - from[0], y as f32 + 0.5 - from[1]];
            let share = if square > 0.0 { (offset[0] * along[0] + offset[1] * along[1]) / square } else { 0.0 };
            let share = share.clamp(0.0, 1.0);
            let distance = (offset[0] - share * along[0]).hypot(offset[1] - share * along[1]);
            let coverage = (0.5 * width + 0.5 - distance).clamp(0.0, 1.0);
            if coverage > 0.0 {
                over(image, x, y, color, coverage);
            }
        }
    }
}

fn circle(image: &mut Image, center: At, radius: f32, width: f32, color: Rgba) {
    let width = width.max(1.0);
    let [columns, rows] = pixels(image, Area { min: center, max: center }.grown(radius + 0.5 * width + 1.0));
    for y in rows {
        for x in columns.clone() {
            let distance = (x as f32 + 0.5 - center[0]).hypot(y as f32 + 0.5 - center[1]);
            let coverage = (0.5 * width + 0.5 - (distance - radius).abs()).clamp(0.0, 1.0);
            if coverage > 0.0 {
                over(image, x, y, color, coverage);
            }
        }
    }
}

/// Writes text with its halo; `corner` is the upper left corner of its box, physical pixels.
fn write(image: &mut Image, text: &str, size: f32, [left, top]: At, scale: f32, (color, halo): (Rgba, Rgba)) {
    let step = scale.max(1.0);
    let halo = [halo[0], halo[1], halo[2], (u32::from(halo[3]) * u32::from(color[3]) / 255) as u8];
    for [dx, dy] in [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [1.0, 1.0], [-1.0, 1.0]] {
        let at = [left + step * dx, top + step * dy];
        font::rasterize(text, size, at, |x, y, coverage| over(image, x, y, halo, coverage));
    }
    font::rasterize(text, size, [left, top], |x, y, coverage| over(image, x, y, color, coverage));
}

#[cfg(test)]
mod tests {
    use super::super::{Anchor, TEXT};
    use super::*;

    fn black(width: u32, height: u32) -> Image {
        Image { width, height, rgba: vec![[0, 0, 0, 255]; (width * height) as usize] }
    }

    #[test]
    fn lines_cover_as_much_as_they_are_wide() {
        for (from, to) in [([5.3, 20.0], [45.3, 20.0]), ([10.0, 4.2], [10.0, 44.2]), ([5.0, 5.0], [33.2843, 33.2843])] {
            let mut image = black(50, 50);
            line(&mut image, from, to, 3.0, [255, 255, 255, 255]);
            let light: f32 = image.rgba.iter().map(|pixel| f32::from(pixel[0]) / 255.0).sum();
            // A length of 40, a width of 3, and two round ends.
            assert!((light - (120.0 + 7.07)).abs() < 2.5, "{light}");
        }
    }

    #[test]
    fn letters_are_dark_on_light_paper() {
        assert_eq!(Paper::of(Background::Color(HexColor([250, 250, 240]))), Paper::Light);
        assert_eq!(Paper::of(Background::Color(HexColor([20, 30, 60]))), Paper::Dark);
        let [r, g, b, a] = Paper::Light.ink(TEXT);
        assert!(r < 40 && g < 40 && b < 40 && a == TEXT[3]);
        assert_eq!(Paper::Light.ink(HALO)[..3], [255; 3]);
        // Hues stay what they are.
        assert_eq!(Paper::Light.ink([200, 100, 50, 9]), [205, 105, 55, 9]);
        assert_eq!(Paper::Dark.ink(TEXT), TEXT);
    }

    #[test]
    fn a_level_line_is_sharp() {
        let mut image = black(20, 20);
        line(&mut image, [2.0, 7.3], [18.0, 7.3], 1.0, [255, 255, 255, 255]);
        let rows: Vec<usize> = (0..20).filter(|y| image.rgba[y * 20 + 10][0] > 0).collect();
        assert_eq!(rows.len(), 1);
        assert_eq!(image.rgba[rows[0] * 20 + 10], [255; 4]);
    }

    #[test]
    fn nothing_outside_the_picture_is_touched_or_harmful() {
        let mut image = black(9, 7);
        let mut list = DisplayList::new([9.0, 7.0]);
        list.line([-1e30, f32::NAN], [1e30, 3.0], 5.0, TEXT);
        list.shapes.push(Shape::Circle { center: [-1e9, 1e9], radius: 1e9, width: 1.0, color: TEXT });
        list.shapes.push(Shape::Rect { area: Area { min: [-1e30; 2], max: [1e30; 2] }, color: [1, 2, 3, 255] });
        list.shapes.push(Shape::Mesh { area: Area { min: [0.0; 2], max: [4.0; 2] }, columns: 0, colors: Vec::new() });
        list.shapes.push(Shape::Text {
            at: [-50.0, 3.0],
            anchor: Anchor::LEFT,
            text: "far".into(),
            size: 20.0,
            color: TEXT,
        });
        paint(&mut image, &list, 1.0, Paper::Dark);
        assert!(image.rgba.iter().filter(|pixel| pixel[..3] == [1, 2, 3]).count() > 20);
        paint(&mut Image { width: 3, height: 3, rgba: Vec::new() }, &list, 1.0, Paper::Light);
    }

    #[test]
    fn transparent_pixels_take_the_colour_alone() {
        let mut image = Image { width: 1, height: 1, rgba: vec![[200, 0, 0, 0]] };
        over(&mut image, 0, 0, [10, 20, 30, 255], 0.5);
        assert_eq!(image.rgba[0], [10, 20, 30, 128]);
    }
}
