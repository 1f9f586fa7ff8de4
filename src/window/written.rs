//! Heights along lines over a picture that an adapter draws: the processor writes them when the view rests.

use super::sheet::Sheet;
use crate::color::Colors;
use crate::view::View;
use bevy::prelude::*;
use bevy_egui::egui::{self, Color32, TextureHandle, TextureOptions};

/// The heights, as pixels that lie over those of the picture of a view.
#[derive(Resource, Default)]
pub struct WrittenHeights {
    drawn: Option<(View, Colors)>,
    sheet: Sheet,
    /// Whether the sheet shows what is drawn.
    is_uploaded: bool,
}

impl WrittenHeights {
    /// Shows these from now on, or none.
    pub(in crate::window) fn show(&mut self, drawn: Option<(View, Colors)>) {
        (self.drawn, self.is_uploaded) = (drawn, false);
    }

    /// Textures with their places as shares of the picture; none where there is nothing for this view.
    pub fn textures(&mut self, ctx: &egui::Context, view: &View) -> &[(TextureHandle, egui::Rect)] {
        let Some((_, colors)) = self.drawn.as_ref().filter(|(drawn, _)| drawn == view) else { return &[] };
        if !self.is_uploaded {
            let image = colors.image();
            let pixel = |at: usize| {
                let [r, g, b, _] = image.rgba[at];
                if colors.rgba[at][3] > 0.0 { Color32::from_rgb(r, g, b) } else { Color32::TRANSPARENT }
            };
            let size = [colors.width as usize, colors.height as usize];
            self.sheet.fill(ctx, ("heights", TextureOptions::NEAREST), size, pixel);
            self.is_uploaded = true;
        }
        self.sheet.tiles()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;

    #[test]
    fn heights_are_shown_in_the_view_that_they_were_written_for() {
        let ctx = egui::Context::default();
        let around = |height| {
            let bounds = Bounds { min: [0.0; 3].into(), max: [1.0; 3].into() };
            View::around(bounds, 0.8, 64, height).unwrap()
        };
        let mut written = WrittenHeights::default();
        assert!(written.textures(&ctx, &around(48)).is_empty());
        let colors = Colors { width: 64, height: 48, rgba: vec![[0.0, 0.5, 0.0, 1.0]; 64 * 48] };
        written.show(Some((around(48), colors)));
        assert_eq!([48, 50].map(|height| written.textures(&ctx, &around(height)).len()), [1, 0]);
        written.show(None);
        assert!(written.textures(&ctx, &around(48)).is_empty());
    }
}
