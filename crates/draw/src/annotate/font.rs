//! The font of all words in pictures and in the window: how wide they are, and their glyphs.

use ab_glyph::{Font, FontRef, Glyph, GlyphId, Outline, OutlineCurve, OutlinedGlyph, Point, Rect, ScaleFont, point};
use std::sync::OnceLock;

/// The font, and those that have what it lacks, in the order of the window's user interface.
fn fonts() -> &'static [FontRef<'static>] {
    static FONTS: OnceLock<Vec<FontRef<'static>>> = OnceLock::new();
    FONTS.get_or_init(|| {
        use epaint_default_fonts::{EMOJI_ICON, NOTO_EMOJI_REGULAR, UBUNTU_LIGHT};
        // They are embedded, so none is refused; a test reads them.
        [UBUNTU_LIGHT, NOTO_EMOJI_REGULAR, EMOJI_ICON]
            .into_iter()
            .filter_map(|data| FontRef::try_from_slice(data).ok())
            .collect()
    })
}

/// The font that has a letter, the first one if none has.
fn font_of(letter: char) -> Option<(&'static FontRef<'static>, GlyphId)> {
    let found = fonts().iter().map(|font| (font, font.glyph_id(letter))).find(|(_, id)| id.0 != 0);
    found.or_else(|| fonts().first().map(|font| (font, font.glyph_id(letter))))
}

/// The letters of a text that no font has, each once: a box stands for them in pictures.
pub fn lacking(text: &str) -> String {
    let mut lacking = String::new();
    for letter in text.chars().filter(|letter| !letter.is_control()) {
        if !lacking.contains(letter) && fonts().iter().all(|font| font.glyph_id(letter).0 == 0) {
            lacking.push(letter);
        }
    }
    lacking
}

/// A font's own scale where an em has `size` pixels.
fn scale(font: &FontRef<'_>, size: f32) -> f32 {
    size * font.height_unscaled() / font.units_per_em().unwrap_or(1000.0)
}

/// Width and height of a line of text, where an em has `size` pixels.
pub fn extent(text: &str, size: f32) -> [f32; 2] {
    let advance = |(font, id): (&FontRef<'static>, GlyphId)| font.as_scaled(scale(font, size)).h_advance(id);
    let width = text.chars().filter_map(font_of).map(advance).sum();
    let height = fonts().first().map_or(size, |font| font.as_scaled(scale(font, size)).height());
    [width, height]
}

/// The text, with its end cut off where it is wider than `width`; `None` where not even a letter fits.
pub fn cut(text: &str, size: f32, width: f32) -> Option<String> {
    if extent(text, size)[0] <= width {
        return Some(text.to_owned());
    }
    let letters: Vec<char> = text.chars().collect();
    (1..letters.len())
        .rev()
        .map(|count| letters[..count].iter().collect::<String>() + "…")
        .find(|shorter| extent(shorter, size)[0] <= width)
}

/// Calls `pixel` with place and coverage (0 to 1) of each pixel of a text whose box begins at `[left, top]`, all in physical
/// pixels.
pub fn rasterize(text: &str, size: f32, [left, top]: [f32; 2], mut pixel: impl FnMut(i64, i64, f32)) {
    let Some(first) = fonts().first() else { return };
    let baseline = top + first.as_scaled(scale(first, size)).ascent();
    let mut x = left;
    for (font, id) in text.chars().filter_map(font_of) {
        let scale = scale(font, size);
        let glyph = Glyph { id, scale: scale.into(), position: ab_glyph::point(x, baseline) };
        x += font.as_scaled(scale).h_advance(id);
        let Some(outline) = font.outline_glyph(glyph) else { continue };
        let corner = outline.px_bounds().min;
        let corner = [corner.x as i64, corner.y as i64];
        outline.draw(|dx, dy, coverage| pixel(corner[0] + i64::from(dx), corner[1] + i64::from(dy), coverage));
    }
}

/// As [`rasterize`], of a text whose box has its middle at `middle` and is turned about it: by `angle`, radians clockwise.
pub fn rasterize_turned(text: &str, size: f32, middle: [f32; 2], angle: f32, mut pixel: impl FnMut(i64, i64, f32)) {
    let Some(first) = fonts().first() else { return };
    let [width, height] = extent(text, size);
    let (sin, cos) = angle.sin_cos();
    // From the middle of the box to the right and down.
    let mut pen = -0.5 * width;
    let baseline = first.as_scaled(scale(first, size)).ascent() - 0.5 * height;
    for (font, id) in text.chars().filter_map(font_of) {
        let scaled = font.as_scaled(scale(font, size));
        let position = point(middle[0] + cos * pen - sin * baseline, middle[1] + sin * pen + cos * baseline);
        pen += scaled.h_advance(id);
        let Some(outline) = font.outline(id).map(|outline| turned(outline, sin, cos)) else { continue };
        let glyph = Glyph { id, scale: scale(font, size).into(), position };
        let outline = OutlinedGlyph::new(glyph, outline, scaled.scale_factor());
        let corner = outline.px_bounds().min;
        let corner = [corner.x as i64, corner.y as i64];
        outline.draw(|dx, dy, coverage| pixel(corner[0] + i64::from(dx), corner[1] + i64::from(dy), coverage));
    }
}

/// An outline, which counts upwards, turned clockwise about its origin.
fn turned(outline: Outline, sin: f32, cos: f32) -> Outline {
    let turn = |at: Point| point(cos * at.x + sin * at.y, cos * at.y - sin * at.x);
    let curves: Vec<OutlineCurve> = outline
        .curves
        .into_iter()
        .map(|curve| match curve {
            OutlineCurve::Line(a, b) => OutlineCurve::Line(turn(a), turn(b)),
            OutlineCurve::Quad(a, b, c) => OutlineCurve::Quad(turn(a), turn(b), turn(c)),
            OutlineCurve::Cubic(a, b, c, d) => OutlineCurve::Cubic(turn(a), turn(b), turn(c), turn(d)),
        })
        .collect();
    // Curves lie within the corners of what holds them, which are given from the top left to the bottom right.
    let Rect { min, max } = outline.bounds;
    let corners = [min, max, point(min.x, max.y), point(max.x, min.y)].map(turn);
    let ends = |of: fn(Point) -> f32| {
        corners
            .iter()
            .map(|corner| of(*corner))
            .fold([f32::MAX, f32::MIN], |[low, high], at| [low.min(at), high.max(at)])
    };
    let ([left, right], [bottom, top]) = (ends(|at| at.x), ends(|at| at.y));
    Outline { bounds: Rect { min: point(left, top), max: point(right, bottom) }, curves }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turned text has as much ink as a level one, in a box that is turned.
    #[test]
    fn turned_glyphs_lie_in_their_turned_box() {
        let text = "−1250.5";
        let [width, height] = extent(text, 40.0);
        let mut level = 0.0;
        rasterize(text, 40.0, [0.0; 2], |_, _, coverage| level += coverage);
        for step in 0..24 {
            let angle = std::f32::consts::TAU * step as f32 / 24.0 + 0.01;
            let (sin, cos) = angle.sin_cos();
            let mut ink = 0.0;
            rasterize_turned(text, 40.0, [3.25, -7.5], angle, |x, y, coverage| {
                ink += coverage;
                let away = [x as f32 + 0.5 - 3.25, y as f32 + 0.5 + 7.5];
                let at = [cos * away[0] + sin * away[1], cos * away[1] - sin * away[0]];
                let is_in = at[0].abs() < 0.5 * width + 1.0 && at[1].abs() < 0.5 * height + 1.0;
                assert!(coverage < 0.02 || is_in, "{at:?} at {angle}");
            });
            assert!((ink / level - 1.0).abs() < 0.02, "{ink} of {level} at {angle}");
        }
    }

    #[test]
    fn the_font_has_what_numbers_and_units_need() {
        assert_eq!(fonts().len(), 3);
        for letter in "0123456789.−×⁰¹²³⁴⁵⁶⁷⁸⁹¯…–·/() kpcMsun".chars() {
            assert_ne!(fonts()[0].glyph_id(letter).0, 0, "{letter}");
        }
        assert_eq!(lacking("Sterne über Köln\n★ Ωξ Звезда, 星と星"), "星と");
    }

    #[test]
    fn text_grows_with_its_size_and_is_cut_to_a_width() {
        let [width, height] = extent("Column density", 13.0);
        assert!((70.0..110.0).contains(&width) && (12.0..20.0).contains(&height), "{width} {height}");
        assert!((extent("Column density", 26.0)[0] - 2.0 * width).abs() < 0.1);
        let short = cut("Column density", 13.0, 50.0).unwrap();
        assert!(short.ends_with('…') && extent(&short, 13.0)[0] <= 50.0);
        assert_eq!(cut("Column density", 13.0, 1.0), None);
    }

    #[test]
    fn glyphs_lie_in_their_box() {
        let [width, height] = extent("Ågjy|", 40.0);
        let mut ink = 0.0;
        rasterize("Ågjy|", 40.0, [10.0, 20.0], |x, y, coverage| {
            ink += coverage;
            if coverage > 0.02 {
                assert!((9.0..11.0 + width).contains(&(x as f32)) && (19.0..21.0 + height).contains(&(y as f32)));
            }
        });
        assert!(ink > 100.0);
    }
}
