//! A contact sheet: pictures side by side with captions under them.

use crate::color::composite::Image;
use font8x8::{BASIC_FONTS, UnicodeFonts};

/// Width and height of a letter, before it is enlarged.
const LETTER: u32 = 8;
/// Space around pictures and captions, pixels.
const GAP: u32 = 8;
/// Behind everything.
const PAPER: [u8; 4] = [24, 24, 27, 255];
/// Captions.
const INK: [u8; 4] = [228, 228, 231, 255];

/// A picture and the lines under it; characters beyond Latin letters and signs are left out.
#[derive(Clone, Debug)]
pub struct Entry<'a> {
    /// The picture.
    pub image: &'a Image,
    /// The lines, from above.
    pub caption: Vec<String>,
}

/// Puts entries into rows of `columns`. Cells are as large as the largest picture; letters are enlarged to the picture's size, and
/// captions cut where a picture ends.
pub fn sheet(entries: &[Entry<'_>], columns: u32) -> Image {
    let columns = columns.clamp(1, entries.len().max(1) as u32);
    let rows = (entries.len() as u32).div_ceil(columns);
    let most = |of: fn(&Entry<'_>) -> u32| entries.iter().map(of).max().unwrap_or(0);
    let cell = [most(|entry| entry.image.width), most(|entry| entry.image.height)];
    let scale = (cell[0] / 300).clamp(1, 4);
    let line = (LETTER + 3) * scale;
    let caption = most(|entry| entry.caption.len() as u32) * line;
    let (step_x, step_y) = (cell[0] + GAP, cell[1] + caption + 2 * GAP);
    let (width, height) = (columns * step_x + GAP, rows * step_y + GAP);
    let mut out = Image { width, height, rgba: vec![PAPER; width as usize * height as usize] };
    for (index, entry) in (0u32..).zip(entries) {
        let corner = [GAP + index % columns * step_x, GAP + index / columns * step_y];
        for (y, row) in (corner[1]..).zip(entry.image.rgba.chunks(entry.image.width.max(1) as usize)) {
            let start = (y * width + corner[0]) as usize;
            out.rgba[start..start + row.len()].copy_from_slice(row);
        }
        for (number, text) in (0u32..).zip(&entry.caption) {
            let top = corner[1] + cell[1] + GAP / 2 + number * line;
            write(&mut out, [corner[0], top], scale, cell[0] / (LETTER * scale), text);
        }
    }
    out
}

/// Writes a line of up to `most` letters; what would be outside the picture is left out.
fn write(out: &mut Image, [left, top]: [u32; 2], scale: u32, most: u32, text: &str) {
    for (place, letter) in (0..most).zip(text.chars()) {
        let Some(rows) = BASIC_FONTS.get(letter) else { continue };
        for index in 0..LETTER * LETTER * scale * scale {
            let [x, y] = [index % (LETTER * scale), index / (LETTER * scale)];
            let [at_x, at_y] = [left + place * LETTER * scale + x, top + y];
            if rows[(y / scale) as usize] >> (x / scale) & 1 == 1 && at_x < out.width && at_y < out.height {
                out.rgba[(at_y * out.width + at_x) as usize] = INK;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_side_by_side_over_their_captions() {
        let image = |width: u32, height: u32, color: u8| Image {
            width,
            height,
            rgba: vec![[color, 0, 0, 255]; (width * height) as usize],
        };
        let images = [image(40, 30, 1), image(40, 30, 2), image(20, 10, 3)];
        let caption = || vec!["volume".to_owned(), "a caption that is longer than its picture \u{1f600}".to_owned()];
        let entries: Vec<Entry<'_>> = images.iter().map(|image| Entry { image, caption: caption() }).collect();
        let out = sheet(&entries, 2);
        assert_eq!((out.width, out.height), (2 * 48 + 8, 2 * (30 + 22 + 16) + 8));
        for (color, count) in [(1, 1200), (2, 1200), (3, 200)] {
            assert_eq!(out.rgba.iter().filter(|pixel| pixel[0] == color && pixel[1] == 0).count(), count);
        }
        assert!(out.rgba.iter().filter(|pixel| **pixel == INK).count() > 100);
        assert_eq!(sheet(&[], 3).rgba.len(), 16 * 8);
    }
}
