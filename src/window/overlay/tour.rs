//! What a tour lays over the picture: words at its foot, and pictures.

use crate::annotate::overlay::{self, Picture, read_png};
use crate::tour::State;
use crate::window::theme;
use bevy_egui::egui::{self, Align2, Color32, ColorImage, Rect, TextureHandle, TextureOptions, pos2, vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Pictures that were read, by path; `None` for those that cannot be.
#[derive(bevy::prelude::Resource, Default)]
pub struct TourPictures(HashMap<PathBuf, Option<TextureHandle>>);

impl TourPictures {
    /// The picture in `folder`, read at its first use; what is wrong with it is said once.
    fn get(&mut self, ctx: &egui::Context, path: PathBuf, tell: &mut dyn FnMut(String)) -> Option<&TextureHandle> {
        let mut read = |path: &Path| match read_png(path) {
            Ok(image) => {
                let size = [image.width as usize, image.height as usize];
                let colors = ColorImage::from_rgba_unmultiplied(size, image.rgba.as_flattened());
                Some(ctx.load_texture(path.display().to_string(), colors, TextureOptions::LINEAR))
            }
            Err(error) => {
                tell(error.to_string());
                None
            }
        };
        self.0.entry(path).or_insert_with_key(|path| read(path)).as_ref()
    }
}

/// Draws it over the picture in `rect`, as in recordings; paths of pictures are named from `folder`.
pub fn draw(
    painter: &egui::Painter,
    rect: Rect,
    state: &State,
    folder: &Path,
    pictures: &mut TourPictures,
    tell: &mut dyn FnMut(String),
) {
    for picture in &state.images {
        if let Some(texture) = pictures.get(painter.ctx(), folder.join(&picture.path), tell) {
            let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
            let white = Color32::WHITE.gamma_multiply(picture.opacity);
            painter.image(texture.id(), place(rect, texture.size_vec2(), picture), whole, white);
        }
    }
    if state.caption.opacity > 0.0 {
        let scale = (rect.height() / 720.0).max(0.25);
        for line in overlay::lines(&state.caption.text, [rect.width() / scale, rect.height() / scale]) {
            let at = rect.min + scale * vec2(line.at[0], line.at[1]);
            let color = Color32::from_rgb(0xf2, 0xf4, 0xf7).gamma_multiply(state.caption.opacity);
            theme::halo_text(painter, at, Align2::CENTER_BOTTOM, line.text, scale * line.em, color);
        }
    }
}

/// Where a picture of so many pixels stands.
fn place(rect: Rect, size: egui::Vec2, how: &Picture) -> Rect {
    let [left, top, width, height] = how.place([rect.width(), rect.height()], [size.x, size.y]);
    Rect::from_min_size(rect.min + vec2(left, top), vec2(width, height))
}
