//! The letters of heights along lines: those of everything else that is written into pictures.

use crate::annotate::font;
use crate::cpu::surface::labels::Letters;

/// The program's font.
pub(super) struct ProgramFont;

impl Letters for ProgramFont {
    fn width(&self, text: &str, size: f32) -> f32 {
        font::extent(text, size)[0]
    }

    fn write(&self, text: &str, size: f32, middle: [f32; 2], angle: f32, pixel: &mut dyn FnMut(i64, i64, f32)) {
        font::rasterize_turned(text, size, middle, angle, pixel);
    }
}
