//! The shore: hypsometric colours whose water ends where heights begin to be above 0.

use super::{Range, TransferFunction};
use crate::color::colormap::{ColorMap, HexColor, Stop};
use std::sync::LazyLock;

/// Colours of water from the deepest place to the shore, each with its share of the way.
const WATER: [(f32, [u8; 3]); 3] = [(0.0, [0x1b, 0x3a, 0x6b]), (0.6, [0x3a, 0x7c, 0xa5]), (1.0, [0x8f, 0xbd, 0xd8])];
/// Colours of land from the shore to the highest place.
const LAND: [(f32, [u8; 3]); 6] = [
    (0.0, [0x4f, 0x8f, 0x4f]),
    (0.22, [0xa9, 0xb6, 0x65]),
    (0.45, [0xc9, 0xa6, 0x6b]),
    (0.69, [0x8d, 0x6e, 0x53]),
    (0.88, [0xb8, 0xb0, 0xa8]),
    (1.0, [0xf7, 0xf7, 0xf5]),
];
/// How far water ends before land begins: less than a step of a baked table.
const SHARP: f32 = 1e-5;
/// Neither water nor land has less of the range.
const LEAST: f32 = 2e-3;

/// The colours of heights that have a shore.
static HYPSOMETRIC: LazyLock<Option<TransferFunction>> = LazyLock::new(|| TransferFunction::preset("terrain"));

impl TransferFunction {
    /// Whether it is the preset `terrain`, whatever its range.
    pub fn is_hypsometric(&self) -> bool {
        HYPSOMETRIC.as_ref().is_some_and(|known| TransferFunction { range: Range::Auto, ..self.clone() } == *known)
    }

    /// The same with water below a place of the range and land above it, each spread over its own side; as it is where its colours are not those of
    /// `terrain`.
    #[must_use]
    pub fn with_shore(self, place: f32) -> TransferFunction {
        if !self.is_hypsometric() {
            return self;
        }
        let shore = place.clamp(LEAST, 1.0 - LEAST);
        let water = WATER.iter().map(|(share, color)| (share * (shore - SHARP), HexColor(*color)));
        let land = LAND.iter().map(|(share, color)| (shore + share * (1.0 - shore), HexColor(*color)));
        let stops: Vec<Stop> = water.chain(land).map(|(place, color)| (place.min(1.0), color)).collect();
        match ColorMap::through(stops) {
            Ok(color_map) => TransferFunction { color_map, ..self },
            Err(_) => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_is_below_the_shore_and_land_above_it() {
        let terrain = TransferFunction::preset("terrain").unwrap();
        let is_blue = |[r, g, b]: [f32; 3]| b > g && g > r;
        let is_green = |[r, g, b]: [f32; 3]| g > 1.2 * r && g > 1.2 * b;
        for shore in [0.0, 0.01, 0.3, 0.52, 0.97, 1.0] {
            let own = terrain.clone().with_shore(shore);
            assert!(own != terrain && own.range == terrain.range, "{shore}");
            let at = |place: f32| own.appearance(place, 0.0).color;
            let (below, above) = (shore.min(1.0 - LEAST) - 0.002, shore.max(LEAST) + 0.002);
            if below > 0.002 {
                assert!(is_blue(at(below)) && is_blue(at(0.5 * below)) && is_blue(at(0.0)), "{shore} {:?}", at(below));
                let dark = |color: [f32; 3]| color.iter().sum::<f32>();
                assert!(dark(at(0.0)) < dark(at(below)), "deep water is dark");
            }
            if above < 0.9 {
                assert!(is_green(at(above)), "{shore} {:?}", at(above));
                let snow = at(1.0);
                assert!(snow.iter().all(|part| *part > 0.9), "{snow:?}");
            }
            // It is no more what it was made of.
            assert_eq!(own.clone().with_shore(0.1), own);
        }
        let grey = TransferFunction::preset("grey").unwrap();
        assert_eq!(grey.clone().with_shore(0.5), grey);
        let edited = TransferFunction { gamma: 2.0, ..terrain };
        assert_eq!(edited.clone().with_shore(0.5), edited);
    }
}
