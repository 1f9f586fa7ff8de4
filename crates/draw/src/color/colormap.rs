//! Colour maps by name, or made of stops. The perceptually uniform ones come first; most curves are colorgrad's.

use colorgrad::{BlendMode, Color, Gradient, GradientBuilder, LinearGradient, preset};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::sync::Arc;

/// A colour as sRGB components within [0, 1], gamma-encoded.
pub type Rgb = [f32; 3];

/// A registered colour map.
struct Entry {
    name: &'static str,
    help: &'static str,
    gradient: fn() -> Box<dyn Gradient>,
}

/// A colour as it is written: `#rrggbb`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct HexColor(pub [u8; 3]);

impl HexColor {
    /// Its components within [0, 1].
    pub fn rgb(self) -> Rgb {
        self.0.map(|byte| f32::from(byte) / 255.0)
    }
}

impl TryFrom<String> for HexColor {
    type Error = String;

    fn try_from(text: String) -> Result<HexColor, String> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii());
        let number = digits.filter(|digits| digits.chars().all(|c| c.is_ascii_hexdigit()));
        let number = number.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        let [_, r, g, b] = number.ok_or_else(|| format!("`{text}`, expected a colour like \"#ff8000\""))?.to_be_bytes();
        Ok(HexColor([r, g, b]))
    }
}

impl From<HexColor> for String {
    fn from(HexColor([r, g, b]): HexColor) -> String {
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

/// A map through colours at even distances, straight in Oklab: even steps look even.
fn straight(colors: &[[u8; 3]]) -> Box<dyn Gradient> {
    let colors: Vec<Color> = colors.iter().map(|&[r, g, b]| Color::from_rgba8(r, g, b, 255)).collect();
    match GradientBuilder::new().colors(&colors).mode(BlendMode::Oklab).build::<LinearGradient>() {
        Ok(gradient) => Box::new(gradient),
        // Two colours or more always make a gradient; a test samples every map.
        Err(_) => Box::new(preset::greys()),
    }
}

macro_rules! straight {
    ($name:literal, $help:literal, $($color:expr),+) => {
        Entry { name: $name, help: $help, gradient: || straight(&[$($color),+]) }
    };
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
    straight!(
        "glacier",
        "even steps, for colour-blind eyes too: black, deep blue, ice",
        [0, 0, 0],
        [15, 44, 92],
        [38, 107, 173],
        [110, 178, 222],
        [232, 247, 255]
    ),
    straight!(
        "ember",
        "even steps, for colour-blind eyes too: black, brown, amber, cream",
        [0, 0, 0],
        [76, 27, 5],
        [163, 74, 9],
        [232, 146, 48],
        [255, 240, 205]
    ),
    straight!(
        "blue-orange",
        "for colour-blind eyes too, good as a hue: blue, grey, orange",
        [38, 120, 220],
        [128, 128, 132],
        [225, 125, 20]
    ),
    straight!("grey", "black to white in even steps", [0, 0, 0], [255, 255, 255]),
    entry!("cubehelix", cubehelix_default, "black to white through all hues, monotonic in grey"),
    entry!("warm", warm, "purple, red, yellow green; even brightness, good as a hue"),
    entry!("cool", cool, "purple, blue, green; even brightness, good as a hue"),
    entry!("turbo", turbo, "rainbow with few artefacts; not uniform"),
    entry!("spectral", spectral, "diverging: red, yellow, blue"),
    entry!("rd-yl-bu", rd_yl_bu, "diverging: red, pale yellow, blue; star colours backwards"),
    entry!("rd-bu", rd_bu, "diverging: red, white, blue"),
    entry!("greys", greys, "white to black"),
    entry!("sinebow", sinebow, "cyclic: all hues"),
    straight!(
        "hues",
        "cyclic in even steps: all hues, equally light, from blue by red, amber and green to blue",
        [110, 167, 240],
        [135, 160, 241],
        [157, 153, 238],
        [176, 146, 230],
        [193, 140, 217],
        [207, 136, 201],
        [218, 132, 182],
        [226, 131, 161],
        [230, 131, 140],
        [231, 134, 118],
        [227, 139, 98],
        [220, 145, 80],
        [209, 153, 66],
        [194, 161, 62],
        [176, 169, 68],
        [155, 176, 82],
        [131, 182, 102],
        [104, 186, 123],
        [74, 189, 145],
        [42, 189, 167],
        [8, 188, 188],
        [20, 185, 207],
        [53, 180, 222],
        [83, 174, 233],
        [110, 167, 240]
    ),
];

/// A stop of a colour map: its place within [0, 1], and its colour there.
pub type Stop = (f32, HexColor);
/// Stops that a colour map may have.
pub const MOST_STOPS: usize = 64;

/// A colour map: by a name that is known to exist, `inferno` by default, or through stops. In RON a name in quotes, or a list
/// `[(0.0, "#000000"), (1.0, "#ffffff")]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorMap(Kind);

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Named(usize),
    Stops(Arc<[Stop]>),
}

impl Default for ColorMap {
    fn default() -> ColorMap {
        ColorMap(Kind::Named(0))
    }
}

impl ColorMap {
    /// Every map that has a name, the perceptually uniform ones first.
    pub fn all() -> impl Iterator<Item = ColorMap> {
        (0..ENTRIES.len()).map(|index| ColorMap(Kind::Named(index)))
    }

    /// The map of that name.
    pub fn named(name: &str) -> Option<ColorMap> {
        ENTRIES.iter().position(|entry| entry.name == name).map(|index| ColorMap(Kind::Named(index)))
    }

    /// The map through stops in ascending order, mixed in Oklab between them.
    ///
    /// # Errors
    /// What is wrong with them: fewer than two, more than [`MOST_STOPS`], not ascending, or outside [0, 1].
    pub fn through(stops: Vec<Stop>) -> Result<ColorMap, String> {
        if !(2..=MOST_STOPS).contains(&stops.len()) {
            return Err(format!("{} stops, expected 2 to {MOST_STOPS}", stops.len()));
        }
        for (index, (place, _)) in stops.iter().enumerate() {
            if !(0.0..=1.0).contains(place) {
                return Err(format!("stop {} is at {place}, expected a number from 0 to 1", index + 1));
            }
            if index > 0 && stops[index - 1].0 >= *place {
                return Err(format!("stops are not sorted: {} comes before {place}", stops[index - 1].0));
            }
        }
        Ok(ColorMap(Kind::Stops(stops.into())))
    }

    /// Its name in RON, on the command line and in the panel; `stops` for one that has none.
    pub fn name(&self) -> &'static str {
        match &self.0 {
            Kind::Named(index) => ENTRIES[*index].name,
            Kind::Stops(_) => "stops",
        }
    }

    /// One line about it.
    pub fn help(&self) -> &'static str {
        match &self.0 {
            Kind::Named(index) => ENTRIES[*index].help,
            Kind::Stops(_) => "colours of your own",
        }
    }

    /// Its stops, if it is made of them.
    pub fn stops(&self) -> Option<&[Stop]> {
        match &self.0 {
            Kind::Named(_) => None,
            Kind::Stops(stops) => Some(stops),
        }
    }

    /// Colours at `count` evenly spaced places from 0 to 1 (both included for two or more).
    pub fn sample(&self, count: usize) -> Vec<Rgb> {
        self.sample_span((0.0, 1.0), count)
    }

    /// Colours at `count` evenly spaced places of a part of the map, both ends included for two or more.
    pub fn sample_span(&self, (from, to): (f32, f32), count: usize) -> Vec<Rgb> {
        let gradient = match &self.0 {
            Kind::Named(index) => (ENTRIES[*index].gradient)(),
            Kind::Stops(stops) => gradient_of(stops),
        };
        (0..count)
            .map(|i| {
                let place = from + (to - from) * i as f32 / (count.max(2) - 1) as f32;
                let color = gradient.at(place.clamp(0.0, 1.0));
                [color.r, color.g, color.b].map(|component| component.clamp(0.0, 1.0))
            })
            .collect()
    }
}

/// The gradient through stops.
fn gradient_of(stops: &[Stop]) -> Box<dyn Gradient> {
    let colors: Vec<Color> = stops.iter().map(|(_, HexColor([r, g, b]))| Color::from_rgba8(*r, *g, *b, 255)).collect();
    let places: Vec<f32> = stops.iter().map(|stop| stop.0).collect();
    match GradientBuilder::new().colors(&colors).domain(&places).mode(BlendMode::Oklab).build::<LinearGradient>() {
        Ok(gradient) => Box::new(gradient),
        // Stops were checked: there are two or more, in ascending order.
        Err(_) => Box::new(preset::greys()),
    }
}

impl std::fmt::Display for ColorMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for ColorMap {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0 {
            Kind::Named(index) => serializer.serialize_str(ENTRIES[*index].name),
            Kind::Stops(stops) => serializer.collect_seq(stops.iter()),
        }
    }
}

impl<'de> Deserialize<'de> for ColorMap {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<ColorMap, D::Error> {
        deserializer.deserialize_any(ColorMapVisitor)
    }
}

struct ColorMapVisitor;

impl<'de> serde::de::Visitor<'de> for ColorMapVisitor {
    type Value = ColorMap;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the name of a colour map in quotes, or a list of (place, \"#rrggbb\")")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<ColorMap, E> {
        ColorMap::named(name).ok_or_else(|| {
            let names: Vec<&str> = ENTRIES.iter().map(|entry| entry.name).collect();
            E::custom(format!("no colour map `{name}`, expected one of {}", names.join(", ")))
        })
    }

    fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut list: A) -> Result<ColorMap, A::Error> {
        let mut stops = Vec::new();
        while let Some(stop) = list.next_element::<Stop>()? {
            stops.push(stop);
            if stops.len() > MOST_STOPS {
                break;
            }
        }
        ColorMap::through(stops).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ron_file;

    #[test]
    fn every_map_has_colours_and_a_name_of_its_own() {
        let names: Vec<&str> = ColorMap::all().map(|map| map.name()).collect();
        for (index, map) in ColorMap::all().enumerate() {
            assert!(!names[..index].contains(&map.name()));
            let colors = map.sample(33);
            assert!(colors.windows(2).any(|pair| pair[0] != pair[1]), "{map}");
            assert_eq!(ColorMap::named(map.name()), Some(map));
        }
    }

    #[test]
    fn even_maps_have_even_steps_of_lightness() {
        for name in ["glacier", "ember", "grey"] {
            let colors = ColorMap::named(name).unwrap().sample(17);
            let lightness: Vec<f32> = colors.iter().map(|&[r, g, b]| Color::new(r, g, b, 1.0).to_oklaba()[0]).collect();
            let steps: Vec<f32> = lightness.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let mean = (lightness[16] - lightness[0]) / 16.0;
            assert!(steps.iter().all(|step| (step / mean - 1.0).abs() < 0.45), "{name}: {steps:?}");
        }
    }

    #[test]
    fn hues_go_round_in_even_steps_and_are_equally_light() {
        let colors = ColorMap::named("hues").unwrap().sample(49);
        assert!((0..3).all(|k| (colors[0][k] - colors[48][k]).abs() < 1e-5), "{colors:?}");
        let lab: Vec<[f32; 4]> = colors.iter().map(|&[r, g, b]| Color::new(r, g, b, 1.0).to_oklaba()).collect();
        assert!(lab.iter().all(|color| (color[0] - lab[0][0]).abs() < 0.005), "{lab:?}");
        let step = |pair: &[[f32; 4]]| (pair[1][1] - pair[0][1]).hypot(pair[1][2] - pair[0][2]);
        let steps: Vec<f32> = lab.windows(2).map(step).collect();
        let mean = steps.iter().sum::<f32>() / 48.0;
        assert!(mean > 0.01 && steps.iter().all(|step| (step / mean - 1.0).abs() < 0.2), "{steps:?}");
    }

    #[test]
    fn stops_are_read_written_and_refused() {
        let read = |text: &str| ron_file::parse::<ColorMap>("m.ron", text);
        let map = read("[(0.0, \"#000000\"), (0.25, \"#ff8000\"), (1.0, \"#ffffff\")]").unwrap();
        assert_eq!(read(&ron::to_string(&map).unwrap()).unwrap(), map);
        let colors = map.sample(5);
        assert!((colors[1][1] - 128.0 / 255.0).abs() < 0.01 && colors[1][2] < 0.02, "{colors:?}");
        assert_eq!(read("\"magma\"").unwrap().name(), "magma");
        for (text, expected) in [
            ("[(0.0, \"#000000\")]", "1 stops, expected 2 to 64"),
            ("[(0.5, \"#000000\"), (0.5, \"#ffffff\")]", "not sorted: 0.5"),
            ("[(0.5, \"#000000\"), (1.5, \"#ffffff\")]", "stop 2 is at 1.5"),
            ("[(0.5, \"#0000\"), (0.6, \"#ffffff\")]", "`#0000`, expected a colour"),
            ("\"infern\"", "no colour map `infern`"),
            ("3", "colour map in quotes"),
        ] {
            let found = read(text).unwrap_err().to_string();
            assert!(found.contains(expected), "{text}: {found}");
        }
    }
}
