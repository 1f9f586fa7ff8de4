//! Transfer functions evaluated at a place of `P` and one of `S`, and baked into tables.

use super::{Hue, TransferFunction};
use crate::color::colormap::Rgb;
use colorgrad::Color;
use rayon::prelude::*;

/// A baked transfer function: brightness along rows, hue down columns, sRGB-encoded.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    /// Brightness steps; texel `i` belongs to brightness `i / (width - 1)`.
    pub width: u32,
    /// Hue steps; texel `j` belongs to `S` at `j / (height - 1)` of its range. 1 without hue.
    pub height: u32,
    /// RGBA8, gamma-encoded (store it as a UNORM texture to sample encoded values), row by row from low `S`.
    pub rgba: Vec<[u8; 4]>,
}

/// What a place of `P` and one of `S` look like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// The colour, gamma-encoded sRGB, as if it were opaque.
    pub color: Rgb,
    /// How opaque it is: for splats how much of it hides the background, for volumes the opacity of a unit length.
    pub opacity: f32,
}

impl TransferFunction {
    /// Brightness steps of a baked table.
    pub const LUT_WIDTH: u32 = 512;
    /// Hue steps of a baked table that has a hue.
    pub const LUT_HEIGHT: u32 = 64;

    /// The brightness at a place of `P`, before the plane's factors.
    pub fn brightness_at(&self, place: f32) -> f32 {
        let place = place.clamp(0.0, 1.0).powf(self.gamma);
        let brightness = self.brightness.as_ref().map_or(place, |curve| curve.at(place));
        if self.reverse { 1.0 - brightness } else { brightness }
    }

    /// The opacity at a place of `P`, before the plane's factors: 1 where no curve is set.
    pub fn opacity_at(&self, place: f32) -> f32 {
        self.opacity.as_ref().map_or(1.0, |curve| curve.at(place))
    }

    /// Appearance at a place of `P` and, where there is a hue, one of `S`, both within [0, 1]. [`TransferFunction::bake_lut`]
    /// tabulates this.
    pub fn appearance(&self, p: f32, s: f32) -> Appearance {
        let colors = self.color_map.sample(COLORS);
        match &self.hue {
            None => self.plain(p, &colors),
            Some(hue) => self.tinted(p, s, hue.color_at(s)),
        }
    }

    fn plain(&self, p: f32, colors: &[Rgb]) -> Appearance {
        let index = (self.brightness_at(p) * (colors.len() - 1) as f32).round() as usize;
        Appearance { color: colors[index.min(colors.len() - 1)], opacity: self.opacity_at(p) }
    }

    fn tinted(&self, p: f32, s: f32, hue: Rgb) -> Appearance {
        let (brightness, opacity) = (self.brightness_at(p), self.opacity_at(p));
        if self.plane.is_plain() {
            return Appearance { color: shade(hue, brightness), opacity };
        }
        let factors = self.plane.factors(p, s);
        let brightness = (brightness * factors.brightness).clamp(0.0, 1.0);
        let hue = factors.dye.mix(hue);
        Appearance { color: shade(hue, brightness), opacity: (opacity * factors.opacity).clamp(0.0, 1.0) }
    }

    /// The table of colours before black.
    pub fn bake_lut(&self) -> Lut {
        self.bake(|Appearance { color: [r, g, b], opacity }| [r * opacity, g * opacity, b * opacity, 1.0])
    }

    /// The table of colours, whatever their opacity.
    pub fn bake_colors(&self) -> Lut {
        self.bake(|Appearance { color: [r, g, b], .. }| [r, g, b, 1.0])
    }

    /// The table of colours with their opacity. Where that is not set, colours are as transparent as they can be and still
    /// the same before black, but for the tint of the dark itself.
    pub fn bake_transparent(&self) -> Lut {
        let has_opacity = self.opacity.is_some() || !self.plane.is_plain();
        // Many maps begin with a colour that is nearly black: where there is nothing, nothing is to be seen.
        let [r, g, b] = self.appearance(0.0, 0.5).color;
        let dark = r.max(g).max(b).min(0.5);
        self.bake(|Appearance { color, opacity }| {
            let [r, g, b] = color;
            let most = r.max(g).max(b);
            match has_opacity {
                true => [r, g, b, opacity],
                false if most > 0.0 => [r / most, g / most, b / most, (most - dark).max(0.0) / (1.0 - dark)],
                false => [0.0; 4],
            }
        })
    }

    fn bake(&self, finish: impl Fn(Appearance) -> [f32; 4] + Sync) -> Lut {
        let bytes = |color: [f32; 4]| color.map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8);
        let width = TransferFunction::LUT_WIDTH;
        let place = |index: u32, count: u32| index as f32 / (count - 1) as f32;
        let Some(hue) = &self.hue else {
            let colors = self.color_map.sample(COLORS);
            let rgba = (0..width).map(|i| bytes(finish(self.plain(place(i, width), &colors)))).collect();
            return Lut { width, height: 1, rgba };
        };
        let height = TransferFunction::LUT_HEIGHT;
        let hues = hue.colors(height as usize);
        let rgba = (0..width * height)
            .into_par_iter()
            .map(|index| {
                let (row, column) = (index / width, index % width);
                bytes(finish(self.tinted(place(column, width), place(row, height), hues[row as usize])))
            })
            .collect();
        Lut { width, height, rgba }
    }
}

impl Hue {
    /// Its colours at evenly spaced places of `S`.
    pub fn colors(&self, count: usize) -> Vec<Rgb> {
        let mut colors = self.color_map.sample_span(self.span, count);
        if self.reverse {
            colors.reverse();
        }
        colors
    }

    /// The colour at a place of `S`.
    pub fn color_at(&self, place: f32) -> Rgb {
        let place = if self.reverse { 1.0 - place } else { place };
        let (from, to) = self.span;
        let at = from + (to - from) * place;
        self.color_map.sample_span((at, at), 1).first().copied().unwrap_or([1.0; 3])
    }
}

/// Colours that a colour map is sampled at.
const COLORS: usize = 4 * TransferFunction::LUT_WIDTH as usize;

/// A colour of the given hue at brightness `b`: lightness follows `b` in Oklab, chroma rises from black, holds, and falls
/// towards white, as far as sRGB reaches.
pub fn shade([r, g, b]: Rgb, brightness: f32) -> Rgb {
    let [_, along_a, along_b, _] = Color::new(r, g, b, 1.0).to_oklaba();
    let lightness = 0.98 * brightness;
    let mut chroma = 0.95 * (4.0 * brightness * (1.0 - brightness)).powf(0.55).min(1.0);
    loop {
        let color = Color::from_oklaba(lightness, chroma * along_a, chroma * along_b, 1.0);
        let rgb = [color.r, color.g, color.b];
        if chroma < 1e-3 || rgb.iter().all(|component| (-1e-3..=1.001).contains(component)) {
            return rgb.map(|component| component.clamp(0.0, 1.0));
        }
        chroma *= 0.94;
    }
}
