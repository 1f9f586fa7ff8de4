//! Colour maps as the panel and the overlays need them.

use bevy_egui::egui::Color32;
use colorgrad::Gradient;

/// A colour map, ready to be sampled.
pub struct Palette {
    gradient: Box<dyn Gradient>,
}

impl Palette {
    /// The colour map of that name; the default one for an unknown name.
    pub fn named(name: &str) -> Palette {
        let gradient: Box<dyn Gradient> = match name {
            "viridis" => Box::new(colorgrad::preset::viridis()),
            "magma" => Box::new(colorgrad::preset::magma()),
            _ => Box::new(colorgrad::preset::inferno()),
        };
        Palette { gradient }
    }
    pub fn swatch(&self, t: f32) -> Color32 { let [r,g,b,_] = self.gradient.at(t).to_rgba8(); Color32::from_rgb(r,g,b) }
    pub fn brightness(&self, t: f32) -> Color32 { self.swatch(t) }
    pub fn hue(&self, t: f32) -> Color32 { self.swatch(t) }
}
