//! Colour maps by name. The perceptually uniform ones come first; the curves themselves are colorgrad's.

use colorgrad::{Gradient, preset};
use serde::{Deserialize, Serialize};

/// A colour as sRGB components within [0, 1], gamma-encoded.
pub type Rgb = [f32; 3];

/// A registered colour map.
struct Entry {
    name: &'static str,
    help: &'static str,
    gradient: fn() -> Box<dyn Gradient>,
}

macro_rules! entry {
    ($name:literal, $preset:ident, $help:literal) => {
        Entry { name: $name, help: $help, gradient: || Box::new(preset::$preset()) }
    };
}

const ENTRIES: &[Entry] = &[
    entry!("inferno", inferno, "perceptually uniform: black, purple, orange, pale yellow"),
    entry!("magma", magma, "perceptually uniform: black, purple, pink, cream"),
    entry!("plasma", plasma, "perceptually uniform: blue, magenta, yellow"),
    entry!("viridis", viridis, "perceptually uniform: purple, teal, yellow"),
    entry!("cividis", cividis, "perceptually uniform for colour-blind eyes too: blue, grey, yellow"),
    entry!("cubehelix", cubehelix_default, "black to white through all hues, monotonic in grey"),
    entry!("warm", warm, "purple, red, yellow green; even brightness, good as a hue"),
    entry!("cool", cool, "purple, blue, green; even brightness, good as a hue"),
    entry!("turbo", turbo, "rainbow with few artefacts; not uniform"),
    entry!("spectral", spectral, "diverging: red, yellow, blue"),
    entry!("rd-yl-bu", rd_yl_bu, "diverging: red, pale yellow, blue; star colours backwards"),
    entry!("rd-bu", rd_bu, "diverging: red, white, blue"),
    entry!("greys", greys, "white to black"),
    entry!("sinebow", sinebow, "cyclic: all hues"),
];

/// A colour map, by a name that is known to exist; `inferno` by default.
#[derive(Default, Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ColorMap(usize);

impl ColorMap {
    /// Every map, the perceptually uniform ones first.
    pub fn all() -> impl Iterator<Item = ColorMap> {
        (0..ENTRIES.len()).map(ColorMap)
    }

    /// The map of that name.
    pub fn named(name: &str) -> Option<ColorMap> {
        ENTRIES.iter().position(|entry| entry.name == name).map(ColorMap)
    }

    /// Its name in RON, on the command line and in the panel.
    pub fn name(self) -> &'static str {
        ENTRIES[self.0].name
    }

    /// One line about it.
    pub fn help(self) -> &'static str {
        ENTRIES[self.0].help
    }

    /// Colours at `count` evenly spaced places from 0 to 1 (both included for two or more).
    pub fn sample(self, count: usize) -> Vec<Rgb> {
        self.sample_span((0.0, 1.0), count)
    }

    /// Colours at `count` evenly spaced places of a part of the map, both ends included for two or more.
    pub fn sample_span(self, (from, to): (f32, f32), count: usize) -> Vec<Rgb> {
        let gradient = (ENTRIES[self.0].gradient)();
        (0..count)
            .map(|i| {
                let place = from + (to - from) * i as f32 / (count.max(2) - 1) as f32;
                let color = gradient.at(place.clamp(0.0, 1.0));
                [color.r, color.g, color.b].map(|component| component.clamp(0.0, 1.0))
            })
            .collect()
    }
}

impl std::fmt::Display for ColorMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl TryFrom<String> for ColorMap {
    type Error = String;

    fn try_from(name: String) -> Result<ColorMap, String> {
        ColorMap::named(&name).ok_or_else(|| {
            let names: Vec<&str> = ENTRIES.iter().map(|entry| entry.name).collect();
            format!("no colour map `{name}`, expected one of {}", names.join(", "))
        })
    }
}

impl From<ColorMap> for String {
    fn from(map: ColorMap) -> String {
        map.name().to_owned()
    }
}
