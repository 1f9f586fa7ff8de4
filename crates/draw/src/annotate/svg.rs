//! A display list as SVG: the same shapes that [`fn@super::paint`] paints, without the halos of letters.

use super::display_list::{Anchor, Area, DisplayList, Rgba, Shape};
use super::number::MINUS;
use super::paint::Paper;
use std::fmt::Write;

/// Where a line of text stands in its box.
const BASELINE: f32 = 0.8;

/// The whole document, as large as the list, on white or black.
pub fn svg(list: &DisplayList, paper: Paper) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_document(&mut out, list, paper);
    out
}

fn write_document(out: &mut String, list: &DisplayList, paper: Paper) -> std::fmt::Result {
    let [width, height] = list.size;
    let behind = if paper == Paper::Light { "white" } else { "black" };
    writeln!(
        out,
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" font-family="sans-serif">"#
    )?;
    writeln!(out, r#"<rect width="100%" height="100%" fill="{behind}"/>"#)?;
    let mut shapes = list.shapes.iter().peekable();
    while let Some(shape) = shapes.next() {
        match shape {
            Shape::Line { from: [x1, y1], to: [x2, y2], width, color } => {
                let ink = ink("stroke", paper.ink(*color));
                writeln!(
                    out,
                    r#"<line x1="{x1:.2}" y1="{y1:.2}" x2="{x2:.2}" y2="{y2:.2}" {ink} stroke-width="{width}"/>"#
                )?;
            }
            Shape::Circle { center: [x, y], radius, width, color } => {
                let ink = ink("stroke", paper.ink(*color));
                writeln!(
                    out,
                    r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius}" fill="none" {ink} stroke-width="{width}"/>"#
                )?;
            }
            Shape::Rect { area, color } => {
                // Neighbours of one colour are one path: tables of many cells stay small.
                write!(out, r#"<path shape-rendering="crispEdges" {} d=""#, ink("fill", paper.ink(*color)))?;
                write_area(out, area)?;
                while let Some(Shape::Rect { area, .. }) =
                    shapes.next_if(|next| matches!(next, Shape::Rect { color: other, .. } if other == color))
                {
                    write_area(out, area)?;
                }
                writeln!(out, r#""/>"#)?;
            }
            Shape::Mesh { area, columns, colors } => write_mesh(out, area, *columns, colors)?,
            Shape::Text { at: [x, _], anchor: Anchor([side, _]), text, size, color } => {
                let area = shape.area();
                let y = area.min[1] + BASELINE * (area.max[1] - area.min[1]);
                let end = ["start", "middle", "end"][(2.0 * *side).round().clamp(0.0, 2.0) as usize];
                let ink = ink("fill", paper.ink(*color));
                let text = escaped(text);
                writeln!(
                    out,
                    r#"<text x="{x:.2}" y="{y:.2}" font-size="{size}" text-anchor="{end}" {ink}>{text}</text>"#
                )?;
            }
        }
    }
    out.push_str("</svg>\n");
    Ok(())
}

/// A rectangle as a part of a path.
fn write_area(out: &mut String, Area { min: [left, top], max: [right, bottom] }: &Area) -> std::fmt::Result {
    let (width, height) = (right - left, bottom - top);
    write!(out, "M{left:.2} {top:.2}h{width:.2}v{height:.2}h{:.2}z", -width)
}

/// A mesh as rectangles between its corners, each of the mean colour of its own.
fn write_mesh(out: &mut String, area: &Area, columns: usize, colors: &[Rgba]) -> std::fmt::Result {
    let rows = colors.len() / columns.max(1);
    if columns < 2 || rows < 2 {
        return Ok(());
    }
    let [width, height] = [0, 1].map(|k| area.max[k] - area.min[k]);
    let place = |column: usize, row: usize| {
        [
            area.min[0] + width * column as f32 / (columns - 1) as f32,
            area.min[1] + height * row as f32 / (rows - 1) as f32,
        ]
    };
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let corners = [0, 1, columns, columns + 1].map(|step| colors[row * columns + column + step]);
            let mean =
                std::array::from_fn(|k| (corners.iter().map(|corner| u32::from(corner[k])).sum::<u32>() / 4) as u8);
            write!(out, r#"<path shape-rendering="crispEdges" {} d=""#, ink("fill", mean))?;
            write_area(out, &Area { min: place(column, row), max: place(column + 1, row + 1) })?;
            writeln!(out, r#""/>"#)?;
        }
    }
    Ok(())
}

/// A colour as the attribute `name`.
fn ink(name: &str, [r, g, b, a]: Rgba) -> String {
    let opacity = if a == 255 { String::new() } else { format!(r#" {name}-opacity="{:.3}""#, f32::from(a) / 255.0) };
    format!(r##"{name}="#{r:02x}{g:02x}{b:02x}"{opacity}"##)
}

/// Text between tags. Only the program's own font lacks the raised minus.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace(MINUS, "\u{207b}")
}

#[cfg(test)]
mod tests {
    use super::super::TEXT;
    use super::*;

    #[test]
    fn shapes_are_elements_and_cells_of_one_colour_are_one_path() {
        let mut list = DisplayList::new([90.0, 60.0]);
        for (step, color) in [(0.0, TEXT), (10.0, TEXT), (20.0, [9, 8, 7, 51])] {
            list.shapes.push(Shape::Rect { area: Area { min: [step, 0.0], max: [step + 10.0, 5.0] }, color });
        }
        list.line([0.0, 1.0], [2.0, 3.0], 1.5, TEXT);
        list.shapes.push(Shape::Circle { center: [4.0; 2], radius: 2.0, width: 1.0, color: TEXT });
        list.text([40.0, 30.0], Anchor::CENTER, "a<b & c", 12.0, TEXT);
        list.shapes.push(Shape::Mesh {
            area: Area { min: [0.0; 2], max: [8.0; 2] },
            columns: 2,
            colors: vec![[40, 0, 0, 255], [0; 4], [0; 4], [0; 4]],
        });
        let text = svg(&list, Paper::Light);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{text}");
        assert!(text.contains(r#"width="90" height="60""#) && text.contains("a&lt;b &amp; c</text>"), "{text}");
        assert_eq!(["<path", "<line", "<circle", "<text"].map(|name| text.matches(name).count()), [3, 1, 1, 1]);
        assert!(text.contains("M0.00 0.00h10.00v5.00h-10.00zM10.00 0.00h"), "{text}");
        assert!(text.contains(r#"fill-opacity="0.200""#) && text.contains(r##"fill="#0a0000""##), "{text}");
        assert!(svg(&list, Paper::Dark).contains(r#"fill="black""#));
    }
}
