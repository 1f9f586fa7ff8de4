//! SRTM's `.hgt`: a square of a degree, told by its exact size; where it is is told by its name.

#[cfg(test)]
mod tests;

use super::content::Content;
use super::raw::{Layout, RawSamples};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Unit};

/// Samples of 3 and of 1 seconds of arc; rows go from north to south.
pub(super) const HGT: HeightFormat = HeightFormat { name: "hgt", extensions: &["hgt"], is_sure: always, detect, open };

/// Samples of a side.
const SIDES: [u64; 2] = [1201, 3601];

/// What stands for no data.
const VOID: f64 = -32768.0;

fn side_of(length: u64) -> Option<u64> {
    SIDES.into_iter().find(|side| side * side * 2 == length)
}

/// By the ending, or by the size with a name that tells the place.
fn detect(content: &Content) -> bool {
    content.has_extension("hgt") || side_of(content.length).is_some() && corner(content).is_some()
}

/// Longitude and latitude of the south-western sample, by a name such as `N39W106`.
fn corner(content: &Content) -> Option<[f64; 2]> {
    let name = content.path.file_name()?.to_str()?.to_ascii_uppercase();
    let number = |text: &str, plus: &str, minus: &str, most: f64| {
        let (letter, digits) = text.split_at_checked(1)?;
        let sign = if letter == plus {
            1.0
        } else if letter == minus {
            -1.0
        } else {
            return None;
        };
        let number: f64 = digits.bytes().all(|byte| byte.is_ascii_digit()).then(|| digits.parse().ok()).flatten()?;
        (number <= most).then_some(sign * number)
    };
    let latitude = number(name.get(..3)?, "N", "S", 90.0)?;
    let longitude = number(name.get(3..7)?, "E", "W", 180.0)?;
    // Nothing but other words may follow.
    let ends = name.as_bytes().get(7).is_none_or(|byte| !byte.is_ascii_alphanumeric());
    ends.then_some([longitude, latitude])
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let side = side_of(content.length).ok_or_else(|| {
        let sizes = SIDES.map(|side| format!("{} ({side} x {side} of int16)", side * side * 2)).join(" or ");
        content.malformed("size", format!("{} bytes", content.length), sizes)
    })?;
    let mut grid = HeightGrid::new(side, side, SampleType::I16);
    let step = 1.0 / (side - 1) as f64;
    let place = corner(content);
    let [west, south] = place.unwrap_or_default();
    (grid.origin, grid.step) = ([west, south + 1.0], [step, -step]);
    (grid.xy_unit, grid.height_unit, grid.crs) = (Unit::new("deg"), Unit::new("m"), Some("EPSG:4326".into()));
    let samples =
        RawSamples::new(content, "samples", Layout::packed([side, side], 0, SampleType::I16, ByteOrder::Big))?;
    let mut about = HeightDescription::new(content, HGT.name, grid);
    about.has_spacing = true;
    if place.is_none() {
        about
            .notes
            .push("the file's name does not tell its place, such as N39W106.hgt: its corner counts as 0, 0".into());
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Value(VOID)))
}
