//! Words and logos of a tour on an output: on a flat screen among the directions that it displays, where recordings have it.

use super::Bent;
use crate::annotate::overlay::{Overlay, OverlayError};
use crate::color::Image;
use crate::tour::State;
use bevy_egui::egui::{self, Color32, ColorImage, TextureHandle, TextureOptions};
use std::path::{Path, PathBuf};

/// Rows of the screen.
const ROWS: u32 = 720;
/// The most columns.
const MOST: f64 = 4096.0;
/// Steps of what fades in and out: each is painted anew.
const STEPS: f32 = 16.0;

/// What is written at present.
#[derive(Default)]
pub(crate) struct Words {
    written: Option<(Overlay, PathBuf, u32)>,
    texture: Option<TextureHandle>,
}

impl Words {
    /// The screen with what a tour writes at a moment, in a texture of `aspect` times its height; `None` where there is nothing.
    ///
    /// # Errors
    /// Once, where a picture cannot be read.
    pub fn write(
        &mut self,
        ctx: &egui::Context,
        state: &State,
        folder: &Path,
        aspect: f64,
    ) -> Result<Option<&TextureHandle>, OverlayError> {
        let step = |opacity: f32| (opacity * STEPS).ceil() / STEPS;
        let mut overlay = Overlay {
            caption: state.caption.text.clone(),
            caption_opacity: step(state.caption.opacity),
            images: state.images.clone(),
        };
        overlay.images.iter_mut().for_each(|image| image.opacity = step(image.opacity));
        if overlay.is_empty() {
            return Ok(None);
        }
        let columns = (f64::from(ROWS) * aspect).round().clamp(1.0, MOST) as u32;
        let wanted = (overlay, folder.to_owned(), columns);
        if self.written.as_ref() != Some(&wanted) {
            let painted = painted(&wanted.0, folder, [columns, ROWS]);
            // What cannot be painted is not tried again before something else is to be written.
            self.written = Some(wanted);
            self.texture = None;
            self.texture = Some(ctx.load_texture("words", painted?, TextureOptions::LINEAR));
        }
        Ok(self.texture.as_ref())
    }
}

/// What an overlay hides is how different it looks on black and on white.
fn painted(overlay: &Overlay, folder: &Path, [width, height]: [u32; 2]) -> Result<ColorImage, OverlayError> {
    let mut papers = [0u8, 255].map(|grey| {
        let rgba = vec![[grey, grey, grey, 255]; width as usize * height as usize];
        Image { width, height, rgba }
    });
    for paper in &mut papers {
        overlay.paint(paper, folder)?;
    }
    let [black, white] = papers;
    let pixels = black.rgba.iter().zip(&white.rgba).map(|(&[r, g, b, _], on_white)| {
        let through = on_white[1].saturating_sub(g);
        Color32::from_rgba_premultiplied(r, g, b, 255 - through)
    });
    Ok(ColorImage::new([width as usize, height as usize], pixels.collect()))
}

/// The output's mesh with the screen on it.
pub(crate) fn lay(bent: &Bent, texture: &TextureHandle, window: egui::Rect) -> egui::Mesh {
    let mut mesh = egui::Mesh::with_texture(texture.id());
    let sheet = bent.projector.sheet(bent.fov_y);
    let [columns, rows] = [bent.mesh.columns, bent.mesh.rows];
    let mut places = Vec::with_capacity(bent.mesh.points.len());
    for i in 0..columns * rows {
        let at = [(i % columns, columns), (i / columns, rows)]
            .map(|(k, count)| f64::from(k) / f64::from((count - 1).max(1)));
        let place = bent.projector.direction(at, bent.fov_y).and_then(|direction| sheet.place(direction));
        let [u, v] = place.unwrap_or([-1.0; 2]);
        let pos = window.lerp_inside(egui::vec2(at[0] as f32, at[1] as f32));
        mesh.vertices.push(egui::epaint::Vertex { pos, uv: egui::pos2(u as f32, v as f32), color: Color32::WHITE });
        places.push(place);
    }
    for cell in bent.mesh.cells() {
        let corners = cell.map(|at| places[at as usize]);
        let inside =
            |place: &Option<[f64; 2]>| place.is_some_and(|place| place.iter().all(|x| (0.0..=1.0).contains(x)));
        // Edges of the screen are empty, so what lies beyond may repeat them.
        if corners.iter().all(Option::is_some) && corners.iter().any(inside) {
            let [a, b, c, d] = cell;
            mesh.indices.extend([a, b, c, b, d, c]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_hide_what_is_below_them_and_nothing_else() {
        let overlay = Overlay { caption: "Words".into(), caption_opacity: 1.0, images: Vec::new() };
        let image = painted(&overlay, Path::new(""), [1280, 720]).unwrap();
        let letters = image.pixels.iter().filter(|pixel| pixel.a() > 200 && pixel.r() > 180).count();
        let empty = image.pixels[..1280 * 600].iter().all(|pixel| *pixel == Color32::TRANSPARENT);
        assert!(letters > 20 && empty, "{letters}");
        let faded = Overlay { caption_opacity: 0.5, ..overlay };
        let faded = painted(&faded, Path::new(""), [1280, 720]).unwrap();
        let most = |image: &ColorImage| image.pixels.iter().map(|pixel| i32::from(pixel.a())).max().unwrap_or(0);
        assert!((2 * most(&faded) - most(&image)).abs() <= 3, "{} {}", most(&faded), most(&image));
    }
}
