//! How degrees become places in the world: maps by their names, and the bodies and ellipsoids that they are of.

use crate::cpu::surface::placed::Map;
use crate::heights::model::{Globe, HeightGrid, units};
use crate::model::Unit;

/// What the setting `map` may be.
pub(super) const MAPS: [&str; 15] = [
    "automatic",
    "plate",
    "local",
    "globe",
    "globe:earth",
    "globe:wgs84",
    "globe:grs80",
    "globe:moon",
    "globe:mars",
    "globe:mercury",
    "globe:venus",
    "globe:titan",
    "globe:ganymede",
    "globe:ceres",
    "globe:pluto",
];

/// Mean radii of bodies, metres (IAU working group on cartographic coordinates, 2015).
const BODIES: [(&str, f64); 9] = [
    ("earth", 6_371_008.8),
    ("moon", 1_737_400.0),
    ("mars", 3_389_500.0),
    ("mercury", 2_439_400.0),
    ("venus", 6_051_800.0),
    ("titan", 2_575_150.0),
    ("ganymede", 2_631_200.0),
    ("ceres", 469_700.0),
    ("pluto", 1_188_300.0),
];

/// Ellipsoids, metres (EPSG 7030, 7019), and reference systems of longitude and latitude on them.
const ELLIPSOIDS: [(&str, Globe, &[&str]); 2] = [
    ("wgs84", Globe { equator: 6_378_137.0, pole: 6_356_752.314_245_179 }, &["EPSG:4326", "EPSG:4979"]),
    ("grs80", Globe { equator: 6_378_137.0, pole: 6_356_752.314_140_356 }, &["EPSG:4258", "EPSG:4269", "EPSG:4283"]),
];

/// Fields in degrees that are at least so wide are a globe unless they are told otherwise.
const GLOBE_FROM: f64 = 20.0;

/// How a grid's places become places in the world, where a setting says `name`.
pub(super) fn map_of(name: &str, grid: &HeightGrid) -> Result<Map, String> {
    let is_degrees = units::is_degrees(&grid.xy_unit);
    let unit = units::metres(&grid.height_unit).unwrap_or(1.0);
    let radius =
        |body: &str| BODIES.iter().find(|(name, _)| *name == body).map_or(BODIES[0].1, |(_, metres)| *metres) / unit;
    let ellipsoid = |body: &str| ELLIPSOIDS.iter().find(|(name, _, _)| *name == body);
    let globe = |body: &str| match ellipsoid(body) {
        Some((_, globe, _)) => globe.in_unit(unit),
        None => Globe::sphere(radius(body)),
    };
    // The one that the reference system of a file is of.
    let of_file = || {
        let found =
            ELLIPSOIDS.iter().find(|(_, _, systems)| grid.crs.as_deref().is_some_and(|crs| systems.contains(&crs)));
        found.map(|(name, _, _)| globe(name))
    };
    let extent = grid.step[0].abs() * (grid.columns - 1) as f64;
    let down = grid.step[1].abs() * (grid.rows - 1) as f64;
    match name.split_once(':').unwrap_or((name, "earth")) {
        ("plate", _) => Ok(Map::Plate),
        ("automatic", _) if !is_degrees => Ok(Map::Plate),
        ("automatic", _) if extent.max(down) < GLOBE_FROM => Ok(Map::Local { radius: radius("earth") }),
        ("automatic" | "globe", _) if is_degrees && !name.contains(':') => {
            Ok(Map::Globe(of_file().unwrap_or(globe("earth"))))
        }
        (kind, _) if !is_degrees => {
            let named = |unit: &Unit| if unit.is_unknown() { "no unit".to_owned() } else { unit.to_string() };
            let found = format!("x and y in {}, heights in {}", named(&grid.xy_unit), named(&grid.height_unit));
            Err(format!("map {kind}: found {found}, expected x and y in degrees (--xy-unit deg), or map plate"))
        }
        ("local", body) => Ok(Map::Local { radius: radius(body) }),
        (_, body) => Ok(Map::Globe(globe(body))),
    }
}

/// The radius in metres of the body that a map places a grid's degrees on; `None` where it is `plate`.
///
/// # Errors
/// A map that is not known, or that does not fit the grid's units.
pub fn radius_of(name: &str, grid: &HeightGrid) -> Result<Option<f64>, String> {
    if !MAPS.contains(&name) {
        return Err(format!("map: found {name}, expected one of {}", MAPS.join(", ")));
    }
    let metres = units::metres(&grid.height_unit).unwrap_or(1.0);
    Ok(match map_of(name, grid)? {
        Map::Plate => None,
        Map::Local { radius } => Some(radius * metres),
        Map::Globe(globe) => Some((2.0 * globe.equator + globe.pole) / 3.0 * metres),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    #[test]
    fn degrees_are_a_globe_from_twenty_on() {
        let grid = |columns: u64, unit: &str| HeightGrid {
            xy_unit: Unit::new(unit),
            height_unit: Unit::new("km"),
            ..HeightGrid::new(columns, 5, SampleType::F32)
        };
        assert_eq!(map_of("automatic", &grid(30, "m")), Ok(Map::Plate));
        assert_eq!(map_of("automatic", &grid(10, "deg")), Ok(Map::Local { radius: 6371.0088 }));
        assert_eq!(map_of("automatic", &grid(21, "deg")), Ok(Map::Globe(Globe::sphere(6371.0088))));
        assert_eq!(map_of("globe:moon", &grid(4, "deg")), Ok(Map::Globe(Globe::sphere(1737.4))));
        assert_eq!(
            map_of("globe:moon", &grid(4, "")),
            Err("map globe: found x and y in no unit, heights in km, expected x and y in degrees (--xy-unit deg), or map plate".into())
        );
        assert!(MAPS.iter().all(|name| map_of(name, &grid(4, "deg")).is_ok()));
    }
}
