//! Units of lengths as height fields have them.

use deepfield_data::model::Unit;

/// Names and metres.
const LENGTHS: [(&str, f64); 5] = [("km", 1e3), ("m", 1.0), ("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9)];

/// The unit's length in metres; `None` for degrees, and where it is unknown.
pub fn metres(unit: &Unit) -> Option<f64> {
    LENGTHS.iter().find(|(name, _)| *name == unit.0).map(|(_, length)| *length)
}

/// Whether places are in degrees of longitude and latitude.
pub fn is_degrees(unit: &Unit) -> bool {
    unit.0 == "deg"
}

/// A unit by any of the names that files have for it (`µm`, `metre`, `micrometers`, `degrees_east`), under its name here; `None` where it is
/// no length and no angle that is known.
pub fn known(name: &str) -> Option<Unit> {
    let name = name.trim().trim_end_matches('\0').trim().to_lowercase();
    let found = match name.as_str() {
        "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => "km",
        "m" | "meter" | "meters" | "metre" | "metres" => "m",
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => "mm",
        "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" | "micrometer" | "micrometers" | "micrometre"
        | "micrometres" => "um",
        "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => "nm",
        "deg" | "degree" | "degrees" | "\u{b0}" | "degrees_east" | "degrees_north" | "degree_east" | "degree_north" => {
            "deg"
        }
        _ => return None,
    };
    Some(Unit::new(found))
}
