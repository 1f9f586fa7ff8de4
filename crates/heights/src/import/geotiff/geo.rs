//! What GeoTIFF (OGC 19-008) and GDAL say of an image: where it is, in which unit, and which value stands for none.

use super::directory::Directory;
use super::tag;
use crate::import::NoData;
use crate::import::content::Content;
use crate::model::HeightGrid;
use deepfield_data::import::ImportError;
use deepfield_data::model::{SampleType, Unit};

/// Keys: the kind of system, whether places are of points or areas, the systems' numbers, and the units'.
const MODEL: u64 = 1024;
const RASTER: u64 = 1025;
const GEOGRAPHIC: u64 = 2048;
const ANGLES: u64 = 2054;
const PROJECTED: u64 = 3072;
const LINEAR: u64 = 3076;
const LINEAR_SIZE: u64 = 3077;
const VERTICAL: u64 = 4099;

/// Values of keys: points instead of areas, degrees of longitude and latitude, and what the file says itself.
const POINT: u64 = 2;
const IN_ANGLES: u64 = 2;
const DEGREE: u64 = 9102;
const METRE: u64 = 9001;
const USER_DEFINED: u64 = 32767;

/// Heights in single precision that are as large as this are compared with what stands for no data to its digits: few
/// are written.
const HUGE: f64 = 1e30;

/// What a file says.
pub(super) struct Geo {
    /// First place and steps.
    place: Option<[[f64; 2]; 2]>,
    /// What stands for no data.
    pub no_data: NoData,
    keys: Keys,
    has_ties_only: bool,
}

/// Keys, each with its value, and the floats that some name.
struct Keys {
    keys: Vec<[u64; 4]>,
    floats: Vec<f64>,
}

impl Keys {
    /// A key's whole number.
    fn number(&self, key: u64) -> Option<u64> {
        self.keys.iter().find(|[own, location, ..]| *own == key && *location == 0).map(|[.., value]| *value)
    }

    /// A key's float.
    fn float(&self, key: u64) -> Option<f64> {
        let is = |[own, location, ..]: &&[u64; 4]| *own == key && *location == u64::from(tag::KEY_NUMBERS);
        let [.., place] = self.keys.iter().find(is)?;
        self.floats.get(usize::try_from(*place).ok()?).copied()
    }
}

impl Geo {
    /// Reads what a directory says of an image of this type.
    ///
    /// # Errors
    /// Where entries are damaged, or pixels are turned.
    pub(super) fn read(directory: &Directory, kind: SampleType) -> Result<Geo, ImportError> {
        let content = directory.content;
        let keys = directory.numbers(tag::KEYS, 4096)?.unwrap_or_default();
        // The first four say which version they are, and how many.
        let keys = keys.as_chunks::<4>().0.iter().skip(1).copied().collect();
        let keys = Keys { keys, floats: directory.floats(tag::KEY_NUMBERS)?.unwrap_or_default() };
        let half = if keys.number(RASTER) == Some(POINT) { 0.0 } else { 0.5 };
        let tie = directory.floats(tag::TIE)?.unwrap_or_default();
        let mut has_ties_only = false;
        let place = if let Some(scale) = directory.floats(tag::SCALE)? {
            Some(of_scale(content, &scale, &tie, half)?)
        } else if let Some(matrix) = directory.floats(tag::TRANSFORMATION)? {
            Some(of_matrix(content, &matrix, half)?)
        } else {
            has_ties_only = !tie.is_empty();
            None
        };
        let no_data = directory.text(tag::NO_DATA)?.map_or(NoData::Nothing, |text| no_data(&text, kind));
        Ok(Geo { place, no_data, keys, has_ties_only })
    }

    /// The value that samples have which the file leaves out.
    pub(super) fn no_data_value(&self) -> f64 {
        match self.no_data {
            NoData::Nothing => 0.0,
            NoData::Value(value) | NoData::Range(value, _) => value,
        }
    }

    /// Tells a grid; whether the distance of samples is stated.
    pub(super) fn apply(&self, grid: &mut HeightGrid, notes: &mut Vec<String>) -> bool {
        if let Some([origin, step]) = self.place {
            (grid.origin, grid.step) = (origin, step);
        }
        if self.has_ties_only {
            notes.push("ground control points are left out: there is no scale of pixels".into());
        }
        let code = |key: u64| self.keys.number(key).filter(|code| (1..USER_DEFINED).contains(code));
        let is_in_angles = self.keys.number(MODEL) == Some(IN_ANGLES);
        let epsg = if is_in_angles { code(GEOGRAPHIC) } else { code(PROJECTED).or_else(|| code(GEOGRAPHIC)) };
        grid.crs = epsg.map(|code| format!("EPSG:{code}"));
        if is_in_angles {
            match self.keys.number(ANGLES) {
                None | Some(DEGREE) => grid.xy_unit = Unit::new("deg"),
                Some(other) => notes.push(format!("angles are in EPSG's unit {other}, which is not known")),
            }
        } else if let Some(unit) = self.keys.number(LINEAR) {
            match self.length(unit) {
                Some(name) => grid.xy_unit = Unit::new(name),
                None => {
                    notes.push(format!("lengths are in EPSG's unit {unit}, which is not known: --xy-unit says another"))
                }
            }
        } else if code(PROJECTED).is_some_and(is_metric) {
            grid.xy_unit = Unit::new("m");
        }
        if self.keys.number(VERTICAL) == Some(METRE) {
            grid.height_unit = Unit::new("m");
        }
        self.place.is_some()
    }

    /// The name of a unit of lengths.
    fn length(&self, unit: u64) -> Option<&'static str> {
        match unit {
            METRE => Some("m"),
            1025 => Some("mm"),
            9036 => Some("km"),
            USER_DEFINED => {
                let metres = self.keys.float(LINEAR_SIZE)?;
                let known = [("km", 1e3), ("m", 1.0), ("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9)];
                known.iter().find(|(_, own)| (metres / own - 1.0).abs() < 1e-9).map(|(name, _)| *name)
            }
            _ => None,
        }
    }
}

/// Systems whose unit is the metre: UTM on WGS 84 and ETRS89, and the web's Mercator.
fn is_metric(code: u64) -> bool {
    matches!(code, 32601..=32660 | 32701..=32760 | 25828..=25838 | 3857)
}

/// Steps, and the place of a pixel's corner or middle.
fn of_scale(content: &Content, scale: &[f64], tie: &[f64], half: f64) -> Result<[[f64; 2]; 2], ImportError> {
    let &[dx, dy, ..] = scale else {
        return Err(content.malformed("ModelPixelScale", format!("{} numbers", scale.len()), "3"));
    };
    let shown = || format!("{dx}, {dy}");
    if ![dx, dy].iter().all(|step| step.is_finite() && *step != 0.0) {
        return Err(content.malformed("ModelPixelScale", shown(), "two numbers other than 0"));
    }
    let [column, row, x, y] = match tie {
        [] => [0.0; 4],
        [column, row, _, x, y, ..] => [*column, *row, *x, *y],
        _ => return Err(content.malformed("ModelTiepoint", format!("{} numbers", tie.len()), "6")),
    };
    let origin = [x + (half - column) * dx, y - (half - row) * dy];
    if !origin.iter().all(|axis| axis.is_finite()) {
        return Err(content.malformed("ModelTiepoint", format!("{x}, {y}"), "finite numbers"));
    }
    // A place that a row further on is smaller, unless the scale says otherwise.
    Ok([origin, [dx, -dy]])
}

/// The same by a matrix of 4 x 4 that does not turn.
fn of_matrix(content: &Content, matrix: &[f64], half: f64) -> Result<[[f64; 2]; 2], ImportError> {
    let field = "ModelTransformation";
    let Some(&[[dx, turn_x, _, x], [turn_y, dy, _, y]]) =
        matrix.first_chunk::<8>().map(|rows| rows.as_chunks().0).and_then(|rows| rows.first_chunk())
    else {
        return Err(content.malformed(field, format!("{} numbers", matrix.len()), "16"));
    };
    if !matrix.iter().all(|number| number.is_finite()) || dx == 0.0 && turn_x == 0.0 || dy == 0.0 && turn_y == 0.0 {
        return Err(content.malformed(
            field,
            format!("{dx}, {turn_x}; {turn_y}, {dy}"),
            "steps that are numbers other than 0",
        ));
    }
    if turn_x != 0.0 || turn_y != 0.0 {
        let found = format!("a rotated or sheared image ({dx}, {turn_x}; {turn_y}, {dy})");
        return Err(content.malformed(field, found, "rows and columns along the axes"));
    }
    Ok([[x + half * dx, y + half * dy], [dx, dy]])
}

/// What GDAL's text says stands for no data.
fn no_data(text: &str, kind: SampleType) -> NoData {
    match text.trim().parse::<f64>() {
        // Written with fewer digits than single precision has.
        Ok(value) if kind == SampleType::F32 && value.is_finite() && value.abs() >= HUGE => {
            let around = 1e-5 * value.abs();
            NoData::Range(value - around, value + around)
        }
        Ok(value) if kind == SampleType::F32 && value.is_finite() => NoData::Value(f64::from(value as f32)),
        Ok(value) if value.is_finite() => NoData::Value(value),
        _ => NoData::Nothing,
    }
}
