//! A transparent picture that lies over the picture, as textures of egui: in parts, where it is larger than a texture can be.

use bevy_egui::egui::{self, Color32, ColorImage, TextureHandle, TextureOptions};

/// A picture in parts that textures can hold, each with its place as a share of the picture.
#[derive(Default)]
pub struct Sheet {
    tiles: Vec<(TextureHandle, egui::Rect)>,
}

impl Sheet {
    /// Shows these pixels from now on; `name` is what textures are called.
    pub fn fill(
        &mut self,
        ctx: &egui::Context,
        (name, options): (&str, TextureOptions),
        [width, height]: [usize; 2],
        pixel: impl Fn(usize) -> Color32,
    ) {
        let parts = parts([width, height], ctx.input(|input| input.max_texture_side));
        self.tiles.truncate(parts.len());
        for (index, [left, top, right, bottom]) in parts.into_iter().enumerate() {
            let rows = (top..bottom).flat_map(|y| y * width + left..y * width + right);
            let image = ColorImage::new([right - left, bottom - top], rows.map(&pixel).collect());
            let share = |x: usize, y: usize| egui::pos2(x as f32 / width as f32, y as f32 / height as f32);
            let place = egui::Rect::from_min_max(share(left, top), share(right, bottom));
            match self.tiles.get_mut(index) {
                Some((texture, known)) => {
                    texture.set(image, options);
                    *known = place;
                }
                None => self.tiles.push((ctx.load_texture(format!("{name} {index}"), image, options), place)),
            }
        }
    }

    /// The parts.
    pub fn tiles(&self) -> &[(TextureHandle, egui::Rect)] {
        &self.tiles
    }
}

/// Paints parts into a picture that stands at `rect`.
pub fn paint(painter: &egui::Painter, rect: egui::Rect, tiles: &[(TextureHandle, egui::Rect)]) {
    let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
    for (texture, place) in tiles {
        let at = |share: egui::Pos2| rect.lerp_inside(share.to_vec2());
        let part = egui::Rect::from_min_max(at(place.min), at(place.max));
        painter.image(texture.id(), part, whole, Color32::WHITE);
    }
}

/// A picture of that size in parts of at most `side` pixels a side: left, top, right and bottom of each.
fn parts([width, height]: [usize; 2], side: usize) -> Vec<[usize; 4]> {
    let side = side.max(1);
    let part = |x: usize, y: usize| [x, y, width.min(x + side), height.min(y + side)];
    (0..height).step_by(side).flat_map(|y| (0..width).step_by(side).map(move |x| part(x, y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_pictures_are_shown_in_parts_that_textures_hold() {
        for size in [[1, 1], [2048, 2048], [2720, 2160], [5000, 3]] {
            let all = parts(size, 2048);
            let pixels: usize = all.iter().map(|[left, top, right, bottom]| (right - left) * (bottom - top)).sum();
            assert_eq!(pixels, size[0] * size[1]);
            assert!(all.iter().all(|[left, top, right, bottom]| right - left <= 2048 && bottom - top <= 2048));
        }
        let ctx = egui::Context::default();
        let mut sheet = Sheet::default();
        sheet.fill(&ctx, ("test", TextureOptions::NEAREST), [2720, 2160], |_| Color32::from_rgb(1, 2, 3));
        let share: f32 = sheet.tiles().iter().map(|(_, place)| place.area()).sum();
        assert!(sheet.tiles().len() >= 4 && (share - 1.0).abs() < 1e-5, "{} {share}", sheet.tiles().len());
    }
}
